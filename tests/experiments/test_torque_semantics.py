"""Torque semantics: found on drives that include the offset in their demand, that do not, and that mislead."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.core.drive import Command, Sample
from autotune.core.errors import DriveError, NotEnoughExcitation
from autotune.core.loop import LocalLoop
from autotune.experiments.path import Motion
from autotune.experiments.runner import Programme
from autotune.experiments.torque_semantics import Meaning, TorqueSemantics, TorqueStep, pulses, tell
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset
from tests.drivers.simulator import axis_of

AXIS = axis_of()
MOTION = Motion.of(AXIS)


class Told(SimDrive):
    """The simulated axis, whose demand is told with so much of the host's offset less than it has."""

    missing = 0.0
    scale = 1.0

    def step(self, command: Command) -> Sample:
        sample = super().step(command._replace(torque_feedforward=command.torque_feedforward * self.scale))
        wrong = sample.torque_command - self.missing * command.torque_feedforward
        return sample._replace(torque_command=wrong)


def found(missing: float = 0.0, scale: float = 1.0, seed: int = 0) -> TorqueSemantics:
    drive = Told(preset("edm-vertical", seed=seed), seed)
    drive.missing, drive.scale = missing, scale
    loop = LocalLoop(drive)
    played = loop.play(Programme((TorqueStep(MOTION),), AXIS.limits, 60.0))
    loop.close()
    result = played.result("torque-step")
    assert isinstance(result, TorqueSemantics)
    return result


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("missing", "meaning"), [(0.0, Meaning.INCLUDED), (1.0, Meaning.MISSING), (-1.0, Meaning.TWICE)]
)
def test_on_the_simulated_axis_under_its_position_controller(
    missing: float, meaning: Meaning, seed: int
) -> None:
    result = found(missing, seed=seed)
    assert result.require() is meaning
    assert result.excess == pytest.approx(-missing, abs=0.1)
    assert result.scale == pytest.approx(1.0, abs=0.2)  # the controller has answered a little by then


@pytest.mark.parametrize(("scale", "says"), [(-1.0, "sign is wrong"), (0.1, "does not act"), (1.9, "unit")])
def test_a_wrong_sign_or_scale_is_refused_in_words(scale: float, says: str) -> None:
    with pytest.raises(DriveError, match=says):
        found(scale=scale).require()


def test_what_cannot_be_told_is_refused() -> None:
    assert found(missing=0.5).meaning is Meaning.UNKNOWN
    offset = pulses(MOTION, 0.04)
    noisy = offset + np.random.default_rng(1).normal(0.0, 2.0, len(offset))
    assert "uncertain" in tell(offset, offset, noisy).reason
    assert tell(offset, offset, noisy).meaning is Meaning.UNKNOWN


def test_the_axis_does_not_slide_and_the_offset_stays_small() -> None:
    offset = pulses(MOTION, TorqueStep(MOTION).amplitude)
    assert np.abs(offset).max() == pytest.approx(0.03 * AXIS.limits.torque)
    drive = SimDrive(preset("edm-vertical"))
    rows: list[Floats] = []
    LocalLoop(drive).play(
        Programme((TorqueStep(MOTION),), AXIS.limits, 60.0), lambda block: rows.append(block)
    )
    position = np.concatenate(rows)[:, Sample._fields.index("position")]
    # 0.04 N m on 100 N m/rad are 0.4 mrad of elastic motion
    assert np.ptp(position[200:]) < 2e-3


def test_without_steps_nothing_can_be_told() -> None:
    with pytest.raises(NotEnoughExcitation):
        tell(np.zeros(500), np.zeros(500), np.zeros(500))
