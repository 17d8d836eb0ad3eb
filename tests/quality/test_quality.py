"""The checks of the sources' quality find what they are for: faults put into small sources."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

from hpmc import quality
from hpmc.quality import Coverage, Gap, Violation

# --- MISRA C:2012 --------------------------------------------------------------------------------

# One violation each, and the rule that it violates; none of these is deviated anywhere.
MISRA_FAULTS = {
    "7.1": "static int32_t f(void) {\n    return 017;\n}",
    "7.2": "static uint32_t f(void) {\n    return 0x80000000;\n}",
    "8.2": "static int32_t f() {\n    return 1;\n}",
    "10.1": "static uint32_t f(int32_t a) {\n    return (uint32_t)(a << 1);\n}",
    "11.3": "static uint16_t f(uint8_t *a) {\n    return *(uint16_t *)a;\n}",
    "11.8": "static uint8_t *f(const uint8_t *a) {\n    return (uint8_t *)a;\n}",
    "12.2": "static uint32_t f(uint32_t a) {\n    return a << 32U;\n}",
    "13.4": "static int32_t f(int32_t a, int32_t b) {\n    int32_t c;\n    return (c = a) + b;\n}",
    "14.4": (
        "static int32_t f(int32_t a) {\n    if (a) {\n        return 1;\n    }\n"
        "    return 2;\n}"
    ),
    "15.1": "static int32_t f(void) {\n    goto end;\nend:\n    return 1;\n}",
    "15.6": "static int32_t f(bool a) {\n    if (a)\n        return 1;\n    return 2;\n}",
    "16.4": (
        "static int32_t f(int32_t a) {\n    switch (a) {\n    case 1:\n        return 1;\n"
        "    case 2:\n        return 2;\n    }\n    return 3;\n}"
    ),
    "17.2": "uint32_t f(uint32_t a);\nuint32_t f(uint32_t a) {\n    return f(a - 1U);\n}",
    "17.7": "static int32_t g(void) {\n    return 1;\n}\nstatic void f(void) {\n    g();\n}",
    "21.3": "static void *f(void) {\n    return malloc(4U);\n}",
}  # fmt: skip


def misra(folder: Path, code: str, name: str = "fault.c") -> list[Violation]:
    """Violations in one source."""
    (folder / name).write_text(f"#include <stdbool.h>\n#include <stdint.h>\n\n{code}\n")
    return quality.find_violations([Path(name)], Path(), folder)


def deviations() -> list[quality.Entry]:
    return quality.load_table(quality.TABLES / "misra.toml", "deviation")


@pytest.mark.parametrize("rule", MISRA_FAULTS)
def test_misra_violation_is_reported(tmp_path: Path, rule: str) -> None:
    found = misra(tmp_path, MISRA_FAULTS[rule])
    assert rule in {violation.rule for violation in found}
    judged = quality.judge_misra(found, deviations())
    assert any(f"rule {rule}:" in finding for finding in judged)


def test_misra_has_nothing_to_say_of_good_code(tmp_path: Path) -> None:
    assert misra(tmp_path, "int32_t one(void);\n\nint32_t one(void) {\n    return 1;\n}") == []


def test_misra_deviation_holds_at_its_place_only() -> None:
    entry = {"rule": "11.5", "files": ["firmware/node/a.c"], "code": "= device;", "reason": "r"}
    here = Violation("11.5", "firmware/node/a.c", 7, "    motor_node_t *node = device;")
    elsewhere = Violation("11.5", "firmware/canopen/b.c", 7, here.code)
    other_code = Violation("11.5", here.file, 9, "    uint8_t *byte = anything;")
    other_rule = Violation("11.4", here.file, 7, here.code)
    assert quality.judge_misra([here], [entry]) == []
    for violation in (elsewhere, other_code, other_rule):
        assert quality.judge_misra([here, violation], [entry]) == [str(violation)]


def test_misra_deviation_that_is_not_needed_is_reported() -> None:
    entry = {"rule": "15.5", "files": ["firmware/a.c", "firmware/b.c"], "reason": "r"}
    found = quality.judge_misra([Violation("15.5", "firmware/a.c", 1, "return;")], [entry])
    assert found == ["misra.toml is stale: rule 15.5 is not violated in firmware/b.c"]


def test_table_entry_without_a_reason_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "table.toml"
    table.write_text('[[deviation]]\nrule = "15.5"\nfiles = ["firmware/*"]\nreason = "so"\n')
    with pytest.raises(SystemExit, match="gives no reason"):
        quality.load_table(table, "deviation")


# --- coverage ------------------------------------------------------------------------------------

REASON = "a reason in words"
GAP = Gap("f.c", "f", "if (a) {", 1)
ALLOWED = {
    "file": "f.c", "function": "f", "condition": "if (a) {", "missing": 1, "reason": REASON,
}  # fmt: skip


def reached(*gaps: Gap, branches_taken: int = 99) -> Coverage:
    return Coverage(
        lines=50, lines_reached=50, branches=100, branches_taken=branches_taken, gaps=set(gaps)
    )


def test_full_coverage_is_clean() -> None:
    assert quality.judge_coverage({"coverage": reached(branches_taken=100)}, []) == []


def test_branch_without_reason_is_reported() -> None:
    assert "uncovered.toml does not say why" in "".join(
        quality.judge_coverage({"coverage": reached(GAP)}, [])
    )
    assert quality.judge_coverage({"coverage": reached(GAP)}, [ALLOWED]) == []


def test_one_branch_more_than_justified_is_reported() -> None:
    gap = Gap(GAP.file, GAP.function, GAP.condition, 2)
    found = quality.judge_coverage({"coverage": reached(gap)}, [ALLOWED])
    assert len(found) == 2  # the new gap, and the reason that fits no longer


def test_reason_without_gap_is_stale() -> None:
    found = quality.judge_coverage({"coverage": reached()}, [ALLOWED])
    assert len(found) == 1
    assert "stale" in found[0]


def test_too_few_branches_are_reported_although_justified() -> None:
    found = quality.judge_coverage({"coverage": reached(GAP, branches_taken=97)}, [ALLOWED])
    assert found == ["coverage: 97.0 % of the branches are taken, 98 % are demanded"]


def test_line_that_no_build_reaches_cannot_be_justified() -> None:
    gap = Gap("f.c", "f", "return 1;", 0)
    entry = {**ALLOWED, "condition": "return 1;", "missing": 0}
    both = {"coverage": reached(gap), "coverage-fixed": reached(gap)}
    one = {"coverage": reached(), "coverage-fixed": reached(gap)}
    assert "in any build" in quality.judge_coverage(both, [entry])[0]
    assert quality.judge_coverage(one, [entry]) == []
    assert "does not say why" in quality.judge_coverage(one, [])[0]


def test_nothing_measured_is_reported() -> None:
    assert "coverage: nothing was measured" in quality.judge_coverage({"coverage": Coverage()}, [])


def test_coverage_of_a_real_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "firmware" / "control" / "sign.c"
    source.parent.mkdir(parents=True)
    source.write_text(
        "int sign(int a) {\n    if (a < 0) {\n        return -1;\n    }\n"
        "    return a == 5 || a == 6;\n}\n\n"
        "int main(void) {\n    return sign(5) - 1;\n}\n"
    )
    build = tmp_path / "build"
    build.mkdir()
    subprocess.run(["gcc", "--coverage", "-O0", source, "-o", "sign"], cwd=build, check=True)
    subprocess.run([build / "sign"], cwd=build, check=True)
    monkeypatch.setattr(quality, "ROOT", tmp_path)
    coverage = quality.read_coverage(quality.measure_coverage(build), tmp_path)
    assert (coverage.lines, coverage.lines_reached) == (6, 5)
    assert (coverage.branches, coverage.branches_taken) == (6, 2)
    file = "firmware/control/sign.c"
    assert coverage.gaps == {
        Gap(file, "sign", "if (a < 0) {", 1),
        Gap(file, "sign", "return -1;", 0),
        Gap(file, "sign", "return a == 5 || a == 6;", 3),
    }
    quality.forget_coverage([str(build)])
    report: dict[str, Any] = quality.measure_coverage(build)
    assert quality.read_coverage(report, tmp_path).lines_reached == 0


# --- cppcheck, clang-tidy ------------------------------------------------------------------------


def test_cppcheck_finds_an_uninitialised_variable(tmp_path: Path) -> None:
    source = tmp_path / "fault.c"
    source.write_text("int main(void) {\n    int a;\n    return a;\n}\n")
    found = quality.check_cppcheck([str(source)])
    assert any("uninitvar" in finding for finding in found)


def test_cppcheck_takes_a_suppression_beside_the_code(tmp_path: Path) -> None:
    source = tmp_path / "fault.c"
    source.write_text(
        "int main(void) {\n    int a;\n    /* cppcheck-suppress uninitvar ; a reason */\n"
        "    return a;\n}\n"
    )
    assert not any("uninitvar" in finding for finding in quality.check_cppcheck([str(source)]))


def test_clang_tidy_finds_a_narrowing_conversion(tmp_path: Path) -> None:
    source = tmp_path / "fault.c"
    source.write_text("signed char f(int a) {\n    signed char b = a;\n    return b;\n}\n")
    (tmp_path / "compile_commands.json").write_text(
        f'[{{"directory": "{tmp_path}", "command": "gcc -c fault.c", "file": "fault.c"}}]'
    )
    (tmp_path / ".clang-tidy").write_text((quality.ROOT / ".clang-tidy").read_text())
    found = quality.check_clang_tidy(tmp_path, [source])
    assert any("bugprone-narrowing-conversions" in finding for finding in found)
    source.write_text("int f(int a) {\n    return a;\n}\n")
    assert quality.check_clang_tidy(tmp_path, [source]) == []


def test_clang_tidy_that_cannot_read_a_source_is_no_success(tmp_path: Path) -> None:
    (tmp_path / "compile_commands.json").write_text("[]")
    assert quality.check_clang_tidy(tmp_path, [tmp_path / "missing.c"]) != []


# --- headers -------------------------------------------------------------------------------------

HEADER = """/**
 * Turns a thing into another, in the units that the names say.
 */
