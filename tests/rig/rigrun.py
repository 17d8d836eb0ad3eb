"""Runs ./rig for the tests, and reads what a run left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hpmc.layout import ROOT, WITH_VCAN
from hpmc.lcm_log import LcmLog

RIG = ROOT / "rig"
LIMIT_S = 400  # of at most about 40 on a quiet machine
JOINTS = (1, 2, 3)
TORQUE_LIMIT_NM = (30.0, 20.0, 5.0)
# 16 reaches in 4.45 s of simulated time, for what does not depend on how far a reach gets.
SHORT = ("--set", "experiment.period_s=0.2")


@dataclass
class Run:
    """A run that has ended."""

    folder: Path
    status: int
    said: str  # standard output
    errors: str  # standard error, without the words of a build
    ended_at: float  # time.time()

    @property
    def summary(self) -> dict[str, Any]:
        return json.loads((self.folder / "summary.json").read_text())

    def log(self, name: str = "run.lcmlog") -> LcmLog:
        return LcmLog(self.folder / name)

    def states(self, name: str = "run.lcmlog") -> list[bytes]:
        """The encoded ARM_STATE messages, in order."""
        return list(self.log(name).raw_messages("ARM_STATE"))


class RunningRig:
    """A run under way."""

    def __init__(self, *arguments: str, folder: Path, mark: str = "") -> None:
        self.folder = folder
        self.process = subprocess.Popen(
            [RIG, "run", "clock", "--no-figures", "--out", folder, *arguments],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=os.environ | {"RIG_TEST_MARK": mark}, start_new_session=True,
        )  # fmt: skip

    def wait_for_log(self, size_bytes: int) -> None:
        """Until the log has grown to a size."""
        log = self.folder / "run.lcmlog"
        until = time.monotonic() + LIMIT_S
        while not (log.exists() and log.stat().st_size >= size_bytes):
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < until
            time.sleep(0.02)

    def inside(self, program: str, *arguments: str) -> str:
        """Runs a Python program in the sandbox of the run."""
        name = f"run-{self.process.pid}"
        done = subprocess.run(
            [WITH_VCAN, "--join", name, "python3", "-c", program, *arguments],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LIMIT_S, check=True,
        )  # fmt: skip
        return done.stdout

    def interrupt(self, number: signal.Signals = signal.SIGINT) -> None:
        """As a terminal does: to the whole process group."""
        os.killpg(self.process.pid, number)

    def wait(self) -> Run:
        try:
            said, errors = self.process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            raise
        ended_at = time.time()
        own = [line for line in errors.splitlines(True) if not line.startswith("rig: ")]
        return Run(self.folder, self.process.returncode, said, "".join(own), ended_at)


def run_rig(*arguments: str, folder: Path) -> Run:
    """A whole run that must succeed."""
    run = RunningRig(*arguments, folder=folder).wait()
    assert run.status == 0, run.said + run.errors
    return run


def marked_processes(mark: str) -> list[str]:
    """Command lines of the processes that a marked run started and that are still there."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"RIG_TEST_MARK={mark}\0".encode() in (folder / "environ").read_bytes():
                found.append((folder / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return found


# --- what is on the bus ------------------------------------------------------------------------


@dataclass(frozen=True)
class Frame:
    period: int
    sender: int  # 0 host, 1..3 node, 127 injected sensors
    id: int
    data: bytes

    @property
    def function(self) -> int:
        return self.id & 0x780

    @property
    def node(self) -> int:
        return self.id & 0x7F

    def word(self, at: int, size: int = 2, *, signed: bool = False) -> int:
        return int.from_bytes(self.data[at : at + size], "little", signed=signed)


def frames(log: LcmLog, first: int = 0, last: int | None = None) -> Iterator[Frame]:
    """All frames of the periods first..last, each with the period in which it was sent."""
    from hpmc_lcm import can_frames_t

    for number, data in enumerate(log.raw_messages("CAN_FRAMES")):
        if number < first or (last is not None and number >= last):
            continue
        message = can_frames_t.decode(data)
        for f in message.frames:
            sent_in = message.seq - (1 if f.sender in JOINTS else 0)
            yield Frame(sent_in, f.sender, f.id, bytes(f.data)[: f.len])


def torques_nm(log: LcmLog) -> np.ndarray:
    """What the nodes gave to their motors, (joint ticks, 3)."""
    columns = [log.column(f"JOINT_TORQUE_{n}", "tau_Nm") for n in JOINTS]
    ticks = min(column.size for column in columns)
    return np.column_stack([column[:ticks] for column in columns])


def can_bits(identifier: int, data: bytes) -> int:
    """Bits of a data frame on the wire, stuffing and intermission included (ISO 11898-1)."""
    head = f"0{identifier:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    rest = int(head, 2) << 15
    for place in range(len(head) - 1, -1, -1):
        if rest >> (place + 15) & 1:
            rest ^= 0xC599 << place
    stuffed, run, last = 0, 0, ""
    for bit in head + f"{rest:015b}":
        run = run + 1 if bit == last else 1
        last = bit
        stuffed += 1
        if run == 5:
            stuffed, run, last = stuffed + 1, 1, "01"[bit == "0"]
    return stuffed + 13
