"""Physics that can be planted into the simulated axis, each with one size.

| name | law | size | default |
|---|---|---|---|
| torque_ripple | cogging of orders 12 and 24 (half as high), random phase | N m, order 12 | 0.02 |
| direction_asymmetry | friction (1 ± size)-fold in the two directions | – | 0.1 |
| stribeck | break-away above Coulomb torque, lost with exp(−(v/0.3 rad/s)²) | N m | 0.06 |
| nonlinear_viscous | lubricant, torque ∝ \\|v\\|^(2/3) (Palmgren) | N m at 1 rad/s | 0.03 |
| position_dependent_friction | a tight spot, Gaussian, 1 rad wide, centre in ±1 rad | relative rise | 0.3 |
| gravity_imbalance | unbalanced mass, size·sin(q + phase) | N m | 0.03 |
| spring | torque ∝ position | N m/rad | 0.01 |
| reversal_memory | more elastic elements, breaking at 10, 30 and 100 mrad | N m in all | 0.1 |
| thermal_drift | lubricant thins with warming, exp(−size·ΔT) (Reynolds) | 1/K | 0.03 |
| elastic_transmission | load on a spring, 40 % of inertia and friction beyond it | rad/(N m) | 0.01 |
| backlash | load beyond a gap, contact stiffness 300 N m/rad | rad | 5e-3 |
| torque_lag | first-order lag of the current loop | s | 5e-4 |
| torque_saturation | iron saturation, T = u·(1 − size·(u/limit)²) | relative loss at the limit | 0.25 |
| dwell_time_break_away | break-away grows with rest (1 s), lost in 5 mrad of slip | N m | 0.08 |
| load_dependent_friction | friction grows with the torque transmitted | N m/(N m) | 0.2 |
| encoder_eccentricity | once-per-revolution error of the encoder, random phase | rad | 1e-3 |
"""

from __future__ import annotations

import difflib
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from autotune.core.errors import ConfigurationError
from autotune_sim.plant import Element, PlantParameters, Wave

Planter = Callable[[PlantParameters, float, np.random.Generator], PlantParameters]
CONTACT_STIFFNESS = 300.0  # N m/rad, of the flanks of a gap
STIFFEST = 1e4  # N m/rad, what the integration step still resolves


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect that can be planted: its size's unit, default and allowed range."""

    plant: Planter
    unit: str
    default: float
    low: float
    high: float


def _field(name: str) -> Planter:
    def plant(axis: PlantParameters, size: float, _: np.random.Generator) -> PlantParameters:
        changes: dict[str, Any] = {name: size}
        return replace(axis, **changes)

    return plant


def _torque_ripple(axis: PlantParameters, size: float, random: np.random.Generator) -> PlantParameters:
    one, two = random.uniform(0.0, 2.0 * math.pi, 2)
    return replace(axis, ripple=(*axis.ripple, Wave(12.0, size, one), Wave(24.0, 0.5 * size, two)))


def _tight_spot(axis: PlantParameters, size: float, random: np.random.Generator) -> PlantParameters:
    return replace(axis, bump=size, bump_centre=float(random.uniform(-1.0, 1.0)), bump_width=1.0)


def _imbalance(axis: PlantParameters, size: float, random: np.random.Generator) -> PlantParameters:
    return replace(axis, imbalance=size, imbalance_phase=float(random.uniform(0.0, 2.0 * math.pi)))


def _reversal_memory(axis: PlantParameters, size: float, _: np.random.Generator) -> PlantParameters:
    more = (Element(0.01, 0.4 * size), Element(0.03, 0.35 * size), Element(0.1, 0.25 * size))
    return replace(axis, elements=axis.elements + (more if size > 0 else ()))


def _elastic(axis: PlantParameters, size: float, _: np.random.Generator) -> PlantParameters:
    stiffness = min(1.0 / size, STIFFEST) if size > 0 else axis.transmission_stiffness
    return replace(axis, transmission_stiffness=stiffness)


def _backlash(axis: PlantParameters, size: float, _: np.random.Generator) -> PlantParameters:
    return replace(axis, gap=size, transmission_stiffness=axis.transmission_stiffness or CONTACT_STIFFNESS)


