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

Where the torque has risen by a level of friction within `SUDDEN_SECONDS`, as in a loop that swings and under no push
of a person or a process, less must be missing (`HINT`), if the lightest axis held by no more than what slides or sticks
it could already be unseen at the speed limit, ∫ (T − may)/J⁻ > limits.speed. What slides it is there what it was half
a second to a second ago: a loop that swings must not teach what its swing needs.

Against the torque friction helps it, so that the bound holds at any speed, and needs less to be known: until the
inverse is, J⁺ is infinite. An encoder that gains against such a torque counts the wrong way, or something stronger
than the motor drives the axis; braking by it is no braking (`doubtful`).

An axis that was never accelerated much does not show its inertia. `ExcessWatch` then has another sign: in
position control, more torque than ever slid or held the axis, and than its reference asks of the heaviest axis
that can brake as its file says, for longer than `EXCESS_SECONDS`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from autotune.core.axis import Limits
from autotune.experiments.inverse_estimate import Inverse

SHORT = 0.15  # of limits.speed
HINT = 0.05  # the same where the torque has risen suddenly and the lightest axis may run at limits.speed
SUDDEN_SECONDS = 0.032  # for a rise by a level of friction
SURER = 0.75  # of the heaviest axis, for the same
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
STRANGE = (
    0.4  # of limits.torque: from here on a force that nobody knows of is a stroke, or an encoder that lies
)
DOUBTFUL = 0.25  # of what must be missing: as much as no stop may be braked with
REMEMBERS = 1.002  # by which a bound on the inertia may rise, each time it is told
EXCESS_SECONDS = 0.005
FADES = 0.98  # a cycle: what the reference asked for still acts
OLD_SECONDS = 0.5  # a loop that swings must not teach what it needs
EARLY_BEYOND = 0.4  # of limits.torque beyond what has slid it, in the first strokes
EARLY_SPEED = 0.005  # of limits.speed, at which it must have slid
EARLY_SECONDS = 0.1  # the same in the first strokes, where friction still builds up: longer than half a swing


class _Way:
    """What is missing in one direction; torque and velocity are counted along it.

    Attributes:
        must: torque that is more than slides or sticks the axis; fast: velocity up to which that is known.
        sure, sure_fast: the same for a torque that has risen suddenly.
        missing: velocity that the encoder does not show; hinted: the same of a lighter axis.
        run: velocity of the lightest axis beyond what the encoder shows.
    """

    __slots__ = ("_before", "_since", "fast", "hinted", "missing", "must", "run", "sure", "sure_fast")

    def __init__(self) -> None:
        self.must, self.fast = math.inf, -math.inf
        self.sure, self.sure_fast = math.inf, -math.inf
        self._before = self._since = (math.inf, -math.inf)  # must and fast as they were
        self.missing = self.hinted = self.run = 0.0

    def begin(self) -> None:
        """Nothing is missing."""
        self.missing = self.hinted = self.run = 0.0

    def add(self, torque: float, gained: float, keeps: float, axis: _Axis, cycle: float) -> None:
        """One cycle under at least `torque`, in which the encoder has gained so much velocity."""
        net = torque - self.must
        gains = (net / axis.heavy if net > 0.0 else net / axis.light) * cycle
        self.missing = keeps * self.missing + gains - gained
        net = torque - self.sure
        gains = (net / (SURER * axis.heavy) if net > 0.0 else net / axis.light) * cycle
        self.hinted = keeps * self.hinted + gains - gained
        self.run = max(keeps * self.run + (net + axis.margin) / axis.light * cycle - gained, 0.0)

    def know(self, must: float, fast: float) -> None:
        """What slides or sticks it; more than before counts later where the torque rises suddenly."""
        self.must, self.fast = must, fast
        self.sure, self.sure_fast = (must, fast) if must <= self._before[0] else self._before

    def older(self) -> None:
        """Some time has passed: what was known when this was last said counts."""
        self._before, self._since = self._since, (self.must, self.fast)
        self.know(self.must, self.fast)

    def rests(self, against: bool, along: bool, velocity: float) -> None:
        """Where it does not show motion against or along this direction, or nothing is missing, the sums begin anew.

        Along it nothing is known beyond the speeds that were seen.
        """
        if self.missing <= 0.0 or not (against or (along and velocity <= self.fast)):
            self.missing = 0.0
        if self.hinted <= 0.0 or not (against or (along and velocity <= self.sure_fast)):
            self.hinted = 0.0


