"""summary.json has the keys of the interface, the numbers of the log, and never a NaN."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from synthetic_log import write_clock_log

from hpmc.analysis import Analysis, analyse_logs
from hpmc.summary import (
    BusFacts,
    LcmFacts,
    RunFacts,
    VersionFacts,
    build_summary,
    print_summary,
    write_summary,
)

KEYS = {
    "mode": None,
    "numbers": None,
    "repetitions": None,
    "reaches": None,
    "seed": None,
    "simulated_s": None,
    "wall_s": None,
    "real_time_factor": None,
    "planned": ["r_mean", "r_std", "sparc_mean", "ldlj_mean"],
    "executed": [
        "r_mean",
        "r_std",
        "r5_mean",
        "sparc_mean",
        "sparc_std",
        "ldlj_mean",
        "ldlj_std",
    ],
    "position_rmse_mm": ["mean", "max"],
    "velocity_rmse_mm_s": ["mean", "max"],
    "final_error_mm": ["mean", "max"],
    "targets": None,
    "bus": ["frames", "lost", "load_worst_percent", "load_typical_percent"],
    "lcm": ["messages", "lost"],
    "pace": None,
    "versions": ["git", "protocol_hash"],
}
TARGET_KEYS = [
    "index",
    "planned_r",
    "executed_r",
    "position_rmse_mm",
    "velocity_rmse_mm_s",
    "manipulability",
]
FACTS = RunFacts(
    mode="sil",
    numbers="fixed",
    seed=7,
    repetitions=1,
    simulated_s=17.25,
    wall_s=3.45,
    bus=BusFacts(frames=138_000, lost=0, load_worst_percent=87.5, load_typical_percent=78.0),
    lcm=LcmFacts(messages=172_500, lost=2),
    versions=VersionFacts(git="abc123", protocol_hash="def456"),
)


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    path = tmp_path_factory.mktemp("log") / "run.lcmlog"
    write_clock_log(path)
    return analyse_logs([path])


def printed(summary: dict) -> str:
    console = Console(width=80)
    with console.capture() as capture:
        print_summary(summary, console)
    return capture.get()


def test_keys(analysis: Analysis) -> None:
    summary = build_summary(FACTS, analysis)
    assert list(summary) == list(KEYS)
    for key, inner in KEYS.items():
        if inner is not None:
            assert list(summary[key]) == inner
    assert [list(target) for target in summary["targets"]] == [TARGET_KEYS] * 8


def test_numbers_are_those_of_the_reaches(analysis: Analysis) -> None:
    summary = build_summary(FACTS, analysis)
    metrics = analysis.metrics
    assert summary["reaches"] == 16
    assert summary["real_time_factor"] == pytest.approx(5.0)
    assert summary["planned"]["r_mean"] == pytest.approx(1.616, abs=5e-4)
    assert summary["executed"]["r_std"] == pytest.approx(np.std(metrics.executed_r))
    assert summary["executed"]["r5_mean"] == pytest.approx(metrics.executed_r5.mean())
    assert summary["planned"]["sparc_mean"] == pytest.approx(metrics.planned_sparc.mean())
    assert summary["executed"]["sparc_std"] == pytest.approx(metrics.executed_sparc.std())
    assert summary["executed"]["ldlj_mean"] == pytest.approx(metrics.executed_ldlj.mean())
    assert summary["position_rmse_mm"]["max"] == metrics.position_rmse_mm.max()
    assert [target["index"] for target in summary["targets"]] == list(range(1, 9))
    fifth = summary["targets"][4]
    both_directions = metrics.executed_r[metrics.target == 5]
    assert both_directions.size == 2
    assert fifth["executed_r"] == pytest.approx(both_directions.mean())
    assert round(fifth["manipulability"], 4) == 0.0529


def test_json_round_trip(analysis: Analysis, tmp_path: Path) -> None:
    summary = build_summary(FACTS, analysis)
    write_summary(summary, tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]


def test_without_logs_every_metric_is_null(tmp_path: Path) -> None:
    summary = build_summary(FACTS, None)
    assert list(summary) == list(KEYS)
    assert summary["reaches"] == 0
    assert set(summary["executed"].values()) == {None}
    write_summary(summary, tmp_path / "summary.json")
    assert "NaN" not in (tmp_path / "summary.json").read_text()
    assert "138000 frames" in printed(summary)


def test_targets_not_reached_are_null(tmp_path: Path) -> None:
    write_clock_log(tmp_path / "run.lcmlog", reaches=2)
    summary = build_summary(FACTS, analyse_logs([tmp_path / "run.lcmlog"]))
    assert summary["targets"][0]["executed_r"] is not None
    assert summary["targets"][1]["executed_r"] is None
    json.dumps(summary, allow_nan=False)


def test_a_hand_that_never_moved_has_a_null_r(analysis: Analysis) -> None:
    nothing = np.full(len(analysis.metrics), np.nan)
    columns = ("executed_r", "executed_r5", "executed_sparc", "executed_ldlj")
    metrics = dataclasses.replace(analysis.metrics, **dict.fromkeys(columns, nothing))
    summary = build_summary(FACTS, dataclasses.replace(analysis, metrics=metrics))
    assert set(summary["executed"].values()) == {None}
    json.dumps(summary, allow_nan=False)


def test_table_stands_beside_the_papers_figures(analysis: Analysis) -> None:
    text = printed(build_summary(FACTS, analysis))
    rows = {cells[0]: cells[1:] for line in text.splitlines() if (cells := line.split())}
    assert [name for name in rows if name.isdigit()] == [str(target) for target in range(1, 9)]
    assert rows["5"][-1] == "0.0529"
    assert rows["all"][0].startswith("1.6160±0.000")
    assert rows["paper"][:2] == ["1.616±0.007", "1.84±0.127"]
    assert rows["human"] == ["1.805±0.153"]
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "172500 messages, 2 lost" in text
    assert "5.00 times real time" in text
