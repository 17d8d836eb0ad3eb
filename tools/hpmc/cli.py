"""The command line behind ./rig: hands each command to its module."""

import importlib
from collections.abc import Sequence

MODULES = {
    "run": "hpmc.run_command",
    "view": "hpmc.view.command",
    "node": "hpmc.node",
    "log": "hpmc.log",
    "report": "hpmc.report.command",
    "can": "hpmc.can.command",
    "bench": "hpmc.bench",
    "flash": "hpmc.flash",
    "doctor": "hpmc.doctor",
    "test": "hpmc.selftest",
}
EXIT_USAGE = 2


def main(argv: Sequence[str]) -> int:
    if not argv or argv[0] not in MODULES:
        print(f"hpmc: the command must be one of {', '.join(MODULES)}")
        return EXIT_USAGE
    module = importlib.import_module(MODULES[argv[0]])
    status: int = module.main(list(argv[1:]))
    return status
