"""What is compared before anything is written: firmware, the drive's own units; and torques that are currents."""

from __future__ import annotations

import struct

import pytest

from autotune.core.errors import ConfigurationError, IdentityMismatch
from autotune_drivers.canopen.opening import open_drive
from autotune_drivers.profile import Profile, read_profile
from autotune_drivers.units import Units
from tests.drivers.fake_node import FakeNode
from tests.drivers.simulator import axis_of


def identified(firmware: bytes = b"1.0.0", **objects: int) -> FakeNode:
    """A node that answers who it is; nothing else can be read."""
    node = FakeNode(
        {(0x1018, sub): struct.pack("<I", value) for sub, value in ((1, 0xFB), (2, 1), (3, 0x01700000))}
    )
    node.objects |= {(0x1018, 4): bytes(4), (0x1008, 0): b"EPOS4", (0x100A, 0): firmware}
    node.objects |= {(int(name[1:], 16), 0): struct.pack("<I", value) for name, value in objects.items()}
    return node


def profile(**changes: object) -> Profile:
    found = read_profile("maxon-epos4")
    return found.model_copy(update=changes)


def test_a_drive_set_up_with_other_units_is_refused_before_anything_is_written() -> None:
    node = identified(x60A9=0x00B44700, x60AA=0x00B40300)
    with pytest.raises(IdentityMismatch, match="60AAh") as caught:
        open_drive(node, 5, axis_of(), read_profile("maxon-epos4"))
    assert not node.writes
    assert "0xb40300" in str(caught.value)


@pytest.mark.parametrize(
    ("low", "high", "found", "fits"),
    [
        ("1.2", "1.10", b"1.9.3", True),
        ("1.2", "1.10", b"v1.10.0 build 7", True),
        ("1.2", "1.10", b"1.11", False),
        ("1.2", None, b"1.1.9", False),
        ("1.2", None, b"2", True),
        ("1.2", None, b"unknown", False),
    ],
)
def test_a_firmware_outside_the_profiles_range_is_refused(
    low: str, high: str | None, found: bytes, fits: bool
) -> None:
    identity = read_profile("maxon-epos4").identity.model_copy(
        update={"firmware_min": low, "firmware_max": high}
    )
    node = identified(found, x60A9=0, x60AA=0)
    with pytest.raises(IdentityMismatch) as caught:
        open_drive(node, 5, axis_of(), profile(identity=identity))
    assert ("firmware" in str(caught.value)) != fits
    assert not node.writes


def test_a_revision_outside_the_profiles_range_is_refused() -> None:
    node = identified()
    node.objects[0x1018, 3] = struct.pack("<I", 0x21260000)  # an EPOS2
    with pytest.raises(IdentityMismatch, match="0x21260000 is outside 0x01500000 to 0x01ffffff"):
        open_drive(node, 5, axis_of(), read_profile("maxon-epos4"))
    assert not node.writes


def test_torques_that_are_currents_are_scaled_by_the_torque_constant() -> None:
    """The DCF's motor: 4760 mA times 107746 µN m/A are its rated torque of 512871 µN m."""
    units = Units(1e-3, -1, 0.512871, True, 107746e-6)
    assert 4760 * units.factor("mA") == pytest.approx(0.512871, rel=1e-5)
    assert units.signed("A") == pytest.approx(-0.107746)
    with pytest.raises(ConfigurationError, match="torque constant"):
        Units(1e-3, 1, 1.0, True).factor("uA")
