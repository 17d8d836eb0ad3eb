"""`./rig log plot`: any numeric fields over the run clock, one axis per unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hpmc.figures import style
from hpmc.lcm_log import LogError
from hpmc.log_columns import INDEX
from hpmc.run_folder import RunFolder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".pdf", ".svg")
MOST_CURVES = 40
BUCKETS = 4000  # of a long curve: the least and the greatest value of each are drawn
LINES = ("-", "--", ":", "-.")
NO_UNIT = "no unit"


@dataclass(frozen=True)
class Curve:
    """One field over time."""

    name: str  # CHANNEL.field[i]
    unit: str
    time_s: np.ndarray
    values: np.ndarray

    @property
    def channel(self) -> str:
        return self.name.partition(".")[0]


def read_curves(
    run: RunFolder, fields: Sequence[str], from_s: float | None = None, to_s: float | None = None
) -> list[Curve]:
    """CHANNEL.field (a whole array), CHANNEL.field[i], CHANNEL.frames[2].id. Raises LogError."""
    curves: dict[str, Curve] = {}
    for wanted in fields:
        channel, dot, field = wanted.partition(".")
        if not dot or not field:
            raise LogError(f"{wanted}: a field is written CHANNEL.field, e.g. ARM_STATE.q_rad[0]")
        for curve in _read(run, channel, field, from_s, to_s):
            curves[curve.name] = curve
    if len(curves) > MOST_CURVES:
        raise LogError(f"{len(curves)} curves are too many for one picture: {MOST_CURVES} at most")
    return list(curves.values())


def draw_curves(curves: Sequence[Curve], title: str, figure: Figure | None = None) -> Figure:
    """One axis per unit, one above the other, over one time."""
    from matplotlib.figure import Figure

    units = list(dict.fromkeys(curve.unit for curve in curves))
    if figure is None:
        figure = Figure(figsize=(10, 1.2 + 2.9 * len(units)))
    axes = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for axis, unit in zip(axes, units, strict=True):
        shown = [curve for curve in curves if curve.unit == unit]
        channels = list(dict.fromkeys(curve.channel for curve in shown))
        for curve in shown:
            time_s, values = _thinned(curve.time_s, curve.values)
            dot = "." if values.size == 1 else None
            # Of two channels that agree both are seen.
            line = LINES[channels.index(curve.channel) % len(LINES)]
            axis.plot(time_s, values, line, marker=dot, linewidth=1.1, label=curve.name)
        axis.set_ylabel(unit or NO_UNIT)
        axis.legend(
            loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.3, handlelength=1.4
        )
    axes[0].set_title(title)
    axes[-1].set_xlabel("time, s")
    return figure


def save_plot(curves: Sequence[Curve], title: str, file: Path) -> None:
    """As the file's suffix says. Raises LogError."""
    if file.suffix.lower() not in SUFFIXES:
        raise LogError(f"-o {file}: the name must end in {', '.join(SUFFIXES)}")
    with style():
        figure = draw_curves(curves, title)
        try:
            figure.savefig(file)
        except OSError as error:
            raise LogError(f"-o {file}: cannot be written: {error.strerror}") from None


def show_plot(curves: Sequence[Curve], title: str) -> None:
    """In a window, until it is closed. Raises LogError where no window can be opened."""
    import matplotlib as mpl

    for backend in ("QtAgg", "TkAgg", "GTK3Agg"):
        try:
            mpl.use(backend, force=True)
            from matplotlib import pyplot as plt

            with style():
                figure = plt.figure(figsize=(10, 6))
                draw_curves(curves, title, figure)
                plt.show()
            return
        except (ImportError, RuntimeError):
            continue
        except Exception as error:  # TclError, whose module may not be there
            raise LogError(f"no window can be opened: {error}; name a file with -o") from None
    raise LogError(
        "no window can be opened: Python has no window system (apt-get install python3-tk); "
        "or name a file with -o"
    )


def _read(
    run: RunFolder, channel: str, field: str, from_s: float | None, to_s: float | None
) -> list[Curve]:
    columns = run.columns(channel)
    if all(column.name.partition("[")[0] != "utime" for column in columns):
        raise LogError(f"{channel} has no utime: it cannot be drawn over time")
    # One element of an array of varying size: frames[2].id is frames.id where frames.index is 2.
    member, element = field, None
    arrays = {column.member for column in columns if column.repeated}
    if (match := re.match(r"(\w+)\[(\d+)\](.*)$", field)) and match[1] in arrays:
        member, element = match[1] + match[3], int(match[2])
    chosen = [column for column in run.columns(channel, [member]) if not column.is_index]
    chosen = chosen or run.columns(channel, [member])
    texts = [column.name for column in chosen if column.dtype is None]
    if texts:
        raise LogError(f"{channel}.{texts[0]} is text: it cannot be drawn")
    names = ["utime", *(column.name for column in chosen)]
    if element is not None:
        names.append(f"{chosen[0].member}.{INDEX}")
    table = run.read(channel, names, from_s, to_s)
    rows = np.ones(len(table), dtype=bool)
    if element is not None:
        rows = table[names[-1]] == element
        if not rows.any():
            raise LogError(f"{channel}.{field}: no message has that many elements in this time")
    time_s = table["utime"][rows] / 1e6
    return [
        Curve(
            f"{channel}.{_with_element(column.name, column.member, element)}",
            column.unit,
            time_s,
            table[column.name][rows].astype(float),
        )
        for column in chosen
    ]


def _with_element(name: str, member: str, element: int | None) -> str:
    return name if element is None else f"{member}[{element}]{name.removeprefix(member)}"


def _thinned(time_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most two points per bucket, so that a peak of one sample stays to be seen."""
    if values.size <= 2 * BUCKETS:
        return time_s, values
    size = -(-values.size // BUCKETS)
    starts = np.arange(0, values.size, size)
    filled = np.pad(values, (0, starts.size * size - values.size), mode="edge")
    buckets = np.where(np.isnan(filled), 0.0, filled).reshape(-1, size)
    least, most = starts + buckets.argmin(axis=1), starts + buckets.argmax(axis=1)
    rows = np.unique(np.minimum(np.concatenate([least, most]), values.size - 1))
    return time_s[rows], values[rows]
