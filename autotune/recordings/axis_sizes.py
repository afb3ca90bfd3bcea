"""Could this be an axis? What units declared wrongly do to a recording and to what is fitted to it.

A wrong unit multiplies time, position or torque by a constant. No fit notices: every equation of motion
still holds, with other parameters. What does notice is the size of what comes out:

- rows further apart than any servo loop is recorded, speeds, accelerations and powers of no motor;
- the natural frequency of the contact at rest √(σ0/J) and the time J·v/F in which the axis coasts to rest,
  which contain no torque: time in another unit moves them by the same factor;
- the length F_c/σ0 over which friction reverses, which contains neither torque nor time: position in
  another unit moves it;
- on a linear axis F_c/(J·g), friction as a part of the weight.

Beyond its `possible` range a size is refused, beyond its `usual` one a question is asked, with the unit
that would bring it back. A factor on torque alone leaves no trace but in the power and in the absolute
sizes: `sizes_line` states them in an engineer's units, for a person to judge.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.core.units import torque_symbol
from autotune.recordings.checks import torque_of
from autotune.recordings.recording import Recording
from autotune.signals.filters import motion

GRAVITY = 9.81
TOO_MANY = 3
"""Unusual sizes that one mistaken unit explains: two may belong to one odd motion, a third does not."""


@dataclass(frozen=True, slots=True)
class Range:
    """What a size may be.

    Attributes:
        name: with which the size is told, with a place for the value: `rows are {} apart`.
        possible: outside, it is no axis.
        usual: outside, a question is asked.
        time, position: powers of the units of time and position in the size.
    """

    name: str
    unit: str
    possible: tuple[float, float]
    usual: tuple[float, float]
    time: int
    position: int


RANGES: Mapping[str, Mapping[str, Range]] = MappingProxyType(
    {
        "rad": {
            "period": Range("spacing of the rows", "s", (2e-6, 2.0), (2e-5, 0.3), 1, 0),
            "speed": Range("highest speed", "rad/s", (1e-6, 1e5), (1e-2, 4e3), -1, 1),
            "acceleration": Range("highest acceleration", "rad/s²", (1e-6, 1e8), (5e-3, 1e6), -2, 1),
            "resonance": Range("natural frequency at rest √(σ0/J)/2π", "Hz", (0.05, 2e4), (0.7, 3e3), -1, 0),
            "coasting": Range("time to coast to rest J·v/F", "s", (1e-6, 3e3), (2e-4, 100.0), 1, 0),
            "reach": Range(
                "motion in which friction reverses F_c/σ0", "rad", (1e-8, 10.0), (1e-5, 0.12), 0, 1
            ),
        },
        "m": {
            "period": Range("spacing of the rows", "s", (2e-6, 2.0), (2e-5, 0.3), 1, 0),
            "speed": Range("highest speed", "m/s", (1e-8, 300.0), (1e-4, 20.0), -1, 1),
            "acceleration": Range("highest acceleration", "m/s²", (1e-7, 1e5), (1e-3, 1e3), -2, 1),
            "resonance": Range("natural frequency at rest √(σ0/J)/2π", "Hz", (0.05, 2e4), (0.7, 3e3), -1, 0),
            "coasting": Range("time to coast to rest J·v/F", "s", (1e-6, 3e3), (2e-4, 100.0), 1, 0),
            "reach": Range("motion in which friction reverses F_c/σ0", "m", (1e-10, 1.0), (1e-8, 3e-3), 0, 1),
            "weight": Range("friction as part of the weight F_c/(J·g)", "", (1e-6, 1e3), (2e-4, 5.0), -2, 1),
        },
    }
)
"""Ends of the ranges: direct drives of telescopes, harmonic gears, air bearings at the one, galvanometer
scanners, turbine spindles and linear motors at the other. Possible ones lie beyond every such extreme."""
POWER = Range("power, torque times speed,", "W", (1e-15, 1e9), (1e-8, 1e6), -1, 1)
"""From presliding of a watch's gear to a mill's main drive. It follows the speed, so it is judged by itself."""
_MISTAKES: tuple[tuple[str, str, float, float], ...] = (
    ("rad", "time is in ms", 1e-3, 1.0),
    ("rad", "time is in µs", 1e-6, 1.0),
    ("rad", "time is in s and was taken as ms", 1e3, 1.0),
    ("rad", "position is in degrees", 1.0, math.pi / 180.0),
    ("rad", "position is in turns", 1.0, 2.0 * math.pi),
    ("rad", "position is in counts, or in mrad", 1.0, 1e-3),
    ("rad", "speeds are in rpm", 1.0, math.pi / 30.0),
    ("m", "time is in ms", 1e-3, 1.0),
    ("m", "time is in µs", 1e-6, 1.0),
    ("m", "time is in s and was taken as ms", 1e3, 1.0),
    ("m", "position is in mm", 1.0, 1e-3),
    ("m", "position is in µm", 1.0, 1e-6),
    ("m", "position is in m and was taken as mm", 1.0, 1e3),
)
"""What is mistaken most: motion unit, in words, what time and position have to be multiplied by."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """How large a motion is [SI]; 99 % points, so that single wild rows do not count."""

    period: float
    travel: float
    speed: float
    acceleration: float
    torque: float
    power: float


def sizes(recording: Recording) -> Sizes:
    """Sizes of the motion, of its positions filtered at a fiftieth of the sampling frequency."""
    speeds, accelerations, powers, travel = [], [], [], 0.0
    torque = torque_of(recording)
    for segment, part in recording.split():
        if len(part) < 16:
            continue
        _, velocity, acceleration = motion(part["position"], part.period, 0.02 / part.period)
        speeds.append(np.abs(velocity))
        accelerations.append(np.abs(acceleration[1:-1]))
        powers.append(np.abs(velocity * torque[segment.rows]))
        travel = max(travel, float(np.ptp(part["position"])))
    return Sizes(
        recording.period,
        travel,
        _high(speeds),
        _high(accelerations),
        float(np.percentile(np.abs(torque), 99.0)) if len(torque) else 0.0,
        _high(powers),
    )


def _high(parts: list[Floats]) -> float:
    return float(np.percentile(np.concatenate(parts), 99.0)) if parts else 0.0


def refuse_unlike_axis(
    recording: Recording, where: str = "the recording", known: Mapping[str, float] = MappingProxyType({})
) -> list[str]:
    """Questions about the units of a recording; empty where its sizes are usual.

    Args:
        where: the file, for the message.
        known: other sizes of `RANGES`, where something tells them.

    Raises:
        RecordingError: no axis moves like this.
    """
    found = sizes(recording)
    if found.speed == 0.0:
        return []
    values = motion_sizes(found) | dict(known)
    impossible, questions = judged_together(values, recording.metadata.motion_unit)
    too_much, doubtful = _judged_power(found, recording)
    if impossible or too_much:
        raise RecordingError(f"{where} is not of an axis: {[*impossible, *too_much][0]}")
    return questions + doubtful


def _judged_power(found: Sizes, recording: Recording) -> tuple[list[str], list[str]]:
    """As `judged`: of a power in watts, where the axis moved and torque is no current."""
    if recording.metadata.torque_unit or found.power == 0.0:
        return [], []
    return _outside(POWER, found.power, "Units of torque are given with '--column torque=FIELD*UNIT'")


def judged_together(values: Mapping[str, float], motion_unit: str) -> tuple[list[str], list[str]]:
    """`judged`, where several unusual sizes with one explanation are impossible."""
    impossible, questions = judged(values, motion_unit)
    if len(questions) >= TOO_MANY and _mistakes(values, motion_unit):
        impossible = [*impossible, _all_unusual(values, motion_unit)]
    return impossible, questions


def _all_unusual(values: Mapping[str, float], motion_unit: str) -> str:
    """One sentence for all sizes that one mistake explains."""
    ranges = RANGES[motion_unit]
    told = [
        f"{_told(one, value)} (usual {one.usual[0]:g} to {one.usual[1]:g})"
        for one, value in ((ranges[name], value) for name, value in values.items())
        if not one.usual[0] <= value <= one.usual[1]
    ]
    return f"{', '.join(told)}. {_hint(values, motion_unit)}"


def motion_sizes(moved: Sizes) -> dict[str, float]:
    return {"period": moved.period, "speed": moved.speed, "acceleration": moved.acceleration}


def judged(values: Mapping[str, float], motion_unit: str) -> tuple[list[str], list[str]]:
    """Sentences on sizes that cannot be, and questions on those that are unusual."""
    ranges = RANGES[motion_unit]
    impossible, questions = [], []
    hint = _hint(values, motion_unit)
    for name, value in values.items():
        beyond, unusual = _outside(ranges[name], value, hint)
        impossible += beyond
        questions += unusual
    return impossible, questions


def _outside(one: Range, value: float, hint: str) -> tuple[list[str], list[str]]:
    """A sentence where the value cannot be, or a question where it is unusual."""
    (low, high), (least, most) = one.possible, one.usual
    if not low <= value <= high:
        return [f"{_told(one, value)}; possible are {low:g} to {high:g}. {hint}"], []
    if not least <= value <= most:
        return [], [f"{_told(one, value)}; usual are {least:g} to {most:g}. Are the units right? {hint}"]
    return [], []


def _told(one: Range, value: float) -> str:
    return f"{one.name} is {value:.3g} {one.unit}".rstrip()


def _hint(values: Mapping[str, float], motion_unit: str) -> str:
    """The units with which every size is usual."""
    fitting = _mistakes(values, motion_unit)
    told = f"It would be usual if {' or if '.join(fitting)}. " if fitting else ""
    return f"{told}Units are given with 'autotune data import --column NAME=FIELD*UNIT'"


def _mistakes(values: Mapping[str, float], motion_unit: str) -> list[str]:
    return [
        words
        for unit, words, time, position in _MISTAKES
        if unit == motion_unit and all(_usual(name, v, unit, time, position) for name, v in values.items())
    ]


def _usual(name: str, value: float, motion_unit: str, time: float, position: float) -> bool:
    one = RANGES[motion_unit][name]
    return one.usual[0] <= value * time**one.time * position**one.position <= one.usual[1]


def sizes_line(recording: Recording, inertia: float | None = None) -> str:
    """The motion in an engineer's units: what a person sees at once is wrong, no bound can."""
    found, metadata = sizes(recording), recording.metadata
    force = torque_symbol(metadata.motion_unit, metadata.torque_unit)
    turning = metadata.motion_unit == "rad"
    speed = f"{found.speed * 30 / math.pi:.3g} rpm" if turning else f"{found.speed:.3g} m/s"
    travel = f"{found.travel / (2 * math.pi):.3g} turns" if turning else f"{found.travel * 1e3:.3g} mm"
    parts = [
        f"rows {found.period * 1e3:.3g} ms apart",
        f"travel {travel}",
        f"up to {speed}",
        f"{found.acceleration:.3g} {metadata.motion_unit}/s²",
        f"{found.torque:.3g} {force}",
    ]
    if not metadata.torque_unit:
        parts.append(f"{found.power:.3g} W")
    if inertia is not None and not metadata.torque_unit:
        parts.append(f"{inertia:.3g} kg m²" if turning else f"{inertia:.3g} kg")
    return "the axis in the units declared: " + ", ".join(parts)
