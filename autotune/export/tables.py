"""What is left of a law that must fit into tables: torque over velocity, torque over position.

    T = J r̈ + K(ṙ) + P(r)

K is friction in steady sliding with viscous friction and offset; P what depends on the place alone. What a table
cannot know is where the motion turned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from autotune.control.model_feedforward import fed_forward, torque_along
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.export.request import Lost, Request, cost
from autotune.export.self_test import presliding_travel
from autotune.models.contact import additive
from autotune.models.drive_model import DriveModel
from autotune.models.effect import Effect

MOST_POINTS = 16384
FAITHFUL = 0.02
"""Of the table's amplitude, by which linear interpolation may be wrong."""
USUAL_SPEED = {"rad": 100.0, "m": 1.0}
USUAL_TRAVEL = 1.0
"""m, of a linear axis whose travel nobody has said."""
_FEWEST = 64
_SLIDING = 40.0


@dataclass(frozen=True, slots=True)
class PositionTable:
    """Torque over position, linear in between; shape (k,) each [motion unit, N m]."""

    position: Floats
    torque: Floats


def speed_of(request: Request) -> tuple[float, tuple[str, ...]]:
    """Up to which speed tables reach, with a note where nobody said."""
    if request.speed is not None:
        return request.speed, ()
    unit = request.model.motion_unit
    usual = USUAL_SPEED[unit]
    return usual, (f"no speed is known: the table reaches to {usual:g} {unit}/s; --speed says another",)


def of_place(effect: Effect) -> bool:
    """Whether an effect of the contact depends on the place."""
    kernels = effect.kind.kernels
    return kernels.torque is not None or kernels.level_factor is not None


def sliding_torque(model: DriveModel, velocity: Floats) -> Floats:
    """K: torque in steady sliding at each velocity but 0, shape (n,) [N m or N]."""
    model = fed_forward(model)
    model = without(model, of_place)
    travel = _SLIDING * presliding_travel(model)
    return np.array([_steady(model, float(v), travel / abs(float(v))) for v in velocity])


def without(model: DriveModel, unwanted: Callable[[Effect], bool]) -> DriveModel:
    """The model without effects of a kind."""
    for effect in model.effects:
        if unwanted(effect):
            model = model.without_effect(effect.name)
    return model


def _steady(model: DriveModel, velocity: float, duration: float) -> float:
    steps = np.array([0.0, 1.0, 2.0]) * (duration * velocity)
    speed = np.full(3, velocity)
    return float(model.torque(steps, speed, np.zeros(3), duration)[-1])


def place_torque(model: DriveModel, position: Floats) -> Floats:
    """P: torque that depends on the place alone, the offset left out; shape (n,) [N m or N]."""
    packed = fed_forward(model).pack()
    offset = model["offset"]
    return np.array([additive(packed.p, packed.on, float(q)) - offset for q in position])


def position_table(request: Request) -> tuple[PositionTable | None, tuple[Lost, ...]]:
    """P as a table, and what of it has no place there.

    A rotary axis repeats with its turn, and holds what repeats with it; a linear one has its travel.

    Raises:
        ConfigurationError: it needs more points than a table may have.
    """
    model = fed_forward(request.model)
    rotary = model.motion_unit == "rad"
    low, high = (0.0, 2.0 * math.pi) if rotary else request.travel or (0.0, USUAL_TRAVEL)
    odd = [
        e for e in model.effects if e.kind.kernels.torque is not None and rotary and not _repeats(model, e)
    ]
    lost = [
        Lost(e.name, "not all of it repeats with the turn, as the table does", cost(request, e)) for e in odd
    ]
    for effect in model.effects:
        if effect.kind.kernels.level_factor is not None:
            why = "its torque changes sign with the direction, which a table over position does not know"
            lost.append(Lost(effect.name, why, cost(request, effect)))
    model = without(model, lambda effect: effect.name in {one.name for one in odd})
    if not any(effect.kind.kernels.torque is not None for effect in model.effects):
        return None, tuple(lost)
    return _fine_enough(model, low, high), tuple(lost)


def _repeats(model: DriveModel, effect: Effect) -> bool:
    alone = without(model, lambda other: other.name != effect.name)
    place = np.linspace(0.0, 2.0 * math.pi, 1001)
    here, later = place_torque(alone, place), place_torque(alone, place + 2.0 * math.pi)
    return bool(np.max(np.abs(here - later)) <= 1e-6 * max(float(np.max(np.abs(here))), 1e-12))


def _fine_enough(model: DriveModel, low: float, high: float) -> PositionTable:
    points = _FEWEST
    while points <= MOST_POINTS:
        position = np.linspace(low, high, points + 1)
        torque = place_torque(model, position)
        between = [0.5 * (position[1:] + position[:-1]), 0.7 * position[1:] + 0.3 * position[:-1]]
        error = max(np.max(np.abs(np.interp(q, position, torque) - place_torque(model, q))) for q in between)
        if error <= FAITHFUL * max(float(np.ptp(torque)) / 2.0, 1e-12):
            return PositionTable(position, torque)
        points *= 2
    raise ConfigurationError(
        f"the table over position overflows: with {MOST_POINTS} points from {low:g} to {high:g} {model.motion_unit} it "
        f"is still wrong by {100 * error / max(float(np.ptp(torque)) / 2.0, 1e-12):.0f} % between them; use --to c, "
        "or take the shortest waves out of the model"
    )


def lost_to_tables(request: Request, table: PositionTable | None) -> Lost:
    """What tables lose of the law along the request's motion: all that has a memory."""
    model = request.model
    kept = without(model, lambda effect: of_place(effect)) if table is None else model
    q, v, a = request.motion.sampled(request.period)
    moving = np.abs(v) > 1e-3 * float(np.max(np.abs(v)))
    grid = speeds(float(np.max(np.abs(v))), 64)
    told = kept["inertia"] * a + np.interp(v, grid, sliding_torque(kept, grid))
    if table is not None:
        told = told + place_torque(kept, q)
    whole = torque_along(without(kept, _only_level), q, v, a, request.period)
    third = len(q) // 3
    size = float(np.sqrt(np.mean((whole - told)[third:][moving[third:]] ** 2)))
    return Lost(
        "presliding", "a table does not know where the motion turned; friction counts as sliding", size
    )


def _only_level(effect: Effect) -> bool:
    return effect.kind.kernels.level_factor is not None


def speeds(most: float, points: int) -> Floats:
    """Velocities of both signs, denser at low speed, without 0; shape (2·points,)."""
    half = np.geomspace(1e-3 * most, most, points)
    return np.concatenate([-half[::-1], half])
