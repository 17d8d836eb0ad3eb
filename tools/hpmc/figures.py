"""The paper's figures of the clock experiment, drawn from a run, as PNG and PDF.

Numbered as in the paper. Error bars and bands are the standard deviation over the reaches of a
target (both directions), so over its two directions when there is one repetition.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hpmc.analysis import Analysis, MeanCurve, way_mm
from hpmc.kinematics import TARGET_COUNT, ClockGeometry
from hpmc.metrics import HARMONIC_R, HUMAN_R, MINIMUM_JERK_R, speed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TARGETS = range(1, TARGET_COUNT + 1)

# Okabe and Ito's colours: told apart with any colour vision
PLANNED = "#0072B2"
EXECUTED = "#D55E00"
RETURN = "#CC79A7"
HARMONIC = "#009E73"
HUMAN = "#56B4E9"
MINIMUM_JERK = "#222222"
INK = "#222222"
SOFT = "#8a8a8a"

HARMONIC_LINE = (0, (5, 2))
MINIMUM_JERK_LINE = (0, (1.5, 1.2))
RETURN_LINE = (0, (4, 1.5))

_STYLE: dict[Any, Any] = {
    "figure.dpi": 100,
    "savefig.dpi": 150,
    "figure.constrained_layout.use": True,
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.6,
    "errorbar.capsize": 3,
}


def draw_all(analysis: Analysis, folder: Path, geometry: ClockGeometry | None = None) -> list[Path]:
    """Draws every figure into `folder` and returns the files, PNG and PDF of each."""
    geometry = geometry or ClockGeometry()
    files = []
    with style():
        for name, draw in FIGURES.items():
            figure = draw(analysis, geometry)
            for suffix in ("png", "pdf"):
                files.append(folder / f"{name}.{suffix}")
                figure.savefig(files[-1])
                figure.set_layout_engine("none")  # laid out once is enough for both files
    return files


def draw_timing(pace: dict[str, Any], folder: Path) -> list[Path]:
    """fig_timing: how long the SYNC periods of a run on the wall clock were (`pace`)."""
    period_ms, bin_ms = pace["period_us"] * 1e-3, pace["histogram_bin_us"] * 1e-3
    bins, counts = np.array(pace["period_histogram"]).reshape(-1, 2).T
    span = max(0.1 * period_ms, 1.1 * np.abs((bins + 0.5) * bin_ms - period_ms).max(initial=0.0))
    files = []
    with style():
        figure = _figure(6.4, 3.2)
        axes = figure.subplots()
        axes.axvspan(
            0.9 * period_ms, 1.1 * period_ms, color=HARMONIC, alpha=0.12, linewidth=0,
            label="a tenth of a period",
        )  # fmt: skip
        axes.bar(bins * bin_ms, counts, width=max(bin_ms, span / 150), align="edge", color=PLANNED)
        axes.axvline(period_ms, color=INK, linewidth=1.0, linestyle=MINIMUM_JERK_LINE)
        axes.set_yscale("log")
        axes.set_ylim(0.7, 2.0 * counts.max(initial=1))
        axes.set_xlim(max(period_ms - span, 0.0), period_ms + span)
        axes.set_xlabel("from one SYNC to the next, ms")
        axes.set_ylabel("SYNC periods")
        axes.set_title(
            f"{pace['cycles']} cycles of {period_ms:g} ms: jitter {pace['jitter_us']:.0f} us, "
            f"{pace['late_cycles']} late, {pace['overruns']} overruns"
        )
        axes.legend(loc="upper right")
        for suffix in ("png", "pdf"):
            files.append(folder / f"fig_timing.{suffix}")
            figure.savefig(files[-1])
            figure.set_layout_engine("none")
    return files


def draw_arm(analysis: Analysis, geometry: ClockGeometry) -> Figure:
    """Fig. 1: the arm at home from above, the targets, and the hand's path in one repetition."""
    figure = _figure(6.4, 5.6)
    axes = figure.subplots()
    for path in analysis.sample.hand_m:
        axes.plot(*path.T, color=EXECUTED, linewidth=1.2, zorder=4)
    axes.plot([], [], color=EXECUTED, label="hand path, executed (one repetition)")
    _draw_links(axes, geometry, geometry.posture(0))
    for target in TARGETS:
        position = geometry.position(target)
        outside = position + 0.026 * (position - geometry.position(0)) / geometry.radius_m
        axes.plot(*position, "o", color="white", markeredgecolor=INK, markersize=9, zorder=5)
        axes.text(outside[0], outside[1], str(target), ha="center", va="center", zorder=6)
    axes.plot([], [], "o", color="white", markeredgecolor=INK, markersize=9, label="targets 1 to 8")
    axes.plot(
        *geometry.position(0),
        "s",
        color=INK,
        markersize=6,
        zorder=7,
        label="home, where the hand is",
    )
    axes.set_title("Fig. 1  Simulated arm from above, at home")
    _metre_axes(axes)
    drawn = np.vstack(
        [
            geometry.arm.joint_positions(geometry.posture(0)),
            *(geometry.position(target) for target in TARGETS),
        ]
    )
    axes.set_xlim(drawn[:, 0].min() - 0.06, drawn[:, 0].max() + 0.06)
    axes.set_ylim(drawn[:, 1].min() - 0.055, drawn[:, 1].max() + 0.055)
    axes.legend(loc="lower right")
    return figure


