"""Messages of a run as what the page draws: plain numbers in SI units, small enough for JSON."""

import tomllib
from typing import Any

import numpy as np

from hpmc import node_words
from hpmc.lcm_types import FINGERPRINT_BYTES, load_type

_ROUNDED = 6  # digits behind the point: 1 um, 1 urad, 1 uN m


class PictureError(ValueError):
    """A message of another version of the .lcm files; the text says which."""


def record(channel_type: str, payload: bytes) -> np.void:
    """Decodes one message of fixed size."""
    lcm_type = load_type(channel_type)
    dtype = lcm_type.dtype
    assert dtype is not None
    fits = len(payload) == FINGERPRINT_BYTES + dtype.itemsize
    if not fits or int.from_bytes(payload[:FINGERPRINT_BYTES], "big") != lcm_type.fingerprint:
        raise PictureError(f"the run was made with another {channel_type}.lcm")
    return np.frombuffer(payload, dtype, 1, FINGERPRINT_BYTES)[0]


def _numbers(value: np.ndarray) -> list[Any] | None:
    # JSON knows no NaN and no infinity; the page leaves out what is null.
    if np.isfinite(value).all():
        rounded: list[Any] = np.round(value.astype(float), _ROUNDED).tolist()
        return rounded
    return None


def state_picture(state: np.void) -> dict[str, Any]:
    """One HPMC_STATE; links in the order elbow, wrist, hand."""
    words = [int(word) & node_words.WORD for word in state["statusword"]]
    return {
        "t": int(state["utime"]) / 1e6,  # s, run clock
        "repetition": int(state["repetition"]),
        "reach": int(state["reach"]),
        "target": int(state["target"]),
        "phase": int(state["phase"]),
        "x_t": _numbers(state["x_t_m"]),
        "x_d": _numbers(state["x_d_m"]),
        "links": _numbers(state["x_link_m"]),
        "links_d": _numbers(state["x_link_d_m"]),
        "forces": _numbers(state["w_link_N"]),
        "wrench": _numbers(state["wrench_N"]),
        "q": _numbers(state["q_rad"]),
        "q_d": _numbers(state["q_d_rad"]),
        "tau": _numbers(state["tau_Nm"]),
        "tau_d": _numbers(state["tau_d_Nm"]),
        "tau_max": _numbers(state["tau_max_Nm"]),
        "convergence": [word >> node_words.CONVERGENCE_BIT & 1 for word in words],
        "drive": [node_words.drive_state(word) for word in words],
        "saturated": bool(state["saturated"]),
    }


def node_picture(status: np.void) -> dict[str, Any]:
    """One NODE_STATUS_n, in words."""
    code = int(status["emcy_code"])
    count = int(status["emcy_count"])
    return {
        "node": int(status["node_id"]),
        "t": int(status["utime"]) / 1e6,
        "drive": node_words.drive_state(int(status["statusword"])),
        "nmt": node_words.nmt_state(int(status["nmt_state"])),
        "limits": node_words.limit_reasons(int(status["limit_reasons"])),
        "missed_sync": int(status["missed_sync"]),
        "temperature_C": int(status["temperature_dC"]) / 10,
        "emergency": f"{code:04X}h {node_words.emergency(code)}" if count else "",
        "emergencies": count,
    }


def rig_picture(info: dict[str, Any]) -> dict[str, Any]:
    """What the page must know of a run, from its RUN_INFO."""
    values = tomllib.loads(info["config_toml"])
    return {
        "mode": info["mode"],
        "seed": info["seed"],
        "git": info["git"],
        "length_m": values["arm"]["length_m"],
        "centre_m": values["experiment"]["centre_m"],
        "radius_m": values["experiment"]["radius_m"],
        "clock": values["experiment"].get("path", "clock") == "clock",
        "reaches": values["experiment"].get("reaches", 16),
        "region_m": values["region_of_attraction"]["saturation_m"],
        "torque_limit_Nm": values["joint_coordination"]["torque_limit_Nm"],
        "w_t_rad": values["dynamic_task"]["w_t_rad"],
    }
