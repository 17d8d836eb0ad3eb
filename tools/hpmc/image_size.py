"""What an image of the motor node takes: flash, RAM, and the deepest stack of each call tree.

Everything is read from the linked ELF file, library functions included: sections for flash and RAM,
the disassembly for the stack. A function's frame is the sum of all that it pushes or subtracts, an
upper bound where it does so on several paths; a tail call (a branch to another function) has
given the frame back. Calls through pointers cannot be followed: a file lists them by caller, and
one that is not listed is an error, as is recursion.

Exceptions nest by priority (firmware/port/stm32f405/interrupts.h): the whole is main, plus each
priority's deepest handler, plus what the core stacks at each entry.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

FLASH_SECTIONS = (".vectors", ".version", ".text", ".data")
RAM_SECTIONS = (".stack", ".noinit", ".data", ".bss")
# Stacked at exception entry, with the word that may be needed to align it (DDI 0403E, B1.5.7).
ENTRY_BYTES = 32 + 4
ENTRY_FLOAT_BYTES = 104 + 4
EXIT_OVER, EXIT_USAGE = 1, 2

FUNCTION = re.compile(r"^[0-9a-f]+ <([^>]+)>:$")
INSTRUCTION = re.compile(r"^\s+[0-9a-f]+:\t(?:[0-9a-f]{4} ?)+\s*\t(\S+)\s*([^@;]*)")
TARGET = re.compile(r"<([^>+]+)(\+0x[0-9a-f]+)?>")
REGISTERS = re.compile(r"\{([^}]*)\}")
SIZE = re.compile(r"^(\.\S+)\s+(\d+)\s+\d+", re.MULTILINE)


class SizeError(Exception):
    """The image cannot be judged."""


@dataclass
class Function:
    """What the disassembly of a function says."""

    frame: int = 0
    calls: set[str] = field(default_factory=set)
    tail_calls: set[str] = field(default_factory=set)
    indirect: bool = False
    floating: bool = False


@dataclass(frozen=True)
class Depth:
    """The deepest path from a function."""

    stack_bytes: int
    path: tuple[str, ...]
    floating: bool


@dataclass(frozen=True)
class Budget:
    """Most that an image may take, in bytes."""

    flash: int = 32 * 1024
    ram: int = 8 * 1024
    stack: int = 1024


def register_count(names: str) -> int:
    """Registers of a list such as r4, r5, r7-r9, lr."""
    count = 0
    for part in (p.strip() for p in names.split(",")):
        first, _, last = part.partition("-")
        count += int(last[1:]) - int(first[1:]) + 1 if last else 1
    return count


def grows(operation: str, operands: str) -> int:
    """Bytes by which an instruction moves the stack pointer down."""
    listed = REGISTERS.search(operands)
    if operation.startswith(("push", "vpush")) or (
        operation.startswith(("stmdb", "vstmdb")) and operands.startswith("sp!")
    ):
        each = 8 if listed and listed[1].startswith("d") else 4
        return each * register_count(listed[1]) if listed else 0
    if operation.startswith("sub") and re.match(r"sp, (sp, )?#\d+", operands):
        return int(operands.rsplit("#", 1)[1])
    if operation.startswith(("str", "strd")) and (m := re.search(r"\[sp, #-(\d+)\]!", operands)):
        return int(m[1])
    return 0


def read_functions(disassembly: str) -> dict[str, Function]:
    """All functions of objdump -d."""
    functions: dict[str, Function] = {}
    name = ""
    for line in disassembly.splitlines():
        if head := FUNCTION.match(line):
            name = head[1]
            functions[name] = Function()
            continue
        if not name or not (match := INSTRUCTION.match(line)):
            continue
        operation, operands = match[1], match[2].strip()
        function = functions[name]
        function.frame += grows(operation, operands)
        function.floating = function.floating or operation.startswith("v")
        target = TARGET.search(line)
        if operation in ("bl", "blx") and target:
            function.calls.add(target[1])
        elif operation == "blx" or (operation == "bx" and operands != "lr"):
            function.indirect = True
        elif operation.startswith("b") and target and target[1] != name and not target[2]:
            function.tail_calls.add(target[1])
    return functions


def deepest(
    name: str,
    functions: Mapping[str, Function],
    indirect: Mapping[str, Sequence[str]],
    known: dict[str, Depth],
    above: tuple[str, ...] = (),
) -> Depth:
    """The deepest path that begins with a call of a function."""
    if name in known:
        return known[name]
    if name in above:
        raise SizeError(f"recursion: {' -> '.join([*above[above.index(name):], name])}")
    if name not in functions:
        raise SizeError(f"{above[-1] if above else 'the list'} calls {name}, which is not there")
    function = functions[name]
    if function.indirect and name not in indirect:
        raise SizeError(f"{name} calls through a pointer: list what it may call")
    callees = function.calls | set(indirect.get(name, ()))
    best = Depth(function.frame, (name,), function.floating)
    floating = function.floating
    for callee, frame in [
        *((c, function.frame) for c in sorted(callees)),
        *((c, 0) for c in sorted(function.tail_calls)),
    ]:
        below = deepest(callee, functions, indirect, known, (*above, name))
        floating = floating or below.floating
        if frame + below.stack_bytes > best.stack_bytes:
            best = Depth(frame + below.stack_bytes, (name, *below.path), floating)
    known[name] = Depth(best.stack_bytes, best.path, floating)
    return known[name]


@dataclass(frozen=True)
class Report:
    """What an image takes."""

    flash: int
    ram: int
    levels: tuple[Depth, ...]  # main first, then each priority's deepest handler
    alone: tuple[Depth, ...]  # trees that nothing interrupts
    trees: tuple[Depth, ...]
    entry_bytes: int
    start_bytes: int  # below all others

    @property
    def stack(self) -> int:
        """Main and all handlers on top of each other."""
        nested = self.entry_bytes + sum(depth.stack_bytes for depth in self.levels)
        return self.start_bytes + max(nested, *(depth.stack_bytes for depth in self.alone))

    def text(self, budget: Budget) -> str:
        """For the terminal."""
        lines = [
            f"flash {self.flash:6} of {budget.flash} bytes",
            f"RAM   {self.ram:6} of {budget.ram} bytes, the stack's room included",
            f"stack {self.stack:6} of {budget.stack} bytes: main and one handler of each priority, "
            f"{self.entry_bytes} for exception entries",
        ]
        for depth in self.trees:
            lines.append(f"  {depth.stack_bytes:5}  {' > '.join(depth.path)}")
        return "\n".join(lines)

    def over(self, budget: Budget) -> list[str]:
        """What is beyond the budget."""
        pairs = (("flash", self.flash, budget.flash), ("RAM", self.ram, budget.ram),
                 ("stack", self.stack, budget.stack))  # fmt: skip
        return [f"{name}: {used} bytes, {used - most} over the budget of {most}"
                for name, used, most in pairs if used > most]  # fmt: skip


def measure(elf: Path, tools: str, calls: Mapping[str, object]) -> Report:
    """Measures an ELF file. tools: prefix of size and objdump."""
    sizes = run(f"{tools}size", "-A", str(elf))
    sections = {name: int(size) for name, size in SIZE.findall(sizes)}
    functions = read_functions(run(f"{tools}objdump", "-d", str(elf)))
    indirect: Mapping[str, Sequence[str]] = calls["indirect"]  # type: ignore[assignment]
    priorities: Sequence[Sequence[str]] = calls["priorities"]  # type: ignore[assignment]
    for caller in indirect:
        if caller in functions and not functions[caller].indirect:
            raise SizeError(f"{caller} is listed, but calls nothing through a pointer")
    known: dict[str, Depth] = {}
    before: Sequence[str] = calls["alone"]  # type: ignore[assignment]
    alone = tuple(deepest(name, functions, indirect, known) for name in before)
    levels, trees = [], []
    entries = 0
    for handlers in priorities:
        depths = [deepest(name, functions, indirect, known) for name in handlers]
        trees += depths
        worst = max(depths, key=lambda depth: depth.stack_bytes)
        levels.append(worst)
    for below in levels[:-1]:
        entries += ENTRY_FLOAT_BYTES if below.floating else ENTRY_BYTES
    return Report(
        sum(sections.get(name, 0) for name in FLASH_SECTIONS),
        sum(sections.get(name, 0) for name in RAM_SECTIONS),
        tuple(levels), alone, (*alone, *trees), entries, functions[str(calls["start"])].frame,
    )  # fmt: skip


def run(*command: str) -> str:
    """Output of a tool."""
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise SizeError(f"{command[0]}: {error}") from error


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: 0 within the budget, 1 beyond, 2 when the image cannot be judged."""
    standard = Budget()
    parser = argparse.ArgumentParser(prog="image_size", description=__doc__.split("\n")[0])
    parser.add_argument("elf", type=Path)
    parser.add_argument("--calls", type=Path, required=True, help="list of indirect calls (TOML)")
    parser.add_argument("--tools", default="arm-none-eabi-", help="prefix of size and objdump")
    parser.add_argument("--flash", type=int, default=standard.flash, help="budget in bytes")
    parser.add_argument("--ram", type=int, default=standard.ram, help="budget in bytes")
    parser.add_argument("--stack", type=int, default=standard.stack, help="budget in bytes")
    arguments = parser.parse_args(argv)
    budget = Budget(arguments.flash, arguments.ram, arguments.stack)
    try:
        calls = tomllib.loads(arguments.calls.read_text(encoding="utf-8"))
        report = measure(arguments.elf, arguments.tools, calls)
    except (OSError, SizeError, tomllib.TOMLDecodeError) as error:
        print(f"image_size: {error}", file=sys.stderr)
        return EXIT_USAGE
    print(report.text(budget))
    over = report.over(budget)
    for line in over:
        print(f"image_size: {line}", file=sys.stderr)
    return EXIT_OVER if over else 0


if __name__ == "__main__":
    sys.exit(main())