def draw_r_per_target(analysis: Analysis, geometry: ClockGeometry) -> Figure:
    """Fig. 3: peak over mean speed of planned and executed reaches, beside the literature."""
    del geometry
    figure = _figure(7.6, 4.6)
    axes = figure.subplots()
    low, high = HUMAN_R[0] - HUMAN_R[1], HUMAN_R[0] + HUMAN_R[1]
    axes.axhspan(low, high, color=HUMAN, alpha=0.2, linewidth=0)
    references = (
        (MINIMUM_JERK_R, f"minimum jerk\n{MINIMUM_JERK_R}", MINIMUM_JERK, MINIMUM_JERK_LINE),
        (HUMAN_R[0], f"human\n{HUMAN_R[0]} ± {HUMAN_R[1]}", HUMAN, "-"),
        (HARMONIC_R, f"harmonic\n{HARMONIC_R}", HARMONIC, HARMONIC_LINE),
    )
    for value, name, color, line in references:
        axes.axhline(value, color=color, linestyle=line, linewidth=1.4)
        axes.annotate(
            name,
            (1.0, value),
            xycoords=("axes fraction", "data"),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            color=INK,
        )
    metrics = analysis.metrics
    _error_bars(axes, analysis, "planned_r", PLANNED, "s", -0.13, "planned, elastic band $X_d$")
    _error_bars(axes, analysis, "executed_r", EXECUTED, "o", 0.13, "executed, hand $X$")
    axes.set_xticks([*TARGETS, TARGET_COUNT + 1], [*(str(target) for target in TARGETS), "all"])
    axes.axvline(TARGET_COUNT + 0.5, color=SOFT, linewidth=0.8)
    for column, color, marker, shift in (
        ("planned_r", PLANNED, "s", -0.13),
        ("executed_r", EXECUTED, "o", 0.13),
    ):
        values = getattr(metrics, column)
        axes.errorbar(
            TARGET_COUNT + 1 + shift, values.mean(), values.std(), color=color, marker=marker
        )
    axes.set_xlim(0.5, TARGET_COUNT + 1.5)
    axes.grid(axis="x", visible=False)
    axes.set_xlabel("target")
    axes.set_ylabel("r = peak speed / mean speed over 1 s")
    axes.set_title(f"Fig. 3  Smoothness r per target ({_reach_count(analysis)}, mean ± std)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    return figure


def draw_rmse_per_target(analysis: Analysis, geometry: ClockGeometry) -> Figure:
    """Fig. 4: tracking errors of position and velocity."""
    del geometry
    figure = _figure(7.2, 5.6)
    position, velocity = figure.subplots(2, 1, sharex=True)
    for axes, column, unit, color in (
        (position, "position_rmse_mm", "mm", PLANNED),
        (velocity, "velocity_rmse_mm_s", "mm/s", EXECUTED),
    ):
        mean, std = _per_target(analysis, column)
        axes.bar(TARGETS, mean, width=0.6, color=color, alpha=0.85)
        axes.errorbar(TARGETS, mean, std, fmt="none", color=INK, linewidth=1.2)
        overall = getattr(analysis.metrics, column).mean()
        axes.axhline(overall, color=INK, linewidth=1, linestyle="--")
        axes.annotate(
            f"all\n{overall:.2f}" if unit == "mm" else f"all\n{overall:.1f}",
            (1.0, overall),
            xycoords=("axes fraction", "data"),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
        )
        axes.set_ylabel(f"RMSE of $X$ against $X_d$, {unit}")
        axes.grid(axis="x", visible=False)
    position.axhline(1.0, color=HARMONIC, linewidth=1.4)
    position.text(0.45, 1.015, "paper: below 1 mm", fontsize=9, va="bottom")
    position.set_ylim(0, max(1.2, position.get_ylim()[1]))
    position.set_title(f"Fig. 4  Position error of the hand ({_reach_count(analysis)}, mean ± std)")
    velocity.set_title("Velocity error of the hand")
    velocity.set_xticks(TARGETS)
    velocity.set_xlabel("target")
    velocity.set_xlim(0.4, TARGET_COUNT + 0.6)
    return figure


def draw_paths_and_speed(analysis: Analysis, geometry: ClockGeometry) -> Figure:
    """Fig. 5: speed of each target's reaches at its place on the clock, hand paths inside."""
    figure = _figure(10.5, 9.0)
    grid = figure.subplots(3, 3)
    place = {1: (1, 2), 2: (0, 2), 3: (0, 1), 4: (0, 0), 5: (1, 0), 6: (2, 0), 7: (2, 1), 8: (2, 2)}
    sample = analysis.sample
    sample_speed = 1e3 * speed(sample.hand_m_s)
    top = 1.08 * max(
        float(sample_speed.max()),
        *(
            float((curves.executed_speed_mm_s.mean + curves.executed_speed_mm_s.std).max())
            for curves in analysis.curves.values()
        ),
    )
    for target, (row, column) in place.items():
        axes = grid[row][column]
        for outward, color, line in ((True, EXECUTED, "-"), (False, RETURN, RETURN_LINE)):
            curves = analysis.curves.get((target, outward))
            if curves is None:
                continue
            axes.plot(analysis.time_s, curves.planned_speed_mm_s.mean, color=PLANNED)
            if analysis.repetitions > 1:
                _band(axes, analysis.time_s, curves.executed_speed_mm_s, color)
            for reach in np.flatnonzero((sample.target == target) & (sample.outward == outward)):
                axes.plot(
                    analysis.time_s, sample_speed[reach], color=color, linestyle=line, linewidth=1
                )
        axes.set_title(f"target {target}")
        _time_axis(axes, analysis)
        axes.set_ylim(0, top)
        if column == 0:
            axes.set_ylabel("speed, mm/s")
        if row != 2:
            axes.set_xlabel("")
    paths = grid[1][1]
    for desired, executed in zip(sample.x_d_m, sample.hand_m, strict=True):
        paths.plot(*desired.T, color=PLANNED, linewidth=5, alpha=0.2)
        paths.plot(*executed.T, color=EXECUTED, linewidth=1)
    for target in TARGETS:
        position = geometry.position(target)
        outside = position + 0.018 * (position - geometry.position(0)) / geometry.radius_m
        paths.text(outside[0], outside[1], str(target), ha="center", va="center", fontsize=9)
    paths.set_title("hand paths, one repetition")
    _metre_axes(paths)
    _limits_around_clock(paths, geometry, 1.35)
    handles = [
        paths.plot([], [], color=PLANNED, label="planned $X_d$")[0],
        paths.plot([], [], color=EXECUTED, label="executed $X$, home to target")[0],
        paths.plot(
            [], [], color=RETURN, linestyle=RETURN_LINE, label="executed $X$, target to home"
        )[0],
    ]
    if analysis.repetitions > 1:
        handles.append(
            paths.fill_between(
                [], [], [], color=EXECUTED, alpha=0.3, label="executed, mean ± std of all"
            )
        )
    many = analysis.repetitions > 1
    shown = f"lines: one repetition of {analysis.repetitions}" if many else _reach_count(analysis)
    figure.suptitle(
        f"Fig. 5  Hand paths, and speed per target ({shown})",
        fontweight="bold",
        x=0.01,
        ha="left",
    )
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def draw_manipulability(analysis: Analysis, geometry: ClockGeometry) -> Figure:
    """Fig. 6: velocity ellipses of the hand at home and at the targets, and their volume."""
    from matplotlib.patches import Ellipse

    del analysis
    figure = _figure(10.0, 4.9)
    clock, bars = figure.subplots(1, 2, width_ratios=(1.1, 1))
    places = [0, *TARGETS]
    volume = np.array([geometry.manipulability(place) for place in places])
    lowest = set(np.argsort(volume)[:2].tolist())
    colors = [EXECUTED if place in lowest else PLANNED for place in places]
    scale = 0.07  # m drawn per m/s of hand speed at 1 rad/s of joint rates
    for place, color in zip(places, colors, strict=True):
        jacobian = geometry.arm.hand_jacobian(geometry.posture(place))
        squared, axes_of_ellipse = np.linalg.eigh(jacobian @ jacobian.T)
        major = axes_of_ellipse[:, 1]
        ellipse = Ellipse(
            tuple(geometry.position(place)),
            width=2 * scale * np.sqrt(squared[1]),
            height=2 * scale * np.sqrt(squared[0]),
            angle=float(np.degrees(np.arctan2(major[1], major[0]))),
            facecolor=color,
            alpha=0.25,
        )
        clock.add_patch(ellipse)
        outline = Ellipse(
            ellipse.center,
            ellipse.width,
            ellipse.height,
            angle=ellipse.angle,
            fill=False,
            edgecolor=color,
            linewidth=1.5,
        )
        clock.add_patch(outline)
        clock.text(
            *geometry.position(place),
            "home" if place == 0 else str(place),
            ha="center",
            va="center",
            fontsize=8 if place == 0 else 10,
        )
    _metre_axes(clock)
    _limits_around_clock(clock, geometry, 1.5)
    clock.text(
        0.02,
        0.02,
        f"scale: {1e3 * scale:.0f} mm = 1 m/s at joint rates of 1 rad/s",
        transform=clock.transAxes,
        fontsize=9,
    )
    clock.set_title("Fig. 6  Manipulability ellipses of the hand")
    bars.bar(range(len(places)), 1e3 * volume, width=0.65, color=colors, alpha=0.85)
    for place, value in enumerate(volume):
        bars.text(place, 1e3 * value + 1, f"{1e3 * value:.1f}", ha="center", fontsize=9)
    bars.set_xticks(range(len(places)), ["home", *(str(target) for target in TARGETS)])
    bars.set_xlabel("target")
    bars.set_ylabel("manipulability $(\\det J J^T)^{1/2}$, $10^{-3}$ m$^2$")
    bars.grid(axis="x", visible=False)
    bars.set_title("Manipulability; the two lowest in orange")
    return figure


def draw_comparison(analysis: Analysis, geometry: ClockGeometry) -> Figure:
    """Fig. 7: executed reaches beside harmonic and minimum-jerk ones of the same duration."""
    del geometry
    figure = _figure(9.6, 4.6)
    position, velocity = figure.subplots(1, 2)
    time_s = analysis.time_s
    all_curves = list(analysis.curves.values())
    distance_mm = float(np.mean([c.planned_way_mm.mean[-1] for c in all_curves]))
    planned_peak = float(np.mean([c.planned_speed_mm_s.mean.max() for c in all_curves]))
    duration_s = np.pi * distance_mm / (2 * planned_peak)  # of a half cosine with this peak
    harmonic = _harmonic(time_s, distance_mm, duration_s)
    minimum_jerk = _minimum_jerk(time_s, distance_mm, duration_s)
    sample = analysis.sample
    for axes, number, curves, sample_curves in (
        (position, 0, [c.executed_way_mm for c in all_curves], way_mm(sample, sample.hand_m)),
        (velocity, 1, [c.executed_speed_mm_s for c in all_curves], 1e3 * speed(sample.hand_m_s)),
    ):
        executed = MeanCurve(time_s.size)
        for curve in curves:
            executed.merge(curve)
        axes.plot(time_s, sample_curves.T, color=EXECUTED, linewidth=0.6, alpha=0.45)
        _band(axes, time_s, executed, EXECUTED)
        axes.plot(time_s, executed.mean, color=EXECUTED, linewidth=2.4)
        axes.plot(time_s, harmonic[number], color=HARMONIC, linestyle=HARMONIC_LINE)
        axes.plot(time_s, minimum_jerk[number], color=MINIMUM_JERK, linestyle=MINIMUM_JERK_LINE)
        _time_axis(axes, analysis)
        axes.set_ylim(bottom=0)
    position.set_ylabel("way along the line to the target, mm")
    velocity.set_ylabel("speed, mm/s")
    position.set_title(f"Fig. 7  Position ({_reach_count(analysis)})")
    velocity.set_title("Speed")
    key: list[tuple[str, dict[str, Any]]] = [
        ("executed, mean ± std", {"color": EXECUTED, "linewidth": 2.4}),
        ("one repetition", {"color": EXECUTED, "linewidth": 0.8, "alpha": 0.6}),
        (f"harmonic, {duration_s:.3f} s", {"color": HARMONIC, "linestyle": HARMONIC_LINE}),
        (
            f"minimum jerk, {duration_s:.3f} s",
            {"color": MINIMUM_JERK, "linestyle": MINIMUM_JERK_LINE},
        ),
    ]
    handles = [position.plot([], [], label=label, **look)[0] for label, look in key]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


FIGURES: dict[str, Callable[[Analysis, ClockGeometry], Figure]] = {
    "fig1_arm": draw_arm,
    "fig3_r_per_target": draw_r_per_target,
    "fig4_rmse_per_target": draw_rmse_per_target,
    "fig5_paths_and_speed": draw_paths_and_speed,
    "fig6_manipulability": draw_manipulability,
    "fig7_comparison": draw_comparison,
}


@contextmanager
def style() -> Iterator[None]:
    """The look of all pictures: `with style(): ...`."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE):
        yield


def _figure(width_in: float, height_in: float) -> Figure:
    # Figure without pyplot: no window system, no global state, and quicker to import
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in))


def _draw_links(axes: Axes, geometry: ClockGeometry, q_rad: np.ndarray) -> None:
    joints = geometry.arm.joint_positions(q_rad)
    names = ("arm", "forearm", "hand")
    for name, start, end, width in zip(names, joints[:-1], joints[1:], (15, 12, 9), strict=True):
        axes.plot(
            *np.stack([start, end]).T,
            color="#c9ced6",
            linewidth=width,
            solid_capstyle="round",
            zorder=2,
        )
        middle = (start + end) / 2
        if name != "hand":
            angle = np.degrees(np.arctan2(*(end - start)[::-1]))
            axes.text(
                middle[0],
                middle[1],
                name,
                ha="center",
                va="center",
                rotation=float(angle),
                fontsize=9,
                zorder=3,
            )
    axes.plot(*joints[:3].T, "o", color="white", markeredgecolor=INK, markersize=8, zorder=3)
    for name, joint, shift in zip(
        ("shoulder", "elbow", "wrist"), joints[:3], ((-8, 12), (0, -18), (14, -2)), strict=True
    ):
        align = "left" if name == "wrist" else "center"
        axes.annotate(
            name, tuple(joint), xytext=shift, textcoords="offset points", ha=align, fontsize=9
        )


def _metre_axes(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _per_target(analysis: Analysis, column: str) -> tuple[np.ndarray, np.ndarray]:
    values = [getattr(analysis.metrics.of_target(target), column) for target in TARGETS]
    mean = np.array([value.mean() if value.size else np.nan for value in values])
    std = np.array([value.std() if value.size else np.nan for value in values])
    return mean, std


def _error_bars(
    axes: Axes, analysis: Analysis, column: str, color: str, marker: str, shift: float, label: str
) -> None:
    mean, std = _per_target(analysis, column)
    axes.errorbar(
        np.array(TARGETS) + shift,
        mean,
        std,
        color=color,
        marker=marker,
        linestyle="none",
        label=label,
    )


def _band(axes: Axes, time_s: np.ndarray, curve: MeanCurve, color: str) -> None:
    low, high = curve.mean - curve.std, curve.mean + curve.std
    axes.fill_between(time_s, low, high, color=color, alpha=0.22, linewidth=0)


def _time_axis(axes: Axes, analysis: Analysis) -> None:
    axes.set_xlim(0, analysis.time_s[-1] + analysis.time_s[1])
    axes.set_xlabel("time, s")


def _limits_around_clock(axes: Axes, geometry: ClockGeometry, radii: float) -> None:
    half = radii * geometry.radius_m
    axes.set_xlim(geometry.centre_m[0] - half, geometry.centre_m[0] + half)
    axes.set_ylim(geometry.centre_m[1] - half, geometry.centre_m[1] + half)


def _reach_count(analysis: Analysis) -> str:
    count = len(analysis.metrics)
    return f"{count} reach{'' if count == 1 else 'es'}"


def _harmonic(
    time_s: np.ndarray, distance: float, duration_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Way and speed of the paper's x_h, at rest after its duration."""
    phase = np.pi * np.minimum(time_s / duration_s, 1.0)
    rate = np.pi / duration_s
    return distance / 2 * (1 - np.cos(phase)), distance / 2 * rate * np.sin(phase)


def _minimum_jerk(
    time_s: np.ndarray, distance: float, duration_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Way and speed of the paper's x_mj, at rest after its duration."""
    s = np.minimum(time_s / duration_s, 1.0)
    way = distance * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return way, distance / duration_s * (30 * s**2 - 60 * s**3 + 30 * s**4)
