"""Runs the experiments of the H-PMC rig and analyses their logs.

For scripts (docs/scripting.md), started with `./rig python SCRIPT.py`:

    from hpmc import Experiment, load, run

    result = run(Experiment("clock", mode="sil"))

What is listed here is looked up when it is first used, so that `import hpmc` costs nothing: the
command line starts a run before numpy is loaded.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpmc.api import Result, load, run
    from hpmc.configuration import ConfigurationError
    from hpmc.contact import first_contact
    from hpmc.energy import audit
    from hpmc.experiment import Experiment
    from hpmc.lcm_log import LogError
    from hpmc.run_command import RunError, RunInterrupted

__all__ = [
    "ConfigurationError",
    "Experiment",
    "LogError",
    "Result",
    "RunError",
    "RunInterrupted",
    "audit",
    "first_contact",
    "load",
    "run",
]

_HOMES = {
    "ConfigurationError": "hpmc.configuration",
    "Experiment": "hpmc.experiment",
    "LogError": "hpmc.lcm_log",
    "Result": "hpmc.api",
    "RunError": "hpmc.run_command",
    "RunInterrupted": "hpmc.run_command",
    "audit": "hpmc.energy",
    "first_contact": "hpmc.contact",
    "load": "hpmc.api",
    "run": "hpmc.api",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    if name not in _HOMES:
        raise AttributeError(f"module 'hpmc' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
