"""The electronic data sheet and the DBC: their rules, and whether others' tools read them."""

from __future__ import annotations

import logging
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from hpmc.layout import ROOT

EDS = ROOT / "firmware" / "od" / "motor_node.eds"
DBC = ROOT / "firmware" / "od" / "motor_node.dbc"

# section, where the finding has to be; a text of its reason; what is replaced in which section
Fault = tuple[str, str, str, str, str]
FAULTS: dict[str, Fault] = {
    "key missing": ("FileInfo", "CreatedBy", "FileInfo", "CreatedBy=H-PMC rig\n", ""),
    "key empty": ("FileInfo", "FileName", "FileInfo", "=motor_node.eds", "="),
    "no date": ("FileInfo", "CreationDate", "FileInfo", "eationDate=11-", "eationDate=13-"),
    "section missing": ("DummyUsage", "missing", "DummyUsage", "[DummyUsage]", "[Dummies]"),
    "dummy neither": ("DummyUsage", "Dummy0005", "DummyUsage", "0005=0", "0005=2"),
    "comment": ("Comments", "Lines=1", "Comments", "Lines=0", "Lines=1"),
    "count": ("OptionalObjects", "lists 57", "OptionalObjects", "Objects=57", "Objects=56"),
    "gap": ("OptionalObjects", "numbered", "OptionalObjects", "\n7=", "\n70="),
    "twice": ("OptionalObjects", "1005h is already", "OptionalObjects", "=0x1006", "=0x1005"),
    "wrong list": ("ManufacturerObjects", "1002h", "ManufacturerObjects", "0x2102", "0x1002"),
    "no list": ("ManufacturerObjects", "no list", "ManufacturerObjects", "0x2102", "0xA000"),
    "no section": ("OptionalObjects", "6502h has no", "6502", "[6502]", "[2502]"),
    "not listed": ("2502", "in no list", "6502", "[6502]", "[2502]"),
    "not mandatory": ("MandatoryObjects", "1001h", "MandatoryObjects", "0x1001", "0x1002"),
    "section twice": ("1006", "again", "1007", "[1007]", "[1006]"),
    "key twice": ("1006", "PDOMapping", "1006", "PDOMapping=0", "PDOMapping=0\nPDOMapping=0"),
    "same object": ("607Dsub0", "same object", "607Dsub0", "[607D", "[607dsub0]\n[607D"),
    "no name": ("1006", "ParameterName", "1006", "Communication cycle period", ""),
    "long name": ("1006", "242", "1006", "Communication cycle period", "n" * 242),
    "object type": ("1006", "ObjectType", "1006", "ObjectType=0x7", "ObjectType=0x3"),
    "type missing": ("1006", "DataType", "1006", "DataType=0x0007\n", ""),
    "type unknown": ("1006", "DataType", "1006", "DataType=0x0007", "DataType=0x0017"),
    "access": ("1006", "AccessType", "1006", "AccessType=rw", "AccessType=RW"),
    "mapping flag": ("1006", "PDOMapping", "1006", "PDOMapping=0", "PDOMapping=2"),
    "no number": ("1006", "not a number", "1006", "DefaultValue=0", "DefaultValue=none"),
    "no octal": ("1006", "not a number", "1006", "DefaultValue=0", "DefaultValue=08"),
    "range": ("1015", "UNSIGNED16", "1015", "DefaultValue=10", "DefaultValue=65536"),
    "negative": ("1006", "UNSIGNED32", "1006", "LowLimit=0", "LowLimit=-1"),
    "signed": ("6060", "INTEGER8", "6060", "LowLimit=-1", "LowLimit=-129"),
    "node-id": ("1014", "UNSIGNED32", "1014", "0x80", "0xFFFFFF81"),
    "above": ("1006", "above HighLimit", "1006", "Value=0", "Value=1000001"),
    "below": ("1801sub3", "above DefaultValue", "1801sub3", "Value=200", "Value=199"),
    "limits": ("6060", "LowLimit is above HighLimit", "6060", "HighLimit=10", "HighLimit=-2"),
    "text limit": ("1008", "LowLimit", "1008", "PDOMapping=0", "PDOMapping=0\nLowLimit=0"),
    "sub number": ("2101", "SubNumber=2", "2101", "SubNumber=3", "SubNumber=2"),
    "no sub number": ("2101", "SubNumber", "2101", "SubNumber=3\n", ""),
    "no sub 0": ("2101", "sub-index 0", "2101sub0", "[2101sub0]", "[2101sub3]"),
    "sub 0 type": ("2101sub0", "UNSIGNED8", "2101sub0", "0x0005", "0x0006"),
    "sub 0 value": ("2101sub0", "highest", "2101sub0", "Value=2", "Value=3"),
    "errors": ("1003sub0", "8 places", "1003sub0", "Value=0", "Value=9"),
    "stray sub": ("2108sub2", "no section [2108]", "2101sub2", "[2101sub2]", "[2108sub2]"),
    "subs of a variable": ("2101", "variable", "2101", "ObjectType=0x9", "ObjectType=0x7"),
    "bad section": ("2101su2", "not the name", "2101sub2", "[2101sub2]", "[2101su2]"),
    "maps nothing": ("1600sub2", "6070h", "1600sub2", "0x60710010", "0x60700010"),
    "not mappable": ("1600sub2", "PDOMapping is not 1", "6071", "PDOMapping=1", "PDOMapping=0"),
    "bits": ("1600sub2", "which has 16", "1600sub2", "0x60710010", "0x60710008"),
    "too many bits": ("1600", "80 bits", "1600sub2", "0x60710010", "0x607A0020"),
    "maps read-only": ("1600sub2", "is ro", "1600sub2", "0x60710010", "0x60770010"),
    "maps a dummy": ("1600sub2", "Dummy0006", "1600sub2", "0x60710010", "0x00060010"),
    "dummy sent": ("1A00sub2", "in a TPDO", "1A00sub2", "0x60770010", "0x00060010"),
    "RPDOs": ("DeviceInfo", "NrOfRXPDO", "DeviceInfo", "NrOfRXPDO=3", "NrOfRXPDO=4"),
    "TPDOs": ("DeviceInfo", "NrOfTXPDO", "DeviceInfo", "NrOfTXPDO=2", "NrOfTXPDO=1"),
    "no mapping": ("1800", "1A00h", "1A00", "[1A00]", "[1A05]"),
    "no rate": ("DeviceInfo", "BaudRate", "DeviceInfo", "BaudRate_1000=1", "BaudRate_1000=0"),
    "rate": ("DeviceInfo", "BaudRate_500", "DeviceInfo", "BaudRate_500=0", "BaudRate_500=500"),
    "granularity": ("DeviceInfo", "65", "DeviceInfo", "Granularity=0", "Granularity=65"),
    "fixed mapping": ("DeviceInfo", "Granularity=8", "DeviceInfo", "larity=0", "larity=8"),
    "mapping written": ("DeviceInfo", "[1600sub1]", "1600sub1", "const", "rw"),
    "master": ("DeviceInfo", "1F80h", "DeviceInfo", "UpMaster=0", "UpMaster=1"),
    "boot-up": ("DeviceInfo", "BootUpSlave", "DeviceInfo", "UpSlave=1", "UpSlave=2"),
    "identity": ("DeviceInfo", "sub 2", "DeviceInfo", "0x46494301", "0x46494302"),
    "LSS": ("DeviceInfo", "LSS", "1018sub4", "[1018sub4]", "[1018sub5]"),
}


