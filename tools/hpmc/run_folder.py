"""Opens what a run left behind: its logs as one, its configuration, its summary.

A run is a folder made by `./rig run` (several logs with --jobs: one after the other on the run
clock) or any LCM event log, also one of lcm-logger. Damage is reported and the rest is read.
"""

import json
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hpmc.lcm_log import LcmLog, LogError
from hpmc.lcm_types import FINGERPRINT_BYTES, LcmType, LcmTypeError
from hpmc.log_columns import Column, columns_of, read_columns, select

CHUNK_MESSAGES = 20_000
_UTIME = np.dtype([("fingerprint", ">u8"), ("utime", ">i8"), ("seq", ">i8")])


@dataclass(frozen=True)
class Table:
    """Rows of some columns of a channel."""

    columns: tuple[Column, ...]
    values: tuple[np.ndarray, ...]  # one array per column, all of one length

    def __len__(self) -> int:
        return self.values[0].size if self.values else 0

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[[column.name for column in self.columns].index(name)]


class RunFolder:
    """The logs of one run, joined, and the files beside them. Raises LogError for what is no run.

    `problems` says in one line each what could not be read.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.problems: list[str] = []
        self.logs: list[LcmLog] = []
        if self.path.is_dir():
            files = sorted(self.path.glob("run*.lcmlog"))
            if not files:
                raise LogError(f"{self.path} is no run: it holds no run*.lcmlog")
        else:
            files = [self.path]
        for file in files:
            try:
                self.logs.append(LcmLog(file, tolerant=True))
            except LogError as error:
                self.problems.append(str(error))
        if not self.logs:
            raise LogError(self.problems[0])
        for log in self.logs:
            self.problems += [
                f"{log.path}: {damage.length} bytes at {damage.offset} hold no whole message"
                for damage in log.damage
            ]
        self.logs.sort(key=self._begin_us)

    @property
    def folder(self) -> Path:
        """Where the files of the run are."""
        return self.path if self.path.is_dir() else self.path.parent

    @cached_property
    def channels(self) -> list[str]:
        """Names of the channels, sorted."""
        return sorted({channel for log in self.logs for channel in log.channels})

    def count(self, channel: str) -> int:
        """Messages of a channel in all logs."""
        return sum(log.count(channel) for log in self.logs)

    def type_of(self, channel: str) -> LcmType | None:
        """None where the channel has no .lcm file here, or was written with another version."""
        types = [log.known_type(channel) for log in self._with(channel)]
        return types[0] if all(types) else None

    def columns(self, channel: str, fields: Sequence[str] = ()) -> list[Column]:
        """The columns of a channel; only `fields` (names, or whole arrays) where given."""
        lcm_type = self.type_of(channel)
        if lcm_type is None:
            raise LogError(
                f"{self.path}: {channel} has no message type in lcm_types, or another version of it"
            )
        try:
            columns = columns_of(lcm_type)
        except LcmTypeError as error:
            raise LogError(str(error)) from None
        return select(columns, fields, channel) if fields else list(columns)

    def utime_us(self, channel: str) -> np.ndarray:
        """Run clock of all messages of a channel, in the order of the logs."""
        return np.concatenate([self._head(log, channel, "utime") for log in self._with(channel)])

    def column(self, channel: str, field: str) -> np.ndarray:
        """A field of all messages of a fixed-size channel; arrays keep their shape."""
        return np.concatenate([log.column(channel, field) for log in self._with(channel)])

    def read(
        self,
        channel: str,
        fields: Sequence[str] = (),
        from_s: float | None = None,
        to_s: float | None = None,
    ) -> Table:
        """A channel as columns, from_s <= run clock <= to_s."""
        columns = tuple(self.columns(channel, fields))
        parts = [table.values for table in self.chunks(channel, columns, from_s, to_s)]
        return Table(columns, tuple(np.concatenate(column) for column in zip(*parts, strict=True)))

    def chunks(
        self,
        channel: str,
        columns: Sequence[Column],
        from_s: float | None = None,
        to_s: float | None = None,
        size: int = CHUNK_MESSAGES,
    ) -> Iterator[Table]:
        """The same, `size` messages at a time, so that a log may be larger than memory.

        There is always one chunk, empty where nothing is in the range.
        """
        given = False
        for log in self._with(channel):
            rows = self.rows(log, channel, from_s, to_s)
            for start in range(0, rows.size, size):
                part = rows[start : start + size]
                yield Table(tuple(columns), tuple(read_columns(log, channel, columns, part)))
                given = True
        if not given:
            log, none = self._with(channel)[0], np.zeros(0, dtype=np.int64)
            yield Table(tuple(columns), tuple(read_columns(log, channel, columns, none)))

    def rows(
        self, log: LcmLog, channel: str, from_s: float | None, to_s: float | None
    ) -> np.ndarray:
        """Numbers of the messages of one log that lie in a range of the run clock."""
        if from_s is None and to_s is None:
            return np.arange(log.count(channel))
        utime = self._head(log, channel, "utime")
        inside = np.ones(utime.size, dtype=bool)
        if from_s is not None:
            inside &= utime >= round(from_s * 1e6)
        if to_s is not None:
            inside &= utime <= round(to_s * 1e6)
        return np.flatnonzero(inside)

    def messages(self, channel: str) -> Iterator[dict[str, Any]]:
        """Decodes a channel message by message."""
        for log in self._with(channel):
            yield from log.messages(channel)

    @cached_property
    def info(self) -> dict[str, Any] | None:
        """The first RUN_INFO; None where the logs have none that can be read."""
        if "RUN_INFO" not in self.channels or self.type_of("RUN_INFO") is None:
            return None
        return next(self.messages("RUN_INFO"))

    @cached_property
    def config_toml(self) -> str | None:
        """The configuration of the run: of the logs, else of config.toml beside them."""
        if self.info is not None:
            return str(self.info["config_toml"])
        file = self.path / "config.toml"
        return file.read_text(errors="replace") if file.is_file() else None

    @cached_property
    def config(self) -> dict[str, Any]:
        """The same as values; empty where there is none, or a damaged one."""
        try:
            return tomllib.loads(self.config_toml or "")
        except tomllib.TOMLDecodeError as error:
            self.problems.append(f"the configuration of {self.path} cannot be read: {error}")
            return {}

    @cached_property
    def summary(self) -> dict[str, Any] | None:
        """summary.json of a run that ended well; None otherwise, and for a single log."""
        file = self.path / "summary.json"
        if not file.is_file():
            return None
        try:
            summary: dict[str, Any] = json.loads(file.read_text())
        except ValueError as error:
            self.problems.append(f"{file} cannot be read: {error}")
            return None
        return summary

    def _with(self, channel: str) -> list[LcmLog]:
        logs = [log for log in self.logs if log.count(channel)]
        if not logs:
            raise LogError(f"{self.path} has no {channel} (it has {', '.join(self.channels)})")
        return logs

    def _head(self, log: LcmLog, channel: str, field: str) -> np.ndarray:
        """utime or seq, with which every type begins."""
        lcm_type = log.known_type(channel)
        if lcm_type is None or [m.name for m in lcm_type.members[:2]] != ["utime", "seq"]:
            raise LogError(f"{log.path}: {channel} has no {field} that is known here")
        offsets, lengths = log.message_places(channel)
        if np.any(lengths < FINGERPRINT_BYTES + 16):
            raise LogError(f"{log.path}: a {channel} message is too short")
        return log.at_offsets(offsets, _UTIME)[field].astype(np.int64)

    def seq_of(self, log: LcmLog, channel: str) -> np.ndarray:
        """Sequence numbers of a channel in one log (each job of a run counts for itself)."""
        return self._head(log, channel, "seq")

    def utime_of(self, log: LcmLog, channel: str) -> np.ndarray:
        """Run clock of a channel in one log, us."""
        return self._head(log, channel, "utime")

    @staticmethod
    def _begin_us(log: LcmLog) -> int:
        return min((int(log.timestamps_us(channel)[0]) for channel in log.channels), default=0)
