"""Where frames come from: an interface, the sandbox of a vcan run, a recording."""

import errno
import itertools
import os
import re
import selectors
import signal
import socket
import struct
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Protocol, Self

import can

from hpmc.candump import CandumpReader, Frame, candump_lines, parse_line
from hpmc.layout import RUNS, WITH_VCAN
from hpmc.lcm_log import LcmLog, LogError
from hpmc.run_folder import RunFolder

SANDBOX_INTERFACE = "vcan0"
_ARPHRD_CAN = 280
_BUFFER_BYTES = 8 << 20
_BATCH_FRAMES = 2000
_PIPE_BYTES = 1 << 16
_PROBED_LINES = 1000
_END_S = 5.0
_GONE = (errno.ENODEV, errno.ENETDOWN, errno.ENXIO)
# linux/can.h, linux/socket.h: what Python's socket module does not name
_FRAME = struct.Struct("=IB3x8s")
_SO_RXQ_OVFL = 40
_SO_TIMESTAMPNS = 35
_CAN_RAW_ERR_FILTER = 2
_EFF_FLAG, _RTR_FLAG, _ERR_FLAG = 0x80000000, 0x40000000, 0x20000000
_ALL_ERRORS = 0x1FFFFFFF
_COUNTER = struct.Struct("=I")
_TIMESPEC = struct.Struct("@qq")
_DROPS = re.compile(r"DROPCOUNT: .*total drops (\d+)")


class SourceError(ValueError):
    """WHERE is nothing that frames come from: one line."""


class SourceGone(RuntimeError):
    """The interface has vanished while it was listened to: one line."""


class Live(Protocol):
    """Frames as they come; `dropped` counts those that the kernel could not keep for us."""

    name: str
    dropped: int
    damaged: int

    def __enter__(self) -> Self: ...
    def __exit__(self, *_: object) -> None: ...
    def read(self, timeout_s: float) -> list[Frame]:
        """What has come; an empty list after timeout_s. Raises SourceGone."""
        ...


class Recording:
    """A file of `candump -L`, or the CAN_FRAMES of a run."""

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self._logs: list[LcmLog] = []
        self._file = path
        self.problems: list[str] = []
        self.reader = CandumpReader()
        if path.is_dir() and (path / "candump.log").is_file():
            self._file = path / "candump.log"
        elif path.is_dir() or path.suffix == ".lcmlog":
            try:
                run = RunFolder(path)
            except LogError as error:
                raise SourceError(str(error)) from None
            self.problems = list(run.problems)
            self._logs = [log for log in run.logs if log.count("CAN_FRAMES")]
            if not self._logs:
                raise SourceError(
                    f"{path}: no candump.log and no CAN_FRAMES (--log full keeps them)"
                )
        if self._logs:
            return
        try:
            with self._file.open(errors="replace") as file:
                if not any(map(parse_line, itertools.islice(file, _PROBED_LINES))):
                    raise SourceError(f"{self._file}: is not in the format of candump -L")
        except OSError as error:
            raise SourceError(f"{self._file}: cannot be read: {error.strerror}") from None

    def frames(self) -> Iterator[Frame]:
        """All of them."""
        for log in self._logs:
            for lines in candump_lines(log):
                yield from self.reader.frames(lines)
        if not self._logs:
            with self._file.open(errors="replace") as file:
                yield from self.reader.frames(file)


