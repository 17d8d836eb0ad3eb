"""Parameter pages of a motor node as files, for a loader or a probe to put into flash.

The format is that of firmware/node/parameter_store.c, the places those of
firmware/port/stm32f405/flash_pages.h; tests/image compares both with the firmware itself.

    python -m hpmc.parameter_page --node-id 3 --serial 1003 page.bin
    qemu-system-arm -M netduinoplus2 ... -device loader,file=page.bin,addr=0x08008000,force-raw=on
"""

from __future__ import annotations

import argparse
import struct
import sys
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ADDRESSES = (0x0800_8000, 0x0800_C000)  # of the two copies
MAGIC = 0x5043_4946
COPY_BYTES = 2048
HEADER = struct.Struct("<IIHBx")
RECORD = struct.Struct("<HBxI")
SERIAL_NUMBER = (0x1018, 4)
UNCONFIGURED = 255
EXIT_USAGE = 2


class PageError(ValueError):
    """Not a page, or a damaged one."""


@dataclass(frozen=True)
class ParameterPage:
    """One copy. values: by index and sub-index, as bit patterns of 32 bits."""

    node_id: int
    sequence: int = 1
    values: Mapping[tuple[int, int], int] = field(default_factory=dict)

    def to_bytes(self) -> bytes:
        """As it stands in flash, without the erased rest."""
        data = HEADER.pack(MAGIC, self.sequence, len(self.values), self.node_id)
        for (index, subindex), value in sorted(self.values.items()):
            data += RECORD.pack(index, subindex, value & 0xFFFF_FFFF)
        data += struct.pack("<I", zlib.crc32(data))
        if len(data) > COPY_BYTES:
            raise PageError(f"{len(self.values)} values do not fit into {COPY_BYTES} bytes")
        return data

    @classmethod
    def of(cls, data: bytes) -> ParameterPage:
        """Reads a page; PageError when it is not whole."""
        if len(data) < HEADER.size:
            raise PageError(f"{len(data)} bytes are too short for a page")
        magic, sequence, count, node_id = HEADER.unpack_from(data)
        end = HEADER.size + count * RECORD.size
        if magic != MAGIC or end + 4 > min(len(data), COPY_BYTES):
            raise PageError("not a parameter page")
        if struct.unpack_from("<I", data, end)[0] != zlib.crc32(data[:end]):
            raise PageError("its checksum is wrong")
        records = RECORD.iter_unpack(data[HEADER.size : end])
        return cls(node_id, sequence, {(index, sub): value for index, sub, value in records})


def device_page(node_id: int, serial: int) -> ParameterPage:
    """A page that makes a board one certain node, its parameters the defaults."""
    return ParameterPage(node_id, 1, {SERIAL_NUMBER: serial})


def number(low: int, high: int, *others: int):  # noqa: ANN201  (a type for argparse)
    """Whole numbers from low to high, or one of the others."""

    def parse(text: str) -> int:
        value = int(text, 0)
        if not low <= value <= high and value not in others:
            raise ValueError
        return value

    parse.__name__ = f"number from {low} to {high}" + "".join(f" or {o}" for o in others)
    return parse


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog="parameter_page", description="Makes a parameter page of a motor node."
    )
    parser.add_argument("--node-id", type=number(1, 127, UNCONFIGURED), required=True,
                        help="1 to 127, or 255: none until LSS gives one")  # fmt: skip
    parser.add_argument("--serial", type=number(1, 0xFFFF_FFFF), required=True,
                        help="1018h:04, where the chip's own cannot be read")  # fmt: skip
    parser.add_argument("file", type=Path)
    arguments = parser.parse_args(argv)
    try:
        arguments.file.write_bytes(device_page(arguments.node_id, arguments.serial).to_bytes())
    except OSError as error:
        print(f"parameter_page: {error}", file=sys.stderr)
        return EXIT_USAGE
    return 0


if __name__ == "__main__":
    sys.exit(main())
