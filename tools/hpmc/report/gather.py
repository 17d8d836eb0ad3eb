"""Everything that the page of a run says, as plain values and pictures for its template."""

import base64
import datetime
import io
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hpmc.analysis import Analysis, analyse_logs
from hpmc.can.load import BIT_RATE, frame_bits
from hpmc.can.words import name_of
from hpmc.candump import sent_frames
from hpmc.kinematics import ClockGeometry, PlanarArm
from hpmc.layout import CONFIG
from hpmc.lcm_log import LogError
from hpmc.log_info import RunDescription, describe
from hpmc.metrics import HUMAN_R, MINIMUM_JERK_R, PAPER_EXECUTED_R, PAPER_PLANNED_R
from hpmc.report import charts
from hpmc.report.reach import ReachPlace, find_reaches, read_reach
from hpmc.report.timeline import Timeline, read_timeline
from hpmc.run_folder import RunFolder
from hpmc.run_results import WHOLE_CLOCK
from hpmc.summary import metric_summary

BASE_EXPERIMENT = "clock"  # its file holds every key (docs/configuration.md)
_LOAD_BUCKET_S = 0.1
_LOAD_POINTS = 600
_WIDE_PX = 1300
_FIGURE_TITLES = {
    "fig1_arm": "The arm from above", "fig3_r_per_target": "Smoothness r per target",
    "fig4_rmse_per_target": "Tracking errors per target",
    "fig5_paths_and_speed": "Hand paths and speed", "fig6_manipulability": "Manipulability",
    "fig7_comparison": "Beside harmonic and minimum-jerk movements",
}  # fmt: skip


@dataclass(frozen=True)
class Picture:
    """A PNG inside the page."""

    title: str
    data: str  # base64
    wide: bool


def gather(path: Path, reach_number: int | None) -> dict[str, Any]:
    """The context of the template. Raises LogError for what is no run, or a reach that is not."""
    run = RunFolder(path)
    facts = describe(run)
    analysis, missing = _analyse(run)
    places = _places(run)
    place = _choose(run, places, analysis, reach_number)
    line = read_timeline(run)
    frames = _frames(run)
    summary = run.summary
    reach_layers: list[Any] = []
    if place is not None:
        try:
            reach_layers = charts.reach_charts(read_reach(run, place))
        except LogError as error:
            missing.append(f"no signals of {place.in_words}: {error}")
    name, config, changed = _configuration(run)
    pictures = _pictures(run, analysis, missing)
    info = facts.info or {}
    mode = (summary or info).get("mode", "")
    if not line.end_s:
        line.end_s = facts.duration_s
    return {
        "title": _title(name, mode, run),
        "folder": run.path.resolve().name,
        "made": datetime.datetime.fromtimestamp(
            max(log.path.stat().st_mtime for log in run.logs)
        ).strftime("%Y-%m-%d %H:%M"),
        "mode": mode,
        "facts": facts,
        "info": info,
        "summary": summary,
        "missing": missing,
        "problems": _problems(facts),
        "cards": _cards(run, analysis, facts, line),
        "table": _table(run, analysis),
        "in_words": _in_words(summary, analysis),
        "pictures": pictures,
        "places": len(places),
        "place": place,
        "chosen": "chosen with --reach" if reach_number else _why_this(analysis, place),
        "reach_layers": reach_layers,
        "line": line,
        "line_chart": charts.timeline_chart(line) if line.drives or line.phases else None,
        "bus_rows": _bus_rows(run, facts, frames),
        "frame_rows": frames["rows"] if frames else [],
        "load_chart": frames["chart"] if frames else None,
        "period_chart": charts.period_chart((summary or {}).get("pace") or {}),
        "experiment": name,
        "config": config,
        "changed": changed,
        "versions": _versions(run, info),
    }


def _title(name: str, mode: str, run: RunFolder) -> str:
    words = f"{name.replace('_', ' ').capitalize()} experiment" if run.config else "Log"
    return f"{words}{', ' + mode if mode else ''}"


def _analyse(run: RunFolder) -> tuple[Analysis | None, list[str]]:
    """The metrics of the logs, and what the run lacks."""
    missing = []
    if run.path.is_dir() and run.summary is None:
        missing.append(
            "summary.json is missing: the run did not come to its end, or has not yet. Figures "
            "below are measured from the whole reaches of its logs."
        )
    period_s = run.config.get("experiment", {}).get("period_s")
    if not isinstance(period_s, int | float):
        missing.append("There is no configuration: the reaches cannot be measured.")
        return None, missing
    try:
        analysis = analyse_logs([log.path for log in run.logs], period_s)
    except (LogError, ValueError, KeyError, IndexError) as error:
        missing.append(f"No reach could be measured: {error}.")
        return None, missing
    if analysis.incomplete:
        missing.append(f"{analysis.incomplete} reaches lack samples and are left out.")
    return analysis, missing


