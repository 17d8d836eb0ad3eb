"""What the nodes and the run went through: phases, drive states, limit reasons, emergencies."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hpmc import node_words
from hpmc.can.words import emergency_text
from hpmc.candump import sent_frames
from hpmc.lcm_log import LogError
from hpmc.run_folder import RunFolder

PHASES = ("boot", "configure", "enable", "approach", "reaches", "stop")
STATUS = "NODE_STATUS_"
_EMCY_IDS = (0x081, 0x0FF)
_ENABLED = "operation enabled"
_SATURATED = "desired hand position out of reach: put on the reachable ring"


@dataclass(frozen=True)
class Span:
    """Something that lasted."""

    from_s: float
    to_s: float
    what: str


@dataclass(frozen=True)
class Event:
    """Something that happened."""

    time_s: float
    who: str
    what: str


@dataclass
class Timeline:
    """Of the whole run, s of the run clock."""

    begin_s: float = 0.0
    end_s: float = 0.0
    phases: list[Span] = field(default_factory=list)
    drives: dict[int, list[Span]] = field(default_factory=dict)  # by node
    limits: dict[tuple[int, str], list[Span]] = field(default_factory=dict)  # by node and reason
    limit_share: dict[tuple[int, str], float] = field(default_factory=dict)  # of the time enabled
    emergencies: list[Event] = field(default_factory=list)
    resets: int = 0  # emergencies with code 0: the error is gone
    changes: list[Event] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    last: dict[int, dict[str, Any]] = field(default_factory=dict)  # NODE_STATUS of each node


def read_timeline(run: RunFolder) -> Timeline:
    """From NODE_STATUS, CAN_FRAMES and HPMC_STATE, as far as they are there."""
    line = Timeline()
    if run.count("HPMC_STATE") and run.type_of("HPMC_STATE"):
        _read_phases(run, line)
    nodes = sorted(int(c.removeprefix(STATUS)) for c in run.channels if c.startswith(STATUS))
    for node in nodes:
        if run.type_of(f"{STATUS}{node}"):
            _read_node(run, node, line)
    if not nodes:
        line.notes.append(
            "There is no NODE_STATUS in the log (--log states leaves it out): limit reasons are "
            "not known, drive states are those of HPMC_STATE."
        )
        _read_drives_from_states(run, line)
    _read_emergencies(run, line)
    line.changes.sort(key=lambda event: event.time_s)
    return line


def _spans(time_s: np.ndarray, values: np.ndarray, end_s: float) -> list[tuple[float, float, int]]:
    """Where a value stays the same: from, to, value."""
    if values.size == 0:
        return []
    first = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    ends = np.append(time_s[first[1:]], end_s)
    return list(zip(time_s[first].tolist(), ends.tolist(), values[first].tolist(), strict=True))


def _read_phases(run: RunFolder, line: Timeline) -> None:
    time_s = run.utime_us("HPMC_STATE") / 1e6
    line.begin_s, line.end_s = float(time_s.min()), float(time_s.max())
    phase = run.column("HPMC_STATE", "phase").astype(int)
    for from_s, to_s, value in _spans(time_s, phase, line.end_s):
        name = PHASES[value] if 0 <= value < len(PHASES) else f"phase {value}"
        line.phases.append(Span(from_s, to_s, name))
        line.changes.append(Event(from_s, "run", name))
    saturated = run.column("HPMC_STATE", "saturated").astype(int)
    for from_s, to_s, value in _spans(time_s, saturated, line.end_s):
        if value:
            line.changes.append(Event(from_s, "run", f"{_SATURATED}, {to_s - from_s:.3f} s"))


def _read_node(run: RunFolder, node: int, line: Timeline) -> None:
    channel = f"{STATUS}{node}"
    time_s = run.utime_us(channel) / 1e6
    line.begin_s = min(line.begin_s, float(time_s.min()))
    line.end_s = max(line.end_s, float(time_s.max()))
    # The last message of each channel holds the counters at the end.
    names = ("nmt_state", "statusword", "limit_reasons", "missed_sync", "temperature_dC",
             "emcy_code", "emcy_count")  # fmt: skip
    columns = {name: run.column(channel, name).astype(int) for name in names}
    line.last[node] = {name: int(values[-1]) for name, values in columns.items()}
    line.last[node]["temperature_max_C"] = float(columns["temperature_dC"].max()) / 10
    words = columns["statusword"] & node_words.WORD
    _read_drive(node, time_s, words, line)
    for from_s, _, value in _spans(time_s, columns["nmt_state"], line.end_s):
        line.changes.append(Event(from_s, f"node {node}", f"NMT {node_words.nmt_state(value)}"))
    enabled = np.array([node_words.drive_state(word) == _ENABLED for word in range(1 << 7)])
    is_enabled = enabled[words & 0x7F]
    reasons = columns["limit_reasons"] & node_words.WORD
    for bit in range(16):
        on = reasons >> bit & 1
        if not on.any():
            continue
        (name,) = node_words.limit_reasons(1 << bit)
        line.limits[node, name] = [
            Span(from_s, to_s, name) for from_s, to_s, value in _spans(time_s, on, line.end_s)
            if value
        ]  # fmt: skip
        share = float(on[is_enabled].mean()) if is_enabled.any() else 0.0
        line.limit_share[node, name] = share


def _read_drive(node: int, time_s: np.ndarray, words: np.ndarray, line: Timeline) -> None:
    known, number = np.unique(words & 0x6F, return_inverse=True)
    names = [node_words.drive_state(int(word)) for word in known]
    ids = np.array([names.index(name) for name in names])
    for from_s, to_s, value in _spans(time_s, ids[number], line.end_s):
        line.drives.setdefault(node, []).append(Span(from_s, to_s, names[value]))
        line.changes.append(Event(from_s, f"node {node}", names[value]))


def _read_drives_from_states(run: RunFolder, line: Timeline) -> None:
    if not run.count("HPMC_STATE") or not run.type_of("HPMC_STATE"):
        return
    time_s = run.utime_us("HPMC_STATE") / 1e6
    words = run.column("HPMC_STATE", "statusword").astype(int) & node_words.WORD
    for joint in range(words.shape[1]):
        _read_drive(joint + 1, time_s, words[:, joint], line)


def _read_emergencies(run: RunFolder, line: Timeline) -> None:
    """Each with register, source and detail where the frames are there, else the last code."""
    found_frames = False
    for log in run.logs:
        if not log.count("CAN_FRAMES") or log.known_type("CAN_FRAMES") is None:
            continue
        try:
            utime, frames = sent_frames(log)
        except LogError as error:
            line.notes.append(str(error))
            continue
        found_frames = True
        is_emergency = (frames["id"] >= _EMCY_IDS[0]) & (frames["id"] <= _EMCY_IDS[1])
        for row in np.flatnonzero(is_emergency & (frames["len"] == 8)).tolist():
            data = frames["data"][row].tobytes()
            _add_emergency(line, utime[row] / 1e6, int(frames["id"][row]) & 0x7F, data)
    if found_frames:
        return
    for node in line.last:
        channel = f"{STATUS}{node}"
        time_s, count = run.utime_us(channel) / 1e6, run.column(channel, "emcy_count").astype(int)
        code = run.column(channel, "emcy_code").astype(int)
        for row in (np.flatnonzero(np.diff(count, prepend=0) > 0)).tolist():
            data = int(code[row]).to_bytes(2, "little") + bytes(6)
            _add_emergency(line, float(time_s[row]), node, data)


def _add_emergency(line: Timeline, time_s: float, node: int, data: bytes) -> None:
    if data[:2] == b"\0\0":
        line.resets += 1
        line.changes.append(Event(time_s, f"node {node}", "all errors are gone"))
    else:
        line.emergencies.append(Event(time_s, f"node {node}", emergency_text(data)))
