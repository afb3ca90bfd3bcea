"""What is true of a simulated axis, in the words of the library: coefficients, and the model that is right.

The simulator's laws are its own; where they are the library's in other words (a sine with a phase, watts
instead of kelvin), this is the translation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import effect_kind
from autotune_sim.plant import LUBRICANT_SPEED, PlantParameters

Values = dict[str, float]
COUPLING_DAMPING = 0.05  # of critical, as the simulator has it
HEADLINE: Mapping[str, tuple[str, ...]] = {
    "torque_ripple": ("sin_1", "cos_1"),
    "direction_asymmetry": ("coulomb",),
    "stribeck": ("break_away",),
    "nonlinear_viscous": ("torque",),
    "position_dependent_friction": ("height",),
    "gravity_imbalance": ("sin", "cos"),
    "spring": ("stiffness",),
    "reversal_memory": (),
    "thermal_drift": ("softening",),
    "elastic_transmission": ("compliance",),
    "backlash": ("gap",),
    "torque_lag": ("time_constant",),
    "torque_saturation": ("loss",),
    "dwell_time_break_away": ("rise",),
    "load_dependent_friction": ("factor",),
    "encoder_eccentricity": ("sin", "cos"),
}
"""What is compared of each effect: the length of the vector of these parameters."""


def _turned(amplitude: float, phase: float) -> Values:
    return {"sin": amplitude * math.cos(phase), "cos": amplitude * math.sin(phase)}


def _ripple(plant: PlantParameters) -> Values:
    values: Values = {}
    for number, wave in enumerate(plant.ripple, 1):
        turned = _turned(wave.amplitude, wave.phase)
        values |= {
            f"order_{number}": wave.order,
            f"sin_{number}": turned["sin"],
            f"cos_{number}": turned["cos"],
        }
    return values


def _memory(plant: PlantParameters) -> Values:
    values: Values = {}
    for number, element in enumerate(plant.elements, 1):
        values |= {f"displacement_{number}": element.displacement, f"torque_{number}": element.torque}
    return values


def _load_side(plant: PlantParameters) -> Values:
    return {
        "load_inertia": plant.load_inertia,
        "load_friction": plant.load_friction,
        "damping": COUPLING_DAMPING,
    }


_TRUTH: Mapping[str, Callable[[PlantParameters], Values]] = {
    "torque_ripple": _ripple,
    "direction_asymmetry": lambda p: {"coulomb": p.asymmetry * p.friction, "viscous": 0.0},
    "stribeck": lambda p: {
        "break_away": p.friction + p.stribeck,
        "stribeck_velocity": p.stribeck_velocity,
        "stribeck_exponent": 2.0,
    },
    "nonlinear_viscous": lambda p: {"torque": p.lubricant, "exponent": 2 / 3, "knee": LUBRICANT_SPEED},
    "position_dependent_friction": lambda p: {
        "height": p.bump,
        "centre": p.bump_centre,
        "width": p.bump_width,
    },
    "gravity_imbalance": lambda p: _turned(p.imbalance, p.imbalance_phase),
    "spring": lambda p: {"stiffness": p.spring},
    "reversal_memory": _memory,
    "thermal_drift": lambda p: {
        "softening": p.thermal_softening * p.thermal_resistance,
        "time_constant": p.thermal_time,
        "idle": 0.0,
    },
    "elastic_transmission": lambda p: {"compliance": 1.0 / p.transmission_stiffness, **_load_side(p)},
    "backlash": lambda p: {
        "gap": p.gap,
        "contact_compliance": 1.0 / p.transmission_stiffness,
        **_load_side(p),
    },
    "torque_lag": lambda p: {"time_constant": p.lag},
    "torque_saturation": lambda p: {"loss": p.saturation, "torque": p.torque_limit},
    "dwell_time_break_away": lambda p: {
        "rise": p.dwell,
        "time_constant": p.dwell_time,
        "slip": p.dwell_slip,
    },
    "load_dependent_friction": lambda p: {"factor": p.load_factor, "friction_share": 0.0},
    "encoder_eccentricity": lambda p: _turned(p.eccentricity, p.eccentricity_phase),
}


def true_model(plant: PlantParameters, effects: tuple[str, ...]) -> DriveModel:
    """The model that is right for a plant with one bristle and these effects."""
    bristle = plant.bristle
    if bristle is None:
        raise ValueError("only a plant with one bristle has a true model")
    model = base_model(
        {
            "inertia": plant.inertia,
            "viscous": plant.viscous,
            "coulomb": bristle.coulomb,
            "stiffness": bristle.stiffness,
            "micro_damping": bristle.damping,
            "offset": plant.offset,
        }
    )
    for effect in effects:
        model = model.with_effect(effect_kind(effect).make(_TRUTH[effect](plant)))
    return model


def coefficient_error(found: DriveModel, truth: DriveModel, effect: str) -> float:
    """Relative error of an effect's size; nan where it has no single number or was not found.

    Of break-away friction only what is above Coulomb friction counts.
    """
    names = HEADLINE[effect]
    if not names or effect not in [one.kind.name for one in found.effects]:
        return math.nan
    kind = effect_kind(effect)
    sizes = [math.hypot(*(model[kind.surface(name)] for name in names)) for model in (found, truth)]
    if effect == "stribeck":
        sizes = [size - model["coulomb"] for size, model in zip(sizes, (found, truth), strict=True)]
    return sizes[0] / sizes[1] - 1.0
