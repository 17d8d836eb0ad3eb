"""The joint torque controller in double precision: the yardstick of firmware/control.

Written from the equations (docs/theory.md), not from the C code, for many joints at once: every
value is an array with one entry per joint. Positions are whole encoder increments and stay exact;
angles are in rad, torques in N m. Times count in whole us.

    joints = JointReference(parameters, position_inc, command)
    joints.command(at, command)                  # a SYNC acts, at the joints where `at` is true
    output = joints.step(position_inc, elapsed_us)
    torque_mNm = guard(output, ...)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

SATURATION_RAD = 0.5
RAMP_FULL_PPM = 1_000_000
TORQUE_MAX_MNM = 32767


@dataclass(frozen=True)
class Parameters:
    """Of the joints: object 2100h, and the encoder."""

    increments_per_revolution: Integers
    ticks_per_sync: Integers  # J, 1..10
    error_growth: Flags  # the phase rule; else body_motion
    q_a_rad: Floats
    q_p_rad: Floats
    q_b_rad: Floats
    torque_limit_Nm: Floats  # TA
    delta_inc256: Integers
    stall_time_us: Integers

    @property
    def step_rad(self) -> Floats:
        """1/J increment."""
        return 2 * np.pi / (self.increments_per_revolution * self.ticks_per_sync)


@dataclass
class Command:
    """Q_d, T_d and T_max as they come over the bus."""

    position_inc: Integers
    torque_mNm: Integers
    torque_max_mNm: Integers


@dataclass
class Fic:
    """State of the fractal impedance controllers."""

    extreme_inc: Integers  # qx
    age_us: Integers
    direction: Integers  # of the body: -1, 0, 1
    sign: Integers  # of the error: -1, 0 before the first step, 1
    converging: Flags
    a_max_rad: Floats
    extreme_rad: Floats  # ext, error_growth only
    f_max_Nm: Floats


@dataclass
class Output:
    torque_Nm: Floats  # within +-TA
    torque_max_Nm: Floats
    f_max_Nm: Floats
    error_rad: Floats
    margin_rad: Floats  # how near a comparison that chose the phase or the latch was to a tie


def profile(a: Floats, q_a: Floats, q_p: Floats, q_b: Floats, t1: Floats, t2: Floats) -> Floats:
    """F(a): slope to T1 at q_a, plateau to q_p, slope to T2 at q_b, plateau."""
    width = q_b - q_p
    rise = np.divide(a - q_p, width, out=np.ones_like(a), where=width > 0)
    return np.select([a <= q_a, a <= q_p, a < q_b], [t1 * a / q_a, t1, t1 + (t2 - t1) * rise], t2)


class JointReference:
    """Joint controllers with their state."""

    def __init__(self, parameters: Parameters, position_inc: Integers, command: Command) -> None:
        self.parameters = parameters
        count = len(position_inc)
        self.before = Command(*(np.zeros(count, np.int64) for _ in range(3)))
        self.now = Command(*(np.zeros(count, np.int64) for _ in range(3)))
        self.tick = np.zeros(count, np.int64)
        self.fic = Fic(
            extreme_inc=np.zeros(count, np.int64), age_us=np.zeros(count, np.int64),
            direction=np.zeros(count, np.int64), sign=np.zeros(count, np.int64),
            converging=np.zeros(count, bool), a_max_rad=np.zeros(count),
            extreme_rad=np.zeros(count), f_max_Nm=np.zeros(count),
        )  # fmt: skip
        self.reset(np.ones(count, bool), position_inc, command)

    def reset_fic(self, at: Flags, position_inc: Integers) -> None:
        for value in vars(self.fic).values():
            value[at] = 0
        self.fic.extreme_inc[at] = position_inc[at]

    def reset(self, at: Flags, position_inc: Integers, command: Command) -> None:
        """As at enabling; the command acts at once."""
        for command_held in (self.before, self.now):
            copy_command(at, command, command_held)
        self.tick[at] = 0
        self.reset_fic(at, position_inc)

    def command(self, at: Flags, command: Command) -> None:
        """The command that begins to act at this SYNC."""
        copy_command(at, self.now, self.before)
        copy_command(at, command, self.now)
        self.tick[at] = 0

    def hold(self, at: Flags, position_inc: Integers) -> None:
        """From now on Q_d is this position."""
        self.now.position_inc[at] = position_inc[at]
        copy_command(at, self.now, self.before)
        self.reset_fic(at, position_inc)

    def step(self, position_inc: Integers, elapsed_us: Integers) -> Output:
        """One joint tick."""
        p, fic = self.parameters, self.fic
        parts = p.ticks_per_sync
        part = np.where(parts == 1, 1, self.tick)
        self.tick = np.minimum(self.tick + 1, parts)

        def between(before: Integers, now: Integers) -> Integers:  # in 1/J
            return before * (parts - part) + now * part

        limit = np.floor(SATURATION_RAD / p.step_rad).astype(np.int64)
        steps = between(self.before.position_inc, self.now.position_inc) - position_inc * parts
        error = np.clip(steps, -limit, limit) * p.step_rad
        t_d = between(self.before.torque_mNm, self.now.torque_mNm) / (1000 * parts)
        t_max = between(self.before.torque_max_mNm, self.now.torque_max_mNm) / (1000 * parts)

        a = np.abs(error)
        f = profile(a, p.q_a_rad, p.q_p_rad, p.q_b_rad, np.minimum(np.abs(t_d), t_max), t_max)
        sign = np.where(error < 0, -1, 1)
        crossed = sign != fic.sign
        fic.sign[:] = sign
        margin = np.where(p.error_growth,
                          self.phase_by_error_growth(a, f, crossed, p.error_growth),
                          self.phase_by_body_motion(error, a, f, crossed, position_inc, elapsed_us,
                                                    ~p.error_growth))  # fmt: skip
        # A profile without second slope jumps at q_b.
        margin = np.where(p.q_p_rad == p.q_b_rad, np.minimum(margin, abs(a - p.q_b_rad)), margin)

        excursion = np.where(fic.a_max_rad > 0, fic.a_max_rad, 1.0)
        spring = np.where(fic.a_max_rad > 0, 2 * fic.f_max_Nm / excursion * (a - excursion / 2), 0)
        torque = sign * np.where(fic.converging, np.minimum(spring, f), f)
        return Output(
            torque_Nm=np.clip(torque, -p.torque_limit_Nm, p.torque_limit_Nm), torque_max_Nm=t_max,
            f_max_Nm=fic.f_max_Nm.copy(), error_rad=error, margin_rad=margin,
        )  # fmt: skip

    def latch(self, at: Flags, a: Floats, f: Floats) -> None:
        self.fic.a_max_rad[at] = a[at]
        self.fic.f_max_Nm[at] = f[at]

    def move(self, at: Flags, q: Integers, elapsed_us: Integers) -> Integers:
        """Direction of the body's motion, 0 when it stalls."""
        p, fic = self.parameters, self.fic
        heading = np.where(fic.direction >= 0, 1, -1)  # one of the two branches runs in a tick
        onward = heading * (q - fic.extreme_inc)
        moved_on = at & (onward > 0)
        turned = at & (-onward * 256 > p.delta_inc256)
        fic.direction[turned] = -heading[turned]
        fic.extreme_inc[moved_on | turned] = q[moved_on | turned]
        fic.age_us[moved_on | turned] = 0
        fic.age_us[at] += elapsed_us[at]
        return np.where(fic.age_us > p.stall_time_us, 0, fic.direction)

    def phase_by_body_motion(
        self, error: Floats, a: Floats, f: Floats, crossed: Flags, position_inc: Integers,
        elapsed_us: Integers, at: Flags,
    ) -> Floats:  # fmt: skip
        fic = self.fic
        toward = error * self.move(at, position_inc, elapsed_us) > 0
        fic.converging[at] = toward[at]
        kept = toward & ~crossed
        margin = np.where(kept, abs(a - fic.a_max_rad), np.inf)
        self.latch(at & (~kept | (a > fic.a_max_rad)), a, f)
        return margin

    def phase_by_error_growth(self, a: Floats, f: Floats, crossed: Flags, at: Flags) -> Floats:
        p, fic = self.parameters, self.fic
        delta = p.delta_inc256 / 256 * 2 * np.pi / p.increments_per_revolution
        diverging = ~crossed & ~fic.converging
        converging = ~crossed & fic.converging
        growing = diverging & (a >= fic.a_max_rad)
        turned_in = diverging & ~growing & (a < fic.a_max_rad - delta)
        shrinking = converging & (a <= fic.extreme_rad)
        turned_out = converging & ~shrinking & (a > fic.extreme_rad + delta)
        # Nearest tie: of a with its extreme, and of a with the turn at delta from it.
        extreme = np.where(fic.converging, fic.extreme_rad, fic.a_max_rad)
        distance = abs(a - extreme)
        margin = np.where(crossed, np.inf, np.minimum(distance, abs(distance - delta)))

        self.latch(at & (crossed | growing | turned_out), a, f)
        extreme_moves = at & (crossed | turned_in | shrinking)
        fic.extreme_rad[extreme_moves] = a[extreme_moves]
        fic.converging[at & turned_in] = True
        fic.converging[at & (crossed | turned_out)] = False
        return margin


def copy_command(at: Flags, source: Command, target: Command) -> None:
    for name, value in vars(target).items():
        value[at] = getattr(source, name)[at]


def guard(
    output: Output, torque_limit_Nm: Floats, ramp_ppm: Integers, position_inc: Integers,
    position_min_inc: Integers, position_max_inc: Integers,
) -> Integers:  # fmt: skip
    """Torque to the motor in whole mN m: |tau| <= ramp x TA, |tau| <= max(T_max, latched f_max)."""
    bound = np.minimum(torque_limit_Nm * ramp_ppm / RAMP_FULL_PPM,
                       np.maximum(output.torque_max_Nm, output.f_max_Nm))  # fmt: skip
    torque = np.clip(output.torque_Nm, -bound, bound)
    outward = ((torque > 0) & (position_inc >= position_max_inc)) | (
        (torque < 0) & (position_inc <= position_min_inc)
    )
    size = np.minimum(np.floor(np.abs(torque) * 1000 + 0.5), TORQUE_MAX_MNM).astype(np.int64)
    return np.where(outward, 0, np.where(torque < 0, -size, size))
