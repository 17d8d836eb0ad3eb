"""`./rig run`: the command line, and a run from its configuration to logs, summary and figures."""

import argparse
import datetime
import itertools
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from rich.console import Console

from hpmc.configuration import Configuration, ConfigurationError, experiments
from hpmc.experiment import FULL_LOG_REACHES, Experiment, override_lines
from hpmc.layout import DEFAULT_TELEMETRY_URL, RUNS
from hpmc.log_size import candump_bytes, check_space, log_bytes
from hpmc.modes import MODES, Job
from hpmc.modes.bench import bus_load_percent
from hpmc.modes.vcan import sandbox_name
from hpmc.run_progress import ProgressBar
from hpmc.run_results import write_results

EXIT_USAGE = 2
EXIT_RUN_ENDED = 3
EXIT_INTERRUPTED = 130


class RunError(RuntimeError):
    """The run ended early: one line that says which part and why."""


class RunInterrupted(RuntimeError):
    """The run was ended by Ctrl-C or SIGTERM."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise ConfigurationError(f"{message} (see ./rig run --help)")


def parse(argv: Sequence[str]) -> Experiment:
    parser = Parser(
        prog="./rig run",
        allow_abbrev=False,
        description="Runs an experiment; leaves its log, summary and figures in a folder.",
    )
    parser.add_argument(
        "experiment", choices=experiments(), help="name of a file in sim_host/config"
    )
    parser.add_argument(
        "--mode",
        choices=tuple(MODES),
        default="vcan",
        help="sil: one process; vcan: one process per box, on a CAN bus (default); "
        "emulated: as sil, nodes are the flash image on an emulated Cortex-M4; "
        "bench: real boards on a CAN interface, by the wall clock",
    )
    parser.add_argument(
        "--sensors",
        choices=("direct", "injected"),
        help="how the nodes see the arm: LCM, or RPDO4 and TPDO1",
    )
    parser.add_argument(
        "--repetitions", metavar="N", help="each from boot to stop; the clock: of 16 reaches"
    )
    parser.add_argument("--joint-rate-hz", choices=("1000", "5000"), help="joint loop of the nodes")
    parser.add_argument("--phase-rule", choices=("body_motion", "error_growth"), help="of the FIC")
    parser.add_argument("--fixed", action="store_true",
                        help="joint controllers in 32-bit integers instead of float")
    parser.add_argument("--seed", metavar="N", help="of the start angles' offsets")
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="TOML over the experiment's own; only the keys that change",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="one parameter, e.g. bus.command_delay_ms=5 (repeatable)",
    )
    parser.add_argument(
        "--pace",
        choices=("lockstep", "realtime"),
        default="lockstep",
        help="as fast as it goes (default), or held to the wall clock (vcan; bench always is)",
    )
    parser.add_argument(
        "--can", metavar="IFACE", help="bench: CAN interface, e.g. can0, or slcan:/dev/ttyACM0"
    )
    parser.add_argument(
        "--yes-move", action="store_true", help="bench: real joints may move, all stand clear"
    )
    parser.add_argument(
        "--jobs",
        type=positive,
        default=1,
        metavar="N",
        help="sil: repetitions spread over N processes",
    )
    parser.add_argument(
        "--log",
        choices=("full", "states", "none"),
        help=f"default: full up to {FULL_LOG_REACHES} reaches, else states",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make (default: runs/TIME-EXPERIMENT-MODE)",
    )
    parser.add_argument(
        "--uml",
        action="store_true",
        help="vcan inside user-mode Linux even where the kernel has CAN",
    )
    parser.add_argument(
        "--lcm-url",
        metavar="URL",
        help="sil, emulated: publish what happens there while it happens, and take targets "
        f"(ARM_TARGET) from there, e.g. {DEFAULT_TELEMETRY_URL}; vcan does so in its sandbox",
    )
    parser.add_argument(
        "--targets",
        type=Path,
        metavar="RUN",
        help="folder of a run: the targets that came from outside act again, at their time",
    )
    parser.add_argument("--no-figures", action="store_true", help="no pictures")
    options = parser.parse_args(argv)
    return Experiment(
        name=options.experiment,
        mode=options.mode,
        config=options.config,
        overrides=all_overrides(options),
        fixed=options.fixed,
        pace=options.pace,
        jobs=options.jobs,
        log=options.log,
        out=options.out,
        uml=options.uml,
        can=options.can,
        yes_move=options.yes_move,
        figures=not options.no_figures,
        lcm_url=options.lcm_url,
        targets=options.targets,
    )


def positive(text: str) -> int:
    value = int(text) if text.isdecimal() else 0
    if not 1 <= value <= 256:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number, 1 to 256")
    return value


def all_overrides(options: argparse.Namespace) -> list[str]:
    named = {
        "experiment.repetitions": options.repetitions,
        "experiment.seed": options.seed,
        "joint.rate_Hz": options.joint_rate_hz,
        "joint.phase_rule": options.phase_rule,
        "rig.sensors": options.sensors,
    }
    return [
        f"{key}={value}" for key, value in named.items() if value is not None
    ] + options.overrides


def check_folder(folder: Path) -> None:
    """The output folder must be new or empty."""
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"--out {folder}: is not a folder")
    if folder.exists() and any(folder.iterdir()):
        raise ConfigurationError(f"--out {folder}: exists already and is not empty")


def make_new(folder: Path) -> bool:
    """Makes a folder; False where there is one of this name."""
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        return False
    return True


def make_folder(folder: Path, configuration: Configuration, *, named: bool) -> Path:
    """Makes the output folder with config.toml in it, and returns the latter.

    A folder that was not named by the user gets a number where there is one of this name already:
    runs of a script may begin within the same second.
    """
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in itertools.count(2))
    try:
        if named:
            folder.mkdir(parents=True, exist_ok=True)
        else:
            folder = next(filter(make_new, itertools.chain([folder], numbered)))
        config_file = folder / "config.toml"
        config_file.write_text(configuration.toml)
    except OSError as error:
        raise ConfigurationError(f"--out {folder}: cannot be written: {error.strerror}") from None
    return config_file


def announce(
    experiment: Experiment, configuration: Configuration, level: str, console: Console
) -> None:
    load_percent = configuration.bus_load_worst_percent
    fits = "" if load_percent <= 100.0 else " (a physical bus would need a slower SYNC)"
    if experiment.mode == "bench":
        load_percent, fits = bus_load_percent(configuration), ""
    kept = "" if level != "none" else ", removed after the analysis"
    console.print(
        f"{configuration.reaches} reaches, {experiment.mode}; bus load at 1 Mbit/s at worst "
        f"{load_percent:.1f} %{fits}; log {level}, "
        f"about {log_bytes(configuration, level) / 1e6:.0f} MB{kept}"
    )
    if experiment.mode == "vcan":
        console.print(f"look in meanwhile: tools/with-vcan --join {sandbox_name()} candump vcan0")


def execute(experiment: Experiment, console: Console) -> Path:
    """Runs the experiment and returns its folder, complete with summary and figures.

    Raises ConfigurationError before anything was made, RunError and RunInterrupted after.
    """
    if experiment.mode not in MODES:
        raise ConfigurationError(
            f"there is no mode '{experiment.mode}' (choose from {', '.join(MODES)})"
        )
    mode = MODES[experiment.mode]
    experiment = replace(
        experiment, overrides=[*mode.overrides, *override_lines(experiment.overrides)]
    )
    configuration = experiment.load()
    mode.check(experiment, configuration)
    level = experiment.log_level(configuration)
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = (experiment.out or RUNS / f"{now}-{experiment.name}-{experiment.mode}").absolute()
    targets = experiment.targets_log()
    if experiment.out:
        check_folder(folder)
    check_space(folder, log_bytes(configuration, level) + candump_bytes(configuration, level))
    config_file = make_folder(folder, configuration, named=experiment.out is not None)
    folder = config_file.parent
    announce(experiment, configuration, level, console)
    bar = ProgressBar(console, configuration.reaches, configuration.reaches_per_repetition)
    job = Job(
        configuration=configuration,
        config_file=config_file,
        log_level="full" if level == "full" else "states",
        folder=folder,
        bar=bar,
        jobs=experiment.jobs,
        realtime=experiment.pace == "realtime",
        uml=experiment.uml,
        lcm_url=experiment.lcm_url,
        targets=targets,
        can=experiment.can,
    )
    with bar.bar:
        outcome = mode.run(job)
    try:
        if outcome.interrupted:
            raise RunInterrupted(f"interrupted; the log up to there: {folder}")
        if outcome.reason:
            raise RunError(f"{outcome.reason}; the log up to there: {folder}")
        try:
            write_results(experiment, configuration, outcome, folder, level, console)
        except (OSError, ValueError) as error:  # no room on the disk; a log without a whole reach
            raise RunError(f"{error}; the log: {folder}") from error
    finally:
        if level == "none":
            for log in outcome.logs:
                log.unlink(missing_ok=True)
    return folder


def main(argv: Sequence[str]) -> int:
    console = Console(highlight=False)
    try:
        folder = execute(parse(argv), console)
    except ConfigurationError as error:
        print(f"rig run: {error}", file=sys.stderr)
        return EXIT_USAGE
    except RunError as error:
        print(f"rig run: {error}", file=sys.stderr)
        return EXIT_RUN_ENDED
    except RunInterrupted as error:
        console.print(str(error), soft_wrap=True)
        return EXIT_INTERRUPTED
    here = Path.cwd()
    shown = folder.relative_to(here) if folder.is_relative_to(here) else folder
    console.print(f"everything is in {shown}", soft_wrap=True)
    return 0
