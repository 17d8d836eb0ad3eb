"""Says what this machine can do for the rig, with the fix for each fault, as `./rig doctor`.

Needs the standard library only, changes nothing, and works before anything is installed.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BOOTSTRAP = ROOT / "tools" / "bootstrap"
VENV_PYTHON = ROOT / "build" / "venv" / "bin" / "python"
UML_MODULES = Path("/usr/lib/uml/modules")
PRIVATE_NETWORK = ("unshare", "--user", "--map-root-user", "--net")
MULTICAST_GROUP = "239.255.76.67"

DISK_NEEDED_BYTES = 500_000_000
DISK_WISHED_BYTES = 3_000_000_000
RECEIVE_BUFFER_WISHED_BYTES = 8 << 20
WAKEUPS = 300
LOCKSTEP_TICK_MAX_MS = 0.5  # a wall-clock SYNC of 1 kHz wants to be through in half its period
LOCKSTEP_RUN = (
    "experiment.period_s=0.05", "schedule.setup_s=0.5", "schedule.approach_s=0.05",
    "joint.ramp_s=0.05", "schedule.stop_s=0.15",
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """One line of the report. A note is a fault that does not keep the rig from running."""

    name: str
    status: str  # ok | note | fault
    detail: str
    fix: str | None = None


class Machine:
    """The machine as the checks see it; tests put another one in its place."""

    def run(self, *command: str, limit_s: float = 10.0) -> tuple[int, str]:
        """Exit status (127: no such command, 124: too slow) and all output of a command."""
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT, timeout=limit_s, check=False,
            )  # fmt: skip
        except FileNotFoundError:
            return 127, f"{command[0]}: no such command"
        except subprocess.TimeoutExpired:
            return 124, f"no answer in {limit_s:.0f} s"
        return done.returncode, done.stdout.decode(errors="replace").strip()

    def read(self, path: Path) -> str | None:
        """Text of a file, None where there is none."""
        try:
            return path.read_text()
        except OSError:
            return None

    def glob(self, folder: Path, pattern: str) -> list[Path]:
        """Files below a folder."""
        return sorted(folder.glob(pattern))

    def processors(self) -> int:
        """Processors that this process may use."""
        return len(os.sched_getaffinity(0))

    def free_bytes(self, folder: Path) -> int:
        """Free space of the file system that holds a folder."""
        return shutil.disk_usage(folder).free

    def wakeups_ms(self) -> list[float]:
        """How long sleeps of 1 ms took."""
        taken = []
        for _ in range(WAKEUPS):
            start = time.monotonic()
            time.sleep(0.001)
            taken.append((time.monotonic() - start) * 1e3)
        return taken

    def lockstep_tick_ms(self) -> float | None:
        """Wall time of a tick over vcan and LCM, from a short run; None where there is no build or
        the run fails."""
        if not (ROOT / "build" / "host" / "sim_host" / "apps" / "hpmc_host").exists():
            return None
        settings = [word for setting in LOCKSTEP_RUN for word in ("--set", setting)]
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "run"
            status, _ = self.run(
                "env", f"PYTHONPATH={ROOT / 'tools'}", str(VENV_PYTHON), "-m", "hpmc", "run",
                "clock", "--log", "none", "--no-figures", "--out", str(out), *settings,
                limit_s=120,
            )  # fmt: skip
            if status != 0:
                return None
            summary = json.loads((out / "summary.json").read_text())
        tick_ms: float = summary["wall_s"] / summary["simulated_s"]  # a tick is 1 ms of the run
        return tick_ms


def last_line(status: int, output: str) -> str:
    """What a failed command said in the end."""
    return output.splitlines()[-1] if output else f"exit status {status}"


def as_root(command: str) -> str:
    """A command as the user has to type it."""
    return command if os.geteuid() == 0 else f"sudo {command}"


def listed(machine: Machine, file: str) -> list[str]:
    """Entries of a list in tools/bootstrap."""
    text = machine.read(BOOTSTRAP / file) or ""
    return [entry for line in text.splitlines() if (entry := line.split("#")[0].strip())]


def missing_packages(machine: Machine, group: str) -> list[str]:
    """Debian packages of a group that are not installed."""
    wanted = listed(machine, f"debian-{group}.txt")
    _, output = machine.run("dpkg-query", "-W", "-f", "${Package} ${db:Status-Status}\n", *wanted)
    there = {line.split()[0] for line in output.splitlines() if line.endswith(" installed")}
    return [package for package in wanted if package not in there]


def check_processors(machine: Machine) -> Finding:
    """Two: the simulation's processes take turns on one, the rest runs on the other."""
    count = machine.processors()
    if count >= 2:
        return Finding("processors", "ok", f"{count}")
    return Finding("processors", "note", "1: expect about half the speed; 2 are better")


