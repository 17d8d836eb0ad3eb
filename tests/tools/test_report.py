"""./rig report: what the page says is what the logs hold, for whole, broken and poor runs."""

import base64
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import lcm
import numpy as np
import pytest
from synthetic_log import message_types, write_clock_log

from hpmc.layout import CONFIG, PROGRAMS, ROOT
from hpmc.report import command
from hpmc.report.charts import period_chart
from hpmc.report.command import make_page
from hpmc.report.reach import find_reaches, read_reach
from hpmc.report.timeline import read_timeline
from hpmc.run_folder import RunFolder

Rig = Callable[..., tuple[int, str, str]]
FAULT_S = 4.2
LIMITED_S = (3.0, 3.5)
DRAWN = ROOT / "docs" / "images" / "fig3_r_per_target.png"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real run of two repetitions in two processes, one key of its configuration changed."""
    folder = tmp_path_factory.mktemp("report") / "run"
    subprocess.run(
        [sys.executable, "-m", "hpmc", "run", "clock", "--mode", "sil", "--no-figures",
         "--repetitions", "2", "--jobs", "2", "--out", folder,
         "--set", "joint_coordination.wrench_cutoff_Hz=80", "--set", "experiment.period_s=0.3"],
        check=True, stdout=subprocess.DEVNULL, timeout=120, cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT / "tools")},
    )  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def page(run: Path) -> str:
    return make_page(run)


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str]) -> Rig:
    """./rig report ...: exit status, standard output, standard error."""

    def ask(*arguments: str | Path) -> tuple[int, str, str]:
        status = command.main([str(argument) for argument in arguments])
        return status, *capsys.readouterr()

    return ask


def rewrite(source: Path, target: Path, change: Callable[[str, Any], bool]) -> None:
    """Copies a log message by message; `change` may edit a message, and leaves it out if false."""
    types = message_types()
    reader, writer = lcm.EventLog(str(source)), lcm.EventLog(str(target), "w", overwrite=True)
    for event in reader:
        name = re.sub(r"_\d+$", "", event.channel).lower() + "_t"
        message = getattr(types, name).decode(event.data)
        if change(event.channel, message):
            writer.write_event(event.timestamp, event.channel, message.encode())
    reader.close()
    writer.close()


def quick_page(folder: Path, reach: int | None = None) -> str:
    """The page of a folder that holds a figure already: drawing them takes the longest."""
    shutil.copy(DRAWN, folder)
    return make_page(folder, reach)


def text_of(page: str) -> str:
    """What a reader sees, without the pictures; cells apart by a space."""

    class Reader(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.skipped = 0
            self.found: list[str] = []

        def handle_starttag(self, tag: str, _: object) -> None:
            self.skipped += tag in ("style", "svg")

        def handle_endtag(self, tag: str) -> None:
            self.skipped -= tag in ("style", "svg")

        def handle_data(self, data: str) -> None:
            if not self.skipped:
                self.found.append(data)

    reader = Reader()
    reader.feed(page)
    return re.sub(r"\s+", " ", " ".join(reader.found))


# --- a whole run ---------------------------------------------------------------------------------


def test_page_has_the_summary_beside_the_paper(run: Path, page: str) -> None:
    summary = RunFolder(run).summary
    assert summary is not None
    text = text_of(page)
    executed = summary["executed"]
    assert f"{executed['r_mean']:.2f} ± {executed['r_std']:.2f}" in text
    assert "paper 1.616 ± 0.007 1.84 ± 0.127 < 1 by target low: 5, 6" in text
    assert "human 1.805 ± 0.153" in text and "minimum jerk 1.875" in text
    third = summary["targets"][2]
    assert (
        f"3 {third['planned_r']:.4f} {third['executed_r']:.2f} {third['position_rmse_mm']:.2f} "
        f"{third['velocity_rmse_mm_s']:.1f} {third['manipulability']:.4f}"
    ) in text
    assert f"worst reach {summary['position_rmse_mm']['max']:.2f}" in text
    assert f"CAN frames {summary['bus']['frames']}, 0 lost" in text
    assert "32 reaches" in text and "in 2 logs" in text


def test_page_is_complete_in_itself_and_small(page: str) -> None:
    assert len(page) < 5_000_000
    assert page.count('src="data:image/png;base64,') == 6  # drawn anew: the run was told not to
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)[^"']*["']""", page)
    assert not re.findall(r"url\((?!#)", page) and "@import" not in page
    assert "<script" not in page
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))  # of all drawings and headings
    used = set(re.findall(r'(?:xlink:href|href)="#([^"]+)"|url\(#([^)]+)\)', page))
    assert {one or other for one, other in used} <= set(ids)


