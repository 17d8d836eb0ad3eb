"""The hand against a wall: contact force, no lasting chatter, and where the energy goes."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest

from hpmc import Experiment, Result, audit, first_contact, load, run
from hpmc.energy import RESIDUAL_BOUND, kinetic_energy_J
from hpmc.kinematics import PlanarArm

REPETITIONS = 3
# N/m: the force at rest, N. The target is 5 mm behind the surface, so this is not force = k depth
# alone: the softer the wall, the more the hand gives it of the 5 mm.
REST_N = {1e3: (4.2, 4.6), 1e4: (30.0, 31.5), 1e5: (91.0, 96.0)}


@pytest.fixture(scope="module", params=REST_N)
def pressed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    overrides = {"wall.stiffness_N_m": request.param, "experiment.repetitions": REPETITIONS}
    folder = tmp_path_factory.mktemp("wall") / "run"
    return run(Experiment("wall", mode="sil", overrides=overrides, figures=False, out=folder))


def test_the_contact_settles(pressed: Result) -> None:
    stiffness = pressed.configuration["wall"]["stiffness_N_m"]
    low, high = REST_N[stiffness]
    for repetition in range(REPETITIONS):
        contact = first_contact(pressed, repetition=repetition)
        assert 0.4 < contact.touched_s < 0.7
        assert contact.late_breaks == 0
        assert contact.breaks <= 4
        assert contact.torque_reversals < 25
        assert low < contact.rest_N < high
        assert contact.rest_std_N < 0.15 * contact.rest_N
        assert contact.peak_N < 3.0 * contact.rest_N
        assert contact.depth_mm == pytest.approx(1e3 * contact.rest_N / stiffness, rel=0.02)


def test_the_host_is_told_the_force(pressed: Result) -> None:
    filtered = pressed.opened.column("HPMC_STATE", "wrench_N")[:, 0]
    holding = np.flatnonzero(pressed.during(reach=0))[-500:]
    assert filtered[holding].mean() == pytest.approx(pressed.wrench_N[holding, 0].mean(), rel=0.01)
    assert np.array_equal(pressed.wrench_N, pressed.opened.column("HAND_WRENCH", "wrench_N"))


def test_the_hand_comes_back(pressed: Result) -> None:
    home = pressed.configuration["experiment"]["centre_m"]
    rows = pressed.during(reach=1)
    assert np.linalg.norm(pressed.hand_m[rows][-1] - home) < 2e-3
    assert not pressed.wrench_N[rows][-500:].any()


def test_the_energy_adds_up(pressed: Result) -> None:
    for repetition in range(REPETITIONS):
        books = audit(pressed, repetition)
        assert books.worst_residual < RESIDUAL_BOUND
        assert (np.diff(books.friction_J) >= 0).all()
        assert books.kinetic_J.min() >= 0
        # A wall is passive: it never gives back more than it got.
        assert books.environment_J.min() > -RESIDUAL_BOUND * books.turned_over_J[-1]
        assert books.environment_J[-1] > 0.005


@pytest.mark.parametrize("wrong", ["no wall", "no friction", "heavier hand", "torque"])
def test_books_with_an_entry_wrong_do_not_add_up(pressed: Result, wrong: str) -> None:
    changed = load(pressed.folder)
    changed.configuration = copy.deepcopy(pressed.configuration)
    read = changed.opened.column
    factor = {"wrench_N": 0.0} if wrong == "no wall" else {}
    if wrong == "torque":
        factor = {"tau_Nm": 1.2}
    if wrong == "no friction":
        changed.configuration["arm"]["joint_friction_Nm_s_rad"] = 0.0
    if wrong == "heavier hand":
        changed.configuration["arm"]["mass_kg"][2] *= 4
    changed.opened.column = lambda channel, field: factor.get(field, 1.0) * read(channel, field)
    assert audit(changed).worst_residual > 1.5 * RESIDUAL_BOUND


def test_energy_of_the_clock_adds_up_much_closer(tmp_path: Path) -> None:
    free = run(Experiment("clock", mode="sil", figures=False, out=tmp_path / "run"))
    books = audit(free)
    assert books.worst_residual < 1e-3
    assert not books.environment_J.any()
    with pytest.raises(ValueError, match="no repetition 1"):
        audit(free, repetition=1)
    with pytest.raises(ValueError, match="does not touch the wall in reach 0"):
        first_contact(free)
    assert "mJ turned over" in books.in_words()


def test_kinetic_energy_of_known_motions() -> None:
    length, mass = np.array([0.3, 0.2, 0.1]), np.array([2.0, 1.0, 0.5])
    straight = np.zeros(3)
    # All links turn as one rod about the shoulder.
    places = np.array([0.15, 0.4, 0.55])
    inertia = (mass * (length**2 / 12 + places**2)).sum()
    energy = kinetic_energy_J(straight, np.array([2.0, 0.0, 0.0]), length, mass)
    assert energy == pytest.approx(0.5 * inertia * 4.0)
    # Only the hand turns.
    energy = kinetic_energy_J(np.array([0.3, 0.4, 0.5]), np.array([0.0, 0.0, 3.0]), length, mass)
    assert energy == pytest.approx(0.5 * 0.5 * 0.1**2 / 3 * 9.0)


def test_kinetic_energy_by_finite_differences() -> None:
    random = np.random.default_rng(5)
    arm, mass, step = PlanarArm(), np.array([4.0, 2.5, 1.0]), 1e-6
    for _ in range(20):
        q, rate = random.uniform(-3, 3, 3), random.uniform(-2, 2, 3)
        before, after = (arm.joint_positions(q + sign * step * rate) for sign in (-0.5, 0.5))
        centre_rate = (after[1:] + after[:-1] - before[1:] - before[:-1]) / 2 / step
        turning = mass * np.array(arm.length_m) ** 2 / 12 * np.cumsum(rate) ** 2
        expected = 0.5 * (mass * (centre_rate**2).sum(axis=1) + turning).sum()
        assert kinetic_energy_J(q, rate, arm.length_m, mass) == pytest.approx(expected, rel=1e-6)


def test_a_run_past_the_wall_says_so(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    short = {"experiment.radius_m": 0.01, "experiment.period_s": 0.5}
    past = run(Experiment("wall", mode="sil", overrides=short, out=tmp_path / "run"), quiet=False)
    said = capfd.readouterr().out
    assert "contact: the hand does not touch the wall in reach 0" in said
    assert "energy: motors" in said
    # The paper is about the clock: its figures and pictures go with all of it.
    assert "Wall experiment" in said and "paper" not in said
    assert not list(past.folder.glob("*.png"))


def test_part_of_the_clock_is_summed_up(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    short = {"experiment.reaches": 3, "experiment.period_s": 0.5}
    part = run(Experiment(mode="sil", overrides=short, out=tmp_path / "run"), quiet=False)
    rows = [line.split() for line in capfd.readouterr().out.splitlines()]
    assert [row[0] for row in rows if row and row[0].isdigit() and len(row) == 6] == ["1", "2"]
    assert [target["planned_r"] is None for target in part.metrics["targets"][:4]] == [
        False, False, True, True,
    ]  # fmt: skip
