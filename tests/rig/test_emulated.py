"""Runs on the flash image itself, emulated: the same run as in one process, and how they end."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from rigrun import RIG, SHORT, RunningRig, frames, marked_processes, run_rig

from hpmc.layout import PROGRAMS
from hpmc.lcm_log import LcmLog
from hpmc.modes import emulated

PERIODS = 4450  # of a run with SHORT
LIMIT_S = 180


def gone(mark: str) -> bool:
    until = time.monotonic() + 5.0
    while marked_processes(mark) and time.monotonic() < until:
        time.sleep(0.05)
    return marked_processes(mark) == []


@pytest.mark.parametrize("numbers", [(), ("--fixed",)], ids=["float", "fixed"])
def test_the_image_gives_the_run_of_the_host(numbers: tuple[str, ...], tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    rig = RunningRig("--mode", "emulated", *numbers, *SHORT, folder=tmp_path / "image", mark=mark)
    image = rig.wait()
    assert image.status == 0, image.said + image.errors
    assert gone(mark)
    host = run_rig(
        "--mode", "sil", "--sensors", "injected", *numbers, *SHORT, folder=tmp_path / "host"
    )
    assert len(image.states()) == PERIODS
    assert image.states() == host.states()
    ours, theirs = image.log(), host.log()
    for channel in ("CAN_FRAMES", "JOINT_TORQUE_1", "JOINT_TORQUE_3", "HPMC_STATE"):
        assert list(ours.raw_messages(channel)) == list(theirs.raw_messages(channel)), channel
    assert next(ours.messages("RUN_INFO"))["mode"] == "emulated"
    assert image.summary["mode"] == "emulated"
    assert image.summary["bus"]["lost"] == 0


def board_of_node(mark: str, node: int) -> int:
    """Number of the process that is a board of a marked run."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            ours = f"RIG_TEST_MARK={mark}\0".encode() in (folder / "environ").read_bytes()
            command = (folder / "cmdline").read_text().split("\0")
        except OSError:
            continue
        if ours and command[0] == "qemu-system-arm" and f"node_{node}.bin" in " ".join(command):
            return int(folder.name)
    raise AssertionError(f"no board of node {node}")


def test_a_killed_board_ends_the_run(tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    rig = RunningRig("--mode", "emulated", *SHORT, folder=tmp_path / "run", mark=mark)
    rig.wait_for_log(100_000)
    os.kill(board_of_node(mark, 2), signal.SIGKILL)
    run = rig.wait()
    assert run.status == 3
    (line,) = run.errors.splitlines()
    assert "the emulated board of motor node 2 (QEMU) was killed by SIGKILL" in line
    assert str(run.folder) in line
    assert not (run.folder / "summary.json").exists()
    assert run.log().lost("ARM_STATE") == 0
    assert gone(mark)


def test_an_interrupted_run_stops_its_nodes(tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    rig = RunningRig("--mode", "emulated", *SHORT, folder=tmp_path / "run", mark=mark)
    rig.wait_for_log(600_000)
    rig.interrupt()
    run = rig.wait()
    assert run.status == 130, run.said + run.errors
    assert run.errors == ""
    assert gone(mark)
    log = run.log()
    last = int(log.column("HPMC_STATE", "seq")[-1]) + 1
    tail = list(frames(log, last - 400))
    assert len([f for f in tail if f.function == 0x300 and f.data[:2] == b"\x02\x00"]) == 3
    assert [f.data for f in tail if f.id == 0x000] == [b"\x02\x00"]  # NMT stop, at the end
    assert log.column("HPMC_STATE", "phase")[-1] == 5


def test_rig_killed_outright_leaves_no_board(tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    rig = RunningRig("--mode", "emulated", *SHORT, folder=tmp_path / "run", mark=mark)
    rig.wait_for_log(50_000)
    rig.interrupt(signal.SIGKILL)
    rig.wait()
    assert gone(mark)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--sensors", "direct"), "--sensors direct: emulated nodes have no encoder"),
        (("--jobs", "2"), "--jobs: goes with --mode sil"),
        (("--pace", "realtime"), "--pace realtime: goes with --mode sil and vcan"),
        (("--uml",), "--uml: goes with --mode vcan"),
        (("--joint-rate-hz", "5000"), "joint.rate_Hz must be 1000"),
    ],
)
def test_options_that_make_no_sense(
    options: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    run = RunningRig("--mode", "emulated", *options, folder=tmp_path / "run").wait()
    assert run.status == 2
    (line,) = run.errors.splitlines()
    assert said in line
    assert not (tmp_path / "run").exists()


# --- what goes wrong on a line -----------------------------------------------------------------


class Tap:
    """A proxy in the line of a node, which puts characters before the RPDO4 of one period."""

    def __init__(self, board: emulated.Board, period: int, insert: bytes, answers: int) -> None:
        self.before = re.compile(rb"t50%d8[0-9A-F]{8}%02X" % (board.node_id, period & 0xFF))
        self.insert = insert
        self.answers = answers  # to what was put in, not to be passed on
        self.periods_of_this_number = period >> 8
        self.board = socket.create_connection(("127.0.0.1", board.port))
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"slcan:tcp:127.0.0.1:{self.listener.getsockname()[1]}"
        self.inserted = threading.Event()
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self) -> None:
        self.host, _ = self.listener.accept()
        for end in (self.host, self.board):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        threading.Thread(target=self.to_host, daemon=True).start()
        rest = b""
        try:
            while data := self.host.recv(4096):
                whole, cr, rest = (rest + data).rpartition(b"\r")
                data = whole + cr
                found = None if self.inserted.is_set() else self.before.search(data)
                if found and self.periods_of_this_number == 0:
                    self.inserted.set()
                    data = data[: found.start()] + self.insert + data[found.start() :]
                elif found:
                    self.periods_of_this_number -= 1
                self.board.sendall(data)
        except OSError:
            pass  # either end has gone: the test looks at what became of the run
        finally:
            self.board.close()

    def to_host(self) -> None:
        try:
            while data := self.board.recv(4096):
                if self.inserted.is_set() and self.answers and b"\r" in data:
                    data = data.replace(b"\r", b"", 1)  # that step sends no frames
                    self.answers -= 1
                self.host.sendall(data)
        except OSError:
            pass


@contextmanager
def tapped_run(
    folder: Path, period: int, insert: bytes, answers: int
) -> Iterator[tuple[subprocess.CompletedProcess[str], Tap, Path]]:
    """sil on three boards, with a tap in the line of node 2."""
    log = folder / "run.lcmlog"
    with emulated.boards(emulated.image()) as boards:
        tap = Tap(boards[1], period, insert, answers)
        lines = [boards[0].line, tap.address, boards[2].line]
        command = [
            str(PROGRAMS["sil"]), "--config", str(RIG.parent / "sim_host/config/clock.toml"),
            "--set", "experiment.period_s=0.2", "--set", "rig.sensors=injected",
            "--log", str(log), *(word for line in lines for word in ("--node", line)),
        ]  # fmt: skip
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LIMIT_S,
            check=False,
        )  # fmt: skip
        yield done, tap, log


def torque_of_node_2(log: LcmLog, period: int) -> np.ndarray:
    """What the plant was given from this period on."""
    rows = [m["tau_Nm"][1] for m in log.messages("ARM_STATE") if m["seq"] > period]
    return np.array(rows)


def test_a_node_reset_in_mid_run(tmp_path: Path) -> None:
    reset_at = 700
    with tapped_run(tmp_path, reset_at, b"t00028102\r", 1) as (done, tap, log):
        assert tap.inserted.is_set()
        assert done.returncode == 3
        (line,) = done.stderr.splitlines()
        # It boots disabled and tells so; the host, which misses its TPDO1, stops the others.
        assert "motor node 2: sent no TPDO1 for 2 periods" in line
        sent = [f for f in frames(LcmLog(log), reset_at) if f.sender == 2 and f.period >= reset_at]
        assert (sent[0].id, sent[0].data) == (0x702, b"\0")
        assert not [f for f in sent if f.function == 0x180]
        torque = torque_of_node_2(LcmLog(log), reset_at)
        assert np.any(torque_of_node_2(LcmLog(log), reset_at - 100)[:100])
        assert not np.any(torque[3:])


@pytest.mark.parametrize("garbage", [b"t2018\xff\xfe00\r", b"t20180011\r"], ids=["bytes", "half"])
def test_garbage_on_the_line_ends_the_run(garbage: bytes, tmp_path: Path) -> None:
    with tapped_run(tmp_path, 40, garbage, 0) as (done, tap, log):
        assert tap.inserted.is_set()
        assert done.returncode == 3
        (line,) = done.stderr.splitlines()
        assert re.fullmatch(r"sil: motor node 2 \(slcan:tcp:.*\): refused a line", line)
        assert LcmLog(log).lost("ARM_STATE") == 0
