"""summary.json of a run, and the table that is printed at its end beside the paper's figures."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hpmc.analysis import Analysis
from hpmc.kinematics import TARGET_COUNT, ClockGeometry
from hpmc.metrics import HUMAN_R, MINIMUM_JERK_R, PAPER_EXECUTED_R, PAPER_PLANNED_R

Summary = dict[str, Any]


@dataclass(frozen=True)
class BusFacts:
    """CAN frames of the run; None where a load does not apply."""

    frames: int
    lost: int
    load_worst_percent: float | None
    load_typical_percent: float | None


@dataclass(frozen=True)
class LcmFacts:
    """LCM messages of the run."""

    messages: int
    lost: int


@dataclass(frozen=True)
class PaceFacts:
    """How well the run kept to the wall clock. What None holds was not measured and is left out."""

    overruns: int  # SYNC periods that were not done when the next one should have begun
    lateness_max_us: int  # how late a period began at worst
    lateness_p99_us: float | None = None
    late_cycles: int | None = None  # began more than a tenth of a period late
    cycles: int | None = None
    period_us: float | None = None  # as wanted
    jitter_us: float | None = None  # root mean square of interval minus period
    histogram_bin_us: float | None = None
    period_histogram: list[list[int]] | None = None  # [bin, count]; bin i begins at i x bin_us
    scheduling: str | None = None  # of the host
    memory: str | None = None
    replies_missing: int | None = None  # injected sensors: TPDO1 waited for in vain
    replies_late: int | None = None

    def facts(self) -> dict[str, Any]:
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class VersionFacts:
    """What the run was built from."""

    git: str
    protocol_hash: str


@dataclass(frozen=True)
class RunFacts:
    """What the runner knows and the logs do not."""

    mode: str
    numbers: str  # of the joint controllers: float or fixed
    seed: int
    repetitions: int
    simulated_s: float
    wall_s: float
    bus: BusFacts
    lcm: LcmFacts
    versions: VersionFacts
    pace: PaceFacts | None = None  # only where the run was held to the wall clock
    encoders: list[dict[str, float]] | None = None  # of the encoder check: what each joint did


def build_summary(
    facts: RunFacts, analysis: Analysis | None, geometry: ClockGeometry | None = None
) -> Summary:
    """The content of summary.json. Without logs (`--log none`) every metric is None (null)."""
    geometry = geometry or ClockGeometry()
    metrics = analysis.metrics if analysis else None

    def of_target(target: int, column: str) -> float | None:
        rows = metrics.of_target(target) if metrics else None
        return _number(np.mean(getattr(rows, column))) if rows else None

    return {
        "mode": facts.mode,
        "numbers": facts.numbers,
        "repetitions": facts.repetitions,
        "reaches": len(metrics) if metrics else 0,
        "seed": facts.seed,
        "simulated_s": facts.simulated_s,
        "wall_s": facts.wall_s,
        "real_time_factor": facts.simulated_s / facts.wall_s if facts.wall_s > 0 else None,
        **metric_summary(analysis),
        "targets": [
            {
                "index": target,
                **{
                    column: of_target(target, column)
                    for column in (
                        "planned_r",
                        "executed_r",
                        "position_rmse_mm",
                        "velocity_rmse_mm_s",
                    )
                },
                "manipulability": geometry.manipulability(target),
            }
            for target in range(1, TARGET_COUNT + 1)
        ],
        "bus": asdict(facts.bus),
        "lcm": asdict(facts.lcm),
        "pace": facts.pace.facts() if facts.pace else None,
        **({"encoder_check": facts.encoders} if facts.encoders else {}),
        "versions": asdict(facts.versions),
    }


def metric_summary(analysis: Analysis | None) -> Summary:
    """The metrics over all reaches, under the keys that they have in summary.json."""
    metrics = analysis.metrics if analysis else None

    def over_all(column: str, statistic: Callable[[np.ndarray], float]) -> float | None:
        return _number(statistic(getattr(metrics, column))) if metrics else None

    return {
        "planned": {
            "r_mean": over_all("planned_r", np.mean),
            "r_std": over_all("planned_r", np.std),
            "sparc_mean": over_all("planned_sparc", np.mean),
            "ldlj_mean": over_all("planned_ldlj", np.mean),
        },
        "executed": {
            "r_mean": over_all("executed_r", np.mean),
            "r_std": over_all("executed_r", np.std),
            "r5_mean": over_all("executed_r5", np.mean),
            "sparc_mean": over_all("executed_sparc", np.mean),
            "sparc_std": over_all("executed_sparc", np.std),
            "ldlj_mean": over_all("executed_ldlj", np.mean),
            "ldlj_std": over_all("executed_ldlj", np.std),
        },
        **{
            column: {"mean": over_all(column, np.mean), "max": over_all(column, np.max)}
            for column in ("position_rmse_mm", "velocity_rmse_mm_s", "final_error_mm")
        },
    }


def write_summary(summary: Summary, path: Path) -> None:
    """Writes summary.json whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
    partial.replace(path)