def check_disk(machine: Machine) -> Finding:
    """Room for packages, build and logs."""
    free = machine.free_bytes(ROOT)
    detail = f"{free / 1e9:.1f} GB free"
    fix = f"du -sh {ROOT}/runs/* shows old runs; rm -r those that are not needed"
    if free < DISK_NEEDED_BYTES:
        return Finding("disk", "fault", detail + ", 0.5 GB are needed", fix)
    if free < DISK_WISHED_BYTES:
        return Finding("disk", "note", detail + ", 3 GB are better for long runs", fix)
    return Finding("disk", "ok", detail)


def check_packages(machine: Machine) -> Finding:
    """Debian packages to build and run."""
    name = "Debian packages"
    if missing := missing_packages(machine, "run"):
        return Finding(name, "fault", "missing: " + " ".join(missing), "./rig build")
    if missing := missing_packages(machine, "test"):
        detail = "all to run; for ./rig test, which installs them: " + " ".join(missing)
        return Finding(name, "note", detail)
    return Finding(name, "ok", "all to run and to test")


def check_python(machine: Machine) -> Finding:
    """The virtual environment, with the locked versions."""
    name = "Python packages"
    anew = "rm -rf build/venv build/stamps && ./rig build"
    status, output = machine.run(str(VENV_PYTHON), "-m", "pip", "freeze")
    if status == 127:
        return Finding(name, "fault", "no virtual environment in build/venv yet", "./rig build")
    if status != 0:
        return Finding(name, "fault", "the virtual environment is broken", anew)
    there = {package_name(line): line for line in output.splitlines()}
    locked = {package_name(line): line for line in listed(machine, "requirements.lock")}
    wrong = [
        package
        for package in listed(machine, "python-run.txt")
        if there.get(package_name(package), "").lower() != locked[package_name(package)].lower()
    ]
    if wrong:
        detail = "absent or not in the locked version: " + " ".join(wrong)
        return Finding(name, "fault", detail, anew)
    return Finding(name, "ok", f"{len(there)} in build/venv")


def package_name(requirement: str) -> str:
    """Normalised name of a requirement such as `Python_can==4.6.1`."""
    return re.sub(r"[-_.]+", "-", requirement.split("==")[0]).lower()


def check_namespaces(machine: Machine) -> Finding:
    """A user and network namespace without privileges."""
    name = "user namespaces"
    status, output = machine.run(*PRIVATE_NETWORK, "true")
    if status == 0:
        return Finding(name, "ok", "a private network can be made without root")
    for key, wanted in (
        ("kernel.unprivileged_userns_clone", "1"),
        ("kernel.apparmor_restrict_unprivileged_userns", "0"),
    ):
        value = machine.read(Path("/proc/sys") / key.replace(".", "/"))
        if value is not None and value.strip() != wanted:
            fix = as_root(f"sysctl -w {key}={wanted}")
            return Finding(name, "fault", f"forbidden by {key}", fix)
    fix = as_root("sysctl -w user.max_user_namespaces=15000")
    return Finding(name, "fault", last_line(status, output), fix)


