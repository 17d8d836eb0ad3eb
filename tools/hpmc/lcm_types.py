"""Message layouts, read from the .lcm files themselves: numpy types, fingerprints, units, decoder.

A fixed-size message becomes a big-endian numpy record whose fields have the names and the order of
the .lcm file. The fingerprint is the hash that lcm-gen puts in front of each message; it changes
with every change of a layout, so a log of another version is recognised. The unit of a field is
what its comment in the .lcm file begins with.
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

NUMPY_CODE = {
    "int8_t": "i1",
    "int16_t": ">i2",
    "int32_t": ">i4",
    "int64_t": ">i8",
    "float": ">f4",
    "double": ">f8",
    "byte": "u1",
    "boolean": "?",
}
_PRIMITIVES = {*NUMPY_CODE, "string"}

# As comments of the .lcm files write them, at the begin or after an object index ("6077h, mN m").
UNITS = (
    "us",
    "s",
    "m",
    "m/s",
    "rad",
    "rad/s",
    "N",
    "N/m",
    "N m",
    "mN m",
    "0.1 degree Celsius",
    "encoder increments",
)

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
    comment: str = ""

    @property
    def unit(self) -> str:
        """One of UNITS, or nothing where the comment names none."""
        clauses = [clause.strip() for clause in re.split(r"[,;:.](?=\s|$)", self.comment)]
        return next((clause for clause in clauses[:2] if clause in UNITS), "")


@dataclass(frozen=True)
class LcmType:
    """One struct of a .lcm file."""

    name: str
    members: tuple[Member, ...]
    comment: str = ""

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
        text = path.read_text()
    except FileNotFoundError:
        raise LcmTypeError(f"no message type {name}: {path} does not exist") from None
    code = _COMMENT.sub(lambda match: " " * len(match[0]), text)  # places stay the same
    for struct in _STRUCT.finditer(code):
        if struct[1] != name:
            continue
        begin, end = struct.span(2)
        leftover = _MEMBER.sub("", code[begin:end]).strip()
        if leftover:
            raise LcmTypeError(f"{path}: cannot read '{leftover.splitlines()[0]}'")
        members = []
        before = begin
        for match in _MEMBER.finditer(code, begin, end):
            line_end = text.find("\n", match.end())
            behind = _comments(text[match.end() : line_end if line_end >= 0 else end])
            comment = behind or _comments(_after_line(text[before : match.start()], before > begin))
            dimensions = tuple(_DIMENSION.findall(match[3]))
            members.append(Member(match[2], match[1], dimensions, comment))
            before = match.end()
        head = _comments(text[code.rfind(";", 0, struct.start()) + 1 : struct.start()])
        return LcmType(name, tuple(members), head)
    raise LcmTypeError(f"{path} has no struct {name}")


def _comments(text: str) -> str:
    """The comments of a piece of a .lcm file as one line."""
    words = [re.sub(r"^//|^/\*+|\*/$", "", comment) for comment in _COMMENT.findall(text)]
    return " ".join(" ".join(words).split())


def _after_line(text: str, follows_member: bool) -> str:
    """Without the rest of the line that a member before stands on, whose comment is there."""
    return text.partition("\n")[2] if follows_member and "\n" in text else text


def type_of_channel(channel: str) -> str:
    """ARM_STATE -> arm_state_t, JOINT_TORQUE_2 -> joint_torque_t."""
    return re.sub(r"_\d+$", "", channel).lower() + "_t"


def nested_type(member: Member) -> LcmType:
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
            value += _fingerprint(nested_type(member), (*parents, lcm_type.name))
    value &= 0xFFFFFFFFFFFFFFFF
    return ((value << 1) | (value >> 63)) & 0xFFFFFFFFFFFFFFFF


def _dtype(lcm_type: LcmType) -> np.dtype | None:
    fields = []
    for member in lcm_type.members:
        if member.type_name == "string" or not all(size.isdigit() for size in member.dimensions):
            return None
        element: Any = NUMPY_CODE.get(member.type_name) or _dtype(nested_type(member))
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
    if member.type_name in NUMPY_CODE:
        element = np.dtype(NUMPY_CODE[member.type_name])
        end = at + element.itemsize
        return np.frombuffer(_taken(data, at, end), element)[0].item(), end
    return _decode_struct(nested_type(member), data, at)


def _taken(data: bytes, begin: int, end: int) -> bytes:
    if end > len(data):
        raise LcmTypeError(f"message of {len(data)} bytes is too short: {end} needed")
    return data[begin:end]


def overlapping(buffer: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """A view of bytes with one record at each of them, so that byte offsets are row numbers."""
    rows = max(buffer.size - dtype.itemsize + 1, 0)
    return np.ndarray((rows,), dtype, buffer=buffer.data, strides=(1,))


@dataclass(frozen=True)
class MemberPlaces:
    """Where the members of many messages of one type are, each array with one entry per message."""

    starts: dict[str, np.ndarray]  # byte offset of the member, of its first element
    counts: dict[str, np.ndarray]  # elements of a member whose first dimension varies; text: bytes
    whole: np.ndarray  # whether the message has the size that its own counts ask for


def member_places(
    lcm_type: LcmType, buffer: np.ndarray, first: np.ndarray, ends: np.ndarray
) -> MemberPlaces:
    """Finds the members of messages that begin (behind the fingerprint) at `first`.

    Works on all messages at once, also where their size varies. Raises LcmTypeError for what it
    does not know: arrays of text, structs of varying size, a second dimension that varies.
    """
    at = first.astype(np.int64)
    whole = at <= ends
    starts: dict[str, np.ndarray] = {}
    counts: dict[str, np.ndarray] = {}

    def integers(code: str, places: np.ndarray) -> np.ndarray:
        nonlocal whole
        dtype = np.dtype(code)
        whole = whole & (places + dtype.itemsize <= ends)
        values = overlapping(buffer, dtype)[np.where(whole, places, 0)].astype(np.int64)
        whole = whole & (values >= 0)
        return np.where(whole, values, 0)

    for member in lcm_type.members:
        starts[member.name] = at
        if member.type_name == "string":
            if member.dimensions:
                raise LcmTypeError(f"{lcm_type.name}.{member.name}: an array of text")
            length = integers(">i4", at)
            counts[member.name] = length
            at = at + 4 + length
            continue
        size = element_size(lcm_type, member)
        if member.dimensions and not member.dimensions[0].isdigit():
            counter = next(m for m in lcm_type.members if m.name == member.dimensions[0])
            count = integers(NUMPY_CODE[counter.type_name], starts[counter.name])
            counts[member.name] = count
            at = at + count * size
        else:
            at = at + size
        whole = whole & (at <= ends)
    return MemberPlaces(starts, counts, whole & (at == ends))


def element_size(lcm_type: LcmType, member: Member) -> int:
    """Bytes of a member; of one element along its first dimension where that one varies."""
    fixed = member.dimensions
    if fixed and not fixed[0].isdigit():
        fixed = fixed[1:]
    code = NUMPY_CODE.get(member.type_name)
    element = np.dtype(code) if code else nested_type(member).dtype
    if element is None or not all(size.isdigit() for size in fixed):
        raise LcmTypeError(f"{lcm_type.name}.{member.name}: elements that vary in size")
    return element.itemsize * int(np.prod([int(size) for size in fixed], dtype=int))
