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
from typing import Any

import lcm
import numpy as np

from hpmc.kinematics import ClockGeometry
from hpmc.lcm_types import TYPE_FOLDER, LcmType, Member, load_type

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


AWKWARD_NUMBERS = (math.nan, -0.0, 1e-310, 0.1 + 0.2, -1.2345678901234567e300, 1 / 3)
AWKWARD_TEXT = ('a, "b"\nc = 1', "", "Grad °")
INTEGER_BITS = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}


def channel_types() -> dict[str, LcmType]:
    """A channel for every .lcm file that describes a whole message, two of one with a number."""
    types = [load_type(path.stem) for path in sorted(TYPE_FOLDER.glob("*.lcm"))]
    whole = [t for t in types if t.members[0].name == "utime"]
    channels = {t.name.removesuffix("_t").upper(): t for t in whole}
    return channels | {"JOINT_TORQUE_2": load_type("joint_torque_t")}


def write_every_type(path: Path, count: int = 40, seed: int = 1, first: int = 0) -> None:
    """Messages of all types, `count` per channel and 1 ms apart, with values that are awkward."""
    random = np.random.default_rng(seed)
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for number in range(first, first + count):
        for channel, lcm_type in channel_types().items():
            message = filled(lcm_type, random, number)
            message.utime, message.seq = 1000 * number, number
            log.write_event(message.utime, channel, message.encode())
    log.close()


def filled(lcm_type: LcmType, random: np.random.Generator, number: int) -> Any:
    """A message of any type with random content; arrays that vary have 0 to 4 elements."""
    message = getattr(message_types(), lcm_type.name)()
    counters = {d for m in lcm_type.members for d in m.dimensions if not d.isdigit()}
    sizes = dict.fromkeys(counters, number % 5)
    for member in lcm_type.members:
        shape = [int(d) if d.isdigit() else sizes[d] for d in member.dimensions]
        value = sizes.get(member.name)
        if value is None:
            value = _value(member, shape, random, number)
        setattr(message, member.name, value)
    return message


def _value(member: Member, shape: list[int], random: np.random.Generator, number: int) -> Any:
    if shape:
        values = [_value(member, shape[1:], random, number) for _ in range(shape[0])]
        return bytes(values) if member.type_name == "byte" and len(shape) == 1 else values
    if member.type_name in INTEGER_BITS:
        most = 1 << (INTEGER_BITS[member.type_name] - 1)
        return int(random.choice([-most, most - 1, int(random.integers(-most, most)), 0]))
    if member.type_name == "string":
        return AWKWARD_TEXT[number % len(AWKWARD_TEXT)]
    if member.type_name == "byte":
        return int(random.integers(256))
    if member.type_name == "boolean":
        return bool(random.integers(2))
    if member.type_name in ("float", "double"):
        return float(random.choice([random.normal(), *AWKWARD_NUMBERS]))
    return filled(load_type(member.type_name.rpartition(".")[2]), random, number)
