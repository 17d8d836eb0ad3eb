"""The page of ./rig report in Chromium: all pictures there, nothing wider than the window."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from conftest import ENVIRONMENT

from hpmc.layout import ROOT

WIDTHS = (1280, 390)


@pytest.fixture(scope="module")
def page(run_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made by the command, from a folder that has no figures yet."""
    folder = tmp_path_factory.mktemp("report") / "run"
    shutil.copytree(run_log, folder)
    subprocess.run(
        [sys.executable, "-m", "hpmc", "report", folder], check=True, cwd=ROOT, env=ENVIRONMENT,
        timeout=120, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return folder / "report.html"


@pytest.fixture(scope="module")
def browser(page: Path) -> Iterator[Browser]:
    with Browser() as browser:
        browser.open(page.as_uri())
        browser.wait_for("document.readyState == 'complete' && document.images.length > 0")
        yield browser


def test_all_pictures_are_there_and_the_console_is_silent(browser: Browser) -> None:
    widths = browser.evaluate("[...document.images].map(image => image.naturalWidth)")
    assert len(widths) == 6 and min(widths) > 300
    drawings = browser.evaluate(
        "[...document.querySelectorAll('figure svg')].map(svg => ["
        "svg.getAttribute('aria-label'), svg.getBBox().width, svg.querySelectorAll('path').length])"
    )
    assert len(drawings) == 10  # hand, speed, joint errors, links x 2, joints x 3, time line, load
    assert all(width > 100 and paths > 5 for _, width, paths in drawings), drawings
    assert browser.errors == []


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_window(browser: Browser, width: int, scheme: str) -> None:
    browser.resize(width, 900)
    browser.scheme(scheme)
    assert browser.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert browser.evaluate("document.body.scrollWidth <= innerWidth")
    # What is wider scrolls inside itself: nothing but such boxes sticks out.
    outside = browser.evaluate(
        "[...document.querySelectorAll('main *, header *, footer *')].filter(element =>"
        " !element.closest('.scroll, svg') && element.getBoundingClientRect().right > innerWidth)"
        ".map(element => element.outerHTML.slice(0, 80))"
    )
    assert outside == []
    smallest = browser.evaluate(
        "Math.min(...[...document.querySelectorAll('main p, main td, main th, figcaption')]"
        ".map(element => parseFloat(getComputedStyle(element).fontSize)))"
    )
    assert smallest >= 12
    assert browser.errors == []


def test_text_stands_out_in_light_and_dark(browser: Browser) -> None:
    """Contrast of WCAG 2.1, 1.4.3: 4.5 for text, also in the drawings; 3 for lines."""
    luminance = (
        "(color => {const [r, g, b] = color.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255)"
        ".map(v => v <= .03928 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4);"
        " return .2126 * r + .7152 * g + .0722 * b})"
    )
    for scheme in ("light", "dark"):
        browser.scheme(scheme)
        for variable, least in (("--ink", 4.5), ("--blue", 3), ("--orange", 3), ("--green", 3),
                                ("--red", 3), ("--soft", 4.5)):  # fmt: skip
            contrast = browser.evaluate(
                "(() => {const probe = document.createElement('i'); document.body.append(probe);"
                f"probe.style.color = 'var({variable})';"
                f"const one = {luminance}(getComputedStyle(probe).color);"
                f"const two = {luminance}(getComputedStyle(document.body).backgroundColor);"
                "probe.remove();"
                "return (Math.max(one, two) + .05) / (Math.min(one, two) + .05)})()"
            )
            assert contrast >= least, (scheme, variable, contrast)
        text = browser.evaluate("getComputedStyle(document.querySelector('figure svg text')).fill")
        assert text == browser.evaluate("getComputedStyle(document.body).color")
