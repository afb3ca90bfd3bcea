"""Whether one column went through a low-pass that the other did not see.

Drives and loggers often record a filtered torque or a filtered position. Moving one against the other mends
the delay, not the lag that is left, and that looks like an elastic transmission. So each side is put
through first-order filters; where motion and torque then belong together far better, the other side is
filtered alike, and that is said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import signal

from autotune.core.arrays import Floats
from autotune.estimation.alignment import aligned, away_from_reversals, best_shift, linear_misfit, shifted
from autotune.estimation.data import Prepared

SAMPLES = (2.0, 4.0, 8.0, 16.0)
"""Time constants tried, of the file."""
CLEARLY = 0.4
"""Of the misfit: less must be left."""
LARGE = 0.1
"""Of the torque: where more is left, something else is missing that a filter could imitate."""


def without_twin(data: Prepared) -> tuple[Prepared, tuple[str, ...]]:
    """A single recording's columns brought together where no controller tells how they belong together."""
    if data.repeated or data.steady:
        return data, ()
    data, said = compensated(aligned(data))
    return data, () if said is None else (said,)


def compensated(data: Prepared) -> tuple[Prepared, str | None]:
    """The data with both sides filtered alike, and a sentence on it; as they are where no column seems filtered."""
    plain = _misfit(data)
    if plain > LARGE:
        return data, None
    trials: list[tuple[float, str, float]] = []
    for samples in (data.finer * count for count in SAMPLES):
        trials.append((_misfit(_motion_through(data, samples)), "torque", samples))
        trials.append((_misfit(_torque_through(data, samples)), "position", samples))
    misfit, column, samples = min(trials)
    if misfit > CLEARLY * plain:
        return data, None
    through, other = (_motion_through, "motion") if column == "torque" else (_torque_through, "torque")
    said = (
        f"The {column} looks low-passed against the other columns, by about {1e3 * samples * data.period:.2g} ms; "
        f"the {other} was filtered alike. An elastic transmission cannot be told from that: record the {column} "
        "unfiltered."
    )
    alike = through(data, samples)
    return replace(shifted(alike, _best(alike)), filtered=True), said


def _best(data: Prepared) -> float:
    rows = away_from_reversals(data)
    return best_shift(lambda shift: linear_misfit(shifted(data, shift), rows), data.shift, data.finer)[0]


def _misfit(data: Prepared) -> float:
    """Share of the torque's variance that inertia and friction leave, at the best shift."""
    rows = away_from_reversals(data)
    return best_shift(lambda shift: linear_misfit(shifted(data, shift), rows), data.shift, data.finer)[1]


def _motion_through(data: Prepared, samples: float) -> Prepared:
    through = _through(data, samples)
    return replace(
        data,
        position=through(data.position),
        velocity=through(data.velocity),
        acceleration=through(data.acceleration),
    )


def _torque_through(data: Prepared, samples: float) -> Prepared:
    return replace(data, recorded_torque=_through(data, samples)(data.recorded_torque))


def _through(data: Prepared, samples: float) -> Callable[[Floats], Floats]:
    share = 1.0 - float(np.exp(-1.0 / samples))

    def run(values: Floats) -> Floats:
        result = np.zeros_like(values)
        for stretch in data.stretches:
            part = values[stretch.rows]
            state = [(1.0 - share) * part[0]]
            result[stretch.rows] = signal.lfilter([share], [1.0, share - 1.0], part, zi=state)[0]
        return result

    return run
