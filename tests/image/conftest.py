"""The images under test, built once, and boards to run them on."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from emulator import PAGE_ADDRESSES, Emulator

from hpmc.firmware_image import find_image
from hpmc.parameter_page import device_page

ROOT = Path(__file__).parents[2]
NODE = 3
SERIAL = 1003
PAGE = device_page(NODE, SERIAL).to_bytes()


@pytest.fixture(scope="session", params=["stm32f405", "stm32f405-fixed"])
def image(request: pytest.FixtureRequest) -> Path:
    """Sealed .elf of each number type."""
    return build(request.param)


@pytest.fixture(scope="session")
def float_image() -> Path:
    """Sealed .elf, controller in float: where the number type does not matter."""
    return build("stm32f405")


@pytest.fixture(scope="session")
def fixed_image() -> Path:
    """Sealed .elf, controller in integers."""
    return build("stm32f405-fixed")


def build(preset: str) -> Path:
    """Brings an image up to date."""
    if not (ROOT / "build" / preset / "build.ninja").exists():
        subprocess.run(["cmake", "--preset", preset], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(
        ["cmake", "--build", "--preset", preset, "--", "--quiet"],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    return find_image(ROOT / "build" / preset)


Boards = Callable[..., Emulator]


@pytest.fixture
def boards() -> Iterator[Boards]:
    """Makes boards that end with the test: boards(elf) is node 3, its channel open."""
    with ExitStack() as stack:

        def make(elf: Path, pages: dict[int, bytes] | None = None) -> Emulator:
            content = {PAGE_ADDRESSES[0]: PAGE} if pages is None else pages
            board = stack.enter_context(Emulator(elf, content))
            board.open()
            return board

        yield make
