"""`./rig log export --to mcap`: all channels in one file, for Foxglove, PlotJuggler and the like.

Messages are JSON with a JSON schema, which both read without a plug-in and which carries unit and
comment of each field; zstd takes away most of what JSON costs in size. Messages keep the order of
the log and are stamped with the run clock; they are read and written some thousand at a time.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from mcap.writer import CompressionType, Writer

from hpmc.lcm_log import LcmLog, LogError
from hpmc.lcm_types import NUMPY_CODE, LcmType, Member, nested_type
from hpmc.log_columns import columns_of, read_messages
from hpmc.log_export import Progress, Selection
from hpmc.run_folder import CHUNK_MESSAGES, RunFolder

CHUNK_BYTES = 4 << 20
_JSON_KINDS = {"float": "number", "double": "number", "boolean": "boolean"}


def json_schema(lcm_type: LcmType) -> dict[str, Any]:
    """The JSON schema of a type: fields in order, with comment and unit."""
    return {
        "title": f"hpmc.{lcm_type.name}",
        "description": lcm_type.comment,
        **_struct_schema(lcm_type),
    }


def write_mcap(run: RunFolder, selection: Selection, file: Path, progress: Progress) -> None:
    """Writes one MCAP file. Raises OSError."""
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="", library="hpmc")
        ids: dict[str, int] = {}
        schemas: dict[str, int] = {}
        for channel in selection.channels:
            lcm_type = run.type_of(channel)
            assert lcm_type is not None
            if lcm_type.name not in schemas:
                schemas[lcm_type.name] = writer.register_schema(
                    name=f"hpmc.{lcm_type.name}",
                    encoding="jsonschema",
                    data=json.dumps(json_schema(lcm_type)).encode(),
                )
            units = {column.name: column.unit for column in columns_of(lcm_type)}
            ids[channel] = writer.register_channel(
                topic=channel,
                message_encoding="json",
                schema_id=schemas[lcm_type.name],
                metadata={"lcm_type": lcm_type.name, "units": json.dumps(units)},
            )
        if run.info is not None:
            info = {key: str(value) for key, value in run.info.items() if key != "config_toml"}
            writer.add_metadata("run_info", info)
        if run.config_toml:
            writer.add_attachment(
                create_time=0, log_time=0, name="config.toml", media_type="application/toml",
                data=run.config_toml.encode(),
            )  # fmt: skip
        for log in run.logs:
            _write_log(run, log, selection, writer, ids, progress)
        writer.finish()


def _write_log(
    run: RunFolder,
    log: LcmLog,
    selection: Selection,
    writer: Writer,
    ids: dict[str, int],
    progress: Progress,
) -> None:
    names = [channel for channel in ids if log.count(channel)]
    rows = {name: run.rows(log, name, selection.from_s, selection.to_s) for name in names}
    places = np.concatenate([log.event_places(name)[rows[name]] for name in names])
    owner = np.repeat(np.arange(len(names)), [rows[name].size for name in names])
    owner = owner[np.argsort(places, kind="stable")]
    done = dict.fromkeys(names, 0)
    for start in range(0, owner.size, CHUNK_MESSAGES):
        part = owner[start : start + CHUNK_MESSAGES]
        messages: dict[int, Iterator[tuple[int, int, bytes]]] = {}
        for number in np.unique(part).tolist():
            name = names[number]
            end = done[name] + int((part == number).sum())
            messages[number] = _encoded(log, name, rows[name][done[name] : end])
            done[name] = end
        for number in part.tolist():
            time_ns, sequence, data = next(messages[number])
            writer.add_message(
                channel_id=ids[names[number]],
                log_time=time_ns,
                publish_time=time_ns,
                sequence=sequence,
                data=data,
            )
        progress(log.path.name, part.size)


def _encoded(log: LcmLog, channel: str, rows: np.ndarray) -> Iterator[tuple[int, int, bytes]]:
    """Time stamp, sequence number and JSON of each message."""
    for message in read_messages(log, channel, rows):
        if message["utime"] < 0:
            raise LogError(f"{log.path}: {channel} has a negative utime")
        yield message["utime"] * 1000, message["seq"] & 0xFFFFFFFF, orjson.dumps(message)


def _struct_schema(lcm_type: LcmType) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": {member.name: _member_schema(member) for member in lcm_type.members},
    }


def _member_schema(member: Member) -> dict[str, Any]:
    if member.type_name == "string":
        schema: dict[str, Any] = {"type": "string"}
    elif member.type_name in NUMPY_CODE:
        schema = {"type": _JSON_KINDS.get(member.type_name, "integer")}
    else:
        schema = _struct_schema(nested_type(member))
    for size in reversed(member.dimensions):
        schema = {"type": "array", "items": schema}
        if size.isdigit():
            schema |= {"minItems": int(size), "maxItems": int(size)}
    described = {"description": member.comment} if member.comment else {}
    return schema | described | ({"unit": member.unit} if member.unit else {})
