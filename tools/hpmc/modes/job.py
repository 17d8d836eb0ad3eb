"""What the modes have in common: one module a mode, each with `check` and `run`."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hpmc.configuration import Configuration
from hpmc.experiment import Experiment
from hpmc.run_progress import ProgressBar


@dataclass(frozen=True)
class Job:
    """What a mode needs to know to run an experiment."""

    configuration: Configuration
    config_file: Path  # the whole configuration, for the programs
    log_level: str  # full | states
    folder: Path  # exists; logs go here
    bar: ProgressBar
    jobs: int = 1  # sil
    realtime: bool = False
    uml: bool = False  # vcan
    can: str | None = None  # bench
    lcm_url: str | None = None  # sil, emulated
    targets: Path | None = None  # log of a run whose targets from outside act again

    def targets_option(self) -> list[str]:
        """For sil and hpmc_host."""
        return ["--targets", str(self.targets)] if self.targets else []


@dataclass
class Outcome:
    """What the processes of a run told."""

    wall_s: float = 0.0
    interrupted: bool = False
    reason: str = ""  # why it ended early; empty if it did not
    stats: list[dict[str, Any]] = field(default_factory=list)  # per process
    logs: list[Path] = field(default_factory=list)


@dataclass(frozen=True)
class Mode:
    """A way to run the rig."""

    check: Callable[[Experiment, Configuration], None]  # raises ConfigurationError
    run: Callable[[Job], Outcome]
    overrides: tuple[str, ...] = ()  # section.key=value that the mode brings, under the user's own
