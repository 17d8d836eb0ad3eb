"""Both phase rules of the joints' FIC on the same reach.

    ./rig python tools/examples/phase_rules.py [PICTURE]

body_motion, the paper's, gives the velocity its ripple and the peak that looks like human reaching;
error_growth follows the plan more smoothly.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from hpmc import Experiment, run
from hpmc.layout import RUNS

RULES = {"body_motion": "tab:blue", "error_growth": "tab:orange"}
REACH = 2  # from home to target 2

figure, (speeds, torques, phases) = plt.subplots(
    3, 1, figsize=(8, 8), sharex=True, layout="constrained", height_ratios=(2, 2, 1)
)
for row, (rule, color) in enumerate(RULES.items()):
    result = run(
        Experiment("clock", mode="sil", overrides={"joint.phase_rule": rule}, figures=False)
    )
    m = result.metrics
    print(f"{rule:12}  r {m['executed']['r_mean']:.2f} ± {m['executed']['r_std']:.2f}, "
          f"position RMSE {m['position_rmse_mm']['mean']:.2f} mm, "
          f"velocity RMSE {m['velocity_rmse_mm_s']['mean']:.1f} mm/s")  # fmt: skip
    rows = result.during(REACH)
    time_s = result.time_s[rows] - result.time_s[rows][0]
    speed = 1e3 * np.linalg.norm(result.hand_m_s[rows], axis=1)
    if row == 0:
        planned = 1e3 * np.linalg.norm(result.v_d_m_s[rows], axis=1)
        speeds.plot(time_s, planned, color="0.6", linestyle="--", label="planned, X_d")
    speeds.plot(time_s, speed, color=color, linewidth=1.2, label=f"hand, {rule}")
    torques.plot(time_s, result.tau_Nm[rows][:, 1], color=color, linewidth=1.2, label=rule)
    converging = result.converging[rows][:, 1]
    phases.fill_between(time_s, row + 0.1, row + 0.9, where=converging, color=color, linewidth=0)

speeds.set(title=f"Reach {REACH}: home to target 2", ylabel="speed, mm/s")
speeds.legend(frameon=False, fontsize=9)
torques.set_ylabel("torque of the elbow, N m")
phases.set(ylabel="elbow in\nconvergence", xlabel="time, s", ylim=(0, 2), xlim=(0, 1))
phases.set_yticks([0.5, 1.5], RULES)
picture = sys.argv[1] if len(sys.argv) > 1 else RUNS / "phase_rules.png"
figure.savefig(picture, dpi=120)
print(f"picture: {picture}")
