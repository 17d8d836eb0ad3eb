"""The vcan session with stand-ins for the processes of the rig."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from hpmc.layout import LAUNCHER

# Runs until SIGTERM, then tells what it counted.
LISTENER = """
import signal, sys, time
def end(*_):
    print('STATS {"messages": 7}', flush=True)
    with open(sys.argv[1], "a") as order:
        order.write(sys.argv[2] + " ended\\n")
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
signal.signal(signal.SIGINT, signal.SIG_IGN)
with open(sys.argv[1], "a") as order:
    order.write(sys.argv[2] + " ready\\n")
print("READY", flush=True)
time.sleep(60)
"""
ARM = """
import sys, time
with open(sys.argv[1], "a") as order:
    order.write("arm_sim started\\n")
time.sleep({seconds})
sys.exit({status})
"""
HOST = """
import signal, sys, time
stop = []
signal.signal(signal.SIGINT, lambda *_: stop.append(1))
print("READY", flush=True)
for tick in range({ticks}):
    print('PROGRESS {{"repetition": 0, "reach": 0, "simulated_s": %.1f}}' % (tick / 10), flush=True)
    time.sleep(0.1)
    if stop:
        break
print('STATS {{"frames": 5}}', flush=True)
{end}
sys.exit({status} or 3 * len(stop))
"""


class Session:
    """A launcher with a plan, and the order in which its processes did things."""

    def __init__(self, folder: Path) -> None:
        self.order = folder / "order"
        self.order.touch()
        self.plan = folder / "plan.json"
        self.commands = {
            name: self.python(LISTENER, str(self.order), name)
            for name in ("run_logger", "motor_node 1", "motor_node 2", "motor_node 3")
        }
        self.commands["hpmc_host"] = self.host()
        self.commands["arm_sim"] = self.python(ARM.format(seconds=0.2, status=0), str(self.order))

    @staticmethod
    def python(program: str, *arguments: str) -> list[str]:
        return [sys.executable, "-S", "-c", program, *arguments]

    @classmethod
    def host(cls, ticks: int = 5, status: int = 0, end: str = "") -> list[str]:
        return cls.python(HOST.format(ticks=ticks, status=status, end=end))

    def start(self) -> subprocess.Popen[str]:
        self.plan.write_text(json.dumps({"processes": self.commands}))
        return subprocess.Popen(
            [sys.executable, "-I", "-S", LAUNCHER, self.plan],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def run(self) -> dict[str, Any]:
        return result_of(self.start())

    def events(self) -> list[str]:
        return self.order.read_text().splitlines()


def result_of(process: subprocess.Popen[str]) -> dict[str, Any]:
    said, errors = process.communicate(timeout=30)
    assert errors == ""
    *_, last = said.splitlines()
    result = json.loads(last.removeprefix("RESULT "))
    assert process.returncode == result["status"]
    return result | {"progress": said.count("PROGRESS ")}


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path)


def test_a_whole_session(session: Session) -> None:
    result = session.run()
    assert (result["status"], result["reason"], result["interrupted"]) == (0, "", False)
    assert 0.4 < result["wall_s"] < 5.0
    assert result["progress"] == 5
    assert result["stats"]["hpmc_host"] == {"frames": 5}
    assert result["stats"]["run_logger"] == {"messages": 7}


def test_arm_sim_starts_when_all_listen_and_the_logger_ends_last(session: Session) -> None:
    session.run()
    events = session.events()
    at = events.index("arm_sim started")
    names = ("run_logger", "motor_node 1", "motor_node 2", "motor_node 3")
    assert {f"{name} ready" for name in names} == set(events[:at])
    assert events[-1] == "run_logger ended" and len(events) == 9


@pytest.mark.parametrize("victim", ["motor_node 2", "run_logger", "hpmc_host"])
def test_a_killed_process_is_named(session: Session, victim: str) -> None:
    session.commands["hpmc_host"] = session.host(ticks=200)
    session.commands["arm_sim"] = session.python(
        ARM.format(seconds=60, status=0), str(session.order)
    )
    process = session.start()
    while "arm_sim started" not in session.events():
        time.sleep(0.02)
    time.sleep(0.5)
    (pid,) = pids_of(process.pid, session.commands[victim])
    os.kill(pid, signal.SIGKILL)
    killed_at = time.monotonic()
    result = result_of(process)
    assert time.monotonic() - killed_at < 1.0
    assert result["status"] == 3 and not result["interrupted"]
    assert result["reason"].startswith(f"{victim} was killed by SIGKILL, 0.")
    assert result["reason"].endswith(" s into the run")


def pids_of(parent: int, command: list[str]) -> list[int]:
    wanted = "\0".join(command) + "\0"
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(c) for c in children if Path(f"/proc/{c}/cmdline").read_text() == wanted]


def test_the_last_words_of_a_process_are_the_reason(session: Session) -> None:
    session.commands["hpmc_host"] = session.host(
        status=3, end="print('hpmc_host: motor node 1: emergency', file=sys.stderr)"
    )
    result = session.run()
    assert (result["status"], result["reason"]) == (3, "hpmc_host: motor node 1: emergency")


def test_arm_sim_may_end_first_only_in_order(session: Session) -> None:
    session.commands["hpmc_host"] = session.host(ticks=30)
    session.commands["arm_sim"] = session.python(
        ARM.format(seconds=0.3, status=4), str(session.order)
    )
    result = session.run()
    assert result["status"] == 3
    assert result["reason"].startswith("arm_sim ended with status 4, 0.")


def test_a_process_that_cannot_start_ends_the_session_before_the_arm(session: Session) -> None:
    session.commands["motor_node 3"] = session.python(
        "import sys; print('motor_node 3: vcan0: No such device', file=sys.stderr); sys.exit(3)"
    )
    result = session.run()
    assert result["reason"].startswith("motor_node 3: vcan0: No such device")
    assert "arm_sim started" not in session.events()


def test_a_process_that_never_gets_ready(session: Session) -> None:
    program = LAUNCHER.read_text().replace("READY_S = 20.0", "READY_S = 1.0")
    assert "READY_S = 1.0" in program
    launcher = session.plan.with_name("launcher.py")
    launcher.write_text(program)
    session.commands["motor_node 1"] = session.python("import time; time.sleep(60)")
    session.commands["hpmc_host"] = session.host(ticks=300)
    session.plan.write_text(json.dumps({"processes": session.commands}))
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", launcher, session.plan],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert result_of(process)["reason"] == "motor_node 1 did not start within 1 s"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_goes_to_the_host_alone(session: Session, number: signal.Signals) -> None:
    session.commands["hpmc_host"] = session.host(ticks=300)
    session.commands["arm_sim"] = session.python(
        ARM.format(seconds=60, status=0), str(session.order)
    )
    process = session.start()
    while "arm_sim started" not in session.events():
        time.sleep(0.02)
    time.sleep(0.3)
    process.send_signal(number)
    result = result_of(process)
    assert result["interrupted"] and result["reason"] == "" and result["status"] == 3
    assert result["stats"]["hpmc_host"] == {"frames": 5}
    assert session.events()[-1] == "run_logger ended"


def test_a_caller_that_is_gone_is_like_an_interrupt(session: Session) -> None:
    session.commands["hpmc_host"] = session.host(ticks=300)
    session.commands["arm_sim"] = session.python(
        ARM.format(seconds=60, status=0), str(session.order)
    )
    process = session.start()
    assert process.stdout is not None and process.stderr is not None
    process.stdout.readline()
    process.stdout.close()
    start = time.monotonic()
    errors = process.stderr.read()
    assert process.wait(30) == 3 and errors == ""
    assert time.monotonic() - start < 3.0
    assert session.events()[-1] == "run_logger ended"


def test_the_arm_may_finish_after_the_host(session: Session) -> None:
    last = "\nprint('STATS {\"overruns\": 0}')"
    session.commands["arm_sim"] = session.python(
        ARM.format(seconds=1.2, status=0).replace("\nsys.exit", last + "\nsys.exit"),
        str(session.order),
    )
    result = session.run()
    assert result["status"] == 0 and result["stats"]["arm_sim"] == {"overruns": 0}


def test_a_process_that_ignores_its_end_is_killed(session: Session) -> None:
    session.commands["motor_node 1"] = session.python(
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
        "print('READY', flush=True); time.sleep(60)"
    )
    session.commands["motor_node 2"] = session.python(
        "import time; print('READY', flush=True); time.sleep(0.6)"
    )
    session.commands["hpmc_host"] = session.host(ticks=300)
    start = time.monotonic()
    result = session.run()
    assert result["reason"].startswith("motor_node 2 ended with status 0")
    assert time.monotonic() - start < 5
