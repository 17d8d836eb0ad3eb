"""The hub: starts the sandbox, and routes frames between its agent, clients and TCP connections.

It runs in a process of its own outside the sandbox, for as long as the main command runs.
"""

from __future__ import annotations

import ctypes
import os
import selectors
import signal
import socket
import struct
import time

from vcan import agent, frames, network
from vcan.frames import frame

LINUX = "/usr/bin/linux.uml"
BOOT_LIMIT_S = 60.0
END_LIMIT_S = frames.GRACE_S + 5.0  # from a signal to the report that the command has ended
AGENT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "agent.py")

CLONE_NEWNS, CLONE_NEWUSER = 0x00020000, 0x10000000
CLONE_NEWPID, CLONE_NEWNET = 0x20000000, 0x40000000
MS_REC, MS_PRIVATE = 0x4000, 0x40000
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
ADDR_NO_RANDOMIZE = 0x0040000
SO_PEERCRED = struct.Struct("3i")


class StartError(Exception):
    """The sandbox does not start; the text says why and what helps."""


def fault_text(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


# --- the two ways to a sandbox ---------------------------------------------------------------


def enter_namespaces() -> None:
    """Gives this process and its children a network of their own; children also process ids."""
    libc = agent.libc
    flags = CLONE_NEWNET | CLONE_NEWPID | CLONE_NEWNS
    user, group = os.geteuid(), os.getegid()
    if user != 0 or libc.unshare(flags) == -1:
        agent.check(libc.unshare(flags | CLONE_NEWUSER), "user namespace")
        for file, text in (
            ("setgroups", "deny"),
            ("uid_map", f"0 {user} 1"),
            ("gid_map", f"0 {group} 1"),
        ):
            with open(f"/proc/self/{file}", "w", encoding="ascii") as out:
                out.write(text)
    private = (b"none", b"/", None, ctypes.c_ulong(MS_REC | MS_PRIVATE), None)
    agent.check(libc.mount(*private), "private mounts")
    network.set_up()


def native_fault() -> str:
    """Empty where the kernel gives an unprivileged process a vcan0 of its own, else why not."""
    pipe_in, pipe_out = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            enter_namespaces()
        except (agent.SetupError, OSError) as error:
            os.write(pipe_out, fault_text(error).encode())
        finally:
            os._exit(0)
    os.close(pipe_out)
    fault = os.read(pipe_in, 4096).decode(errors="replace")
    os.close(pipe_in)
    os.waitpid(pid, 0)
    return fault


def start_native(link: int) -> int:
    """Starts the agent as first process of new namespaces; killing the process group ends all."""
    pid = os.fork()
    if pid:
        return pid
    status = 1
    try:
        os.setpgid(0, 0)
        enter_namespaces()
        first = os.fork()
        if first == 0:
            agent.libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
            try:
                agent.mount("proc", "/proc")
            except agent.SetupError:
                pass  # some containers forbid it: ps then shows foreign numbers, no more
            agent.serve(link)
            os._exit(0)
        os.close(link)
        os.waitpid(first, 0)
        status = 0
    except (agent.SetupError, OSError) as error:
        os.write(link, frame(0, frames.HELLO, 0, fault_text(error).encode()))
    finally:
        os._exit(status)


def claim_cpu() -> tuple[int, socket.socket | None]:
    """One host CPU for the sandbox, one that no other sandbox has if there is such a one."""
    cpus = sorted(os.sched_getaffinity(0), reverse=True)
    for cpu in cpus:
        mark = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            mark.bind(f"\0with-vcan/cpu/{cpu}")
        except OSError:
            mark.close()
        else:
            return cpu, mark
    return cpus[time.monotonic_ns() % len(cpus)], None


def start_uml(link: int, console: int, memory_mb: int) -> int:
    """Boots user-mode Linux with the agent as init and the link as its first serial line."""
    cpu, mark = claim_cpu()
    arguments = [
        "linux.uml",
        f"mem={memory_mb}M",
        "root=/dev/root",
        "rootfstype=hostfs",
        "rootflags=/",
        "rw",
        f'init="{AGENT}"',
        "con=null",
        "con0=null,fd:2",
        "ssl=null",
        f"ssl0=fd:{link}",
        "noreboot",
        "quiet",
        # No folder and socket for uml_mconsole. And 0.2 s instead of 1.3 s to boot: no speed tests
        # of RAID, no self-tests of ciphers, no delay calibration.
        "initcall_blacklist=make_umid_init,mconsole_init,raid6_select_algo",
        "cryptomgr.notests",
        "lpj=20000000",
    ]
    pid = os.fork()
    if pid:
        return pid
    try:
        os.setpgid(0, 0)
        null = os.open("/dev/null", os.O_RDONLY)
        for number, fd in enumerate((null, console, console)):
            os.dup2(fd, number)
        os.set_inheritable(link, True)
        if mark:
            os.set_inheritable(mark.fileno(), True)
        os.sched_setaffinity(0, {cpu})
        agent.libc.personality(ADDR_NO_RANDOMIZE)
        # Without TMPDIR it keeps its memory in /dev/shm.
        os.execve(LINUX, arguments, {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/"})
    finally:
        os._exit(127)


# --- routing ---------------------------------------------------------------------------------


class Wire:
    """A non-blocking socket with an output buffer."""

    def __init__(self, hub: Hub, connection: socket.socket) -> None:
        self.hub, self.socket = hub, connection
        self.out = bytearray()
        self.reading = True
        self.closed = False
        connection.setblocking(False)
        hub.selector.register(connection, selectors.EVENT_READ, self)

    def watch(self) -> None:
        if self.closed:
            return
        events = (selectors.EVENT_READ if self.reading else 0) | (
            selectors.EVENT_WRITE if self.out and self.may_write() else 0
        )
        if self.socket.fileno() in self.hub.selector.get_map():
            self.hub.selector.unregister(self.socket)
        if events:
            self.hub.selector.register(self.socket, events, self)

    def may_write(self) -> bool:
        return True

    def send(self, data: bytes) -> None:
        self.out += data
        self.flush()

    def flush(self, at_most: int = 1 << 30) -> int:
        """Bytes written now."""
        count = 0
        try:
            while self.out and count < at_most and not self.closed:
                sent = self.socket.send(self.out[: min(65536, at_most - count)])
                del self.out[:sent]
                count += sent
        except BlockingIOError:
            pass
        except OSError:
            self.out.clear()
        self.watch()
        return count

    def read(self) -> bytes | None:
        """What came; empty at the end, None if nothing yet."""
        try:
            return self.socket.recv(65536)
        except BlockingIOError:
            return None
        except OSError:
            return b""

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            if self.socket.fileno() in self.hub.selector.get_map():
                self.hub.selector.unregister(self.socket)
            self.socket.close()

    def on_event(self, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self.flush()
        if events & selectors.EVENT_READ and not self.closed:
            self.on_readable()

    def on_readable(self) -> None:
        raise NotImplementedError


class Link(Wire):
    def __init__(self, hub: Hub, connection: socket.socket) -> None:
        self.credit = frames.LINK_WINDOW
        super().__init__(hub, connection)
        self.deframer = frames.Deframer()

    def may_write(self) -> bool:
        return self.credit > 0

    def flush(self, at_most: int = 1 << 30) -> int:
        count = super().flush(min(at_most, self.credit))
        self.credit -= count
        self.watch()
        return count

    def on_readable(self) -> None:
        data = self.read()
        if data == b"":
            self.hub.sandbox_is_gone()
        for number, kind, stream, payload in self.deframer.feed(data or b""):
            if number != 0:
                self.hub.from_agent(number, kind, stream, payload)
            elif kind == frames.ACK:
                self.credit += frames.U32.unpack(payload)[0]
                self.flush()
            else:
                self.hub.on_hello(payload)


class Client(Wire):
    """The with-vcan process of one terminal: its frames pass through under our session number."""

    def __init__(self, hub: Hub, connection: socket.socket) -> None:
        super().__init__(hub, connection)
        self.deframer = frames.Deframer()
        self.number = hub.new_session(self)
        self.end_by: float | None = None

    def on_readable(self) -> None:
        data = self.read()
        if data == b"":
            self.pass_on(frames.CLOSE, 0)
            number = signal.SIGTERM if self is self.hub.main else signal.SIGHUP
            self.pass_on(frames.SIGNAL, 0, frames.U32.pack(number))
            self.close()
        for _, kind, stream, payload in self.deframer.feed(data or b""):
            self.pass_on(kind, stream, payload)

    def pass_on(self, kind: int, stream: int, payload: bytes = b"") -> None:
        ending = kind == frames.SIGNAL and frames.U32.unpack(payload)[0] in agent.ENDING_SIGNALS
        if ending and self.end_by is None:
            self.end_by = time.monotonic() + END_LIMIT_S
        self.hub.to_agent(self.number, kind, stream, payload)

    def from_agent(self, kind: int, stream: int, payload: bytes) -> None:
        if not self.closed:
            self.send(frame(1, kind, stream, payload))
        elif kind == frames.DATA:  # nobody reads it any more: let the command end in order
            self.hub.to_agent(self.number, frames.ACK, stream, frames.U32.pack(len(payload)))


class Forwarded(Wire):
    """A TCP connection from the host to a port of the sandbox."""

    def __init__(self, hub: Hub, connection: socket.socket, port: int) -> None:
        super().__init__(hub, connection)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.credit = frames.WINDOW
        self.number = hub.new_session(self)
        self.receipt = frames.Receipt(self.number, 1)
        self.ends = self.over = False
        hub.to_agent(self.number, frames.DIAL, 0, frames.U16.pack(port))

    def on_readable(self) -> None:
        data = self.read()
        if data is None:
            return
        if data:
            self.credit -= len(data)
            self.hub.to_agent(self.number, frames.DATA, 0, data)
        else:
            self.hub.to_agent(self.number, frames.CLOSE, 0)
        self.reading = bool(data) and self.credit > 0
        self.watch()

    def flush(self, at_most: int = 1 << 30) -> int:
        count = super().flush(at_most)
        if receipt := self.receipt.take(count):
            self.hub.to_link(receipt)
        if not self.out and not self.closed:
            if self.over:
                self.close()
            elif self.ends:
                try:
                    self.socket.shutdown(socket.SHUT_WR)
                except OSError:
                    pass
        return count

    def from_agent(self, kind: int, stream: int, payload: bytes) -> None:
        if kind == frames.DATA:
            self.send(payload)
        elif kind == frames.ACK:
            self.credit += frames.U32.unpack(payload)[0]
            self.reading = True
            self.watch()
        elif kind == frames.CLOSE and stream == 1:
            self.ends = True
            self.flush()
        elif kind == frames.CLOSE:
            self.reading = False
            self.watch()
        elif kind == frames.EXIT:
            self.over = True
            self.flush()


class Listener:
    def __init__(self, hub: Hub, listener: socket.socket, port: int | None) -> None:
        self.hub, self.listener, self.port = hub, listener, port
        listener.setblocking(False)
        hub.selector.register(listener, selectors.EVENT_READ, self)

    def on_event(self, _: int) -> None:
        try:
            connection, _address = self.listener.accept()
        except OSError:
            return
        if self.port is not None:
            Forwarded(self.hub, connection, self.port)
        elif same_user(connection):
            Client(self.hub, connection)
        else:
            connection.close()


def same_user(connection: socket.socket) -> bool:
    raw = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, SO_PEERCRED.size)
    return SO_PEERCRED.unpack(raw)[1] == os.geteuid()


class Hub:
    def __init__(self, main: socket.socket, native: bool, memory_mb: int) -> None:
        self.selector = selectors.DefaultSelector()
        self.sessions: dict[int, Client | Forwarded] = {}
        self.early: list[bytes] = []  # for the agent, until it has said hello
        self.ready = False
        self.result: tuple[int, str] | None = None
        self.main = Client(self, main)
        ours, theirs = socket.socketpair()
        agent.libc.prctl(PR_SET_CHILD_SUBREAPER, 1)  # so that we see each process of it end
        self.console = os.memfd_create("console")
        if native:
            self.pid = start_native(theirs.fileno())
        else:
            self.pid = start_uml(theirs.fileno(), self.console, memory_mb)
        theirs.close()
        self.link = Link(self, ours)

    def new_session(self, peer: Client | Forwarded) -> int:
        number = max(self.sessions, default=0) + 1
        self.sessions[number] = peer
        return number

    def to_agent(self, number: int, kind: int, stream: int, payload: bytes = b"") -> None:
        if number in self.sessions:
            self.to_link(frame(number, kind, stream, payload))

    def to_link(self, data: bytes) -> None:
        if self.ready:
            self.link.send(data)
        else:
            self.early.append(data)

    def from_agent(self, number: int, kind: int, stream: int, payload: bytes) -> None:
        peer = self.sessions.get(number)
        if peer is None:
            return
        if kind == frames.EXIT:
            del self.sessions[number]
            if peer is self.main:
                self.result = frames.read_exit(payload)
                return
        peer.from_agent(kind, stream, payload)

    def on_hello(self, fault: bytes) -> None:
        if fault:
            self.result = 125, f"the sandbox cannot be set up: {fault.decode(errors='replace')}"
            return
        self.ready = True
        self.link.send(b"".join(self.early))
        self.early.clear()

    def sandbox_is_gone(self) -> None:
        if self.result is None:
            os.lseek(self.console, 0, os.SEEK_SET)
            said = os.read(self.console, 1 << 20).decode(errors="replace").strip().split("\n")
            self.result = 125, f"the sandbox stopped unexpectedly: {said[-1]}"

    def enforce_limits(self, start_by: float) -> None:
        now = time.monotonic()
        if not self.ready and now >= start_by and self.result is None:
            self.result = 125, f"the sandbox did not start within {BOOT_LIMIT_S:.0f} s"
        for peer in list(self.sessions.values()):
            if isinstance(peer, Client) and peer.end_by is not None and now >= peer.end_by:
                peer.end_by = None
                text = "the sandbox does not answer"
                if peer is not self.main:
                    peer.send(frames.exit_frame(1, 125, text))
                elif self.result is None:
                    self.result = 125, text + ": it was killed"

    def serve(self, listeners: list[tuple[socket.socket, int | None]]) -> None:
        """Routes until the main command has ended; then ends the sandbox and tells the clients."""
        for listener, port in listeners:
            Listener(self, listener, port)
        start_by = time.monotonic() + BOOT_LIMIT_S
        while self.result is None:
            clients = [p for p in self.sessions.values() if isinstance(p, Client)]
            limits = [p.end_by for p in clients if p.end_by is not None]
            if not self.ready:
                limits.append(start_by)
            wait = max(0.0, min(limits) - time.monotonic()) if limits else None
            for key, events in self.selector.select(wait):
                key.data.on_event(events)
            self.enforce_limits(start_by)
        os.killpg(self.pid, signal.SIGKILL)
        try:
            while True:
                os.wait()
        except ChildProcessError:
            pass
        for listener, _ in listeners:
            listener.close()
        joined = [p for p in self.sessions.values() if isinstance(p, Client) and p is not self.main]
        for peer in joined:
            peer.send(frames.exit_frame(1, 128 + signal.SIGTERM))
        self.main.send(frames.exit_frame(1, *self.result))
        clients = [self.main, *joined]
        until = time.monotonic() + 10.0
        while any(c.out and not c.closed for c in clients) and time.monotonic() < until:
            for key, events in self.selector.select(0.1):
                key.data.on_event(events)
