"""Tables with units in their headers, for controllers that take a file of points."""

from __future__ import annotations

from autotune.core.arrays import Floats
from autotune.export.c_file import quantity
from autotune.export.request import Exported, Request, lost_everywhere
from autotune.export.tables import lost_to_tables, position_table, sliding_torque, speed_of, speeds
from autotune.export.text import about, ascii_only, headline

VELOCITY, POSITION, CONSTANTS = "velocity.csv", "position.csv", "constants.csv"
_POINTS = 24
_KEPT = "sliding friction and offset over velocity, what repeats over position, inertia as a constant"


def export_csv(request: Request) -> Exported:
    """`velocity.csv`, `constants.csv`, and `position.csv` where something repeats with the place.

    Raises:
        ConfigurationError: a wave that needs more points than a table has.
    """
    model, name = request.model, request.name
    most, notes = speed_of(request)
    velocity = speeds(most, _POINTS)
    places, lost_places = position_table(request)
    lost = (*lost_everywhere(request), *lost_places, lost_to_tables(request, places))
    head = [headline(request), *about(request, lost, "", kept=_KEPT).splitlines()]
    torque = f"{quantity(request)} [{model.torque_symbol}]"
    unit = model.motion_unit
    files = {
        VELOCITY: _table(head, (f"velocity [{unit}/s]", torque), velocity, sliding_torque(model, velocity)),
        CONSTANTS: _constants(request, head),
    }
    if places is not None:
        columns = (f"position [{unit}]", torque)
        repeat = ["Repeats with every turn."] if unit == "rad" else []
        files[POSITION] = _table([*head, *repeat], columns, places.position, places.torque)
    made = {f"{name}_{file}": ascii_only(text).encode("ascii") for file, text in files.items()}
    return Exported(made, lost, notes)


def _constants(request: Request, head: list[str]) -> str:
    model = request.model
    rows = [f"inertia,{model['inertia']!r},{model.unit('inertia')}"]
    return "\n".join([*(f"# {line}" for line in head), "name,value,unit", *rows]) + "\n"


def _table(head: list[str], columns: tuple[str, str], one: Floats, other: Floats) -> str:
    rows = [f"{a:.9g},{b:.9g}" for a, b in zip(one, other, strict=True)]
    return "\n".join([*(f"# {line}" for line in head), ",".join(columns), *rows]) + "\n"
