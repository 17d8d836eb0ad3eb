"""CiA 402 by python-canopen's BaseNode402: the states, mode 10, and mode -1 by its number."""

from __future__ import annotations

import time

import canopen
import pytest
from conftest import Bench, home, until, until_booted

NOT_REFERENCED = 0x0100
CONVERGENCE = 0x4000
REFERENCED = 0x8000


def test_through_the_states_and_torque_in_mode_10(drive: canopen.BaseNode402) -> None:
    until(lambda: drive.state == "SWITCH ON DISABLED")
    drive.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    assert drive.op_mode == "CYCLIC SYNCHRONOUS TORQUE"
    for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"):
        drive.state = state
        assert drive.state == state
    drive.rpdo[1]["Target torque"].raw = 400
    drive.rpdo[1]["Max torque"].raw = 300
    until(lambda: drive.tpdo[1]["Torque actual value"].raw == 300)
    before = drive.tpdo[1]["Position actual value"].raw
    time.sleep(0.2)
    assert drive.tpdo[1]["Position actual value"].raw > before + 100  # the inertia moves
    drive.state = "QUICK STOP ACTIVE"
    until(lambda: drive.state == "SWITCH ON DISABLED")
    assert drive.tpdo[1]["Torque actual value"].raw == 0
    for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED", "SWITCHED ON",
                  "READY TO SWITCH ON", "SWITCH ON DISABLED"):  # fmt: skip
        drive.state = state
        until(lambda state=state: drive.state == state)


def test_a_silent_master_is_a_fault_and_can_be_reset(drive: canopen.BaseNode402) -> None:
    drive.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    drive.state = "OPERATION ENABLED"
    drive.rpdo[1].stop()
    until(lambda: drive.state == "FAULT")
    assert drive.emcy.log[-1].code == 0x8250
    assert drive.emcy.active[-1].register & 0x11 == 0x11
    assert drive.sdo[0x603F].raw == 0x8250
    drive.rpdo[1].start(0.005)
    drive.reset_from_fault()
    until(lambda: drive.state == "OPERATION ENABLED")
    until(lambda: drive.emcy.log[-1].code == 0)
    assert drive.sdo[0x1001].raw == 0


def test_mode_minus_1_needs_a_reference_and_says_so(drive: canopen.BaseNode402) -> None:
    drive.sdo[0x6060].raw = -1
    drive.state = "SWITCHED ON"
    drive.controlword = 0x0F
    until(lambda: drive.sdo[0x2200].raw & NOT_REFERENCED)
    assert drive.state == "SWITCHED ON"
    assert drive.sdo[0x6041].raw & REFERENCED == 0


def test_mode_minus_1_follows_a_command(drive: canopen.BaseNode402) -> None:
    drive.sdo[0x6098].raw = 37  # here is home
    home(drive)
    drive.state = "SWITCHED ON"
    assert drive.sdo[0x6041].raw & REFERENCED
    here = drive.tpdo[1]["Position actual value"].raw
    drive.rpdo[2]["Modes of operation"].raw = -1  # goes out with the next controlword
    drive.sdo[0x6060].raw = -1
    until(lambda: drive.sdo[0x6061].raw == -1)
    command = drive.rpdo[1]
    command["Target position"].raw = here
    command["Target torque"].raw = 1000
    command["Max torque"].raw = 2000
    time.sleep(0.05)
    drive.controlword = 0x0F
    until(lambda: drive.tpdo[1]["Statusword"].raw & 0x6F == 0x27)
    command["Target position"].raw = here + 400
    until(lambda: abs(drive.tpdo[1]["Position actual value"].raw - here - 400) < 90)
    assert drive.emcy.log == []


@pytest.mark.parametrize(("method", "index_rad"), [(34, 0.3), (33, -0.3)])
def test_homing_finds_the_index_pulse(
    bench: Bench, drive: canopen.BaseNode402, method: int, index_rad: float
) -> None:
    bench.stop()
    drive.nmt._state = 0
    bench.start(5, "--index-rad", str(index_rad))
    until_booted(drive)
    drive.sdo[0x1400][5].raw = 200
    drive.nmt.state = "OPERATIONAL"
    drive.sdo[0x6098].raw = method
    drive.sdo[0x607C].raw = 1000
    home(drive)
    until(lambda: drive.sdo[0x6041].raw & 0x3400 == 0x1400)
    assert abs(drive.sdo[0x6064].raw - 1000) < 200  # stopped just behind the index
    assert drive.sdo[0x6041].raw & REFERENCED
    assert drive.emcy.log == []


def test_homing_without_an_index_pulse_fails(drive: canopen.BaseNode402) -> None:
    drive.sdo[0x6098].raw = 33
    drive.sdo[0x2104][2].raw = 100
    assert not drive.homing(timeout=2.0)
    assert drive.sdo[0x6041].raw & 0x2000
    assert drive.sdo[0x6041].raw & REFERENCED == 0
