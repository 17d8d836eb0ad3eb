"""The register header of the STM32F405 port, beside ST's own description and ARM's documents."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import CodeType

import pytest

ROOT = Path(__file__).resolve().parents[2]
HEADER = ROOT / "firmware" / "port" / "stm32f405" / "registers.h"
SVD = ROOT / "build" / "svd" / "STM32F40x.svd"  # ./rig test fetches it

DEFINE = re.compile(r"^#define (\w+)(?:\((\w+)\))? (.+)$", re.MULTILINE)

# Peripherals whose name in the header is another one than in ST's description.
NAMES = {"DBG": "DBG", "ADC_COMMON": "C_ADC", "CAN": "CAN1"}
SINGLE = ["RCC", "FLASH", "PWR", "SYSCFG", "USART1", "IWDG", "ADC1", "ADC_COMMON", "DBGMCU", "CAN"]
TIMERS = ["TIM1", "TIM2", "TIM3", "TIM4", "TIM5", "TIM6", "TIM7", "TIM8"]
SHARED = {"GPIO": ["GPIOA", "GPIOB", "GPIOC"], "TIM": TIMERS}
# Registers of which there are several: name in ST's description, and how many.
MANY = {
    "CAN_RFR": ("RF{}R", 2), "CAN_TIR": ("TI{}R", 3), "CAN_TDTR": ("TDT{}R", 3),
    "CAN_TDLR": ("TDL{}R", 3), "CAN_TDHR": ("TDH{}R", 3), "CAN_RIR": ("RI{}R", 2),
    "CAN_RDTR": ("RDT{}R", 2), "CAN_RDLR": ("RDL{}R", 2), "CAN_RDHR": ("RDH{}R", 2),
    "CAN_FR1": ("F{}R1", 28), "CAN_FR2": ("F{}R2", 28),
}  # fmt: skip

# The core, as in ARM DDI 0403E: address, and (lowest bit, width) of each field.
CORE: dict[str, tuple[int, dict[str, tuple[int, int]]]] = {
    "NVIC_ISER": (0xE000E100, {}), "NVIC_ICER": (0xE000E180, {}),
    "NVIC_ISPR": (0xE000E200, {}), "NVIC_ICPR": (0xE000E280, {}),
    "NVIC_IPR": (0xE000E400, {}),
    "SCB_CPUID": (0xE000ED00, {}),
    "SCB_ICSR": (0xE000ED04, {"VECTACTIVE": (0, 9), "VECTPENDING": (12, 9), "PENDSTCLR": (25, 1),
                              "PENDSTSET": (26, 1), "PENDSVCLR": (27, 1), "PENDSVSET": (28, 1)}),
    "SCB_VTOR": (0xE000ED08, {}),
    "SCB_AIRCR": (0xE000ED0C, {"SYSRESETREQ": (2, 1), "PRIGROUP": (8, 3), "VECTKEY": (16, 16)}),
    "SCB_SCR": (0xE000ED10, {"SLEEPDEEP": (2, 1)}),
    "SCB_CCR": (0xE000ED14, {"UNALIGN_TRP": (3, 1), "DIV_0_TRP": (4, 1), "BFHFNMIGN": (8, 1),
                             "STKALIGN": (9, 1)}),
    "SCB_SHPR1": (0xE000ED18, {"PRI_4": (0, 8), "PRI_5": (8, 8), "PRI_6": (16, 8)}),
    "SCB_SHPR2": (0xE000ED1C, {"PRI_11": (24, 8)}),
    "SCB_SHPR3": (0xE000ED20, {"PRI_14": (16, 8), "PRI_15": (24, 8)}),
    "SCB_SHCSR": (0xE000ED24, {"MEMFAULTENA": (16, 1), "BUSFAULTENA": (17, 1),
                               "USGFAULTENA": (18, 1)}),
    "SCB_CFSR": (0xE000ED28, {
        "IACCVIOL": (0, 1), "DACCVIOL": (1, 1), "MUNSTKERR": (3, 1), "MSTKERR": (4, 1),
        "MLSPERR": (5, 1), "MMARVALID": (7, 1), "IBUSERR": (8, 1), "PRECISERR": (9, 1),
        "IMPRECISERR": (10, 1), "UNSTKERR": (11, 1), "STKERR": (12, 1), "LSPERR": (13, 1),
        "BFARVALID": (15, 1), "UNDEFINSTR": (16, 1), "INVSTATE": (17, 1), "INVPC": (18, 1),
        "NOCP": (19, 1), "UNALIGNED": (24, 1), "DIVBYZERO": (25, 1)}),
    "SCB_HFSR": (0xE000ED2C, {"VECTTBL": (1, 1), "FORCED": (30, 1), "DEBUGEVT": (31, 1)}),
    "SCB_MMFAR": (0xE000ED34, {}), "SCB_BFAR": (0xE000ED38, {}),
    "SCB_CPACR": (0xE000ED88, {"CP10": (20, 2), "CP11": (22, 2)}),
    "FPU_FPCCR": (0xE000EF34, {"LSPEN": (30, 1), "ASPEN": (31, 1)}),
    "FPU_FPDSCR": (0xE000EF3C, {"RMODE": (22, 2), "FZ": (24, 1), "DN": (25, 1)}),
    "SYST_CSR": (0xE000E010, {"ENABLE": (0, 1), "TICKINT": (1, 1), "CLKSOURCE": (2, 1),
                              "COUNTFLAG": (16, 1)}),
    "SYST_RVR": (0xE000E014, {"RELOAD": (0, 24)}), "SYST_CVR": (0xE000E018, {}),
    "MPU_TYPE": (0xE000ED90, {"DREGION": (8, 8)}),
    "MPU_CTRL": (0xE000ED94, {"ENABLE": (0, 1), "HFNMIENA": (1, 1), "PRIVDEFENA": (2, 1)}),
    "MPU_RNR": (0xE000ED98, {}),
    "MPU_RBAR": (0xE000ED9C, {"REGION": (0, 4), "VALID": (4, 1)}),
    "MPU_RASR": (0xE000EDA0, {"ENABLE": (0, 1), "SIZE": (1, 5), "SRD": (8, 8), "B": (16, 1),
                              "C": (17, 1), "S": (18, 1), "TEX": (19, 3), "AP": (24, 3),
                              "XN": (28, 1)}),
    "DCB_DEMCR": (0xE000EDFC, {"TRCENA": (24, 1)}),
    "DWT_CTRL": (0xE0001000, {"CYCCNTENA": (0, 1)}), "DWT_CYCCNT": (0xE0001004, {}),
}  # fmt: skip
CORE_BASES = {
    "NVIC": 0xE000E000, "SCB": 0xE000ED00, "FPU": 0xE000EF30, "SYST": 0xE000E010,
    "MPU": 0xE000ED90, "DCB": 0xE000EDF0, "DWT": 0xE0001000,
}  # fmt: skip

Fields = dict[str, int]  # name: mask


@dataclass
class Peripheral:
    """Base address, and address offset and fields of each register."""

    base: int
    registers: dict[str, tuple[int, Fields]] = field(default_factory=dict)


@dataclass
class Chip:
    """What ST describes."""

    peripherals: dict[str, Peripheral] = field(default_factory=dict)
    interrupts: dict[str, int] = field(default_factory=dict)


def text(element: ElementTree.Element, tag: str) -> str:
    found = element.findtext(tag)
    assert found is not None, f"no {tag}"
    return found


def read_fields(register: ElementTree.Element) -> Fields:
    """Masks by name; bits that are described one by one (PLLN0, PLLN1, ...) also as one field."""
    fields: Fields = {}
    for entry in register.iter("field"):
        mask = ((1 << int(text(entry, "bitWidth"))) - 1) << int(text(entry, "bitOffset"))
        name = text(entry, "name")
        fields[name] = mask
        stem = name.rstrip("0123456789")
        if stem != name:
            fields[f"{stem}#"] = fields.get(f"{stem}#", 0) | mask
    return fields


@pytest.fixture(scope="module")
def chip() -> Chip:
    root = ElementTree.parse(SVD).getroot()
    found = Chip()
    for entry in root.iter("peripheral"):
        name = text(entry, "name")
        peripheral = Peripheral(int(text(entry, "baseAddress"), 0))
        if (origin := entry.get("derivedFrom")) is not None:
            peripheral.registers = found.peripherals[origin].registers
        for register in entry.iter("register"):
            offset = int(text(register, "addressOffset"), 0)
            peripheral.registers[text(register, "name")] = (offset, read_fields(register))
        found.peripherals[name] = peripheral
        for interrupt in entry.iter("interrupt"):
            found.interrupts[text(interrupt, "name")] = int(text(interrupt, "value"))
    return found


@dataclass
class Header:
    """Macros of the register header: values without argument, and expressions with one."""

    values: dict[str, int]
    functions: dict[str, tuple[str, str]]
    fields: dict[str, dict[str, int]] = field(default_factory=dict)  # by register

    def value(self, name: str, argument: int | None = None) -> int:
        if argument is None:
            return self.values[name]
        parameter, expression = self.functions[name]
        return evaluate(expression, ChainMap({parameter: argument}, self.values))


@cache
def compiled(expression: str) -> CodeType:
    """A constant expression of C with + * << on unsigned numbers."""
    plain = re.sub(r"\b(0x[0-9A-F]+|\d+)U\b", r"\1", expression)
    assert re.fullmatch(r"[\w\s()+*<]+", plain), expression
    return compile(plain, expression, "eval")


def evaluate(expression: str, known: Mapping[str, int]) -> int:
    return int(eval(compiled(expression), {"__builtins__": {}}, known))  # compiled() has checked it


def read_header(source: str) -> Header:
    header = Header({}, {})
    body = source.replace("\\\n", " ").split("#define REGISTERS_H\n", 1)[1]
    register = "none"
    for name, parameter, expression in DEFINE.findall(body):
        if parameter:
            assert name not in header.functions, f"{name} is defined twice"
            header.functions[name] = (parameter, expression)
        else:
            assert name not in header.values, f"{name} is defined twice"
            header.values[name] = evaluate(expression, header.values)
            if name.startswith(f"{register}_"):
                header.fields.setdefault(register, {})[name] = header.values[name]
        if "_BASE +" in expression or parameter:
            register = name  # its fields follow
    return header


def field_of(fields: Fields, name: str, number: int | None = None) -> int | None:
    """Mask of a field; RF1R calls its FMP field FMP1."""
    for candidate in (name, f"{name}{number}" if number is not None else name, f"{name}#"):
        if candidate in fields:
            return fields[candidate]
    return None


class Check:
    """Compares a header with what is known, and keeps account of what has been compared."""

    def __init__(self, header: Header, chip: Chip) -> None:
        self.header = header
        self.chip = chip
        self.checked: set[str] = set()
        self.findings: list[str] = []

    def expect(self, name: str, expected: int, found: int) -> None:
        self.checked.add(name)
        if found != expected:
            self.findings.append(f"{name} is {found:#x}, must be {expected:#x}")

    def fields(self, macro: str, known: list[tuple[Fields, int | None]]) -> None:
        """Every field of a register, in each of its instances that has it."""
        for name, value in self.header.fields.get(macro, {}).items():
            for fields, number in known:
                mask = field_of(fields, name.removeprefix(f"{macro}_"), number)
                if mask is not None:
                    self.expect(name, mask, value)

    def bases(self) -> None:
        for name, value in self.header.values.items():
            if not name.endswith("_BASE"):
                continue
            short = name.removesuffix("_BASE")
            if short in CORE_BASES:
                self.expect(name, CORE_BASES[short], value)
            else:
                self.expect(name, self.chip.peripherals[NAMES.get(short, short)].base, value)

    def single(self, prefix: str) -> None:
        svd = self.chip.peripherals[NAMES.get(prefix, "DBG" if prefix == "DBGMCU" else prefix)]
        for register, (offset, fields) in svd.registers.items():
            macro = register if prefix == "DBGMCU" else f"{prefix}_{register}"
            if macro in self.header.values:
                self.expect(macro, svd.base + offset, self.header.values[macro])
                self.fields(macro, [(fields, None)])

    def shared(self, prefix: str, names: list[str]) -> None:
        for macro in self.header.functions:
            if not macro.startswith(f"{prefix}_"):
                continue
            register = macro.removeprefix(f"{prefix}_")
            known: list[tuple[Fields, int | None]] = []
            for name in names:
                svd = self.chip.peripherals[name]
                for variant in (register, f"{register}_Input", f"{register}_Output"):
                    if variant in svd.registers:
                        offset, fields = svd.registers[variant]
                        self.expect(macro, svd.base + offset, self.header.value(macro, svd.base))
                        known.append((fields, None))
            self.fields(macro, known)

    def many(self) -> None:
        can = self.chip.peripherals["CAN1"]
        for macro, (pattern, count) in MANY.items():
            known: list[tuple[Fields, int | None]] = []
            for number in range(count):
                offset, fields = can.registers[pattern.format(number)]
                self.expect(macro, can.base + offset, self.header.value(macro, number))
                known.append((fields, number))
            self.fields(macro, known)

    def core(self) -> None:
        for macro, (address, fields) in CORE.items():
            if macro in self.header.functions:
                for word in range(3):
                    self.expect(macro, address + 4 * word, self.header.value(macro, word))
            else:
                self.expect(macro, address, self.header.values[macro])
            for name, (low, width) in fields.items():
                mask = ((1 << width) - 1) << low
                self.expect(f"{macro}_{name}", mask, self.header.values[f"{macro}_{name}"])

    def interrupts(self) -> None:
        for name, value in self.header.values.items():
            if name.startswith("IRQ_"):
                irq = f"{name.removeprefix('IRQ_')}_IRQ"
                self.expect(name, self.chip.interrupts[irq], value)

    def run(self) -> list[str]:
        """Findings; a line of the header that nothing is known about is one."""
        self.bases()
        for prefix in SINGLE:
            self.single(prefix)
        for prefix, names in SHARED.items():
            self.shared(prefix, names)
        self.many()
        self.core()
        self.interrupts()
        every = set(self.header.values) | set(self.header.functions)
        self.findings += [
            f"{name}: neither ST nor ARM knows it" for name in sorted(every - self.checked)
        ]
        return self.findings


def test_every_address_and_bit_is_as_documented(chip: Chip) -> None:
    header = read_header(HEADER.read_text())
    check = Check(header, chip)
    assert check.run() == []
    assert len(check.checked) == len(header.values) + len(header.functions) > 300


def seeds(source: str) -> list[tuple[str, str, str]]:
    """(macro, line, wrong line) for every definition: its first number off by one, or moved."""
    found = []
    for match in DEFINE.finditer(source.replace("\\\n", " ")):
        line = match.group(0)
        head, number, tail = re.split(r"(0x[0-9A-F]+|\d+)(?=U\b|\)$)", line, maxsplit=1)
        found.append((match.group(1), line, f"{head}{int(number, 0) ^ 2}{tail}"))
        if "<<" in line:
            moved = re.sub(r"<< (\d+)", lambda m: f"<< {(int(m.group(1)) + 1) % 32}", line)
            found.append((match.group(1), line, moved))
    return found


def test_a_wrong_bit_in_any_line_is_found(chip: Chip) -> None:
    source = HEADER.read_text().replace("\\\n", " ")
    unseen = []
    wrong = seeds(source)
    assert len(wrong) > 500
    for macro, line, mutant in wrong:
        findings = Check(read_header(source.replace(f"{line}\n", f"{mutant}\n")), chip).run()
        if not any(macro.removesuffix("_BASE") in finding for finding in findings):
            unseen.append(mutant)
    assert unseen == []


def test_a_line_that_nobody_documents_is_found(chip: Chip) -> None:
    source = HEADER.read_text().replace(
        "#define RCC_CR_HSION ", "#define RCC_CR_LASER (1U << 9)\n#define RCC_CR_HSION "
    )
    assert Check(read_header(source), chip).run() == [
        "RCC_CR_LASER: neither ST nor ARM knows it"
    ]
