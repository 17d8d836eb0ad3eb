"""`./rig run`: an experiment from its configuration to logs, summary and figures."""

import argparse
import contextlib
import datetime
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NoReturn, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from hpmc.configuration import (
    Configuration,
    ConfigurationError,
    experiments,
    load_configuration,
)
from hpmc.layout import LAUNCHER, NUMBERS, PROGRAMS, RUNS, WITH_VCAN

EXIT_USAGE = 2
EXIT_RUN_ENDED = 3
EXIT_INTERRUPTED = 130

REACHES_PER_REPETITION = 16
FULL_LOG_REACHES = 160
SYNC_PERIOD_S = 0.001
# Bytes of log per SYNC period, headers included: with `--log full`, and more per further joint
# tick; with `--log states`; of candump.log. Measured; a test holds them to 10 % of the real files.
FULL_BYTES = 1190
FULL_BYTES_JOINT_TICK = 415
STATES_BYTES = 605
STATES_BYTES_JOINT_TICK = 181
CANDUMP_BYTES = 315
CANDUMP_BYTES_INJECTED = 455
DISK_RESERVE_BYTES = 200 << 20
WATCH_S = 0.2


class RunError(RuntimeError):
    """The run ended early: one line that says which part and why."""


@dataclass
class Outcome:
    """What the processes of a run told."""

    wall_s: float = 0.0
    interrupted: bool = False
    reason: str = ""
    stats: list[dict[str, Any]] = field(default_factory=list)  # per process
    logs: list[Path] = field(default_factory=list)


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise ConfigurationError(f"{message} (see ./rig run --help)")


def parse(argv: Sequence[str]) -> argparse.Namespace:
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
        choices=("sil", "vcan"),
        default="vcan",
        help="sil: one process; vcan: one process per box, on a CAN bus (default)",
    )
    parser.add_argument(
        "--sensors",
        choices=("direct", "injected"),
        help="how the nodes see the arm: LCM, or RPDO4 and TPDO1",
    )
    parser.add_argument("--repetitions", metavar="N", help="of 16 reaches each")
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
        help="as fast as it goes (default), or held to the wall clock (vcan)",
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
    parser.add_argument("--no-figures", action="store_true", help="no pictures")
    return parser.parse_args(argv)


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


def log_bytes(configuration: Configuration, level: str) -> int:
    """Expected size of the logs."""
    further = configuration.joint_ticks - 1
    full = FULL_BYTES + further * FULL_BYTES_JOINT_TICK
    states = STATES_BYTES + further * STATES_BYTES_JOINT_TICK
    periods = configuration.repetitions * configuration.periods_per_repetition
    return periods * (full if level == "full" else states)


def candump_bytes(configuration: Configuration, level: str) -> int:
    """Expected size of candump.log."""
    injected = configuration.values["rig"]["sensors"] == "injected"
    periods = configuration.repetitions * configuration.periods_per_repetition
    each = CANDUMP_BYTES_INJECTED if injected else CANDUMP_BYTES
    return periods * each if level == "full" else 0


def check_folder(folder: Path) -> None:
    """The output folder must be new or empty."""
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"--out {folder}: is not a folder")
    if folder.exists() and any(folder.iterdir()):
        raise ConfigurationError(f"--out {folder}: exists already and is not empty")


def make_folder(folder: Path, configuration: Configuration) -> Path:
    """Makes the output folder with config.toml in it, and returns the latter."""
    config_file = folder / "config.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        config_file.write_text(configuration.toml)
    except OSError as error:
        raise ConfigurationError(f"--out {folder}: cannot be written: {error.strerror}") from None
    return config_file


def check_space(folder: Path, wanted_bytes: int) -> None:
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if free < wanted_bytes + DISK_RESERVE_BYTES:
        raise ConfigurationError(
            f"--out {folder}: the log will take {wanted_bytes / 1e6:.0f} MB, "
            f"{free / 1e6:.0f} MB are free; take fewer --repetitions, --log states or another --out"
        )


