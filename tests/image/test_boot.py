"""The image as it is flashed, on an emulated Cortex-M4: boots, answers, steps, and ends faults."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import pytest
from conftest import NODE, PAGE, SERIAL, Boards
from emulator import CODE_ADDRESS, PAGE_ADDRESSES, Emulator, Frame, SdoAbort

from hpmc.firmware_image import verify
from hpmc.parameter_page import ParameterPage

RESET_NODE = 129
START = 1
EMCY_SUPERVISOR_RESET = 0x6010
EMCY_PARAMETERS_LOST = 0x5530
SDO_HARDWARE = 0x0606_0000
SAVE = 0x6576_6173
SWITCH_ON_DISABLED = 0x40
FAULT_BITS = 0x4F
ENABLED = 0x27

HARD, MEMORY, BUS, USAGE, STACK, SUPERVISOR = 1, 2, 3, 4, 5, 6
NODE_STEP = "motor_node_step"
NO_CODE_THERE = 0xE000_0000  # the core's private region: never executable
UNIQUE_ID = 0x1FFF_7A10  # not there in the emulator


def tick(board: Emulator, number: int, position: int, *frames: tuple[int, bytes]) -> list[Frame]:
    """One joint tick of the stepped time base; the node's frames."""
    sensors = struct.pack("<iBBh", position, number & 0xFF, 0, 250)
    return board.frames(*frames, (0x500 + NODE, sensors)).frames


class Joint:
    """A node in the stepped time base with injected sensors, at rest at position 0."""

    def __init__(self, board: Emulator) -> None:
        self.board = board
        self.number = 0
        self.torque = 0
        self.status = 0
        board.write(NODE, 0x2F00, 0, 1, 1)
        board.write(NODE, 0x2F01, 0, 1, 1)

    def tick(self, *frames: tuple[int, bytes], position: int = 0) -> list[Frame]:
        """One tick with SYNC; keeps torque and statusword of TPDO1."""
        self.number += 1
        command = struct.pack("<ihH", 100, 3000, 4000)
        sent = tick(
            self.board, self.number, position, (0x200 + NODE, command), *frames, (0x080, b"")
        )
        for frame in sent:
            if frame.id == 0x180 + NODE:
                _, self.torque, self.status = struct.unpack("<ihH", frame.data)
        return sent

    def enable(self) -> None:
        """Mode -1 with torque."""
        self.tick((0x000, bytes([START, NODE])))
        self.tick()
        for control in (0x06, 0x07, 0x0F):
            self.tick((0x300 + NODE, struct.pack("<Hb", control, -1)))
        for _ in range(120):
            self.tick()
        assert self.status & 0x6F == ENABLED, hex(self.status)
        assert self.torque > 1000


def expect_no_torque(board: Emulator) -> None:
    """Switch on disabled, and no torque."""
    assert board.read(NODE, 0x6041) & FAULT_BITS == SWITCH_ON_DISABLED
    assert board.read(NODE, 0x6077) == 0


def expect_reset(board: Emulator, cause: int, resets: int = 1) -> None:
    """The board has come back, disabled, and tells why."""
    board.open_after_reset()
    assert board.read(NODE, 0x2203, 1) == cause
    assert board.read(NODE, 0x2203, 8) == resets
    assert board.read(NODE, 0x1003, 1) == EMCY_SUPERVISOR_RESET | cause << 16
    expect_no_torque(board)


def test_version(boards: Boards, image: Path) -> None:
    block = verify(image.with_suffix(".bin").read_bytes())
    board = boards(image)
    assert board.read_text(NODE, 0x100A) == block.object_100a()
    assert board.read(NODE, 0x2107, 0) == 1  # no crystal there: no CAN, and the board says so


def test_serial_number_and_node_id_from_the_page(boards: Boards, float_image: Path) -> None:
    board = boards(float_image)
    assert board.read(NODE, 0x1018, 4) == SERIAL
    assert board.command("N").text == [f"N{SERIAL:04X}"]


def test_two_joint_ticks_and_boot_up(boards: Boards, image: Path) -> None:
    board = boards(image)
    joint = Joint(board)
    assert tick(board, 1, 5) == []
    boot_up = board.frames((0x000, bytes([RESET_NODE, NODE])), (0x500 + NODE, b"\0\0\0\0\2\0\0\0"))
    assert boot_up.frames == []  # what comes after the restart is in its first step
    assert tick(board, 3, 7)[0] == Frame(0x700 + NODE, b"\0")
    joint.number = 3
    joint.tick((0x000, bytes([START, NODE])))
    position = joint.tick(position=-7)[0]
    assert struct.unpack_from("<i", position.data)[0] == -7


