"""Adaptive LuGre feedforward, section 5.1.4: the PID's torque says where the feedforward is wrong.

    dF_g/dt = α_g u_PID          (5.14)
    dσ0/dt  = α_0 u_PID ż        (5.15)
    dF_c/dt = α_c u_PID sign z   (5.16)

The gains are given without dimension, so that one set serves axes of every size and benchmarks of every
frequency ω: what a period adds is to be a share of the parameter. Over a period of T = 2π/ω, (5.14) and
(5.16) add α·T·u to a torque, so α_g = offset·ω and α_c = coulomb·ω [1/s]. In (5.15) ż brings its own 1/s:
a reversal adds α_0·∫u ż dt = α_0·∫u dz ≈ 2·α_0·u·x_s, whatever it takes, and x_s = F_c/σ0. That is a
share of σ0 where α_0 = stiffness/x_s² [1/rad²], with the x_s of the moment: of σ0 it adds 2·stiffness·u/F_c.
F_s keeps its ratio to F_c, and σ1 its ratio to σ0: damping belongs to its spring. A σ1 that stays behind as
σ0 falls acts over a longer reach: at 5 Hz it takes up more torque than friction itself.

The thesis's own gains at 1 Hz (Table 6.3) correspond to 0.0016, 0.016 and 0.009 (x_s = 9.39 mrad); here
they are larger, as the end is found instead of waited for.

Gates, so that a wrong sign or a stuck axis can do no harm: bounds; the first period fades in and the
second is the yardstick, both without adaptation; adaptation freezes, at the best parameters so far, when
the PID's torque grows; and without enough excitation (the friction state never saturates) nothing is said
to be valid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.control.feedforward import LugreParameters, advance
from autotune.core.arrays import Floats
from autotune.core.drive import Sample
from autotune.core.errors import ConfigurationError
from autotune.models.compiled import compiled

HISTORY_SECONDS = 0.05
YARDSTICK = 1  # index of the period that u_PID is compared with; the one before it fades in
SETTLED_PERIODS = 6
SETTLED_DRIFT = 0.01
SETTLED_OFFSET = 0.005
GROWTH = 1.5
NO_GAIN = 1.05  # u_PID at rest over u_PID at the start; periods of one setting scatter by 0.5 to 3 %
LEAST_SATURATION = 0.2
BOUND_MARGIN = 0.02


@dataclass(frozen=True, slots=True)
class AdaptationGains:
    """Dimensionless gains; see the module's docstring."""

    offset: float = 0.05
    stiffness: float = 0.19
    coulomb: float = 0.15


