"""Runs all tests of the project, as `./rig test` and CI do, and sums them up.

A step is one command with a time limit. Steps run two at a time where that is safe; those that need
a quiet machine run alone at the end. A failing step does not stop the others. Needs the standard
library only.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build"
LOGS = BUILD / "log"
LINES_SHOWN = 300  # of a failed step's output
GRACE_S = 5.0  # from SIGTERM to SIGKILL

PYTEST = [
    sys.executable, "-m", "pytest", "-q", "-rs", "--durations=5", "--color=no",
    "-o", f"cache_dir={BUILD / 'pytest_cache'}", "-o", "faulthandler_timeout=150",
]  # fmt: skip
FIXED_TESTS = "tests/tools/test_fixed.py"


QUALITY = [sys.executable, "-m", "hpmc.quality"]
CORE = ("control", "canopen", "cia402", "od", "node")  # folders of the firmware but its ports


@dataclass(frozen=True)
class Step:
    """One command of the test run."""

    name: str
    job: str
    commands: Sequence[Sequence[str]]
    limit_s: float
    advice: str
    after: str | None = None
    alone: bool = False
    fixed: bool = False


@dataclass
class Result:
    """What came of a step: tests counted where it counts tests, else the step itself as one."""

    step: Step
    seconds: float = 0.0
    problem: str | None = None
    output: str = ""
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    closing: list[str] = field(default_factory=list)


def preset(name: str, jobs: int) -> list[list[str]]:
    """Commands that configure, build and test one CMake preset."""
    return [
        ["cmake", "--preset", name, "-DBUILD_TESTING=ON", f"-DUNITY_ROOT={BUILD / 'unity'}"],
        ["cmake", "--build", "--preset", name, "-j", str(jobs), "--", "--quiet"],
        ["ctest", "--preset", name, "--no-tests=error", "-j", str(jobs), "--timeout", "120"],
    ]


def steps() -> list[Step]:
    """All steps, in order."""
    configure, build, ctest = preset("host", 2)
    configure_fixed, build_fixed, ctest_fixed = preset("host-fixed", 2)
    sources = [
        str(file.relative_to(ROOT))
        for folder in ("firmware", "sim_host", "tests")
        for file in sorted((ROOT / folder).rglob("*"))
        if file.suffix in {".c", ".h", ".cpp"}
    ]
    coverage, coverage_fixed = preset("coverage", 1), preset("coverage-fixed", 1)
    counted = [str(BUILD / "coverage"), str(BUILD / "coverage-fixed")]
    tidied = tuple(f"firmware/{name}/" for name in (*CORE, "port/posix"))
    checked = [source for source in sources if source.startswith(tidied) and source.endswith(".c")]
    return [
        Step(
            "build", "everything, by gcc, warnings as errors", [configure, build], 900,
            "read the compiler's first error", alone=True,
        ),
        Step(
            "sanitize", "firmware and its C tests, with address and undefined-behaviour sanitizers",
            preset("sanitize", 1), 300,
            "one test alone: ctest --preset sanitize -R NAME",
        ),
        Step(
            "sanitize-fixed", "the same, joint controllers in integers",
            preset("sanitize-fixed", 1), 300,
            "one test alone: ctest --preset sanitize-fixed -R NAME", fixed=True,
        ),
        Step(
            "ctest", "C tests (Unity) and C++ tests (doctest)", [ctest], 300,
            "one test alone: ctest --preset host -R NAME", after="build",
        ),
        Step(
            "clang", "firmware and its C tests, by clang", preset("clang", 1), 300,
            "one test alone: ctest --preset clang -R NAME",
        ),
        Step(
            "generated", "files made from motor_node.eds and from hpmc_config are up to date",
            [[sys.executable, "tools/generate_od.py", "--check"],
             [sys.executable, "tools/generate_config_docs.py", "--check"]], 60,
            "make them again: tools/generate_od.py; tools/generate_config_docs.py",
            after="build",
        ),
        Step(
            "format", "layout of C and C++ sources",
            [["clang-format", "--dry-run", "--Werror", *sources]], 120,
            "lay them out: git ls-files '*.c' '*.h' '*.cpp' | xargs clang-format -i",
        ),
        Step(
            "lint", "Python sources, by ruff",
            [[sys.executable, "-m", "ruff", "check", "--config", "tools/pyproject.toml",
              "--cache-dir", str(BUILD / "ruff_cache"), "tools", "tests"]], 60,
            "some are mended by: build/venv/bin/ruff check --fix --config tools/pyproject.toml "
            "tools tests",
        ),
        Step(
            "coverage", "lines and branches of the firmware that its C tests reach, by gcovr",
            [*coverage[:2], *coverage_fixed[:2], [*QUALITY, "forget-coverage", *counted],
             coverage[2], coverage_fixed[2], [*QUALITY, "coverage", *counted]], 300,
            "write the test, or justify the branch in tests/quality/uncovered.toml",
        ),
        Step(
            "cppcheck", "firmware and host by cppcheck; the firmware's headers are described",
            [[*QUALITY, "cppcheck", "firmware", "sim_host", "tests/unit", "tests/host"],
             [*QUALITY, "headers"]], 60,
            "exceptions stand beside the code: /* cppcheck-suppress id ; reason */",
        ),
        Step(
            "tidy", "firmware and its POSIX port by clang-tidy",
            [[*QUALITY, "clang-tidy", str(BUILD / "host"), *checked]], 240,
            "exceptions stand beside the code: /* NOLINTNEXTLINE(check): reason */",
            after="build",
        ),
        Step(
            "misra", "firmware beside MISRA C:2012, by cppcheck's addon",
            [[*QUALITY, "misra"]], 120,
            "deviations, with reasons, stand in tests/quality/misra.toml",
        ),
        Step(
            "quality", "these checks find faults that are put in", [[*PYTEST, "tests/quality"]],
            120, "one test alone: build/venv/bin/python -m pytest tests/quality -k NAME",
        ),
        Step(
            "image", "the image for the STM32F405: its files, budgets, and faults on the emulator",
            [["cmake", "--preset", "stm32f405"], ["cmake", "--preset", "stm32f405-fixed"],
             [*PYTEST, "tests/image"]], 600,
            "one test alone: build/venv/bin/python -m pytest tests/image -k NAME",
        ),
        Step(
            "tools", "Python tests of the tools",
            [[*PYTEST, "tests/tools", "--ignore", FIXED_TESTS]], 400,
            "one test alone: build/venv/bin/python -m pytest tests/tools -k NAME", after="build",
        ),
        Step(
            "view", "the viewer: its server, and its page in headless Chromium",
            [[*PYTEST, "tests/view"]], 300,
            "one test alone: build/venv/bin/python -m pytest tests/view -k NAME", after="build",
            alone=True,
        ),
        Step(
            "fixed", "joint controllers in integers: programs and C tests",
            [configure_fixed, [*build_fixed[:4], "--target", "rig", "unit_tests", *build_fixed[4:]],
             [*ctest_fixed, "-L", "unit"]], 600,
            "one test alone: ctest --preset host-fixed -R NAME", after="build", alone=True,
            fixed=True,
        ),
        Step(
            "fixed-runs", "their symbols on small cores; 1600 reaches beside those in float",
            [[*PYTEST, FIXED_TESTS]], 400,
            f"one test alone: build/venv/bin/python -m pytest {FIXED_TESTS} -k NAME", after="fixed",
            alone=True, fixed=True,
        ),
        Step(
            "rig", "whole runs of the rig", [[*PYTEST, "tests/rig"]], 1200,
            "one test alone: build/venv/bin/python -m pytest tests/rig -k NAME", after="build",
            alone=True,
        ),
    ]  # fmt: skip


running: set[int] = set()  # process groups, to be ended when the test run is interrupted


def run_command(command: Sequence[str], log: Path, deadline: float) -> str | None:
    """Runs a command, its output appended to `log`; returns what went wrong, None if nothing."""
    environment = os.environ | {"HYPOTHESIS_STORAGE_DIRECTORY": str(BUILD / "hypothesis")}
    with log.open("ab") as output:
        try:
            process = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            return f"{command[0]} cannot be started: {error.strerror}"
        running.add(process.pid)
        try:
            status = process.wait(timeout=max(deadline - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            return "it took too long and was ended"
        finally:
            # Also what the command left running.
            kill_group(process)
            running.discard(process.pid)
    if status < 0:
        return f"ended by {signal.Signals(-status).name}"
    return f"exit status {status}" if status else None


def kill_group(process: subprocess.Popen[bytes]) -> None:
    """Ends a command and everything it started: SIGTERM, then SIGKILL for those who stay."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        if number == signal.SIGTERM:
            try:
                process.wait(timeout=GRACE_S)
            except subprocess.TimeoutExpired:
                continue
            time.sleep(0.1)
    process.wait()


