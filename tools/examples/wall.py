"""The hand pressed against a stiff wall: force, energy, and whether the contact settles.

    ./rig python tools/examples/wall.py [PICTURE]

The target lies 5 mm behind the surface. The hand is held there for a second and comes back.
"""

import sys

import matplotlib.pyplot as plt

from hpmc import Experiment, audit, first_contact, run
from hpmc.layout import RUNS

STIFFNESSES_N_M = {1e3: "tab:green", 1e4: "tab:blue", 1e5: "tab:red"}

figure, (forces, energies) = plt.subplots(
    2, 1, figsize=(8, 7), sharex=True, layout="constrained"
)
for stiffness, color in STIFFNESSES_N_M.items():
    result = run(
        Experiment("wall", mode="sil", overrides={"wall.stiffness_N_m": stiffness}, figures=False)
    )
    contact, energy = first_contact(result), audit(result)
    print(f"{stiffness:.0e} N/m  {contact.in_words()}")
    print(f"           {energy.in_words()}")
    label = f"{stiffness:.0e} N/m".replace("e+0", "e")
    start_s = result.time_s[result.during(reach=0)][0]
    forces.plot(result.time_s - start_s, result.wrench_N[:, 0], color=color, label=label)
    sums = {"-": energy.motor_J, ":": energy.friction_J, "--": energy.environment_J}
    for style, sum_J in sums.items():
        energies.plot(energy.time_s - start_s, 1e3 * sum_J, color=color, linestyle=style)

period_s = result.configuration["experiment"]["period_s"]
for axes in (forces, energies):
    axes.axvline(period_s, color="0.8", zorder=0)
forces.set(title="Pressed against a wall, 5 mm behind its surface", ylabel="force on the wall, N")
forces.annotate(" back home", (period_s, 0.92), xycoords=("data", "axes fraction"), color="0.4")
forces.legend(frameon=False)
for style, label in (("-", "work of the motors"), (":", "lost in the joints' friction"),
                     ("--", "work on the wall")):  # fmt: skip
    energies.plot([], [], color="0.3", linestyle=style, label=label)
energies.legend(frameon=False)
energies.set(xlabel="time since the reach began, s", ylabel="energy, mJ", xlim=(0, 2 * period_s))
picture = sys.argv[1] if len(sys.argv) > 1 else RUNS / "wall.png"
figure.savefig(picture, dpi=120)
print(f"picture: {picture}")
