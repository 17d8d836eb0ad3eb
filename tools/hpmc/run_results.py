"""From the logs of a run to its summary, candump and figures."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from hpmc.configuration import Configuration
from hpmc.experiment import Experiment
from hpmc.layout import NUMBERS
from hpmc.modes.bench import bus_load_percent
from hpmc.modes.job import Outcome

if TYPE_CHECKING:
    from hpmc.summary import PaceFacts

SYNC_PERIOD_S = 0.001
WHOLE_CLOCK = 16  # reaches to all targets and back: what the pictures and the paper show


def total(stats: list[dict[str, Any]], *keys: str) -> int:
    return sum(int(entry.get(key, 0)) for entry in stats for key in keys)


def pace_facts(experiment: Experiment, stats: list[dict[str, Any]]) -> PaceFacts | None:
    """From what the process that kept to the wall clock has told."""
    from hpmc.summary import PaceFacts

    if experiment.mode != "bench" and experiment.pace != "realtime":
        return None
    if experiment.mode != "bench":
        return PaceFacts(total(stats, "overruns"), total(stats, "lateness_max_us"))
    told = {key: value for entry in stats if "replies_missing" in entry or "cycles" in entry
            for key, value in entry.items()}  # fmt: skip
    return PaceFacts(**{f.name: told[f.name] for f in fields(PaceFacts) if f.name in told})


def write_results(
    experiment: Experiment,
    configuration: Configuration,
    outcome: Outcome,
    folder: Path,
    level: str,
    console: Console,
) -> None:
    """Summary, candump and figures into the folder; the summary's table onto the console.

    Analysis is imported here: a run is under way before numpy and matplotlib are loaded.
    """
    from hpmc.analysis import analyse_logs
    from hpmc.candump import write_candump
    from hpmc.kinematics import ClockGeometry, PlanarArm
    from hpmc.lcm_log import LcmLog
    from hpmc.summary import (
        BusFacts,
        LcmFacts,
        RunFacts,
        VersionFacts,
        build_summary,
        print_summary,
        write_summary,
    )

    values = configuration.values
    geometry = ClockGeometry(
        arm=PlanarArm(tuple(values["arm"]["length_m"])),
        centre_m=tuple(values["experiment"]["centre_m"]),
        radius_m=values["experiment"]["radius_m"],
        phi_deg=math.degrees(values["dynamic_task"]["w_t_rad"]),
    )
    analysis = analyse_logs(outcome.logs, values["experiment"]["period_s"])
    log = LcmLog(outcome.logs[0])
    info = next(log.messages("RUN_INFO"))
    loads = [
        entry["load_typical_percent"] for entry in outcome.stats if "load_typical_percent" in entry
    ]
    simulated_s = configuration.repetitions * configuration.periods_per_repetition * SYNC_PERIOD_S
    facts = RunFacts(
        mode=experiment.mode,
        numbers=NUMBERS,
        seed=configuration.seed,
        repetitions=configuration.repetitions,
        simulated_s=simulated_s,
        wall_s=outcome.wall_s,
        bus=BusFacts(
            frames=total(outcome.stats, "frames"),
            lost=total(outcome.stats, "frames_lost", "frames_dropped"),
            load_worst_percent=bus_load_percent(configuration)
            if experiment.mode == "bench"
            else configuration.bus_load_worst_percent,
            load_typical_percent=sum(loads) / len(loads) if loads else None,
        ),
        lcm=LcmFacts(messages=total(outcome.stats, "messages"), lost=total(outcome.stats, "lost")),
        versions=VersionFacts(git=info["git"], protocol_hash=info["protocol_hash"]),
        pace=pace_facts(experiment, outcome.stats),
        encoders=next((e["encoder_check"] for e in outcome.stats if "encoder_check" in e), None),
    )
    summary = build_summary(facts, analysis, geometry)
    if outside := total(outcome.stats, "outside_targets"):
        console.print(
            f"targets from outside: {outside}; the figures of those reaches mean little"
        )
    if refused := total(outcome.stats, "outside_targets_refused", "outside_targets_dropped"):
        console.print(
            f"targets from outside that were refused: {refused}; none acts between the reaches"
        )
    if analysis.incomplete:
        console.print(f"{analysis.incomplete} reaches lack samples and are left out")
    for damage in analysis.damage:
        console.print(f"[yellow]{damage}[/]")
    if level == "full":
        write_candump([LcmLog(path) for path in outcome.logs], folder / "candump.log")
    whole_clock = configuration.reaches_per_repetition == WHOLE_CLOCK and (
        values["experiment"]["path"] == "clock"
    )
    if experiment.figures and summary["pace"] and "period_histogram" in summary["pace"]:
        from hpmc.figures import draw_timing

        draw_timing(summary["pace"], folder)
    if experiment.figures and whole_clock:
        from hpmc.figures import draw_all

        draw_all(analysis, folder, geometry)
    # Last, so that a folder with a summary is a complete one.
    write_summary(summary, folder / "summary.json")
    print_summary(summary, console, experiment.name, beside_paper=whole_clock)
    if values["wall"]["surface"] != "none" and not console.quiet:
        print_contact(folder, console)


def print_contact(folder: Path, console: Console) -> None:
    """What happened at the wall, and where the energy went."""
    from hpmc.api import load
    from hpmc.contact import first_contact
    from hpmc.energy import audit

    run = load(folder)
    try:
        contact = first_contact(run).in_words()
    except ValueError as error:
        contact = f"contact: {error}"
    for line in (contact, audit(run).in_words()):
        console.print(line, soft_wrap=True)
