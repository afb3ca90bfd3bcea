"""Small displacements (section 3.4.3): excitation far below break-away, from a relaxed friction state.

In position mode a decaying sine brings the friction state to zero; the mean torque of its last cycles
is u₀, the torque that carries gravity, offset and torque ripple just here. Then the drive is switched
to torque mode and u(t) = u₀ + u_s(t) is played with |u_s| < 0.1·min(F_c, F_s). A drive without a torque
mode gets u_s as torque offset round a constant reference, and what counts is the total torque demand.
u_s is a multisine: the slow, large swings of a PRBS walk through hysteresis, which looks like damping.

Where the encoder told nothing for a while in a set, or one set gave way to its torque much more or less than another
(Σu_s·q/Σu_s², the junctions' compliance, is the axis's own), the axis is moved afterwards: sets of an encoder that
died or changed meanwhile, or of a torque that turned round, are not kept, as the guard does not let it move.

An encoder that tells nothing of the excitation for `PATIENCE` is dead or coarse: the axis is moved at once, as the
next set is prepared, and the guard sees which. One that is coarse has to show that it lives every `COARSE_PATIENCE`,
so the time for which torque acts on an axis that nobody sees is bounded. u₀ is found anew in every preparation, at the
same place and from the same state: where sets stayed round different ones, the axis bore another load, or encoder and
torque have both turned round, which leaves a sound axis seen in a mirror.

An axis that leaves the region round z = 0 is caught in position mode, relaxed again and excited more
weakly; the samples of that set are marked `abandoned`.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Limits
from autotune.core.drive import Command, Mode, Sample
from autotune.core.errors import NotEnoughExcitation
from autotune.experiments.experiment import Experiment, Needs, approach, needs_of, together
from autotune.experiments.path import ABANDONED, Item, Mark, Path, Plan, Steps, Switch
from autotune.recordings.recording import CONDITIONING
from autotune.signals.excitation import decaying_sine, multisine

LABEL = "presliding"
EXCITATION = 0.07  # of the friction level; the thesis: below 0.1, but less looks less like damping
CLOSED_LOOP_EXCITATION = 0.09  # more where the controller holds the axis, yet below 0.1 all the same
SET_SECONDS = 3.0
LINES, SLOWEST, FASTEST = 40, 5.0, 200.0  # Hz
NYQUIST_PART = 0.35  # of the sampling rate
RELAX_CYCLES, RELAX_FASTEST, MEAN_CYCLES = 32, 10.0, 8
HOLD_SECONDS, TRIALS, TRIAL_SECONDS = 0.4, 2, 1.0
CORRECTION, LARGEST_PART = 0.7, 0.05
SURVEY_SPEED = 0.2  # of the user's peak speed
DRIFT = 0.01  # of the user's amplitude
LEAST_COUNTS = 16
ALIKE = (
    0.5  # of the set that gave way most: junctions are as stiff in the next set, but for where the axis rests
)
SILENT_SECONDS = 0.5  # in a set, two periods of the slowest line and more
PATIENCE = 0.25  # s of silence in an excitation: three times the longest that an encoder with counts enough has shown
COARSE_PATIENCE = 12.0  # s, of whole sets, where its counts are too coarse for that
SAME_LOAD = 0.3  # friction levels between u0 of preparations whose sets stayed: a hundredth is usual
OFFSET_NOISE = 0.01  # of limits.torque, the same where there is hardly any friction
TRIES = 3
WEAKER = 0.7

Walk = Generator[Item, Sample, tuple[Sample, float]]


class _Swing(NamedTuple):
    """One stretch of excitation: last sample, distance from its beginning, way walked in all, how long the encoder was
    silent at a stretch, how far the axis gave way per torque, and whether it was ended as the encoder was silent."""

    sample: Sample
    drift: float
    travel: float
    stayed: bool
    silent: float
    gave: float = 0.0
    mute: bool = False

    def excess(self, friction: float) -> float:
        """By how much u₀ is too high: a torque Δu bends the junctions by z, and (3.10) creeps by |q̇|z/g."""
        part = self.drift / self.travel if self.travel > 0.0 else 0.0
        return CORRECTION * friction * min(max(part, -LARGEST_PART), LARGEST_PART)


@dataclass(slots=True)
class _Shown:
    """What encoder and axis have shown in the sets and preparations so far.

    Attributes:
        quiet: how long the encoder has told nothing under excitation, since it or the axis last moved [s].
        coarse: it lived although it had told nothing for `PATIENCE`.
        prepared: u₀ of the last preparation, offsets: of those under which a set stayed [N m or N].
        gave: of each set kept; longest: silence in them [s].
    """

    quiet: float = 0.0
    coarse: bool = False
    prepared: float = 0.0
    offsets: list[float] = field(default_factory=list)
    gave: list[float] = field(default_factory=list)
    longest: float = 0.0

    def moved(self, offset: float) -> None:
        """The axis has been moved, so its encoder lives, and relaxed at u₀."""
        self.coarse |= self.quiet > PATIENCE
        self.quiet, self.prepared = 0.0, offset

    @property
    def patience(self) -> float:
        """Silence after which an excitation ends [s]."""
        return math.inf if self.coarse else PATIENCE

    def keep(self, swing: _Swing) -> None:
        """A set was played to its end, under the load of the last preparation."""
        self.offsets.append(self.prepared)
        self.gave.append(swing.gave)
        self.longest = max(self.longest, swing.silent)

    @property
    def doubtful(self) -> bool:
        """Whether the sets kept may be those of an encoder that died or changed, or of a torque that turned round."""
        least, most = min(self.gave, default=0.0), max(self.gave, default=0.0)
        return self.longest > SILENT_SECONDS or not least >= ALIKE * most


@dataclass(frozen=True, slots=True)
class PreslidingResult:
    """What became of the sets.

    Attributes:
        kept: repeats that stayed in presliding.
        abandoned: repeats that did not.
        amplitude: of the last excitation [N m or N].
        offset: u₀ of the last sets [N m or N].
        friction: level from which the amplitude was chosen [N m or N].
    """

    kept: tuple[int, ...]
    abandoned: tuple[int, ...]
    amplitude: float
    offset: float
    friction: float


@dataclass(frozen=True)
class Presliding(Experiment):
    """Sets of three seconds; repeat k of label `presliding` is set k.

    Attributes:
        friction: estimate of min(F_c, F_s) [N m or N]; None measures it first, in a slow move.
        torque_mode: whether the drive has one; otherwise the excitation rides on a position held.
        sets: number of sets.
    """

    friction: float | None = None
    torque_mode: bool = True
    sets: int = 10

    @property
    def name(self) -> str:
        return LABEL

    @property
    def labels(self) -> tuple[str, ...]:
        return (CONDITIONING, LABEL, ABANDONED)

    @property
    def drift(self) -> float:
        """Distance from where a set began at which it is given up [rad or m]."""
        return max(LEAST_COUNTS * self.motion.resolution, DRIFT * self.motion.amplitude)

    @property
    def duration(self) -> float:
        """Without sets that have to be played again."""
        survey = self.survey.duration if self.friction is None else 0.0
        trials = TRIALS * TRIAL_SECONDS if self.torque_mode else 0.0
        return survey + self.relaxing[0].duration + trials + self.sets * SET_SECONDS

    def needs(self, limits: Limits) -> Needs:
        """Of the survey, and of the sine that relaxes the axis."""
        return together([needs_of(self.survey, limits), needs_of(self.relaxing[0], limits)])

    def run(self, start: Sample) -> Steps:
        sample = yield Mark(CONDITIONING)
        friction = self.friction
        if friction is None:
            sample, friction = yield from self._measure_friction(sample)
        amplitude = (EXCITATION if self.torque_mode else CLOSED_LOOP_EXCITATION) * friction
        kept: list[int] = []
        lost: list[int] = []
        unheard: list[int] = []
        shown = _Shown()
        sample, offset = yield from self._prepare_set(sample, amplitude, friction, shown)
        while len(kept) < self.sets and len(lost) <= TRIES:
            repeat = len(kept) + len(lost) + len(unheard)
            yield Mark(LABEL, repeat)
            swing = yield from self._excite(sample, offset, self._signal(amplitude), shown)
            sample, offset = swing.sample, offset - swing.excess(friction)
            if swing.stayed:
                shown.keep(swing)
                kept.append(repeat)
                if shown.quiet < COARSE_PATIENCE or len(kept) == self.sets:
                    continue
            elif swing.mute:
                unheard.append(repeat)
            else:
                lost.append(repeat)
                amplitude *= WEAKER
            yield Mark(CONDITIONING if swing.stayed else ABANDONED, repeat)
            if not self.torque_mode:
                sample = yield Command(sample.reference)
            sample, offset = yield from self._prepare_set(sample, amplitude, friction, shown)
        yield Mark(CONDITIONING)
        sample = yield from self._position_mode(sample)
        if shown.doubtful:
            yield from self._show_life(sample, shown)
        self._check_load(friction, shown)
        if not kept:
            raise NotEnoughExcitation(
                f"presliding: the axis left the region of ±{self.drift:.3g} round its rest in all {len(lost)} "
                f"tries, last with an excitation of {amplitude / WEAKER:.3g} round u0 = {offset:.4g}; look for "
                "vibration from outside, or play it in closed loop (torque_mode=False)"
            )
        return PreslidingResult(tuple(kept), (*lost, *unheard), amplitude, offset, friction)

    def _prepare_set(self, sample: Sample, amplitude: float, friction: float, shown: _Shown) -> Walk:
        """Relaxes in position mode, finds u₀, and tries it out in torque mode; again, where the encoder was silent."""
        while True:
            sample, offset = yield from self._relax(sample)
            shown.moved(offset)
            if not self.torque_mode:
                return sample, offset
            sample = yield Switch(Mode.TORQUE, offset)
            trial = self._signal(amplitude)[: self.motion.samples(TRIAL_SECONDS)]
            for _ in range(0 if shown.coarse and shown.gave else TRIALS):  # whose trials would tell nothing
                swing = yield from self._excite(sample, offset, trial, shown)
                sample, offset = swing.sample, offset - swing.excess(friction)
                if swing.mute:
                    break
            else:
                return sample, offset

    def _relax(self, sample: Sample) -> Walk:
        """Brings the friction state to zero in position mode; the torque that holds the axis then."""
        sample = yield from self._position_mode(sample)
        yield Mark(CONDITIONING)
        yield from approach(self.motion, sample.reference)
        plan, weights = self.relaxing
        offset = 0.0
        for reference, weight in zip(plan.reference.tolist(), weights, strict=True):
            sample = yield Command(reference)
            offset += weight * sample.torque_command
        return sample, offset

    def _check_load(self, friction: float, shown: _Shown) -> None:
        """All sets stayed round one u₀, or they are of different axes.

        Raises:
            NotEnoughExcitation: another load.
        """
        least, most = min(shown.offsets, default=0.0), max(shown.offsets, default=0.0)
        allowed = SAME_LOAD * friction + OFFSET_NOISE * self.motion.torque
        if most - least > allowed:
            raise NotEnoughExcitation(
                f"presliding: the torque that holds the axis here was {least:.4g} for one set and {most:.4g} for "
                f"another, but no more than {allowed:.3g} may lie between them: something leans on the axis or was "
                "put on it, or encoder and torque have both turned round; make sure that it is free, and play it again"
            )

    def _show_life(self, sample: Sample, shown: _Shown) -> Generator[Item, Sample, None]:
        """An encoder that told nothing of a set is coarse or dead: the guard sees which, as it moves; u₀ after it."""
        yield from approach(self.motion, sample.reference)
        yield from self.survey.play()
        if not shown.coarse:  # whose sets never give way alike, and whose load was looked at on the way
            _, offset = yield from self._relax(sample._replace(reference=self.motion.centre))
            shown.offsets.append(offset)

    def _position_mode(self, sample: Sample) -> Generator[Item, Sample, Sample]:
        return (yield Switch(Mode.POSITION, 0.0)) if self.torque_mode else sample

    def _command(self, reference: float, offset: float, value: float) -> Command:
        if self.torque_mode:
            return Command(0.0, 0.0, offset + value, 0.0)
        return Command(reference, 0.0, 0.0, value)

    def _excite(
        self, sample: Sample, offset: float, signal: Floats, shown: _Shown
    ) -> Generator[Item, Sample, _Swing]:
        """Plays `signal` round u₀, or round the reference held; ends where the axis drifts away or is silent."""
        home, reference, drift, period = sample.position, sample.reference, self.drift, self.motion.period
        before, travel, longest, product = home, 0.0, 0.0, 0.0
        began, patience = shown.quiet, shown.patience
        for value in signal.tolist():
            sample = yield self._command(reference, offset, value)
            position = sample.position
            product += value * (position - home)
            if position == before:
                shown.quiet += period
                longest = max(longest, shown.quiet - began)
                if shown.quiet > patience:
                    return _Swing(sample, position - home, travel, False, longest, mute=True)
                continue
            shown.quiet = began = 0.0
            travel += abs(position - before)
            before = position
            if abs(position - home) > drift:
                return _Swing(sample, position - home, travel, False, 0.0)
        gave = product / float(signal @ signal)
        return _Swing(sample, before - home, travel, True, longest, gave)

    def prepare(self) -> None:
        """The excitation takes a third of a second to design: longer than a powered axis may wait."""
        unit_excitation(self.motion.period)
        _ = self.survey, self.relaxing

    def _signal(self, amplitude: float) -> Floats:
        return amplitude * unit_excitation(self.motion.period)

    @cached_property
    def relaxing(self) -> tuple[Plan, list[float]]:
        """A decaying sine round the centre, and the weights with which its last cycles' torque is averaged."""
        motion = self.motion
        amplitude = 0.75 * motion.amplitude
        smallest = min(2.0 * motion.resolution, 0.1 * amplitude)
        possible = min(motion.speed / amplitude, math.sqrt(motion.acceleration / amplitude)) / (2.0 * math.pi)
        frequency = min(max(4.0 * motion.frequency, 2.0), 0.9 * possible)
        fastest = max(frequency, min(RELAX_FASTEST, 0.02 / motion.period))
        fall = decaying_sine(amplitude, smallest, RELAX_CYCLES, frequency, fastest, motion.period)
        plan = Path(motion, motion.centre).add(motion.centre + fall).dwell(HOLD_SECONDS).plan()
        weights = np.zeros(len(plan.reference))
        window = np.hanning(round(MEAN_CYCLES / fastest / motion.period))  # parts of cycles count little
        weights[len(fall) - len(window) : len(fall)] = window / window.sum()
        return plan, weights.tolist()

    @cached_property
    def survey(self) -> Plan:
        """Slowly forth and back round the centre."""
        path, centre = Path(self.motion, self.motion.centre), self.motion.centre
        reach, speed = 0.5 * self.motion.amplitude, SURVEY_SPEED * self.motion.usual_speed
        path.move(centre - reach).dwell(0.1)
        return path.move(centre + reach, speed=speed).move(centre - reach, speed=speed).move(centre).plan()

    def _measure_friction(self, sample: Sample) -> Walk:
        """Half the difference of the median torques of a slow move in both directions."""
        yield from approach(self.motion, sample.reference)
        plan = self.survey
        slow = SURVEY_SPEED * self.motion.usual_speed
        torque: dict[bool, list[float]] = {True: [], False: []}
        for reference, velocity in zip(plan.reference.tolist(), plan.velocity.tolist(), strict=True):
            sample = yield Command(reference)
            if 0.95 * slow < abs(velocity) < 1.05 * slow:
                torque[velocity > 0.0].append(sample.torque_command)
        up, down = (float(np.median(torque[sign])) for sign in (True, False))
        if not up > down:
            raise NotEnoughExcitation(
                f"presliding: the torque of a slow move is {up:.4g} upwards and {down:.4g} downwards, so there "
                "is no friction to excite; check the sign of the torque, or leave this experiment out"
            )
        return sample, 0.5 * (up - down)


@lru_cache(maxsize=8)
def unit_excitation(period: float) -> Floats:
    """A multisine of whole periods in one set, log-spaced lines of equal size, peak 1; do not change it."""
    fastest = min(FASTEST, NYQUIST_PART / period)
    lines = np.unique(np.round(np.geomspace(SLOWEST, fastest, LINES) * SET_SECONDS)) / SET_SECONDS
    samples = max(round(SET_SECONDS / period), 1)
    rng = np.random.default_rng(0)  # the same signal in every set and every run: sets can be compared
    signal = multisine(lines, np.ones(len(lines)), samples, period, rng)
    return np.asarray(signal / np.abs(signal).max(), dtype=np.float64)
