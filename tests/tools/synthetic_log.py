"""Logs with known content for the tests, written with LCM's own Python code."""

import importlib
import math
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import lcm

from hpmc.kinematics import ClockGeometry
from hpmc.lcm_types import TYPE_FOLDER

DISTANCE_M = 0.1
MOVEMENT_S = 0.972
TICK_US = 1000
REACH_TICKS = 1000
RIPPLE_MM = 0.5  # of the executed hand about the planned one, along the line, in reach 0
RIPPLE_HZ = 5.0


@lru_cache
def message_types() -> ModuleType:
    """The package hpmc_lcm as lcm-gen makes it."""
    folder = Path(tempfile.mkdtemp(prefix="hpmc_lcm_"))
    try:
        generator = shutil.which("lcm-gen", path=str(Path(sys.executable).parent))
        subprocess.run(
            [
                generator or "lcm-gen",
                "-p",
                "--ppath",
                folder,
                *TYPE_FOLDER.glob("*.lcm"),
            ],
            check=True,
        )
        sys.path.insert(0, str(folder))
        return importlib.import_module("hpmc_lcm")
    finally:
        sys.path.remove(str(folder))
        shutil.rmtree(folder)


def half_cosine(time_s: float) -> tuple[float, float]:
    """Way and speed of the paper's elastic band, m and m/s."""
    t = min(time_s, MOVEMENT_S)
    omega = math.pi / MOVEMENT_S
    way = DISTANCE_M / 2 * (1 - math.cos(omega * t))
    return way, DISTANCE_M / 2 * omega * math.sin(omega * t)


def ripple(time_s: float, reach: int, amplitude_mm: float = RIPPLE_MM) -> tuple[float, float]:
    """How far the executed way is ahead of the planned one, and its rate, m and m/s.

    Grows with the reach, so that reaches differ; ends with the movement, where it is.
    """
    omega = 2 * math.pi * RIPPLE_HZ
    amplitude = amplitude_mm * 1e-3 * (1 + 0.05 * reach)
    rate = amplitude * omega * math.cos(omega * time_s) if time_s < MOVEMENT_S else 0.0
    return amplitude * math.sin(omega * min(time_s, MOVEMENT_S)), rate


def write_clock_log(
    path: Path,
    repetitions: range = range(1),
    reaches: int = 16,
    joint_ticks: int = 1,
    setup_ticks: int = 20,
    ripple_mm: float = RIPPLE_MM,
) -> None:
    """Reaches that are half cosines as planned, and run ahead by `ripple` as executed."""
    types = message_types()
    geometry = ClockGeometry()
    log = lcm.EventLog(str(path), "w", overwrite=True)
    arm, state = types.arm_state_t(), types.hpmc_state_t()
    info = types.run_info_t()
    info.mode, info.seed, info.config_toml = "sil", 7, 'name = "clock"\n'
    log.write_event(0, "RUN_INFO", info.encode())
    for repetition, reach, tick in _ticks(repetitions, reaches, setup_ticks):
        target = reach // 2 + 1 if reach >= 0 else 0
        start, end = geometry.position(0), geometry.position(target)
        if reach % 2:
            start, end = end, start
        line = (end - start) / DISTANCE_M if reach >= 0 else start * 0
        way, speed = half_cosine(tick * TICK_US * 1e-6)
        state.utime = arm.utime + (TICK_US // joint_ticks if arm.seq else 0)
        state.repetition, state.reach, state.target = repetition, reach, target
        state.x_t_m = end.tolist()
        state.x_d_m = (start + way * line).tolist()
        state.v_d_m_s = (speed * line).tolist()
        for joint_tick in range(joint_ticks):
            ahead, ahead_rate = ripple(tick * TICK_US * 1e-6, reach, ripple_mm)
            arm.utime = state.utime + joint_tick * TICK_US // joint_ticks
            # between the host's ticks the hand is put elsewhere: nothing may use it
            astray = 1.0 if joint_tick else 0.0
            arm.hand_m = (start + (way + ahead) * line + astray).tolist()
            arm.hand_m_s = ((speed + ahead_rate) * line + astray).tolist()
            log.write_event(arm.utime, "ARM_STATE", arm.encode())
            arm.seq += 1
            if joint_tick == 0:
                log.write_event(arm.utime, "HPMC_STATE", state.encode())
                state.seq += 1
    log.close()


def _ticks(repetitions: range, reaches: int, setup_ticks: int) -> Iterator[tuple[int, int, int]]:
    for repetition in repetitions:
        yield from ((repetition, -1, 0) for _ in range(setup_ticks))
        for reach in range(reaches):
            yield from ((repetition, reach, tick) for tick in range(REACH_TICKS))
        yield from ((repetition, -1, 0) for _ in range(setup_ticks))
