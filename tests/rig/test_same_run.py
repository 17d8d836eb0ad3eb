"""One configuration and seed give one run, whatever carries it: byte for byte."""

from __future__ import annotations

from pathlib import Path

import pytest
from rigrun import SHORT, Run, run_rig

from hpmc.layout import CONFIG


def test_sil_and_vcan_are_one_run(sil: Run, vcan: Run) -> None:
    assert len(sil.states()) == 17250
    assert sil.states() == vcan.states()
    ours, theirs = sil.log(), vcan.log()
    assert ours.channels == theirs.channels
    for channel in ours.channels:
        if channel != "RUN_INFO":  # says the mode
            assert list(ours.raw_messages(channel)) == list(theirs.raw_messages(channel)), channel
    assert (sil.folder / "candump.log").read_bytes() == (vcan.folder / "candump.log").read_bytes()
    assert sil.summary["executed"] == vcan.summary["executed"]


def test_two_runs_on_the_bus_are_one_run(vcan: Run, vcan_realtime: Run) -> None:
    assert vcan.states() == vcan_realtime.states()


def test_two_runs_in_one_process_are_one_run(short_sil: Run, runs: Path) -> None:
    again = run_rig("--mode", "sil", *SHORT, folder=runs / "short_again")
    log = (short_sil.folder / "run.lcmlog").read_bytes()
    assert log == (again.folder / "run.lcmlog").read_bytes()


def test_injected_sensors_on_the_bus(short_injected: Run, runs: Path) -> None:
    on_bus = run_rig("--sensors", "injected", *SHORT, folder=runs / "injected_vcan")
    assert on_bus.states() == short_injected.states()
    assert on_bus.summary["bus"]["lost"] == 0 and on_bus.summary["lcm"]["lost"] == 0
    dump = (short_injected.folder / "candump.log").read_bytes()
    assert dump == (on_bus.folder / "candump.log").read_bytes()
    assert dump.count(b" 501#") == 4450


def test_injected_sensors_give_the_run_of_direct_ones(short_injected: Run, short_sil: Run) -> None:
    # One function quantises the angle in both, and torques are whole mN m in both.
    assert short_injected.states() == short_sil.states()


def test_joints_at_5_khz_on_the_bus(short_fast: Run, runs: Path) -> None:
    on_bus = run_rig("--joint-rate-hz", "5000", *SHORT, folder=runs / "fast_vcan")
    assert len(short_fast.states()) == 5 * 4450
    assert on_bus.states() == short_fast.states()
    assert on_bus.summary["bus"]["lost"] == 0 and on_bus.summary["lcm"]["lost"] == 0


def test_joints_at_5_khz_are_another_run(short_fast: Run, short_sil: Run) -> None:
    assert short_fast.states()[::5] != short_sil.states()


def test_a_press_against_the_wall_on_the_bus(runs: Path) -> None:
    wall = ("--config", str(CONFIG / "wall.toml"), "--set", "experiment.reaches=1",
            "--set", "experiment.period_s=0.9")  # fmt: skip
    alone = run_rig("--mode", "sil", *wall, folder=runs / "wall_sil")
    on_bus = run_rig(*wall, folder=runs / "wall_vcan")
    assert on_bus.log().column("HAND_WRENCH", "wrench_N")[:, 0].max() > 10.0
    assert on_bus.states() == alone.states()
    assert "residual at worst" in on_bus.said


# --- repetitions ---------------------------------------------------------------------------------


def by_repetition(run: Run, logs: list[str]) -> dict[int, list[bytes]]:
    """Angles and all else of ARM_STATE, behind its time and number, by repetition."""
    head = 8 + 8 + 8  # fingerprint, utime, seq
    found: dict[int, list[bytes]] = {}
    for name in logs:
        log = run.log(name)
        repetition = log.column("HPMC_STATE", "repetition").tolist()
        states = list(log.raw_messages("ARM_STATE"))
        for number, state in zip(repetition, states, strict=True):
            found.setdefault(number, []).append(state[head:])
    return found


