"""What gains must keep, and by how much they miss it, over all axes of the family in both regimes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from autotune.control.gains.loop import Gains
from autotune.control.gains.members import NOMINAL, Family, Member
from autotune.control.gains.regimes import REGIMES, linear_axis
from autotune.control.gains.sampled import (
    Complexes,
    SampledAxis,
    axis_response,
    controller_response,
    frequencies,
    margins,
    sampled_axis,
)
from autotune.core.arrays import Floats


@dataclass(frozen=True, slots=True)
class Requirements:
    """What gains must keep on the nominal axis, and the part of it that is left at the ends of the intervals.

    Attributes:
        modulus: distance of L from −1, that is a sensitivity of at most 1/modulus (Åström and Hägglund, Advanced
            PID Control, ch. 4, take 1/1.4 to 1/2.0).
        phase: [deg]; gain: [dB], to either side.
        noise: step of the torque for one count, as a share of the torque limit.
        corners: part of modulus, phase and gain that every other member must keep.
    """

    modulus: float = 0.5
    phase: float = 30.0
    gain: float = 6.0
    noise: float = 0.05
    corners: float = 0.75

    def scaled(self, part: float) -> Requirements:
        """The same with margins that many times as large."""
        return replace(
            self, modulus=min(self.modulus * part, 0.85), phase=self.phase * part, gain=self.gain * part
        )


@dataclass(frozen=True, slots=True)
class Corner:
    """One axis in one regime, sampled."""

    what: str
    axis: SampledAxis
    response: Complexes
    period: float
    nominal: bool


def corners_of(kin: Family) -> tuple[Corner, ...]:
    """Both regimes of every member."""
    return tuple(_corner(one, regime) for one in kin.members for regime in REGIMES)


def _corner(member: Member, regime: str) -> Corner:
    axis = sampled_axis(
        linear_axis(member.model, "sticking" if regime == "sticking" else "sliding"), member.timing
    )
    period = member.timing.period
    return Corner(
        f"{regime}, {member.what}", axis, axis_response(axis, period), period, member.what == NOMINAL
    )


def shaped(corners: tuple[Corner, ...], current: Gains, point: Floats) -> Gains:
    """Gains of (ln ωc, ln a, ln b) in the structure of `current`; kd from |L(ωc)| = 1 on the nominal axis, sliding."""
    crossover, a, b = np.exp(point)
    rate = 2.0 * math.pi * crossover
    integral = 0.0 if current.structure == "pi_velocity" else rate**2 / (a * b)
    unit = current.scaled(rate / a, 1.0, integral)
    nominal = corners[1]
    loop = np.abs(nominal.response * controller_response(unit, nominal.period))
    at = float(
        np.interp(math.log(crossover), np.log(frequencies(nominal.period)), np.log(np.maximum(loop, 1e-300)))
    )
    kd = math.exp(-at)
    return current.scaled(kd * rate / a, kd, kd * integral)


def shortfall(corners: tuple[Corner, ...], gains: Gains, wanted: Requirements) -> float:
    """By how much the requirements are missed over all corners, 0 where they are kept."""
    total, less = 0.0, wanted.scaled(wanted.corners)
    for one in corners:
        found = margins(one.axis, gains, one.period, one.response)
        if not found.stable:
            return 10.0 + min(found.radius, 10.0)
        least = wanted if one.nominal else less
        total += max(0.0, least.modulus - found.modulus) / least.modulus
        total += max(0.0, least.phase - found.phase) / least.phase
        total += max(0.0, least.gain - min(found.gain, found.gain_down)) / least.gain
    return total


def binding(corners: tuple[Corner, ...]) -> tuple[Corner, ...]:
    """The corners that usually bind; all are looked at in the end."""
    keys = (
        "nominal",
        "inertia low",
        "inertia high",
        "damping low",
        "compliance",
        "dead time",
        "torque lag high",
    )
    return tuple(one for one in corners if any(key in one.what for key in keys))
