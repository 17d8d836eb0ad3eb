"""`./rig log`: looks into the logs of a run; see docs/logs.md."""

import argparse
import dataclasses
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from hpmc.lcm_log import LogError
from hpmc.log_export import FORMATS, Selection, export, exportable
from hpmc.output import quiet_pipe
from hpmc.run_folder import RunFolder

EXIT_DIFFERENT = 1
EXIT_USAGE = 2
TOLD_EACH_S = 5.0  # progress where there is no terminal


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise LogError(f"{message} (see {self.prog} --help)")


def parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(prog="./rig log", allow_abbrev=False, description="Looks into a run.")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    run_help = "folder of a run, or any LCM log"

    info = commands.add_parser("info", allow_abbrev=False, help="what it holds, what is missing")
    info.add_argument("run", type=Path, metavar="RUN", help=run_help)
    info.add_argument("--json", action="store_true", help="for programs")

    show = commands.add_parser("show", allow_abbrev=False, help="messages as a table")
    show.add_argument("run", type=Path, metavar="RUN", help=run_help)
    show.add_argument("--channel", required=True, action="append", metavar="NAME",
                      help="again for more, one table each")  # fmt: skip
    show.add_argument("--fields", default="", metavar="A,B[0],...",
                      help="a whole array by its name, one of its elements by an index; "
                      "default: all")  # fmt: skip
    show.add_argument("--every", type=positive, default=1, metavar="N", help="each N-th row")
    show.add_argument("--csv", action="store_true", help="comma-separated, numbers in full")
    add_range(show)

    plot = commands.add_parser("plot", allow_abbrev=False, help="fields over time")
    plot.add_argument("run", type=Path, metavar="RUN", help=run_help)
    plot.add_argument("fields", nargs="+", metavar="CHANNEL.FIELD",
                      help="e.g. HPMC_STATE.x_d_m, ARM_STATE.q_rad[0]")  # fmt: skip
    plot.add_argument("-o", "--out", type=Path, metavar="FILE",
                      help=".png, .pdf or .svg; without it a window opens")  # fmt: skip
    add_range(plot)

    diff = commands.add_parser("diff", allow_abbrev=False,
                               help="where two runs differ; exit status 1 if they do")  # fmt: skip
    diff.add_argument("run", type=Path, metavar="RUN1", help=run_help)
    diff.add_argument("other", type=Path, metavar="RUN2")
    diff.add_argument("--channel", action="append", default=[], metavar="NAME",
                      help="only this one, again for more")  # fmt: skip

    exporter = commands.add_parser("export", allow_abbrev=False, help="as files for other programs")
    exporter.add_argument("run", type=Path, metavar="RUN", help=run_help)
    exporter.add_argument("--to", required=True, choices=FORMATS)
    exporter.add_argument("--channel", action="append", default=[], metavar="NAME",
                          help="only this one, again for more")  # fmt: skip
    exporter.add_argument("-o", "--out", type=Path, metavar="DIR",
                          help="folder for the files (default: RUN/export)")  # fmt: skip
    add_range(exporter)
    return parser.parse_args(argv)


def add_range(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--from", type=seconds, dest="from_s", metavar="S",
                        help="s of the run clock")  # fmt: skip
    # --to of export names the format
    parser.add_argument("--until" if parser.prog.endswith("export") else "--to", type=seconds,
                        dest="to_s", metavar="S", help="s of the run clock, included")  # fmt: skip


def seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a time in s")
    return value


def positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number from 1 on")
    return int(text)


class Work:
    """A bar on standard error; where that is no terminal, a line now and then."""

    def __init__(self, total: int, unit: str) -> None:
        self.console = Console(stderr=True, highlight=False)
        self.total, self.unit = total, unit
        self.done, self.told = 0, time.monotonic()
        self.bar = Progress(
            TextColumn("{task.description}"), BarColumn(None), TaskProgressColumn(),
            TimeRemainingColumn(), console=self.console, transient=True,
            disable=not self.console.is_terminal,
        )  # fmt: skip
        self.task = self.bar.add_task("", total=total)

    def advance(self, what: str, count: int) -> None:
        self.done += count
        self.bar.update(self.task, description=what, completed=self.done)
        if not self.console.is_terminal and time.monotonic() - self.told > TOLD_EACH_S:
            self.told = time.monotonic()
            self.console.print(f"{what}: {self.done}/{self.total} {self.unit}")


