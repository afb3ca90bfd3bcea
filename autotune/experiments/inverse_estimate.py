"""What torque slides the axis, and how heavy it is: its own inverse, estimated while it moves.

    T = J·a + F·sign(v) + B·v + G

Windows of steady direction give mean torque, velocity and, from two neighbours, acceleration. The torque
that slides the axis is the largest of those in which it does not speed up; so neither inertia nor the
torque that builds up after a reversal (presliding) counts. In the first strokes a direction that has hardly been
gone in, beside the longest stroke, has not slid; later, what moves under less than half of friction is bent.

J is fitted by recursive least squares with forgetting (Åström and Wittenmark, Adaptive Control, chapter 2), only
well after a reversal. Everything is scaled with the limits; J is claimed only where its standard error is small.
The first window far beyond the speeds that were seen is explained by J and B alike, where friction falls with speed:
the least that the axis weighs is what two solutions in a row say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from autotune.core.axis import Limits

SHORTEST, LONGEST = 0.016, 0.128  # s, of a window
LEAST_CYCLES = 4
LEAST_COUNTS = 6.0  # of travel in a window: direction and velocity are then beyond the encoder's steps
FORGET = 0.995  # a window: about 3 s of motion
NARROW = 0.998  # a window: what slides the axis here may differ from what slid it there
BENDS = 0.5  # friction levels from the middle: where less torque moves the axis, it only bends its junctions
LEAST_WINDOWS = 8
EVERY = 4  # windows, between two solutions
BEYOND_REVERSAL = 0.25  # of the longest stroke: friction has built up then
FIRST_STROKES = 6  # in which a direction that has hardly been gone in has only bent the junctions
SHORTER = 0.9  # a reversal: the longest stroke is forgotten
NOISE = 2e-3  # of limits.torque, least standard deviation of a window
PRIOR = (1.0, 1.0, 0.3, 1.0)  # standard deviations of J, F, B, G in units of the limits
CERTAIN = 0.25  # standard error of J, of itself


@dataclass(frozen=True, slots=True)
class Inverse:
    """What is known; None where it is not [N m, kg m², or N, kg].

    Attributes:
        up, down: torque at which the axis slides upwards, and downwards.
        fast_up, fast_down: fastest windows that these torques were found in [rad/s or m/s].
        strokes: in either direction, since the beginning.
        inertia: estimate; `heaviest` and `lightest` are three standard errors away, `lightest` in the solution before
            too.
    """

    up: float | None = None
    down: float | None = None
    strokes: int = 0
    inertia: float | None = None
    lightest: float = 0.0
    heaviest: float = 0.0
    fast_up: float = 0.0
    fast_down: float = 0.0

    @property
    def friction(self) -> float | None:
        """Half the distance of both; None unless both are known."""
        if self.up is None or self.down is None:
            return None
        return max(0.5 * (self.up - self.down), 0.0)


class InverseEstimate:
    """Takes samples; `inverse` is what they have shown so far."""

    __slots__ = (
        "_correlation",
        "_down",
        "_information",
        "_least",
        "_lightest",
        "_power",
        "_reaches",
        "_reversals",
        "_scales",
        "_seconds",
        "_shortest",
        "_since",
        "_start",
        "_stroke",
        "_strokes",
        "_sum",
        "_up",
        "_weight",
        "_window",
        "_windows",
        "inverse",
    )

    def __init__(self, limits: Limits, period: float, resolution: float) -> None:
        self._scales = (limits.deceleration, limits.speed, limits.torque)
        self._shortest = max(SHORTEST, LEAST_CYCLES * period)
        self._least = LEAST_COUNTS * resolution
        self._information = np.zeros((4, 4))
        self._correlation = np.zeros(4)
        self._power = self._weight = self._stroke = self._strokes = self._lightest = 0.0
        self._up: float | None = None
        self._down: float | None = None
        self._reaches = [0.0, 0.0]  # longest strokes in which up and down were found
        self._windows = self._since = self._reversals = 0
        self._window: tuple[float, float, float] | None = None  # velocity, seconds, mean torque
        self._start = self._sum = self._seconds = 0.0
        self.inverse = Inverse()

    def restart(self, position: float) -> None:
        """The next window begins here; what is known stays."""
        self._start, self._sum, self._seconds, self._window = position, 0.0, 0.0, None

    def add(self, position: float, torque: float, cycle: float) -> bool:
        """One cycle that ended at `position` under `torque`; True where `inverse` may have changed."""
        self._sum += torque * cycle
        self._seconds += cycle
        if self._seconds < self._shortest:
            return False
        return self._close(position)

    def _close(self, position: float) -> bool:
        way, seconds = position - self._start, self._seconds
        if not abs(way) >= self._least:
            if seconds >= LONGEST:
                self.restart(position)
            return False
        window = (way / seconds, seconds, self._sum / seconds)
        before, self._window = self._window, window
        self._start, self._sum, self._seconds = position, 0.0, 0.0
        if self._stroke * way < 0.0:
            self._strokes = max(SHORTER * self._strokes, abs(self._stroke))
            self._stroke = 0.0
            self._reversals += 1
        self._stroke += way
        if before is None or before[0] * way <= 0.0:
            return False
        self._slide(before, window)
        if abs(self._stroke) > BEYOND_REVERSAL * self._strokes:
            self._take(before, window)
        if self._windows >= LEAST_WINDOWS and self._since >= EVERY:
            self._solve()
        return True

    def _slide(self, one: tuple[float, float, float], two: tuple[float, float, float]) -> None:
        """A window in which the axis does not speed up tells how much torque slides it, but for one that bends it."""
        up, down, torque = self._up, self._down, two[2]
        if up is not None and down is not None:
            if abs(2.0 * torque - up - down) < BENDS * (up - down):
                return
            narrow = 0.5 * (1.0 - NARROW) * (up - down)
            up, down = up - narrow, down + narrow
        last = self.inverse
        fast_up, fast_down = (
            NARROW * last.fast_up,
            NARROW * last.fast_down,
        )  # what slid it there is forgotten too
        if 0.0 < two[0] <= one[0]:
            up = torque if up is None else max(up, torque)
            fast_up = max(fast_up, two[0])
            self._reaches[0] = max(self._reaches[0], self._stroke)
        elif 0.0 > two[0] >= one[0]:
            down = torque if down is None else min(down, torque)
            fast_down = max(fast_down, -two[0])
            self._reaches[1] = max(self._reaches[1], -self._stroke)
        self._up, self._down = up, down
        self.inverse = replace(
            last,
            up=up if self._slid(0) else None,
            down=down if self._slid(1) else None,
            strokes=self._reversals,
            fast_up=fast_up,
            fast_down=fast_down,
        )

    def _slid(self, way: int) -> bool:
        """Whether the axis has slid that way, and not only bent its junctions: so far against the longest stroke."""
        longest = max(self._strokes, abs(self._stroke))
        return self._reversals > FIRST_STROKES or self._reaches[way] > BEYOND_REVERSAL * longest

    def _take(self, one: tuple[float, float, float], two: tuple[float, float, float]) -> None:
        deceleration, speed, limit = self._scales
        seconds = one[1] + two[1]
        velocity = (one[0] * one[1] + two[0] * two[1]) / seconds
        torque = (one[2] * one[1] + two[2] * two[1]) / (seconds * limit)
        acceleration = (two[0] - one[0]) / (0.5 * seconds)
        row = np.array((acceleration / deceleration, 1.0 if velocity > 0.0 else -1.0, velocity / speed, 1.0))
        self._information *= FORGET
        self._information += row[:, None] * row
        self._correlation *= FORGET
        self._correlation += row * torque
        self._power = FORGET * self._power + torque * torque
        self._weight = FORGET * self._weight + 1.0
        self._windows += 1
        self._since += 1

    def _solve(self) -> None:
        self._since = 0
        deceleration, _, limit = self._scales
        prior = np.diag([(NOISE / sigma) ** 2 for sigma in PRIOR])
        spread = np.linalg.inv(self._information + prior)
        found = spread @ self._correlation
        noise = max((self._power - float(found @ self._correlation)) / self._weight, NOISE**2)
        inertia, error = float(found[0]), float(np.sqrt(noise * spread[0, 0]))
        scale = limit / deceleration
        known = 0.0 < error < CERTAIN * inertia
        before, self._lightest = self._lightest, max(inertia - 3.0 * error, 0.0) * scale
        self.inverse = replace(
            self.inverse,
            strokes=self._reversals,
            inertia=inertia * scale if known else None,
            lightest=min(before, self._lightest),
            heaviest=(inertia + 3.0 * error) * scale,
        )
