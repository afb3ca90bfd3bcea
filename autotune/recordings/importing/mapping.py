"""Which columns become which of the recording, with their factors to SI, and what is said about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError, a_few
from autotune.recordings.importing.asking import Doubt
from autotune.recordings.importing.clock import LEAST_ROWS
from autotune.recordings.importing.electric import electric, taken_as_torque, too_large
from autotune.recordings.importing.factor import Assignment
from autotune.recordings.importing.missing import missing, overlooked
from autotune.recordings.importing.options import Wishes
from autotune.recordings.importing.recognise import (
    KINDS,
    MEASURED,
    Guess,
    guess,
    guesses_of,
    quantity_of,
    unit_of,
    wanted_of,
)
from autotune.recordings.importing.source import Column, Source, by_name, usual_rows
from autotune.recordings.importing.units import Unit, find_unit
from autotune.recordings.recording import FLOAT_COLUMNS

SECONDS_AT_MOST = 0.05
"""A clock without a unit is taken in seconds only if its step is below this."""
REPEAT = "repeat"
_FEW = 6
_WANTED = ("reference", "torque_command", "torque_feedforward")
_NEEDED = ("time", "position", "torque")
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


def choose(
    source: Source, assigned: Mapping[str, Assignment], wishes: Wishes
) -> tuple[list[Choice], list[Doubt]]:
    """Columns of the recording, assigned ones first, then what can be recognised; and what must be asked for.

    Raises:
        ConfigurationError: the assigned columns differ in length.
    """
    rows = _rows(source, assigned)
    guesses = _guesses(source, rows)
    taken = {assignment.index for assignment in assigned.values()}
    found = [_assigned(item, source, wishes) for item in assigned.values()]
    for target in FLOAT_COLUMNS:
        if target not in assigned:
            fellow = assigned.get(MEASURED.get(target, ""))
            found += _recognised(target, source, guesses, taken, wishes, fellow)
    found += _own_repeats(source, rows, taken) if REPEAT not in assigned else []
    choices = [one for one in found if isinstance(one, Choice)]
    doubts = [one for one in found if isinstance(one, Doubt)]
    targets = {one.target for one in found}
    used = taken | {choice.index for choice in choices}
    doubts += missing(targets, used, source, guesses, rows, wishes)
    doubts += overlooked(targets, set(assigned), used, source, rows)
    return choices, doubts + _mixed(choices, source, wishes)


def _guesses(source: Source, rows: int | None) -> list[Guess]:
    """What each column seems to be; nothing where it is not as long as the recording."""
    found = iter(guesses_of([column for column in source.columns if column.rows == rows]))
    return [next(found) if column.rows == rows else Guess("", None) for column in source.columns]


def _rows(source: Source, assigned: Mapping[str, Assignment]) -> int | None:
    """The length that all columns of the recording have: of the assigned ones, else of most."""
    columns = {item.target: source.columns[item.index] for item in assigned.values()}
    lengths = {column.rows for column in columns.values()}
    if len(lengths) > 1:
        told = ", ".join(f"{target} = {column} with {column.rows}" for target, column in columns.items())
        raise ConfigurationError(
            f"{source.path}: --column takes columns that differ in length: {told} rows; take columns of one length"
        )
    return lengths.pop() if lengths else usual_rows(source.columns)


def said(choices: list[Choice], source: Source, labels: Column | None) -> list[str]:
    """One line a column: what was taken as what; and one for those that are used for nothing, `labels` neither."""
    lines = []
    for choice in choices:
        column = source.columns[choice.index]
        times = "" if choice.factor == 1.0 else f" × {choice.factor:.9g}"
        taken = f"{choice.target} = {column}{times} ({choice.why})"
        lines.append(
            taken if choice.target else f"{column} is left out: it has no unit; name it with --column"
        )
    used = {choice.index for choice in choices}
    left = [str(one) for index, one in enumerate(source.columns) if index not in used and one is not labels]
    if left:
        such = "a reference" if "torque" in {choice.target for choice in choices} else "the torque measured"
        lines.append(f"not used: {a_few(left, _FEW)}; --column TARGET=FIELD takes one, such as {such}")
    return lines


def written(choices: list[Choice], source: Source, assigned: Mapping[str, Assignment]) -> dict[str, str]:
    """What `--column` says for each column that is beyond doubt."""
    told = {choice.target: source.called(choice.index) for choice in choices if choice.target}
    return told | {target: item.written for target, item in assigned.items()}


def motion_unit(choices: list[Choice], wishes: Wishes) -> tuple[str, str]:
    """`rad` or `m`, and why."""
    linear, rotary = _measuring(choices, _LINEAR), _measuring(choices, _ROTARY)
    if wishes.motion_unit:
        return wishes.motion_unit, "--unit"
    seen = "m" if linear else "rad" if rotary else None
    return (
        (seen, "units in the file") if seen else ("rad", "no unit says otherwise; --unit m for a linear axis")
    )


def _measuring(choices: list[Choice], kinds: frozenset[str]) -> list[tuple[Choice, Unit]]:
    return [(choice, choice.unit) for choice in choices if choice.unit and choice.unit.kind in kinds]


def _mixed(choices: list[Choice], source: Source, wishes: Wishes) -> list[Doubt]:
    """Linear and rotary units in one file, or against `--unit`."""
    linear, rotary = _measuring(choices, _LINEAR), _measuring(choices, _ROTARY)
    if linear and rotary:
        (one, unit), (other, its) = linear[0], rotary[0]
        sentence = (
            f"{one.target} is in {unit.text} (linear) but {other.target} in {its.text} (rotary), and a recording is "
            "on the motor side in one of them; for a screw of 5 mm a turn, FACTOR is 1e-3*2*pi/0.005"
        )
        return [Doubt(each.target, sentence, f"{source.called(each.index)}*FACTOR") for each, _ in linear]
    seen = "m" if linear else "rad" if rotary else None
    if wishes.motion_unit and seen and wishes.motion_unit != seen:
        all_odd = linear or rotary
        odd, unit = all_odd[0]
        sentence = f"--unit is {wishes.motion_unit} but {odd.target} is in {unit.text}; write --unit {seen} or a factor"
        return [Doubt(each.target, sentence, f"{source.called(each.index)}*FACTOR") for each, _ in all_odd]
    return []


def value_doubt(choice: Choice, values: Floats, source: Source) -> list[Doubt]:
    """Values without a written unit that cannot be SI as they are."""
    if choice.trusted or not choice.target:
        return []
    column, called, quantity = (
        source.columns[choice.index],
        source.called(choice.index),
        quantity_of(choice.target),
    )
    finite = values[np.isfinite(values)]
    if quantity == "position" and len(finite) and np.ptp(finite) > 100 and np.all(finite == np.round(finite)):
        sentence = (
            f"{column} holds whole numbers only ({finite.min():g} to {finite.max():g}), which looks like encoder "
            f"counts: '{choice.target}={called}*2*pi/COUNTS' with the counts of a turn, or '{called}*1' if it is SI"
        )
        return [Doubt(choice.target, sentence, f"{called}*2*pi/COUNTS")]
    if quantity == "time" and len(finite) > 2:
        step = float(np.median(np.diff(finite)))
        if step >= SECONDS_AT_MOST:
            sentence = (
                f"{column} steps by {step:g} and has no unit: 'time={called}*s' for seconds, 'time={called}*ms' for "
                f"milliseconds, 'time={called}*us' for microseconds"
            )
            return [Doubt("time", sentence, f"{called}*UNIT")]
    return []


def _assigned(item: Assignment, source: Source, wishes: Wishes) -> Choice | Doubt:
    column = source.columns[item.index]
    if item.target == REPEAT:
        return Choice(REPEAT, item.index, item.factor or 1.0, "--column", None, True)
    unit = unit_of(column, quantity_of(item.target))
    if item.factor is None:
        return _by_unit(item.target, item.index, source, Guess(item.target, unit, True), wishes)
    plain = abs(item.factor) == 1.0
    if unit is not None and plain and unit.factor != 1.0 and unit.kind in KINDS[quantity_of(item.target)]:
        sign = "-" if item.factor < 0 else ""
        right = f"{source.called(item.index)}*{sign}{unit.text}"
        sentence = (
            f"--column '{item.target}={item.written}': {column} would be read without converting {unit.text}; write "
            f"'{item.target}={right}' or the whole factor to SI"
        )
        return Doubt(item.target, sentence, right)
    return too_large(item, source, unit) or Choice(
        item.target, item.index, item.factor, "--column", None, True
    )


def _own_repeats(source: Source, rows: int | None, taken: set[int]) -> list[Choice]:
    """The one column with the recording's own name for repetitions; what it holds is looked at when it is read."""
    named = [source.columns.index(column) for column in by_name(REPEAT, source.columns) if not column.unit]
    own = [i for i in named if i not in taken and source.columns[i].rows == rows]
    return [Choice(REPEAT, own[0], 1.0, "a recording's own name", None, False)] if len(own) == 1 else []