#ifndef THING_H
#define THING_H

typedef struct {
    uint32_t since_us;
    uint32_t events; /**< since power-on */
} thing_t;

/** Starts afresh. */
void thing_reset(thing_t *thing);
void thing_stop(thing_t *thing);

/** Lets time pass; returns the torque in N m. */
float thing_step(uint32_t elapsed_us, thing_t *thing);

/** Half of a. */
static inline int32_t thing_half(int32_t a) {
    return a / 2;
}

#endif
"""


def test_described_header_is_clean() -> None:
    assert quality.check_header(Path("thing.h"), HEADER) == []


@pytest.mark.parametrize(
    ("there", "instead", "finding"),
    [
        ("/** Starts afresh. */\n", "", "thing_reset has no comment"),
        ("void thing_stop", "\nvoid thing_stop", "thing_stop has no comment"),
        ("/** Half of a. */\n", "", "thing_half has no comment"),
        ("uint32_t elapsed_us", "uint32_t elapsed", "nothing says the unit of elapsed"),
        ("since_us;", "since;", "nothing says the unit of the field since"),
        ("/** Lets time pass; returns the torque in N m. */", "/** Next. */", "of what it returns"),
        (HEADER[: HEADER.index("#ifndef")], "", "no comment above the include guard"),
    ],
)
def test_header_that_leaves_something_out(there: str, instead: str, finding: str) -> None:
    assert HEADER.count(there) == 1
    found = quality.check_header(Path("thing.h"), HEADER.replace(there, instead))
    assert any(finding in line for line in found), found
