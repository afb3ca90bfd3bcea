"""The drive as the rest of the program sees it: one cycle at a time.

`Drive.step` owns time: a real drive waits for its cycle, a simulated one computes it, and the same
experiment runs on both. All quantities are SI and on the motor side (see `motion_unit`): position in
rad or m, torque in N m or N.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import NamedTuple, Protocol, runtime_checkable


class Mode(Enum):
    """How the drive is commanded (CiA 402: cyclic synchronous position, velocity, torque)."""

    POSITION = "position"
    VELOCITY = "velocity"
    TORQUE = "torque"


class Command(NamedTuple):
    """What the drive is told for one cycle.

    `position` is used in POSITION mode, `velocity` in VELOCITY mode, `torque` in TORQUE mode;
    `torque_feedforward` is added by the drive in every mode (CiA 402 object 60B2).

    A `position` that is nan (see `HOLD`) keeps the position that the drive was told last, or the one
    that it has held since `enable`: this is how the first sample is taken before anybody can know
    where the axis stands.
    """

    position: float = 0.0
    velocity: float = 0.0
    torque: float = 0.0
    torque_feedforward: float = 0.0


HOLD = Command(position=math.nan)
"""Stay where you are: the first command after `enable`."""


class Sample(NamedTuple):
    """What was true in one cycle, taken at one instant, before the commanded torque acts.

    Attributes:
        time: s, the drive's own clock (cycles × period).
        reference: position that the controller follows [rad or m]; the measured one in TORQUE mode.
        position: measured [rad or m].
        velocity: as the drive reports it [rad/s or m/s].
        torque_command: total torque demand, feedforward included [N m or N].
        torque: as the drive measures it (from its current) [N m or N].
        torque_feedforward: part of `torque_command` that came from the host or the drive's own
            feedforward [N m or N].
        torque_feedback: u_PID = `torque_command` − `torque_feedforward` [N m or N].
        temperature: of motor or drive [°C], nan where the drive has none.
        missed: cycles lost just before this sample.
    """

    time: float
    reference: float
    position: float
    velocity: float
    torque_command: float
    torque: float
    torque_feedforward: float
    torque_feedback: float
    temperature: float
    missed: int


class Standing(NamedTuple):
    """Where an axis is and how fast, as its drive tells without power [rad or m, rad/s or m/s]."""

    position: float
    velocity: float


@runtime_checkable
class CutsPower(Protocol):
    """A drive that can take power off without braking first."""

    def cut(self) -> None:
        """Takes power off at once; a brake, where there is one, falls in. For an axis whose position sensor lies:
        a ramp, or a position that is held, would be followed by it.

        Raises: as `Drive.disable`.
        """


@runtime_checkable
class Drive(Protocol):
    """One axis drive, behind whatever link.

    Parameter names are dotted and the same for every drive; a profile maps them to objects:
    `limit.position_min`, `limit.position_max`, `limit.speed`, `limit.torque`,
    `limit.following_error`, `controller.kp`, `controller.kd`, `controller.ki`,
    `controller.derivative_filter`, `feedforward.enabled`, `feedforward.inertia`,
    `feedforward.viscous`, `feedforward.coulomb`, `feedforward.break_away`,
    `feedforward.stribeck_velocity`, `feedforward.stiffness`, `feedforward.micro_damping`,
    `feedforward.offset`, `feedforward.reference_filter`. Values are SI.
    """

    @property
    def period(self) -> float:
        """Cycle time [s]."""

    @property
    def identity(self) -> Mapping[str, int | str]:
        """Vendor, product, revision, serial number and firmware as the drive tells them."""

    def look(self) -> Standing:
        """Where the axis is, without power and without changing anything.

        Raises: LinkError.
        """

    def enable(self, mode: Mode) -> None:
        """Powers the axis in `mode`, holding its present position.

        Raises:
            StateError, DriveFault, LinkError: power is off when any of them leaves this call.
        """

    def step(self, command: Command) -> Sample:
        """Plays one cycle.

        Raises:
            DriveFault, LinkError: the drive has taken power off or will do so by itself.
        """

    def disable(self) -> None:
        """Brings the axis to rest and takes power off. Idempotent, safe in every state.

        Raises:
            DriveFault: power is off, but a fault came with it that nobody has told yet, or the axis did not
                brake. LinkError, StateError: that power is off is not certain.
        """

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        """Reads parameters by name; all that the drive knows when `names` is None."""

    def write_parameters(self, values: Mapping[str, float]) -> None:
        """Writes parameters to volatile memory and reads each back within the drive's resolution."""

    def store(self) -> None:
        """Makes the present parameters survive power-off (CiA 301 object 1010)."""

    def faults(self) -> list[str]:
        """Present faults in words; empty when there are none."""

    def close(self) -> None:
        """Disables the axis and lets go of the link. Idempotent."""
