"""Presliding: what an encoder has to show in it, and sets that are worth nothing."""

from __future__ import annotations

import pytest

from autotune.core.drive import Mode
from autotune.core.errors import GuardStop, NotEnoughExcitation
from autotune.experiments.path import Motion
from autotune.experiments.presliding import Presliding
from autotune.experiments.runner import Programme
from tests.experiments.hurt_axis import Hurt, HurtDrive, Mass
from tests.experiments.support import axis

AXIS = axis()
MOTION = Motion.of(AXIS)
COARSE = AXIS.model_copy(
    update={"mechanics": AXIS.mechanics.model_copy(update={"counts_per_revolution": 700})}
)
"""Below break-away its encoder tells nothing."""


def play(drive: HurtDrive, sets: int) -> None:
    experiment = Presliding(Motion.of(drive.axis), friction=0.33, sets=sets)
    Programme((experiment,), drive.axis.limits, 900.0)(drive, lambda row, label, repeat: None)


class Switched(HurtDrive):
    """Knows when it was switched to which mode."""

    modes: list[tuple[float, Mode]]

    def enable(self, mode: Mode) -> None:
        self.__dict__.setdefault("modes", []).append((self.time, mode))
        super().enable(mode)


def test_an_encoder_too_coarse_for_presliding_has_to_show_that_it_lives() -> None:
    """After a quarter of a second, and then every four sets: so long torque acts on an axis that nobody sees."""
    drive = Switched(COARSE)
    play(drive, sets=5)
    spans = [
        later - since
        for (since, mode), (later, _) in zip(drive.modes, drive.modes[1:], strict=False)
        if mode is Mode.TORQUE
    ]
    assert len(spans) == 3
    assert spans[0] == pytest.approx(0.25, abs=0.01)
    assert 12.0 < max(spans) < 15.0


@pytest.mark.parametrize("after", [1.0, 2.5])
def test_who_leans_on_an_axis_whose_encoder_died_in_presliding_moves_it_without_power(after: float) -> None:
    """Regression: 34.8 rad/s of 15.5, 1.3 s after an encoder had died in a set (seed 1224536)."""
    drive = HurtDrive(AXIS, Mass(load=lambda time: 0.5 * (time > 8.0 + after)), Hurt("frozen", 8.0))
    with pytest.raises(GuardStop, match="encoder"):
        play(drive, sets=2)
    assert drive.time < 8.0 + min(after, 1.0)
    assert drive.fastest < AXIS.limits.speed


def test_sets_under_another_load_are_not_kept() -> None:
    leans = HurtDrive(
        COARSE, Mass(load=lambda time: 0.2 * (time > 26.5))
    )  # while it is relaxed anew, after four sets
    with pytest.raises(NotEnoughExcitation, match="leans on the axis"):
        play(leans, sets=5)


def test_a_mirrored_axis_is_told_by_the_load_that_it_bears() -> None:
    """Regression: encoder and torque both turned round, and ten sets were kept (seed 1225326).

    Seen by both, friction and inertia are what they were, and gravity has changed its sign.
    """
    drive = HurtDrive(AXIS, Mass(gravity=0.12, load=lambda time: -0.24 * (time > 11.5)))
    with pytest.raises(NotEnoughExcitation, match="turned round"):
        play(drive, sets=3)
    assert drive.fastest < AXIS.limits.speed


def test_what_is_announced_covers_all_that_moves_the_axis() -> None:
    """Regression: the sine that relaxes the axis goes half as far again as the survey, and was not counted."""
    experiment = Presliding(MOTION)
    needs = experiment.needs(AXIS.limits)
    for plan in (experiment.survey, experiment.relaxing[0]):
        assert needs.position_min < plan.reference.min()
        assert plan.reference.max() < needs.position_max
        assert abs(plan.velocity).max() < needs.speed
        assert abs(plan.acceleration).max() <= needs.acceleration
