"""The benchmark sine (section 6.3.6), as it is and while a feedforward adapts.

The torque offset is computed for the very reference sample that it is sent with; velocity and
acceleration are central differences of the filtered reference, so they are exact in phase. Amplitude
and feedforward fade in together over half a period and out again at the end; one whole period passes
before anything is measured.
"""

from __future__ import annotations

import copy
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from autotune.control.feedforward import FeedforwardLaw
from autotune.core.axis import Limits
from autotune.core.drive import Command, Sample
from autotune.core.recording import Floats
from autotune.experiments.experiment import Experiment, Needs, Planned, needs_of
from autotune.experiments.path import CONDITIONING, Item, Mark, Motion, Path, Plan, Steps
from autotune.signals.excitation import smooth_step

BENCHMARK, ADAPTATION = "benchmark", "adaptation"


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
class BenchmarkSine(Planned):
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
        path.move(self.motion.centre)
        whole = self.motion.centre + sine(self.motion, self.repeats * self.periods + 2)
        path.add(whole[:n])
        for window in range(self.repeats):
            begin = n * (1 + window * self.periods)
            path.mark(self.label, self.first_repeat + window)
            path.add(whole[begin : begin + n * self.periods])
        path.mark(CONDITIONING).add(whole[-n:])

    def prepare(self) -> None:
        if self.feedforward is not None:
            self.feedforward.prepare()

    def run(self, start: Sample) -> Steps:
        if self.feedforward is None:
            yield from super().run(start)
            return None
        plan = self.plan(start.reference)
        law = copy.deepcopy(self.feedforward)
        yield from compensated(plan, self._gain(plan), law)
        return law

    def _gain(self, plan: Plan) -> Floats:
        """How much of the feedforward is on; the sine stands just before the plan's settling tail."""
        fade = envelope(self.motion, self.repeats * self.periods + 2)
        gain = np.zeros(len(plan.reference))
        begin = _first(plan, self.label) - period_samples(self.motion)
        gain[begin : begin + len(fade)] = fade
        return gain


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
        return max(self.longest, self._plan(self.motion.centre).duration)

    def needs(self, limits: Limits) -> Needs:
        return needs_of(self._plan(self.motion.centre), limits)

    def prepare(self) -> None:
        self.feedforward.prepare()

    def run(self, start: Sample) -> Steps:
        """Fades in, repeats whole periods, fades out."""
        plan = self._plan(start.reference)
        n = period_samples(self.motion)
        law = copy.deepcopy(self.feedforward)
        middle = _first(plan, ADAPTATION)
        fade = np.zeros(len(plan.reference))
        fade[middle - n : middle + 2 * n] = envelope(self.motion, 3)
        rows = _rows(plan, fade)
        previous: Sample | None = yield Mark(CONDITIONING)
        previous = yield from _follow(rows[:middle], law, None)
        for period in range(max(self._periods - 2, 1)):
            yield Mark(ADAPTATION, period)
            previous = yield from _follow(rows[middle : middle + n], law, previous)
            if law.settled:
                break
        yield Mark(CONDITIONING)
        yield from _follow(rows[middle + n :], law, previous)
        return law

    @property
    def _periods(self) -> int:
        return int(self.longest / (period_samples(self.motion) * self.motion.period))

    def _plan(self, start: float) -> Plan:
        """Three periods: fade in, the one that is repeated, fade out."""
        return BenchmarkSine(self.motion, repeats=1, periods=1, label=ADAPTATION).plan(start)


Row = tuple[float, float, float, float]


def compensated(plan: Plan, gain: Floats, law: FeedforwardLaw) -> Generator[Item, Sample, None]:
    """Plays a plan with `gain` × the law's torque; the law sees only what is played with gain > 0."""
    rows = _rows(plan, gain)
    edges = [start for start, _, _ in plan.marks] + [len(rows)]
    previous: Sample | None = None
    for (start, label, repeat), stop in zip(plan.marks, edges[1:], strict=True):
        yield Mark(label, repeat)
        previous = yield from _follow(rows[start:stop], law, previous)


def _follow(
    rows: list[Row], law: FeedforwardLaw, previous: Sample | None
) -> Generator[Item, Sample, Sample | None]:
    step = law.step
    for reference, velocity, acceleration, gain in rows:
        torque = gain * step(reference, velocity, acceleration, previous) if gain > 0.0 else 0.0
        sample = yield Command(reference, 0.0, 0.0, torque)
        previous = sample if gain > 0.0 else None
    return previous


def _rows(plan: Plan, gain: Floats) -> list[Row]:
    columns: Iterator[Floats] = chain((plan.reference, plan.velocity, plan.acceleration, gain))
    return list(zip(*(column.tolist() for column in columns), strict=True))


def _first(plan: Plan, label: str) -> int:
    return next(start for start, name, _ in plan.marks if name == label)
