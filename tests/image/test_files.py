"""The image as files: names, version block, checksum, reproducibility, budgets, parameter pages."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import NODE, PAGE, ROOT, SERIAL

from hpmc.firmware_image import CRC_OFFSET, FLASH_BEGIN, ImageError, find_image, verify
from hpmc.image_size import SizeError, deepest, read_functions
from hpmc.parameter_page import COPY_BYTES, PageError, ParameterPage, main

SUFFIXES = (".elf", ".bin", ".hex", ".map")
BUDGETS = {"HPMC_FLASH_BUDGET": 20000, "HPMC_RAM_BUDGET": 4000, "HPMC_STACK_BUDGET": 500}


def eds_hash() -> str:
    header = (ROOT / "firmware/od/object_dictionary.h").read_text()
    match = re.search(r'OD_PROTOCOL_HASH_TEXT "(\w+)"', header)
    assert match
    return match[1]


def test_version_block_and_names(image: Path) -> None:
    block = verify(image.with_suffix(".bin").read_bytes())
    assert block.protocol_hash == eds_hash()
    assert block.build_type == ("fixed" if "fixed" in image.parent.name else "float")
    assert image.stem == block.file_stem()
    assert image.stem.startswith(f"motor_node{'-fixed' * (block.build_type == 'fixed')}-")
    assert all(image.with_suffix("").parent.joinpath(image.stem + s).exists() for s in SUFFIXES)


def test_all_files_hold_the_same_image(image: Path, tmp_path: Path) -> None:
    content = image.with_suffix(".bin").read_bytes()
    for kind, source in (("elf32-littlearm", ".elf"), ("ihex", ".hex")):
        out = tmp_path / f"{kind}.bin"
        subprocess.run(
            ["arm-none-eabi-objcopy", "-I", kind, "-O", "binary",
             image.parent / (image.stem + source), out],
            check=True,
        )  # fmt: skip
        assert out.read_bytes() == content
    begin = re.search(r"^\.vectors\s+0x0*([0-9a-f]+)", image.with_suffix(".map").read_text(), re.M)
    assert begin is not None
    assert int(begin[1], 16) == FLASH_BEGIN


@pytest.mark.parametrize("at", [0, 0x1FF, CRC_OFFSET - 5, CRC_OFFSET, CRC_OFFSET + 4, -1])
def test_a_changed_byte_is_found(float_image: Path, at: int) -> None:
    content = bytearray(float_image.with_suffix(".bin").read_bytes())
    content[at] ^= 0x10
    with pytest.raises(ImageError):
        verify(bytes(content))


def sources(folder: Path) -> Path:
    """A copy of what an image is built from, without its history."""
    folder.mkdir(parents=True)
    for name in ("firmware", "tools"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("CMakeLists.txt", "CMakePresets.json", ".gitignore"):
        shutil.copy(ROOT / name, folder)
    return folder


def cmake(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Configures and builds the image there."""
    subprocess.run(
        ["cmake", "--preset", "stm32f405", *options], cwd=folder, check=True, capture_output=True
    )
    return subprocess.run(
        ["cmake", "--build", "--preset", "stm32f405"], cwd=folder, check=False,
        capture_output=True, text=True,
    )  # fmt: skip


def test_two_builds_in_two_folders_are_the_same_byte_for_byte(tmp_path: Path) -> None:
    made = []
    for name in ("a", "another/deeper folder"):
        folder = sources(tmp_path / name)
        done = cmake(folder)
        assert done.returncode == 0, done.stdout + done.stderr
        files = sorted((folder / "build" / "stm32f405").glob("motor_node*+g*.*"))
        assert [file.suffix for file in files] == sorted(SUFFIXES)
        made.append({file.name: file.read_bytes() for file in files})
    assert made[0] == made[1]