def lint(file: Path) -> tuple[int, list[str], str]:
    """Exit status, findings and what went to the standard error of tools/eds_lint.py."""
    tool = ROOT / "tools" / "eds_lint.py"
    done = subprocess.run([sys.executable, tool, file], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout.splitlines(), done.stderr


def replaced(section: str, old: str, new: str) -> str:
    """The data sheet with one replacement in the section (its head included)."""
    text = EDS.read_text(encoding="ascii")
    begin = text.index(f"[{section}]\n")
    end = text.find("\n[", begin) + 1 or len(text)
    body = text[begin:end]
    assert body.count(old) == 1, f"{old!r} is there {body.count(old)} times in [{section}]"
    return text[:begin] + body.replace(old, new) + text[end:]


def test_the_data_sheet_has_no_fault() -> None:
    assert lint(EDS) == (0, [], "")


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS.keys())
def test_a_fault_is_found_in_its_section(fault: Fault, tmp_path: Path) -> None:
    section, reason, where, old, new = fault
    file = tmp_path / EDS.name
    file.write_text(replaced(where, old, new), encoding="ascii")
    status, findings, errors = lint(file)
    assert (status, errors) == (1, "")
    assert any(line.startswith(f"[{section}] ") and reason in line for line in findings), findings


@pytest.mark.parametrize(
    ("section", "old", "new"),
    [
        ("1006", "DefaultValue=0", "DefaultValue=010"),
        ("6060", "LowLimit=-1", "LowLimit=0xFF"),
        ("1014", "$NODEID+0x80", "0x80+$NODEID"),
        ("1014", "$NODEID+0x80", "$NODEID+0xFFFFFF80"),
        ("1006", "DefaultValue=0", "DefaultValue=1000000"),
        ("1006", "DefaultValue=0", "DefaultValue="),
        ("1006", "Communication cycle period", "n" * 241),
        ("Comments", "Lines=0", "Lines=1\nLine1=fine"),
    ],
)
def test_what_is_allowed_is_no_fault(section: str, old: str, new: str, tmp_path: Path) -> None:
    file = tmp_path / EDS.name
    file.write_text(replaced(section, old, new), encoding="ascii")
    assert lint(file) == (0, [], "")


@pytest.mark.parametrize("content", [None, b"no section\n", b"[FileInfo]\nFileName=\xff\n"])
def test_an_unreadable_file(content: bytes | None, tmp_path: Path) -> None:
    file = tmp_path / "other.eds"
    if content is not None:
        file.write_bytes(content)
    status, findings, errors = lint(file)
    assert (status, findings) == (2, [])
    assert errors.startswith(str(file))
    assert errors.count("\n") == 1


def test_python_canopen_reads_it_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    import canopen

    with warnings.catch_warnings(), caplog.at_level(logging.WARNING):
        warnings.simplefilter("error")
        dictionary = canopen.import_od(str(EDS), node_id=3)
    assert caplog.records == []
    assert len(dictionary) == 3 + 57 + 15
    assert dictionary[0x1400][1].default == 0x203
    assert dictionary.device_information.nr_of_RXPDO == 3


def test_cantools_reads_the_dbc() -> None:
    import cantools

    database = cantools.database.load_file(DBC)
    assert {message.frame_id for message in database.messages} >= {
        function + node for function in (0x180, 0x200) for node in (1, 2, 3)
    }
    assert all(message.length <= 8 for message in database.messages)
