"""How large the logs of a run will be, and whether they fit on the disk."""

import shutil
from pathlib import Path

from hpmc.configuration import Configuration, ConfigurationError

# Bytes of log per SYNC period, headers included: with `--log full`, and more per further joint
# tick; with `--log states`; of candump.log. Measured; a test holds them to 10 % of the real files.
FULL_BYTES = 1190
FULL_BYTES_JOINT_TICK = 415
STATES_BYTES = 605
STATES_BYTES_JOINT_TICK = 181
CANDUMP_BYTES = 315
CANDUMP_BYTES_INJECTED = 455
DISK_RESERVE_BYTES = 200 << 20


def log_bytes(configuration: Configuration, level: str) -> int:
    """Expected size of the logs."""
    further = configuration.joint_ticks - 1
    full = FULL_BYTES + further * FULL_BYTES_JOINT_TICK
    states = STATES_BYTES + further * STATES_BYTES_JOINT_TICK
    periods = configuration.repetitions * configuration.periods_per_repetition
    return periods * (full if level == "full" else states)


def candump_bytes(configuration: Configuration, level: str) -> int:
    """Expected size of candump.log."""
    injected = configuration.values["rig"]["sensors"] == "injected"
    periods = configuration.repetitions * configuration.periods_per_repetition
    each = CANDUMP_BYTES_INJECTED if injected else CANDUMP_BYTES
    return periods * each if level == "full" else 0


def check_space(folder: Path, wanted_bytes: int) -> None:
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if free < wanted_bytes + DISK_RESERVE_BYTES:
        raise ConfigurationError(
            f"--out {folder}: the log will take {wanted_bytes / 1e6:.0f} MB, "
            f"{free / 1e6:.0f} MB are free; take fewer --repetitions, --log states or another --out"
        )
