"""What is known of a bus after the frames so far: rates, load, nodes, what happened."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from hpmc import node_words
from hpmc.can.decode import Decoded, decode
from hpmc.can.load import BIT_RATE, frame_bits
from hpmc.can.words import name_of, statusword_text
from hpmc.candump import Frame

WINDOW_S = 1.0  # that live rates are counted over
EVENTS_KEPT = 200
_EVENT_SERVICES = {"NMT", "EMCY", "SDO_request", "SDO_reply", "LSS_request", "LSS_reply", "error"}


@dataclass
class NodeState:
    """The last that a node said of itself."""

    nmt: int = -1
    statusword: int | None = None
    mode: int | None = None
    limits: int | None = None
    temperature_c: float | None = None
    emergencies: int = 0
    last_emergency: str = ""
    heard_s: float = 0.0


@dataclass
class Counter:
    """Frames of one identifier."""

    count: int = 0
    rate_hz: float = 0.0
    last: Frame | None = None
    first_s: float = 0.0


@dataclass(frozen=True)
class _Mark:
    time_s: float
    counts: dict[int, int]
    bits: int


@dataclass
class BusState:
    """Fed with frames in batches."""

    frames: int = 0
    errors: int = 0
    bits: int = 0
    first_s: float | None = None
    last_s: float = 0.0
    load_percent: float = 0.0
    rate_hz: float = 0.0
    by_id: dict[int, Counter] = field(default_factory=dict)
    nodes: dict[int, NodeState] = field(default_factory=dict)
    events: deque[tuple[float, Decoded]] = field(
        default_factory=lambda: deque(maxlen=EVENTS_KEPT)
    )
    _marks: deque[_Mark] = field(default_factory=deque)

    def add(self, batch: list[Frame]) -> None:
        """Takes frames in, in their order."""
        if not batch:
            return
        if self.first_s is None:
            self.first_s = batch[0].time_s
        self.last_s = batch[-1].time_s
        self.frames += len(batch)
        self.bits += bits_of(batch)
        for frame in batch:
            counter = self.by_id.setdefault(frame.cob_id, Counter(first_s=frame.time_s))
            counter.count += 1
            counter.last = frame
            self.errors += frame.is_error
            self._look_at(frame)

    def _look_at(self, frame: Frame) -> None:
        _, node, service = name_of(frame.cob_id)
        if frame.is_error:
            service = "error"
        data = frame.data
        if service in _EVENT_SERVICES:
            self.events.append((frame.time_s, decode(frame)))
        if node is None or frame.is_error or service in ("RPDO1", "RPDO2", "RPDO4", "SDO_request"):
            return
        state = self.nodes.setdefault(node, NodeState())
        state.heard_s = frame.time_s
        if service == "heartbeat" and data:
            if state.nmt != data[0]:
                self.events.append((frame.time_s, decode(frame)))
            state.nmt = data[0]
        elif service == "TPDO1" and len(data) == 8:
            state.statusword = int.from_bytes(data[6:8], "little")
        elif service == "TPDO2" and len(data) >= 7:
            values = decode(frame).values
            state.mode = int(values["modes_of_operation_display"])
            state.limits = int(values["limit_reasons"])
            state.temperature_c = float(values["motor_temperature"])
        elif service == "EMCY" and len(data) == 8:
            state.emergencies += 1
            state.last_emergency = decode(frame).text

    def measure(self, now_s: float | None = None) -> None:
        """Rates and load: over the last second up to now, or over everything without it."""
        if self.first_s is None:
            return
        if now_s is None:
            span, counts, bits = self.last_s - self.first_s, {}, 0
        else:
            counts = {cob_id: counter.count for cob_id, counter in self.by_id.items()}
            self._marks.append(_Mark(now_s, counts, self.bits))
            while len(self._marks) > 2 and now_s - self._marks[1].time_s >= WINDOW_S:
                self._marks.popleft()
            mark = self._marks[0]
            span, counts, bits = now_s - mark.time_s, mark.counts, mark.bits
        if span <= 0:
            return
        for cob_id, counter in self.by_id.items():
            counter.rate_hz = (counter.count - counts.get(cob_id, 0)) / span
        self.rate_hz = sum(counter.rate_hz for counter in self.by_id.values())
        self.load_percent = 100 * (self.bits - bits) / (span * BIT_RATE)


def bits_of(batch: list[Frame]) -> int:
    """Bits on the wire; error and remote frames, and such with long identifiers, are left out."""
    plain = [f for f in batch if not f.is_error and not f.is_remote and f.cob_id <= 0x7FF]
    if not plain:
        return 0
    ids = np.fromiter((frame.cob_id for frame in plain), np.uint16, len(plain))
    lengths = np.fromiter((len(frame.data) for frame in plain), np.int64, len(plain))
    joined = b"".join(frame.data.ljust(8, b"\0") for frame in plain)
    data = np.frombuffer(joined, np.uint8).reshape(-1, 8)
    return int(frame_bits(ids, lengths, data).sum())


def node_texts(state: NodeState) -> tuple[str, str, str, str]:
    """NMT state, drive state, mode with limits, last emergency."""
    nmt = node_words.nmt_state(state.nmt)
    drive = "" if state.statusword is None else statusword_text(state.statusword)
    limits = ", ".join(node_words.limit_reasons(state.limits or 0))
    mode = "" if state.mode is None else f"mode {state.mode}"
    emergency = f"{state.emergencies} x, last {state.last_emergency}" if state.emergencies else ""
    return nmt, drive, "; ".join(filter(None, (mode, limits))), emergency
