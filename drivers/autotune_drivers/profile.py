"""Profiles: where a drive keeps what, in which unit. One TOML file for each kind of drive.

A profile says which drive it is for (object 1018h), which objects carry the cycle, which parameters
the drive can hold, how they are stored, and what its own error codes mean. Nothing is assumed that is
not in it. Signals are written `6064:00 i32 count`: object, type, unit.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from autotune.core.configuration import Strict, read_toml, validate
from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.signals import ObjectField, SignalField, all_known
from autotune_drivers.tables import HarmonicsBlock, VelocityPoints
from autotune_drivers.units import TORQUE_UNITS, is_constant, is_current

PARAMETERS = (
    "limit.position_min",
    "limit.position_max",
    "limit.speed",
    "limit.torque",
    "limit.following_error",
    "limit.deceleration",
    "limit.temperature",
    "controller.kp",
    "controller.kd",
    "controller.ki",
    "controller.derivative_filter",
    "feedforward.enabled",
    "feedforward.inertia",
    "feedforward.viscous",
    "feedforward.coulomb",
    "feedforward.break_away",
    "feedforward.stribeck_velocity",
    "feedforward.stiffness",
    "feedforward.micro_damping",
    "feedforward.offset",
    "feedforward.reference_filter",
)
RECORDED = (
    "position",
    "reference",
    "velocity",
    "torque_command",
    "torque",
    "torque_feedback",
    "temperature",
    "sync",
    "cycle",
)
"""What a drive's recorder can be asked for; `sync` and `cycle` are counters."""


Word = Annotated[int, Field(ge=0, le=0xFFFF_FFFF)]


Version = Annotated[str, Field(pattern=r"^\d+(\.\d+)*$")]


class Identity(Strict):
    """Objects 1018h and 100Ah of the drives that the profile is for; what is left out is not compared.

    `firmware_min` and `firmware_max` are dotted numbers, both inclusive: "1.2" is below "1.10".
    """

    vendor: Word | None = None
    product: Word | None = None
    revision_min: Word = 0
    revision_max: Word = 0xFFFF_FFFF
    firmware_min: Version | None = None
    firmware_max: Version | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Identity:
        if self.revision_min > self.revision_max:
            raise ValueError(
                f"revision_min {self.revision_min:#x} must not be above revision_max {self.revision_max:#x}"
            )
        return self


class Signals(Strict):
    """What the drive sends in every cycle; `temperature` comes every `slow_cycles` cycles."""

    status: SignalField
    position: SignalField
    velocity: SignalField
    torque: SignalField
    torque_demand: SignalField
    torque_feedback: SignalField | None = None
    sync_counter: SignalField | None = None
    temperature: SignalField | None = None


class Commands(Strict):
    """What the drive is sent in every cycle."""

    control: SignalField
    position: SignalField
    velocity: SignalField
    torque: SignalField
    torque_feedforward: SignalField


class Torque(Strict):
    """The meaning of torque objects.

    `constant` is the torque constant, where the drive tells currents. `find`: whether the torque demand
    includes the feedforward differs from drive to drive, and is found by a small step before a run.
    """

    rated: SignalField
    constant: SignalField | None = None
    demand_includes_feedforward: bool
    find: bool = False

    @model_validator(mode="after")
    def _known_units(self) -> Torque:
        if self.rated.unit not in TORQUE_UNITS - {"permille"}:
            raise ValueError(f"torque.rated has the unit {self.rated.unit!r}; write mNm, uNm, A, mA or SI")
        if self.constant is not None and not is_constant(self.constant.unit):
            raise ValueError(
                f"torque.constant has the unit {self.constant.unit!r}; write uNm/A, mNm/A or Nm/A"
            )
        return self


class Parameter(Strict):
    """A parameter that the drive holds; `min` and `max` in SI, where its object is narrower."""

    at: SignalField
    min: float | None = None
    max: float | None = None


class Clock(Strict):
    """Where a simulated drive tells that its time advances with SYNC (lock-step): a bit that is set."""

    at: ObjectField
    lock_step_mask: Annotated[int, Field(gt=0)]