def counts_repeats(values: Floats) -> bool:
    """Whether a column, shape (n,), counts repetitions: whole numbers from 0 on that change, and stay for a while."""
    whole = bool(np.all((values == np.round(values)) & (values >= 0.0)))
    return whole and 0 < int(np.count_nonzero(np.diff(values))) * LEAST_ROWS <= len(values)


def _recognised(
    target: str,
    source: Source,
    guesses: list[Guess],
    taken: set[int],
    wishes: Wishes,
    fellow: Assignment | None,
) -> list[Choice | Doubt]:
    """The column that is `target`; `fellow`: what a person says is measured of it."""
    hits = [i for i, found in enumerate(guesses) if found.target == target and i not in taken]
    exact = [i for i in hits if guesses[i].canonical]
    hits = exact or hits
    hits = [i for i in taken_as_torque(target, source, guesses, hits, wishes) if i not in taken]
    if fellow is not None:
        hits = wanted_of(target, source.columns[fellow.index], source.columns, hits)
    if len(hits) > 1 and target in _NEEDED:
        names = a_few([f"'{target}={source.called(i)}'" for i in hits], 4)
        return [Doubt(target, f"{len(hits)} columns that may be {target}: one of {names}", "NAME")]
    if len(hits) != 1 or (target == "time" and source.period is not None and wishes.period is not None):
        return []
    found = guesses[hits[0]]
    return [_by_unit(target, hits[0], source, found, wishes)]


