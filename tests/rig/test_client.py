"""The motor node against clients that nobody here wrote: python-canopen and tshark, on a vcan bus.

The tests themselves are in tests/rig/client; one pytest runs them all inside one sandbox, since
the kernel of this machine may have no CAN.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from hpmc.layout import ROOT, WITH_VCAN

CLIENT = Path(__file__).parent / "client"
LIMIT_S = 240.0  # of about 40 on a quiet machine


def test_clients_on_a_virtual_bus(tmp_path: Path) -> None:
    capture = tmp_path / "candump.log"
    ran = subprocess.run(
        [str(WITH_VCAN), sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider",
         "--color=no", "--durations=5", "-o", "faulthandler_timeout=60", str(CLIENT)],
        cwd=ROOT, env=os.environ | {"HPMC_CLIENT_CAPTURE": str(capture)}, timeout=LIMIT_S,
        stdin=subprocess.DEVNULL, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-20000:] + ran.stderr[-4000:]
    print(ran.stdout)
    passed = re.search(r"(\d+) passed", ran.stdout)
    assert passed and int(passed[1]) >= 55, ran.stdout
    decode(capture)


def decode(capture: Path) -> None:
    """Every frame of the capture is CANopen to tshark, and none is malformed. (It hands frames
    without data, the SYNCs, to no dissector.)"""
    ran = subprocess.run(
        ["tshark", "-r", str(capture), "-d", "can.subdissector,canopen", "-T", "fields",
         "-e", "frame.protocols", "-e", "_ws.malformed", "-e", "can.len", "-e", "can.id"],
        timeout=60, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    frames = [line.split("\t") for line in ran.stdout.splitlines()]
    assert len(frames) > 1000
    assert [frame for frame in frames if frame[1]] == []
    assert [f for f in frames if "canopen" not in f[0] and f[2:] != ["0", "128"]] == []
