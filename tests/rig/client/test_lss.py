"""LSS by python-canopen: a node without a node-id is found, gets one, and keeps it."""

from __future__ import annotations

from pathlib import Path

import canopen
import pytest
from canopen.lss import LssError
from conftest import EDS, Bench, until_booted

PRODUCT = 0x46494301
REVISION = 0x00010000
SERIAL = 0x00C0FFEE


@pytest.fixture
def lss(network: canopen.Network) -> canopen.lss.LssMaster:
    network.lss.RESPONSE_TIMEOUT = 0.06
    return network.lss


def test_fastscan_configures_an_unconfigured_node(
    bench: Bench, network: canopen.Network, lss: canopen.lss.LssMaster, tmp_path: Path
) -> None:
    memory = ("--parameters", str(tmp_path / "parameters"), "--serial", str(SERIAL))
    bench.start(255, *memory)
    found, identity = lss.fast_scan()
    assert found
    assert identity == [0, PRODUCT, REVISION, SERIAL]
    assert lss.inquire_node_id() == 255
    lss.configure_node_id(42)
    lss.store_configuration()
    node = network.add_node(42, str(EDS))
    lss.send_switch_state_global(lss.WAITING_STATE)
    until_booted(node)
    assert node.sdo[0x1018][4].raw == SERIAL
    bench.stop()
    node.nmt._state = 0
    bench.start(255, *memory)  # power-on: the stored node-id
    until_booted(node)
    assert lss.fast_scan() == (False, None)


def test_selective_switch_and_inquiries(
    node: canopen.BaseNode402, bench: Bench, network: canopen.Network, lss: canopen.lss.LssMaster
) -> None:
    bench.start(6)
    node.sdo[0x1000].raw  # noqa: B018  (both are up)
    assert lss.send_switch_state_selective(0, PRODUCT, REVISION, 5)
    assert lss.inquire_node_id() == 5  # one answer: node 6 waits
    assert lss.inquire_lss_address(0x5B) == PRODUCT
    assert lss.inquire_lss_address(0x5D) == 5
    with pytest.raises(LssError):
        lss.configure_node_id(128)
    with pytest.raises(LssError):
        lss.store_configuration()  # this one has no memory
    lss.configure_node_id(77)
    lss.send_switch_state_global(lss.WAITING_STATE)
    moved = network.add_node(77, str(EDS))
    node.nmt.state = "RESET COMMUNICATION"
    until_booted(moved)
    assert moved.sdo[0x1018][4].raw == 5


def test_parameters_are_saved_and_restored(
    bench: Bench, network: canopen.Network, tmp_path: Path
) -> None:
    memory = ("--parameters", str(tmp_path / "parameters"))
    bench.start(5, *memory)
    node = network.add_node(5, str(EDS))
    until_booted(node)
    assert node.sdo[0x1010][1].raw == 1
    node.sdo[0x2100][4].raw = 4321
    with pytest.raises(canopen.SdoAbortedError) as refused:
        node.sdo[0x1010][1].raw = 1
    assert refused.value.code == 0x08000020
    node.sdo[0x1010][1].raw = 0x65766173
    node.sdo[0x2100][4].raw = 1
    for expected in (4321, 4321, 5000):
        if expected == 5000:
            node.sdo[0x1011][1].raw = 0x64616F6C
            assert node.sdo[0x2100][4].raw == 4321  # until the reset
        node.nmt.state = "RESET"
        until_booted(node)
        assert node.sdo[0x2100][4].raw == expected


def test_without_a_memory_saving_is_refused(node: canopen.BaseNode402) -> None:
    assert node.sdo[0x1010][1].raw == 0
    with pytest.raises(canopen.SdoAbortedError) as refused:
        node.sdo[0x1010][1].raw = 0x65766173
    assert refused.value.code == 0x060A0023
