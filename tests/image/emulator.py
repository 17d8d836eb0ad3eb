"""An image of the motor node on QEMU's STM32F405 machine, talked to as SLCAN over its USART.

Serial line and gdb stub are Unix sockets in a folder of the emulator's own: no ports. Every wait
ends with the byte that is waited for, or fails after WAIT_S.
"""

from __future__ import annotations

import re
import shutil
import socket
import struct
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

WAIT_S = 60.0
PAGE_ADDRESSES = (0x0800_8000, 0x0800_C000)
CODE_ADDRESS = 0x2001_0000  # RAM that the image does not use


@dataclass(frozen=True)
class Frame:
    """A frame of the node."""

    id: int
    data: bytes


@dataclass
class Answer:
    """What came up to the end of a line's answer."""

    frames: list[Frame] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    refused: bool = False


class Emulator:
    """One board. pages: what stands in flash, by address."""

    def __init__(self, elf: Path, pages: dict[int, bytes], *options: str) -> None:
        self.elf = elf
        self.folder = Path(tempfile.mkdtemp(prefix="hpmc-"))
        self.log = (self.folder / "qemu.log").open("wb")
        command = [
            "qemu-system-arm", "-M", "netduinoplus2", "-kernel", str(elf), "-nographic",
            "-monitor", "none", "-no-user-config", "-nodefaults", "-vga", "none",
            "-chardev", f"socket,id=line,path={self.folder}/line,server=on,wait=on",
            "-serial", "chardev:line",
            "-chardev", f"socket,id=gdb,path={self.folder}/gdb,server=on,wait=off",
            "-gdb", "chardev:gdb", *options,
        ]  # fmt: skip
        for address, content in pages.items():
            file = self.folder / f"{address:x}.bin"
            file.write_bytes(content)
            command += ["-device", f"loader,file={file},addr={address:#x},force-raw=on"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log
        )
        self.line = socket.socket(socket.AF_UNIX)
        self.line.settimeout(WAIT_S)
        self.received = b""
        try:
            self.connect()
        except BaseException:
            self.close()
            raise

    def connect(self) -> None:
        """QEMU makes the socket, then waits for us before it starts the board."""
        end = time.monotonic() + WAIT_S
        while True:
            try:
                self.line.connect(str(self.folder / "line"))
                return
            except (FileNotFoundError, ConnectionRefusedError):
                if self.process.poll() is not None or time.monotonic() > end:
                    raise RuntimeError(f"QEMU does not start: {self.said()}") from None
                time.sleep(0.01)

    def said(self) -> str:
        """QEMU's own words."""
        self.log.flush()
        return (self.folder / "qemu.log").read_text(errors="replace")

    def close(self) -> None:
        """Ends QEMU."""
        self.line.close()
        self.process.kill()
        self.process.wait()
        self.log.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()

    # --- lines

    def send(self, content: bytes) -> None:
        """Raw bytes."""
        self.line.sendall(content)

    def read_line(self) -> tuple[str, str]:
        """The next line of the node, and its end: CR or BEL."""
        while not (match := re.match(rb"([^\r\a]*)([\r\a])", self.received)):
            more = self.line.recv(65536)
            if not more:
                raise RuntimeError(f"QEMU has ended: {self.said()}")
            self.received += more
        self.received = self.received[match.end() :]
        return match[1].decode("ascii", "replace"), match[2].decode()

    def answers(self, count: int = 1) -> Answer:
        """Reads until so many lines were answered."""
        answer = Answer()
        while count:
            text, end = self.read_line()
            if text.startswith("t"):
                answer.frames.append(Frame(int(text[1:4], 16), bytes.fromhex(text[5:])))
            elif text:
                answer.text.append(text)
                count -= 1
            else:
                answer.refused = answer.refused or end == "\a"
                count -= 1
        return answer

    def command(self, text: str) -> Answer:
        """One line and its answer."""
        self.send(text.encode() + b"\r")
        return self.answers()

    def open(self) -> None:
        """Opens the channel of a board that has just started."""
        assert not self.command("O").refused

    def open_after_reset(self) -> None:
        """Opens the channel as soon as the board is there again; it refuses before, being open."""
        end = time.monotonic() + WAIT_S
        while self.command("O").refused:
            assert time.monotonic() < end, "no reset"
            time.sleep(0.01)

    # --- frames

    def frames(self, *frames: tuple[int, bytes]) -> Answer:
        """Sends frames and reads up to the last one's answer."""
        self.send(b"".join(f"t{i:03X}{len(d)}{d.hex().upper()}\r".encode() for i, d in frames))
        return self.answers(len(frames))

    def request(self, node: int, data: bytes) -> bytes:
        """One SDO request and its response. Abort codes are an error."""
        answer = self.frames((0x600 + node, data))
        found = [frame.data for frame in answer.frames if frame.id == 0x580 + node]
        while not found:  # free-running: it may come with a later step
            text, _ = self.read_line()
            if text.startswith(f"t{0x580 + node:03X}"):
                found = [bytes.fromhex(text[5:])]
        if found[0][0] == 0x80:
            raise SdoAbort(struct.unpack_from("<I", found[0], 4)[0])
        return found[0]

    def read(self, node: int, index: int, sub: int = 0) -> int:
        """A number of the object dictionary."""
        response = self.request(node, struct.pack("<BHBI", 0x40, index, sub, 0))
        size = 4 - (response[0] >> 2 & 3)
        return int.from_bytes(response[4 : 4 + size], "little")

    def read_text(self, node: int, index: int) -> str:
        """A string of the object dictionary."""
        length = struct.unpack_from(
            "<I", self.request(node, struct.pack("<BHBI", 0x40, index, 0, 0)), 4
        )[0]
        text, toggle = b"", 0
        while len(text) < length:
            part = self.request(node, bytes([0x60 | toggle, *[0] * 7]))
            text += part[1 : 8 - (part[0] >> 1 & 7)]
            toggle ^= 0x10
        return text.decode()

    def write(self, node: int, index: int, sub: int, size: int, value: int) -> None:
        """Writes a number."""
        head = 0x23 | (4 - size) << 2
        value &= (1 << 8 * size) - 1
        self.request(node, struct.pack("<BHBI", head, index, sub, value))

    def nmt(self, command: int, node: int) -> Answer:
        """An NMT command."""
        return self.frames((0x000, bytes([command, node])))

    # --- debugger

    def debug(self, *commands: str) -> str:
        """Runs gdb on the board that is halted meanwhile, and lets it go on."""
        options = [f"--eval-command={command}" for command in (
            "set architecture arm", f"file {self.elf}", f"target remote {self.folder}/gdb",
            *commands, "delete", "detach",
        )]  # fmt: skip
        done = subprocess.run(
            ["gdb-multiarch", "-nx", "-batch", *options], stdin=subprocess.DEVNULL,
            capture_output=True, text=True, timeout=WAIT_S, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def run_in_node(self, code: Sequence[int], *commands: str) -> str:
        """Lets the node's next step run other code (Thumb half-words) instead."""
        words = [
            f"set {{unsigned short}}{CODE_ADDRESS + 2 * i:#x} = {word:#x}"
            for i, word in enumerate(code)
        ]
        return self.debug(
            "break motor_node_step", "continue", *words, *commands, f"set $pc = {CODE_ADDRESS:#x}"
        )


class SdoAbort(Exception):
    """The node refused an SDO request."""

    def __init__(self, code: int) -> None:
        super().__init__(f"abort code {code:08X}h")
        self.code = code
