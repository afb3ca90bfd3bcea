"""Simulated axes for diagnoses: sizes of planted effects, the model before anything was fitted, and unknown physics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from autotune_sim.effects import EFFECTS
from autotune_sim.presets import Preset, preset

MEDIUM = {
    "torque_ripple": 0.01, "direction_asymmetry": 0.06, "stribeck": 0.04, "nonlinear_viscous": 0.02,
    "position_dependent_friction": 0.15, "gravity_imbalance": 0.015, "spring": 0.004,
    "reversal_memory": 0.06, "thermal_drift": 0.03, "elastic_transmission": 0.01, "backlash": 4e-3,
    "torque_lag": 5e-4, "torque_saturation": 0.2, "dwell_time_break_away": 0.08,
    "load_dependent_friction": 0.15, "encoder_eccentricity": 1.6e-2,
}  # fmt: skip
NOMINAL = {
    "inertia": 6.66e-4, "viscous": 4.13e-3, "coulomb": 0.30, "stiffness": 100.0, "micro_damping": 0.05,
    "offset": 0.048,
}  # fmt: skip


def plain_axis(seed: int, effects: Mapping[str, float] | None = None) -> Preset:
    """A LuGre axis without Stribeck effect, every parameter within ±20 %, with planted effects."""
    axis = preset("lugre", seed=seed, effects=effects)
    bristle = axis.plant.bristle
    if bristle is None:
        raise ValueError("the preset 'lugre' has a bristle")
    return replace(axis, plant=replace(axis.plant, bristle=replace(bristle, break_away=bristle.coulomb)))


def planted_size(effect: str, size: float) -> float:
    """As much of an effect as the simulator allows."""
    return min(size, EFFECTS[effect].high)


def _dip(time: float, position: float, velocity: float, acceleration: float) -> float:
    return -0.05 * velocity * math.exp(-((velocity / 1.5) ** 2))


def _crank(time: float, position: float, velocity: float, acceleration: float) -> float:
    return -1.5e-4 * acceleration * math.cos(2 * position)


def _uneven_oil(time: float, position: float, velocity: float, acceleration: float) -> float:
    return -0.006 * velocity * math.sin(position)


def _mains(time: float, position: float, velocity: float, acceleration: float) -> float:
    return 0.012 * math.sin(2 * math.pi * 7.3 * time)


class _Creep:
    """A dashpot behind a spring: torque follows velocity late."""

    def __init__(self) -> None:
        self.late = 0.0

    def __call__(self, time: float, position: float, velocity: float, acceleration: float) -> float:
        self.late += 1e-3 / 0.3 * (velocity - self.late)
        return -0.01 * self.late


ALIENS = {"dip": lambda: _dip, "crank": lambda: _crank, "uneven_oil": lambda: _uneven_oil,
          "mains": lambda: _mains, "creep": _Creep}  # fmt: skip
