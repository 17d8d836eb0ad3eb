"""The pin table of docs/hardware beside the header that the firmware is built with."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HEADER = ROOT / "firmware" / "port" / "stm32f405" / "board_pins.h"
TABLE = ROOT / "docs" / "hardware" / "wiring.md"

PIN = re.compile(
    r"^#define PIN_(\w+) +\\?\s*"
    r"\(\(gpio_pin_t\)\{GPIO([A-C])_BASE, (\d+), GPIO_(\w+), (\d+), GPIO_(\w+)\}\)$",
    re.MULTILINE,
)
ROW = re.compile(
    r"^\| (\w+) \| P([A-C])(\d+) \| (\w+)(?: (\d+))? \|([\w ]*)\| (\w+) \|", re.MULTILINE
)
PULLS = {"NO_PULL": "none", "PULL_UP": "up", "PULL_DOWN": "down"}
# DS8626 table 9: what an alternate function or converter channel is on a pin that is used here.
FUNCTIONS = {
    ("B", 8, 9): "CAN1_RX", ("B", 9, 9): "CAN1_TX", ("A", 9, 7): "USART1_TX",
    ("A", 10, 7): "USART1_RX", ("A", 0, 2): "TIM5_CH1", ("A", 1, 2): "TIM5_CH2",
    ("A", 2, 2): "TIM5_CH3", ("A", 8, 1): "TIM1_CH1", ("C", 0, 0): "ADC1_IN10",
    ("C", 1, 0): "ADC1_IN11",
}  # fmt: skip
NEEDED_BY_THE_CHIP = {"A13", "A14", "B3", "A11", "A12", "B2", "C14", "C15"}

Pin = tuple[str, str, int, str, int, str]


def header_pins(source: str) -> list[Pin]:
    found = [
        (name, port, int(number), mode.lower(), int(alternate), PULLS[pull])
        for name, port, number, mode, alternate, pull in PIN.findall(source)
    ]
    assert len(found) == source.count("#define PIN_")
    return found


def table_pins(page: str) -> list[Pin]:
    pins = page.split("\n## Wiring")[0]
    rows = ROW.findall(pins)
    assert len(rows) == sum(line.startswith("| ") for line in pins.splitlines()) - 1  # heading
    return [
        (name, port, int(number), mode, int(alternate or 0), pull)
        for name, port, number, mode, alternate, _, pull in rows
    ]


def test_the_table_is_that_of_the_header() -> None:
    assert table_pins(TABLE.read_text()) == header_pins(HEADER.read_text())


def test_no_pin_has_two_uses() -> None:
    pins = [f"{port}{number}" for _, port, number, *_ in header_pins(HEADER.read_text())]
    assert len(pins) == len(set(pins))
    assert not NEEDED_BY_THE_CHIP & set(pins)


def test_functions_are_those_of_the_data_sheet() -> None:
    for name, port, number, mode, alternate, function, _ in ROW.findall(TABLE.read_text()):
        known = FUNCTIONS.get((port, int(number), int(alternate or 0)), "")
        assert function.strip() == known, name
        assert (mode in {"alternate", "analog"}) == bool(known), name