@dataclass(slots=True)
class _Axis:
    """What the axis can be: its inertias, its friction, and the torque by which `must` exceeds what holds it.

    `likely` is between the inertias that it can have; 0 for nothing known.
    """

    light: float
    heavy: float = math.inf
    friction: float = math.inf
    margin: float = 0.0
    likely: float = 0.0


class MomentumWatch:
    """Watches one axis; knows next to nothing until `know` is told.

    Attributes:
        way: that the encoder has gone in the last `MOVING` cycles.
    """

    __slots__ = (
        "_allowed",
        "_axis",
        "_before",
        "_cycle",
        "_doubt",
        "_down",
        "_faster",
        "_hint",
        "_known",
        "_leap",
        "_more",
        "_moving",
        "_positions",
        "_seconds",
        "_speed",
        "_stroke",
        "_sudden",
        "_torques",
        "_up",
        "_velocity",
        "way",
    )

    def __init__(self, limits: Limits, period: float, resolution: float) -> None:
        feigned = FEIGNED * resolution / period
        self._allowed, self._hint = SHORT * limits.speed + feigned, HINT * limits.speed + feigned
        self._speed = limits.speed
        self._sudden = max(round(SUDDEN_SECONDS / period), LATE)
        self._moving = MOVING_COUNTS * resolution
        self._more = MORE_TORQUE * limits.torque
        self._stroke = STRANGE * limits.torque
        self._doubt = 0
        self._leap = (LEAP * limits.deceleration, (FEIGNED + 0.5) * resolution / period)
        self._faster = FASTER[1] * limits.speed
        self._known = False
        self._axis = _Axis(UNKNOWN * limits.torque / limits.deceleration)
        self._up, self._down = _Way(), _Way()
        self._seconds = 0.0
        self.begin(0.0)

    def begin(self, position: float) -> None:
        """The axis stands at `position`."""
        self._positions = [position] * MOVING
        self._torques = [0.0] * LATE
        self._before = [0.0] * self._sudden
        self._velocity = math.nan
        self.way = 0.0
        self._up.begin()
        self._down.begin()
        self._cycle = 0

    def suppose(self, up: float, down: float) -> None:
        """More torque than has ever slid or held the axis, as long as nothing better is known of it."""
        if not self._known:
            self._up.know(up, self._up.fast)
            self._down.know(down, self._down.fast)

    def know(self, inverse: Inverse, sticks: float) -> None:
        """What the axis is; `sticks`: torque beyond what slides it that was seen to hold it."""
        friction = inverse.friction
        self._known = inverse.inertia is not None and friction is not None
        if inverse.inertia is None or friction is None or inverse.up is None or inverse.down is None:
            return
        margin = MORE * friction + self._more
        self._up.know(inverse.up + sticks + margin, FASTER[0] * inverse.fast_up + self._faster)
        self._down.know(sticks + margin - inverse.down, FASTER[0] * inverse.fast_down + self._faster)
        heavy = min(HEAVIER * inverse.heaviest, REMEMBERS * self._axis.heavy)
        likely = math.sqrt(inverse.inertia * inverse.heaviest)
        self._axis = _Axis(LIGHTER * inverse.inertia, heavy, friction, margin, likely)

    def check(self, position: float, torque: float, cycle: float, missed: bool) -> float:
        """One cycle that ended at `position` under `torque`.

        Returns the velocity that is missing, with the sign of its direction; 0 where it may be as it is.
        """
        at, long_ago = self._cycle % MOVING, self._cycle % self._sudden
        way = self.way = position - self._positions[at]
        last = self._positions[at - 1]
        self._positions[at] = position
        rise, self._before[long_ago] = torque - self._before[long_ago], torque
        self._torques[self._cycle % LATE] = torque
        self._cycle += 1
        velocity = (position - last) / cycle
        gained, self._velocity = velocity - self._velocity, velocity
        if self._leaps(gained, cycle, missed):
            return gained
        up, down = self._up, self._down
        if missed or gained != gained:
            up.begin()
            down.begin()
            return 0.0
        self._age(cycle)
        keeps = 1.0 - cycle / LEAKS
        up.add(min(self._torques), gained, keeps, self._axis, cycle)
        down.add(-max(self._torques), -gained, keeps, self._axis, cycle)
        if self._short(up, rise):
            return max(up.missing, up.hinted)
        if self._short(down, -rise):
            return -max(down.missing, down.hinted)
        if max(up.missing, down.missing) > DOUBTFUL * self._allowed or self._strange(gained, cycle):
            self._doubt = DOUBT_CYCLES
        upwards, downwards = way > self._moving, way < -self._moving
        up.rests(downwards, upwards, velocity)
        down.rests(upwards, downwards, -velocity)
        return 0.0

    def _age(self, cycle: float) -> None:
        """What was known a while ago counts."""
        self._seconds += cycle
        if self._seconds > OLD_SECONDS:
            self._seconds = 0.0
            self._up.older()
            self._down.older()

    def _leaps(self, gained: float, cycle: float, missed: bool) -> bool:
        """A velocity that no axis of this file can have gained in a cycle."""
        slope, feigned = self._leap
        self._doubt -= self._doubt > 0
        if not missed and abs(gained) > DOUBT / LEAP * slope * cycle + feigned:
            self._doubt = DOUBT_CYCLES
            return abs(gained) > slope * cycle + feigned
        return False

    def _strange(self, gained: float, cycle: float) -> bool:
        """A velocity that has changed by what neither torque nor friction can have done."""
        beyond = abs(gained) - self._leap[1]
        if beyond <= 0.0:
            return False
        known = self._up.must - min(self._torques) if gained < 0.0 else self._down.must + max(self._torques)
        return self._axis.likely * beyond / cycle > max(known, 0.0) + self._stroke

    def _short(self, way: _Way, rise: float) -> bool:
        """Whether too much is missing."""
        if way.missing > self._allowed:
            return True
        return way.hinted > self._hint and way.run > self._speed and rise > self._axis.friction

    @property
    def doubtful(self) -> bool:
        """Whether the velocity has leapt or changed strangely a moment ago, or a quarter of what stops was missing."""
        return self._doubt > 0


