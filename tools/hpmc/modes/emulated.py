"""As sil, but each node is the flash image itself on an emulated Cortex-M4 (docs/emulated.md)."""

import contextlib
import os
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hpmc.configuration import Configuration, ConfigurationError
from hpmc.experiment import Experiment
from hpmc.firmware_image import ImageError, find_image
from hpmc.layout import IMAGES
from hpmc.modes.job import Job, Outcome
from hpmc.modes.sil import check_one_process_rig, describe_status, line_reader, program
from hpmc.parameter_page import ADDRESSES, device_page
from hpmc.processes import WATCH_S, Child, Watch

OVERRIDES = ("rig.sensors=injected",)
NODE_IDS = (1, 2, 3)
SERIAL_BASE = 1000
END_S = 5.0


def check(experiment: Experiment, configuration: Configuration) -> None:
    if configuration.values["rig"]["sensors"] != "injected":
        raise ConfigurationError(
            "--sensors direct: emulated nodes have no encoder; RPDO4 injects positions"
        )
    if experiment.jobs > 1:
        raise ConfigurationError("--jobs: goes with --mode sil")
    if experiment.pace != "lockstep":
        raise ConfigurationError("--pace realtime: goes with --mode sil and vcan")
    check_one_process_rig(experiment)
    image()


def image() -> Path:
    try:
        return find_image(IMAGES)
    except ImageError as error:
        raise ConfigurationError(f"--mode emulated: {error}") from None


@dataclass
class Board:
    """An emulated board: QEMU with the image, its serial line a TCP port."""

    node_id: int
    port: int
    process: subprocess.Popen[str]
    errors: Path

    @property
    def line(self) -> str:
        return f"slcan:tcp:127.0.0.1:{self.port}"

    def why_ended(self) -> str:
        """Empty while it runs."""
        status = self.process.poll()
        if status is None:
            return ""
        name = f"the emulated board of motor node {self.node_id}"
        if status < 0:
            return f"{name} (QEMU) was killed by {signal.Signals(-status).name}"
        said = self.errors.read_text(errors="replace").strip().splitlines()
        return f"{name} (QEMU) ended with status {status}" + "".join(f": {s}" for s in said[-1:])


def start_board(node_id: int, elf: Path, folder: Path) -> Board:
    """Starts a board.

    Its port is one that the system chose: QEMU is handed the listening socket itself, so nobody
    else can take the port meanwhile, and a client may call before QEMU is ready to answer.
    """
    page = folder / f"node_{node_id}.bin"
    page.write_bytes(device_page(node_id, SERIAL_BASE + node_id).to_bytes())
    errors = folder / f"node_{node_id}.errors"
    cpus = sorted(os.sched_getaffinity(0))
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener, errors.open("w") as said:
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # inherited when accepted
        listener.bind(("127.0.0.1", 0))
        listener.listen(1)
        number = listener.fileno()
        command = [
            # Should ./rig be killed outright, the boards do not stay.
            "setpriv", "--pdeathsig", "KILL",
            # Its two threads hand each byte to one another: across processors that takes longer.
            "taskset", "--cpu-list", str(cpus[node_id % len(cpus)]),
            "qemu-system-arm", "-M", "netduinoplus2", "-nodefaults", "-display", "none",
            "-kernel", str(elf),
            "-device", f"loader,file={page},addr={ADDRESSES[0]:#x},force-raw=on",
            "-chardev", f"socket,id=line,fd={number},server=on,wait=off",
            "-serial", "chardev:line",
        ]  # fmt: skip
        process = subprocess.Popen(
            command, pass_fds=[number], stdin=subprocess.DEVNULL, stdout=said, stderr=said,
            text=True, start_new_session=True,
        )  # fmt: skip
        return Board(node_id, listener.getsockname()[1], process, errors)


@contextlib.contextmanager
def boards(elf: Path) -> Iterator[list[Board]]:
    """Three boards, ended with the context however it is left."""
    with tempfile.TemporaryDirectory(prefix="hpmc-emulated-") as name:
        started: list[Board] = []
        try:
            started.extend(start_board(node_id, elf, Path(name)) for node_id in NODE_IDS)
            yield started
        finally:
            end(started)


def end(started: list[Board]) -> None:
    for board in started:
        board.process.terminate()
    limit = time.monotonic() + END_S
    for board in started:
        try:
            board.process.wait(max(0.0, limit - time.monotonic()))
        except subprocess.TimeoutExpired:
            board.process.kill()
            board.process.wait()


def run(job: Job) -> Outcome:
    outcome = Outcome(logs=[job.folder / "run.lcmlog"])
    began = time.monotonic()
    with Watch() as watch, boards(image()) as started:
        command = program(job, outcome.logs[0])
        for board in started:
            command += ["--node", board.line]
        sil = Child(command, line_reader(outcome, job.bar, 0, 0))
        watch.add(sil)
        outcome.reason = await_end(sil, started)
        sil.wait()
        outcome.interrupted = watch.interrupted
    outcome.wall_s = time.monotonic() - began
    if not outcome.reason and sil.process.returncode != 0 and not outcome.interrupted:
        outcome.reason = "; ".join(sil.errors[-1:]) or describe_status(sil.process.returncode)
    return outcome


def await_end(sil: Child, started: list[Board]) -> str:
    """Waits for sil; returns why a board ended before it, if one did."""
    reason = ""
    while sil.process.poll() is None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            sil.process.wait(WATCH_S)
        # sil sees the line of a board that ended closed, and ends by itself.
        reason = reason or why_a_board_ended(started)
    if sil.process.returncode not in (0, -signal.SIGINT) and not reason:
        time.sleep(WATCH_S)  # a killed board's line may close before its end can be seen
        reason = why_a_board_ended(started)
    return reason


def why_a_board_ended(started: list[Board]) -> str:
    """Empty while all run."""
    return next(filter(None, (board.why_ended() for board in started)), "")
