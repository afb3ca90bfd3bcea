"""Units of drive objects: how many SI units one raw unit is, on the motor side.

| unit | is |
|---|---|
| `SI` | rad, rad/s, N m, … as they are (m, m/s, N on a linear axis) |
| `count`, `count/s`, `count/s2` | of the axis's position sensor |
| `rpm`, `0.1mrpm`, `rpm/s`, `rev/s`, `mrev/s`, `rev/s2` | revolutions a minute or second (rotary axes only) |
| `A`, `mA`, `uA` | current, times the torque constant of the profile: torque |
| `permille` | of the rated torque |
| `mNm`, `uNm` | 1e-3, 1e-6 N m |
| `degC`, `0.1degC`, `ms`, `us` | as they say |
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError

_FIXED = {"SI": 1.0, "mNm": 1e-3, "uNm": 1e-6, "degC": 1.0, "0.1degC": 0.1, "ms": 1e-3, "us": 1e-6}
_COUNTS = ("count", "count/s", "count/s2")
_TURN = 2.0 * math.pi
_TURNS = {
    "rpm": _TURN / 60.0,
    "0.1mrpm": 1e-4 * _TURN / 60.0,
    "rpm/s": _TURN / 60.0,
    "rev/s": _TURN,
    "mrev/s": 1e-3 * _TURN,
    "rev/s2": _TURN,
}
_CURRENTS = {"A": 1.0, "mA": 1e-3, "uA": 1e-6}
_CONSTANTS = {"Nm/A": 1.0, "mNm/A": 1e-3, "uNm/A": 1e-6}
UNITS: tuple[str, ...] = (*_FIXED, *_COUNTS, *_TURNS, *_CURRENTS, *_CONSTANTS, "permille")
TORQUE_UNITS = frozenset({"SI", "mNm", "uNm", "permille", "A", "mA", "uA"})
"""Units that a torque signal may have."""
VELOCITY_UNITS = frozenset({"SI", "count/s", "rpm", "0.1mrpm", "rev/s", "mrev/s"})
"""Units that a velocity may have."""

SIGNED_PARAMETERS = frozenset({"limit.position_min", "limit.position_max", "feedforward.offset"})
"""Parameters whose sign follows the axis's direction; the others are magnitudes."""
MIRRORED: Mapping[str, str] = MappingProxyType(
    {
        "limit.position_min": "limit.position_max",
        "limit.position_max": "limit.position_min",
    }
)
"""Where the drive counts against the axis, its lower limit is our upper one."""


@dataclass(frozen=True, slots=True)
class Units:
    """What turns raw values of one drive on one axis into SI.

    Attributes:
        resolution: one count [rad or m].
        direction: −1 where the drive counts against the axis.
        rated_torque: N m or N.
        rotary: the axis turns.
        torque_constant: N m/A or N/A, nan where the profile names none.
    """

    resolution: float
    direction: int
    rated_torque: float
    rotary: bool
    torque_constant: float = math.nan

    @classmethod
    def of(cls, axis: Axis, rated_torque: float, torque_constant: float = math.nan) -> Units:
        return cls(
            axis.position_resolution,
            axis.mechanics.direction,
            rated_torque,
            axis.motion_unit == "rad",
            torque_constant,
        )

    def factor(self, unit: str) -> float:
        """SI units in one raw unit, without sign.

        Raises:
            ConfigurationError: revolutions on a linear axis, or a current without a torque constant.
        """
        if unit in _COUNTS:
            return self.resolution
        if unit == "permille":
            return self.rated_torque / 1000.0
        if not self.rotary and unit in _TURNS:
            raise ConfigurationError(
                f"the profile gives values in {unit}, but the axis is linear (motion_unit is 'm'); "
                "choose a profile for a linear drive"
            )
        if unit in _CURRENTS:
            return _CURRENTS[unit] * self._constant(unit)
        return _TURNS[unit] if unit in _TURNS else fixed_factor(unit) or 1.0

    def _constant(self, unit: str) -> float:
        if not self.torque_constant > 0.0:
            raise ConfigurationError(
                f"the profile gives torques as currents ({unit}), but the torque constant is "
                f"{self.torque_constant:g}; set torque.constant in the profile, and the motor's data in the drive"
            )
        return self.torque_constant

    def signed(self, unit: str) -> float:
        """SI units in one raw unit, with the axis's direction."""
        return self.direction * self.factor(unit)


def fixed_factor(unit: str) -> float | None:
    """SI units in one raw unit where no axis is needed to know them, else None."""
    return _FIXED.get(unit, _CONSTANTS.get(unit))


def is_current(unit: str) -> bool:
    """True where the torque constant is needed."""
    return unit in _CURRENTS


def is_constant(unit: str) -> bool:
    """True for units of a torque constant."""
    return unit in _CONSTANTS
