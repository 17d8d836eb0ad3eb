"""Cuts a log into reaches and joins what the host wanted to what the arm did.

A reach is the run of HPMC_STATE messages of one (repetition, reach >= 0). ARM_STATE is joined by
utime, so with a joint loop of 5 kHz only the states at the host's ticks are used. A reach that
lacks a sample (the end of a killed run, a lost message) is counted and left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hpmc.lcm_log import LcmLog, LogError

REACH_S = 1.0
BATCH_TICKS = 100_000


@dataclass(frozen=True)
class Reaches:
    """n reaches of k samples each; SI units."""

    repetition: np.ndarray  # (n)
    reach: np.ndarray  # (n), within the repetition, even = away from home, odd = back
    target: np.ndarray  # (n), 1..8, also of the way back
    period_s: float  # between samples
    x_t_m: np.ndarray  # (n, 2), where the reach should end
    x_d_m: np.ndarray  # (n, k, 2), elastic band
    v_d_m_s: np.ndarray  # (n, k, 2)
    hand_m: np.ndarray  # (n, k, 2), executed
    hand_m_s: np.ndarray  # (n, k, 2)

    @property
    def outward(self) -> np.ndarray:
        """True for home to target, False for target to home."""
        return self.reach % 2 == 0


class ReachIndex:
    """Where the reaches of one log are; their samples are read batch by batch."""

    def __init__(self, log: LcmLog, reach_s: float = REACH_S) -> None:
        self._log = log
        utime = log.column("HPMC_STATE", "utime")
        if utime.size < 2:
            raise LogError(f"{log.path}: HPMC_STATE has {utime.size} message, no reach in it")
        self.period_us = int(np.median(np.diff(utime[:1000])))
        self.ticks = round(reach_s * 1e6 / self.period_us)
        repetition = log.column("HPMC_STATE", "repetition")
        reach = log.column("HPMC_STATE", "reach")

        new = (np.diff(repetition) != 0) | (np.diff(reach) != 0)
        first = np.concatenate([[0], np.flatnonzero(new) + 1])
        length = np.diff(np.concatenate([first, [utime.size]]))
        first, length = first[reach[first] >= 0], length[reach[first] >= 0]
        whole = length == self.ticks
        whole &= utime[first + length - 1] - utime[first] == (self.ticks - 1) * self.period_us

        arm_utime = log.column("ARM_STATE", "utime")
        if np.any(np.diff(arm_utime) <= 0):
            raise LogError(f"{log.path}: utime of ARM_STATE does not grow")
        arm_row = np.searchsorted(arm_utime, utime)
        joined = arm_utime[np.minimum(arm_row, arm_utime.size - 1)] == utime
        gaps = np.concatenate([[0], np.cumsum(~joined)])
        whole &= gaps[first + length] == gaps[first]

        self.incomplete = int((~whole).sum())
        self._first = first[whole]
        self._arm_row = arm_row
        self._repetition = repetition[self._first]
        self._reach = reach[self._first]
        self._target = log.column("HPMC_STATE", "target")[self._first]

    def __len__(self) -> int:
        return self._first.size

    def batches(self, batch_ticks: int = BATCH_TICKS) -> Iterator[Reaches]:
        """All whole reaches in log order, about `batch_ticks` samples at a time."""
        size = max(batch_ticks // self.ticks, 1)
        for start in range(0, len(self), size):
            yield self._read(slice(start, start + size))

    def _read(self, which: slice) -> Reaches:
        rows = (self._first[which, None] + np.arange(self.ticks)).ravel()
        arm_rows = self._arm_row[rows]

        def samples(channel: str, field: str, at: np.ndarray) -> np.ndarray:
            low, high = int(at[0]), int(at[-1]) + 1
            column = self._log.column(channel, field, low, high)[at - low]
            return column.reshape(-1, self.ticks, 2)

        return Reaches(
            repetition=self._repetition[which],
            reach=self._reach[which],
            target=self._target[which],
            period_s=self.period_us * 1e-6,
            x_t_m=samples("HPMC_STATE", "x_t_m", rows)[:, -1],
            x_d_m=samples("HPMC_STATE", "x_d_m", rows),
            v_d_m_s=samples("HPMC_STATE", "v_d_m_s", rows),
            hand_m=samples("ARM_STATE", "hand_m", arm_rows),
            hand_m_s=samples("ARM_STATE", "hand_m_s", arm_rows),
        )
