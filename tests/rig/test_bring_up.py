"""The nodes are led up and down the standard way: read from the frames and torques of a log."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import pytest
from rigrun import JOINTS, TORQUE_LIMIT_NM, Frame, Run, frames, torques_nm

PERIODS = 17250
SETUP, STOP = 1000, 17000
RAMP_PERIODS = 100
SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP = 0x40, 0x21, 0x23, 0x27, 0x07
NMT, SYNC, RPDO1, RPDO2, SDO, ANSWER = 0x000, 0x080, 0x200, 0x300, 0x600, 0x580
TPDO1, TPDO2, HEARTBEAT = 0x180, 0x280, 0x700


@pytest.fixture(scope="module")
def bus(vcan: Run) -> list[Frame]:
    """The frames of the setup and of the stop."""
    log = vcan.log()
    return [*frames(log, 0, SETUP + 100), *frames(log, STOP - 100, PERIODS)]


def state(statusword: int) -> int:
    masked = statusword & 0x6F
    return SWITCH_ON_DISABLED if statusword & 0x4F == SWITCH_ON_DISABLED else masked


def changes(values: Iterable[int]) -> list[int]:
    return [value for value, _ in itertools.groupby(values)]


def states_of(bus: list[Frame], node: int) -> list[tuple[int, int]]:
    """Period and drive state of each TPDO1."""
    return [(f.period, state(f.word(6))) for f in bus if f.id == TPDO1 + node]


def enabled_since(bus: list[Frame], node: int) -> int:
    return next(period for period, value in states_of(bus, node) if value == ENABLED)


def test_reset_boot_up_configuration_start(bus: list[Frame]) -> None:
    commands = [(f.period, f.data) for f in bus if f.id == NMT]
    assert [data for _, data in commands] == [b"\x81\x00", b"\x01\x00", b"\x02\x00"]
    assert commands[0][0] == 0
    started = commands[1][0]

    for node in JOINTS:
        booted = [f.period for f in bus if f.id == HEARTBEAT + node and f.data == b"\x00"]
        requests = [f for f in bus if f.id == SDO + node]
        answers = [f for f in bus if f.id == ANSWER + node]
        assert booted and booted[-1] < requests[0].period < started
        # CiA 301: a download is confirmed with 60h and the same object.
        assert [f.data[:4] for f in answers] == [b"\x60" + f.data[1:4] for f in requests]
        assert all(f.data[0] & 0xE3 == 0x23 for f in requests)
        assert answers[-1].period < started
    assert not [f for f in bus if f.period < started and f.id in (SYNC, *range(0x201, 0x304))]


def test_what_is_configured(bus: list[Frame]) -> None:
    for node in JOINTS:
        written = {
            (f.word(1), f.data[3]): f.word(4, 4 - (f.data[0] >> 2 & 3))
            for f in bus
            if f.id == SDO + node
        }
        expected = {
            (0x1017, 0): 100,  # heartbeat
            (0x1019, 0): 240,  # SYNC counter
            (0x1400, 5): 5,  # deadline of the command, SYNC periods
            (0x608F, 1): 65536,
            (0x2F00, 0): 0,  # direct sensors
            (0x2F01, 0): 1,  # stepped time base
        }
        assert expected.items() <= written.items()
        listened = {written[0x1016, i] >> 16 for i in (1, 2, 3)}
        assert listened == {127, 1, 2, 3} - {node}
        limit_mnm = round(1000 * TORQUE_LIMIT_NM[node - 1])
        assert limit_mnm in [value for (index, _), value in written.items() if index == 0x2100]


def test_at_most_one_acyclic_frame_of_the_host_in_a_period(bus: list[Frame]) -> None:
    acyclic = [f.period for f in bus if f.sender == 0 and f.function not in (RPDO1, SYNC)]
    stop = [f.period for f in bus if f.id in (0x301, 0x302, 0x303) and f.data[0] == 2]
    assert len(stop) == 3 and set(stop) == {STOP}  # in place of the commands of its period
    assert max(np.bincount([p for p in acyclic if p != STOP])) == 1


def test_each_period_has_commands_then_sync_and_every_node_answers(bus: list[Frame]) -> None:
    started = next(f.period for f in bus if f.id == NMT and f.data[0] == 1)
    counter = 0
    for period in range(started + 1, SETUP):
        from_host = [f for f in bus if f.period == period and f.sender == 0]
        assert [f.id for f in from_host[-4:]] == [0x201, 0x202, 0x203, SYNC]
        counter = counter % 240 + 1
        assert from_host[-1].data == bytes([counter])
        from_nodes = [f.id for f in bus if f.period == period and f.function == TPDO1]
        assert from_nodes == [0x181, 0x182, 0x183]


def test_the_states_of_cia_402_in_order(bus: list[Frame]) -> None:
    for node in JOINTS:
        assert changes(value for _, value in states_of(bus, node)) == [
            SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, SWITCH_ON_DISABLED,
        ]  # fmt: skip
        controlwords = [(f.word(0), f.data[2]) for f in bus if f.id == RPDO2 + node]
        assert controlwords == [(6, 0xFF), (7, 0xFF), (0xF, 0xFF), (2, 0), (0, 0)]
        modes = [f.data[0] for f in bus if f.id == TPDO2 + node and f.period > SETUP]
        assert modes and set(modes) == {0xFF}


def test_nodes_and_host_send_heartbeats(bus: list[Frame]) -> None:
    for node in (*JOINTS, 127):
        beats = [
            f.period
            for f in bus
            if f.id == HEARTBEAT + node and f.data == b"\x05" and f.period < SETUP + 100
        ]
        # The host has one acyclic frame a period: configuration may come first.
        assert len(beats) >= 8 and set(np.diff(beats).tolist()) <= {100, 101}


def test_no_torque_before_enabled_or_after_the_stop(vcan: Run, bus: list[Frame]) -> None:
    torque = torques_nm(vcan.log())
    for node in JOINTS:
        column = torque[:, node - 1]
        since = enabled_since(bus, node)
        assert not np.any(column[:since])
        assert np.any(column[since:SETUP])
        assert not np.any(column[STOP + RAMP_PERIODS + 2 :])
        off = {period for period, value in states_of(bus, node) if value in (READY, SWITCHED_ON)}
        assert off and not np.any(column[sorted(off)])


def test_the_bound_ramps_up_and_down(vcan: Run, bus: list[Frame]) -> None:
    torque = np.abs(torques_nm(vcan.log()))
    for node in JOINTS:
        limit = TORQUE_LIMIT_NM[node - 1]
        since = enabled_since(bus, node)
        up = limit * np.arange(1, RAMP_PERIODS + 1) / RAMP_PERIODS
        assert np.all(torque[since : since + RAMP_PERIODS, node - 1] <= up + 1e-3)
        down = limit * (1 - np.arange(RAMP_PERIODS) / RAMP_PERIODS)
        assert np.all(torque[STOP : STOP + RAMP_PERIODS, node - 1] <= down + 1e-3)
        assert np.all(torque[:, node - 1] <= limit)


def test_the_plant_gets_the_torques_of_the_nodes(vcan: Run) -> None:
    log = vcan.log()
    torque = torques_nm(log)
    assert np.array_equal(log.column("ARM_STATE", "tau_Nm")[1:], torque[:-1])
    assert np.array_equal(torque, np.round(torque * 1000) / 1000)  # whole mN m


def test_the_approach_comes_before_the_first_reach(vcan: Run, bus: list[Frame]) -> None:
    log = vcan.log()
    phase = log.column("HPMC_STATE", "phase")
    assert changes(phase.tolist()) == [0, 1, 2, 3, 4, 5]
    approach = np.flatnonzero(phase == 3)
    assert approach[-1] == SETUP - 1 and approach.size > 500

    q_d, q = log.column("HPMC_STATE", "q_d_rad"), log.column("HPMC_STATE", "q_rad")
    x_d, hand = log.column("HPMC_STATE", "x_d_m"), log.column("ARM_STATE", "hand_m")
    first = approach[0]
    increment = 2 * np.pi / 65536
    assert np.all(np.abs(q_d[first] - q[first]) < increment)
    assert np.linalg.norm(x_d[first] - hand[first]) < 1e-4
    assert np.all(np.abs(np.diff(q_d[approach], axis=0)) <= 0.004 + 1e-12)
    assert np.linalg.norm(hand[SETUP] - (0.3, 0.0)) < 0.003

    # Reduced torque until the blend is over: RPDO1 carries 0.3 of T_max.
    maximum = log.column("HPMC_STATE", "tau_max_Nm")
    for f in bus:
        if f.function == RPDO1 and first < f.period < first + 250:
            assert f.word(6) == round(300 * maximum[f.period, f.node - 1])
    full = [f for f in bus if f.function == RPDO1 and f.period == SETUP + 50]
    assert [f.word(6) for f in full] == [round(1000 * t) for t in maximum[SETUP + 50]]


def test_commands_on_the_bus_are_those_of_the_layers(vcan: Run) -> None:
    log = vcan.log()
    scale = 65536 / (2 * np.pi)
    first = 8000
    q_d = log.column("HPMC_STATE", "q_d_rad", first, first + 200)
    tau_d = log.column("HPMC_STATE", "tau_d_Nm", first, first + 200)
    tau_max = log.column("HPMC_STATE", "tau_max_Nm", first, first + 200)
    q = log.column("HPMC_STATE", "q_rad", first, first + 200)
    for f in frames(log, first, first + 200):
        joint, row = f.node - 1, f.period - first
        if f.function == RPDO1:
            assert f.word(0, 4, signed=True) == round(q_d[row, joint] * scale)
            assert f.word(4, signed=True) == pytest.approx(1000 * tau_d[row, joint], abs=0.501)
            assert f.word(6) == pytest.approx(1000 * tau_max[row, joint], abs=0.501)
        elif f.function == TPDO1 and 0 <= row < 199:
            # Measured in this period, known to the host in the next.
            assert f.word(0, 4, signed=True) == round(q[row + 1, joint] * scale)
