"""`./rig log diff`: where two runs differ first, by how much at most, and their metrics.

Messages are paired by channel and run clock. Every field of every channel counts, but for RUN_INFO:
mode, seed, versions and configuration are shown beside each other and not judged, so that the same
movement in `sil` and `vcan` is the same.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hpmc.lcm_log import LogError
from hpmc.log_columns import Column
from hpmc.run_folder import RunFolder

DESCRIBED = "RUN_INFO"
SAME_TIME = 1 << 16  # rows of one channel with one utime, more than there ever are
NOT_COMPARED = ("wall_s", "real_time_factor")  # of summary.json: they say nothing of the movement


@dataclass(frozen=True)
class FieldDifference:
    """One column that differs."""

    channel: str
    name: str
    unit: str
    rows: int  # pairs that differ
    first_s: float
    first: tuple[Any, Any]
    largest: float | None  # None for text
    largest_s: float


@dataclass(frozen=True)
class ChannelDifference:
    """One channel of both runs."""

    channel: str
    pairs: int  # messages compared
    only: tuple[int, int]  # messages that the other run has not
    only_first_s: float | None  # the first of them
    fields: tuple[FieldDifference, ...]
    bytes_differ: bool = False  # of a channel whose type is not known

    @property
    def same(self) -> bool:
        return not (self.fields or any(self.only) or self.bytes_differ)


@dataclass
class RunDifference:
    """All that `./rig log diff` says; `described` and `metrics` are not judged."""

    paths: tuple[str, str]
    channels: list[ChannelDifference] = field(default_factory=list)
    only_channels: tuple[list[str], list[str]] = ((), ())  # type: ignore[assignment]
    described: list[tuple[str, Any, Any]] = field(default_factory=list)
    metrics: list[tuple[str, Any, Any]] = field(default_factory=list)

    @property
    def same(self) -> bool:
        return all(channel.same for channel in self.channels) and not any(self.only_channels)

    @property
    def fields(self) -> list[FieldDifference]:
        return [field for channel in self.channels for field in channel.fields]

    @property
    def first(self) -> FieldDifference | None:
        """The earliest difference of a value; of several at one time, by name of the channel."""
        return min(self.fields, key=lambda f: (f.first_s, f.channel), default=None)


def compare(
    one: RunFolder,
    two: RunFolder,
    channels: Sequence[str] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> RunDifference:
    """Compares all channels, or those named. `tell` hears which one is on. Raises LogError."""
    for channel in channels:
        for run in (one, two):
            if not run.count(channel):
                raise LogError(f"{run.path} has no {channel} (it has {', '.join(run.channels)})")
    names = [set(run.channels) & set(channels or run.channels) for run in (one, two)]
    difference = RunDifference((str(one.path), str(two.path)))
    difference.only_channels = (sorted(names[0] - names[1]), sorted(names[1] - names[0]))
    for channel in sorted(names[0] & names[1] - {DESCRIBED}):
        tell(channel)
        difference.channels.append(_compare_channel(one, two, channel))
    difference.described = list(_side_by_side(_description(one), _description(two), differing=True))
    difference.metrics = list(_side_by_side(_metrics(one), _metrics(two), differing=False))
    return difference


def print_difference(difference: RunDifference, console: Console) -> None:
    """As text, for a terminal."""

    def say(text: str, style: str = "") -> None:
        console.print(Text(text, style=style), soft_wrap=True)

    say(f"1: {difference.paths[0]}\n2: {difference.paths[1]}")
    for key, one, two in difference.described:
        say(f"  {key}: {_short(one)} | {_short(two)}")
    for number, only in enumerate(difference.only_channels, 1):
        if only:
            say(f"only in {number}: {', '.join(only)}", "yellow")
    for channel in difference.channels:
        for number, count in enumerate(channel.only, 1):
            if count:
                say(
                    f"{channel.channel}: {count} messages only in {number} "
                    f"(the first without a partner: {channel.only_first_s:.6f} s)",
                    "yellow",
                )
        if channel.bytes_differ:
            say(f"{channel.channel}: its bytes differ; its type is not known here", "yellow")
    if first := difference.first:
        say(
            f"first difference at {first.first_s:.6f} s: {first.channel}.{first.name} "
            f"{_short(first.first[0])} | {_short(first.first[1])} {first.unit}".rstrip(),
            "bold",
        )
        console.print(_field_table(difference))
    if difference.metrics:
        console.print(_metric_table(difference))
    compared = len(difference.channels)
    pairs = sum(channel.pairs for channel in difference.channels)
    verdict = "the same" if difference.same else "different"
    say(f"{verdict}: {compared} channels, {pairs} pairs of messages compared", "bold")


def _compare_channel(one: RunFolder, two: RunFolder, channel: str) -> ChannelDifference:
    if one.type_of(channel) is None or two.type_of(channel) is None:
        return _compare_bytes(one, two, channel)
    columns = one.columns(channel)
    difference = _compare_rows(one, two, channel, [c for c in columns if not c.repeated], [])
    repeated = [column for column in columns if column.repeated]
    if not repeated:
        return difference
    # Elements of an array of varying size are compared beside their messages.
    elements = _compare_rows(one, two, channel, repeated, [c.name for c in repeated if c.is_index])
    return replace(difference, fields=difference.fields + elements.fields)


def _compare_rows(
    one: RunFolder,
    two: RunFolder,
    channel: str,
    columns: Sequence[Column],
    row_giver: Sequence[str],
) -> ChannelDifference:
    """One row per message; with the index of an array as `row_giver`, one per element of it."""
    keys = [_keys(run, channel, row_giver) for run in (one, two)]
    if np.array_equal(keys[0], keys[1]):
        key, rows = keys[0], (slice(None), slice(None))
        alone = np.zeros(0, dtype=np.int64)
    else:
        key, *found = np.intersect1d(keys[0], keys[1], assume_unique=True, return_indices=True)
        rows = (found[0], found[1])
        alone = np.setxor1d(keys[0], keys[1], assume_unique=True)
    time_s = key // SAME_TIME / 1e6
    fields = []
    for column in columns:
        # Column by column, so that no whole channel is held in memory.
        pair = [
            run.read(channel, [column.name, *row_giver])[column.name][where]
            for run, where in zip((one, two), rows, strict=True)
        ]
        if found_difference := _compare_column(channel, column, pair[0], pair[1], time_s):
            fields.append(found_difference)
    return ChannelDifference(
        channel,
        key.size,
        (keys[0].size - key.size, keys[1].size - key.size),
        float(alone.min() // SAME_TIME) / 1e6 if alone.size else None,
        tuple(fields),
    )


def _keys(run: RunFolder, channel: str, row_giver: Sequence[str]) -> np.ndarray:
    """Run clock, and which row of the channel with that time; unique within a run."""
    table = run.read(channel, ["utime", *row_giver])
    utime = table["utime"]
    order = np.argsort(utime, kind="stable")
    ordered = utime[order]
    place = np.arange(ordered.size) - np.searchsorted(ordered, ordered)
    keys = np.empty(utime.size, dtype=np.int64)
    keys[order] = ordered * SAME_TIME + place
    return keys


def _compare_column(
    channel: str, column: Column, one: np.ndarray, two: np.ndarray, time_s: np.ndarray
) -> FieldDifference | None:
    differ = one != two
    if one.dtype.kind == "f":
        differ &= ~(np.isnan(one) & np.isnan(two))
    rows = np.flatnonzero(differ)
    if rows.size == 0:
        return None
    largest, largest_row = None, rows[0]
    if one.dtype.kind != "O":
        distance = np.abs(one[rows].astype(float) - two[rows].astype(float))
        largest_row = rows[np.argmax(np.where(np.isnan(distance), np.inf, distance))]
        largest = float(distance.max())
    first = rows[np.argmin(time_s[rows])]
    return FieldDifference(
        channel=channel,
        name=column.name,
        unit=column.unit,
        rows=int(rows.size),
        first_s=float(time_s[first]),
        first=(one[first], two[first]),
        largest=largest,
        largest_s=float(time_s[largest_row]),
    )


def _compare_bytes(one: RunFolder, two: RunFolder, channel: str) -> ChannelDifference:
    raw = [
        [data for log in run.logs if log.count(channel) for data in log.raw_messages(channel)]
        for run in (one, two)
    ]
    pairs = min(len(raw[0]), len(raw[1]))
    return ChannelDifference(
        channel, pairs, (0, 0), None, (), bytes_differ=raw[0] != raw[1]
    )


def _description(run: RunFolder) -> dict[str, Any]:
    info = {k: v for k, v in (run.info or {}).items() if k not in ("utime", "seq", "config_toml")}
    return {**info, **dict(_flat(run.config))}


def _metrics(run: RunFolder) -> dict[str, Any]:
    """Of summary.json; without one, measured here from the whole reaches of the logs."""
    if run.summary is not None:
        flat = dict(_flat(run.summary))
        return {
            key: value
            for key, value in flat.items()
            if isinstance(value, int | float) and key not in NOT_COMPARED
        }
    from hpmc.analysis import analyse_logs
    from hpmc.summary import metric_summary

    try:
        period_s = run.config["experiment"]["period_s"]
        analysis = analyse_logs([log.path for log in run.logs], period_s)
    except (KeyError, LogError):
        return {}
    return dict(_flat(metric_summary(analysis)))


def _flat(values: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for number, entry in enumerate(value, 1):
                yield from _flat(entry, f"{prefix}{key}[{number}].")
        else:
            yield f"{prefix}{key}", value


def _side_by_side(
    one: dict[str, Any], two: dict[str, Any], *, differing: bool
) -> Iterator[tuple[str, Any, Any]]:
    """Keys of both; those per target, and all where `differing`, only if their values differ."""
    for key in dict.fromkeys([*one, *two]):
        pair = (one.get(key), two.get(key))
        if pair[0] != pair[1] or not (differing or key.startswith("targets[")):
            yield (key, *pair)


def _field_table(difference: RunDifference) -> Table:
    table = Table(box=box.HORIZONTALS, pad_edge=False)
    table.add_column("field", no_wrap=True)
    table.add_column("rows that\ndiffer", justify="right")
    table.add_column("first at,\ns", justify="right", no_wrap=True)
    table.add_column("largest\ndifference", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("at,\ns", justify="right", no_wrap=True)
    for entry in difference.fields:
        table.add_row(
            f"{entry.channel}.{entry.name}",
            str(entry.rows),
            f"{entry.first_s:.6f}",
            _largest(entry.largest),
            entry.unit,
            f"{entry.largest_s:.6f}",
        )
    return table


def _largest(value: float | None) -> str:
    if value is None:
        return "text"
    return str(int(value)) if value.is_integer() else f"{value:.4g}"


def _metric_table(difference: RunDifference) -> Table:
    table = Table(box=box.HORIZONTALS, pad_edge=False)
    table.add_column("metric", no_wrap=True)
    for head in ("1", "2", "2 - 1"):
        table.add_column(head, justify="right", no_wrap=True)
    for key, one, two in difference.metrics:
        numbers = isinstance(one, int | float) and isinstance(two, int | float)
        change = two - one if numbers else None
        table.add_row(
            key,
            _short(one),
            _short(two),
            "" if not change else f"{change:+.4g}",
            style="bold" if change else None,
        )
    return table


def _short(value: Any) -> str:  # noqa: ANN401
    if value is None:
        return "-"
    if isinstance(value, float | np.floating):
        return f"{value:.6g}" if abs(value) < 1e6 else f"{value:.9g}"
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
