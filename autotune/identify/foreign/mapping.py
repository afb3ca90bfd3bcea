"""Which columns become which of the recording, with their factors to SI, and what is said about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from autotune.core.errors import ConfigurationError, RecordingError
from autotune.core.recording import FLOAT_COLUMNS
from autotune.identify.foreign.factor import Assignment
from autotune.identify.foreign.recognise import KINDS, Guess, guess, quantity_of, unit_of
from autotune.identify.foreign.source import Column, Floats, Source
from autotune.identify.foreign.units import Unit, find_unit

SECONDS_AT_MOST = 0.05
"""A clock without a unit is taken in seconds only if its step is below this."""
_LINEAR = frozenset({"length", "linear speed", "force"})
_ROTARY = frozenset({"angle", "angular speed", "torque"})


@dataclass(frozen=True, slots=True)
class Choice:
    """One column of the recording: index in the file, factor to SI, and why."""

    target: str
    index: int
    factor: float
    why: str
    unit: Unit | None
    trusted: bool
    """The factor comes from the person or from a written unit, not from the lack of one."""


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the person said: motion unit, unit of the torque column, one count of the encoder."""

    motion_unit: str | None = None
    torque_unit: str | None = None
    resolution: float | None = None
    period: float | None = None


def choose(source: Source, assigned: Mapping[str, Assignment], wishes: Wishes) -> list[Choice]:
    """Columns of the recording, assigned ones first, then what can be recognised.

    Raises:
        ConfigurationError: something needed is missing or in doubt; the message has the option to write.
    """
    guesses = [guess(column) for column in source.columns]
    taken = {assignment.index for assignment in assigned.values()}
    choices = [_assigned(item, source, wishes) for item in assigned.values()]
    for target in FLOAT_COLUMNS:
        if target in assigned:
            continue
        found = _recognised(target, source, guesses, taken, wishes)
        if found is not None:
            choices.append(found)
    _complete({choice.target for choice in choices}, source, guesses, wishes)
    return choices


def said(choices: list[Choice], source: Source) -> list[str]:
    """One line a column: what was taken as what."""
    lines = []
    for choice in choices:
        column = source.columns[choice.index]
        times = "" if choice.factor == 1.0 else f" × {choice.factor:.9g}"
        taken = f"{choice.target} = {column}{times} ({choice.why})"
        lines.append(
            taken if choice.target else f"{column} is left out: it has no unit; name it with --column"
        )
    return lines


def motion_unit(choices: list[Choice], wishes: Wishes) -> tuple[str, str]:
    """`rad` or `m`, and why.

    Raises:
        ConfigurationError: linear and rotary units in one file, or against `--unit`.
    """
    linear = [choice for choice in choices if choice.unit and choice.unit.kind in _LINEAR]
    rotary = [choice for choice in choices if choice.unit and choice.unit.kind in _ROTARY]
    if linear and rotary:
        raise ConfigurationError(
            f"{linear[0].target} is in {linear[0].unit and linear[0].unit.text} (linear) but {rotary[0].target} in "
            f"{rotary[0].unit and rotary[0].unit.text} (rotary); a recording is on the motor side in one of "
            "them. Give one a factor, for example 'position=FIELD*1e-3*2*pi/0.005' for a screw of 5 mm a turn"
        )
    seen = "m" if linear else "rad" if rotary else None
    if wishes.motion_unit and seen and wishes.motion_unit != seen:
        odd = (linear or rotary)[0]
        raise ConfigurationError(
            f"--unit is {wishes.motion_unit} but {odd.target} is in {odd.unit and odd.unit.text}; use "
            f"--unit {seen}, or give {odd.target} a factor"
        )
    if wishes.motion_unit:
        return wishes.motion_unit, "--unit"
    return (
        (seen, "units in the file") if seen else ("rad", "no unit says otherwise; --unit m for a linear axis")
    )


def check_values(choice: Choice, values: Floats, source: Source) -> None:
    """Raises ConfigurationError where values without a written unit cannot be SI as they are."""
    if choice.trusted:
        return
    name, quantity = source.columns[choice.index], quantity_of(choice.target)
    finite = values[np.isfinite(values)]
    if quantity == "position" and len(finite) and np.ptp(finite) > 100 and np.all(finite == np.round(finite)):
        raise ConfigurationError(
            f"{source.path}: {name} holds whole numbers only ({finite.min():g} to {finite.max():g}), which looks "
            f"like encoder counts. Write '{choice.target}={name.name}*2*pi/COUNTS' with the counts of a turn, or "
            f"'{choice.target}={name.name}*1' if it is SI already"
        )
    if quantity == "time" and len(finite) > 2:
        step = float(np.median(np.diff(finite)))
        if step >= SECONDS_AT_MOST:
            raise ConfigurationError(
                f"{source.path}: {name} steps by {step:g} and has no unit. Write 'time={name.name}*1' for seconds, "
                f"'time={name.name}*ms' for milliseconds, 'time={name.name}*us' for microseconds"
            )


def _assigned(item: Assignment, source: Source, wishes: Wishes) -> Choice:
    column = source.columns[item.index]
    if item.target == "repeat":
        return Choice("repeat", item.index, item.factor or 1.0, "--column", None, True)
    unit = unit_of(column, quantity_of(item.target))
    if item.factor is None:
        return _by_unit(item.target, item.index, column, Guess(item.target, unit, True), source, wishes)
    plain = abs(item.factor) == 1.0
    if unit is not None and plain and unit.factor != 1.0 and unit.kind in KINDS[quantity_of(item.target)]:
        sign = "-" if item.factor < 0 else ""
        raise ConfigurationError(
            f"--column '{item.target}={item.written}': {column} would be read without converting {unit.text}. "
            f"Write '{item.target}={column.name}*{sign}{unit.text}' or the whole factor to SI"
        )
    return Choice(item.target, item.index, item.factor, "--column", None, True)


