"""Experiments from a script: run one, or open an earlier one, and get numbers and numpy arrays.

`run(Experiment(...))` and `load(folder)` both give a Result. Its arrays are read from the log when
they are first asked for, and kept. Row k of every array belongs to the same instant, `time_s[k]`:
one row per SYNC period (1 ms) of the run, from boot to stop, repetition after repetition.
"""

import json
import threading
import tomllib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from hpmc.analysis import ReachMetrics, analyse_logs
from hpmc.experiment import Experiment
from hpmc.lcm_log import LogError
from hpmc.run_command import execute
from hpmc.run_folder import RunFolder

STAGES = ("boot", "configure", "enable", "approach", "reaches", "stop")
CONVERGENCE_BIT = 14  # of the statusword


def run(experiment: Experiment | None = None, *, quiet: bool = True) -> "Result":
    """Runs an experiment and opens what it left; `quiet=False` shows progress and the table.

    Blocks until the run has ended. Raises ConfigurationError before anything is made, RunError when
    the run ended early, RunInterrupted after Ctrl-C or SIGTERM (which run() handles meanwhile, so
    it must be called from the main thread).
    """
    if threading.current_thread() is not threading.main_thread():
        raise RuntimeError("hpmc.run: call it from the main thread, or from processes of its own")
    return Result(execute(experiment or Experiment(), Console(quiet=quiet, highlight=False)))


def load(folder: Path | str) -> "Result":
    """Opens the folder of an earlier run, also of one that ended early, or a single log.

    Raises LogError where there is no run.
    """
    result = Result(Path(folder))
    if not result.complete:
        _ = result.opened  # says so now
    return result


@dataclass(frozen=True)
class _Rows:
    """Which messages of HPMC_STATE and ARM_STATE belong together."""

    time_us: np.ndarray
    host: np.ndarray
    arm: np.ndarray


