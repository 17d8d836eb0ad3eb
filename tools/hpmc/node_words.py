"""What the numbers of a motor node say, in words: drive and NMT state, limit reasons, emergencies.

Limit reasons are read from the description of 2200h in motor_node.eds. Sources of the others:
CiA 402 (statusword), CiA 301 (NMT states, emergency error codes).
"""

import configparser
import re
from functools import lru_cache

from hpmc.layout import ROOT

EDS = ROOT / "firmware" / "od" / "motor_node.eds"
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
_EMERGENCIES = {
    0x0000: "no error",
    0x2310: "over-current",
    0x4310: "over-temperature",
    0x6010: "reset by watchdog or supervisor",
    0x7305: "encoder implausible",
    0x8100: "own node-id heard from another device",
    0x8130: "heartbeat missing",
    0x8140: "recovered from bus-off",
    0x8210: "PDO too short, not processed",
    0x8220: "PDO too long",
    0x8240: "SYNC of unexpected length",
    0x8250: "no command within the deadline",
    0x8400: "overspeed",
    0x8611: "following error",
    0x8612: "position limit exceeded",
    0x8700: "SYNC missing",
}


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
    names = _limit_reason_names()
    return [names.get(bit, f"bit {bit}") for bit in range(16) if bits >> bit & 1]


def emergency(code: int) -> str:
    """By the emergency error code."""
    return _EMERGENCIES.get(code, "unknown emergency")


@lru_cache
def _limit_reason_names() -> dict[int, str]:
    eds = configparser.ConfigParser(interpolation=None, strict=False)
    eds.read(EDS, encoding="ascii")
    return {
        int(bit): name.strip()
        for bit, name in re.findall(r"\b(\d+) ([^,;]+)", eds["2200"]["Description"])
    }
