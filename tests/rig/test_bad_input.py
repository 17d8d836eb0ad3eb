"""Bad input: one clear line, exit status 2, nothing left behind."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from rigrun import RIG, ROOT


def contents(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "joint.rate_hz=1000"], ["joint.rate_hz", "joint.rate_Hz"]),
        (["--set", "experiment.radius_m=0.9"], ["experiment.radius_m", "0.001 to 0.3"]),
        (["--set", "experiment.centre_m=[0.5, 0]"], ["target 1", "out of reach", "0.551 m"]),
        (["--config", "no/such.toml"], ["no/such.toml", "no such file"]),
        (["--repetitions", "0"], ["experiment.repetitions", "1 to 100000"]),
        (["--joint-rate-hz", "2000"], ["--joint-rate-hz", "1000", "5000"]),
        (["--repetitions", "99999", "--log", "full", "--mode", "sil"], ["MB are free", "--out"]),
        (["--jobs", "2"], ["--jobs", "--mode sil"]),
    ],
)
def test_bad_input_through_the_front_door(
    arguments: list[str], words: list[str], tmp_path: Path
) -> None:
    folder = tmp_path / "new" / "run"
    before = contents(ROOT / "runs")
    done = subprocess.run(
        [RIG, "run", "clock", "--out", folder, *arguments],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if not line.startswith("rig: ")]
    assert all(word in line for word in words), line
    assert done.stdout == ""
    assert contents(tmp_path) == set()
    assert contents(ROOT / "runs") == before
