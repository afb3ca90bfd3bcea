"""The filters of `signals.filters` for runs of the twin: up to eight motions, lane beside lane.

A recursion waits for its last result; eight of them in vectors take little longer than one. Every number is the same
to the last bit as alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.lanes import WIDTH, along, room_for, side_by_side
from autotune.signals.filters import low_pass_of

Spans = Sequence[tuple[int, int]]


def motions_in_lanes(
    positions: Sequence[Floats], period: float, cutoff: float, spans: Spans
) -> tuple[Floats, Floats, Floats] | None:
    """`filters.motion` of up to eight positions, arrays of shape (8, n): lanes beyond the last have its motion.

    None, and nothing is done, where the cut-off leaves positions as they are or a span is too short to be filtered.
    """
    found = low_pass_of(cutoff, period)
    if found is None or min(last - first for first, last in spans) < 4:
        return None
    smooth, velocity, acceleration = np.empty((3, WIDTH, len(positions[0])))
    for lane in range(WIDTH):
        smooth[lane] = positions[min(lane, len(positions) - 1)]
    done = 0
    for first, last in spans:
        _still(smooth, velocity, acceleration, done, first)
        done, padding = last, min(last - first - 1, found.padding)
        long = room_for(last - first + 2 * padding)
        _motion_in_lanes(
            found.sections, found.rest, padding, first, period, long, smooth, velocity, acceleration
        )
    _still(smooth, velocity, acceleration, done, smooth.shape[1])
    return smooth, velocity, acceleration


def _still(smooth: Floats, velocity: Floats, acceleration: Floats, first: int, last: int) -> None:
    """What is beside the spans."""
    for part in (smooth, velocity, acceleration):
        part[:, first:last] = 0.0


@compiled
def _through(sections: Floats, rest: Floats, values: Floats, back: bool) -> None:
    """Both sections, from rest at the first value, in place; from the last one `back` to the first."""
    b0, b1, b2, a1, a2 = sections[0, 0], sections[0, 1], sections[0, 2], sections[0, 4], sections[0, 5]
    d0, d1, d2, c1, c2 = sections[1, 0], sections[1, 1], sections[1, 2], sections[1, 4], sections[1, 5]
    count = len(values)
    x = values[count - 1 if back else 0]
    z, w, s, t = rest[0, 0] * x, rest[0, 1] * x, rest[1, 0] * x, rest[1, 1] * x
    for k in range(count):
        at = count - 1 - k if back else k
        x = values[at]
        y = b0 * x + z
        z = b1 * x - a1 * y + w
        w = b2 * x - a2 * y
        x = d0 * y + s
        s = d1 * y - c1 * x + t
        t = d2 * y - c2 * x
        values[at] = x


@compiled
def _filtered_motion(
    sections: Floats,
    rest: Floats,
    padding: int,
    start: int,
    period: float,
    long: Floats,
    smooth: Floats,
    velocity: Floats,
    acceleration: Floats,
) -> None:
    """Positions filtered in place and their differences, from a sample on; `long` is room for them and their ends."""
    n = len(long) - 2 * padding
    for k in range(n):
        long[padding + k] = smooth[start + k]
    for i in range(padding):  # an odd extension
        long[i] = 2.0 * long[padding] - long[2 * padding - i]
        long[n + padding + i] = 2.0 * long[n + padding - 1] - long[n + padding - 2 - i]
    _through(sections, rest, long, False)
    _through(sections, rest, long, True)
    for k in range(n):
        smooth[start + k] = long[padding + k]
    for k in range(1, n - 1):
        before, here, later = long[padding + k - 1], long[padding + k], long[padding + k + 1]
        velocity[start + k] = (later - before) / (2.0 * period)
        acceleration[start + k] = ((later - here) - (here - before)) / (period * period)
    end = start + n - 1
    velocity[start] = (long[padding + 1] - long[padding]) / period
    velocity[end] = (long[padding + n - 1] - long[padding + n - 2]) / period
    acceleration[start] = acceleration[end] = 0.0 * long[padding]


@compiled
def _motion_in_lanes(
    sections: Floats,
    rest: Floats,
    padding: int,
    start: int,
    period: float,
    long: Floats,
    smooth: Floats,
    velocity: Floats,
    acceleration: Floats,
) -> None:
    """`_filtered_motion` of eight rows, shape (8, n); `long` of shape (rows, 8)."""
    _filtered_motion(
        sections, rest, padding, start, period, side_by_side(long), along(smooth), along(velocity),
        along(acceleration),
    )  # fmt: skip
