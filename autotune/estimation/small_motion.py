"""Small displacements: the linear system J·q'' + σ·q' + σ0·q = u (3.46), and pieces of a recording summed up by it.

Sampled with a held input it is the difference equation
y(k) = −a1·y(k−1) − a2·y(k−2) + b1·u(k−1) + b2·u(k−2) (ARX, (3.48)).

Pieces that never leave presliding in torque mode show the inverse routine little but encoder steps. This system,
fitted by its one-step prediction error, uses all that their motion tells; but the bristle is no linear spring: it
looks softer and more damped, the more so as noise shakes it. So the same fit is made to the twin, and the model's
parameters are right where twin and measurement give the same three numbers (indirect inference: Gouriéroux,
Monfort, Renault 1993).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.estimation.least_squares import Free
from autotune.estimation.pieces import Piece, Surroundings
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.reversal_memory import DAMPING, REMEMBERS, memory_stiffness
from autotune.signals.normal_equations import Part


@dataclass(frozen=True, slots=True)
class SpringMass:
    """inertia J [kg m²], damping σ1 + σ2 [N m s/rad], stiffness σ0 [N m/rad]."""

    inertia: float
    damping: float
    stiffness: float

    def coefficients(self, period: float) -> tuple[Floats, Floats]:
        """Denominator (1, a1, a2) and numerator (0, b1, b2) for an input held over each period.

        The exact step response gives the numerator: poles e^{s·h} as always, and the two b from the
        response after one period and from the static gain.
        """
        first, second = self._poles()
        one, two = cmath.exp(first * period), cmath.exp(second * period)
        a1, a2 = -(one + two).real, (one * two).real
        if abs(first - second) < 1e-6 * abs(first):
            step = 1.0 - (cmath.exp(first * period) * (1.0 - first * period)).real
        else:
            step = 1.0 - ((first * two - second * one) / (first - second)).real
        b1 = step / self.stiffness
        b2 = (1.0 + a1 + a2) / self.stiffness - b1
        return np.array([1.0, a1, a2]), np.array([0.0, b1, b2])

    def state_space(self, period: float) -> tuple[Floats, Floats]:
        """Transition over a period, shape (2, 2), of position and velocity, and what a held torque adds."""
        whole = np.zeros((3, 3))
        whole[0, 1] = 1.0
        whole[1] = np.array([-self.stiffness, -self.damping, 1.0]) / self.inertia
        result = scipy.linalg.expm(whole * period)
        return np.asarray(result[:2, :2]), np.asarray(result[:2, 2])

    def respond(self, torque: Floats, period: float) -> Floats:
        """Displacement of an axis at rest before the first sample, shape (n,)."""
        denominator, numerator = self.coefficients(period)
        return np.asarray(scipy.signal.lfilter(numerator, denominator, torque))

    def free(self, count: int, period: float) -> Floats:
        """Two decaying motions without input, shape (2, count): from displacement 1, and from a push."""
        denominator, _ = self.coefficients(period)
        push = np.zeros(count)
        push[0] = 1.0
        swing = np.asarray(scipy.signal.lfilter([1.0], denominator, push))
        return np.stack([swing, np.concatenate([[0.0], swing[:-1]])])

    def _poles(self) -> tuple[complex, complex]:
        half = self.damping / (2.0 * self.inertia)
        root = cmath.sqrt(half * half - self.stiffness / self.inertia)
        return -half + root, -half - root


def from_difference(a1: float, a2: float, b1: float, b2: float, period: float) -> SpringMass | None:
    """Physical parameters of a difference equation; None where it is no spring-mass system.

    Poles by the logarithm, stiffness by the static gain.
    """
    gain = (b1 + b2) / (1.0 + a1 + a2) if 1.0 + a1 + a2 != 0 else math.nan
    roots = np.roots([1.0, a1, a2])
    if not gain > 0 or np.any(np.abs(roots) >= 1.0) or np.any((roots.imag == 0) & (roots.real <= 0)):
        return None
    poles = np.log(roots.astype(complex)) / period
    stiffness = 1.0 / gain
    inertia = stiffness / float((poles[0] * poles[1]).real)
    return SpringMass(inertia, -inertia * float((poles[0] + poles[1]).real), stiffness)


SET_SECONDS = 3.0
_ITERATIONS = 4
_DIFFERENCE = 1e-4
_LARGEST = 0.5


def suits(piece: Piece, around: Surroundings) -> bool:
    """Whether a piece is to be summed up like this; the noises must be known."""
    excited = bool(np.ptp(piece.torque) > 0) and len(piece) * piece.period > 1.0
    return piece.sticks and not piece.closed and excited and around.process_noise > 0.0


def small_motion(
    piece: Piece,
    twins: list[Piece],
    packed: Packed,
    around: Surroundings,
    free: Sequence[Free],
) -> list[Part]:
    """One part a set: the three numbers, measured less twins, in units of their standard error."""
    system = linear_system(packed)
    predictor = noise_polynomial(system, piece, around)
    binding = _binding(system, free)
    sets = max(1, round(len(piece) * piece.period / SET_SECONDS))
    parts = []
    for rows in np.array_split(np.arange(len(piece)), sets):
        where = slice(int(rows[0]), int(rows[-1]) + 1)
        unknown = left_by_start(len(rows), predictor)
        measured = fit_set(piece, where, system, predictor, unknown)
        simulated = [fit_set(twin, where, system, predictor, unknown) for twin in twins]
        found = [one[0] for one in simulated if one is not None]
        if measured is None or not found:
            continue
        error = np.mean(found, axis=0) - measured[0]
        root = measured[1] / np.sqrt(1.0 + 1.0 / len(found))
        columns = root @ binding
        parts.append(Part(root @ error, columns, columns, 3, 1.0))
    return parts


def linear_system(packed: Packed) -> SpringMass:
    """The spring-mass system that a model is for infinitely small motion."""
    p = packed.p
    stiffness, damping = float(p[layout.STIFFNESS]), float(p[layout.MICRO_DAMPING] + p[layout.VISCOUS])
    if packed.on[REMEMBERS]:
        stiffness, damping = stiffness + memory_stiffness(p), damping + float(p[DAMPING])
    return SpringMass(float(p[layout.INERTIA]), max(damping, 1e-9 * float(p[layout.INERTIA])), stiffness)


def noise_polynomial(system: SpringMass, piece: Piece, around: Surroundings) -> Floats:
    """C of the predictor: how the stationary Kalman filter forgets, shape (3,).

    Its noises are those of the twin: a torque that changes every sample, and the quantiser.
    """
    transition, entry = system.state_space(piece.period)
    reading = around.resolution**2 / 12.0 + around.position_noise**2
    reading = max(reading, 1e-6 * float(np.var(piece.measured)), 1e-30)
    scale = np.array([1.0, np.sqrt(system.stiffness / system.inertia)]) * np.sqrt(reading)
    scaled = transition * scale / scale[:, None]
    noise = np.outer(entry / scale, entry / scale) * around.process_noise**2
    try:
        covariance = scipy.linalg.solve_discrete_are(scaled.T, np.array([[1.0], [0.0]]), noise, np.eye(1))
    except np.linalg.LinAlgError:
        return np.array([1.0, 0.0, 0.0])
    gain = covariance[:, 0] / (covariance[0, 0] + 1.0)
    return np.asarray(np.poly(scaled @ (np.eye(2) - np.outer(gain, [1.0, 0.0]))).real)


def left_by_start(count: int, predictor: Floats) -> Floats:
    """Offset, drift and what the start leaves behind in prediction errors: an orthonormal basis, shape (count, 4)."""
    pulse = np.zeros(count)
    pulse[0] = 1.0
    start = np.asarray(scipy.signal.lfilter([1.0], predictor, pulse))
    late = np.concatenate([[0.0], start[:-1]])
    return np.linalg.qr(np.column_stack([np.ones(count), np.linspace(-1.0, 1.0, count), start, late]))[0]


def fit_set(
    piece: Piece, where: slice, start: SpringMass, predictor: Floats, unknown: Floats
) -> tuple[Floats, Floats] | None:
    """Logarithms of inertia, damping and stiffness, shape (3,), and the root of their information.

    None where the fit runs away. `unknown` is what `left_by_start` gives for so many rows.
    """
    torque, position = piece.torque[where], piece.measured[where]
    torque, position = torque - torque.mean(), position - position.mean()
    begin = np.log([start.inertia, start.damping, start.stiffness])
    x, columns, error = begin.copy(), np.empty((len(torque), 3)), np.empty(0)
    for _ in range(_ITERATIONS):
        error = _prediction_error(x, torque, position, piece.period, predictor, unknown)
        for index in range(3):
            moved = x.copy()
            moved[index] += _DIFFERENCE
            other = _prediction_error(moved, torque, position, piece.period, predictor, unknown)
            columns[:, index] = (other - error) / _DIFFERENCE
        step = -np.linalg.lstsq(columns, error, rcond=None)[0]
        x = x + np.clip(step, -_LARGEST, _LARGEST)
        if not np.all(np.abs(x - begin) < 3.0):
            return None
    variance = float(error @ error) / max(len(error) - 8, 1)
    if variance <= 0.0:
        return None
    return x, np.asarray(np.linalg.qr(columns, mode="r") / np.sqrt(variance))


def _prediction_error(
    x: Floats, torque: Floats, position: Floats, period: float, predictor: Floats, unknown: Floats
) -> Floats:
    """A/C·y − B/C·u, less what is unknown of the set: offset, drift and what the start leaves behind."""
    system = SpringMass(*(float(value) for value in np.exp(x)))
    denominator, numerator = system.coefficients(period)
    error = scipy.signal.lfilter(denominator, predictor, position) - scipy.signal.lfilter(
        numerator, predictor, torque
    )
    return np.asarray(error - unknown @ (error @ unknown))


def _binding(system: SpringMass, free: Sequence[Free]) -> Floats:
    """How the three logarithms follow p/scale, shape (3, k): as in the linear system."""
    binding = np.zeros((3, len(free)))
    for index, parameter in enumerate(free):
        if parameter.name == "inertia":
            binding[0, index] = parameter.scale / system.inertia
        elif parameter.slot in (layout.MICRO_DAMPING, layout.VISCOUS, DAMPING):
            binding[1, index] = parameter.scale / system.damping
        elif parameter.name == "stiffness":
            binding[2, index] = parameter.scale / system.stiffness
    return binding
