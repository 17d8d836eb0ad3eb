"""What is to be run: a name of sim_host/config, the mode, and what is changed."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hpmc.configuration import Configuration, ConfigurationError, load_configuration
from hpmc.layout import NUMBERS

FULL_LOG_REACHES = 160


@dataclass(frozen=True)
class Experiment:
    """An experiment and how to run it; the fields are the options of `./rig run`."""

    name: str = "clock"
    mode: str = "vcan"  # a name of hpmc.modes.MODES
    config: Path | None = None  # TOML over the experiment's own
    overrides: Sequence[str] = ()  # section.key=value, over `config`
    fixed: bool = False
    pace: str = "lockstep"  # or realtime
    jobs: int = 1  # processes that the repetitions are spread over
    log: str | None = None  # full | states | none; by the number of reaches when left out
    out: Path | None = None  # folder to make; runs/TIME-NAME-MODE when left out
    uml: bool = False
    figures: bool = True
    lcm_url: str | None = None  # sil: where to publish what happens while it happens
    targets: Path | None = None  # a run whose targets from outside act again

    def load(self) -> Configuration:
        """The whole configuration. Raises ConfigurationError."""
        files = [self.config] if self.config else []
        configuration = load_configuration(self.name, files, self.overrides)
        if self.fixed and NUMBERS != "fixed":
            raise ConfigurationError(
                "--fixed: these programs are made and chosen by ./rig run --fixed"
            )
        return configuration

    def targets_log(self) -> Path | None:
        """The log that `targets` names. Raises ConfigurationError."""
        if self.targets is None:
            return None
        log = self.targets / "run.lcmlog" if self.targets.is_dir() else self.targets
        if not log.is_file():
            raise ConfigurationError(f"--targets {self.targets}: holds no run.lcmlog")
        return log.absolute()

    def log_level(self, configuration: Configuration) -> str:
        return self.log or ("full" if configuration.reaches <= FULL_LOG_REACHES else "states")