class Interface:
    """A CAN interface of this machine."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.dropped = 0
        self.damaged = 0  # never: the kernel hands out whole frames

    def __enter__(self) -> Self:
        try:
            self._bus = can.Bus(interface="socketcan", channel=self.name)
        except (OSError, can.CanError) as error:
            raise SourceError(f"{self.name}: cannot be listened to: {error}") from None
        try:
            self._socket: socket.socket = self._bus.socket
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            self._socket.setsockopt(
                socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, struct.pack("=I", _ALL_ERRORS)
            )
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._socket.setblocking(False)
        except OSError as error:
            self._bus.shutdown()
            raise SourceError(f"{self.name}: cannot be listened to: {error}") from None
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._socket, selectors.EVENT_READ)
        return self

    def __exit__(self, *_: object) -> None:
        self._selector.close()
        self._bus.shutdown()

    def read(self, timeout_s: float) -> list[Frame]:
        frames: list[Frame] = []
        if not self._selector.select(timeout_s):
            return frames
        try:
            while len(frames) < _BATCH_FRAMES:
                data, ancillary, _, _ = self._socket.recvmsg(_FRAME.size, 256)
                time_s = 0.0
                for _, kind, value in ancillary:
                    if kind == _SO_TIMESTAMPNS:
                        seconds, nanos = _TIMESPEC.unpack(value)
                        time_s = seconds + nanos * 1e-9
                    elif kind == _SO_RXQ_OVFL:
                        (self.dropped,) = _COUNTER.unpack(value)
                frames.append(_unpack(data, time_s))
        except BlockingIOError:
            pass
        except OSError as error:
            if error.errno in _GONE:
                raise SourceGone(f"{self.name} has gone: {error.strerror}") from None
            raise
        return frames


def _unpack(data: bytes, time_s: float) -> Frame:
    identifier, length, payload = _FRAME.unpack(data)
    mask = 0x1FFFFFFF if identifier & (_EFF_FLAG | _ERR_FLAG) else 0x7FF
    return Frame(
        time_s, identifier & mask | identifier & _ERR_FLAG, payload[: min(length, 8)],
        bool(identifier & _ERR_FLAG), bool(identifier & _RTR_FLAG),
    )  # fmt: skip


class Sandbox:
    """The bus of a sandbox: candump inside, which costs the run little; words are made outside."""

    def __init__(self, sandbox: str) -> None:
        self.name = f"{SANDBOX_INTERFACE} of {sandbox}"
        self.dropped = 0
        self.damaged = 0
        self._sandbox = sandbox
        self._rest = b""

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [str(WITH_VCAN), "--join", self._sandbox, "candump", "-L", "-d",
             "-r", str(_BUFFER_BYTES), f"{SANDBOX_INTERFACE},0~0,#{_ALL_ERRORS:08X},0:0"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            start_new_session=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._process.stdout, selectors.EVENT_READ)
        return self

    def __exit__(self, *_: object) -> None:
        self._selector.close()
        with suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGTERM)
        try:
            self._process.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()

    def read(self, timeout_s: float) -> list[Frame]:
        if not self._selector.select(timeout_s):
            return []
        assert self._process.stdout is not None
        chunk = os.read(self._process.stdout.fileno(), _PIPE_BYTES)
        if not chunk:
            try:
                _, said = self._process.communicate(timeout=_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                _, said = self._process.communicate()
            words = said.decode(errors="replace").strip().splitlines()
            raise SourceGone(f"{self.name} has gone{': ' + words[-1] if words else ''}")
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        frames = []
        for line in lines:
            text = line.decode(errors="replace")
            frame = parse_line(text)
            if frame is not None:
                frames.append(frame)
            elif drops := _DROPS.search(text):
                self.dropped = int(drops[1])
            elif text.strip():
                self.damaged += 1
        return frames


def find_source(where: str | None) -> Recording | Interface | Sandbox:
    """What WHERE names; without it the one bus that is there. Raises SourceError."""
    if where is None:
        return _only_one()
    for path in (Path(where), RUNS / where):
        if path.exists():
            return Recording(path)
    if where in sandboxes():
        return Sandbox(where)
    if where in interfaces():
        if _is_down(where):
            raise SourceError(f"{where} is down: ip link set {where} up")
        return Interface(where)
    raise SourceError(
        f"{where}: is no CAN interface, no sandbox, no run and no file here{_what_is_there()}"
    )


def interfaces() -> list[str]:
    """CAN interfaces of this machine, sorted."""
    found = []
    for kind in Path("/sys/class/net").glob("*/type"):
        with suppress(OSError):
            if int(kind.read_text()) == _ARPHRD_CAN:
                found.append(kind.parent.name)
    return sorted(found)


def sandboxes() -> list[str]:
    """Names of this user's sandboxes (tools/with-vcan --name), a run's and others."""
    prefix = rf"@with-vcan/{os.geteuid()}/([\w.-]+)$"
    names = re.findall(prefix, Path("/proc/net/unix").read_text(), re.MULTILINE)
    return sorted(set(names))


def _is_down(interface: str) -> bool:
    try:
        return not int(Path("/sys/class/net", interface, "flags").read_text(), 0) & 1
    except OSError:
        return True


def _only_one() -> Interface | Sandbox:
    names = [*sandboxes(), *(name for name in interfaces() if not _is_down(name))]
    if len(names) == 1:
        return Sandbox(names[0]) if names[0] in sandboxes() else Interface(names[0])
    if names:
        raise SourceError(f"there are several buses: say which of {', '.join(names)}")
    raise SourceError(
        "there is no bus: no CAN interface, and no vcan run of yours is going on; "
        "a recorded one: ./rig can RUN"
    )


def _what_is_there() -> str:
    names = [*sandboxes(), *interfaces()]
    return f" (there are {', '.join(names)})" if names else ""
