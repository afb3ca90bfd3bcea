"""What shakes an axis beside its command, as the twin is disturbed: process noise with its colour, sensor noise apart.

A process disturbance is a torque on the axis: white, and a part with a memory (a first-order autoregression).
It passes through the loop into position and torque. Noise of the position sensor passes through the
controller; noise of the torque sensor reaches nothing but the record.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats
from autotune.estimation.controller_law import LoopSamples, PositionController, late_samples
from autotune.models.compiled import compiled
from autotune.signals.rounded_recursion import BESIDE, SAME, by_rounding


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Levels are standard deviations.

    Attributes:
        white: of a torque on the axis that is new in every sample [N m]; `coloured`: of one with a memory.
        correlation: time constant of that memory [s].
        position: of the position before it is quantised.
        sensor: of the recorded torque [N m]; the axis does not feel it. nan where unknown.
        uneven: variance of stretches over what it is usually, where that is more than chance; else 1.
        jitter: of the moment at which a row is written [s]; the axis does not feel it.
    """

    white: float = 0.0
    coloured: float = 0.0
    correlation: float = 0.0
    position: float = 0.0
    sensor: float = math.nan
    uneven: float = 1.0
    jitter: float = 0.0

    @property
    def process(self) -> float:
        """Of all torque that acts on the axis [N m]."""
        return math.hypot(self.white, self.coloured)

    def level_at(self, hertz: float, period: float) -> float:
        """Level of the white noise that is as dense at this frequency [N m]."""
        dense = float(coloured_power(np.array([hertz]), self.correlation, period)[0])
        return math.hypot(self.white, self.coloured * math.sqrt(dense))

    def louder(self, factor: float) -> Disturbance:
        """The same disturbance with `factor` times the torque and the position noise."""
        return replace(
            self, white=factor * self.white, coloured=factor * self.coloured, position=factor * self.position
        )

    def drawn(self, random: np.random.Generator, size: int, period: float) -> Floats:
        """A process disturbance [N m], shape (size,); always takes as many random numbers."""
        fresh = random.normal(0.0, 1.0, (2, size))
        memory = memory_of(self.correlation, period)
        gain = math.sqrt(1.0 - memory**2)
        fresh[1, :1] /= gain  # so that it begins with its usual variance
        coloured = scipy.signal.lfilter([gain], [1.0, -memory], fresh[1])
        return np.asarray(self.white * fresh[0] + self.coloured * coloured)


def memory_of(correlation: float, period: float) -> float:
    """Coefficient of the autoregression from sample to sample."""
    return math.exp(-period / correlation) if correlation > 0.0 else 0.0


def coloured_power(hertz: Floats, correlation: float, period: float) -> Floats:
    """Spectrum of a unit-variance autoregression over that of white noise of unit variance, shape (f,)."""
    memory = memory_of(correlation, period)
    angle = 2.0 * np.pi * hertz * period
    return np.asarray((1.0 - memory**2) / (1.0 - 2.0 * memory * np.cos(angle) + memory**2))


def jitter_of(measured: Floats, stretches: Sequence[slice], period: float) -> float:
    """Spread of the moment at which rows are written [s], by positions of shape (n,); 0 where there is none.

    Such rows are off by speed times delay, each by itself: differences of two orders, which take out the motion, are
    then as large as each other and in proportion to speed. Of a slow recording the fourth still holds motion.
    """
    return next((spread for low in (4, 6) if (spread := _spread(measured, stretches, period, low))), 0.0)


