"""./rig log on logs with known content: info, show, plot, diff, and what they do with damage."""

import csv
import io
import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import lcm
import numpy as np
import pytest
from synthetic_log import (
    channel_types,
    message_types,
    write_clock_log,
    write_every_type,
)

from hpmc import log as log_command
from hpmc.lcm_log import LcmLog, LogError
from hpmc.lcm_types import TYPE_FOLDER, UNITS, load_type
from hpmc.log_columns import columns_of, read_columns, read_messages
from hpmc.log_diff import compare
from hpmc.log_info import describe
from hpmc.log_plot import BUCKETS, draw_curves, read_curves
from hpmc.run_folder import RunFolder

TYPES = [load_type(path.stem) for path in sorted(TYPE_FOLDER.glob("*.lcm"))]
# How the names of fields end, where they carry the unit.
SUFFIXES = {
    "_m_s": "m/s", "_rad_s": "rad/s", "_rad": "rad", "_Nm": "N m", "_mNm": "mN m", "_N": "N",
    "_m": "m", "_inc": "encoder increments", "_dC": "0.1 degree Celsius", "utime": "us",
}  # fmt: skip

Rig = Callable[..., tuple[int, str, str]]


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str]) -> Rig:
    """./rig log ...: exit status, standard output, standard error."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        status = log_command.main([str(argument) for argument in arguments])
        return status, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("every") / "run.lcmlog"
    write_every_type(path)
    return path


@pytest.fixture(scope="module")
def clock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of one run that two jobs made."""
    folder = tmp_path_factory.mktemp("clock")
    for job in range(2):
        write_every_type(folder / f"run-{job:02d}.lcmlog", count=20, first=20 * job)
    return folder


def arm_state(number: int, utime: int | None = None) -> bytes:
    message = message_types().arm_state_t()
    message.utime, message.seq = 1000 * number if utime is None else utime, number
    message.q_rad = [0.1 * number, 1.0, -2.0]
    return message.encode()


def write_events(path: Path, events: list[tuple[int, str, bytes]]) -> Path:
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for time_us, channel, data in events:
        log.write_event(time_us, channel, data)
    log.close()
    return path


def decoded(path: Path, channel: str) -> list[dict]:
    """By the decoder that is tested against LCM's own."""
    lcm_type = channel_types()[channel]
    return [lcm_type.decode(data) for data in LcmLog(path).raw_messages(channel)]


def at_path(message: dict, name: str, element: int = 0) -> object:
    """The value of a column's name in a decoded message; `frames.id` of the given element."""
    value: object = message
    for part in re.findall(r"\w+", name):
        if isinstance(value, list) and not part.isdigit():
            if part == "index":
                return element
            value = value[element]
        value = value[int(part)] if isinstance(value, list) else value[part]
    return value


def same(one: object, two: object) -> bool:
    if isinstance(one, float) and isinstance(two, float) and math.isnan(one):
        return math.isnan(two)
    if isinstance(one, float) and isinstance(two, float):
        return one == two and math.copysign(1, one) == math.copysign(1, two)
    return one == two


# --- units and columns ---------------------------------------------------------------------------


def test_every_real_number_of_a_message_has_a_unit_that_its_name_repeats() -> None:
    checked = 0
    for lcm_type in TYPES:
        for member in lcm_type.members:
            suffix = next((s for s in SUFFIXES if member.name.endswith(s)), None)
            if suffix:
                assert member.unit == SUFFIXES[suffix], f"{lcm_type.name}.{member.name}"
                checked += 1
            else:
                assert not member.unit, f"{lcm_type.name}.{member.name}: the name lacks the unit"
                assert member.type_name not in ("double", "float")
    assert checked > 30