def check_can(machine: Machine) -> Finding:
    """A vcan device in a network namespace of one's own."""
    name = "CAN in the kernel"
    make_vcan = ("ip", "link", "add", "vcan0", "type", "vcan")
    status, output = machine.run(*PRIVATE_NETWORK, *make_vcan)
    if status == 0:
        return Finding(name, "ok", "a vcan device can be made")
    if machine.run("modinfo", "vcan")[0] == 0:
        fix = as_root("modprobe -a vcan can-raw")
        return Finding(name, "fault", "the module vcan is not loaded", fix)
    detail = f"no vcan device can be made ({last_line(status, output)})"
    fix = as_root("apt-get install linux-image-amd64") + ", then boot that kernel"
    return Finding(name, "fault", detail, fix)


def check_user_mode_linux(machine: Machine) -> Finding:
    """Debian's user-mode kernel, its CAN modules, and that it boots."""
    name = "user-mode Linux"
    if missing := missing_packages(machine, "uml"):
        install = as_root("apt-get install -y --no-install-recommends " + " ".join(missing))
        return Finding(name, "fault", "missing packages: " + " ".join(missing), install)
    again = as_root("apt-get install --reinstall user-mode-linux")
    status, version = machine.run("linux.uml", "--version")
    if status != 0:
        return Finding(name, "fault", "linux.uml does not start", again)
    if not machine.glob(UML_MODULES / version, "kernel/drivers/net/can/vcan.ko*"):
        return Finding(name, "fault", f"no CAN modules for its version {version}", again)
    start = time.monotonic()
    status, output = machine.run(
        str(ROOT / "tools" / "with-vcan"), "--uml", "ip", "link", "show", "vcan0", limit_s=60
    )
    if status != 0 or "vcan0" not in output:
        detail = f"version {version} does not boot: {last_line(status, output)}"
        fix = "tools/with-vcan --uml true shows why; it needs a writable HOME and 512 MB of memory"
        return Finding(name, "fault", detail, fix)
    seconds = time.monotonic() - start
    return Finding(name, "ok", f"version {version}, up with vcan0 in {seconds:.1f} s")


def check_multicast(machine: Machine) -> Finding:
    """A route for LCM's group outside the sandbox: only for those who look on from there."""
    name = "multicast route"
    status, output = machine.run("ip", "-4", "route", "get", MULTICAST_GROUP)
    if status == 0 and "unreachable" not in output:
        return Finding(name, "ok", output.split(" src")[0])
    detail = "none here; runs make their own, only LCM tools outside a run's sandbox lack it"
    up = as_root("ip link set lo up multicast on")
    return Finding(name, "note", detail, up + " && " + as_root("ip route add 224.0.0.0/4 dev lo"))


def check_buffers(machine: Machine) -> Finding:
    """Upper limit of a socket's receive buffer."""
    name = "receive buffers"
    text = machine.read(Path("/proc/sys/net/core/rmem_max"))
    limit = int(text) if text else 0
    if limit >= RECEIVE_BUFFER_WISHED_BYTES:
        return Finding(name, "ok", f"up to {limit >> 10} KiB")
    detail = f"up to {limit >> 10} KiB; 8192 KiB are safer where runs use the machine's own kernel"
    fix = as_root(f"sysctl -w net.core.rmem_max={RECEIVE_BUFFER_WISHED_BYTES}")
    return Finding(name, "note", detail, fix)


