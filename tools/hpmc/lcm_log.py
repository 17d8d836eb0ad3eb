"""Fast reader of LCM event logs (run.lcmlog): any field of a channel as one numpy array.

The file is memory-mapped and only the asked-for fields of the asked-for rows are copied, so a log
may be much larger than memory. Opening it costs one pass over the file for the events' offsets.
A damaged or truncated log is read as far as it can be: `LcmLog.damage` says where it is not. With
`tolerant` single messages that do not have the layout of their type are left out as damage, too.
Source: liblcm, eventlog.c. All numbers of the file are big-endian.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hpmc.lcm_types import (
    FINGERPRINT_BYTES,
    LcmType,
    LcmTypeError,
    load_type,
    member_places,
    overlapping,
    type_of_channel,
)

SYNC_WORD = 0xEDA1DA01
LONGEST_CHANNEL_NAME = 63  # LCM_MAX_CHANNEL_NAME_LENGTH

_HEADER = np.dtype(
    [
        ("sync", ">u4"),
        ("number", ">i8"),
        ("timestamp_us", ">i8"),
        ("channel_length", ">i4"),
        ("data_length", ">i4"),
    ]
)
_SEQ = np.dtype([("fingerprint", ">u8"), ("utime", ">i8"), ("seq", ">i8")])  # begins every type
_SCAN_BYTES = 1 << 24


class LogError(ValueError):
    """A log that cannot be read as asked; the text names the file and the reason."""


@dataclass(frozen=True)
class Damage:
    """Bytes of the file that hold no whole event."""

    offset: int
    length: int


@dataclass(frozen=True)
class _Channel:
    offsets: np.ndarray  # int64, where each message (its fingerprint) begins in the file
    lengths: np.ndarray  # int32, bytes, fingerprint included


class LcmLog:
    """One event log, open for reading.

    `damage` lists the parts that hold no whole event (the cut-off tail of a killed run, mostly),
    and the messages that were left out because `tolerant` asks for it.
    """

    def __init__(self, path: Path | str, *, tolerant: bool = False) -> None:
        self.path = Path(path)
        try:
            if self.path.stat().st_size == 0:
                raise LogError(f"{self.path} is empty")
            self._bytes = np.memmap(self.path, dtype=np.uint8, mode="r")
        except OSError as error:
            raise LogError(f"cannot read {self.path}: {error.strerror}") from None
        starts, self.damage = _find_events(self._bytes)
        if starts.size == 0:
            raise LogError(f"{self.path} is not an LCM log: it holds no whole event")
        self._channels = _group_by_channel(self._bytes, starts)
        if tolerant:
            for channel in self.channels:
                self._leave_out_damaged(channel)
            self.damage.sort(key=lambda damage: damage.offset)

    @property
    def bytes(self) -> np.ndarray:
        """The file, mapped into memory."""
        return self._bytes

    @property
    def channels(self) -> list[str]:
        """Names of the channels, sorted."""
        return sorted(self._channels)

    def count(self, channel: str) -> int:
        """Number of messages of a channel; 0 where the log has none."""
        return self._channels[channel].offsets.size if channel in self._channels else 0

    def size(self, channel: str) -> int:
        """Bytes of the messages of a channel."""
        return int(self._index(channel).lengths.astype(np.int64).sum())

    def column(
        self, channel: str, field: str, start: int = 0, stop: int | None = None
    ) -> np.ndarray:
        """One field of the messages start..stop of a fixed-size channel, in native byte order."""
        records, offsets = self._records(channel)
        column = records[field][offsets[start:stop]]
        return column.astype(column.dtype.newbyteorder("="))

    def read(self, channel: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """The messages start..stop of a fixed-size channel as a record array, native byte order."""
        records, offsets = self._records(channel)
        rows = records[offsets[start:stop]]
        return rows.astype(rows.dtype.newbyteorder("="))

    def messages(self, channel: str) -> Iterator[dict[str, Any]]:
        """Decodes a channel of any type, message by message."""
        lcm_type = load_type(type_of_channel(channel))
        for data in self.raw_messages(channel):
            yield lcm_type.decode(data)

    def raw_messages(self, channel: str) -> Iterator[bytes]:
        """The encoded messages of a channel, fingerprints included."""
        index = self._index(channel)
        for offset, length in zip(index.offsets.tolist(), index.lengths.tolist(), strict=True):
            yield self._bytes[offset : offset + length].tobytes()

    def lost(self, channel: str) -> int:
        """Messages missing inside a channel, by their sequence numbers."""
        index = self._index(channel)
        if int(index.lengths.min()) < _SEQ.itemsize:
            raise LogError(f"{self.path}: {channel} has no sequence number")
        seq = self._overlapping(_SEQ)["seq"][index.offsets].astype(np.int64)
        return int((np.diff(seq) - 1).sum())

    def event_places(self, channel: str) -> np.ndarray:
        """Where the events of a channel begin in the file: sorted they are the order of the log."""
        return self._index(channel).offsets - len(channel.encode()) - _HEADER.itemsize

    def timestamps_us(self, channel: str) -> np.ndarray:
        """Time stamps by the logger: the rig's own gives run clock, lcm-logger wall clock."""
        stamps = self._overlapping(_HEADER)["timestamp_us"][self.event_places(channel)]
        return stamps.astype(np.int64)

    def known_type(self, channel: str) -> LcmType | None:
        """The type of a channel; None where it has no .lcm file, or was written with another."""
        try:
            lcm_type = load_type(type_of_channel(channel))
            self._check_fingerprint(channel, lcm_type)
        except (LcmTypeError, LogError):
            return None
        return lcm_type

    def at_offsets(self, offsets: np.ndarray, dtype: np.dtype) -> np.ndarray:
        """Records of `dtype` copied from the given places of the file."""
        return self._overlapping(dtype)[offsets]

    def message_places(self, channel: str) -> tuple[np.ndarray, np.ndarray]:
        """Where the messages of a channel begin in the file, and their lengths in bytes."""
        index = self._index(channel)
        self._check_fingerprint(channel, load_type(type_of_channel(channel)))
        return index.offsets, index.lengths

    def _leave_out_damaged(self, channel: str) -> None:
        """Keeps the messages of a known type that have its fingerprint and its size."""
        index = self._channels[channel]
        try:
            lcm_type = load_type(type_of_channel(channel))
        except LcmTypeError:
            return
        whole = index.lengths >= FINGERPRINT_BYTES
        if whole.any():
            places = np.where(whole, index.offsets, index.offsets[whole.argmax()])
            whole &= self._overlapping(np.dtype(">u8"))[places] == lcm_type.fingerprint
        if not whole.any():
            return  # another type, or another version of it
        if lcm_type.dtype is not None:
            whole &= index.lengths == FINGERPRINT_BYTES + lcm_type.dtype.itemsize
        else:
            rows = np.flatnonzero(whole)
            first = index.offsets[rows] + FINGERPRINT_BYTES
            ends = index.offsets[rows] + index.lengths[rows]
            try:
                whole[rows] = member_places(lcm_type, self._bytes, first, ends).whole
            except LcmTypeError:
                return  # a layout that only the decoder knows
        if whole.all():
            return
        self.damage += [
            Damage(int(index.offsets[row]), int(index.lengths[row]))
            for row in np.flatnonzero(~whole)
        ]
        if whole.any():
            self._channels[channel] = _Channel(index.offsets[whole], index.lengths[whole])
        else:
            del self._channels[channel]

    def _records(self, channel: str) -> tuple[np.ndarray, np.ndarray]:
        index = self._index(channel)
        lcm_type = load_type(type_of_channel(channel))
        dtype = lcm_type.dtype
        if dtype is None:
            raise LogError(f"{channel} varies in size: read it with messages()")
        self._check_fingerprint(channel, lcm_type)
        if np.any(index.lengths != FINGERPRINT_BYTES + dtype.itemsize):
            raise LogError(f"{self.path}: a {channel} message has not the size of {lcm_type.name}")
        return self._overlapping(dtype), index.offsets + FINGERPRINT_BYTES

    def _check_fingerprint(self, channel: str, lcm_type: LcmType) -> None:
        first = int(self._channels[channel].offsets[0])
        found = int.from_bytes(self._bytes[first : first + FINGERPRINT_BYTES].tobytes(), "big")
        if found != lcm_type.fingerprint:
            raise LogError(
                f"{self.path}: {channel} was written with another {lcm_type.name}.lcm "
                f"(fingerprint {found:016x}, here {lcm_type.fingerprint:016x})"
            )

    def _index(self, channel: str) -> _Channel:
        if channel not in self._channels:
            raise LogError(f"{self.path} has no {channel} (it has {', '.join(self.channels)})")
        return self._channels[channel]

    def _overlapping(self, dtype: np.dtype) -> np.ndarray:
        return overlapping(self._bytes, dtype)


