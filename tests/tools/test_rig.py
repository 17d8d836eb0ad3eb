"""The front door ./rig with stand-ins for apt, sudo, pip and cmake, and what ./rig test runs."""

from __future__ import annotations

import itertools
import os
import platform
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hpmc import selftest

ROOT = Path(__file__).resolve().parents[2]

# Everything that the script calls, but for what the tests replace.
REAL_TOOLS = (
    *("bash", "cat", "cut", "dirname", "env", "find", "flock", "getconf", "mkdir", "paste"),
    *("rm", "sed", "sha256sum", "sleep", "tail", "touch", "true", "uname"),
)

FAKE_APT = """
case "$*" in
    *update*) touch "$FAKES/updated" ;;
    *install*)
        [[ -e $FAKES/lists-outdated && ! -e $FAKES/updated ]] && echo "E: 404" && exit 100
        [[ -e $FAKES/apt-broken ]] && echo "E: no network" && exit 100
        for word in "$@"; do touch "$FAKES/installed-$word"; done ;;
esac
"""
FAKE_DPKG_QUERY = """
package=${!#}
[[ -e $FAKES/installed-$package ]] && echo installed
"""
FAKE_PYTHON = """
env >"$FAKES/python-environment"
"""
FAKE_CMAKE = """
sleep "$(cat "$FAKES/cmake-seconds" 2>/dev/null || echo 0)"
mkdir -p "$(dirname "$0")/../build/host" && touch "$(dirname "$0")/../build/host/build.ninja"
[[ ! -e $FAKES/cmake-broken ]] || { echo "error: expected ';'"; exit 1; }
"""


