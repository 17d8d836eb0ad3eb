"""The fixed-point build: free of floating point on cores without it, and as good in the experiment.

The runs take the programs of build/host and build/host-fixed as they are; `./rig test` makes both.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from test_rig import Rig, of

from hpmc.layout import WITH_VCAN

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
CORES = ("cortex-m3", "cortex-m0plus")

# What the library may take from elsewhere. Any other name, above all a helper for float or double
# (__aeabi_fadd, __aeabi_d2iz, __addsf3, __muldf3, ...), has no business in the fixed build.
INTEGER_HELPERS = {
    "__aeabi_uldivmod",  # 64-bit division: configuration, torque slope, node_drive.c
    "__clzsi2",  # leading zeros, M0+ has no instruction for them: number_fixed.h
    "__aeabi_ldivmod",
    "__aeabi_lmul",  # 64-bit product, M0+ has no instruction for it
    "__aeabi_uidiv",  # 32-bit division, M0+ likewise
    "__aeabi_uidivmod",
    "__aeabi_idiv",
    "__aeabi_idivmod",
    "__gnu_thumb1_case_sqi",  # jump tables of the M0+
    "__gnu_thumb1_case_uqi",
    "__gnu_thumb1_case_shi",
    "__gnu_thumb1_case_uhi",
}
LIBRARY = {"memcpy", "memset", "memcmp", "memmove", "strlen"}


def symbols(core: str, folder: Path, *options: str) -> tuple[set[str], set[str]]:
    """Undefined and defined symbols of the firmware library, compiled for a core without FPU."""
    sources = [
        source for part in ("canopen", "cia402", "control", "node", "od")
        for source in sorted((FIRMWARE / part).glob("*.c"))
    ]  # fmt: skip
    assert len(sources) > 15
    subprocess.run(
        ["arm-none-eabi-gcc", f"-mcpu={core}", "-mthumb", "-mfloat-abi=soft", "-std=c11", "-O2",
         "-ffp-contract=off", f"-I{FIRMWARE}", *options, "-c", *map(str, sources)],
        cwd=folder, check=True,
    )  # fmt: skip
    objects = [str(path) for path in folder.glob("*.o")]
    lines = subprocess.run(
        ["arm-none-eabi-nm", "--format=posix", *objects],
        check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    entries = [line.split() for line in lines if not line.endswith(":")]
    undefined = {name for name, kind, *_ in entries if kind == "U"}
    return undefined, {name for name, kind, *_ in entries if kind != "U"}


@pytest.mark.parametrize("core", CORES)
def test_no_floating_point_symbol_without_fpu(core: str, tmp_path: Path) -> None:
    undefined, defined = symbols(core, tmp_path, "-DCONTROL_FIXED_POINT")
    assert {"motor_node_step", "fic_step", "torque_guard"} <= defined
    assert undefined - defined - LIBRARY <= INTEGER_HELPERS


def test_the_float_build_would_be_found(tmp_path: Path) -> None:
    undefined, _ = symbols("cortex-m3", tmp_path)
    assert {"__aeabi_fmul", "__aeabi_fdiv", "__aeabi_i2f"} <= undefined - INTEGER_HELPERS


def test_fixed_builds_and_chooses_its_own_programs(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    for fetched in ("unity/src/unity.c", "svd/STM32F40x.svd"):
        (tmp_path / "build" / fetched).parent.mkdir(parents=True)
        (tmp_path / "build" / fetched).touch()
    for arguments, build in (
        (["run", "clock"], "host"),
        (["run", "clock", "--fixed"], "host-fixed"),
        (["node", "--fixed", "--id", "1"], "host-fixed"),
        (["test", "--fixed"], "host"),
    ):
        status, output, calls = rig.run(*arguments)
        assert status == 0, output
        presets = {call.split("--preset ")[1].split()[0] for call in of("cmake", calls)}
        assert presets == (set() if arguments[0] == "test" else {build})
        environment = (rig.fakes / "python-environment").read_text().splitlines()
        assert f"HPMC_BUILD={rig.folder}/build/{build}" in environment
        types = f"{rig.folder}/build/{build}/lcm_types/python"
        assert f"PYTHONPATH={rig.folder}/tools:{types}" in environment


def run_clock(folder: Path, *arguments: str, numbers: str = "float") -> dict[str, Any]:
    """A run in one process: its summary."""
    build = ROOT / "build" / {"float": "host", "fixed": "host-fixed"}[numbers]
    out = folder / numbers
    command = [sys.executable, "-m", "hpmc", "run", "clock", "--mode", "sil", "--no-figures"]
    fixed = ["--fixed"] if numbers == "fixed" else []
    done = subprocess.run(
        [*command, *fixed, "--out", str(out), *arguments],
        env=os.environ | {"PYTHONPATH": str(ROOT / "tools"), "HPMC_BUILD": str(build)},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


def test_1600_reaches_are_as_in_float(tmp_path: Path) -> None:
    arguments = ("--repetitions", "100", "--jobs", "2", "--log", "none")
    summaries = {numbers: run_clock(tmp_path, *arguments, numbers=numbers)
                 for numbers in ("float", "fixed")}  # fmt: skip
    for numbers, summary in summaries.items():
        assert (summary["numbers"], summary["reaches"]) == (numbers, 1600)
    r = {numbers: summary["executed"]["r_mean"] for numbers, summary in summaries.items()}
    rmse = {numbers: s["position_rmse_mm"]["mean"] for numbers, s in summaries.items()}
    print(f"r {r}, position RMSE {rmse} mm")
    assert r["float"] != r["fixed"]  # else the same programs ran
    assert r["fixed"] == pytest.approx(r["float"], abs=0.02)
    assert rmse["fixed"] == pytest.approx(rmse["float"], abs=0.03)


def test_joints_at_5_khz(tmp_path: Path) -> None:
    summary = run_clock(tmp_path, "--repetitions", "10", "--jobs", "2", "--log", "none",
                        "--joint-rate-hz", "5000", numbers="fixed")  # fmt: skip
    assert 1.75 <= summary["executed"]["r_mean"] <= 1.95
    assert summary["position_rmse_mm"]["mean"] < 0.8
    assert summary["position_rmse_mm"]["max"] < 1.2


def test_the_log_names_the_numbers(tmp_path: Path) -> None:
    from hpmc.lcm_log import LcmLog

    for numbers in ("float", "fixed"):
        run_clock(tmp_path, "--log", "states", numbers=numbers)
        info = next(LcmLog(tmp_path / numbers / "run.lcmlog").messages("RUN_INFO"))
        assert info["build"].endswith(f"joint controllers in {numbers}")


def test_a_client_drives_the_node(tmp_path: Path) -> None:
    """`./rig node --fixed` on a bus: states, modes 10 and -1, by python-canopen."""
    client = ROOT / "tests" / "rig" / "client"
    build = ROOT / "build" / "host-fixed"
    done = subprocess.run(
        [str(WITH_VCAN), sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider",
         "--color=no", "-o", "faulthandler_timeout=60", str(client / "test_drive.py"),
         "-k", "mode_10 or follows_a_command"],
        cwd=ROOT, env=os.environ | {"HPMC_CLIENT_CAPTURE": str(tmp_path / "candump.log"),
                                    "PYTHONPATH": str(ROOT / "tools"), "HPMC_BUILD": str(build)},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and "2 passed" in done.stdout, done.stdout + done.stderr


def test_fixed_with_the_float_programs_is_refused(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "hpmc", "run", "clock", "--fixed", "--out", str(tmp_path / "out")],
        env=os.environ | {"PYTHONPATH": str(ROOT / "tools"),
                          "HPMC_BUILD": str(ROOT / "build" / "host")},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and "./rig run --fixed" in done.stderr
    assert not (tmp_path / "out").exists()
