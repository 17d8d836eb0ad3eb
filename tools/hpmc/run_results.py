"""From the logs of a run to its summary, candump and figures."""

import math
from pathlib import Path
from typing import Any

from rich.console import Console

from hpmc.configuration import Configuration
from hpmc.experiment import Experiment
from hpmc.layout import NUMBERS
from hpmc.modes.job import Outcome

SYNC_PERIOD_S = 0.001


def total(stats: list[dict[str, Any]], *keys: str) -> int:
    return sum(int(entry.get(key, 0)) for entry in stats for key in keys)


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
        PaceFacts,
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
            load_worst_percent=configuration.bus_load_worst_percent,
            load_typical_percent=sum(loads) / len(loads) if loads else None,
        ),
        lcm=LcmFacts(messages=total(outcome.stats, "messages"), lost=total(outcome.stats, "lost")),
        versions=VersionFacts(git=info["git"], protocol_hash=info["protocol_hash"]),
        pace=PaceFacts(
            overruns=total(outcome.stats, "overruns"),
            lateness_max_us=total(outcome.stats, "lateness_max_us"),
        )
        if experiment.pace == "realtime"
        else None,
    )
    summary = build_summary(facts, analysis, geometry)
    if outside := total(outcome.stats, "outside_targets"):
        console.print(
            f"targets from outside: {outside}; the figures of those reaches mean little"
        )
    if refused := total(outcome.stats, "outside_targets_refused", "outside_targets_dropped"):
        console.print(f"targets from outside that were refused: {refused}; none acts between the reaches")
    if analysis.incomplete:
        console.print(f"{analysis.incomplete} reaches lack samples and are left out")
    for damage in analysis.damage:
        console.print(f"[yellow]{damage}[/]")
    if level == "full":
        write_candump([LcmLog(path) for path in outcome.logs], folder / "candump.log")
    if experiment.figures:
        from hpmc.figures import draw_all

        draw_all(analysis, folder, geometry)
    # Last, so that a folder with a summary is a complete one.
    write_summary(summary, folder / "summary.json")
    print_summary(summary, console)
