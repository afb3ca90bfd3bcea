"""Parameters of the simulated drive: names, ranges, factory values; volatile and stored.

The names are those of `autotune.core.drive.Drive`; values are SI. What is written is kept as the drive
keeps it, in single precision.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune_sim.presets import Preset


@dataclass(frozen=True, slots=True)
class Range:
    """What a parameter may be, and its factory value."""

    default: float
    low: float
    high: float
    unit: str


_TABLE: dict[str, Range] = {
    "controller.kp": Range(60.0, 0.0, 1e4, "N m/rad"),
    "controller.kd": Range(0.15, 0.0, 100.0, "N m s/rad"),
    "controller.ki": Range(6000.0, 0.0, 1e6, "N m/(rad s)"),
    "controller.derivative_filter": Range(0.5, 0.01, 1.0, "1"),
    "feedforward.enabled": Range(0.0, 0.0, 1.0, "0 or 1"),
    "feedforward.inertia": Range(0.0, 0.0, 1.0, "kg m²"),
    "feedforward.viscous": Range(0.0, 0.0, 10.0, "N m s/rad"),
    "feedforward.coulomb": Range(0.0, 0.0, 100.0, "N m"),
    "feedforward.break_away": Range(0.0, 0.0, 100.0, "N m"),
    "feedforward.stribeck_velocity": Range(0.1, 1e-4, 100.0, "rad/s"),
    "feedforward.stiffness": Range(0.0, 0.0, 1e6, "N m/rad"),
    "feedforward.micro_damping": Range(0.0, 0.0, 100.0, "N m s/rad"),
    "feedforward.offset": Range(0.0, -100.0, 100.0, "N m"),
    "feedforward.reference_filter": Range(0.0, 0.0, 0.99, "1"),
    "limit.position_min": Range(-25.0, -1000.0, 1000.0, "rad"),
    "limit.position_max": Range(25.0, -1000.0, 1000.0, "rad"),
    "limit.speed": Range(50.0, 0.01, 400.0, "rad/s"),
    "limit.torque": Range(1.34, 0.0, 1.34, "N m"),
    "limit.following_error": Range(0.3, 1e-4, 1000.0, "rad"),
    "limit.deceleration": Range(400.0, 1.0, 2000.0, "rad/s²"),
    "limit.temperature": Range(100.0, 30.0, 150.0, "°C"),
}
NAMES = tuple(_TABLE)
CONTROL = np.dtype([(name.replace(".", "_"), np.float64) for name in NAMES], align=True)


class Parameters(Mapping[str, float]):
    """The drive's parameters by name. `record` is what the control kernel reads, shape (1,)."""

    def __init__(self, preset: Preset) -> None:
        self._ranges = _ranges(preset)
        self.record: NDArray[np.void] = np.zeros(1, CONTROL)
        self._values: dict[str, float] = {}
        self.restore({name: entry.default for name, entry in self._ranges.items()})

    def __getitem__(self, name: str) -> float:
        self._known(name)
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def range(self, name: str) -> Range:
        """Factory value, bounds and unit of a parameter.

        Raises:
            KeyError: no such parameter.
        """
        self._known(name)
        return self._ranges[name]

    def set(self, name: str, value: float) -> None:
        """Sets one parameter, in single precision.

        Raises:
            KeyError: no such parameter, with the nearest right name.
            ValueError: a value out of range, in words.
        """
        self.check(name, value)
        self._values[name] = kept = float(np.float32(value))
        self.record[name.replace(".", "_")] = kept

    def check(self, name: str, value: float) -> None:
        """Raises what `set` would raise."""
        self._known(name)
        allowed = self._ranges[name]
        inside = allowed.low <= value <= allowed.high * (1.0 + 1e-6)
        if not (math.isfinite(value) and inside) or (name == "feedforward.enabled" and value not in (0, 1)):
            raise ValueError(
                f"parameter {name} of the simulated drive cannot be {value}; "
                f"allowed is {allowed.low:g} to {allowed.high:g} [{allowed.unit}]"
            )

    def snapshot(self) -> dict[str, float]:
        """All values, as `restore` takes them."""
        return dict(self._values)

    def restore(self, values: Mapping[str, float]) -> None:
        """Sets all parameters in `values`; none is changed where one cannot be.

        Raises:
            KeyError, ValueError: as `set`.
        """
        for name, value in values.items():
            self.check(name, value)
        for name, value in values.items():
            self.set(name, value)

    def _known(self, name: str) -> None:
        if name not in self._ranges:
            near = difflib.get_close_matches(name, self._ranges, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(self._ranges)}"
            raise KeyError(f"the simulated drive has no parameter {name!r}; {hint}")


def _ranges(preset: Preset) -> dict[str, Range]:
    gains, torque = preset.gains, preset.plant.torque_limit
    factory = {
        "controller.kp": gains.kp,
        "controller.kd": gains.kd,
        "controller.ki": gains.ki,
        "controller.derivative_filter": gains.derivative_filter,
        "limit.torque": torque,
    }
    table = {name: _about(entry, factory.get(name, entry.default)) for name, entry in _TABLE.items()}
    table["limit.torque"] = Range(torque, 0.0, torque, "N m")
    return table


def _about(entry: Range, factory: float) -> Range:
    """The table's range with a factory value; wider where that is beyond it, as gains of a linear axis are."""
    high = entry.high if factory <= entry.high else 10.0 * factory
    return Range(factory, entry.low, high, entry.unit)
