"""What a recording cannot do without and no column was recognised as: asked for, with what may be it."""

from __future__ import annotations

from collections.abc import Callable

from autotune.core.errors import a_few
from autotune.recordings.importing.asking import Doubt
from autotune.recordings.importing.electric import a_current
from autotune.recordings.importing.options import Wishes
from autotune.recordings.importing.recognise import Guess, could_be_position, could_be_torque
from autotune.recordings.importing.source import Column, Source

_MAY_BE: dict[str, Callable[[Column], bool]] = {"position": could_be_position, "torque": could_be_torque}


def missing(
    targets: set[str], taken: set[int], source: Source, guesses: list[Guess], rows: int | None, wishes: Wishes
) -> list[Doubt]:
    """Time, position (or velocity) and torque where nothing seems to be one.

    Args:
        targets: what has a column, or is asked for already.
        taken: columns that are something already.
        rows: the length that all columns of the recording have.
    """
    lacking: dict[str, str] = {}
    doubts: list[Doubt] = []
    if not ("time" in targets or source.period or wishes.period or wishes.speed_curve):
        table = ", or --speed-curve where each row is a constant speed with its mean torque"
        lacking["time"] = f"time (or --period{table * ('velocity' in targets and 'position' not in targets)})"
    if wishes.speed_curve and "velocity" not in targets:
        lacking["velocity"] = "velocity"
    elif not {"position", "velocity"} & targets:
        lacking["position"] = "position"
    if not {"torque", "torque_command"} & targets:
        doubts += a_current(source, guesses, wishes)
        if not doubts:
            lacking["torque"] = "torque"
    may_be = {target: _may_be(target, taken, source, rows) for target in lacking}
    alone = [
        f"only {source.columns[hits[0]]} can be {target}" for target, hits in may_be.items() if len(hits) == 1
    ]
    likely = f"; by name and unit {', '.join(alone)}" if alone else ""
    told = f"cannot tell which column is {', '.join(lacking.values())}; the file has {source.described()}"
    return doubts + [Doubt(target, told + likely, _field(hits, source)) for target, hits in may_be.items()]


def overlooked(
    targets: set[str], assigned: set[str], taken: set[int], source: Source, rows: int | None
) -> list[Doubt]:
    """Columns that may be what is measured, where something else would be taken in its place without a word.

    A position integrated from the velocity would start at 0 and drift; a torque commanded is none that was measured.
    """
    doubts: list[Doubt] = []
    if "position" not in targets and "velocity" in targets - assigned:
        hits = _may_be("position", taken, source, rows)
        ends = "with 'velocity=...' named and no 'position=...' it is integrated from the velocity"
        doubts += _asked("position", "an angle, a length or counts", hits, source, ends)
    if "torque" not in targets and "torque_command" in targets - assigned:
        hits = _may_be("torque", taken, source, rows)
        ends = "with 'torque_command=...' named and no 'torque=...' the torque commanded is taken for it"
        doubts += _asked("torque", "a torque or a force", hits, source, ends)
    return doubts


def _asked(target: str, what: str, hits: list[int], source: Source, ends: str) -> list[Doubt]:
    if not hits:
        return []
    names = a_few([f"'{target}={source.called(i)}'" for i in hits], 4)
    measures = f"{len(hits)} measure{'s' * (len(hits) == 1)} {what}"
    sentence = f"no column is called a {target}, but {measures}: say {names}; {ends}"
    return [Doubt(target, sentence, _field(hits, source))]


def _may_be(target: str, taken: set[int], source: Source, rows: int | None) -> list[int]:
    """Columns that could be it by their unit, and bear no name of anything."""
    fits = _MAY_BE.get(target)
    free = [(i, column) for i, column in enumerate(source.columns) if i not in taken and column.rows == rows]
    return [i for i, column in free if fits is not None and fits(column)]


def _field(hits: list[int], source: Source) -> str:
    """The only column that may be it, for a person to confirm; else a placeholder."""
    return source.called(hits[0]) if len(hits) == 1 else "NAME"
