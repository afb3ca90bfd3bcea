"""References made of moves, ramps, cruises and dwells, smooth and sampled with the cycle.

Speeds change along v₀ + (v₁ − v₀)·(3s² − 2s³), so acceleration is continuous and its peak is
1.5·|v₁ − v₀|/T. The finished reference passes H(z) = (1 − α)z/(z − α) (6.14), started so that it is
continuous from where the axis stands.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Axis
from autotune.core.drive import Command, Mode, Sample
from autotune.recordings.recording import CONDITIONING

ABANDONED = "abandoned"  # follows samples that became useless: they are conditioning too
PEAK = 1.5  # peak over mean slope of 3s² − 2s³
SETTLED = 1e-7  # part of the filter's lag that may be left at the end of a reference


class Mark(NamedTuple):
    """Says what the samples from here on belong to; takes no cycle."""

    label: str
    repeat: int = 0


class Switch(NamedTuple):
    """Powers the axis in another mode, at rest; answered with the first sample in it.

    `torque` is commanded at once in TORQUE mode.
    """

    mode: Mode
    torque: float = 0.0


Item = Command | Mark | Switch
Steps = Generator[Item, Sample, object]
"""What an experiment plays; it receives the samples."""


@dataclass(frozen=True, slots=True)
class Motion:
    """How an axis is moved in and between experiments. SI, motor side.

    Attributes:
        period: cycle [s].
        reference_filter: α of (6.14).
        centre: position round which experiments move.
        speed, acceleration: of moves between measurements; far inside the limits.
        travel: half of the travel that experiments may use round `centre`.
        amplitude, frequency: of the user's own motion (the benchmark): every experiment is scaled by it.
        top_speed: fastest that an experiment may go.
        hardest: highest acceleration an experiment may ask for.
        torque: limit.
        resolution: of the position sensor.
        revolution: distance after which torque ripple repeats; None on linear axes.
    """

    period: float
    reference_filter: float
    centre: float
    speed: float
    acceleration: float
    travel: float
    amplitude: float
    frequency: float
    top_speed: float
    hardest: float
    torque: float
    resolution: float
    revolution: float | None = None

    @classmethod
    def of(cls, axis: Axis, centre: float | None = None) -> Motion:
        """Derives the scales of an axis from its limits and its benchmark."""
        limits = axis.limits
        middle = 0.5 * (limits.position_min + limits.position_max) if centre is None else centre
        room = min(limits.position_max - middle, middle - limits.position_min)
        usual = 2.0 * math.pi * axis.benchmark.frequency * axis.benchmark.amplitude
        return cls(
            period=axis.cycle,
            reference_filter=axis.reference.filter,
            centre=middle,
            speed=min(0.4 * limits.speed, 4.0 * usual),
            acceleration=0.25 * limits.deceleration,
            travel=0.85 * room,
            amplitude=axis.benchmark.amplitude,
            frequency=axis.benchmark.frequency,
            top_speed=0.75 * limits.speed,
            hardest=0.75 * limits.deceleration,
            torque=limits.torque,
            resolution=axis.position_resolution,
            revolution=2.0 * math.pi if axis.motion_unit == "rad" else None,
        )

    @property
    def usual_speed(self) -> float:
        """Peak velocity of the user's motion."""
        return 2.0 * math.pi * self.frequency * self.amplitude

    def samples(self, seconds: float) -> int:
        """Whole cycles in `seconds`, at least one."""
        return max(round(seconds / self.period), 1)


@dataclass(frozen=True, slots=True)
class Plan:
    """A reference ready to be played.

    Attributes:
        reference: filtered position, shape (n,).
        torque: torque offset beside it, shape (n,).
        marks: (first sample, label, repeat), in order; the first is at sample 0.
        period: cycle [s].
    """

    reference: Floats
    torque: Floats
    marks: tuple[tuple[int, str, int], ...]
    period: float

    @property
    def duration(self) -> float:
        return len(self.reference) * self.period

    @property
    def velocity(self) -> Floats:
        """Central difference of the reference, shape (n,); at rest beyond both ends."""
        padded = np.concatenate([self.reference[:1], self.reference, self.reference[-1:]])
        return np.asarray((padded[2:] - padded[:-2]) / (2.0 * self.period))

    @property
    def acceleration(self) -> Floats:
        """Second difference of the reference, shape (n,)."""
        padded = np.concatenate([self.reference[:1], self.reference, self.reference[-1:]])
        return np.asarray(np.diff(padded, 2) / self.period**2)

    def play(self) -> Generator[Item, Sample, None]:
        """Plays the reference with its torque offset and its marks."""
        edges = [start for start, _, _ in self.marks] + [len(self.reference)]
        for (start, label, repeat), stop in zip(self.marks, edges[1:], strict=True):
            yield Mark(label, repeat)
            positions, torques = self.reference[start:stop].tolist(), self.torque[start:stop].tolist()
            for position, torque in zip(positions, torques, strict=True):
                yield Command(position, 0.0, 0.0, torque)


