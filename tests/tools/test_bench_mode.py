"""What mode bench makes of an interface, and which rates of SYNC fit on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hpmc.configuration import ConfigurationError, load_configuration
from hpmc.modes import bench
from hpmc.movements import held, slopes


def link(kind: str = "", **changes: Any) -> dict[str, Any]:
    info = {"info_kind": kind} if kind else {"info_data": {"bittiming": {"bitrate": 1000000}}}
    return {"link_type": "can", "flags": ["UP", "LOWER_UP"], "linkinfo": info} | changes


def test_only_vcan_is_virtual() -> None:
    assert bench.interface_of("vcan0", link("vcan")).virtual
    for kind in ("", "vxcan", "slcan"):
        assert not bench.interface_of("can0", link(kind)).virtual


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (link(link_type="ether"), "of type ether, not can"),
        (link(flags=[]), "is down; ip link set can0 up type can bitrate 1000000"),
        (link(linkinfo={"info_data": {"bittiming": {"bitrate": 500000}}}), "500000 bit/s"),
    ],
)
def test_interfaces_that_do_not_serve(told: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        bench.interface_of("can0", told)


def test_motion_wants_a_yes_but_on_a_virtual_bus_or_with_injected_sensors() -> None:
    can0, vcan0 = bench.Interface("can0", False), bench.Interface("vcan0", True)
    with pytest.raises(ConfigurationError, match="--yes-move"):
        bench.check_motion(can0, injected=False, yes_move=False)
    bench.check_motion(can0, injected=False, yes_move=True)
    bench.check_motion(can0, injected=True, yes_move=False)
    bench.check_motion(vcan0, injected=False, yes_move=False)


@pytest.mark.parametrize(
    ("sensors", "rate", "load"),
    [("direct", 1000, 87.5), ("injected", 500, 64.0), ("injected", 250, 32.0)],
)
def test_rates_that_fit_on_a_physical_bus(sensors: str, rate: int, load: float) -> None:
    overrides = [f"rig.sensors={sensors}", f"bench.sync_Hz={rate}"]
    configuration = load_configuration("clock", overrides=overrides)
    assert bench.bus_load_percent(configuration) == pytest.approx(load)
    bench.check_load(bench.Interface("can0", False), configuration)


def test_injected_sensors_at_one_kilohertz_are_for_virtual_buses() -> None:
    configuration = load_configuration("clock", overrides=["rig.sensors=injected"])
    bench.check_load(bench.Interface("vcan0", True), configuration)
    with pytest.raises(ConfigurationError, match=r"128\.0 % of can0 .* bench\.sync_Hz=500"):
        bench.check_load(bench.Interface("can0", False), configuration)


def test_a_place_stands_while_none_is_told() -> None:
    told = np.array([[0.3, 0.1], [0.3, 0.0], [0.0, 0.0], [0.0, 0.0], [0.2, 0.1]])
    assert held(told)[:, 0].tolist() == [0.3, 0.3, 0.3, 0.3, 0.2]


def test_slopes_of_a_parabola_are_exact_and_steps_are_smoothed() -> None:
    time_s = np.arange(100) * 1e-3
    curve = np.column_stack([3.0 * time_s**2, 1.0 - 2.0 * time_s])
    found = slopes(curve, 10, 1e-3)[10:-10]
    np.testing.assert_allclose(found[:, 0], 6.0 * time_s[10:-10], atol=1e-12)
    np.testing.assert_allclose(found[:, 1], -2.0, atol=1e-12)
    steps = np.round(curve / 1e-4) * 1e-4
    assert np.abs(slopes(steps, 10, 1e-3)[10:-10] - found).max() < 0.01
