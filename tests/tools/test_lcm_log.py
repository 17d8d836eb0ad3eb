"""The log reader against LCM's own Python code: layouts, fingerprints, values, damaged files."""

import struct
from pathlib import Path

import lcm
import numpy as np
import pytest
from synthetic_log import message_types, write_clock_log

from hpmc.candump import write_candump
from hpmc.lcm_log import Damage, LcmLog, LogError
from hpmc.lcm_types import TYPE_FOLDER, LcmTypeError, load_type, type_of_channel

TYPE_NAMES = sorted(path.stem for path in TYPE_FOLDER.glob("*.lcm"))
EVENT_HEADER_BYTES = 28


@pytest.fixture(scope="module")
def short_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "run.lcmlog"
    write_clock_log(path, reaches=1)
    return path


def write_events(path: Path, events: list[tuple[str, bytes]]) -> None:
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for number, (channel, data) in enumerate(events):
        log.write_event(number, channel, data)
    log.close()


def arm_states(count: int) -> list[tuple[str, bytes]]:
    message = message_types().arm_state_t()
    events = []
    for seq in range(count):
        message.utime, message.seq, message.q_rad = (
            1000 * seq,
            seq,
            [0.1 * seq, -1.0, 2.0],
        )
        events.append(("ARM_STATE", message.encode()))
    return events


def event_bytes(channel: str, data: bytes) -> int:
    return EVENT_HEADER_BYTES + len(channel) + len(data)


@pytest.mark.parametrize("name", TYPE_NAMES)
def test_fingerprint_is_the_one_of_lcm_gen(name: str) -> None:
    generated = getattr(message_types(), name)()
    assert load_type(name).fingerprint == generated.get_hash()


def test_fingerprint_changes_with_a_name_a_type_and_a_size(tmp_path: Path) -> None:
    def fingerprint(members: str) -> int:
        folder = tmp_path / str(abs(hash(members)))
        folder.mkdir()
        (folder / "a_t.lcm").write_text(f"package p; struct a_t {{ {members} }}")
        return load_type("a_t", folder).fingerprint

    layouts = [
        "double x[3];",
        "double y[3];",
        "float x[3];",
        "double x[2];",
        "double x[1][3];",
    ]
    assert len({fingerprint(members) for members in layouts}) == len(layouts)


@pytest.mark.parametrize("name", [name for name in TYPE_NAMES if load_type(name).dtype])
def test_record_holds_the_values_that_lcm_encoded(name: str) -> None:
    generated = getattr(message_types(), name)()
    record_type = load_type(name).dtype
    assert record_type is not None
    for number, field in enumerate(record_type.names or ()):
        shape = record_type[field].shape
        values = (np.arange(np.prod(shape, dtype=int)) - number).reshape(shape)
        if record_type[field].base.kind == "f":
            values = values * 1.25
        elif record_type[field].base.kind == "b":
            values = values % 2 == 1
        is_bytes = isinstance(getattr(generated, field), bytes)
        setattr(
            generated,
            field,
            bytes(values.astype("u1")) if is_bytes else values.tolist(),
        )
    record = np.frombuffer(generated.encode()[8:], record_type)[0]
    for field in record_type.names or ():
        expected = getattr(generated, field)
        expected = list(expected) if isinstance(expected, bytes) else expected
        assert record[field].tolist() == expected, field


def test_an_unreadable_member_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad_t.lcm").write_text("struct bad_t { const int32_t A = 1; double x; }")
    with pytest.raises(LcmTypeError, match="const int32_t A = 1"):
        load_type("bad_t", tmp_path)
    with pytest.raises(LcmTypeError, match=r"missing_t\.lcm"):
        load_type("missing_t", tmp_path)


def test_channels_map_to_types() -> None:
    assert type_of_channel("JOINT_TORQUE_2") == "joint_torque_t"
    assert type_of_channel("HPMC_STATE") == "hpmc_state_t"


