#!/usr/bin/env python3
"""Seal a linked image: fill in its length and checksum, and name its files by what it is.

    tools/seal_image.py --elf unsealed.elf --map unsealed.map --objcopy arm-none-eabi-objcopy \
        --out build/stm32f405

Writes motor_node[-fixed]-VERSION+gHASH.elf, .bin, .hex and .map, and removes those of an earlier
state from the folder. The version block (firmware/port/stm32f405/version_block.h) says what the
image is. Needs the Python standard library only.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from hpmc.firmware_image import (
    ImageError,
    VersionBlock,
    elf_segments,
    sealed,
)


def objcopy(program: str, kind: str, source: Path, target: Path) -> None:
    """Converts an ELF file."""
    subprocess.run([program, "-O", kind, str(source), str(target)], check=True)


def seal(elf: Path, map_: Path, program: str, out: Path) -> Path:
    """Makes the four files; returns the .elf."""
    with tempfile.TemporaryDirectory(dir=out) as folder:
        work = Path(folder)
        binary = work / "image.bin"
        objcopy(program, "binary", elf, binary)
        image = sealed(binary.read_bytes())
        content = bytearray(elf.read_bytes())
        for offset, address, size in elf_segments(bytes(content)):
            content[offset : offset + size] = image[address : address + size]
        block = VersionBlock.of(image)
        stem = block.file_stem()
        (work / f"{stem}.elf").write_bytes(content)
        shutil.copyfile(map_, work / f"{stem}.map")
        objcopy(program, "binary", work / f"{stem}.elf", work / f"{stem}.bin")
        objcopy(program, "ihex", work / f"{stem}.elf", work / f"{stem}.hex")
        if (work / f"{stem}.bin").read_bytes() != image:
            raise ImageError(f"{elf}: its segments do not make up its binary")
        for old in out.glob("motor_node*+g*.*"):
            old.unlink()
        for suffix in ("elf", "bin", "hex", "map"):
            (work / f"{stem}.{suffix}").replace(out / f"{stem}.{suffix}")
    return out / f"{stem}.elf"


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--elf", type=Path, required=True)
    parser.add_argument("--map", type=Path, required=True)
    parser.add_argument("--objcopy", default="arm-none-eabi-objcopy")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    try:
        print(seal(arguments.elf, arguments.map, arguments.objcopy, arguments.out))
    except (ImageError, OSError, subprocess.CalledProcessError) as error:
        print(f"seal_image: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
