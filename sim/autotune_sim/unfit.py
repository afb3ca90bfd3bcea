"""Axes that must not be tuned: each is sound by itself, but no parameters would be better on it for good.

| name | what is drawn | why nothing may be kept |
|---|---|---|
| no-excitation | friction of 1.05 to 1.5 times the motor's torque | the axis hardly moves: nothing can be told apart |
| limit-cycle | integral gain of 6 to 15 times the nominal | the loop hunts by itself |
| resonance | a load on a spring that resonates at the loop's bandwidth | better tracking costs damping |
| wide-backlash | a gap of 1.2 to 2.5 times the benchmark's amplitude | the load does not follow the motor |
| changing-load | torque from outside that swings with 15 to 40 % of the motor's | the next move meets another axis |
| leaning | somebody on the table with 15 to 40 % of the motor's torque | what was measured was not the axis |

`unfit=NAME` draws from the seed, `unfit=NAME:SIZE` (0 mild to 1 strong) places it in the range.
"""

from __future__ import annotations

import difflib
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.errors import ConfigurationError
from autotune_sim.effects import CONTACT_STIFFNESS, scale_friction
from autotune_sim.presets import Preset

Order = tuple[str, str, float]
"""A fault to plan: name, value, time [s]."""
Change = Callable[[Preset, float], tuple[Preset, tuple[Order, ...]]]
BENCHMARK = 0.2  # rad, amplitude that a gap is measured against


def unfit_axis(axis: Preset, name: str, size: float | None = None) -> tuple[Preset, tuple[Order, ...]]:
    """The axis made unfit, and what has to happen on it while it runs.

    Raises:
        ConfigurationError: an unknown name, or a size outside 0 to 1.
    """
    if name not in UNFIT:
        near = difflib.get_close_matches(name, UNFIT, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(UNFIT)}"
        raise ConfigurationError(f"there is no unfit axis {name!r}; {hint}")
    if size is None:
        random = np.random.default_rng([axis.seed, zlib.crc32(name.encode())])
        size = float(random.uniform(0.0, 1.0))
    if not 0.0 <= size <= 1.0:
        raise ConfigurationError(f"unfit axis {name!r} has size {size}; allowed is 0 to 1")
    low, high = UNFIT[name].low, UNFIT[name].high
    return UNFIT[name].change(axis, low + size * (high - low))


def _stuck(axis: Preset, factor: float) -> tuple[Preset, tuple[Order, ...]]:
    plant = axis.plant
    level = factor * plant.torque_limit / plant.friction if plant.friction > 0 else 1.0
    return replace(axis, plant=scale_friction(plant, level)), ()


def _hunting(axis: Preset, factor: float) -> tuple[Preset, tuple[Order, ...]]:
    return replace(axis, gains=replace(axis.gains, ki=factor * axis.gains.ki)), ()


def _resonant(axis: Preset, factor: float) -> tuple[Preset, tuple[Order, ...]]:
    """Both masses swing against each other at `factor` times the loop's crossover, about √(kp/J)."""
    plant, share = axis.plant, 0.4
    crossover = math.sqrt(axis.gains.kp / plant.inertia)
    reduced = plant.inertia * share * (1.0 - share)
    stiffness = reduced * (factor * crossover) ** 2
    return replace(axis, plant=replace(plant, transmission_stiffness=stiffness, load_inertia=share)), ()


def _loose(axis: Preset, factor: float) -> tuple[Preset, tuple[Order, ...]]:
    gap = factor * BENCHMARK
    plant = replace(axis.plant, gap=gap, transmission_stiffness=CONTACT_STIFFNESS)
    return replace(axis, plant=plant), ()


def _ordered(name: str) -> Change:
    def change(axis: Preset, share: float) -> tuple[Preset, tuple[Order, ...]]:
        return axis, ((name, f"{share:.4f}", 0.0),)

    return change


@dataclass(frozen=True, slots=True)
class Unfit:
    """One kind: what it changes, between a mild and a strong size."""

    change: Change
    low: float
    high: float


UNFIT: dict[str, Unfit] = {
    "no-excitation": Unfit(_stuck, 1.05, 1.5),
    "limit-cycle": Unfit(_hunting, 6.0, 15.0),
    "resonance": Unfit(_resonant, 0.7, 1.4),
    "wide-backlash": Unfit(_loose, 1.2, 2.5),
    "changing-load": Unfit(_ordered("load-wave"), 0.15, 0.4),
    "leaning": Unfit(_ordered("leaning"), 0.15, 0.4),
}
