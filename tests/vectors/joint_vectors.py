"""Makes the vectors shared by the float build, the fixed build and the numpy reference.

    python tests/vectors/joint_vectors.py FILE

Only the seed is kept in the repository; the build makes the file (see README.md beside this one).
A lane is one joint with one set of parameters over STEPS ticks; what it is told and where it stands
are whole numbers, drawn by numpy's PCG64 from SEED. Half of the lanes have parameters at the edges
of their ranges, the others random ones.

The file, little-endian: one int32 with the number of lanes and one with STEPS, then for each lane
LANE and STEPS times STEP, the layouts that tests/unit/test_vectors.c reads.
"""

import sys
from pathlib import Path

import numpy as np

from hpmc.reference import Command, Floats, Integers, JointReference, Parameters, guard

SEED = 20210501
LANES = 416
STEPS = 256

# Profiles so steep that one step of an angle is worth about 1 mN m or more: no 32-bit number can
# follow the reference within 1 mN m there. Such lanes have a tolerance of their own.
ORDINARY_Q_A_URAD = 250
ORDINARY_WIDTH_URAD = 250  # q_b - q_p, and at least q_p / 40
TOLERANCE_NM = 0.001

# With error_growth, an even J, and delta = half an increment as in the experiment, a turn by just
# delta is a tie, which the rounding of each build decides.
TIE_LANES = 4

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1
COMMAND, RESET, HOLD = 1, 2, 4  # events of a step

LANE = np.dtype([
    ("increments_per_revolution", "<u4"), ("ticks_per_sync", "<u4"), ("error_growth", "<u4"),
    ("q_a_urad", "<u4"), ("q_p_urad", "<u4"), ("q_b_urad", "<u4"), ("torque_limit_mNm", "<u4"),
    ("delta_inc256", "<u4"), ("stall_time_us", "<u4"), ("steep", "<u4"),
    ("position_min_inc", "<i4"), ("position_max_inc", "<i4"), ("tolerance_Nm", "<f8"),
])  # fmt: skip
STEP = np.dtype([
    # in
    ("events", "<u4"), ("elapsed_us", "<u4"), ("position_inc", "<i4"), ("ramp_ppm", "<u4"),
    ("target_inc", "<i4"), ("torque_mNm", "<i4"), ("torque_max_mNm", "<i4"),
    # out, after the step
    ("converging", "<i4"), ("direction", "<i4"), ("sign", "<i4"), ("extreme_inc", "<i4"),
    ("age_us", "<u4"), ("guarded_mNm", "<i4"), ("unused", "<i4"),
    ("error_rad", "<f8"), ("torque_Nm", "<f8"), ("f_max_Nm", "<f8"), ("a_max_rad", "<f8"),
    ("extreme_rad", "<f8"), ("margin_rad", "<f8"),
])  # fmt: skip

INCREMENTS = (65536, 1 << 10, 1 << 24, 4096, 1_000_003, 1 << 20)
PROFILES_URAD = (
    (7500, 9000, 16000),  # of the paper
    (250, 250, 500),
    (500_000, 500_000, 500_000),
    (490_000, 490_000, 500_000),
    (20_000, 20_000, 20_000),  # one slope, then a jump
    (7500, 16000, 16000),
    (250, 490_000, 500_000),
)
STEEP_URAD = ((1, 1, 1), (1, 2, 3), (1, 499_999, 500_000), (100, 100, 150), (7500, 9000, 9001))
TORQUE_LIMITS_MNM = (30000, 20000, 5000, 32767, 0, 1)
DELTAS_INC256 = (128, 128, 0, 1, 300, 65535)
STALL_TIMES_US = (20000, 20000, 0, 1_000_000, 3000)
MOTIONS = ("swing", "creep", "jump", "rest")
TORQUES = ("smooth", "full", "zero", "random")


def deal(choices: tuple[object, ...], random: np.random.Generator) -> np.ndarray:
    """Each choice for equally many lanes, in an order of its own."""
    return np.array(choices)[random.permutation(LANES) % len(choices)]