def test_configuration_marks_what_differs(page: str) -> None:
    assert "3 keys differ from sim_host/config/clock.toml and are marked." in text_of(page)
    (row,) = re.findall(r'<tr class="changed"><td>joint_coordination[^§]*?</tr>', page)
    assert text_of(row).startswith("joint_coordination.wrench_cutoff_Hz 80 100 Hz, low-pass")
    assert set(re.findall(r'class="changed"><td>([\w.]+)', page)) == {
        "joint_coordination.wrench_cutoff_Hz", "experiment.repetitions", "experiment.period_s",
    }  # fmt: skip


def test_versions_and_health(run: Path, page: str) -> None:
    info = RunFolder(run).info
    assert info is not None
    text = text_of(page)
    for value in (info["git"], info["protocol_hash"], info["libm"], info["build"]):
        assert re.sub(r"\s+", " ", value) in text
    assert "ARM_STATE 12100 1000.00 1.000 0 0 0" in text
    assert "181h N1_TPDO1" in text
    assert "Emergencies None." in text


def test_run_on_the_wall_clock_shows_how_long_its_periods_were() -> None:
    assert period_chart({"overruns": 0, "lateness_max_us": 12}) is None
    pace = {"period_us": 1000.0, "histogram_bin_us": 10.0, "period_histogram": [[98, 2], [100, 7]]}
    chart = period_chart(pace)
    assert chart is not None and chart.title == "Length of the SYNC periods"
    bars = re.findall(r"fill: var\(--blue\)", chart.svg)
    assert len(bars) == 2 and "from one SYNC to the next, ms" in chart.svg


# --- one reach -----------------------------------------------------------------------------------


def test_reach_has_the_signals_of_the_log_at_one_sync(run: Path) -> None:
    """Command and measurement of one SYNC: torque is that of JOINT_TORQUE at the same time."""
    folder = RunFolder(run)
    places = find_reaches(folder)
    assert [place.number for place in places] == list(range(1, 33))
    place = places[20]
    assert (place.repetition, place.reach, place.target) == (1, 4, 3)
    assert place.in_words == "reach 21, home to target 3, repetition 1"
    signals = read_reach(folder, place)
    span = place.from_us / 1e6, place.to_us / 1e6
    state = folder.read("HPMC_STATE", [], *span)
    arm = folder.read("ARM_STATE", [], *span)
    assert signals.time_s.size == len(state) == 300
    assert np.array_equal(signals.x_d_m[:, 1], state["x_d_m[1]"])
    assert np.array_equal(signals.tau_max_Nm[:, 2], state["tau_max_Nm[2]"])
    wrench = np.hypot(state["w_link_N[1][0]"], state["w_link_N[1][1]"])
    assert np.allclose(signals.link_force_N[:, 1], wrench)
    for joint in range(3):
        given = folder.read(f"JOINT_TORQUE_{joint + 1}", ["tau_Nm"], *span)
        assert np.allclose(signals.tau_Nm[:, joint], given["tau_Nm"], atol=1e-9)
        error = state[f"q_d_rad[{joint}]"] - arm[f"q_rad[{joint}]"]
        assert np.allclose(signals.joint_error_rad[:, joint], error, atol=1.1e-4)
    assert np.allclose(signals.hand_m[:, 0], arm["hand_m[0]"], atol=1e-4)
    assert np.allclose(signals.hand_speed_m_s, np.hypot(arm["hand_m_s[0]"], arm["hand_m_s[1]"]))
    assert 0.05 < signals.convergence.mean() < 0.95


def test_reach_allows_for_the_age_of_the_command(tmp_path: Path) -> None:
    """The command that acts at a SYNC is the RPDO1 before it on the bus, however old."""
    subprocess.run(
        [PROGRAMS["sil"], "--config", CONFIG / "clock.toml", "--set", "experiment.period_s=0.3",
         "--set", "bus.pipeline=2", "--set", "bus.command_delay_ms=3",
         "--log", tmp_path / "run.lcmlog"],
        check=True, capture_output=True, timeout=60,
    )  # fmt: skip
    folder = RunFolder(tmp_path)
    place = find_reaches(folder)[3]
    acting, newest = [], 0
    for message in folder.messages("CAN_FRAMES"):
        for frame in message["frames"]:
            if frame["id"] == 0x080 and place.from_us <= message["utime"] <= place.to_us:
                acting.append(newest)
            elif frame["id"] == 0x201:
                newest = int.from_bytes(bytes(frame["data"][:4]), "little", signed=True)
    arm = folder.read("ARM_STATE", ["q_rad"], place.from_us / 1e6, place.to_us / 1e6)
    error = np.array(acting) * 2 * np.pi / 65536 - arm["q_rad[0]"]
    assert np.ptp(error) > 1e-3
    assert np.allclose(read_reach(folder, place).joint_error_rad[:, 0], error, atol=1.1e-4)