def _eccentricity(axis: PlantParameters, size: float, random: np.random.Generator) -> PlantParameters:
    return replace(axis, eccentricity=size, eccentricity_phase=float(random.uniform(0.0, 2.0 * math.pi)))


EFFECTS: dict[str, Effect] = {
    "torque_ripple": Effect(_torque_ripple, "N m", 0.02, 0.0, 0.3),
    "direction_asymmetry": Effect(_field("asymmetry"), "1", 0.1, -0.8, 0.8),
    "stribeck": Effect(_field("stribeck"), "N m", 0.06, 0.0, 0.3),
    "nonlinear_viscous": Effect(_field("lubricant"), "N m at 1 rad/s", 0.03, 0.0, 0.15),
    "position_dependent_friction": Effect(_tight_spot, "1", 0.3, -0.8, 2.0),
    "gravity_imbalance": Effect(_imbalance, "N m", 0.03, 0.0, 0.4),
    "spring": Effect(_field("spring"), "N m/rad", 0.01, 0.0, 0.04),
    "reversal_memory": Effect(_reversal_memory, "N m", 0.1, 0.0, 0.4),
    "thermal_drift": Effect(_field("thermal_softening"), "1/K", 0.03, 0.0, 0.2),
    "elastic_transmission": Effect(_elastic, "rad/(N m)", 0.01, 0.0, 0.05),
    "backlash": Effect(_backlash, "rad", 5e-3, 0.0, 0.05),
    "torque_lag": Effect(_field("lag"), "s", 5e-4, 0.0, 3e-3),
    "torque_saturation": Effect(_field("saturation"), "1", 0.25, 0.0, 0.33),
    "dwell_time_break_away": Effect(_field("dwell"), "N m", 0.08, 0.0, 0.3),
    "load_dependent_friction": Effect(_field("load_factor"), "1", 0.2, 0.0, 0.6),
    "encoder_eccentricity": Effect(_eccentricity, "rad", 1e-3, 0.0, 0.02),
}


def apply_effects(axis: PlantParameters, effects: Mapping[str, float], seed: int = 0) -> PlantParameters:
    """The axis with effects planted; `friction` scales the friction level first.

    Phases and places are drawn from `seed` and the effect's name, so that one effect does not depend
    on which others are there.

    Raises:
        ConfigurationError: an unknown effect, with the nearest right one, or a size out of range.
    """
    for name, size in effects.items():
        check_size(name, size)
    axis = scale_friction(axis, effects.get("friction", 1.0))
    for name, size in effects.items():
        if name != "friction":
            random = np.random.default_rng([seed, zlib.crc32(name.encode())])
            axis = EFFECTS[name].plant(axis, size, random)
    return axis


def check_size(name: str, size: float) -> None:
    """Raises ConfigurationError where there is no such effect or it cannot have that size."""
    if name == "friction":
        unit, low, high = "times the nominal friction", 0.0, 5.0
    elif name in EFFECTS:
        unit, low, high = EFFECTS[name].unit, EFFECTS[name].low, EFFECTS[name].high
    else:
        near = difflib.get_close_matches(name, [*EFFECTS, "friction"], 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(EFFECTS)} and friction"
        raise ConfigurationError(f"there is no effect {name!r} to plant; {hint}")
    if not (math.isfinite(size) and low <= size <= high):
        raise ConfigurationError(
            f"the size of effect {name!r} is {size}; allowed is {low} to {high} [{unit}]"
        )


def scale_friction(axis: PlantParameters, factor: float) -> PlantParameters:
    """The axis with all dry friction, its stiffness and its damping multiplied; 0 removes them."""
    if factor == 1.0:
        return axis
    if factor == 0.0:
        return replace(axis, elements=(), bristle=None, micro_damping=0.0)
    bristle = axis.bristle
    if bristle is not None:
        bristle = replace(
            bristle,
            coulomb=bristle.coulomb * factor,
            break_away=bristle.break_away * factor,
            stiffness=bristle.stiffness * factor,
            damping=bristle.damping * factor,
        )
    return replace(
        axis,
        elements=tuple(Element(e.displacement, e.torque * factor) for e in axis.elements),
        micro_damping=axis.micro_damping * factor,
        bristle=bristle,
    )
