"""Inertia from the small: what a controller's restlessness moves, in strokes that hardly accelerate.

A controller answers every count and every tight spot with a little torque. The second difference of positions
over 2m cycles is the mean of the acceleration under a triangle, the torque's mean under the same triangle belongs to
it, and the difference of both to m cycles earlier is free of friction, gravity and all else that changes slowly:

    Δ(q[k+m] − 2q[k] + q[k−m])/(mh)² = ΔT_Δ/J,    J = Σ ΔT_Δ·Δa / (Σ Δa² − n·20/12·count²/(mh)⁴)

The last term is what whole counts add to the sum of squares; where they are most of it, the longer of two triangles
is used, or none. On axes of which the inertia is known it was within a factor of two of it from the first second
on, mostly within 20 %. A loop so quiet that its torque shows nothing is `quiet`, which is knowledge too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TRIANGLES = (0.004, 0.008)  # s, m·h of each
LEAST_CYCLES = 4
BLOCK = 64  # times the shorter m, that are looked at together
FORGET = 0.9  # a block
BLOCKS = 4  # before a loop is called quiet
MOTION = 0.5  # of the sum of squares, that must not be counts
CORRELATED = 0.2
MOVING_COUNTS = 32.0  # in a block, below which nothing is looked at
QUIET = 0.01  # of limits.torque: root mean square of ΔT_Δ
COUNTS = 20.0 / 12.0  # of a count's square, in the difference of two second differences


class FineInertia:
    """Takes samples of an axis in motion.

    Attributes:
        inertia: what they have shown so far, 0 for nothing.
        quiet: for a second of motion and more the torque has changed by next to nothing.
    """

    __slots__ = ("_blocks", "_count", "_level", "_period", "_positions", "_spans", "_sums", "_torques", "inertia",
                 "quiet")  # fmt: skip

    def __init__(self, torque: float, period: float, resolution: float) -> None:
        self._period, self._count, self._level = period, resolution, QUIET * torque
        self._spans = [max(round(seconds / period), LEAST_CYCLES) for seconds in TRIANGLES]
        self._sums = np.zeros((len(TRIANGLES), 5))
        self._blocks = 0
        self._positions: list[float] = []
        self._torques: list[float] = []
        self.inertia = 0.0
        self.quiet = False

    def restart(self) -> None:
        """The next sample does not follow the last one."""
        self._positions.clear()
        self._torques.clear()

    def add(self, position: float, torque: float, cycle: float) -> bool:
        """One cycle that ended at `position` under `torque`; True where `inertia` may have changed."""
        if cycle > 1.5 * self._period:
            self.restart()
            return False
        self._positions.append(position)
        self._torques.append(torque)
        if len(self._positions) < BLOCK * self._spans[0]:
            return False
        positions, torques = np.array(self._positions), np.array(self._torques)
        self.restart()
        if np.ptp(positions) < MOVING_COUNTS * self._count:
            return False
        for sums, span in zip(self._sums, self._spans, strict=True):
            sums *= FORGET
            sums += block_sums(positions, torques, span, self._period, self._count)
        self._blocks += 1
        self.inertia = next(filter(None, map(_inertia, self._sums)), 0.0)
        if self._blocks >= BLOCKS:
            number, torques_squared = self._sums[0, 4], self._sums[0, 3]
            self.quiet = bool(torques_squared < number * self._level**2)
        return True


def block_sums(
    positions: NDArray[np.float64], torques: NDArray[np.float64], span: int, period: float, count: float
) -> tuple[float, float, float, float, float]:
    """Sums of torque times acceleration, acceleration squared less what counts feign, the same whole, torque squared;
    and how many.

    Args:
        positions, torques: (n,), each torque acted in the cycle that ended at its position.
        span: m cycles.
    """
    acceleration = (positions[2 * span :] - 2.0 * positions[span:-span] + positions[: -2 * span]) / (
        span * period
    ) ** 2
    rise = np.arange(1, span + 1)
    triangle = np.concatenate((rise, rise[-2::-1])) / span**2
    torque = np.convolve(torques, triangle, "valid")[1:][: len(acceleration)]
    a, t = acceleration[span:] - acceleration[:-span], torque[span:] - torque[:-span]
    squares = float(a @ a)
    feigned = len(a) * COUNTS * count**2 / (span * period) ** 4
    return float(t @ a), squares - feigned, squares, float(t @ t), float(len(a))


def _inertia(sums: NDArray[np.float64]) -> float:
    product, motion, squares, torques, _ = sums
    if motion <= MOTION * squares or product <= CORRELATED * np.sqrt(squares * torques):
        return 0.0
    return float(product / motion)
