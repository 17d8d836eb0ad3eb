"""The modes of the rig by name (docs/architecture.md)."""

from hpmc.modes import bench, emulated, sil, vcan
from hpmc.modes.job import Job, Mode, Outcome

MODES = {
    "sil": Mode(sil.check, sil.run),
    "vcan": Mode(vcan.check, vcan.run),
    "emulated": Mode(emulated.check, emulated.run, emulated.OVERRIDES),
    "bench": Mode(bench.check, bench.run, bench.OVERRIDES),
}

__all__ = ["MODES", "Job", "Mode", "Outcome"]