def _recognised(
    target: str, source: Source, guesses: list[Guess], taken: set[int], wishes: Wishes
) -> Choice | None:
    hits = [i for i, found in enumerate(guesses) if found.target == target and i not in taken]
    exact = [i for i in hits if guesses[i].canonical]
    hits = exact or hits
    if target == "torque" and not hits and wishes.torque_unit in ("A", "V"):
        kind = "current" if wishes.torque_unit == "A" else "voltage"
        hits = [i for i, found in enumerate(guesses) if found.target == kind and i not in taken]
    needed = target in ("time", "position", "torque")
    if len(hits) > 1 and needed:
        names = " or ".join(f"--column '{target}={source.columns[i].name}'" for i in hits)
        raise ConfigurationError(f"{source.path} has {len(hits)} columns that may be {target}: write {names}")
    if len(hits) != 1 or (target == "time" and source.period is not None and wishes.period is not None):
        return None
    index = hits[0]
    return _by_unit(target, index, source.columns[index], guesses[index], source, wishes)


def _by_unit(target: str, index: int, column: Column, found: Guess, source: Source, wishes: Wishes) -> Choice:
    """The column with the factor of its unit; raises ConfigurationError where the unit must be asked for."""
    quantity, unit, option = quantity_of(target), found.unit, f"--column '{target}={column.name}"
    if quantity == "torque":
        unit = unit or find_unit(wishes.torque_unit or "")
        _refuse_electric(column, source, unit, option, wishes)
        if unit is not None and unit.kind in ("current", "voltage"):
            return Choice(target, index, unit.factor, f"{unit.text}, as --torque-unit says", None, True)
    if unit is None and column.unit:
        raise ConfigurationError(
            f"{source.path}: the unit of {column} is not known; write {option}*FACTOR' with what takes it to SI"
        )
    if unit is None:
        return _without_unit(target, index, column, found, source)
    if unit.kind not in KINDS[quantity]:
        raise ConfigurationError(
            f"{source.path}: {column} measures {unit.kind}, not {quantity}; name another column for {target}, or "
            f"write {option}*FACTOR'"
        )
    if unit.kind in ("counts", "count rate"):
        if wishes.resolution is None:
            raise ConfigurationError(
                f"{source.path}: {column} is in encoder counts; write {option}*2*pi/COUNTS' with the counts of a "
                "turn, or say one count in rad or m with --resolution"
            )
        return Choice(target, index, wishes.resolution, "counts, times --resolution", None, True)
    return Choice(target, index, unit.factor, unit.text, unit, True)


def _refuse_electric(column: Column, source: Source, unit: Unit | None, option: str, wishes: Wishes) -> None:
    """A current, a voltage or a share of the rated torque is no torque until somebody says the constant."""
    kind = unit.kind if unit is not None else guess(column).target
    if kind == "share":
        raise ConfigurationError(
            f"{source.path}: {column} is a share of the rated torque; with a rated torque of, say, 0.5 N m write "
            f"{option}*0.5*{unit.factor if unit else 1:g}'"
        )
    if kind not in ("current", "voltage"):
        return
    letter = "A" if kind == "current" else "V"
    if wishes.torque_unit == letter:
        return
    constant = "the torque constant, say 0.12 N m/A" if kind == "current" else "N m (or N) a volt, say 35.15"
    raise ConfigurationError(
        f"{source.path}: {column} is a {kind}, not a torque; with {constant}, write "
        f"{option}*{'0.12' if kind == 'current' else '35.15'}', or work in {letter} with --torque-unit {letter}"
    )


def _without_unit(target: str, index: int, column: Column, found: Guess, source: Source) -> Choice:
    """No unit in the file: SI if the person named the column, or it has a recording's own name, or it is time."""
    if found.canonical or target == "time":
        return Choice(target, index, 1.0, "no unit written: taken in SI", None, False)
    examples = {
        "position": "rad, '{0}*deg', '{0}*mm'",
        "velocity": "rad/s or m/s, '{0}*rpm'",
        "torque": "N m or N, '{0}*mNm'",
    }
    example = examples.get(quantity_of(target), "SI").format(f"{target}={column.name}")
    if target in ("time", "position", "torque"):
        raise ConfigurationError(
            f"{source.path}: {column} has no unit, and a guess could be wrong; write --column "
            f"'{target}={column.name}' if it is in {example} or any factor otherwise"
        )
    return Choice("", index, 1.0, "no unit", None, False)


def _complete(targets: set[str], source: Source, guesses: list[Guess], wishes: Wishes) -> None:
    """Raises where time, position (or velocity) or torque could not be found."""
    missing = []
    if "time" not in targets and source.period is None and wishes.period is None:
        missing.append("time (or --period SECONDS)")
    if not {"position", "velocity"} & targets:
        missing.append("position")
    if not {"torque", "torque_command"} & targets:
        for index, found in enumerate(guesses):
            if found.target in ("current", "voltage"):
                column = source.columns[index]
                _refuse_electric(column, source, found.unit, f"--column 'torque={column.name}", wishes)
        missing.append("torque")
    if missing:
        raise RecordingError(
            f"{source.path}: cannot tell which column is {', '.join(missing)}; the file has {source.described()}. "
            f"Write --column {missing[0].split()[0]}=NAME"
        )
