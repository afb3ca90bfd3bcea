"""What a drive's torque objects mean, found by a small step of the torque offset at standstill.

The axis holds its position while the offset jumps by ±δ, far below what would make it slide. The position
controller pulls against it, in its own time and way; so neither the demand D nor the measured torque T can
be judged alone. Their difference can: where D is the whole demand, D − T stays as it is; where the offset
u is missing in D, D − T follows −u; where it is counted twice, +u. T itself, in the first cycles after an
edge, before the controller can answer, gives sign and scale of the offset.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.axis import Limits
from autotune.core.drive import Command, Sample
from autotune.core.errors import DriveError, NotEnoughExcitation
from autotune.experiments.experiment import Experiment, Needs
from autotune.experiments.path import Mark, Motion, Steps
from autotune.recordings.recording import CONDITIONING

TORQUE_STEP = "torque-step"
SHARE_OF_LIMIT = 0.03
PULSES = 24
PULSE_SECONDS = 0.04
LEAD_SECONDS = 0.2
DELAY_CYCLES = 6  # after an edge, until demand and measured torque both know of it
EDGE_CYCLES = 5  # in which the controller has not answered yet
NEAR = 0.25
LARGEST_ERROR = 0.1
SCALE = (0.6, 1.4)


class Meaning(StrEnum):
    """Whether the torque demand, as the drive is read now, has the torque offset in it."""

    INCLUDED = "included"
    MISSING = "missing"
    TWICE = "twice"
    UNKNOWN = "unknown"


_LEVELS = {Meaning.INCLUDED: 0.0, Meaning.MISSING: -1.0, Meaning.TWICE: 1.0}


@dataclass(frozen=True, slots=True)
class TorqueSemantics:
    """What the step has shown.

    Attributes:
        meaning: of the demand.
        excess: regression coefficient of D − T on the offset, with its standard error (`error`).
        scale: first answer of the measured torque, in units of the offset; 1 where sign and scale are right.
        reason: in words.
    """

    meaning: Meaning
    excess: float
    error: float
    scale: float
    reason: str

    def require(self) -> Meaning:
        """The meaning.

        Raises:
            DriveError: it cannot be told, or the offset's sign or scale is wrong.
        """
        if self.meaning is Meaning.UNKNOWN:
            raise DriveError(f"the meaning of the drive's torque objects cannot be told: {self.reason}")
        return self.meaning


@dataclass(frozen=True)
class TorqueStep(Experiment):
    """Pulses of the torque offset while the axis holds where it stands; returns `TorqueSemantics`."""

    @property
    def name(self) -> str:
        return TORQUE_STEP

    @property
    def labels(self) -> tuple[str, ...]:
        return (CONDITIONING, TORQUE_STEP)

    @property
    def amplitude(self) -> float:
        """δ [N m]."""
        return SHARE_OF_LIMIT * self.motion.torque

    @property
    def duration(self) -> float:
        return 2.0 * LEAD_SECONDS + 2.0 * PULSES * PULSE_SECONDS

    def needs(self, limits: Limits) -> Needs:
        middle = 0.5 * (limits.position_min + limits.position_max)
        return Needs(middle, middle, 0.0, 0.0, self.amplitude)

    def run(self, start: Sample) -> Steps:
        hold = start.reference
        yield Mark(CONDITIONING)
        for _ in range(self.motion.samples(LEAD_SECONDS)):
            yield Command(hold)
        yield Mark(TORQUE_STEP)
        rows: list[tuple[float, float, float]] = []
        for offset in pulses(self.motion, self.amplitude).tolist():
            sample = yield Command(hold, 0.0, 0.0, offset)
            rows.append((offset, sample.torque_command, sample.torque))
        yield Mark(CONDITIONING)
        for _ in range(self.motion.samples(LEAD_SECONDS)):
            yield Command(hold)
        table = np.array(rows)
        return tell(table[:, 0], table[:, 1], table[:, 2])


def pulses(motion: Motion, amplitude: float) -> Floats:
    """+δ, 0, −δ, 0, … each for `PULSE_SECONDS`; shape (n,)."""
    length = motion.samples(PULSE_SECONDS)
    levels = [level for k in range(PULSES) for level in (amplitude if k % 2 == 0 else -amplitude, 0.0)]
    return np.repeat(np.array(levels), length)


def tell(offset: Floats, demand: Floats, torque: Floats) -> TorqueSemantics:
    """Judges the answer to pulses of the offset.

    Args:
        offset: u, piecewise constant, shape (n,) [N m].
        demand: D in the same cycles, as the drive is read now, shape (n,) [N m].
        torque: T as measured, shape (n,) [N m].

    Raises:
        NotEnoughExcitation: there are no steps in `offset`.
    """
    edges = np.flatnonzero(np.diff(offset)) + 1
    if len(edges) < 4:
        raise NotEnoughExcitation(f"the torque offset has {len(edges)} steps; at least 4 are needed")
    excess, error = _excess(offset, demand - torque, edges)
    scale = _scale(offset, torque, edges)
    meaning, reason = _judge(excess, error, scale)
    return TorqueSemantics(meaning, excess, error, scale, reason)


def _excess(offset: Floats, difference: Floats, edges: NDArray[np.int64]) -> tuple[float, float]:
    """Change of the difference across each edge in units of the offset's: mean and standard error."""
    bounds = [0, *edges.tolist(), len(offset)]
    levels = [
        float(np.mean(difference[start + DELAY_CYCLES : stop])) if stop - start > DELAY_CYCLES else math.nan
        for start, stop in itertools.pairwise(bounds)
    ]
    steps = offset[edges] - offset[edges - 1]
    ratios = np.diff(np.array(levels)) / steps
    ratios = ratios[np.isfinite(ratios)]
    if len(ratios) < 4:
        return math.nan, math.inf
    return float(np.mean(ratios)), float(np.std(ratios, ddof=1) / math.sqrt(len(ratios)))


