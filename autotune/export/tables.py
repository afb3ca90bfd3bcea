"""What is left of a law that must fit into tables: torque over velocity, torque over position.

    T = J r̈ + K(ṙ) + P(r)

K is friction in steady sliding with viscous friction and offset, the elements of `reversal_memory` sliding;
P the ripple and imbalance. What a table cannot know is where the motion turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.control.model_feedforward import fed_forward, torque_along
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.export.request import Lost, Request
from autotune.models.drive_model import DriveModel

PLACES = ("torque_ripple", "gravity_imbalance", "spring", "position_dependent_friction")
"""Effects that depend on the place."""
POINTS_A_WAVE = 16
"""Of the shortest wave: linear interpolation between them is wrong by 2 % of its amplitude at most."""
MOST_POINTS = 16384
_WHOLE = 1e-6
_SLIDING = 40.0
USUAL_SPEED = {"rad": 100.0, "m": 1.0}


@dataclass(frozen=True, slots=True)
class PositionTable:
    """Torque over one repeat of all waves; shape (k,) each [motion unit, N m]. Begins at position 0."""

    position: Floats
    torque: Floats


def speed_of(request: Request) -> tuple[float, tuple[str, ...]]:
    """Up to which speed tables reach, with a note where nobody said."""
    if request.speed is not None:
        return request.speed, ()
    unit = request.model.motion_unit
    usual = USUAL_SPEED[unit]
    return usual, (f"no speed is known: the table reaches to {usual:g} {unit}/s; --speed says another",)


def sliding_torque(model: DriveModel, velocity: Floats) -> Floats:
    """K: torque in steady sliding at each velocity but 0, shape (n,) [N m or N]."""
    for effect in PLACES:
        model = model.without_effect(effect)
    model = fed_forward(model)
    travel = _SLIDING * presliding_travel(model)
    return np.array([_steady(model, float(v), travel / abs(float(v))) for v in velocity])


def presliding_travel(model: DriveModel) -> float:
    """Travel after which everything slides [motion unit]."""
    parameters = fed_forward(model).parameters
    elements = [v.value for name, v in parameters.items() if name.startswith("reversal_memory.displacement")]
    levels = (parameters[name].value for name in ("coulomb", "break_away") if name in parameters)
    return max(max(levels) / parameters["stiffness"].value, *elements, 1e-12)


def _steady(model: DriveModel, velocity: float, duration: float) -> float:
    steps = np.array([0.0, 1.0, 2.0]) * (duration * velocity)
    speed = np.full(3, velocity)
    return float(model.torque(steps, speed, np.zeros(3), duration)[-1])


def waves(model: DriveModel) -> list[tuple[str, float, float, float]]:
    """Effect, order, sine and cosine part of every wave of torque over position."""
    values = {name: value.value for name, value in model.parameters.items()}
    found = []
    for name, order in values.items():
        if name.startswith("torque_ripple.order_") and order > 0.0:
            number = name.removeprefix("torque_ripple.order_")
            parts = (values[f"torque_ripple.sin_{number}"], values[f"torque_ripple.cos_{number}"])
            found.append(("torque_ripple", order, *parts))
    if "gravity_imbalance" in model:
        order = values.get("gravity_imbalance.order", 1.0)
        found.append(
            ("gravity_imbalance", order, values["gravity_imbalance.sin"], values["gravity_imbalance.cos"])
        )
    return found


def repeating(model: DriveModel) -> tuple[float, list[tuple[str, float, float, float]], list[str]]:
    """Length of a repeat, the waves that fit into it, and the effects with waves that do not.

    A rotary axis repeats with its turn, a linear one with its longest wave.
    """
    every = waves(model)
    least = 1.0 if model.motion_unit == "rad" else min((wave[1] for wave in every), default=1.0)
    fits = [wave for wave in every if abs(wave[1] / least - round(wave[1] / least)) < _WHOLE]
    length = 2.0 * math.pi if model.motion_unit == "rad" else 1.0 / least
    return length, fits, sorted({wave[0] for wave in every if wave not in fits})


def position_table(model: DriveModel) -> PositionTable | None:
    """P as a table; None where no wave fits.

    Raises:
        ConfigurationError: the shortest wave needs more points than a table may have.
    """
    length, fits, _ = repeating(model)
    if not fits:
        return None
    scale = 1.0 if model.motion_unit == "rad" else 2.0 * math.pi
    cycles = max(wave[1] for wave in fits) * scale * length / (2.0 * math.pi)
    points = POINTS_A_WAVE * math.ceil(cycles - _WHOLE)
    if points > MOST_POINTS:
        unit = "rev" if model.motion_unit == "rad" else "m"
        raise ConfigurationError(
            f"the table over position overflows: a wave of {max(w[1] for w in fits):g} cycles/{unit} needs {points} "
            f"points, a table has {MOST_POINTS} at most; use --to c, or take the wave out of the model"
        )
    position = np.arange(points) * length / points
    torque = np.zeros(points)
    for _, order, sine, cosine in fits:
        angle = order * scale * position
        torque += sine * np.sin(angle) + cosine * np.cos(angle)
    return PositionTable(position, torque)


def lost_to_tables(request: Request, table: PositionTable | None) -> Lost:
    """What tables lose of the law along the request's motion: all that has a memory."""
    model = request.model
    q, v, a = request.motion.sampled(request.period)
    moving = np.abs(v) > 1e-3 * float(np.max(np.abs(v)))
    told = model["inertia"] * a
    grid = speeds(float(np.max(np.abs(v))), 64)
    told = told + np.interp(v, grid, sliding_torque(model, grid))
    if table is not None:
        told += np.interp(q, table.position, table.torque, period=_repeat(table))
    if "spring" in model:
        told += model["spring.stiffness"] * q
    whole = torque_along(model, q, v, a, request.period)
    third = len(q) // 3
    size = float(np.sqrt(np.mean((whole - told)[third:][moving[third:]] ** 2)))
    name = "reversal_memory" if "reversal_memory" in model else "presliding"
    return Lost(name, "a table does not know where the motion turned; its friction counts as sliding", size)


def _repeat(table: PositionTable) -> float:
    return float(table.position[-1] + (table.position[1] - table.position[0]))


def speeds(most: float, points: int) -> Floats:
    """Velocities of both signs, denser at low speed, without 0; shape (2·points,)."""
    half = np.geomspace(1e-3 * most, most, points)
    return np.concatenate([-half[::-1], half])