class Rig:
    """A copy of ./rig and its lists among stand-ins that note how they were called."""

    def __init__(self, folder: Path, user: str = "0", sudo: str | None = None) -> None:
        self.folder, self.fakes, self.bin = folder, folder / "fakes", folder / "bin"
        self.fakes.mkdir()
        self.bin.mkdir()
        shutil.copy(ROOT / "rig", folder)
        shutil.copy(ROOT / "CMakePresets.json", folder)
        shutil.copytree(ROOT / "tools" / "bootstrap", folder / "tools" / "bootstrap")
        for tool in REAL_TOOLS:
            real = shutil.which(tool)
            assert real, tool
            (self.bin / tool).symlink_to(real)
        self.fake("id", f"[[ $1 == -u ]] && echo {user} || echo somebody")
        self.fake("apt-get", FAKE_APT)
        self.fake("dpkg-query", FAKE_DPKG_QUERY)
        self.fake("cmake", FAKE_CMAKE)
        self.fake("unshare", "exit 1")
        if sudo is not None:
            self.fake("sudo", sudo)
        python = folder / "build" / "venv" / "bin" / "python"
        python.parent.mkdir(parents=True)
        self.fake("python", FAKE_PYTHON, python)

    def fake(self, name: str, body: str, path: Path | None = None) -> None:
        """Puts a stand-in for a tool in place."""
        path = path or self.bin / name
        path.write_text(f'#!/bin/bash\necho "{name} $*" >>"$FAKES/calls"\n{body}\n')
        path.chmod(0o755)

    def set(self, flag: str, value: str = "") -> None:
        """Tells the stand-ins something."""
        (self.fakes / flag).write_text(value)

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Starts ./rig."""
        environment = {"PATH": str(self.bin), "FAKES": str(self.fakes), "HOME": str(self.folder)}
        return subprocess.Popen(
            [self.folder / "rig", *arguments], env=environment, stdin=subprocess.DEVNULL, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def run(self, *arguments: str) -> tuple[int, str, list[str]]:
        """Runs ./rig: exit status, output, and the calls that it made."""
        calls = self.fakes / "calls"
        calls.unlink(missing_ok=True)
        process = self.start(*arguments)
        output, _ = process.communicate(timeout=30)
        made = calls.read_text().splitlines() if calls.exists() else []
        return process.returncode, output, made


def of(tool: str, calls: list[str]) -> list[str]:
    """The calls of one tool, without its name."""
    return [call.removeprefix(f"{tool} ") for call in calls if call.startswith(f"{tool} ")]


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_root_installs_only_what_is_missing_and_only_once(rig: Rig) -> None:
    for package in ("g++", "cmake"):
        rig.set(f"installed-{package}")
    status, output, calls = rig.run("build")
    assert status == 0, output
    (install,) = of("apt-get", calls)
    assert install.startswith("-y") and "--no-install-recommends" in install
    assert " libode-dev " in install and " g++ " not in install and " cmake " not in install
    assert "user-mode-linux" not in install and "doctest-dev" not in install
    (pip,) = [call for call in of("python", calls) if "pip install" in call]
    assert "python-run.txt" in pip and "--constraint" in pip and "requirements.lock" in pip
    assert output.count("installing Debian packages") == 1

    status, output, calls = rig.run("build")
    assert (status, output) == (0, "")
    assert not of("apt-get", calls) and not of("dpkg-query", calls) and not of("python", calls)
    assert of("cmake", calls) == [call for call in of("cmake", calls) if "--build" in call]


def test_a_changed_list_is_installed_again(rig: Rig) -> None:
    rig.run("build")
    with (rig.folder / "tools" / "bootstrap" / "debian-run.txt").open("a") as file:
        file.write("a-new-package  # for this test\n")
    status, _, calls = rig.run("build")
    (install,) = of("apt-get", calls)
    assert status == 0 and install.endswith(" a-new-package")


def test_outdated_package_lists_are_refreshed(rig: Rig) -> None:
    rig.set("lists-outdated")
    status, output, calls = rig.run("build")
    assert status == 0, output
    assert [("update" in call, " install " in call) for call in of("apt-get", calls)] == [
        (False, True), (True, False), (False, True)
    ]  # fmt: skip


def test_a_failed_installation_says_so_and_is_tried_again(rig: Rig) -> None:
    rig.set("apt-broken")
    status, output, _ = rig.run("build")
    assert status == 1
    assert "E: no network" in output and "could not be installed" in output
    (rig.fakes / "apt-broken").unlink()
    status, output, calls = rig.run("build")
    assert status == 0 and of("apt-get", calls)


def test_an_ordinary_user_installs_through_sudo(tmp_path: Path) -> None:
    rig = Rig(tmp_path, user="1000", sudo='[[ $1 == -n ]] && shift; exec "$@"')
    status, output, calls = rig.run("build")
    assert status == 0, output
    installs = [call for call in of("sudo", calls) if "install" in call]
    assert len(installs) == 1
    assert installs[0].startswith("-n env DEBIAN_FRONTEND=noninteractive apt-get ")


@pytest.mark.parametrize("sudo", [None, "exit 1"])
def test_without_rights_the_command_to_type_is_named(tmp_path: Path, sudo: str | None) -> None:
    rig = Rig(tmp_path, user="1000", sudo=sudo)
    status, output, calls = rig.run("build")
    packages = [
        line.strip()
        for line in (ROOT / "tools/bootstrap/debian-run.txt").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    command = "apt-get update && apt-get install -y --no-install-recommends " + " ".join(packages)
    assert status == 1
    assert (f"sudo sh -c '{command}'" if sudo else command) in output
    assert not of("apt-get", calls) and not of("cmake", calls)
    assert rig.run("build")[0] == 1


def test_elsewhere_than_on_debian_the_packages_are_named(rig: Rig) -> None:
    (rig.bin / "apt-get").unlink()
    status, output, _ = rig.run("build")
    assert status == 1 and "not a Debian system" in output and "libode-dev" in output


@pytest.mark.parametrize("kernel_has_can", [False, True])
def test_user_mode_linux_only_without_can_in_the_kernel(rig: Rig, kernel_has_can: bool) -> None:
    if kernel_has_can:
        rig.fake("unshare", "exit 0")
    status, output, calls = rig.run("run", "clock")
    assert status == 0, output
    assert any("user-mode-linux" in call for call in of("apt-get", calls)) != kernel_has_can
    _, _, calls = rig.run("run", "clock")
    assert not of("apt-get", calls)


def test_run_hands_its_arguments_over_in_a_fixed_environment(rig: Rig) -> None:
    rig.run("build")
    _, output, calls = rig.run("run", "clock", "--set", "a b=c")
    assert of("python", calls)[-1] == "-m hpmc run clock --set a b=c", output
    environment = (rig.fakes / "python-environment").read_text().splitlines()
    assert f"PYTHONPATH={rig.folder}/tools:{rig.folder}/build/host/lcm_types/python" in environment
    assert {"OMP_NUM_THREADS=1", "OPENBLAS_NUM_THREADS=1"} <= set(environment)
    assert f"GLIBC_TUNABLES={tunables()}" in environment


def test_a_script_gets_its_own_options_where_it_was_called(rig: Rig) -> None:
    rig.fake("python", FAKE_PYTHON + 'pwd >"$FAKES/folder"', rig.folder / "build/venv/bin/python")
    status, output, calls = rig.run("python", "my script.py", "--fixed", "-x")
    assert status == 0, output
    assert of("python", calls)[-1] == "my script.py --fixed -x"
    assert (rig.fakes / "folder").read_text().strip() == str(Path.cwd())
    environment = (rig.fakes / "python-environment").read_text().splitlines()
    assert f"HPMC_BUILD={rig.folder}/build/host" in environment
    assert "GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-FMA4" in environment
    assert any(line.startswith(f"PYTHONPATH={rig.folder}/tools:") for line in environment)

    _, _, calls = rig.run("python", "--fixed", "script.py")
    assert of("python", calls)[-1] == "script.py"
    environment = (rig.fakes / "python-environment").read_text().splitlines()
    assert f"HPMC_BUILD={rig.folder}/build/host-fixed" in environment


def test_a_failed_build_shows_the_compilers_words(rig: Rig) -> None:
    rig.run("build")
    rig.set("cmake-broken")
    status, output, calls = rig.run("run", "clock")
    assert status == 1
    assert "error: expected ';'" in output and "the build failed" in output
    assert not any(call.startswith("-m hpmc") for call in of("python", calls))


def test_two_at_once_take_turns(rig: Rig) -> None:
    rig.set("cmake-seconds", "0.7")
    first, second = rig.start("build"), rig.start("build")
    outputs = [process.communicate(timeout=30)[0] for process in (first, second)]
    assert (first.returncode, second.returncode) == (0, 0), outputs
    assert sum("waiting for it" in output for output in outputs) == 1
    calls = (rig.fakes / "calls").read_text().splitlines()
    assert len([call for call in of("python", calls) if "pip install" in call]) == 1


def test_a_moved_folder_is_built_anew(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    rig = Rig(here)
    rig.run("build")
    here.rename(there)
    rig.folder, rig.fakes, rig.bin = there, there / "fakes", there / "bin"
    for flag in rig.fakes.glob("installed-*"):
        flag.unlink()
    rig.set("apt-broken")  # ends it before a real environment is made
    _, output, _ = rig.run("build")
    assert f"moved here from {here}" in output
    assert not (there / "build" / "venv").exists() and not (there / "build" / "host").exists()


@pytest.fixture
def foreign_folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    for path in [folder, *folder.rglob("*")]:
        if path.is_dir():
            path.chmod(path.stat().st_mode | stat.S_IRWXU)
    shutil.rmtree(folder)


def test_a_build_folder_of_another_user_is_explained(foreign_folder: Path) -> None:
    rig = Rig(foreign_folder, user="1000")
    (rig.folder / "build").chmod(0o555)
    as_nobody = [str(shutil.which("setpriv")), "--reuid=65534", "--regid=65534", "--clear-groups"]
    done = subprocess.run(
        [*(as_nobody if os.geteuid() == 0 else []), rig.folder / "rig", "build"], check=False,
        env={"PATH": str(rig.bin), "FAKES": str(rig.fakes)}, text=True, capture_output=True,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"sudo chown -R somebody {rig.folder}/build" in done.stderr


def test_help_and_an_unknown_command(rig: Rig) -> None:
    for arguments in (["help"], ["--help"], []):
        status, output, calls = rig.run(*arguments)
        assert status == 0 and "./rig COMMAND" in output and "doctor" in output
        assert calls == []
    status, output, calls = rig.run("tset")
    assert status == 2 and "tset" in output and calls == []


def test_what_is_done_already_costs_little(rig: Rig) -> None:
    def seconds(*arguments: str) -> float:
        start = time.monotonic()
        rig.run(*arguments)
        return time.monotonic() - start

    rig.run("run", "clock")
    assert min(seconds("help") for _ in range(5)) < 0.2
    assert min(seconds("run", "clock") for _ in range(5)) < 0.3


def tunables() -> str:
    """The value of GLIBC_TUNABLES that ./rig sets."""
    prefix = "export GLIBC_TUNABLES="
    (line,) = (line for line in (ROOT / "rig").read_text().splitlines() if line.startswith(prefix))
    return line.removeprefix(prefix)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="glibc has one libm path here")
def test_the_libm_path_is_the_one_of_a_processor_without_fused_operations() -> None:
    program = (
        "from math import *\n"
        "print([f(i * 1e-3) for f in (sin, cos, atan, exp, tan) for i in range(20000)])"
    )

    def values(setting: str) -> str:
        environment = {key: v for key, v in os.environ.items() if key != "GLIBC_TUNABLES"}
        environment |= {"GLIBC_TUNABLES": setting} if setting else {}
        return subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        ).stdout

    here = values(tunables())
    assert here == values("glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX,-SSE4_1")
    if " fma " in Path("/proc/cpuinfo").read_text():
        assert here != values("")


# --- ./rig test ----------------------------------------------------------------------------------


def step(program: str, limit_s: float = 20.0, **more: object) -> selftest.Step:
    command = [sys.executable, "-c", program]
    return selftest.Step(
        more.pop("name", "probe"), "a probe", [command], limit_s, "mend it", **more
    )  # type: ignore[arg-type]


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "log").mkdir()
    monkeypatch.setattr(selftest, "LOGS", tmp_path / "log")


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("....\n4 passed in 0.12s\n", (4, 0, 0)),
        (
            "SKIPPED [2] a.py:3: no board\n3 passed, 2 skipped, 1 warning in 61.1s (0:01:01)\n",
            (3, 0, 2),
        ),
        ("=== 1 failed, 2 passed, 3 errors in 1.00s ===\n", (2, 4, 0)),
        ("100% tests passed, 0 tests failed out of 7\n", (7, 0, 0)),
        ("71% tests passed, 2 tests failed out of 7\n", (5, 2, 0)),
        ("All checks passed!\n", (1, 0, 0)),
    ],
)
def test_counts_are_those_of_ctest_and_pytest(output: str, expected: tuple[int, int, int]) -> None:
    failed = expected[1] > 0
    result = selftest.run_step(step(f"print({output!r}); raise SystemExit({int(failed)})"))
    assert (result.passed, result.failed, result.skipped) == expected
    assert (result.problem is None) == (not failed)


def test_a_step_that_dies_counts_as_failed() -> None:
    for program, word in (
        ("import os; os.abort()", "SIGABRT"),
        ("raise SystemExit(3)", "status 3"),
    ):
        result = selftest.run_step(step(f"print('2 passed in 0.1s', flush=True)\n{program}"))
        assert result.failed == 1 and word in str(result.problem)
    missing = selftest.Step("probe", "", [["/no/such/program"]], 5, "")
    assert "cannot be started" in str(selftest.run_step(missing).problem)


def test_a_slow_step_is_ended_with_its_children(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selftest, "GRACE_S", 0.5)
    program = (
        "import pathlib, signal, subprocess, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "child = subprocess.Popen(['sleep', '60'])\n"
        f"pathlib.Path({str(tmp_path / 'pid')!r}).write_text(str(child.pid))\n"
        "time.sleep(60)"
    )
    start = time.monotonic()
    result = selftest.run_step(step(program, limit_s=1.0))
    assert "too long" in str(result.problem) and time.monotonic() - start < 10
    child = Path("/proc") / (tmp_path / "pid").read_text()
    assert not child.exists() or "\nState:\tZ" in (child / "status").read_text()


def test_steps_wait_for_what_they_need_and_go_on_after_a_failure(
    capsys: pytest.CaptureFixture[str],
) -> None:
    chosen = [
        step("raise SystemExit(1)", name="build", alone=True),
        step("", name="lint"),
        step("", name="tools", after="build"),
        step("", name="rig", after="build", alone=True),
    ]
    results = selftest.run_all(chosen)
    selftest.summarise(results, 1.0)
    assert [result.problem is None for result in results] == [False, True, False, False]
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "1 passed, 3 failed"
    assert any(line.startswith("build failed (exit status 1): mend it") for line in lines)


def test_a_lone_step_runs_alone(tmp_path: Path) -> None:
    def timed(name: str) -> str:
        return (
            "import pathlib, time\nstart = time.monotonic()\ntime.sleep(0.3)\n"
            f"span = f'{{start}} {{time.monotonic()}}'\n"
            f"pathlib.Path({str(tmp_path / name)!r}).write_text(span)"
        )

    names = ["a", "b", "c", "d"]
    selftest.run_all([step(timed(name), name=name, alone=name in "cd") for name in names])
    span = {name: [float(t) for t in (tmp_path / name).read_text().split()] for name in names}
    together = {
        (one, other)
        for one, other in itertools.combinations(names, 2)
        if span[one][0] < span[other][1] and span[other][0] < span[one][1]
    }
    assert together == {("a", "b")}


def test_the_list_of_steps_and_an_unknown_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert selftest.main(["--list"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in ("ctest", "sanitize", "clang", "lint", "tools", "rig"))
    with pytest.raises(SystemExit) as ended:
        selftest.main(["--only", "no-such-step"])
    assert ended.value.code == 2