class ProgressBar:
    """Reach, simulated time and real-time factor."""

    def __init__(self, console: Console, reaches: int) -> None:
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(None),
            TextColumn("reach {task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[simulated]}"),
            TimeElapsedColumn(),
            console=console,
            transient=not console.is_terminal,
        )
        self.reaches = reaches
        self.task = self.bar.add_task("starting", total=reaches, simulated="")
        self.done: dict[int, tuple[int, float, float]] = {}  # per job: reaches, first time, time
        self.began = time.monotonic()
        self.printed = time.monotonic()
        self.console = console

    def update(self, job: int, line: str) -> None:
        told = json.loads(line)
        first = self.done.get(job, (0, told["simulated_s"], 0.0))[1]
        if not self.done:
            self.began = time.monotonic()
        reaches = told["reach"] + 1 + REACHES_PER_REPETITION * told["repetition"]
        self.done[job] = (
            max(reaches, self.done.get(job, (0, 0, 0))[0]),
            first,
            told["simulated_s"],
        )
        completed = sum(entry[0] for entry in self.done.values())
        simulated = sum(entry[2] - entry[1] for entry in self.done.values())
        elapsed = max(time.monotonic() - self.began, 1e-3)
        text = f"{simulated:.1f} s simulated, {simulated / elapsed:.2f} x real time"
        self.bar.update(
            self.task, completed=min(completed, self.reaches), simulated=text, description="running"
        )
        if not self.console.is_terminal and time.monotonic() - self.printed > 5.0:
            self.printed = time.monotonic()
            self.console.print(f"reach {completed}/{self.reaches}, {text}")


class Child:
    """A process of the run and the reader of its lines."""

    def __init__(self, command: list[str], on_line: Callable[[str], None]) -> None:
        self.errors: list[str] = []
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert self.process.stdout is not None and self.process.stderr is not None
        self.readers = [
            threading.Thread(target=read_lines, args=(self.process.stdout, on_line), daemon=True),
            threading.Thread(
                target=read_lines, args=(self.process.stderr, self.errors.append), daemon=True
            ),
        ]
        for reader in self.readers:
            reader.start()

    def wait(self, timeout_s: float | None = None) -> int:
        status = self.process.wait(timeout_s)
        for reader in self.readers:
            reader.join(5.0)
        return status


def read_lines(stream: IO[str], on_line: Callable[[str], None]) -> None:
    for line in stream:
        on_line(line.rstrip("\n"))


