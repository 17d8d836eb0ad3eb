"""`./rig log show`: messages as a table of aligned columns, or as CSV."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TextIO

import numpy as np

from hpmc.log_columns import Column
from hpmc.run_folder import RunFolder, Table

TIME_HEAD = "time (s)"
DIGITS = 9  # in the table; CSV has all
GAP = "  "


@dataclass(frozen=True)
class Rows:
    """What of a run is shown."""

    channel: str
    fields: Sequence[str] = ()  # all where empty
    from_s: float | None = None
    to_s: float | None = None
    every: int = 1


def write_table(run: RunFolder, rows: Rows, out: TextIO) -> None:
    """Aligned columns, the run clock in s first; each `every`-th row."""
    columns = _columns(run, rows)
    heads = [TIME_HEAD, *(column.head for column in columns[1:])]
    widths: list[int] = []
    for table in _every(run, rows, columns):
        cells = [_cells(values) for values in table.values[1:]]
        cells.insert(0, [f"{time / 1e6:.6f}" for time in table.values[0].tolist()])
        if not widths:
            widths = [
                max(len(head), *(len(cell) for cell in column), 1)
                for head, column in zip(heads, cells, strict=True)
            ]
            out.write(_line(heads, widths))
        out.writelines(_line(row, widths) for row in zip(*cells, strict=True))


def write_csv(run: RunFolder, rows: Rows, out: TextIO) -> None:
    """The same as CSV, every number in full."""
    columns = _columns(run, rows)
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([TIME_HEAD, *(column.head for column in columns[1:])])
    for table in _every(run, rows, columns):
        cells = [_plain(values) for values in table.values[1:]]
        writer.writerows(zip((table.values[0] / 1e6).tolist(), *cells, strict=True))


def _columns(run: RunFolder, rows: Rows) -> list[Column]:
    """utime, for the time in front, and what was asked for; utime itself is not shown twice."""
    (utime,) = run.columns(rows.channel, ["utime"])
    columns = run.columns(rows.channel, rows.fields)
    return [utime, *(column for column in columns if column.name != "utime" or rows.fields)]


def _every(run: RunFolder, rows: Rows, columns: Sequence[Column]) -> Iterator[Table]:
    offset = 0
    for table in run.chunks(rows.channel, columns, rows.from_s, rows.to_s):
        first = -offset % rows.every
        offset += len(table)
        yield Table(table.columns, tuple(values[first :: rows.every] for values in table.values))


def _cells(values: np.ndarray) -> list[str]:
    if values.dtype.kind == "f":
        return [f"{value:.{DIGITS}g}" for value in values.tolist()]
    if values.dtype.kind == "O":
        return [repr(value) if _breaks(value) else value for value in values.tolist()]
    return [str(int(value)) for value in values.tolist()]


def _plain(values: np.ndarray) -> list[object]:
    return (values.astype(np.int8) if values.dtype.kind == "b" else values).tolist()


def _breaks(text: str) -> bool:
    """Whether a text would break the line that it stands in."""
    return any(not character.isprintable() for character in text)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    line = GAP.join(cell.rjust(width) for cell, width in zip(cells, widths, strict=True))
    return line.rstrip() + "\n"
