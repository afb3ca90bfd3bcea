"""A copy of the adaptation laws that gets the same samples goes the same way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np

from autotune.control.adaptation import AdaptiveFeedforward, Bounds
from autotune.control.feedforward import LugreParameters
from autotune.core.drive import Command, Sample
from autotune.core.loop import ROW_FIELDS
from autotune.experiments.path import Mark, Motion
from autotune.experiments.sines import AdaptiveSine
from autotune.tuning.convergence import NAMES, Convergence
from tests.experiments.support import axis, sample

START = LugreParameters(6.66e-4, 4.13e-3, 0.33, 60.0, 0.1, 0.05, 0.33)


class Heard:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[Mapping[str, tuple[float, float | None, str]]] = []

    def parameters(self, values: Mapping[str, tuple[float, float | None, str]]) -> None:
        self.told.append(values)


def play(sine: AdaptiveSine) -> tuple[AdaptiveFeedforward, np.ndarray]:
    """The law that ran, and the rows that were published; u_PID is made up, and moves all parameters."""
    rng = np.random.default_rng(3)
    steps, rows, label = sine.run(sample()), [], 0
    item, seen = next(steps), sample()
    while True:
        if isinstance(item, Mark):
            label = sine.labels.index(item.label)
        elif isinstance(item, Command):
            feedback = 0.02 * np.sign(np.cos(2 * np.pi * len(rows) * 1e-3)) + 0.005 * rng.normal()
            seen = sample(position=item.position, torque_feedback=float(feedback))
            rows.append([*seen, label, 0])
        try:
            item = steps.send(seen)
        except StopIteration as end:
            ran = cast(AdaptiveFeedforward, end.value)
            return ran, np.array(rows, dtype=float)


def test_the_copy_goes_the_way_of_the_law() -> None:
    motion = Motion.of(axis())
    law = AdaptiveFeedforward(
        START, Bounds.around(START, (10.0, 120.0)), 1.0, motion.period, least_periods=30
    )
    sine = AdaptiveSine(motion, law, 12.0)
    ran, rows = play(sine)
    assert rows.shape[1] == len(ROW_FIELDS)
    heard = Heard()
    shown = Convergence(law, sine, [heard], "rad")  # type: ignore[list-item]
    for first in range(0, len(rows), 50):
        shown.watch(rows[first : first + 50])
    found = ran.result()
    assert np.ptp(found.history, axis=0).min() > 0.0  # it has moved
    told = np.array([[values[name][0] for name in NAMES] for values in heard.told])
    when = 1.0 + 0.1 * (1 + np.arange(len(told)))  # the first period fades in
    ours = np.column_stack([np.interp(when, found.time, column) for column in found.history.T])
    # the law keeps every 50th step, and between them the parameters move by less than this
    np.testing.assert_allclose(told, ours, rtol=5e-3)
    assert len(told) == 100  # ten periods of 1 s, each 0.1 s
    assert heard.told[-1]["stiffness"][2] == "N m/rad"
    assert all(values[name][1] is not None for values in heard.told for name in NAMES)


def test_the_law_that_is_shown_is_not_the_one_that_runs() -> None:
    motion = Motion.of(axis())
    law = AdaptiveFeedforward(START, Bounds.around(START), 1.0, motion.period)
    before = law.present()
    sine = AdaptiveSine(motion, law, 6.0)
    shown = Convergence(law, sine, [], "rad")
    shown.watch(play(sine)[1])
    np.testing.assert_array_equal(law.present(), before)
    assert isinstance(shown.values, np.ndarray)
    assert Sample._fields[0] == "time"