def test_time_is_counted_by_ticks(boards: Boards, float_image: Path) -> None:
    """The host's clock has no say: heartbeats come with every 100th period, never else."""
    board = boards(float_image)
    Joint(board)
    tick(board, 0, 0)
    beats = [n for n in range(1, 1001) if Frame(0x700 + NODE, b"\x7f") in tick(board, n, 0)]
    assert [b - a for a, b in pairwise(beats)] == [100] * 9


def test_torque_and_node_reset_in_mid_run(boards: Boards, image: Path) -> None:
    board = boards(image)
    joint = Joint(board)
    joint.enable()
    joint.tick((0x000, bytes([RESET_NODE, NODE])))
    boot_up = joint.tick()
    assert boot_up[0] == Frame(0x700 + NODE, b"\0")
    joint.tick((0x000, bytes([START, NODE])))
    joint.tick()
    assert joint.torque == 0
    assert joint.status & FAULT_BITS == SWITCH_ON_DISABLED
    joint.enable()  # sensors and time base have outlived the reset


def test_enabling_on_the_oscillator_is_refused_when_free_running(
    boards: Boards, float_image: Path
) -> None:
    board = boards(float_image)
    board.write(NODE, 0x2F00, 0, 1, 1)
    board.nmt(START, NODE)
    for control in (0x06, 0x07, 0x0F):
        board.write(NODE, 0x6060, 0, 1, 10)
        board.write(NODE, 0x6040, 0, 2, control)
    assert board.read(NODE, 0x2200) & 0x8000
    assert board.read(NODE, 0x6041) & 0x6F != ENABLED


def test_a_save_fails_cleanly_where_the_flash_does_not_obey(
    boards: Boards, float_image: Path
) -> None:
    board = boards(float_image)
    with pytest.raises(SdoAbort) as refusal:
        board.write(NODE, 0x1010, 1, 4, SAVE)
    assert refusal.value.code == SDO_HARDWARE
    assert board.read(NODE, 0x1018, 4) == SERIAL


# --- parameter pages


def test_newer_page_wins_and_its_values_act(boards: Boards, float_image: Path) -> None:
    newer = ParameterPage(NODE, 2, {(0x1018, 4): 77, (0x1017, 0): 250})
    pages = dict(zip(PAGE_ADDRESSES, (PAGE, newer.to_bytes()), strict=True))
    board = boards(float_image, pages)
    assert board.read(NODE, 0x1018, 4) == 77
    assert board.read(NODE, 0x1017) == 250


def test_corrupt_page_boots_with_defaults_and_says_so(boards: Boards, float_image: Path) -> None:
    page = bytearray(PAGE)
    page[14] ^= 1
    board = boards(float_image, {PAGE_ADDRESSES[0]: bytes(page)})
    # No node-id is known: LSS gives one (CiA 305: switch global, configure, back to waiting).
    for request in (b"\x04\x01", bytes([0x11, NODE]), b"\x04\x00"):
        board.frames((0x7E5, request.ljust(8, b"\0")))
    assert board.read(NODE, 0x1003, 1) == EMCY_PARAMETERS_LOST
    assert board.read(NODE, 0x1017) == 100
    expect_no_torque(board)


def test_blank_flash_waits_for_lss_and_complains_of_nothing(
    boards: Boards, float_image: Path
) -> None:
    board = boards(float_image, {})
    for request in (b"\x04\x01", bytes([0x11, NODE]), b"\x04\x00"):
        board.frames((0x7E5, request.ljust(8, b"\0")))
    assert board.read(NODE, 0x1003, 0) == 0


# --- the image's checksum


def damaged(elf: Path, folder: Path, old: bytes, new: bytes) -> Path:
    """A copy of an image with something else at one place of its flash."""
    content = elf.read_bytes()
    assert content.count(old) == 1
    copy = folder / elf.name
    copy.write_bytes(content.replace(old, new))
    return copy


def test_damaged_image_boots_disabled(boards: Boards, float_image: Path, tmp_path: Path) -> None:
    # A text of 1008h: the program runs without it.
    board = boards(damaged(float_image, tmp_path, b"FIC motor node", b"fic motor node"))
    assert board.read(NODE, 0x1003, 1) == EMCY_SUPERVISOR_RESET | 8 << 16
    expect_no_torque(board)
    joint = Joint(board)
    with pytest.raises(AssertionError):
        joint.enable()
    assert joint.torque == 0
    request = struct.pack("<BHBI", 0x40, 0x2200, 0, 0)
    answers = [f.data for f in joint.tick((0x600 + NODE, request)) if f.id == 0x580 + NODE]
    assert struct.unpack_from("<I", answers[0], 4)[0] & 0x8000


