"""A motion that nothing was adapted to: what was learned on the benchmark must not harm any other.

Inside the benchmark's own travel, speed and acceleration, but of another kind: a quick move with a rest, strokes of
constant speed, a smaller and faster sine. With A and f of the benchmark and v = 2πfA it goes up to 0.8·A, 0.9·v
and about v²/A, so it needs no limit that the benchmark does not need.
The feedforward fades in on the way to the first place and out on the way home; neither is judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from autotune.core.arrays import Floats
from autotune.experiments.path import Motion, Path
from autotune.experiments.sines import BenchmarkSine, Row
from autotune.recordings.recording import CONDITIONING
from autotune.signals.excitation import smooth_step

HELD_OUT = "held_out"
FAR, NEAR = 0.8, 0.3  # of the benchmark's amplitude: where it turns
FAST, STEADY = 0.9, 0.5  # of its peak speed
SMALL, QUICK = 0.2, 1.6  # amplitude and frequency of the sine, of the benchmark's
REST = 0.05  # of a period of the benchmark, at rest between two moves


@dataclass(frozen=True)
class HeldOut(BenchmarkSine):
    """One window of the held-out motion under `label`; `repeats` and `periods` of the benchmark play no part."""

    label: str = HELD_OUT

    def trace(self, path: Path) -> None:
        motion, reach = self.motion, self.motion.amplitude
        speed, hard = motion.usual_speed, motion.usual_speed**2 / motion.amplitude
        centre, rest = motion.centre, REST / motion.frequency
        path.move(centre - FAR * reach, FAST * speed, hard)
        path.mark(self.label, self.first_repeat)
        path.move(centre + FAR * reach, FAST * speed, hard).dwell(rest)
        path.move(centre + NEAR * reach, STEADY * speed, hard)
        path.add(path.position + _small_sine(motion)).dwell(rest)
        path.move(centre - FAR * reach, STEADY * speed, hard)
        path.mark(CONDITIONING).move(centre, FAST * speed, hard)

    @cached_property
    def rows(self) -> list[Row]:
        """As of the benchmark; the share of the feedforward is 1 wherever the motion is judged."""
        plan = self.plan
        edges = [first for first, _, _ in plan.marks]
        begin, end, count = edges[1], edges[2], len(plan.reference)
        place = np.arange(1, count + 1)
        gain = smooth_step(place / begin) * smooth_step((count - place) / (count - end))
        columns = (plan.reference, plan.velocity, plan.acceleration, gain)
        return list(zip(*(column.tolist() for column in columns), strict=True))


def _small_sine(motion: Motion) -> Floats:
    """One period round zero, faded in and out; shape (n,)."""
    count = motion.samples(1.0 / (QUICK * motion.frequency))
    turn = np.arange(1, count + 1) / count
    fade = smooth_step(4.0 * turn) * smooth_step(4.0 * (1.0 - turn))
    return np.asarray(SMALL * motion.amplitude * fade * np.sin(2.0 * np.pi * turn))
