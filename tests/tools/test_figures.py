"""The figures are drawn for one repetition, for several, and for a run that was cut short; what
they show is read back from the drawn objects."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from synthetic_log import write_clock_log

from hpmc.analysis import Analysis, analyse_logs
from hpmc.figures import (
    EXECUTED,
    FIGURES,
    PLANNED,
    draw_all,
    draw_comparison,
    draw_r_per_target,
)
from hpmc.kinematics import ClockGeometry


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    path = tmp_path_factory.mktemp("log") / "run.lcmlog"
    write_clock_log(path)
    return analyse_logs([path])


def test_every_figure_is_written_as_png_and_pdf(analysis: Analysis, tmp_path: Path) -> None:
    files = draw_all(analysis, tmp_path)
    assert sorted(path.name for path in files) == sorted(
        f"{name}.{suffix}" for name in FIGURES for suffix in ("png", "pdf")
    )
    for path in files:
        start = b"\x89PNG" if path.suffix == ".png" else b"%PDF"
        assert path.read_bytes().startswith(start)
        assert path.stat().st_size > 5_000


def test_nothing_is_cut_off_or_without_a_label(analysis: Analysis) -> None:
    for name, draw in FIGURES.items():
        figure = draw(analysis, ClockGeometry())
        figure.set_layout_engine("constrained")
        figure.draw_without_rendering()
        width, height = figure.get_size_inches() * figure.dpi
        box = figure.get_tightbbox().padded(0).transformed(figure.dpi_scale_trans)
        assert box.x0 >= -1 and box.y0 >= -1, name
        assert box.x1 <= width + 1 and box.y1 <= height + 1, name
        for axes in figure.axes:
            shared = axes.get_subplotspec().get_gridspec().nrows > 1
            assert shared or (axes.get_xlabel() and axes.get_ylabel()), name
        titles = [axes.get_title("left") or axes.get_title() for axes in figure.axes]
        titles.append(figure.get_suptitle())
        assert any(title.startswith("Fig. ") for title in titles), name


def test_r_figure_shows_the_metrics(analysis: Analysis) -> None:
    (axes,) = draw_r_per_target(analysis, ClockGeometry()).axes
    drawn = {line.get_color(): line for line in axes.lines if len(line.get_xdata()) == 8}
    for color, column in ((PLANNED, "planned_r"), (EXECUTED, "executed_r")):
        expected = [
            getattr(analysis.metrics.of_target(target), column).mean() for target in range(1, 9)
        ]
        np.testing.assert_allclose(drawn[color].get_ydata(), expected)
    levels = {float(line.get_ydata()[0]) for line in axes.lines if len(line.get_ydata()) == 2}
    assert {1.805, 1.875, 1.596} <= levels


def test_comparison_curves_have_the_planned_duration(analysis: Analysis) -> None:
    position, velocity = draw_comparison(analysis, ClockGeometry()).axes
    peaks = [float(np.max(line.get_ydata())) for line in velocity.lines if len(line.get_ydata())]
    # mean executed, harmonic, minimum jerk: the last three
    assert peaks[-2] == pytest.approx(np.pi / 2 * 100 / 0.972, rel=1e-3)
    assert peaks[-1] == pytest.approx(1.875 * 100 / 0.972, rel=1e-3)
    assert "0.972 s" in "".join(str(line.get_label()) for line in position.lines)


@pytest.mark.parametrize(("repetitions", "reaches"), [(1, 1), (2, 3)])
def test_a_run_that_was_cut_short_is_drawn_too(
    tmp_path: Path, repetitions: int, reaches: int
) -> None:
    write_clock_log(tmp_path / "run.lcmlog", repetitions=range(repetitions), reaches=reaches)
    short = analyse_logs([tmp_path / "run.lcmlog"])
    for draw in FIGURES.values():
        draw(short, ClockGeometry()).draw_without_rendering()


def test_matplotlib_is_loaded_only_to_draw() -> None:
    code = "import hpmc.figures, hpmc.summary, sys; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
