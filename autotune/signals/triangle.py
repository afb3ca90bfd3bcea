"""Least squares with many choices among the same columns: reduced once to a triangle that holds all of them.

With [columns, target] = Q·R every fit of mixtures of the columns is one of the few rows of R: the same gains and the
same rest, but for rounding (Golub and Van Loan, Matrix Computations, 4th ed., 5.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats, Integers

ALIKE = 1e-10
"""Of the largest singular value: terms that differ by less are one, and share its gain."""
NOTHING = 1e-300


@dataclass(frozen=True, slots=True)
class Solved:
    """Gains of the terms, shape (k,); mean of what they leave; and the share of the target's variance explained."""

    gains: Floats
    rest: float
    explained: float


@dataclass(frozen=True, slots=True)
class Triangle:
    """Columns and a target, reduced.

    Attributes:
        rows: R of the columns and the target beside them, less their means in every run; shape (m, k + 1), m ≤ k + 1.
        means: of both over all runs, shape (k + 1,).
    """

    rows: Floats
    means: Floats

    def fitted(self, mixing: Floats | None = None) -> Solved:
        """Least squares of the target by the columns, or by mixtures of them, shape (k, j)."""
        table, means, target = self.rows[:, :-1], self.means[:-1], self.rows[:, -1]
        if mixing is not None:
            table, means = table @ mixing, means @ mixing
        size = np.maximum(np.linalg.norm(table, axis=0), NOTHING)
        told = size > NOTHING
        gains = np.linalg.lstsq(table / size, target, rcond=ALIKE)[0] / size * told
        left = target - table @ gains
        explained = 1.0 - float(left @ left) / max(float(target @ target), NOTHING)
        return Solved(np.asarray(gains), float(self.means[-1] - means @ gains), explained)


def reduced(
    columns: Sequence[Floats] | Floats, target: Floats, run: Integers, weight: Floats | None = None
) -> Triangle:
    """A triangle of columns and a target, each of shape (m,), with a constant for every run.

    Args:
        run: number of the run that each row belongs to, shape (m,), ascending.
        weight: of each row's square, shape (m,); all alike where none are given.
    """
    table = np.array([*columns, target])
    means = np.average(table, axis=1, weights=weight) if len(target) else np.zeros(len(table))
    left = less_run_means(table, run, weight)
    left = left if weight is None else left * np.sqrt(weight)
    return Triangle(np.asarray(np.linalg.qr(left.T, mode="r")), means)


def less_run_means(values: Floats, run: Integers, weight: Floats | None = None) -> Floats:
    """Values of shape (…, m) less their mean in the run that each belongs to; `run` of shape (m,), ascending."""
    if len(run) == 0:
        return values
    first = np.flatnonzero(np.diff(run, prepend=run[0] - 1))
    rows = np.diff(first, append=len(run))
    count = rows if weight is None else np.add.reduceat(weight, first)
    means = np.add.reduceat(values if weight is None else values * weight, first, axis=-1) / count
    return np.asarray(values - np.repeat(means, rows, axis=-1))
