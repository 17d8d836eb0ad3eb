"""Native nodes on vcan0 in place of boards. Runs inside tools/with-vcan (test_bench.py)."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterator

import pytest

from hpmc.kinematics import ClockGeometry
from hpmc.layout import PROGRAMS

IFACE = "vcan0"
HOME_RAD = ClockGeometry().posture(0)

if "HPMC_BENCH_INSIDE" not in os.environ:
    collect_ignore_glob = ["test_*"]


class Boards:
    """Starts the nodes, and ends them."""

    def __init__(self) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []

    def start(self, *options: str, of_joint: dict[int, list[str]] | None = None) -> None:
        for joint in (1, 2, 3):
            own = (of_joint or {}).get(joint, [])
            command = [str(PROGRAMS["motor_node"]), "--free-running", "--can", IFACE,
                       "--id", str(joint), "--referenced", *options, *own]  # fmt: skip
            process = subprocess.Popen(command, stdout=subprocess.PIPE)
            self.processes.append(process)
            # A board has a processor of its own: the loop's processes must not starve it.
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(50))
            assert process.stdout is not None and process.stdout.readline() == b"READY\n"

    def start_with_joints(self, of_joint: dict[int, list[str]] | None = None) -> None:
        """Each with an absolute encoder and a joint of its own, heavy as an arm's, at home."""
        angles = {
            joint: ["--angle-rad", f"{HOME_RAD[joint - 1]:.6f}", *(of_joint or {}).get(joint, [])]
            for joint in (1, 2, 3)
        }
        self.start("--inertia", "1", "--viscous-friction", "0.5", of_joint=angles)

    def stop(self) -> None:
        for process in self.processes:
            process.terminate()
        for process in self.processes:
            process.wait(5.0)
        self.processes = []


@pytest.fixture
def boards() -> Iterator[Boards]:
    boards = Boards()
    yield boards
    boards.stop()
