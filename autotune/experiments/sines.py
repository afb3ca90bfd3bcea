"""The benchmark sine (section 6.3.6), as it is and while a feedforward adapts.

The torque offset is computed for the very reference sample that it is sent with; velocity and
acceleration are central differences of the filtered reference, so they are exact in phase. Amplitude
and feedforward fade in together over half a period and out again at the end; one whole period passes
before anything is measured.
"""

from __future__ import annotations

import copy
from collections.abc import Generator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from autotune.control.feedforward import FeedforwardLaw
from autotune.core.arrays import Floats
from autotune.core.axis import Limits
from autotune.core.drive import Command, Sample
from autotune.experiments.experiment import Experiment, Needs, PlannedExperiment, approach
from autotune.experiments.path import Item, Mark, Motion, Path, Steps
from autotune.recordings.recording import CONDITIONING
from autotune.signals.excitation import smooth_step

BENCHMARK, ADAPTATION = "benchmark", "adaptation"
Row = tuple[float, float, float, float]


def period_samples(motion: Motion) -> int:
    """Samples of one period of the benchmark, a whole number."""
    return max(round(1.0 / (motion.frequency * motion.period)), 8)


def sine(motion: Motion, periods: int) -> Floats:
    """Unfiltered sine round 0, `periods` whole periods long, faded in and out; shape (n,)."""
    return motion.amplitude * envelope(motion, periods) * np.sin(_phase(motion, periods))


def envelope(motion: Motion, periods: int) -> Floats:
    """Fades in over the first half period and out over the last; shape (n,)."""
    turns = _phase(motion, periods) / (2.0 * np.pi)
    return smooth_step(2.0 * turns) * smooth_step(2.0 * (periods - turns))


def _phase(motion: Motion, periods: int) -> Floats:
    n = period_samples(motion)
    return np.asarray(2.0 * np.pi * np.arange(1, periods * n + 1) / n)


@dataclass(frozen=True)
class BenchmarkSine(PlannedExperiment):
    """Windows of whole periods under the label `benchmark`, one repeat a window.

    Attributes:
        repeats: windows measured one after the other.
        periods: whole periods a window.
        feedforward: a law that gives the torque offset; None for none.
        first_repeat: number of the first window, where before and after are measured in turn.
        label: of the measured windows.
    """

    repeats: int = 1
    periods: int = 3
    feedforward: FeedforwardLaw | None = None
    first_repeat: int = 0
    label: str = BENCHMARK

    @property
    def name(self) -> str:
        return self.label

    def trace(self, path: Path) -> None:
        n = period_samples(self.motion)
        whole = self.motion.centre + sine(self.motion, self.repeats * self.periods + 2)
        path.add(whole[:n])
        for window in range(self.repeats):
            begin = n * (1 + window * self.periods)
            path.mark(self.label, self.first_repeat + window)
            path.add(whole[begin : begin + n * self.periods])
        path.mark(CONDITIONING).add(whole[-n:])

    @cached_property
    def rows(self) -> list[Row]:
        """(reference, velocity, acceleration, share of the feedforward) of each cycle."""
        plan = self.plan
        gain = np.zeros(len(plan.reference))
        fade = envelope(self.motion, self.repeats * self.periods + 2)
        gain[: len(fade)] = fade
        columns = (plan.reference, plan.velocity, plan.acceleration, gain)
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def prepare(self) -> None:
        super().prepare()
        if self.feedforward is not None:
            _ = self.rows
            self.feedforward.prepare()

    def run(self, start: Sample) -> Steps:
        if self.feedforward is None:
            return (yield from super().run(start))
        law = copy.deepcopy(self.feedforward)
        yield from approach(self.motion, start.reference)
        edges = [first for first, _, _ in self.plan.marks] + [len(self.rows)]
        previous: Sample | None = None
        for (first, label, repeat), stop in zip(self.plan.marks, edges[1:], strict=True):
            yield Mark(label, repeat)
            previous = yield from _follow(self.rows[first:stop], law, previous)
        return law


@dataclass(frozen=True)
class AdaptiveSine(Experiment):
    """The benchmark sine until the feedforward law has settled; returns the law as it then is.

    Attributes:
        feedforward: the law that adapts; a copy runs, so the experiment can be played again.
        longest: machine time after which it ends unsettled [s].
    """

    feedforward: FeedforwardLaw
    longest: float = 100.0

    @property
    def name(self) -> str:
        return ADAPTATION

    @property
    def labels(self) -> tuple[str, ...]:
        return (CONDITIONING, ADAPTATION)

    @property
    def duration(self) -> float:
        """At most."""
        return self._one.duration + (self._periods - 1) * period_samples(self.motion) * self.motion.period

    def needs(self, limits: Limits) -> Needs:
        return self._one.needs(limits)

    def prepare(self) -> None:
        self._one.prepare()

    def run(self, start: Sample) -> Steps:
        """Fades in, repeats whole periods, fades out."""
        n, rows = period_samples(self.motion), self._one.rows
        law = copy.deepcopy(self.feedforward)
        yield Mark(CONDITIONING)
        yield from approach(self.motion, start.reference)
        previous = yield from _follow(rows[:n], law, None)
        for period in range(self._periods):
            yield Mark(ADAPTATION, period)
            previous = yield from _follow(rows[n : 2 * n], law, previous)
            if law.settled:
                break
        yield Mark(CONDITIONING)
        yield from _follow(rows[2 * n :], law, previous)
        return law

    @property
    def fading_in(self) -> list[Row]:
        """References of the first period, which fades in."""
        return self._one.rows[: period_samples(self.motion)]

    @property
    def one_period(self) -> list[Row]:
        """References of every period after it."""
        n = period_samples(self.motion)
        return self._one.rows[n : 2 * n]

    @property
    def _periods(self) -> int:
        return max(int(self.longest / (period_samples(self.motion) * self.motion.period)) - 2, 1)

    @cached_property
    def _one(self) -> BenchmarkSine:
        """Three periods: fade in, the one that is repeated, fade out."""
        return BenchmarkSine(self.motion, 1, 1, self.feedforward, label=ADAPTATION)


def _follow(
    rows: list[Row], law: FeedforwardLaw, previous: Sample | None
) -> Generator[Item, Sample, Sample | None]:
    step = law.step
    for reference, velocity, acceleration, gain in rows:
        torque = gain * step(reference, velocity, acceleration, previous) if gain > 0.0 else 0.0
        sample = yield Command(reference, 0.0, 0.0, torque)
        previous = sample if gain > 0.0 else None
    return previous
