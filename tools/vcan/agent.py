#!/usr/bin/python3 -IS
"""Process 1 of the sandbox: starts commands and carries their streams over the link.

In user-mode Linux it is init and the link is a serial line; natively it is the first process of
the namespaces and the link is a socket. It sleeps in poll() unless there is something to carry.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import select
import signal
import socket
import struct
import sys
import termios
import time
import tty

if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

from vcan import frames, network
from vcan.frames import Request, frame

LEFTOVER_GRACE_S = 1.0  # for what a command leaves in the background
DRAIN_S = 2.0  # for a connection without a reader, once the main command has ended
ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
LCM_URL = b"udpm://239.255.76.67:7667?ttl=0"
RB_POWER_OFF = 0x4321FEDC
FIONREAD = termios.FIONREAD
MODULES = "/usr/lib/uml/modules"

libc = ctypes.CDLL(None, use_errno=True)


class SetupError(Exception):
    """The sandbox cannot be set up; the text says why."""


def check(result: int, what: str) -> int:
    if result == -1:
        raise SetupError(f"{what}: {os.strerror(ctypes.get_errno())}")
    return result


def mount(kind: str, target: str, options: str = "") -> None:
    arguments = (kind.encode(), target.encode(), kind.encode(), ctypes.c_ulong(0), options.encode())
    check(libc.mount(*arguments), f"mount {kind} on {target}")


def set_up_machine() -> None:
    """Mounts, kernel modules and limits of a freshly booted user-mode Linux."""
    mount("proc", "/proc")
    mount("sysfs", "/sys")
    mount("tmpfs", "/run", "mode=755")
    for folder in ("/dev/pts", "/dev/shm"):
        os.makedirs(folder, exist_ok=True)
    mount("devpts", "/dev/pts", "ptmxmode=666,mode=620")
    mount("tmpfs", "/dev/shm", "mode=1777")
    for link, target in (("fd", ""), ("stdin", "/0"), ("stdout", "/1"), ("stderr", "/2")):
        os.symlink(f"/proc/self/fd{target}", f"/dev/{link}")
    finit_module = 313  # x86_64, the one architecture of the package's 64-bit kernel
    folder = f"{MODULES}/{os.uname().release}/kernel"
    for module in (
        "net/can/can.ko",
        "net/can/can-raw.ko",
        "net/can/can-bcm.ko",  # cyclic transmission, as python-can uses it
        "drivers/net/can/dev/can-dev.ko",
        "drivers/net/can/vcan.ko",
        "drivers/net/can/slcan/slcan.ko",
    ):
        try:
            fd = os.open(f"{folder}/{module}", os.O_RDONLY)
        except FileNotFoundError:
            if "slcan" in module:
                continue
            raise SetupError(f"{folder}/{module} is missing") from None
        check(libc.syscall(finit_module, fd, b"", 0), f"insmod {module}")
        os.close(fd)
    for key, value in (
        ("net/core/rmem_max", 64 << 20),
        ("net/core/rmem_default", 64 << 20),
        ("net/core/netdev_max_backlog", 30000),
    ):
        with open(f"/proc/sys/{key}", "w", encoding="ascii") as file:
            file.write(str(value))


class Outlet:
    """Carries what it reads from a file descriptor into the link, within the window."""

    def __init__(self, fd: int, session: Session, stream: int) -> None:
        self.fd, self.session, self.stream = fd, session, stream
        self.credit = frames.WINDOW
        self.left: int | None = None  # bytes still to carry once the command has ended


class Session:
    """A command or a TCP connection: `into` takes stream 0, `outlets` give streams 1 and 2."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.pid = 0  # 0: a TCP connection
        self.into = -1
        self.pending = bytearray()
        self.receipt = frames.Receipt(number, 0)
        self.into_ends = False
        self.terminal = -1
        self.outlets: dict[int, Outlet] = {}
        self.status: int | None = None
        self.kill_at: float | None = None