def test_reach_is_the_worst_or_the_one_asked_for(run: Path, page: str, rig: Rig) -> None:
    summary = RunFolder(run).summary
    assert summary is not None
    worst = f"the one with the largest position error, {summary['position_rmse_mm']['max']:.2f} mm"
    assert worst in text_of(page)
    status, _, said = rig(run, "--reach", "33")
    assert (status, said) == (2, f"rig report: --reach 33: the reaches of {run} are 1 to 32\n")


# --- limits and faults ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def faulty(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first log of the run, with a limited node, an emergency and lost messages put into it."""
    folder = tmp_path_factory.mktemp("faulty")

    def change(channel: str, message: Any) -> bool:
        time_s = message.utime / 1e6
        if channel == "NODE_STATUS_2":
            if LIMITED_S[0] <= time_s < LIMITED_S[1]:
                message.limit_reasons = 0x0044
            if time_s >= FAULT_S:
                message.statusword, message.emcy_code = 0x0608, 0x8611
                message.emcy_count, message.missed_sync = 1, 7
        if channel == "CAN_FRAMES" and message.utime == round(FAULT_S * 1e6):
            frame = message_types().can_frame_t()
            frame.id, frame.sender, frame.len = 0x082, 2, 8
            frame.data = bytes.fromhex("1186210000020000")
            message.frames, message.count = [frame, *message.frames], message.count + 1
        return not (channel == "HAND_WRENCH" and 5000 <= message.seq < 5003)

    rewrite(run / "run-00.lcmlog", folder / "run.lcmlog", change)
    return folder


def test_limits_and_faults_in_words(faulty: Path) -> None:
    line = read_timeline(RunFolder(faulty))
    assert set(line.limits) == {(2, "T_max or latched f_max"), (2, "temperature")}
    (span,) = line.limits[2, "temperature"]
    assert (span.from_s, span.to_s) == pytest.approx(LIMITED_S, abs=0.0101)
    assert line.drives[2][-1].what == "fault"
    assert line.drives[2][-1].from_s == pytest.approx(FAULT_S)
    enabled_s = FAULT_S - 0.07
    assert line.limit_share[2, "temperature"] == pytest.approx(0.5 / enabled_s, rel=0.02)
    (emergency,) = line.emergencies
    # A node's frame was sent in the period before the one in whose message it is.
    assert emergency.time_s == pytest.approx(FAULT_S - 0.001)
    assert (emergency.who, emergency.what) == (
        "node 2", "8611h following error; register 21h (generic, drive); detail 512",
    )  # fmt: skip
    assert [span.what for span in line.phases] == [
        "boot", "configure", "enable", "approach", "reaches", "stop",
    ]  # fmt: skip
    text = text_of(quick_page(faulty))
    assert "following error; register 21h" in text
    assert "2 temperature" in text and "2 T_max or latched f_max" in text
    assert "HAND_WRENCH: 3 messages are lost" in text
    assert "HAND_WRENCH 3 4999 4.999 run.lcmlog" in text
    assert "2 1 7 25.0" in text  # node, emergencies, missed SYNCs, temperature


def test_emergencies_without_frames_come_from_the_node_status(
    faulty: Path, tmp_path: Path
) -> None:
    log = tmp_path / "run.lcmlog"
    rewrite(faulty / "run.lcmlog", log, lambda channel, _: channel != "CAN_FRAMES")
    (emergency,) = read_timeline(RunFolder(tmp_path)).emergencies
    assert emergency.what == "8611h following error"
    assert emergency.time_s == pytest.approx(FAULT_S, abs=0.0101)


# --- runs that lack something --------------------------------------------------------------------


def test_run_of_a_real_arm_has_no_arm_state(run: Path, tmp_path: Path) -> None:
    rewrite(
        run / "run-00.lcmlog", tmp_path / "run.lcmlog",
        lambda channel, _: channel not in ("ARM_STATE", "HAND_WRENCH") and "TORQUE" not in channel,
    )  # fmt: skip
    place = find_reaches(RunFolder(tmp_path))[0]
    encoders, arm = read_reach(RunFolder(tmp_path), place), read_reach(RunFolder(run), place)
    assert encoders.hand_speed_from == "from encoders over 20 ms"
    assert np.array_equal(encoders.tau_Nm, arm.tau_Nm)
    assert np.abs(encoders.hand_speed_m_s - arm.hand_speed_m_s).mean() < 0.01
    text = text_of(quick_page(tmp_path, 1))
    assert "from encoders over 20 ms" in text and "summary.json is missing" in text


