"""The vcan session: starts the processes of the rig, watches them, ends them in order.

Runs inside the sandbox that tools/with-vcan makes, by itself (`python launcher.py PLAN.json`), with
the standard library only, since the interpreter shares one processor with the lockstep loop. Tells
its caller in lines on standard output: PROGRESS {json}, and last RESULT {json}.
"""

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

READY_S = 20.0
STALL_SPREAD_S = 0.6  # between the stall time-outs of two processes
END_S = 5.0
KILL_S = 0.1  # after a failure: the lockstep loop stands still, its parts cannot end in order

EXIT_RUN_ENDED = 3
SELF_ENDING = ("arm_sim", "bench_bridge")


@dataclass
class Role:
    """One process of the rig."""

    name: str
    process: subprocess.Popen[bytes]
    ready: bool = False
    open: bool = True
    stats: dict[str, Any] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)  # on standard error
    rest: dict[int, bytes] = field(default_factory=dict)  # unfinished lines by descriptor


class Session:
    def __init__(self, plan: dict[str, Any]) -> None:
        self.plan = plan
        self.roles: dict[str, Role] = {}
        self.selector = selectors.DefaultSelector()
        self.interrupted = False
        self.simulated_s = 0.0
        self.reason = ""

    def run(self) -> int:
        signal.signal(signal.SIGINT, self.on_signal)
        signal.signal(signal.SIGTERM, self.on_signal)
        began = time.monotonic()
        try:
            self.start_all()
            began = time.monotonic()
            if not self.reason:
                self.watch_until_host_ends()
        finally:
            wall_s = time.monotonic() - began
            self.end_all()
        status = EXIT_RUN_ENDED if self.reason or self.interrupted else 0
        result = {
            "status": status,
            "reason": self.reason,
            "interrupted": self.interrupted,
            "wall_s": wall_s,
            "stats": {name: role.stats for name, role in self.roles.items()},
        }
        self.tell("RESULT " + json.dumps(result))
        return status

    def tell(self, line: str) -> None:
        try:
            print(line, flush=True)
        except BrokenPipeError:
            # The caller was killed: as after Ctrl-C, but nobody listens any more.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            self.on_signal()

    def on_signal(self, *_: object) -> None:
        self.interrupted = True
        host = self.roles.get("hpmc_host")
        if host is not None and host.process.poll() is None:
            host.process.send_signal(signal.SIGINT)
        elif host is None:
            self.reason = self.reason or "interrupted before the run began"

    def start_all(self) -> None:
        """Listeners first; arm_sim, which sends the first message, when all others are ready.

        Without arm_sim the host begins by itself, so the others listen before it starts.
        """
        last = "arm_sim" if "arm_sim" in self.plan["processes"] else "hpmc_host"
        for name, command in self.plan["processes"].items():
            if name != last:
                self.start(name, command)
        limit = time.monotonic() + READY_S
        while not self.reason and not all(role.ready for role in self.roles.values()):
            self.collect(0.2)
            self.check_exits(host_may_end=False)
            if time.monotonic() > limit:
                late = [role.name for role in self.roles.values() if not role.ready]
                self.reason = f"{', '.join(late)} did not start within {READY_S:.0f} s"
        if not self.reason:
            self.start(last, self.plan["processes"][last])

    def start(self, name: str, command: list[str]) -> None:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self.roles[name] = role = Role(name, process)
        assert process.stdout is not None and process.stderr is not None
        for stream in (process.stdout, process.stderr):
            os.set_blocking(stream.fileno(), False)
            self.selector.register(stream.fileno(), selectors.EVENT_READ, role)

    def collect(self, timeout_s: float) -> None:
        """Takes in what the processes say, waiting up to timeout_s for something."""
        for key, _ in self.selector.select(timeout_s):
            role: Role = key.data
            data = os.read(key.fd, 65536)
            if not data:
                self.selector.unregister(key.fd)
                role.open = False
                continue
            lines = (role.rest.get(key.fd, b"") + data).split(b"\n")
            role.rest[key.fd] = lines.pop()
            assert role.process.stderr is not None
            for line in lines:
                self.on_line(role, line.decode(errors="replace"), key.fd)

    def on_line(self, role: Role, line: str, descriptor: int) -> None:
        assert role.process.stderr is not None
        if descriptor == role.process.stderr.fileno():
            role.said.append(line)
        elif line == "READY":
            role.ready = True
        elif line.startswith("STATS "):
            role.stats = json.loads(line.removeprefix("STATS "))
        elif line.startswith("PROGRESS "):
            self.simulated_s = json.loads(line.removeprefix("PROGRESS "))["simulated_s"]
            self.tell(line)

    def check_exits(self, host_may_end: bool) -> bool:
        """True when the run is over; sets the reason when a process ended that should not have."""
        ended = [role for role in self.roles.values() if role.process.poll() is not None]
        if not ended:
            return False
        self.collect(0.05)
        host = self.roles.get("hpmc_host")
        if host_may_end and host in ended and host.process.returncode >= 0:
            if host.process.returncode != 0 and not (self.interrupted and not host.said):
                self.reason = self.reason or self.first_cause(host)
            return True
        # These end by themselves after the last tick, just before the host does.
        unexpected = [r for r in ended if r.name not in SELF_ENDING or r.process.returncode != 0]
        if unexpected:
            told = [role for role in unexpected if role.process.returncode < 0] or unexpected
            self.reason = self.reason or (
                f"{why_ended(told[0])}, {self.simulated_s:.1f} s into the run"
            )
        return bool(unexpected)

    def first_cause(self, host: Role) -> str:
        """arm_sim, which waits for the nodes themselves, names a silent node; the host cannot."""
        limit = time.monotonic() + STALL_SPREAD_S
        arm = self.roles.get("arm_sim")
        silent = "no HAND_WRENCH" in "".join(host.said)
        while arm is not None and silent and time.monotonic() < limit:
            self.collect(0.05)
            if arm.process.poll() is not None and arm.said:
                return why_ended(arm)
        return why_ended(host)

    def watch_until_host_ends(self) -> None:
        while not self.check_exits(host_may_end=True):
            # The end of a process closes its pipes, which wakes this up.
            self.collect(0.25)

    def end_all(self) -> None:
        """Nodes and arm first, the logger last: it takes in what is still on its way."""
        for name in SELF_ENDING:
            role = self.roles.get(name)
            if role is not None and not self.reason and not self.interrupted:
                # The host is through with the last SYNC period a little before the joint loop.
                with contextlib.suppress(subprocess.TimeoutExpired):
                    role.process.wait(END_S)
        others = [role for role in self.roles.values() if role.name != "run_logger"]
        stop(others, KILL_S if self.reason else END_S)
        logger = [role for role in self.roles.values() if role.name == "run_logger"]
        stop(logger, END_S)
        limit = time.monotonic() + END_S
        while self.selector.get_map() and time.monotonic() < limit:
            self.collect(0.2)
        for role in self.roles.values():
            if role.process.returncode not in (0, -signal.SIGTERM) and role.said:
                self.reason = self.reason or why_ended(role)


def stop(roles: list[Role], patience_s: float) -> None:
    for role in roles:
        if role.process.poll() is None:
            role.process.terminate()
    limit = time.monotonic() + patience_s
    for role in roles:
        try:
            role.process.wait(max(0.0, limit - time.monotonic()))
        except subprocess.TimeoutExpired:
            role.process.kill()
            role.process.wait()


def why_ended(role: Role) -> str:
    status = role.process.returncode
    if status < 0:
        return f"{role.name} was killed by {signal.Signals(-status).name}"
    return role.said[-1] if role.said else f"{role.name} ended with status {status}"


def main() -> int:
    return Session(json.loads(Path(sys.argv[1]).read_text())).run()


if __name__ == "__main__":
    sys.exit(main())
