"""How stiff must the region of attraction be? The clock with all its stiffnesses scaled.

    ./rig python tools/examples/stiffness_sweep.py [PICTURE]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from hpmc import Experiment, RunError, run
from hpmc.configuration import load_configuration
from hpmc.layout import RUNS

PAPER = load_configuration("clock").values["region_of_attraction"]
FACTORS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)

rows = []
for factor in FACTORS:
    scaled = {
        "region_of_attraction.stiffness_N_m": factor * np.array(PAPER["stiffness_N_m"]),
        "region_of_attraction.force_max_N": factor * np.array(PAPER["force_max_N"]),
    }
    try:
        result = run(
            Experiment("clock", mode="sil", overrides=scaled, log="states", figures=False)
        )
    except RunError as error:  # too soft to reach home, or unstable
        print(f"x {factor:<4}  {error}")
        continue
    metrics = result.reach_metrics
    rows.append((factor, metrics.position_rmse_mm, metrics.executed_r,
                 np.abs(result.tau_Nm).max(axis=0)))  # fmt: skip
    print(f"x {factor:<4}  position RMSE {metrics.position_rmse_mm.mean():.2f} mm, "
          f"r {metrics.executed_r.mean():.2f}, largest torques {rows[-1][3]} N m")  # fmt: skip

factors = [row[0] for row in rows]
figure, (error, smoothness) = plt.subplots(2, 1, figsize=(7, 6), sharex=True, layout="constrained")
for axes, column, label in ((error, 1, "position RMSE, mm"), (smoothness, 2, "r of the hand")):
    means = [row[column].mean() for row in rows]
    spread = [row[column].std() for row in rows]
    axes.errorbar(factors, means, yerr=spread, marker="o", capsize=3, color="tab:blue")
    axes.axvline(1.0, color="0.8", zorder=0)
    axes.set_ylabel(label)
error.set(title="Region of attraction: stiffness, mean ± std of 16 reaches", ylim=(0, None))
smoothness.axhline(1.84, color="tab:orange", linestyle="--", label="paper, 1.84")
smoothness.legend(frameon=False)
smoothness.set(xscale="log", xlabel="stiffness, times the paper's")
smoothness.set_xticks(factors, [f"{factor:g}" for factor in factors], minor=False)
smoothness.minorticks_off()
picture = sys.argv[1] if len(sys.argv) > 1 else RUNS / "stiffness_sweep.png"
figure.savefig(picture, dpi=120)
print(f"picture: {picture}")
