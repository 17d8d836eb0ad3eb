"""`./rig flash`: the image onto a board, verified, with the board's node-id in a parameter page.

What was stored on the board (1010h, LSS) stays: the newest parameter page is read first, and
written anew with the node-id, over the older of the two.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from hpmc.firmware_image import FLASH_BEGIN, ImageError, find_image, verify
from hpmc.layout import ROOT
from hpmc.parameter_page import ADDRESSES, COPY_BYTES, PageError, ParameterPage

EXIT_USAGE = 2
EXIT_NO_BOARD = 3
LIMIT_S = 120.0  # of one command of a tool
SECTOR_BYTES = 0x4000  # of the parameter pages
LOG = ROOT / "build" / "log" / "flash.log"
OPENOCD = ("openocd", "-f", "interface/stlink.cfg", "-f", "target/stm32f4x.cfg")
DFU = ("dfu-util", "-d", "0483:df11", "-a", "0")
HELP = """\
Puts the image that `./rig build firmware` made onto an STM32F405 board, verifies it, and writes the
node-id into a parameter page; what else is stored there stays.

  openocd   ST-Link probe on the SWD pins; the board as it is, and it starts afterwards
  dfu       USB; BOOT0 high at reset puts the chip's own loader there
  serial    USART1 (PA9, PA10) by an adapter for 3.3 V, named by --device; BOOT0 high at reset

A node-id set by the board's switches goes before the one that is stored. Exit status: 0 done and
verified, 2 wrong arguments or no image, 3 no board or not done.
"""
# What each tool says when nothing is there, and what to tell the user then.
ABSENT = {
    "openocd": (("open failed", "no device found", "unable to open"), "no ST-Link probe found"),
    "dfu-util": (("No DFU capable USB device",), "no board in DFU mode found on USB"),
    "stm32flash": (
        ("Failed to open port", "Failed to init device"), "no board answers at {device}",
    ),
}


class NotDone(Exception):
    """The board was not reached, or refused; one line for the user."""


Runner = Callable[[Sequence[str]], subprocess.CompletedProcess[str]]


def run_tool(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Runs a tool within its time limit; its output is kept in the log."""
    try:
        result = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace", timeout=LIMIT_S, check=False,
        )  # fmt: skip
    except FileNotFoundError as error:
        raise NotDone(f"{command[0]} is not installed: ./rig flash installs it") from error
    except subprocess.TimeoutExpired as error:
        raise NotDone(f"{command[0]} did not end within {LIMIT_S:.0f} s") from error
    LOG.parent.mkdir(parents=True, exist_ok=True)
    with LOG.open("a", encoding="utf-8") as log:
        log.write(f"$ {' '.join(command)}\n{result.stdout}\n")
    return result


@dataclass(frozen=True)
class Part:
    """A file and the flash address that it belongs to."""

    file: Path
    address: int


@dataclass(frozen=True)
class Board:
    """A board behind one of the tools."""

    device: str = ""
    run: Runner = run_tool

    def call(self, *command: str) -> None:
        """Runs a tool; NotDone with the reason when it fails."""
        result = self.run(command)
        if result.returncode == 0:
            return
        signs, advice = ABSENT[command[0]]
        if any(sign.lower() in result.stdout.lower() for sign in signs):
            raise NotDone(advice.format(device=self.device))
        said = [line for line in result.stdout.splitlines() if "error" in line.lower()]
        why = said[-1].strip() if said else f"exit status {result.returncode}"
        raise NotDone(f"{command[0]}: {why}; all of it: {LOG.relative_to(ROOT)}")

    def read_pages(self, folder: Path) -> list[bytes]:
        """Both parameter pages as they are."""
        raise NotImplementedError

    def write(self, parts: Sequence[Part], folder: Path) -> None:
        """Erases, writes and verifies; a probe then starts the image."""
        raise NotImplementedError


def page_files(folder: Path) -> list[Path]:
    return [folder / f"page{number}.bin" for number in range(len(ADDRESSES))]


class ProbeBoard(Board):
    """An ST-Link, by OpenOCD."""

    def commands(self, *steps: str) -> None:
        words: list[str] = []
        for step in ("init", "reset halt", *steps, "shutdown"):
            words += ("-c", step)
        self.call(*OPENOCD, *words)

    def read_pages(self, folder: Path) -> list[bytes]:
        files = page_files(folder)
        self.commands(
            *(f"dump_image {{{file}}} {address:#010x} {COPY_BYTES}"
              for file, address in zip(files, ADDRESSES, strict=True))
        )  # fmt: skip
        return [file.read_bytes() for file in files]

    def write(self, parts: Sequence[Part], folder: Path) -> None:
        places = [f"{{{part.file}}} {part.address:#010x} bin" for part in parts]
        self.commands(
            *(f"flash write_image erase {place}" for place in places),
            *(f"verify_image {place}" for place in places),
            "reset run",
        )


