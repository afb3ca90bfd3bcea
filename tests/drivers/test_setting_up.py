"""PDO mappings, session and parameters on a node in memory: what is written, in which order, and back."""

from __future__ import annotations

import pickle
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError, LinkError, TransferAborted
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.parameters import DriveParameters
from autotune_drivers.canopen.pdo import RPDO, TPDO, pack, read_setting, setting
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.session import Session
from autotune_drivers.canopen.wire import Wire
from autotune_drivers.profile import read_profile
from autotune_drivers.units import UNITS, Units
from tests.drivers.fake_node import FakeNode, Objects

CONTROL = ObjectRef(0x6040, 0, "u16")
TARGET = ObjectRef(0x607A, 0, "i32")
STATUS = ObjectRef(0x6041, 0, "u16")


def words(*values: int) -> list[bytes]:
    return [value.to_bytes(4, "little") for value in values]


def pdo_objects(kind: int, number: int, cob: int, entries: list[int]) -> Objects:
    mapping = kind + 0x200 + number
    objects = {(kind + number, 1): words(cob)[0], (kind + number, 2): b"\xff"}
    objects[mapping, 0] = bytes((len(entries),))
    for sub in range(1, 9):
        objects[mapping, sub] = words((entries + [0] * 8)[sub - 1])[0]
    return objects


@pytest.fixture
def node() -> FakeNode:
    return FakeNode(
        pdo_objects(RPDO, 0, 0x205, [0x60400010])
        | pdo_objects(TPDO, 0, 0x40000185, [0x60410010])
        | {(0x6060, 0): b"\x08", (0x60C2, 1): b"\x02", (0x60C2, 2): b"\xfd"}
    )


@pytest.fixture
def sdo(node: FakeNode) -> Sdo:
    return Sdo(Wire(node, 127, 0.05), 5)


def test_a_mapping_is_written_in_the_order_that_drives_demand(node: FakeNode, sdo: Sdo) -> None:
    Session(sdo).map(setting(RPDO, 0, 5, 1, [CONTROL, TARGET]))
    order = [(index, sub, int.from_bytes(data, "little")) for index, sub, data in node.writes]
    assert order == [
        (0x1400, 1, 0x80000205),
        (0x1600, 0, 0),
        (0x1600, 1, 0x60400010),
        (0x1600, 2, 0x607A0020),
        (0x1600, 0, 2),
        (0x1400, 2, 1),
        (0x1400, 1, 0x205),
    ]


def test_the_bit_without_remote_frames_stays(node: FakeNode, sdo: Sdo) -> None:
    Session(sdo).map(setting(TPDO, 0, 5, 1, [STATUS]))
    cobs = [int.from_bytes(data, "little") for index, sub, data in node.writes if (index, sub) == (0x1800, 1)]
    assert cobs == [0xC0000185, 0x40000185]


def test_a_mapping_that_is_as_wanted_is_left_alone(node: FakeNode, sdo: Sdo) -> None:
    session = Session(sdo)
    session.map(setting(RPDO, 0, 5, 255, [CONTROL]))
    assert node.writes == []
    assert session.restore() == []
    assert node.writes == []


def test_everything_comes_back(node: FakeNode, sdo: Sdo) -> None:
    before = dict(node.objects)
    session = Session(sdo)
    session.map(setting(RPDO, 0, 5, 1, [CONTROL, TARGET]))
    session.map(setting(TPDO, 0, 5, 1, [STATUS]))
    session.map(setting(RPDO, 0, 5, 1, [CONTROL]))
    session.write(ObjectRef(0x6060, 0, "i8"), 10)
    session.write(ObjectRef(0x6060, 0, "i8"), 9)
    assert session.restore() == []
    # entries beyond the number in sub-index 0 mean nothing
    node.objects[0x1600, 2] = before[0x1600, 2]
    assert node.objects == before


def test_an_heir_restores_from_the_backup(node: FakeNode, sdo: Sdo) -> None:
    before = dict(node.objects)
    first = Session(sdo)
    first.remember(ObjectRef(0x6060, 0, "i8"))
    first.remember_pdo(setting(RPDO, 0, 5, 1, [CONTROL, TARGET]))
    backup = pickle.loads(pickle.dumps(first.backup()))  # known before anything was changed
    first.map(setting(RPDO, 0, 5, 1, [CONTROL, TARGET]))
    first.write(ObjectRef(0x6060, 0, "i8"), 10)
    heir = Session(sdo, backup)
    heir.write(ObjectRef(0x6060, 0, "i8"), 9)
    assert heir.restore() == []
    node.objects[0x1600, 2] = before[0x1600, 2]
    assert node.objects == before


def test_objects_that_are_only_valid_together_are_tried_again(node: FakeNode, sdo: Sdo) -> None:
    value, exponent = ObjectRef(0x60C2, 1, "u8"), ObjectRef(0x60C2, 2, "i8")
    session = Session(sdo)
    session.write(exponent, -4)
    session.write(value, 25)
    write = sdo.write
    refused: list[int] = []

    def picky(ref: ObjectRef, raw: float, timeout: float | None = None) -> None:
        if ref == value and node.objects[0x60C2, 2] != b"\xfd":
            refused.append(1)
            raise TransferAborted("value and exponent do not fit", 0x06090030)
        write(ref, raw, timeout)

    sdo.write = picky  # type: ignore[method-assign]
    assert session.restore() == []
    assert refused == [1]
    assert (node.objects[0x60C2, 1], node.objects[0x60C2, 2]) == (b"\x02", b"\xfd")


