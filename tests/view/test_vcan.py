"""./rig view reaches into the sandbox of a vcan run."""

import json
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from conftest import process, until, viewer
from websockets.sync.client import connect

from hpmc.layout import ROOT
from hpmc.lcm_log import LcmLog
from hpmc.view.live import sandboxes

ASKED = [0.28, 0.03]
AFTER_S = 0.5


def drag_once(url: str) -> dict[str, Any]:
    """Asks for a target during the reaches; a state half a second of run time after it acted."""
    asked, acted_s = False, None
    with connect(f"ws://{urlsplit(url).netloc}/ws", origin=url.rstrip("/"), proxy=None) as page:
        while True:
            message = json.loads(page.recv(timeout=60))
            for state in message.get("states", []):
                if state["phase"] == 4 and not asked:
                    page.send(json.dumps({"do": "target", "x": ASKED[0], "y": ASKED[1]}))
                    asked = True
                if acted_s is None and state["x_t"] == ASKED:
                    acted_s = state["t"]
                if acted_s is not None and state["t"] > acted_s + AFTER_S:
                    assert [node["drive"] for node in message["nodes"]] == 3 * ["operation enabled"]
                    return state


def test_target_dragged_in_a_vcan_run_whose_log_repeats_it_in_sil(tmp_path: Path) -> None:
    folder = tmp_path / "vcan"
    with process(
        sys.executable, "-m", "hpmc", "run", "clock", "--no-figures", "--out", folder,
        "--set", "experiment.period_s=5",
    ) as run:  # fmt: skip
        name = f"run-{run.pid}"
        until(lambda: name in sandboxes() or run.poll() is not None, "the sandbox of the run")
        with viewer(name) as url:
            last = drag_once(url)
    log = LcmLog(folder / "run.lcmlog")
    (target,) = [m for m in log.messages("ARM_TARGET") if m["target"] == -1]
    assert target["x_t_m"] == ASKED

    again = tmp_path / "sil"
    with process(
        sys.executable, "-m", "hpmc", "run", "clock", "--mode", "sil", "--no-figures",
        "--out", again, "--config", folder / "config.toml", "--targets", folder,
    ) as repetition:  # fmt: skip
        assert repetition.stdout is not None
        said = repetition.stdout.read()
        assert repetition.wait(120) == 0
    assert "targets from outside: 1;" in said
    periods = round(1000 * last["t"])
    assert periods > target["utime"] / 1000 + 1000 * AFTER_S - 2
    states = list(log.raw_messages("ARM_STATE"))[:periods]
    assert len(states) == periods
    assert states == list(LcmLog(again / "run.lcmlog").raw_messages("ARM_STATE"))[:periods]


def test_viewer_ends_with_the_run(tmp_path: Path) -> None:
    """It says so; and nothing of it stays in the sandbox."""
    with socket.socket() as probe:  # a name that no other test has now
        probe.bind(("127.0.0.1", 0))
        name = f"run-0{probe.getsockname()[1]}"
    sandbox = [ROOT / "tools" / "with-vcan", "--name", name, "cat"]
    with subprocess.Popen(sandbox, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL) as cat:
        until(lambda: name in sandboxes(), "the sandbox")
        with process(sys.executable, "-m", "hpmc", "view", name) as view:
            assert view.stdout is not None
            assert view.stdout.readline().startswith("open http://127.0.0.1:")
            assert cat.stdin is not None
            cat.stdin.close()
            assert cat.wait(60) == 0
            assert view.stdout.readline() == "the run has ended\n"
            assert view.wait(60) == 0
