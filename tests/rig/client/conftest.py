"""A bus with motor nodes on it, and python-canopen as the master. Runs inside tools/with-vcan."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import canopen
import pytest

from hpmc.layout import PROGRAMS, ROOT

IFACE = "vcan0"
EDS = ROOT / "firmware" / "od" / "motor_node.eds"
START_S = 5.0

if "HPMC_CLIENT_CAPTURE" not in os.environ:  # started by tests/rig/test_client.py only
    collect_ignore_glob = ["test_*"]


def until(condition: Callable[[], object], limit_s: float = 2.0) -> None:
    """Waits for something to become true."""
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.005)


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
    network.sync.stop()
    network.disconnect()


class Bench:
    """Starts native nodes, and ends them."""

    def __init__(self) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []

    def start(self, node_id: int, *options: str) -> subprocess.Popen[bytes]:
        words = [str(PROGRAMS["motor_node"]), "--free-running", "--can", IFACE]
        process = subprocess.Popen([*words, "--id", str(node_id), *options], stdout=subprocess.PIPE)
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
    node.sdo.RESPONSE_TIMEOUT = 1.0
    bench.start(5)
    until(lambda: node.nmt.state == "PRE-OPERATIONAL")
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