def _by_unit(target: str, index: int, source: Source, found: Guess, wishes: Wishes) -> Choice | Doubt:
    """The column with the factor of its unit; a doubt where the unit must be asked for."""
    quantity, unit = quantity_of(target), found.unit
    column, called = source.columns[index], source.called(index)
    if quantity == "torque":
        unit = unit or find_unit(wishes.torque_unit or "")
        doubt = electric(target, index, source, unit, wishes)
        if doubt is not None:
            return doubt
        if unit is not None and unit.kind in ("current", "voltage"):
            return Choice(target, index, unit.factor, f"{unit.text}, as --torque-unit says", None, True)
    if unit is None and column.unit:
        return Doubt(target, f"the unit of {column} is not known: FACTOR takes it to SI", f"{called}*FACTOR")
    if unit is None:
        return _without_unit(target, index, source, found)
    if unit.kind not in KINDS[quantity]:
        sentence = (
            f"{column} measures {unit.kind}, not {quantity}: name another column, or what takes it to SI"
        )
        return Doubt(target, sentence, f"{called}*FACTOR")
    if unit.kind in ("counts", "count rate"):
        if wishes.resolution is None:
            sentence = (
                f"{column} is in encoder counts: COUNTS of a turn, or --resolution with one count in rad or m"
            )
            return Doubt(target, sentence, f"{called}*2*pi/COUNTS")
        return Choice(target, index, wishes.resolution, "counts, times --resolution", None, True)
    return Choice(target, index, unit.factor, unit.text, unit, True)


def _without_unit(target: str, index: int, source: Source, found: Guess) -> Choice | Doubt:
    """No unit in the file: SI if the person named the column, or it has a recording's own name, or it is time."""
    if found.canonical or target == "time":
        return Choice(target, index, 1.0, "no unit written: taken in SI", None, False)
    if target not in _NEEDED:
        return Choice("", index, 1.0, "no unit", None, False)
    return _unit_asked(target, index, source)


def _unit_asked(target: str, index: int, source: Source) -> Doubt:
    units = "rad, deg, mm" if quantity_of(target) == "position" else "Nm, mNm, N"
    sentence = f"{source.columns[index]} has no unit, and a guess could be wrong: UNIT is {units} or any factor to SI"
    return Doubt(target, sentence, f"{source.called(index)}*UNIT")


def also_asked(choices: list[Choice], source: Source) -> list[Doubt]:
    """Where something is asked anyway: the units of what was commanded too, which the command would leave out else."""
    left = [(guess(source.columns[one.index]).target, one.index) for one in choices if not one.target]
    return [_unit_asked(target, index, source) for target, index in left if target in _WANTED]
