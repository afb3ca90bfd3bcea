"""One scale on friction: found within 2 % on the simulator's plant, and told from a change of shape."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.identify.characteristic import Points
from autotune.models.drive_model import DriveModel, base_model
from autotune.monitoring.friction_scale import friction_scale, scale_in_words
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
    assert "wear" in scale_in_words(found, math.nan) or abs(1.0 - found.theta) < 0.03


@pytest.mark.parametrize(
    ("warmer", "cause"), [(-12.0, "temperature"), (0.5, "preload"), (math.nan, "preload")]
)
def test_preload_and_temperature_are_told_apart(warmer: float, cause: str) -> None:
    random = np.random.default_rng(5)
    plant = preset("edm-vertical").plant
    found = friction_scale(legs(scale_friction(plant, 1.2), random), model_of(plant))
    assert found is not None
    assert found.enough
    assert cause in scale_in_words(found, warmer).rsplit("temperature: ", 1)[-1]


def test_nothing_is_said_without_a_change_or_without_both_directions() -> None:
    random = np.random.default_rng(6)
    plant = preset("edm-vertical").plant
    same = friction_scale(legs(plant, random), model_of(plant))
    assert same is not None
    assert scale_in_words(same, 0.0) == ""
    points = legs(plant, random)
    assert friction_scale(points.where(points.velocity > 0), model_of(plant)) is None
