"""A loop that swings tells how heavy its axis is; an encoder that tells a part of the motion makes it heavier.

Such an encoder changes the gain of the loop and mostly lets it swing, where slow strokes have not shown the inertia
well enough to hold torque and motion against each other in every cycle (`momentum_watch`). A swing is:

- the torque falls by far more than friction (and by two levels of it more, where the reference has turned round just
  then), rises by as much, and falls again, each soon after the other and at
  least half as far (a loop that rings down is let be),
- the axis goes forwards while it falls, and backwards, or less than half as far forwards, while it rises. Where
  torque follows what the place asks for (cogging, gravity, a tight spot), the axis goes on in both.

Each such half counts by its height, at most twice. At `ENOUGH` in three halves, or two full ones, its inertia is the
slope of impulse over velocity,

    ∫T dt = J·v + c·t + d,

within some 30 % where the torque swings so far. An axis that swings and is as heavy as it was (`fine_inertia`) is let
be, however badly its loop swings: that is no danger to its limits, which are watched. So is one that sticks for half
of the time: what its torque does meanwhile is friction's. Where the loop was so quiet
that it showed nothing, a large swing is news enough, unless the reference speeds up just then.
"""

from __future__ import annotations

from collections import deque

import numpy as np

ENOUGH = 3.0  # heights
HIGHEST = 2.0  # heights that one half counts
HALVES = 3  # at least, or two that count as much as a half can: what rings down after a stroke has fallen below by then
LEAST_FRICTION = 1.0  # friction levels that the torque must fall or rise by: one height
LEAST_TORQUE = 0.15  # of limits.torque
UNKNOWN_TORQUE = 0.3  # the same before friction is known
TURNS = 0.5  # heights, after which the torque has turned round
LEAST_COUNTS = 4.0  # that the axis must go in every other half
FORWARDS = 0.5  # of the half before: so far the axis may go on
LONGEST = 0.25  # s, of half a swing
LATE = 0.02  # s, in which the torque follows a reference that has turned round
REVERSED = 2.0  # levels of friction more, where the reference has turned round: it turns friction round
STEADY = 0.5  # of the highest half
ASKED = 2.0  # times what the reference asks of the heaviest axis
SMOOTH = 0.1  # a cycle: weight of the reference's newest rate, which comes in whole counts
FADES = 0.98  # a cycle: what the reference asked for still acts
CALM = 1.25  # heights of friction alone: the reference asks for nothing
NEWS = 0.4  # of limits.torque: height of a swing that tells by itself
KEPT = 256  # cycles to find the inertia from
FEWEST = 12  # the same
STICKS = 0.1  # of its fastest, that an axis goes half of the time where it sticks and slips
REMEMBERS = 1.01  # by which a bound on the inertia may rise, each time it is told