@dataclass(frozen=True, slots=True)
class Bounds:
    """Allowed (low, high) of each adapted parameter; SI."""

    stiffness: tuple[float, float]
    coulomb: tuple[float, float]
    offset: tuple[float, float]

    @classmethod
    def around(cls, start: LugreParameters, stiffness: tuple[float, float] | None = None) -> Bounds:
        """A factor of 4 in stiffness, 2 in Coulomb torque, half the Coulomb torque for the offset."""
        low, high = stiffness or (start.stiffness / 4.0, start.stiffness * 4.0)
        return cls(
            (low, high),
            (start.coulomb / 2.0, start.coulomb * 2.0),
            (start.offset - start.coulomb / 2.0, start.offset + start.coulomb / 2.0),
        )

    def arrays(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds in the order stiffness, coulomb, offset; shape (3,) each."""
        pairs = np.array([self.stiffness, self.coulomb, self.offset])
        return pairs[:, 0].copy(), pairs[:, 1].copy()


@dataclass(frozen=True, slots=True)
class AdaptationResult:
    """What adaptation found.

    Attributes:
        parameters: mean over the last settled periods, or the best period where it froze.
        settled: the parameters have come to rest.
        frozen: adaptation was stopped because u_PID grew.
        valid: settled, excited, and no bound was hit.
        reason: in words.
        time, history: [s], (n,) and (n, 3): stiffness, coulomb, offset as they went.
        feedback_rms: u_PID of each whole period [N m].
    """

    parameters: LugreParameters
    settled: bool
    frozen: bool
    valid: bool
    reason: str
    time: Floats
    history: Floats
    feedback_rms: Floats


@compiled
def _adapt(
    p: Floats, state: Floats, gains: Floats, low: Floats, high: Floats, feedback: float, period: float
) -> None:
    """One step of (5.14)–(5.16) within bounds; `p` is updated, F_s keeps its ratio to F_c, σ1 to σ0."""
    ratio = p[6] / p[2]
    reach = p[2] / p[3]
    z_sign = 0.0 if state[0] == 0.0 else math.copysign(1.0, state[0])
    stiffness = p[3] + period * gains[0] / reach**2 * feedback * state[1]
    coulomb = p[2] + period * gains[1] * feedback * z_sign
    offset = p[5] + period * gains[2] * feedback
    relaxation = p[4] / p[3]
    p[3] = min(max(stiffness, low[0]), high[0])
    p[4] = relaxation * p[3]
    p[2] = min(max(coulomb, low[1]), high[1])
    p[5] = min(max(offset, low[2]), high[2])
    p[6] = p[2] * ratio


class AdaptiveFeedforward:
    """The thesis's adaptation laws as a feedforward law; see `result` for what it found."""

    def __init__(
        self,
        start: LugreParameters,
        bounds: Bounds,
        frequency: float,
        period: float,
        gains: AdaptationGains | None = None,
        least_periods: int = 15,
    ) -> None:
        if frequency <= 0 or period <= 0:
            raise ConfigurationError(f"frequency {frequency} Hz and period {period} s must be above 0")
        gains = gains or AdaptationGains()
        omega = 2.0 * math.pi * frequency
        self._gains = np.array([gains.stiffness, gains.coulomb * omega, gains.offset * omega])
        self._low, self._high = bounds.arrays()
        self._p = start.array()
        self._period = period
        self._samples = max(round(1.0 / (frequency * period)), 2)
        self._least = least_periods
        self._state = np.zeros(2)
        self._sums = np.zeros(5)
        self._count = 0
        self._step = 0
        self._periods: list[Floats] = []
        self._history: list[tuple[float, float, float, float]] = []
        self._every = max(round(HISTORY_SECONDS / period), 1)
        self._settled = False
        self._frozen = False

    @property
    def settled(self) -> bool:
        """The parameters have come to rest, or adaptation was frozen."""
        return self._settled or self._frozen

    def present(self) -> Floats:
        """Stiffness, Coulomb torque and offset as they are now, shape (3,)."""
        return self._p[[3, 2, 5]].copy()

    def prepare(self) -> None:
        """Compiles the kernels without changing the state."""
        p = self._p.copy()
        advance(p, np.zeros(2), 0.0, 0.0, self._period)
        _adapt(p, np.zeros(2), self._gains, self._low, self._high, 0.0, self._period)

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        """Adapts from the previous sample, then gives the torque for this reference."""
        if previous is not None and not self.settled:
            self._learn(previous.torque_feedback)
        return float(advance(self._p, self._state, velocity, acceleration, self._period))

    def _learn(self, feedback: float) -> None:
        if len(self._periods) > YARDSTICK:
            _adapt(self._p, self._state, self._gains, self._low, self._high, feedback, self._period)
        p, sums = self._p, self._sums
        sums[0] += p[3]
        sums[1] += p[2]
        sums[2] += p[5]
        sums[3] += feedback * feedback
        sums[4] += abs(self._state[0]) * p[3] > 0.9 * p[2]
        self._count += 1
        if self._step % self._every == 0:
            self._history.append((self._step * self._period, p[3], p[2], p[5]))
        self._step += 1
        if self._count == self._samples:
            self._close_period()

    def _close_period(self) -> None:
        means = self._sums / self._count
        means[3] = math.sqrt(means[3])
        self._periods.append(means)
        self._sums[:] = 0.0
        self._count = 0
        at_rest = len(self._periods) >= self._least and self._at_rest()
        if self._has_grown() or (at_rest and self._gained_nothing()):
            self._frozen = True
            best = min(self._periods[YARDSTICK:], key=lambda period: float(period[3]))
            self._p = LugreParameters.from_array(self._p).with_friction(*best[:3]).array()
            return
        self._settled = at_rest

    def _feedback(self) -> Floats:
        """u_PID of the periods that can be compared with each other, rms [N m]."""
        return np.array([float(period[3]) for period in self._periods[YARDSTICK:]])

    def _has_grown(self) -> bool:
        rms = self._feedback()
        return len(rms) > 2 and bool(np.min(rms[-2:]) > GROWTH * np.min(rms))

    def _gained_nothing(self) -> bool:
        """The laws came to rest where u_PID is larger than at the start: they followed something else."""
        rms = self._feedback()
        return bool(np.mean(rms[-SETTLED_PERIODS:]) > NO_GAIN * rms[0])

    def _at_rest(self) -> bool:
        """Compares the halves of the last periods: less than 1 % apart (offset: 0.5 % of Coulomb)."""
        recent = np.array(self._periods[-SETTLED_PERIODS:])[:, :3]
        half = SETTLED_PERIODS // 2
        drift = np.abs(recent[half:].mean(axis=0) - recent[:half].mean(axis=0))
        scale = np.array([recent[:, 0].mean(), recent[:, 1].mean(), recent[:, 1].mean()])
        return bool(np.all(drift < np.array([SETTLED_DRIFT, SETTLED_DRIFT, SETTLED_OFFSET]) * scale))

    def result(self) -> AdaptationResult:
        """What was found so far; a query."""
        periods = np.array(self._periods) if self._periods else np.zeros((0, 5))
        history = np.array(self._history) if self._history else np.zeros((0, 4))
        current = LugreParameters.from_array(self._p)
        if len(periods) >= SETTLED_PERIODS and not self._frozen:
            current = current.with_friction(*periods[-SETTLED_PERIODS:, :3].mean(axis=0))
        reason = self._reason(current, periods)
        return AdaptationResult(
            parameters=current,
            settled=self._settled,
            frozen=self._frozen,
            valid=not reason,
            reason=reason or f"settled after {len(periods)} periods",
            time=history[:, 0],
            history=history[:, 1:],
            feedback_rms=periods[:, 3],
        )

    def _reason(self, current: LugreParameters, periods: Floats) -> str:
        """Why the result is not valid; empty where it is."""
        saturated = len(periods) > 0 and periods[-SETTLED_PERIODS:, 4].mean() >= LEAST_SATURATION
        small = "the sine is too small: friction never saturates; raise benchmark.amplitude"
        if self._frozen:
            rms = self._feedback()
            return (
                f"frozen after {len(periods)} periods: the controller's torque grew during adaptation, from "
                f"{rms.min():.3g} to {rms[-1]:.3g} rms; the best period is kept"
            ) + ("" if saturated else f"; {small}")
        if len(periods) < SETTLED_PERIODS:
            return f"only {len(periods)} whole periods were played; at least {SETTLED_PERIODS} are needed"
        if not saturated:
            return small
        values = np.array([current.stiffness, current.coulomb, current.offset])
        names = ("stiffness", "coulomb", "offset")
        margin = BOUND_MARGIN * (self._high - self._low)
        hit = [
            n
            for n, v, lo, hi, m in zip(names, values, self._low, self._high, margin, strict=True)
            if not lo + m < v < hi - m
        ]
        if hit:
            return f"{', '.join(hit)} ran into a bound round the identified value"
        return "" if self._settled else f"not settled after {len(periods)} periods"
