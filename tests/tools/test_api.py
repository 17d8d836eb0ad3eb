"""Experiments from a script: run, load, and what they give back."""

from __future__ import annotations

import inspect
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

import hpmc
from hpmc import (
    ConfigurationError,
    Experiment,
    LogError,
    Result,
    RunError,
    RunInterrupted,
    load,
    run,
    run_command,
)
from hpmc.experiment import override_lines
from hpmc.lcm_log import LcmLog

SHORT = {"experiment.period_s": 0.2, "experiment.reaches": 4}
PERIODS = 1000 + 4 * 200 + 250


def short(out: Path | None = None, **changes: object) -> Experiment:
    overrides = SHORT | changes.pop("overrides", {})
    return Experiment(mode="sil", overrides=overrides, figures=False, out=out, **changes)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(short(tmp_path_factory.mktemp("api") / "run"))


def arrays() -> list[tuple[str, str]]:
    """Names and descriptions of the arrays of a Result."""
    members = inspect.getmembers(Result, lambda member: isinstance(member, cached_property))
    return [(name, doc) for name, m in members if (doc := inspect.getdoc(m) or "").startswith("(n")]


# --- import --------------------------------------------------------------------------------------


def test_the_import_loads_nothing_heavy() -> None:
    code = (
        "import hpmc, sys; "
        "print({'numpy', 'matplotlib', 'rich', 'lcm', 'argparse'} & sys.modules.keys() or 'light')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}, timeout=60,
                          check=True)  # fmt: skip
    assert done.stdout == "light\n"


def test_what_is_exported() -> None:
    for name in hpmc.__all__:
        assert getattr(hpmc, name).__name__ == name
        assert name in dir(hpmc)
    with pytest.raises(AttributeError, match="no attribute 'runn'"):
        _ = hpmc.runn


# --- what a run gives back -----------------------------------------------------------------------


def test_metrics_are_the_summary(result: Result) -> None:
    assert result.complete
    assert result.metrics == json.loads((result.folder / "summary.json").read_text())
    assert result.metrics["reaches"] == 4
    assert result.reach_metrics.executed_r.shape == (4,)
    assert result.reach_metrics.executed_r.mean() == result.metrics["executed"]["r_mean"]
    assert result.configuration["experiment"]["period_s"] == 0.2


def test_there_are_arrays() -> None:
    assert len(arrays()) >= 18


@pytest.mark.parametrize(("name", "doc"), arrays())
def test_an_array_has_the_shape_and_kind_that_it_says(result: Result, name: str, doc: str) -> None:
    shape = re.match(r"\((n(?:, \d)*)\), (m/s|m|rad/s|rad|N m|N|s|bool|text|number|from 0)", doc)
    assert shape is not None, doc
    array = getattr(result, name)
    further = tuple(int(size) for size in shape[1].split(", ")[1:])
    assert array.shape == (PERIODS, *further)
    kind = {"bool": "b", "text": "U", "number": "i", "from 0": "i"}.get(shape[2], "f")
    assert array.dtype.kind == kind
    assert array is getattr(result, name)  # read once
    unit = re.search(r"_(m_s|m|rad_s|rad|Nm|N|s)$", name)
    spelt = {"m_s": "m/s", "rad_s": "rad/s", "Nm": "N m"}
    assert unit is None or shape[2] == spelt.get(unit[1], unit[1])


def test_rows_belong_to_one_instant(result: Result) -> None:
    log = LcmLog(result.folder / "run.lcmlog")
    np.testing.assert_array_equal(result.time_s, np.arange(PERIODS) / 1e3)
    for channel, field, array in (
        ("ARM_STATE", "hand_m", result.hand_m),
        ("ARM_STATE", "tau_Nm", result.tau_Nm),
        ("HPMC_STATE", "x_d_m", result.x_d_m),
        ("HPMC_STATE", "w_link_N", result.link_wrench_N),
    ):
        np.testing.assert_array_equal(array, log.column(channel, field))
    np.testing.assert_array_equal(
        result.tau_Nm[1:], np.column_stack(
            [log.column(f"JOINT_TORQUE_{n}", "tau_Nm")[:-1] for n in (1, 2, 3)]
        )
    )  # fmt: skip
    words = log.column("HPMC_STATE", "statusword").astype(int) & 0xFFFF
    np.testing.assert_array_equal(result.converging, (words & 0x4000) != 0)
    moving = result.stage == "reaches"
    assert 0.1 < result.converging[moving].mean() < 0.95


