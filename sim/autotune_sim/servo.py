"""Servo loop of the simulated drive: samples, computes, acts, once a cycle of h seconds.

Position control is a published contract:

    e = r − y
    d ← d + derivative_filter·((Δr − Δy)/h − d)
    u = kp·e + kd·d + ki·Σe·h + offset            (this sample's e is in the sum)

y is quantised by the encoder. The total is clamped to the torque limit, and the sum is held while it
is clamped; u is applied at once and held for the sample. `offset` is the host's torque offset and the
drive's own feedforward, which follows the LuGre model (5.2), (5.3) in the discrete form (5.8) and takes
its velocity and acceleration from differences of the position demand, as the thesis's Appendix B does.
With `feedforward.stiffness` 0 its friction is Coulomb and Stribeck friction of the demand's direction; a table over
velocity (`own_friction.py`) is added.

Velocity control is proportional and integral (4.2), with kd as the proportional and kp as the integral
gain, so that an axis is as stiff as in position control without its integral part. Torque control
passes the demand on.
"""

from __future__ import annotations

import math
from enum import IntEnum
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from autotune_sim.kernel import Record, kernel
from autotune_sim.own_friction import fresh_friction, own_friction
from autotune_sim.own_ripple import acts, fresh_ripple, own_ripple
from autotune_sim.parameters import Parameters
from autotune_sim.plant import (
    AMBIENT,
    HEALTHY,
    advance,
    felt_temperature,
    fresh_state,
    pack,
    reading,
    substeps,
)
from autotune_sim.presets import MOST_LATE, Preset
from autotune_sim.truth import NO_TRUTH, Truth

NOISE_BLOCK = 4096
VELOCITY_FILTER = 0.2  # of the drive's own velocity estimate
PERIODS = (1e-3, 4e-3)  # s, allowed


class ServoMode(IntEnum):
    """What the servo loop controls."""

    POSITION = 0
    VELOCITY = 1
    TORQUE = 2


class ServoState(NamedTuple):
    """What was true at one sampling instant, and the torque demand computed from it.

    Attributes:
        time: s since the servo was made.
        position_demand: what the loop follows [rad]; the measured position in TORQUE mode.
        position: measured, in whole encoder counts [rad].
        velocity: the drive's own estimate [rad/s].
        torque_demand: total after the clamp, feedforward included [N m].
        torque_actual: measured motor torque at this instant, the result of earlier demands [N m].
        torque_offset: feedforward in `torque_demand`: the host's and the drive's own [N m].
        following_error: position demand − position [rad].
        temperature: of the motor [°C].
        saturated: whether the demand was clamped.
    """

    time: float
    position_demand: float
    position: float
    velocity: float
    torque_demand: float
    torque_actual: float
    torque_offset: float
    following_error: float
    temperature: float
    saturated: bool


_MEMORY = ("cycles", "measured", "velocity", "demand", "demand_velocity", "smooth_velocity", "derivative",
           "sum", "bristle", "integral")  # fmt: skip
MEMORY = np.dtype(
    [(name, np.float64) for name in _MEMORY] + [("late", np.int64), ("held", np.float64, (MOST_LATE,))],
    align=True,
)


