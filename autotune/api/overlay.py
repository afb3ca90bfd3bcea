"""What each candidate of a diagnosis explains, beside what the model misses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.diagnosis.verdict import Diagnosis
from autotune.estimation.coordinates import coordinates, variance_shares

NO_PLACE = ("direction", "time")
"""Coordinates that tell nothing of where a torque lives."""


@dataclass(frozen=True, slots=True)
class Overlay:
    """The rows that candidates were fitted on, in the order of time; shape (m,) each.

    Attributes:
        time: s, goes on over pauses; `coordinates`: by name.
        residual: of the model fitted as it is, without any of the candidates [N m or N].
        contributions: effect → what the residual loses with it; follows: effect → the coordinate that it follows most.
    """

    time: Floats
    coordinates: Mapping[str, Floats]
    residual: Floats
    contributions: Mapping[str, Floats]
    follows: Mapping[str, str]


def overlay_of(diagnosis: Diagnosis) -> Overlay | None:
    """None where nothing was fitted."""
    problem, root = diagnosis.problem, diagnosis.root
    if problem is None or root is None:
        return None
    data, fitted = problem.data, problem.training > 0.0
    order = np.argsort(data.grid, kind="stable")
    order = order[fitted[order]]
    taken = {one.effect: one.contribution for one in diagnosis.candidates if one.contribution is not None}
    follows = {}
    for effect, values in taken.items():
        shares = variance_shares(data, values, fitted) if np.ptp(values[fitted]) > 0.0 else {"velocity": 1.0}
        follows[effect] = max(
            (name for name in shares if name not in NO_PLACE), key=lambda name: shares[name]
        )
    return Overlay(
        np.asarray(data.grid[order] * data.period, dtype=np.float64),
        {name: values[order] for name, values in coordinates(data).items()},
        root.fitted.error[order],
        {effect: values[order] for effect, values in taken.items()},
        follows,
    )
