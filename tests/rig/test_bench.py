"""Mode bench with native nodes in place of boards, on a vcan bus.

The tests themselves are in tests/rig/bench; one pytest runs them inside one sandbox, where nodes
and `./rig run --mode bench` meet on vcan0. Here: what is refused before anything runs, and the
wall-clock SYNC of 1 kHz, for machines that are quick enough.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rigrun import RIG

from hpmc.doctor import LOCKSTEP_TICK_MAX_MS, Machine
from hpmc.layout import ROOT, WITH_VCAN

INSIDE = Path(__file__).parent / "bench"
LIMIT_S = 400.0  # of about 40 on a quiet machine


def run_inside(tests: str) -> str:
    ran = subprocess.run(
        [str(WITH_VCAN), sys.executable, "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider",
         "--color=no", "--durations=8", "-k", tests, str(INSIDE)],
        cwd=ROOT, env=os.environ | {"HPMC_BENCH_INSIDE": "1"}, timeout=LIMIT_S,
        stdin=subprocess.DEVNULL, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-20000:] + ran.stderr[-4000:]
    print(ran.stdout)
    return ran.stdout


def test_nodes_in_place_of_boards() -> None:
    said = run_inside("not kilohertz")
    done = re.search(r"(\d+) passed", said)
    assert done and int(done[1]) >= 4, said
    if skipped := re.findall(r"^SKIPPED .*$", said, re.MULTILINE):
        pytest.skip(f"{done[1]} passed, but: {'; '.join(skipped)}")


def test_sync_at_one_kilohertz() -> None:
    tick_ms = Machine().lockstep_tick_ms()
    assert tick_ms is not None, "the lockstep tick could not be measured"
    if tick_ms >= LOCKSTEP_TICK_MAX_MS:
        pytest.skip(
            f"a lockstep tick takes {tick_ms:.2f} ms here, SYNC at 1 kHz wants less than "
            f"{LOCKSTEP_TICK_MAX_MS} ms (./rig doctor)"
        )
    assert "1 passed" in run_inside("kilohertz")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["--can", "can0"]),
        (["--can", "nosuch0"], ["nosuch0", "no such interface", "docs/bench.md"]),
        (["--can", "lo"], ["--can lo", "not can"]),
        (["--can", "slcan:/dev/null"], ["real joints would move", "--yes-move"]),
        (["--can", "slcan:/dev/null", "--sensors", "injected"], ["slcand"]),
        (["--can", "slcan:no/such"], ["no serial device"]),
        (["--can", "lo", "--set", "bus.pipeline=1"], ["bus.pipeline", "must be 2"]),
        (["--can", "lo", "--set", "bench.sync_Hz=20"], ["bench.sync_Hz", "at least 100"]),
        (["--can", "lo", "--set", "bench.sync_Hz=300"], ["bench.sync_Hz", "must divide"]),
        (["--can", "lo", "--jobs", "2"], ["--jobs", "--mode sil"]),
    ],
)
def test_what_is_refused(arguments: list[str], words: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [RIG, "run", "clock", "--mode", "bench", "--out", tmp_path / "run", *arguments],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    (line,) = [line for line in done.stderr.splitlines() if not line.startswith("rig: ")]
    assert done.returncode == 2, line
    assert all(word in line for word in words), line
    assert done.stdout == "" and not (tmp_path / "run").exists()
