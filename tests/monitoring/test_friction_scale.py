"""One scale on friction: found within 2 % on the simulator's plant, and told from a change of shape."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.identify.steady_state import Points
from autotune.models.drive_model import DriveModel, base_model
from autotune.monitoring.friction_scale import (
    AT_ONCE,
    CREPT,
    Background,
    course_of,
    friction_scale,
    scale_in_words,
)
from autotune.monitoring.trend import Change
from autotune_sim.effects import scale_friction
from autotune_sim.plant import PlantParameters
from autotune_sim.presets import preset
from autotune_sim.presets import vary as varied

SPEEDS = np.array([0.25, 0.4, 0.6, 0.9, 1.25])
VELOCITY = np.concatenate([SPEEDS, -SPEEDS])


def model_of(plant: PlantParameters) -> DriveModel:
    level = {"coulomb": plant.friction, "stiffness": plant.stiffness}
    return base_model(
        {
            "inertia": plant.inertia,
            "viscous": plant.viscous,
            "micro_damping": 0.05,
            "offset": plant.offset,
            **level,
        }
    )


def legs(plant: PlantParameters, random: np.random.Generator, viscous: float = 1.0) -> Points:
    """Mean torques of legs of a second each: process noise averaged over a thousand samples, ripple over turns."""
    torque = plant.friction * np.sign(VELOCITY) + viscous * plant.viscous * VELOCITY + plant.offset
    error = np.full(len(VELOCITY), 1.5e-3)
    noise: Floats = random.normal(0.0, error)
    return Points(VELOCITY, torque + noise, error)


def test_theta_within_two_percent_on_fifty_axes() -> None:
    for seed in range(50):
        random = np.random.default_rng([seed, 9])
        plant = varied(preset("edm-vertical").plant, random)
        true = float(random.uniform(0.7, 1.3))
        found = friction_scale(legs(scale_friction(plant, 1.0 / true), random), model_of(plant))
        assert found is not None
        assert found.theta == pytest.approx(true, rel=0.02)


def test_a_changed_shape_is_no_scale() -> None:
    random = np.random.default_rng(4)
    plant = preset("edm-vertical").plant
    found = friction_scale(legs(plant, random, viscous=6.0), model_of(plant))
    assert found is not None
    assert not found.enough
    assert "wear" in scale_in_words(found, Background()) or abs(1.0 - found.theta) < 0.03


@pytest.mark.parametrize(
    ("known", "cause"),
    [
        (Background(-12.0), "at 12 K less: the temperature"),
        (Background(0.5), "no such change of temperature: the preload"),
        (Background(), "no such change of temperature: the preload"),
        (Background(-12.0, -0.015), "at 12 K less: the temperature"),
        (Background(-12.0, -0.005, AT_ONCE), "at the same temperature; it came at once: the preload"),
        (Background(-6.0, 0.0, CREPT), "it crept there: wear"),
        (Background(-2.0, -0.015, CREPT), "it crept there: wear"),
    ],
)
def test_preload_temperature_and_wear_are_told_apart(known: Background, cause: str) -> None:
    random = np.random.default_rng(5)
    plant = preset("edm-vertical").plant
    found = friction_scale(legs(scale_friction(plant, 1.2), random), model_of(plant))
    assert found is not None
    assert found.enough
    assert cause in scale_in_words(found, known)


def test_more_than_a_temperature_can_do_is_not_laid_to_it() -> None:
    random = np.random.default_rng(7)
    plant = preset("edm-vertical").plant
    found = friction_scale(legs(scale_friction(plant, 1.4), random), model_of(plant))
    assert found is not None
    assert "the temperature." not in scale_in_words(found, Background(-6.0))


def test_the_largest_change_since_the_model_says_how_it_came() -> None:
    def day(number: int) -> datetime:
        return datetime(2026, 1, 1) + timedelta(days=number)

    step = Change("step", day(40), 0.2, 0.01)
    creep = Change("trend", day(10), 0.1, 0.01)
    before = Change("step", day(5), 0.5, 0.01)
    fall = Change("step", day(50), -0.3, 0.01)
    changes = [before, creep, step, fall]
    assert course_of(changes, day(20), rises=True) == AT_ONCE
    assert course_of([before, creep], day(20), rises=True) == CREPT
    assert course_of([before, fall], day(20), rises=True) == ""
    assert course_of(changes, day(20), rises=False) == AT_ONCE


def test_nothing_is_said_without_a_change_or_without_both_directions() -> None:
    random = np.random.default_rng(6)
    plant = preset("edm-vertical").plant
    same = friction_scale(legs(plant, random), model_of(plant))
    assert same is not None
    assert scale_in_words(same, Background(0.0)) == ""
    points = legs(plant, random)
    assert friction_scale(points.where(points.velocity > 0), model_of(plant)) is None