def test_a_reach_is_cut_out(result: Result) -> None:
    rows = result.during(reach=2)
    assert rows.sum() == 200
    np.testing.assert_array_equal(np.flatnonzero(rows), np.arange(1400, 1600))
    assert set(result.stage[rows]) == {"reaches"}
    angle = np.pi / 4  # target 2
    expected = [0.3 + 0.1 * np.cos(angle), 0.1 * np.sin(angle)]
    np.testing.assert_allclose(result.target_m[rows], np.tile(expected, (200, 1)))


def test_load_gives_the_same(result: Result) -> None:
    again = load(str(result.folder))
    assert again.metrics == result.metrics
    np.testing.assert_array_equal(again.q_rad, result.q_rad)
    single = load(result.folder / "run.lcmlog")
    np.testing.assert_array_equal(single.q_rad, result.q_rad)
    assert single.configuration == result.configuration
    assert not single.complete


def test_other_channels_are_at_hand(result: Result) -> None:
    assert result.opened.column("NODE_STATUS_1", "temperature_dC")[-1] == 250


def test_a_faster_joint_loop_is_joined_by_time(tmp_path: Path) -> None:
    fast = run(short(tmp_path / "fast", overrides={"joint.rate_Hz": 5000}))
    assert fast.hand_m.shape == fast.x_d_m.shape == (PERIODS, 2)
    states = fast.opened
    np.testing.assert_array_equal(fast.hand_m, states.column("ARM_STATE", "hand_m")[::5])


def test_repetitions_of_several_processes_stand_in_order(tmp_path: Path) -> None:
    spread = run(short(tmp_path / "jobs", jobs=2, overrides={"experiment.repetitions": 3}))
    assert len(spread.opened.logs) == 2
    np.testing.assert_array_equal(spread.repetition, np.repeat(np.arange(3), PERIODS))
    assert (np.diff(spread.time_s) > 0).all()
    assert spread.during(0, repetition=2).sum() == 200


def test_without_a_log_the_metrics_are_there(tmp_path: Path) -> None:
    bare = run(short(tmp_path / "bare", log="none"))
    assert bare.metrics["reaches"] == 4
    assert bare.configuration["experiment"]["reaches"] == 4
    with pytest.raises(LogError, match="holds no run"):
        _ = bare.time_s
    assert load(bare.folder).metrics == bare.metrics


def test_runs_within_one_second_have_folders_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Noon(run_command.datetime.datetime):
        @classmethod
        def now(cls, tz: object = None) -> Noon:
            return cls(2026, 1, 1, 12)

    monkeypatch.setattr(run_command.datetime, "datetime", Noon)
    monkeypatch.setattr(run_command, "RUNS", tmp_path)
    results = [run(short()) for _ in range(3)]
    names = [f"20260101-120000-clock-sil{end}" for end in ("", "-2", "-3")]
    assert [each.folder.name for each in results] == names
    assert {each.metrics["reaches"] for each in results} == {4}
    np.testing.assert_array_equal(results[0].hand_m, results[2].hand_m)


