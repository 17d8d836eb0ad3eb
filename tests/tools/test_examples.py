"""The example scripts and the snippets of docs/scripting.md run and say what they should."""

from __future__ import annotations

import dataclasses
import inspect
import os
import re
import subprocess
import sys
from functools import cached_property
from pathlib import Path

import matplotlib.image
import pytest

from hpmc import Experiment, Result
from hpmc.layout import BUILD, ROOT

EXAMPLES = ROOT / "tools" / "examples"
PAGE = ROOT / "docs" / "scripting.md"
LIMIT_S = 300


def run_script(folder: Path, *arguments: str) -> str:
    """Runs Python as ./rig python does; what it printed."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join((str(ROOT / "tools"), str(BUILD / "lcm_types" / "python"))),
        "HPMC_RUNS": str(folder / "runs"),
        "MPLBACKEND": "agg",
    }
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, text=True,
        stdin=subprocess.DEVNULL, capture_output=True, timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return done.stdout


def run_example(folder: Path, name: str) -> str:
    """Runs an example and looks at its picture."""
    picture = folder / f"{name}.png"
    said = run_script(folder, str(EXAMPLES / f"{name}.py"), str(picture))
    assert f"picture: {picture}" in said
    pixels = matplotlib.image.imread(picture)
    assert pixels.shape[0] > 500 and pixels.shape[1] > 500
    assert 0.005 < (pixels[..., :3].min(axis=2) < 0.9).mean() < 0.6  # neither empty nor covered
    return said


def test_each_example_is_short_and_tested_here() -> None:
    names = {path.stem for path in EXAMPLES.glob("*.py")}
    assert names == {"figure_of_eight", "phase_rules", "stiffness_sweep", "wall"}
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text().splitlines()) < 60


def test_figure_of_eight(tmp_path: Path) -> None:
    said = run_example(tmp_path, "figure_of_eight")
    fine, bad = re.findall(
        r"target every (\d+) ms: hand ([\d.]+) mm .* ([\d.]+) mm when it may be (\d+) ms late; "
        r"([\d.]+) mm from X_d", said,
    )  # fmt: skip
    assert (fine[0], bad[0]) == ("20", "1")
    assert float(fine[1]) < 2.5 and float(fine[2]) < 1.5 and float(fine[4]) < 0.8
    assert 10 < int(fine[3]) < 30
    assert float(bad[1]) > 2 * float(fine[1])


def test_stiffness_sweep(tmp_path: Path) -> None:
    said = run_example(tmp_path, "stiffness_sweep")
    rmse = [float(text) for text in re.findall(r"position RMSE ([\d.]+) mm", said)]
    assert len(rmse) == 6
    assert rmse[0] > 1.3 * rmse[2] > 1.3 * 1.3 * rmse[4]


def test_phase_rules(tmp_path: Path) -> None:
    said = run_example(tmp_path, "phase_rules")
    rows = re.findall(r"(\w+) +r ([\d.]+) .* velocity RMSE ([\d.]+) mm/s", said)
    assert [row[0] for row in rows] == ["body_motion", "error_growth"]
    assert 1.7 < float(rows[0][1]) < 1.95 and 1.55 < float(rows[1][1]) < 1.75
    assert float(rows[1][2]) < 0.7 * float(rows[0][2])


def test_wall(tmp_path: Path) -> None:
    said = run_example(tmp_path, "wall")
    rest = [float(text) for text in re.findall(r"at rest ([\d.]+) N", said)]
    assert len(rest) == 3 and rest == sorted(rest)
    assert re.findall(r"(\d+) later than 0.3 s", said) == ["0", "0", "0"]
    residuals = re.findall(r"residual at worst ([\d.]+) %", said)
    assert len(residuals) == 3 and max(float(text) for text in residuals) < 1.0


def test_the_snippets_of_the_page(tmp_path: Path) -> None:
    """All of them one after the other, as a reader would paste them."""
    snippets = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.S | re.M)
    assert len(snippets) >= 4
    script = tmp_path / "snippets.py"
    script.write_text("\n".join(snippets))
    expected = re.findall(r"^# -> (.*)$", script.read_text(), re.M)
    said = run_script(tmp_path, str(script))
    assert expected
    for line in expected:
        assert re.search(re.sub(r"\\\.\\\.\\\.", ".*", re.escape(line)), said), line


def test_the_page_lists_all_arrays_with_shape_and_unit() -> None:
    listed = re.findall(r"^\| `(\w+)` \| (n[^|]*) \|\s*([^|]*?)\s*\|", PAGE.read_text(), re.M)
    members = inspect.getmembers(Result, lambda member: isinstance(member, cached_property))
    described = {name: doc for name, m in members if (doc := inspect.getdoc(m) or "")[:2] == "(n"}
    assert {name for name, _, _ in listed} == described.keys()
    for name, shape, unit in listed:
        assert described[name].startswith(f"({shape}), {unit}"), name


def test_the_page_lists_all_options() -> None:
    page = PAGE.read_text()
    for option in dataclasses.fields(Experiment):
        assert f"`{option.name}`" in page, option.name


@pytest.mark.parametrize("name", ["figure_of_eight", "phase_rules", "stiffness_sweep", "wall"])
def test_the_page_names_the_example(name: str) -> None:
    assert f"../tools/examples/{name}.py" in PAGE.read_text()
