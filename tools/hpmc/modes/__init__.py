"""The modes of the rig by name (docs/architecture.md)."""

from hpmc.modes import bench, emulated, sil, vcan
from hpmc.modes.job import Job, Mode, Outcome

MODES = {
    "emulated": Mode(emulated.check, emulated.run, emulated.OVERRIDES),
    "sil": Mode(sil.check, sil.run),
    "vcan": Mode(vcan.check, vcan.run),
    "bench": Mode(bench.check, bench.run, bench.OVERRIDES),
}

__all__ = ["MODES", "Job", "Mode", "Outcome"]
