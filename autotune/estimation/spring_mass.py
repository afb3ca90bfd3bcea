"""The linear system of small displacements: J·q'' + σ·q' + σ0·q = u (3.46), sampled with a held input.

Between the physical parameters and the difference equation
y(k) = −a1·y(k−1) − a2·y(k−2) + b1·u(k−1) + b2·u(k−2) (ARX, (3.48)).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from autotune.core.arrays import Floats


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
        result = expm(whole * period)
        return np.asarray(result[:2, :2]), np.asarray(result[:2, 2])

    def respond(self, torque: Floats, period: float) -> Floats:
        """Displacement of an axis at rest before the first sample, shape (n,)."""
        denominator, numerator = self.coefficients(period)
        return np.asarray(lfilter(numerator, denominator, torque))

    def free(self, count: int, period: float) -> Floats:
        """Two decaying motions without input, shape (2, count): from displacement 1, and from a push."""
        denominator, _ = self.coefficients(period)
        push = np.zeros(count)
        push[0] = 1.0
        swing = np.asarray(lfilter([1.0], denominator, push))
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
