"""Axes that can be simulated, by name.

`edm-vertical` is the vertical axis of an electro-discharge machine (thesis, Tables 6.2 and 6.3);
`lugre` is the same axis with a single LuGre bristle, for identification with known truth;
`frictionless` has no friction but the viscous one.

What the tables leave open was chosen so that the figures of section 6.3.6 come out (a test holds them):
ripple of two orders with 0.01 N m each, their phases, and the derivative without a filter, as in the
thesis's Appendix B.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from autotune.core.errors import ConfigurationError
from autotune_sim.composition import MachineFile, plant_of, read_machine
from autotune_sim.effects import apply_effects, scale_friction
from autotune_sim.plant import Bristle, Element, PlantParameters, Wave

PERIOD = 1e-3  # s, of the drive's cycle where nobody says another
SPREAD = 0.2  # relative, of the parameters that a seed varies


@dataclass(frozen=True, slots=True)
class Gains:
    """Factory settings of the position controller."""

    kp: float = 60.0
    kd: float = 0.15
    ki: float = 6000.0
    derivative_filter: float = 1.0


@dataclass(frozen=True, slots=True)
class Preset:
    """A simulated axis: mechanics and the drive's factory settings.

    Attributes:
        seed: of the variation of the plant; the noise has a seed of its own (`Servo`).
        effects: what was planted, name → size.
        commutation_offset: where the zero of the commutation encoder is, seen from position 0 [turns].
        dead_time: by which the torque comes later than it is demanded, in whole cycles, beside the plant's own lag [s].
    """

    name: str
    plant: PlantParameters
    gains: Gains = Gains()
    period: float = PERIOD
    seed: int = 0
    effects: tuple[tuple[str, float], ...] = ()
    commutation_offset: float = 0.0
    dead_time: float = 0.0


_BREAKS = (0.8e-3, 2e-3, 6e-3, 15e-3, 40e-3, 80e-3)
_SHARES = (0.14, 0.20, 0.25, 0.20, 0.13, 0.08)
_LEVEL = 0.33
_RIPPLE = (Wave(72.0, 0.01, 1.63), Wave(144.0, 0.01, 1.54))  # commutator bars and their harmonic


def _edm_vertical() -> PlantParameters:
    elements = tuple(Element(d, share * _LEVEL) for d, share in zip(_BREAKS, _SHARES, strict=True))
    return PlantParameters(
        inertia=6.66e-4,
        viscous=4.13e-3,
        offset=0.048,
        micro_damping=0.112,
        elements=elements,
        ripple=_RIPPLE,
    )


def _lugre() -> PlantParameters:
    bristle = Bristle(coulomb=0.30, break_away=0.36, velocity=0.3, stiffness=100.0, damping=0.05)
    return PlantParameters(inertia=6.66e-4, viscous=4.13e-3, offset=0.048, bristle=bristle)


def _frictionless() -> PlantParameters:
    return scale_friction(_edm_vertical(), 0.0)


PRESETS: dict[str, Callable[[], PlantParameters]] = {
    "edm-vertical": _edm_vertical,
    "lugre": _lugre,
    "frictionless": _frictionless,
}


def preset(name: str, seed: int | None = 0, effects: Mapping[str, float] | None = None) -> Preset:
    """The axis `name`, varied by `seed` (0 or None: nominal), with planted effects (name → size).

    Besides the effects of `effects.EFFECTS`, the name `friction` scales the friction level. A name that ends with
    `.toml` is the file of a composed machine (`composition`).

    Raises:
        ConfigurationError: an unknown name, with the nearest right one, or a size out of range.
    """
    if name.endswith(".toml"):
        return _composed(Path(name), seed or 0, effects or {})
    if name not in PRESETS:
        near = difflib.get_close_matches(name, PRESETS, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(PRESETS)}"
        raise ConfigurationError(f"there is no simulated axis {name!r}; {hint}")
    seed = seed or 0
    if seed < 0:
        raise ConfigurationError(f"the seed of simulated axis {name!r} is {seed}; it must be 0 or above")
    plant = PRESETS[name]()
    if seed:
        plant = vary(plant, np.random.default_rng([seed, 1]))
    planted = dict(effects or {})
    plant = apply_effects(plant, planted, seed)
    offset = float(np.random.default_rng([seed, 3]).uniform())
    return Preset(name, plant, seed=seed, effects=tuple(planted.items()), commutation_offset=offset)


MOST_LATE = 4
"""Cycles by which a torque may come late."""
NEARLY = 1e-6


def with_dead_time(axis: Preset, dead_time: float) -> Preset:
    """The axis behind a drive whose torque comes so much later [s].

    Raises:
        ConfigurationError: not a few whole cycles.
    """
    late = dead_time / axis.period
    if not 0.0 <= late <= MOST_LATE + NEARLY or abs(late - round(late)) > NEARLY:
        raise ConfigurationError(
            f"dead time is {dead_time:g} s; the simulated drive can have 0 to {MOST_LATE} whole cycles of "
            f"{axis.period:g} s"
        )
    return replace(axis, dead_time=dead_time)


def vary(plant: PlantParameters, random: np.random.Generator, spread: float = SPREAD) -> PlantParameters:
    """Inertia, viscous friction, friction level, break-away displacement, offset and ripple by ±spread each."""
    inertia, viscous, level, reach, offset, ripple = random.uniform(1 - spread, 1 + spread, 6)
    plant = scale_friction(plant, level)
    bristle = plant.bristle
    if bristle is not None:
        bristle = replace(bristle, stiffness=bristle.stiffness / reach)
    return replace(
        plant,
        inertia=plant.inertia * inertia,
        viscous=plant.viscous * viscous,
        offset=plant.offset * offset,
        elements=tuple(Element(e.displacement * reach, e.torque) for e in plant.elements),
        bristle=bristle,
        ripple=tuple(replace(wave, amplitude=wave.amplitude * ripple) for wave in plant.ripple),
    )


_REFERENCE = _edm_vertical().inertia


def _composed(path: Path, seed: int, effects: Mapping[str, float]) -> Preset:
    """Gains as the file says, else the factory's in proportion to the inertia that the motor feels."""
    if effects:
        raise ConfigurationError(
            f"machine {path}: {', '.join(effects)} cannot be planted in a composed machine; draw it into the file"
        )
    file = read_machine(path)
    plant = plant_of(file, PERIOD)
    return Preset(file.name, plant, _gains(file, plant.inertia), seed=seed)


def _gains(file: MachineFile, inertia: float) -> Gains:
    if file.controller is not None:
        return Gains(**file.controller.model_dump())
    factor, factory = inertia / _REFERENCE, Gains()
    return Gains(factor * factory.kp, factor * factory.kd, factor * factory.ki)
