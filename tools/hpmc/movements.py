"""Cuts a log into reaches and joins what the host wanted to what the arm did.

A reach is the run of HPMC_STATE messages of one (repetition, reach >= 0). ARM_STATE is joined by
utime, so with a joint loop of 5 kHz only the states at the host's ticks are used. A reach that
lacks a sample (the end of a killed run, a lost message) is counted and left out.

A log of a real arm has no ARM_STATE: there the hand is where the nodes' encoders put it
(HPMC_STATE, which tells in a period what was measured in the one before), and its velocity is the
slope of a parabola fitted to SMOOTHED_S of that, wide enough for the steps of the encoders.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hpmc.lcm_log import LcmLog, LogError

REACH_S = 1.0
BATCH_TICKS = 100_000
SMOOTHED_S = 0.021
HAND = 2  # of x_link_m


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

        self._measured_by_nodes = "ARM_STATE" not in log.channels
        if self._measured_by_nodes:
            arm_row = np.arange(1, utime.size + 1)  # told a period later
            joined = np.append(np.diff(utime) == self.period_us, False)
        else:
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

        if self._measured_by_nodes:
            hand_m, hand_m_s = self._measured_hand(arm_rows)
        else:
            hand_m = samples("ARM_STATE", "hand_m", arm_rows)
            hand_m_s = samples("ARM_STATE", "hand_m_s", arm_rows)
        return Reaches(
            repetition=self._repetition[which],
            reach=self._reach[which],
            target=self._target[which],
            period_s=self.period_us * 1e-6,
            x_t_m=samples("HPMC_STATE", "x_t_m", rows)[:, -1],
            x_d_m=samples("HPMC_STATE", "x_d_m", rows),
            v_d_m_s=samples("HPMC_STATE", "v_d_m_s", rows),
            hand_m=hand_m,
            hand_m_s=hand_m_s,
        )

    def _measured_hand(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity of the hand from the encoders, each (n, k, 2)."""
        half = max(round(SMOOTHED_S * 0.5e6 / self.period_us), 1)
        low = max(int(rows[0]) - half, 0)
        links = self._log.column("HPMC_STATE", "x_link_m", low, int(rows[-1]) + 1 + half)
        hand = held(links.reshape(links.shape[0], -1, 2)[:, HAND])
        velocity = slopes(hand, half, self.period_us * 1e-6)
        return (
            hand[rows - low].reshape(-1, self.ticks, 2),
            velocity[rows - low].reshape(-1, self.ticks, 2),
        )


def held(hand_m: np.ndarray) -> np.ndarray:
    """Outside the periods in which the layers ran (0, 0) is told: there the last place stands."""
    told = hand_m.any(axis=1)
    last = np.maximum.accumulate(np.where(told, np.arange(told.size), 0))
    return hand_m[last]


def slopes(values: np.ndarray, half: int, period_s: float) -> np.ndarray:
    """Derivative of each column: slope of the parabola through 2 half + 1 samples around each
    (Savitzky and Golay 1964); the ends repeat their last value."""
    offsets = np.arange(-half, half + 1)
    weights = offsets / (period_s * float((offsets**2).sum()))
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    return np.column_stack(
        [np.convolve(column, weights[::-1], mode="valid") for column in padded.T]
    )
