"""`./rig log info`: what a log holds, how regular it is, and what is missing from it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hpmc.lcm_log import LcmLog
from hpmc.lcm_types import LcmTypeError, load_type, type_of_channel
from hpmc.run_folder import RunFolder

GAPS_SHOWN = 8  # per channel


@dataclass(frozen=True)
class Rhythm:
    """Intervals between messages that follow each other by sequence number."""

    rate_hz: float
    interval_ms: float  # mean
    jitter_std_us: float
    jitter_max_us: float  # largest distance of an interval from their median


@dataclass(frozen=True)
class Gap:
    """Messages that a log should have and has not."""

    log: str  # name of the file
    after_seq: int
    missing: int
    at_s: float  # run clock of the last message before


@dataclass(frozen=True)
class ChannelFacts:
    """One channel of all logs of a run."""

    channel: str
    type_name: str | None  # None: no .lcm file of it here, or another version of it (see `note`)
    note: str
    messages: int
    bytes: int
    from_s: float | None
    to_s: float | None
    rhythm: Rhythm | None  # by the run clock; by the logger's time stamps without a known type
    logger_rhythm: Rhythm | None  # by the logger's time stamps, where they are not the run clock
    lost: int | None
    not_growing: int | None  # messages whose sequence number is not above the one before
    gaps: tuple[Gap, ...]


@dataclass(frozen=True)
class RunDescription:
    """All that `./rig log info` says."""

    path: str
    files: dict[str, int]  # name: bytes
    messages: int
    duration_s: float
    channels: tuple[ChannelFacts, ...]
    problems: tuple[str, ...]  # damage, files that cannot be read
    info: dict[str, Any] | None  # RUN_INFO without the configuration
    config: dict[str, Any]


def describe(run: RunFolder) -> RunDescription:
    """Reads time and sequence number of every message."""
    channels = tuple(_describe_channel(run, channel) for channel in run.channels)
    begins = [facts.from_s for facts in channels if facts.from_s is not None]
    ends = [facts.to_s for facts in channels if facts.to_s is not None]
    info = {k: v for k, v in run.info.items() if k != "config_toml"} if run.info else None
    config = run.config
    _ = run.summary  # a damaged one is a problem
    return RunDescription(
        path=str(run.path),
        files={log.path.name: log.path.stat().st_size for log in run.logs},
        messages=sum(facts.messages for facts in channels),
        duration_s=max(ends) - min(begins) if begins else 0.0,
        channels=channels,
        problems=tuple(run.problems),
        info=info,
        config=config,
    )


def print_description(description: RunDescription, console: Console) -> None:
    """As text, for a terminal."""
    size_mb = sum(description.files.values()) / 1e6
    console.print(
        Text(
            f"{description.path}: {', '.join(description.files)}, {size_mb:.1f} MB, "
            f"{description.messages} messages, {description.duration_s:.3f} s"
        ),
        soft_wrap=True,
    )
    if info := description.info:
        console.print(Text(f"mode {info['mode']}, seed {info['seed']}"), soft_wrap=True)
        console.print(
            Text(f"sources {info['git'] or '-'}, protocol {info['protocol_hash'] or '-'}"),
            soft_wrap=True,
        )
        console.print(Text(f"{info['build'] or '-'}; {info['libm'] or '-'}"), soft_wrap=True)
    console.print(_channel_table(description))
    for facts in description.channels:
        _print_gaps(facts, console)
    for problem in description.problems:
        console.print(Text(problem, style="yellow"), soft_wrap=True)
    if description.config:
        console.print(Text("configuration", style="bold"))
        for section, values in description.config.items():
            items = values.items() if isinstance(values, dict) else [("", values)]
            text = "  ".join(f"{key}={value}" for key, value in items)
            console.print(Text(f"  {section}: {text}"), soft_wrap=True)


def _channel_table(description: RunDescription) -> Table:
    table = Table(box=box.HORIZONTALS, pad_edge=False)
    table.add_column("channel", no_wrap=True)
    for head in ("messages", "rate,\nHz", "interval,\nms", "jitter, us\nstd / most",
                 "lost", "from,\ns", "to,\ns"):  # fmt: skip
        table.add_column(head, justify="right", no_wrap=True)
    for facts in description.channels:
        table.add_row(
            facts.channel,
            str(facts.messages),
            *_rhythm_text(facts.rhythm),
            "-" if facts.lost is None else Text(str(facts.lost), "red" if facts.lost else ""),
            "-" if facts.from_s is None else f"{facts.from_s:.3f}",
            "-" if facts.to_s is None else f"{facts.to_s:.3f}",
        )
        if facts.logger_rhythm:
            table.add_row("  as logged", "", *_rhythm_text(facts.logger_rhythm), style="dim")
    return table


def _rhythm_text(rhythm: Rhythm | None) -> tuple[str, str, str]:
    if rhythm is None:
        return "-", "-", "-"
    return (
        f"{rhythm.rate_hz:.2f}",
        f"{rhythm.interval_ms:.3f}",
        f"{rhythm.jitter_std_us:.0f} / {rhythm.jitter_max_us:.0f}",
    )


def _print_gaps(facts: ChannelFacts, console: Console) -> None:
    if facts.note:
        console.print(Text(f"{facts.channel}: {facts.note}", style="yellow"), soft_wrap=True)
    if facts.not_growing:
        console.print(
            Text(
                f"{facts.channel}: the sequence number does not grow {facts.not_growing} times "
                "(a message twice, or several runs in one log)",
                style="yellow",
            ),
            soft_wrap=True,
        )
    for gap in facts.gaps[:GAPS_SHOWN]:
        console.print(
            Text(
                f"{facts.channel}: {gap.missing} lost after number {gap.after_seq}, "
                f"{gap.at_s:.3f} s ({gap.log})",
                style="red",
            ),
            soft_wrap=True,
        )
    if more := facts.gaps[GAPS_SHOWN:]:
        missing = sum(gap.missing for gap in more)
        console.print(Text(f"{facts.channel}: {missing} more lost in {len(more)} gaps", "red"))


def _describe_channel(run: RunFolder, channel: str) -> ChannelFacts:
    logs = [log for log in run.logs if log.count(channel)]
    lcm_type = run.type_of(channel)
    timed = lcm_type is not None and [m.name for m in lcm_type.members[:2]] == ["utime", "seq"]
    stamps = [log.timestamps_us(channel) for log in logs]
    seqs = [run.seq_of(log, channel) for log in logs] if timed else None
    utimes = [run.utime_of(log, channel) for log in logs] if timed else None
    gaps: list[Gap] = []
    not_growing = 0
    if seqs is not None and utimes is not None:
        for log, seq, utime in zip(logs, seqs, utimes, strict=True):
            steps = np.diff(seq)
            not_growing += int((steps <= 0).sum())
            gaps += [
                Gap(log.path.name, int(seq[i]), int(steps[i]) - 1, float(utime[i]) / 1e6)
                for i in np.flatnonzero(steps > 1)
            ]
    as_logged = utimes is not None and not all(
        np.array_equal(stamp, utime) for stamp, utime in zip(stamps, utimes, strict=True)
    )
    return ChannelFacts(
        channel=channel,
        type_name=lcm_type.name if lcm_type else None,
        note="" if lcm_type else _why_unknown(logs[0], channel),
        messages=run.count(channel),
        bytes=sum(log.size(channel) for log in logs),
        from_s=float(min(utime.min() for utime in utimes)) / 1e6 if utimes else None,
        to_s=float(max(utime.max() for utime in utimes)) / 1e6 if utimes else None,
        rhythm=_rhythm(utimes or stamps, seqs),
        logger_rhythm=_rhythm(stamps, seqs) if as_logged else None,
        lost=sum(gap.missing for gap in gaps) if timed else None,
        not_growing=not_growing if timed else None,
        gaps=tuple(gaps),
    )


def _why_unknown(log: LcmLog, channel: str) -> str:
    name = type_of_channel(channel)
    try:
        load_type(name)
    except LcmTypeError:
        return f"no {name}.lcm here: its fields cannot be read"
    return f"{log.path.name} was written with another {name}.lcm: its fields cannot be read"


def _rhythm(times_us: list[np.ndarray], seqs: list[np.ndarray] | None) -> Rhythm | None:
    parts = []
    for number, time in enumerate(times_us):
        step = np.diff(time)
        parts.append(step[np.diff(seqs[number]) == 1] if seqs is not None else step)
    steps = np.concatenate(parts)
    if steps.size == 0 or steps.mean() <= 0:
        return None
    return Rhythm(
        rate_hz=1e6 / float(steps.mean()),
        interval_ms=float(steps.mean()) * 1e-3,
        jitter_std_us=float(steps.std()),
        jitter_max_us=float(np.abs(steps - np.median(steps)).max()),
    )