class Path:
    """Builds a plan piece by piece, from `start`, at rest, under the label `conditioning`."""

    def __init__(self, motion: Motion, start: float) -> None:
        self.motion = motion
        self._start = start
        self._pieces: list[Floats] = []
        self._torques: list[Floats] = []
        self._marks: list[tuple[int, str, int]] = [(0, CONDITIONING, 0)]
        self.count = 0
        self.position = start
        self.speed = 0.0

    def mark(self, label: str, repeat: int = 0) -> Path:
        """What comes next belongs to `label` and `repeat`."""
        if self._marks[-1][0] == self.count:
            self._marks.pop()
        self._marks.append((self.count, label, repeat))
        return self

    def move(self, target: float, speed: float | None = None, acceleration: float | None = None) -> Path:
        """From rest to rest at `target`; as fast as speed and acceleration allow."""
        distance = target - self.position
        if distance == 0.0:
            return self
        top = min(speed or self.motion.speed, math.sqrt(abs(distance) * self._slope(acceleration)))
        steps = self._change(0.0, top, acceleration)
        left = abs(distance) - 2.0 * float(steps.sum())
        cruise = np.full(
            max(math.ceil(left / (top * self.motion.period) - 1e-9), 0), top * self.motion.period
        )
        shape = np.concatenate([steps, cruise, steps[::-1]])
        return self.add(self.position + distance * np.cumsum(shape) / shape.sum(), end_speed=0.0)

    def ramp(self, speed: float, acceleration: float | None = None) -> Path:
        """Changes the (signed) speed smoothly."""
        if speed == self.speed:
            return self
        return self.add(
            self.position + np.cumsum(self._change(self.speed, speed, acceleration)), end_speed=speed
        )

    def cruise(self, distance: float = 0.0, seconds: float = 0.0) -> Path:
        """Goes on at the present speed for a distance or a time; whole cycles, at least one."""
        seconds = seconds or abs(distance / self.speed)
        steps = times(self.motion.samples(seconds), self.speed * self.motion.period)
        return self.add(self.position + steps, end_speed=self.speed)

    def dwell(self, seconds: float) -> Path:
        """Stands still."""
        return self.add(np.full(self.motion.samples(seconds), self.position), end_speed=0.0)

    def add(self, positions: Floats, end_speed: float = 0.0, torque: Floats | None = None) -> Path:
        """Appends sampled positions; the caller answers for their smoothness."""
        self._pieces.append(np.asarray(positions, dtype=np.float64))
        self._torques.append(np.zeros(len(positions)) if torque is None else torque)
        self.count += len(positions)
        self.position, self.speed = float(positions[-1]), end_speed
        return self

    def ramp_distance(self, before: float, after: float, acceleration: float | None = None) -> float:
        """Distance that `ramp` takes from one speed to another."""
        return abs(float(self._change(before, after, acceleration).sum()))

    def positions(self) -> Floats:
        """The unfiltered reference so far, shape (n,)."""
        return np.concatenate(self._pieces) if self._pieces else np.zeros(0)

    def plan(self) -> Plan:
        """Filters the reference (6.14), with time at the end for the filter to settle."""
        alpha = self.motion.reference_filter
        tail = math.ceil(math.log(SETTLED) / math.log(alpha)) if alpha > 0.0 else 1
        self.mark(CONDITIONING).dwell(tail * self.motion.period)
        raw = self.positions()
        steps = ((1.0 - alpha) * (raw - self._start)).tolist()
        last = 0.0
        smooth = np.array([last := alpha * last + step for step in steps])
        return Plan(
            np.asarray(self._start + smooth),
            np.concatenate(self._torques),
            tuple(self._marks),
            self.motion.period,
        )

    def _slope(self, acceleration: float | None) -> float:
        """Mean acceleration whose peak is the one allowed."""
        return (acceleration or self.motion.acceleration) / PEAK

    def _change(self, before: float, after: float, acceleration: float | None) -> Floats:
        """Increments of a smooth change of speed."""
        seconds = abs(after - before) / self._slope(acceleration)
        count = max(math.ceil(seconds / self.motion.period), 1)
        s = (np.arange(count) + 0.5) / count
        return np.asarray((before + (after - before) * s * s * (3.0 - 2.0 * s)) * self.motion.period)


def times(count: int, period: float) -> Floats:
    """period, 2·period … count·period; shape (count,)."""
    return np.arange(1, count + 1, dtype=np.float64) * period


def labels_of(plan: Plan) -> tuple[str, ...]:
    """Labels of a plan, each once, in order of appearance."""
    return unique(label for _, label, _ in plan.marks)


def unique(names: Sequence[str] | Generator[str, None, None]) -> tuple[str, ...]:
    """Each name once, in order."""
    return tuple(dict.fromkeys(names))
