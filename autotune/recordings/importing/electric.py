"""Columns in amperes, volts or shares of the rated torque: no torque until somebody says the constant."""

from __future__ import annotations

from autotune.core.errors import a_few
from autotune.recordings.importing.asking import Doubt
from autotune.recordings.importing.factor import Assignment
from autotune.recordings.importing.options import Wishes
from autotune.recordings.importing.recognise import COMMAND, Guess, guess, words_of
from autotune.recordings.importing.source import Source
from autotune.recordings.importing.units import Unit

_QUANTITY_OF = {"A": "current", "V": "voltage"}
"""What `--torque-unit` takes for a torque."""
_LETTER_OF = {quantity: letter for letter, quantity in _QUANTITY_OF.items()}
_CONSTANT = {"A": "0.12", "V": "35.15"}
"""What stands in examples."""
MOST_A_UNIT = 100.0
"""Torque or force of each ampere or volt: more than a motor makes behind its gear. A screw may, and is asked about."""
_TORQUES = ("torque", "torque_command")


def taken_as_torque(
    target: str, source: Source, guesses: list[Guess], hits: list[int], wishes: Wishes
) -> list[int]:
    """Which columns are `target` where `--torque-unit` says amperes or volts: `hits`, else currents or voltages.

    A command in newton metres is none beside a torque in amperes.
    """
    quantity = _QUANTITY_OF.get(wishes.torque_unit or "")
    if quantity is None or target not in _TORQUES:
        return hits
    units = {i: guesses[i].unit for i in hits}
    alike = [i for i, unit in units.items() if unit is None or unit.kind == quantity or target == "torque"]
    return alike or _found(quantity + target.removeprefix("torque"), source, guesses)


def electric(target: str, index: int, source: Source, unit: Unit | None, wishes: Wishes) -> Doubt | None:
    """A current, a voltage or a share of the rated torque is no torque until somebody says the constant."""
    column, called = source.columns[index], source.called(index)
    kind = unit.kind if unit is not None else guess(column).target.removesuffix(COMMAND)
    if kind == "share":
        share = unit.factor if unit else 1.0
        sentence = (
            f"{column} is a share of the rated torque: say '{target}={called}*0.5*{share:g}' for 0.5 N m"
        )
        return Doubt(target, sentence, f"{called}*RATED*{share:g}")
    letter = _LETTER_OF.get(kind)
    if letter is None or wishes.torque_unit == letter:
        return None
    constant = _CONSTANT[letter]
    scale = f"*{unit.text}" if unit is not None and unit.factor != 1.0 else ""
    sentence = (
        f"{column} is a {kind}, not a torque: say '{target}={called}*{constant}{scale}' for {constant} N m (or N) "
        f"in each {letter}, or work in {letter} with --torque-unit {letter}"
    )
    return Doubt(target, sentence, f"{called}*CONSTANT{scale}")


def too_large(item: Assignment, source: Source, unit: Unit | None) -> Doubt | None:
    """Asks whether a constant is for each ampere or each milliampere, where it would be too large for any motor."""
    letter = _LETTER_OF.get(unit.kind) if unit is not None else None
    if unit is None or letter is None or unit.factor == 1.0 or item.factor is None:
        return None
    if f"*{unit.text}" in item.written or abs(item.factor) <= MOST_A_UNIT * unit.factor:
        return None
    called, of_each = source.called(item.index), item.factor / unit.factor
    right = f"{called}*{item.factor:g}*{unit.text}"
    sentence = (
        f"--column '{item.target}={item.written}' makes {of_each:g} of each {letter}: write '{item.target}={right}' if "
        f"{item.factor:g} is for each {letter}, or '{item.target}={called}*{of_each:g}*{unit.text}' if it is for each "
        f"{unit.text}"
    )
    return Doubt(item.target, sentence, right)


def a_current(source: Source, guesses: list[Guess], wishes: Wishes) -> list[Doubt]:
    """Where nothing is a torque: the constant of a current, or of a voltage, and of the one commanded beside it."""
    for quantity in _QUANTITY_OF.values():
        measured = _found(quantity, source, guesses)
        commanded = _found(quantity + COMMAND, source, guesses)
        if len(measured) > 1:
            names = a_few([f"'torque={source.called(i)}*CONSTANT'" for i in measured], 4)
            several = f"{len(measured)} columns are a {quantity} that may tell the torque: one of {names}"
            return [Doubt("torque", several, "NAME*CONSTANT")]
        chosen = dict(zip(_TORQUES, (measured, commanded), strict=True))
        asked = [
            electric(target, hits[0], source, guesses[hits[0]].unit, wishes)
            for target, hits in chosen.items()
            if len(hits) == 1
        ]
        if asked:
            return [doubt for doubt in asked if doubt is not None]
    return []


def _found(target: str, source: Source, guesses: list[Guess]) -> list[int]:
    """Columns that are called so; else those that only have such a unit, as the other current of a motor has."""
    hits = [i for i, found in enumerate(guesses) if found.target == target]
    called = [i for i in hits if words_of(source.columns[i].name)[0] == target.removesuffix(COMMAND)]
    return called or hits
