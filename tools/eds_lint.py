#!/usr/bin/env python3
"""Check an electronic data sheet against the rules of CiA 306 and the objects of CiA 301.

    tools/eds_lint.py firmware/od/motor_node.eds

One line per finding: the section and what is wrong in it. Exit status 0 when there is none, 1 when
there are some, 2 when the file cannot be read. Every sub-index has to have its own section: the
compact forms (CompactSubObj, CompactPDO) are not known here. Needs the Python standard library
only.
"""

from __future__ import annotations

import argparse
import configparser
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

MANDATORY_KEYS: Mapping[str, tuple[str, ...]] = {
    "FileInfo": (
        *("FileName", "FileVersion", "FileRevision", "EDSVersion", "Description"),
        *("CreationTime", "CreationDate", "CreatedBy"),
        *("ModificationTime", "ModificationDate", "ModifiedBy"),
    ),
    "DeviceInfo": (
        *("VendorName", "VendorNumber", "ProductName", "ProductNumber", "RevisionNumber"),
        *("OrderCode", "BaudRate_10", "BaudRate_20", "BaudRate_50", "BaudRate_125"),
        *("BaudRate_250", "BaudRate_500", "BaudRate_800", "BaudRate_1000"),
        *("SimpleBootUpMaster", "SimpleBootUpSlave", "Granularity", "DynamicChannelsSupported"),
        *("GroupMessaging", "NrOfRXPDO", "NrOfTXPDO", "LSS_Supported"),
    ),
    "DummyUsage": tuple(f"Dummy{index:04}" for index in range(1, 8)),
    "Comments": ("Lines",),
    "MandatoryObjects": ("SupportedObjects",),
    "OptionalObjects": ("SupportedObjects",),
    "ManufacturerObjects": ("SupportedObjects",),
}
LISTS = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
MANDATORY_OBJECTS = (0x1000, 0x1001, 0x1018)
YES_NO = ("SimpleBootUpMaster", "SimpleBootUpSlave", "GroupMessaging", "LSS_Supported")
FORMATS = {
    "EDSVersion": (r"\d\.\d", "x.y"),
    "CreationTime": (r"(0\d|1[0-2]):[0-5]\d(AM|PM)", "hh:mm(AM|PM)"),
    "CreationDate": (r"(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])-\d{4}", "mm-dd-yyyy"),
}
FORMATS |= {f"Modification{what}": FORMATS[f"Creation{what}"] for what in ("Time", "Date")}
ACCESS_TYPES = ("ro", "wo", "rw", "rwr", "rww", "const")
RPDO_ACCESS, TPDO_ACCESS = ("wo", "rw", "rww"), ("ro", "rw", "rwr", "const")
DOMAIN, VAR, ARRAY, RECORD = 0x2, 0x7, 0x8, 0x9
UNSIGNED8, UNSIGNED32, DATA_TYPE_DOMAIN = 0x5, 0x7, 0xF
PRE_DEFINED_ERROR_FIELD, IDENTITY, NMT_STARTUP = 0x1003, 0x1018, 0x1F80
RPDO, RPDO_MAPPING = range(0x1400, 0x1600), range(0x1600, 0x1800)
TPDO, TPDO_MAPPING = range(0x1800, 0x1A00), range(0x1A00, 0x1C00)
STRUCTURE_SUBINDEX = 0xFF
NAME_LENGTH, PDO_BITS, NODE_IDS = 241, 64, (1, 127)
OBJECT_SECTION = re.compile(r"([0-9A-F]{4})(?:sub([0-9A-F]{1,2}))?", re.IGNORECASE)
OTHER_OBJECT_SECTION = re.compile(r"[0-9A-F]{4}(Name|Value|Denotation|ObjectLinks)", re.IGNORECASE)


@dataclass(frozen=True)
class Finding:
    """What is wrong, and in which section."""

    section: str
    reason: str

    def __str__(self) -> str:
        return f"[{self.section}] {self.reason}"


@dataclass(frozen=True)
class Type:
    """A data type of CiA 301 (7.4.7). bits: 0 where the length is the value's own."""

    name: str
    bits: int
    kind: str

    @property
    def low(self) -> int:
        return -(1 << (self.bits - 1)) if self.kind == "signed" else 0

    @property
    def high(self) -> int:
        return (1 << (self.bits - (self.kind == "signed"))) - 1


