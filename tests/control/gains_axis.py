"""Axes for the tests of gains: the vertical axis with what identification finds of it, and the simulator's plant."""

from __future__ import annotations

import math

import numpy as np

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.members import Member
from autotune.control.gains.search import settle_on
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import EFFECTS
from autotune_sim.presets import preset
from autotune_sim.servo import Servo

TIMING = LoopTiming(1e-3, 2.0 * math.pi / 50_000, 1.34, reference_filter=0.8)
HUNTS, HOLDS = Gains(16.4, 0.02, 2000.0), Gains(16.4, 0.02, 1000.0)
THESIS = Gains(60.0, 0.15, 6000.0)


def vertical() -> DriveModel:
    """Table 6.2 with the elements of the preset, as a run identifies them."""
    plant = preset("edm-vertical").plant
    errors = {"inertia": 2e-6, "viscous": 2e-5, "coulomb": 1e-3, "stiffness": 1.0, "micro_damping": 0.014}
    model = base_model(
        {
            "inertia": plant.inertia, "viscous": plant.viscous, "coulomb": 0.01, "stiffness": 10.0,
            "micro_damping": 0.05, "offset": plant.offset,
        },
        errors,
    )  # fmt: skip
    held: dict[str, float] = {}
    for number, element in enumerate(plant.elements, 1):
        held[f"displacement_{number}"] = element.displacement
        held[f"torque_{number}"] = element.torque - (0.01 if number == 1 else 0.0)
    effect = EFFECTS["reversal_memory"].make(held, {name: 0.02 * value for name, value in held.items()})
    return model.with_effect(effect)


def lugre(coulomb: float = 0.3, break_away: float = 0.36) -> DriveModel:
    """One bristle whose friction falls with speed, with standard errors."""
    values = {
        "inertia": 6.66e-4, "viscous": 4e-3, "coulomb": coulomb, "stiffness": 100.0, "micro_damping": 0.05,
        "offset": 0.05, "break_away": break_away, "stribeck_velocity": 0.3,
    }  # fmt: skip
    return base_model(values, {name: 0.02 * value for name, value in values.items()})


def on_the_plant(gains: Gains, size: float, seconds: float, seed: int = 1) -> Floats:
    """Positions after a step on the simulator's own plant and servo loop, shape (n,) [rad]."""
    servo = Servo(preset("edm-vertical"), seed=seed)
    for name in ("kp", "kd", "ki", "derivative_filter"):
        servo.parameters.record["controller_" + name] = getattr(gains, name)
    servo.power(True)
    for _ in range(600):
        servo.cycle(0.0)
    return np.array([servo.cycle(size).position for _ in range(round(seconds * 1e3))])


def expected_settling(members: tuple[Member, ...], gains: Gains, size: float) -> float:
    """The mean over axes, each under a disturbance of its own [s]."""
    return float(np.mean([settle_on(one, gains, size, k) for k, one in enumerate(members)]))