def test_a_unit_is_the_first_clause_or_the_one_behind_the_object_index(tmp_path: Path) -> None:
    (tmp_path / "a_t.lcm").write_text(
        """package p;
        // A_CHANNEL: for the test; with a semicolon.
        struct a_t
        {
            int64_t utime; // us, behind the field
            /* N m, before
               it */ double a;
            double b; // m/s; as well
            // 6077h, mN m
            int32_t c;
            // counts, never in m
            int32_t d;

            double e[2];
        }"""
    )
    lcm_type = load_type("a_t", tmp_path)
    assert lcm_type.comment == "A_CHANNEL: for the test; with a semicolon."
    assert [m.unit for m in lcm_type.members] == ["us", "N m", "m/s", "mN m", "", ""]
    assert [m.comment for m in lcm_type.members] == [
        "us, behind the field", "N m, before it", "m/s; as well", "6077h, mN m",
        "counts, never in m", "",
    ]  # fmt: skip
    assert {unit for t in TYPES for m in t.members if (unit := m.unit)} <= set(UNITS)


@pytest.mark.parametrize("channel", channel_types())
def test_columns_have_the_values_of_the_decoded_messages(every: Path, channel: str) -> None:
    log = LcmLog(every)
    messages = decoded(every, channel)
    columns = columns_of(channel_types()[channel])
    table = read_columns(log, channel, columns, slice(None))
    array = next((column.member for column in columns if column.repeated), None)
    rows = [(m, k) for m in messages for k in range(len(m[array]) if array else 1)]
    assert len(rows) == table[0].size > 0
    for column, values in zip(columns, table, strict=True):
        for value, (message, element) in zip(values.tolist(), rows, strict=True):
            assert same(value, at_path(message, column.name, element)), column.name
    some = np.array([5, 3, 17])
    again = read_columns(log, channel, [columns[0]], some)[0]
    assert again.tolist() == [messages[i]["utime"] for i in some]


@pytest.mark.parametrize("channel", channel_types())
def test_messages_read_together_are_those_decoded_one_by_one(every: Path, channel: str) -> None:
    read = read_messages(LcmLog(every), channel, slice(None))
    assert len(read) == 40
    # as text, since NaN is not NaN
    assert repr(read) == repr(decoded(every, channel))


def test_a_run_of_several_jobs_is_one(clock: Path, every: Path) -> None:
    run = RunFolder(clock)
    assert len(run.logs) == 2
    assert run.count("ARM_STATE") == 40
    assert run.utime_us("CAN_FRAMES").tolist() == [1000 * k for k in range(40)]
    table = run.read("HPMC_STATE", ["x_link_m[1]", "reach"], 0.010, 0.029)
    assert [c.name for c in table.columns] == ["x_link_m[1][0]", "x_link_m[1][1]", "reach"]
    assert len(table) == 20
    pieces = list(run.chunks("CAN_FRAMES", run.columns("CAN_FRAMES"), size=7))
    assert len(pieces) == 6
    whole = run.read("CAN_FRAMES")
    for number, values in enumerate(whole.values):
        np.testing.assert_array_equal(np.concatenate([p.values[number] for p in pieces]), values)
    with pytest.raises(LogError, match=r"no field q_rad\[3\]; there are q_rad\[0\] to q_rad\[2\]"):
        run.columns("ARM_STATE", ["q_rad[3]"])
    with pytest.raises(LogError, match="no field speed; its fields are utime, seq, q_rad"):
        run.columns("ARM_STATE", ["speed"])


# --- damage --------------------------------------------------------------------------------------


def test_single_damaged_messages_are_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / "run.lcmlog"
    write_every_type(path, count=10)
    whole = path.read_bytes()
    log = LcmLog(path)
    arm, _ = log.message_places("ARM_STATE")
    can, _ = log.message_places("CAN_FRAMES")
    info, _ = log.message_places("RUN_INFO")
    hurt = bytearray(whole)
    hurt[arm[0]] ^= 1  # fingerprint, of the first message too
    hurt[can[4] + 8 + 16 : can[4] + 8 + 20] = (1 << 30).to_bytes(4, "big")  # frames there are not
    hurt[can[6] + 8 + 16] = 0x80  # a negative number of them
    hurt[can[7] + 8 + 19] = 1  # fewer than there are
    hurt[info[2] + 8 + 16] = 0x7F  # length of a text
    path.write_bytes(hurt[:-5])
    run = RunFolder(path)
    assert run.utime_us("ARM_STATE").tolist() == [1000 * k for k in range(1, 10)]
    assert run.utime_us("CAN_FRAMES").tolist() == [
        1000 * k for k in range(10) if k not in (4, 6, 7)
    ]
    assert run.count("RUN_INFO") == 9
    places = sorted(int(place) for place in (arm[0], can[4], can[6], can[7], info[2]))
    told = [int(re.search(r"at (\d+) hold", problem)[1]) for problem in run.problems]
    assert told[:5] == places
    assert len(told) == 6 and told[5] > info[-1]
    facts = {f.channel: f for f in describe(run).channels}
    assert facts["CAN_FRAMES"].lost == 3
    assert [(g.after_seq, g.missing) for g in facts["CAN_FRAMES"].gaps] == [(3, 1), (5, 2)]
    # a strict reader refuses the log
    with pytest.raises(LogError):
        LcmLog(path).column("ARM_STATE", "utime")


