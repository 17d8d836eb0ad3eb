"""Energy audit of a run: what the motors put in must be found again.

    work of the motors = kinetic energy + loss in the joints' friction + work on the environment

Everything comes from ARM_STATE: the work of the motors from the torques that were held from tick to
tick and the angles moved meanwhile, friction and environment by the trapezoidal rule. What is left
over is the residual: it is not zero, since the log has a sample per joint tick and the plant works
in steps of 0.2 ms, but it is bounded by RESIDUAL_BOUND of the energy that was turned over; a plant
that makes energy out of nothing leaves a larger one.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hpmc.api import Result

RESIDUAL_BOUND = 0.01  # of the energy turned over; tests/tools/test_wall.py holds runs to it


@dataclass(frozen=True)
class EnergyAudit:
    """Sums from the begin of the repetition to each joint tick; J, all of shape (n)."""

    time_s: np.ndarray
    motor_J: np.ndarray  # work of the motors on the arm
    friction_J: np.ndarray  # lost in the joints, never falls
    environment_J: np.ndarray  # work of the hand on its environment: stored and lost there
    kinetic_J: np.ndarray  # of the arm
    turned_over_J: np.ndarray  # work of the motors, each tick counted positive

    @property
    def residual_J(self) -> np.ndarray:
        """What the books do not explain."""
        return self.motor_J - self.friction_J - self.environment_J - self.kinetic_J

    @property
    def worst_residual(self) -> float:
        """Largest residual as a fraction of the energy turned over in the repetition."""
        return float(np.abs(self.residual_J).max() / self.turned_over_J[-1])

    def in_words(self) -> str:
        """One line."""
        return (
            f"energy: motors {1e3 * self.motor_J[-1]:.1f} mJ = friction "
            f"{1e3 * self.friction_J[-1]:.1f} + environment {1e3 * self.environment_J[-1]:.1f} + "
            f"kinetic {1e3 * self.kinetic_J[-1]:.1f} mJ; residual at worst "
            f"{100 * self.worst_residual:.2f} % of {1e3 * self.turned_over_J[-1]:.0f} mJ "
            "turned over"
        )


def audit(result: "Result", repetition: int = 0) -> EnergyAudit:
    """The books of one repetition (each begins at rest, with the arm put back to its start)."""
    arm = result.configuration["arm"]
    states = result.opened
    utime = states.column("ARM_STATE", "utime")
    rows = _of_repetition(result, utime, repetition)
    time_s = utime[rows] * 1e-6
    q_rad, rate, tau, velocity, wrench = (
        states.column("ARM_STATE", field)[rows]
        for field in ("q_rad", "qd_rad_s", "tau_Nm", "hand_m_s", "wrench_N")
    )
    dt = np.diff(time_s)
    # tau of row k was held from row k - 1 to row k.
    motor = (tau[1:] * np.diff(q_rad, axis=0)).sum(axis=1)
    friction_power = arm["joint_friction_Nm_s_rad"] * (rate**2).sum(axis=1)
    environment_power = (wrench * velocity).sum(axis=1)
    return EnergyAudit(
        time_s=time_s,
        motor_J=_running(motor),
        friction_J=_running(_mean(friction_power) * dt),
        environment_J=_running(_mean(environment_power) * dt),
        kinetic_J=kinetic_energy_J(q_rad, rate, arm["length_m"], arm["mass_kg"]),
        turned_over_J=_running(np.abs(motor)),
    )


def kinetic_energy_J(
    q_rad: np.ndarray, rate_rad_s: np.ndarray, length_m: np.ndarray, mass_kg: np.ndarray
) -> np.ndarray:
    """Of three slender rods in a plane, (n), from relative angles and rates, (n, 3)."""
    length, mass = np.asarray(length_m), np.asarray(mass_kg)
    angle, omega = np.cumsum(q_rad, axis=-1), np.cumsum(rate_rad_s, axis=-1)
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    along = (length * omega)[..., None] * normal  # velocity of each link's end against its start
    centre = np.cumsum(along, axis=-2) - along / 2
    turning = (mass * length**2 / 12 * omega**2).sum(axis=-1)
    return 0.5 * ((mass * (centre**2).sum(axis=-1)).sum(axis=-1) + turning)


def _of_repetition(result: "Result", utime: np.ndarray, repetition: int) -> np.ndarray:
    inside = result.time_s[result.repetition == repetition]
    if inside.size == 0:
        raise ValueError(f"the run has no repetition {repetition}")
    return (utime >= round(inside[0] * 1e6)) & (utime <= round(inside[-1] * 1e6))


def _mean(samples: np.ndarray) -> np.ndarray:
    return (samples[1:] + samples[:-1]) / 2


def _running(parts: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(parts)])
