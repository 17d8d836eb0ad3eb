"""A bus at a terminal: a table that renews itself, or plain lines."""

from dataclasses import dataclass

from rich import box
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from hpmc.can.decode import Decoded, decode
from hpmc.can.state import BusState, node_texts
from hpmc.can.words import name_of
from hpmc.candump import Frame

RUN_CLOCK_BELOW_S = 1e6  # time stamps above are those of a wall clock
_EVENTS_SHOWN = 6
_LEAST_ROWS = 4
_FRAME_LINES = 13  # of the picture, beside nodes, events and frames


@dataclass(frozen=True)
class Selection:
    """What is to be shown; rates and load are always those of the whole bus."""

    node: int | None = None
    part: str = ""  # of the name

    def takes(self, frame: Frame) -> bool:
        name, node, _ = name_of(frame.cob_id)
        if frame.is_error:
            return not self.part and self.node is None
        return self._takes(name, node)

    def takes_event(self, event: Decoded) -> bool:
        return self._takes(event.name, event.node)

    def _takes(self, name: str, node: int | None) -> bool:
        if self.node is not None and node != self.node:
            return False
        return self.part.lower() in name.lower()


class Clock:
    """Time stamps of a run clock as they are, those of a wall clock from the first one on."""

    def __init__(self) -> None:
        self._zero_s: float | None = None

    def text(self, time_s: float) -> str:
        if self._zero_s is None:
            self._zero_s = time_s if time_s > RUN_CLOCK_BELOW_S else 0.0
        return f"{time_s - self._zero_s:12.6f}"


def line(frame: Frame, clock: Clock) -> str:
    """A frame as one line of text."""
    decoded = decode(frame)
    return f"{clock.text(frame.time_s)}  {frame.cob_id:03X}  {decoded.name:<14}  {decoded.text}"


def totals(state: BusState, dropped: int, damaged: int, *, live: bool) -> str:
    """What the whole bus does, in one line."""
    first_s = state.first_s or 0.0
    text = (
        f"{state.frames} frames in {state.last_s - first_s:.3f} s, {state.rate_hz:.0f} frames/s, "
        f"load at 1 Mbit/s {state.load_percent:.1f} %"
    )
    if live:
        text += f", {dropped} dropped here"
    if state.errors:
        text += f", {state.errors} error frames"
    if damaged:
        text += f", {damaged} lines that hold no frame"
    return text


def picture(
    name: str, state: BusState, dropped: int, damaged: int, selection: Selection, clock: Clock,
    console: Console, *, live: bool,
) -> Group:  # fmt: skip
    """Nodes, what happened last, and every identifier with its last content."""
    head = Text.assemble((name, "bold"), "  ", totals(state, dropped, damaged, live=live))
    if dropped or state.errors or damaged:
        head.stylize("red", len(name))
    nodes = _nodes(state, selection)
    events = [
        (time_s, event) for time_s, event in state.events if selection.takes_event(event)
    ][-_EVENTS_SHOWN:]
    room = console.size.height - _FRAME_LINES - nodes.row_count - len(events) if live else 1 << 16
    return Group(
        head, nodes, _events(events, clock), _frames(state, selection, max(room, _LEAST_ROWS))
    )


def _table(*heads: str, right: tuple[str, ...] = ()) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, expand=True, show_edge=False)
    for number, head in enumerate(heads):
        last = number == len(heads) - 1
        table.add_column(
            head, justify="right" if head in right else "left", no_wrap=True,
            overflow="ellipsis", ratio=1 if last else None,
        )  # fmt: skip
    return table


def _nodes(state: BusState, selection: Selection) -> Table:
    table = _table("node", "NMT", "drive", "mode, limits", "emergencies")
    for number, node in sorted(state.nodes.items()):
        if selection.node not in (None, number):
            continue
        nmt, drive, mode, emergency = node_texts(node)
        bad = node.emergencies > 0 or drive.startswith("fault")
        table.add_row(
            str(number), nmt, Text(drive, "red" if drive.startswith("fault") else ""), mode,
            Text(emergency, "red" if bad else ""),
        )  # fmt: skip
    return table


def _events(events: list[tuple[float, Decoded]], clock: Clock) -> Table:
    table = _table("time, s", "event", "what", right=("time, s",))
    for time_s, event in events:
        style = "red" if event.service in ("EMCY", "error") or "abort" in event.text else ""
        table.add_row(clock.text(time_s).strip(), event.name, Text(event.text, style))
    return table


def _frames(state: BusState, selection: Selection, room: int) -> Table:
    table = _table("id", "frame", "count", "Hz", "last content", right=("count", "Hz"))
    shown = [
        (cob_id, counter)
        for cob_id, counter in sorted(state.by_id.items())
        if counter.last is not None and selection.takes(counter.last)
    ]
    left_out = len(shown) - room
    for cob_id, counter in shown[: room - 1] if left_out > 0 else shown:
        assert counter.last is not None
        decoded = decode(counter.last)
        table.add_row(
            f"{cob_id:03X}", decoded.name, str(counter.count), f"{counter.rate_hz:.1f}",
            Text(decoded.text),
        )  # fmt: skip
    if left_out > 0:
        table.add_row("", f"{left_out + 1} more", "", "", "a taller window, --node or --filter")
    return table
