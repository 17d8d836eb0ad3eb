"""./rig log export, read back by the programs' own libraries and compared value by value."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_log import channel_types, write_every_type

from hpmc import log as log_command
from hpmc import log_mcap
from hpmc.lcm_log import LcmLog
from hpmc.log_export import FORMATS, whole_file
from hpmc.run_folder import RunFolder, Table

CHANNELS = list(channel_types())
UNITS_OF_ARM_STATE = {
    "utime": "us", "seq": "", "q_rad": "rad", "qd_rad_s": "rad/s", "tau_Nm": "N m", "hand_m": "m",
    "hand_m_s": "m/s", "wrench_N": "N",
}  # fmt: skip


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "run.lcmlog"
    write_every_type(path)
    return path


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a short log is written in several pieces, as a long one is."""
    monkeypatch.setattr(RunFolder.chunks, "__defaults__", (None, None, 7))
    monkeypatch.setattr(log_mcap, "CHUNK_MESSAGES", 13)
    monkeypatch.setattr(log_mcap, "CHUNK_BYTES", 2000)


@pytest.fixture(params=["whole", "pieces"])
def exported(request: pytest.FixtureRequest, log: Path, tmp_path: Path) -> Any:
    if request.param == "pieces":
        request.getfixturevalue("small_chunks")

    def export(to: str, *options: str) -> Path:
        arguments = ["export", str(log), "--to", to, "-o", str(tmp_path / "out"), *options]
        assert log_command.main(arguments) == 0
        return tmp_path / "out"

    return export


def messages(log: Path, channel: str) -> list[dict]:
    return [channel_types()[channel].decode(data) for data in LcmLog(log).raw_messages(channel)]


def table(log: Path, channel: str) -> Table:
    """Tested against the decoder in test_log.py."""
    return RunFolder(log).read(channel)


def bits(values: Any) -> Any:
    """To compare also NaN and the sign of zero; all NaN are one."""
    values = np.asarray(values)
    if values.dtype.kind == "f":
        return np.where(np.isnan(values), np.nan, values).view(f"u{values.dtype.itemsize}")
    return values


def test_csv_is_read_by_numpy(log: Path, exported: Any) -> None:
    folder = exported("csv")
    assert sorted(p.name for p in folder.iterdir()) == sorted(f"{c}.csv" for c in CHANNELS)
    for channel in CHANNELS:
        wanted = table(log, channel)
        with (folder / f"{channel}.csv").open(newline="") as file:
            rows = list(csv.reader(file))
        assert rows[0] == [column.head for column in wanted.columns]
        assert len(rows) == len(wanted) + 1
        texts = [i for i, column in enumerate(wanted.columns) if column.dtype is None]
        for i in texts:
            assert [row[i] for row in rows[1:]] == wanted.values[i].tolist()
        for i, column in enumerate(wanted.columns):
            if i in texts or texts:
                continue  # text with line ends is nothing for loadtxt
            values = np.loadtxt(
                folder / f"{channel}.csv", delimiter=",", skiprows=1, usecols=i, ndmin=1,
                dtype=wanted.values[i].dtype if column.dtype.kind != "b" else np.int8,
            )  # fmt: skip
            np.testing.assert_array_equal(bits(values), bits(wanted.values[i]), column.name)
    assert "q_rad[0] (rad)" in (folder / "ARM_STATE.csv").read_text()


def test_parquet_is_read_by_pyarrow(log: Path, exported: Any) -> None:
    from pyarrow import parquet

    folder = exported("parquet")
    for channel in CHANNELS:
        read = parquet.read_table(folder / f"{channel}.parquet")
        wanted = table(log, channel)
        assert read.column_names == [column.name for column in wanted.columns]
        assert read.num_rows == len(wanted)
        for column, values in zip(wanted.columns, wanted.values, strict=True):
            field = read.schema.field(column.name)
            assert field.metadata[b"unit"].decode() == column.unit
            assert field.metadata[b"description"].decode() == column.comment
            if column.dtype is None:
                assert read[column.name].to_pylist() == values.tolist()
            else:
                found = read[column.name].to_numpy()
                assert found.dtype == values.dtype
                np.testing.assert_array_equal(bits(found), bits(values), column.name)
        assert read.schema.metadata[b"channel"].decode() == channel
    units = json.loads(read.schema.metadata[b"units"])
    assert units["tau_Nm"] == "N m"  # of JOINT_TORQUE_2, the last one


def test_mat_is_read_by_scipy(log: Path, exported: Any) -> None:
    from scipy.io import loadmat

    read = loadmat(exported("mat") / "run.mat", simplify_cells=True)
    for channel in CHANNELS:
        lcm_type = channel_types()[channel]
        wanted = messages(log, channel)
        for member in lcm_type.members:
            if member.name == "frames":
                continue
            values = [message[member.name] for message in wanted]
            if lcm_type.name == "can_frames_t":  # one row per frame
                values = np.repeat(values, [message["count"] for message in wanted])
            found = read[channel][member.name]
            if member.type_name == "string":
                assert [str(f) if len(f) else "" for f in found] == values
            else:
                assert found.shape == np.shape(values), member.name
                np.testing.assert_array_equal(bits(found), bits(np.array(values)), member.name)
    assert read["HPMC_STATE"]["x_link_m"].shape == (40, 3, 2)
    frames = [frame for message in messages(log, "CAN_FRAMES") for frame in message["frames"]]
    assert read["CAN_FRAMES"]["frames_data"].tolist() == [frame["data"] for frame in frames]
    assert read["CAN_FRAMES"]["frames_id"].tolist() == [frame["id"] for frame in frames]
    units = {k: v if len(v) else "" for k, v in read["units"]["ARM_STATE"].items()}
    assert units == UNITS_OF_ARM_STATE


