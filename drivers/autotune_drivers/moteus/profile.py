"""Profiles of moteus controllers: which parameters are where, in which unit, and how it is guarded.

They lie beside the CANopen ones and say `protocol = "moteus"`. Parameters are written
`{ at = "servo.pid_position.kp", unit = "Nm/rev" }`; `resolution` is in that unit, where the controller
keeps less than single precision.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field, model_validator

from autotune.core.configuration import Strict, read_toml, validate
from autotune.core.errors import ConfigurationError
from autotune_drivers.profile import PARAMETERS, profile_path
from autotune_drivers.signals import all_known
from autotune_drivers.tables import StepTable

_TURN = 2.0 * math.pi
UNITS: Mapping[str, float] = MappingProxyType(
    {"SI": 1.0, "rev": _TURN, "rev/s": _TURN, "rev/s2": _TURN, "Nm/rev": 1.0 / _TURN, "degC": 1.0}
)
"""SI units in one unit of the controller."""
Number = Annotated[int, Field(ge=0, le=0x7FFF_FFFF)]


class MoteusIdentity(Strict):
    """Registers 100h to 102h of the controllers that the profile is for; what is left out is not compared."""

    model: Number | None = None
    map_min: Number = 0
    map_max: Number = 0x7FFF_FFFF


class MoteusParameter(Strict):
    """A parameter that the controller holds; `min` and `max` in SI."""

    at: Annotated[str, Field(pattern=r"^[a-z0-9_]+(\.[A-Za-z0-9_]+)+$")]
    unit: str = "SI"
    min: float | None = None
    max: float | None = None
    resolution: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _known_unit(self) -> MoteusParameter:
        all_known((self.unit,), UNITS, "unit")
        return self


class MoteusClock(Strict):
    """Where a simulated controller tells that its time advances with commands, and by how much [s]."""

    lock_step: str
    period: str


class MoteusCycle(Strict):
    """How patient the cycle is: seconds for a reply, and how many may be lost in a row."""

    reply_timeout: Annotated[float, Field(gt=0, le=5)] = 0.02
    lost_cycles: Annotated[int, Field(ge=0, le=20)] = 3


class MoteusGuard(Strict):
    """`watchdog`: silence after which the controller stops its axis [s], armed in every command."""

    watchdog: Annotated[float, Field(gt=0.01, le=0.2)] = 0.15


class MoteusStore(Strict):
    """`conf write`, done after at most `seconds`.

    `reload`: only our parameters are written over what is stored, and `conf load` proves that they are
    kept. Not for a real controller: loading sets its position up anew, and turns that it has counted are lost.
    """

    reload: bool = False
    seconds: Annotated[float, Field(gt=0, le=60)] = 5.0


class MoteusProfile(Strict):
    """A kind of moteus controller. See the module's text."""

    schema_version: Annotated[Literal[1], Field(alias="schema")] = 1
    protocol: Literal["moteus"]
    name: str
    title: str
    vendor: str
    identity: MoteusIdentity = MoteusIdentity()
    temperature: Literal["motor", "board", "none"] = "motor"
    parameters: Mapping[str, MoteusParameter] = {}
    session: Mapping[str, float] = {}
    stop_deceleration: MoteusParameter | None = None
    clock: MoteusClock | None = None
    cycle: MoteusCycle = MoteusCycle()
    guard: MoteusGuard = MoteusGuard()
    store: MoteusStore | None = None
    ripple: StepTable | None = None
    transition_seconds: Annotated[float, Field(gt=0, le=30)] = 3.0
    faults: Mapping[str, str] = {}

    @model_validator(mode="after")
    def _known(self) -> MoteusProfile:
        all_known(self.parameters, PARAMETERS, "parameter")
        for text in self.faults:
            int(text)
        return self

    @property
    def fault_texts(self) -> dict[int, str]:
        """Words for the controller's own fault numbers."""
        return {int(number): text for number, text in self.faults.items()}

    @property
    def has_feedforward_block(self) -> bool:
        """True where the controller itself can run the LuGre feedforward."""
        return "feedforward.stiffness" in self.parameters


def read_moteus_profile(name: str, directory: Path | None = None) -> MoteusProfile:
    """Reads a profile: by name from the program's own, or a `.toml` path relative to `directory`.

    Raises:
        ConfigurationError: there is none of that name, it is not for moteus, or it is not valid.
    """
    path = profile_path(name, directory)
    data = read_toml(path, "profile")
    if data.get("protocol", "canopen") != "moteus":
        raise ConfigurationError(
            f"profile {name!r} is for CANopen drives, but the link is a moteus line; write "
            "profile = \"moteus\" (or 'autotune-sim-moteus' for the simulated one) into the axis file"
        )
    return validate(MoteusProfile, data, f"profile {path}")
