"""Who is at the other end of a moteus line, and what its profile says."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from autotune.core.errors import (
    ConfigurationError,
    IdentityMismatch,
    LinkError,
    LinkTimeout,
    StateError,
)
from autotune.core.paths import config_directory
from autotune_drivers.moteus.drive import MoteusDrive
from autotune_drivers.moteus.multiplex import Form, write
from autotune_drivers.moteus.node import MoteusNode
from autotune_drivers.moteus.port import open_port
from autotune_drivers.moteus.profile import read_moteus_profile
from autotune_drivers.profile import read_profile
from tests.drivers.contract import where
from tests.drivers.moteus_rig import moteus_opener, settings
from tests.drivers.simulator import Simulator


def test_a_silent_controller_is_said(running: Simulator) -> None:
    running.order("silent=3")
    time.sleep(0.1)
    with pytest.raises(LinkTimeout, match="controller 1 is silent"):
        moteus_opener(running.directory)()
    running.order("clear")


def test_a_wrong_id_names_the_right_one(running: Simulator) -> None:
    with pytest.raises(LinkTimeout, match="id=1"):
        moteus_opener(running.directory, "moteus+serial:edm.tty?id=2")()


def test_a_wrong_speed_is_said(running: Simulator) -> None:
    with pytest.raises(LinkTimeout, match="speed is not 115200 baud"):
        moteus_opener(running.directory, "moteus+serial:edm.tty?id=1&baud=115200")()
    moteus_opener(running.directory)().close()


def test_a_port_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="there is no serial port"):
        moteus_opener(tmp_path)()
    (tmp_path / "edm.tty").write_text("no port")
    with pytest.raises(LinkError, match="not a serial port"):
        moteus_opener(tmp_path)()


def test_a_port_that_another_program_has_is_not_disturbed(drive: MoteusDrive, running: Simulator) -> None:
    with pytest.raises(LinkError, match="in use"):
        moteus_opener(running.directory)()
    assert where(drive) == pytest.approx(where(drive), abs=5e-3)


def test_another_model_is_refused_before_anything_is_written(running: Simulator) -> None:
    before = settings(running.directory)
    mark = running.mark
    running.order("other-identity")
    running.wait_for("fault put in", mark)
    with pytest.raises(IdentityMismatch, match="0x7a01"):
        moteus_opener(running.directory)()
    running.order("clear")
    assert settings(running.directory) == before


def test_a_controller_that_another_host_commands_is_left_alone(running: Simulator) -> None:
    """Its commands have no watchdog; nothing of ours is written."""
    port = open_port(running.directory / "edm.tty", 921600)
    node = MoteusNode(port, 1)
    node.greet()
    node.tell(
        write(Form.INT8, 0, [10])
        + write(Form.FLOAT, 0x20, [float("nan")])
        + write(Form.FLOAT, 0x27, [float("nan")])
    )
    port.close()
    with pytest.raises(StateError, match="another program commands it"):
        moteus_opener(running.directory)()
    port = open_port(running.directory / "edm.tty", 921600)
    node = MoteusNode(port, 1)
    node.greet()
    assert node.registers((Form.INT8, 0, 1))[0] == 10
    node.tell(write(Form.INT8, 0, [0]))
    port.close()


def test_an_axis_in_metres_is_refused(running: Simulator) -> None:
    with pytest.raises(ConfigurationError, match="revolutions"):
        moteus_opener(running.directory, motion_unit="m")()


def test_profiles_are_for_their_links() -> None:
    with pytest.raises(ConfigurationError, match="for a moteus link"):
        read_profile("moteus")
    with pytest.raises(ConfigurationError, match="for CANopen drives"):
        read_moteus_profile("cia402")
    with pytest.raises(ConfigurationError, match="did you mean 'autotune-sim-moteus'"):
        read_moteus_profile("autotune-sim-moteu")
    assert not read_moteus_profile("moteus").has_feedforward_block


@pytest.mark.parametrize("name", ["moteus", "autotune-sim-moteus"])
def test_profiles_load(name: str) -> None:
    assert read_moteus_profile(name).name == name


def test_mistakes_in_a_profile_are_named(tmp_path: Path) -> None:
    text = (config_directory() / "profiles" / "moteus.toml").read_text(encoding="utf-8")
    for right, wrong, says in (
        ("title =", "titel =", "did you mean 'title'"),
        ('"Nm/rev"', '"Nm/rv"', "did you mean 'Nm/rev'"),
        ('"controller.kp"', '"controler.kp"', "did you mean 'controller.kp'"),
        ("watchdog = 0.15", "watchdog = 0.5", "watchdog"),
    ):
        assert right in text
        (tmp_path / "mine.toml").write_text(text.replace(right, wrong, 1), encoding="utf-8")
        with pytest.raises(ConfigurationError, match=says):
            read_moteus_profile("mine.toml", tmp_path)