def nan_is_null(value: Any) -> Any:
    """What JSON makes of a message."""
    if isinstance(value, dict):
        return {key: nan_is_null(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [nan_is_null(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def test_mcap_is_read_by_its_reader(log: Path, exported: Any) -> None:
    from mcap.reader import make_reader

    wanted = {channel: messages(log, channel) for channel in CHANNELS}
    done = dict.fromkeys(CHANNELS, 0)
    with (exported("mcap") / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            expected = wanted[channel.topic][done[channel.topic]]
            assert json.loads(message.data) == nan_is_null(expected)
            assert message.log_time == message.publish_time == expected["utime"] * 1000
            assert message.sequence == expected["seq"]
            assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
            assert schema.name == f"hpmc.{channel_types()[channel.topic].name}"
            done[channel.topic] += 1
        assert set(done.values()) == {40}
        summary = reader.get_summary()
        assert summary.statistics.message_count == 40 * len(CHANNELS)
        schemas = {s.name: json.loads(s.data) for s in summary.schemas.values()}
        (attachment,) = reader.iter_attachments()
        assert attachment.name == "config.toml"
        assert attachment.data.decode() == wanted["RUN_INFO"][0]["config_toml"]
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata["seed"] == str(wanted["RUN_INFO"][0]["seed"])
    arm = schemas["hpmc.arm_state_t"]["properties"]
    assert {name: p.get("unit", "") for name, p in arm.items()} == UNITS_OF_ARM_STATE
    assert arm["q_rad"]["items"] == {"type": "number"}
    link = schemas["hpmc.hpmc_state_t"]["properties"]["x_link_m"]
    assert (link["minItems"], link["items"]["maxItems"]) == (3, 2)
    frame = schemas["hpmc.can_frames_t"]["properties"]["frames"]["items"]["properties"]
    assert frame["id"] == {"type": "integer", "description": "COB-ID, 0..2047"}
    assert schemas["hpmc.run_info_t"]["properties"]["mode"]["type"] == "string"


def test_mcap_keeps_the_order_of_the_log(log: Path, exported: Any) -> None:
    import lcm
    from mcap.reader import make_reader

    order = [event.channel for event in lcm.EventLog(str(log), "r")]
    with (exported("mcap") / "run.mcap").open("rb") as file:
        found = [c.topic for _, c, _ in make_reader(file).iter_messages(log_time_order=False)]
    assert found == order


@pytest.mark.parametrize("to", FORMATS)
def test_a_channel_and_a_time_are_chosen(log: Path, exported: Any, to: str) -> None:
    options = ("--channel", "JOINT_TORQUE_2", "--from", "0.0095", "--until", "0.012")
    (file,) = exported(to, *options).iterdir()
    seqs = {
        "csv": lambda: np.loadtxt(file, delimiter=",", skiprows=1, usecols=1).tolist(),
        "parquet": lambda: parquet_column(file, "seq"),
        "mat": lambda: loaded(file)["JOINT_TORQUE_2"]["seq"].tolist(),
        "mcap": lambda: [json.loads(m.data)["seq"] for m in mcap_messages(file)],
    }[to]()
    assert seqs == [10, 11, 12]


def parquet_column(file: Path, name: str) -> list[Any]:
    from pyarrow import parquet

    return parquet.read_table(file)[name].to_pylist()


def loaded(file: Path) -> Any:
    from scipy.io import loadmat

    return loadmat(file, simplify_cells=True)


def mcap_messages(file: Path) -> list[Any]:
    from mcap.reader import make_reader

    with file.open("rb") as stream:
        return [message for _, _, message in make_reader(stream).iter_messages()]


@pytest.mark.parametrize("to", FORMATS)
def test_nothing_in_the_time_gives_files_without_rows(exported: Any, to: str) -> None:
    folder = exported(to, "--from", "99")
    assert {file.suffix for file in folder.iterdir()} == {f".{to}"}


def test_channels_without_a_type_are_left_out_and_told(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import lcm

    path = tmp_path / "a.lcmlog"
    copy = lcm.EventLog(str(path), "w", overwrite=True)
    for event in lcm.EventLog(str(log), "r"):
        copy.write_event(event.timestamp, event.channel, event.data)
    copy.write_event(0, "SOMETHING", b"else")
    copy.close()
    assert log_command.main(["export", str(path), "--to", "csv"]) == 0
    assert "left out: SOMETHING" in capsys.readouterr().err
    assert len(list((tmp_path / "a.export").iterdir())) == len(CHANNELS)
    arguments = ["export", str(path), "--to", "csv", "--channel", "SOMETHING"]
    assert log_command.main(arguments) == 2


def test_a_file_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("before")
    with pytest.raises(ZeroDivisionError), whole_file(tmp_path / "a.csv") as (_, partial):
        partial.write_text("half")
        raise ZeroDivisionError
    assert [(f.name, f.read_text()) for f in tmp_path.iterdir()] == [("a.csv", "before")]


def test_no_room_in_a_mat_file_is_told(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("hpmc.log_export.MAT_LIMIT_BYTES", 5000)
    arguments = ["export", str(log), "--to", "mat", "-o", str(tmp_path / "out")]
    assert log_command.main(arguments) == 2
    assert "do not fit into a MAT file" in capsys.readouterr().err
    assert list((tmp_path / "out").iterdir()) == []