class Servo:
    """The servo loop on the axis of a preset.

    Args:
        preset: what is simulated.
        seed: of the noise; runs with equal seeds are equal.
        refine: integration steps for each usual one, to see how exact the plant is.

    Raises:
        ValueError: a cycle outside 1 to 4 ms.
    """

    def __init__(self, preset: Preset, seed: int = 0, refine: int = 1) -> None:
        if not PERIODS[0] <= preset.period <= PERIODS[1]:
            raise ValueError(
                f"the cycle of the simulated drive is {preset.period} s; "
                f"allowed is {PERIODS[0]} to {PERIODS[1]} s"
            )
        self.preset = preset
        self.period = preset.period
        self.parameters = Parameters(preset)
        self.powered = False
        self.brake_stuck = False
        self.mode = ServoMode.POSITION
        self._switch = _OFF  # a plain integer: an enumeration costs the kernel's dispatcher 7 µs
        self._steps = substeps(preset.plant, self.period) * refine
        self._plant = pack(preset.plant, self.period / self._steps)
        self._state = fresh_state()
        self._memory = np.zeros(1, MEMORY)
        self._memory["late"] = round(preset.dead_time / preset.period)
        self.ripple = fresh_ripple(preset.commutation_offset)
        self.friction = fresh_friction()
        self._rows = NO_TRUTH
        self._truth: Truth | None = None
        self._random = np.random.default_rng([seed, preset.seed, 2])
        self._process: list[float] = []
        self._sensor: list[float] = []
        self.reset()

    def power(self, on: bool, mode: ServoMode = ServoMode.POSITION) -> None:
        """Switches the power stage; the axis holds where it is, with an empty integrator.

        Without power the brake holds the axis.
        """
        self.powered = on
        self.mode = mode
        self._switch = int(mode) if on else _OFF
        self.reset()

    @property
    def feedback_parts(self) -> tuple[float, float, float]:
        """Proportional, integral and derivative torque of the last cycle of position control [N m]."""
        control, memory = self.parameters.record[0], self._memory[0]
        error = memory["demand"] - memory["measured"]
        return (
            float(control["controller_kp"] * error),
            float(control["controller_ki"] * memory["sum"]),
            float(control["controller_kd"] * memory["derivative"]),
        )

    def reset(self) -> None:
        """Forgets what the controller knew: demand = measured position, no velocity, no sums, no torque on its way."""
        cycles, late = self._memory["cycles"][0], self._memory["late"][0]
        self._memory[:] = 0
        self._memory["cycles"], self._memory["late"] = cycles, late
        self._memory["measured"] = self._memory["demand"] = self.position

    @property
    def position(self) -> float:
        """Encoder reading [rad]."""
        return float(reading(self._plant[0], self._state[0]))

    @property
    def temperature(self) -> float:
        """Of the motor [°C]."""
        held = float(self._plant["temperature_held"][0])
        return held if not math.isnan(held) else float(AMBIENT + self._state["felt"][0])

    @property
    def time(self) -> float:
        """s since the servo was made."""
        return float(self._memory["cycles"][0]) * self.period

    def cycle(
        self,
        target_position: float = 0.0,
        target_velocity: float = 0.0,
        target_torque: float = 0.0,
        torque_offset: float = 0.0,
    ) -> ServoState:
        """Samples now, computes the torque demand, then lets one period pass.

        Only the target of the present mode is used; `torque_offset` is added in every mode.
        """
        process, sensor = self._process, self._sensor
        if not process:
            process, sensor = self._draw()
        return ServoState(
            *_cycle(
                self._plant,
                self._state,
                self.parameters.record,
                self._memory,
                self.ripple,
                self.friction,
                self._switch,
                self.brake_stuck,
                target_position,
                target_velocity,
                target_torque,
                torque_offset,
                process.pop(),
                sensor.pop(),
                self._steps,
                self.period,
                self._rows,
                monotonic() if self._truth is not None else 0.0,
            )
        )

    # What is broken, and what is true

    @property
    def broken(self) -> dict[str, float]:
        """What is broken now: fields of `plant.HEALTHY` that have another value."""
        now = {name: float(self._plant[name][0]) for name in HEALTHY}
        return {name: value for name, value in now.items() if not _same(value, HEALTHY[name])}

    def hurt(self, **changes: float) -> None:
        """Breaks something: fields of `plant.HEALTHY`, from the next cycle on.

        Raises:
            KeyError: no such field.
        """
        for name, value in changes.items():
            if name not in HEALTHY:
                raise KeyError(name)
            self._plant[name] = value

    def heal(self) -> None:
        """Nothing is broken any more."""
        self.hurt(**HEALTHY)

    def warm(self, rise: float) -> None:
        """The winding is warmer by `rise` at once [°C]."""
        self._state["winding"] = self._state["winding"][0] + rise

    def scale_inertia(self, factor: float) -> None:
        """A load is put on or taken off."""
        self._plant["inertia"] = self._plant["inertia"][0] * factor

    def lose(self, cycles: int) -> None:
        """Lets periods pass without power: what moves without it is seen to move."""
        for _ in range(cycles):
            self.idle()

    @property
    def true_position(self) -> float:
        """Where the motor's shaft is, whatever the encoder says [rad]."""
        return float(self._state["position"][0])

    @property
    def true_load_position(self) -> float:
        """Where the load is [rad]; the motor's position on a rigid axis."""
        rigid = self.preset.plant.transmission_stiffness == 0.0
        return float(self._state["position" if rigid else "load_position"][0])

    @property
    def true_velocity(self) -> float:
        """How fast the motor's shaft turns, whatever anybody says [rad/s]."""
        return float(self._state["velocity"][0])

    @property
    def torque(self) -> float:
        """Torque that the output stage gives now [N m]."""
        return float(self._state["motor_torque"][0])

    @property
    def truth(self) -> Truth | None:
        """The log of what was true in every cycle, where one is kept."""
        return self._truth

    def keep_truth(self, truth: Truth) -> None:
        """Logs every cycle from now on."""
        self._truth = truth
        self._rows = truth.buffer

    def idle(self) -> ServoState:
        """One period without power: the brake holds."""
        if self.powered:
            self.power(False)
        return self.cycle()

    def _draw(self) -> tuple[list[float], list[float]]:
        plant = self.preset.plant
        self._process = self._random.normal(0.0, plant.process_noise, NOISE_BLOCK).tolist()
        self._sensor = self._random.normal(0.0, plant.torque_noise, NOISE_BLOCK).tolist()
        return self._process, self._sensor


