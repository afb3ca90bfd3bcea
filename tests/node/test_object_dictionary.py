"""The data sheet and what the drive makes of it."""

from __future__ import annotations

import math
import re
import struct
from configparser import RawConfigParser

import canopen
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.object_dictionary import ObjectDictionary, packed, read_eds
from tests.node.support import EDS, NODE


@pytest.fixture(scope="module")
def sheet() -> RawConfigParser:
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(EDS.read_text(encoding="ascii"))
    return parser


OBJECTS = read_eds(EDS, NODE)


@pytest.fixture
def objects() -> ObjectDictionary:
    return OBJECTS


def test_every_listed_object_is_there_and_every_object_is_listed(sheet: RawConfigParser) -> None:
    listed = []
    for group in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        count = int(sheet[group]["SupportedObjects"])
        indices = [int(sheet[group][str(number)], 16) for number in range(1, count + 1)]
        assert len(sheet[group]) == count + 1
        assert indices == sorted(indices)
        listed += indices
    present = [int(title, 16) for title in sheet.sections() if re.fullmatch("[0-9A-F]{4}", title)]
    assert sorted(listed) == sorted(present)
    assert {
        int(sheet["ManufacturerObjects"][key], 16) >= 0x2000
        for key in sheet["ManufacturerObjects"]
        if key != "SupportedObjects"
    } == {True}


def test_sub_numbers_count_the_sub_indices(sheet: RawConfigParser) -> None:
    for title in sheet.sections():
        if "SubNumber" in sheet[title]:
            subs = [other for other in sheet.sections() if other.startswith(title + "sub")]
            assert len(subs) == int(sheet[title]["SubNumber"]), title


def test_mandatory_keys_of_the_file(sheet: RawConfigParser) -> None:
    info = sheet["FileInfo"]
    assert re.fullmatch(r"\d\d:\d\d(AM|PM)", info["CreationTime"])
    assert re.fullmatch(r"\d\d-\d\d-\d{4}", info["ModificationDate"])
    assert len(sheet["Comments"]) == int(sheet["Comments"]["Lines"]) + 1
    assert sheet["DeviceInfo"]["BaudRate_1000"] == "1"


def test_the_canopen_package_reads_the_same(objects: ObjectDictionary) -> None:
    other = canopen.import_od(str(EDS), node_id=NODE)
    assert set(other) == objects.indices
    for entry in objects:
        variable = other.get_variable(entry.index, entry.subindex)
        assert variable is not None, hex(entry.index)
        assert variable.data_type == entry.data_type
        assert variable.pdo_mappable == entry.mappable
        if entry.packer is not None:
            assert variable.default == entry.default


def test_defaults_are_within_their_own_limits(objects: ObjectDictionary) -> None:
    for entry in objects:
        entry.check(entry.default)
        if entry.packer is not None:
            assert (
                entry.decode(entry.encode(entry.default)) == pytest.approx(entry.default)
                if "w" in entry.access
                else True
            )


def test_unknown_object_and_sub_index(objects: ObjectDictionary) -> None:
    with pytest.raises(Abort) as unknown:
        objects[0x5FFF]
    assert unknown.value.code == AbortCode.NO_OBJECT
    with pytest.raises(Abort) as subindex:
        objects[0x1018, 9]
    assert subindex.value.code == AbortCode.NO_SUBINDEX


@given(st.floats(-100.0, 100.0, width=32))
def test_reals_survive_the_wire(value: float) -> None:
    entry = OBJECTS[0x2100, 9]
    entry.put(entry.decode(entry.encode(value)))
    assert entry.get() == value


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_refused(objects: ObjectDictionary, value: float) -> None:
    with pytest.raises(Abort):
        objects[0x2100, 9].put(value)


@pytest.mark.parametrize(
    ("value", "told"), [(5_000_000_000, 2**31 - 1), (-5_000_000_000, -(2**31)), (-1_483_640, -1_483_640)]
)
def test_what_an_object_cannot_hold_is_told_as_the_most_that_it_can(value: int, told: int) -> None:
    """A target at the other end of its range makes a following error of 33 bits."""
    assert struct.unpack("<Hif", packed(struct.Struct("<Hif"), (7, value, 1e300)))[:2] == (7, told)