@pytest.fixture(scope="session")
def one_job(runs: Path) -> Run:
    return run_rig("--mode", "sil", "--repetitions", "5", *SHORT, folder=runs / "one_job")


def test_jobs_do_not_change_results(one_job: Run, runs: Path) -> None:
    two = run_rig(
        "--mode", "sil", "--repetitions", "5", "--jobs", "2", *SHORT, folder=runs / "two_jobs"
    )
    logs = ["run-00.lcmlog", "run-01.lcmlog"]
    assert sorted(path.name for path in two.folder.glob("*.lcmlog")) == logs
    assert two.log(logs[0]).column("HPMC_STATE", "repetition").tolist() == [
        r for r in (0, 1, 2) for _ in range(4450)
    ]
    # Time and number included.
    assert one_job.states() == two.states(logs[0]) + two.states(logs[1])
    assert one_job.summary["executed"] == two.summary["executed"]
    assert one_job.summary["targets"] == two.summary["targets"]
    assert two.summary["repetitions"] == 5 and two.summary["reaches"] == 80
    assert two.summary["bus"]["frames"] == one_job.summary["bus"]["frames"]


def test_more_jobs_than_repetitions(one_job: Run, runs: Path) -> None:
    many = run_rig(
        "--mode", "sil", "--repetitions", "2", "--jobs", "8", *SHORT, folder=runs / "many_jobs"
    )
    states = many.states("run-00.lcmlog") + many.states("run-01.lcmlog")
    assert states == one_job.states()[: len(states)]


def test_repetitions_differ_from_each_other(one_job: Run) -> None:
    repetitions = by_repetition(one_job, ["run.lcmlog"])
    assert sorted(repetitions) == [0, 1, 2, 3, 4]
    assert len({tuple(states[:1]) for states in repetitions.values()}) == 5
    assert len({tuple(states) for states in repetitions.values()}) == 5
    results = {target["executed_r"] for target in one_job.summary["targets"]}
    assert len(results) == 8


def test_the_first_repetition_does_not_depend_on_how_many_follow(
    one_job: Run, short_sil: Run
) -> None:
    assert one_job.states()[:4450] == short_sil.states()


def test_another_seed_is_another_run(short_sil: Run, runs: Path) -> None:
    other = run_rig("--mode", "sil", "--seed", "2", *SHORT, folder=runs / "seed")
    assert other.summary["seed"] == 2
    ours, theirs = short_sil.states(), other.states()
    assert len(ours) == len(theirs)
    assert all(a != b for a, b in zip(ours, theirs, strict=True))


def test_several_repetitions_on_the_bus(one_job: Run, runs: Path) -> None:
    on_bus = run_rig("--repetitions", "2", *SHORT, folder=runs / "two_on_bus")
    states = on_bus.states()
    assert states == one_job.states()[: len(states)] and len(states) == 2 * 4450
    assert on_bus.summary["bus"]["lost"] == 0 and on_bus.summary["lcm"]["lost"] == 0


def test_the_configuration_as_used_gives_the_run_again(runs: Path) -> None:
    changes = ("--phase-rule", "error_growth", "--seed", "77", "--set", "plant.step_s=0.0001",
               "--set", "joint.ramp_s=0.15")  # fmt: skip
    first = run_rig("--mode", "sil", *changes, *SHORT, folder=runs / "changed")
    again = run_rig(
        "--mode", "sil", "--config", str(first.folder / "config.toml"), folder=runs / "from_config"
    )
    assert again.states() == first.states()
    config = (first.folder / "config.toml").read_text()
    assert (again.folder / "config.toml").read_text() == config
    assert 'phase_rule = "error_growth"' in config and "seed = 77" in config


def test_a_file_needs_only_the_keys_that_it_changes(runs: Path, short_sil: Run) -> None:
    file = runs / "seed.toml"
    file.write_text("[experiment]\nseed = 2\nperiod_s = 5.0\n")
    run = run_rig("--mode", "sil", "--config", str(file), *SHORT, folder=runs / "with_file")
    assert run.summary["seed"] == 2
    assert len(run.states()) == 4450  # --set goes over the file
    assert run.states() != short_sil.states()