_OFF = -1


@kernel
def _cycle(
    plant: Any,
    state: Any,
    control: Any,
    memory: Any,
    ripple: Any,
    friction: Any,
    mode: int,
    brake_stuck: bool,
    target_position: float,
    target_velocity: float,
    target_torque: float,
    torque_offset: float,
    process_noise: float,
    sensor_noise: float,
    steps: int,
    h: float,
    truth: Any,
    wall: float,
) -> tuple[float, float, float, float, float, float, float, float, float, bool]:
    p, s, c, m = plant[0], state[0], control[0], memory[0]
    y = reading(p, s)
    m.velocity += VELOCITY_FILTER * ((y - m.measured) / h - m.velocity)
    time, measured_torque = m.cycles * h, s.motor_torque + sensor_noise
    temperature = felt_temperature(p, s, h)
    if mode == 0:
        demand = target_position
        offset = torque_offset + _feedforward(c, m, friction[0], demand, h)
        wanted, clamped = _position_loop(c, m, demand, y, offset, h)
    elif mode == 1:
        demand, offset = y, torque_offset
        wanted, clamped = _velocity_loop(c, m, target_velocity, y, offset, h)
    elif mode == 2:
        demand, offset = y, torque_offset
        wanted, clamped = _clamp(target_torque + offset, c.limit_torque)
    else:
        demand, offset, wanted, clamped = y, 0.0, 0.0, False
    m.demand_velocity = (demand - m.demand) / h
    m.demand, m.measured = demand, y
    m.cycles += 1.0
    before, braked = s.velocity, mode < 0 or brake_stuck
    arrived = _arrived(m, wanted)
    if mode >= 0 and acts(ripple[0]):
        for _ in range(steps):  # in the current loop, which is as fast as the plant's steps
            given = stage(p, mode, arrived + own_ripple(ripple[0], reading(p, s)))
            advance(p, s, given, process_noise, braked, 1, h / steps)
    else:
        advance(p, s, stage(p, mode, arrived), process_noise, braked, steps, h / steps)
    shown = p.velocity_gain * m.velocity
    if len(truth) > 0:
        target = target_position if mode == 0 else target_velocity if mode == 1 else target_torque
        _log(truth[int(m.cycles) % len(truth)], p, s, mode, h * m.cycles, wall, before, h)
        _log_drive(truth[int(m.cycles) % len(truth)], wanted, y, shown, target, temperature)
    return time, demand, y, shown, wanted, measured_torque, offset, demand - y, temperature, clamped


@kernel
def _arrived(m: Record, wanted: float) -> float:
    """The torque demand that reaches the output stage now: this cycle's, or that of `late` cycles before [N m]."""
    if m.late == 0:
        return wanted
    oldest = m.held[0]
    for i in range(m.late - 1):
        m.held[i] = m.held[i + 1]
    m.held[m.late - 1] = wanted
    return float(oldest)