def _scale(offset: Floats, torque: Floats, edges: NDArray[np.int64]) -> float:
    """The largest answer of the measured torque in the first cycles after an edge, averaged over edges."""
    inner = edges[(edges >= 2) & (edges + EDGE_CYCLES < len(torque))]
    steps = offset[inner] - offset[inner - 1]
    before = 0.5 * (torque[inner - 1] + torque[inner - 2])
    answers = np.array([np.mean((torque[inner + k] - before) / steps) for k in range(EDGE_CYCLES)])
    return float(answers[np.argmax(np.abs(answers))])


def _judge(excess: float, error: float, scale: float) -> tuple[Meaning, str]:
    if not error < LARGEST_ERROR:
        return Meaning.UNKNOWN, (
            f"demand less measured torque changes by {excess:.2f} ± {error:.2f} of the offset's step, which is "
            "too uncertain; let the axis come to rest, or write down in an own profile what its manual says"
        )
    if scale < 0.0 and abs(scale) > 0.5 * SCALE[0]:
        return Meaning.UNKNOWN, (
            f"the measured torque answers with {scale:.2f} of the offset: the sign is wrong. Check the polarity "
            "in the drive (607Eh) and mechanics.direction in the axis file"
        )
    if not SCALE[0] <= scale <= SCALE[1]:
        return Meaning.UNKNOWN, (
            f"the measured torque answers with {scale:.2f} of the offset instead of 1: the torque offset does "
            "not act, or its unit is another one. Check rated torque and torque constant in the drive, and the "
            "profile's units"
        )
    for meaning, level in _LEVELS.items():
        if abs(excess - level) < NEAR:
            return meaning, f"demand less measured torque changes by {excess:.2f} of the offset's step"
    return Meaning.UNKNOWN, (
        f"demand less measured torque changes by {excess:.2f} of the offset's step; −1, 0 or 1 could be "
        "understood. Check that demand and measured torque have the same unit in the profile"
    )