def _problems(facts: RunDescription) -> list[str]:
    problems = list(facts.problems)
    for channel in facts.channels:
        if channel.lost:
            problems.append(f"{channel.channel}: {channel.lost} messages are lost")
        if channel.note:
            problems.append(f"{channel.channel}: {channel.note}")
        if channel.not_growing:
            problems.append(
                f"{channel.channel}: the sequence number does not grow {channel.not_growing} times"
            )
    return problems


# --- summary -------------------------------------------------------------------------------------


def _metrics(run: RunFolder, analysis: Analysis | None) -> dict[str, Any]:
    """Of summary.json, else of the logs."""
    return run.summary or metric_summary(analysis)


def _is_papers(run: RunFolder) -> bool:
    experiment = run.config.get("experiment", {})
    return (
        experiment.get("path", "clock") == "clock"
        and experiment.get("reaches", WHOLE_CLOCK) == WHOLE_CLOCK
    )


def number(value: float | None, digits: int) -> str:
    """As text; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def _cards(
    run: RunFolder, analysis: Analysis | None, facts: RunDescription, line: Timeline
) -> list[dict[str, str]]:
    """The few figures that one looks for first: name, value, what to hold them against, style."""
    metrics = _metrics(run, analysis)
    papers = _is_papers(run)
    cards = []
    executed = metrics.get("executed", {})
    if executed.get("r_mean") is not None:
        cards.append({
            "name": "smoothness r, executed",
            "value": f"{executed['r_mean']:.2f} ± {executed['r_std']:.2f}",
            "beside": f"paper {PAPER_EXECUTED_R[0]} ± {PAPER_EXECUTED_R[1]}" if papers else "",
        })  # fmt: skip
        rmse = metrics["position_rmse_mm"]
        cards.append({
            "name": "position error (RMSE)", "value": f"{rmse['mean']:.2f} mm",
            "beside": f"paper below 1 mm; worst reach {rmse['max']:.2f}" if papers
            else f"worst reach {rmse['max']:.2f} mm",
        })  # fmt: skip
        final = metrics["final_error_mm"]
        cards.append({
            "name": "final error", "value": f"{final['mean']:.2f} mm",
            "beside": f"worst {final['max']:.2f} mm",
        })  # fmt: skip
    cards.append({
        "name": "emergencies", "value": str(len(line.emergencies)),
        "beside": line.emergencies[0].what if line.emergencies else "of all nodes",
        "style": "bad" if line.emergencies else "good",
    })  # fmt: skip
    lost = sum(channel.lost or 0 for channel in facts.channels)
    bus_lost = ((run.summary or {}).get("bus") or {}).get("lost", 0)
    cards.append({
        "name": "lost", "value": f"{bus_lost} frames", "beside": f"{lost} messages of the log",
        "style": "bad" if lost or bus_lost else "good",
    })  # fmt: skip
    cards.append(_speed_card(run, facts))
    return cards


def _speed_card(run: RunFolder, facts: RunDescription) -> dict[str, str]:
    summary = run.summary or {}
    if pace := summary.get("pace"):
        return {
            "name": "held to the wall clock", "value": f"{pace['overruns']} overruns",
            "beside": f"latest period {pace['lateness_max_us']} us late",
            "style": "bad" if pace["overruns"] else "good",
        }  # fmt: skip
    if factor := summary.get("real_time_factor"):
        return {
            "name": "times real time", "value": f"{factor:.2f}",
            "beside": f"{summary['simulated_s']:.1f} s in {summary['wall_s']:.1f} s",
        }  # fmt: skip
    return {"name": "run clock", "value": f"{facts.duration_s:.2f} s", "beside": "in the logs"}


def _table(run: RunFolder, analysis: Analysis | None) -> dict[str, Any] | None:
    """Rows of text beside the paper's, as at the end of ./rig run."""
    metrics = _metrics(run, analysis)
    planned, executed = metrics.get("planned", {}), metrics.get("executed", {})
    if executed.get("r_mean") is None:
        return None
    rows = []
    for target in metrics.get("targets") or _targets(run, analysis):
        if target["planned_r"] is None:
            continue
        rows.append(("", str(target["index"]), number(target["planned_r"], 4),
                     number(target["executed_r"], 2), number(target["position_rmse_mm"], 2),
                     number(target["velocity_rmse_mm_s"], 1),
                     number(target["manipulability"], 4)))  # fmt: skip
    position, velocity = metrics["position_rmse_mm"], metrics["velocity_rmse_mm_s"]
    rows.append(("all", "all", f"{planned['r_mean']:.4f} ± {planned['r_std']:.4f}",
                 f"{executed['r_mean']:.2f} ± {executed['r_std']:.2f}",
                 number(position["mean"], 2), number(velocity["mean"], 1), ""))  # fmt: skip
    rows.append(("", "worst reach", "", "", number(position["max"], 2), number(velocity["max"], 1),
                 ""))  # fmt: skip
    if _is_papers(run):
        rows += [
            ("paper", "paper", f"{PAPER_PLANNED_R[0]:.3f} ± {PAPER_PLANNED_R[1]:.3f}",
             f"{PAPER_EXECUTED_R[0]:.2f} ± {PAPER_EXECUTED_R[1]:.3f}", "< 1", "by target",
             "low: 5, 6"),
            ("paper", "human", "", f"{HUMAN_R[0]:.3f} ± {HUMAN_R[1]:.3f}", "", "", ""),
            ("paper", "minimum jerk", "", f"{MINIMUM_JERK_R:.3f}", "", "", ""),
        ]  # fmt: skip
    reaches = metrics.get("reaches") or (len(analysis.metrics) if analysis else 0)
    return {"rows": rows, "reaches": reaches}


