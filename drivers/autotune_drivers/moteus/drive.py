"""A moteus controller on a serial line as a `Drive`: positions in revolutions become rad, one cycle at a time.

Power is on only while the controller guards us: every command carries a watchdog time. A host that dies
or hangs therefore stops the axis. What a session changes in the controller is put back by `close`.

| mode | what is commanded |
|---|---|
| POSITION | position, its rate as velocity, feedforward torque |
| VELOCITY | velocity alone: the controller's demand advances with it |
| TORQUE | feedforward torque, with kp and kd scale and the integral's limit at 0 |

u_PID is the sum of the P, I and D torques (030h to 032h) with `servo.pid_position.sign`: the controller
computes them from measured − desired. Where its output is limited, u_PID is what is left of the total.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from autotune.core.axis import Axis
from autotune.core.drive import Command, Mode, Sample, Standing
from autotune.core.errors import DriveError, LinkError, StateError
from autotune_drivers.moteus.exchange import MoteusExchange, State, Target
from autotune_drivers.moteus.faults import LIMITED
from autotune_drivers.moteus.faults import Mode as Told
from autotune_drivers.moteus.multiplex import MODE, Form
from autotune_drivers.moteus.power import MoteusPower
from autotune_drivers.moteus.settings import MoteusSettings
from autotune_drivers.stopping import MAY_BE_ON, close_down, off_after, tell_unconfirmed

TURN = 2.0 * math.pi
_AGREES = 1e-5


class MoteusDrive:
    """One controller; made by `moteus_open.MoteusOpener`, which has checked who it is.

    Args:
        sign: of the position controller's torques (`servo.pid_position.sign`).

    `left`: what earlier sessions had left and was put right, in words.
    """

    left: tuple[str, ...] = ()

    def __init__(
        self,
        exchange: MoteusExchange,
        power: MoteusPower,
        settings: MoteusSettings,
        axis: Axis,
        identity: Mapping[str, int | str],
        lock_step: bool,
        sign: float,
    ) -> None:
        self.lock_step = lock_step
        self._exchange, self._power, self._settings = exchange, power, settings
        self._period = axis.cycle
        self._identity = MappingProxyType(dict(identity))
        self._direction = axis.mechanics.direction
        self._to_motion = self._direction * TURN
        self._speed = axis.limits.speed / TURN
        self._torque_limit = axis.limits.torque
        self._feedback_sign = self._direction * sign
        self._mode = Mode.POSITION
        self._held = self._rate = 0.0
        self._live = self._closed = self._blind = self._unsure = False
        self._loss: LinkError | None = None  # that has told of a lost link

    @property
    def period(self) -> float:
        return self._period

    @property
    def identity(self) -> Mapping[str, int | str]:
        return self._identity

    def backup(self) -> Mapping[str, str]:
        """What may have to be put back; for a process that has to do it in our place."""
        return self._settings.backup()

    def look(self) -> Standing:
        state = self._exchange.look()
        return Standing(state.position * self._to_motion, state.velocity * self._to_motion)

    # Power

    def enable(self, mode: Mode) -> None:
        if self._live:
            self.disable()
            raise StateError("enable was asked for while power was on; power is off now: disable first")
        self._live, self._loss, self._unsure = True, None, False
        self._mode, self._rate = Mode.POSITION, 0.0
        try:
            self._held = self._power.on()
            self._mode = mode
        except BaseException as error:
            self._loss = error if isinstance(error, LinkError) else None
            off_after(error, self.disable)
            raise

    def disable(self) -> None:
        """See `Drive.disable`.

        Raises:
            DriveFault: power is off, but a fault came with it that was not told before. LinkError: the
                controller did not confirm, and no cycle had failed before. StateError: power stays on.
        """
        if not self._live:
            return
        try:
            self._power.off(*self._motion(), brake=not self._blind)
        except LinkError as error:
            told, self._loss = self._loss, self._loss or error
            self._unsure = not self._power.abandon()
            tell_unconfirmed(error, told, self._unsure)
        except StateError:
            self._unsure = True
            raise
        finally:
            self._live = False
        self._power.look_back()

    def cut(self) -> None:
        """See `autotune.core.drive.CutsPower`."""
        self._blind = True
        try:
            self.disable()
        finally:
            self._blind = False

    def _motion(self) -> tuple[float, float]:
        """Where a stop begins [rev], and how fast [rev/s]."""
        state = self._exchange.state
        if self._mode is Mode.POSITION or state is None:
            return self._held, self._rate
        return state.position, state.velocity

    # The cycle

    def step(self, command: Command) -> Sample:
        if not self._live:
            raise StateError("a cycle was asked for while power is off; enable the drive first")
        target = self._target(command)
        try:
            missed = self._exchange.cycle(target)
        except LinkError as error:
            self._loss = error
            raise
        except OverflowError as error:
            raise DriveError(
                f"{command} cannot be sent: {error}; it does not fit single precision"
            ) from error
        state = self._exchange.state
        if state is None or state.mode != Told.POSITION:
            raise self._power.lost()
        if not math.isfinite(state.position + state.velocity + state.torque):
            self._power.must_see()
        if self._exchange.temperature_overdue:
            self._power.must_be_warm()
        return self._sample(state, command, missed)

    def _target(self, command: Command) -> Target:
        feedforward = self._direction * command.torque_feedforward
        if self._mode is Mode.POSITION:
            return self._position_target(command, feedforward)
        if self._mode is Mode.VELOCITY:
            self._must_be_finite(command, command.velocity, feedforward)
            return Target(math.nan, command.velocity / self._to_motion, feedforward)
        torque = self._direction * command.torque + feedforward
        self._must_be_finite(command, torque)
        return Target(math.nan, 0.0, torque, feedback=False)

    def _position_target(self, command: Command, feedforward: float) -> Target:
        self._must_be_finite(command, feedforward)
        position = self._held if math.isnan(command.position) else command.position / self._to_motion
        self._must_be_finite(command, position)
        rate = (position - self._held) / self._period
        self._held, self._rate = position, max(-self._speed, min(self._speed, rate))
        return Target(position, self._rate, feedforward)

    def _must_be_finite(self, command: Command, *values: float) -> None:
        if not all(map(math.isfinite, values)):
            raise DriveError(f"{command} cannot be sent: every value must be a finite number")

    def _sample(self, state: State, command: Command, missed: int) -> Sample:
        total = self._direction * state.total
        feedback, feedforward = self._shares(state, command, total)
        position = state.position * self._to_motion
        reference = position
        if self._mode is Mode.POSITION:
            control = state.control_position
            reference = (self._held if math.isnan(control) else control) * self._to_motion
        return Sample(
            (self._exchange.count - 1) * self._period,
            reference,
            position,
            state.velocity * self._to_motion,
            total,
            self._direction * state.torque,
            feedforward,
            feedback,
            state.temperature,
            missed,
        )

    def _shares(self, state: State, command: Command, total: float) -> tuple[float, float]:
        """u_PID, and the feedforward: the host's and what the controller itself adds."""
        if self._mode is Mode.TORQUE:
            return total - command.torque_feedforward, command.torque_feedforward
        if state.fault in LIMITED or abs(total) >= self._torque_limit * (1.0 - _AGREES):
            feedforward = self._direction * state.feedforward
            return total - feedforward, feedforward
        feedback = self._feedback_sign * (state.proportional + state.integral + state.derivative)
        return feedback, total - feedback

    # At rest

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        return self._settings.parameters.read(names)

    def write_parameters(self, values: Mapping[str, float]) -> None:
        self._settings.parameters.write(values)

    def store(self) -> None:
        if self._live:
            raise StateError("parameters are stored with power off only; disable the drive first")
        self._settings.store()

    def faults(self) -> list[str]:
        return self._power.present_faults()

    def powered(self) -> bool | None:
        """What the controller says of its power now; None where it does not answer."""
        try:
            mode = int(self._settings.node.registers((Form.INT8, MODE, 1))[MODE])
        except (LinkError, KeyError):
            return None
        return mode not in (Told.STOPPED, Told.FAULT)

    def idle(self) -> None:
        """To be called now and then between routines. Raises LinkError."""
        self._settings.node.port.drain()

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        node = self._settings.node
        hang_up, who = node.port.close, f"controller {node.number}"
        close_down(self.disable, self._restore, hang_up, lambda: self._loss is not None, who)

    def _restore(self) -> list[str]:
        """What could not be put back; nothing is, where a controller may have power and stop by what was set.

        Raises:
            LinkError: it does not answer.
        """
        try:
            off = not self._unsure or self._power.abandon()
            if off:
                self._power.acknowledge()
            else:
                self._exchange.look()
        except LinkError:
            if self._loss is not None:
                return []
            raise
        self._loss = None
        return self._settings.restore() if off else [MAY_BE_ON]
