"""The client: lends its terminal or pipes, and its signals, to one command in a sandbox."""

from __future__ import annotations

import errno
import fcntl
import os
import select
import signal
import socket
import stat
import struct
import sys
import termios
import tty

from vcan import frames
from vcan.frames import Request, frame

PASSED_SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    signal.SIGHUP,
    signal.SIGQUIT,
    signal.SIGUSR1,
    signal.SIGUSR2,
)


def terminal_size() -> tuple[int, int]:
    for fd in (1, 2, 0):
        try:
            rows, columns, _, _ = struct.unpack(
                "HHHH", fcntl.ioctl(fd, termios.TIOCGWINSZ, struct.pack("HHHH", 0, 0, 0, 0))
            )
        except OSError:
            continue
        return rows, columns
    return 24, 80


class Client:
    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.to_hub = bytearray()
        self.credit = frames.WINDOW
        self.stdin_open = True
        self.out = {1: bytearray(), 2: bytearray()}
        self.receipts = {1: frames.Receipt(1, 1), 2: frames.Receipt(1, 2)}
        self.result: tuple[int, str] | None = None
        self.is_tty = [os.isatty(fd) for fd in (0, 1, 2)]
        self.is_tty[0] = self.is_tty[0] and (self.is_tty[1] or self.is_tty[2])
        self.wake_in, wake_out = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        for number in (*PASSED_SIGNALS, signal.SIGWINCH):
            signal.signal(number, lambda *_: None)
        signal.set_wakeup_fd(wake_out, warn_on_full_buffer=False)

    def run(self, argv: list[str]) -> tuple[int, str]:
        """Runs argv in the sandbox: exit status and a text to show."""
        umask = os.umask(0)
        os.umask(umask)
        request = Request(
            [os.fsencode(argument) for argument in argv],
            dict(os.environb),
            os.getcwdb(),
            umask,
            self.is_tty,
            terminal_size(),
        )
        self.send(frames.RUN, 0, request.to_bytes())
        saved = None
        if self.is_tty[0] and os.tcgetpgrp(0) == os.getpgrp():
            saved = termios.tcgetattr(0)
            tty.setraw(0)
        try:
            self.relay()
        finally:
            if saved is not None:
                termios.tcsetattr(0, termios.TCSADRAIN, saved)
        assert self.result is not None
        return self.result

    def send(self, kind: int, stream: int = 0, payload: bytes = b"") -> None:
        self.to_hub += frame(1, kind, stream, payload)

    def relay(self) -> None:
        deframer = frames.Deframer()
        self.socket.setblocking(False)
        while self.result is None or self.out[1] or self.out[2]:
            poll = select.poll()
            poll.register(self.wake_in, select.POLLIN)
            if self.result is None:
                wanted = select.POLLIN | (select.POLLOUT if self.to_hub else 0)
                poll.register(self.socket, wanted)
                if self.stdin_open and self.credit > 0:
                    poll.register(0, select.POLLIN)
            for stream, data in self.out.items():
                if data:
                    poll.register(stream, select.POLLOUT)
            for fd, events in poll.poll():
                if fd == self.wake_in:
                    self.pass_signals(os.read(self.wake_in, 64))
                elif fd == 0:
                    self.take_stdin()
                elif fd in self.out:
                    self.write_out(fd)
                elif events & select.POLLOUT:
                    try:
                        del self.to_hub[: self.socket.send(self.to_hub)]
                    except OSError:
                        self.to_hub.clear()
                else:
                    self.receive(deframer)

    def receive(self, deframer: frames.Deframer) -> None:
        try:
            data = self.socket.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.result = 125, "the sandbox is gone"
        for _, kind, stream, payload in deframer.feed(data):
            if kind == frames.DATA and stream in self.out:
                self.out[stream] += payload
            elif kind == frames.ACK:
                self.credit += frames.U32.unpack(payload)[0]
            elif kind == frames.CLOSE and stream == 0:
                self.stdin_open = False
            elif kind == frames.EXIT:
                self.result = frames.read_exit(payload)

    def pass_signals(self, numbers: bytes) -> None:
        for number in numbers:
            if number == signal.SIGWINCH:
                self.send(frames.WINSIZE, 0, frames.SIZE.pack(*terminal_size()))
            elif number in PASSED_SIGNALS:
                self.send(frames.SIGNAL, 0, frames.U32.pack(number))
                if self.result is not None:
                    raise KeyboardInterrupt

    def take_stdin(self) -> None:
        try:
            data = os.read(0, min(frames.CHUNK, self.credit))
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self.credit -= len(data)
            self.send(frames.DATA, 0, data)
        else:
            self.stdin_open = False
            self.send(frames.CLOSE, 0)

    def write_out(self, fd: int) -> None:
        """Writes no more than a pipe that is writable takes at once, so signals get through."""
        data = self.out[fd]
        size = 65536 if stat.S_ISREG(os.fstat(fd).st_mode) else select.PIPE_BUF
        try:
            count = os.write(fd, data[:size])
        except BlockingIOError:
            return
        except OSError as error:  # our reader is gone, or the disk is full
            data.clear()
            self.send(frames.CLOSE, fd)
            if error.errno != errno.EPIPE:
                print(f"with-vcan: output: {error.strerror}", file=sys.stderr)
            return
        del data[:count]
        self.to_hub += self.receipts[fd].take(count)
