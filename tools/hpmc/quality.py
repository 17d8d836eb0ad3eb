"""Checks the quality of the sources, beyond what the compilers say: `python -m hpmc.quality CHECK`.

Each check prints what it found, one finding a line, and ends with status 1 if there is any:

- coverage: lines and branches of the firmware that its unit tests reach, in the float and in the
  fixed-point build; what is not reached must be justified in tests/quality/uncovered.toml;
- cppcheck, clang-tidy: clean, but for suppressions beside the code that give a reason;
- misra: MISRA C:2012 by cppcheck's addon; deviations stand in tests/quality/misra.toml, with
  reasons, and docs/misra.md is made from it (`misra --write`);
- headers: every function of the firmware's headers is described, and every number has a unit.

Justifications that nothing needs any more are findings as well. Needs the standard library only.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
TABLES = ROOT / "tests" / "quality"

Entry = dict[str, Any]  # of a table of exceptions


def run(command: Sequence[str | Path], cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Runs a tool and keeps what it says; a tool that is not there ends the check."""
    try:
        return subprocess.run(
            [str(word) for word in command],
            cwd=cwd or ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError:
        sys.exit(f"{command[0]} is not installed: ./rig test installs it")


def load_table(file: Path, key: str) -> list[Entry]:
    """Entries of a table of exceptions; each must give its reason."""
    entries = tomllib.loads(file.read_text()).get(key, [])
    for entry in entries:
        if len(str(entry.get("reason", "")).split()) < 3:
            sys.exit(f"{file.name}: an entry gives no reason: {entry}")
    return entries


# --- coverage ------------------------------------------------------------------------------------

COVERED_FOLDERS = ("control", "canopen", "cia402", "node", "port/stm32f405")
BRANCHES_MIN_PERCENT = 98.0


@dataclass(frozen=True)
class Gap:
    """Branches of one line that no test takes; missing = 0 for a line that no test reaches."""

    file: str
    function: str
    condition: str
    missing: int

    def __str__(self) -> str:
        what = f"{self.missing} of its branches not taken" if self.missing else "not reached"
        return f"{self.file}, {self.function}: `{self.condition}`: {what}"


@dataclass
class Coverage:
    """What the tests of one build reach."""

    lines: int = 0
    lines_reached: int = 0
    branches: int = 0
    branches_taken: int = 0
    gaps: set[Gap] = field(default_factory=set)

    def percent(self) -> float:
        """Share of branches taken."""
        return 100.0 * self.branches_taken / self.branches if self.branches else 0.0


def read_coverage(report: dict[str, Any], root: Path) -> Coverage:
    """Sums up a JSON report of gcovr 5."""
    coverage = Coverage()
    for file in report["files"]:
        text = (root / file["file"]).read_text().splitlines()
        starts = sorted((entry["lineno"], entry["name"]) for entry in file["functions"])
        for line in file["lines"]:
            if line["gcovr/noncode"]:
                continue
            number = line["line_number"]
            function = next((name for start, name in reversed(starts) if start <= number), "")
            branches = line["branches"]
            taken = sum(branch["count"] > 0 for branch in branches)
            coverage.lines += 1
            coverage.lines_reached += line["count"] > 0
            coverage.branches += len(branches)
            coverage.branches_taken += taken
            missing = len(branches) - taken
            if line["count"] == 0 or missing:
                condition = text[number - 1].strip()
                missing = missing if line["count"] else 0
                coverage.gaps.add(Gap(file["file"], function, condition, missing))
    return coverage


def judge_coverage(builds: dict[str, Coverage], allowed: Sequence[Entry]) -> list[str]:
    """Findings: lines not reached, too few branches, gaps without reason, reasons without gap.

    A line that one build cannot reach may be justified, one that no build reaches may not.
    """
    findings = []
    justified = {
        Gap(entry["file"], entry["function"], entry["condition"], entry["missing"])
        for entry in allowed
    }
    for name, coverage in builds.items():
        if coverage.lines == 0:
            findings.append(f"{name}: nothing was measured")
        if coverage.percent() < BRANCHES_MIN_PERCENT:
            findings.append(
                f"{name}: {coverage.percent():.1f} % of the branches are taken, "
                f"{BRANCHES_MIN_PERCENT:.0f} % are demanded"
            )
    found = set().union(*(coverage.gaps for coverage in builds.values()))
    for gap in sorted(found, key=str):
        where = [name for name, coverage in builds.items() if gap in coverage.gaps]
        if gap.missing == 0 and len(where) == len(builds):
            findings.append(f"{gap} in any build")
        elif gap not in justified:
            findings.append(f"{gap} in {', '.join(where)}, and uncovered.toml does not say why")
    findings += [
        f"uncovered.toml is stale: {gap}: this is no longer so"
        for gap in sorted(justified - found, key=str)
    ]
    return findings


def measure_coverage(build: Path) -> Entry:
    """JSON report of gcovr over the counters in a build folder."""
    folders = "|".join(COVERED_FOLDERS)
    result = run(
        ["gcovr", "--root", ROOT, "--object-directory", build, "--filter",
         rf"firmware/({folders})/", "--json", "-", build]
    )  # fmt: skip
    if result.returncode != 0:
        sys.exit(f"gcovr failed:\n{result.stderr}")
    return json.loads(result.stdout)


def check_coverage(builds: Sequence[str]) -> list[str]:
    """Builds are folders that were built with HPMC_COVERAGE and whose tests have run."""
    reports = {Path(build).name: read_coverage(measure_coverage(Path(build)), ROOT)
               for build in builds}  # fmt: skip
    for name, coverage in reports.items():
        print(
            f"{name}: {coverage.lines_reached} of {coverage.lines} lines, {coverage.branches_taken}"
            f" of {coverage.branches} branches ({coverage.percent():.1f} %)"
        )
    return judge_coverage(reports, load_table(TABLES / "uncovered.toml", "branch"))


def forget_coverage(builds: Iterable[str]) -> None:
    """Sets the counters to zero, so that what was reached by earlier tests does not count."""
    for build in builds:
        for file in Path(build).rglob("*.gcda"):
            file.unlink()


# --- cppcheck, MISRA -----------------------------------------------------------------------------

FINDING = "--template={file}:{line}: {message} [{id}]"
MISRA_FOLDERS = ("control", "canopen", "cia402", "od", "node")
MISRA_FINDING = re.compile(r"^(?P<file>.+?):(?P<line>\d+): .* \[misra-c2012-(?P<rule>[\d.]+)\]$")
UNREAD = re.compile(r"\[(internalError|syntaxError|cppcheckError|preprocessorErrorDirective)\]$")


def check_cppcheck(paths: Sequence[str]) -> list[str]:
    """Everything that cppcheck knows, but for what it cannot see and one matter of taste."""
    result = run(
        ["cppcheck", "--quiet", "--enable=all", "--inline-suppr", "--std=c11", "--std=c++20",
         "--error-exitcode=1", f"--suppressions-list={TABLES / 'cppcheck.txt'}",
         "-I", "firmware", "-I", "sim_host", "-I", "tests/unit", FINDING, "--template-location=",
         *paths]
    )  # fmt: skip
    findings = [line for line in result.stderr.splitlines() if line.strip()]
    if result.returncode != 0 and not findings:
        findings = [f"cppcheck ended with status {result.returncode}: {result.stdout}"]
    return findings


@dataclass(frozen=True)
class Violation:
    """One place where cppcheck's addon says that a rule of MISRA C:2012 is violated."""

    rule: str
    file: str
    line: int
    code: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: rule {self.rule}: {self.code.strip()}"


def find_violations(folders: Sequence[Path], include: Path, root: Path) -> list[Violation]:
    """All violations of MISRA C:2012, deviated or not, in file order."""
    result = run(
        ["cppcheck", "--quiet", "--addon=misra", "--std=c11", "-I", include, FINDING,
         "--template-location=", *folders],
        cwd=root,
    )  # fmt: skip
    violations = set()
    for line in result.stderr.splitlines():
        match = MISRA_FINDING.match(line)
        if match:
            text = (root / match["file"]).read_text().splitlines()
            number = int(match["line"])
            violations.add(Violation(match["rule"], match["file"], number, text[number - 1]))
        elif UNREAD.search(line):  # what else it says is for the check cppcheck
            sys.exit(f"cppcheck or its addon misra failed:\n{result.stderr}")
    if result.returncode != 0:
        sys.exit(f"cppcheck failed:\n{result.stdout}")
    return sorted(violations, key=lambda found: (found.file, found.line, found.rule))


def covers(deviation: Entry, violation: Violation) -> bool:
    """Whether a deviation allows a violation: the rule, the file and, if given, the code."""
    return (
        deviation["rule"] == violation.rule
        and any(fnmatch.fnmatch(violation.file, pattern) for pattern in deviation["files"])
        and re.search(str(deviation.get("code", "")), violation.code) is not None
    )


def judge_misra(violations: Sequence[Violation], deviations: Sequence[Entry]) -> list[str]:
    """Findings: violations that no deviation allows, deviations and files of them not needed."""
    findings = [
        str(violation)
        for violation in violations
        if not any(covers(deviation, violation) for deviation in deviations)
    ]
    for deviation in deviations:
        for pattern in deviation["files"]:
            narrowed = {**deviation, "files": [pattern]}
            if not any(covers(narrowed, violation) for violation in violations):
                findings.append(
                    f"misra.toml is stale: rule {deviation['rule']} is not violated in {pattern}"
                    + (f" by code like {deviation['code']}" if "code" in deviation else "")
                )
    return findings


def misra_document(deviations: Sequence[Entry]) -> str:
    """docs/misra.md"""
    lines = [
        "# MISRA C:2012 in the firmware",
        "",
        "`./rig test --only misra` checks firmware/{control,canopen,cia402,od,node} with the addon",
        "of cppcheck. The rules' texts are not public; their numbers lead to them in the standard.",
        "A violation outside the places of this table fails the test, and so does an entry that is",
        "no longer needed. Made from tests/quality/misra.toml by `python -m hpmc.quality misra",
        "--write`: do not edit.",
        "",
        "| rule | category | where | what | why |",
        "|---|---|---|---|---|",
    ]
    for deviation in sorted(deviations, key=lambda entry: version(str(entry["rule"]))):
        where = ", ".join(str(file).removeprefix("firmware/") for file in deviation["files"])
        lines.append(
            f"| {deviation['rule']} | {deviation['category']} | {where} | {deviation['what']} "
            f"| {deviation['reason']} |"
        )
    return "\n".join(lines) + "\n"


def version(rule: str) -> tuple[int, ...]:
    """Orders rule numbers."""
    return tuple(int(part) for part in rule.split("."))


def check_misra(write: bool) -> list[str]:
    """The firmware but for its ports, which call an operating system or name registers."""
    deviations = load_table(TABLES / "misra.toml", "deviation")
    document = ROOT / "docs" / "misra.md"
    if write:
        document.write_text(misra_document(deviations))
    folders = [Path("firmware") / name for name in MISRA_FOLDERS]
    violations = find_violations(folders, Path("firmware"), ROOT)
    findings = judge_misra(violations, deviations)
    others = sum(not any(covers(entry, violation) for entry in deviations)
                 for violation in violations)  # fmt: skip
    if not document.exists() or document.read_text() != misra_document(deviations):
        findings.append("docs/misra.md is stale: python -m hpmc.quality misra --write")
    print(f"{len(violations)} violations are seen, {len(violations) - others} of them deviated")
    return findings


# --- clang-tidy ----------------------------------------------------------------------------------

TIDY_FINDING = re.compile(r"^(?P<place>/\S+:\d+:\d+): (?:warning|error): (?P<rest>.*)$")


def check_clang_tidy(build: Path, sources: Sequence[Path]) -> list[str]:
    """Sources by the compile commands of a build folder, with the checks of .clang-tidy."""

    def tidy(source: Path) -> list[str]:
        result = run(["clang-tidy", "--quiet", "--warnings-as-errors=*", "-p", build, source])
        findings = [
            f"{os.path.relpath(match['place'], ROOT)}: {match['rest']}"
            for match in map(TIDY_FINDING.match, result.stdout.splitlines())
            if match
        ]
        skipped = "Compile command not found" in result.stderr
        if skipped or (result.returncode != 0 and not findings):
            findings = [f"{source}: clang-tidy failed: {result.stdout}{result.stderr}"]
        return findings

    with ThreadPoolExecutor(max_workers=2) as pool:
        found = pool.map(tidy, sources)
    return sorted({finding for findings in found for finding in findings})


# --- headers -------------------------------------------------------------------------------------

UNITS = re.compile(
    r"(^|_)(ns|us|ms|s|Hz|rad|urad|deg|inc|inc256|Nm|mNm|mA|mA2|dC|ppm|rpm|percent|steps)$"
)
# Numbers that are no quantities: identifiers, counts, codes and bit patterns.
PLAIN = re.compile(
    r"(^|_)(id|index|subindex|count|first|len|length|size|bytes|offset|counter|overflow|code|source"
    r"|detail|mode|controlword|statusword|value|min|max|type|access|data|tick|part|parts|whole"
    r"|events|register|refusals|reasons|direction|sign|done|fd|ttl|mask|match|payload|datagram"
    r"|number|sequence|queued)$"
)
UNIT_TYPES = {"angle_t", "angle_step_t", "torque_t"}  # rad, N m
NUMBER_TYPES = {
    *(f"{sign}int{bits}_t" for sign in ("", "u") for bits in (8, 16, 32, 64)),
    "int", "unsigned", "long", "size_t", "float", "double",
}  # fmt: skip
FUNCTION = re.compile(
    r"^(?:static inline |extern )?(?P<result>(?:const )?\w[\w ]*?[ *]+)(?P<name>\w+)"
    r"\((?P<parameters>[^;{]*?)\)\s*[;{]",
    re.MULTILINE,
)
FIELD = re.compile(
    r"^ +(?:const )?(?P<type>\w+) \*?(?P<name>\w+)(?:\[\w+\])*;(?P<comment>[ \t]*/\*\*<.*)?$",
    re.MULTILINE,
)


def has_unit(name: str) -> bool:
    """Whether a name says its unit, or names no quantity."""
    return bool(UNITS.search(name) or PLAIN.search(name))


def comment_before(text: str, position: int) -> str:
    """The comment of the declaration at this position, or of the group that it stands in."""
    lines = text[:position].splitlines()
    while lines and lines[-1].strip() and not lines[-1].endswith("*/"):
        lines.pop()  # an earlier declaration of the group
    match = re.search(r"/\*\*(?:(?!\*/).)*\*/$", "\n".join(lines), re.DOTALL)
    return match.group(0) if match else ""


def check_header(file: Path, text: str) -> list[str]:
    """Findings in one header."""
    findings = []

    def say(position: int, what: str) -> None:
        findings.append(f"{file}:{text.count(chr(10), 0, position) + 1}: {what}")

    head = re.match(r"/\*\*(?P<words>(?:(?!\*/).)*)\*/\n#ifndef", text, re.DOTALL)
    if not head or len(head["words"].split()) < 5:
        say(0, "no comment above the include guard says what the module does")
    for match in FUNCTION.finditer(text):
        comment = comment_before(text, match.start())
        if not comment:
            say(match.start(), f"{match['name']} has no comment")
            continue
        for parameter in match["parameters"].split(","):
            words = re.findall(r"\w+", parameter)
            kind, name = words[-2:] if len(words) >= 2 else ("", "")
            if kind in NUMBER_TYPES and not has_unit(name) and name not in comment:
                say(match.start(), f"{match['name']}: nothing says the unit of {name}")
        result = match["result"].replace("const ", "").strip()
        if result in NUMBER_TYPES and not has_unit(match["name"]) and len(comment.split()) < 4:
            say(match.start(), f"{match['name']}: nothing says the unit of what it returns")
    for match in FIELD.finditer(text):
        named = match["comment"] or has_unit(match["name"]) or match["type"] in UNIT_TYPES
        if match["type"] in NUMBER_TYPES and not named:
            say(match.start(), f"nothing says the unit of the field {match['name']}")
    return findings


def check_headers() -> list[str]:
    """All headers of the firmware but the generated one, whose generator has a test of its own."""
    return [
        finding
        for file in sorted((ROOT / "firmware").rglob("*.h"))
        if file.name != "object_dictionary.h"
        for finding in check_header(file.relative_to(ROOT), file.read_text())
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: returns 0 when the check found nothing, else 1."""
    parser = argparse.ArgumentParser(prog="hpmc.quality", description=__doc__.splitlines()[0])
    checks = parser.add_subparsers(dest="check", required=True)
    for name in ("coverage", "forget-coverage"):
        checks.add_parser(name).add_argument("build", nargs="+")
    checks.add_parser("cppcheck").add_argument("path", nargs="+")
    tidy = checks.add_parser("clang-tidy")
    tidy.add_argument("build", type=Path)
    tidy.add_argument("source", type=Path, nargs="+")
    checks.add_parser("misra").add_argument("--write", action="store_true")
    checks.add_parser("headers")
    arguments = parser.parse_args(argv)

    if arguments.check == "forget-coverage":
        forget_coverage(arguments.build)
        return 0
    if arguments.check == "coverage":
        findings = check_coverage(arguments.build)
    elif arguments.check == "cppcheck":
        findings = check_cppcheck(arguments.path)
    elif arguments.check == "clang-tidy":
        findings = check_clang_tidy(arguments.build, arguments.source)
    elif arguments.check == "misra":
        findings = check_misra(arguments.write)
    else:
        findings = check_headers()
    for finding in findings:
        print(finding)
    print(f"{arguments.check}: {len(findings)} findings" if findings else
          f"{arguments.check}: clean")  # fmt: skip
    return int(bool(findings))


if __name__ == "__main__":
    sys.exit(main())