def _targets(run: RunFolder, analysis: Analysis | None) -> list[dict[str, Any]]:
    """Means per target, where there is no summary.json."""
    if analysis is None:
        return []
    geometry = _geometry(run)
    rows = []
    for target in np.unique(analysis.metrics.target[analysis.metrics.target > 0]).tolist():
        of_target = analysis.metrics.of_target(target)
        rows.append({
            "index": target, "manipulability": geometry.manipulability(target),
            **{name: float(np.mean(getattr(of_target, name))) for name in (
                "planned_r", "executed_r", "position_rmse_mm", "velocity_rmse_mm_s")},
        })  # fmt: skip
    return rows


def _in_words(summary: dict[str, Any] | None, analysis: Analysis | None) -> list[str]:
    metrics = summary or metric_summary(analysis)
    executed, planned = metrics.get("executed", {}), metrics.get("planned", {})
    if executed.get("r_mean") is None:
        return []
    lines = [f"r at 5 % of peak speed {number(executed.get('r5_mean'), 2)}"]
    if "sparc_mean" in executed:
        lines.append(
            f"smoothness: SPARC {number(executed['sparc_mean'], 3)} "
            f"(planned {number(planned['sparc_mean'], 3)}), "
            f"LDLJ {number(executed['ldlj_mean'], 2)} (planned {number(planned['ldlj_mean'], 2)})"
        )
    for joint, found in enumerate((summary or {}).get("encoder_check") or (), start=1):
        lines.append(
            f"encoder of joint {joint}: {found['moved_rad']:+.4f} rad under "
            f"{found['torque_Nm']:+.2f} N m"
        )
    return lines


# --- pictures and reaches ------------------------------------------------------------------------


def _geometry(run: RunFolder) -> ClockGeometry:
    config = run.config
    return ClockGeometry(
        arm=PlanarArm(tuple(config["arm"]["length_m"])),
        centre_m=tuple(config["experiment"]["centre_m"]),
        radius_m=config["experiment"]["radius_m"],
        phi_deg=math.degrees(config["dynamic_task"]["w_t_rad"]),
    )


def _pictures(run: RunFolder, analysis: Analysis | None, missing: list[str]) -> list[Picture]:
    """Those of the run; drawn anew where it has none and they can be."""
    if run.path.is_dir():
        # The lengths of the SYNC periods are drawn with the timing.
        files = sorted(file for file in run.path.glob("fig*.png") if file.stem != "fig_timing")
        if files:
            return [_picture(file.stem, file.read_bytes()) for file in files]
    if analysis is None or not _is_papers(run):
        return []
    from hpmc.figures import FIGURES, style

    pictures = []
    try:
        geometry = _geometry(run)
        for name, draw in FIGURES.items():
            png = io.BytesIO()
            with style():
                draw(analysis, geometry).savefig(png, format="png")
            pictures.append(_picture(name, png.getvalue()))
    except (KeyError, ValueError) as error:
        missing.append(f"The paper's figures could not be drawn: {error}.")
    return pictures