def test_log_equals_what_lcm_reads(short_log: Path) -> None:
    log = LcmLog(short_log)
    states = log.read("ARM_STATE")
    wanted = message_types().hpmc_state_t
    x_d_m = log.column("HPMC_STATE", "x_d_m")
    arm_row = hpmc_row = 0
    for event in lcm.EventLog(str(short_log), "r"):
        if event.channel == "ARM_STATE":
            message = message_types().arm_state_t.decode(event.data)
            assert states[arm_row]["utime"] == message.utime
            assert tuple(states[arm_row]["hand_m_s"]) == tuple(message.hand_m_s)
            arm_row += 1
        elif event.channel == "HPMC_STATE":
            assert tuple(x_d_m[hpmc_row]) == tuple(wanted.decode(event.data).x_d_m)
            hpmc_row += 1
    assert (arm_row, hpmc_row) == (log.count("ARM_STATE"), log.count("HPMC_STATE")) == (1040, 1040)
    assert log.damage == []
    assert states.dtype["utime"].isnative
    assert states["hand_m_s"].std() > 0.01
    np.testing.assert_array_equal(log.column("ARM_STATE", "seq", 10, 20), np.arange(10, 20))


def test_run_info_is_decoded(short_log: Path) -> None:
    (info,) = LcmLog(short_log).messages("RUN_INFO")
    assert (info["mode"], info["seed"], info["config_toml"]) == (
        "sil",
        7,
        'name = "clock"\n',
    )
    assert info["git"] == ""


def test_decoder_gives_what_lcm_decodes() -> None:
    types = message_types()
    _, data = can_frames(-5, [(0x181, 1, bytes(range(8))), (0x80, 127, b"")])
    decoded = load_type("can_frames_t").decode(data)
    generated = types.can_frames_t.decode(data)
    assert (decoded["utime"], decoded["seq"], decoded["count"]) == (-5, 0, 2)
    for frame, expected in zip(decoded["frames"], generated.frames, strict=True):
        assert (frame["id"], frame["sender"]) == (expected.id, expected.sender)
        assert bytes(frame["data"]) == bytes(expected.data)
    for length in range(8, len(data)):
        with pytest.raises(LcmTypeError, match="too short"):
            load_type("can_frames_t").decode(data[:length])
    with pytest.raises(LcmTypeError, match="expected"):
        load_type("can_frames_t").decode(data + b"\0")
    with pytest.raises(LcmTypeError, match="no arm_state_t"):
        load_type("arm_state_t").decode(data)


def test_missing_messages_are_counted(tmp_path: Path) -> None:
    events = arm_states(10)
    del events[3], events[5:7]
    write_events(tmp_path / "a.lcmlog", events)
    assert LcmLog(tmp_path / "a.lcmlog").lost("ARM_STATE") == 3


