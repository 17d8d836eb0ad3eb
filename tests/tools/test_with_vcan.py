"""tools/with-vcan: CAN and multicast inside, exact streams, status and signals, nothing left."""

from __future__ import annotations

import json
import os
import random
import select
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

WITH_VCAN = str(Path(__file__).parents[2] / "tools" / "with-vcan")
UML = [WITH_VCAN, "--uml"]
PYTHON = ["/usr/bin/python3", "-IS", "-c"]
LIMIT_S = 30
UNENDING = "test_what_does_not_end_is_killed"
LEAST_PRIVILEGED = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]

EXCHANGE = """
candump -n 2 vcan0 & sleep 0.2
cansend vcan0 181#1122334455667788
cansend vcan0 7FF#
wait
"""

MULTICAST = """
import socket, struct
group = "239.255.76.67"
receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
receiver.bind((group, 7667))
member = socket.inet_aton(group) + struct.pack("=I", socket.INADDR_ANY)
receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
receiver.settimeout(5)
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
sender.sendto(b"tick", (group, 7667))
print(receiver.recv(100).decode())
"""

SERVE_ONCE = """
import socket
listener = socket.create_server(("127.0.0.1", {port}))
print("listening", flush=True)
for _ in range(2):
    connection, _ = listener.accept()
    data = b""
    while more := connection.recv(65536):
        data += more
    connection.sendall(data[::-1])
    connection.close()
"""

SEND_AND_GO = """
import socket
listener = socket.create_server(("127.0.0.1", {port}))
print("listening", flush=True)
connection, _ = listener.accept()
connection.setblocking(False)
try:
    while connection.send(bytes(65536)):
        pass
except BlockingIOError:
    pass
"""

UNTIL_SIGNAL = """
import signal, sys, time
numbers = {signal.SIGINT, signal.SIGTERM}
signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
print("ready", flush=True)
print("got", signal.Signals(signal.sigwait(numbers)).name, flush=True)
time.sleep(0.2)
print("ended in order", flush=True)
sys.exit(9)
"""


def run(*command: str, **options: Any) -> subprocess.CompletedProcess[bytes]:
    options.setdefault("stdin", subprocess.DEVNULL)
    if "input" in options:
        del options["stdin"]
    return subprocess.run(command, capture_output=True, timeout=LIMIT_S, **options)


def start(*command: str, **options: Any) -> subprocess.Popen[bytes]:
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, **options)