def _picture(name: str, png: bytes) -> Picture:
    title = _FIGURE_TITLES.get(name, name.replace("_", " "))
    width_px = int.from_bytes(png[16:20], "big")  # of the header (PNG specification, 11.2.1)
    return Picture(title, base64.b64encode(png).decode(), width_px >= _WIDE_PX)


def _places(run: RunFolder) -> list[ReachPlace]:
    if not run.count("HPMC_STATE") or run.type_of("HPMC_STATE") is None:
        return []
    return find_reaches(run)


def _choose(
    run: RunFolder, places: list[ReachPlace], analysis: Analysis | None, wanted: int | None
) -> ReachPlace | None:
    """The one asked for, else the one with the worst position error, else the first."""
    by_number = {place.number: place for place in places}
    if wanted is not None:
        if wanted not in by_number:
            there = f"{min(by_number)} to {max(by_number)}" if by_number else "none"
            raise LogError(f"--reach {wanted}: the reaches of {run.path} are {there}")
        return by_number[wanted]
    if analysis is not None:
        worst = int(np.argmax(analysis.metrics.position_rmse_mm))
        key = int(analysis.metrics.repetition[worst]), int(analysis.metrics.reach[worst])
        return next((p for p in places if (p.repetition, p.reach) == key), None)
    return places[0] if places else None


def _why_this(analysis: Analysis | None, place: ReachPlace | None) -> str:
    if place is None:
        return ""
    if analysis is None:
        return "the first; another one with --reach N"
    worst = float(analysis.metrics.position_rmse_mm.max())
    return f"the one with the largest position error, {worst:.2f} mm; another one with --reach N"


# --- bus and timing ------------------------------------------------------------------------------


def _frames(run: RunFolder) -> dict[str, Any] | None:
    """Counts per identifier and load over time; None where the frames are not in the log."""
    counts = np.zeros(1 << 11, dtype=np.int64)
    load_time: list[np.ndarray] = []
    load_bits: list[np.ndarray] = []
    span_s = 0.0
    for log in run.logs:
        if not log.count("CAN_FRAMES") or log.known_type("CAN_FRAMES") is None:
            continue
        try:
            utime, frames = sent_frames(log)
        except LogError:
            continue
        if frames.size == 0:
            continue
        ids = frames["id"].astype(np.int64) & 0x7FF
        counts += np.bincount(ids, minlength=counts.size)
        data = np.frombuffer(frames["data"].tobytes(), np.uint8).reshape(-1, 8)
        bits = frame_bits(ids, frames["len"].astype(np.int64), data)
        span_us = int(utime.max() - utime.min())
        span_s += span_us / 1e6
        bucket_us = max(_LOAD_BUCKET_S * 1e6, span_us / _LOAD_POINTS)
        bucket = ((utime - utime.min()) / bucket_us).astype(np.int64)
        # The last bucket is not full.
        sums = np.bincount(bucket, weights=bits)[:-1]
        load_time.append((utime.min() + np.arange(sums.size) * bucket_us) / 1e6)
        load_bits.append(sums / (bucket_us / 1e6))
    if not counts.any():
        return None
    rows = []
    for cob_id in np.flatnonzero(counts).tolist():
        count = int(counts[cob_id])
        rate = count / span_s if span_s > 0 else math.nan
        rows.append((f"{cob_id:03X}h", name_of(cob_id)[0], str(count), number(rate, 1)))
    percent = 100 * np.concatenate(load_bits) / BIT_RATE
    chart = charts.load_chart(np.concatenate(load_time), percent) if percent.size > 1 else None
    mean = float(percent.mean()) if percent.size else math.nan
    return {"rows": rows, "chart": chart, "count": int(counts.sum()), "mean_percent": mean}


