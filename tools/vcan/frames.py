"""Frames between client, hub and agent: many sessions over one byte stream.

    client (stdin, stdout, signals) <-unix socket-> hub <-link-> agent (inside the sandbox)

A session is one command or one forwarded TCP connection. A frame is a header (session u32,
kind u8, stream u8, payload length u32, little endian) and the payload. Streams of a session:
0 flows into the sandbox, 1 and 2 flow out. At most WINDOW bytes of a stream are on their way;
the receiver allows more with ACK, so one stuck reader never stops the other sessions.

Session 0 is the link itself. The hub keeps at most LINK_WINDOW bytes on their way to the agent,
so that the serial line of user-mode Linux, which buffers 4096 bytes, never has to throttle:
it sometimes does not wake up again.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

HEADER = struct.Struct("<IBBI")
WINDOW = 256 * 1024
CHUNK = 32 * 1024
LINK_WINDOW = 2048
GRACE_S = 10.0  # from SIGINT or SIGTERM to SIGKILL

HELLO = 0  # agent -> hub: sandbox is set up (empty) or what failed (text)
RUN = 1  # start a command: Request
DIAL = 2  # connect to a TCP port of the sandbox's loopback: u16
DATA = 3
ACK = 4  # receiver has taken bytes: u32
CLOSE = 5  # this side is done with the stream: end of data, or reader gone
SIGNAL = 6  # u32
WINSIZE = 7  # rows u16, columns u16
EXIT = 8  # the session's last frame: status i32, text to show

U16 = struct.Struct("<H")
U32 = struct.Struct("<I")
SIZE = struct.Struct("<HH")
STATUS = struct.Struct("<i")


def frame(session: int, kind: int, stream: int = 0, payload: bytes = b"") -> bytes:
    return HEADER.pack(session, kind, stream, len(payload)) + payload


def exit_frame(session: int, status: int, text: str = "") -> bytes:
    return frame(session, EXIT, 0, STATUS.pack(status) + text.encode())


def read_exit(payload: bytes) -> tuple[int, str]:
    return STATUS.unpack_from(payload)[0], payload[STATUS.size :].decode(errors="replace")


class Receipt:
    """Counts the bytes taken from a stream and makes an ACK of every quarter window."""

    def __init__(self, session: int, stream: int, window: int = WINDOW) -> None:
        self._session, self._stream, self._due = session, stream, window // 4
        self._taken = 0

    def take(self, count: int) -> bytes:
        """The frame to send now, or nothing."""
        self._taken += count
        if self._taken < self._due:
            return b""
        count, self._taken = self._taken, 0
        return frame(self._session, ACK, self._stream, U32.pack(count))


class Deframer:
    """Cuts a byte stream into frames (session, kind, stream, payload)."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[int, int, int, bytes]]:
        self._buffer += data
        while len(self._buffer) >= HEADER.size:
            session, kind, stream, length = HEADER.unpack_from(self._buffer)
            end = HEADER.size + length
            if len(self._buffer) < end:
                return
            payload = bytes(self._buffer[HEADER.size : end])
            del self._buffer[:end]
            yield session, kind, stream, payload


class Request:
    """What a command needs to run: all a process takes over from its parent, but files."""

    LAYOUT = struct.Struct("<IIHH???")  # umask, number of arguments, rows, columns, tty of 0, 1, 2

    def __init__(
        self,
        argv: list[bytes],
        environment: dict[bytes, bytes],
        folder: bytes,
        umask: int,
        tty: list[bool],
        size: tuple[int, int],
    ) -> None:
        self.argv, self.environment, self.folder = argv, environment, folder
        self.umask, self.tty, self.size = umask, tty, size

    def to_bytes(self) -> bytes:
        words = [self.folder, *self.argv, *(k + b"=" + v for k, v in self.environment.items())]
        head = self.LAYOUT.pack(self.umask, len(self.argv), *self.size, *self.tty)
        return head + b"\0".join(words)

    @classmethod
    def from_bytes(cls, data: bytes) -> Request:
        umask, count, rows, columns, *tty = cls.LAYOUT.unpack_from(data)
        folder, *words = data[cls.LAYOUT.size :].split(b"\0")
        pairs = [word.partition(b"=") for word in words[count:]]
        environment = {key: value for key, _, value in pairs}
        return cls(words[:count], environment, folder, umask, tty, (rows, columns))
