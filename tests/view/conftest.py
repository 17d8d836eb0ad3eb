"""What the tests of ./rig view share: a sil run at human speed, the viewer beside it, addresses."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hpmc.layout import CONFIG, PROGRAMS, ROOT

sys.path.insert(0, str(Path(__file__).parent))

# So that these tests run without any setting, as the others do.
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT / "tools")}


def free_udp_port() -> int:
    """One that the system has free now; multicast of another test would need the same one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def lcm_url() -> str:
    return f"udpm://239.255.76.67:{free_udp_port()}?ttl=0"


def until(ask: Callable[[], object], what: str, limit_s: float = 60.0) -> None:
    """Asks until it is so."""
    limit = time.monotonic() + limit_s
    while not ask():
        assert time.monotonic() < limit, f"not within {limit_s:.0f} s: {what}"
        time.sleep(0.02)


@contextmanager
def process(*command: str | Path) -> Iterator[subprocess.Popen[str]]:
    """A process with its standard output to read; asked to end, and ended, with the block."""
    started = subprocess.Popen(
        [str(word) for word in command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, cwd=ROOT, env=ENVIRONMENT, start_new_session=True,
    )  # fmt: skip
    try:
        yield started
    finally:
        started.send_signal(signal.SIGINT)
        try:
            started.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            os.killpg(started.pid, signal.SIGKILL)
            started.communicate()


@contextmanager
def sil_at_human_speed(url: str, log: Path) -> Iterator[subprocess.Popen[str]]:
    """A run whose first reach lasts ten minutes."""
    with process(
        PROGRAMS["sil"], "--config", CONFIG / "clock.toml", "--set", "experiment.period_s=600",
        "--realtime", "--lcm-url", url, "--log", log,
    ) as run:  # fmt: skip
        assert run.stdout is not None
        line = run.stdout.readline()
        assert line.startswith("PROGRESS"), line  # it has begun
        yield run


@contextmanager
def viewer(*arguments: str | Path) -> Iterator[str]:
    """`./rig view`; where its page is."""
    with process(sys.executable, "-m", "hpmc", "view", *arguments) as program:
        assert program.stdout is not None
        line = program.stdout.readline()
        found = re.match(r"open (http://127\.0\.0\.1:\d+/)", line)
        assert found, line
        yield found.group(1)


@pytest.fixture(scope="session")
def run_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run."""
    folder = tmp_path_factory.mktemp("run")
    subprocess.run(
        [PROGRAMS["sil"], "--config", CONFIG / "clock.toml", "--set", "experiment.period_s=0.5",
         "--log", folder / "run.lcmlog"],
        check=True, stdout=subprocess.DEVNULL, timeout=120,
    )  # fmt: skip
    return folder




@pytest.fixture(scope="session")
def replay_url(run_log: Path) -> Iterator[str]:
    """A viewer of that run."""
    with viewer(run_log) as url:
        yield url
