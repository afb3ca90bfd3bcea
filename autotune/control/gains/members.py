"""The axes that a model stands for: its nominal one, and others at the ends of its parameters' intervals.

One group of parameters at a time is moved to either end: two standard errors, `LEAST` at least, `ASSUMED` where
the model has no standard error (Table 6.2 of the thesis: what was identified again differed by 3 to 40 %).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from autotune.control.gains.loop import LoopTiming
from autotune.control.gains.regimes import COMPLIANT, steepness_of
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.torque_lag import TORQUE_LAG
from autotune.models.total_friction import (
    ELEMENTS_DAMPING,
    damping_at_rest,
    stiffness_at_rest,
    stiffness_spread,
    total_friction,
)

ERRORS = 2.0
"""Standard errors to either side: 95 %."""
LEAST = 0.05
"""Relative, of an interval: friction and inertia of one machine differ by as much from day to day."""
TODAY = 0.01
"""The same for what is expected of the axis as it was identified, on the day of its run."""
ASSUMED = 0.2
"""Relative, where the model has no standard error: the reproducibility of Table 6.2."""
AS_A_WHOLE = 0.75
"""Steepness of a lag whose four stages are alike: nearly a delay."""
NOMINAL = "nominal"
MOST = 0.6
"""Relative: a parameter that nothing was said about may not turn its sign."""


@dataclass(frozen=True, slots=True)
class Member:
    """One axis of the family; `what` says which end of which interval it is."""

    what: str
    model: DriveModel
    timing: LoopTiming


@dataclass(frozen=True, slots=True)
class Family:
    """All members, the nominal one first; `assumed` names the parameters whose interval was assumed."""

    members: tuple[Member, ...]
    assumed: tuple[str, ...]

    @property
    def nominal(self) -> Member:
        return self.members[0]


_GROUPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("inertia", ("inertia",)),
    ("friction", ("coulomb", "break_away", REVERSAL_MEMORY.surface("torque_"))),
    ("stiffness", ("stiffness", REVERSAL_MEMORY.surface("displacement_"))),
    ("damping", ("micro_damping", "viscous", ELEMENTS_DAMPING)),
    ("torque lag", (TORQUE_LAG.surface("time_constant"),)),
    ("compliance", tuple(kind.surface(name) for kind, name in COMPLIANT)),
)


def _friction(model: DriveModel) -> tuple[float, float | None]:
    total = total_friction(model)
    return total.value, total.standard_error


def _stiffness(model: DriveModel) -> tuple[float, float | None]:
    return stiffness_at_rest(model), stiffness_spread(model)


def _damping(model: DriveModel) -> tuple[float, float | None]:
    viscous = model.base["viscous"]
    errors = [model.damping_error, viscous.standard_error or 0.0]
    known = [error for error in errors if error is not None]
    return damping_at_rest(model) + viscous.value, math.hypot(*known) if len(known) == len(errors) else None


SUMS = {"friction": _friction, "stiffness": _stiffness, "damping": _damping}
"""Groups that are a sum where friction is of several elements: the sum and its standard error."""


def family(model: DriveModel, timing: LoopTiming) -> Family:
    """The nominal axis and both ends of each group.

    Raises:
        ConfigurationError: the model is of an axis without inertia to speak of, or not in SI torque.
    """
    if model.torque_unit:
        raise ConfigurationError(
            f"the model's torque is in {model.torque_unit}; gains are judged in N m or N. Import the recordings with "
            "the torque constant and fit the model again"
        )
    members = [Member(NOMINAL, model, timing)]
    assumed: list[str] = []
    for name, keys in _GROUPS:
        present = [one for one in model.parameters if _in_group(one, keys) and model[one] > 0.0]
        if not present:
            continue
        part, known = _spread(model, name, present)
        assumed += [] if known else [name]
        for sign, end in ((-1.0, "low"), (1.0, "high")):
            factor = 1.0 + sign * part
            members.append(Member(f"{name} {end}", _scaled(model, present, factor), timing))
    ends = (*_late(model, timing), *_late_as_a_whole(model, timing), *_damped(model, timing))
    return Family((*members, *ends), tuple(assumed))


def drawn(model: DriveModel, timing: LoopTiming, count: int, seed: int) -> tuple[Member, ...]:
    """Axes as likely as the standard errors say, shape (count,): each group of parameters and the dead time by itself.

    For what is expected of the axis, where `family` is for what may happen at worst.
    """
    random = np.random.default_rng([seed, count])
    groups = [
        [one for one in model.parameters if _in_group(one, keys) and model[one] > 0.0] for _, keys in _GROUPS
    ]
    names = [name for name, _ in _GROUPS]
    parts = [
        _spread(model, name, present, TODAY)[0] / ERRORS if present else 0.0
        for name, present in zip(names, groups, strict=True)
    ]
    found = []
    for number in range(count):
        factors = 1.0 + np.array(parts) * np.clip(random.normal(size=len(parts)), -ERRORS, ERRORS)
        own = model
        for present, factor in zip(groups, factors, strict=True):
            own = _scaled(own, present, float(factor)) if present else own
        late = max(timing.dead_time + timing.dead_time_error * random.normal(), 0.0)
        found.append(Member(f"drawn {number}", own, replace(timing, dead_time=late)))
    return tuple(found)


def _in_group(name: str, keys: Iterable[str]) -> bool:
    return any(name.startswith(key) if key.endswith("_") else name == key for key in keys)


def _spread(model: DriveModel, group: str, names: list[str], least: float = LEAST) -> tuple[float, bool]:
    """Relative half width of a group's interval, `least` at least, and whether it rests on standard errors.

    Parts of friction and of the stiffness at rest trade with each other; what counts is how well the sum is known.
    """
    table = model.parameters
    if REVERSAL_MEMORY.name in model and group in SUMS and (group != "damping" or ELEMENTS_DAMPING in names):
        total, error = SUMS[group](model)
        errors = [error]
    else:
        total = sum(table[name].value for name in names)
        errors = [table[name].standard_error for name in names]
    known = [error for error in errors if error is not None and math.isfinite(error)]
    if not known or (len(known) < len(names) and len(names) == 1):
        return ASSUMED, False
    return min(max(ERRORS * math.hypot(*known) / total, least), MOST), True


def _scaled(model: DriveModel, names: list[str], factor: float) -> DriveModel:
    """A group scaled; travel of memory elements falls as their stiffness rises."""
    errors = {name: model.parameters[name].standard_error for name in names}
    changed = {
        name: model[name] / factor if "displacement" in name else model[name] * factor for name in names
    }
    return model.with_values(changed, errors)


def _late(model: DriveModel, timing: LoopTiming) -> list[Member]:
    """A later loop, where its dead time is uncertain; beside a resonance, whose phase it turns, an earlier one too."""
    if timing.dead_time_error <= 0.0:
        return []
    ends = {"high": timing.dead_time + ERRORS * timing.dead_time_error}
    if any(kind.name in model for kind, _ in COMPLIANT):
        ends["low"] = max(timing.dead_time - ERRORS * timing.dead_time_error, 0.0)
    return [Member(f"dead time {end}", model, replace(timing, dead_time=late)) for end, late in ends.items()]


def _late_as_a_whole(model: DriveModel, timing: LoopTiming) -> list[Member]:
    """A lag that is a dead time: motion at the frequencies of a run does not tell; beyond the crossover it counts."""
    if TORQUE_LAG.name not in model or steepness_of(model) >= AS_A_WHOLE:
        return []
    held = model[TORQUE_LAG.surface("time_constant")]
    whole = TORQUE_LAG.make({"time_constant": held, "steepness": AS_A_WHOLE})
    return [Member("torque lag as dead time", model.with_effect(whole), timing)]


def _damped(model: DriveModel, timing: LoopTiming) -> list[Member]:
    """Other forms of presliding's damping, where friction has several elements: more in the bristle, more in them.

    Where the model does not say which part is the elements', all of it in the bristle.
    """
    if REVERSAL_MEMORY.name not in model:
        return []
    own = model.parameters.get(ELEMENTS_DAMPING)
    if own is None:
        return [Member("damping in the bristle alone", model, replace(timing, shared_damping=False))]
    whole = damping_at_rest(model)
    reach = ERRORS * own.standard_error if own.standard_error is not None else whole
    ends = {
        "damping more in the bristle": max(own.value - reach, 0.0),
        "damping more in the elements": min(own.value + reach, whole),
    }
    return [
        Member(what, model.with_values({ELEMENTS_DAMPING: part, "micro_damping": whole - part}), timing)
        for what, part in ends.items()
        if abs(part - own.value) > LEAST * whole
    ]
