"""An image of the motor node on QEMU's STM32F405 machine, talked to as SLCAN over its USART.

Serial line and gdb stub are Unix sockets in a folder of the emulator's own: no ports. Every wait
ends with the byte that is waited for, or fails after WAIT_S.
"""

from __future__ import annotations

import contextlib
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

WAIT_S = 20.0
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

    def await_board(self) -> None:
        """Asks until the board answers: while it starts it does not listen."""
        end = time.monotonic() + WAIT_S
        self.line.settimeout(0.1)
        while b"V" not in self.received:
            assert time.monotonic() < end, "the board does not answer"
            self.send(b"\rV\r")
            with contextlib.suppress(TimeoutError):
                self.received += self.line.recv(65536)
        self.line.settimeout(WAIT_S)
        self.send(b"N\r")  # whatever else was asked is answered before it
        while not self.read_line()[0].startswith("N"):
            pass

    def open(self) -> None:
        """Opens the channel of a board that has just started."""
        self.await_board()
        assert not self.command("O").refused

    def open_after_reset(self) -> None:
        """Opens the channel as soon as the board is there again; it refuses before, being open."""
        end = time.monotonic() + WAIT_S
        self.await_board()
        while self.command("O").refused:
            assert time.monotonic() < end, "no reset"
            self.await_board()

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

    def symbol(self, name: str) -> int:
        """Address of a function."""
        listed = subprocess.run(
            ["arm-none-eabi-nm", str(self.elf)], check=True, capture_output=True, text=True
        ).stdout
        return next(
            int(line.split()[0], 16) for line in listed.splitlines() if line.split()[-1] == name
        )

    def debug(self) -> Debugger:
        """Halts the board until the debugger is closed."""
        return Debugger(self.folder / "gdb")

    def run_instead(
        self, function: str, code: Sequence[int], registers: Sequence[int] = (),
        line: bytes = b"", times: int = 1,
    ) -> None:  # fmt: skip
        """Runs other code (Thumb half-words) when a function is called next, which line, sent to
        the board, may bring about. registers: r0 and on."""
        with self.debug() as debugger:
            debugger.write(CODE_ADDRESS, struct.pack(f"<{len(code)}H", *code))
            debugger.set_breakpoint(self.symbol(function))
            self.send(line)
            for _ in range(times):
                debugger.run()
                for number, value in enumerate(registers):
                    debugger.set_register(number, value)
                debugger.set_register(PROGRAM_COUNTER, CODE_ADDRESS)
            debugger.clear_breakpoint(self.symbol(function))


PROGRAM_COUNTER = 15


class Debugger:
    """A client of QEMU's gdb stub: GDB's remote serial protocol, as far as it is needed here."""

    def __init__(self, path: Path) -> None:
        self.stub = socket.socket(socket.AF_UNIX)
        self.stub.settimeout(WAIT_S)
        self.stub.connect(str(path))
        self.received = b""
        self.ask("qXfer:features:read:target.xml:0,ffb")  # else it refuses to set registers

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.ask("D")  # detach: the board goes on
        self.stub.close()

    def answer(self) -> str:
        """The next packet."""
        while not (match := re.search(rb"\$([^#]*)#..", self.received)):
            more = self.stub.recv(4096)
            assert more, "QEMU has ended"
            self.received += more
        self.received = self.received[match.end() :]
        self.stub.sendall(b"+")
        return match[1].decode()

    def ask(self, request: str) -> str:
        """One request and its answer."""
        content = request.encode()
        self.stub.sendall(b"$%s#%02x" % (content, sum(content) & 0xFF))
        answer = self.answer()
        while answer.startswith("T02") or (answer.startswith("T") and request not in ("c", "?")):
            answer = self.answer()  # QEMU tells unasked that connecting has halted the board
        assert not answer.startswith("E"), f"{request}: {answer}"
        return answer

    def write(self, address: int, content: bytes) -> None:
        """Memory."""
        assert self.ask(f"M{address:x},{len(content):x}:{content.hex()}") == "OK"

    def set_register(self, number: int, value: int) -> None:
        """r0 to r15."""
        assert self.ask(f"P{number:x}={value.to_bytes(4, 'little').hex()}") == "OK"

    def set_breakpoint(self, address: int) -> None:
        """In flash or RAM."""
        assert self.ask(f"Z0,{address:x},2") == "OK"

    def clear_breakpoint(self, address: int) -> None:
        """Takes it away."""
        assert self.ask(f"z0,{address:x},2") == "OK"

    def run(self) -> None:
        """Goes on up to the breakpoint."""
        answer = self.ask("c")
        assert answer.startswith("T05"), answer


class SdoAbort(Exception):
    """The node refused an SDO request."""

    def __init__(self, code: int) -> None:
        super().__init__(f"abort code {code:08X}h")
        self.code = code
