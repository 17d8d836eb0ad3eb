"""What the numbers of a motor node say, in words: drive and NMT state, limit reasons, emergencies.

Limit reasons and bits of the error register are read from motor_node.eds, emergencies from emcy.h.
Sources of the others: CiA 402 (statusword), CiA 301 (NMT states).
"""

import configparser
import re
from functools import lru_cache

from hpmc.layout import ROOT

EDS = ROOT / "firmware" / "od" / "motor_node.eds"
EMCY_HEADER = ROOT / "firmware" / "canopen" / "emcy.h"
CONVERGENCE_BIT = 14
WORD = 0xFFFF

# Mask and value of the statusword for each state of the drive.
_DRIVE_STATES = (
    (0x4F, 0x00, "not ready to switch on"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "operation enabled"),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction active"),
    (0x4F, 0x08, "fault"),
)
_NMT_STATES = {0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"}


def drive_state(statusword: int) -> str:
    """State of the CiA 402 state machine by the statusword (6041h)."""
    for mask, value, name in _DRIVE_STATES:
        if statusword & mask == value:
            return name
    return f"unknown ({statusword & WORD:04X}h)"


def nmt_state(value: int) -> str:
    """By the value of a heartbeat; -1 before the first."""
    return _NMT_STATES.get(value, "not heard yet" if value < 0 else f"unknown ({value})")


def limit_reasons(bits: int) -> list[str]:
    """Why torque is less than asked for, or enabling refused, by 2200h."""
    return _bits_in_words("2200", bits)


def error_register(bits: int) -> list[str]:
    """Kinds of error that last, by 1001h."""
    return _bits_in_words("1001", bits)


def emergency(code: int) -> str:
    """By the emergency error code."""
    return emergencies().get(code, "unknown emergency")


@lru_cache
def emergencies() -> dict[int, str]:
    """Words of every error code that the firmware can send."""
    codes = re.findall(
        r"^\s*EMCY_(\w+) = 0x([0-9A-F]{4}),?(?:\s*/\*\*<\s*(.*?)\s*\*/)?",
        EMCY_HEADER.read_text(encoding="utf-8"), re.MULTILINE,
    )  # fmt: skip
    return {int(code, 16): words or name.lower().replace("_", " ") for name, code, words in codes}


def _bits_in_words(section: str, bits: int) -> list[str]:
    names = _bit_names(section)
    return [names.get(bit, f"bit {bit}") for bit in range(16) if bits >> bit & 1]


@lru_cache
def _bit_names(section: str) -> dict[int, str]:
    eds = configparser.ConfigParser(interpolation=None, strict=False)
    eds.read(EDS, encoding="ascii")
    return {
        int(bit): name.strip()
        for bit, name in re.findall(r"\b(\d+) ([^,;]+)", eds[section]["Description"])
    }
