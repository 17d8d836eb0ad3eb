"""What is to be run: a name of sim_host/config, the mode, and what is changed."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hpmc.configuration import Configuration, ConfigurationError, load_configuration
from hpmc.layout import NUMBERS

FULL_LOG_REACHES = 160


@dataclass(frozen=True)
class Experiment:
    """An experiment and how to run it; the fields are the options of `./rig run`."""

    name: str = "clock"
    mode: str = "vcan"  # a name of hpmc.modes.MODES
    config: Path | None = None  # TOML over the experiment's own
    # over `config`: "section.key=value" each, or {"section.key": value}
    overrides: Sequence[str] | Mapping[str, Any] = ()
    fixed: bool = False
    pace: str = "lockstep"  # or realtime
    jobs: int = 1  # processes that the repetitions are spread over
    log: str | None = None  # full | states | none; by the number of reaches when left out
    out: Path | None = None  # folder to make; runs/TIME-NAME-MODE when left out
    uml: bool = False
    can: str | None = None  # bench: CAN interface, or slcan:DEVICE
    yes_move: bool = False  # bench: real joints may move
    figures: bool = True
    lcm_url: str | None = None  # sil, emulated: where to publish what happens while it happens
    targets: Path | None = None  # a run whose targets from outside act again

    def load(self) -> Configuration:
        """The whole configuration. Raises ConfigurationError."""
        files = [self.config] if self.config else []
        configuration = load_configuration(self.name, files, override_lines(self.overrides))
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


def override_lines(overrides: Sequence[str] | Mapping[str, Any]) -> list[str]:
    """`section.key=value` with the values as TOML writes them. Raises ConfigurationError."""
    if not isinstance(overrides, Mapping):
        return list(overrides)
    return [f"{key}={toml_value(key, value)}" for key, value in overrides.items()]


def toml_value(key: str, value: object) -> str:
    """Numbers, strings, booleans and arrays of them; numpy's too."""
    plain = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(plain, (list, tuple)):
        return "[" + ", ".join(toml_value(key, item) for item in plain) + "]"
    if isinstance(plain, (bool, str)):
        return json.dumps(plain)
    if isinstance(plain, (int, float)):
        return repr(plain)
    raise ConfigurationError(f"{key}: {value!r} is no number, string or list of them")
