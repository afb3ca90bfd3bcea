"""What a moteus controller keeps, and what it must not keep."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from autotune.core.drive import Mode
from autotune.core.errors import (
    DriveError,
    LinkError,
    StateError,
)
from autotune_drivers.moteus.drive import MoteusDrive
from autotune_drivers.moteus.opening import MoteusOpener
from tests.drivers.moteus_rig import moteus_opener, settings
from tests.drivers.simulator import Simulator, simulator


def test_storing_keeps_ours_and_nothing_that_a_session_or_a_run_has_changed(tmp_path: Path) -> None:
    with simulator(
        tmp_path, "--link", "moteus", "--node", "1", "--state", str(tmp_path / "memory")
    ) as process:
        drive = moteus_opener(tmp_path)()
        drive.write_parameters({"limit.speed": 10.0, "feedforward.coulomb": 0.3, "feedforward.enabled": 1.0})
        drive.store()
        assert drive.read_parameters(["limit.speed"])["limit.speed"] == pytest.approx(10.0, rel=1e-3)
        mark = process.mark
        process.order("power-loss")
        process.wait_for("boot-up", mark)
        after = drive.read_parameters(["limit.speed", "feedforward.coulomb", "feedforward.enabled"])
        drive.close()
        stored = settings(tmp_path)
    assert after == pytest.approx(
        {"limit.speed": 50.0, "feedforward.coulomb": 0.3, "feedforward.enabled": 1.0}, rel=1e-3
    )
    assert stored["servo.default_accel_limit"] == "63.662"


def test_a_controller_that_may_not_load_stores_without_the_session(tmp_path: Path) -> None:
    """As a real one: `conf load` would cost it its position."""
    with simulator(
        tmp_path, "--link", "moteus", "--node", "1", "--state", str(tmp_path / "memory")
    ) as process:
        opener = moteus_opener(tmp_path)
        store = opener.profile.store
        assert store is not None
        profile = opener.profile.model_copy(update={"store": store.model_copy(update={"reload": False})})
        drive = MoteusOpener(opener.address, opener.axis, profile)()
        drive.write_parameters({"feedforward.coulomb": 0.3})
        drive.store()
        assert drive._settings.console.get("servo.timeout_mode") == "10"
        drive.close()
        mark = process.mark
        process.order("power-loss")
        process.wait_for("boot-up", mark)
        stored = settings(tmp_path)
    assert stored["autotune.feedforward.coulomb"] == "0.3"
    assert stored["servo.timeout_mode"] == "12"


def test_a_memory_that_keeps_nothing_is_found_out(running: Simulator, drive: MoteusDrive) -> None:
    mark = running.mark
    running.order("nvm")
    running.wait_for("fault put in", mark)
    drive.write_parameters({"feedforward.viscous": 0.001})
    try:
        with pytest.raises(DriveError, match="does not keep"):
            drive.store()
    finally:
        running.order("clear")
        drive.write_parameters({"feedforward.viscous": 0.0})


def test_a_refused_parameter_is_said_and_nothing_is_half_written(
    running: Simulator, drive: MoteusDrive
) -> None:
    mark = running.mark
    running.order("sdo-abort=2100:04:06090030")
    running.wait_for("fault put in", mark)
    before = drive.read_parameters(["feedforward.inertia"])
    with pytest.raises(LinkError, match=r"autotune\.feedforward\.coulomb"):
        drive.write_parameters({"feedforward.inertia": 0.002, "feedforward.coulomb": 0.3})
    running.order("clear")
    assert drive.read_parameters(["feedforward.inertia"]) == before


def test_nothing_is_stored_with_power_on(drive: MoteusDrive) -> None:
    drive.enable(Mode.POSITION)
    try:
        with pytest.raises(StateError, match="power off"):
            drive.store()
    finally:
        drive.disable()


def test_what_a_session_that_died_has_changed_is_put_back_by_the_next(tmp_path: Path) -> None:
    with simulator(tmp_path, "--link", "moteus", "--node", "1"):
        before, keep = settings(tmp_path), tmp_path / "sessions"
        opener = replace(moteus_opener(tmp_path), keep=keep)
        opener()._settings.node.port.close()  # nothing of it runs any more
        left = settings(tmp_path)
        assert left["servo.timeout_mode"] != before["servo.timeout_mode"]
        drive = opener()
        assert "servo.timeout_mode" in drive.left[0]
        assert "put back" in drive.left[0]
        drive.close()
        assert settings(tmp_path) == before
        assert list(keep.iterdir()) == []


def test_what_somebody_has_set_in_a_controller_since_is_left_alone(tmp_path: Path) -> None:
    with simulator(tmp_path, "--link", "moteus", "--node", "1"):
        keep = tmp_path / "sessions"
        opener = replace(moteus_opener(tmp_path), keep=keep)
        dead = opener()
        dead._settings.console.set("servo.default_accel_limit", "12.5")
        dead._settings.node.port.close()
        drive = opener()
        assert any("servo.default_accel_limit" in one and "left as they are" in one for one in drive.left)
        drive.close()
        assert settings(tmp_path)["servo.default_accel_limit"] == "12.5"
