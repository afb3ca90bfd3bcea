"""Before power: an axis outside its travel, or one that moves, is refused and nothing is switched on."""

from __future__ import annotations

import math

import pytest

from autotune.core.errors import GuardStop
from autotune.core.loop import LocalLoop
from autotune.experiments.path import Motion
from autotune.experiments.runner import Programme
from autotune.experiments.sines import BenchmarkSine
from autotune.experiments.standstill import standing
from autotune_sim.inprocess import open_sim
from tests.experiments.support import FollowingDrive, axis

AXIS = axis()


def test_an_axis_at_rest_inside_its_travel_may_be_powered() -> None:
    drive = FollowingDrive(position=1.5)
    assert standing(LocalLoop(drive), AXIS.limits).position == 1.5
    assert "enable position" not in drive.calls


@pytest.mark.parametrize(
    ("position", "turning", "says"),
    [
        (25.0, 0.0, r"stands at 25, but limits\.position_max allows 20"),
        (-20.5, 0.0, r"stands at -20\.5, but limits\.position_min allows -20"),
        (0.0, 1.5, r"moves with 1\.5 at 0, but 1 \(0\.05 of limits\.speed\)"),
        (0.0, -1.5, r"moves with -1\.5"),
        (math.nan, 0.0, "not finite numbers; check encoder"),
        (0.0, math.inf, "not finite numbers"),
    ],
)
def test_what_must_not_be_powered_is_refused_in_words(position: float, turning: float, says: str) -> None:
    drive = FollowingDrive(position=position)
    drive.turning = turning
    with pytest.raises(GuardStop, match=says) as stop:
        standing(LocalLoop(drive), AXIS.limits)
    assert str(stop.value).startswith("power was not switched on")


def test_one_flickering_count_of_a_coarse_encoder_is_no_motion() -> None:
    drive = FollowingDrive()
    flicker = iter([3.1, 0.0, 0.0, -3.1, 0.0])
    drive.look = lambda: FollowingDrive.look(drive)._replace(velocity=next(flicker))  # type: ignore[method-assign]
    assert standing(LocalLoop(drive), AXIS.limits).position == 0.0


def test_a_programme_does_not_power_an_axis_outside_its_travel() -> None:
    """The drive would take its own limit for the position to hold, and go there."""
    away = axis(position_min=5.0, position_max=20.0)
    drive = open_sim("sim://edm-vertical")
    drive.write_parameters({"limit.position_min": 5.0})
    powered: list[bool] = []
    enable = drive.enable
    drive.enable = lambda mode: (powered.append(True), enable(mode))[1]  # type: ignore[method-assign]
    what = Programme((BenchmarkSine(Motion.of(away), 1, 2),), away.limits, 300.0)
    with pytest.raises(GuardStop, match=r"stands at 0, but limits\.position_min allows 5"):
        LocalLoop(drive).play(what)
    assert not powered
