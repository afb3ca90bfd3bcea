"""Columns in amperes, volts or shares of the rated torque: no torque until somebody says the constant."""

from __future__ import annotations

from autotune.core.errors import a_few
from autotune.recordings.importing.asking import Doubt
from autotune.recordings.importing.options import Wishes
from autotune.recordings.importing.recognise import COMMAND, Guess, guess, words_of
from autotune.recordings.importing.source import Source
from autotune.recordings.importing.units import Unit

_QUANTITY_OF = {"A": "current", "V": "voltage"}
"""What `--torque-unit` takes for a torque."""
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
    if kind not in ("current", "voltage"):
        return None
    letter, constant = ("A", "0.12") if kind == "current" else ("V", "35.15")
    if wishes.torque_unit == letter:
        return None
    scale = f"*{unit.text}" if unit is not None and unit.factor != 1.0 else ""
    sentence = (
        f"{column} is a {kind}, not a torque: say '{target}={called}*{constant}{scale}' for {constant} N m (or N) "
        f"in each {letter}, or work in {letter} with --torque-unit {letter}"
    )
    return Doubt(target, sentence, f"{called}*CONSTANT{scale}")


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
