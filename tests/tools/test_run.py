"""`./rig run` up to the start of its processes, and the little sums around a run."""

from __future__ import annotations

import collections
import dataclasses
import itertools
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from rich.console import Console

from hpmc import log_size, processes, run_command
from hpmc.configuration import load_configuration
from hpmc.modes import MODES, Job, Mode
from hpmc.modes.sil import describe_status, spread
from hpmc.modes.vcan import vcan_plan
from hpmc.run_progress import ProgressBar


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An output folder; the test fails if processes are started."""

    def started(*_: object) -> None:
        raise AssertionError("a run was started")

    for name, mode in MODES.items():
        monkeypatch.setitem(run_command.MODES, name, Mode(mode.check, started))
    monkeypatch.setattr(run_command, "RUNS", tmp_path / "runs")
    return tmp_path / "out"


BAD = [
    (["--mode", "hil"],
     "argument --mode: invalid choice: 'hil' (choose from 'sil', 'vcan', 'emulated', 'bench')"),
    (["--sensors", "none"], "argument --sensors: invalid choice"),
    (["--pace", "fast"], "argument --pace: invalid choice"),
    (["--log", "all"], "argument --log: invalid choice"),
    (["--phase-rule", "x"], "argument --phase-rule: invalid choice"),
    (["--joint-rate-hz", "2000"], "argument --joint-rate-hz: invalid choice: '2000' (choose from"),
    (["--repetitions", "0"], "experiment.repetitions: must be a whole number, 1 to 100000"),
    (["--repetitions", "1e3"], "experiment.repetitions: must be a whole number, 1 to 100000"),
    (["--repetitions", "-1"], "experiment.repetitions: must be a whole number, 1 to 100000"),
    (["--repetitions", ""], "experiment.repetitions: must be a whole number, 1 to 100000"),
    (["--seed", "x"], "experiment.seed: must be a whole number, 0 to 2147483647"),
    (["--seed", "-1"], "experiment.seed: must be a whole number, 0 to 2147483647"),
    (["--jobs", "0", "--mode", "sil"], "argument --jobs: '0': must be a whole number, 1 to 256"),
    (["--jobs", "two"], "argument --jobs: 'two': must be a whole number, 1 to 256"),
    (["--jobs", "2"], "--jobs: goes with --mode sil"),
    (["--uml", "--mode", "sil"], "--uml: goes with --mode vcan"),
    (["--lcm-url", "udpm://239.255.76.67:7667"], "--lcm-url: goes with --mode sil"),
    (["--lcm-url", "tcp://1.2.3.4", "--mode", "sil"], "--lcm-url tcp://1.2.3.4: must be"),
    (["--jobs", "2", "--pace", "realtime", "--mode", "sil"], "--jobs: one process only"),
    (["--targets", "no/such"], "--targets no/such: holds no run.lcmlog"),
    (["--set", "bus.command_delay_ms=1"], "bus.command_delay_ms: goes with --mode sil"),
    (
        ["--set", "arm.lenght_m=[1, 1, 1]"],
        "unknown key 'arm.lenght_m', did you mean 'arm.length_m'",
    ),
    (["--set", "experiment.seed"], "'experiment.seed': must be section.key=value"),
    (["--set", "experiment.radius_m=0.28"], "target 1 at (0.580, 0.000) m is out of reach"),
    (["--config", "/no/such.toml"], "/no/such.toml: no such file"),
    (["--config", "/tmp"], "/tmp: is a folder, not a file"),
    (["--bogus"], "unrecognized arguments: --bogus"),
    (["--rep", "2"], "unrecognized arguments: --rep 2"),  # no guessing at abbreviations
    (["--set"], "argument --set: expected one argument"),
    (
        ["--sensors", "injected", "--joint-rate-hz", "5000"],
        "rig.sensors: injected sensors come once per SYNC, so joint.rate_Hz must be 1000",
    ),
]


@pytest.mark.parametrize(("arguments", "words"), BAD)
def test_bad_input(
    arguments: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = run_command.main(["clock", "--out", str(folder), *arguments])
    said = capsys.readouterr()
    assert status == 2
    assert said.out == "" and len(said.err.splitlines()) == 1
    assert said.err.startswith("rig run: ") and words in said.err
    assert list(folder.parent.iterdir()) == []


def test_the_experiment_is_asked_for(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command.main([]) == 2 and run_command.main(["watch"]) == 2
    missing, unknown = capsys.readouterr().err.splitlines()
    assert "required: experiment" in missing
    assert "'watch' (choose from 'clock', 'figure_of_eight', 'wall')" in unknown


def test_the_output_folder_must_be_new_or_empty(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.mkdir()
    (folder / "run.lcmlog").write_text("precious")
    assert run_command.main(["clock", "--out", str(folder)]) == 2
    assert run_command.main(["clock", "--out", str(folder / "run.lcmlog")]) == 2
    assert run_command.main(["clock", "--out", str(folder / "run.lcmlog" / "below")]) == 2
    occupied, file, below = capsys.readouterr().err.splitlines()
    assert f"--out {folder}: exists already and is not empty" in occupied
    assert "is not a folder" in file
    assert "cannot be written: Not a directory" in below
    assert [path.name for path in folder.iterdir()] == ["run.lcmlog"]
    assert (folder / "run.lcmlog").read_text() == "precious"


DiskUsage = collections.namedtuple("DiskUsage", "total used free")


def test_disk_space_is_checked_before_a_run(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = 17250 * (log_size.FULL_BYTES + log_size.CANDUMP_BYTES) + log_size.DISK_RESERVE_BYTES
    monkeypatch.setattr(log_size.shutil, "disk_usage", lambda _: DiskUsage(0, 0, wanted - 1))
    assert run_command.main(["clock", "--out", str(folder)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "the log will take 26 MB" in line and f"{(wanted - 1) / 1e6:.0f} MB are free" in line
    assert not folder.exists()

    monkeypatch.setattr(log_size.shutil, "disk_usage", lambda _: DiskUsage(0, 0, wanted))
    with pytest.raises(AssertionError, match="started"):
        run_command.main(["clock", "--out", str(folder)])
    assert (folder / "config.toml").exists()


def test_how_the_log_grows_with_level_rate_and_repetitions() -> None:
    def bytes_of(level: str, *overrides: str) -> int:
        return log_size.log_bytes(load_configuration("clock", overrides=overrides), level)

    one = bytes_of("full")
    assert bytes_of("full", "experiment.repetitions=7") == 7 * one
    assert bytes_of("states") < 0.6 * one
    assert bytes_of("full", "joint.rate_Hz=5000") > 2 * one
    assert bytes_of("none") == bytes_of("states")  # written, analysed, removed


@pytest.mark.parametrize(
    ("arguments", "level"),
    [
        ([], "full"),
        (["--repetitions", "10"], "full"),
        (["--repetitions", "11"], "states"),
        (["--repetitions", "11", "--log", "full"], "full"),
        (["--log", "none"], "none"),
    ],
)
def test_the_log_is_full_up_to_160_reaches(
    arguments: list[str], level: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(AssertionError, match="started"):
        run_command.main(["clock", "--mode", "sil", "--out", str(folder), *arguments])
    assert f"; log {level}, about " in capsys.readouterr().out.replace("\n", " ")


def test_options_are_overrides_and_set_comes_last() -> None:
    experiment = run_command.parse(
        ["clock", "--seed", "3", "--sensors", "injected", "--set", "experiment.seed=4"]
    )
    assert experiment.overrides == [
        "experiment.seed=3",
        "rig.sensors=injected",
        "experiment.seed=4",
    ]


@pytest.mark.parametrize(
    ("repetitions", "jobs"), list(itertools.product((1, 2, 5, 100), (1, 2, 3, 8)))
)
def test_repetitions_are_spread_evenly_and_whole(repetitions: int, jobs: int) -> None:
    parts = spread(repetitions, jobs)
    assert len(parts) == min(jobs, repetitions)
    assert [n for first, count in parts for n in range(first, first + count)] == list(
        range(repetitions)
    )
    counts = [count for _, count in parts]
    assert max(counts) - min(counts) <= 1


def test_the_processes_of_a_vcan_run() -> None:
    configuration = load_configuration(
        "clock", overrides=["joint.rate_Hz=5000", "joint.increments_per_revolution=1048576"]
    )
    job = Job(
        configuration=configuration, config_file=Path("c.toml"), log_level="states",
        folder=Path(), bar=ProgressBar(Console(), 16), realtime=True,
    )  # fmt: skip
    processes = vcan_plan(job, Path("l.lcmlog"))["processes"]
    assert list(processes) == [
        "run_logger", "motor_node 1", "motor_node 2", "motor_node 3", "hpmc_host", "arm_sim",
    ]  # fmt: skip
    node = " ".join(processes["motor_node 2"])
    assert "--joint-ticks 5" in node and "--increments-per-revolution 1048576" in node
    assert node.endswith("--id 2")
    assert processes["arm_sim"][-1] == "--realtime"
    plan = vcan_plan(dataclasses.replace(job, realtime=False), Path("l.lcmlog"))
    assert "--realtime" not in plan["processes"]["arm_sim"]
    for name in ("run_logger", "hpmc_host"):
        assert " ".join(processes[name]).endswith("--log-level states")


def test_progress_counts_the_reaches_of_all_jobs() -> None:
    console = Console(force_terminal=True, width=120)
    bar = ProgressBar(console, 64)
    bar.update(0, '{"repetition": 0, "reach": -1, "simulated_s": 0.0}')
    bar.update(0, '{"repetition": 1, "reach": 3, "simulated_s": 22.0}')
    bar.update(1, '{"repetition": 0, "reach": 7, "simulated_s": 43.5}')
    task = bar.bar.tasks[0]
    assert task.completed == 16 + 4 + 8 and task.total == 64
    assert "22.0 s simulated" in task.fields["simulated"]  # job 1 began at 43.5 s
    assert "x real time" in task.fields["simulated"]
    bar.update(1, '{"repetition": 0, "reach": -1, "simulated_s": 53.0}')  # stopping: no step back
    assert bar.bar.tasks[0].completed == 28


# --- watching processes --------------------------------------------------------------------------

SLEEP = "import signal, sys, time; signal.signal(signal.SIGINT, lambda *_: sys.exit(7)); "


def child(program: str, lines: list[str] | None = None) -> processes.Child:
    return processes.Child([sys.executable, "-c", program], (lines or []).append)


def test_a_child_hands_over_its_lines() -> None:
    lines: list[str] = []
    process = processes.Child(
        [sys.executable, "-c", "import sys; print('a\\nb'); print('bad', file=sys.stderr)"],
        lines.append,
    )
    assert process.wait() == 0
    assert lines == ["a", "b"] and process.errors == ["bad"]


def test_an_interrupt_is_passed_on_and_waited_for() -> None:
    with processes.Watch() as watch:
        watch.add(child(SLEEP + "time.sleep(60)"))
        watch.add(child(SLEEP + "time.sleep(60)"))
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
        watch.wait()
    assert watch.interrupted
    assert [c.process.returncode for c in watch.children] == [7, 7]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_before_a_process_starts_still_ends_it() -> None:
    with processes.Watch() as watch:
        os.kill(os.getpid(), signal.SIGTERM)
        watch.add(child("import time; time.sleep(60)"))
        watch.wait()
    assert watch.interrupted and watch.children[0].process.returncode != 0


def test_when_one_process_fails_the_others_are_stopped() -> None:
    start = time.monotonic()
    with processes.Watch() as watch:
        watch.add(child(SLEEP + "time.sleep(60)"))
        watch.add(child("import sys, time; time.sleep(0.5); print('broke', file=sys.stderr); "
                        "sys.exit(3)"))  # fmt: skip
        watch.wait()
    assert time.monotonic() - start < 10
    assert not watch.interrupted
    assert watch.failed is watch.children[1] and watch.failed.errors == ["broke"]
    assert watch.children[0].process.returncode == 7


def test_statuses_in_words() -> None:
    assert describe_status(-9) == "sil was killed by SIGKILL"
    assert describe_status(3) == "sil ended with status 3"
