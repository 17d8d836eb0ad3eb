"""./rig doctor on machines that are made up, and once on this one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hpmc import doctor

UML = "6.1.176"
Answer = tuple[int, str]


class MadeUpMachine(doctor.Machine):
    """A machine where everything is well, but for what a test changes."""

    def __init__(self) -> None:
        self.answers: dict[str, Answer] = {
            "dpkg-query": (0, ""),
            "pip": (0, (doctor.BOOTSTRAP / "requirements.lock").read_text()),
            "unshare true": (0, ""),
            "unshare ip": (0, ""),
            "modinfo": (1, "modinfo: ERROR: Module vcan not found."),
            "linux.uml": (0, UML),
            "with-vcan": (0, "2: vcan0: <NOARP,UP,LOWER_UP>"),
            "ip": (0, "multicast 239.255.76.67 dev lo src 127.0.0.1"),
        }
        self.absent: set[str] = set()
        self.files = {Path("/proc/sys/net/core/rmem_max"): "16777216\n"}
        self.modules = [Path("vcan.ko")]
        self.cores, self.free, self.sleeps = 2, 50_000_000_000, [1.06] * 300
        self.tick_ms: float | None = 0.12

    def run(self, *command: str, limit_s: float = 10.0) -> Answer:
        tool = Path(command[0]).name
        if tool == "dpkg-query":
            there = [name for name in command[4:] if name not in self.absent]
            return 0, "\n".join(f"{name} installed" for name in there)
        if tool == "python":
            tool = "pip"
        if tool == "unshare":
            tool = f"unshare {command[4]}"
        return self.answers[tool]

    def read(self, path: Path) -> str | None:
        return super().read(path) if doctor.BOOTSTRAP in path.parents else self.files.get(path)

    def glob(self, folder: Path, pattern: str) -> list[Path]:
        assert folder.name == UML and "vcan" in pattern
        return self.modules

    def processors(self) -> int:
        return self.cores

    def free_bytes(self, folder: Path) -> int:
        return self.free

    def wakeups_ms(self) -> list[float]:
        return self.sleeps

    def lockstep_tick_ms(self) -> float | None:
        return self.tick_ms


@pytest.fixture
def machine() -> MadeUpMachine:
    return MadeUpMachine()


def examine(machine: MadeUpMachine) -> tuple[dict[str, doctor.Finding], dict[str, str | None], int]:
    findings, modes = doctor.examine(machine)
    return {finding.name: finding for finding in findings}, modes, doctor.main([], machine)


def without_can(machine: MadeUpMachine) -> None:
    machine.answers["unshare ip"] = (2, "Error: Unknown device type.")


def test_where_all_is_well_nothing_is_to_be_fixed(machine: MadeUpMachine) -> None:
    findings, modes, status = examine(machine)
    assert {finding.status for finding in findings.values()} == {"ok"}
    assert {finding.fix for finding in findings.values()} == {None}
    assert modes == {"sil": "native", "vcan": "native"} and status == 0


@pytest.mark.parametrize(
    ("tick_ms", "words"), [(0.7, "0.70 ms over vcan"), (None, "not measured: no run")]
)
def test_a_slow_or_unknown_lockstep_tick_is_a_note(
    machine: MadeUpMachine, tick_ms: float | None, words: str
) -> None:
    machine.tick_ms = tick_ms
    findings, _, status = examine(machine)
    assert findings["lockstep tick"].status == "note" and words in findings["lockstep tick"].detail
    assert findings["lockstep tick"].fix is not None and status == 0


def test_user_mode_linux_stands_in_for_a_kernel_without_can(machine: MadeUpMachine) -> None:
    without_can(machine)
    findings, modes, status = examine(machine)
    assert findings["CAN in the kernel"].status == "note"
    assert findings["CAN in the kernel"].fix is None
    assert modes == {"sil": "native", "vcan": "user-mode Linux"} and status == 0


def test_a_kernel_with_can_needs_no_user_mode_linux(machine: MadeUpMachine) -> None:
    machine.absent = {"user-mode-linux", "kmod"}
    findings, modes, status = examine(machine)
    assert findings["user-mode Linux"].status == "note"
    assert modes["vcan"] == "native" and status == 0


@pytest.mark.parametrize(
    ("absent", "answers", "modules", "words", "fix"),
    [
        ({"kmod"}, {}, True, "missing packages: kmod", "apt-get install -y"),
        (set(), {"linux.uml": (1, "")}, True, "does not start", "--reinstall user-mode-linux"),
        (set(), {}, False, f"no CAN modules for its version {UML}", "--reinstall"),
        (set(), {"with-vcan": (1, "no memory")}, True, "does not boot: no memory", "with-vcan"),
        (set(), {"with-vcan": (124, "no answer in 60 s")}, True, "no answer in 60 s", "with-vcan"),
    ],
)
def test_neither_can_nor_user_mode_linux_leaves_sil(
    machine: MadeUpMachine, absent: set[str], answers: dict[str, Answer], modules: bool, words: str,
    fix: str,
) -> None:  # fmt: skip
    without_can(machine)
    machine.absent = absent
    machine.answers |= answers
    machine.modules = machine.modules if modules else []
    findings, modes, status = examine(machine)
    uml = findings["user-mode Linux"]
    assert uml.status == "fault" and words in uml.detail and fix in str(uml.fix)
    assert findings["CAN in the kernel"].status == "fault" and findings["CAN in the kernel"].fix
    assert modes == {"sil": "native", "vcan": None} and status == 0


def test_a_module_that_only_wants_loading(machine: MadeUpMachine) -> None:
    without_can(machine)
    machine.answers |= {"modinfo": (0, "filename: vcan.ko"), "with-vcan": (1, "")}
    findings, _, _ = examine(machine)
    assert str(findings["CAN in the kernel"].fix).endswith("modprobe -a vcan can-raw")


@pytest.mark.parametrize(
    ("key", "value", "fix"),
    [
        ("kernel/unprivileged_userns_clone", "0\n", "sysctl -w kernel.unprivileged_userns_clone=1"),
        (
            "kernel/apparmor_restrict_unprivileged_userns", "1\n",
            "sysctl -w kernel.apparmor_restrict_unprivileged_userns=0",
        ),
        ("kernel/other", "1\n", "sysctl -w user.max_user_namespaces=15000"),
    ],
)  # fmt: skip
def test_forbidden_namespaces(machine: MadeUpMachine, key: str, value: str, fix: str) -> None:
    for tool in ("unshare true", "unshare ip"):
        machine.answers[tool] = (1, "unshare: unshare failed: Operation not permitted")
    machine.answers["with-vcan"] = (1, "")
    machine.files[Path("/proc/sys") / key] = value
    findings, modes, status = examine(machine)
    assert findings["user namespaces"].status == "fault"
    assert str(findings["user namespaces"].fix).endswith(fix)
    assert modes["vcan"] is None and status == 0


def test_before_anything_is_installed(
    machine: MadeUpMachine, capsys: pytest.CaptureFixture[str]
) -> None:
    machine.absent = {"libode-dev", "g++", "doctest-dev"}
    machine.answers["pip"] = (127, "no such command")
    findings, modes, status = examine(machine)
    assert findings["Debian packages"].detail == "missing: g++ libode-dev"
    assert findings["Debian packages"].fix == findings["Python packages"].fix == "./rig build"
    assert modes == {"sil": None, "vcan": None} and status == 1
    lines = capsys.readouterr().out.splitlines()
    fault = next(n for n, line in enumerate(lines) if "missing: g++ libode-dev" in line)
    assert lines[fault].startswith("FAULT") and lines[fault + 1].strip() == "fix: ./rig build"
    assert lines[-1] == "modes that run here: sil no, vcan no"


def test_packages_for_tests_alone_are_no_fault(machine: MadeUpMachine) -> None:
    machine.absent = {"doctest-dev"}
    findings, _, status = examine(machine)
    assert findings["Debian packages"].status == "note" and status == 0


@pytest.mark.parametrize(
    ("before", "after"), [("numpy==", "numpy==0."), ("lcm==", "nolcm=="), ("rich==", "# rich==")]
)
def test_a_package_in_another_version(machine: MadeUpMachine, before: str, after: str) -> None:
    status, lock = machine.answers["pip"]
    assert before in lock
    machine.answers["pip"] = (status, lock.replace(before, after))
    findings, _, status = examine(machine)
    assert findings["Python packages"].status == "fault" and status == 1
    assert before.rstrip("=") in findings["Python packages"].detail


def test_names_of_packages_are_compared_as_pypi_does(machine: MadeUpMachine) -> None:
    status, lock = machine.answers["pip"]
    machine.answers["pip"] = (
        status,
        lock.replace("numpy", "NumPy").replace("python-can", "Python_Can"),
    )
    assert examine(machine)[0]["Python packages"].status == "ok"


def test_disk_and_processors(machine: MadeUpMachine) -> None:
    machine.cores, machine.free = 1, 1_000_000_000
    findings, _, status = examine(machine)
    assert findings["processors"].status == findings["disk"].status == "note" and status == 0
    machine.free = 400_000_000
    findings, _, status = examine(machine)
    assert findings["disk"].status == "fault" and findings["disk"].fix and status == 1


def test_network_settings(machine: MadeUpMachine) -> None:
    machine.files[Path("/proc/sys/net/core/rmem_max")] = "212992\n"
    machine.answers["ip"] = (2, "RTNETLINK answers: Network is unreachable")
    findings, _, status = examine(machine)
    assert "208 KiB" in findings["receive buffers"].detail
    assert str(findings["receive buffers"].fix).endswith("sysctl -w net.core.rmem_max=8388608")
    assert "ip route add 224.0.0.0/4 dev lo" in str(findings["multicast route"].fix)
    assert status == 0


def test_timer_tick(machine: MadeUpMachine) -> None:
    machine.sleeps = [1.1] * 290 + [5.0] * 10
    findings, _, _ = examine(machine)
    assert findings["timer tick"].status == "note"
    assert "wakes 0.10 ms late, 99 % within 4.00 ms" in findings["timer tick"].detail


def test_json_for_scripts(machine: MadeUpMachine, capsys: pytest.CaptureFixture[str]) -> None:
    without_can(machine)
    assert doctor.main(["--json"], machine) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["modes"] == {"sil": "native", "vcan": "user-mode Linux"}
    assert {"name", "status", "detail", "fix"} == set(said["checks"][0])
    assert {check["status"] for check in said["checks"]} == {"ok", "note"}


def test_the_real_probes_answer() -> None:
    real = doctor.Machine()
    assert real.run("/no/such/tool")[0] == 127
    assert real.run("sh", "-c", "echo out; echo err >&2; exit 4") == (4, "out\nerr")
    assert real.run("sleep", "5", limit_s=0.1)[0] == 124
    assert real.processors() >= 1 and real.free_bytes(doctor.ROOT) > 0
    assert real.read(Path("/no/such/file")) is None
    assert 1.0 <= min(real.wakeups_ms()) < 100.0
    assert doctor.check_packages(real).status in {"ok", "note"}