class Watch:
    """Waits for the processes of a run; Ctrl-C and SIGTERM are passed on to them as SIGINT.

    To be entered before the first of them starts, so that none outlives an early Ctrl-C.
    """

    def __init__(self) -> None:
        self.interrupted = False
        self.failed: Child | None = None  # the first that ended badly
        self.children: list[Child] = []

    def __enter__(self) -> Self:
        self.previous = {
            number: signal.signal(number, self.on_signal)
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self.previous.items():
            signal.signal(number, handler)

    def on_signal(self, *_: object) -> None:
        self.interrupted = True
        self.stop()

    def stop(self) -> None:
        for child in self.children:
            child.process.send_signal(signal.SIGINT)

    def add(self, child: Child) -> None:
        self.children.append(child)
        if self.interrupted:
            child.process.send_signal(signal.SIGINT)

    def wait(self) -> None:
        """Until all have ended; when one ends badly the others are stopped."""
        while alive := [child for child in self.children if child.process.poll() is None]:
            with contextlib.suppress(subprocess.TimeoutExpired):
                alive[0].process.wait(WATCH_S)
            if self.failed is None:
                ended = [child for child in self.children if child.process.poll()]
                self.failed = next(iter(ended), None)
                if self.failed:
                    self.stop()
        for child in self.children:
            child.wait()


def spread(repetitions: int, jobs: int) -> list[tuple[int, int]]:
    """First repetition and number of repetitions of each job."""
    jobs = min(jobs, repetitions)
    share, rest = divmod(repetitions, jobs)
    parts, first = [], 0
    for job in range(jobs):
        count = share + (job < rest)
        parts.append((first, count))
        first += count
    return parts


def run_sil(
    configuration: Configuration,
    config_file: Path,
    level: str,
    jobs: int,
    folder: Path,
    bar: ProgressBar,
) -> Outcome:
    parts = spread(configuration.repetitions, jobs)
    outcome = Outcome()
    began = time.monotonic()
    with Watch() as watch:
        for job, (first, count) in enumerate(parts):
            log = folder / ("run.lcmlog" if len(parts) == 1 else f"run-{job:02d}.lcmlog")
            outcome.logs.append(log)
            command = [
                str(PROGRAMS["sil"]),
                "--config",
                str(config_file),
                "--log",
                str(log),
                "--log-level",
                level,
                "--first-repetition",
                str(first),
                "--repetitions",
                str(count),
            ]
            watch.add(Child(command, line_reader(outcome, bar, job, first)))
        watch.wait()
    outcome.interrupted = watch.interrupted
    outcome.wall_s = time.monotonic() - began
    if watch.failed:
        outcome.reason = "; ".join(watch.failed.errors[-1:]) or describe_status(
            watch.failed.process.returncode
        )
    return outcome


def line_reader(outcome: Outcome, bar: ProgressBar, job: int, first: int) -> Callable[[str], None]:
    def on_line(line: str) -> None:
        if line.startswith("PROGRESS "):
            told = json.loads(line.removeprefix("PROGRESS "))
            told["repetition"] -= first
            bar.update(job, json.dumps(told))
        elif line.startswith("STATS "):
            outcome.stats.append(json.loads(line.removeprefix("STATS ")))

    return on_line


def describe_status(status: int) -> str:
    if status < 0:
        return f"sil was killed by {signal.Signals(-status).name}"
    return f"sil ended with status {status}"


def vcan_plan(
    configuration: Configuration, config_file: Path, level: str, log: Path, realtime: bool
) -> dict[str, Any]:
    config = ["--config", str(config_file)]
    node = [
        str(PROGRAMS["motor_node"]),
        "--joint-ticks",
        str(configuration.joint_ticks),
        "--increments-per-revolution",
        str(configuration.values["joint"]["increments_per_revolution"]),
    ]
    processes = {
        "run_logger": [str(PROGRAMS["run_logger"]), "--log", str(log), "--log-level", level],
        **{f"motor_node {n}": [*node, "--id", str(n)] for n in (1, 2, 3)},
        "hpmc_host": [str(PROGRAMS["hpmc_host"]), *config, "--log-level", level],
        "arm_sim": [str(PROGRAMS["arm_sim"]), *config, *(["--realtime"] if realtime else [])],
    }
    return {"processes": processes}


def sandbox_name() -> str:
    """For `tools/with-vcan --join NAME`, from another terminal."""
    return f"run-{os.getpid()}"


def run_vcan(
    configuration: Configuration,
    config_file: Path,
    level: str,
    folder: Path,
    options: argparse.Namespace,
    bar: ProgressBar,
) -> Outcome:
    outcome = Outcome(logs=[folder / "run.lcmlog"])
    result: dict[str, Any] = {}

    def on_line(line: str) -> None:
        if line.startswith("PROGRESS "):
            bar.update(0, line.removeprefix("PROGRESS "))
        elif line.startswith("RESULT "):
            result.update(json.loads(line.removeprefix("RESULT ")))

    with tempfile.NamedTemporaryFile("w", suffix=".json", dir=folder) as plan:
        json.dump(
            vcan_plan(
                configuration, config_file, level, outcome.logs[0], options.pace == "realtime"
            ),
            plan,
        )
        plan.flush()
        command = [
            str(WITH_VCAN),
            "--name",
            sandbox_name(),
            *(["--uml"] if options.uml else []),
            sys.executable,
            "-I",
            "-S",
            str(LAUNCHER),
            plan.name,
        ]
        with Watch() as watch:
            child = Child(command, on_line)
            watch.add(child)
            watch.wait()
        outcome.interrupted = watch.interrupted
    if not result:
        outcome.reason = " ".join(child.errors[-3:]) or (
            f"the vcan session ended with status {child.process.returncode}"
        )
        return outcome
    outcome.wall_s = result["wall_s"]
    outcome.reason = result["reason"]
    outcome.interrupted = outcome.interrupted or result["interrupted"]
    outcome.stats = list(result["stats"].values())
    return outcome


def total(stats: list[dict[str, Any]], *keys: str) -> int:
    return sum(int(entry.get(key, 0)) for entry in stats for key in keys)


def write_results(
    options: argparse.Namespace,
    configuration: Configuration,
    outcome: Outcome,
    folder: Path,
    level: str,
    console: Console,
) -> None:
    """Analysis is imported here: a run is under way before numpy and matplotlib are loaded."""
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
        mode=options.mode,
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
        if options.pace == "realtime"
        else None,
    )
    summary = build_summary(facts, analysis, geometry)
    if analysis.incomplete:
        console.print(f"{analysis.incomplete} reaches lack samples and are left out")
    for damage in analysis.damage:
        console.print(f"[yellow]{damage}[/]")
    if level == "full":
        write_candump([LcmLog(path) for path in outcome.logs], folder / "candump.log")
    if not options.no_figures:
        from hpmc.figures import draw_all

        draw_all(analysis, folder, geometry)
    # Last, so that a folder with a summary is a complete one.
    write_summary(summary, folder / "summary.json")
    print_summary(summary, console)