def test_git_hash_and_dirty_sources_in_the_name(tmp_path: Path) -> None:
    folder = sources(tmp_path / "repository")
    git = ["git", "-c", "user.name=test", "-c", "user.email=test", "-C", str(folder)]
    for command in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "all"]):
        subprocess.run([*git, *command], check=True, capture_output=True)
    head = subprocess.run(
        [*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True
    ).stdout
    for dirty in (False, True):
        if dirty:
            (folder / "firmware" / "new.txt").touch()
        done = cmake(folder)
        assert done.returncode == 0, done.stdout + done.stderr
        image = find_image(folder / "build" / "stm32f405")  # the one before is gone
        block = verify(image.with_suffix(".bin").read_bytes())
        assert head.startswith(block.git_hash) and len(block.git_hash) == 12
        assert block.dirty == dirty
        assert image.stem == f"motor_node-{block.version}+g{head[:12]}{'-dirty' * dirty}"


@pytest.mark.parametrize("budget", BUDGETS)
def test_a_budget_that_is_exceeded_fails_the_build(
    float_image: Path, tmp_path: Path, budget: str
) -> None:
    what = budget.split("_")[1]
    command = [
        sys.executable, "-m", "hpmc.image_size", str(float_image), "--calls",
        str(ROOT / "firmware/port/stm32f405/calls.toml"),
    ]  # fmt: skip
    environment = {"PYTHONPATH": str(ROOT / "tools"), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    option = f"--{what.lower()}"
    done = subprocess.run(
        [*command, option, str(BUDGETS[budget])], capture_output=True, text=True, env=environment,
        check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"over the budget of {BUDGETS[budget]}" in done.stderr


def test_a_seeded_violation_fails_the_build_itself(tmp_path: Path) -> None:
    folder = sources(tmp_path / "grown")
    main_c = folder / "firmware/port/stm32f405/main.c"
    begin = "int main(void) {"
    room = "volatile char room[600]; room[0] = 0; (void)room[0];"
    main_c.write_text(main_c.read_text().replace(begin, f"{begin}\n    {room}", 1))
    done = cmake(folder)
    assert done.returncode != 0
    assert re.search(r"stack: \d+ bytes, \d+ over the budget of 1024", done.stdout + done.stderr)


# --- stack analysis


LISTING = """
08000000 <main>:
 8000000:\tb510      \tpush\t{r4, lr}
 8000002:\tb084      \tsub\tsp, #16
 8000004:\tf000 f800 \tbl\t8000100 <leaf>
 8000008:\te000      \tb.n\t8000200 <tail>

08000100 <leaf>:
 8000100:\te92d 47f0 \tstmdb\tsp!, {r4, r5, r6, r7, r8, r9, sl, lr}
 8000104:\ted2d 8b02 \tvpush\t{d8}

08000200 <tail>:
 8000200:\tb5f0      \tpush\t{r4, r5, r6, r7, lr}
 8000202:\tb0a0      \tsub\tsp, #128\t; 0x80
 8000204:\t4798      \tblx\tr3

08000300 <round>:
 8000300:\tf000 f800 \tbl\t8000300 <round>
"""


def test_depth_of_a_known_listing() -> None:
    functions = read_functions(LISTING)
    assert (functions["main"].frame, functions["leaf"].frame, functions["tail"].frame) == (
        24, 40, 148,
    )  # fmt: skip
    depth = deepest("main", functions, {"tail": ["leaf"]}, {})
    assert depth.stack_bytes == 148 + 40  # the tail call has given main's frame back
    assert depth.path == ("main", "tail", "leaf")
    assert depth.floating


def test_what_cannot_be_judged_is_said() -> None:
    functions = read_functions(LISTING)
    with pytest.raises(SizeError, match="tail calls through a pointer"):
        deepest("main", functions, {}, {})
    with pytest.raises(SizeError, match="recursion: round -> round"):
        deepest("round", functions, {}, {})


def test_frames_agree_with_the_compilers_own(image: Path) -> None:
    """GCC's -fstack-usage: what it says of a function is never more than what was read."""
    listing = subprocess.run(
        ["arm-none-eabi-objdump", "-d", str(image)], check=True, capture_output=True, text=True
    ).stdout
    functions = read_functions(listing)
    compared = 0
    for file in (image.parent / "firmware").rglob("*.su"):
        for line in file.read_text().splitlines():
            place, size, _ = line.split("\t")
            source, name = place.split(":")[0], place.rsplit(":", 1)[1]
            if not Path(source).exists():
                continue  # of an earlier state of the sources
            if sum(name == other.split(".")[0] for other in functions) == 1 and name in functions:
                compared += 1
                assert functions[name].frame >= int(size), line
    assert compared > 100


# --- torque first


def test_fault_entry_takes_the_torque_off_first(image: Path) -> None:
    """The first store of every fault handler is PIN_SERVO_ENABLE, low."""
    pins = (ROOT / "firmware/port/stm32f405/board_pins.h").read_text()
    found = re.search(r"PIN_SERVO_ENABLE \(\(gpio_pin_t\)\{GPIO(\w)_BASE, (\d+),", pins)
    assert found
    port, pin = found.groups()
    listing = subprocess.run(
        ["arm-none-eabi-objdump", "-d", "--disassemble=fault_entry", str(image)],
        check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    lines = [line.split("\t")[2:] for line in listing.splitlines() if line.count("\t") >= 3]
    operations = [line[0] for line in lines[:3]]
    assert operations[2] == "str" and lines[2][1].startswith("r1, [r0")
    words = dict(re.findall(r"([0-9a-f]{7}):\t[0-9a-f ]+\t\.word\t0x([0-9a-f]+)", listing))
    values = []
    for line in lines[:2]:
        place = re.search(r"\(([0-9a-f]{7}) ", line[-1])
        literal = re.search(r"#(\d+)", line[1])
        values.append(int(words[place[1]], 16) if place else int(literal[1]))
    assert values == [0x4002_0000 + 0x400 * (ord(port) - ord("A")) + 0x18, 1 << (int(pin) + 16)]


def test_vectors(image: Path) -> None:
    """Reset, and every vector that is not handled, is where it should be."""
    content = image.with_suffix(".bin").read_bytes()
    vectors = [int.from_bytes(content[i : i + 4], "little") for i in range(0, 98 * 4, 4)]
    symbols = subprocess.run(
        ["arm-none-eabi-nm", str(image)], check=True, capture_output=True, text=True
    ).stdout
    address = {line.split()[-1]: int(line.split()[0], 16) for line in symbols.splitlines()}
    assert vectors[0] == address["stack_begin"]
    assert vectors[1] == address["startup_reset"] | 1
    handled = {14: "interrupt_node", 15: "interrupt_time", 16 + 20: "interrupt_can_cyclic",
               16 + 21: "interrupt_can_other", 16 + 28: "interrupt_tick_timer",
               16 + 37: "interrupt_usart1"}  # fmt: skip
    for number, vector in enumerate(vectors[2:], start=2):
        assert vector == address[handled.get(number, "fault_entry")] | 1, number


def test_the_fixed_image_has_no_float_code(fixed_image: Path) -> None:
    listing = subprocess.run(
        ["arm-none-eabi-objdump", "-d", fixed_image], check=True, capture_output=True, text=True
    ).stdout
    assert not re.findall(r"\tv(?:add|mul|ldr|mov|cvt|push|msr|mrs)\S*", listing)
    assert not re.findall(r"<__aeabi_[fd]\w+>|<__\w+[sd]f\w*>", listing)


@pytest.mark.parametrize("forbidden", ["malloc", "_sbrk", "printf", "_write", "exit"])
def test_no_heap_and_no_stdio(image: Path, forbidden: str) -> None:
    symbols = subprocess.run(
        ["arm-none-eabi-nm", str(image)], check=True, capture_output=True, text=True
    ).stdout
    assert not re.search(rf" {forbidden}$", symbols, re.M)


# --- parameter pages


def test_page_comes_back(tmp_path: Path) -> None:
    page = ParameterPage(NODE, 5, {(0x1018, 4): SERIAL, (0x607C, 0): 0xFFFF_FFF0})
    assert ParameterPage.of(page.to_bytes().ljust(COPY_BYTES, b"\xff")) == page
    file = tmp_path / "page.bin"
    assert main(["--node-id", str(NODE), "--serial", str(SERIAL), str(file)]) == 0
    assert file.read_bytes() == PAGE


@pytest.mark.parametrize("at", range(len(PAGE)))
def test_every_byte_of_a_page_counts(at: int) -> None:
    content = bytearray(PAGE)
    content[at] ^= 1
    with pytest.raises(PageError):
        ParameterPage.of(bytes(content))


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--node-id", "0", "--serial", "1", "p"], "invalid number from 1 to 127 or 255"),
        (["--node-id", "128", "--serial", "1", "p"], "--node-id"),
        (["--node-id", "1", "--serial", "0", "p"], "invalid number from 1 to 4294967295"),
        (["--node-id", "1", "--serial", "1", "/no/such/folder/p"], "No such file"),
    ],
)
def test_bad_arguments(
    arguments: list[str], what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(arguments)
    except SystemExit as error:
        status = error.code
    assert status == 2
    assert what in capsys.readouterr().err
