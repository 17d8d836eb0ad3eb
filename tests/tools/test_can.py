"""./rig can: what frames say, rates and load, sources, and a real bus."""

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest

from hpmc import node_words
from hpmc.can import command, sources
from hpmc.can.decode import decode
from hpmc.can.load import frame_bits
from hpmc.can.show import Selection
from hpmc.can.state import BusState
from hpmc.can.words import emergency_text, name_of, statusword_text
from hpmc.candump import CandumpReader, Frame, parse_line
from hpmc.layout import CONFIG, PROGRAMS, ROOT, WITH_VCAN
from hpmc.lcm_log import LcmLog

Rig = Callable[..., tuple[int, str, str]]
SESSION = Path(__file__).with_name("can_session.py")
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT / "tools")}


def frame(cob_id: int, *data: int, time_s: float = 0.0) -> Frame:
    return Frame(time_s, cob_id, bytes(data))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a real run of two seconds of reaches, with its candump.log."""
    folder = tmp_path_factory.mktemp("can") / "run"
    subprocess.run(
        [sys.executable, "-m", "hpmc", "run", "clock", "--mode", "sil", "--no-figures",
         "--out", folder, "--set", "experiment.period_s=0.5"],
        check=True, stdout=subprocess.DEVNULL, timeout=120, cwd=ROOT, env=ENVIRONMENT,
    )  # fmt: skip
    return folder


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str]) -> Iterator[Rig]:
    """./rig can ...: exit status, standard output, standard error."""

    def ask(*arguments: str | Path) -> tuple[int, str, str]:
        status = command.main([str(argument) for argument in arguments])
        return status, *capsys.readouterr()

    handlers = {number: command.signal.getsignal(number) for number in (2, 15)}
    yield ask
    for number, handler in handlers.items():
        command.signal.signal(number, handler)


# --- frames in words -----------------------------------------------------------------------------


def test_every_emergency_has_words_in_its_one_place_and_the_protocol_page_names_no_other() -> None:
    codes = node_words.emergencies()
    header = node_words.EMCY_HEADER.read_text()
    assert len(codes) == len(re.findall(r"EMCY_\w+ = 0x", header)) >= 16
    assert codes[0x8250] == "no command within the deadline"
    page = (ROOT / "docs" / "protocol.md").read_text()
    named = {int(code, 16) for code in re.findall(r"\| (\d{4})h(?: for 1)? \|", page)}
    assert len(named) >= 10 and named <= set(codes)


def test_emergency_tells_code_register_source_and_detail() -> None:
    data = bytes.fromhex("3081110200000000")
    assert emergency_text(data) == (
        "8130h heartbeat missing; register 11h (generic, communication); source 2"
    )
    assert decode(Frame(0.0, 0x083, data)).name == "N3_EMCY"
    assert emergency_text(bytes.fromhex("11862100FEFFFFFF")).endswith("(generic, drive); detail -2")
    assert emergency_text(bytes.fromhex("FFFF000000000000")) == "FFFFh unknown emergency"


@pytest.mark.parametrize(
    ("sent", "name", "text"),
    [
        (frame(0x000, 0x81, 0), "NMT", "reset node: all nodes"),
        (frame(0x000, 1, 2), "NMT", "start: node 2"),
        (frame(0x080), "SYNC", "no data"),
        (frame(0x080, 7), "SYNC", "sync_counter 7"),
        (frame(0x77F, 5), "HOST_heartbeat", "operational"),
        (frame(0x709, 0x7F), "N9_heartbeat", "pre-operational"),
        (frame(0x302, 0x0F, 0, 0xFF), "N2_RPDO2", "controlword 000Fh, modes_of_operation -1"),
        (frame(0x285, 0xFF, 0x44, 0, 3, 0, 0xF6, 0xFF), "N5_TPDO2",
         "modes_of_operation_display -1, limit_reasons 0044h (T_max or latched f_max, temperature),"
         " counters_missed_sync 3, motor_temperature -1.0 degC"),
        (frame(0x183, 0xFE, 0xFF, 0xFF, 0xFF, 0x18, 0xFC, 0x37, 0x46), "N3_TPDO1",
         "position_actual_value -2 inc, torque_actual_value -1.000 N m, "
         "statusword 4637h (operation enabled, convergence)"),
        (frame(0x181, 1, 2), "N1_TPDO1", "too short: 2 of 8 bytes 01 02"),
        (frame(0x601, 0x2B, 0x17, 0x10, 0, 0x64, 0, 0, 0), "N1_SDO_request",
         "write 1017h Producer heartbeat time = 100 ms"),
        (frame(0x581, 0x60, 0x17, 0x10, 0, 0, 0, 0, 0), "N1_SDO_reply",
         "written 1017h Producer heartbeat time"),
        (frame(0x603, 0x40, 0x41, 0x60, 0, 0, 0, 0, 0), "N3_SDO_request", "read 6041h Statusword"),
        (frame(0x583, 0x4B, 0x41, 0x60, 0, 0x37, 0x06, 0, 0), "N3_SDO_reply",
         "6041h Statusword = 0637h (operation enabled)"),
        (frame(0x582, 0x80, 0x17, 0x10, 0, 0x30, 0, 9, 6), "N2_SDO_reply",
         "abort of 1017h Producer heartbeat time: 06090030h Value range of parameter exceeded"),
        (frame(0x601, 0x40, 0x99, 0x99, 1, 0, 0, 0, 0), "N1_SDO_request",
         "read 9999h:01 (not in the EDS)"),
        (frame(0x601, 0x23, 0x16, 0x10, 1, 0xF4, 1, 0x7F, 0), "N1_SDO_request",
         "write 1016h:01 Consumer heartbeat time 1 = node 127, 500 ms"),
        (frame(0x581, 0x41, 0x08, 0x10, 0, 14, 0, 0, 0), "N1_SDO_reply",
         "1008h Manufacturer device name = 14 bytes in segments"),
        (frame(0x581, 0x00, *b"FIC mot"), "N1_SDO_reply", "segment: b'FIC mot'"),
        (frame(0x601, 0x70, 0, 0, 0, 0, 0, 0, 0), "N1_SDO_request", "next segment, please"),
        (frame(0x7E5, 4, 1), "LSS_request", "04 01"),
        (frame(0x155, 1), "unknown", "01"),
        (frame(0x700), "unknown", "no data"),
        (Frame(0.0, 0x20000004, bytes(8), is_error=True), "error",
         "error frame 20000004h 00 00 00 00 00 00 00 00"),
    ],
)  # fmt: skip
def test_frames_in_words(sent: Frame, name: str, text: str) -> None:
    decoded = decode(sent)
    assert (decoded.name, decoded.text) == (name, text)


def test_no_frame_of_11_bits_makes_it_stumble() -> None:
    random = np.random.default_rng(1)
    for cob_id in range(1 << 11):
        for length in (0, 1, 8):
            assert decode(Frame(0.0, cob_id, random.bytes(length))).name == name_of(cob_id)[0]


def test_statusword_in_words() -> None:
    assert statusword_text(0x0608) == "fault"
    assert statusword_text(0x4EB7) == "operation enabled, warning, limit, convergence"


# --- recordings ----------------------------------------------------------------------------------


def test_lines_of_candump_are_read_as_python_can_reads_them(run: Path) -> None:
    with (run / "candump.log").open() as file:
        ours = list(CandumpReader().frames(file))
    theirs = can.CanutilsLogReader(run / "candump.log")
    count = 0
    for mine, message in zip(ours, theirs, strict=True):
        assert (mine.time_s, mine.cob_id, mine.data) == (
            message.timestamp, message.arbitration_id, bytes(message.data)
        )  # fmt: skip
        count += 1
    assert count > 50_000
    assert parse_line("(1.5) can0 20000080#0000000000000000") == Frame(
        1.5, 0x20000080, bytes(8), is_error=True
    )
    assert parse_line("(1.5) can0 181#R") == Frame(1.5, 0x181, b"", is_remote=True)
    for bad in ("", "x", "(1.5) can0 181#1", "(1.5) can0 181#001122334455667788", "(1.5) can0 1#"):
        assert parse_line(bad) is None


def test_recorded_bus_decodes_to_the_values_of_the_log(run: Path) -> None:
    log = LcmLog(run / "run.lcmlog")
    rows = {int(utime): row for row, utime in enumerate(log.column("HPMC_STATE", "utime"))}
    q_rad, tau_Nm = log.column("HPMC_STATE", "q_rad"), log.column("HPMC_STATE", "tau_Nm")
    tau_d, tau_max = log.column("HPMC_STATE", "tau_d_Nm"), log.column("HPMC_STATE", "tau_max_Nm")
    statusword, phase = log.column("HPMC_STATE", "statusword"), log.column("HPMC_STATE", "phase")
    rad_per_inc = 2 * np.pi / 65536
    compared = {"TPDO1": 0, "RPDO1": 0}
    for sent in sources.Recording(run).frames():
        row = rows.get(round(sent.time_s * 1e6))
        if row is None or phase[row] != 4 or sent.cob_id & 0x780 not in (0x180, 0x200):
            continue
        decoded = decode(sent)
        assert decoded.node is not None
        joint, values = decoded.node - 1, decoded.values
        compared[decoded.service] += 1
        if decoded.service == "TPDO1":  # told to the host in the next period
            assert values["torque_actual_value"] == pytest.approx(tau_Nm[row + 1][joint], abs=1e-9)
            assert values["statusword"] == int(statusword[row + 1][joint]) & 0xFFFF
            position = values["position_actual_value"] * rad_per_inc
            assert position == pytest.approx(q_rad[row + 1][joint], abs=1e-9)
        else:
            assert values["target_torque"] == pytest.approx(tau_d[row][joint], abs=0.0006)
            assert values["max_torque"] == pytest.approx(tau_max[row][joint], abs=0.0006)
    assert compared["TPDO1"] == compared["RPDO1"] > 3 * 7990


def test_run_without_candump_log_says_the_same(run: Path, tmp_path: Path, rig: Rig) -> None:
    status, from_file, said = rig(run, "--node", "2", "--filter", "heart")
    assert (status, said) == (0, "")
    lines = from_file.splitlines()
    assert len(lines) > 50
    assert lines[0] == "    0.001000  702  N2_heartbeat    boot-up"
    assert all(line.split()[1:3] == ["702", "N2_heartbeat"] for line in lines)
    (tmp_path / "run.lcmlog").symlink_to(run / "run.lcmlog")
    assert rig(tmp_path, "--node", "2", "--filter", "heart") == (0, from_file, "")
    first = rig(tmp_path / "run.lcmlog", "--count", "1")[1]
    assert first == "    0.000000  000  NMT             reset node: all nodes\n"


def test_lines_that_are_no_frames_are_counted_and_told(run: Path, tmp_path: Path, rig: Rig) -> None:
    lines = (run / "candump.log").read_text().splitlines()[:100]
    lines[40] = lines[40][:-1]
    lines[60] = "broken"
    file = tmp_path / "candump.log"
    file.write_text("\n".join(lines) + "\n")
    status, out, said = rig(file)
    assert (status, len(out.splitlines())) == (0, 98)
    assert said == f"rig can: {file}: 2 lines hold no frame, the first is line 41\n"


def test_count_ends_after_so_many_shown(run: Path, rig: Rig) -> None:
    status, out, _ = rig(run, "--filter", "SDO", "--count", "3")
    assert status == 0
    assert [line.split()[2] for line in out.splitlines()] == [
        "N1_SDO_request", "N1_SDO_reply", "N2_SDO_request",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere: is no CAN interface, no sandbox, no run and no file here"),
        (["/etc/passwd"], "/etc/passwd: is not in the format of candump -L"),
        (["--node", "0"], "argument --node: 0: must be 1 to 127"),
        (["--node", "x"], "argument --node: x: must be 1 to 127"),
        (["--count", "-1"], "argument --count: -1: must be a whole number from 1 on"),
        (["--filter", "TPDO9"], "--filter TPDO9: names are N1_TPDO1 and such, made of NMT, SYNC"),
        (["--speed"], "unrecognized arguments: --speed"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], said: str, rig: Rig) -> None:
    status, out, error = rig(*arguments)
    assert (status, out) == (2, "")
    assert error.startswith(f"rig can: {said}")
    assert error.count("\n") == 1


def test_folder_without_frames_is_one_line(tmp_path: Path, rig: Rig) -> None:
    subprocess.run(
        [PROGRAMS["sil"], "--config", CONFIG / "clock.toml", "--log", tmp_path / "run.lcmlog",
         "--set", "experiment.period_s=0.2", "--log-level", "states"],
        check=True, stdout=subprocess.DEVNULL, timeout=120,
    )  # fmt: skip
    status, _, said = rig(tmp_path)
    assert status == 2
    assert said == (
        f"rig can: {tmp_path}: no candump.log and no CAN_FRAMES (--log full keeps them)\n"
    )


# --- rates, load, nodes --------------------------------------------------------------------------


def test_bits_of_a_frame_are_those_of_an_independent_count() -> None:
    """The numbers of tests/host/test_link_can_load.cpp."""
    known = [
        (0x080, "01", 59), (0x7FF, "", 50), (0x7FF, "FF" * 8, 126), (0x555, "55" * 8, 112),
        (0x000, "00" * 8, 127), (0x201, "34120000E8038813", 120), (0x183, "FFFFFFFF18FC3746", 120),
        (0x77F, "05", 59), (0x078, "3C" * 8, 131), (0x000, "", 53),
    ]  # fmt: skip
    data = [bytes.fromhex(text) for _, text, _ in known]
    bits = frame_bits(
        np.array([cob_id for cob_id, _, _ in known]),
        np.array([len(part) for part in data]),
        np.array([list(part.ljust(8, b"\0")) for part in data], dtype=np.uint8),
    )
    assert bits.tolist() == [count for _, _, count in known]


def test_load_of_a_run_is_the_one_that_its_host_counted(run: Path) -> None:
    summary = json.loads((run / "summary.json").read_text())
    frames = list(sources.Recording(run).frames())
    sync_s = [sent.time_s for sent in frames if sent.cob_id == 0x080]
    state = BusState()
    state.add([sent for sent in frames if sync_s[0] <= sent.time_s < sync_s[-1]])
    state.measure()
    assert state.load_percent == pytest.approx(summary["bus"]["load_typical_percent"], abs=0.3)
    assert state.by_id[0x181].rate_hz == pytest.approx(1000, rel=0.001)


def test_state_keeps_what_nodes_said_and_what_happened() -> None:
    state = BusState()
    state.add([
        frame(0x705, 0, time_s=1.0), frame(0x705, 0x7F, time_s=1.1), frame(0x705, 0x7F, time_s=1.2),
        frame(0x205, *bytes(8), time_s=1.3),
        frame(0x185, 0, 0, 0, 0, 0, 0, 0x08, 0x06, time_s=1.4),
        frame(0x285, 0xFF, 2, 0, 0, 0, 0xFA, 0, time_s=1.5),
        frame(0x085, 0x50, 0x82, 0x11, 0, 0, 0, 0, 0, time_s=1.6),
        Frame(1.7, 0x20000040, bytes(8), is_error=True),
    ])  # fmt: skip
    node = state.nodes[5]
    assert (node.nmt, node.statusword, node.mode, node.limits) == (0x7F, 0x0608, -1, 2)
    assert (node.temperature_c, node.emergencies) == (25.0, 1)
    assert node.last_emergency.startswith("8250h no command within the deadline")
    assert (state.frames, state.errors) == (8, 1)
    told = [(time_s, event.name) for time_s, event in state.events]
    assert told == [
        (1.0, "N5_heartbeat"), (1.1, "N5_heartbeat"), (1.6, "N5_EMCY"), (1.7, "error"),
    ]  # fmt: skip


def test_live_rates_are_those_of_the_last_second() -> None:
    state = BusState()
    for now in range(4):
        state.add([frame(0x181, *bytes(8), time_s=now)] * (100 if now == 3 else 10))
        state.measure(float(now))
    assert state.by_id[0x181].rate_hz == 100


def test_selection_takes_nodes_and_parts_of_names() -> None:
    frames = [frame(0x181, 0), frame(0x582, 0), frame(0x602, 0), frame(0x080), frame(0x082)]

    def taken(node: int | None, part: str) -> list[int]:
        return [f.cob_id for f in frames if Selection(node, part).takes(f)]

    assert taken(None, "") == [0x181, 0x582, 0x602, 0x080, 0x082]
    assert taken(2, "") == [0x582, 0x602, 0x082]
    assert taken(None, "sdo") == [0x582, 0x602]
    assert taken(2, "emcy") == [0x082]
    assert taken(None, "N1_") == [0x181]


# --- a real bus ----------------------------------------------------------------------------------


@pytest.fixture
def name() -> str:
    """Of a sandbox, that no other test has now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"can-{probe.getsockname()[1]}"


