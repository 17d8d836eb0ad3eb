"""The planar three-link arm of the experiment: pose, hand Jacobian, manipulability.

m, rad; shoulder at the origin, q1 from +x, q2 and q3 relative, counter-clockwise positive, elbow on
the -y side (q2 > 0). Used for analysis and pictures only; the controller has its own in C++.
"""

from dataclasses import dataclass

import numpy as np

TARGET_COUNT = 8


@dataclass(frozen=True)
class PlanarArm:
    """Lengths of arm, forearm and hand."""

    length_m: tuple[float, float, float] = (0.282, 0.269, 0.044)

    def posture(self, hand_m: np.ndarray, phi_rad: float) -> np.ndarray:
        """Joint angles that put the hand at `hand_m` in direction `phi_rad` (posture `paper`).

        Source: paper, section Dynamic Task, with the errata of docs/. Raises ValueError where the
        wrist cannot reach.
        """
        arm, forearm, hand = self.length_m
        wrist_m = np.asarray(hand_m) - hand * np.array([np.cos(phi_rad), np.sin(phi_rad)])
        distance = float(np.hypot(*wrist_m))
        if not abs(arm - forearm) < distance < arm + forearm:
            raise ValueError(f"hand position {tuple(hand_m)} m is out of reach")
        cos_beta = (arm**2 + distance**2 - forearm**2) / (2 * arm * distance)
        phi_arm = float(np.arctan2(wrist_m[1], wrist_m[0]) - np.arccos(cos_beta))
        elbow_m = arm * np.array([np.cos(phi_arm), np.sin(phi_arm)])
        phi_forearm = float(np.arctan2(wrist_m[1] - elbow_m[1], wrist_m[0] - elbow_m[0]))
        return _wrapped(np.array([phi_arm, phi_forearm - phi_arm, phi_rad - phi_forearm]))

    def joint_positions(self, q_rad: np.ndarray) -> np.ndarray:
        """Shoulder, elbow, wrist and hand, shape (4, 2)."""
        direction = np.cumsum(q_rad)
        links = np.array(self.length_m)[:, None] * np.stack(
            [np.cos(direction), np.sin(direction)], axis=1
        )
        return np.vstack([np.zeros(2), np.cumsum(links, axis=0)])

    def hand_jacobian(self, q_rad: np.ndarray) -> np.ndarray:
        """Hand velocity = J joint rates, shape (2, 3)."""
        joints = self.joint_positions(q_rad)
        lever = joints[3] - joints[:3]
        return np.stack([-lever[:, 1], lever[:, 0]])

    def manipulability(self, q_rad: np.ndarray) -> float:
        """sqrt(det(J J')), m^2: the volume of the velocity ellipse up to pi."""
        jacobian = self.hand_jacobian(q_rad)
        return float(np.sqrt(np.linalg.det(jacobian @ jacobian.T)))


@dataclass(frozen=True)
class ClockGeometry:
    """Where the clock experiment happens: home in the centre, targets counter-clockwise from +x."""

    arm: PlanarArm = PlanarArm()
    centre_m: tuple[float, float] = (0.3, 0.0)
    radius_m: float = 0.1
    phi_deg: float = 155.0

    def position(self, target: int) -> np.ndarray:
        """Target 1..8; 0 is home."""
        centre = np.array(self.centre_m)
        if target == 0:
            return centre
        angle = 2 * np.pi * (target - 1) / TARGET_COUNT
        return centre + self.radius_m * np.array([np.cos(angle), np.sin(angle)])

    def posture(self, target: int) -> np.ndarray:
        """Joint angles at a target (0 = home) in posture `paper`."""
        return self.arm.posture(self.position(target), np.deg2rad(self.phi_deg))

    def manipulability(self, target: int) -> float:
        """At a target (0 = home) in posture `paper`, m^2."""
        return self.arm.manipulability(self.posture(target))


def _wrapped(angle_rad: np.ndarray) -> np.ndarray:
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi
