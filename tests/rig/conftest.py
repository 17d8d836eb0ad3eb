"""Runs that several tests look at, each made once."""

from __future__ import annotations

from pathlib import Path

import pytest
from rigrun import SHORT, Run, run_rig


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="session")
def vcan(runs: Path) -> Run:
    """`./rig run clock` with nothing else: 16 reaches on a CAN bus, full log."""
    return run_rig(folder=runs / "vcan")


@pytest.fixture(scope="session")
def vcan_realtime(runs: Path) -> Run:
    """The same again, held to the wall clock."""
    return run_rig("--pace", "realtime", folder=runs / "vcan_realtime")


@pytest.fixture(scope="session")
def sil(runs: Path) -> Run:
    """The same in one process, with figures."""
    return run_rig("--mode", "sil", folder=runs / "sil")


@pytest.fixture(scope="session")
def short_sil(runs: Path) -> Run:
    return run_rig("--mode", "sil", *SHORT, folder=runs / "short_sil")


@pytest.fixture(scope="session")
def short_injected(runs: Path) -> Run:
    """Sensors and torques over the bus."""
    return run_rig("--mode", "sil", "--sensors", "injected", *SHORT, folder=runs / "injected")


@pytest.fixture(scope="session")
def short_fast(runs: Path) -> Run:
    """Joint loop at 5 kHz."""
    return run_rig("--mode", "sil", "--joint-rate-hz", "5000", *SHORT, folder=runs / "fast")
