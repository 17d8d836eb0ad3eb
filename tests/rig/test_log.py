"""./rig log on runs of the rig; candump.log beside the log that it was made from."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from rigrun import JOINTS, LIMIT_S, RIG, Run

from hpmc.layout import ROOT
from hpmc.log_info import describe
from hpmc.run_folder import RunFolder

REACHES = 4  # the phase of the run in which commands are sent as they are computed
TORQUE_UNIT_NM = 1e-3
RADIANS_PER_INCREMENT = 2 * np.pi / 65536


def rig_log(*arguments: str | Path, status: int = 0) -> str:
    done = subprocess.run(
        [RIG, "log", *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True,
        timeout=LIMIT_S, check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout


def test_the_same_movement_on_the_bus_and_in_one_process_does_not_differ(
    sil: Run, vcan: Run
) -> None:
    said = rig_log("diff", sil.folder, vcan.folder)
    assert "mode: sil | vcan" in said
    assert "the same: 12 channels" in said


def test_injected_sensors_differ(short_sil: Run, short_injected: Run) -> None:
    said = rig_log("diff", short_sil.folder, short_injected.folder, status=1)
    assert "rig.sensors: direct | injected" in said
    assert "first difference at " in said


def test_info_of_a_run_has_no_gap(vcan: Run) -> None:
    description = describe(RunFolder(vcan.folder))
    assert description.problems == ()
    facts = {facts.channel: facts for facts in description.channels}
    assert all(entry.lost == 0 and entry.type_name for entry in facts.values())
    for channel in ("ARM_STATE", "HPMC_STATE", "CAN_FRAMES", "JOINT_TORQUE_3"):
        assert facts[channel].rhythm.rate_hz == 1000
        assert facts[channel].rhythm.jitter_max_us == 0
    assert description.config["joint"]["rate_Hz"] == 1000
    assert description.messages == vcan.summary["lcm"]["messages"]


@pytest.mark.parametrize("to", ["csv", "parquet", "mat", "mcap"])
def test_a_run_is_exported(short_sil: Run, tmp_path: Path, to: str) -> None:
    said = rig_log("export", short_sil.folder, "--to", to, "-o", tmp_path / to)
    assert len(said.splitlines()) == (13 if to in ("csv", "parquet") else 1)
    q_rad = short_sil.log().column("ARM_STATE", "q_rad")
    assert np.array_equal(exported_angles(tmp_path / to, to), q_rad)


def exported_angles(folder: Path, to: str) -> Any:
    if to == "csv":
        return np.loadtxt(folder / "ARM_STATE.csv", delimiter=",", skiprows=1, usecols=(2, 3, 4))
    if to == "parquet":
        from pyarrow import parquet

        table = parquet.read_table(folder / "ARM_STATE.parquet")
        return np.column_stack([table[f"q_rad[{i}]"].to_numpy() for i in range(3)])
    if to == "mat":
        from scipy.io import loadmat

        return loadmat(folder / "run.mat", simplify_cells=True)["ARM_STATE"]["q_rad"]
    import json

    from mcap.reader import make_reader

    with (folder / "run.mcap").open("rb") as file:
        messages = make_reader(file).iter_messages(topics="ARM_STATE")
        return np.array([json.loads(message.data)["q_rad"] for _, _, message in messages])


def test_candump_log_is_decoded_to_the_values_of_the_log(short_sil: Run) -> None:
    """By python-can and cantools with motor_node.dbc, frame by frame."""
    database = cantools.database.load_file(ROOT / "firmware/od/motor_node.dbc")
    log = short_sil.log()
    state = log.read("HPMC_STATE")
    torque = {n: log.column(f"JOINT_TORQUE_{n}", "tau_Nm") for n in JOINTS}
    commands, replies = 0, 0
    with can.LogReader(str(short_sil.folder / "candump.log")) as reader:
        for frame in reader:
            node, function = frame.arbitration_id & 0x7F, frame.arbitration_id & 0x780
            if function not in (0x180, 0x200):
                continue
            decoded = database.decode_message(
                frame.arbitration_id, bytes(frame.data), decode_choices=False
            )
            tick = round(frame.timestamp * 1000)
            joint = node - 1
            if function == 0x200 and state["phase"][tick] == REACHES:
                now = state[tick]
                wanted_inc = now["q_d_rad"][joint] / RADIANS_PER_INCREMENT
                assert abs(decoded["target_position"] - wanted_inc) <= 0.5 + 1e-6
                for signal, field in (("target_torque", "tau_d_Nm"), ("max_torque", "tau_max_Nm")):
                    assert abs(decoded[signal] - now[field][joint]) <= 0.5001 * TORQUE_UNIT_NM
                commands += 1
            elif function == 0x180:
                assert decoded["torque_actual_value"] == pytest.approx(torque[node][tick], abs=1e-9)
                if tick + 1 < state.size and state["phase"][tick + 1] == REACHES:
                    after = state[tick + 1]  # one period later the host has it
                    assert after["q_rad"][joint] == pytest.approx(
                        decoded["position_actual_value"] * RADIANS_PER_INCREMENT, abs=1e-12
                    )
                    assert after["tau_Nm"][joint] == pytest.approx(
                        decoded["torque_actual_value"], abs=1e-9
                    )
                    assert int(after["statusword"][joint]) & 0xFFFF == decoded["statusword"]
                    replies += 1
    assert commands > 9000 and replies > 9000