class DfuBoard(Board):
    """The chip's own loader, by USB."""

    def upload(self, file: Path, address: int, size: int) -> bytes:
        file.unlink(missing_ok=True)  # dfu-util refuses to overwrite
        self.call(*DFU, "-s", f"{address:#010x}:{size}", "-U", str(file))
        return file.read_bytes()

    def read_pages(self, folder: Path) -> list[bytes]:
        return [
            self.upload(file, address, COPY_BYTES)
            for file, address in zip(page_files(folder), ADDRESSES, strict=True)
        ]

    def write(self, parts: Sequence[Part], folder: Path) -> None:
        for part in parts:
            self.call(*DFU, "-s", f"{part.address:#010x}", "-D", str(part.file))
        for part in parts:  # dfu-util itself does not verify
            content = part.file.read_bytes()
            if self.upload(folder / "verify.bin", part.address, len(content)) != content:
                raise NotDone(f"what stands at {part.address:#010x} is not what was written")


class SerialBoard(Board):
    """The chip's own loader, by USART1."""

    def read_pages(self, folder: Path) -> list[bytes]:
        files = page_files(folder)
        for file, address in zip(files, ADDRESSES, strict=True):
            place = f"{address:#010x}:{COPY_BYTES}"
            self.call("stm32flash", "-r", str(file), "-S", place, self.device)
        return [file.read_bytes() for file in files]

    def write(self, parts: Sequence[Part], folder: Path) -> None:
        for part in parts:
            place = f"{part.address:#010x}"
            self.call("stm32flash", "-f", "-w", str(part.file), "-v", "-S", place, self.device)


METHODS: dict[str, type[Board]] = {"openocd": ProbeBoard, "dfu": DfuBoard, "serial": SerialBoard}


def next_page(pages: Sequence[bytes], node_id: int) -> tuple[ParameterPage, int]:
    """The page to write, with what the newest has kept, and the number of its copy."""
    found: dict[int, ParameterPage] = {}
    for number, data in enumerate(pages):
        try:
            found[number] = ParameterPage.of(data)
        except PageError:
            continue  # erased or damaged: the firmware passes over it as well
    if not found:
        return ParameterPage(node_id), 0
    newest = max(found, key=lambda number: found[number].sequence)
    page = replace(found[newest], node_id=node_id, sequence=found[newest].sequence + 1)
    return page, 1 - newest


def flash(board: Board, image: Path, node_id: int, say: Callable[[str], None]) -> None:
    """All of it; NotDone when the board does not get there."""
    with tempfile.TemporaryDirectory(prefix="rig-flash-") as name:
        folder = Path(name)
        page, copy = next_page(board.read_pages(folder), node_id)
        file = folder / "page.bin"
        file.write_bytes(page.to_bytes())
        kept = f", {len(page.values)} stored values kept" if page.values else ""
        say(f"writing and verifying {image.name}, node-id {node_id}{kept}")
        board.write([Part(image, FLASH_BEGIN), Part(file, ADDRESSES[copy])], folder)


def node_id(text: str) -> int:
    """1 to 127, for argparse."""
    value = int(text, 0)
    if not 1 <= value <= 127:
        raise argparse.ArgumentTypeError(f"{text}: must be 1 to 127")
    return value


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_USAGE, f"{self.prog}: {message} (see ./rig flash --help)\n")


def parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="rig flash", description=HELP, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--id", type=node_id, required=True, metavar="N", dest="node_id",
                        help="node-id to be stored on the board, 1 to 127")  # fmt: skip
    parser.add_argument("--method", choices=tuple(METHODS), default="openocd",
                        help="way to the board; default: openocd")  # fmt: skip
    parser.add_argument("--device", default="", metavar="PORT",
                        help="serial port of the method serial, e.g. /dev/ttyUSB0")  # fmt: skip
    parser.add_argument("--fixed", action="store_true",
                        help="the image with joint controllers in integers")  # fmt: skip
    parser.add_argument("--image", type=Path, metavar="FILE.bin",
                        help="another image than the one that was built")  # fmt: skip
    arguments = parser.parse_args(argv)
    if (arguments.method == "serial") != bool(arguments.device):
        parser.error("--device goes with --method serial, and that method needs it")
    return arguments


def chosen_image(arguments: argparse.Namespace) -> Path:
    """A whole image; ImageError or OSError when there is none."""
    preset = "stm32f405-fixed" if arguments.fixed else "stm32f405"
    image: Path = arguments.image or find_image(ROOT / "build" / preset).with_suffix(".bin")
    try:
        verify(image.read_bytes())
    except ImageError as error:
        raise ImageError(f"{image}: {error}") from error
    return image


def main(argv: Sequence[str]) -> int:
    """Entry point."""
    arguments = parse(argv)

    def say(text: str) -> None:
        print(f"rig flash: {text}", file=sys.stderr, flush=True)

    try:
        image = chosen_image(arguments)
    except (ImageError, OSError) as error:
        say(str(error))
        return EXIT_USAGE
    LOG.unlink(missing_ok=True)
    try:
        flash(METHODS[arguments.method](arguments.device), image, arguments.node_id, say)
    except NotDone as error:
        say(str(error))
        return EXIT_NO_BOARD
    started = arguments.method == "openocd"
    say("done: verified" + (" and started" if started else "; now BOOT0 low, and reset"))
    return 0
