"""The double-precision reference against the law in its own words, and the edges in its vectors."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "vectors"))

import joint_vectors as vectors  # noqa: E402

from hpmc.reference import Output, guard, profile  # noqa: E402

# Of what goes in. Another digest means other vectors: a changed generator, or another stream of
# numpy's. Then look at the printed differences of unit_vectors before changing it here.
INPUT_DIGEST = "7ef75c9cf5fae521f685bb8369390068ab60f2f2ac86bd4eb70e7815f4fa379b"
INPUTS = ("events", "elapsed_us", "position_inc", "ramp_ppm", "target_inc", "torque_mNm",
          "torque_max_mNm")  # fmt: skip


@pytest.fixture(scope="module")
def made() -> tuple[np.ndarray, np.ndarray]:
    return vectors.make_vectors()


@dataclass
class PlainFic:
    """One joint, written as the equations of docs/theory.md stand."""

    lane: np.void
    q_x: int = 0
    age: int = 0
    direction: int = 0
    s: int = 0
    converging: bool = False
    a_max: float = 0.0
    f_max: float = 0.0
    ext: float = 0.0
    seen: set[str] = field(default_factory=set)

    def torque_profile(self, a: float, t1: float, t2: float) -> float:
        q_a, q_p, q_b = (
            int(self.lane[name]) * 1e-6 for name in ("q_a_urad", "q_p_urad", "q_b_urad")
        )
        if a <= q_a:
            return t1 * a / q_a
        if a <= q_p:
            return t1
        if a < q_b:
            return t1 + (t2 - t1) * (a - q_p) / (q_b - q_p)
        return t2

    def step(self, e: float, q: int, elapsed: int, t1: float, t2: float) -> float:
        a, sg = abs(e), -1 if e < 0 else 1
        f = self.torque_profile(a, t1, t2)
        delta_inc = int(self.lane["delta_inc256"]) / 256
        if self.lane["error_growth"]:
            delta = delta_inc * 2 * np.pi / int(self.lane["increments_per_revolution"])
            self.error_growth(a, f, sg, delta)
        else:
            self.body_motion(e, a, f, sg, q, delta_inc, elapsed)
        if not self.converging:
            return sg * f
        spring = 2 * self.f_max / self.a_max * (a - self.a_max / 2) if self.a_max > 0 else 0.0
        self.seen.add("profile below spring" if f < spring else "spring")
        return sg * min(spring, f)

    def body_motion(
        self, e: float, a: float, f: float, sg: int, q: int, delta: float, elapsed: int
    ) -> None:
        if self.direction >= 0:
            if q >= self.q_x:
                self.age = 0 if q > self.q_x else self.age
                self.q_x = q
            elif q < self.q_x - delta:
                self.direction, self.q_x, self.age = -1, q, 0
        elif q <= self.q_x:
            self.age = 0 if q < self.q_x else self.age
            self.q_x = q
        elif q > self.q_x + delta:
            self.direction, self.q_x, self.age = 1, q, 0
        self.age += elapsed
        d = 0 if self.age > int(self.lane["stall_time_us"]) else self.direction
        if sg != self.s:
            self.s, self.a_max, self.f_max = sg, a, f
        self.converging = e * d > 0
        if not self.converging or a > self.a_max:
            self.a_max, self.f_max = a, f

    def error_growth(self, a: float, f: float, sg: int, delta: float) -> None:
        if sg != self.s:
            self.s, self.converging, self.a_max, self.ext, self.f_max = sg, False, a, a, f
        elif not self.converging:
            if a >= self.a_max:
                self.a_max, self.f_max = a, f
            elif a < self.a_max - delta:
                self.converging, self.ext = True, a
        elif a <= self.ext:
            self.ext = a
        elif a > self.ext + delta:
            self.converging, self.a_max, self.f_max = False, a, f


def run_plain(lane: np.void, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, set[str]]:
    """Torques and phases of one lane, and what was met on the way."""
    parts, step_rad = int(lane["ticks_per_sync"]), 0.0
    step_rad = 2 * np.pi / (int(lane["increments_per_revolution"]) * parts)
    limit = int(0.5 / step_rad)
    fic = PlainFic(lane, q_x=int(steps[0]["position_inc"]))
    told = tuple(int(steps[0][name]) for name in ("target_inc", "torque_mNm", "torque_max_mNm"))
    before = now = told
    tick, torques, phases = 0, [], []
    for step in steps:
        told = tuple(int(step[name]) for name in ("target_inc", "torque_mNm", "torque_max_mNm"))
        q = int(step["position_inc"])
        if step["events"] & vectors.COMMAND:
            before, now, tick = now, told, 0
        if step["events"] & vectors.RESET:
            before, now, tick = told, told, 0
            fic = PlainFic(lane, q_x=q, seen=fic.seen)
        if step["events"] & vectors.HOLD:
            before = now = (q, *now[1:])
            fic = PlainFic(lane, q_x=q, seen=fic.seen)
        part = 1 if parts == 1 else min(tick, parts)
        tick += 1
        q_d, t_d, t_max = (b * parts + (n - b) * part for b, n in zip(before, now, strict=True))
        e = max(-limit, min(limit, q_d - q * parts)) * step_rad
        t2 = t_max / (1000 * parts)
        t1 = min(abs(t_d) / (1000 * parts), t2)
        ta = int(lane["torque_limit_mNm"]) / 1000
        torques.append(max(-ta, min(ta, fic.step(e, q, int(step["elapsed_us"]), t1, t2))))
        phases.append(fic.converging)
    return np.array(torques), np.array(phases), fic.seen


def test_the_reference_is_the_law_in_its_own_words(made: tuple[np.ndarray, np.ndarray]) -> None:
    lanes, steps = made
    seen: set[str] = set()
    for lane in range(0, len(lanes), 5):
        if vectors.has_ties(lanes)[lane]:
            continue
        torques, phases, met = run_plain(lanes[lane], steps[lane])
        np.testing.assert_array_equal(phases, steps[lane]["converging"] == 1, err_msg=f"{lane}")
        np.testing.assert_allclose(torques, steps[lane]["torque_Nm"], rtol=1e-9, atol=1e-9)
        seen |= met
    assert seen == {"spring", "profile below spring"}


def test_profile_of_the_paper() -> None:
    a = np.array([0.0, 0.00375, 0.0075, 0.009, 0.0125, 0.016, 0.5])
    one = np.ones_like(a)
    f = profile(a, 0.0075 * one, 0.009 * one, 0.016 * one, 2 * one, 5 * one)
    np.testing.assert_allclose(f, [0, 1, 2, 2, 3.5, 5, 5], atol=1e-12)


def test_guard_bounds_round_and_stop_at_position_limits() -> None:
    def output(torque: float, torque_max: float, f_max: float) -> Output:
        zero = np.zeros(1)
        return Output(np.array([torque]), np.array([torque_max]), np.array([f_max]), zero, zero)

    def of(torque: float, ramp: int, position: int = 0, f_max: float = 2.0) -> int:
        def whole(value: int) -> np.ndarray:
            return np.array([value])

        guarded = guard(output(torque, 8.0, f_max), np.array([20.0]), whole(ramp), whole(position),
                        whole(-1000), whole(1000))  # fmt: skip
        return int(guarded[0])

    assert [of(3.0, 1_000_000), of(-3.0, 100_000), of(9.0, 1_000_000)] == [3000, -2000, 8000]
    assert of(9.0, 1_000_000, f_max=8.5) == 8500
    assert [of(0.0005, 1_000_000), of(-0.0005, 1_000_000)] == [1, -1]
    assert [of(3.0, 1_000_000, 1000), of(-3.0, 1_000_000, 1000)] == [0, -3000]


def test_the_vectors_reach_every_edge(made: tuple[np.ndarray, np.ndarray]) -> None:
    lanes, steps = made
    assert steps.size >= 100_000
    assert set(lanes["ticks_per_sync"]) == set(range(1, 11))
    assert {1 << 10, 1 << 24} <= set(lanes["increments_per_revolution"])
    for rule in (0, 1):
        of_rule = steps[lanes["error_growth"] == rule]
        assert 0.1 < of_rule["converging"].mean() < 0.6
        assert (np.diff(of_rule["sign"], axis=1) != 0).sum() > 2000
    for name, ends in (("q_a_urad", (1, 250, 500_000)), ("q_b_urad", (1, 500, 500_000)),
                       ("torque_limit_mNm", (0, 32767)), ("delta_inc256", (0, 65535)),
                       ("stall_time_us", (0, 1_000_000))):  # fmt: skip
        assert set(ends) <= set(lanes[name]), name
    for name, ends in (("position_inc", (-(2**31), 2**31 - 1)), ("torque_mNm", (-32767, 0, 32767)),
                       ("target_inc", (-(2**31), 2**31 - 1)), ("torque_max_mNm", (0, 32767)),
                       ("ramp_ppm", (0, 1_000_000))):  # fmt: skip
        assert set(ends) <= set(steps[name].ravel()), name
    a = abs(steps["error_rad"])
    q_a, q_p, q_b = (lanes[name][:, None] * 1e-6 for name in ("q_a_urad", "q_p_urad", "q_b_urad"))
    pieces = [a < q_a, (a > q_a) & (a < q_p), (a > q_p) & (a < q_b), a > q_b, a > 0.4999, a == 0]
    assert min(piece.sum() for piece in pieces) > 2000
    for event in (vectors.COMMAND, vectors.RESET, vectors.HOLD):
        assert (steps["events"] & event != 0).sum() > 300
    assert (steps["age_us"] > lanes["stall_time_us"][:, None]).sum() > 5000
    assert (abs(steps["torque_Nm"]) > steps["f_max_Nm"] * 0.99).sum() > 5000
    stopped = (steps["guarded_mNm"] == 0) & (abs(steps["torque_Nm"]) > 1) & (steps["ramp_ppm"] > 0)
    assert stopped.sum() > 300  # at position limits, or TA x ramp below .5 mN m


def test_few_lanes_are_steep_and_only_they_are_given_more(
    made: tuple[np.ndarray, np.ndarray],
) -> None:
    lanes, _ = made
    q_a, q_p, q_b = (lanes[name].astype(int) for name in ("q_a_urad", "q_p_urad", "q_b_urad"))
    ordinary = (q_a >= 250) & ((q_b == q_p) | (q_b - q_p >= np.maximum(250, q_p // 50)))
    assert ((lanes["steep"] == 0) <= ordinary).all()
    assert (lanes["tolerance_Nm"][lanes["steep"] == 0] == 0.001).all()
    assert lanes["steep"].sum() <= 0.06 * len(lanes)


def test_the_seed_makes_these_vectors(made: tuple[np.ndarray, np.ndarray]) -> None:
    lanes, steps = made
    digest = hashlib.sha256()
    for name in vectors.LANE.names:
        if name != "tolerance_Nm":  # comes through floating-point functions
            digest.update(np.ascontiguousarray(lanes[name]).tobytes())
    for name in INPUTS:
        digest.update(np.ascontiguousarray(steps[name]).tobytes())
    assert digest.hexdigest() == INPUT_DIGEST


def test_the_file_holds_all_of_it(made: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    lanes, steps = made
    path = tmp_path / "vectors.bin"
    vectors.write_vectors(lanes, steps, path)
    data = path.read_bytes()
    assert len(data) == 8 + lanes.nbytes + steps.nbytes
    assert np.frombuffer(data, "<i4", 2).tolist() == [vectors.LANES, vectors.STEPS]
    lane_bytes = vectors.LANE.itemsize + vectors.STEPS * vectors.STEP.itemsize
    third = np.frombuffer(data, vectors.STEP, vectors.STEPS,
                          8 + 2 * lane_bytes + vectors.LANE.itemsize)  # fmt: skip
    np.testing.assert_array_equal(third, steps[2])
