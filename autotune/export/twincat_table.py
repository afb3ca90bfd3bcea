"""The friction table of Beckhoff's TwinCAT CNC: velocity to motor current, one for both directions.

Keys, units and bounds as in the manual "TF5200 friction compensation" (P-COMP-00041 to -00047, -00058, -00062;
infosys.beckhoff.com, tf5200_axis_compensation): `in` in µm/s or 0.001 °/s from 0 upwards, `out` in the drive's own
unit of torque (on CANopen that of 6077h: per mille of 6076h), at most 20 entries, `scaling_factor` in 0.1 %.
Whole numbers, which builds before V3.1.3132 ask for: `out` is written tenfold and scaled by 10 %.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from autotune.control.model_feedforward import fed_forward
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.export.request import Exported, Lost, Request, cost, lost_everywhere
from autotune.export.self_test import presliding_travel
from autotune.export.tables import lost_to_tables, of_place, sliding_torque, speed_of
from autotune.export.text import about, ascii_only, headline
from autotune.models.drive_model import DriveModel
from autotune.models.effect import Effect

ENTRIES = 20
_LARGEST = 2**31 - 1
_LARGEST_PERMILLE = 32767
_TENFOLD, _SCALING = 10.0, 100
_MOST_DELAY = 10
_KEPT = "sliding friction over velocity, the mean of both directions"


def export_twincat_table(request: Request) -> Exported:
    """`autotune_ff.frict_comp`.

    Raises:
        ConfigurationError: no rated torque is known, nothing to compensate, or numbers that the table cannot hold.
    """
    if request.rated_torque is None:
        raise ConfigurationError(
            "the table is in per mille of the drive's rated torque; give it with --rated-torque (object 6076h)"
        )
    most, notes = speed_of(request)
    speed = np.geomspace(1e-3 * most, most, ENTRIES - 1)
    friction = _both_directions(request.model, speed)
    if not np.any(np.round(_TENFOLD * 1e3 * friction / request.rated_torque)):
        raise ConfigurationError(
            "the model has no friction that shows in per mille of the rated torque: nothing of it fits into the table"
        )
    lost = _lost(request)
    lines = [*_comment(request, lost), *_list(request, speed, friction)]
    text = ascii_only("\n".join(lines) + "\n")
    return Exported({f"{request.name}.frict_comp": text.encode("ascii")}, lost, notes)


def _both_directions(model: DriveModel, speed: Floats) -> Floats:
    """Mean of the two directions: without offset and asymmetry, shape (n,) [N m or N]."""
    return np.asarray(0.5 * (sliding_torque(model, speed) - sliding_torque(model, -speed)))


def _one_sided(model: DriveModel, effect: Effect) -> bool:
    """Whether an effect makes the two directions differ."""
    speed = np.array([1e-2, 1.0, 1e2])
    lone = model.without_effect(effect.name)
    apart = [sliding_torque(m, speed) + sliding_torque(m, -speed) for m in (model, lone)]
    return bool(np.max(np.abs(apart[0] - apart[1])) > 1e-9 * max(model["coulomb"], 1e-9))


def _lost(request: Request) -> tuple[Lost, ...]:
    model = fed_forward(request.model)
    lost = [*lost_everywhere(request), lost_to_tables(request, None)]
    for effect in model.effects:
        if of_place(effect):
            lost.append(Lost(effect.name, "the table is over velocity", cost(request, effect)))
        elif _one_sided(model, effect):
            lost.append(Lost(effect.name, "the table is one for both directions", cost(request, effect)))
    if model["offset"] != 0.0:
        lost.append(Lost("offset", "the table has the direction's sign", abs(model["offset"])))
    lost.append(Lost("inertia", "the CNC has a feedforward of its own for it", _inertial(request)))
    return tuple(lost)


def _inertial(request: Request) -> float:
    _, _, acceleration = request.motion.sampled(request.period)
    return float(request.model["inertia"] * np.sqrt(np.mean(acceleration**2)))


def _units(request: Request) -> tuple[str, float]:
    """Unit of velocity in the list, and how many of it a unit of the motor's velocity is."""
    if request.model.motion_unit == "m":
        return "µm/s", 1e6
    if request.lead is not None:
        return "µm/s", 1e3 * request.lead / (2.0 * math.pi)
    return "0.001 °/s", 1e3 * 180.0 / math.pi


def _comment(request: Request, lost: tuple[Lost, ...]) -> list[str]:
    unit, _ = _units(request)
    permille = f"out: {_TENFOLD:g} times per mille of {request.rated_torque:g} {request.model.torque_symbol}"
    told = about(request, lost, "# ", (f"in: {unit}. {permille}, brought back by scaling_factor.",), _KEPT)
    return [f"# {headline(request)}", *told.splitlines()]


def _list(request: Request, speed: Floats, friction: Floats) -> Iterator[str]:
    unit, scale = _units(request)
    rated = request.rated_torque or 1.0
    inward = [0, *(_whole(scale * v, f"velocity [{unit}]", _LARGEST) for v in speed)]
    permille = [0.0, *(1e3 * torque / rated for torque in friction)]
    most = max(abs(value) for value in permille)
    if most > _LARGEST_PERMILLE:
        raise ConfigurationError(
            f"the table overflows: friction is {most:.0f} per mille of the rated torque {rated:g}, a drive takes "
            f"{_LARGEST_PERMILLE} at most; check --rated-torque"
        )
    outward = [_whole(_TENFOLD * value, "torque [per mille]", _LARGEST) for value in permille]
    if any(later <= earlier for earlier, later in pairwise(inward)):
        raise ConfigurationError(
            f"the table's velocities are not distinct in whole {unit}: its top speed {speed[-1]:g} is too low; "
            "check --speed and --lead"
        )
    delay = round(10.0 * scale * presliding_travel(request.model))  # in tenths of a unit of travel
    yield "frict_comp.mode               3"
    yield f"frict_comp.table_entries      {len(inward)}"
    yield f"frict_comp.position_delay     {min(delay, _MOST_DELAY)}"
    yield "frict_comp.reversal_lookahead 0"
    yield f"frict_comp.scaling_factor     {_SCALING}"
    yield "frict_comp.delay_cycles       0"
    for i, (one, other) in enumerate(zip(inward, outward, strict=True)):
        yield f"frict_comp.table[{i}].in".ljust(30) + str(one)
        yield f"frict_comp.table[{i}].out".ljust(30) + str(other)


def _whole(value: float, what: str, most: int) -> int:
    if not abs(value) <= most:
        raise ConfigurationError(f"the table overflows: {what} {value:.3g} is beyond {most}")
    return round(value)