def _bus_rows(
    run: RunFolder, facts: RunDescription, frames: dict[str, Any] | None
) -> list[tuple[str, str]]:
    summary = run.summary or {}
    rows: list[tuple[str, str]] = []
    bus = summary.get("bus") or {}
    if bus:
        rows.append(("CAN frames", f"{bus['frames']}, {bus['lost']} lost"))
    elif frames:
        rows.append(("CAN frames in the log", str(frames["count"])))
    if bus.get("load_typical_percent") is not None:
        rows.append(("load at 1 Mbit/s while cyclic frames flow",
                     f"{bus['load_typical_percent']:.1f} % of the bits"))  # fmt: skip
    if bus.get("load_worst_percent") is not None:
        rows.append(("load of the cyclic frames with the worst stuffing",
                     f"{bus['load_worst_percent']:.1f} %"))  # fmt: skip
    if lcm := summary.get("lcm"):
        rows.append(("LCM messages", f"{lcm['messages']}, {lcm['lost']} lost"))
    lost = sum(channel.lost or 0 for channel in facts.channels)
    rows.append(("messages in the log", f"{facts.messages}, {lost} lost by sequence number"))
    if summary.get("real_time_factor"):
        rows.append(("simulated / wall time", f"{summary['simulated_s']:.2f} s / "
                     f"{summary['wall_s']:.2f} s = {summary['real_time_factor']:.2f}"))  # fmt: skip
    for key, value in (summary.get("pace") or {}).items():
        if not isinstance(value, list | dict):
            name = key.replace("_us", ", us").replace("_", " ")
            rows.append((name, f"{value:.1f}" if isinstance(value, float) else str(value)))
    return rows


# --- configuration -------------------------------------------------------------------------------


def _configuration(run: RunFolder) -> tuple[str, list[tuple[str, list[dict[str, str]]]], int]:
    """Name of the experiment, its sections of keys beside the defaults, how many differ."""
    name, defaults = _nearest_experiment(run.config)
    comments = _comments(run.config_toml or "")
    sections = []
    changed = 0
    for section, values in run.config.items():
        if not isinstance(values, dict):
            continue
        rows = []
        for key, value in values.items():
            default = defaults.get(section, {}).get(key)
            differs = default is not None and not _same(value, default)
            changed += differs
            rows.append({
                "key": key, "value": _plain(value), "default": _plain(default) if differs else "",
                "meaning": comments.get((section, key), ""),
            })  # fmt: skip
        sections.append((section, rows))
    return name, sections, changed


def _nearest_experiment(config: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """A run does not say which experiment it was: the one from which the fewest keys differ."""
    best, best_defaults, fewest = BASE_EXPERIMENT, {}, None
    files = sorted(CONFIG.glob("*.toml"), key=lambda file: file.stem != BASE_EXPERIMENT)
    base = tomllib.loads((CONFIG / f"{BASE_EXPERIMENT}.toml").read_text())
    for file in files:
        over = tomllib.loads(file.read_text())
        defaults = {
            section: {**base.get(section, {}), **over.get(section, {})}
            for section in base.keys() | over.keys()
            if isinstance(base.get(section, {}), dict) and isinstance(over.get(section, {}), dict)
        }
        differing = sum(
            not _same(config.get(section, {}).get(key), value)
            for section, values in defaults.items()
            for key, value in values.items()
        )
        if fewest is None or differing < fewest:
            best, best_defaults, fewest = file.stem, defaults, differing
    return best, best_defaults


def _same(one: object, two: object) -> bool:
    if isinstance(one, list) and isinstance(two, list):
        return len(one) == len(two) and all(map(_same, one, two))
    if isinstance(one, int | float) and isinstance(two, int | float):
        return math.isclose(one, two, rel_tol=1e-12)
    return one == two


def _plain(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(_plain(part) for part in value)
    if isinstance(value, float):
        return f"{value:.9g}"
    return str(value)


def _comments(toml: str) -> dict[tuple[str, str], str]:
    """What stands behind each key of a configuration as hpmc_config writes it."""
    section, found = "", {}
    for line in toml.splitlines():
        if line.startswith("["):
            section = line.strip("[] ")
        elif "=" in line and "#" in line:
            found[section, line.split("=")[0].strip()] = line.partition("#")[2].strip()
    return found


def _versions(run: RunFolder, info: dict[str, Any]) -> list[tuple[str, str]]:
    versions = (run.summary or {}).get("versions") or {}
    rows = [
        ("sources", info.get("git") or versions.get("git")),
        ("protocol", info.get("protocol_hash") or versions.get("protocol_hash")),
        ("mathematics", info.get("libm")),
        ("build", info.get("build")),
        ("joint controllers in", (run.summary or {}).get("numbers")),
        ("seed", info.get("seed")),
    ]
    return [(name, str(value)) for name, value in rows if value not in (None, "")]