def log_info(options: argparse.Namespace) -> int:
    from hpmc.log_info import describe, print_description

    description = describe(RunFolder(options.run))
    if options.json:
        print(json.dumps(dataclasses.asdict(description), indent=2, default=str))
    else:
        print_description(description, console())
    return 0


def log_show(options: argparse.Namespace) -> int:
    from hpmc.log_table import Rows, write_csv, write_table

    run = RunFolder(options.run)
    tell_problems(run)
    fields = [field.strip() for field in options.fields.split(",") if field.strip()]
    for channel in options.channel:
        run.columns(channel, fields)  # all is checked before anything is printed
    write = write_csv if options.csv else write_table
    for number, channel in enumerate(options.channel):
        if len(options.channel) > 1:
            print(("\n" if number else "") + channel)
        rows = Rows(channel, fields, options.from_s, options.to_s, options.every)
        write(run, rows, sys.stdout)
    return 0


def log_plot(options: argparse.Namespace) -> int:
    from hpmc.log_plot import read_curves, save_plot, show_plot

    if options.out is None and not has_display():
        raise LogError("there is no display for a window: name a file with -o, e.g. -o plot.png")
    run = RunFolder(options.run)
    tell_problems(run)
    curves = read_curves(run, options.fields, options.from_s, options.to_s)
    if not any(curve.values.size for curve in curves):
        raise LogError(f"{run.path}: no message in this range of time")
    if options.out is None:
        show_plot(curves, str(run.path))
        return 0
    save_plot(curves, str(run.path), options.out)
    print(f"{len(curves)} curves in {options.out}")
    return 0


def log_diff(options: argparse.Namespace) -> int:
    from hpmc.log_diff import compare, print_difference

    one, two = RunFolder(options.run), RunFolder(options.other)
    for run in (one, two):
        tell_problems(run)
    work = Work(max(len(set(one.channels) | set(two.channels)), 1), "channels")
    with work.bar:
        difference = compare(one, two, options.channel, lambda channel: work.advance(channel, 1))
    print_difference(difference, console())
    return 0 if difference.same else EXIT_DIFFERENT


def log_export(options: argparse.Namespace) -> int:
    run = RunFolder(options.run)
    tell_problems(run)
    channels, left_out = exportable(run, list(dict.fromkeys(options.channel)))
    for line in left_out:
        print(f"rig log: {line}", file=sys.stderr)
    beside = run.path / "export" if run.path.is_dir() else run.path.with_suffix(".export")
    folder = options.out or beside
    if folder.exists() and not folder.is_dir():
        raise LogError(f"-o {folder}: is not a folder")
    work = Work(sum(run.count(channel) for channel in channels), "messages")
    with work.bar:
        selection = Selection(channels, options.from_s, options.to_s)
        files = export(run, options.to, selection, folder, work.advance)
    for file in files:
        print(f"{file}  {file.stat().st_size / 1e6:.1f} MB")
    return 0


def tell_problems(run: RunFolder) -> None:
    """Damage goes to standard error: what is printed is the rest."""
    for problem in run.problems:
        print(f"rig log: {problem}", file=sys.stderr)


def has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def console() -> Console:
    """Tables are not folded where nobody looks."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else 110)


COMMANDS = {
    "info": log_info,
    "show": log_show,
    "plot": log_plot,
    "diff": log_diff,
    "export": log_export,
}


def main(argv: Sequence[str]) -> int:
    status = 0
    try:
        with quiet_pipe():
            options = parse(argv)
            check_range(options)
            status = COMMANDS[options.command](options)
    except LogError as error:
        print(f"rig log: {error}", file=sys.stderr)
        return EXIT_USAGE
    return status


def check_range(options: argparse.Namespace) -> None:
    from_s, to_s = getattr(options, "from_s", None), getattr(options, "to_s", None)
    if from_s is not None and to_s is not None and to_s < from_s:
        raise LogError(f"the time range ends ({to_s:g} s) before it begins ({from_s:g} s)")