def test_length_beyond_the_flash_is_a_damaged_image(
    boards: Boards, float_image: Path, tmp_path: Path
) -> None:
    block = verify(float_image.with_suffix(".bin").read_bytes())
    ends = struct.pack("<II", block.image_bytes, block.image_crc)
    huge = struct.pack("<II", 0x7FFF_FFFC, block.image_crc)
    board = boards(damaged(float_image, tmp_path, ends, huge))
    assert board.read(NODE, 0x1003, 1) == EMCY_SUPERVISOR_RESET | 8 << 16


# --- faults


@pytest.mark.parametrize(
    ("cause", "code", "registers"),
    [
        # str r1, [r0]; dsb; udf: SHCSR = 0 takes the separate exceptions away
        (HARD, [0x6001, 0xF3BF, 0x8F4F, 0xDE00], [0xE000_ED24, 0]),
        (MEMORY, [0x4700], [NO_CODE_THERE + 1]),  # bx r0
        (BUS, [0x6800], [UNIQUE_ID]),  # ldr r0, [r0]
        (USAGE, [0xDE00], []),  # udf
        (STACK, [0xB5FF, 0xE7FD], []),  # push all, again
        (STACK, [0xB0FF, 0x9000, 0xE7FC], []),  # a frame of 508 bytes jumps over the guard
        (SUPERVISOR, [0xE7FE], []),  # a loop without end
    ],
    ids=["hard", "memory", "bus", "usage", "stack", "stack-jump", "hang"],
)
def test_fault_with_torque_on(
    boards: Boards, float_image: Path, cause: int, code: list[int], registers: list[int]
) -> None:
    board = boards(float_image)
    joint = Joint(board)
    joint.enable()
    joint.number += 1
    sensors = struct.pack("<iBBh", 0, joint.number & 0xFF, 0, 250)
    line = f"t{0x500 + NODE:03X}8{sensors.hex().upper()}\r".encode()
    board.run_instead(NODE_STEP, code, registers, line)
    expect_reset(board, cause)
    joint = Joint(board)
    joint.tick((0x000, bytes([START, NODE])))
    joint.tick()
    assert joint.torque == 0
    joint.enable()  # the fault is over, and only told


def test_crash_record_names_the_place_and_counts(boards: Boards, float_image: Path) -> None:
    board = boards(float_image)
    code = [0xBF00, 0xDE00]  # nop, udf
    board.run_instead(NODE_STEP, code, times=2)
    expect_reset(board, USAGE, resets=2)
    assert board.read(NODE, 0x2203, 2) == CODE_ADDRESS + 2
    assert board.read(NODE, 0x2203, 5) == 1 << 16  # CFSR: undefined instruction
    board.nmt(RESET_NODE, NODE)
    assert board.read(NODE, 0x2203, 1) == USAGE
    assert board.read(NODE, 0x1003, 0) == 0  # told once


def test_address_of_a_bus_fault(boards: Boards, float_image: Path) -> None:
    board = boards(float_image)
    board.run_instead(NODE_STEP, [0x6800], [UNIQUE_ID])
    expect_reset(board, BUS)
    assert board.read(NODE, 0x2203, 7) == UNIQUE_ID


def test_supervisor_sees_main_stop(boards: Boards, float_image: Path) -> None:
    """Joint ticks go on, but nothing feeds the watchdog: the reset comes without it too."""
    board = boards(float_image)
    board.run_instead("usart_transmit", [0xB662, 0xE7FE])  # cpsie i; a loop without end
    expect_reset(board, SUPERVISOR)
    assert board.read(NODE, 0x2203, 2) == CODE_ADDRESS + 2


# --- the serial line


@pytest.mark.parametrize(
    "garbage",
    [b"\0\xff\x80garbage\r", b"t", b"t6038", b"t503800000\r", b"x" * 5000 + b"\r", b"\r\r\r"],
    ids=["binary", "letter", "half", "short", "long", "empty"],
)
def test_garbage_and_half_lines(boards: Boards, float_image: Path, garbage: bytes) -> None:
    board = boards(float_image)
    joint = Joint(board)
    joint.enable()
    board.send(garbage + b"\r")
    board.send(b"V\r")
    while True:  # refusals of the garbage, then the answer
        text, _ = board.read_line()
        if text.startswith("V"):
            break
    joint.tick()
    assert joint.status & 0x6F == ENABLED
    assert joint.torque > 1000


def test_garbage_is_counted(boards: Boards, float_image: Path) -> None:
    board = boards(float_image)
    before = board.read(NODE, 0x2201, 8)
    assert board.command("garbage").refused
    board.read(NODE, 0x1000)  # a step takes the count over
    assert board.read(NODE, 0x2201, 8) == before + 1
