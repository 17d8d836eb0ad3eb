"""The format of `candump -L`: candump.log from the CAN_FRAMES of a log, with simulated time, and
frames from such lines.

A CAN_FRAMES message of tick k holds what the nodes sent in tick k-1, then what the host (and the
sensor injection) sent in tick k; each frame is stamped with the tick in which it was sent.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hpmc.lcm_log import LcmLog, LogError
from hpmc.lcm_types import FINGERPRINT_BYTES, load_type

_FIRST_NODE, _LAST_NODE = 1, 3
_WRITE_FRAMES = 200_000
_LINE = re.compile(
    r"\((\d+\.\d+)\)\s+(\S+)\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(R\d?|(?:[0-9A-Fa-f]{2}){0,8})\s*"
    r"(?: [RT])?$"
)
ERROR_FLAG = 0x20000000  # of SocketCAN's identifiers


class Frame(NamedTuple):
    """One frame of a classical bus."""

    time_s: float
    cob_id: int
    data: bytes
    is_error: bool = False  # the controller's own words, no frame of the bus
    is_remote: bool = False


class CandumpReader:
    """Frames from lines; `damaged` counts the lines that hold none, `first_damaged` is one."""

    def __init__(self) -> None:
        self.damaged = 0
        self.first_damaged = 0

    def frames(self, lines: Iterable[str]) -> Iterator[Frame]:
        for number, line in enumerate(lines, start=1):
            frame = parse_line(line)
            if frame is not None:
                yield frame
            elif line.strip():
                self.damaged += 1
                self.first_damaged = self.first_damaged or number


def parse_line(line: str) -> Frame | None:
    """None where the line holds no frame of a classical bus."""
    match = _LINE.match(line.strip())
    if match is None:
        return None
    time_s, _, cob_id, data = match.groups()
    number, remote = int(cob_id, 16), data.startswith("R")
    return Frame(
        float(time_s), number, b"" if remote else bytes.fromhex(data), bool(number & ERROR_FLAG),
        remote,
    )  # fmt: skip


def write_candump(logs: Sequence[LcmLog], path: Path, interface: str = "vcan0") -> int:
    """Writes all frames of the logs, in bus order, and returns their number."""
    written = 0
    with path.open("w") as file:
        for log in logs:
            for lines in candump_lines(log, interface):
                file.writelines(lines)
                written += len(lines)
    return written


def candump_lines(log: LcmLog, interface: str = "vcan0") -> Iterator[list[str]]:
    """The lines of a log, many at a time."""
    utime_us, frames = sent_frames(log)
    for start in range(0, frames.size, _WRITE_FRAMES):
        part = slice(start, start + _WRITE_FRAMES)
        yield _lines(utime_us[part], frames[part], interface)


def sent_frames(log: LcmLog) -> tuple[np.ndarray, np.ndarray]:
    """When each frame of a log was sent (us, run clock), and the frames (can_frame_t)."""
    message, frames = _read_frames(log)
    return _send_times(log, message, frames["sender"]), frames


def _lines(utime: np.ndarray, frames: np.ndarray, interface: str) -> list[str]:
    seconds, micros = np.divmod(utime, 1_000_000)
    data = frames["data"].tobytes().hex().upper()
    return [
        f"({second:010d}.{micro:06d}) {interface} {cob_id:03X}#"
        f"{data[16 * i : 16 * i + 2 * length]}\n"
        for i, (second, micro, cob_id, length) in enumerate(
            zip(
                seconds.tolist(),
                micros.tolist(),
                frames["id"].tolist(),
                frames["len"].tolist(),
                strict=True,
            )
        )
    ]


def _read_frames(log: LcmLog) -> tuple[np.ndarray, np.ndarray]:
    """All frames in order, and for each the number of the message that holds it."""
    offsets, lengths = log.message_places("CAN_FRAMES")
    frame = load_type("can_frame_t").dtype
    if frame is None:
        raise LogError("can_frame_t varies in size")
    head = np.dtype([("utime", ">i8"), ("seq", ">i8"), ("count", ">i4")])
    first = offsets + FINGERPRINT_BYTES
    if np.any(lengths < FINGERPRINT_BYTES + head.itemsize):
        raise LogError(f"{log.path}: a CAN_FRAMES message is too short")
    count = log.at_offsets(first, head)["count"].astype(np.int64)
    if np.any(lengths != FINGERPRINT_BYTES + head.itemsize + count * frame.itemsize):
        raise LogError(f"{log.path}: a CAN_FRAMES message has not the size of its frames")
    message = np.repeat(np.arange(count.size), count)
    number_in_message = np.arange(message.size) - np.repeat(np.cumsum(count) - count, count)
    places = first[message] + head.itemsize + number_in_message * frame.itemsize
    return message, log.at_offsets(places, frame)


def _send_times(log: LcmLog, message: np.ndarray, sender: np.ndarray) -> np.ndarray:
    head = np.dtype([("utime", ">i8")])
    offsets, _ = log.message_places("CAN_FRAMES")
    tick_utime = log.at_offsets(offsets + FINGERPRINT_BYTES, head)["utime"].astype(np.int64)
    from_node = (sender >= _FIRST_NODE) & (sender <= _LAST_NODE)
    return tick_utime[np.where(from_node, np.maximum(message - 1, 0), message)]