def _spread(measured: Floats, stretches: Sequence[slice], period: float, order: int) -> float:
    """The same by differences of this order and the second above it."""
    edge = order // 2 + 1
    moved = [np.abs(np.gradient(measured[rows], period))[edge:-edge] for rows in stretches]
    speed = np.concatenate(moved)
    lower, higher = (
        np.concatenate([_differences(measured[rows], of)[edge - of // 2 : len(v) + edge - of // 2]
                        for rows, v in zip(stretches, moved, strict=True)])
        for of in (order, order + 2)
    )  # fmt: skip
    edges = np.quantile(speed[speed > SLOW * np.quantile(speed, 0.99)], np.linspace(0.0, 1.0, SPEEDS + 1))
    delays, alike = [], []
    for low, high in itertools.pairwise(edges.tolist()):
        inside = (speed >= low) & (speed <= high)
        power = float(np.median(lower[inside] ** 2)) / CHI
        alike.append(float(np.median(higher[inside] ** 2)) / CHI / max(power, 1e-300))
        delays.append(math.sqrt(power / float(np.mean(speed[inside] ** 2))))
    quick = delays[len(delays) // 3 :]
    proportional = min(quick) > PROPORTIONAL * max(quick)
    return float(np.mean(quick)) if proportional and 0.5 < float(np.median(alike)) < 2.0 else 0.0


def readings(
    seen: tuple[Floats, Floats, Floats], held: Flags, recursion: Floats, within: float, counts: float
) -> Floats | None:
    """Positions as a controller read them, told by what it asked for, shape (n,); None where no row was written late.

    A row that is written late holds another position than the one that was read for its demand. In three rows

        u[k] − u[k−1] = m·(u[k−1] − u[k−2]) + Σ_i (a_i·r[k−i] − b_i·y[k−i]),  i = 0, 1, 2

    and so the last of the readings is known from the two before it. None, too, where the law is not this one: then
    hardly a row holds what it tells, or what differs is no late row, which is ahead on the way by a sample's motion.

    Args:
        seen: reference and position as recorded, in the row of the demand that they made, and that demand.
        held: rows where the demand is not the controller's, shape (n,).
        recursion: m, a_0 to a_2, b_0 to b_2.
        within: by what a reading that is told so may be off.
        counts: of the encoder; 0 where there are none.
    """
    told = seen[1].copy()
    same, late, other = _read_in_turn(*seen, held, recursion, within, counts, told)
    prompt = same > (1.0 - ON_THE_WAY) * len(told)
    return told if prompt and late > ON_THE_WAY * (late + other) else None


@compiled
def _read_in_turn(
    reference: Floats,
    position: Floats,
    demand: Floats,
    held: Flags,
    recursion: Floats,
    within: float,
    counts: float,
    told: Floats,
) -> tuple[int, int, int]:
    """Readings one after the other, written to `told`; how many rows hold what was read, a later place, and another.

    It begins, and begins again, where three rows that belong together show that none of them is late.
    """
    same, late, other, known = 0, 0, 0, False
    alike = max(within, 0.5 * counts)  # the decimals of a file are no late row
    for k in range(2, len(told)):
        if held[k] or held[k - 1] or held[k - 2]:
            known = False
            continue
        rest = demand[k] - demand[k - 1] - recursion[0] * (demand[k - 1] - demand[k - 2])
        for i in range(3):
            rest -= recursion[1 + i] * reference[k - i]
        for i in range(1, 3):
            rest += recursion[4 + i] * told[k - i]
        ahead = position[k] + rest / recursion[4]
        if abs(ahead) <= (alike if known else within):
            same, known = same + 1, True
        elif known:
            before, now = told[k - 1] - told[k - 2], position[k] - ahead - told[k - 1]
            low, high = min(before, now, 0.0) - 2.0 * counts, max(before, now, 0.0) + 2.0 * counts
            known = low <= ahead <= high
            if known:
                told[k] = position[k] - (round(ahead / counts) * counts if counts > 0.0 else ahead)
            if known and math.copysign(ahead, ahead * before) > -counts:
                late += 1
            else:
                other += 1
    return same, late, other


def _differences(values: Floats, order: int) -> Floats:
    """Of an order, so that white noise keeps its variance."""
    return np.asarray(np.diff(values, order) / math.sqrt(math.comb(2 * order, order)))


SLOW, SPEEDS, CHI, PROPORTIONAL = 0.05, 6, 0.4549, 0.8
"""Of the largest speed: slower tells nothing; classes of speed; median over mean of a squared normal number; and how
far classes of the faster two thirds may be apart."""
ON_THE_WAY = 0.95
"""Of the rows that hold another position than was read, those that are ahead on the way: else none was late."""
STILL = Disturbance()
"""Nothing shakes the axis."""


def positions_read(samples: LoopSamples, law: PositionController, counts: float) -> Floats | None:
    """Positions as the controller read them, shape (n,), where rows hold later ones; None where none does.

    By a law that is exact at the samples and has no feedforward; and where a demand tells a reading to half a count, as
    roundings of demands would add up in readings one after the other. `counts`: of the encoder, 0 for none.
    """
    forward = law.velocity_feedforward, law.position_feedforward, law.acceleration_feedforward
    if not law.exact or law.ticks > 1 or law.smeared or any(forward):
        return None
    memory, rate = 1.0 - law.derivative_filter, law.kd * law.derivative_filter / samples.period
    summed = law.ki * samples.period
    of_error = np.array([law.kp + summed, -law.kp * (1.0 + memory) - memory * summed, memory * law.kp])
    of_rate = rate * np.array([1.0, -2.0, 1.0])
    recursion = np.concatenate([[memory], of_error + law.reference_rate * of_rate, of_error + of_rate])
    step = samples.step
    least = SAME * float(np.std(np.diff(samples.position)))
    within = max(BESIDE * by_rounding(recursion, step) / float(recursion[4]), least)
    if within > 0.5 * counts and step > 0.0:
        return None
    late = late_samples(samples, law.reference_delay, law.position_delay)
    told, found = samples.position.copy(), False
    for rows in samples.stretches:
        seen = late.reference[rows], late.position[rows], late.demand[rows]
        read = readings(seen, late.clamped[rows], recursion, within, counts)
        if read is not None:
            told[rows.start : rows.stop - law.position_delay] = read[law.position_delay :]
            found = True
    return told if found else None