def check_timer(machine: Machine) -> Finding:
    """How late a sleeper wakes: a wall-clock bus at 1 kHz wants less than half a millisecond."""
    late_ms = sorted(taken - 1.0 for taken in machine.wakeups_ms())
    median_ms, p99_ms = statistics.median(late_ms), late_ms[int(0.99 * len(late_ms))]
    detail = f"a sleeper wakes {median_ms:.2f} ms late, 99 % within {p99_ms:.2f} ms"
    if p99_ms < 0.5:
        return Finding("timer tick", "ok", detail)
    detail += ": fine in lockstep; a wall-clock bus at 1 kHz will overrun"
    fix = "end what keeps the processors busy, or use a machine with high-resolution timers"
    return Finding("timer tick", "note", detail, fix)


def check_lockstep(machine: Machine, vcan: bool) -> Finding:
    """How long a tick of the whole rig takes over vcan and LCM."""
    name = "lockstep tick"
    if not vcan:
        return Finding(name, "note", "not measured: mode vcan does not run here")
    tick_ms = machine.lockstep_tick_ms()
    if tick_ms is None:
        return Finding(name, "note", "not measured: no run could be made", "./rig build")
    detail = f"{tick_ms:.2f} ms over vcan and LCM, {1.0 / tick_ms:.1f} times real time"
    if tick_ms < LOCKSTEP_TICK_MAX_MS:
        return Finding(name, "ok", detail)
    detail += f"; a wall-clock SYNC of 1 kHz wants less than {LOCKSTEP_TICK_MAX_MS} ms"
    return Finding(name, "note", detail, "use a machine whose own kernel has CAN, or --set "
                   "bench.sync_Hz=100")  # fmt: skip


def examine(machine: Machine) -> tuple[list[Finding], dict[str, str | None]]:
    """All findings, and for each mode how it can run (None: it cannot)."""
    base_checks = (check_processors, check_disk, check_packages, check_python)
    base = [check(machine) for check in base_checks]
    namespaces, can = check_namespaces(machine), check_can(machine)
    uml = check_user_mode_linux(machine)
    rest = [check(machine) for check in (check_multicast, check_buffers, check_timer)]

    native = namespaces.status == can.status == "ok"
    if native:
        uml = demoted(uml, "not needed, since the kernel has CAN")
    elif uml.status == "ok":
        namespaces = demoted(namespaces, "user-mode Linux is used instead")
        can = demoted(can, "user-mode Linux is used instead")

    ready = all(finding.status != "fault" for finding in base)
    sandbox = "native" if native else "user-mode Linux" if uml.status == "ok" else None
    modes = {"sil": "native" if ready else None, "vcan": sandbox if ready else None}
    rest.append(check_lockstep(machine, modes["vcan"] is not None))
    return [*base, namespaces, can, uml, *rest], modes


def demoted(finding: Finding, why: str) -> Finding:
    """A fault that does not matter here becomes a note."""
    if finding.status != "fault":
        return finding
    return Finding(finding.name, "note", f"{finding.detail}: {why}")


def print_report(findings: Sequence[Finding], modes: dict[str, str | None]) -> None:
    """One line for each finding, below it the fix; at the end what runs."""
    for finding in findings:
        mark = "FAULT" if finding.status == "fault" else finding.status
        print(f"{mark:6} {finding.name:18} {finding.detail}")
        if finding.fix is not None:
            print(f"{'':6} {'':18} fix: {finding.fix}")
    words = [f"{mode} {'no' if how is None else f'yes ({how})'}" for mode, how in modes.items()]
    print("\nmodes that run here: " + ", ".join(words))


def main(argv: Sequence[str] | None = None, machine: Machine | None = None) -> int:
    """Entry point: returns 0 when the rig can run in some mode, 1 when not."""
    parser = argparse.ArgumentParser(
        prog="rig doctor", description="What this machine can do, and the fix for each fault."
    )
    parser.add_argument("--json", action="store_true", help="prints the findings as JSON")
    arguments = parser.parse_args(argv)

    findings, modes = examine(machine or Machine())
    if arguments.json:
        print(json.dumps({"checks": [asdict(f) for f in findings], "modes": modes}, indent=2))
    else:
        print_report(findings, modes)
    return 0 if any(modes.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
