"""A table over velocity in a CiA 402 drive: what its profile says, what the drive takes, and what it then plays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from autotune.control.velocity_table import Points, TableBlock
from autotune.core.errors import ConfigurationError, LinkError
from autotune.core.friction_table import TORQUE, VELOCITY
from autotune.core.loop import LocalLoop
from autotune.core.paths import config_directory
from autotune_drivers.profile import read_profile
from autotune_sim.own_friction import own_friction
from tests.tuning.ripple_cut_rig import VelocityRig, points

STEP = 1e-4 * 2.0 * np.pi / 60.0  # 0.1 mrpm
TEXT = (config_directory() / "profiles/autotune-sim-table.toml").read_text(encoding="utf-8")
TABLE = points(2, (0.2, 0.22, 0.24, 0.25, 0.26, 0.28))


@pytest.fixture
def rig() -> VelocityRig:
    return VelocityRig({})


@pytest.fixture
def loop(rig: VelocityRig, tmp_path: Path) -> Iterator[LocalLoop]:
    with rig.time():
        opened = rig.open(tmp_path)
        yield opened
        opened.close()


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ("u32 0.1mrpm", "u32 permille", "friction_table.velocity has the unit 'permille'"),
        ("3160:07 u16 permille", "3160:07 u16 rpm", "friction_table.torque has the unit 'rpm'"),
        ("points = 6", "points = 1", "points"),
        ("points = 6", "points = 256", "ends at sub-index 256"),
        ('kind = "points"', 'kind = "steps"', "kind"),
        ('"feedforward.offset" = {', '"feedforward.coulomb" = {', "leave out feedforward.coulomb"),
        ('"feedforward.enabled"', '"feedforward.reference_filter"', "needs feedforward.enabled"),
    ],
)
def test_mistakes_in_the_entry_are_named(tmp_path: Path, right: str, wrong: str, says: str) -> None:
    assert right in TEXT
    (tmp_path / "mine.toml").write_text(TEXT.replace(right, wrong, 1), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        read_profile("mine.toml", tmp_path)
    assert says in str(caught.value)


def test_the_drive_says_what_its_table_can_hold(loop: LocalLoop) -> None:
    block = TableBlock.of(loop.read_parameters())
    assert block == TableBlock(6, 1e8 * STEP, pytest.approx(1.5), STEP, pytest.approx(5e-4))


def test_velocities_are_written_before_torques_in_the_drives_steps(loop: LocalLoop) -> None:
    backwards = dict(reversed(TABLE.items()))
    loop.write_parameters(backwards | {f"{VELOCITY}.0": 0.1, f"{TORQUE}.0": 0.2001})
    held = loop.read_parameters()
    assert held[f"{VELOCITY}.0"] == pytest.approx(round(0.1 / STEP) * STEP, abs=1e-12)
    assert held[f"{TORQUE}.0"] == pytest.approx(0.2, abs=1e-12)
    names = [name for name in held if name.startswith((VELOCITY, TORQUE))]
    assert names == [f"{stem}.{k}" for stem in (VELOCITY, TORQUE) for k in range(6)]


@pytest.mark.parametrize(
    ("name", "value"), [(f"{TORQUE}.2", 1.6), (f"{VELOCITY}.5", 1100.0), (f"{TORQUE}.0", -0.1)]
)
def test_what_overflows_is_refused_before_anything_is_written(
    loop: LocalLoop, name: str, value: float
) -> None:
    before = loop.read_parameters()
    with pytest.raises(ConfigurationError, match="this drive allows"):
        loop.write_parameters({**TABLE, name: value})
    assert loop.read_parameters() == before


def test_velocities_that_do_not_increase_cannot_be_switched_on(loop: LocalLoop) -> None:
    off = {**TABLE, "feedforward.enabled": 0.0}
    loop.write_parameters({**off, f"{VELOCITY}.3": TABLE[f"{VELOCITY}.2"]})
    with pytest.raises(LinkError):
        loop.write_parameters({"feedforward.enabled": 1.0})
    loop.write_parameters(off)
    loop.write_parameters({"feedforward.enabled": 1.0})


def test_the_drive_plays_what_the_law_says_that_it_plays(rig: VelocityRig, loop: LocalLoop) -> None:
    loop.write_parameters(TABLE)
    held = {name.removeprefix("feedforward."): value for name, value in loop.read_parameters().items()}
    law = Points.among(held)
    assert law is not None
    record = rig.device.firmware.servo.friction[0]
    for velocity in (0.0, *np.random.default_rng(1).uniform(-30.0, 30.0, 50), 1e-3, -1e-3, 1e3):
        assert own_friction(record, float(velocity)) == pytest.approx(float(law.at(velocity)), abs=1e-12)
