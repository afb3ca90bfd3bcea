"""Profiles: the ones that come along are right, and mistakes in one are named."""

from __future__ import annotations

from pathlib import Path

import canopen
import pytest
from canopen import objectdictionary as od

from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.profile import Profile, read_profile

PROFILES = sorted(
    path.stem
    for path in (config_directory() / "profiles").glob("*.toml")
    if 'protocol = "moteus"' not in path.read_text(encoding="utf-8")
)
TYPES = {
    "bool": od.BOOLEAN,
    "u8": od.UNSIGNED8,
    "u16": od.UNSIGNED16,
    "u32": od.UNSIGNED32,
    "u64": od.UNSIGNED64,
    "i8": od.INTEGER8,
    "i16": od.INTEGER16,
    "i32": od.INTEGER32,
    "i64": od.INTEGER64,
    "f32": od.REAL32,
    "f64": od.REAL64,
}


def objects(profile: Profile) -> list[tuple[str, ObjectRef, str, bool]]:
    """(what for, object, access needed, must be mappable) of everything in a profile."""
    found = [("torque.rated", profile.torque.rated.ref, "r", False)]
    for name, signal in profile.signals:
        if signal is not None:
            found.append((f"signals.{name}", signal.ref, "r", True))
    found += [(f"commands.{name}", signal.ref, "w", True) for name, signal in profile.commands]
    found += [(name, parameter.at.ref, "rw", False) for name, parameter in profile.parameters.items()]
    found += [(text, ObjectRef.parse(text), "rw", False) for text in profile.session]
    if profile.clock:
        found.append(("clock", profile.clock.at, "r", False))
    if profile.store:
        found.append(("store", profile.store.at, "rw", False))
    if profile.quick_stop_deceleration:
        found.append(("quick stop", profile.quick_stop_deceleration.ref, "rw", False))
    return found


@pytest.mark.parametrize("name", PROFILES)
def test_loads_and_is_named_as_its_file(name: str) -> None:
    assert read_profile(name).name == name


@pytest.mark.parametrize("name", PROFILES)
def test_every_object_is_in_the_eds_with_its_type_and_access(name: str) -> None:
    profile = read_profile(name)
    if profile.eds is None:
        pytest.skip(f"profile {name} is for many drives, there is no one EDS")
    dictionary = canopen.import_od(str(config_directory() / "eds" / profile.eds), node_id=5)
    for what, ref, access, mappable in objects(profile):
        variable = dictionary.get_variable(ref.index, ref.sub)
        assert variable is not None, f"{what}: {ref} is not in the EDS"
        assert variable.data_type == TYPES[ref.type], f"{what}: {ref} has another type"
        for right in access:
            assert right in variable.access_type or variable.access_type == "const", f"{what}: {ref}"
        assert variable.pdo_mappable or not mappable, f"{what}: {ref} cannot be mapped"


def test_the_eds_and_the_profile_agree_on_who_the_drive_is() -> None:
    profile = read_profile("autotune-sim")
    dictionary = canopen.import_od(str(config_directory() / "eds" / str(profile.eds)), node_id=5)
    identity = [dictionary[0x1018][sub].default for sub in (1, 2, 3)]
    assert identity[0] == profile.identity.vendor
    assert identity[1] == profile.identity.product
    assert profile.identity.revision_min <= identity[2] <= profile.identity.revision_max


def test_only_the_simulated_drive_has_a_friction_model_of_its_own() -> None:
    assert read_profile("autotune-sim").has_feedforward_block
    assert not read_profile("cia402").has_feedforward_block


def test_an_unknown_profile_is_named_with_the_nearest() -> None:
    with pytest.raises(ConfigurationError, match="did you mean 'autotune-sim'"):
        read_profile("autotune-simm")


def test_a_profile_of_ones_own_is_beside_the_axis_file(tmp_path: Path) -> None:
    text = (config_directory() / "profiles" / "cia402.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text.replace('name = "cia402"', 'name = "mine"'), encoding="utf-8")
    assert read_profile("mine.toml", tmp_path).name == "mine"


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ('title = "', 'titel = "', "did you mean 'title'"),
        ("6064:00 i32 count", "6064:00 i32 counts", "did you mean 'count"),
        ("6064:00 i32 count", "6064:00 int32 count", "unknown type 'int32'"),
        ("6064:00 i32 count", "6064 i32 count", "is not understood"),
        ("6064:00 i32 count", "6064:00", "is not understood"),
        ('"limit.torque"', '"limit.torqe"', "did you mean 'limit.torque'"),
        ("6076:00 u32 mNm", "6076:00 u32 permille", "torque.rated"),
        ('"6007:00 i16" = 3', '"6007 i16" = 3', "is not understood"),
        ("schema = 1", "schema = 2", "schema"),
        ("demand_includes_feedforward = true", "", "demand_includes_feedforward"),
        ("6074:00 i16 permille", "30D0:00 i32 mA", "torque.constant"),
        ("6074:00 i16 permille", "6074:00 i16 count", "signals.torque_demand has the unit 'count'"),
        ("find = true", "fnid = true", "did you mean 'find'"),
        ("[identity]", "[identity]\nrevision_min = 2\nrevision_max = 1", "revision_min"),
        ("[identity]", '[identity]\nfirmware_min = "one"', "firmware_min"),
        ("[session]", '[expects]\n"60A9 u32" = 1\n[session]', "is not understood"),
    ],
)
def test_mistakes_in_a_profile_are_named(tmp_path: Path, right: str, wrong: str, says: str) -> None:
    text = (config_directory() / "profiles" / "cia402.toml").read_text(encoding="utf-8")
    assert right in text
    (tmp_path / "mine.toml").write_text(text.replace(right, wrong, 1), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        read_profile("mine.toml", tmp_path)
    assert says in str(caught.value)
    assert "mine.toml" in str(caught.value)