def output_until_terminated(process: subprocess.Popen[bytes]) -> list[bytes]:
    assert process.stdout is not None
    first = process.stdout.readline()
    process.terminate()
    return (first + process.communicate(timeout=LIMIT_S)[0]).split()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def children_of(pid: int) -> set[int]:
    """All descendants of a process."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(folder.name)] = int((folder / "stat").read_text().rsplit(")")[1].split()[1])
        except OSError:
            continue
    family = {pid}
    while more := {child for child, parent in parents.items() if parent in family} - family:
        family |= more
    return family - {pid}


def alive(pids: set[int]) -> list[str]:
    lines = []
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")")[1].split()[0]
            if state != "Z":  # a zombie waits for a slow init only
                lines.append(Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return lines


def eventually(holds: Callable[[], bool], within_s: float = 5.0) -> bool:
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        if holds():
            return True
        time.sleep(0.05)
    return holds()


@pytest.fixture(scope="module")
def sandbox() -> Iterator[str]:
    """One running sandbox, for all tests that join it."""
    name = f"pytest-{os.getpid()}"
    process = start(*UML, "--name", name, "sh", "-c", "echo up; sleep 1000")
    assert process.stdout is not None and process.stdout.readline() == b"up\n"
    yield name
    process.terminate()
    assert process.wait(LIMIT_S) == 128 + signal.SIGTERM


def join(name: str) -> list[str]:
    return [WITH_VCAN, "--join", name]


@dataclass
class Ending:
    """A command that was told to end: what came of it, and when."""

    after_s: float
    status: int
    words: bytes


@pytest.fixture(scope="module", autouse=True)
def unending(request: pytest.FixtureRequest, sandbox: str) -> Iterator[dict[str, Any]]:
    """What takes with-vcan 10 and 15 s to end, begun here: the other tests run meanwhile."""
    if not any(item.name == UNENDING for item in request.session.items):
        yield {}
        return
    stopped = start(*UML, "sh", "-c", "echo on; sleep 1000")
    deaf = start(*join(sandbox), "sh", "-c", "trap '' TERM; echo on; while :; do sleep 1; done")
    for process in (stopped, deaf):
        assert process.stdout is not None and process.stdout.readline() == b"on\n"
    family = children_of(stopped.pid)
    for pid in family:
        if Path(f"/proc/{pid}/comm").read_text().startswith("linux"):
            os.kill(pid, signal.SIGSTOP)
    begin = time.monotonic()

    def end(process: subprocess.Popen[bytes]) -> Ending:
        process.terminate()
        words = process.communicate(timeout=LIMIT_S)[1]
        return Ending(time.monotonic() - begin, process.returncode, words)

    with ThreadPoolExecutor() as pool:
        ends = {"stopped": pool.submit(end, stopped), "deaf": pool.submit(end, deaf)}
        yield {"family": family, **ends}


def test_frames_pass_between_two_processes() -> None:
    result = run(*UML, "sh", "-c", EXCHANGE)
    assert result.stdout.split() == (b"vcan0 181 [8] 11 22 33 44 55 66 77 88 vcan0 7FF [0]".split())
    assert (result.returncode, result.stderr) == (0, b"")


def test_the_joined_sandbox_has_can_multicast_and_buffers(sandbox: str) -> None:
    dump = start(*join(sandbox), "candump", "-n", "1", "vcan0")
    assert eventually(
        lambda: b"vcan0" in run(*join(sandbox), "cat", "/proc/net/can/rcvlist_all").stdout
    )
    assert run(*join(sandbox), "cansend", "vcan0", "123#AB").returncode == 0
    assert dump.communicate(timeout=LIMIT_S)[0].split() == b"vcan0 123 [1] AB".split()
    assert run(*join(sandbox), *PYTHON, MULTICAST).stdout == b"tick\n"
    script = "cat /proc/sys/net/core/rmem_max /sys/class/net/vcan0/tx_queue_len"
    result = run(*join(sandbox), "sh", "-c", script + "; echo $LCM_DEFAULT_URL")
    assert result.stdout.split() == [
        b"67108864",
        b"1000",
        b"udpm://239.255.76.67:7667?ttl=0",
    ]


def test_streams_are_exact_and_apart(sandbox: str) -> None:
    data = random.Random(1).randbytes(1_000_003)
    result = run(*join(sandbox), "sh", "-c", "cat; printf 'a\\nb' >&2", input=data)
    assert result.stdout == data
    assert result.stderr == b"a\nb"


def test_output_of_the_main_command_is_not_cut(tmp_path: Path) -> None:
    data = random.Random(2).randbytes(5_000_000)
    (tmp_path / "data").write_bytes(data)
    result = run(*UML, "sh", "-c", "cat data; printf end >&2; exit 3", cwd=tmp_path)
    assert result.stdout == data
    assert (result.returncode, result.stderr) == (3, b"end")


def test_output_comes_promptly(sandbox: str) -> None:
    process = start(*join(sandbox), "sh", "-c", "printf now; sleep 20")
    begin = time.monotonic()
    assert process.stdout is not None and process.stdout.read(3) == b"now"
    assert time.monotonic() - begin < 5
    process.terminate()
    process.wait(LIMIT_S)


def test_a_reader_that_stops_does_not_stop_the_others(sandbox: str) -> None:
    stuck = start(*join(sandbox), "sh", "-c", "head -c 4000000 /dev/zero; echo all written >&2")
    assert stuck.stdout is not None and os.read(stuck.stdout.fileno(), 1) == b"\0"
    assert run(*join(sandbox), "echo", "free").stdout == b"free\n"
    assert not select.select([stuck.stderr], [], [], 0.5)[0], "what is not read must wait inside"
    assert stuck.communicate(timeout=LIMIT_S) == (bytes(4_000_000 - 1), b"all written\n")


def test_a_reader_that_goes_away_ends_the_command(sandbox: str) -> None:
    stuck = start(*join(sandbox), "cat", "/dev/zero")
    assert stuck.stdout is not None and os.read(stuck.stdout.fileno(), 1) == b"\0"
    stuck.stdout.close()  # as `| head` does: SIGPIPE ends the command
    assert stuck.wait(LIMIT_S) == 128 + signal.SIGPIPE


def test_arguments_environment_and_folder_arrive(sandbox: str, tmp_path: Path) -> None:
    folder = tmp_path / "two words"
    folder.mkdir()
    words = ["a b", "line\nline", "", '"$HOME"', "\\", "é"]
    script = 'printf "%s|" "$@"; printf "%s|" "$ODD"; pwd; umask'
    result = run(
        *join(sandbox),
        "sh",
        "-c",
        script,
        "sh",
        *words,
        cwd=folder,
        env={**os.environ, "ODD": "x\ny=z"},
        umask=0o027,
    )
    assert result.stdout.decode() == "|".join([*words, "x\ny=z", f"{folder}\n0027\n"])


@pytest.mark.parametrize(
    ("script", "status"),
    [("exit 0", 0), ("exit 42", 42), ("kill -KILL $$", 137), ("kill -SEGV $$", 139)],
)
def test_exit_status(sandbox: str, script: str, status: int) -> None:
    assert run(*join(sandbox), "sh", "-c", script).returncode == status


def test_a_command_that_cannot_start(sandbox: str) -> None:
    missing = run(*join(sandbox), "no-such-command")
    assert missing.returncode == 127
    assert missing.stderr == b"with-vcan: no-such-command: No such file or directory\n"
    forbidden = run(*join(sandbox), "/etc/passwd")
    assert forbidden.returncode == 126
    assert forbidden.stderr == b"with-vcan: /etc/passwd: Permission denied\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_lets_the_command_end_in_order(sandbox: str, number: signal.Signals) -> None:
    way = UML if number == signal.SIGINT else join(sandbox)
    process = start(*way, *PYTHON, UNTIL_SIGNAL)
    assert process.stdout is not None and process.stdout.readline() == b"ready\n"
    process.send_signal(number)
    output, _ = process.communicate(timeout=LIMIT_S)
    assert output.decode() == f"got {number.name}\nended in order\n"
    assert process.returncode == 9


def test_written_files_are_on_the_host_at_the_end(sandbox: str, tmp_path: Path) -> None:
    script = "seq 100000 > closed; exec 3> open; echo data >&3; setsid sleep 1000 &"
    assert run(*join(sandbox), "sh", "-c", script, cwd=tmp_path).returncode == 0
    assert (tmp_path / "closed").read_bytes().split()[-1] == b"100000"
    assert (tmp_path / "open").read_bytes() == b"data\n"


def test_the_clock_runs_at_real_time(sandbox: str) -> None:
    clock = [*join(sandbox), "cut", "-d", " ", "-f", "1", "/proc/uptime"]
    begin, inside = time.monotonic(), float(run(*clock).stdout)
    time.sleep(1.0)
    elapsed = time.monotonic() - begin
    assert float(run(*clock).stdout) - inside == pytest.approx(elapsed, abs=0.5)


def test_forward_serves_a_port_of_the_sandbox() -> None:
    port = free_port()
    process = start(*UML, "--forward", str(port), *PYTHON, SERVE_ONCE.format(port=port))
    assert process.stdout is not None and process.stdout.readline() == b"listening\n"
    for data in (b"short", random.Random(3).randbytes(300_000)):
        with socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S) as connection:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            answer = b"".join(iter(lambda: connection.recv(65536), b""))
        assert answer == data[::-1]
    process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0


def test_a_connection_that_nobody_reads_does_not_hold_the_sandbox() -> None:
    port = free_port()
    process = start(*UML, "--forward", str(port), *PYTHON, SEND_AND_GO.format(port=port))
    assert process.stdout is not None and process.stdout.readline() == b"listening\n"
    with socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S):
        process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0


def test_two_sandboxes_at_once_are_apart(sandbox: str) -> None:
    dump = start(*join(sandbox), "candump", "vcan0")
    other = run(*UML, "sh", "-c", EXCHANGE)
    assert len(other.stdout.splitlines()) == 2
    assert run(*join(sandbox), "cansend", "vcan0", "001#").returncode == 0
    assert output_until_terminated(dump) == b"vcan0 001 [0]".split()


def test_own_failures_are_one_line_and_125(sandbox: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        cases = [
            ([*UML, "--name", sandbox, "true"], f"a sandbox named {sandbox} is running already"),
            ([WITH_VCAN, "--join", "nobody", "true"], "no sandbox named nobody is running"),
            ([*UML, "--forward", str(port), "true"], f"127.0.0.1:{port}: Address already in use"),
            ([WITH_VCAN], "no command given"),
            ([WITH_VCAN, "--mem", "1", "true"], "--mem 1: 64 to 65536"),
            ([WITH_VCAN, "--bogus", "true"], "--bogus"),
        ]
        for command, text in cases:
            result = run(*command)
            assert result.returncode == 125, command
            lines = result.stderr.decode().splitlines()
            assert len(lines) == 1 and lines[0].startswith("with-vcan: ") and text in lines[0]


def test_info_is_one_json_line() -> None:
    result = run(*UML, "--info")
    assert json.loads(result.stdout) == {"way": "uml", "why": "asked for by --uml"}
    assert json.loads(run(WITH_VCAN, "--info").stdout)["way"] in ("native", "uml")


def test_nothing_is_left_behind(tmp_path: Path) -> None:
    def leftovers() -> tuple[set[str], str]:
        names = {
            str(path)
            for folder in ("/tmp", "/dev/shm", os.environ.get("XDG_RUNTIME_DIR", "/tmp"))
            for path in Path(folder).iterdir()
        }
        return names, Path("/proc/mounts").read_text()

    before = leftovers()
    (tmp_path / "home").mkdir()
    process = start(
        *UML,
        "--name",
        f"left-{os.getpid()}",
        "sh",
        "-c",
        "sleep 100 & setsid sleep 100 & echo up; sleep 1",
        env={**os.environ, "HOME": str(tmp_path / "home")},
    )
    assert process.stdout is not None and process.stdout.readline() == b"up\n"
    family = children_of(process.pid)
    process.wait(LIMIT_S)
    assert len(family) > 3 and not alive(family)
    names, mounts = leftovers()
    mine = {name for name in names - before[0] if "vcan" in name or "uml" in name}
    assert not mine and mounts == before[1]
    assert not list((tmp_path / "home").iterdir())


@pytest.mark.parametrize("who", ["client", "hub"])
def test_a_kill_leaves_no_process_and_frees_the_name(who: str) -> None:
    name = f"kill-{who}-{os.getpid()}"
    process = start(*UML, "--name", name, "sh", "-c", "echo up; sleep 1000")
    assert process.stdout is not None and process.stdout.readline() == b"up\n"
    family = children_of(process.pid)
    assert len(family) >= 3
    if who == "client":
        process.kill()
    else:
        hub = min(family)
        os.kill(hub, signal.SIGKILL)
        assert process.communicate(timeout=LIMIT_S)[1] == b"with-vcan: the sandbox is gone\n"
        assert process.returncode == 125
    assert eventually(lambda: not alive(family), 10), alive(family)
    assert run(*UML, "--name", name, "true").returncode == 0


def test_native_way_inside_user_mode_linux(sandbox: str) -> None:
    """The kernel of user-mode Linux has CAN: with-vcan in it must take the native way."""
    inside = [*join(sandbox), WITH_VCAN]
    assert json.loads(run(*inside, "--info").stdout)["way"] == "native"
    dump = start(*join(sandbox), "candump", "vcan0")
    result = run(*inside, "sh", "-c", EXCHANGE + "exit 5")
    assert (result.returncode, len(result.stdout.splitlines())) == (5, 2)
    assert run(*inside, *PYTHON, MULTICAST).stdout == b"tick\n"
    assert run(*join(sandbox), "cansend", "vcan0", "001#").returncode == 0
    assert output_until_terminated(dump) == b"vcan0 001 [0]".split(), "not private"


def test_native_way_needs_no_root_and_ends_its_processes(sandbox: str) -> None:
    inside = [*join(sandbox), *LEAST_PRIVILEGED, WITH_VCAN]
    result = run(*inside, "sh", "-c", EXCHANGE + "setsid sleep 4321 & sleep 0.2", cwd="/")
    assert len(result.stdout.splitlines()) == 2, result.stderr
    left = run(*join(sandbox), "sh", "-c", "grep -alE 'slee[p].4321' /proc/*/cmdline")
    assert left.stdout == b""


def test_native_join_and_signal(sandbox: str) -> None:
    script = f"""
{WITH_VCAN} --name inner sh -c 'echo up; candump -n 1 vcan0' & first=$!
until {WITH_VCAN} --join inner grep -q vcan0 /proc/net/can/rcvlist_all; do sleep 0.2; done
{WITH_VCAN} --join inner cansend vcan0 321#CC
wait $first; echo status $?
{WITH_VCAN} sleep 100 & sleep 1.5; kill -TERM $!; wait $!; echo status $?
"""
    result = run(*join(sandbox), "sh", "-c", script)
    assert result.stdout.split() == b"up vcan0 321 [1] CC status 0 status 143".split()


def test_what_does_not_end_is_killed(unending: dict[str, Any]) -> None:
    """A command that ignores SIGTERM after 10 s, a sandbox that does not answer after 15 s."""
    deaf: Ending = unending["deaf"].result()
    assert deaf.after_s > 5.0
    assert deaf.status == 128 + signal.SIGKILL
    stopped: Ending = unending["stopped"].result()
    assert stopped.words == b"with-vcan: the sandbox does not answer: it was killed\n"
    assert stopped.status == 125
    assert not alive(unending["family"])
