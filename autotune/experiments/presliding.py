"""Small displacements (section 3.4.3): a PRBS far below break-away, from a relaxed friction state.

First the friction state is brought to zero by a decaying sine, then u(t) = u₀ + u_s(t) with
|u_s| < 0.1·min(F_c, F_s) is played. In torque mode the loop is open; a drive without one gets u_s as
torque offset round a constant reference, and what counts is the total torque demand. An axis that
leaves the region round z = 0 is relaxed again and excited more weakly. Two experiments, since a mode
is changed at rest only: `Relax` walks in position mode, `Presliding` measures.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from autotune.core.axis import Limits
from autotune.core.drive import Command, Mode, Sample
from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.core.recording import Floats
from autotune.experiments.experiment import Experiment, Needs, Planned
from autotune.experiments.path import TRANSITION, Mark, Motion, Path, Steps
from autotune.signals.excitation import decaying_sine, prbs

LABEL = "presliding"
EXCITATION = 0.09  # of the friction level; the thesis: below 0.1
BITS, SET_SECONDS = 10, 3.0
RELAX_CYCLES = 14
WIPE, WIPE_CYCLES, WIPE_SECONDS = 0.5, 10, 1.5
HOLD_SECONDS = 0.4
DRIFT = 0.015  # of the user's amplitude
LEAST_COUNTS = 25
SURVEY_SPEED = 0.2  # of the user's peak speed
TRIES = 3
WEAKER = 0.7
HOLDABLE = 0.8  # of the friction level: an offset beyond would slide in torque mode

Walk = Generator[Command | Mark, Sample, Sample]


@dataclass(frozen=True)
class Relax(Planned):
    """Decaying sine in position mode, from `amplitude` down to `smallest`: leaves z near zero."""

    amplitude: float
    smallest: float
    frequency: float

    @property
    def name(self) -> str:
        return "relax"

    def trace(self, path: Path) -> None:
        path.move(self.motion.centre)
        samples = self.motion.samples(RELAX_CYCLES / self.frequency)
        path.add(self.motion.centre + decaying_sine(self.amplitude, self.smallest, RELAX_CYCLES, samples))
        path.dwell(HOLD_SECONDS)


def relax(motion: Motion) -> Relax:
    """Starts at three quarters of the user's amplitude, ends at two counts of the sensor."""
    amplitude = 0.75 * motion.amplitude
    fastest = min(
        motion.speed / (2 * math.pi * amplitude), math.sqrt(motion.acceleration / amplitude) / (2 * math.pi)
    )
    frequency = min(max(4.0 * motion.frequency, 2.0), 0.9 * fastest)
    return Relax(motion, amplitude, min(2.0 * motion.resolution, 0.1 * amplitude), frequency)


@dataclass(frozen=True)
class PreslidingResult:
    """What became of the sets: `kept` are the repeats that stayed in presliding.

    `amplitude` is the one used last, `offset` and `friction` what was used as u₀ and level [N m or N].
    """

    kept: tuple[int, ...]
    restarts: int
    amplitude: float
    offset: float
    friction: float