def print_summary(
    summary: Summary,
    console: Console | None = None,
    experiment: str = "clock",
    *,
    beside_paper: bool = True,
) -> None:
    """Prints the table per target and for all, beside the paper's figures where it is its run."""
    console = console or Console()
    console.print(_table(summary, experiment, beside_paper))
    for line in _facts_in_words(summary):
        console.print(Text(line))


def _table(summary: Summary, experiment: str, beside_paper: bool) -> Table:
    name = experiment.replace("_", " ").capitalize()
    table = Table(
        title=f"{name} experiment, {summary['mode']}, joints in {summary['numbers']}: "
        f"{summary['reaches']} reaches",
        title_justify="left",
        title_style="bold",
        box=box.HORIZONTALS,
        pad_edge=False,
    )
    table.add_column("target")
    table.add_column("planned r", justify="right")
    table.add_column("executed r", justify="right")
    table.add_column("position\nRMSE, mm", justify="right")
    table.add_column("velocity\nRMSE, mm/s", justify="right")
    table.add_column("manipu-\nlability", justify="right")
    for target in summary["targets"]:
        if not beside_paper and target["planned_r"] is None:
            continue  # a clock position that is not visited
        table.add_row(
            str(target["index"]),
            _text(target["planned_r"], 4),
            _text(target["executed_r"], 2),
            _text(target["position_rmse_mm"], 2),
            _text(target["velocity_rmse_mm_s"], 1),
            _text(target["manipulability"], 4),
        )
    table.add_section()
    planned, executed = summary["planned"], summary["executed"]
    table.add_row(
        "all",
        f"{_text(planned['r_mean'], 4)}±{_text(planned['r_std'], 4)}",
        f"{_text(executed['r_mean'], 2)}±{_text(executed['r_std'], 2)}",
        _text(summary["position_rmse_mm"]["mean"], 2),
        _text(summary["velocity_rmse_mm_s"]["mean"], 1),
        "",
        style="bold",
    )
    table.add_row(
        "worst reach",
        "",
        "",
        _text(summary["position_rmse_mm"]["max"], 2),
        _text(summary["velocity_rmse_mm_s"]["max"], 1),
        "",
    )
    if not beside_paper:
        return table
    table.add_section()
    table.add_row(
        "paper",
        f"{PAPER_PLANNED_R[0]:.3f}±{PAPER_PLANNED_R[1]:.3f}",
        f"{PAPER_EXECUTED_R[0]:.2f}±{PAPER_EXECUTED_R[1]:.3f}",
        "< 1",
        "by target",
        "low: 5, 6",
        style="cyan",
    )
    table.add_row("human", "", f"{HUMAN_R[0]:.3f}±{HUMAN_R[1]:.3f}", "", "", "", style="cyan")
    table.add_row("min. jerk", "", f"{MINIMUM_JERK_R:.3f}", "", "", "", style="cyan")
    return table


def _facts_in_words(summary: Summary) -> list[str]:
    bus, lcm = summary["bus"], summary["lcm"]
    final_error = summary["final_error_mm"]
    planned, executed = summary["planned"], summary["executed"]
    lines = [
        f"r at 5 % of peak speed {_text(summary['executed']['r5_mean'], 2)}, "
        f"final error {_text(final_error['mean'], 2)} mm (worst {_text(final_error['max'], 2)} mm)",
        f"smoothness: SPARC {_text(executed['sparc_mean'], 3)} (planned "
        f"{_text(planned['sparc_mean'], 3)}), LDLJ {_text(executed['ldlj_mean'], 2)} (planned "
        f"{_text(planned['ldlj_mean'], 2)})",
        f"{summary['simulated_s']:.1f} s simulated in {summary['wall_s']:.1f} s: "
        f"{_text(summary['real_time_factor'], 2)} times real time",
        f"CAN {bus['frames']} frames, {bus['lost']} lost; LCM {lcm['messages']} messages, "
        f"{lcm['lost']} lost",
    ]
    if bus["load_worst_percent"] is not None:
        lines[-1] += (
            f"; load at 1 Mbit/s {_text(bus['load_typical_percent'], 0)} %, "
            f"worst {_text(bus['load_worst_percent'], 0)} %"
        )
    if pace := summary["pace"]:
        lines.append(
            f"held to the wall clock: {pace['overruns']} overruns, "
            f"a period began at most {pace['lateness_max_us']} us late"
        )
        if "late_cycles" in pace:
            lines[-1] = (
                f"SYNC each {pace['period_us']:.0f} us: {pace['overruns']} overruns, "
                f"{pace['late_cycles']} of {pace['cycles']} cycles late, jitter "
                f"{pace['jitter_us']:.0f} us, 99 % of the cycles began within "
                f"{pace['lateness_p99_us']:.0f} us, all within {pace['lateness_max_us']} us; "
                f"{pace['scheduling']}, memory {pace['memory']}"
            )
    for number, found in enumerate(summary.get("encoder_check", ()), start=1):
        lines.append(
            f"encoder of joint {number}: {found['moved_rad']:+.4f} rad under "
            f"{found['torque_Nm']:+.2f} N m"
        )
    return lines


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