TYPES = {
    0x1: Type("BOOLEAN", 1, "unsigned"),
    0x8: Type("REAL32", 32, "real"),
    0x9: Type("VISIBLE_STRING", 0, "text"),
    0xA: Type("OCTET_STRING", 0, "octets"),
    0xB: Type("UNICODE_STRING", 0, "text"),
    0xC: Type("TIME_OF_DAY", 48, "unsigned"),
    0xD: Type("TIME_DIFFERENCE", 48, "unsigned"),
    0xF: Type("DOMAIN", 0, "text"),
    0x11: Type("REAL64", 64, "real"),
}
for _bits, _signed, _unsigned in (
    *((8, 0x2, 0x5), (16, 0x3, 0x6), (32, 0x4, 0x7), (24, 0x10, 0x16)),
    *((40, 0x12, 0x18), (48, 0x13, 0x19), (56, 0x14, 0x1A), (64, 0x15, 0x1B)),
):
    TYPES[_signed] = Type(f"INTEGER{_bits}", _bits, "signed")
    TYPES[_unsigned] = Type(f"UNSIGNED{_bits}", _bits, "unsigned")


def number(text: str) -> int:
    """A number of CiA 306: decimal, hexadecimal with 0x, octal with 0."""
    match = re.fullmatch(r"(-?)(?:0x([0-9A-F]+)|0([0-7]+)|(\d+))", text.strip(), re.IGNORECASE)
    if not match or (match[4] and match[4] != "0" and match[4].startswith("0")):
        raise ValueError(f"{text!r} is not a number")
    digits, base = next((d, b) for d, b in zip(match.groups()[1:], (16, 8, 10), strict=True) if d)
    value = int(digits, base)
    return -value if match[1] else value


@dataclass(frozen=True)
class Value:
    """The value of an object; node_id: 1 where the node-id is added to it."""

    base: float
    node_id: int

    def at(self, node: int) -> float:
        return self.base + node * self.node_id


def value_of(text: str, kind: Type) -> Value | None:
    """The value that a text stands for; None for texts and octets. ValueError when it has none."""
    if kind.kind == "text":
        return None
    if kind.kind == "octets":
        bytes.fromhex(text)
        return None
    if kind.kind == "real":
        return Value(float(text), 0)
    match = re.fullmatch(r"\$NODEID(?:\s*\+\s*(.+))?|(.+?)\s*\+\s*\$NODEID", text)
    base = number((match[1] or match[2] or "0") if match else text)
    if kind.kind == "signed" and text.lower().startswith("0x") and kind.high < base:
        base -= (1 << kind.bits) if base < 1 << kind.bits else 0  # two's complement
    value = Value(base, int(match is not None))
    if not all(kind.low <= value.at(node) <= kind.high for node in NODE_IDS):
        raise ValueError(f"{text!r} is out of the range of {kind.name}")
    return value


def list_of(index: int) -> str | None:
    """The list in which an object has to be."""
    if index in MANDATORY_OBJECTS:
        return "MandatoryObjects"
    if 0x1002 <= index <= 0x1FFF or 0x6000 <= index <= 0x9FFF:
        return "OptionalObjects"
    return "ManufacturerObjects" if 0x2000 <= index <= 0x5FFF else None


