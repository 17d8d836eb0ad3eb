"""The hand against the wall: when, how hard, and whether it settles.

A contact chatters when the hand leaves the surface again and again, or the force keeps swinging.
What counts as settled: no break of contact later than SETTLING_S after the first touch, and a
standard deviation of the force over the last HOLD_S of the reach that is small beside its mean.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hpmc.api import Result

SETTLING_S = 0.3
HOLD_S = 0.5


@dataclass(frozen=True)
class Contact:
    """A reach that ends against the wall. Forces along the wall's normal, into the wall, N."""

    touched_s: float  # from the begin of the reach
    peak_N: float
    rest_N: float  # mean over the last HOLD_S of the reach
    rest_std_N: float  # standard deviation there
    breaks: int  # the hand left the surface, all in all
    late_breaks: int  # later than SETTLING_S after the first touch
    torque_reversals: int  # changes of sign of the joint torques, all joints, after SETTLING_S
    depth_mm: float  # of the hand in the surface, mean over the last HOLD_S

    def in_words(self) -> str:
        """One line."""
        return (
            f"contact: touched at {self.touched_s:.3f} s, peak {self.peak_N:.1f} N, at rest "
            f"{self.rest_N:.2f} N ± {self.rest_std_N:.2f} N, {self.depth_mm:.2f} mm deep; contact "
            f"broken {self.breaks} times, {self.late_breaks} later than {SETTLING_S} s"
        )


def first_contact(result: "Result", reach: int = 0, repetition: int = 0) -> Contact:
    """Of one reach. Raises ValueError when the hand does not touch the wall in it."""
    wall = result.configuration["wall"]
    rows = result.during(reach, repetition)
    into_wall = -np.array([np.cos(wall["normal_rad"]), np.sin(wall["normal_rad"])])
    force = result.wrench_N[rows] @ into_wall
    depth = (result.hand_m[rows] - np.array(wall["point_m"])) @ into_wall
    time_s = result.time_s[rows]
    touching = force > 0
    if not touching.any():
        raise ValueError(f"the hand does not touch the wall in reach {reach}")
    touched_s = time_s[touching.argmax()]
    left = np.flatnonzero(touching[:-1] & ~touching[1:]) + 1
    settled = time_s >= touched_s + SETTLING_S
    holding = time_s > time_s[-1] - HOLD_S
    signs = np.sign(result.tau_Nm[rows][settled])
    return Contact(
        touched_s=float(touched_s - time_s[0]),
        peak_N=float(force.max()),
        rest_N=float(force[holding].mean()),
        rest_std_N=float(force[holding].std()),
        breaks=left.size,
        late_breaks=int(settled[left].sum()),
        torque_reversals=int((signs[1:] * signs[:-1] < 0).sum()),
        depth_mm=float(1e3 * depth[holding].mean()),
    )
