"""Instructions of the joint tick and of the node's step, counted on the emulator: the bars hold
over all shared vectors, and two runs count the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hpmc import bench_firmware
from hpmc.bench import main
from hpmc.bench_firmware import BARS, MEASUREMENTS, PRESETS, BenchError, Vectors

EVERY = 13  # lanes, where not all are needed


@pytest.fixture(scope="module")
def vectors() -> Vectors:
    return Vectors(1)


@pytest.fixture(scope="module", params=list(PRESETS))
def counted(request: pytest.FixtureRequest, vectors: Vectors) -> tuple[str, np.ndarray]:
    """Number type, and the records of one run."""
    elf = bench_firmware.build(PRESETS[request.param])
    return request.param, bench_firmware.run(elf, vectors)


def test_no_bar_is_exceeded(counted: tuple[str, np.ndarray], vectors: Vectors) -> None:
    numbers, records = counted
    counts = bench_firmware.summarise(records, numbers, vectors)["counts"]
    assert {name: count.worst for name, count in counts.items() if count.is_over} == {}
    assert {name for name, count in counts.items() if count.bar is not None} == set(BARS[numbers])
    assert counts["joint_tick"].samples == vectors.steps.size


@pytest.mark.parametrize("numbers", PRESETS)
def test_two_runs_count_the_same(numbers: str) -> None:
    vectors = Vectors(EVERY)
    elf = bench_firmware.build(PRESETS[numbers])
    records = bench_firmware.run(elf, vectors)
    assert len(records) > vectors.steps.size
    assert np.array_equal(records, bench_firmware.run(elf, vectors))


def test_a_part_of_the_vectors_counts_as_in_the_whole(
    counted: tuple[str, np.ndarray], vectors: Vectors
) -> None:
    numbers, records = counted
    part = Vectors(EVERY)
    some = bench_firmware.run(bench_firmware.build(PRESETS[numbers]), part)
    worst = bench_firmware.summarise(some, numbers, part)["counts"]["joint_tick"]
    ticks = records["instructions"][records["what"] == MEASUREMENTS["joint_tick"]]
    overhead = records["instructions"][records["what"] == bench_firmware.OVERHEAD][0]
    assert ticks[worst.worst_vector] - overhead == worst.worst


def test_other_work_than_the_law_is_found(
    counted: tuple[str, np.ndarray], vectors: Vectors
) -> None:
    numbers, records = counted
    idle = records.copy()
    idle["value"] = 0
    with pytest.raises(BenchError, match="not those of the reference"):
        bench_firmware.summarise(idle, numbers, vectors)


def test_a_wrong_clock_is_found(counted: tuple[str, np.ndarray], vectors: Vectors) -> None:
    numbers, records = counted
    slow = records.copy()
    slow["instructions"] *= 2
    with pytest.raises(BenchError, match="1000 instructions are counted as"):
        bench_firmware.summarise(slow, numbers, vectors)


def test_a_bar_that_is_exceeded_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(BARS["fixed"], "joint_tick", 100)
    file = tmp_path / "counts.json"
    assert main(["firmware", "--every", "416", "--json", str(file)]) == 1
    told = capsys.readouterr()
    assert "joint tick, fixed:" in told.err and "more than 100" in told.err
    assert "joint tick, float:" not in told.err
    counts = json.loads(file.read_text())
    assert counts["unit"] == "instructions"
    assert counts["fixed"]["joint_tick"]["worst"] > 100
    assert set(counts["float"]) == {"overhead_subtracted", *MEASUREMENTS}


@pytest.mark.parametrize("every", ["0", "417", "x"])
def test_bad_arguments(every: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["firmware", "--every", every])
    assert ended.value.code == 2
    assert "--every" in capsys.readouterr().err