class Cycle(Strict):
    """How patient the cycle is: seconds for an answer, and how many may be lost in a row."""

    reply_timeout: Annotated[float, Field(gt=0, le=5)] = 0.02
    lost_cycles: Annotated[int, Field(ge=0, le=20)] = 3
    slow_cycles: Annotated[int, Field(ge=1, le=240)] = 200


class Heartbeats(Strict):
    """Heartbeats [s]: ours, after which silence the drive stops, and the drive's.

    `watchdog` is for drives without a heartbeat consumer (1016h): the time after which they stop by
    themselves when process data no longer come; it gets `consume`.
    """

    watchdog: SignalField | None = None
    produce: Annotated[float, Field(gt=0, le=1)] = 0.025
    consume: Annotated[float, Field(gt=0, le=1)] = 0.15
    monitor: Annotated[float, Field(gt=0, le=5)] = 0.1

    @model_validator(mode="after")
    def _ordered(self) -> Heartbeats:
        if self.consume < 2 * self.produce:
            raise ValueError(f"consume {self.consume} must be at least twice produce {self.produce}")
        return self


def _timer(value: Any) -> Any:
    return ObjectRef.parse(value) if isinstance(value, str) and value != "event-timer" else value


class OffsetGuard(Strict):
    """How the drive drops a torque offset whose sender has gone silent, which `autotune play` needs.

    `timer`: the event timer of the receive PDO (1400h:05 and the like, ms), or an object of the drive's own in ms.
    `ramp`: seconds that it then takes until nothing of the offset is left.
    """

    timer: Annotated[Literal["event-timer"] | ObjectRef, BeforeValidator(_timer)]
    ramp: Annotated[float, Field(ge=0, le=1)]


class Store(Strict):
    """Object 1010h: written with "save", ready after at most `seconds`.

    `verify`: the reset after which everything is read again. Only a reset of the node loads what was
    stored of the application; where it would lose the position (incremental encoders), a reset of
    communication is what can be had.
    """

    at: ObjectField
    seconds: Annotated[float, Field(gt=0, le=60)] = 5.0
    verify: Literal["reset-node", "reset-communication", "none"] = "reset-communication"


class Recorder(Strict):
    """The drive's own data recorder: what is written to start it, and where its samples are.

    Each of `channels` takes an object as a PDO mapping has it (index, sub-index, bits). `columns` says
    which signals it records, the SYNC counter among them. With the layout `rows` one object has whole
    samples, one after the other; with `columns` there is one object a channel in `data`. The sampling
    period is written to `period`, or is `sample_seconds`.
    """

    layout: Literal["rows", "columns"] = "rows"
    control: ObjectField
    start: Annotated[int, Field(ge=0, le=0xFFFF_FFFF)]
    stop: Annotated[int, Field(ge=0, le=0xFFFF_FFFF)] = 0
    wanted: ObjectField
    capacity: Annotated[int, Field(ge=1)]
    recorded: ObjectField
    period: SignalField | None = None
    sample_seconds: Annotated[float, Field(gt=0, le=1)] | None = None
    setup: Mapping[str, int] = {}
    channels: Annotated[tuple[ObjectField, ...], Field(min_length=1)]
    data: Annotated[tuple[ObjectField, ...], Field(min_length=1)]
    columns: Mapping[str, SignalField]

    @model_validator(mode="after")
    def _fits(self) -> Recorder:
        if len(self.columns) > len(self.channels):
            raise ValueError(
                f"recorder.columns has {len(self.columns)} signals for {len(self.channels)} channels"
            )
        all_known(self.columns, RECORDED, "recorder column")
        for text in self.setup:
            ObjectRef.parse(text)
        return self


