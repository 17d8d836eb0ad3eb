"""./rig flash: the real tools without a board, and the steps beside a board that is acted."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from hpmc import flash
from hpmc.firmware_image import BLOCK, MAGIC, VERSION_BLOCK_OFFSET, sealed
from hpmc.parameter_page import ADDRESSES, COPY_BYTES, SERIAL_NUMBER, ParameterPage

STORED = {SERIAL_NUMBER: 77, (0x2106, 1): 30000}


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """A small image with a version block that is in order."""
    content = bytearray(range(256)) * 5
    block = BLOCK.pack(MAGIC, 1, 0, 0, b"1.2.3", b"0123456789", 0, 0, 0)
    content[VERSION_BLOCK_OFFSET : VERSION_BLOCK_OFFSET + len(block)] = block
    file = tmp_path / "motor_node-1.2.3+g0123456789.bin"
    file.write_bytes(sealed(bytes(content)))
    return file


class ActedBoard:
    """Flash behind a tool: does what the three tools' commands mean, and keeps the commands."""

    def __init__(self) -> None:
        self.flash = bytearray(b"\xff" * 0x1_0000)
        self.commands: list[Sequence[str]] = []
        self.started = False
        self.loses_a_byte = False

    def put(self, address: int, data: bytes) -> None:
        begin = address - flash.FLASH_BEGIN
        sector = flash.SECTOR_BYTES
        for erased in range(begin // sector * sector, begin + len(data), sector):
            self.flash[erased : erased + sector] = b"\xff" * sector
        self.flash[begin : begin + len(data)] = data
        if self.loses_a_byte:
            self.flash[begin] ^= 1

    def get(self, address: int, size: int) -> bytes:
        begin = address - flash.FLASH_BEGIN
        return bytes(self.flash[begin : begin + size])

    def __call__(self, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
        self.commands.append(command)
        act = {"openocd": self.openocd, "dfu-util": self.dfu, "stm32flash": self.serial}
        error = act[command[0]](list(command))
        return subprocess.CompletedProcess(command, 1 if error else 0, error, None)

    def openocd(self, command: list[str]) -> str:
        assert tuple(command[:5]) == flash.OPENOCD
        steps = command[6::2]
        assert steps[:2] == ["init", "reset halt"]
        assert steps[-1] == "shutdown"
        for step in steps[2:-1]:
            words = re.match(r"([a-z_ ]+?)(?: \{(.+)\} (0x\w+)(?: (\w+))?)?$", step)
            assert words is not None, step
            verb, file, address, last = words.groups()
            if verb == "dump_image":
                Path(file).write_bytes(self.get(int(address, 0), int(last)))
            elif verb == "flash write_image erase":
                self.put(int(address, 0), Path(file).read_bytes())
            elif verb == "verify_image":
                content = Path(file).read_bytes()
                if self.get(int(address, 0), len(content)) != content:
                    return "Info : clock speed\nError: checksum mismatch\n"
            else:
                assert verb == "reset run"
                self.started = True
        return ""

    def dfu(self, command: list[str]) -> str:
        place = command[command.index("-s") + 1].split(":")
        if "-U" in command:
            file = Path(command[-1])
            assert not file.exists()
            file.write_bytes(self.get(int(place[0], 0), int(place[1])))
            return ""
        self.put(int(place[0], 0), Path(command[-1]).read_bytes())
        return ""

    def serial(self, command: list[str]) -> str:
        assert command[-1] == "/dev/ttyX"
        place = command[command.index("-S") + 1].split(":")
        if "-r" in command:
            Path(command[command.index("-r") + 1]).write_bytes(
                self.get(int(place[0], 0), int(place[1]))
            )
            return ""
        content = Path(command[command.index("-w") + 1]).read_bytes()
        self.put(int(place[0], 0), content)
        right = "-v" not in command or self.get(int(place[0], 0), len(content)) == content
        return "" if right else "Failed to verify at address 0x08000000\n"


def put_onto(board: ActedBoard, method: str, image: Path, node_id: int) -> list[str]:
    said: list[str] = []
    device = "/dev/ttyX" if method == "serial" else ""
    flash.flash(flash.METHODS[method](device, board), image, node_id, said.append)
    return said


def pages(board: ActedBoard) -> list[ParameterPage | None]:
    found: list[ParameterPage | None] = []
    for address in ADDRESSES:
        try:
            found.append(ParameterPage.of(board.get(address, COPY_BYTES)))
        except flash.PageError:
            found.append(None)
    return found


@pytest.mark.parametrize("method", flash.METHODS)
def test_a_new_board_gets_image_and_node_id(method: str, image: Path) -> None:
    board = ActedBoard()
    put_onto(board, method, image, 5)
    content = image.read_bytes()
    assert board.get(flash.FLASH_BEGIN, len(content)) == content
    assert pages(board) == [ParameterPage(5), None]
    assert board.started == (method == "openocd")


@pytest.mark.parametrize("method", flash.METHODS)
@pytest.mark.parametrize("newest", [0, 1])
def test_what_is_stored_stays(method: str, newest: int, image: Path) -> None:
    board = ActedBoard()
    board.put(ADDRESSES[newest], ParameterPage(9, 41, STORED).to_bytes())
    board.put(ADDRESSES[1 - newest], ParameterPage(8, 40, {}).to_bytes())
    said = put_onto(board, method, image, 5)
    found = pages(board)
    assert found[newest] == ParameterPage(9, 41, STORED)
    assert found[1 - newest] == ParameterPage(5, 42, STORED)
    assert "2 stored values kept" in said[-1]


def test_a_damaged_page_is_written_over(image: Path) -> None:
    board = ActedBoard()
    board.put(ADDRESSES[0], ParameterPage(9, 41, STORED).to_bytes()[:-1] + b"\x00")
    board.put(ADDRESSES[1], ParameterPage(8, 40, STORED).to_bytes())
    put_onto(board, "openocd", image, 5)
    assert pages(board) == [ParameterPage(5, 41, STORED), ParameterPage(8, 40, STORED)]


@pytest.mark.parametrize("method", flash.METHODS)
def test_an_image_that_is_not_what_was_written_is_found(method: str, image: Path) -> None:
    board = ActedBoard()
    board.loses_a_byte = True
    with pytest.raises(flash.NotDone):
        put_onto(board, method, image, 5)
    assert not board.started


def test_the_tool_s_own_words_are_shown(image: Path) -> None:
    board = ActedBoard()
    board.loses_a_byte = True
    with pytest.raises(flash.NotDone, match=r"^openocd: Error: checksum mismatch; all of it: "):
        put_onto(board, "openocd", image, 5)


# --- the real tools, without a board


def rig_flash(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str]]:
    try:
        status = flash.main(arguments)
    except SystemExit as end:
        status = int(str(end.code))
    return status, capsys.readouterr().err.splitlines()


@pytest.mark.parametrize(
    ("method", "reason"),
    [
        (["--method", "openocd"], "no ST-Link probe found"),
        (["--method", "dfu"], "no board in DFU mode found on USB"),
        (["--method", "serial", "--device", "/dev/ttyNONE"], "no board answers at /dev/ttyNONE"),
    ],
)
def test_without_a_board_one_clear_line(
    method: list[str], reason: str, image: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    # A board that is plugged into the machine of the test must not be flashed by it.
    monkeypatch.setattr(flash, "OPENOCD", (*flash.OPENOCD, "-c", "hla_serial NONE"))
    monkeypatch.setattr(flash, "DFU", (*flash.DFU, "-S", "NONE"))
    monkeypatch.setattr(flash, "LOG", flash.ROOT / "build" / "log" / f"flash-{tmp_path.name}.log")
    status, said = rig_flash(capsys, "--id", "5", "--image", str(image), *method)
    flash.LOG.unlink(missing_ok=True)
    assert status == 3
    assert said == [f"rig flash: {reason}"]


def test_openocd_has_the_configuration() -> None:
    command = [*flash.OPENOCD, "-c", "noinit; echo [target names]; shutdown"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert result.returncode == 0, result.stderr
    assert "stm32f4x.cpu" in (result.stdout + result.stderr).split()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--id", "0"], "0: must be 1 to 127"),
        (["--id", "128"], "128: must be 1 to 127"),
        ([], "--id"),
        (["--id", "5", "--method", "serial"], "--device"),
        (["--id", "5", "--device", "/dev/ttyUSB0"], "--device"),
        (["--id", "5", "--image", "/nowhere.bin"], "/nowhere.bin"),
    ],
)
def test_wrong_arguments(
    arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, said = rig_flash(capsys, *arguments)
    assert status == 2
    assert len(said) == 1
    assert reason in said[0]


def test_a_damaged_image_is_refused(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = bytearray(image.read_bytes())
    content[1000] ^= 1
    image.write_bytes(content)
    status, said = rig_flash(capsys, "--id", "5", "--image", str(image))
    assert status == 2
    assert len(said) == 1
    assert "checksum" in said[0]
