"""`./rig log export` to CSV, Parquet and MAT: tables of a run with their units.

A channel is read, converted and written some thousand messages at a time; only MAT, whose format
wants it so, holds one channel (not the log) in memory. Files appear whole or not at all.
"""

import contextlib
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hpmc.lcm_log import LogError
from hpmc.lcm_types import LcmTypeError
from hpmc.log_columns import Column, columns_of
from hpmc.run_folder import RunFolder, Table

FORMATS = ("csv", "parquet", "mat", "mcap")
MAT_LIMIT_BYTES = (1 << 31) - (1 << 20)  # of one variable in a MAT file of version 5

Progress = Callable[[str, int], None]  # what is being written, how many messages more are done


@dataclass(frozen=True)
class Selection:
    """What of a run is exported."""

    channels: Sequence[str]
    from_s: float | None = None
    to_s: float | None = None


def exportable(run: RunFolder, channels: Sequence[str]) -> tuple[list[str], list[str]]:
    """The channels that can be exported (all, or those named), and a line for each that cannot.

    Raises LogError when a channel that was asked for by name cannot be exported.
    """
    able, unable = [], []
    for channel in channels or run.channels:
        try:
            if not run.count(channel):
                raise LogError(
                    f"{run.path} has no {channel} (it has {', '.join(run.channels)})"
                )
            lcm_type = run.type_of(channel)
            if lcm_type is None:
                raise LogError(f"{channel}: no message type in lcm_types, or another version of it")
            columns_of(lcm_type)
        except (LogError, LcmTypeError) as error:
            if channels:
                raise LogError(str(error)) from None
            unable.append(f"left out: {error}")
        else:
            able.append(channel)
    if not able:
        raise LogError(f"{run.path}: no channel has a message type in lcm_types")
    return able, unable


def export(
    run: RunFolder, to: str, selection: Selection, folder: Path, progress: Progress
) -> list[Path]:
    """Writes the files of one format into `folder` and returns them. Raises LogError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if to == "mcap":
            from hpmc.log_mcap import write_mcap

            with whole_file(folder / "run.mcap") as (file, partial):
                write_mcap(run, selection, partial, progress)
            return [file]
        if to == "mat":
            with whole_file(folder / "run.mat") as (file, partial):
                write_mat(run, selection, partial, progress)
            return [file]
        files = []
        for channel in selection.channels:
            with whole_file(folder / f"{channel}.{to}") as (file, partial):
                {"csv": write_csv, "parquet": write_parquet}[to](
                    run, channel, selection, partial, progress
                )
            files.append(file)
        return files
    except OSError as error:
        raise LogError(f"{folder}: cannot be written: {error.strerror or error}") from None


@contextlib.contextmanager
def whole_file(file: Path) -> Iterator[tuple[Path, Path]]:
    """The name of a file and one to write to meanwhile, which goes away if that fails."""
    partial = file.with_name(file.name + ".partial")
    try:
        yield file, partial
        partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)


def write_csv(
    run: RunFolder, channel: str, selection: Selection, file: Path, progress: Progress
) -> None:
    """One head line, `name (unit)`; numbers in full, so that they are read back to the last bit."""
    from pyarrow import csv

    columns = run.columns(channel)
    schema = _schema(run, channel, columns, heads=True)
    with csv.CSVWriter(str(file), schema) as writer:
        for table in _chunks(run, channel, columns, selection, progress):
            writer.write_batch(_batch(table, schema))


def write_parquet(
    run: RunFolder, channel: str, selection: Selection, file: Path, progress: Progress
) -> None:
    """One column per number; unit and description in its metadata, the run's in the schema's."""
    from pyarrow import parquet

    columns = run.columns(channel)
    schema = _schema(run, channel, columns, heads=False)
    with parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for table in _chunks(run, channel, columns, selection, progress):
            writer.write_batch(_batch(table, schema))


def write_mat(run: RunFolder, selection: Selection, file: Path, progress: Progress) -> None:
    """MATLAB 5: a struct per channel, arrays as N x 3 and N x 3 x 2; `units` and `run` beside."""
    from scipy.io import savemat

    def save(stream: Any, content: dict[str, Any]) -> None:  # noqa: ANN401
        savemat(stream, content, long_field_names=True, oned_as="column")

    units: dict[str, dict[str, str]] = {}
    with file.open("wb") as stream:
        for channel in selection.channels:
            columns = run.columns(channel)
            parts = list(_chunks(run, channel, columns, selection, progress))
            content = dict(_arrays(columns, parts))
            size = sum(values.nbytes for values in content.values())
            if size > MAT_LIMIT_BYTES:
                raise LogError(
                    f"{channel}: {size / 1e9:.1f} GB do not fit into a MAT file (2.1 GB per "
                    "channel); take a part with --from and --until, or parquet"
                )
            del parts
            save(stream, {channel: content})
            units[channel] = {_base(c.name): c.unit for c in columns}
        save(stream, {"units": units, "run": _run_texts(run)})


def _base(name: str) -> str:
    """The array that a column is of, as MATLAB can name it: frames.data[3] -> frames_data."""
    return re.sub(r"\[\d+\]", "", name).replace(".", "_")


def _arrays(
    columns: Sequence[Column], parts: Sequence[Table]
) -> Iterator[tuple[str, np.ndarray]]:
    for base in dict.fromkeys(_base(column.name) for column in columns):
        numbers = [i for i, column in enumerate(columns) if _base(column.name) == base]
        last = re.findall(r"\[(\d+)\]", columns[numbers[-1]].name)
        shape = [int(index) + 1 for index in last]
        joined = [np.concatenate([part.values[i] for part in parts]) for i in numbers]
        yield base, np.stack(joined, axis=-1).reshape(-1, *shape) if shape else joined[0]


def _chunks(
    run: RunFolder,
    channel: str,
    columns: Sequence[Column],
    selection: Selection,
    progress: Progress,
) -> Iterator[Table]:
    for table in run.chunks(channel, columns, selection.from_s, selection.to_s):
        yield table
        progress(channel, len(table))


def _schema(run: RunFolder, channel: str, columns: Sequence[Column], *, heads: bool) -> Any:  # noqa: ANN401
    import pyarrow as pa

    lcm_type = run.type_of(channel)
    assert lcm_type is not None
    fields = []
    for column in columns:
        kind = pa.string()
        if column.dtype is not None:
            kind = pa.from_numpy_dtype(column.dtype.newbyteorder("="))
        if heads and kind == pa.bool_():
            kind = pa.int8()  # 0 and 1 are read as numbers by everything
        fields.append(
            pa.field(
                column.head if heads else column.name,
                kind,
                nullable=False,
                metadata={"unit": column.unit, "description": column.comment},
            )
        )
    return pa.schema(
        fields,
        metadata={
            "channel": channel,
            "type": lcm_type.name,
            "description": lcm_type.comment,
            "units": json.dumps({column.name: column.unit for column in columns}),
            **_run_texts(run),
        },
    )


def _batch(table: Table, schema: Any) -> Any:  # noqa: ANN401
    import pyarrow as pa

    arrays = []
    for values, kind in zip(table.values, schema.types, strict=True):
        if values.dtype.kind == "b" and kind == pa.int8():
            values = values.astype(np.int8)
        arrays.append(pa.array(values, type=kind))
    return pa.record_batch(arrays, schema=schema)


def _run_texts(run: RunFolder) -> dict[str, str]:
    """RUN_INFO as text."""
    info = {k: str(v) for k, v in (run.info or {}).items() if k not in ("utime", "seq")}
    return info or {"config_toml": run.config_toml or ""}
