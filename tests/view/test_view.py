"""Parts of ./rig view without a browser: which run, what it says, words, the relay."""

import asyncio
import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ENVIRONMENT, sil_at_human_speed

from hpmc import node_words
from hpmc.layout import ROOT
from hpmc.lcm_log import LcmLog
from hpmc.view import command, live
from hpmc.view.live import Relay, relay_command, split_events
from hpmc.view.pictures import record, state_picture
from hpmc.view.replay import Replay


def view(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hpmc", "view", *map(str, arguments)], cwd=ROOT, text=True,
        env=ENVIRONMENT, capture_output=True, timeout=60, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(("arguments", "line"), [
    (["no/such/run"], "no/such/run: is neither the folder of a run nor the sandbox of one going"),
    (["--port", "65536"], "--port 65536: must be 0 to 65535"),
    (["--port", "x"], "argument --port: invalid int value: 'x'"),
    (["a", "b"], "unrecognized arguments: b"),
])  # fmt: skip
def test_bad_input_gets_one_line(arguments: list[str], line: str) -> None:
    answer = view(*arguments)
    assert answer.returncode == 2
    assert answer.stderr.startswith(f"rig view: {line}")
    assert answer.stderr.count("\n") == 1


def test_no_log_in_the_folder(tmp_path: Path) -> None:
    answer = view(tmp_path)
    assert answer.returncode == 2
    assert answer.stderr == f"rig view: {tmp_path} is no run: it holds no run*.lcmlog\n"


def test_no_live_run_is_said_in_one_line(lcm_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "sandboxes", list)
    with pytest.raises(command.UsageError, match="no run is going on") as error:
        asyncio.run(command.find_live(None, lcm_url))
    assert "\n" not in str(error.value)


def test_of_several_live_runs_one_must_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "sandboxes", lambda: ["run-7", "run-12"])
    with pytest.raises(command.UsageError, match="say which of run-7, run-12"):
        asyncio.run(command.find_live(None, "udpm://239.255.76.67:1?ttl=0"))


def test_states_of_a_log_at_an_instant(run_log: Path) -> None:
    replay = Replay(run_log)
    log = LcmLog(run_log / "run.lcmlog")
    times = log.column("HPMC_STATE", "utime") / 1e6
    assert (replay.begin_s, replay.end_s) == (times[0], times[-1])
    assert replay.marks() == pytest.approx([1.0 + 0.5 * reach for reach in range(16)])
    states = replay.states(2.0, 2.01, 100)
    assert [state["t"] for state in states] == pytest.approx([2.0 + i / 1000 for i in range(1, 11)])
    row = int(np.searchsorted(times, 2.01))
    assert states[-1]["x_d"] == pytest.approx(log.column("HPMC_STATE", "x_d_m")[row], abs=1e-6)
    thin = replay.states(2.0, 4.0, 50)
    assert len(thin) == 50 and thin[-1]["t"] == pytest.approx(4.0)
    assert replay.states(4.0, 4.0, 50) == []
    nodes = replay.nodes(5.0)
    assert [node["node"] for node in nodes] == [1, 2, 3]
    assert {node["drive"] for node in nodes} == {"operation enabled"}
    assert all(4.98 < node["t"] <= 5.0 for node in nodes)
    assert replay.nodes(0.0005) == [] or replay.nodes(0.0005)[0]["t"] <= 0.0005


def test_phase_colours_come_from_the_statusword(run_log: Path) -> None:
    log = LcmLog(run_log / "run.lcmlog")
    rows = log.read("HPMC_STATE", 2000, 2400)
    seen = set()
    for row in rows:
        picture = state_picture(row)
        for joint in range(3):
            bit = (int(row["statusword"][joint]) & 0x4000) != 0
            assert picture["convergence"][joint] == bit
            seen.add(bit)
    assert seen == {False, True}


def test_what_is_no_number_is_left_out(run_log: Path) -> None:
    row = LcmLog(run_log / "run.lcmlog").read("HPMC_STATE", 2000, 2001)[0].copy()
    row["x_d_m"][0] = np.nan
    assert state_picture(row)["x_d"] is None


def test_words() -> None:
    assert node_words.drive_state(0x4237) == "operation enabled"
    assert node_words.drive_state(0x0208) == "fault"
    assert node_words.nmt_state(127) == "pre-operational"
    assert node_words.emergency(0x8250) == "no command within the deadline"