@pytest.mark.parametrize("cut", [1, 27, 28, 100, 180])
def test_a_truncated_tail_is_reported_and_the_rest_read(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "a.lcmlog"
    events = arm_states(5)
    write_events(path, events)
    size = event_bytes(*events[0])
    path.write_bytes(path.read_bytes()[: 4 * size + cut])
    log = LcmLog(path)
    assert log.count("ARM_STATE") == 4
    assert log.damage == [Damage(4 * size, cut)]


def test_damage_in_the_middle_costs_one_event(tmp_path: Path) -> None:
    path = tmp_path / "a.lcmlog"
    events = arm_states(6)
    write_events(path, events)
    size = event_bytes(*events[0])
    content = bytearray(path.read_bytes())
    content[2 * size : 2 * size + 40] = b"\0" * 40  # the header of event 2
    path.write_bytes(content)
    log = LcmLog(path)
    assert log.column("ARM_STATE", "seq").tolist() == [0, 1, 3, 4, 5]
    assert log.damage == [Damage(2 * size, size)]
    # an event that was cut off, and others written after it
    path.write_bytes(bytes(content[: size + 90]) + bytes(content[3 * size :]))
    log = LcmLog(path)
    assert log.column("ARM_STATE", "seq").tolist() == [0, 3, 4, 5]
    assert log.damage == [Damage(size, 90)]


def test_sync_words_inside_a_message_are_data(tmp_path: Path) -> None:
    path = tmp_path / "a.lcmlog"
    whole_event = struct.pack(">IqqII", 0xEDA1DA01, 0, 0, 1, 2) + b"Xab"
    info = message_types().run_info_t()
    events = arm_states(2)
    for hidden in (whole_event, whole_event[:20], b"\xed\xa1\xda\x01" * 20):
        info.config_toml = "?" * len(hidden)
        data = info.encode().replace(b"?" * len(hidden), hidden)
        write_events(path, [events[0], ("RUN_INFO", data), events[1], ("RUN_INFO", data)])
        log = LcmLog(path)
        assert log.channels == ["ARM_STATE", "RUN_INFO"]
        assert list(log.raw_messages("RUN_INFO")) == [data, data]
        assert log.count("ARM_STATE") == 2
        assert log.damage == []


def test_events_on_the_border_of_a_scanned_part_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.lcmlog"
    write_events(path, arm_states(50))
    for part in (1, 2, 3, 5, 61, event_bytes(*arm_states(1)[0])):
        monkeypatch.setattr("hpmc.lcm_log._SCAN_BYTES", part)
        assert LcmLog(path).column("ARM_STATE", "seq").tolist() == list(range(50))


def test_files_that_are_no_log(tmp_path: Path) -> None:
    path = tmp_path / "a.lcmlog"
    with pytest.raises(LogError, match="No such file"):
        LcmLog(path)
    path.write_bytes(b"")
    with pytest.raises(LogError, match="is empty"):
        LcmLog(path)
    for text in (b"x", b"text" * 100, b"\xed\xa1\xda\x01"):
        path.write_bytes(text)
        with pytest.raises(LogError, match="not an LCM log"):
            LcmLog(path)


def test_messages_of_another_version_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.lcmlog"
    channel, data = arm_states(1)[0]
    write_events(path, [(channel, bytes([data[0] ^ 1]) + data[1:])])
    with pytest.raises(LogError, match=r"another arm_state_t\.lcm"):
        LcmLog(path).read("ARM_STATE")
    write_events(path, [(channel, data), (channel, data[:-1])])
    with pytest.raises(LogError, match="size"):
        LcmLog(path).read("ARM_STATE")
    with pytest.raises(LogError, match="has no HPMC_STATE"):
        LcmLog(path).column("HPMC_STATE", "utime")


def can_frames(utime: int, frames: list[tuple[int, int, bytes]]) -> tuple[str, bytes]:
    types = message_types()
    message = types.can_frames_t()
    message.utime, message.count = utime, len(frames)
    for cob_id, sender, data in frames:
        frame = types.can_frame_t()
        frame.id, frame.sender, frame.len = cob_id, sender, len(data)
        frame.data = data.ljust(8, b"\0")
        message.frames.append(frame)
    return "CAN_FRAMES", message.encode()


def test_candump_lines_carry_the_tick_in_which_a_frame_was_sent(tmp_path: Path) -> None:
    reply = bytes.fromhex("00112233445566ff")
    write_events(
        tmp_path / "a.lcmlog",
        [
            can_frames(999_000, [(0x000, 0, b"\x81\x00")]),
            can_frames(1_000_000, []),
            can_frames(
                1_001_000,
                [
                    (0x181, 1, reply),
                    (0x700 + 3, 3, b"\x05"),
                    (0x501, 127, reply),
                    (0x80, 0, b""),
                ],
            ),
        ],
    )
    count = write_candump([LcmLog(tmp_path / "a.lcmlog")], tmp_path / "candump.log")
    assert count == 5
    assert (tmp_path / "candump.log").read_text().splitlines() == [
        "(0000000000.999000) vcan0 000#8100",
        "(0000000001.000000) vcan0 181#00112233445566FF",
        "(0000000001.000000) vcan0 703#05",
        "(0000000001.001000) vcan0 501#00112233445566FF",
        "(0000000001.001000) vcan0 080#",
    ]


def test_candump_is_read_by_python_can(tmp_path: Path) -> None:
    can = pytest.importorskip("can")
    frames = [(0x181, 1, b"\xfe"), (0x201, 0, bytes(range(8)))]
    write_events(tmp_path / "a.lcmlog", [can_frames(5_000, frames), can_frames(6_000, frames)])
    write_candump([LcmLog(tmp_path / "a.lcmlog")], tmp_path / "candump.log")
    read = list(can.CanutilsLogReader(tmp_path / "candump.log"))
    sent = [(cob_id, data) for cob_id, _, data in frames]
    assert [(message.arbitration_id, bytes(message.data)) for message in read] == 2 * sent
    assert [round(message.timestamp, 6) for message in read] == [
        0.005,
        0.005,
        0.005,
        0.006,
    ]


def test_a_damaged_can_frames_message_is_refused(tmp_path: Path) -> None:
    channel, data = can_frames(0, [(0x80, 0, b"")])
    write_events(tmp_path / "a.lcmlog", [(channel, data[:-1])])
    with pytest.raises(LogError, match="size"):
        write_candump([LcmLog(tmp_path / "a.lcmlog")], tmp_path / "candump.log")
