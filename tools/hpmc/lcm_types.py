"""Message layouts, read from the .lcm files themselves: numpy types, fingerprints, a plain decoder.

A fixed-size message becomes a big-endian numpy record whose fields have the names and the order of
the .lcm file. The fingerprint is the hash that lcm-gen puts in front of each message; it changes
with every change of a layout, so a log of another version is recognised.
Source: lcm-gen (lcmgen.c, `lcm_struct_hash`) and the LCM type specification.
"""

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

TYPE_FOLDER = Path(__file__).resolve().parents[2] / "lcm_types"

FINGERPRINT_BYTES = 8

_NUMPY_CODE = {
    "int8_t": "i1",
    "int16_t": ">i2",
    "int32_t": ">i4",
    "int64_t": ">i8",
    "float": ">f4",
    "double": ">f8",
    "byte": "u1",
    "boolean": "?",
}
_PRIMITIVES = {*_NUMPY_CODE, "string"}

_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_STRUCT = re.compile(r"struct\s+(\w+)\s*\{(.*?)\}", re.DOTALL)
_MEMBER = re.compile(r"([\w.]+)\s+(\w+)\s*((?:\[\s*\w+\s*\]\s*)*);")
_DIMENSION = re.compile(r"\[\s*(\w+)\s*\]")


class LcmTypeError(ValueError):
    """A .lcm file or a message that does not follow it; the text names both."""


@dataclass(frozen=True)
class Member:
    """One field: its element type, and one size per dimension (a number, or a field's name)."""

    name: str
    type_name: str
    dimensions: tuple[str, ...]


@dataclass(frozen=True)
class LcmType:
    """One struct of a .lcm file."""

    name: str
    members: tuple[Member, ...]

    @property
    def fingerprint(self) -> int:
        """The 64-bit number (unsigned) that precedes every encoded message."""
        return _fingerprint(self, ())

    @property
    def dtype(self) -> np.dtype | None:
        """The numpy record of the message without its fingerprint; None when its size varies."""
        return _dtype(self)

    def decode(self, data: bytes) -> dict[str, Any]:
        """Decodes one message, fixed or variable in size, into a dict; arrays become lists."""
        if int.from_bytes(data[:FINGERPRINT_BYTES], "big") != self.fingerprint:
            raise LcmTypeError(f"no {self.name} message of this version of the .lcm file")
        value, end = _decode_struct(self, data, FINGERPRINT_BYTES)
        if end != len(data):
            raise LcmTypeError(f"{self.name} message has {len(data)} bytes, {end} expected")
        return value


@lru_cache
def load_type(name: str, folder: Path = TYPE_FOLDER) -> LcmType:
    """Reads struct `name` from folder/name.lcm."""
    path = folder / f"{name}.lcm"
    try:
        text = _COMMENT.sub("", path.read_text())
    except FileNotFoundError:
        raise LcmTypeError(f"no message type {name}: {path} does not exist") from None
    for struct_name, body in _STRUCT.findall(text):
        if struct_name == name:
            leftover = _MEMBER.sub("", body).strip()
            if leftover:
                raise LcmTypeError(f"{path}: cannot read '{leftover.splitlines()[0]}'")
            return LcmType(
                name,
                tuple(
                    Member(member, type_name, tuple(_DIMENSION.findall(dimensions)))
                    for type_name, member, dimensions in _MEMBER.findall(body)
                ),
            )
    raise LcmTypeError(f"{path} has no struct {name}")


def type_of_channel(channel: str) -> str:
    """ARM_STATE -> arm_state_t, JOINT_TORQUE_2 -> joint_torque_t."""
    return re.sub(r"_\d+$", "", channel).lower() + "_t"


def _nested_type(member: Member) -> LcmType:
    return load_type(member.type_name.rpartition(".")[2])


def _hash_update(value: int, byte: int) -> int:
    signed = value - (1 << 64) if value >> 63 else value  # C shifts the sign bit in
    return (((signed << 8) ^ (signed >> 55)) + byte) & 0xFFFFFFFFFFFFFFFF


def _hash_string(value: int, text: str) -> int:
    value = _hash_update(value, len(text))
    for byte in text.encode():
        value = _hash_update(value, byte)
    return value


def _fingerprint(lcm_type: LcmType, parents: tuple[str, ...]) -> int:
    if lcm_type.name in parents:
        return 0
    value = 0x12345678
    for member in lcm_type.members:
        value = _hash_string(value, member.name)
        if member.type_name in _PRIMITIVES:
            value = _hash_string(value, member.type_name)
        value = _hash_update(value, len(member.dimensions))
        for size in member.dimensions:
            value = _hash_update(value, 0 if size.isdigit() else 1)
            value = _hash_string(value, size)
    for member in lcm_type.members:
        if member.type_name not in _PRIMITIVES:
            value += _fingerprint(_nested_type(member), (*parents, lcm_type.name))
    value &= 0xFFFFFFFFFFFFFFFF
    return ((value << 1) | (value >> 63)) & 0xFFFFFFFFFFFFFFFF


def _dtype(lcm_type: LcmType) -> np.dtype | None:
    fields = []
    for member in lcm_type.members:
        if member.type_name == "string" or not all(size.isdigit() for size in member.dimensions):
            return None
        element: Any = _NUMPY_CODE.get(member.type_name) or _dtype(_nested_type(member))
        if element is None:
            return None
        fields.append((member.name, element, tuple(int(size) for size in member.dimensions)))
    return np.dtype(fields)


def _decode_struct(lcm_type: LcmType, data: bytes, at: int) -> tuple[dict[str, Any], int]:
    value: dict[str, Any] = {}
    for member in lcm_type.members:
        shape = [int(size) if size.isdigit() else value[size] for size in member.dimensions]
        value[member.name], at = _decode_array(member, shape, data, at)
    return value, at


def _decode_array(member: Member, shape: list[int], data: bytes, at: int) -> tuple[Any, int]:
    if shape:
        items = []
        for _ in range(shape[0]):
            item, at = _decode_array(member, shape[1:], data, at)
            items.append(item)
        return items, at
    if member.type_name == "string":
        begin = at + 4
        end = begin + int.from_bytes(_taken(data, at, begin), "big")
        return _taken(data, begin, end).rstrip(b"\0").decode(errors="replace"), end
    if member.type_name in _NUMPY_CODE:
        element = np.dtype(_NUMPY_CODE[member.type_name])
        end = at + element.itemsize
        return np.frombuffer(_taken(data, at, end), element)[0].item(), end
    return _decode_struct(_nested_type(member), data, at)


def _taken(data: bytes, begin: int, end: int) -> bytes:
    if end > len(data):
        raise LcmTypeError(f"message of {len(data)} bytes is too short: {end} needed")
    return data[begin:end]
