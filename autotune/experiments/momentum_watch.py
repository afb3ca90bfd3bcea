"""Momentum that must be there: an encoder that tells less than the axis does gives itself away by the torque.

Once the axis's inverse is known (`inverse_estimate`), the torque of a cycle bounds from below what it adds to
the velocity, along either direction:

    Δv ≥ (T − must)·h/J⁺ where T pushes,   (T − must)·h/J⁻ where it brakes

with T the least of the last `LATE` demands, `must` more than slides it at such speeds or sticks it, J⁺ and J⁻
the heaviest and the lightest that the axis can be. What is missing is summed up (Page's cumulative sum, never
below zero, with a leak) while the encoder shows motion, in that direction or against it; an axis that sticks is
`motion_watch`'s. A sum beyond SHORT of the speed limit and what counts can feign is no friction: the encoder tells
a part only (lost pulses, a coupling that slips), or something has stopped the axis. A velocity that leaps by what
no axis of this file could brake in one cycle is the same, and needs nothing to be known.

Against the torque friction helps it, so that the bound holds at any speed, and needs less to be known: until the
inverse is, J⁺ is infinite. An encoder that gains against such a torque counts the wrong way, or something stronger
than the motor drives the axis; braking by it is no braking (`doubtful`).

An axis that was never accelerated much does not show its inertia. `ExcessWatch` then has another sign: in
position control, more torque than ever slid or held the axis, and than its reference asks of the heaviest axis
that can brake as its file says, for longer than `EXCESS_SECONDS`.
"""

from __future__ import annotations

import math

from autotune.core.axis import Limits
from autotune.experiments.inverse_estimate import Inverse

SHORT = 0.15  # of limits.speed
FEIGNED = 2.5  # counts a cycle
LEAKS = 0.05  # s, in which the sum forgets: a load that comes slowly is no loss
LATE = 3  # cycles that a torque may take to act
MOVING_COUNTS = 2.0  # in the last MOVING cycles, below which it may stick
MOVING = 4
HEAVIER = 1.25  # times the inertia found and three standard errors
UNKNOWN = 1e-3  # of torque/deceleration: the lightest axis, before anything is known
LIGHTER = 0.5  # of the inertia found: what a soft transmission leaves of it
MORE = 0.25  # friction levels beyond what slides or sticks
MORE_TORQUE = 0.03  # of limits.torque
FASTER = (1.1, 0.02)  # times the fastest speed seen, and of limits.speed: beyond, friction may be larger
LEAP = 20.0  # times limits.deceleration in a cycle
DOUBT = 8.0  # the same, after which a stop for any reason does not trust the encoder
DOUBT_CYCLES = 20
DOUBTFUL = 0.25  # of what must be missing: as much as no stop may be braked with
REMEMBERS = 1.002  # by which a bound on the inertia may rise, each time it is told
EXCESS_SECONDS = 0.005
FADES = 0.98  # a cycle: what the reference asked for still acts
OLD_SECONDS = 0.5  # a loop that swings must not teach what it needs


