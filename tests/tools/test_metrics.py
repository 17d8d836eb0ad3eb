"""Metrics on movements with known answers, kinematics against finite differences, the cutting of
a log into reaches."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from synthetic_log import MOVEMENT_S, REACH_TICKS, half_cosine, ripple, write_clock_log

from hpmc.analysis import analyse_logs
from hpmc.kinematics import ClockGeometry, PlanarArm
from hpmc.lcm_log import LcmLog, LogError
from hpmc.metrics import (
    final_error,
    log_dimensionless_jerk,
    peak_over_mean,
    peak_over_mean_moving,
    rmse,
    spectral_arc_length,
    speed,
)
from hpmc.movements import ReachIndex

OWN_DURATION = np.linspace(0, 1, 100_001)


def half_cosine_speed(time: np.ndarray) -> np.ndarray:
    return np.sin(np.pi * time)


def minimum_jerk_speed(time: np.ndarray) -> np.ndarray:
    return 30 * time**2 - 60 * time**3 + 30 * time**4


def test_r_of_the_two_reference_movements_over_their_own_duration() -> None:
    assert peak_over_mean(half_cosine_speed(OWN_DURATION)) == pytest.approx(1.5708, abs=5e-5)
    assert peak_over_mean(minimum_jerk_speed(OWN_DURATION)) == pytest.approx(1.875, abs=5e-5)


def test_r_above_five_percent_of_the_peak() -> None:
    moving = peak_over_mean_moving
    assert moving(half_cosine_speed(OWN_DURATION)) == pytest.approx(1.523, abs=5e-4)
    assert moving(minimum_jerk_speed(OWN_DURATION)) == pytest.approx(1.6585, abs=5e-5)


def test_r_of_the_half_cosine_in_a_window_of_one_second() -> None:
    time = np.arange(1000) * 1e-3
    speeds = np.where(time < MOVEMENT_S, half_cosine_speed(time / MOVEMENT_S), 0.0)
    assert peak_over_mean(speeds) == pytest.approx(1.616, abs=5e-4)
    # waiting at the end is left out by the threshold
    assert peak_over_mean_moving(speeds) == pytest.approx(1.523, abs=2e-3)


def test_the_threshold_keeps_a_pause_between_two_submovements() -> None:
    speeds = np.array([0, 0, 1, 4, 0, 0, 2, 1, 0, 0.0])
    assert peak_over_mean_moving(speeds) == pytest.approx(4 / (8 / 6))
    assert peak_over_mean(speeds) == pytest.approx(4 / 0.8)


def test_no_movement_has_no_r() -> None:
    speeds = np.stack([np.zeros(10), np.ones(10)])
    with np.errstate(all="raise"):
        assert np.isnan(peak_over_mean(speeds)).tolist() == [True, False]
        assert np.isnan(peak_over_mean_moving(speeds)).tolist() == [True, False]


BELL = np.exp(-5 * np.arange(-1, 1, 0.01) ** 2)  # speed of the authors' example, 10 ms apart


def test_spectral_arc_length_and_jerk_have_their_authors_values() -> None:
    assert spectral_arc_length(BELL, 0.01) == pytest.approx(-1.41403, abs=5e-6)
    assert log_dimensionless_jerk(BELL, 0.01) == pytest.approx(-5.81636, abs=5e-6)


def arc_length_by_transform(speeds: np.ndarray, rate_hz: float) -> float:
    """The definition in words, with a whole padded transform and a loop."""
    points = 2 ** (int(np.ceil(np.log2(speeds.size))) + 4)
    spectrum = np.abs(np.fft.fft(speeds, points))
    seen = [
        (k * rate_hz / points, float(spectrum[k] / spectrum.max()))
        for k in range(points // 2 + 1)
        if k * rate_hz / points <= 10.0
    ]
    while seen[-1][1] < 0.05:
        seen.pop()
    while seen[0][1] < 0.05:
        seen.pop(0)
    width = seen[-1][0] - seen[0][0]
    steps = itertools.pairwise(seen)
    return -sum(np.hypot((f1 - f0) / width, m1 - m0) for (f0, m0), (f1, m1) in steps)


def test_spectral_arc_length_is_that_of_the_whole_transform() -> None:
    random = np.random.default_rng(3)
    time = np.arange(1000) * 1e-3
    for tremor_hz in (2.0, 6.5, 9.9, 15.0):
        speeds = np.sin(np.pi * time) + 0.3 * np.abs(np.sin(np.pi * tremor_hz * time))
        speeds += 0.05 * np.abs(random.normal(size=time.size))
        expected = arc_length_by_transform(speeds, 1000)
        assert spectral_arc_length(speeds, 1e-3) == pytest.approx(expected, rel=1e-9)
    # slow sampling: the spectrum ends below the highest frequency looked at
    few = np.array([0.0, 1.0, 3.0, 2.0, 0.5])
    assert spectral_arc_length(few, 0.1) == pytest.approx(arc_length_by_transform(few, 10))


def test_smoothness_depends_neither_on_size_nor_on_duration_and_falls_with_tremor() -> None:
    for smoothness in (spectral_arc_length, log_dimensionless_jerk):
        assert smoothness(7 * BELL, 0.01) == pytest.approx(smoothness(BELL, 0.01))
    # the same samples in twice the time
    assert log_dimensionless_jerk(BELL, 0.02) == pytest.approx(log_dimensionless_jerk(BELL, 0.01))
    tremor = BELL * (1 + 0.2 * np.sin(2 * np.pi * 6 * np.arange(BELL.size) * 0.01))
    assert spectral_arc_length(tremor, 0.01) < spectral_arc_length(BELL, 0.01) - 0.1
    assert log_dimensionless_jerk(tremor, 0.01) < log_dimensionless_jerk(BELL, 0.01) - 1


def test_smoothness_of_many_reaches_is_that_of_each_and_none_of_rest() -> None:
    random = np.random.default_rng(5)
    speeds = BELL + 0.1 * np.abs(random.normal(size=(4, BELL.size)))
    speeds[2] = 0.0
    for smoothness in (spectral_arc_length, log_dimensionless_jerk):
        with np.errstate(all="raise"):
            together = smoothness(speeds, 0.01)
            assert np.isnan(together).tolist() == [False, False, True, False]
        each = [smoothness(speeds[i], 0.01) for i in (0, 1, 3)]
        np.testing.assert_allclose(together[[0, 1, 3]], each)


def test_rmse_is_of_the_distance() -> None:
    desired = np.zeros((2, 4, 2))
    actual = desired.copy()
    actual[0] = [3.0, 4.0]
    actual[1, 0] = [0.0, 2.0]
    np.testing.assert_allclose(rmse(actual, desired), [5.0, 1.0])


def test_final_error_is_of_the_last_sample() -> None:
    path = np.array([[[9.0, 9.0], [1.0, 1.0]]])
    np.testing.assert_allclose(final_error(path, np.array([[1.0, 3.0]])), [2.0])
    np.testing.assert_allclose(speed(np.array([[3.0, -4.0]])), [5.0])


def test_manipulability_is_lowest_at_targets_5_and_6() -> None:
    clock = ClockGeometry()
    volume = [clock.manipulability(target) for target in range(9)]
    assert [round(volume[target], 4) for target in (0, 5, 6)] == [
        0.0690,
        0.0529,
        0.0584,
    ]
    assert set(np.argsort(volume)[:2].tolist()) == {5, 6}


@pytest.mark.parametrize("target", range(9))
def test_posture_reaches_the_target_with_the_hand_at_phi(target: int) -> None:
    clock = ClockGeometry()
    q_rad = clock.posture(target)
    np.testing.assert_allclose(
        clock.arm.joint_positions(q_rad)[3], clock.position(target), atol=1e-12
    )
    assert np.cos(q_rad.sum() - np.deg2rad(155)) == pytest.approx(1)
    assert q_rad[1] > 0


def test_jacobian_is_the_derivative_of_the_hand_position() -> None:
    arm, step = PlanarArm(), 1e-6
    for q_rad in np.random.default_rng(1).uniform(-3, 3, (20, 3)):
        numeric = [
            (arm.joint_positions(q_rad + d)[3] - arm.joint_positions(q_rad - d)[3]) / (2 * step)
            for d in step * np.eye(3)
        ]
        np.testing.assert_allclose(arm.hand_jacobian(q_rad), np.array(numeric).T, atol=1e-9)


def test_out_of_reach_is_said() -> None:
    with pytest.raises(ValueError, match="out of reach"):
        PlanarArm().posture(np.array([0.7, 0.0]), 0.0)


@pytest.mark.parametrize("joint_ticks", [1, 5])
def test_reaches_of_a_log_have_the_metrics_they_were_made_with(
    tmp_path: Path, joint_ticks: int
) -> None:
    path = tmp_path / "run.lcmlog"
    write_clock_log(path, repetitions=range(3, 5), reaches=2, joint_ticks=joint_ticks)
    analysis = analyse_logs([path])
    metrics = analysis.metrics
    assert metrics.repetition.tolist() == [3, 3, 4, 4]
    assert metrics.reach.tolist() == [0, 1, 0, 1]
    assert metrics.target.tolist() == [1, 1, 1, 1]
    np.testing.assert_allclose(metrics.planned_r, 1.616, atol=5e-4)
    for row, reach in enumerate(metrics.reach.tolist()):
        ahead_m, rate_m_s = np.array([ripple(1e-3 * tick, reach) for tick in range(1000)]).T
        planned_m_s = np.array([half_cosine(1e-3 * tick)[1] for tick in range(1000)])
        executed_m_s = np.abs(planned_m_s + rate_m_s)
        for column, expected in (
            ("position_rmse_mm", 1e3 * np.sqrt(np.mean(ahead_m**2))),
            ("velocity_rmse_mm_s", 1e3 * np.sqrt(np.mean(rate_m_s**2))),
            ("final_error_mm", 1e3 * abs(ahead_m[-1])),
            ("executed_r", executed_m_s.max() / executed_m_s.mean()),
            ("executed_r5", peak_over_mean_moving(executed_m_s)),
            ("planned_sparc", arc_length_by_transform(planned_m_s, 1000)),
            ("executed_sparc", arc_length_by_transform(executed_m_s, 1000)),
            ("planned_ldlj", log_dimensionless_jerk(planned_m_s, 1e-3)),
            ("executed_ldlj", log_dimensionless_jerk(executed_m_s, 1e-3)),
        ):
            assert getattr(metrics, column)[row] == pytest.approx(expected, rel=1e-6), column
        assert metrics.executed_r5[row] < metrics.executed_r[row] - 0.01
    assert (analysis.incomplete, analysis.repetitions) == (0, 2)
    assert analysis.simulated_s == pytest.approx(4.08, abs=2e-3)
    assert sorted(analysis.curves) == [(1, False), (1, True)]
    curves = analysis.curves[1, True]
    assert curves.executed_way_mm.count == 2
    assert curves.planned_way_mm.mean[-1] == pytest.approx(100)
    assert curves.executed_way_mm.std.max() == pytest.approx(0, abs=1e-5)


def test_the_hand_that_follows_the_plan_has_its_r(tmp_path: Path) -> None:
    write_clock_log(tmp_path / "run.lcmlog", reaches=1, ripple_mm=0.0)
    metrics = analyse_logs([tmp_path / "run.lcmlog"]).metrics
    assert metrics.planned_r == pytest.approx(metrics.executed_r)
    assert metrics.executed_r == pytest.approx(1.616, abs=5e-4)
    assert metrics.executed_r5 == pytest.approx(1.523, abs=2e-3)


def test_a_reach_that_lacks_a_sample_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "run.lcmlog"
    write_clock_log(path, reaches=3)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 8 // 10])  # the end of a killed run
    analysis = analyse_logs([path])
    assert (len(analysis.metrics), analysis.incomplete, len(analysis.damage)) == (
        2,
        1,
        1,
    )

    log = LcmLog(path)
    for channel in ("HPMC_STATE", "ARM_STATE"):
        offsets, _ = log.message_places(channel)
        holed = bytearray(whole)
        place = int(offsets[20 + REACH_TICKS + 500]) - len(channel) - 28
        holed[place : place + 4] = b"lost"
        path.write_bytes(holed)
        index = ReachIndex(LcmLog(path))
        assert (len(index), index.incomplete) == (2, 1)
        assert [batch.reach.tolist() for batch in index.batches()] == [[0, 2]]


def test_batches_do_not_change_the_reaches(tmp_path: Path) -> None:
    path = tmp_path / "run.lcmlog"
    write_clock_log(path, reaches=3, joint_ticks=2)
    index = ReachIndex(LcmLog(path))
    (whole,) = index.batches()
    parts = list(index.batches(batch_ticks=1))
    assert len(parts) == 3
    for name in ("x_t_m", "x_d_m", "v_d_m_s", "hand_m", "hand_m_s", "reach", "target"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))


def test_a_reach_goes_out_from_home_and_the_next_one_back(tmp_path: Path) -> None:
    path = tmp_path / "run.lcmlog"
    # nothing between the repetitions: reach 0 of one is followed by reach 0 of the next
    write_clock_log(path, repetitions=range(2), reaches=1, setup_ticks=0)
    (reaches,) = ReachIndex(LcmLog(path)).batches()
    assert reaches.repetition.tolist() == [0, 1]

    write_clock_log(path, reaches=4)
    (reaches,) = ReachIndex(LcmLog(path)).batches()
    assert reaches.target.tolist() == [1, 1, 2, 2]
    assert reaches.outward.tolist() == [True, False, True, False]
    clock = ClockGeometry()
    for target, outward, x_t_m in zip(reaches.target, reaches.outward, reaches.x_t_m, strict=True):
        np.testing.assert_allclose(x_t_m, clock.position(int(target) if outward else 0))


def test_logs_of_several_jobs_are_one_run(tmp_path: Path) -> None:
    parts = [tmp_path / "1.lcmlog", tmp_path / "0.lcmlog"]
    write_clock_log(parts[0], repetitions=range(1, 2), reaches=2)
    write_clock_log(parts[1], repetitions=range(1), reaches=2)
    analysis = analyse_logs(parts)
    assert analysis.metrics.repetition.tolist() == [0, 0, 1, 1]
    assert analysis.sample.repetition.tolist() == [0, 0]


def test_a_log_without_a_whole_reach_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.lcmlog"
    write_clock_log(path, reaches=0)
    with pytest.raises(LogError, match="no whole reach"):
        analyse_logs([path])