def test_words_of_every_limit_reason_and_emergency_of_the_firmware() -> None:
    """Each bit and code that the C headers define has a word."""
    headers = "".join(path.read_text() for path in (ROOT / "firmware").rglob("*.h"))
    masks = re.findall(r"define LIMIT_REASON_\w+ 0x([0-9A-F]+)U", headers)
    bits = [int(mask, 16) for mask in masks]
    assert len(bits) > 10
    for mask in bits:
        (word,) = node_words.limit_reasons(mask)
        assert not word.startswith("bit "), f"{mask:#x}"
    codes = [int(code, 16) for code in re.findall(r"EMCY_\w+ = 0x([0-9A-F]{4})", headers)]
    assert len(codes) > 10
    for code in codes:
        assert node_words.emergency(code) != "unknown emergency", f"{code:04X}h"


def test_relay_thins_out_and_asks_for_targets(tmp_path: Path, lcm_url: str) -> None:
    async def look() -> tuple[list[dict[str, object]], set[str]]:
        states: list[dict[str, object]] = []
        channels: set[str] = set()
        asked = False
        async with Relay(relay_command(None, lcm_url)) as relay, asyncio.timeout(60):
            async for events in relay.batches():
                channels |= {channel for channel, _ in events}
                states += [
                    state_picture(record("hpmc_state_t", payload))
                    for channel, payload in events
                    if channel == "HPMC_STATE"
                ]
                if states and states[-1]["phase"] == 4 and not asked:
                    relay.send_target(0.28, 0.03)
                    asked = True
                if states and states[-1]["x_t"] == [0.28, 0.03] and "RUN_INFO" in channels:
                    break
        return states, channels

    log = tmp_path / "run.lcmlog"
    with sil_at_human_speed(lcm_url, log):
        states, channels = asyncio.run(look())
    assert all(round(float(str(state["t"])) * 1000) % 8 == 0 for state in states)
    assert channels >= {"HPMC_STATE", "NODE_STATUS_1", "NODE_STATUS_3", "RUN_INFO", "RELAY"}
    assert not channels & {"CAN_FRAMES", "ARM_STATE"}
    # Stamped with the period at which it acted, the request itself is not logged.
    targets = [m for m in LcmLog(log).messages("ARM_TARGET") if m["target"] == -1]
    assert [target["x_t_m"] for target in targets] == [[0.28, 0.03]]
    assert targets[0]["seq"] == 1 and targets[0]["utime"] % 1000 == 0


def test_stream_in_pieces_of_any_size(run_log: Path) -> None:
    data = (run_log / "run.lcmlog").read_bytes()[:20000]
    whole = split_events(bytearray(data))
    buffer, pieces = bytearray(), []
    for at in range(0, len(data), 7):
        buffer += data[at : at + 7]
        pieces += split_events(buffer)
    assert pieces == whole and len(whole) > 50
    with pytest.raises(live.LiveError, match="damaged"):
        split_events(bytearray(b"\0" * 100))


def test_sandboxes_of_runs_are_found_by_name() -> None:
    with socket.socket(socket.AF_UNIX) as fake:
        fake.bind(f"\0with-vcan/{os.geteuid()}/run-{os.getpid()}")
        assert f"run-{os.getpid()}" in live.sandboxes()
    assert f"run-{os.getpid()}" not in live.sandboxes()


def test_publishing_at_human_speed_changes_nothing(tmp_path: Path, lcm_url: str) -> None:
    """`./rig run --mode sil` with --lcm-url and --pace realtime beside a plain one."""
    short = ("--mode", "sil", "--no-figures", "--set", "experiment.period_s=0.2")
    ways = {"plain": (), "live": ("--lcm-url", lcm_url, "--pace", "realtime")}
    logs = {}
    for name, options in ways.items():
        folder = tmp_path / name
        subprocess.run(
            [sys.executable, "-m", "hpmc", "run", "clock", *short, *options, "--out", folder],
            cwd=ROOT, env=ENVIRONMENT, check=True, stdout=subprocess.DEVNULL, timeout=120,
        )  # fmt: skip
        logs[name] = LcmLog(folder / "run.lcmlog")
    assert logs["plain"].channels == logs["live"].channels
    for channel in logs["plain"].channels:
        assert [*logs["plain"].raw_messages(channel)] == [*logs["live"].raw_messages(channel)]
    summary = json.loads((tmp_path / "live" / "summary.json").read_text())
    assert summary["pace"] is not None and summary["real_time_factor"] < 1.05