class Profile(Strict):
    """A kind of drive. See the module's text.

    `expects` are objects that must have a value for the profile's units to be right; they are compared
    before anything is written. `encoder`: where the drive says how many counts a turn has; `none` where its
    positions do not follow object 608Fh. `ripple`: harmonics of torque that the drive adds; `friction_table`: torque
    over velocity. `remarks` are told to the person who commissions the axis.
    """

    schema_version: Annotated[Literal[1], Field(alias="schema")] = 1
    name: str
    title: str
    eds: str | None = None
    identity: Identity = Identity()
    torque: Torque
    signals: Signals
    commands: Commands
    parameters: Mapping[str, Parameter] = {}
    session: Mapping[str, float] = {}
    expects: Mapping[str, float] = {}
    recorder: Recorder | None = None
    remarks: tuple[str, ...] = ()
    quick_stop_deceleration: SignalField | None = None
    encoder: Literal["608F", "none"] = "608F"
    clock: Clock | None = None
    cycle: Cycle = Cycle()
    guard: Heartbeats = Heartbeats()
    offset_guard: OffsetGuard | None = None
    store: Store | None = None
    ripple: HarmonicsBlock | None = None
    friction_table: VelocityPoints | None = None
    transition_seconds: Annotated[float, Field(gt=0, le=30)] = 3.0
    faults: Mapping[str, str] = {}

    @model_validator(mode="after")
    def _known(self) -> Profile:
        all_known(self.parameters, PARAMETERS, "parameter")
        if self.friction_table is not None:
            self.friction_table.alone_beside(self.parameters)
        for text in (*self.session, *self.expects):
            ObjectRef.parse(text)
        for text in self.faults:
            int(text, 16)
        return self

    @model_validator(mode="after")
    def _torques_are_torques(self) -> Profile:
        torques = {
            "signals.torque": self.signals.torque,
            "signals.torque_demand": self.signals.torque_demand,
            "signals.torque_feedback": self.signals.torque_feedback,
            "commands.torque": self.commands.torque,
            "commands.torque_feedforward": self.commands.torque_feedforward,
        }
        for name, signal in torques.items():
            if signal is not None and signal.unit not in TORQUE_UNITS:
                raise ValueError(
                    f"{name} has the unit {signal.unit!r}; a torque is in {', '.join(sorted(TORQUE_UNITS))}"
                )
        every = [*torques.values(), self.torque.rated, *(one.at for one in self.parameters.values())]
        if self.torque.constant is None and any(one is not None and is_current(one.unit) for one in every):
            raise ValueError("a torque is given as a current; name the torque constant in torque.constant")
        return self

    @property
    def fault_texts(self) -> dict[int, str]:
        """Words for the drive's own error codes."""
        return {int(code, 16): text for code, text in self.faults.items()}

    @property
    def has_feedforward_block(self) -> bool:
        """True where the drive itself can run the LuGre feedforward."""
        return {"feedforward.stiffness", "feedforward.inertia", "feedforward.enabled"} <= set(self.parameters)


def read_profile(name: str, directory: Path | None = None) -> Profile:
    """Reads a profile: by name from the program's own, or a `.toml` path relative to `directory`.

    Raises:
        ConfigurationError: there is none of that name (the nearest is named), or it is not valid.
    """
    path = profile_path(name, directory)
    data = read_toml(path, "profile")
    if data.get("protocol", "canopen") != "canopen":
        raise ConfigurationError(
            f"profile {name!r} is for a {data['protocol']} link, but the link is CANopen; choose a profile of a "
            "CANopen drive, or correct the link"
        )
    return validate(Profile, data, f"profile {path}")


def profile_path(name: str, directory: Path | None = None) -> Path:
    """Where a profile is; see `read_profile`. Raises ConfigurationError: there is none of that name."""
    path = Path(name) if name.endswith(".toml") else config_directory() / "profiles" / f"{name}.toml"
    if directory is not None and name.endswith(".toml"):
        path = directory / path
    if not name.endswith(".toml") and not path.is_file():
        raise ConfigurationError(_unknown(name, path.parent))
    return path


def _unknown(name: str, directory: Path) -> str:
    known = sorted(path.stem for path in directory.glob("*.toml"))
    near = difflib.get_close_matches(name, known, 1, cutoff=0.4)
    hint = f"did you mean {near[0]!r}" if near else f"there are {', '.join(known)}"
    return f"there is no profile {name!r}; {hint}? A file of your own is named with its ending: my-drive.toml"
