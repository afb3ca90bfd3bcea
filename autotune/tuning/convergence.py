"""Parameters while the adaptation laws move them, for whoever looks on.

The laws run where the cycles are. Their next step follows from the sample alone, so a copy of them that gets the
same samples, here, goes the same way; the axis is neither asked nor disturbed.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Sequence

import numpy as np

from autotune.control.adaptation import AdaptiveFeedforward
from autotune.core.arrays import Floats
from autotune.core.drive import Sample
from autotune.experiments.sines import ADAPTATION, AdaptiveSine
from autotune.models.drive_model import surface_parameter
from autotune.tuning.observer import Observer

EVERY_SECONDS = 0.1
NAMES = ("stiffness", "coulomb", "offset")


class Convergence:
    """Follows an adaptive sine by its rows, and tells observers the parameters with their spread over a period."""

    def __init__(
        self, law: AdaptiveFeedforward, sine: AdaptiveSine, observers: Sequence[Observer], motion_unit: str
    ) -> None:
        self._law = copy.deepcopy(law)
        self._observers = observers
        self._label = sine.labels.index(ADAPTATION)
        self._rows = sine.one_period
        self._count = 0
        self._previous: Sample | None = None
        self._every = max(round(EVERY_SECONDS / sine.motion.period), 1)
        self._units = [surface_parameter(name).unit_for(motion_unit) for name in NAMES]
        self._last: deque[Floats] = deque(maxlen=max(len(self._rows) // self._every, 2))
        nothing = Sample._make([0.0] * len(Sample._fields))  # while it fades in, nothing is adapted
        for reference, velocity, acceleration, gain in sine.fading_in:
            if gain > 0.0:
                self._law.step(reference, velocity, acceleration, self._previous)
            self._previous = nothing if gain > 0.0 else None

    def watch(self, rows: Floats) -> None:
        """Rows of the programme, as `core.loop.Watch`."""
        for row in rows[rows[:, -2] == self._label]:
            reference, velocity, acceleration, _ = self._rows[self._count % len(self._rows)]
            self._law.step(reference, velocity, acceleration, self._previous)
            self._previous = Sample._make(row[: len(Sample._fields)].tolist())
            self._count += 1
            if self._count % self._every == 0:
                self._tell()

    @property
    def values(self) -> Floats:
        """Stiffness, Coulomb torque and offset as they are, shape (3,)."""
        return self._law.present()

    def _tell(self) -> None:
        self._last.append(self.values)
        spread = np.std(np.array(self._last), axis=0)
        told = {
            name: (float(value), float(error), unit)
            for name, value, error, unit in zip(NAMES, self._last[-1], spread, self._units, strict=True)
        }
        for observer in self._observers:
            observer.parameters(told)
