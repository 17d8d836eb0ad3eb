"""What test_can.py runs inside a sandbox: a motor node, its master, and `hpmc can` looking on."""

import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import can
import canopen

from hpmc.can import sources
from hpmc.candump import Frame
from hpmc.layout import PROGRAMS, ROOT

NODE = 5
LIMIT_S = 60.0
FLOOD = 5000


def until(ask: Callable[[], object], what: str) -> None:
    limit = time.monotonic() + LIMIT_S
    while not ask():
        assert time.monotonic() < limit, f"not within {LIMIT_S:.0f} s: {what}"
        time.sleep(0.01)


def onlooker(out: Path) -> subprocess.Popen[bytes]:
    """`./rig can vcan0`, once it has seen the node."""
    with out.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "hpmc", "can", "vcan0", "--lines"],
            stdout=file, stderr=file, cwd=ROOT,
        )  # fmt: skip
    until(lambda: "N5_heartbeat" in out.read_text() or process.poll() is not None, "a heartbeat")
    assert process.poll() is None, out.read_text()
    return process


def see_services(out: Path) -> None:
    """SDO read in segments, refused write, emergency: each in words."""
    process = onlooker(out)
    network = canopen.Network()
    network.connect(interface="socketcan", channel="vcan0")
    node = network.add_node(NODE, str(ROOT / "firmware" / "od" / "motor_node.eds"))
    assert node.sdo[0x1008].raw == "FIC motor node"
    try:
        node.sdo[0x1000].raw = 1
    except canopen.SdoAbortedError as error:
        assert error.code == 0x06010002
    node.nmt.send_command(1)
    network.send_message(0x080, b"\x01")  # a counter that is not configured: 8240h once
    expected = (
        "N5_SDO_request  read 1008h Manufacturer device name",
        "N5_SDO_reply    1008h Manufacturer device name = 14 bytes in segments",
        "N5_SDO_reply    segment: b'FIC mot'",
        "N5_SDO_reply    abort of 1000h Device type: 06010002h ",
        "NMT             start: node 5",
        "N5_EMCY         8240h SYNC of unexpected length",
    )
    for text in expected:
        until(lambda text=text: text in out.read_text(), f"{text}\n{out.read_text()[-3000:]}")
    network.disconnect()
    process.send_signal(signal.SIGINT)
    assert process.wait(LIMIT_S) == 130, out.read_text()


def count_drops() -> None:
    """What the kernel drops for a reader that is too slow is counted, frame by frame."""
    sources._BUFFER_BYTES = 1  # the least that the kernel gives
    with sources.Interface("vcan0") as slow, can.Bus(interface="socketcan", channel="vcan0") as bus:
        for number in range(FLOOD):
            bus.send(can.Message(
                arbitration_id=0x333, data=number.to_bytes(4, "little"), is_extended_id=False
            ))  # fmt: skip
        seen: list[Frame] = []
        # The next frame tells how many were lost before it.
        limit = time.monotonic() + LIMIT_S
        while not any(frame.cob_id == 0x334 for frame in seen):
            assert time.monotonic() < limit
            seen += slow.read(0.2)
            bus.send(can.Message(arbitration_id=0x334, is_extended_id=False))
        flood = [frame for frame in seen if frame.cob_id == 0x333]
        assert 0 < len(flood) < FLOOD
        assert slow.dropped >= FLOOD - len(flood) > 0, (slow.dropped, len(flood))
        # Frames of the node may be among the lost ones.
        assert slow.dropped - (FLOOD - len(flood)) < FLOOD // 2


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "lines.txt"
        node = subprocess.Popen(
            [PROGRAMS["motor_node"], "--free-running", "--id", str(NODE), "--can", "vcan0"],
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            see_services(out)
            print("LISTEN FROM OUTSIDE", flush=True)
            sys.stdin.readline()
            count_drops()
            last = onlooker(out)
            subprocess.run(["ip", "link", "del", "vcan0"], check=True)
            assert last.wait(LIMIT_S) == 3
            # First it goes down, then away: either may be seen first.
            assert re.search(
                "\nrig can: vcan0 has gone: (No such device|Network is down)\n$", out.read_text()
            ), out.read_text()[-300:]
        finally:
            node.kill()
            node.wait()
    print("ALL WELL", flush=True)


if __name__ == "__main__":
    main()
