"""The configuration of a run: resolved and checked by the program hpmc_config, read back here."""

import subprocess
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hpmc.layout import CONFIG, PROGRAMS

EXIT_USAGE = 2
BASE = CONFIG / "clock.toml"  # complete; the other experiments say what differs from it


class ConfigurationError(ValueError):
    """One line: the key and the allowed range."""


@dataclass(frozen=True)
class Configuration:
    toml: str
    values: dict[str, Any]
    periods_per_repetition: int
    joint_ticks: int
    bus_load_worst_percent: float

    @property
    def repetitions(self) -> int:
        return int(self.values["experiment"]["repetitions"])

    @property
    def reaches_per_repetition(self) -> int:
        return int(self.values["experiment"]["reaches"])

    @property
    def reaches(self) -> int:
        return self.repetitions * self.reaches_per_repetition

    @property
    def seed(self) -> int:
        return int(self.values["experiment"]["seed"])


def experiments() -> list[str]:
    return sorted(path.stem for path in CONFIG.glob("*.toml"))


def load_configuration(
    experiment: str, files: Sequence[Path] = (), overrides: Sequence[str] = ()
) -> Configuration:
    """The experiment's file, `files` over it, then `key=value`. Raises ConfigurationError."""
    if experiment not in experiments():
        raise ConfigurationError(
            f"there is no experiment '{experiment}' (choose from {', '.join(experiments())})"
        )
    own = CONFIG / f"{experiment}.toml"
    command = [str(PROGRAMS["hpmc_config"])]
    for file in (*dict.fromkeys((BASE, own)), *files):
        command += ["--config", str(file)]
    for override in overrides:
        command += ["--set", override]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60)
    if answer.returncode != 0:
        raise ConfigurationError(answer.stderr.strip().removeprefix("configuration: "))
    text, _, facts = answer.stdout.rpartition("\n\n# periods_per_repetition")
    derived = tomllib.loads("periods_per_repetition" + facts.replace("\n# ", "\n"))
    return Configuration(toml=text + "\n", values=tomllib.loads(text), **derived)
