"""The sample period that a file states by a single number beside its columns: `fs = 51200`, `Ts = 4`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from autotune.recordings.importing.factor import Assignment
from autotune.recordings.importing.recognise import guess
from autotune.recordings.importing.source import Source, short

_PERIODS = frozenset(
    [
        "ts",
        "dt",
        "tsample",
        "sampletime",
        "samplingtime",
        "sampleperiod",
        "samplingperiod",
        "tsampling",
        "stepsize",
    ]
)
_RATES = frozenset(
    ["fs", "fsample", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "fsampling"]
)


def stated_period(scalars: Mapping[str, float]) -> tuple[str, float] | None:
    """What the numbers say, and in which; None where none does, or they do not agree.

    Names count without regard to case, underscores and the structure that they are in. Seconds and hertz.

    >>> stated_period({"gain": 3.0, "log.Fs": 400.0})
    ('log.Fs', 0.0025)
    >>> stated_period({"Ts": 0.001, "fs": 400.0}) is None
    True
    """
    found: dict[str, float] = {}
    for name, value in scalars.items():
        plain = name.rsplit(".", 1)[-1].replace("_", "").lower()
        if plain in _PERIODS | _RATES and math.isfinite(value) and value > 0.0:
            found[name] = value if plain in _PERIODS else 1.0 / value
    if not found:
        return None
    name, period = next(iter(found.items()))
    agree = all(math.isclose(other, period, rel_tol=1e-6) for other in found.values())
    return (name, period) if agree else None


def with_stated_period(source: Source, assigned: Mapping[str, Assignment], wanted: float | None) -> Source:
    """The file with the period that it states, where it has no clock and its format knows none.

    Args:
        wanted: what `--period` says [s]; it is taken, and a period that differs is told.
    """
    clock = "time" in assigned or any(guess(column).target == "time" for column in source.columns)
    found = stated_period(source.scalars)
    if clock or source.period is not None or found is None:
        return source
    name, period = found
    said = f"{short(name)!r} in the file is {source.scalars[name]:g}: rows of {period:g} s"
    if wanted is None:
        return replace(source, period=period, notes=(*source.notes, said))
    if math.isclose(wanted, period, rel_tol=1e-3):
        return source
    return replace(source, notes=(*source.notes, f"{said}, but --period {wanted:g} is taken"))
