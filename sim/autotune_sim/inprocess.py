"""A simulated drive in this process: `sim://PRESET`, without a wire and as fast as the processor allows.

It behaves as the drive behind the wire does: it clamps demands to its limits, watches following error,
speed, position and temperature, and answers a violation with a controlled stop, power off and a fault
that stays until it is reset.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from autotune.core.drive import Command, Mode, Sample, Standing
from autotune.core.errors import (
    ConfigurationError,
    DriveError,
    DriveFault,
    LinkTimeout,
    StateError,
)
from autotune.core.stopping import StopWatch, Ways
from autotune_sim.altered_commands import AlteredCommands
from autotune_sim.drive_faults import OVER_CURRENT, REHEARSED, fault_error, in_words, refused
from autotune_sim.drive_limits import DriveLimits
from autotune_sim.emergency import ErrorCode
from autotune_sim.hurts import HURTS, apply_hurt
from autotune_sim.link_url import HERE, parse_sim_url
from autotune_sim.presets import Preset
from autotune_sim.ramp import Ramp
from autotune_sim.rehearsal import Agenda
from autotune_sim.servo import Servo, ServoMode, ServoState
from autotune_sim.stored import keep, must_be_kept, recall
from autotune_sim.truth import Truth

MISSED = 3  # cycles lost in a rehearsal
HEAT = 200.0  # K, of a rehearsal
LEAP = 0.1  # rad, from where the axis is to another master's target
STOP_FAULT = 3e-3  # s into a controlled stop, of a rehearsed fault
AFTERMATH = 200  # cycles without power that are logged, where what is true is logged
_ALTERED = frozenset({"rpdo-lost", "second-master"})
_MODES = {
    Mode.POSITION: ServoMode.POSITION,
    Mode.VELOCITY: ServoMode.VELOCITY,
    Mode.TORQUE: ServoMode.TORQUE,
}


def open_sim(url: str, cycle: float | None = None, directory: Path = HERE) -> SimDrive:
    """Opens `sim://PRESET?seed=3&effect=stribeck:0.05&effect=spring&cycle=0.001&friction=0`.

    Every key may be left out, `effect` and `fault` (`fault=silent@2.5`, see `rehearsal`) may be given
    several times; an effect without a size has its default size (`effects`). With `memory=FILE` stored
    parameters live in that file and outlast the process; `truth=FILE` logs what is true on the axis
    (`truth`), `unfit=NAME[:SIZE]` makes it one that must not be tuned (`unfit`), with `dead_time=0.001` [s] its torque
    comes a cycle of so many seconds late.

    Args:
        cycle: s, where the URL says none.
        directory: from which a composed machine's file (`sim://machine.toml`) is looked for.

    Raises:
        ConfigurationError: an unknown preset, effect, fault or key, or a value out of range.
    """
    request = parse_sim_url(url, cycle, directory)
    drive = SimDrive(request.preset, request.preset.seed, Path(request.memory) if request.memory else None)
    if request.truth:
        drive.keep_truth(Truth(Path(request.truth)))
    for name, value, time in request.faults:
        drive.inject(name, time, value)
    return drive


class SimDrive:
    """`autotune.core.drive.Drive` over a `Servo`.

    Args:
        preset: what is simulated.
        seed: of the noise.
        memory: file that stored parameters live in; None: they go with the process.

    Raises:
        ConfigurationError: a cycle that the drive does not have.
    """

    def __init__(self, preset: Preset, seed: int = 0, memory: Path | None = None) -> None:
        try:
            self._servo = Servo(preset, seed)
        except ValueError as error:
            raise ConfigurationError(str(error)) from None
        self._parameters = self._servo.parameters
        self._memory = memory
        recall(memory, self._parameters)
        self._stored = self._parameters.snapshot()
        self._agenda = Agenda()
        self._conditions: set[str] = set()
        self._fault = 0
        self._mode = ServoMode.POSITION
        self._demand = self._demand_before = 0.0
        self._ways = Ways(self._servo.period)
        self._missed = 0
        self._altered = AlteredCommands(0.0)
        self._leap = LEAP
        self._sample: ServoState = self._servo.idle()
        self._read_limits()

    @property
    def servo(self) -> Servo:
        """The servo loop inside; for tests that must see the truth."""
        return self._servo

    def keep_truth(self, truth: Truth) -> None:
        """Logs from now on what is true on the axis."""
        self._servo.keep_truth(truth)
        truth.note("open", self._servo.time, parameters=self._parameters.snapshot(), stored=self._stored)

    def _note(self, kind: str, **details: Any) -> None:
        if self._servo.truth is not None:
            self._servo.truth.note(kind, self._servo.time, **details)

    @property
    def period(self) -> float:
        return self._servo.period

    @property
    def identity(self) -> Mapping[str, int | str]:
        return {
            "vendor": 0x7FFFA701,
            "product": 0x402,
            "revision": 0x10000,
            "serial": 1000 + self._servo.preset.seed,
            "firmware": "autotune simulated drive, in process",
        }

    def look(self) -> Standing:
        self._answer()
        return Standing(self._servo.position, self._sample.velocity)

    # Power

    def enable(self, mode: Mode) -> None:
        self._answer()
        if self._servo.powered:
            self.disable()
            raise StateError("enable was asked for while power was on; power is off now: disable first")
        self._refuse_enabling()
        self._mode = _MODES[mode]
        self._servo.power(True, self._mode)
        self._demand = self._demand_before = self._servo.position
        self._missed = 0
        self._ways.begin()
        self._altered = AlteredCommands(self._demand)
        self._note("enabled", mode=mode.value)

    def disable(self) -> None:
        """See `Drive`.

        Raises:
            DriveFault: a fault in the middle of the stop; power is off all the same.
        """
        if self._servo.powered:
            watch = self._stop(self._agenda)
            if watch.runs_away:
                raise DriveFault(
                    f"the simulated drive did not bring its axis to rest as it should: {watch.trouble}"
                )
            if "stop-fault" in self._conditions:
                self._conditions -= {"stop-fault"}
                self._fault = OVER_CURRENT
                self._note("fault", code=OVER_CURRENT)
                raise fault_error(OVER_CURRENT, "while the axis was brought to rest", self._sample)

    def cut(self) -> None:
        """See `autotune.core.drive.CutsPower`."""
        if self._servo.powered:
            self._without_power()

    def close(self) -> None:
        try:
            self.disable()
        finally:
            self._note("closed", parameters=self._parameters.snapshot(), stored=self._stored)

    def reset_faults(self) -> None:
        """What a person does at the drive once the cause is gone.

        Raises:
            DriveFault: the cause is still there.
        """
        self._answer()
        self._fault = 0
        self._sample = self._servo.idle()
        if self._cause():
            self._fault = self._cause()
            raise fault_error(self._fault, "and its cause is still there", self._sample)

    def _refuse_enabling(self) -> None:
        if "enable-missing" in self._conditions:
            raise StateError(
                "the simulated drive stays in 'switch on disabled': " + in_words(ErrorCode.ENABLE_INPUT)
            )
        code = self._fault or self._cause()
        if code:
            self._fault = code
            raise fault_error(code, "when power was asked for", self._sample)

    def _stop(self, agenda: Agenda | None = None) -> StopWatch:
        """Brakes on the drive's own ramp, then takes power off; meanwhile something of `agenda` may fail."""
        servo = self._servo
        moved = self._ways.longest / servo.period
        watch = StopWatch(self._limits.stop(self._servo), self._sample.velocity, moved)
        try:
            if "enable-missing" not in self._conditions:
                ramp = self._ramp()
                while (
                    not ramp.done
                    and not watch.runs_away
                    and not ("stop-fault" in self._conditions and ramp.elapsed >= STOP_FAULT)
                ):
                    self._sample = servo.cycle(ramp.step(servo.period))
                    watch.see(self._sample.position, self._sample.velocity)
                    if agenda is not None and agenda.due <= self._sample.time + servo.period:
                        self._rehearse()
        finally:
            self._without_power()
        return watch

    def _without_power(self) -> None:
        servo = self._servo
        servo.power(False)
        self._note("disabled")
        if servo.truth is not None:
            servo.lose(AFTERMATH)
        self._sample = servo.idle()

    def _ramp(self) -> Ramp:
        servo, sample = self._servo, self._sample
        position, velocity = self._demand, (self._demand - self._demand_before) / servo.period
        following = abs(sample.following_error) < 0.5 * self._limits.window
        if self._mode is not ServoMode.POSITION or not following:
            servo.power(True, ServoMode.POSITION)
            position, velocity = servo.position, sample.velocity
        velocity = min(max(velocity, -self._limits.speed), self._limits.speed)  # a leap is no speed
        return Ramp(position, velocity, self._parameters["limit.deceleration"])

    # The cycle

    def step(self, command: Command) -> Sample:
        servo = self._servo
        if not servo.powered:
            self._answer()
            raise StateError("a cycle was asked for while power is off; enable the drive first")
        if self._agenda.due <= self._sample.time + servo.period:
            self._rehearse()
        if self._conditions and not self._conditions.isdisjoint(_ALTERED):
            command = self._altered.heard(
                command, self._mode, "rpdo-lost" in self._conditions, self._sample.position + self._leap
            )
        position, velocity, torque, feedforward = command
        limits = self._limits
        if position != position:
            position = self._demand
        position = min(max(position, limits.lowest), limits.highest)
        velocity = min(max(velocity, -limits.speed), limits.speed)
        if not math.isfinite(velocity + torque + feedforward):
            raise DriveError(f"{command} cannot be sent to the simulated drive: every value must be finite")
        self._sample = state = servo.cycle(position, velocity, torque, feedforward)
        self._ways.see(state.position)
        self._demand_before, self._demand = self._demand, position
        code = limits.broken(state)
        if code:
            self._fail(code)
        missed, self._missed = self._missed, 0
        return Sample(
            state.time,
            state.position_demand,
            state.position,
            state.velocity,
            state.torque_demand,
            state.torque_actual,
            state.torque_offset,
            state.torque_demand - state.torque_offset,
            state.temperature + self._heating,
            missed,
        )

    def _fail(self, code: int) -> None:
        """Stops the axis and raises the fault; in torque mode power goes at once, as 605Eh is set behind a wire."""
        self._fault = code
        error = fault_error(code, "while it was running", self._sample)
        self._note("fault", code=code)
        if self._mode is ServoMode.TORQUE:
            self._without_power()
        else:
            self._stop()
        raise error

    def _cause(self) -> int:
        """Code of a fault that is there now; 0 for none."""
        if self._servo.temperature > self._limits.hottest:
            return ErrorCode.MOTOR_TEMPERATURE
        return ErrorCode.BRAKE if "brake-missing" in self._conditions else 0

    # Parameters

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        self._answer()
        values = self._parameters.snapshot()
        if names is None:
            return values
        try:
            return {name: self._parameters[name] for name in names}
        except KeyError as error:
            raise ConfigurationError(str(error.args[0])) from None

    def write_parameters(self, values: Mapping[str, float]) -> None:
        """All of `values` or, where one cannot be, none.

        Raises:
            ConfigurationError: an unknown name or a value out of range. TransferAborted, LinkTimeout.
        """
        self._answer()
        if "write-refused" in self._conditions:
            raise refused("parameters cannot be written")
        try:
            self._parameters.restore(values)
        except KeyError as error:
            raise ConfigurationError(str(error.args[0])) from None
        except ValueError as error:
            raise ConfigurationError(str(error)) from None
        self._read_limits()
        self._note("written", values=dict(values))

    def store(self) -> None:
        self._answer()
        if self._servo.powered:
            raise StateError("parameters are stored with power off only; disable the drive first")
        if "store-refused" in self._conditions:
            raise refused("parameters cannot be stored")
        if "nvm" not in self._conditions:
            self._stored = self._parameters.snapshot()
            if self._memory is not None:
                keep(self._memory, self._stored)
            self._note("stored", stored=self._stored)
        must_be_kept(self._stored, self._parameters.snapshot())

    def faults(self) -> list[str]:
        self._answer()
        code = self._fault or self._cause()
        return [f"{in_words(code)} ({code:04X}h)"] if code else []

    def power_cycle(self) -> None:
        """Switches the drive off and on: faults are forgotten, stored parameters are back."""
        self._servo.power(False)
        if self._servo.truth is not None:
            self._servo.lose(AFTERMATH)
        self._sample = self._servo.idle()
        self._fault = 0
        self._parameters.restore(self._stored)
        self._read_limits()

    def _read_limits(self) -> None:
        """Keeps what every cycle compares with."""
        self._heating = HEAT if "hot" in self._conditions else 0.0
        self._limits = DriveLimits.of(self._parameters, self._heating)

    # Rehearsals

    def inject(self, name: str, at_time: float | None = None, value: str = "") -> None:
        """Lets something fail (`rehearsal`) or break (`hurts`), now or at a time of the drive's clock [s].

        Raises:
            ConfigurationError: an unknown name or an impossible value or time.
        """
        self._agenda.add(name, self._sample.time if at_time is None else at_time, value)
        if at_time is None and not self._servo.powered:
            self._rehearse()

    def _rehearse(self) -> None:
        for name, value in self._agenda.take(self._sample.time + self.period):
            self._happen(name, value)
        self._fail_as_rehearsed()

    def _happen(self, name: str, value: str) -> None:
        self._note("fault put in", name=name, value=value)
        if name in HURTS:
            apply_hurt(self._servo, name, value)
            return
        if name == "clear":
            self._servo.heal()
        if name in _ALTERED:
            self._altered.sent = self._demand
        if name == "second-master":
            self._leap = float(value or LEAP)
        self._conditions = set() if name == "clear" else self._conditions | {name}
        self._servo.brake_stuck = "blocked" in self._conditions
        self._read_limits()

    def _fail_as_rehearsed(self) -> None:
        if self._conditions & {"silent", "power-loss"}:
            self._answer()
        for name in self._conditions & set(REHEARSED):
            self._conditions -= {"drive-fault", "following-error"}
            if self._servo.powered:
                self._fail(REHEARSED[name])
            self._fault = REHEARSED[name] if name in ("drive-fault", "following-error") else self._fault
        if "missed-cycles" in self._conditions:
            self._conditions -= {"missed-cycles"}
            self._lose_cycles()

    def _lose_cycles(self) -> None:
        for _ in range(MISSED if self._servo.powered else 0):
            self._sample = self._servo.cycle(self._demand)
            self._missed += 1

    def _answer(self) -> None:
        """Raises LinkTimeout where the drive is not there; it has brought its axis to rest by itself."""
        if not self._conditions & {"silent", "power-loss"}:
            return
        if "power-loss" in self._conditions:
            self._conditions -= {"power-loss"}
            self.power_cycle()
        self.disable()
        raise LinkTimeout(
            "the simulated drive does not answer (a rehearsed failure); check that it has power and that "
            "the cable is plugged"
        )
