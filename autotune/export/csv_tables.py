"""Tables with units in their headers, for controllers that take a file of points."""

from __future__ import annotations

from autotune.core.arrays import Floats
from autotune.export.c_file import quantity
from autotune.export.request import Exported, Lost, Request, cost, lost_everywhere
from autotune.export.tables import (
    lost_to_tables,
    position_table,
    repeating,
    sliding_torque,
    speed_of,
    speeds,
)
from autotune.export.text import about, ascii_only, headline

VELOCITY, POSITION, CONSTANTS = "velocity.csv", "position.csv", "constants.csv"
_POINTS = 24
_KEPT = "sliding friction and offset over velocity, waves over position, inertia and spring as constants"


def export_csv(request: Request) -> Exported:
    """`velocity.csv`, `constants.csv`, and `position.csv` where something repeats with the place.

    Raises:
        ConfigurationError: a wave that needs more points than a table has.
    """
    model, name = request.model, request.name
    most, notes = speed_of(request)
    velocity = speeds(most, _POINTS)
    places = position_table(model)
    lost = (*lost_everywhere(request), *_lost_places(request), lost_to_tables(request, places))
    head = [headline(request), *about(request, lost, "", kept=_KEPT).splitlines()]
    torque = f"{quantity(request)} [{model.torque_symbol}]"
    unit = model.motion_unit
    files = {
        VELOCITY: _table(head, (f"velocity [{unit}/s]", torque), velocity, sliding_torque(model, velocity)),
        CONSTANTS: _constants(request, head),
    }
    if places is not None:
        columns = (f"position [{unit}]", torque)
        repeat = f"Repeats every {repeating(model)[0]:.9g} {unit}."
        files[POSITION] = _table([*head, repeat], columns, places.position, places.torque)
    made = {f"{name}_{file}": ascii_only(text).encode("ascii") for file, text in files.items()}
    return Exported(made, lost, notes)


def _lost_places(request: Request) -> tuple[Lost, ...]:
    model = request.model
    _, _, odd = repeating(model)
    whys = dict.fromkeys(odd, "a wave of it does not repeat with the table")
    whys["position_dependent_friction"] = "its sign changes with the direction, which a table does not know"
    return tuple(
        Lost(effect.name, whys[effect.name], cost(request, effect))
        for effect in model.effects
        if effect.name in whys
    )


def _constants(request: Request, head: list[str]) -> str:
    model = request.model
    names = ["inertia", *(["spring.stiffness"] if "spring" in model else [])]
    rows = [f"{name},{model[name]!r},{model.unit(name)}" for name in names]
    return "\n".join([*(f"# {line}" for line in head), "name,value,unit", *rows]) + "\n"


def _table(head: list[str], columns: tuple[str, str], one: Floats, other: Floats) -> str:
    rows = [f"{a:.9g},{b:.9g}" for a, b in zip(one, other, strict=True)]
    return "\n".join([*(f"# {line}" for line in head), ",".join(columns), *rows]) + "\n"
