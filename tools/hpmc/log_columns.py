"""The fields of a message type as plain columns: one number each, with name, unit and comment.

Arrays are indexed: `q_rad[0]`, `x_link_m[2][1]`. A type with an array of varying size becomes a
long table, one row per element of it: `frames.index`, `frames.id`, `frames.data[0]` beside the
fields of the message, which repeat; a message whose array is empty has no row. Text is a column,
too.
"""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from hpmc.lcm_log import LcmLog, LogError
from hpmc.lcm_types import (
    FINGERPRINT_BYTES,
    NUMPY_CODE,
    LcmType,
    LcmTypeError,
    Member,
    element_size,
    member_places,
    nested_type,
)

INDEX = "index"  # of the element in an array of varying size


@dataclass(frozen=True)
class Column:
    """One column of the table that a channel becomes."""

    name: str
    unit: str
    comment: str
    dtype: np.dtype | None  # as in the file; None is text
    member: str  # of the message
    offset: int  # bytes, from the begin of the member, or of its element where `repeated`
    repeated: bool = False  # one value per element of the array of varying size

    @property
    def head(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def is_index(self) -> bool:
        return self.repeated and self.offset < 0


@lru_cache
def columns_of(lcm_type: LcmType) -> tuple[Column, ...]:
    """All columns of a type, in the order of its .lcm file. Raises LcmTypeError."""
    columns: list[Column] = []
    varying: list[str] = []
    for member in lcm_type.members:
        if member.type_name == "string":
            if member.dimensions:
                raise LcmTypeError(f"{lcm_type.name}.{member.name}: an array of text is no column")
            columns.append(Column(member.name, member.unit, member.comment, None, member.name, 0))
        elif member.dimensions and not member.dimensions[0].isdigit():
            varying.append(member.name)
            element = Member(
                member.name, member.type_name, member.dimensions[1:], member.comment
            )
            element_size(lcm_type, member)
            columns.append(
                Column(
                    f"{member.name}.{INDEX}", "", f"place in {member.name}, from 0",
                    np.dtype("i4"), member.name, -1, True,
                )
            )  # fmt: skip
            columns += _leaves(element, member.name, 0, True, member.name)
        else:
            element_size(lcm_type, member)
            columns += _leaves(member, member.name, 0, False, member.name)
    if len(varying) > 1:
        raise LcmTypeError(
            f"{lcm_type.name} is no table: {' and '.join(varying)} both vary in size"
        )
    return tuple(columns)


def select(columns: Sequence[Column], wanted: Sequence[str], where: str) -> list[Column]:
    """The columns named: a whole array by its name, one of its elements by an index.

    Raises LogError with the names there are.
    """
    chosen: list[Column] = []
    for name in wanted:
        found = [c for c in columns if c.name == name or _is_part(c.name, name)]
        if not found:
            names = dict.fromkeys(re.sub(r"\[\d+\]", "", column.name) for column in columns)
            sizes = [c.name for c in columns if _is_part(c.name, re.sub(r"\[.*", "", name))]
            there = (
                f"its fields are {', '.join(names)}" if not sizes else f"there are {sizes[0]} to "
                f"{sizes[-1]}"
            )
            raise LogError(f"{where} has no field {name}; {there}")
        chosen += found
    return list(dict.fromkeys(chosen))


def read_columns(
    log: LcmLog, channel: str, columns: Sequence[Column], rows: slice | np.ndarray
) -> list[np.ndarray]:
    """The columns of the messages `rows`, in native byte order; text as an array of objects."""
    lcm_type = log.known_type(channel)
    if lcm_type is None:
        raise LogError(f"{log.path}: {channel} has no message type here, or another version of it")
    places, lengths = log.message_places(channel)
    places, lengths = places[rows], lengths[rows]
    try:
        members = member_places(
            lcm_type, log.bytes, places + FINGERPRINT_BYTES, places + lengths
        )
    except LcmTypeError as error:
        raise LogError(str(error)) from None
    if not members.whole.all():
        raise LogError(f"{log.path}: a {channel} message has not the size of {lcm_type.name}")
    long = next((column.member for column in columns_of(lcm_type) if column.repeated), None)
    message = index = None
    if long is not None and any(column.repeated for column in columns):
        count = members.counts[long]
        message = np.repeat(np.arange(count.size), count)
        index = np.arange(message.size) - np.repeat(np.cumsum(count) - count, count)
    values: list[np.ndarray] = []
    for column in columns:
        start = members.starts[column.member]
        if column.is_index:
            assert index is not None
            values.append(index.astype(np.int32))
        elif column.dtype is None:
            text = [
                log.bytes[at + 4 : at + 4 + size].tobytes().rstrip(b"\0").decode(errors="replace")
                for at, size in zip(
                    start.tolist(), members.counts[column.member].tolist(), strict=True
                )
            ]
            column_values = np.array(text, dtype=object)
            values.append(column_values if message is None else column_values[message])
        else:
            if column.repeated:
                assert message is not None and index is not None
                stride = element_size(lcm_type, _member(lcm_type, column.member))
                at = start[message] + index * stride + column.offset
            else:
                at = start + column.offset
            found = log.at_offsets(at, column.dtype)
            found = found.astype(found.dtype.newbyteorder("="))
            is_field = not column.repeated and message is not None
            values.append(found[message] if is_field else found)
    return values


def _member(lcm_type: LcmType, name: str) -> Member:
    return next(member for member in lcm_type.members if member.name == name)


def _is_part(column: str, name: str) -> bool:
    return column.startswith((f"{name}[", f"{name}."))


def _leaves(
    member: Member, name: str, offset: int, repeated: bool, top: str
) -> list[Column]:
    """Columns of a member of fixed size: one per number in it."""
    shape = [int(size) for size in member.dimensions]
    code: Any = NUMPY_CODE.get(member.type_name)
    inner = None if code else nested_type(member)
    dtype = np.dtype(code) if code else inner.dtype if inner else None
    assert dtype is not None
    columns: list[Column] = []
    for number, place in enumerate(itertools.product(*(range(size) for size in shape))):
        here = name + "".join(f"[{i}]" for i in place)
        at = offset + number * dtype.itemsize
        if inner is None:
            columns.append(Column(here, member.unit, member.comment, dtype, top, at, repeated))
            continue
        assert dtype.fields is not None
        for part in inner.members:
            begin = at + dtype.fields[part.name][1]
            columns += _leaves(part, f"{here}.{part.name}", begin, repeated, top)
    return columns


def read_messages(
    log: LcmLog, channel: str, rows: slice | np.ndarray
) -> list[dict[str, Any]]:
    """The messages `rows` as LcmType.decode gives them, many at a time."""
    lcm_type = log.known_type(channel)
    if lcm_type is None:
        raise LogError(f"{log.path}: {channel} has no message type here, or another version of it")
    places, lengths = log.message_places(channel)
    places, lengths = places[rows], lengths[rows]
    members = member_places(lcm_type, log.bytes, places + FINGERPRINT_BYTES, places + lengths)
    if not members.whole.all():
        raise LogError(f"{log.path}: a {channel} message has not the size of {lcm_type.name}")
    columns = []
    for member in lcm_type.members:
        start = members.starts[member.name]
        if member.type_name == "string":
            ends = start + 4 + members.counts[member.name]
            columns.append(
                [
                    log.bytes[at + 4 : end].tobytes().rstrip(b"\0").decode(errors="replace")
                    for at, end in zip(start.tolist(), ends.tolist(), strict=True)
                ]
            )
            continue
        varying = bool(member.dimensions) and not member.dimensions[0].isdigit()
        shape = [int(size) for size in member.dimensions[int(varying) :]]
        if not varying:
            columns.append(_values(log, member, start, shape))
            continue
        count = members.counts[member.name]
        ends = np.cumsum(count)
        index = np.arange(int(count.sum())) - np.repeat(ends - count, count)
        at = np.repeat(start, count) + index * element_size(lcm_type, member)
        flat = _values(log, member, at, shape)
        columns.append(
            [
                flat[begin:end]
                for begin, end in zip((ends - count).tolist(), ends.tolist(), strict=True)
            ]
        )
    names = [member.name for member in lcm_type.members]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


def _values(log: LcmLog, member: Member, at: np.ndarray, shape: list[int]) -> list[Any]:
    """One entry per place: a number, a dict, or lists of them."""
    code = NUMPY_CODE.get(member.type_name)
    element = np.dtype(code) if code else nested_type(member).dtype
    found = log.at_offsets(at, np.dtype((element, tuple(shape))) if shape else element)
    return _plain(found, None if code else nested_type(member))


def _plain(values: np.ndarray, lcm_type: LcmType | None) -> list[Any]:
    if lcm_type is None:
        return values.tolist()
    if values.ndim > 1:
        return [_plain(row, lcm_type) for row in values]
    columns = [
        _plain(
            values[member.name],
            None if member.type_name in NUMPY_CODE else nested_type(member),
        )
        for member in lcm_type.members
    ]
    names = [member.name for member in lcm_type.members]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
