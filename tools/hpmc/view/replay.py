"""A run from its log: what happened at an instant, for playing and scrubbing."""

from pathlib import Path
from typing import Any

import numpy as np

from hpmc.lcm_log import LogError
from hpmc.run_folder import RunFolder
from hpmc.view.pictures import node_picture, rig_picture, state_picture


class Replay:
    """The logs of one run, one after the other in run time."""

    def __init__(self, folder: Path) -> None:
        """Raises LogError when the folder holds no readable log of a run."""
        run = RunFolder(folder)
        logs = run.logs
        for log in logs:
            if not log.count("HPMC_STATE"):
                raise LogError(f"{log.path} has no HPMC_STATE: it is not the log of a run")
        self._logs = sorted(logs, key=lambda log: int(log.column("HPMC_STATE", "utime", 0, 1)[0]))
        self._times = [log.column("HPMC_STATE", "utime") / 1e6 for log in self._logs]
        self._firsts = np.array([times[0] for times in self._times])
        self._node_times = [
            {n: log.column(f"NODE_STATUS_{n}", "utime") / 1e6 for n in (1, 2, 3)
             if log.count(f"NODE_STATUS_{n}")}
            for log in self._logs
        ]  # fmt: skip
        self.begin_s = float(self._times[0][0])
        self.end_s = float(self._times[-1][-1])
        if not self._logs[0].count("RUN_INFO"):
            raise LogError(f"{self._logs[0].path} has no RUN_INFO: the configuration is unknown")
        self.rig = rig_picture(next(self._logs[0].messages("RUN_INFO")))
        self.damage = run.problems

    def marks(self) -> list[float]:
        """Where reaches begin, s."""
        begins: list[float] = []
        for log, times in zip(self._logs, self._times, strict=True):
            reach = log.column("HPMC_STATE", "reach")
            new = np.flatnonzero((np.diff(reach, prepend=-1) != 0) & (reach >= 0))
            begins += times[new].tolist()
        return begins

    def states(self, begin_s: float, end_s: float, most: int) -> list[dict[str, Any]]:
        """At most so many states of begin_s < t <= end_s, evenly spread, the last among them."""
        found = []
        for log, times in zip(self._logs, self._times, strict=True):
            first, last = np.searchsorted(times, [begin_s, end_s], side="right").tolist()
            found += [(log, row) for row in range(first, last)] if last - first <= most else [
                (log, first + (last - first) * i // most - 1) for i in range(1, most + 1)
            ]  # fmt: skip
        if len(found) > most:
            found = [found[len(found) * i // most - 1] for i in range(1, most + 1)]
        return [state_picture(log.read("HPMC_STATE", row, row + 1)[0]) for log, row in found]

    def nodes(self, time_s: float) -> list[dict[str, Any]]:
        """What the host knew of each node at an instant; nothing with `--log states`."""
        at = max(int(np.searchsorted(self._firsts, time_s, side="right")) - 1, 0)
        pictures = []
        for node, times in self._node_times[at].items():
            row = int(np.searchsorted(times, time_s, side="right")) - 1
            if row >= 0:
                status = self._logs[at].read(f"NODE_STATUS_{node}", row, row + 1)[0]
                pictures.append(node_picture(status))
        return pictures
