"""Units of drive objects: how many SI units one raw unit is, on the motor side.

| unit | is |
|---|---|
| `SI` | rad, rad/s, N m, … as they are (m, m/s, N on a linear axis) |
| `count`, `count/s`, `count/s2` | of the axis's position sensor |
| `rpm` | revolutions a minute (rotary axes only) |
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
UNITS: tuple[str, ...] = (*_FIXED, *_COUNTS, "rpm", "permille")

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
    """

    resolution: float
    direction: int
    rated_torque: float
    rotary: bool

    @classmethod
    def of(cls, axis: Axis, rated_torque: float) -> Units:
        return cls(
            axis.position_resolution, axis.mechanics.direction, rated_torque, axis.motion_unit == "rad"
        )

    def factor(self, unit: str) -> float:
        """SI units in one raw unit, without sign.

        Raises:
            ConfigurationError: rpm on a linear axis.
        """
        if unit in _COUNTS:
            return self.resolution
        if unit == "permille":
            return self.rated_torque / 1000.0
        if unit == "rpm":
            if not self.rotary:
                raise ConfigurationError(
                    "the profile gives speeds in rpm, but the axis is linear (motion_unit is 'm'); "
                    "choose a profile for a linear drive"
                )
            return 2.0 * math.pi / 60.0
        return _FIXED[unit]

    def signed(self, unit: str) -> float:
        """SI units in one raw unit, with the axis's direction."""
        return self.direction * self.factor(unit)


def fixed_factor(unit: str) -> float | None:
    """SI units in one raw unit where no axis is needed to know them, else None."""
    return _FIXED.get(unit)
