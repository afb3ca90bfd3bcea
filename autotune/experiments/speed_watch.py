"""Speed by the encoder itself: what the drive reports may be filtered, late, or in another unit.

The newest mean velocities over SPAN cycles, v₁ and before it v₀, are extrapolated to the end of the
reaction time, as the reported velocity is, less what whole counts can feign:

    v = v₁ + (v₁ − v₀)/Δt·(Δt/2 + reaction),   |v| ≤ limits.speed + FEIGNED·resolution/period.

Where counts are coarse, the mean over the whole ring is the sharper one: it may not exceed the limit by
more than one count in that time. A single cycle counts too, so a jump of the encoder is a speed.
Reported velocity and differences of positions are regressed on each other over windows that are longer
than both quantisation and filters.
"""

from __future__ import annotations

from autotune.core.axis import Limits

SPAN = 2  # cycles: a longer one is late where the axis vibrates
FEIGNED = 2.0  # count/period: ±½ count in each of three positions, worst case of the extrapolation
_RING = 8
LEAST_COUNTS = 16.0  # in a window, to compare
WINDOWS = 32
SLOPE = (0.3, 3.0)  # a slow filter lags; a wrong unit is wrong by more (rpm: 9.55, 1/10, the sign)


class SpeedWatch:
    """Watches one axis; pure apart from what it remembers."""

    __slots__ = ("_at", "_count", "_feigned", "_limit", "_matching", "_positions", "_product", "_reported",
                 "_squares", "_time", "_times", "_windows")  # fmt: skip

    def __init__(self, limits: Limits, period: float, resolution: float) -> None:
        self._limit = limits.speed
        self._count = resolution
        self._feigned = FEIGNED * resolution / period
        self._squares = self._product = 0.0
        self._windows = 0
        self.begin(0.0, period)

    def begin(self, position: float, period: float) -> None:
        """The axis stands at `position`."""
        self._positions = [position] * _RING
        self._times = [(k - _RING + 1) * period for k in range(_RING)]
        self._time = self._reported = 0.0
        self._at = 0

    def check(self, position: float, velocity: float, cycle: float, reaction: float) -> str:
        """One cycle that ended at `position`; why the axis must be stopped, or nothing."""
        at, positions, times = self._at, self._positions, self._times
        self._time = time = self._time + cycle
        self._reported += velocity * cycle
        last = positions[at - 1]
        middle = positions[at - SPAN]
        oldest, began = positions[at], times[at]
        split, before = times[at - SPAN], at - 2 * SPAN
        span, earlier = time - split, times[before]
        newer = (position - middle) / span
        older = (middle - positions[before]) / (split - earlier)
        soon = newer + 2.0 * (newer - older) / (time - earlier) * (0.5 * span + reaction)
        positions[at], times[at] = position, time
        self._at = at = (at + 1) % _RING
        allowed = self._limit + self._feigned
        if not -allowed <= soon <= allowed:
            return self._too_fast(soon)
        way = self._limit * (time - began) + self._count
        if not -way <= position - oldest <= way:
            return self._too_fast((position - oldest) / (time - began))
        step = self._limit * cycle + self._count
        if not -step <= position - last <= step:
            return self._too_fast((position - last) / cycle)
        return self._compare(position - oldest) if at == 0 else ""

    def _compare(self, way: float) -> str:
        """One more window of both velocities; what is wrong with the reported one."""
        reported, self._reported = self._reported, 0.0
        if abs(way) < LEAST_COUNTS * self._count:
            return ""
        self._squares += way * way
        self._product += way * reported
        self._windows += 1
        if self._windows < WINDOWS:
            return ""
        slope = self._product / self._squares
        self._squares, self._product, self._windows = 0.5 * self._squares, 0.5 * self._product, WINDOWS // 2
        return "" if SLOPE[0] <= slope <= SLOPE[1] else _other_unit(slope)

    def _too_fast(self, speed: float) -> str:
        return (
            f"by its positions the speed is, or soon will be, {speed:.6g}, but limits.speed allows "
            f"{self._limit:.6g}; look for a disturbance or a jumping encoder, lower the speed of the experiment, "
            "or raise the limit if the machine allows it"
        )


def _other_unit(slope: float) -> str:
    what = "has the opposite sign of" if slope < -SLOPE[0] else f"is {slope:.3g} times"
    return (
        f"the velocity that the drive reports {what} what its positions show ({SLOPE[0]:g} to {SLOPE[1]:g} "
        "times is allowed); correct the unit of velocity in the profile, the drive's velocity unit or the "
        "encoder's counts per revolution"
    )
