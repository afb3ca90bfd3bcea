"""Data sheets as vendors write them, and profiles against them. The tables are in the output (-s, or on failure)."""

from __future__ import annotations

import random
from pathlib import Path

import canopen
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune_drivers.canopen.data_sheet import DataSheet, parse_data_sheet, read_data_sheet
from autotune_drivers.canopen.profile_check import check, table
from autotune_drivers.profile import read_profile

SHARED = Path(__file__).resolve().parents[2] / "../shared/eds"
OWN = config_directory() / "eds" / "autotune-sim.eds"
ONE = "[DeviceInfo]\nVendorNumber=0x1\nProductNumber=2\nRevisionNumber=3\n"
OBJECT = "[6041]\nParameterName=Status\nObjectType=0x7\nDataType=0x0006\nAccessType=ro\nPDOMapping=1\n"
FILES = {
    "epos4_50_15_can_node1.dcf": ("maxon-epos4", 0x65520000, 1010),
    "eve-net_canopen_1.4.2.eds": ("ingenia-eve", 46202881, 400),
    "402.eds": ("cia402", 0, 130),
    "cia402_slave.eds": ("cia402", 1, 100),
    "epos2_347717.eds": ("cia402", 0x63220000, 200),
}
LACKS = {
    "402.eds": {"60B2:00 commands.torque_feedforward", "1010:01 store"},
    "cia402_slave.eds": {"60B2:00 commands.torque_feedforward", "6074:00 signals.torque_demand"},
    "epos2_347717.eds": {"60B2:00 commands.torque_feedforward", "6071:00 commands.torque"},
}
"""Drives that cannot be compensated from the host: what a generic profile misses in each, at least."""


def shared(name: str) -> Path:
    path = SHARED / name
    if not path.is_file():
        pytest.skip(f"{name}: the folder ../shared/eds is not there")
    return path


@pytest.mark.parametrize("name", FILES)
def test_the_vendors_files_load(name: str) -> None:
    sheet = read_data_sheet(shared(name))
    assert sheet.product == FILES[name][1]
    reference = canopen.import_od(str(shared(name)), node_id=1)
    known = {(o.index, s) for o in reference.values() for s in getattr(o, "subindices", {0: o})}
    shared_objects = known & set(sheet.objects)
    assert len(shared_objects) > 0.9 * len(known)  # the other reader, where both know an object
    for index, sub in shared_objects:
        variable = reference.get_variable(index, sub)
        if variable is not None and variable.name:
            assert sheet.objects[index, sub].mappable == variable.pdo_mappable


@pytest.mark.parametrize("name", ["epos4_50_15_can_node1.dcf", "eve-net_canopen_1.4.2.eds"])
def test_every_object_of_a_vendors_profile_is_there_with_its_type_and_access(name: str) -> None:
    lines = check(read_profile(FILES[name][0]), read_data_sheet(shared(name)))
    print(table(f"{FILES[name][0]} and {name}", lines))
    assert len(lines) > 15
    assert not [line for line in lines if not line.fine]


@pytest.mark.parametrize("name", LACKS)
def test_what_a_drive_lacks_for_compensation_from_the_host_is_named(name: str) -> None:
    lines = check(read_profile("cia402"), read_data_sheet(shared(name)))
    print(table(f"cia402 and {name}", lines))
    missing = {
        f"{line.use.ref.index:04X}:{line.use.ref.sub:02X} {line.use.what}" for line in lines if not line.fine
    }
    assert missing >= LACKS[name]
    position = next(line for line in lines if line.use.what == "signals.position")
    assert position.fine  # what every one of them has


@pytest.mark.parametrize("name", ["autotune-sim", "autotune-sim-kinetic"])
def test_the_simulated_drives_profiles_and_its_own_data_sheet(name: str) -> None:
    lines = check(read_profile(name), read_data_sheet(OWN))
    print(table(f"{name} and {OWN.name}", lines))
    assert not [line for line in lines if not line.fine]


def parsed(text: str, encoding: str = "utf-8") -> DataSheet:
    return parse_data_sheet(text.encode(encoding), "drive.eds")


def test_empty_numbers_are_remarked_and_the_objects_are_read() -> None:
    sheet = parsed(ONE.replace("=2", "=").replace("=0x1", "= ") + OBJECT)
    assert sheet.vendor is None
    assert sheet.product is None
    assert sheet.revision == 3
    assert sheet.objects[0x6041, 0].type == "u16"
    assert any("ProductNumber" in remark for remark in sheet.remarks)


def test_a_section_that_comes_twice_counts_as_it_comes_last() -> None:
    sheet = parsed(ONE + OBJECT + "[6041]\nDataType=0x0007\n")
    assert sheet.objects[0x6041, 0].type == "u32"
    assert sheet.objects[0x6041, 0].mappable
    assert any("[6041]" in remark for remark in sheet.remarks)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "cp1252", "utf-16"])
def test_any_usual_encoding(encoding: str) -> None:
    sheet = parsed(ONE + OBJECT.replace("Status", "Zustand geändert"), encoding)
    assert sheet.objects[0x6041, 0].name.startswith("Zustand ge")


def test_compact_entries_and_comments_after_numbers() -> None:
    text = "[2000]\nObjectType=0x8\nDataType=0x7 ; u32\nAccessType=RW\nCompactSubObj=3\nPDOMapping=0\n"
    sheet = parsed(ONE + text)
    assert {sub for index, sub in sheet.objects if index == 0x2000} == {0, 1, 2, 3}
    assert sheet.objects[0x2000, 3].writable


@pytest.mark.parametrize(
    "content",
    [b"", b"[FileInfo]\nFileName=x\n", b"\x00\x01\x02garbage", b"{'json': 1}", bytes(range(1, 256)) * 40],
)
def test_what_is_no_data_sheet_ends_in_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "drive.eds"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"drive\.eds"):
        read_data_sheet(path)


def test_ten_megabytes_of_garbage_end_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    path.write_bytes(random.Random(1).randbytes(10_000_000))
    with pytest.raises(ConfigurationError, match=r"10\.0 MB") as caught:
        read_data_sheet(path)
    assert len(str(caught.value)) < 500


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="there is no data sheet"):
        read_data_sheet(tmp_path / "none.eds")


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400), st.integers(0, 400))
def test_bytes_put_in_anywhere_never_crash_the_reader(noise: bytes, place: int) -> None:
    content = (ONE + OBJECT).encode()
    content = content[:place] + noise + content[place:]
    try:
        said = str(parse_data_sheet(content, "drive.eds").objects)
    except ConfigurationError as error:
        said = str(error)
    assert "drive.eds" in said or "SheetObject" in said