def test_interrupted_run_with_a_damaged_log_says_what_is_missing_and_shows_the_rest(
    run: Path, tmp_path: Path
) -> None:
    data = bytearray((run / "run-00.lcmlog").read_bytes())
    quarter = len(data) // 4
    data[quarter : quarter + 5000] = bytes(5000)
    (tmp_path / "run.lcmlog").write_bytes(data[: 3 * quarter])
    text = text_of(quick_page(tmp_path))
    assert "summary.json is missing: the run did not come to its end" in text
    assert len(re.findall(r"run\.lcmlog: \d+ bytes at \d+ hold no whole message", text)) == 2
    assert re.search(r"ARM_STATE: \d+ messages are lost", text)
    assert re.search(r"\d reaches lack samples and are left out", text)
    assert "One reach, layer by layer" in text
    assert "paper 1.616 ± 0.007" in text


def test_run_that_ended_before_its_first_reach(run: Path, tmp_path: Path) -> None:
    rewrite(
        run / "run-00.lcmlog", tmp_path / "run.lcmlog", lambda _, message: message.utime < 900_000
    )
    text = text_of(make_page(tmp_path))
    assert "summary.json is missing" in text and "No reach was measured." in text
    assert "No reach could be measured" in text and "One reach, layer by layer" not in text
    assert "approach" in text


def test_log_of_states_only_whose_names_cannot_break_the_page(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "a <b> & 'c'"
    folder.mkdir()

    def change(channel: str, message: Any) -> bool:
        if channel == "RUN_INFO":
            message.git = "<img src=x onerror=alert(1)>"
        return channel in ("RUN_INFO", "ARM_STATE", "HPMC_STATE", "ARM_TARGET")

    rewrite(run / "run-00.lcmlog", folder / "run.lcmlog", change)
    page = quick_page(folder)
    text = text_of(page)
    assert "<img src=x" not in page and "a <b> &" not in page
    assert "a <b> & 'c'" in text and "<img src=x" in text
    assert "There is no NODE_STATUS in the log" in text
    assert "No limit reason is in the log." in text
    assert "One reach, layer by layer" in text


def test_log_without_configuration_and_one_of_another_program(tmp_path: Path, rig: Rig) -> None:
    write_clock_log(tmp_path / "run.lcmlog", reaches=2)
    text = text_of(quick_page(tmp_path))
    assert "There is no configuration: the reaches cannot be measured." in text
    assert "Reach 1, home to target 1" in text
    other = tmp_path / "other.lcmlog"
    log = lcm.EventLog(str(other), "w", overwrite=True)
    log.write_event(0, "ELSEWHERE", b"12345678")
    log.close()
    assert rig(other)[0] == 0
    text = text_of((tmp_path / "other.html").read_text())
    assert "ELSEWHERE: no elsewhere_t.lcm here" in text


# --- the command ---------------------------------------------------------------------------------


def test_page_goes_into_the_folder_or_where_it_is_told(run: Path, tmp_path: Path, rig: Rig) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    shutil.copy(DRAWN, folder)
    status, out, error = rig(folder)
    assert (status, error) == (0, "")
    assert re.fullmatch(rf"{folder}/report\.html  \d\.\d MB\n", out)
    page = (folder / "report.html").read_text()
    assert page.startswith("<!doctype html>")
    # The figure of the run is taken as it is, and no other is drawn.
    assert page.count("data:image/png") == 1
    assert base64.b64encode(DRAWN.read_bytes()).decode() in page
    target = tmp_path / "elsewhere" / "page.html"
    target.parent.mkdir()
    assert rig(folder, "-o", target, "--reach", "18")[0] == 0
    assert "Reach 18, target 1 to home, repetition 1" in target.read_text()
    assert [file.name for file in target.parent.iterdir()] == ["page.html"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["/no/such"], "cannot read /no/such: No such file or directory"),
        (["/etc/passwd"], "/etc/passwd is not an LCM log"),
        (["RUN", "-o", "/no/such/page.html"], "-o /no/such/page.html: there is no folder /no/such"),
        (["RUN", "-o", "/tmp"], "-o /tmp: is a folder"),
        (["RUN", "--reach", "0"], "argument --reach: '0': must be a whole number from 1 on"),
        ([], "the following arguments are required: RUN"),
    ],
)
def test_bad_input_is_one_line(run: Path, arguments: list[str], said: str, rig: Rig) -> None:
    status, out, error = rig(*(run / "run-00.lcmlog" if a == "RUN" else a for a in arguments))
    assert (status, out) == (2, "")
    assert error.startswith(f"rig report: {said}") and error.count("\n") == 1