CTEST_CLOSING = re.compile(r"^\d+% tests passed, (\d+) tests? failed out of (\d+)$", re.MULTILINE)
PYTEST_CLOSING = re.compile(r"^=*\s*((?:\d+ \w+,? ?)+) in [\d.]+s.*$", re.MULTILINE)
PYTEST_SKIP = re.compile(r"^SKIPPED .*$", re.MULTILINE)


def count(result: Result) -> None:
    """Fills the counts and closing lines of a result from the output."""
    ctest = CTEST_CLOSING.findall(result.output)
    pytest = PYTEST_CLOSING.findall(result.output) if not ctest else []
    result.closing = [match.group(0) for match in CTEST_CLOSING.finditer(result.output)]
    if ctest:
        failed, total = (int(number) for number in ctest[-1])
        result.failed, result.passed = failed, total - failed
    elif pytest:
        numbers = {word: int(n) for n, word in re.findall(r"(\d+) (\w+)", pytest[-1])}
        result.passed = numbers.get("passed", 0)
        result.failed = sum(numbers.get(word, 0) for word in ("failed", "error", "errors"))
        result.skipped = numbers.get("skipped", 0)
        result.closing = [match.group(0) for match in PYTEST_SKIP.finditer(result.output)]
        result.closing.append(list(PYTEST_CLOSING.finditer(result.output))[-1].group(0).strip("= "))
    elif result.problem is None:
        result.passed = 1
    if result.problem is not None and result.failed == 0:
        result.failed = 1