def run(options: argparse.Namespace, console: Console) -> int:
    configuration = load_configuration(
        options.experiment, [options.config] if options.config else [], all_overrides(options)
    )
    if options.fixed and NUMBERS != "fixed":
        raise ConfigurationError("--fixed: these programs are made and chosen by ./rig run --fixed")
    if options.mode == "vcan" and options.jobs > 1:
        raise ConfigurationError("--jobs: goes with --mode sil")
    if options.mode == "vcan" and configuration.values["bus"]["command_delay_ms"] > 0:
        raise ConfigurationError("bus.command_delay_ms: goes with --mode sil")
    if options.mode == "sil" and (options.pace != "lockstep" or options.uml):
        raise ConfigurationError("--pace realtime and --uml: go with --mode vcan")
    reaches = configuration.repetitions * REACHES_PER_REPETITION
    level = options.log or ("full" if reaches <= FULL_LOG_REACHES else "states")
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = (options.out or RUNS / f"{now}-{options.experiment}-{options.mode}").absolute()
    check_folder(folder)
    wanted = log_bytes(configuration, level)
    check_space(folder, wanted + candump_bytes(configuration, level))
    config_file = make_folder(folder, configuration)
    fits = (
        ""
        if configuration.bus_load_worst_percent <= 100.0
        else (" (a physical bus would need a slower SYNC)")
    )
    kept = "" if level != "none" else ", removed after the analysis"
    console.print(
        f"{reaches} reaches, {options.mode}; bus load at 1 Mbit/s at worst "
        f"{configuration.bus_load_worst_percent:.1f} %{fits}; "
        f"log {level}, "
        f"about {wanted / 1e6:.0f} MB{kept}"
    )
    if options.mode == "vcan":
        console.print(f"look in meanwhile: tools/with-vcan --join {sandbox_name()} candump vcan0")
    app_level = "full" if level == "full" else "states"
    bar = ProgressBar(console, reaches)
    with bar.bar:
        if options.mode == "sil":
            outcome = run_sil(configuration, config_file, app_level, options.jobs, folder, bar)
        else:
            outcome = run_vcan(configuration, config_file, app_level, folder, options, bar)
    try:
        if outcome.interrupted:
            console.print(f"interrupted; the log up to there: {folder}", soft_wrap=True)
            return EXIT_INTERRUPTED
        if outcome.reason:
            raise RunError(f"{outcome.reason}; the log up to there: {folder}")
        write_results(options, configuration, outcome, folder, level, console)
    finally:
        if level == "none":
            for log in outcome.logs:
                log.unlink(missing_ok=True)
    here = Path.cwd()
    shown = folder.relative_to(here) if folder.is_relative_to(here) else folder
    console.print(f"everything is in {shown}", soft_wrap=True)
    return 0


def main(argv: Sequence[str]) -> int:
    try:
        return run(parse(argv), Console(highlight=False))
    except ConfigurationError as error:
        print(f"rig run: {error}", file=sys.stderr)
        return EXIT_USAGE
    except RunError as error:
        print(f"rig run: {error}", file=sys.stderr)
        return EXIT_RUN_ENDED