@dataclass(frozen=True)
class Presliding(Experiment):
    """Sets of one PRBS period each; repeat k of label `presliding` is set k.

    Attributes:
        friction: estimate of min(F_c, F_s) [N m or N]; None measures it first (closed loop only).
        offset: u₀, the torque that carries gravity [N m or N]; None as above.
        sets: PRBS periods played.
        drift: distance from where a set began at which it is given up [rad or m].
        open_loop: torque mode; otherwise the excitation rides on a position held.
    """

    friction: float | None
    offset: float | None
    drift: float
    sets: int = 4
    open_loop: bool = True

    def __post_init__(self) -> None:
        if not self.open_loop:
            return
        if self.friction is None or self.offset is None:
            raise ConfigurationError(
                "presliding in torque mode needs the friction level and the offset torque; play "
                "'steady-state' first and pass its result, or use the closed loop (open_loop=False), which "
                "measures both"
            )
        if abs(self.offset) > HOLDABLE * self.friction:
            raise ConfigurationError(
                f"presliding in torque mode: the offset torque {self.offset:.4g} is not held by a friction "
                f"of {self.friction:.4g}, the axis would slide; use the closed loop (open_loop=False)"
            )

    @property
    def name(self) -> str:
        return LABEL

    @property
    def mode(self) -> Mode:
        return Mode.TORQUE if self.open_loop else Mode.POSITION

    @property
    def idle_torque(self) -> float:
        return (self.offset or 0.0) if self.open_loop else 0.0

    @property
    def labels(self) -> tuple[str, ...]:
        return (TRANSITION, LABEL)

    @property
    def duration(self) -> float:
        """Without restarts."""
        measuring = 0.0 if self.friction is not None else self._survey(self.motion.centre).plan().duration
        wiping = WIPE_SECONDS if self.open_loop else 0.0
        return measuring + wiping + 2 * HOLD_SECONDS + self.sets * len(self._signal(1.0)) * self.motion.period

    def needs(self, limits: Limits) -> Needs:
        level, offset = self.friction or 0.0, self.offset or 0.0
        reach = self.drift if self.friction is not None else self.motion.amplitude
        # once drift is seen, the axis is caught by friction alone: keep a wide berth in torque mode
        margin = 4.0 * reach
        return Needs(
            self.motion.centre - margin,
            self.motion.centre + margin,
            self.motion.usual_speed if self.friction is None else 0.0,
            self.motion.acceleration if self.friction is None else 0.0,
            abs(offset) + WIPE * level,
        )

    def run(self, start: Sample) -> Steps:
        sample = yield Mark(TRANSITION)
        friction, offset = self.friction, self.offset
        if friction is None or offset is None:
            sample, friction, offset = yield from self._measure(sample)
        hold = Command(sample.reference, 0.0, offset, 0.0)
        return (yield from self._sets(sample, hold, friction))

    def _sets(self, sample: Sample, hold: Command, friction: float) -> Steps:
        amplitude, restarts = EXCITATION * friction, 0
        kept: list[int] = []
        repeat = -1
        sample = yield from self._relax(sample, hold, friction)
        while len(kept) < self.sets and restarts <= TRIES:
            repeat += 1
            yield Mark(LABEL, repeat)
            sample, stayed = yield from self._excite(sample, hold, self._signal(amplitude), self.drift)
            yield Mark(TRANSITION)
            if stayed:
                kept.append(repeat)
                continue
            restarts += 1
            amplitude *= WEAKER
            sample = yield from self._relax(sample, hold, friction)
        if not kept:
            raise NotEnoughExcitation(
                f"presliding: the axis left the region of ±{self.drift:.3g} round its rest {restarts} times, "
                f"last with an excitation of {amplitude / WEAKER:.3g} round u0 = {hold.torque:.4g}; measure "
                "the steady state again (friction level or offset must be wrong), or use the closed loop"
            )
        return PreslidingResult(tuple(kept), restarts, amplitude, hold.torque, friction)

    def _relax(self, sample: Sample, hold: Command, friction: float) -> Walk:
        """Holds still; in the open loop wipes the friction's memory with ever smaller loops first."""
        calm = np.zeros(self.motion.samples(HOLD_SECONDS))
        sample, _ = yield from self._excite(sample, hold, calm, math.inf)
        if not self.open_loop:
            return sample
        samples = self.motion.samples(WIPE_SECONDS)
        level = WIPE * friction
        for _ in range(TRIES + 1):
            wipe = decaying_sine(level, 0.02 * level, WIPE_CYCLES, samples)
            sample, stayed = yield from self._excite(sample, hold, wipe, 5.0 * self.drift)
            if stayed:
                break
            level *= WEAKER
        sample, _ = yield from self._excite(sample, hold, calm, math.inf)
        return sample

    def _excite(
        self, sample: Sample, hold: Command, signal: Floats, drift: float
    ) -> Generator[Command | Mark, Sample, tuple[Sample, bool]]:
        """Plays `signal` on the torque round `hold`; stops where the axis drifts away."""
        home = sample.position
        reference, _, offset, _ = hold
        for value in signal.tolist():
            if self.open_loop:
                sample = yield Command(0.0, 0.0, offset + value, 0.0)
            else:
                sample = yield Command(reference, 0.0, 0.0, value)
            if abs(sample.position - home) > drift:
                return sample, False
        return sample, True

    def _signal(self, amplitude: float) -> Floats:
        hold = max(round(SET_SECONDS / self.motion.period / (2**BITS - 1)), 1)
        return prbs(BITS, hold, amplitude)

    def _survey(self, start: float) -> Path:
        """To the centre, slowly forth and back, then a decaying sine."""
        path, whole, centre = Path(self.motion, start), relax(self.motion), self.motion.centre
        reach, speed = 0.5 * self.motion.amplitude, SURVEY_SPEED * self.motion.usual_speed
        path.move(centre).move(centre - reach).dwell(0.1)
        path.move(centre + reach, speed=speed).move(centre - reach, speed=speed).move(centre)
        samples = self.motion.samples(RELAX_CYCLES / whole.frequency)
        return path.add(centre + decaying_sine(whole.amplitude, whole.smallest, RELAX_CYCLES, samples))

    def _measure(self, sample: Sample) -> Generator[Command | Mark, Sample, tuple[Sample, float, float]]:
        """Friction level and offset from the torque of a slow move in both directions."""
        plan = self._survey(sample.reference).plan()
        slow = SURVEY_SPEED * self.motion.usual_speed
        torque: dict[bool, list[float]] = {True: [], False: []}
        for reference, velocity in zip(plan.reference.tolist(), plan.velocity.tolist(), strict=True):
            sample = yield Command(reference)
            if 0.95 * slow < abs(velocity) < 1.05 * slow:
                torque[velocity > 0.0].append(sample.torque_command)
        up, down = (float(np.median(torque[sign])) for sign in (True, False))
        friction, offset = 0.5 * (up - down), 0.5 * (up + down)
        if not friction > 0.0:
            raise NotEnoughExcitation(
                f"presliding: the torque of a slow move is {up:.4g} upwards and {down:.4g} downwards, so "
                "there is no friction to excite; check the sign of the torque, or leave this experiment out"
            )
        return sample, friction, offset


def presliding(
    motion: Motion,
    friction: float | None = None,
    offset: float | None = None,
    open_loop: bool = True,
    sets: int = 4,
) -> tuple[Experiment, ...]:
    """Relax in position mode, then measure; about 20 s with four sets.

    Raises:
        ConfigurationError: torque mode without the estimates it needs, or one in which the axis slides.
    """
    drift = max(LEAST_COUNTS * motion.resolution, DRIFT * motion.amplitude)
    measure = Presliding(motion, friction, offset, drift, sets, open_loop)
    return (measure,) if friction is None else (relax(motion), measure)
