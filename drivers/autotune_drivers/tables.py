"""Entries of profiles for tables in a drive: torque over position, which the drive adds by itself.

`[ripple]` in a profile says where they are, in which unit, how fine, in which order they are written, how they
are stored, and from which page all that is. Harmonics are objects of a CANopen drive; the table is moteus's.
Each becomes parameters by name (`autotune.core.ripple_parameters`), in the order in which they are written.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from autotune.core.configuration import Strict
from autotune.core.ripple_parameters import ALIGNMENT, GAIN, ORDER, PHASE, SOURCE, TABLE, TORQUE
from autotune_drivers.canopen.objects import ObjectRef

Object = Annotated[
    ObjectRef, BeforeValidator(lambda value: ObjectRef.parse(value) if isinstance(value, str) else value)
]
Count = Annotated[int, Field(ge=1, le=4096)]


class SaveCommand(Strict):
    """A command object (ETG.1020): bytes written to `command`; `status` is 255 while busy, 0 or 1 when done."""

    command: Object
    value: Annotated[int, Field(ge=0, le=0xFF)]
    status: Object
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
    order: Object
    phase: Object
    torque: Object
    gain: Object
    control: Object | None = None
    use: int = 0
    aligned_by: tuple[Object, ...] = ()
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


def unit_factor(unit: str) -> float:
    """SI units in one unit of a table's object."""
    return math.radians(1.0) if unit == "deg" else 1.0