class ExcessWatch:
    """Torque that nobody asked for; `know` is told what has slid or held the axis so far.

    Attributes:
        heaviest: inertia that the axis may have.
    """

    __slots__ = (
        "_asked",
        "_excess",
        "_lasts",
        "_levels",
        "_new",
        "_rate",
        "_reference",
        "_seconds",
        "heaviest",
    )

    def __init__(self, heaviest: float) -> None:
        self.heaviest = heaviest
        self._levels = self._new = (math.inf, math.inf)
        self._seconds, self._lasts = 0.0, OLD_SECONDS
        self.begin(0.0)

    def begin(self, reference: float) -> None:
        """The axis is to hold at `reference`."""
        self._reference, self._rate = reference, 0.0
        self._asked = self._excess = 0.0

    def know(self, up: float, down: float, early: bool = False) -> None:
        """Torques that are more than it has ever needed upwards and downwards; what is known first counts at once.

        `early`: in the first strokes, in which it also counts at once that nothing is known any more.
        """
        self._new, self._lasts = (up, down), EARLY_SECONDS if early else OLD_SECONDS
        if math.inf in self._levels or (early and math.inf in self._new):
            self._levels = self._new

    def check(self, reference: float, torque: float, cycle: float) -> bool:
        """One cycle; True where torque has been beyond for too long."""
        self._seconds += cycle
        if self._seconds > self._lasts:
            self._seconds, self._levels = 0.0, self._new
        rate = (reference - self._reference) / cycle
        self._asked = max(abs(rate - self._rate) / cycle, FADES * self._asked)
        self._reference, self._rate = reference, rate
        level = self._levels[0] if torque > 0.0 else self._levels[1]
        beyond = abs(torque) - self.heaviest * self._asked > level
        self._excess = (
            math.copysign(abs(self._excess) + cycle, torque)
            if beyond and torque * self._excess >= 0.0
            else 0.0
        )
        return abs(self._excess) > EXCESS_SECONDS


def early_levels(inverse: Inverse, first: float, limits: Limits) -> tuple[float, float]:
    """More torque than the first strokes of a session need, upwards and downwards: what has slid the axis there or,
    where it has not gone there yet, the other way, and a lot. An axis that creeps at rest has not slid.

    Args:
        first: torque as power came on.
    """
    slow = EARLY_SPEED * limits.speed
    up = inverse.up if inverse.fast_up > slow else None
    down = inverse.down if inverse.fast_down > slow else None
    if up is None and down is None:
        return math.inf, math.inf
    more = EARLY_BEYOND * limits.torque
    ways = up if up is not None else -(down or 0.0), -down if down is not None else up or 0.0
    return max(ways[0], first) + more, max(ways[1], -first) + more
