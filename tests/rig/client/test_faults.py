"""What a node does when things go wrong, seen from the bus: the table of docs/protocol.md.

Rows that other files test: a command that stays away (test_drive.py), PDOs and SYNCs of wrong
length (test_network.py).
"""

from __future__ import annotations

import struct
import time

import can
import canopen
from conftest import EDS, Bench, ticks, until, until_booted

POSITION_LIMIT = 0x0008
TEMPERATURE = 0x0040
CURRENT = 0x0080
NO_COMMAND = 0x0200
OUTSIDE_WINDOW = 0x0400
SPEED = 0x4000
CLOCK = 0x8000
WARNING = 0x0080


def enable(drive: canopen.BaseNode402, torque_mNm: int = 0) -> None:
    """Operation enabled in mode 10 with this torque."""
    drive.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    drive.rpdo[1]["Target torque"].raw = torque_mNm
    drive.rpdo[1]["Max torque"].raw = 5000
    drive.state = "OPERATION ENABLED"
    until(lambda: drive.state == "OPERATION ENABLED")


def fault_of(drive: canopen.BaseNode402, limit_s: float = 5.0) -> int:
    """Waits for the fault, which stays; returns its code."""
    until(lambda: drive.emcy.log, limit_s)
    until(lambda: drive.sdo[0x6041].raw & 0x4F == 0x08, limit_s)
    assert drive.sdo[0x6077].raw == 0
    drive.controlword = 0x0F
    time.sleep(0.03)
    assert drive.sdo[0x6041].raw & 0x4F == 0x08
    return drive.sdo[0x603F].raw


def restart(bench: Bench, drive: canopen.BaseNode402, *options: str) -> None:
    """The node anew, with other options, operational."""
    bench.stop()
    drive.emcy.log.clear()
    drive.nmt._state = 0
    bench.start(5, *options)
    until_booted(drive)
    drive.sdo[0x1400][5].raw = 200
    drive.nmt.state = "OPERATIONAL"
    time.sleep(0.05)


def inject(network: canopen.Network, position: int, flags: int = 0, dC: int = 250) -> None:
    network.send_message(0x505, struct.pack("<iBBh", position, 0, flags, dC))


def test_more_missed_syncs_than_allowed(
    drive: canopen.BaseNode402, network: canopen.Network
) -> None:
    drive.sdo[0x1400][5].raw = 2000
    enable(drive)
    drive.sdo[0x2102].raw = 20
    drive.sdo[0x1006].raw = 5000
    network.sync.stop()
    assert fault_of(drive) == 0x8700
    assert drive.sdo[0x2201][1].raw >= 20


def test_same_sync_counter_again_and_a_jump(
    drive: canopen.BaseNode402, network: canopen.Network
) -> None:
    network.sync.stop()
    time.sleep(0.05)
    drive.sdo[0x1019].raw = 240
    replies: list[float] = []
    network.subscribe(0x185, lambda _id, _data, stamp: replies.append(stamp))
    for counter, answers in ((1, 1), (2, 2), (2, 2), (5, 3), (6, 4)):
        network.send_message(0x080, bytes([counter]))
        time.sleep(0.03)
        assert len(replies) == answers, counter
    assert drive.sdo[0x2201][2].raw == 1
    assert drive.sdo[0x2201][3].raw == 1


def test_heartbeat_of_the_host_lost_while_enabled(
    drive: canopen.BaseNode402, network: canopen.Network
) -> None:
    drive.sdo[0x1016][1].raw = 127 << 16 | 200
    enable(drive)
    network.send_message(0x77F, b"\5")
    assert fault_of(drive) == 0x8130
    assert drive.emcy.log[0].data[0] == 127