class Agent:
    def __init__(self, link: int) -> None:
        self.link = link
        self.sessions: dict[int, Session] = {}
        self.readers: dict[int, Outlet] = {}
        self.writers: dict[int, Session] = {}
        self.main: Session | None = None
        self.done = False
        self.drain_until: float | None = None  # the main command has ended, connections still flow
        self.wake_in, wake_out = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        for number in ENDING_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(wake_out, warn_on_full_buffer=False)
        self.poll = select.poll()
        self.poll.register(self.wake_in, select.POLLIN)
        self.poll.register(link, select.POLLIN)

    def send(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[os.write(self.link, view) :]

    def serve(self) -> None:
        """Runs until the main command's exit is reported or the link is gone."""
        deframer = frames.Deframer()
        receipt = frames.Receipt(0, 0, frames.LINK_WINDOW)
        while not self.done:
            for fd, _ in self.poll.poll(self.timeout_ms()):
                if fd == self.link:
                    try:
                        data = os.read(self.link, 65536)
                    except OSError:
                        data = b""
                    if not data:
                        self.end_others()
                        return
                    self.send(receipt.take(len(data)))
                    for received in deframer.feed(data):
                        self.dispatch(*received)
                elif fd == self.wake_in:
                    self.reap()
                    if self.main is not None and self.main.status is not None:
                        self.end_others()
                        self.finish_if_done(self.main)
                elif fd in self.writers:
                    self.flush_into(self.writers[fd])
                elif fd in self.readers:
                    self.carry(self.readers[fd])
            self.enforce_deadlines()

    def timeout_ms(self) -> float | None:
        deadlines = [s.kill_at for s in self.sessions.values() if s.kill_at is not None]
        deadlines += [] if self.drain_until is None else [self.drain_until]
        return max(0.0, min(deadlines) - time.monotonic()) * 1e3 + 1 if deadlines else None

    def enforce_deadlines(self) -> None:
        for session in self.sessions.values():
            if session.kill_at is not None and time.monotonic() >= session.kill_at:
                session.kill_at = None
                self.signal(session, signal.SIGKILL)
        if self.drain_until is not None and time.monotonic() >= self.drain_until and not self.done:
            assert self.main is not None
            self.finish(self.main)

    def dispatch(self, number: int, kind: int, stream: int, payload: bytes) -> None:
        if kind == frames.RUN:
            self.run(number, Request.from_bytes(payload))
            return
        if kind == frames.DIAL:
            self.dial(number, frames.U16.unpack(payload)[0])
            return
        session = self.sessions.get(number)
        if session is None:
            return
        if kind == frames.DATA:
            if session.into >= 0:
                session.pending += payload
                self.flush_into(session)
        elif kind == frames.CLOSE and stream == 0:
            session.into_ends = True
            self.flush_into(session)
        elif kind == frames.CLOSE and stream in session.outlets:
            self.close_outlet(session.outlets[stream])
        elif kind == frames.ACK and stream in session.outlets:
            session.outlets[stream].credit += frames.U32.unpack(payload)[0]
            self.watch(session.outlets[stream].fd)
        elif kind == frames.SIGNAL:
            wanted = signal.Signals(frames.U32.unpack(payload)[0])
            if wanted in ENDING_SIGNALS and session.kill_at is None:
                session.kill_at = time.monotonic() + frames.GRACE_S
            self.signal(session, wanted)
        elif kind == frames.WINSIZE and session.terminal >= 0:
            set_size(session.terminal, *frames.SIZE.unpack(payload))

    def signal(self, session: Session, number: int) -> None:
        """SIGTERM goes to the command alone, as from kill; all others to its group, as Ctrl-C."""
        if session.pid and session.status is None:
            os.kill(session.pid if number == signal.SIGTERM else -session.pid, number)

    def run(self, number: int, request: Request) -> None:
        session = self.sessions[number] = Session(number)
        if self.main is None:
            self.main = session
        slave = -1
        if any(request.tty):
            session.terminal, slave = os.openpty()
            set_size(session.terminal, *request.size)
        theirs: list[int] = []
        for stream, is_terminal in enumerate(request.tty):
            if is_terminal:
                theirs.append(os.dup(slave))
                if stream == 0:
                    session.into = os.dup(session.terminal)
                elif not session.outlets or session.terminal not in [
                    outlet.fd for outlet in session.outlets.values()
                ]:
                    session.outlets[stream] = Outlet(session.terminal, session, stream)
            elif stream == 0:
                reader, session.into = os.pipe()
                theirs.append(reader)
            else:
                reader, writer = os.pipe()
                theirs.append(writer)
                session.outlets[stream] = Outlet(reader, session, stream)
        if slave >= 0:
            os.close(slave)
        fault_in, fault_out = os.pipe()
        session.pid = os.fork()
        if session.pid == 0:
            become(request, theirs, fault_out)
        for fd in (*theirs, fault_out):
            os.close(fd)
        fault = os.read(fault_in, 4096).decode(errors="replace")
        os.close(fault_in)
        if fault:
            os.waitpid(session.pid, 0)
            status, text = fault.split(" ", 1)
            session.status = int(status)
            self.finish(session, text)
            return
        self.open_streams(session)

    def dial(self, number: int, port: int) -> None:
        session = self.sessions[number] = Session(number)
        try:
            connection = socket.create_connection(("127.0.0.1", port))
        except OSError as error:
            session.status = 1
            self.finish(session, str(error))
            return
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        session.into = connection.detach()
        session.outlets[1] = Outlet(os.dup(session.into), session, 1)
        self.open_streams(session)

    def open_streams(self, session: Session) -> None:
        os.set_blocking(session.into, False)
        self.writers[session.into] = session
        for outlet in session.outlets.values():
            os.set_blocking(outlet.fd, False)
            self.readers[outlet.fd] = outlet
            self.watch(outlet.fd)

    def watch(self, fd: int) -> None:
        """Lets poll() wake us for exactly what can be done with fd now."""
        if fd in self.readers and self.readers[fd].credit > 0:
            self.poll.register(fd, select.POLLIN)
        elif fd in self.writers and self.writers[fd].pending:
            self.poll.register(fd, select.POLLOUT)
        else:
            try:
                self.poll.unregister(fd)
            except KeyError:
                pass

    def carry(self, outlet: Outlet) -> None:
        """Moves one chunk from a command or connection to the link."""
        try:
            data = os.read(outlet.fd, min(frames.CHUNK, outlet.credit))
        except BlockingIOError:
            return
        except OSError:  # the last holder of a pseudo-terminal is gone, or a reset connection
            data = b""
        session = outlet.session
        if data:
            outlet.credit -= len(data)
            if self.drain_until is not None:
                self.drain_until = time.monotonic() + DRAIN_S
            self.send(frame(session.number, frames.DATA, outlet.stream, data))
            self.watch(outlet.fd)
            if outlet.left is None:
                return
            outlet.left -= len(data)
            if outlet.left > 0:
                return
        self.send(frame(session.number, frames.CLOSE, outlet.stream))
        self.close_outlet(outlet)

    def close_outlet(self, outlet: Outlet) -> None:
        session = outlet.session
        del session.outlets[outlet.stream]
        del self.readers[outlet.fd]
        self.watch(outlet.fd)
        if outlet.fd == session.terminal:
            session.terminal = -1
        os.close(outlet.fd)
        self.finish_if_done(session)

    def flush_into(self, session: Session) -> None:
        """Moves what came over the link to a command or connection, as far as it takes it."""
        if session.into < 0:
            return
        try:
            while session.pending:
                count = os.write(session.into, session.pending[: frames.CHUNK])
                del session.pending[:count]
                self.send(session.receipt.take(count))
        except BlockingIOError:
            pass
        except OSError:  # the reader is gone
            session.pending.clear()
            self.send(frame(session.number, frames.CLOSE, 0))
            session.into_ends = True
        if session.pending or not session.into_ends:
            self.watch(session.into)
            return
        fd, session.into = session.into, -1
        del self.writers[fd]
        self.watch(fd)
        if session.pid:
            os.close(fd)
        else:
            with socket.socket(fileno=fd) as connection:
                try:
                    connection.shutdown(socket.SHUT_WR)
                except OSError:
                    pass
        self.finish_if_done(session)

    def reap(self) -> bool:
        """Collects every ended process, orphans of the sandbox included; True while some live."""
        try:
            os.read(self.wake_in, 4096)
        except BlockingIOError:
            pass
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return False
            if pid == 0:
                return True
            for session in [s for s in self.sessions.values() if s.pid == pid]:
                code = os.waitstatus_to_exitcode(status)
                session.status = code if code >= 0 else 128 - code
                session.kill_at = None
                if session is not self.main:
                    self.finish_if_done(session)

    def end_others(self) -> None:
        """Ends every process of the sandbox but this one."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            if not self.reap():
                return
            os.kill(-1, number)
            until = time.monotonic() + LEFTOVER_GRACE_S
            while self.reap() and time.monotonic() < until:
                select.select([self.wake_in], [], [], max(0.0, until - time.monotonic()))

    def finish_if_done(self, session: Session) -> None:
        """A command is done when it has ended and its output is carried, a connection when closed.

        Output of a command that has ended is what is in its pipes now: whatever it leaves in the
        background may hold them open for ever. A pseudo-terminal ends by itself.
        """
        if session.number not in self.sessions:
            return
        if session.pid and session.status is not None:
            for outlet in list(session.outlets.values()):
                if outlet.left is None and outlet.fd != session.terminal:
                    count = struct.pack("i", 0)
                    outlet.left = struct.unpack("i", fcntl.ioctl(outlet.fd, FIONREAD, count))[0]
                    if outlet.left == 0:
                        self.send(frame(session.number, frames.CLOSE, outlet.stream))
                        self.close_outlet(outlet)
                        return  # which has called us again
            if session.outlets or (session is self.main and self.connections_flow()):
                return
            self.finish(session)
            return
        if not session.pid and session.into < 0 and not session.outlets:
            session.status = 0
            self.finish(session)
        if self.drain_until is not None and not session.pid and self.main is not None:
            self.finish_if_done(self.main)

    def connections_flow(self) -> bool:
        """Whether a connection still has something to carry out of the sandbox. Once every process
        has ended each comes to its end, unless its client does not read: then time does."""
        if not any(session.outlets for session in self.sessions.values() if not session.pid):
            return False
        if self.drain_until is None:
            self.drain_until = time.monotonic() + DRAIN_S
        return True

    def finish(self, session: Session, text: str = "") -> None:
        """Closes what is open, brings written files to the host, and reports the status."""
        del self.sessions[session.number]
        for fd in [outlet.fd for outlet in session.outlets.values()] + [session.into]:
            if fd >= 0:
                self.readers.pop(fd, None)
                self.writers.pop(fd, None)
                self.watch(fd)
                os.close(fd)
        if session.pid:
            os.sync()
        assert session.status is not None
        self.send(frames.exit_frame(session.number, session.status, text))
        self.done = self.done or session is self.main


def set_size(terminal: int, rows: int, columns: int) -> None:
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))


def become(request: Request, stdio: list[int], fault_out: int) -> None:
    """In the child: turns into the command, or writes the fault and ends."""
    environment = request.environment
    environment.setdefault(b"LCM_DEFAULT_URL", LCM_URL)
    what = request.argv[0]
    try:
        if not os.access(environment.get(b"HOME", b""), os.W_OK | os.X_OK):
            environment[b"HOME"] = b"/tmp"
        os.setsid()
        for number, fd in enumerate(stdio):
            os.dup2(fd, number)
        if any(request.tty):
            fcntl.ioctl(request.tty.index(True), termios.TIOCSCTTY, 0)
        for number in (*ENDING_SIGNALS, signal.SIGPIPE, signal.SIGCHLD):
            signal.signal(number, signal.SIG_DFL)
        os.umask(request.umask)
        what = request.folder
        os.chdir(request.folder)
        what = request.argv[0]
        os.execvpe(what, request.argv, environment)
    except OSError as error:
        status = 127 if isinstance(error, FileNotFoundError) else 126
        os.write(fault_out, b"%d %s: " % (status, what) + (error.strerror or "").encode())
    finally:
        os._exit(127)


def serve(link: int) -> None:
    agent = Agent(link)
    agent.send(frame(0, frames.HELLO))
    agent.serve()


def main() -> None:
    """As init of user-mode Linux, on its first serial line."""
    while os.open("/dev/null", os.O_RDWR) < 2:
        pass
    link = os.open("/dev/ttyS0", os.O_RDWR | os.O_NOCTTY)
    tty.setraw(link)
    try:
        set_up_machine()
        network.set_up()
    except (SetupError, OSError) as error:
        text = (error.strerror if isinstance(error, OSError) else None) or str(error)
        os.write(link, frame(0, frames.HELLO, 0, text.encode()))
    else:
        try:
            serve(link)
        except OSError:  # nobody listens any more
            pass
    os.sync()
    termios.tcdrain(link)
    libc.reboot(RB_POWER_OFF)


if __name__ == "__main__":
    main()