class Sheet:
    """An electronic data sheet and what is wrong with it."""

    def __init__(self, parser: configparser.ConfigParser) -> None:
        self.parser = parser
        self.findings: list[Finding] = []
        self.objects: dict[int, str] = {}  # section of each
        self.subs: dict[int, dict[int, str]] = {}
        for section in parser.sections():
            match = OBJECT_SECTION.fullmatch(section)
            if match:
                index = int(match[1], 16)
                here: dict[int, str] = self.objects
                key = index
                if match[2]:
                    here, key = self.subs.setdefault(index, {}), int(match[2], 16)
                if key in here:
                    self.report(section, f"is the same object as [{here[key]}]")
                here[key] = section
            elif re.match(r"[0-9]", section) and not OTHER_OBJECT_SECTION.fullmatch(section):
                self.report(section, "is not the name of a section")

    def report(self, section: str, reason: str) -> None:
        self.findings.append(Finding(section, reason))

    def get(self, section: str, key: str) -> str:
        return self.parser.get(section, key, fallback="").strip()

    def number(self, section: str, key: str) -> int | None:
        """A key's number, if it is there; a finding when it is not one."""
        text = self.get(section, key)
        if not text:
            return None
        try:
            return number(text)
        except ValueError as error:
            self.report(section, f"{key}: {error}")
            return None

    def in_range(self, section: str, key: str, low: int, high: int) -> int | None:
        value = self.number(section, key)
        if value is None or low <= value <= high:
            return value
        self.report(section, f"{key}={self.get(section, key)} is not within {low}..{high}")
        return None

    def quietly(self, section: str | None, key: str) -> int | None:
        """A key's number where something else reports what is wrong with it."""
        try:
            return number(self.get(section, key)) if section else None
        except ValueError:
            return None

    def entry(self, index: int, subindex: int) -> str | None:
        """The section of a value: a variable's own is its sub-index 0."""
        if index in self.subs:
            return self.subs[index].get(subindex)
        return self.objects.get(index) if subindex == 0 else None

    def check(self) -> list[Finding]:
        checks: tuple[Callable[[], None], ...] = (
            self.check_keys,
            self.check_file_info,
            self.check_comments,
            self.check_lists,
            self.check_objects,
            self.check_device_info,
            self.check_pdos,
        )
        for check in checks:
            check()
        return self.findings

    def check_keys(self) -> None:
        for section, keys in MANDATORY_KEYS.items():
            if not self.parser.has_section(section):
                self.report(section, "section is missing")
                continue
            for key in keys:
                if not self.parser.has_option(section, key):
                    self.report(section, f"{key} is missing")
                elif not self.get(section, key):
                    self.report(section, f"{key} is empty")

    def check_file_info(self) -> None:
        for key in ("FileVersion", "FileRevision"):
            self.in_range("FileInfo", key, 0, 255)
        for key, (pattern, words) in FORMATS.items():
            text = self.get("FileInfo", key)
            if text and not re.fullmatch(pattern, text):
                self.report("FileInfo", f"{key}={text} is not {words}")

    def check_comments(self) -> None:
        lines = self.in_range("Comments", "Lines", 0, 0xFFFF)
        if lines is None:
            return
        keys = set(self.parser.options("Comments")) - {"Lines"}
        if keys != {f"Line{line}" for line in range(1, lines + 1)}:
            self.report("Comments", f"Lines={lines} are not Line1..Line{lines}")

    def check_lists(self) -> None:
        listed: dict[int, str] = {}
        for section in LISTS:
            if self.parser.has_section(section):
                self.check_list(section, listed)
        for index in MANDATORY_OBJECTS:
            if index not in listed:
                self.report("MandatoryObjects", f"{index:04X}h is missing")
        for index, section in self.objects.items():
            if index not in listed:
                self.report(section, "is in no list of objects")

    def check_list(self, section: str, listed: dict[int, str]) -> None:
        keys = [key for key in self.parser.options(section) if key != "SupportedObjects"]
        if keys != [str(place) for place in range(1, len(keys) + 1)]:
            self.report(section, f"its entries are not numbered 1..{len(keys)}")
        count = self.number(section, "SupportedObjects")
        if count is not None and count != len(keys):
            self.report(section, f"SupportedObjects={count}, but it lists {len(keys)}")
        for key in keys:
            index = self.in_range(section, key, 0, 0xFFFF)
            if index is None:
                if not self.get(section, key):
                    self.report(section, f"{key} is empty")
                continue
            if index in listed:
                self.report(section, f"{index:04X}h is already in [{listed[index]}]")
            listed[index] = section
            if list_of(index) != section:
                self.report(section, f"{index:04X}h belongs in {list_of(index) or 'no list'}")
            if index not in self.objects:
                self.report(section, f"{index:04X}h has no section")

    def check_objects(self) -> None:
        for index, section in self.objects.items():
            self.check_name(section)
            kind = self.object_type(section)
            subs = self.subs.get(index, {})
            if kind in (VAR, DOMAIN):
                self.check_variable(section, kind)
                if subs:
                    self.report(section, "is a variable, but has sub-indices")
            elif kind in (ARRAY, RECORD):
                self.check_sub_indices(index, section, subs)
            elif kind is not None:
                self.report(section, f"ObjectType={self.get(section, 'ObjectType')} is unknown")
        for index, subs in self.subs.items():
            for section in subs.values():
                if index not in self.objects:
                    self.report(section, f"there is no section [{index:04X}]")
                self.check_name(section)
                kind = self.object_type(section)
                if kind in (VAR, DOMAIN):
                    self.check_variable(section, kind)
                elif kind is not None:
                    self.report(section, "ObjectType of a sub-index is not VAR or DOMAIN")

    def object_type(self, section: str) -> int | None:
        return self.number(section, "ObjectType") if self.get(section, "ObjectType") else VAR

    def check_name(self, section: str) -> None:
        name = self.get(section, "ParameterName")
        if not name:
            self.report(section, "ParameterName is missing or empty")
        elif len(name) > NAME_LENGTH:
            self.report(
                section, f"ParameterName has {len(name)} characters, more than {NAME_LENGTH}"
            )

    def check_sub_indices(self, index: int, section: str, subs: dict[int, str]) -> None:
        count = self.number(section, "SubNumber")
        if not self.get(section, "SubNumber"):
            self.report(section, "SubNumber is missing")
        elif count is not None and count != len(subs):
            self.report(section, f"SubNumber={count}, but there are {len(subs)} sub-indices")
        if 0 not in subs:
            self.report(section, "sub-index 0 is missing")
            return
        first = subs[0]
        if self.quietly(first, "DataType") not in (None, UNSIGNED8):
            self.report(first, "DataType of sub-index 0 is not UNSIGNED8")
        highest = max(subindex for subindex in subs if subindex != STRUCTURE_SUBINDEX)
        default = self.quietly(first, "DefaultValue")
        if default is None:
            self.report(first, "DefaultValue of sub-index 0 is not given")
        elif index == PRE_DEFINED_ERROR_FIELD:
            # CiA 301, 7.5.2.4: the number of errors that there are, not the highest sub-index
            if default > highest:
                self.report(first, f"DefaultValue={default}, but the field has {highest} places")
        elif default != highest:
            self.report(first, f"DefaultValue={default}, but the highest sub-index is {highest}")

    def check_variable(self, section: str, object_type: int) -> None:
        access = self.get(section, "AccessType")
        if access not in ACCESS_TYPES and (access or object_type == VAR):
            self.report(section, f"AccessType={access} is not one of {', '.join(ACCESS_TYPES)}")
        mapping = self.get(section, "PDOMapping")
        if mapping not in ("0", "1") and (mapping or object_type == VAR):
            self.report(section, f"PDOMapping={mapping} is not 0 or 1")
        if object_type == VAR and not self.get(section, "DataType"):
            self.report(section, "DataType is missing")
            return
        code = self.number(section, "DataType")
        if object_type == DOMAIN and code not in (None, DATA_TYPE_DOMAIN):
            self.report(section, "DataType of a domain is not DOMAIN")
        elif code is not None and code not in TYPES:
            self.report(section, f"DataType={self.get(section, 'DataType')} is unknown")
        elif code is not None:
            self.check_values(section, TYPES[code])

    def check_values(self, section: str, kind: Type) -> None:
        values: list[tuple[str, Value]] = []
        for key in ("LowLimit", "DefaultValue", "HighLimit"):
            text = self.get(section, key)
            if not text:
                continue
            if key != "DefaultValue" and kind.kind in ("text", "octets"):
                self.report(section, f"{key} of a {kind.name}")
                continue
            try:
                value = value_of(text, kind)
            except ValueError as error:
                self.report(section, f"{key}: {error}")
                continue
            if value is not None:
                values.append((key, value))
        for place, (lower, low) in enumerate(values):
            for upper, high in values[place + 1 :]:
                if any(low.at(node) > high.at(node) for node in NODE_IDS):
                    self.report(section, f"{lower} is above {upper}")

    def check_device_info(self) -> None:
        section = "DeviceInfo"
        if not self.parser.has_section(section):
            return
        rates = [key for key in MANDATORY_KEYS[section] if key.startswith("BaudRate_")]
        for key in (*rates, *YES_NO):
            self.in_range(section, key, 0, 1)
        for key in MANDATORY_KEYS["DummyUsage"]:
            self.in_range("DummyUsage", key, 0, 1)
        if not any(self.quietly(section, key) for key in rates):
            self.report(section, "no BaudRate is supported")
        self.in_range(section, "DynamicChannelsSupported", 0, 0xFFFFFFFF)
        for key, objects in (("NrOfRXPDO", RPDO), ("NrOfTXPDO", TPDO)):
            value, count = self.number(section, key), sum(i in objects for i in self.objects)
            if value is not None and value != count:
                self.report(section, f"{key}={value}, but there are {count}")
        for subindex, key in enumerate(("VendorNumber", "ProductNumber", "RevisionNumber"), 1):
            value = self.in_range(section, key, 0, 0xFFFFFFFF)
            identity = self.quietly(self.entry(IDENTITY, subindex), "DefaultValue")
            if None not in (value, identity) and value != identity:
                self.report(section, f"{key} is not that of 1018h sub {subindex}")
        if self.quietly(section, "LSS_Supported") and any(
            self.entry(IDENTITY, subindex) is None for subindex in range(1, 5)
        ):
            self.report(section, "LSS_Supported=1 without the four numbers of 1018h")
        if self.quietly(section, "SimpleBootUpMaster") and NMT_STARTUP not in self.objects:
            self.report(section, "SimpleBootUpMaster=1 without 1F80h")
        self.check_granularity()

    def check_granularity(self) -> None:
        granularity = self.in_range("DeviceInfo", "Granularity", 0, PDO_BITS)
        if granularity is None:
            return
        entries = [section for _, _, section in self.mapped()]
        writable = [e for e in entries if self.get(e, "AccessType") not in ("ro", "const")]
        if granularity == 0 and writable:
            self.report("DeviceInfo", f"Granularity=0, but [{writable[0]}] can be written")
        if granularity > 0 and entries and not writable:
            self.report("DeviceInfo", f"Granularity={granularity}, but no mapping can be written")

    def mapped(self) -> Iterator[tuple[int, int, str]]:
        """Index, sub-index and section of each place of the mapping parameters."""
        for index in self.objects:
            if index in RPDO_MAPPING or index in TPDO_MAPPING:
                for subindex, section in self.subs.get(index, {}).items():
                    if subindex not in (0, STRUCTURE_SUBINDEX):
                        yield index, subindex, section

    def check_pdos(self) -> None:
        for ones, others in ((RPDO, RPDO_MAPPING), (TPDO, TPDO_MAPPING)):
            for here, there in ((ones, others), (others, ones)):
                for index, section in self.objects.items():
                    other = index - here.start + there.start
                    if index in here and other not in self.objects:
                        self.report(section, f"is there without {other:04X}h")
        totals: dict[int, int] = {}
        for index, _, section in self.mapped():
            if self.quietly(section, "DataType") not in (None, UNSIGNED32):
                self.report(section, "DataType of a mapping is not UNSIGNED32")
            value = self.quietly(section, "DefaultValue")
            if value is None:
                self.report(section, "DefaultValue of a mapping is not given")
            else:
                self.check_mapped(index, section, value)
                totals[index] = totals.get(index, 0) + (value & 0xFF)
        for index, bits in totals.items():
            if bits > PDO_BITS:
                self.report(
                    self.objects[index], f"maps {bits} bits, more than {PDO_BITS} of a frame"
                )

    def check_mapped(self, index: int, section: str, value: int) -> None:
        target, subindex, bits = value >> 16, value >> 8 & 0xFF, value & 0xFF
        name = f"{target:04X}h sub {subindex}"
        if 1 <= target <= 7:
            if index in TPDO_MAPPING:
                self.report(section, f"maps the dummy {name} in a TPDO")
            if self.quietly("DummyUsage", f"Dummy{target:04}") != 1:
                self.report(section, f"maps {name}, but Dummy{target:04} is not 1")
            code: int | None = target
        else:
            entry = self.entry(target, subindex)
            if entry is None:
                self.report(section, f"maps {name}, which is not there")
                return
            if self.get(entry, "PDOMapping") != "1":
                self.report(section, f"maps {name}, whose PDOMapping is not 1")
            access = self.get(entry, "AccessType")
            if access not in (RPDO_ACCESS if index in RPDO_MAPPING else TPDO_ACCESS):
                self.report(section, f"maps {name}, whose AccessType is {access}")
            code = self.quietly(entry, "DataType")
        kind = TYPES.get(code) if code is not None else None
        if kind is not None and kind.bits and kind.bits != bits:
            self.report(section, f"maps {bits} bits of {name}, which has {kind.bits}")


def lint(text: str) -> list[Finding]:
    """What is wrong with an electronic data sheet. configparser.Error when it is none."""
    parser = configparser.ConfigParser(
        delimiters=("=",), comment_prefixes=(";",), interpolation=None, default_section=""
    )
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    try:
        parser.read_string(text)
    except configparser.DuplicateSectionError as error:
        return [Finding(error.section, f"section is there again in line {error.lineno}")]
    except configparser.DuplicateOptionError as error:
        return [Finding(error.section, f"{error.option} is there again in line {error.lineno}")]
    return Sheet(parser).check()


def main() -> int:
    arguments = argparse.ArgumentParser(description="Check an electronic data sheet (CiA 306).")
    arguments.add_argument("file", type=Path)
    file: Path = arguments.parse_args().file
    try:
        findings = lint(file.read_text(encoding="ascii"))
    except (OSError, UnicodeDecodeError, configparser.Error) as error:
        print(f"{file}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    for finding in findings:
        print(finding)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
