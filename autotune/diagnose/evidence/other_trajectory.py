"""Another trajectory decides: a model fitted without it and carried there unchanged.

In one recording several effects may explain the same error. Carried to a second trajectory the right one lowers the
error there, the wrong ones raise it. Each recording is held out in turn; a `veto` segment is held out always.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.data import VETO
from autotune.estimation.problem import CHUNK, Study, refit

LEAST_ROWS = 60
LEAST_REST = 0.25
"""Of the rows: with fewer left the other recordings say too little to be carried anywhere."""
ITERATIONS = 10


def folds_of(study: Study) -> Iterator[Flags]:
    """Grid rows to be held out: the veto trajectory, else each recording in turn."""
    data = study.data
    if study.has(VETO):
        yield data.role(VETO) & (study.weight > 0)
        return
    if len(data.starts) < 2:
        return
    number = np.searchsorted(np.array(data.starts), data.grid, side="right")
    fitted = study.training > 0
    for one in np.unique(number):
        held = fitted & (number == one)
        left = fitted & (number != one)
        if held.sum() >= LEAST_ROWS and left.sum() >= LEAST_REST * fitted.sum():
            yield held


def carried_error(study: Study, level: Level, held: Flags) -> Floats:
    """Error of the model fitted without the rows held out, shape (m,)."""
    others = replace(study, weight=study.weight * ~held)
    return refit(others, level.fitted.packed, list(level.free), level.correction, ITERATIONS).error


def chunks_of(error: Floats) -> list[float]:
    """Squared error of pieces that are compared pairwise."""
    pieces = max(1, min(len(error) // 20, max(10, len(error) // CHUNK)))
    return [float(np.sum(part**2)) for part in np.array_split(error, pieces)]
