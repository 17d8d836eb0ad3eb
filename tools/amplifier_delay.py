"""Prints the delay that each joint's torque loop bears: the table of docs/hardware/wiring.md.

omega_c tau < 0.35 with omega_c = sqrt(2 K / M), K = T1 / q_a, and M the inertia that a joint's
torque accelerates while the other joints are free, at the least of all postures.
"""

from __future__ import annotations

import numpy as np

LENGTH_m = np.array([0.282, 0.269, 0.044])
MASS_kg = np.array([4.0, 2.5, 1.0])
Q_A_rad = 7.5e-3
BEARS = 0.35
PLATEAUS_Nm = {"TA": np.array([30.0, 20.0, 5.0]), "2, 2, 0.2 N m": np.array([2.0, 2.0, 0.2])}


def mass_matrix(q2_rad: float, q3_rad: float) -> np.ndarray:
    """Of three slender rods, in relative angles; docs/theory.md, "The simulated arm"."""
    beyond_kg = np.array([MASS_kg[1:].sum(), MASS_kg[2], 0.0])
    angle_rad = np.array([0.0, q2_rad, q2_rad + q3_rad])
    links = np.empty((3, 3))
    for i in range(3):
        links[i, i] = LENGTH_m[i] ** 2 * (MASS_kg[i] / 3 + beyond_kg[i])
        for j in range(i + 1, 3):
            coupling = LENGTH_m[i] * LENGTH_m[j] * (MASS_kg[j] / 2 + beyond_kg[j])
            links[i, j] = links[j, i] = coupling * np.cos(angle_rad[i] - angle_rad[j])
    relative = np.tril(np.ones((3, 3)))
    return relative.T @ links @ relative


def least_inertia_kgm2() -> np.ndarray:
    """Per joint, over elbow and wrist angles on a grid of 0.05 rad."""
    least = np.full(3, np.inf)
    for q2_rad in np.arange(0.05, 3.1, 0.05):
        for q3_rad in np.arange(-3.0, 3.05, 0.05):
            inertia = 1.0 / np.diag(np.linalg.inv(mass_matrix(q2_rad, q3_rad)))
            least = np.minimum(least, inertia)
    return least


def delay_ms(plateau_Nm: np.ndarray, inertia_kgm2: np.ndarray) -> np.ndarray:
    return 1e3 * BEARS / np.sqrt(2 * plateau_Nm / Q_A_rad / inertia_kgm2)


if __name__ == "__main__":
    least = least_inertia_kgm2()
    print("M, least, kg m2:", *(f"{value:.3g}" for value in least))
    for name, plateau in PLATEAUS_Nm.items():
        values = delay_ms(plateau, least)
        print(f"delay allowed, ms, T1 = {name}:", *(f"{value:.2f}" for value in values))
