"""However a run ends: nodes stopped, a reason in plain words, the log whole, no process left."""

from __future__ import annotations

import re
import signal
import time
import uuid
from pathlib import Path

import numpy as np
import pytest
from rigrun import (
    JOINTS,
    TORQUE_LIMIT_NM,
    Run,
    RunningRig,
    frames,
    marked_processes,
    torques_nm,
)

from hpmc.layout import LAUNCHER

# Kills the process of the sandbox whose command line begins with these words; says when.
KILL = """
import os, sys, time
words = sys.argv[1].split()
for number in filter(str.isdigit, os.listdir("/proc")):
    try:
        command = open(f"/proc/{number}/cmdline").read().split("\\0")
    except OSError:
        continue
    node = command[command.index("--id") + 1 :][:1] if "--id" in command else []
    if [command[0].rsplit("/")[-1], *node] == words:
        print(time.time())
        os.kill(int(number), int(sys.argv[2]))
"""


def gone(mark: str) -> bool:
    until = time.monotonic() + 3.0
    while marked_processes(mark) and time.monotonic() < until:
        time.sleep(0.05)
    return marked_processes(mark) == []


def readable_until_s(run: Run) -> float:
    log = run.log()
    assert sum(damage.length for damage in log.damage) < 10_000  # an event cut off at the end
    assert log.lost("ARM_STATE") == 0
    return log.column("ARM_STATE", "utime")[-1] * 1e-6


def kill_in_run(victim: str, folder: Path, mark: str) -> tuple[Run, float]:
    """A run in which a process is killed, and the time from there to the end of ./rig."""
    rig = RunningRig(folder=folder, mark=mark)
    rig.wait_for_log(2_000_000)
    killed_at = float(rig.inside(KILL, victim, str(int(signal.SIGKILL))))
    run = rig.wait()
    return run, run.ended_at - killed_at


@pytest.mark.parametrize("victim", ["motor_node 2", "hpmc_host", "arm_sim", "run_logger"])
def test_a_killed_process_ends_the_run(victim: str, tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    run, seconds = kill_in_run(victim, tmp_path / "run", mark)
    if seconds >= 1.0:  # the machine may have been busy
        run, seconds = kill_in_run(victim, tmp_path / "second", mark)
    assert seconds < 1.0
    assert run.status == 3
    (line,) = run.errors.splitlines()
    found = re.search(rf"{victim} was killed by SIGKILL, ([\d.]+) s into the run", line)
    assert found and str(run.folder) in line
    assert readable_until_s(run) > float(found[1]) - 0.3
    assert not (run.folder / "summary.json").exists()
    assert gone(mark)


def check_stopped_in_order(run: Run) -> None:
    """Quick stop to all nodes in one period, the bound ramps to zero, off, NMT stop."""
    log = run.log()
    assert log.damage == []
    last = int(log.column("HPMC_STATE", "seq")[-1]) + 1
    tail = list(frames(log, last - 400))
    stops = [f.period for f in tail if f.function == 0x300 and f.data[:2] == b"\x02\x00"]
    assert len(stops) == 3 and len(set(stops)) == 1
    off = [f.period for f in tail if f.function == 0x300 and f.data[:2] == b"\x00\x00"]
    nmt = [(f.period, f.data) for f in tail if f.id == 0x000]
    assert len(off) == 3 and min(off) > stops[0]
    assert [data for _, data in nmt] == [b"\x02\x00"] and nmt[0][0] > max(off)
    assert nmt[0][0] - stops[0] < 200
    assert log.column("HPMC_STATE", "phase")[-1] == 5

    torque = torques_nm(log)
    for node in JOINTS:
        column = np.abs(torque[stops[0] : stops[0] + 100, node - 1])
        down = TORQUE_LIMIT_NM[node - 1] * (1 - np.arange(column.size) / 100)
        assert np.all(column <= down + 1e-3)
    assert np.any(torque[stops[0] + 5])  # held, not let go
    assert not np.any(torque[stops[0] + 102 :])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("mode", ["vcan", "sil"])
def test_an_interrupted_run_stops_its_nodes(
    mode: str, number: signal.Signals, tmp_path: Path
) -> None:
    mark = uuid.uuid4().hex
    repetitions = [] if mode == "vcan" else ["--repetitions", "10"]
    rig = RunningRig("--mode", mode, *repetitions, folder=tmp_path / "run", mark=mark)
    rig.wait_for_log(2_500_000)
    rig.interrupt(number)
    asked_at = time.time()
    run = rig.wait()
    assert run.status == 130
    assert run.ended_at - asked_at < 5.0
    assert "interrupted; the log up to there" in run.said and run.errors == ""
    assert gone(mark)
    check_stopped_in_order(run)


@pytest.mark.parametrize("after_s", [0.0, 0.4, 1.2])
def test_an_interrupt_while_the_processes_start(after_s: float, tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    rig = RunningRig(folder=tmp_path / "run", mark=mark)
    while not (tmp_path / "run" / "config.toml").exists():
        time.sleep(0.005)
    time.sleep(after_s)
    rig.interrupt()
    run = rig.wait()
    assert run.status == 130
    assert "Traceback" not in run.errors
    assert gone(mark)


def test_an_interrupt_before_anything_is_made(tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    rig = RunningRig(folder=tmp_path / "run", mark=mark)
    time.sleep(0.3)  # in ./rig, or while modules are loaded
    rig.interrupt()
    run = rig.wait()
    assert run.status in (130, -signal.SIGINT)  # 130 to a shell, both
    assert "Traceback" not in run.errors
    assert gone(mark)


def test_rig_killed_outright_leaves_no_process(tmp_path: Path) -> None:
    mark = uuid.uuid4().hex
    rig = RunningRig(folder=tmp_path / "run", mark=mark)
    rig.wait_for_log(1_000_000)
    rig.interrupt(signal.SIGKILL)
    rig.wait()
    assert gone(mark)


def test_a_second_terminal_looks_in(tmp_path: Path) -> None:
    rig = RunningRig(folder=tmp_path / "run")
    rig.wait_for_log(1_000_000)
    listen = (
        "import subprocess; "
        "print(subprocess.run(['candump', '-L', '-n', '50', 'vcan0'], capture_output=True, "
        "text=True, timeout=10).stdout)"
    )
    seen = {line.split()[2].split("#")[0] for line in rig.inside(listen).splitlines() if line}
    assert {"080", "181", "182", "183", "201", "202", "203"} <= seen
    rig.interrupt()
    run = rig.wait()
    assert run.status == 130 and run.errors == ""  # the run was not disturbed
    assert f"--join run-{rig.process.pid} candump vcan0" in run.said


def test_the_launcher_needs_the_standard_library_only() -> None:
    imported = re.findall(r"^(?:from|import) (\w+)", LAUNCHER.read_text(), re.MULTILINE)
    assert "hpmc" not in imported and "numpy" not in imported
