"""SDO access to every object of the electronic data sheet, with boundary and forbidden values."""

from __future__ import annotations

import re
import struct
import time
from collections.abc import Iterator

import canopen
import pytest
from canopen.objectdictionary import ODVariable
from conftest import EDS, ticks

READ_ONLY = 0x06010002
NO_OBJECT = 0x06020000
INCOMPATIBLE = 0x06040043
TOO_LONG = 0x06070012
TOO_SHORT = 0x06070013
NO_SUBINDEX = 0x06090011
RANGE = 0x06090030
TOO_HIGH = 0x06090031
TOO_LOW = 0x06090032
COMMAND = 0x05040001
NOT_STORED = 0x08000020
STATE = 0x08000022
NO_DATA = 0x08000024

NUMBERS = {2: "<b", 3: "<h", 4: "<i", 5: "<B", 6: "<H", 7: "<I"}
STRING = 9
# Values differ from the data sheet's from the moment of power-on.
LIVE = {0x1001, 0x100A, 0x1010, 0x1018, 0x2200, 0x2202, 0x6041, 0x6064}
# Commands and other objects whose values have rules of their own: tested one by one below.
OWN_RULES = {0x1003, 0x1010, 0x1011, 0x1016, 0x1019, 0x1028, 0x605A, 0x6060, 0x607D, 0x6098}


def variables() -> list[ODVariable]:
    od = canopen.import_od(str(EDS), 5)
    found = []
    for item in od.values():
        found += [item] if isinstance(item, ODVariable) else list(item.values())
    return found


def name(variable: ODVariable) -> str:
    return f"{variable.index:04X}:{variable.subindex:02X}"


def abort_of(node: canopen.RemoteNode, variable: ODVariable, data: bytes, **how: bool) -> int:
    """Code of the abort that a write meets; 0 when it is accepted."""
    return abort(node, variable.index, variable.subindex, data, **how)


def abort(
    node: canopen.RemoteNode, index: int, subindex: int, data: bytes, **how: bool
) -> int:
    try:
        node.sdo.download(index, subindex, data, **how)
    except canopen.SdoAbortedError as error:
        return error.code
    return 0


def read(node: canopen.RemoteNode, index: int, subindex: int, form: str) -> int:
    (value,) = struct.unpack(form, node.sdo.upload(index, subindex))
    return value


def test_data_sheet_loads_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    assert len(variables()) > 100
    assert caplog.records == []


def test_every_object_can_be_read_and_has_its_default(node: canopen.BaseNode402) -> None:
    wrong = []
    for variable in variables():
        if variable.index == 0x1003 and variable.subindex > 0:
            with pytest.raises(canopen.SdoAbortedError) as refused:
                node.sdo.upload(variable.index, variable.subindex)
            assert refused.value.code == NO_DATA
            continue
        data = node.sdo.upload(variable.index, variable.subindex)
        if variable.data_type == STRING:
            assert data.decode().startswith(variable.default)
            continue
        (value,) = struct.unpack(NUMBERS[variable.data_type], data)
        if variable.index not in LIVE and value != variable.default:
            wrong.append((name(variable), value, variable.default))
    assert wrong == []


def test_objects_that_only_read_refuse_every_write(node: canopen.BaseNode402) -> None:
    wrong = []
    for variable in variables():
        if variable.writable:
            continue
        data = node.sdo.upload(0x1000, 0)
        for how in ({}, {"force_segment": True}):
            code = abort_of(node, variable, data, **how)
            if code != READ_ONLY:
                wrong.append((name(variable), how, hex(code)))
    assert wrong == []


@pytest.fixture
def stepped(node: canopen.BaseNode402) -> Iterator[None]:
    """Somebody closes the ticks, for tests that set 2F01h."""
    with ticks(node.network, node.id):
        yield


@pytest.mark.usefixtures("stepped")
def test_writes_within_and_beyond_the_range(node: canopen.BaseNode402) -> None:
    wrong = []
    count = 0
    for variable in variables():
        if not variable.writable or variable.index in OWN_RULES:
            continue
        form = NUMBERS[variable.data_type]
        signed = form.islower()
        bits = 8 * struct.calcsize(form)
        lowest = -(1 << (bits - 1)) if signed else 0
        highest = (1 << (bits - 1 if signed else bits)) - 1
        low = lowest if variable.min is None else variable.min
        high = highest if variable.max is None else variable.max
        expected = {low: 0, high: 0}
        if low > lowest:
            expected |= {low - 1: TOO_LOW, lowest: TOO_LOW}
        if high < highest:
            expected |= {high + 1: TOO_HIGH, highest: TOO_HIGH}
        for value, code in [*expected.items(), (variable.default, 0)]:
            data = struct.pack(form, value)
            for how in ({}, {"force_segment": True}):
                got = abort_of(node, variable, data, **how)
                count += 1
                if got != code:
                    wrong.append((name(variable), value, how, hex(got)))
            if code == 0 and read(node, variable.index, variable.subindex, form) != value:
                wrong.append((name(variable), value, "was not stored"))
    assert wrong == []
    assert count > 200


def test_writes_of_the_wrong_size(node: canopen.BaseNode402) -> None:
    wrong = []
    for variable in variables():
        if not variable.writable:
            continue
        size = struct.calcsize(NUMBERS[variable.data_type])
        for how in ({}, {"force_segment": True}):
            long = abort_of(node, variable, bytes(size + 1), **how)
            short = abort_of(node, variable, bytes(size - 1), **how) if size > 1 else TOO_SHORT
            if (long, short) != (TOO_LONG, TOO_SHORT):
                wrong.append((name(variable), how, hex(long), hex(short)))
    assert wrong == []