def _find_sync_words(buffer: np.ndarray) -> np.ndarray:
    sync = SYNC_WORD.to_bytes(4, "big")
    found = []
    for start in range(0, buffer.size, _SCAN_BYTES):
        part = buffer[start : start + _SCAN_BYTES + len(sync) - 1]
        places = np.flatnonzero(part[: max(part.size - 3, 0)] == sync[0])
        for i in range(1, len(sync)):
            places = places[part[places + i] == sync[i]]
        found.append(places + start)
    places = np.concatenate(found)
    return places[places + _HEADER.itemsize <= buffer.size]


def _find_events(buffer: np.ndarray) -> tuple[np.ndarray, list[Damage]]:
    """Offsets of all whole events, in file order, and what lies between them."""
    starts = _find_sync_words(buffer)
    if starts.size == 0:
        return starts, [Damage(0, buffer.size)]
    headers = overlapping(buffer, _HEADER)
    channel_length = headers["channel_length"][starts].astype(np.int64)
    data_length = headers["data_length"][starts].astype(np.int64)
    ends = starts + _HEADER.itemsize + channel_length + data_length
    sane = (
        (channel_length > 0)
        & (channel_length <= LONGEST_CHANNEL_NAME)
        & (data_length >= 0)
        & (ends <= buffer.size)
    )
    keep = sane.copy()
    overlaps = np.flatnonzero(sane[:-1] & (ends[:-1] > starts[1:]))
    reach = 0  # end of the last event that stays: sync words before it are payload
    for i in overlaps.tolist():
        if starts[i] < reach:
            continue
        end = int(ends[i])
        inside = slice(i + 1, int(np.searchsorted(starts, end)))
        follows = np.searchsorted(starts, end) < starts.size and starts[inside.stop] == end
        if follows or end == buffer.size:
            keep[inside] = False
            reach = end
        else:
            keep[i] = False
    starts, ends = starts[keep], ends[keep]
    edges_from = np.concatenate([[0], ends])
    edges_to = np.concatenate([starts, [buffer.size]])
    gaps = np.flatnonzero(edges_to > edges_from)
    damage = [Damage(int(edges_from[i]), int(edges_to[i] - edges_from[i])) for i in gaps]
    return starts, damage


def _group_by_channel(buffer: np.ndarray, starts: np.ndarray) -> dict[str, _Channel]:
    headers = overlapping(buffer, _HEADER)
    name_length = headers["channel_length"][starts].astype(np.int32)
    data_length = headers["data_length"][starts].astype(np.int32)
    channels: dict[str, _Channel] = {}
    for length in np.unique(name_length).tolist():
        rows = np.flatnonzero(name_length == length)
        names = overlapping(buffer, np.dtype(f"S{length}"))[starts[rows] + _HEADER.itemsize]
        while rows.size:
            same = names == names[0]
            name = bytes(names[0]).decode(errors="replace")
            places = starts[rows[same]] + _HEADER.itemsize + length
            channels[name] = _Channel(places, data_length[rows[same]])
            rows, names = rows[~same], names[~same]
    return channels
