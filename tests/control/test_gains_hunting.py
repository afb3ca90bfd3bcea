"""Hunting and stick-slip: recognised in records, predicted on the twin, and true on the simulator's plant."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from autotune.control.gains.hunting import after_step, predicted, recognised
from autotune.control.gains.loop import Gains
from autotune.control.gains.members import family
from autotune.control.gains.routh import pid_conditions
from autotune.control.gains.stick_slip import slow_motion, stands_often
from autotune.control.gains.twin import follow, step_reference
from autotune.models.drive_model import DriveModel
from autotune.models.total_friction import damping_at_rest
from tests.control.gains_axis import HOLDS, HUNTS, TIMING, lugre, on_the_plant, vertical

COUNT = TIMING.resolution
BURSTS = Gains(0.465, 0.0188, 1.99)


def record(seconds: float = 6.0) -> np.ndarray:
    return np.arange(round(seconds / TIMING.period)) * TIMING.period


def test_a_swing_is_told_with_frequency_and_amplitude() -> None:
    found = recognised(0.01 * np.sin(2.0 * math.pi * 7.3 * record()), TIMING.period, COUNT)
    assert found is not None
    assert found.frequency == pytest.approx(7.3, rel=0.02)
    assert found.amplitude == pytest.approx(0.01, rel=0.02)


@pytest.mark.parametrize("name", ["rests", "rounds", "dies out", "creeps"])
def test_what_is_no_limit_cycle(name: str) -> None:
    time = record()
    shapes = {
        "rests": np.zeros_like(time),
        "rounds": COUNT * np.round(1.4 * np.sin(60.0 * time)),
        "dies out": 0.05 * np.exp(-2.0 * time) * np.sin(40.0 * time),
        "creeps": 1e-3 * time,
    }
    assert recognised(shapes[name], TIMING.period, COUNT) is None


def test_bursts_are_hunting_too() -> None:
    time = record()
    bursts = 0.02 * np.sin(40.0 * time) * ((time % 1.9) < 0.3)
    assert recognised(bursts, TIMING.period, COUNT) is not None


def test_the_vertical_axis_hunts_with_ki_2000_and_is_told_before() -> None:
    """About ±90 mrad at 26.5 Hz on the plant; the twin knows it within 10 % and 25 %."""
    plant = recognised(on_the_plant(HUNTS, 0.2, 4.0), TIMING.period, COUNT)
    assert plant is not None
    assert plant.amplitude == pytest.approx(0.09, rel=0.1)
    assert plant.frequency == pytest.approx(26.5, rel=0.05)
    twin = predicted(vertical(), HUNTS, TIMING, (0.2,))
    assert twin is not None
    assert twin.frequency == pytest.approx(plant.frequency, rel=0.1)
    assert twin.amplitude == pytest.approx(plant.amplitude, rel=0.25)


def test_with_ki_1000_friction_holds_it_although_routh_fails() -> None:
    assert recognised(on_the_plant(HOLDS, 0.2, 4.0), TIMING.period, COUNT) is None
    assert predicted(vertical(), HOLDS, TIMING, (0.2,)) is None
    assert not pid_conditions(vertical(), HOLDS).sliding_stable
    assert not pid_conditions(vertical(), HUNTS).sliding_stable


def test_a_loop_that_runs_away_is_told() -> None:
    found = after_step(lugre(), Gains(50.0, 3.0), TIMING, 0.2)
    assert found is not None


def test_falling_friction_stick_slips_with_soft_gains_only() -> None:
    soft = slow_motion(lugre(0.25, 0.5), Gains(2.0, 0.005, 20.0), TIMING, 1.0)
    stiff = slow_motion(lugre(0.3, 0.31), Gains(60.0, 0.15, 2000.0), TIMING, 1.0)
    assert soft.below > 0.0
    assert stiff.below == 0.0


def test_an_axis_that_never_leaves_its_place_is_not_free_of_stick_slip() -> None:
    """A loop too weak for friction comes to stand but once; it was told to be free once."""
    speed = 0.5
    place = np.concatenate([np.linspace(0.0, 1e-3, 50), np.full(950, 1e-3)])
    assert stands_often(place, speed, TIMING)
    assert not stands_often(speed * TIMING.period * np.arange(1000), speed, TIMING)
    weak = slow_motion(lugre(), Gains(0.05, 0.005, 0.1), TIMING, speed)
    assert weak.below == pytest.approx(speed)


def test_bursts_are_measured_when_they_have_grown() -> None:
    """Each burst leaves more in the integral, until after some 10 s they are as far apart as they come."""
    falling = lugre(0.256, 0.308)
    shaken = replace(TIMING, disturbance=5e-3)
    early = [after_step(falling, BURSTS, shaken, size) for size in (0.2, -0.2)]
    found = predicted(falling, BURSTS, shaken, (0.2,), slow=False)
    assert any(one is not None and one.bursts for one in early)
    assert found is not None
    assert found.amplitude > 1.3 * min(one.amplitude for one in early if one is not None)


def damped_elements(model: DriveModel, share: float, error: float) -> DriveModel:
    """The model with a share of its damping in presliding in the elements, known by its standard error."""
    whole = model["micro_damping"]
    memory = next(effect for effect in model.effects if effect.name == "reversal_memory")
    values = {name: value.value for name, value in memory.values.items()} | {"damping": share * whole}
    effect = memory.kind.make(values, {"damping": error * whole})
    return model.with_effect(effect).with_values({"micro_damping": (1.0 - share) * whole})


def test_damping_in_all_elements_lasts_longer_than_in_the_bristle() -> None:
    """At rest both forms are the same; once the first element slides, only the bristle's has gone."""
    spread, alone = TIMING, replace(TIMING, shared_damping=False)
    reference = step_reference(0.2, 0.1, 1.0, TIMING)
    swings = [
        float(np.ptp(follow(vertical(), HUNTS, one, reference).position[-500:])) for one in (spread, alone)
    ]
    assert swings[0] < swings[1]
    members = [one for one in family(vertical(), TIMING).members if not one.timing.shared_damping]
    assert [one.what for one in members] == ["damping in the bristle alone"]
    assert all(one.timing.shared_damping for one in family(lugre(), TIMING).members)


def test_what_a_model_says_of_its_elements_damping_is_taken_and_its_interval_has_both_ends() -> None:
    """As shared by their stiffness, a quarter of it known by a standard error of an eighth: ends at a quarter less and
    at all of it in the elements."""
    told = damped_elements(vertical(), 0.8, 0.125)
    reference = step_reference(0.2, 0.1, 1.0, TIMING)
    alone = follow(told, HUNTS, replace(TIMING, shared_damping=False), reference).position
    np.testing.assert_array_equal(follow(told, HUNTS, TIMING, reference).position, alone)
    whole = damping_at_rest(told)
    ends = {one.what: one.model for one in family(told, TIMING).members if "damping more" in one.what}
    shares = {what: model["reversal_memory.damping"] / whole for what, model in ends.items()}
    assert shares == pytest.approx({"damping more in the bristle": 0.55, "damping more in the elements": 1.0})
    assert [damping_at_rest(model) for model in ends.values()] == pytest.approx([whole, whole])


def test_presliding_s_damping_is_as_known_as_its_sum() -> None:
    """Its parts trade with each other; the ends of the interval are those of all of it."""
    told = replace(damped_elements(vertical(), 0.8, 0.5), damping_error=0.1 * damping_at_rest(vertical()))
    low = next(one.model for one in family(told, TIMING).members if one.what == "damping low")
    assert damping_at_rest(low) == pytest.approx(0.8 * damping_at_rest(told), rel=0.02)
