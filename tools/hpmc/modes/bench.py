"""Real boards, or nodes in their place, on a CAN interface of this machine, by the wall clock."""

import json
import stat
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hpmc.configuration import Configuration, ConfigurationError
from hpmc.experiment import Experiment
from hpmc.layout import PROGRAMS
from hpmc.modes.job import Job, Outcome
from hpmc.modes.vcan import LOG, run_session

OVERRIDES = ("bus.pipeline=2",)
BITRATE = 1_000_000
INJECTED_SYNC_MAX_HZ = 500  # on a physical bus
SLCAN = "slcan:"
MULTICAST_GROUP = "239.255.76.67"


@dataclass(frozen=True)
class Interface:
    """A CAN interface as far as a run has to know it."""

    name: str
    virtual: bool  # of kind vcan: nothing can move


def find_interface(name: str) -> Interface:
    """Raises ConfigurationError where it cannot carry the rig's frames."""
    where = f"--can {name}"
    if name.startswith(SLCAN):
        address = name.removeprefix(SLCAN)
        device = Path(address.partition("@")[0])  # slcan:DEVICE@BAUD
        is_device = device.exists() and stat.S_ISCHR(device.stat().st_mode)
        if not (is_device or address.startswith("tcp:")):
            raise ConfigurationError(f"{where}: {device} is no serial device")
        return Interface(name, virtual=False)
    told = subprocess.run(
        ["ip", "-j", "-d", "link", "show", "dev", name], capture_output=True, text=True, timeout=10
    )
    if told.returncode != 0:
        raise ConfigurationError(
            f"{where}: there is no such interface here; without hardware: tools/with-vcan, "
            "docs/bench.md"
        )
    return interface_of(name, json.loads(told.stdout)[0])


def interface_of(name: str, link: dict[str, Any]) -> Interface:
    """From what `ip -j -d link show` tells."""
    where = f"--can {name}"
    if link.get("link_type") != "can":
        raise ConfigurationError(f"{where}: is of type {link.get('link_type')}, not can")
    info = link.get("linkinfo", {})
    virtual = info.get("info_kind") == "vcan"
    if "UP" not in link.get("flags", ()):
        setting = "" if virtual else f" type can bitrate {BITRATE}"
        raise ConfigurationError(f"{where}: is down; ip link set {name} up{setting}")
    bitrate = info.get("info_data", {}).get("bittiming", {}).get("bitrate", BITRATE)
    if bitrate != BITRATE:
        raise ConfigurationError(f"{where}: runs at {bitrate} bit/s, must be {BITRATE}")
    return Interface(name, virtual)


def bus_load_percent(configuration: Configuration) -> float:
    """At worst, at the wall-clock rate of SYNC."""
    return configuration.bus_load_worst_percent * sync_hz(configuration) / 1000.0


def sync_hz(configuration: Configuration) -> int:
    return int(configuration.values["bench"]["sync_Hz"])


def is_injected(configuration: Configuration) -> bool:
    return bool(configuration.values["rig"]["sensors"] == "injected")


def check(experiment: Experiment, configuration: Configuration) -> None:
    if experiment.jobs > 1:
        raise ConfigurationError("--jobs: goes with --mode sil")
    if experiment.uml:
        raise ConfigurationError("--uml: goes with --mode vcan")
    if experiment.lcm_url or experiment.targets:
        raise ConfigurationError("--lcm-url and --targets: go with --mode sil and emulated")
    if experiment.fixed:
        raise ConfigurationError("--fixed: the boards have their own firmware in mode bench")
    if experiment.can is None:
        raise ConfigurationError("--can: mode bench needs an interface, e.g. --can can0")
    check_configuration(configuration)
    interface = find_interface(experiment.can)
    check_motion(interface, is_injected(configuration), experiment.yes_move)
    check_load(interface, configuration)
    check_multicast()


def check_configuration(configuration: Configuration) -> None:
    bus = configuration.values["bus"]
    if bus["pipeline"] != 2:
        raise ConfigurationError(
            "bus.pipeline: must be 2 in mode bench, commands go out right after SYNC"
        )
    if bus["command_delay_ms"] > 0:
        raise ConfigurationError("bus.command_delay_ms: goes with --mode sil")
    lowest = configuration.values["joint"]["rate_Hz"] / 10
    if not is_injected(configuration) and sync_hz(configuration) < lowest:
        raise ConfigurationError(
            f"bench.sync_Hz: must be at least {lowest:.0f} with a real arm, a node takes at most "
            "10 joint ticks a SYNC"
        )


def check_motion(interface: Interface, injected: bool, yes_move: bool) -> None:
    if interface.name.startswith(SLCAN) and injected:
        raise ConfigurationError(
            f"--can {interface.name}: host and bench_bridge cannot share a serial device; put the "
            "adapter under the kernel's driver (slcand) for --sensors injected"
        )
    if not (interface.virtual or injected or yes_move):
        raise ConfigurationError(
            f"--can {interface.name}: is no virtual interface, real joints would move; "
            "--yes-move says that all stand clear (docs/safety.md)"
        )


def check_load(interface: Interface, configuration: Configuration) -> None:
    """A virtual bus has no bit rate."""
    if interface.virtual:
        return
    rate, load = sync_hz(configuration), bus_load_percent(configuration)
    if is_injected(configuration) and rate > INJECTED_SYNC_MAX_HZ:
        raise ConfigurationError(
            f"bench.sync_Hz: {rate} Hz with injected sensors are {load:.1f} % of {interface.name} "
            f"at worst; on a physical bus at most {INJECTED_SYNC_MAX_HZ}, --set bench.sync_Hz="
            f"{INJECTED_SYNC_MAX_HZ}"
        )
    if load > 100.0:
        raise ConfigurationError(
            f"bench.sync_Hz: {rate} Hz are {load:.1f} % of {interface.name} at worst"
        )


def check_multicast() -> None:
    told = subprocess.run(
        ["ip", "-4", "route", "get", MULTICAST_GROUP], capture_output=True, text=True, timeout=10
    )
    if told.returncode != 0 or "unreachable" in told.stdout:
        raise ConfigurationError(
            "LCM has no multicast route here; ip link set lo up multicast on && "
            "ip route add 224.0.0.0/4 dev lo"
        )


def bench_plan(job: Job, log: Path) -> dict[str, Any]:
    """What the launcher starts."""
    config = ["--config", str(job.config_file)]
    log_level = ["--log-level", job.log_level]
    can = ["--can", str(job.can)]
    processes = {
        "run_logger": [str(PROGRAMS["run_logger"]), "--log", str(log), *log_level],
        "hpmc_host": [str(PROGRAMS["hpmc_host"]), "--bench", *config, *can, *log_level],
    }
    if is_injected(job.configuration):
        processes["bench_bridge"] = [str(PROGRAMS["bench_bridge"]), *config, *can]
        processes["arm_sim"] = [str(PROGRAMS["arm_sim"]), "--bridged", *config]
    return {"processes": processes}


def run(job: Job) -> Outcome:
    return run_session(job, bench_plan(job, job.folder / LOG), [])
