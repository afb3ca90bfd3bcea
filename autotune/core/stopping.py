"""Watches an axis while its drive takes it to rest: a stop only takes speed away.

The drive carries the stop out, so no command of ours can be corrected; what is left is to see that it
brakes, and to take power off where it does not:

    |v(t)| ≤ |v₀| + 0.1·v_max + 2·T·a + 2·q/T

v₀ is the highest speed in the `TAKES_OVER` cycles that pass before the stop command acts (sent, taken over
with SYNC), v_max and a the axis's speed limit and deceleration. In two cycles T the axis may still gain speed,
by no more than it could lose; 2·q/T is what two counts q of the position sensor look like. Beyond that in
`IN_A_ROW` samples, whoever controls the axis drives it: a coasting axis is the lesser evil.

A speed that vanishes at once is no braking: an encoder that is silent while, even with `AT_ONCE` times the
deceleration that the drive brakes with, the axis had to show `SHOWN` counts a cycle has died, or something has stopped
the axis; neither is to be braked by it. Nor is an encoder that shows less than `PART` of what even then had to be left
of the speed that its own positions showed before: it tells a part of the motion, and a ramp that follows it drives
the axis. Where time is the clock's, `IN_A_BURST` samples in a row have to show it: two answers in a burst tell of one
place. An axis that has waited for a late host is not judged by what it was before.

A speed of half that allowance that turns round `TURNS` times is no braking either: the loop swings, by gains or by an
encoder that tells a part, and would do so until the longest stop is over.

Both velocities are watched: the drive's, which may be filtered, begin anew at 0 with the stop, or be in a
wrong unit, and the position's difference.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from autotune.core.axis import Axis, Limits

IN_A_ROW = 3
IN_A_BURST = 2
TURNS = 4
AT_ONCE = 4.0
SHOWN = 3.0
PART = 0.5
REMEMBERED = 4  # an encoder that lies may have begun to just before the stop
TAKES_OVER = 2
LATE = 2.0  # cycles from one answer to the next
_SHARE = 0.1
_DELAY_CYCLES = 2.0
_COUNTS = 2.0


@dataclass(frozen=True, slots=True)
class StopLimits:
    """What is known of an axis that is being stopped; SI.

    Attributes:
        allowance: speed that it may gain at the beginning, with what noise looks like.
        beyond: how far outside of its travel it may be found: a reference at the limit, and the following
            error allowed.
        deceleration: that the drive brakes with; count: of the position sensor.
    """

    period: float
    allowance: float
    position_min: float
    position_max: float
    beyond: float
    unit: str
    deceleration: float
    count: float

    @classmethod
    def of(cls, axis: Axis) -> StopLimits:
        return cls.from_limits(axis.limits, axis.cycle, axis.position_resolution, axis.motion_unit)

    @classmethod
    def from_limits(cls, limits: Limits, period: float, resolution: float, unit: str) -> StopLimits:
        """Of an axis with these limits; `resolution` is one count of its position sensor."""
        travel = (limits.position_min, limits.position_max)
        allowance = gain_allowed(limits.speed, limits.deceleration, period, resolution)
        return cls(period, allowance, *travel, limits.following_error, unit, limits.deceleration, resolution)


def gain_allowed(speed: float, deceleration: float, period: float, resolution: float) -> float:
    """Speed that an axis may gain while it begins to brake, with what two counts look like."""
    return _SHARE * speed + _DELAY_CYCLES * period * deceleration + _COUNTS * resolution / period


class Ways:
    """How far the axis has gone in each of the last `REMEMBERED` cycles; in whatever positions are counted in.

    Attributes:
        passed: cycles between the last two answers, by the clock; nan where that is not known.
    """

    __slots__ = ("_at", "_late", "_period", "_ways", "_when", "passed")

    def __init__(self, period: float) -> None:
        self._period = period
        self._ways: deque[float] = deque(maxlen=REMEMBERED)
        self._late: deque[bool] = deque(maxlen=REMEMBERED)
        self.begin()

    def begin(self) -> None:
        """After a pause nothing is known."""
        self._ways.clear()
        self._late.clear()
        self._at: float | None = None
        self._when = self.passed = math.nan

    def see(self, position: float, missed: int = 0, now: float = math.nan) -> None:
        """One cycle has ended at `position`; so many were lost before it. `now`: of the clock [s]; nan in lock-step."""
        self.passed, self._when = (now - self._when) / self._period, now
        if self._at is not None:
            self._ways.append(abs(position - self._at) / max(missed + 1.0, self.passed))
        self._late.append(is_late(missed, self.passed))
        self._at = position

    @property
    def longest(self) -> float:
        """Of them; nan where none is known."""
        return max(self._ways, default=math.nan)

    @property
    def late(self) -> bool:
        """One of them was: the axis may have waited for its next command, and hurries after it."""
        return any(self._late)


def is_late(missed: int, passed: float) -> bool:
    """Whether a sample came later than its turn: cycles were lost before it, or the clock says so."""
    return missed > 0 or passed > LATE


class StopWatch:
    """One stop.

    Args:
        velocity: that the drive told last, moved: the highest that positions have shown in the cycles before the stop
            (`Ways`); nan where that is not known.
        late: one of those cycles was; how fast the axis was without the delay is not known.
        demanded: velocity that the stop begins to brake from; an axis that lags behind it catches up first.

    Attributes:
        runs_away: speed has grown where it must fall; power has to go at once.
        trouble: what was seen, in words; empty where the stop was as it should be.
    """

    def __init__(
        self,
        limits: StopLimits,
        velocity: float,
        moved: float = math.nan,
        demanded: float = 0.0,
        late: bool = False,
    ) -> None:
        self.runs_away = False
        self.trouble = ""
        self._limits = limits
        self._position: float | None = None  # how long ago the last one was taken is not known
        self._speed = abs(velocity) if math.isfinite(velocity) else 0.0
        self._seen = self._beyond = self._vanished = self._turns = 0
        self._way = 0.0
        self._least = self._speed  # that it must have had in the cycle before
        self._shown = (
            min(self._speed, abs(moved)) if math.isfinite(moved) else 0.0
        )  # the same, by both velocities
        if late:
            self._least = self._shown = 0.0
        self._speed = max(self._speed, abs(demanded))

    def see(self, position: float, velocity: float, missed: int = 0, passed: float = math.nan) -> None:
        """Takes the next sample; so many cycles were lost before it.

        Args:
            passed: cycles since the sample before, by the host's clock. Two that come in a burst show no way between
                them, and one that was late the way of the delay: what is doubtful is counted for the axis.
        """
        limits = self._limits
        before, self._position = self._position, position
        nominal = 1.0 + missed
        longest, shortest = (
            (max(nominal, passed), min(nominal, passed)) if passed > 0.0 else (nominal, nominal)
        )
        moved = 0.0 if before is None else abs(position - before) / (longest * limits.period)
        known = math.isfinite(velocity + moved)
        speed = max(abs(velocity), moved) if known else math.inf  # what is no number counts as too fast
        self._seen += 1
        if known and self._seen <= TAKES_OVER:
            self._speed = max(self._speed, speed)
        if is_late(missed, passed):  # it waited for us, and not because its brake took hold
            self._least, self._shown = min(self._least, speed), min(self._shown, moved)
        elif before is not None:
            vanishes = self._vanishes(abs(position - before), shortest * limits.period)
            self._vanished = self._vanished + 1 if vanishes else 0
        self._beyond = 0 if speed <= self._speed + limits.allowance else self._beyond + 1
        if self._beyond >= IN_A_ROW and not self.runs_away:
            self.runs_away = True
            self.trouble = (
                f"its speed rose from {self._speed:.3g} to {speed:.3g} {limits.unit}/s; power was taken off at "
                "once, and it coasts to rest. Check the position sensor, the brake, and what else moves the axis"
            )
        elif not self.runs_away and self._vanished >= (IN_A_BURST if passed > 0.0 else 1):
            self.runs_away = True
            self.trouble = (
                f"its speed of {self._speed:.3g} {limits.unit}/s vanished at once, or most of it: power was taken off, "
                "and it coasts to rest. Check the position sensor and its cable, and what may have stopped the axis"
            )
        elif not self.runs_away and self._swings(velocity):
            self.runs_away = True
            self.trouble = (
                f"it swung to and fro, by up to {self._speed:.3g} {limits.unit}/s; power was taken off at once, and it "
                "coasts to rest. Check the position sensor, the coupling and the controller's gains"
            )
        elif not self.trouble and self._outside(position, velocity):
            self.trouble = (
                f"it left its travel: {position:.4g} {limits.unit}, allowed is {limits.position_min:g} to "
                f"{limits.position_max:g}. Check that it brakes with limits.deceleration, and bring it back"
            )

    def _vanishes(self, way: float, seconds: float) -> bool:
        """Whether the axis shows nothing where it cannot rest yet, or far less than must be left."""
        lost = AT_ONCE * self._limits.deceleration * seconds
        self._least, self._shown = self._least - lost, self._shown - lost
        count = self._limits.count
        if way <= 1.5 * count:
            return self._least * seconds > SHOWN * count
        return PART * (self._shown * seconds - count) > way + count

    def _swings(self, velocity: float) -> bool:
        """Whether it has turned round too often, each time at a speed that no rest has."""
        if abs(velocity) > 0.5 * self._limits.allowance:
            self._turns += velocity * self._way < 0.0
            self._way = velocity
        return self._turns >= TURNS

    def _outside(self, position: float, velocity: float) -> bool:
        low, high = self._limits.position_min, self._limits.position_max
        if velocity > 0.0:
            return position > high + self._limits.beyond
        return velocity < 0.0 and position < low - self._limits.beyond