class Result:
    """A run that has ended: `folder`, `metrics`, `configuration`, and arrays (n rows, 1 ms each).

    Arrays are in SI units; positions are (x, y) with the shoulder at the origin; joints and links
    are in the order shoulder, elbow, wrist and arm, forearm, hand. LogError is raised for what the
    log does not hold (`log="none"`, a damaged file).
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __repr__(self) -> str:
        return f"Result({str(self.folder)!r})"

    # --- numbers ---------------------------------------------------------------------------------

    @property
    def complete(self) -> bool:
        """Whether the run came to its end."""
        return (self.folder / "summary.json").is_file()

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """summary.json: means over all reaches, and per target."""
        if not self.complete:
            raise LogError(f"{self.folder} has no summary.json: the run did not come to its end")
        try:
            summary: dict[str, Any] = json.loads((self.folder / "summary.json").read_text())
        except ValueError as error:
            raise LogError(f"{self.folder / 'summary.json'} cannot be read: {error}") from None
        return summary

    @cached_property
    def reach_metrics(self) -> ReachMetrics:
        """The same per reach: arrays of one entry per reach (hpmc.analysis.ReachMetrics)."""
        return analyse_logs(self._files, self.configuration["experiment"]["period_s"]).metrics

    @cached_property
    def configuration(self) -> dict[str, dict[str, Any]]:
        """The whole configuration of the run by section and key (docs/configuration.md)."""
        file = self.folder / "config.toml"
        return tomllib.loads(file.read_text()) if file.is_file() else self.opened.config

    # --- arrays, one row per SYNC period ---------------------------------------------------------

    @cached_property
    def time_s(self) -> np.ndarray:
        """(n), s, run clock; repetitions follow one another, so it grows all through."""
        return self._rows.time_us / 1e6

    @cached_property
    def repetition(self) -> np.ndarray:
        """(n), from 0."""
        return self._host("repetition")

    @cached_property
    def reach(self) -> np.ndarray:
        """(n), number of the reach within the repetition, from 0; -1 outside the reaches."""
        return self._host("reach")

    @cached_property
    def stage(self) -> np.ndarray:
        """(n), text: boot, configure, enable, approach, reaches or stop."""
        return np.array(STAGES)[self._host("phase")]

    @cached_property
    def target_m(self) -> np.ndarray:
        """(n, 2), m, X_t: target of the hand."""
        return self._host("x_t_m")

    @cached_property
    def x_d_m(self) -> np.ndarray:
        """(n, 2), m, X_d: desired hand position, of the elastic band."""
        return self._host("x_d_m")

    @cached_property
    def v_d_m_s(self) -> np.ndarray:
        """(n, 2), m/s, velocity of X_d."""
        return self._host("v_d_m_s")

    @cached_property
    def hand_m(self) -> np.ndarray:
        """(n, 2), m, X: hand position, of the arm itself."""
        return self._arm("hand_m")

    @cached_property
    def hand_m_s(self) -> np.ndarray:
        """(n, 2), m/s, hand velocity."""
        return self._arm("hand_m_s")

    @cached_property
    def wrench_N(self) -> np.ndarray:
        """(n, 2), N, W: force of the hand on its environment, as the sensor gives it."""
        return self._arm("wrench_N")

    @cached_property
    def link_wrench_N(self) -> np.ndarray:
        """(n, 3, 2), N, W_d of elbow, wrist and hand, of the region of attraction."""
        return self._host("w_link_N")

    @cached_property
    def q_rad(self) -> np.ndarray:
        """(n, 3), rad, joint angles, relative, counter-clockwise positive."""
        return self._arm("q_rad")

    @cached_property
    def qd_rad_s(self) -> np.ndarray:
        """(n, 3), rad/s, joint rates."""
        return self._arm("qd_rad_s")

    @cached_property
    def q_d_rad(self) -> np.ndarray:
        """(n, 3), rad, Q_d: desired joint angles."""
        return self._host("q_d_rad")

    @cached_property
    def tau_Nm(self) -> np.ndarray:
        """(n, 3), N m, torque of the motors, held from the joint tick before up to this row."""
        return self._arm("tau_Nm")

    @cached_property
    def tau_d_Nm(self) -> np.ndarray:
        """(n, 3), N m, T_d: desired torques, of the joint coordination."""
        return self._host("tau_d_Nm")

    @cached_property
    def tau_max_Nm(self) -> np.ndarray:
        """(n, 3), N m, T_max: second plateau of the torque profile."""
        return self._host("tau_max_Nm")

    @cached_property
    def converging(self) -> np.ndarray:
        """(n, 3), bool, whether the FIC of the joint is in convergence (else in divergence).

        As the node reported it with TPDO1 of the SYNC period before.
        """
        return self._host("statusword") >> CONVERGENCE_BIT & 1 == 1

    def during(self, reach: int, repetition: int = 0) -> np.ndarray:
        """(n), bool: the rows of one reach. `result.hand_m[result.during(3)]` is its hand path."""
        return (self.reach == reach) & (self.repetition == repetition)

    # --- the log ---------------------------------------------------------------------------------

    @cached_property
    def opened(self) -> RunFolder:
        """The run's logs, for what is not above: `result.opened.column("NODE_STATUS_1", "utime")`.

        Channels and fields: docs/lcm.md.
        """
        return RunFolder(self.folder)

    @property
    def _files(self) -> list[Path]:
        return [log.path for log in self.opened.logs]

    @cached_property
    def _rows(self) -> _Rows:
        host_us = self.opened.column("HPMC_STATE", "utime")
        arm_us = self.opened.column("ARM_STATE", "utime")
        time_us, host, arm = np.intersect1d(host_us, arm_us, return_indices=True)
        return _Rows(time_us, host, arm)

    def _host(self, field: str) -> np.ndarray:
        return self.opened.column("HPMC_STATE", field)[self._rows.host]

    def _arm(self, field: str) -> np.ndarray:
        return self.opened.column("ARM_STATE", field)[self._rows.arm]
