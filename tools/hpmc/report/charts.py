"""Charts of the report as SVG inside the page: its fonts, its colours in light and dark."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpmc.figures import EXECUTED, HARMONIC, INK, PLANNED, RETURN, SOFT, style
from hpmc.report.reach import JOINTS, LINKS, ReachSignals
from hpmc.report.timeline import PHASES, Span, Timeline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GRID = "#e6e6e6"
FAULT = "#cc3311"
# Drawn colour: variable of the page's style sheet.
_VARIABLES = {
    INK: "--ink", SOFT: "--soft", GRID: "--grid", PLANNED: "--blue", EXECUTED: "--orange",
    HARMONIC: "--green", RETURN: "--pink", FAULT: "--red",
}  # fmt: skip
_WIDTH_IN = 5.0
_JOINT_COLORS = (PLANNED, EXECUTED, HARMONIC)
_JOINT_LINES = ("-", (0, (5, 1.5)), (0, (1.5, 1)))
_COLUMNS = 1500  # of a time line: what lies closer is one
_LETTER_WIDTH = 0.0115  # of the time line's width
_LEGEND_COLUMNS = 5
_DRIVE_COLORS = {
    "operation enabled": HARMONIC, "fault": FAULT, "fault reaction active": FAULT,
    "quick stop active": EXECUTED, "switched on": PLANNED, "ready to switch on": PLANNED,
}  # fmt: skip


@dataclass(frozen=True)
class Chart:
    """One picture and what it shows."""

    title: str
    svg: str
    note: str = ""


def reach_charts(signals: ReachSignals) -> list[tuple[str, list[Chart]]]:
    """By layer of the paper, top to bottom."""
    band = [
        _chart("Hand: target X_t, desired X_d, measured X", lambda: _positions(signals), 3.1),
        _chart("Speed of the hand", lambda: _speeds(signals), 2.2,
               f"measured {signals.hand_speed_from}"),
    ]  # fmt: skip
    region = [
        _chart("Link errors |X_d - X|", lambda: _triple(
            signals.time_s, 1e3 * signals.link_error_m, LINKS, "mm", at_zero=True), 2.2),
        _chart("Link wrenches |W_L|", lambda: _triple(
            signals.time_s, signals.link_force_N, LINKS, "N", at_zero=True), 2.2),
    ]  # fmt: skip
    if signals.wrench_N.max() > 0:
        measured = signals.wrench_N[:, None]
        region.append(_chart("Measured wrench |W| of the hand on its environment", lambda: _triple(
            signals.time_s, measured, ("hand",), "N", at_zero=True), 2.2))  # fmt: skip
    joints = [
        _chart(f"Joint {joint + 1}, {name}: torque between ±T_max, phase of its FIC",
               lambda joint=joint: _torque(signals, joint), 2.8)
        for joint, name in enumerate(JOINTS)
    ]  # fmt: skip
    return [
        ("Elastic band", band),
        ("Dynamic task and joint controllers", [
            _chart("Joint errors Q_d - q", lambda: _triple(
                signals.time_s, 1e3 * signals.joint_error_rad, JOINTS, "mrad"), 2.2)]),
        ("Region of attraction", region),
        ("Joint coordination and joint controllers", joints),
    ]  # fmt: skip


def timeline_chart(line: Timeline) -> Chart:
    """Phases of the run, drive states and limit reasons of the nodes, emergencies as marks."""
    rows = ["run", *(f"node {node}" for node in sorted(line.drives))]
    rows += [f"node {node}: {name}" for node, name in sorted(line.limits)]
    height = 1.15 + 0.26 * len(rows)
    return _chart("Time line", lambda: _timeline(line, rows), height, width=9.4)


def load_chart(time_s: np.ndarray, percent: np.ndarray) -> Chart:
    """Load of the bus over the run."""

    def draw() -> Figure:
        figure, axes = _figure(1)
        axes[0].plot(time_s, percent, color=PLANNED, linewidth=1.1)
        axes[0].axhline(100, color=FAULT, linewidth=1)
        axes[0].set_ylim(0, max(105.0, 1.05 * float(percent.max())))
        axes[0].set_ylabel("% of 1 Mbit/s")
        axes[0].set_xlabel("run clock, s")
        return figure

    return _chart("Load of the bus", draw, 2.2, "each frame counted bit by bit")


def period_chart(pace: dict[str, object]) -> Chart | None:
    """How long the SYNC periods were, of a run on the wall clock; None where it was not told."""
    if not {"period_us", "histogram_bin_us", "period_histogram"} <= pace.keys():
        return None
    pairs = np.array(pace["period_histogram"], dtype=float).reshape(-1, 2)
    bin_ms = float(str(pace["histogram_bin_us"])) * 1e-3
    period_ms = float(str(pace["period_us"])) * 1e-3

    def draw() -> Figure:
        figure, axes = _figure(1)
        axes[0].bar(pairs[:, 0] * bin_ms, pairs[:, 1], width=bin_ms, align="edge", color=PLANNED)
        axes[0].axvline(period_ms, color=INK, linewidth=1, linestyle=(0, (2, 2)))
        axes[0].set_yscale("log")
        axes[0].set_xlabel("from one SYNC to the next, ms")
        axes[0].set_ylabel("periods")
        return figure

    return _chart("Length of the SYNC periods", draw, 2.2)


# --- drawing -------------------------------------------------------------------------------------


def _chart(
    title: str, draw: Callable[[], Figure], height: float, note: str = "", width: float = _WIDTH_IN
) -> Chart:
    import matplotlib as mpl

    settings = {
        "svg.fonttype": "none", "svg.hashsalt": title, "font.size": 9.5, "axes.labelsize": 9.5,
        "legend.fontsize": 9.0, "text.color": INK, "axes.edgecolor": SOFT, "axes.labelcolor": INK,
        "xtick.color": INK, "ytick.color": INK, "path.simplify_threshold": 0.2,
        "lines.linewidth": 1.3, "svg.id": None,
    }  # fmt: skip
    settings = {key: value for key, value in settings.items() if key in mpl.rcParams}
    with style(), mpl.rc_context(settings):
        figure = draw()
        figure.set_size_inches(width, height)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={
            "Date": None, "Creator": None, "Format": None, "Type": None})  # fmt: skip
    return Chart(title, _for_page(buffer.getvalue(), title), note)


def _for_page(svg: str, title: str) -> str:
    """An SVG file as an element of a page: names of its own, colours of the page."""
    svg = svg[svg.index("<svg") :]
    prefix = re.sub(r"\W+", "-", title.lower())
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r'href="#', f'href="#{prefix}-', svg)
    svg = svg.replace("url(#", f"url(#{prefix}-")
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font-size: \1px", svg)
    for color, variable in _VARIABLES.items():
        svg = re.sub(color, f"var({variable})", svg, flags=re.IGNORECASE)
    head, _, rest = svg.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None
    return f'<svg {box[0]} role="img" aria-label="{title}">{rest}'


def _figure(rows: int, *, share: bool = True) -> tuple[Figure, Sequence[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots(rows, 1, sharex=share, squeeze=False)[:, 0]
    for axis in axes:
        axis.grid(color=GRID)
        axis.margins(x=0)
    return figure, axes


def _legend(axes: Axes, columns: int) -> None:
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, handlelength=1.6,
        columnspacing=1.2, borderaxespad=0.1,
    )  # fmt: skip


def _positions(signals: ReachSignals) -> Figure:
    figure, axes = _figure(2)
    for row, name in enumerate("xy"):
        axis = axes[row]
        axis.plot(signals.time_s, signals.x_t_m[:, row], color=SOFT, label="X_t",
                  linestyle=(0, (4, 2)))  # fmt: skip
        axis.plot(signals.time_s, signals.x_d_m[:, row], color=PLANNED, label="X_d")
        axis.plot(signals.time_s, signals.hand_m[:, row], color=EXECUTED, label="X", linewidth=1)
        low, high = axis.get_ylim()
        if high - low < 0.01:  # an axis along which nothing moves shows no quantisation
            axis.set_ylim((low + high) / 2 - 0.005, (low + high) / 2 + 0.005)
        axis.set_ylabel(f"{name}, m")
    _legend(axes[0], 3)
    axes[-1].set_xlabel("time, s")
    return figure


def _speeds(signals: ReachSignals) -> Figure:
    figure, axes = _figure(1)
    axes[0].plot(signals.time_s, 1e3 * signals.planned_speed_m_s, color=PLANNED, label="X_d")
    axes[0].plot(
        signals.time_s, 1e3 * signals.hand_speed_m_s, color=EXECUTED, label="X", linewidth=1
    )
    axes[0].set_ylim(bottom=0)
    axes[0].set_ylabel("mm/s")
    axes[0].set_xlabel("time, s")
    _legend(axes[0], 2)
    return figure


def _triple(
    time_s: np.ndarray, values: np.ndarray, names: Sequence[str], unit: str, *,
    at_zero: bool = False,
) -> Figure:  # fmt: skip
    figure, axes = _figure(1)
    for column, name in enumerate(names):
        axes[0].plot(
            time_s, values[:, column], color=_JOINT_COLORS[column], label=name, linewidth=1.1,
            linestyle=_JOINT_LINES[column],
        )  # fmt: skip
    if at_zero:
        axes[0].set_ylim(bottom=0)
    axes[0].set_ylabel(unit)
    axes[0].set_xlabel("time, s")
    _legend(axes[0], 3)
    return figure


def _torque(signals: ReachSignals, joint: int) -> Figure:
    figure, axes = _figure(1)
    axis = axes[0]
    most = signals.tau_max_Nm[:, joint]
    axis.fill_between(signals.time_s, -most, most, color=SOFT, alpha=0.25, linewidth=0,
                      label="±T_max")  # fmt: skip
    axis.plot(signals.time_s, signals.tau_d_Nm[:, joint], color=PLANNED, label="T_d")
    axis.plot(signals.time_s, signals.tau_Nm[:, joint], color=INK, label="torque", linewidth=0.9)
    # The phase as a strip below the curves.
    low, high = axis.get_ylim()
    strip = 0.055 * (high - low)
    axis.set_ylim(low - 2 * strip, high)
    for phase, color, name in ((False, EXECUTED, "divergence"), (True, HARMONIC, "convergence")):
        spans = _true_spans(signals.time_s, signals.convergence[:, joint] == phase)
        axis.broken_barh(spans, (low - 1.7 * strip, strip), facecolor=color, linewidth=0,
                         label=name)  # fmt: skip
    axis.set_ylabel("N m")
    axis.set_xlabel("time, s")
    _legend(axis, 3)
    return figure


def _true_spans(time_s: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """Begin and length of each stretch that is true."""
    edges = np.diff(np.concatenate([[0], on.astype(int), [0]]))
    step = float(np.median(np.diff(time_s)))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [
        (float(time_s[a]), float(time_s[b] - time_s[a]) + step)
        for a, b in zip(begins.tolist(), ends.tolist(), strict=True)
    ]


def _timeline(line: Timeline, rows: Sequence[str]) -> Figure:
    from matplotlib.patches import Patch

    figure, axes = _figure(1)
    axis = axes[0]
    phase_colors = (SOFT, SOFT, PLANNED, RETURN, HARMONIC, EXECUTED)
    handles = {}
    for span in _merged(line.phases, line):
        color = phase_colors[PHASES.index(span.what)] if span.what in PHASES else SOFT
        _bar(axis, 0, span, color, alpha=0.75)
        if not _write_inside(axis, 0, span, line):
            handles[span.what] = Patch(color=color, alpha=0.75, label=span.what)
    for row, node in enumerate(sorted(line.drives), start=1):
        for span in _merged(line.drives[node], line):
            color = _DRIVE_COLORS.get(span.what, SOFT)
            _bar(axis, row, span, color, alpha=0.45)
            if not _write_inside(axis, row, span, line):
                handles[span.what] = Patch(color=color, alpha=0.45, label=span.what)
    for row, key in enumerate(sorted(line.limits), start=1 + len(line.drives)):
        for span in _merged(line.limits[key], line):
            _bar(axis, row, span, EXECUTED, alpha=0.9)
    for event in line.emergencies:
        row = rows.index(event.who) if event.who in rows else 0
        axis.plot(event.time_s, row, marker="v", color=FAULT, markersize=8, clip_on=False)
        handles["emergency"] = Patch(color=FAULT, label="emergency")
    if handles:
        axis.legend(
            handles=list(handles.values()), loc="lower left", bbox_to_anchor=(0, 1.0),
            ncols=_LEGEND_COLUMNS, handlelength=1.2,
        )  # fmt: skip
    axis.set_yticks(range(len(rows)), rows)
    axis.set_ylim(len(rows) - 0.45, -0.55)
    axis.set_xlim(line.begin_s, max(line.end_s, line.begin_s + 1e-3))
    axis.grid(axis="y", visible=False)
    axis.set_xlabel("run clock, s")
    axis.tick_params(axis="y", length=0)
    return figure


def _bar(axis: Axes, row: int, span: Span, color: str, alpha: float) -> None:
    axis.broken_barh(
        [(span.from_s, span.to_s - span.from_s)], (row - 0.36, 0.72), facecolor=color, alpha=alpha,
        linewidth=0,
    )  # fmt: skip


def _write_inside(axis: Axes, row: int, span: Span, line: Timeline) -> bool:
    """The name of what lasted, where there is room for it; whether there is."""
    part = (span.to_s - span.from_s) / max(line.end_s - line.begin_s, 1e-9)
    if part < _LETTER_WIDTH * (len(span.what) + 1):
        return False
    axis.text((span.from_s + span.to_s) / 2, row, span.what, ha="center", va="center",
              fontsize=8.5)  # fmt: skip
    return True


def _merged(spans: Sequence[Span], line: Timeline) -> list[Span]:
    """Spans as they can be seen: a short one is at least a column wide, close ones are one."""
    column_s = (line.end_s - line.begin_s) / _COLUMNS
    merged: list[Span] = []
    for span in spans:
        to_s = max(span.to_s, span.from_s + column_s)
        before = merged[-1] if merged else None
        if before and before.what == span.what and span.from_s - before.to_s < column_s:
            merged[-1] = Span(before.from_s, to_s, span.what)
        else:
            merged.append(Span(span.from_s, to_s, span.what))
    return merged