def make_lanes(random: np.random.Generator) -> np.ndarray:
    """Parameters: the edges for one half of the lanes, random values for the other."""
    lanes = np.zeros(LANES, LANE)
    lanes["ticks_per_sync"] = deal(tuple(range(1, 11)), random)
    lanes["error_growth"] = deal((0, 1), random)
    drawn = deal((0, 1), random) == 1
    lanes["increments_per_revolution"] = np.where(
        drawn, np.exp2(random.uniform(10, 24, LANES)).astype(int), deal(INCREMENTS, random)
    )
    lanes["torque_limit_mNm"] = np.where(
        drawn, random.integers(0, 32768, LANES), deal(TORQUE_LIMITS_MNM, random)
    )
    lanes["stall_time_us"] = deal(STALL_TIMES_US, random)

    steep = deal((1, *[0] * 19), random) == 1
    q_a = np.exp(random.uniform(np.log(ORDINARY_Q_A_URAD), np.log(200_000), LANES)).astype(int)
    q_p = q_a + random.integers(0, 100_000, LANES)
    q_b = q_p + np.maximum(ORDINARY_WIDTH_URAD, q_p // 40) + random.integers(0, 100_000, LANES)
    drawn_urad = np.minimum(np.stack([q_a, q_p, q_b], axis=1), 500_000)
    edges_urad = np.where(steep[:, None], deal(STEEP_URAD, random), deal(PROFILES_URAD, random))
    urad = np.where((drawn & ~steep)[:, None], drawn_urad, edges_urad)
    lanes["q_a_urad"], lanes["q_p_urad"], lanes["q_b_urad"] = urad.T
    lanes["steep"] = steep
    lanes["tolerance_Nm"] = TOLERANCE_NM + np.where(steep, steep_tolerance_Nm(urad * 1e-6), 0)

    lanes["delta_inc256"] = deal(DELTAS_INC256, random)
    # A tie is left to few lanes, those with slow targets: see make_motion.
    even = np.flatnonzero((lanes["error_growth"] == 1) & (lanes["ticks_per_sync"] % 2 == 0))
    lanes["delta_inc256"][even] = np.where(
        lanes["delta_inc256"][even] == 128, 127, lanes["delta_inc256"][even]
    )
    lanes["delta_inc256"][even[:TIE_LANES]] = 128
    lanes["position_min_inc"], lanes["position_max_inc"] = INT32_MIN, INT32_MAX
    return lanes


def steep_tolerance_Nm(profile_rad: Floats) -> Floats:
    """Slope times what an angle may be off by: a step of 2^-29 rad, or the rounding of a float."""
    q_a, q_p, q_b = profile_rad.T
    width = np.where(q_b > q_p, q_b - q_p, np.inf)
    return 3 * 32.767 / np.minimum(q_a, width) * np.maximum(2.0**-22 * q_b, 2.0**-29)


def has_ties(lanes: np.ndarray) -> np.ndarray:
    return (
        (lanes["error_growth"] == 1)
        & (lanes["ticks_per_sync"] % 2 == 0)
        & (lanes["delta_inc256"] == 128)
    )


def make_motion(lanes: np.ndarray, random: np.random.Generator) -> tuple[Integers, Integers]:
    """Targets and positions, (lanes, STEPS), in increments."""
    time = np.arange(STEPS)[None, :]
    motion = deal(MOTIONS, random)[:, None]
    increments_per_urad = lanes["increments_per_revolution"] / (2e6 * np.pi)
    reach = np.maximum(
        3.0,
        lanes["q_b_urad"]
        * increments_per_urad
        * np.exp(random.uniform(np.log(0.3), np.log(3), LANES)),
    )[:, None]

    def waves(size: float) -> Floats:
        total = np.zeros((LANES, STEPS))
        for _ in range(3):
            phase, periods = random.uniform(0, 1, (LANES, 1)), random.uniform(0.5, 12, (LANES, 1))
            total += size / 3 * np.sin(2 * np.pi * (phase + periods * time / STEPS))
        return total

    error = waves(1.0) * reach
    walk = np.cumsum(random.integers(-1, 2, (LANES, STEPS)), axis=1)
    rest = np.cumsum(random.random((LANES, STEPS)) < 0.03, axis=1)
    creep = walk * np.maximum(1, np.rint(reach / 30))
    error = np.select(
        [motion == "swing", motion == "creep", motion == "rest"], [error, creep, rest % 3], error
    )
    target = np.where(motion == "swing", waves(3.0) * reach, np.rint(waves(0.3) * reach / 8) * 8)
    target += np.rint(random.uniform(-1e5, 1e5, (LANES, 1)))
    position = target - error

    held = np.cumsum(random.random((LANES, STEPS)) < 0.2, axis=1)  # index of the present jump
    for places in (target, position):
        ends = random.choice([INT32_MIN, INT32_MAX, 0], (LANES, STEPS))
        jumps = np.where(
            random.random((LANES, STEPS)) < 0.3, ends, random.uniform(-2, 2, (LANES, STEPS)) * reach
        )
        places[:] = np.where(motion == "jump", np.take_along_axis(jumps, held, axis=1), places)
    for row in np.flatnonzero(has_ties(lanes)):
        period = time[0] // lanes["ticks_per_sync"][row]
        target[row] = 40 + abs(period % 10 - 5)  # one increment a SYNC, to and fro
        position[row] = 0
    target, position = (
        np.clip(np.rint(places), INT32_MIN, INT32_MAX).astype(np.int64)
        for places in (target, position)
    )
    return target, position


def make_steps(lanes: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The columns of STEP that go in."""
    steps = np.zeros((LANES, STEPS), STEP)
    time = np.arange(STEPS)[None, :]
    steps["target_inc"], steps["position_inc"] = make_motion(lanes, random)
    # A period has J ticks, now and then up to three more, when a SYNC is late.
    for row, ticks in zip(steps, lanes["ticks_per_sync"], strict=True):
        at = np.cumsum(ticks + random.integers(0, 4, STEPS) * (random.random(STEPS) < 0.1)) - ticks
        row["events"][at[at < STEPS]] |= COMMAND
    steps["events"] |= np.where(random.random((LANES, STEPS)) < 0.006, RESET, 0).astype(np.uint32)
    steps["events"] |= np.where(random.random((LANES, STEPS)) < 0.004, HOLD, 0).astype(np.uint32)
    steps["elapsed_us"] = 1000 // lanes["ticks_per_sync"][:, None]

    kind = deal(TORQUES, random)[:, None]
    swell = 0.5 + 0.5 * np.sin(2 * np.pi * (random.random((LANES, 1)) + 3 * time / STEPS))
    size = random.uniform(0.05, 1.0, (LANES, 1)) * 32767
    for name, low in (("torque_mNm", -32767), ("torque_max_mNm", 0)):
        values = np.select(
            [kind == "smooth", kind == "full", kind == "zero"],
            [size * swell * random.uniform(0.6, 1.4, (LANES, 1)), 32767, 0],
            random.integers(low, 32768, (LANES, STEPS)),
        )
        steps[name] = np.clip(np.rint(values), low, 32767)
    steps["torque_mNm"] *= np.where(random.random((LANES, 1)) < 0.5, -1, 1)
    steps["ramp_ppm"] = deal((0, 1, 1), random)[:, None] * np.where(
        deal((0, 1), random)[:, None], 1_000_000, random.integers(0, 1_000_001, (LANES, STEPS))
    )
    # A joint that swings into its position limits.
    inside = deal((1, 0, 0, 0, 0, 0, 0, 0), random) == 1
    position = steps["position_inc"][inside]
    lanes["position_min_inc"][inside] = np.quantile(position, 0.2, axis=1)
    lanes["position_max_inc"][inside] = np.quantile(position, 0.8, axis=1)
    return steps


def run_reference(lanes: np.ndarray, steps: np.ndarray) -> None:
    """Fills the columns of STEP that come out."""
    whole = {name: lanes[name].astype(np.int64) for name in LANE.names if name != "tolerance_Nm"}
    parameters = Parameters(
        increments_per_revolution=whole["increments_per_revolution"],
        ticks_per_sync=whole["ticks_per_sync"], error_growth=lanes["error_growth"] == 1,
        q_a_rad=whole["q_a_urad"] * 1e-6, q_p_rad=whole["q_p_urad"] * 1e-6,
        q_b_rad=whole["q_b_urad"] * 1e-6, torque_limit_Nm=whole["torque_limit_mNm"] / 1000,
        delta_inc256=whole["delta_inc256"], stall_time_us=whole["stall_time_us"],
    )  # fmt: skip
    joints: JointReference | None = None
    for time in range(steps.shape[1]):
        now = steps[:, time]
        position = now["position_inc"].astype(np.int64)
        command = Command(
            *(now[name].astype(np.int64) for name in ("target_inc", "torque_mNm", "torque_max_mNm"))
        )
        joints = joints or JointReference(parameters, position, command)
        joints.command(now["events"] & COMMAND != 0, command)
        joints.reset(now["events"] & RESET != 0, position, command)
        joints.hold(now["events"] & HOLD != 0, position)
        output = joints.step(position, now["elapsed_us"].astype(np.int64))
        for name, value in vars(joints.fic).items():
            now[name] = value
        now["torque_Nm"], now["error_rad"] = output.torque_Nm, output.error_rad
        now["margin_rad"] = output.margin_rad
        now["guarded_mNm"] = guard(
            output,
            parameters.torque_limit_Nm,
            now["ramp_ppm"],
            position,
            whole["position_min_inc"],
            whole["position_max_inc"],
        )


def make_vectors() -> tuple[np.ndarray, np.ndarray]:
    """Lanes (LANES,) and steps (LANES, STEPS)."""
    random = np.random.Generator(np.random.PCG64(SEED))
    lanes = make_lanes(random)
    steps = make_steps(lanes, random)
    run_reference(lanes, steps)
    return lanes, steps


def write_vectors(lanes: np.ndarray, steps: np.ndarray, path: Path) -> None:
    with path.open("wb") as file:
        file.write(np.array([len(lanes), steps.shape[1]], "<i4").tobytes())
        for lane, row in zip(lanes, steps, strict=True):
            file.write(lane.tobytes() + row.tobytes())


if __name__ == "__main__":
    write_vectors(*make_vectors(), Path(sys.argv[1]))
