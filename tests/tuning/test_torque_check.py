"""Over the real byte stream: a generic profile finds what the drive's 6074h means, and reads it that way."""

from __future__ import annotations

import pytest

from autotune.core.drive import HOLD, Command, Mode
from autotune.core.loop import LocalLoop
from autotune.experiments.path import Motion
from autotune.experiments.runner import Programme
from autotune.experiments.torque_semantics import Meaning, TorqueSemantics, TorqueStep
from autotune.tuning.torque_check import INCLUDES
from autotune_drivers.canopen.opening import open_drive
from autotune_drivers.profile import read_profile
from tests.drivers.simulator import axis_of
from tests.tuning.cut_rig import NODE, Rig, virtual_time

AXIS = axis_of()


def test_a_generic_profile_over_the_wire_finds_that_the_demand_includes_the_offset() -> None:
    rig = Rig({})
    with virtual_time(rig):
        loop = LocalLoop(open_drive(rig, NODE, AXIS, read_profile("cia402")))
        played = loop.play(Programme((TorqueStep(Motion.of(AXIS)),), AXIS.limits, 60.0))
        loop.close()
    found = played.result("torque-step")
    assert isinstance(found, TorqueSemantics)
    assert found.require() is Meaning.INCLUDED
    assert found.scale == pytest.approx(1.0, abs=0.25)


def test_what_was_found_changes_how_the_demand_is_read() -> None:
    rig = Rig({})
    with virtual_time(rig):
        drive = open_drive(rig, NODE, AXIS, read_profile("cia402"))
        for includes in (1.0, 0.0):
            drive.write_parameters({INCLUDES: includes})
            assert drive.read_parameters([INCLUDES]) == {INCLUDES: includes}
            drive.enable(Mode.POSITION)
            start = drive.step(HOLD).position
            sample = drive.step(Command(start, torque_feedforward=0.02))
            told = rig.device.firmware.sample.torque_demand  # 6074h, in steps of 0.5 mN m
            read = sample.torque_command if includes else sample.torque_feedback
            assert read == pytest.approx(told, abs=0.3e-3)
            assert sample.torque_command - sample.torque_feedback == pytest.approx(0.02, abs=0.3e-3)
            drive.disable()
        drive.close()


def test_a_profile_that_says_it_has_nothing_to_find() -> None:
    rig = Rig({})
    with virtual_time(rig):
        drive = open_drive(rig, NODE, AXIS, read_profile("autotune-sim"))
        assert INCLUDES not in drive.read_parameters()
        drive.close()