@kernel
def stage(p: Record, mode: int, wanted: float) -> float:
    """Torque that the output stage gives: what is wanted, or what it is stuck at [N m]."""
    if p.stage_torque == p.stage_torque and (mode >= 0 or p.stage_live != 0.0):
        return float(p.stage_torque)
    return wanted


@kernel
def _log(
    row: Record, p: Record, s: Record, mode: int, time: float, wall: float, before: float, h: float
) -> None:
    """What is true of the axis at the end of a period."""
    row.time, row.wall = time, wall
    row.position, row.velocity = s.position, s.velocity
    row.acceleration = (s.velocity - before) / h
    row.torque, row.push = p.torque_gain * s.motor_torque, s.pushed
    row.temperature = AMBIENT + s.winding + s.warming
    row.mode = mode
    row.live = 1 if mode >= 0 or (p.stage_live != 0.0 and p.stage_torque == p.stage_torque) else 0


@kernel
def _log_drive(row: Record, wanted: float, y: float, shown: float, target: float, temperature: float) -> None:
    """What the drive holds to be true at the same time."""
    row.demanded, row.reading, row.shown_velocity = wanted, y, shown
    row.target, row.shown_temperature = target, temperature


@kernel
def _clamp(torque: float, limit: float) -> tuple[float, bool]:
    if torque > limit:
        return limit, True
    if torque < -limit:
        return -limit, True
    return torque, False


@kernel
def _position_loop(
    c: Record, m: Record, demand: float, y: float, offset: float, h: float
) -> tuple[float, bool]:
    error = demand - y
    rate = ((demand - m.demand) - (y - m.measured)) / h
    m.derivative += c.controller_derivative_filter * (rate - m.derivative)
    total = m.sum + error * h
    torque = c.controller_kp * error + c.controller_kd * m.derivative + c.controller_ki * total + offset
    torque, clamped = _clamp(torque, c.limit_torque)
    if not clamped:
        m.sum = total
    return torque, clamped


@kernel
def _velocity_loop(
    c: Record, m: Record, target: float, y: float, offset: float, h: float
) -> tuple[float, bool]:
    error = target - (y - m.measured) / h
    m.derivative += c.controller_derivative_filter * (error - m.derivative)
    total = m.integral + error * h
    torque, clamped = _clamp(
        c.controller_kd * m.derivative + c.controller_kp * total + offset, c.limit_torque
    )
    if not clamped:
        m.integral = total
    return torque, clamped


@kernel
def _feedforward(c: Record, m: Record, table: Record, demand: float, h: float) -> float:
    """The drive's own block (5.2): the bristle follows the demand itself, the rest its smoothed rate."""
    step = demand - m.demand
    old = m.smooth_velocity
    keep = c.feedforward_reference_filter
    v = keep * old + (1.0 - keep) * step / h
    m.smooth_velocity = v
    friction, bent = _block_friction(c, m.bristle, step / h, h)
    m.bristle = bent
    if c.feedforward_enabled == 0.0:
        return 0.0
    friction += own_friction(table, step / h)
    return float(
        c.feedforward_inertia * (v - old) / h + c.feedforward_viscous * v + friction + c.feedforward_offset
    )


@kernel
def _block_friction(c: Record, z: float, v: float, h: float) -> tuple[float, float]:
    """Friction predicted for the demand's velocity v, and the bristle's new deflection (5.8)."""
    if v == 0.0:
        return c.feedforward_stiffness * z, z
    excess = max(c.feedforward_break_away - c.feedforward_coulomb, 0.0)
    level = c.feedforward_coulomb + excess * math.exp(-((v / c.feedforward_stribeck_velocity) ** 2))
    direction = math.copysign(1.0, v)
    if c.feedforward_stiffness == 0.0 or level == 0.0:
        return direction * level, 0.0
    g = level / c.feedforward_stiffness
    decay = math.exp(-abs(v) * h / g)
    z = decay * z + direction * g * (1.0 - decay)
    rate = v - abs(v) * z / g
    return c.feedforward_stiffness * z + c.feedforward_micro_damping * rate, z


def _same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))
