"""One pass over the logs of a run: the metrics of each reach and what the pictures draw."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from hpmc.kinematics import TARGET_COUNT
from hpmc.lcm_log import LcmLog, LogError
from hpmc.metrics import (
    final_error,
    log_dimensionless_jerk,
    peak_over_mean,
    peak_over_mean_moving,
    rmse,
    spectral_arc_length,
    speed,
)
from hpmc.movements import REACH_S, Reaches, ReachIndex


@dataclass(frozen=True)
class ReachMetrics:
    """One entry per reach, in the order of repetition and reach."""

    repetition: np.ndarray
    reach: np.ndarray
    target: np.ndarray
    planned_r: np.ndarray
    executed_r: np.ndarray
    executed_r5: np.ndarray
    position_rmse_mm: np.ndarray
    velocity_rmse_mm_s: np.ndarray
    final_error_mm: np.ndarray
    planned_sparc: np.ndarray
    executed_sparc: np.ndarray
    planned_ldlj: np.ndarray
    executed_ldlj: np.ndarray

    def __len__(self) -> int:
        return self.target.size

    def of_target(self, target: int) -> "ReachMetrics":
        """Both directions of one target."""
        rows = self.target == target
        return ReachMetrics(*(getattr(self, column.name)[rows] for column in fields(self)))


class MeanCurve:
    """Mean and standard deviation, sample by sample, over many curves."""

    def __init__(self, samples: int) -> None:
        self.count = 0
        self._sum = np.zeros(samples)
        self._sum_of_squares = np.zeros(samples)

    def add(self, curves: np.ndarray) -> None:
        """Adds curves, shape (n, samples)."""
        self.count += curves.shape[0]
        self._sum += curves.sum(axis=0)
        self._sum_of_squares += (curves**2).sum(axis=0)

    def merge(self, other: "MeanCurve") -> None:
        """Adds the curves of another one."""
        self.count += other.count
        self._sum += other._sum
        self._sum_of_squares += other._sum_of_squares

    @property
    def mean(self) -> np.ndarray:
        return self._sum / self.count

    @property
    def std(self) -> np.ndarray:
        variance = self._sum_of_squares / self.count - self.mean**2
        return np.sqrt(np.maximum(variance, 0.0))


@dataclass
class ReachCurves:
    """Speed and way along the straight line, over the window, of one target and direction."""

    planned_speed_mm_s: MeanCurve
    executed_speed_mm_s: MeanCurve
    planned_way_mm: MeanCurve
    executed_way_mm: MeanCurve


@dataclass
class Analysis:
    """What the logs of one run say."""

    metrics: ReachMetrics
    incomplete: int  # reaches left out, a sample or more missing
    simulated_s: float
    time_s: np.ndarray  # of the samples of a reach, from the change of target
    curves: dict[tuple[int, bool], ReachCurves]  # by (target, outward)
    sample: Reaches  # the first repetition, for paths
    damage: list[str] = field(default_factory=list)  # of the logs, one line each

    @property
    def repetitions(self) -> int:
        return int(np.unique(self.metrics.repetition).size)


def analyse_logs(paths: Iterable[Path], reach_s: float = REACH_S) -> Analysis:
    """Reads the logs of one run (several with --jobs, each with its own repetitions)."""
    tables: list[ReachMetrics] = []
    curves: dict[tuple[int, bool], ReachCurves] = {}
    samples: list[Reaches] = []
    incomplete, simulated_s, damage = 0, 0.0, []
    ticks, period_s = 0, 0.0
    for path in paths:
        log = LcmLog(path)
        damage += [f"{path}: {d.length} bytes at {d.offset} hold no message" for d in log.damage]
        index = ReachIndex(log, reach_s)
        if ticks and index.ticks != ticks:
            raise LogError(f"{path}: {index.ticks} samples a reach, {ticks} in the other logs")
        ticks, period_s = index.ticks, index.period_us * 1e-6
        incomplete += index.incomplete
        utime = log.column("HPMC_STATE", "utime")
        simulated_s += float(utime[-1] - utime[0]) * 1e-6
        for batch_number, reaches in enumerate(index.batches()):
            tables.append(_measure(reaches))
            _add_curves(curves, reaches)
            if batch_number == 0:
                samples.append(_first_repetition(reaches))
    if not tables:
        raise LogError("no whole reach in the logs")
    return Analysis(
        metrics=_joined(tables),
        incomplete=incomplete,
        simulated_s=simulated_s,
        time_s=np.arange(ticks) * period_s,
        curves=curves,
        sample=min(samples, key=lambda reaches: int(reaches.repetition[0])),
        damage=damage,
    )


def way_mm(reaches: Reaches, position_m: np.ndarray) -> np.ndarray:
    """How far a path has come on the straight line from start to target, shape (n, k)."""
    start = reaches.x_d_m[:, 0]
    line = reaches.x_t_m - start
    direction = line / np.maximum(speed(line), 1e-9)[:, None]
    return 1e3 * np.einsum("nkx,nx->nk", position_m - start[:, None], direction)


def _measure(reaches: Reaches) -> ReachMetrics:
    planned_speed, executed_speed = speed(reaches.v_d_m_s), speed(reaches.hand_m_s)
    return ReachMetrics(
        repetition=reaches.repetition,
        reach=reaches.reach,
        target=reaches.target,
        planned_r=peak_over_mean(planned_speed),
        executed_r=peak_over_mean(executed_speed),
        executed_r5=peak_over_mean_moving(executed_speed),
        position_rmse_mm=1e3 * rmse(reaches.hand_m, reaches.x_d_m),
        velocity_rmse_mm_s=1e3 * rmse(reaches.hand_m_s, reaches.v_d_m_s),
        final_error_mm=1e3 * final_error(reaches.hand_m, reaches.x_t_m),
        planned_sparc=spectral_arc_length(planned_speed, reaches.period_s),
        executed_sparc=spectral_arc_length(executed_speed, reaches.period_s),
        planned_ldlj=log_dimensionless_jerk(planned_speed, reaches.period_s),
        executed_ldlj=log_dimensionless_jerk(executed_speed, reaches.period_s),
    )


def _joined(tables: list[ReachMetrics]) -> ReachMetrics:
    columns = [
        np.concatenate([getattr(table, column.name) for table in tables])
        for column in fields(ReachMetrics)
    ]
    order = np.lexsort((columns[1], columns[0]))
    return ReachMetrics(*(column[order] for column in columns))


def _add_curves(curves: dict[tuple[int, bool], ReachCurves], reaches: Reaches) -> None:
    data = {
        "planned_speed_mm_s": 1e3 * speed(reaches.v_d_m_s),
        "executed_speed_mm_s": 1e3 * speed(reaches.hand_m_s),
        "planned_way_mm": way_mm(reaches, reaches.x_d_m),
        "executed_way_mm": way_mm(reaches, reaches.hand_m),
    }
    ticks = reaches.x_d_m.shape[1]
    for target in range(1, TARGET_COUNT + 1):
        for outward in (True, False):
            rows = (reaches.target == target) & (reaches.outward == outward)
            if not rows.any():
                continue
            key = (target, outward)
            if key not in curves:
                curves[key] = ReachCurves(*(MeanCurve(ticks) for _ in data))
            for name, values in data.items():
                getattr(curves[key], name).add(values[rows])


def _first_repetition(reaches: Reaches) -> Reaches:
    rows = reaches.repetition == reaches.repetition[0]
    return Reaches(
        **{
            column.name: value[rows] if isinstance(value, np.ndarray) else value
            for column in fields(Reaches)
            for value in [getattr(reaches, column.name)]
        }
    )
