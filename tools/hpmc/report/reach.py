"""The signals of one reach, layer by layer, from HPMC_STATE and, where there is one, ARM_STATE."""

from dataclasses import dataclass

import numpy as np

from hpmc.lcm_log import LogError
from hpmc.node_words import CONVERGENCE_BIT
from hpmc.run_folder import RunFolder

JOINTS = ("shoulder", "elbow", "wrist")
LINKS = ("elbow", "wrist", "hand")
_HAND = 2
_SYNC_PERIOD_US = 1000
_SLOPE_S = 0.010  # to either side: hand velocity where only encoders tell it
_STATE_FIELDS = (
    "utime", "x_t_m", "x_d_m", "v_d_m_s", "q_d_rad", "q_rad", "x_link_d_m", "x_link_m", "w_link_N",
    "wrench_N", "tau_d_Nm", "tau_max_Nm", "tau_Nm", "statusword", "saturated",
)  # fmt: skip


@dataclass(frozen=True)
class ReachPlace:
    """Where a reach is in the run."""

    number: int  # in the run, from 1
    repetition: int  # from 0
    reach: int  # within the repetition, from 0
    target: int  # clock position, also of the way back
    from_us: int  # run clock
    to_us: int  # of its last sample

    @property
    def in_words(self) -> str:
        text = f"reach {self.number}"
        if self.target > 0:
            way = f"home to target {self.target}", f"target {self.target} to home"
            text += f", {way[self.reach % 2]}"
        if self.repetition:
            text += f", repetition {self.repetition}"
        return text


@dataclass(frozen=True)
class ReachSignals:
    """n samples; what a node measured stands beside the command that acted at that SYNC."""

    time_s: np.ndarray  # (n), from the change of target
    x_t_m: np.ndarray  # (n, 2)
    x_d_m: np.ndarray  # (n, 2)
    hand_m: np.ndarray  # (n, 2), of the encoders
    planned_speed_m_s: np.ndarray  # (n)
    hand_speed_m_s: np.ndarray  # (n)
    hand_speed_from: str
    joint_error_rad: np.ndarray  # (n, 3), Q_d - q
    link_error_m: np.ndarray  # (n, 3), length
    link_force_N: np.ndarray  # (n, 3), length
    wrench_N: np.ndarray  # (n), length
    tau_d_Nm: np.ndarray  # (n, 3)
    tau_max_Nm: np.ndarray  # (n, 3)
    tau_Nm: np.ndarray  # (n, 3)
    convergence: np.ndarray  # (n, 3), phase of each FIC
    saturated: np.ndarray  # (n)


def find_reaches(run: RunFolder) -> list[ReachPlace]:
    """All reaches of a run, whole or not, in their order. Raises LogError without HPMC_STATE."""
    places: list[tuple[int, int, int, int, int]] = []
    for log in run.logs:
        if not log.count("HPMC_STATE"):
            continue
        columns = ("utime", "repetition", "reach", "target")
        utime, repetition, reach, target = (log.column("HPMC_STATE", name) for name in columns)
        new = (np.diff(repetition) != 0) | (np.diff(reach) != 0)
        first = np.concatenate([[0], np.flatnonzero(new) + 1])
        last = np.concatenate([first[1:] - 1, [utime.size - 1]])
        places += [
            (int(repetition[a]), int(reach[a]), int(target[a]), int(utime[a]), int(utime[b]))
            for a, b in zip(first.tolist(), last.tolist(), strict=True)
            if reach[a] >= 0
        ]
    per_repetition = reaches_per_repetition(run, max((place[1] + 1 for place in places), default=1))
    return [
        ReachPlace(place[0] * per_repetition + place[1] + 1, *place) for place in sorted(places)
    ]


def reaches_per_repetition(run: RunFolder, seen: int) -> int:
    """By the configuration where it says so, else by what was seen."""
    configured = run.config.get("experiment", {}).get("reaches")
    return configured if isinstance(configured, int) and configured >= seen else seen


def read_reach(run: RunFolder, place: ReachPlace) -> ReachSignals:
    """Raises LogError where less than three samples are left of it."""
    # What the nodes measured at a SYNC is told a period later; the command that acts there is as
    # many periods old as the bus takes beyond the one of bus.pipeline 1.
    bus = run.config.get("bus", {})
    age = int(bus.get("pipeline", 1)) - 1 + int(bus.get("command_delay_ms", 0))
    begin_us = place.from_us - age * _SYNC_PERIOD_US
    table = run.read("HPMC_STATE", _STATE_FIELDS, begin_us / 1e6, place.to_us / 1e6 + 0.01)
    age = int(np.count_nonzero(table["utime"] < place.from_us))
    inside = int(np.count_nonzero(table["utime"] <= place.to_us)) - age
    count = min(inside, len(table) - age - 1)
    if count < 3:
        raise LogError(f"reach {place.number} has less than three samples")

    def shaped(name: str, *shape: int) -> np.ndarray:
        columns = [c.name for c in table.columns if c.name.partition("[")[0] == name]
        return np.stack([table[column] for column in columns], axis=1).reshape(-1, *shape)

    now, told = slice(age, age + count), slice(age + 1, age + count + 1)
    acting = slice(0, count)
    utime = table["utime"][now]
    links = shaped("x_link_m", 3, 2)[told]
    hand = links[:, _HAND]
    speed, source = _hand_speed(run, place, utime, hand)
    return ReachSignals(
        time_s=(utime - place.from_us) / 1e6,
        x_t_m=shaped("x_t_m", 2)[now],
        x_d_m=shaped("x_d_m", 2)[now],
        hand_m=hand,
        planned_speed_m_s=_length(shaped("v_d_m_s", 2)[now]),
        hand_speed_m_s=speed,
        hand_speed_from=source,
        joint_error_rad=shaped("q_d_rad", 3)[acting] - shaped("q_rad", 3)[told],
        link_error_m=_length(shaped("x_link_d_m", 3, 2)[now] - links),
        link_force_N=_length(shaped("w_link_N", 3, 2)[now]),
        wrench_N=_length(shaped("wrench_N", 2)[now]),
        tau_d_Nm=shaped("tau_d_Nm", 3)[acting],
        tau_max_Nm=shaped("tau_max_Nm", 3)[acting],
        tau_Nm=shaped("tau_Nm", 3)[told],
        convergence=(shaped("statusword", 3)[told].astype(np.int64) >> CONVERGENCE_BIT & 1) == 1,
        saturated=table["saturated"][now].astype(bool),
    )


def _hand_speed(
    run: RunFolder, place: ReachPlace, utime: np.ndarray, hand_m: np.ndarray
) -> tuple[np.ndarray, str]:
    """Of the simulated arm where it is in the log; else the slope of what the encoders say."""
    try:
        arm = run.read("ARM_STATE", ["utime", "hand_m_s"], place.from_us / 1e6, place.to_us / 1e6)
        rows = np.searchsorted(arm["utime"], utime)
        if np.array_equal(arm["utime"][np.minimum(rows, len(arm) - 1)], utime):
            return np.hypot(arm["hand_m_s[0]"][rows], arm["hand_m_s[1]"][rows]), "of the arm"
    except (LogError, IndexError):
        pass
    period_s = float(np.median(np.diff(utime))) / 1e6
    half = max(round(_SLOPE_S / period_s), 1)
    padded = np.pad(hand_m, ((half, half), (0, 0)), mode="edge")
    slope = (padded[2 * half :] - padded[: -2 * half]) / (2 * half * period_s)
    return _length(slope), f"from encoders over {2e3 * half * period_s:.0f} ms"


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.hypot(vectors[..., 0], vectors[..., 1])
