"""NMT, heartbeat, emergencies, SYNC and PDOs, by python-canopen."""

from __future__ import annotations

import itertools
import statistics
import struct
import time

import canopen
import pytest
from conftest import EDS, Bench, until, until_booted


def test_boot_up_and_the_nmt_commands(node: canopen.BaseNode402) -> None:
    assert node.sdo[0x1000].raw == 0x00020192
    for state in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL"):
        node.nmt.state = state
        time.sleep(0.05)
        node.nmt.wait_for_heartbeat(1.0)  # what the node says, not what was asked for
        assert node.nmt.state == state


@pytest.mark.parametrize("command", ["RESET", "RESET COMMUNICATION"])
def test_resets_boot_again(node: canopen.BaseNode402, command: str) -> None:
    node.sdo[0x1017].raw = 50
    node.sdo[0x2100][4].raw = 1234
    node.nmt.state = command
    until_booted(node)
    assert node.sdo[0x1017].raw == 100
    assert node.sdo[0x2100][4].raw == (5000 if command == "RESET" else 1234)


def test_stopped_has_no_sdo(node: canopen.BaseNode402) -> None:
    node.nmt.state = "STOPPED"
    node.sdo.RESPONSE_TIMEOUT = 0.1
    with pytest.raises(canopen.SdoCommunicationError):
        node.sdo.upload(0x1000, 0)


def test_heartbeat_period(node: canopen.BaseNode402, network: canopen.Network) -> None:
    beats: list[float] = []
    node.sdo[0x1017].raw = 20
    network.subscribe(0x705, lambda _id, _data, stamp: beats.append(stamp))
    until(lambda: len(beats) >= 20)
    periods = [b - a for a, b in itertools.pairwise(beats)]
    assert 0.018 <= statistics.median(periods) <= 0.024


def test_heartbeat_consumer_tells_of_a_lost_master(
    drive: canopen.BaseNode402, network: canopen.Network
) -> None:
    drive.sdo[0x1016][1].raw = 127 << 16 | 60
    network.send_message(0x77F, b"\5")
    until(lambda: drive.emcy.log)
    assert drive.emcy.log[0].code == 0x8130
    assert drive.emcy.log[0].data[0] == 127
    assert drive.sdo[0x1003][1].raw & 0xFFFF == 0x8130


def test_pdo_maps_are_those_of_the_data_sheet(node: canopen.BaseNode402) -> None:
    node.pdo.read()
    sent = {number: [v.name for v in node.tpdo[number].map] for number in (1, 2)}
    taken = {number: [v.name for v in node.rpdo[number].map] for number in (1, 2, 4)}
    assert sent[1] == ["Position actual value", "Torque actual value", "Statusword"]
    assert sent[2][0] == "Modes of operation display"
    assert taken[1] == ["Target position", "Target torque", "Max torque"]
    assert taken[2] == ["Controlword", "Modes of operation"]
    assert len(taken[4]) == 4
    for maps, ids in ((node.tpdo, {1: 0x185, 2: 0x285}), (node.rpdo, {1: 0x205, 2: 0x305,
                                                                      4: 0x505})):  # fmt: skip
        for number, cob_id in ids.items():
            assert maps[number].cob_id == cob_id
            assert maps[number].enabled
    assert [node.tpdo[1].trans_type, node.tpdo[2].trans_type] == [1, 255]


def test_tpdo1_says_what_the_objects_say(drive: canopen.BaseNode402) -> None:
    assert drive.tpdo[1].wait_for_reception(1.0) is not None
    assert drive.tpdo[1]["Position actual value"].raw == drive.sdo[0x6064].raw
    assert drive.tpdo[1]["Torque actual value"].raw == 0
    assert drive.tpdo[1]["Statusword"].raw == drive.sdo[0x6041].raw
    assert drive.tpdo[2].wait_for_reception(1.0) is not None
    assert drive.tpdo[2]["Motor temperature"].raw == 250


def test_sync_without_counter_is_answered_each_time(
    drive: canopen.BaseNode402, network: canopen.Network
) -> None:
    heard = {0x080: 0, 0x185: 0}

    def count(cob_id: int, _data: bytearray, _time: float) -> None:
        heard[cob_id] += 1

    for cob_id in heard:
        network.subscribe(cob_id, count)
    time.sleep(0.5)
    network.sync.stop()
    time.sleep(0.1)
    assert heard[0x080] > 20
    assert abs(heard[0x080] - heard[0x185]) <= 1  # the first may lie between the subscriptions
    assert drive.emcy.log == []
    assert drive.sdo[0x2201][2].raw == 0


def test_two_nodes_on_one_bus(bench: Bench, network: canopen.Network) -> None:
    nodes = [network.add_node(number, str(EDS)) for number in (1, 127)]
    for number in (1, 127):
        bench.start(number, "--serial", str(1000 + number))
    until(lambda: all(node.nmt.state == "PRE-OPERATIONAL" for node in nodes))
    assert [node.sdo[0x1018][4].raw for node in nodes] == [1001, 1127]


def test_pdos_of_wrong_length(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    network.send_message(0x305, b"\6\0")
    until(lambda: len(drive.emcy.log) == 1)
    network.send_message(0x305, b"\6\0\0\0")
    until(lambda: len(drive.emcy.log) == 2)
    assert [e.code for e in drive.emcy.log] == [0x8210, 0x8220]
    assert drive.sdo[0x2201][5].raw == 1
    assert drive.sdo[0x2201][6].raw == 1
    history = [drive.sdo[0x1003][i].raw & 0xFFFF for i in (1, 2)]
    assert history == [0x8220, 0x8210]


def test_sync_of_wrong_length(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    network.send_message(0x080, b"\1")
    until(lambda: drive.emcy.log)
    assert drive.emcy.log[0].code == 0x8240
    time.sleep(0.1)
    network.send_message(0x080, b"\1")
    time.sleep(0.1)
    assert len(drive.emcy.log) == 1


def test_emergency_inhibit_time(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    came: list[float] = []
    drive.sdo[0x1015].raw = 2000  # 200 ms
    network.subscribe(0x085, lambda _id, _data, stamp: came.append(stamp))
    network.send_message(0x305, struct.pack("<H", 6))
    network.send_message(0x305, struct.pack("<HH", 6, 0))
    until(lambda: len(came) == 2)
    assert came[1] - came[0] > 0.15