class SwingWatch:
    """Watches one axis in position control.

    Args:
        torque: limit; heaviest: inertia that the axis may have; resolution: of the encoder.
    """

    __slots__ = ("_asked", "_before", "_began", "_count", "_extreme", "_halves", "_heaviest", "_heights", "_highest",
                 "_impulse", "_kept", "_known", "_least", "_limit", "_pivot", "_quiet", "_rate", "_reference", "_sign",
                 "_time", "_told", "_turned", "_way")  # fmt: skip

    def __init__(self, torque: float, heaviest: float, resolution: float) -> None:
        self._limit, self._heaviest = torque, ASKED * heaviest
        self._count = LEAST_COUNTS * resolution
        self._known = np.inf
        self._quiet = False
        self._told = (np.inf, False)
        self.know(None)
        self.begin(0.0, 0.0, 0.0)

    def weigh(self, heaviest: float, quiet: bool) -> None:
        """The inertia is less than this; `quiet`: it is not known because the loop was so quiet until now.

        What is told counts from the next time on: a swing that has just begun must not teach what it needs. What is
        told first counts at once: before it any swing was let be.
        """
        first = heaviest if self._told[0] == np.inf else self._told[0]
        self._known = min(first, REMEMBERS * self._known)
        self._quiet = self._told[1]
        self._told = (heaviest, quiet)

    def know(self, friction: float | None) -> None:
        """The level of friction; None until both directions were seen."""
        if friction is None:
            self._least = UNKNOWN_TORQUE * self._limit
        else:
            self._least = max(LEAST_FRICTION * friction, LEAST_TORQUE * self._limit)

    def begin(self, position: float, reference: float, torque: float) -> None:
        """The axis is to hold at `reference`."""
        self._reference, self._rate, self._way, self._asked = reference, 0.0, 0.0, 0.0
        self._time = self._impulse = 0.0
        self._kept: deque[tuple[float, float, float]] = deque(maxlen=KEPT)  # time, impulse, position
        self._turned = -LONGEST  # when the reference has turned round
        self._sign = 1.0  # of the torque's present change
        self._pivot = self._extreme = (torque, position, 0.0)
        self._forget()

    def _forget(self) -> None:
        self._halves, self._heights, self._highest, self._before, self._began = 0, 0.0, 0.0, 0.0, 0.0

    def check(self, position: float, reference: float, torque: float, cycle: float) -> float:
        """One cycle that ended at `position` under `torque`; True where the loop swings."""
        step = reference - self._reference
        change = SMOOTH * (step / cycle - self._rate)
        self._rate += change
        self._asked = max(abs(change) / cycle, FADES * self._asked)
        self._reference = reference
        self._time += cycle
        self._impulse += torque * cycle
        self._kept.append((self._time, self._impulse, position))
        if step != 0.0:
            if step * self._way < 0.0:
                self._turned = self._time
            self._way = step
        back = (self._extreme[0] - torque) * self._sign
        if back <= 0.0:
            self._extreme = (torque, position, self._time)
            if self._halves and (half := self._half()) and self._heights + half >= self._enough:
                return self._judged()
        elif back > TURNS * self._height:
            self._turn(torque, position)
        return 0.0

    def _judged(self) -> float:
        """The inertia of the swing; it is only told where it is more than it can be, and else forgotten."""
        samples = np.array([one for one in self._kept if one[0] >= self._began])
        inertia = 0.0 if sticks(samples) else shown_inertia(samples)
        news = self._highest > NEWS * self._limit and self._height < CALM * self._least
        self._forget()
        return inertia if inertia > (0.0 if self._quiet and news else self._known) else 0.0

    @property
    def _enough(self) -> float:
        """Heights that make a swing, the present half included."""
        return ENOUGH if self._halves >= HALVES - 1 else 2.0 * HIGHEST

    @property
    def _height(self) -> float:
        return self._least + self._heaviest * self._asked

    def _half(self) -> float:
        """Heights of the present half; 0 where it is no part of a swing."""
        (torque, position, time), (before, start, began) = self._extreme, self._pivot
        if time - began > LONGEST:
            return 0.0
        turned = REVERSED * self._least if self._turned >= began - LATE else 0.0
        height, way = abs(torque - before), (start - position) * self._sign
        if way < self._count and (self._before < self._count or way < -FORWARDS * self._before):
            return 0.0
        if height < max(self._height + turned, STEADY * self._highest):
            return 0.0
        return min(height / self._height, HIGHEST)

    def _turn(self, torque: float, position: float) -> None:
        """The torque has turned round: a half ends and another begins."""
        heights = self._half()
        ended, began = self._extreme, self._pivot
        if heights > 0.0:
            self._began = self._began if self._halves else began[2]
            self._halves, self._heights = self._halves + 1, self._heights + heights
            self._highest = max(self._highest, abs(ended[0] - began[0]))
            self._before = (began[1] - ended[1]) * self._sign
        elif self._turned < began[2] - LATE or ended[2] - began[2] > LONGEST:
            self._forget()
        self._pivot, self._extreme = ended, (torque, position, self._time)
        self._sign = -self._sign


def sticks(samples: np.ndarray) -> bool:
    """Whether the axis hardly moves for half of the time: it hunts, and friction tells nothing of its inertia.

    Args:
        samples: as for `shown_inertia`.
    """
    if len(samples) < FEWEST:
        return False
    speed = np.abs((samples[2:, 2] - samples[:-2, 2]) / (samples[2:, 0] - samples[:-2, 0]))
    return bool(np.median(speed) < STICKS * np.max(speed))


def shown_inertia(samples: np.ndarray) -> float:
    """Slope of impulse over velocity; 0 for too few samples.

    Args:
        samples: (n, 3): time [s], impulse of the torque until then, position at it.
    """
    if len(samples) < FEWEST:
        return 0.0
    time, impulse, position = samples.T
    velocity = (position[2:] - position[:-2]) / (time[2:] - time[:-2])
    time = time[1:-1] - time[0]
    rows = np.column_stack((velocity, time, np.ones_like(time)))
    return float(np.linalg.lstsq(rows, impulse[1:-1], rcond=None)[0][0])