def test_what_cannot_be_put_back_is_said(node: FakeNode, sdo: Sdo) -> None:
    session = Session(sdo)
    session.write(ObjectRef(0x6060, 0, "i8", "mode"), 10)
    node.refuse[0x6060, 0, "write"] = 0x08000022
    assert "mode (6060h:00) could not be set back" in session.restore()[0]


def test_an_object_that_a_drive_lacks_is_skipped_only_where_that_is_allowed(sdo: Sdo) -> None:
    absent = ObjectRef(0x6007, 0, "i16")
    assert Session(sdo).write_if_there(absent, 3) is False
    with pytest.raises(TransferAborted):
        Session(sdo).write(absent, 3)


@given(st.lists(st.sampled_from(["u8", "i16", "u32", "f32", "f64"]), max_size=20))
def test_packing_keeps_order_and_fits(types: list[str]) -> None:
    refs = [ObjectRef(0x2000 + n, 0, kind) for n, kind in enumerate(types)]
    try:
        groups = pack(refs)
    except ConfigurationError:
        assert sum(ref.size for ref in refs) > 8 * 2
        return
    assert [ref for group in groups for ref in group] == refs
    assert all(0 < sum(ref.size for ref in group) <= 8 for group in groups)


def test_reads_back_what_is_there(sdo: Sdo) -> None:
    found = read_setting(sdo, TPDO, 0)
    assert (found.cob_id, found.transmission, found.entries) == (0x40000185, 255, (0x60410010,))


# Parameters


def drive_parameters(direction: int = 1) -> tuple[DriveParameters, FakeNode]:
    profile = read_profile("autotune-sim")
    node = FakeNode(
        {
            (p.at.ref.index, p.at.ref.sub): p.at.ref.encode(p.at.ref.raw(1.0))
            for p in profile.parameters.values()
        }
    )
    units = Units(resolution=1e-3, direction=direction, rated_torque=0.5, rotary=True)
    return DriveParameters(Sdo(Wire(node, 127, 0.05), 5), profile, units), node


def test_units_are_converted() -> None:
    parameters, node = drive_parameters()
    parameters.write({"limit.position_max": 2.0, "limit.torque": 1.34, "controller.kp": 60.0})
    assert struct.unpack("<i", node.objects[0x607D, 2])[0] == 2000
    assert struct.unpack("<H", node.objects[0x6072, 0])[0] == 2680
    assert struct.unpack("<f", node.objects[0x2000, 1])[0] == 60.0
    assert parameters.read(["limit.torque"]) == {"limit.torque": pytest.approx(1.34)}


def test_limits_change_places_where_the_drive_counts_the_other_way() -> None:
    parameters, node = drive_parameters(direction=-1)
    parameters.write({"limit.position_min": -3.0, "limit.position_max": 2.0, "feedforward.offset": 0.048})
    assert struct.unpack("<i", node.objects[0x607D, 1])[0] == -2000
    assert struct.unpack("<i", node.objects[0x607D, 2])[0] == 3000
    assert struct.unpack("<f", node.objects[0x2100, 9])[0] == pytest.approx(-0.048)
    found = parameters.read(["limit.position_min", "limit.position_max", "limit.speed"])
    assert found == {
        "limit.position_min": pytest.approx(-3.0),
        "limit.position_max": pytest.approx(2.0),
        "limit.speed": pytest.approx(1e-3),
    }


def test_a_refused_write_puts_the_others_back() -> None:
    parameters, node = drive_parameters()
    before = dict(node.objects)
    node.refuse[0x2100, 4, "write"] = 0x08000021
    with pytest.raises(TransferAborted, match=r"feedforward\.coulomb"):
        parameters.write({"controller.kp": 50.0, "feedforward.coulomb": 0.3})
    assert node.objects == before


def test_a_value_that_the_drive_changes_is_found_out() -> None:
    parameters, node = drive_parameters()
    store = node._store

    def limits(index: int, sub: int, data: bytes) -> None:
        store(index, sub, struct.pack("<f", min(struct.unpack("<f", data)[0], 40.0)))

    node._store = limits  # type: ignore[method-assign]
    with pytest.raises(LinkError, match="written as 50, but the drive has 40"):
        parameters.write({"controller.kp": 50.0})
    assert struct.unpack("<f", node.objects[0x2000, 1])[0] == 1.0


def test_rpm_needs_a_rotary_axis() -> None:
    linear = Units(resolution=1e-6, direction=1, rated_torque=100.0, rotary=False)
    with pytest.raises(ConfigurationError, match="linear"):
        linear.factor("rpm")
    turning = ("rpm", "0.1mrpm", "rpm/s", "rev/s", "mrev/s", "rev/s2")
    currents = ("A", "mA", "uA")
    assert all(linear.factor(unit) > 0 for unit in UNITS if unit not in (*turning, *currents))
    with pytest.raises(ConfigurationError, match="torque constant"):
        linear.factor("mA")
