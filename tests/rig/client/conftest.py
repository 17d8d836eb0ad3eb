"""A bus with motor nodes on it, and python-canopen as the master. Runs inside tools/with-vcan."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import canopen
import pytest

from hpmc.layout import NUMBERS, ROOT
from hpmc.node import command as node_command
from hpmc.node import parser as node_parser

IFACE = "vcan0"
EDS = ROOT / "firmware" / "od" / "motor_node.eds"
START_S = 5.0

if "HPMC_CLIENT_CAPTURE" not in os.environ:  # started by tests/rig/test_client.py only
    collect_ignore_glob = ["test_*"]


def until(condition: Callable[[], object], limit_s: float = 5.0) -> None:
    """Waits for something to become true."""
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.005)


def until_booted(node: canopen.RemoteNode) -> None:
    until(lambda: node.nmt.state == "PRE-OPERATIONAL")


@pytest.fixture(scope="session", autouse=True)
def capture() -> Iterator[None]:
    with Path(os.environ["HPMC_CLIENT_CAPTURE"]).open("wb") as file:
        dump = subprocess.Popen(["candump", "-L", IFACE], stdout=file)
        yield
        dump.terminate()
        dump.wait()


@pytest.fixture
def network() -> Iterator[canopen.Network]:
    network = canopen.Network()
    network.connect(interface="socketcan", channel=IFACE)
    yield network
    with contextlib.suppress(can.CanError):  # a test may have stopped it already
        network.sync.stop()
    network.disconnect()


def home(drive: canopen.BaseNode402) -> None:
    """Homing by BaseNode402. It may look at a statusword of before its own command, then it says
    that the homing was interrupted: asking again tells."""
    assert any(drive.homing(timeout=5.0) for _ in range(3))


@contextlib.contextmanager
def ticks(network: canopen.Network, node_id: int) -> Iterator[None]:
    """Closes the node's ticks by RPDO4: in the stepped time base it answers at them alone."""
    ended = threading.Event()

    def close_ticks() -> None:
        for tick in itertools.count():
            network.send_message(0x500 + node_id, bytes((0, 0, 0, 0, tick % 256, 0, 250, 0)))
            if ended.wait(0.002):
                return

    closer = threading.Thread(target=close_ticks)
    closer.start()
    try:
        yield
    finally:
        ended.set()
        closer.join()


class Bench:
    """Starts native nodes, and ends them."""

    def __init__(self) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []

    def start(self, node_id: int, *options: str) -> subprocess.Popen[bytes]:
        fixed = ["--fixed"] if NUMBERS == "fixed" else []
        words = ["--can", IFACE, "--id", str(node_id), *fixed, *options]
        command = node_command(node_parser().parse_args(words))  # as ./rig node starts it
        process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self.processes.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == b"READY\n"
        return process

    def stop(self) -> None:
        for process in self.processes:
            process.terminate()
        statuses = [process.wait(5.0) for process in self.processes]
        self.processes = []
        assert set(statuses) <= {0}


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.stop()


@pytest.fixture
def node(bench: Bench, network: canopen.Network) -> canopen.BaseNode402:
    """Node 5, booted and pre-operational."""
    node = canopen.BaseNode402(5, str(EDS))
    network.add_node(node)
    # A loaded machine may hold up this client for longer than the library's patience.
    node.sdo.RESPONSE_TIMEOUT = 2.0
    node.TIMEOUT_CHECK_TPDO = 1.0
    node.TIMEOUT_SWITCH_OP_MODE = 2.0
    node.TIMEOUT_SWITCH_STATE_SINGLE = 2.0
    node.TIMEOUT_SWITCH_STATE_FINAL = 4.0
    bench.start(5)
    until_booted(node)
    return node


@pytest.fixture
def drive(node: canopen.BaseNode402, network: canopen.Network) -> Iterator[canopen.BaseNode402]:
    """The same node operational, with SYNC and the cyclic command running."""
    node.setup_402_state_machine()
    node.sdo[0x1400][5].raw = 200  # ms: a client in Python is no real-time master
    node.nmt.state = "OPERATIONAL"
    network.sync.start(0.005)
    command = node.rpdo[1]
    command["Target position"].raw = 0
    command["Target torque"].raw = 0
    command["Max torque"].raw = 0
    command.start(0.005)
    until(lambda: node.nmt.state == "OPERATIONAL")
    yield node
    command.stop()
