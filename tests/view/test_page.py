"""The viewer's page in headless Chromium, beside a live run and from a log."""

from pathlib import Path

import pytest
from browser import Browser
from conftest import sil_at_human_speed, viewer

FRAMES_PER_S = 30
# A hash of what a canvas shows.
PIXELS = """[...document.querySelectorAll("canvas")].map((canvas) => {
    const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    return data.reduce((hash, byte) => (hash * 31 + byte) | 0, 7);
})"""
ON_PAGE = """(([x, y]) => {
    const box = hpmcView.arm.canvas.getBoundingClientRect();
    return [box.left + x, box.top + y];
})(hpmcView.arm.place(%s))"""
HAND = "hpmcView.states.at(-1).links[2]"


def page_of(browser: Browser, url: str) -> None:
    browser.open(url)
    browser.wait_for("window.hpmcView && hpmcView.hello && hpmcView.stats.drawn > 5")


def test_live_run_is_drawn_and_its_target_dragged(tmp_path: Path, lcm_url: str) -> None:
    """The acceptance test of the live view."""
    with (
        sil_at_human_speed(lcm_url, tmp_path / "run.lcmlog"),
        viewer("--lcm-url", lcm_url) as url,
        Browser() as browser,
    ):
        page_of(browser, url)
        assert browser.evaluate("hpmcView.hello.kind") == "live"
        browser.wait_for("hpmcView.states.at(-1)?.phase === 4")  # reaching

        before = browser.evaluate(PIXELS)
        assert len(before) == 5
        browser.wait_for(f"({PIXELS}).every((now, i) => now !== {before}[i])")

        # Dragged from the target to another place: the hand follows it there.
        start = browser.evaluate(ON_PAGE % "hpmcView.states.at(-1).x_t")
        end = browser.evaluate(ON_PAGE % "[0.33, -0.06]")
        browser.mouse("mousePressed", *start)
        for i in range(1, 11):
            way = zip(start, end, strict=True)
            browser.mouse("mouseMoved", *(a + (b - a) * i / 10 for a, b in way))
        browser.mouse("mouseReleased", *end)
        browser.wait_for(f"Math.hypot({HAND}[0] - 0.33, {HAND}[1] + 0.06) < 0.003")
        target = browser.evaluate("hpmcView.states.at(-1).x_t")
        assert target == pytest.approx([0.33, -0.06], abs=0.002)  # a pixel is 1.4 mm

        words = ["operation enabled", "operational", "25.0 °C"]
        browser.wait_for(
            f"{words}.every((word) => document.getElementById('nodes').innerText.split(word).length"
            " === 4)"
        )
        assert not browser.errors


def test_thirty_pictures_a_second(tmp_path: Path, lcm_url: str) -> None:
    """Of a 1 kHz source. The best of many seconds counts: this asks what the viewer can do, not how
    busy the machine is."""
    with (
        sil_at_human_speed(lcm_url, tmp_path / "run.lcmlog"),
        viewer("--lcm-url", lcm_url) as url,
        Browser() as browser,
    ):
        page_of(browser, url)
        browser.wait_for(f"hpmcView.stats.perSecond >= {FRAMES_PER_S}", limit_s=60)
        assert browser.evaluate("hpmcView.stats.states / hpmcView.stats.messages") >= 1


def test_replay_plays_pauses_and_scrubs(replay_url: str) -> None:
    with Browser() as browser:
        page_of(browser, replay_url)
        assert browser.evaluate("hpmcView.hello.marks.length") == 16
        assert browser.evaluate("hpmcView.hello.end") == pytest.approx(9.249)
        began = browser.evaluate("hpmcView.states.at(-1).t")
        browser.wait_for(f"hpmcView.states.at(-1).t > {began} + 0.2")

        browser.evaluate("document.getElementById('play').click()")
        browser.wait_for("document.getElementById('play').textContent === '▶'")
        browser.evaluate(
            "(scrub => { scrub.value = 3.25; scrub.dispatchEvent(new Event('input'));"
            " scrub.dispatchEvent(new Event('change')); })(document.getElementById('scrub'))"
        )
        browser.wait_for("Math.abs(hpmcView.states.at(-1).t - 3.25) < 0.0015")
        # At rest while paused: reach 5 of a period of .5 s began at 3 s, toward clock position 3.
        state = browser.evaluate("hpmcView.states.at(-1)")
        assert (state["reach"], state["target"]) == (4, 3)
        assert state["x_t"] == pytest.approx([0.3, 0.1])
        browser.evaluate(
            "(speed => { speed.value = '20'; speed.dispatchEvent(new Event('change')); })"
            "(document.getElementById('speed'))"
        )
        browser.evaluate("document.getElementById('play').click()")
        browser.wait_for("hpmcView.states.at(-1).t > 9.2")
        browser.wait_for("document.getElementById('play').textContent === '▶'")  # at the end
        assert not browser.errors


def test_page_fits_wide_and_narrow_windows(replay_url: str) -> None:
    with Browser() as browser:
        page_of(browser, replay_url)
        for scheme in ("light", "dark"):
            browser.scheme(scheme)
            for width in (1280, 390):
                browser.resize(width, 844)
                browser.wait_for(f"innerWidth === {width}")
                assert browser.evaluate("document.documentElement.scrollWidth <= innerWidth")
                too_wide = browser.evaluate(
                    "[...document.querySelectorAll('body *')].filter(e =>"
                    " e.getClientRects().length && e.getBoundingClientRect().right > innerWidth + 1"
                    ").map(e => e.className)"
                )
                assert too_wide == []
        assert not browser.errors