def run_step(step: Step) -> Result:
    """Runs the commands of a step up to the first that fails."""
    log = LOGS / f"test-{step.name}.log"
    log.unlink(missing_ok=True)
    start = time.monotonic()
    result = Result(step)
    for command in step.commands:
        result.problem = run_command(command, log, start + step.limit_s)
        if result.problem is not None:
            break
    result.seconds = time.monotonic() - start
    result.output = log.read_text(errors="replace")
    count(result)
    return result


def report(result: Result) -> None:
    """Prints one step: its closing lines, and all its words if it failed."""
    verdict = "ok" if result.problem is None else f"FAILED: {result.problem}"
    lines = []
    if result.problem is not None:
        said = result.output.splitlines()
        if len(said) > LINES_SHOWN:
            lines.append(f"... all of it in {LOGS / f'test-{result.step.name}.log'}")
        lines += said[-LINES_SHOWN:]
    else:
        lines += result.closing
    head = f"{result.step.name:14} {result.seconds:6.1f} s  {verdict}  ({result.step.job})"
    print("\n".join([head, *(f"    {line}" for line in lines)]), flush=True)


def run_all(chosen: Sequence[Step]) -> list[Result]:
    """Runs the steps in order, two at a time but for those that want to be alone."""
    printing = threading.Lock()
    names = {step.name for step in chosen}
    outcomes: dict[str, Result] = {}

    def run(step: Step) -> None:
        if step.after in names and outcomes[step.after].problem is not None:
            result = Result(step, problem=f"not run, since '{step.after}' failed", failed=1)
        else:
            result = run_step(step)
        outcomes[step.name] = result
        with printing:
            report(result)

    with ThreadPoolExecutor(max_workers=2) as pool:
        for alone, group in itertools.groupby(chosen, key=lambda step: step.alone):
            if alone:
                for step in group:
                    run(step)
            else:
                list(pool.map(run, group))
    return [outcomes[step.name] for step in chosen]


def summarise(results: Sequence[Result], seconds: float) -> None:
    """Prints the slowest steps, what to do about failed ones, and the closing line."""
    slowest = sorted(results, key=lambda result: -result.seconds)[:4]
    times = ", ".join(f"{result.step.name} {result.seconds:.0f} s" for result in slowest)
    print(f"\nslowest of {seconds:.0f} s: {times}")
    if skipped := sum(result.skipped for result in results):
        print(f"{skipped} skipped, see above for the reasons")
    for result in results:
        if result.problem is not None:
            print(f"{result.step.name} failed ({result.problem}): {result.step.advice}")
    passed = sum(result.passed for result in results)
    failed = sum(result.failed for result in results)
    print(f"{passed} passed, {failed} failed", flush=True)


def interrupted(number: int, _frame: FrameType | None) -> NoReturn:
    """Signal handler: ends what runs, then this process."""
    for group in running:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGTERM)
    print("interrupted", file=sys.stderr, flush=True)
    os._exit(128 + number)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: returns 0 when everything passed, 1 when not, 2 for wrong arguments."""
    parser = argparse.ArgumentParser(prog="rig test", description="Runs all tests, the same as CI.")
    parser.add_argument("--only", action="append", metavar="NAME",
                        help="only this step (again for more), and what it needs")  # fmt: skip
    parser.add_argument("--fixed", action="store_true",
                        help="only the steps of the fixed-point build")  # fmt: skip
    parser.add_argument("--list", action="store_true", help="names the steps")
    arguments = parser.parse_args(argv)

    every = {step.name: step for step in steps()}
    if arguments.list:
        for step in every.values():
            print(f"{step.name:14} {step.job}")
        return 0
    fixed = {step.name for step in every.values() if step.fixed}
    wanted = set(arguments.only or (fixed if arguments.fixed else every))
    if unknown := sorted(wanted - set(every)):
        parser.error(f"there is no step '{unknown[0]}'; the steps are {', '.join(every)}")
    while missing := {every[name].after for name in wanted} - wanted - {None}:
        wanted |= missing

    LOGS.mkdir(parents=True, exist_ok=True)
    signal.signal(signal.SIGTERM, interrupted)
    signal.signal(signal.SIGINT, interrupted)
    start = time.monotonic()
    results = run_all([step for step in every.values() if step.name in wanted])
    summarise(results, time.monotonic() - start)
    return int(any(result.problem is not None for result in results))


if __name__ == "__main__":
    sys.exit(main())
