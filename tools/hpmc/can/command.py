"""`./rig can`: the bus in words, live or recorded; see docs/can.md."""

import argparse
import contextlib
import itertools
import signal
import sys
import time
from collections.abc import Sequence
from typing import NoReturn

from rich.console import Console
from rich.live import Live as LiveDisplay

from hpmc.can.show import Clock, Selection, line, picture, totals
from hpmc.can.sources import Live, Recording, SourceError, SourceGone, find_source
from hpmc.can.state import BusState
from hpmc.can.words import names
from hpmc.output import quiet_pipe

EXIT_USAGE = 2
EXIT_ENDED = 3
EXIT_INTERRUPTED = 130
_REFRESH_S = 0.25
_BATCH = 5000


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise SourceError(f"{message} (see ./rig can --help)")


def parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="./rig can", allow_abbrev=False,
        description="The CAN bus in words with units: a live table at a terminal, else lines.",
    )  # fmt: skip
    parser.add_argument(
        "where", nargs="?", metavar="WHERE",
        help="CAN interface (can0), sandbox of a vcan run that is going on (run-PID), folder of a "
        "run, or a file of candump -L; left out: the one bus that is there",
    )  # fmt: skip
    parser.add_argument("--node", type=_node_id, metavar="N", help="only frames of this node")
    parser.add_argument("--filter", default="", metavar="NAME",
                        help="only frames with this in their name, e.g. TPDO1, SDO")  # fmt: skip
    parser.add_argument("--lines", action="store_true", help="one line per frame")
    parser.add_argument("--count", type=_positive, metavar="N",
                        help="end after so many frames that are shown")  # fmt: skip
    options = parser.parse_args(argv)
    known = [*names(), *(f"N{node}_{name}" for node in range(1, 128) for name in names()),
             "HOST_heartbeat"]  # fmt: skip
    if not any(options.filter.lower() in name.lower() for name in known):
        raise SourceError(f"--filter {options.filter}: names are N1_TPDO1 and such, made of "
                          f"{', '.join(names())}")  # fmt: skip
    return options


def _node_id(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 127:
        raise argparse.ArgumentTypeError(f"{text}: must be 1 to 127")
    return int(text)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a whole number from 1 on")
    return int(text)


def show_recording(recording: Recording, options: argparse.Namespace, *, lines: bool) -> None:
    """All of its frames as lines, or a table of what the bus did up to its end."""
    state, clock = BusState(), Clock()
    selection = Selection(options.node, options.filter)
    for problem in recording.problems:
        print(f"rig can: {problem}", file=sys.stderr)
    shown = 0
    frames = recording.frames()
    while batch := list(itertools.islice(frames, _BATCH)):
        if options.count is not None:
            batch, shown = _up_to(batch, selection, options.count, shown)
        state.add(batch)
        if lines:
            sys.stdout.writelines(
                line(frame, clock) + "\n" for frame in batch if selection.takes(frame)
            )
        if options.count is not None and shown >= options.count:
            break
    state.measure()
    reader = recording.reader
    if not lines:
        console = Console(highlight=False)
        console.print(picture(
            recording.name, state, 0, reader.damaged, selection, clock, console, live=False
        ))  # fmt: skip
    if reader.damaged:
        print(f"rig can: {recording.name}: {reader.damaged} lines hold no frame, the first is line "
              f"{reader.first_damaged}", file=sys.stderr)  # fmt: skip


def _up_to(batch: list, selection: Selection, most: int, shown: int) -> tuple[list, int]:
    """The part of a batch in which no more than `most` frames are shown in all."""
    for number, frame in enumerate(batch):
        shown += selection.takes(frame)
        if shown >= most:
            return batch[: number + 1], shown
    return batch, shown


def show_live(source: Live, options: argparse.Namespace, *, lines: bool) -> None:
    """Until Ctrl-C, --count, or the end of the interface."""
    state, clock = BusState(), Clock()
    selection = Selection(options.node, options.filter)
    interrupted = False
    try:
        _watch(source, options, state, clock, selection, lines=lines)
    except KeyboardInterrupt:
        interrupted = True
    state.measure(time.monotonic())
    print(f"{source.name}: {totals(state, source.dropped, source.damaged, live=True)}",
          file=sys.stderr)  # fmt: skip
    if interrupted:
        raise KeyboardInterrupt


def _watch(
    source: Live, options: argparse.Namespace, state: BusState, clock: Clock,
    selection: Selection, *, lines: bool,
) -> None:  # fmt: skip
    console = Console(highlight=False)
    shown, drops_told, renewed = 0, 0, time.monotonic()
    state.measure(renewed)
    with contextlib.ExitStack() as stack:
        display = None
        if not lines:
            display = stack.enter_context(LiveDisplay(
                console=console, screen=True, auto_refresh=False, vertical_overflow="crop"
            ))  # fmt: skip
        stack.enter_context(source)
        while options.count is None or shown < options.count:
            batch = source.read(_REFRESH_S)
            if options.count is not None:
                batch, shown = _up_to(batch, selection, options.count, shown)
            state.add(batch)
            if display is None:
                for frame in batch:
                    if selection.takes(frame):
                        print(line(frame, clock))
                if source.dropped > drops_told:
                    print(f"rig can: {source.dropped} frames dropped here so far", file=sys.stderr)
                    drops_told = source.dropped
                sys.stdout.flush()
            now = time.monotonic()
            if now - renewed >= _REFRESH_S:
                renewed = now
                state.measure(now)
                if display is not None:
                    display.update(picture(
                        source.name, state, source.dropped, source.damaged, selection, clock,
                        console, live=True,
                    ), refresh=True)  # fmt: skip


def main(argv: Sequence[str]) -> int:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        with quiet_pipe():
            options = parse(argv)
            source = find_source(options.where)
            lines = options.lines or not sys.stdout.isatty()
            if isinstance(source, Recording):
                show_recording(source, options, lines=lines)
            else:
                show_live(source, options, lines=lines)
    except SourceError as error:
        print(f"rig can: {error}", file=sys.stderr)
        return EXIT_USAGE
    except SourceGone as error:
        print(f"rig can: {error}", file=sys.stderr)
        return EXIT_ENDED
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    return 0
