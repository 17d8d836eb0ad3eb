"""What a frame says: its name, its node, and its content in words with units.

PDOs, NMT, SYNC, EMCY and heartbeats are read by motor_node.dbc (which knows nodes 1 to 3; a frame
of another node is read as node 1's), SDO by CiA 301, 7.2.4.3, with the objects of motor_node.eds.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import canopen
import cantools
from canopen.sdo.exceptions import SdoAbortedError
from cantools.database.can import Database, Message, Signal

from hpmc import node_words
from hpmc.can.words import emergency_text, name_of, statusword_text
from hpmc.candump import Frame
from hpmc.layout import ROOT

DBC = ROOT / "firmware" / "od" / "motor_node.dbc"
_TEMPLATE_NODE = 1
_LONGEST_NUMBER = 8


@dataclass(frozen=True)
class Decoded:
    """A frame in words."""

    name: str  # N1_TPDO1
    node: int | None  # that it comes from or goes to; None: of the whole bus
    service: str  # TPDO1
    text: str
    values: dict[str, float] = field(default_factory=dict)  # signals of the DBC, with their units


def decode(frame: Frame) -> Decoded:
    """Never fails: what cannot be read says so and shows its bytes."""
    if frame.is_error:
        text = f"error frame {frame.cob_id:08X}h {_hex(frame.data)}"
        return Decoded("error", None, "error", text)
    name, node, service = name_of(frame.cob_id)
    if frame.is_remote:
        return Decoded(name, node, service, "remote frame")
    if service in ("SDO_request", "SDO_reply"):
        return Decoded(name, node, service, _sdo(frame.data, service == "SDO_request"))
    message = _message(frame.cob_id, node)
    if message is None or (service == "SYNC" and not frame.data):
        return Decoded(name, node, service, _hex(frame.data))
    if len(frame.data) < message.length:
        return Decoded(
            name, node, service,
            f"too short: {len(frame.data)} of {message.length} bytes {_hex(frame.data)}",
        )  # fmt: skip
    values: dict[str, Any] = dict(message.decode(frame.data, decode_choices=False))
    if service == "NMT":
        text = _nmt(message, values)
    elif service == "EMCY":
        text = emergency_text(frame.data)
    else:
        text = ", ".join(_signal_text(signal, values[signal.name]) for signal in message.signals)
    return Decoded(name, node, service, text, values)


@lru_cache
def _database() -> Database:
    database = cantools.database.load_file(DBC)
    assert isinstance(database, Database)
    return database


@lru_cache(maxsize=2048)
def _message(cob_id: int, node: int | None) -> Message | None:
    known = {message.frame_id: message for message in _database().messages}
    if cob_id in known:
        return known[cob_id]
    return known.get(cob_id - node + _TEMPLATE_NODE) if node else None


def _signal_text(signal: Signal, value: float) -> str:
    if signal.name == "statusword":
        return f"{signal.name} {int(value):04X}h ({statusword_text(int(value))})"
    if signal.name == "limit_reasons":
        reasons = ", ".join(node_words.limit_reasons(int(value))) or "none"
        return f"{signal.name} {int(value):04X}h ({reasons})"
    if signal.name == "controlword":
        return f"{signal.name} {int(value):04X}h"
    if signal.choices and int(value) in signal.choices:
        return str(signal.choices[int(value)])
    number = f"{value:.{_digits(float(signal.scale))}f}"
    return f"{signal.name} {number}{' ' + signal.unit if signal.unit else ''}"


@lru_cache
def _digits(scale: float) -> int:
    """Decimals that show a signal to its last bit: scale 0.001 has three."""
    return next(digits for digits in range(_LONGEST_NUMBER) if round(scale, digits) == scale)


def _nmt(message: Message, values: dict[str, Any]) -> str:
    choices = message.get_signal_by_name("nmt_command").choices or {}
    command, node = int(values["nmt_command"]), int(values["nmt_node_id"])
    whom = f"node {node}" if node else "all nodes"
    return f"{choices.get(command, f'command {command}')}: {whom}"


def _hex(data: bytes) -> str:
    return data.hex(" ").upper() or "no data"


# --- SDO ---------------------------------------------------------------------------------------


@lru_cache
def _objects() -> canopen.ObjectDictionary:
    return canopen.import_od(str(node_words.EDS), node_id=_TEMPLATE_NODE)


def object_name(index: int, subindex: int) -> str:
    """1017h Producer heartbeat time; of a record with the sub-index."""
    found = _variable(index, subindex)
    place = f"{index:04X}h"
    entry = _objects().get(index)
    if entry is None:
        return f"{place}:{subindex:02X} (not in the EDS)"
    if isinstance(entry, canopen.objectdictionary.ODVariable) and subindex == 0:
        return f"{place} {entry.name}"
    part = found.name if found else "no such sub-index"
    whole = "" if part.startswith(entry.name) else f"{entry.name}, "
    return f"{place}:{subindex:02X} {whole}{part}"


def _variable(index: int, subindex: int) -> Any:  # noqa: ANN401
    entry = _objects().get(index)
    if entry is None or isinstance(entry, canopen.objectdictionary.ODVariable):
        return entry if subindex == 0 else None
    return entry.subindices.get(subindex)


def _value_text(index: int, subindex: int, data: bytes) -> str:
    variable = _variable(index, subindex)
    if variable is None:
        return _hex(data)
    try:
        value = variable.decode_raw(data)
    except (ValueError, TypeError, canopen.ObjectDictionaryError):
        return _hex(data)
    if isinstance(value, int) and index == 0x6041:
        return f"{value:04X}h ({statusword_text(value)})"
    if isinstance(value, int) and index == 0x1016 and subindex:
        return f"node {value >> 16 & 0x7F}, {value & 0xFFFF} ms"
    return f"{value!r}{' ' + variable.unit if variable.unit else ''}"


def _sdo(data: bytes, request: bool) -> str:
    if len(data) < 8:
        return f"too short: {len(data)} of 8 bytes {_hex(data)}"
    command, rest = data[0] >> 5, data[4:8]
    index, subindex = int.from_bytes(data[1:3], "little"), data[3]
    if command == 4:
        code = int.from_bytes(rest, "little")
        reason = SdoAbortedError.CODES.get(code, "unknown reason")
        return f"abort of {object_name(index, subindex)}: {code:08X}h {reason}"
    # Numbers of the commands, CiA 301 tables 40 to 46: requests and replies differ.
    initiate_download, initiate_upload = (1, 2) if request else (3, 2)
    if command == initiate_upload and request:
        return f"read {object_name(index, subindex)}"
    if command == initiate_download and not request:
        return f"written {object_name(index, subindex)}"
    if command in (initiate_download, initiate_upload):
        verb = "write " if request else ""
        if data[0] & 2:
            unused = data[0] >> 2 & 3 if data[0] & 1 else 0
            value = _value_text(index, subindex, rest[: 4 - unused])
        else:
            value = f"{int.from_bytes(rest, 'little')} bytes in segments"
        return f"{verb}{object_name(index, subindex)} = {value}"
    return _segment(data, command, request)


def _segment(data: bytes, command: int, request: bool) -> str:
    holds_data = command == 0
    if not holds_data:
        asks = request and command == 3
        return "next segment, please" if asks else "segment taken" if command == 1 else _hex(data)
    used = data[1 : 8 - (data[0] >> 1 & 7)]
    last = ", the last" if data[0] & 1 else ""
    return f"segment{last}: {used!r}" if used.isascii() else f"segment{last}: {_hex(used)}"