def test_on_a_real_bus_with_a_motor_node(name: str) -> None:
    """Inside the sandbox with python-can, from outside through --join; see can_session.py."""
    session = subprocess.Popen(
        [WITH_VCAN, "--name", name, "--", sys.executable, SESSION],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        cwd=ROOT, env=ENVIRONMENT,
    )  # fmt: skip
    try:
        assert session.stdin is not None and session.stdout is not None
        said = []
        for text in session.stdout:
            said.append(text)
            if text == "LISTEN FROM OUTSIDE\n":
                break
        else:
            pytest.fail("the session ended: " + "".join(said))
        outside = subprocess.run(
            [sys.executable, "-m", "hpmc", "can", name, "--node", "5", "--filter", "heartbeat",
             "--count", "4"],
            capture_output=True, text=True, cwd=ROOT, env=ENVIRONMENT, timeout=60,
        )  # fmt: skip
        assert outside.returncode == 0, outside.stderr
        shown = [line.split(maxsplit=2)[1:] for line in outside.stdout.splitlines()]
        assert [part[0] for part in shown] == ["705"] * 4
        assert all("N5_heartbeat" in part[1] for part in shown)
        assert outside.stderr.startswith(f"vcan0 of {name}: ")
        assert outside.stderr.endswith("0 dropped here\n")
        # One that listens while the sandbox ends.
        gone = subprocess.Popen(
            [sys.executable, "-m", "hpmc", "can", name, "--filter", "heartbeat"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            cwd=ROOT, env=ENVIRONMENT,
        )  # fmt: skip
        assert gone.stdout is not None
        assert "N5_heartbeat" in gone.stdout.readline()
        rest, _ = session.communicate("go on\n", timeout=120)
        _, error = gone.communicate(timeout=60)
        assert session.returncode == 0, "".join(said) + rest
        assert rest.endswith("ALL WELL\n"), rest
        assert gone.returncode == 3
        assert re.fullmatch(rf"rig can: vcan0 of {name} has gone.*\n", error), error
    finally:
        session.kill()
        session.communicate()
