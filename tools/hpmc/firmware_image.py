"""The flashed image as a file: its version block, checksum and place in flash.

The version block's layout is firmware/port/stm32f405/version_block.h. Standard library only.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

FLASH_BEGIN = 0x0800_0000
VERSION_BLOCK_OFFSET = 0x200
MAGIC = 0x434D_5048
LAYOUT = 1
BLOCK = struct.Struct("<IHBB12s16s16xIII")
CRC_OFFSET = VERSION_BLOCK_OFFSET + BLOCK.size - 4
BUILD_TYPES = ("float", "fixed")
PROGRAM_HEADER = struct.Struct("<8I")
PT_LOAD = 1


class ImageError(ValueError):
    """The file is not an image of the motor node, or a damaged one."""


@dataclass(frozen=True)
class VersionBlock:
    """What an image says about itself."""

    build_type: str
    dirty: bool
    version: str
    git_hash: str
    protocol_hash: str
    image_bytes: int
    image_crc: int

    @classmethod
    def of(cls, image: bytes) -> VersionBlock:
        """Reads the block of an image that begins at FLASH_BEGIN."""
        if len(image) < VERSION_BLOCK_OFFSET + BLOCK.size:
            raise ImageError(f"{len(image)} bytes are too short for an image")
        magic, layout, build, dirty, version, git, protocol, size, crc = BLOCK.unpack_from(
            image, VERSION_BLOCK_OFFSET
        )
        if magic != MAGIC or layout != LAYOUT or build >= len(BUILD_TYPES):
            raise ImageError(f"no version block at offset {VERSION_BLOCK_OFFSET:#x}")
        return cls(
            BUILD_TYPES[build], bool(dirty), text(version), text(git), f"{protocol:08x}", size, crc
        )

    def file_stem(self) -> str:
        """Name of the image's files without suffix."""
        kind = "" if self.build_type == "float" else f"-{self.build_type}"
        return f"motor_node{kind}-{self.version}+g{self.git_hash}{'-dirty' * self.dirty}"

    def object_100a(self) -> str:
        """What the flashed node answers when object 100Ah is read."""
        git = f"g{self.git_hash}{'-dirty' * self.dirty}"
        return f"{self.version}+{self.protocol_hash} {git} {self.build_type} {self.image_crc:08X}"


def text(field: bytes) -> str:
    """A zero-terminated field."""
    return field.split(b"\0")[0].decode("ascii")


def checksum(image: bytes) -> int:
    """CRC-32 of an image without the word that holds it."""
    return zlib.crc32(image[CRC_OFFSET + 4 :], zlib.crc32(image[:CRC_OFFSET]))


def sealed(image: bytes) -> bytes:
    """The image with its length and checksum filled in."""
    VersionBlock.of(image)
    if len(image) % 4:
        raise ImageError(f"{len(image)} bytes: not a whole number of words")
    content = bytearray(image)
    struct.pack_into("<I", content, CRC_OFFSET - 4, len(image))
    struct.pack_into("<I", content, CRC_OFFSET, checksum(bytes(content)))
    return bytes(content)


def verify(image: bytes) -> VersionBlock:
    """The block of a whole image; ImageError when it is damaged."""
    block = VersionBlock.of(image)
    if block.image_bytes != len(image):
        raise ImageError(f"{len(image)} bytes, but the image has {block.image_bytes}")
    if block.image_crc != checksum(image):
        raise ImageError(f"checksum {checksum(image):08X}, but should be {block.image_crc:08X}")
    return block


def elf_segments(elf: bytes) -> list[tuple[int, int, int]]:
    """(offset in the file, offset in the image, bytes) of what an ELF file puts into flash."""
    if elf[:6] != b"\x7fELF\x01\x01":
        raise ImageError("not a 32-bit little-endian ELF file")
    table, size, count = struct.unpack_from("<I", elf, 28)[0], *struct.unpack_from("<HH", elf, 42)
    segments = []
    for i in range(count):
        kind, offset, _, address, bytes_, *_ = PROGRAM_HEADER.unpack_from(elf, table + i * size)
        if kind == PT_LOAD and bytes_:
            segments.append((offset, address - FLASH_BEGIN, bytes_))
    return segments


def find_image(build: Path) -> Path:
    """The one sealed .elf in a build folder."""
    found = sorted(build.glob("motor_node*+g*.elf"))
    if len(found) != 1:
        raise ImageError(f"{build}: {len(found)} images, not one; build it: ./rig build firmware")
    return found[0]
