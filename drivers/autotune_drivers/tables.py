"""Entries of profiles for tables in a drive: torque over position or over velocity, which the drive adds by itself.

`[ripple]` and `[friction_table]` in a profile say where they are, in which unit, how fine, in which order they are
written, how they are stored, and from which page all that is. Harmonics and points over velocity are objects of a
CANopen drive; the table over position is moteus's. Each becomes parameters by name (`autotune.core.ripple_parameters`,
`autotune.core.friction_table`), in the order in which they are written.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from autotune.core import friction_table
from autotune.core.configuration import Strict
from autotune.core.ripple_parameters import ALIGNMENT, GAIN, ORDER, PHASE, SOURCE, TABLE, TORQUE
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.signals import ObjectField, Signal, SignalField
from autotune_drivers.units import TORQUE_UNITS, VELOCITY_UNITS, Units

Count = Annotated[int, Field(ge=1, le=4096)]


class SaveCommand(Strict):
    """A command object (ETG.1020): bytes written to `command`; `status` is 255 while busy, 0 or 1 when done."""

    command: ObjectField
    value: Annotated[int, Field(ge=0, le=0xFF)]
    status: ObjectField
    seconds: Annotated[float, Field(gt=0, le=60)] = 5.0


class HarmonicsBlock(Strict):
    """`count` harmonics: objects of the first one, the others `stride` sub-indices on.

    Attributes:
        order, phase, torque: whole cycles a turn; degrees, 0 to 360; N m, 0 or above.
        gain: factor of all; 0 switches them off.
        control: says which memory is in use, `use` for what is written and saved.
        aligned_by: read-only objects that tell where the drive counts the turn from.
        save: how they are stored, where the store command of the profile does not do it.
        source: the vendor's page.
    """

    kind: Literal["harmonics"]
    count: Count
    stride: Count
    highest_order: Count
    order: ObjectField
    phase: ObjectField
    torque: ObjectField
    gain: ObjectField
    control: ObjectField | None = None
    use: int = 0
    aligned_by: tuple[ObjectField, ...] = ()
    save: SaveCommand | None = None
    source: str

    def places(self) -> dict[str, tuple[ObjectRef, str]]:
        """Name → object and unit, in the order of writing."""
        found: dict[str, tuple[ObjectRef, str]] = {}
        if self.control is not None:
            found[SOURCE] = (self.control, "SI")
        for number in range(self.count):
            for stem, first, unit in ((ORDER, self.order, "SI"), (PHASE, self.phase, "deg"),
                                      (TORQUE, self.torque, "SI")):  # fmt: skip
                sub = first.sub + number * self.stride
                found[f"{stem}.{number}"] = (ObjectRef(first.index, sub, first.type), unit)
        found[GAIN] = (self.gain, "SI")
        return found

    def told(self) -> dict[str, ObjectRef]:
        """Name → object of what is only read."""
        return {f"{ALIGNMENT}{ref.index:04X}h:{ref.sub:02X}": ref for ref in self.aligned_by}


class StepTable(Strict):
    """A table of whole steps over the turn of the commutation encoder, in a controller with names.

    Attributes:
        at: name of the table; `at.0` to `at.(points − 1)`.
        largest_step: of either sign that is used.
        scale: name of the current of one step [A]; 0 switches the table off.
        constant: name of the motor's rpm/V; the torque constant is `torque_factor` over it [N m/A].
        aligned_by: names of settings that move the zero from which the turn is counted, or its direction.
        source: where all that is to be read.
    """

    kind: Literal["steps"]
    at: str
    points: Count
    largest_step: Annotated[int, Field(ge=1, le=0x7FFF)]
    scale: str
    constant: str
    torque_factor: Annotated[float, Field(gt=0)]
    aligned_by: tuple[str, ...] = ()
    source: str

    def places(self) -> dict[str, str]:
        """Name → the controller's name, in the order of writing."""
        return {f"{TABLE}.{k}": f"{self.at}.{k}" for k in range(self.points)} | {GAIN: self.scale}

    def told(self) -> Mapping[str, str]:
        """Name → the controller's name of what is only read."""
        names = (self.constant, *self.aligned_by)
        return {ALIGNMENT + name: name for name in names}


class VelocityPoints(Strict):
    """`points` of torque over velocity: straight lines between them and from the origin, constant beyond the last.

    The negative half is the positive one turned round. Velocities are written first, then torques, each from the
    first sub-index on, while `feedforward.enabled` (in `[parameters]`) is off; the store command is the profile's.

    Attributes:
        velocity, torque: objects of the first point, with unit; the others are `stride` sub-indices on.
        largest_velocity, largest_torque: in raw units, where the drive takes less than its objects do.
        source: the vendor's page.
    """

    kind: Literal["points"]
    points: Annotated[int, Field(ge=2, le=256)]
    stride: Count = 1
    velocity: SignalField
    torque: SignalField
    largest_velocity: Annotated[float, Field(gt=0)] | None = None
    largest_torque: Annotated[float, Field(gt=0)] | None = None
    source: str

    @model_validator(mode="after")
    def _units(self) -> VelocityPoints:
        for name, signal, known in (("velocity", self.velocity, VELOCITY_UNITS),
                                    ("torque", self.torque, TORQUE_UNITS)):  # fmt: skip
            if signal.unit not in known:
                raise ValueError(
                    f"friction_table.{name} has the unit {signal.unit!r}; write one of {', '.join(sorted(known))}"
                )
            last = signal.ref.sub + (self.points - 1) * self.stride
            if last > 0xFF:
                raise ValueError(f"friction_table.{name} ends at sub-index {last}; a drive has 255 at most")
        return self

    def alone_beside(self, parameters: Collection[str]) -> None:
        """Raises ValueError: friction would be in the drive twice, or nothing switches the table."""
        twice = sorted(
            {f"feedforward.{n}" for n in ("viscous", "coulomb", "break_away", "stiffness")} & {*parameters}
        )
        if twice:
            raise ValueError(f"a friction_table has the whole friction; leave out {', '.join(twice)}")
        if "feedforward.enabled" not in parameters:
            raise ValueError("a friction_table needs feedforward.enabled, which switches it off and on")

    def places(self) -> dict[str, Signal]:
        """Name → object and unit, in the order of writing."""
        return {
            f"{stem}.{k}": first.at(first.ref.sub + k * self.stride)
            for stem, first in (
                (friction_table.VELOCITY, self.velocity),
                (friction_table.TORQUE, self.torque),
            )
            for k in range(self.points)
        }

    def told(self, units: Units) -> dict[str, float]:
        """What the drive can hold, by name [SI]: the largest values, and one step of each."""
        found = {}
        for signal, own, largest, step in (
            (self.velocity, self.largest_velocity, friction_table.LARGEST_VELOCITY, friction_table.VELOCITY_STEP),
            (self.torque, self.largest_torque, friction_table.LARGEST_TORQUE, friction_table.TORQUE_STEP),
        ):  # fmt: skip
            factor = units.factor(signal.unit)
            found[largest] = factor * (signal.ref.range[1] if own is None else own)
            found[step] = 0.0 if signal.ref.is_float else factor
        return found


def unit_factor(unit: str) -> float:
    """SI units in one unit of a table's object."""
    return math.radians(1.0) if unit == "deg" else 1.0