def test_what_does_not_exist(node: canopen.BaseNode402) -> None:
    known = {variable.index for variable in variables()}
    for index in (0x0001, 0x0FFF, 0x1002, 0x1402, 0x2000, 0x5FFF, 0x6503, 0xFFFF):
        assert index not in known
        assert abort(node, index, 0, b"\0") == NO_OBJECT
    for index, subindex in ((0x1000, 1), (0x1018, 5), (0x1400, 3), (0x2100, 9), (0x6040, 255)):
        assert abort(node, index, subindex, b"\0") == NO_SUBINDEX


def test_block_transfer_is_refused(node: canopen.BaseNode402) -> None:
    with pytest.raises(canopen.SdoAbortedError) as refused:
        node.sdo.open(0x1008, 0, "rb", block_transfer=True).read()
    assert refused.value.code == COMMAND


def test_segmented_upload_of_a_string(node: canopen.BaseNode402) -> None:
    text = node.sdo[0x100A].raw
    assert re.fullmatch(r"\d+\.\d+\.\d+\+[0-9a-f]{8}", text) and len(text) > 7


def test_segmented_transfer_that_stands_still_is_aborted(
    node: canopen.BaseNode402, network: canopen.Network
) -> None:
    heard: list[bytes] = []
    network.subscribe(0x585, lambda _id, data, _time: heard.append(bytes(data)))
    network.send_message(0x605, bytes([0x40, 0x08, 0x10, 0, 0, 0, 0, 0]))
    time.sleep(1.2)
    assert heard[0][0] == 0x41
    assert heard[1] == bytes([0x80, 0x08, 0x10, 0, 0, 0, 0x04, 0x05])
    network.send_message(0x605, bytes([0x60, 0, 0, 0, 0, 0, 0, 0]))
    time.sleep(0.05)
    assert heard[2][4:] == bytes([0x01, 0, 0x04, 0x05])


def test_toggle_bit(node: canopen.BaseNode402, network: canopen.Network) -> None:
    heard: list[bytes] = []
    network.subscribe(0x585, lambda _id, data, _time: heard.append(bytes(data)))
    for command in (0x40, 0x70):
        network.send_message(0x605, bytes([command, 0x08, 0x10, 0, 0, 0, 0, 0]))
        time.sleep(0.05)
    assert heard[1] == bytes([0x80, 0x08, 0x10, 0, 0, 0, 0x03, 0x05])


def test_error_history(node: canopen.BaseNode402) -> None:
    assert abort(node, 0x1003, 0, b"\1") == RANGE
    assert abort(node, 0x1003, 0, b"\0") == 0


def test_heartbeat_consumers(node: canopen.BaseNode402) -> None:
    for subindex in (1, 2, 3, 4):
        value = struct.pack("<I", (10 + subindex) << 16 | 100)
        assert abort(node, 0x1016, subindex, value) == 0
    assert abort(node, 0x1016, 2, struct.pack("<I", 11 << 16 | 50)) == INCOMPATIBLE
    assert abort(node, 0x1016, 1, struct.pack("<I", 0x7FFFFF)) == 0
    assert abort(node, 0x1016, 1, struct.pack("<I", 0x800000)) == TOO_HIGH
    assert abort(node, 0x1016, 1, struct.pack("<I", 0)) == 0


def test_sync_counter_overflow(node: canopen.BaseNode402) -> None:
    for value, code in ((2, 0), (240, 0), (1, RANGE), (241, TOO_HIGH), (255, TOO_HIGH), (0, 0)):
        assert abort(node, 0x1019, 0, bytes([value])) == code, value
    assert abort(node, 0x1006, 0, struct.pack("<I", 5000)) == 0
    assert abort(node, 0x1019, 0, b"\2") == STATE
    assert abort(node, 0x1006, 0, struct.pack("<I", 0)) == 0


def test_emergency_consumers(node: canopen.BaseNode402) -> None:
    for value, code in ((0x81, 0), (0xFF, 0), (0x80000000, 0), (0x80, RANGE), (0x100, RANGE)):
        assert abort(node, 0x1028, 1, struct.pack("<I", value)) == code, hex(value)


def test_quick_stop_options(node: canopen.BaseNode402) -> None:
    for value, code in ((0, 0), (1, 0), (3, RANGE), (4, RANGE), (6, 0), (7, TOO_HIGH),
                        (-1, TOO_LOW), (2, 0)):  # fmt: skip
        assert abort(node, 0x605A, 0, struct.pack("<h", value)) == code, value


def test_modes(node: canopen.BaseNode402) -> None:
    for value, code in ((-2, TOO_LOW), (11, TOO_HIGH), (1, RANGE), (9, RANGE), (0, 0)):
        assert abort(node, 0x6060, 0, struct.pack("<b", value)) == code, value
    for value in (-1, 6, 10):
        assert abort(node, 0x6060, 0, struct.pack("<b", value)) == 0
        time.sleep(0.01)
        assert read(node, 0x6061, 0, "<b") == value


def test_position_limits_must_not_cross(node: canopen.BaseNode402) -> None:
    assert abort(node, 0x607D, 2, struct.pack("<i", 1000)) == 0
    assert abort(node, 0x607D, 1, struct.pack("<i", 1001)) == RANGE
    assert abort(node, 0x607D, 1, struct.pack("<i", 1000)) == 0
    assert abort(node, 0x607D, 2, struct.pack("<i", 999)) == RANGE


def test_homing_methods(node: canopen.BaseNode402) -> None:
    for value, code in ((32, TOO_LOW), (33, 0), (34, 0), (35, RANGE), (36, RANGE), (37, 0),
                        (38, TOO_HIGH)):  # fmt: skip
        assert abort(node, 0x6098, 0, struct.pack("<b", value)) == code, value