class MomentumWatch:
    """Watches one axis; knows next to nothing until `know` is told.

    Attributes:
        way: that the encoder has gone in the last `MOVING` cycles.
    """

    __slots__ = (
        "_allowed",
        "_cycle",
        "_doubt",
        "_down",
        "_fast_down",
        "_fast_up",
        "_faster",
        "_heavy",
        "_known",
        "_leap",
        "_light",
        "_more",
        "_moving",
        "_must_down",
        "_must_up",
        "_positions",
        "_torques",
        "_up",
        "_velocity",
        "way",
    )

    def __init__(self, limits: Limits, period: float, resolution: float) -> None:
        self._allowed = SHORT * limits.speed + FEIGNED * resolution / period
        self._moving = MOVING_COUNTS * resolution
        self._more = MORE_TORQUE * limits.torque
        self._doubt = 0
        self._leap = (LEAP * limits.deceleration, (FEIGNED + 0.5) * resolution / period)
        self._faster = FASTER[1] * limits.speed
        self._fast_up = self._fast_down = -math.inf
        self._known = False
        self._must_up = self._must_down = math.inf
        self._light, self._heavy = UNKNOWN * limits.torque / limits.deceleration, math.inf
        self.begin(0.0)

    def begin(self, position: float) -> None:
        """The axis stands at `position`."""
        self._positions = [position] * MOVING
        self._torques = [0.0] * LATE
        self._velocity = math.nan
        self.way = 0.0
        self._up = self._down = 0.0
        self._cycle = 0

    def suppose(self, up: float, down: float) -> None:
        """More torque than has ever slid or held the axis, as long as nothing better is known of it."""
        if not self._known:
            self._must_up, self._must_down = up, down

    def know(self, inverse: Inverse, sticks: float) -> None:
        """What the axis is; `sticks`: torque beyond what slides it that was seen to hold it."""
        friction = inverse.friction
        self._known = inverse.inertia is not None and friction is not None
        if inverse.inertia is None or friction is None or inverse.up is None or inverse.down is None:
            return
        beyond = sticks + MORE * friction + self._more
        self._fast_up = FASTER[0] * inverse.fast_up + self._faster
        self._fast_down = FASTER[0] * inverse.fast_down + self._faster
        self._must_up, self._must_down = inverse.up + beyond, beyond - inverse.down
        self._heavy = min(HEAVIER * inverse.heaviest, REMEMBERS * self._heavy)
        self._light = LIGHTER * inverse.inertia

    def check(self, position: float, torque: float, cycle: float, missed: bool) -> float:
        """One cycle that ended at `position` under `torque`.

        Returns the velocity that is missing, with the sign of its direction; 0 where it may be as it is.
        """
        at = self._cycle % MOVING
        way = self.way = position - self._positions[at]
        last = self._positions[at - 1]
        self._positions[at] = position
        self._torques[self._cycle % LATE] = torque
        self._cycle += 1
        velocity = (position - last) / cycle
        gained, self._velocity = velocity - self._velocity, velocity
        slope, feigned = self._leap
        self._doubt -= self._doubt > 0
        if not missed and abs(gained) > DOUBT / LEAP * slope * cycle + feigned:
            self._doubt = DOUBT_CYCLES
            if abs(gained) > slope * cycle + feigned:
                return gained
        if missed or gained != gained:
            self._up = self._down = 0.0
            return 0.0
        keeps = 1.0 - cycle / LEAKS
        self._up = keeps * self._up + self._least(min(self._torques) - self._must_up) * cycle - gained
        self._down = keeps * self._down + self._least(-max(self._torques) - self._must_down) * cycle + gained
        if self._up > self._allowed:
            return self._up
        if self._down > self._allowed:
            return -self._down
        if max(self._up, self._down) > DOUBTFUL * self._allowed:
            self._doubt = DOUBT_CYCLES
        up = way < -self._moving or (way > self._moving and velocity <= self._fast_up)
        down = way > self._moving or (way < -self._moving and -velocity <= self._fast_down)
        if not (self._up > 0.0 and up):
            self._up = 0.0
        if not (self._down > 0.0 and down):
            self._down = 0.0
        return 0.0

    @property
    def doubtful(self) -> bool:
        """Whether the velocity has leapt a moment ago, or a quarter of what stops the axis was missing."""
        return self._doubt > 0

    def _least(self, net: float) -> float:
        """Acceleration that there must be at least."""
        return net / self._heavy if net > 0.0 else net / self._light


class ExcessWatch:
    """Torque that nobody asked for; `know` is told what has slid or held the axis so far."""

    __slots__ = ("_asked", "_excess", "_heaviest", "_levels", "_new", "_rate", "_reference", "_seconds")

    def __init__(self, heaviest: float) -> None:
        self._heaviest = heaviest
        self._levels = self._new = (math.inf, math.inf)
        self._seconds = 0.0
        self.begin(0.0)

    def begin(self, reference: float) -> None:
        """The axis is to hold at `reference`."""
        self._reference, self._rate = reference, 0.0
        self._asked = self._excess = 0.0

    def know(self, up: float, down: float) -> None:
        """Torques that are more than it has ever needed upwards and downwards."""
        self._new = (up, down)

    def check(self, reference: float, torque: float, cycle: float) -> bool:
        """One cycle; True where torque has been beyond for too long."""
        self._seconds += cycle
        if self._seconds > OLD_SECONDS:
            self._seconds, self._levels = 0.0, self._new
        rate = (reference - self._reference) / cycle
        self._asked = max(abs(rate - self._rate) / cycle, FADES * self._asked)
        self._reference, self._rate = reference, rate
        level = self._levels[0] if torque > 0.0 else self._levels[1]
        beyond = abs(torque) - self._heaviest * self._asked > level
        self._excess = (
            math.copysign(abs(self._excess) + cycle, torque)
            if beyond and torque * self._excess >= 0.0
            else 0.0
        )
        return abs(self._excess) > EXCESS_SECONDS