def test_quiet_or_not(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run(short(tmp_path / "quiet"))
    assert capfd.readouterr() == ("", "")
    run(short(tmp_path / "loud"), quiet=False)
    assert "executed r" in capfd.readouterr().out


# --- overrides -----------------------------------------------------------------------------------


def test_overrides_by_key() -> None:
    lines = override_lines({
        "a.number": 0.1, "a.whole": np.int64(3), "a.large": 1e5, "a.word": "error_growth",
        "a.vector": np.array([1.0, 2.5]), "a.list": (1, 2),
    })  # fmt: skip
    assert lines == [
        "a.number=0.1", "a.whole=3", "a.large=100000.0", 'a.word="error_growth"',
        "a.vector=[1.0, 2.5]", "a.list=[1, 2]",
    ]  # fmt: skip
    assert override_lines(["a.b=c"]) == ["a.b=c"]
    with pytest.raises(ConfigurationError, match=r"a.none: None is no number, string or list"):
        override_lines({"a.none": None})


# --- what goes wrong -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("experiment", "words"),
    [
        (Experiment("watch", mode="sil"), "there is no experiment 'watch'"),
        (Experiment(mode="sim"), "there is no mode 'sim' .choose from sil, "),
        (short(overrides={"experiment.seed": -1}), "experiment.seed: must be a whole number"),
        (short(overrides={"wall.stifness_N_m": 1e4}), "did you mean 'wall.stiffness_N_m'"),
        (short(uml=True), "--uml: goes with --mode vcan"),
    ],
)
def test_a_bad_experiment_makes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, experiment: Experiment, words: str
) -> None:
    monkeypatch.setattr(run_command, "RUNS", tmp_path / "runs")
    with pytest.raises(ConfigurationError, match=words):
        run(experiment)
    assert not (tmp_path / "runs").exists()


def test_a_run_that_ends_early(tmp_path: Path) -> None:
    coarse = {"schedule.approach_tolerance_m": 0.0001, "joint.increments_per_revolution": 1024}
    with pytest.raises(RunError, match="the approach did not reach home"):
        run(short(tmp_path / "coarse", overrides=coarse))
    left = load(tmp_path / "coarse")
    assert not left.complete
    assert left.hand_m.shape[0] > 900
    with pytest.raises(LogError, match="did not come to its end"):
        _ = left.metrics


def test_an_interrupted_run(tmp_path: Path) -> None:
    log = tmp_path / "cut" / "run.lcmlog"
    ended = threading.Event()

    def interrupt() -> None:
        while not ended.is_set() and not (log.exists() and log.stat().st_size > 3_000_000):
            time.sleep(0.01)
        if not ended.is_set():
            os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        with pytest.raises(RunInterrupted, match="interrupted; the log up to there"):
            run(short(tmp_path / "cut", overrides={"experiment.repetitions": 500}, log="states"))
    finally:
        ended.set()
        thread.join()
    cut = load(tmp_path / "cut")
    assert not cut.complete
    assert cut.hand_m.shape[0] > 1000


def test_only_in_the_main_thread(tmp_path: Path) -> None:
    caught: list[BaseException] = []

    def call() -> None:
        try:
            run(short(tmp_path / "thread"))
        except RuntimeError as error:
            caught.append(error)

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    assert "main thread" in str(caught[0])
    assert not (tmp_path / "thread").exists()


def test_no_run_to_load(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="is no run"):
        load(tmp_path)
    with pytest.raises(LogError, match="No such file"):
        load(tmp_path / "none")


def test_waypoints_are_told_apart_from_places_of_the_clock(tmp_path: Path, result: Result) -> None:
    overrides = {"experiment.path": "figure_of_eight", "experiment.waypoint_s": 0.05}
    eight = run(short(tmp_path / "eight", overrides=overrides))
    assert list(result.opened.column("ARM_TARGET", "target")) == [1, 0, 2, 0]
    assert list(eight.opened.column("ARM_TARGET", "target")) == [-2] * 16
    for each, interval_us in ((result, 200_000), (eight, 50_000)):
        told = each.opened.column("ARM_TARGET", "utime")
        assert list(np.diff(told)) == [interval_us] * (told.size - 1)
        rows = np.searchsorted(each.time_s, told / 1e6)
        np.testing.assert_array_equal(
            each.target_m[rows], each.opened.column("ARM_TARGET", "x_t_m")
        )
