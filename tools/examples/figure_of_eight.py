"""The hand follows a target that runs along a figure of eight.

    ./rig python tools/examples/figure_of_eight.py [PICTURE]

The elastic band makes a movement toward each target that it is given, with a frame and a phase of
its own. A target that moves on every millisecond therefore never lets it converge; one that moves
on every 20 ms is followed. The script shows both.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from hpmc import Experiment, Result, run
from hpmc.layout import RUNS


def path_m(result: Result, rows: np.ndarray) -> np.ndarray:
    """Where an ideal target is, (n, 2); the run's own target moves on in steps."""
    experiment = result.configuration["experiment"]
    s = 2 * np.pi * np.arange(rows.sum()) / rows.sum()
    return experiment["centre_m"] + experiment["radius_m"] * np.stack(
        [np.sin(2 * s) / 2, np.sin(s)], axis=1
    )


def rms_mm(error_m: np.ndarray) -> float:
    return float(1e3 * np.sqrt((error_m**2).sum(axis=1).mean()))


figure, panels = plt.subplots(1, 2, figsize=(7, 6), sharey=True, layout="constrained")
for axes, waypoint_s in zip(panels, (0.02, 0.001), strict=True):
    result = run(
        Experiment("figure_of_eight", mode="sil", figures=False, log="states",
                   overrides={"experiment.waypoint_s": waypoint_s})
    )  # fmt: skip
    rows = result.during(reach=1)  # the second time around: the start from rest is over
    path, hand, planned = path_m(result, rows), result.hand_m[rows], result.x_d_m[rows]
    late_ms = min(range(100), key=lambda ms: rms_mm(hand - np.roll(path, ms, axis=0)))
    off_mm = rms_mm(hand - np.roll(path, late_ms, axis=0))
    print(f"target every {1e3 * waypoint_s:.0f} ms: hand {rms_mm(hand - path):.2f} mm from the "
          f"target, {off_mm:.2f} mm when it may be {late_ms} ms late; "
          f"{rms_mm(hand - planned):.2f} mm from X_d")  # fmt: skip
    axes.plot(*(1e3 * path.T), color="0.75", linewidth=5, label="path of the target")
    axes.plot(*(1e3 * hand.T), color="tab:blue", linewidth=1.2, label="hand X")
    axes.set(title=f"a waypoint every {1e3 * waypoint_s:.0f} ms", xlabel="x, mm", aspect="equal")
panels[0].set_ylabel("y, mm")
panels[0].legend(loc="upper center", frameon=False)
panels[0].set_ylim(-115, 150)
picture = sys.argv[1] if len(sys.argv) > 1 else RUNS / "figure_of_eight.png"
figure.savefig(picture, dpi=120)
print(f"picture: {picture}")