def test_emergency_of_a_peer(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    drive.sdo[0x1028][1].raw = 0x081
    enable(drive)
    network.send_message(0x082, struct.pack("<HBBi", 0x8400, 0x21, 0, 0))
    time.sleep(0.05)
    assert drive.emcy.log == []
    network.send_message(0x081, struct.pack("<HBBi", 0x8400, 0x21, 0, 0))
    assert fault_of(drive) == 0x8130
    assert drive.emcy.log[0].data[0] == 1


def test_nmt_leaves_operational_while_enabled(drive: canopen.BaseNode402) -> None:
    enable(drive)
    drive.nmt.state = "PRE-OPERATIONAL"
    until(lambda: drive.emcy.log)
    assert drive.emcy.log[0].code == 0x8250
    until(lambda: drive.sdo[0x6041].raw & 0x4F == 0x08)


def test_bus_off(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    enable(drive)
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        for error_class in (0x040, 0x100):  # bus-off, restarted, as the kernel tells them
            bus.send(can.Message(arbitration_id=error_class, is_error_frame=True, dlc=8,
                                 data=bytes(8), is_extended_id=False))  # fmt: skip
            time.sleep(0.2)
            assert len(drive.emcy.log) == (0 if error_class == 0x040 else 1)
    assert fault_of(drive) == 0x8140


def test_own_node_id_heard_from_another_device(
    drive: canopen.BaseNode402, network: canopen.Network
) -> None:
    enable(drive)
    network.send_message(0x185, bytes(8))
    until(lambda: drive.emcy.log)
    assert drive.emcy.log[0].code == 0x8100
    time.sleep(0.15)
    drive.nmt.wait_for_heartbeat(1.0)
    assert drive.nmt.state == "STOPPED"
    drive.nmt.state = "PRE-OPERATIONAL"
    time.sleep(0.05)
    assert drive.sdo[0x6041].raw & 0x4F == 0x08


def test_position_limit(bench: Bench, drive: canopen.BaseNode402) -> None:
    restart(bench, drive, "--referenced", "--inertia", "0.5")
    drive.sdo[0x607D][2].raw = 300
    enable(drive, 1000)
    until(lambda: drive.emcy.log)
    assert drive.emcy.log[0].code == 0x8612
    assert drive.sdo[0x2200].raw & POSITION_LIMIT
    assert drive.sdo[0x6077].raw == 0
    assert drive.sdo[0x6041].raw & WARNING
    drive.rpdo[1]["Target torque"].raw = -1000  # the way back is free
    until(lambda: drive.sdo[0x6064].raw < 300)
    assert drive.state == "OPERATION ENABLED"


def test_overspeed(drive: canopen.BaseNode402) -> None:
    drive.sdo[0x6080].raw = 60
    enable(drive, 500)
    until(lambda: drive.sdo[0x2200].raw & SPEED)  # the derating holds it just below
    time.sleep(0.2)
    assert drive.emcy.log == []
    drive.sdo[0x6080].raw = 40
    assert fault_of(drive) == 0x8400


def test_encoder_jump(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    drive.sdo[0x1400][5].raw = 2000
    drive.sdo[0x2F00].raw = 1
    inject(network, 1000)
    enable(drive)
    inject(network, 1100)
    time.sleep(0.05)
    assert drive.emcy.log == []
    inject(network, 2000000)
    assert fault_of(drive) == 0x7305
    assert drive.emcy.log[0].data[0] == 1


def test_index_pulse_out_of_its_place(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    drive.sdo[0x1400][5].raw = 5000
    drive.sdo[0x2F00].raw = 1
    drive.sdo[0x6098].raw = 34
    inject(network, 0)
    drive.op_mode = "HOMING"
    drive.state = "OPERATION ENABLED"
    drive.controlword = 0x1F
    time.sleep(0.05)
    inject(network, 100, flags=1)
    until(lambda: drive.sdo[0x6041].raw & 0x8000)
    inject(network, 0)
    time.sleep(0.02)
    inject(network, -1000, flags=1)
    assert fault_of(drive) == 0x7305
    assert drive.emcy.log[0].data[0] == 2


def test_encoder_stuck_under_torque(bench: Bench, drive: canopen.BaseNode402) -> None:
    restart(bench, drive, "--coulomb-friction", "100")
    enable(drive, 3900)
    time.sleep(0.8)
    assert drive.emcy.log == []
    drive.rpdo[1]["Target torque"].raw = 4100  # above 80 % of TA
    assert fault_of(drive) == 0x7305
    assert drive.emcy.log[0].data[0] == 3


def test_over_current(bench: Bench, drive: canopen.BaseNode402) -> None:
    restart(bench, drive, "--coulomb-friction", "100")
    drive.sdo[0x6075].raw = 400  # mA; 1 A makes 5 N m
    drive.sdo[0x2105][3].raw = 100
    enable(drive, 3000)
    until(lambda: drive.sdo[0x2200].raw & CURRENT)
    until(lambda: 2000 <= drive.sdo[0x6077].raw <= 2900)
    assert 1000 <= drive.sdo[0x6078].raw <= 1500
    assert drive.emcy.log == []
    drive.sdo[0x2105][4].raw = 300
    assert fault_of(drive) == 0x2310


def test_over_temperature(drive: canopen.BaseNode402, network: canopen.Network) -> None:
    drive.sdo[0x1400][5].raw = 5000
    drive.sdo[0x2F00].raw = 1
    inject(network, 0, dC=1100)
    enable(drive, 4000)
    until(lambda: drive.sdo[0x6077].raw == 2500)  # half of TA
    assert drive.sdo[0x2200].raw & TEMPERATURE
    assert drive.emcy.log == []
    inject(network, 0, dC=1200)
    assert fault_of(drive) == 0x4310
    assert drive.emcy.log[0].register & 0x08


def test_several_commands_before_one_sync(
    drive: canopen.BaseNode402, network: canopen.Network
) -> None:
    enable(drive)
    drive.rpdo[1].stop()
    network.sync.stop()
    drive.sdo[0x1400][5].raw = 2000
    time.sleep(0.05)
    before = drive.sdo[0x2201][4].raw
    for torque in (100, 200, 300):
        network.send_message(0x205, struct.pack("<ihH", 0, torque, 5000))
    network.sync.transmit()
    time.sleep(0.03)
    assert drive.sdo[0x6077].raw == 300
    assert drive.sdo[0x2201][4].raw - before in (2, 3)


def test_watchdog_reset_boots_disabled(bench: Bench, network: canopen.Network) -> None:
    node = network.add_node(5, str(EDS))
    bench.start(5, "--after-watchdog")
    until(lambda: node.emcy.log)
    assert node.emcy.log[0].code == 0x6010
    assert node.sdo[0x6041].raw & 0x6F == 0x60
    node.nmt.state = "RESET"  # an ordinary one
    until_booted(node)
    time.sleep(0.2)
    assert len(node.emcy.log) == 1


def test_internal_oscillator(bench: Bench, drive: canopen.BaseNode402) -> None:
    restart(bench, drive, "--internal-oscillator")
    drive.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    drive.state = "SWITCHED ON"
    drive.controlword = 0x0F
    until(lambda: drive.sdo[0x2200].raw & CLOCK)
    assert drive.sdo[0x6041].raw & 0x6F == 0x23
    drive.sdo[0x2F01].raw = 1  # stepped: node time does not come from the oscillator
    with ticks(drive.network, drive.id):
        drive.state = "OPERATION ENABLED"
        until(lambda: drive.state == "OPERATION ENABLED")
        assert drive.sdo[0x2200].raw & CLOCK == 0


def test_refusals_say_why(bench: Bench, drive: canopen.BaseNode402) -> None:
    restart(bench, drive, "--referenced")
    drive.rpdo[2]["Modes of operation"].raw = -1
    drive.rpdo[1]["Target position"].raw = 5000
    time.sleep(0.05)
    drive.state = "SWITCHED ON"
    drive.controlword = 0x0F
    until(lambda: drive.sdo[0x2200].raw & OUTSIDE_WINDOW)
    drive.rpdo[1].stop()
    time.sleep(0.3)
    drive.controlword = 0x0F
    until(lambda: drive.sdo[0x2200].raw & NO_COMMAND)
    assert drive.sdo[0x6041].raw & 0x6F == 0x23