def test_a_log_of_nothing_but_damage_is_told(tmp_path: Path, rig: Rig) -> None:
    path = write_events(tmp_path / "a.lcmlog", [(0, "ARM_STATE", arm_state(0)[:-1])])
    status, said, _ = rig("info", path)
    assert status == 0
    assert "0 messages" in said and f"{len(arm_state(0)) - 1} bytes at 37 hold no whole" in said
    assert rig("export", path, "--to", "csv")[0] == 2
    assert rig("show", path, "--channel", "ARM_STATE")[0] == 2
    assert rig("diff", path, path)[0] == 0


@pytest.mark.parametrize("seed", range(20))
def test_no_damage_makes_the_reader_fail(every: Path, tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    content = np.frombuffer(every.read_bytes(), dtype=np.uint8).copy()
    places = random.integers(0, content.size, 200)
    content[places] = random.integers(0, 256, places.size)
    path = tmp_path / "run.lcmlog"
    path.write_bytes(content[: random.integers(content.size // 2, content.size)].tobytes())
    run = RunFolder(path)
    assert run.problems
    for facts in describe(run).channels:
        if facts.type_name:
            assert sum(len(t) for t in run.chunks(facts.channel, run.columns(facts.channel))) >= 0
            assert facts.messages <= 40


def test_a_damaged_job_does_not_hide_the_others(clock: Path, tmp_path: Path, rig: Rig) -> None:
    (tmp_path / "run-00.lcmlog").write_bytes((clock / "run-00.lcmlog").read_bytes())
    (tmp_path / "run-01.lcmlog").write_bytes(b"nothing of a log")
    (tmp_path / "summary.json").write_text("{")
    status, said, errors = rig("info", tmp_path)
    assert status == 0
    assert "run-01.lcmlog is not an LCM log" in said and "summary.json cannot be read" in said
    status, said, errors = rig("show", tmp_path, "--channel", "ARM_STATE", "--fields", "seq")
    assert (status, len(said.splitlines())) == (0, 21)
    assert "run-01.lcmlog is not an LCM log" in errors


# --- info ----------------------------------------------------------------------------------------


def test_info_tells_rates_jitter_losses_and_what_it_does_not_know(tmp_path: Path, rig: Rig) -> None:
    # 1 kHz by the run clock; logged 100 s later, each second message 200 us late
    kept = [k for k in range(100) if k not in (10, 11, 50)]
    events = [(100_000_000 + 1000 * k + 200 * (k % 2), "ARM_STATE", arm_state(k)) for k in kept]
    events += [(100_000_000 + 500 * k, "SOMETHING", b"else") for k in range(5)]
    events += [(100_000_000, "BUS_CLOSED", bytes(8) + b"of another version")]
    path = write_events(tmp_path / "look.lcmlog", events)
    description = describe(RunFolder(path))
    facts = {facts.channel: facts for facts in description.channels}
    arm = facts["ARM_STATE"]
    assert (arm.messages, arm.lost, arm.not_growing) == (97, 3, 0)
    assert [(g.after_seq, g.missing, g.at_s) for g in arm.gaps] == [(9, 2, 0.009), (49, 1, 0.049)]
    assert (arm.rhythm.rate_hz, arm.rhythm.jitter_max_us) == (1000, 0)
    assert arm.logger_rhythm.jitter_std_us == pytest.approx(200, rel=0.01)
    assert (arm.from_s, arm.to_s) == (0.0, pytest.approx(0.099))
    assert description.duration_s == pytest.approx(0.099)
    assert facts["SOMETHING"].rhythm.rate_hz == pytest.approx(2000)
    assert (facts["SOMETHING"].type_name, facts["SOMETHING"].lost) == (None, None)
    assert "no something_t.lcm" in facts["SOMETHING"].note
    assert "another bus_closed_t.lcm" in facts["BUS_CLOSED"].note

    status, said, errors = rig("info", path)
    assert (status, errors) == (0, "")
    assert re.search(r"ARM_STATE +97 +1000\.00 +1\.000 +0 / 0 +3 +0\.000 +0\.099", said)
    assert "as logged" in said
    assert "ARM_STATE: 2 lost after number 9, 0.009 s (look.lcmlog)" in said
    told = json.loads(rig("info", path, "--json")[1])
    assert told["channels"][0]["gaps"][0]["missing"] == 2


def test_info_tells_of_a_log_with_two_runs(tmp_path: Path, rig: Rig) -> None:
    events = [(1000 * k, "ARM_STATE", arm_state(k)) for k in [*range(5), *range(5)]]
    said = rig("info", write_events(tmp_path / "a.lcmlog", events))[1]
    assert "sequence number does not grow 1 times" in said


def test_info_tells_configuration_and_versions(tmp_path: Path, rig: Rig) -> None:
    info = message_types().run_info_t()
    info.mode, info.seed, info.git, info.libm = "sil", 7, "abc123-dirty", "glibc 2.36"
    info.config_toml = "[joint]\nrate_Hz = 5000  # Hz\n"
    path = write_events(tmp_path / "a.lcmlog", [(0, "RUN_INFO", info.encode())])
    said = rig("info", path)[1]
    for text in ("mode sil, seed 7", "abc123-dirty", "glibc 2.36", "joint: rate_Hz=5000"):
        assert text in said
    info.config_toml = "not = = toml"
    said = rig("info", write_events(path, [(0, "RUN_INFO", info.encode())]))[1]
    assert "configuration of" in said and "cannot be read" in said


# --- show ----------------------------------------------------------------------------------------


def test_show_prints_aligned_columns_with_units(tmp_path: Path, rig: Rig) -> None:
    path = write_events(
        tmp_path / "a.lcmlog", [(1000 * k, "ARM_STATE", arm_state(k)) for k in range(20)]
    )
    table = ("show", path, "--channel", "ARM_STATE", "--fields")
    status, said, _ = rig(*table, "seq, q_rad[0],tau_Nm", "--from", "0.0095", "--to", "0.012")
    lines = said.splitlines()
    assert status == 0
    heads = ["time (s)", "seq", "q_rad[0] (rad)", "tau_Nm[0] (N m)", "tau_Nm[1] (N m)",
             "tau_Nm[2] (N m)"]  # fmt: skip
    assert re.split(r"  +", lines[0].strip()) == heads
    assert [line.split() for line in lines[1:]] == [
        [f"0.0{k}000", str(k), f"{0.1 * k:.9g}", "0", "0", "0"] for k in (10, 11, 12)
    ]
    assert len({len(line) for line in lines}) == 1
    _, said, _ = rig(*table, "seq", "--every", "8")
    assert [line.split()[1] for line in said.splitlines()[1:]] == ["0", "8", "16"]


def test_show_as_csv_is_exact(every: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    for size in (20_000, 3):
        monkeypatch.setattr(RunFolder.chunks, "__defaults__", (None, None, size))
        said = rig("show", every, "--channel", "HPMC_STATE", "--csv")[1]
        rows = list(csv.reader(io.StringIO(said)))
        assert rows[0][:4] == ["time (s)", "seq", "repetition", "reach"]
        assert "x_link_m[2][1] (m)" in rows[0]
        wanted = decoded(every, "HPMC_STATE")
        assert len(rows) == 41
        thin = rig("show", every, "--channel", "HPMC_STATE", "--csv", "--every", "5")[1]
        assert list(csv.reader(io.StringIO(thin)))[1:] == rows[1::5]
        place = rows[0].index("w_link_N[1][0] (N)")
        for row, message in zip(rows[1:], wanted, strict=True):
            assert float(row[0]) == message["utime"] / 1e6
            assert same(float(row[place]), message["w_link_N"][1][0])
            assert row[-1] == str(int(message["saturated"]))


def test_show_keeps_text_in_one_line(every: Path, rig: Rig) -> None:
    said = rig("show", every, "--channel", "RUN_INFO", "--fields", "mode")[1]
    assert len(said.splitlines()) == 41
    assert r"'a, \"b\"\nc = 1'" in said or r"'a, "  in said


# --- plot ----------------------------------------------------------------------------------------


def test_curves_are_the_fields_over_the_run_clock(every: Path) -> None:
    run = RunFolder(every)
    curves = read_curves(
        run,
        ["ARM_STATE.q_rad", "HPMC_STATE.x_link_m[2]", "JOINT_TORQUE_2.tau_Nm",
         "CAN_FRAMES.frames[1].data[3]", "CAN_FRAMES.count", "HPMC_STATE.saturated"],
        0.01, 0.02,
    )  # fmt: skip
    assert [(curve.name, curve.unit) for curve in curves] == [
        *((f"ARM_STATE.q_rad[{i}]", "rad") for i in range(3)),
        *((f"HPMC_STATE.x_link_m[2][{i}]", "m") for i in range(2)),
        ("JOINT_TORQUE_2.tau_Nm", "N m"),
        ("CAN_FRAMES.frames[1].data[3]", ""),
        ("CAN_FRAMES.count", ""),
        ("HPMC_STATE.saturated", ""),
    ]
    messages = decoded(every, "CAN_FRAMES")[10:21]
    assert curves[7].values.tolist() == [m["count"] for m in messages]
    there = [m for m in messages if m["count"] > 1]
    assert curves[6].values.tolist() == [m["frames"][1]["data"][3] for m in there]
    assert curves[6].time_s.tolist() == [m["utime"] / 1e6 for m in there]
    (all_frames,) = read_curves(run, ["CAN_FRAMES.frames.id"], 0.01, 0.02)
    assert all_frames.values.size == sum(m["count"] for m in messages)


def test_one_axis_per_unit(every: Path) -> None:
    run = RunFolder(every)
    fields = ["ARM_STATE.q_rad[0]", "ARM_STATE.tau_Nm", "HPMC_STATE.q_d_rad[0]"]
    figure = draw_curves(read_curves(run, fields), "title")
    assert [axis.get_ylabel() for axis in figure.axes] == ["rad", "N m"]
    assert figure.axes[1].get_xlabel() == "time, s"
    labels = [[line.get_label() for line in axis.lines] for axis in figure.axes]
    assert labels[0] == ["ARM_STATE.q_rad[0]", "HPMC_STATE.q_d_rad[0]"]
    wanted = [m["q_rad"][0] for m in decoded(every, "ARM_STATE")]
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), wanted)


def test_a_long_curve_keeps_its_peaks(tmp_path: Path) -> None:
    count = 3 * BUCKETS
    peaks = {5002: 7.0, 6004: -3.0}
    events = [(k, "JOINT_TORQUE_1", torque(k, peaks.get(k, 0.0))) for k in range(count)]
    path = write_events(tmp_path / "a.lcmlog", events)
    figure = draw_curves(read_curves(RunFolder(path), ["JOINT_TORQUE_1.tau_Nm"]), "")
    line = figure.axes[0].lines[0]
    assert len(line.get_xdata()) <= 2 * BUCKETS
    assert (line.get_ydata().max(), line.get_ydata().min()) == (7.0, -3.0)
    assert line.get_xdata()[line.get_ydata().argmax()] == 5.002


def torque(number: int, tau_nm: float) -> bytes:
    message = message_types().joint_torque_t()
    message.utime, message.seq, message.tau_Nm = 1000 * number, number, tau_nm
    return message.encode()


@pytest.mark.parametrize(("suffix", "begin"), [("png", b"\x89PNG"), ("pdf", b"%PDF"),
                                               ("svg", b"<?xml")])  # fmt: skip
def test_plot_writes_the_picture(
    every: Path, tmp_path: Path, rig: Rig, suffix: str, begin: bytes
) -> None:
    file = tmp_path / f"a.{suffix}"
    status, said, errors = rig("plot", every, "ARM_STATE.q_rad", "-o", file)
    assert (status, errors) == (0, "")
    assert said == f"3 curves in {file}\n"
    assert file.read_bytes().startswith(begin)


# --- diff ----------------------------------------------------------------------------------------


def test_runs_with_the_same_content_do_not_differ(
    every: Path, clock: Path, tmp_path: Path, rig: Rig
) -> None:
    assert rig("diff", every, every)[0] == 0
    write_every_type(tmp_path / "again.lcmlog")
    status, said, _ = rig("diff", every, tmp_path / "again.lcmlog")
    assert status == 0 and "the same: 9 channels, 360 pairs" in said
    status, said, _ = rig("diff", every, clock)  # other random numbers from message 20 on
    assert status == 1
    assert "first difference at 0.020000 s" in said


def test_diff_finds_the_first_and_the_largest_difference(tmp_path: Path, rig: Rig) -> None:
    one, two = tmp_path / "one.lcmlog", tmp_path / "two.lcmlog"
    taus = [0.0] * 50
    write_events(one, [(0, "JOINT_TORQUE_1", torque(k, tau)) for k, tau in enumerate(taus)])
    taus[20], taus[30] = 0.001, -2.5
    lacking = [(0, "JOINT_TORQUE_1", torque(k, tau)) for k, tau in enumerate(taus) if k != 10]
    write_events(two, [*lacking, (0, "JOINT_TORQUE_2", torque(0, 0.0))])
    difference = compare(RunFolder(one), RunFolder(two))
    (found,) = difference.fields
    assert (found.channel, found.name, found.unit) == ("JOINT_TORQUE_1", "tau_Nm", "N m")
    assert (found.rows, found.first_s, found.first) == (2, pytest.approx(0.02), (0.0, 0.001))
    assert (found.largest, found.largest_s) == (2.5, pytest.approx(0.03))
    (channel,) = difference.channels
    assert (channel.pairs, channel.only, channel.only_first_s) == (49, (1, 0), 0.01)
    assert difference.only_channels == ([], ["JOINT_TORQUE_2"])
    status, said, _ = rig("diff", one, two)
    assert status == 1
    assert "first difference at 0.020000 s: JOINT_TORQUE_1.tau_Nm 0 | 0.001 N m" in said
    assert "only in 2: JOINT_TORQUE_2" in said and "JOINT_TORQUE_1: 1 messages only in 1" in said
    assert "different: 1 channels" in said


def test_diff_compares_the_bytes_of_what_it_does_not_know(tmp_path: Path) -> None:
    runs = []
    for number, data in enumerate((b"a", b"a", b"b")):
        path = write_events(tmp_path / f"{number}.lcmlog", [(0, "SOMETHING", data)])
        runs.append(RunFolder(path))
    assert compare(runs[0], runs[1]).same
    assert not compare(runs[0], runs[2]).same


def test_diff_shows_run_info_and_metrics_and_does_not_judge_them(tmp_path: Path, rig: Rig) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_clock_log(tmp_path / name / "run.lcmlog", reaches=1)
        summary = {"executed": {"r_mean": 1.8 if name == "one" else 1.9}, "mode": name}
        (tmp_path / name / "summary.json").write_text(json.dumps(summary))
    status, said, _ = rig("diff", tmp_path / "one", tmp_path / "two")
    assert status == 0
    assert re.search(r"executed\.r_mean +1\.8 +1\.9 +\+0\.1", said)
    info = message_types().run_info_t()
    info.mode, info.config_toml = "vcan", "[joint]\nrate_Hz = 1000\n"
    events = [(0, "RUN_INFO", info.encode()), (0, "ARM_STATE", arm_state(0))]
    write_events(tmp_path / "a.lcmlog", events)
    info.mode, info.config_toml = "sil", "[joint]\nrate_Hz = 5000\n"
    write_events(tmp_path / "b.lcmlog", [(0, "RUN_INFO", info.encode()), events[1]])
    status, said, _ = rig("diff", tmp_path / "a.lcmlog", tmp_path / "b.lcmlog")
    assert status == 0
    assert "mode: vcan | sil" in said and "joint.rate_Hz: 1000 | 5000" in said


def test_metrics_are_measured_where_there_is_no_summary(tmp_path: Path) -> None:
    info = message_types().run_info_t()
    info.config_toml = "[experiment]\nperiod_s = 1.0\n"
    paths = []
    for name, ripple_mm in (("a", 0.5), ("b", 0.0)):
        path = tmp_path / f"{name}.lcmlog"
        write_clock_log(path, reaches=2, ripple_mm=ripple_mm)
        content = path.read_bytes()
        write_events(path, [(0, "RUN_INFO", info.encode())])
        rest = LcmLog(tmp_path / f"{name}.lcmlog").event_places("RUN_INFO")
        assert rest.size == 1
        second = content.find(b"\xed\xa1\xda\x01", 4)  # behind the synthetic log's own RUN_INFO
        path.write_bytes(path.read_bytes() + content[second:])
        paths.append(path)
    difference = compare(*(RunFolder(path) for path in paths))
    metrics = {key: (one, two) for key, one, two in difference.metrics}
    assert metrics["planned.r_mean"] == pytest.approx((1.616, 1.616), abs=5e-4)
    assert metrics["position_rmse_mm.mean"][0] > 0.3 > 1e-6 > metrics["position_rmse_mm.mean"][1]


# --- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["info", "missing"], "cannot read missing: No such file"),
        (["info", "."], "is no run: it holds no run*.lcmlog"),
        (["info"], "required: RUN"),
        (["look", "LOG"], "invalid choice: 'look'"),
        ([], "required: COMMAND"),
        (["show", "LOG", "--channel", "ARM"], "has no ARM (it has ARM_STATE"),
        (["show", "LOG", "--channel", "ARM_STATE", "--fields", "q"], "ARM_STATE has no field q;"),
        (["show", "LOG"], "required: --channel"),
        (["show", "LOG", "--channel", "ARM_STATE", "--from", "soon"], "'soon': must be a time"),
        (["show", "LOG", "--channel", "ARM_STATE", "--from", "nan"], "'nan': must be a time in s"),
        (["show", "LOG", "--channel", "ARM_STATE", "--from", "2", "--to", "1"],
         "the time range ends (1 s) before it begins (2 s)"),
        (["show", "LOG", "--channel", "ARM_STATE", "--every", "0"], "a whole number from 1 on"),
        (["plot", "LOG", "ARM_STATE", "-o", "a.png"], "a field is written CHANNEL.field"),
        (["plot", "LOG", "ARM_STATE.q_rad", "-o", "a.xyz"], "-o a.xyz: the name must end in .png"),
        (["plot", "LOG", "RUN_INFO.git", "-o", "a.png"], "RUN_INFO.git is text"),
        (["plot", "LOG", "ARM_STATE.q_rad", "-o", "missing/a.png"], "cannot be written: No such"),
        (["plot", "LOG", "ARM_STATE.q_rad", "--from", "99", "-o", "a.png"], "no message in this"),
        (["plot", "LOG", "CAN_FRAMES.frames[9].id", "-o", "a.png"], "that many elements"),
        (["plot", "LOG", "CAN_FRAMES.frames", *(f"HPMC_STATE.{f}" for f in (
            "x_link_m", "x_link_d_m", "w_link_N", "q_d_rad", "q_rad", "tau_d_Nm", "tau_max_Nm",
            "tau_Nm")), "-o", "a.png"], "44 curves are too many for one picture: 40 at most"),
        (["plot", "LOG", "ARM_STATE.q_rad"], "there is no display"),
        (["diff", "LOG", "missing"], "cannot read missing"),
        (["diff", "LOG", "LOG", "--channel", "ARM"], "has no ARM"),
        (["export", "LOG", "--to", "xls"], "invalid choice: 'xls'"),
        (["export", "LOG", "--to", "csv", "--channel", "ARM"], "has no ARM"),
        (["export", "LOG", "--to", "csv", "-o", "LOG"], "is not a folder"),
    ],
)  # fmt: skip
def test_bad_input_is_told_in_one_line(
    every: Path, tmp_path: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch, arguments: list[str],
    told: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    status, said, errors = rig(*(str(every) if a == "LOG" else a for a in arguments))
    assert (status, said) == (2, "")
    assert errors.startswith("rig log: ") and errors.count("\n") == 1
    assert told in errors
    assert list(tmp_path.iterdir()) == []
