"""Where the project's files are."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# ./rig names the build that it made: build/host, or build/host-fixed for --fixed.
BUILD = Path(os.environ.get("HPMC_BUILD", ROOT / "build" / "host"))
NUMBERS = "fixed" if BUILD.name == "host-fixed" else "float"  # of the joint controllers
# The image for the board, in the same numbers.
IMAGES = BUILD.with_name("stm32f405-fixed" if NUMBERS == "fixed" else "stm32f405")
CONFIG = ROOT / "sim_host" / "config"
RUNS = Path(os.environ.get("HPMC_RUNS", ROOT / "runs"))
WITH_VCAN = ROOT / "tools" / "with-vcan"
LAUNCHER = ROOT / "tools" / "hpmc" / "launcher.py"

# Where whoever looks on finds a run (sim_host/link/lcm_link.h).
DEFAULT_TELEMETRY_URL = "udpm://239.255.76.67:7667?ttl=0"

PROGRAMS = {
    "arm_sim": BUILD / "sim_host" / "apps" / "arm_sim",
    "bench_bridge": BUILD / "sim_host" / "apps" / "bench_bridge",
    "bench": BUILD / "sim_host" / "apps" / "rig_bench",
    "hpmc_config": BUILD / "sim_host" / "apps" / "hpmc_config",
    "hpmc_host": BUILD / "sim_host" / "apps" / "hpmc_host",
    "motor_node": BUILD / "firmware" / "port" / "motor_node",
    "run_logger": BUILD / "sim_host" / "apps" / "run_logger",
    "sil": BUILD / "sim_host" / "apps" / "sil",
    "telemetry_relay": BUILD / "sim_host" / "apps" / "telemetry_relay",
}
