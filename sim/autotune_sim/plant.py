"""Mechanics of the simulated axis, motor side: inertia, friction, disturbances, encoder.

    J·dv/dt = T_motor + n − T_friction(q, v) − σ2·v − F_g − T_ripple(q) − ...

is integrated by the leapfrog method: velocities live half a step before positions, damping torques are
taken at the mean of old and new velocity, the motor torque as its mean from velocity to velocity. With a
step of 0.1 ms against presliding modes near 80 Hz this agrees with a step four times finer (a test holds
it to that). Where a transmission is elastic or has a gap, motor and load are two masses.

Everything is in SI. Kernels read a `PARAMETERS` record and change a `STATE` record. The record also has
the fields of `HEALTHY`: what is broken at this moment (`hurts`), nothing on a healthy axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from autotune_sim.friction import bend, slide, strength
from autotune_sim.kernel import Record, kernel
from autotune_sim.machine import PARAMETERS as MACHINE_PARAMETERS
from autotune_sim.machine import STATE as MACHINE_STATE
from autotune_sim.machine import Machine, machine_step, pack_machine, sensed

MAX_ELEMENTS = 12
MAX_WAVES = 8
STEP_LIMIT = 1e-4  # s, longest integration step of a rigid axis
AMBIENT = 25.0  # °C
BRAKE_STIFFNESS = 2000.0  # N m/rad
BRAKE_TORQUE = 2.0  # N m
BRAKE_DAMPING = 0.1  # N m s/rad
STOP_STIFFNESS = 500.0  # N m/rad, of a hard stop: 2.7 mrad at full torque
STOP_DAMPING = 0.3  # N m s/rad
LOAD_FILTER = 1e-3  # s, smoothing of the transmitted torque that presses the contacts
LUBRICANT_SPEED = 0.05  # rad/s, below it the lubricant's torque is linear in speed
WINDING_RISE = 60.0  # K, in the long run at full torque
WINDING_TIME = 300.0  # s

Array = NDArray[np.void]


@dataclass(frozen=True, slots=True)
class Element:
    """One elastic element: breaks at `displacement` [rad], carries `torque` [N m]."""

    displacement: float
    torque: float


@dataclass(frozen=True, slots=True)
class Bristle:
    """LuGre bristle: F_c, F_s [N m], v_s [rad/s], σ0 [N m/rad], σ1 [N m s/rad].

    `fading_velocity`: v_d of σ1·exp(−(v/v_d)²) [rad/s]; 0: σ1 is the same at all speeds. `exponent`: δ of
    exp(−|v/v_s|^δ), by which F_s falls to F_c. `sticks`: part of the level up to which the contact is elastic (Dupont,
    Hayward, Armstrong and Altpeter 2002); 0: LuGre's. `smooth_velocity`: of a contact that is no bristle and has no
    static friction, its level times tanh(v/v_c) [rad/s]; 0: it has.
    """

    coulomb: float
    break_away: float
    velocity: float
    stiffness: float
    damping: float
    fading_velocity: float = 0.0
    exponent: float = 2.0
    sticks: float = 0.0
    smooth_velocity: float = 0.0


@dataclass(frozen=True, slots=True)
class Wave:
    """A torque of `amplitude` [N m]·sin(order·q + phase) that opposes positive motion."""

    order: float
    amplitude: float
    phase: float


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """What the axis is made of. The second block is zero on a healthy axis (see `effects`).

    Attributes:
        inertia: kg m²; viscous: σ2 [N m s/rad]; offset: F_g [N m].
        micro_damping: σ1 of the elastic elements, shared in proportion to stiffness [N m s/rad].
        elements, bristle: friction; either may be missing.
        ripple: torque ripple of motor and bearings.
        process_noise: standard deviation of a torque that changes every cycle [N m].
        torque_noise: standard deviation of the torque measurement [N m].
        counts: encoder counts per revolution; torque_limit: of the amplifier [N m].
        asymmetry: friction is (1 + asymmetry)-fold for positive, (1 − asymmetry) for negative motion.
        stribeck: torque that friction loses with speed [N m], with `stribeck_velocity` [rad/s].
        lubricant: torque of the lubricant at 1 rad/s, growing with |v|^(2/3) [N m].
        bump, bump_centre, bump_width: relative rise of friction at a tight spot [rad].
        imbalance: N m, with phase [rad]; spring: N m/rad about position zero.
        thermal_softening: relative loss of friction per kelvin of warming [1/K], with the bearing's
            thermal resistance [K/W] and time constant [s].
        transmission_stiffness: N m/rad, 0 for a rigid axis; gap: backlash [rad];
            load_inertia, load_friction: share of the load side.
        lag: time constant of the torque loop [s]; saturation: relative loss of torque at the limit.
        dwell: rise of break-away torque after long rest [N m], dwell_time [s], dwell_slip [rad].
        load_factor: N m of friction per N m transmitted.
        eccentricity: amplitude of the encoder's once-per-revolution error [rad], with phase.
        machine: what hangs on the motor in place of one or two masses with the friction above (`composition`).
    """

    inertia: float
    viscous: float
    offset: float
    micro_damping: float = 0.0
    elements: tuple[Element, ...] = ()
    bristle: Bristle | None = None
    ripple: tuple[Wave, ...] = ()
    process_noise: float = 5e-3
    torque_noise: float = 2e-3
    counts: int = 50_000
    torque_limit: float = 1.34

    asymmetry: float = 0.0
    stribeck: float = 0.0
    stribeck_velocity: float = 0.3
    lubricant: float = 0.0
    bump: float = 0.0
    bump_centre: float = 0.0
    bump_width: float = 1.0
    imbalance: float = 0.0
    imbalance_phase: float = 0.0
    spring: float = 0.0
    thermal_softening: float = 0.0
    thermal_resistance: float = 6.0
    thermal_time: float = 60.0
    transmission_stiffness: float = 0.0
    gap: float = 0.0
    load_inertia: float = 0.4
    load_friction: float = 0.4
    lag: float = 0.0
    saturation: float = 0.0
    dwell: float = 0.0
    dwell_time: float = 1.0
    dwell_slip: float = 5e-3
    load_factor: float = 0.0
    eccentricity: float = 0.0
    eccentricity_phase: float = 0.0
    machine: Machine | None = None

    @property
    def resolution(self) -> float:
        """One encoder count [rad]."""
        return 2.0 * math.pi / self.counts

    @property
    def friction(self) -> float:
        """Friction level at speed, without viscous part [N m]."""
        level = sum(element.torque for element in self.elements)
        return level + (self.bristle.coulomb if self.bristle else 0.0)

    @property
    def stiffness(self) -> float:
        """Stiffness at rest [N m/rad]."""
        stiffness = sum(element.torque / element.displacement for element in self.elements)
        return stiffness + (self.bristle.stiffness if self.bristle else 0.0)


_COPIED = (
    "inertia", "viscous", "offset", "asymmetry", "stribeck_velocity", "lubricant", "bump_centre",
    "bump_width", "imbalance", "imbalance_phase", "spring", "thermal_softening", "thermal_resistance",
    "thermal_time", "transmission_stiffness", "gap", "load_inertia", "load_friction", "lag",
    "saturation", "dwell_time", "dwell_slip", "eccentricity", "eccentricity_phase", "torque_limit",
)  # fmt: skip
_DERIVED = ("resolution", "stribeck_ratio", "bump_ratio", "dwell_ratio", "load_ratio",
            "transmission_damping")  # fmt: skip
_BRISTLE = tuple("bristle_" + field.name for field in fields(Bristle))
_ELEMENT = ("element_displacement", "element_stiffness", "element_damping", "element_weight")
_WAVE = ("wave_order", "wave_amplitude", "wave_phase")

HEALTHY: dict[str, float] = {
    "encoder_gain": 1.0,
    "encoder_offset": 0.0,  # rad
    "encoder_held": math.nan,  # rad, reading of an encoder that is dead
    "velocity_gain": 1.0,  # of the drive's own velocity
    "torque_gain": 1.0,  # torque at the shaft per torque that the drive believes in
    "stage_torque": math.nan,  # N m, of an output stage that does not follow its demand
    "stage_live": 0.0,  # 1: it does so without power too
    "push": 0.0,  # N m, from outside
    "push_wave": 0.0,  # N m, from outside, at push_rate [rad/s]
    "push_rate": 0.0,
    "lean": 0.0,  # N m, largest, of somebody who leans on the table now and then
    "stop_low": -math.inf,  # rad, hard stops
    "stop_high": math.inf,
    "temperature_held": math.nan,  # °C, reading of a sensor that is dead
    "temperature_time": 0.0,  # s, time constant of a slow sensor
}
"""What can be broken, and its value on a healthy axis."""
PARAMETERS = np.dtype(
    [(name, np.float64) for name in (*_COPIED, *_DERIVED, *_BRISTLE, *HEALTHY)]
    + [(name, np.float64, (MAX_ELEMENTS,)) for name in _ELEMENT]
    + [(name, np.float64, (MAX_WAVES,)) for name in _WAVE]
    + [("element_count", np.int64), ("wave_count", np.int64)]
    + MACHINE_PARAMETERS,
    align=True,
)
_STATES = ("position", "velocity", "load_position", "load_velocity", "motor_torque", "motor_half", "age", "load",
           "warming", "winding", "brake", "felt", "elapsed", "pushed")  # fmt: skip
STATE = np.dtype(
    [(name, np.float64) for name in _STATES]
    + [("elastic", np.float64, (2,)), ("damping", np.float64, (2,)), ("bristle_state", np.float64, (2,))]
    + [("element_state", np.float64, (2, MAX_ELEMENTS))]
    + MACHINE_STATE,
    align=True,
)


def pack(plant: PlantParameters, step: float = STEP_LIMIT) -> Array:
    """The parameters as the kernels read them: a structured array of shape (1,); `step` [s] is of integration."""
    packed = np.zeros(1, PARAMETERS)
    for name in _COPIED:
        packed[name] = getattr(plant, name)
    level = plant.friction
    for name, value in (("stribeck", plant.stribeck), ("dwell", plant.dwell), ("load", plant.load_factor)):
        packed[name + "_ratio"] = value / level if level > 0 else 0.0
    packed["bump_ratio"] = plant.bump
    packed["resolution"] = plant.resolution
    packed["transmission_damping"] = _transmission_damping(plant)
    _pack_friction(packed, plant)
    for name, value in HEALTHY.items():
        packed[name] = value
    packed["wave_count"] = len(plant.ripple)
    for i, wave in enumerate(plant.ripple):
        packed["wave_order"][0, i] = wave.order
        packed["wave_amplitude"][0, i] = wave.amplitude
        packed["wave_phase"][0, i] = wave.phase
    if plant.machine is not None:
        pack_machine(packed, plant.machine, step)
    return packed


def fresh_state() -> Array:
    """A plant at rest at position zero, cold and without tension: shape (1,)."""
    return np.zeros(1, STATE)


def substeps(plant: PlantParameters, period: float) -> int:
    """Integration steps of one cycle; a two-mass axis is stiffer and needs twice as many."""
    if plant.machine is not None:
        return plant.machine.steps(period)
    return math.ceil(period / STEP_LIMIT - 1e-9) * (2 if plant.transmission_stiffness > 0 else 1)


def _pack_friction(packed: Array, plant: PlantParameters) -> None:
    level, stiffness = plant.friction, _element_stiffness(plant.elements)
    packed["element_count"] = len(plant.elements)
    for i, element in enumerate(plant.elements):
        own = element.torque / element.displacement
        packed["element_displacement"][0, i] = element.displacement
        packed["element_stiffness"][0, i] = own
        packed["element_damping"][0, i] = plant.micro_damping * own / stiffness if stiffness else 0.0
        packed["element_weight"][0, i] = element.torque / level if level else 0.0
    if plant.bristle is not None and plant.bristle.coulomb > 0:
        for field in fields(Bristle):
            packed["bristle_" + field.name] = getattr(plant.bristle, field.name)


def _element_stiffness(elements: Sequence[Element]) -> float:
    return sum(element.torque / element.displacement for element in elements)


def _transmission_damping(plant: PlantParameters) -> float:
    """Damping of the coupling [N m s/rad]: 5 % of critical."""
    reduced = plant.inertia * plant.load_inertia * (1.0 - plant.load_inertia)
    return 0.1 * math.sqrt(plant.transmission_stiffness * reduced)


@kernel
def reading(p: Record, s: Record) -> float:
    """Position as the encoder tells it: whole counts of the shaft's angle and its once-around error."""
    if p.encoder_held == p.encoder_held:
        return float(p.encoder_held)
    angle = s.position + p.eccentricity * math.sin(s.position + p.eccentricity_phase)
    angle = p.encoder_gain * angle + p.encoder_offset
    return float(round(angle / p.resolution) * p.resolution)


@kernel
def advance(p: Record, s: Record, torque: float, noise: float, braked: bool, steps: int, h: float) -> None:
    """Integrates `steps` steps of h seconds with a constant torque demand and disturbance [N m]."""
    s.pushed = outside(p, s.elapsed)
    noise += s.pushed
    s.elapsed += steps * h
    for _ in range(steps):
        drive = p.torque_gain * motor(p, s, torque, h)
        if p.machine_bodies > 0:
            many_masses(p, s, drive + noise, braked, h)
        elif p.transmission_stiffness > 0.0:
            two_masses(p, s, drive + noise, braked, h)
        else:
            one_mass(p, s, drive + noise, braked, h)
    warm(p, s, steps * h)


@kernel
def outside(p: Record, time: float) -> float:
    """Torque from outside at `time` [s]: a load, one that swings, somebody who leans on the table [N m].

    Leaning comes and goes: the product of two slow waves whose periods have no common multiple.
    """
    total = p.push
    if p.push_wave != 0.0:
        total += p.push_wave * math.sin(p.push_rate * time)
    if p.lean != 0.0:
        total += p.lean * max(0.0, math.sin(2.9 * time)) * math.sin(0.77 * time + 1.0)
    return float(total)


@kernel
def hard_stop(p: Record, q: float, v: float) -> float:
    """Torque of a hard stop at position q [rad]; it pushes and never pulls [N m]."""
    if q > p.stop_high:
        return float(max(STOP_STIFFNESS * (q - p.stop_high) + STOP_DAMPING * v, 0.0))
    if q < p.stop_low:
        return float(min(STOP_STIFFNESS * (q - p.stop_low) + STOP_DAMPING * v, 0.0))
    return 0.0


@kernel
def felt_temperature(p: Record, s: Record, elapsed: float) -> float:
    """What the drive's sensor says of the motor [°C]; it lags by `temperature_time`, or is dead."""
    true = s.winding + s.warming
    keep = p.temperature_time / (p.temperature_time + elapsed)
    s.felt = true + keep * (s.felt - true)
    if p.temperature_held == p.temperature_held:
        return float(p.temperature_held)
    return float(AMBIENT + s.felt)


@kernel
def motor(p: Record, s: Record, torque: float, h: float) -> float:
    """Mean torque at the shaft from half a step ago to half a step ahead.

    Iron saturation costs torque at high current; the current loop lags exponentially.
    """
    target = torque * (1.0 - p.saturation * (torque / p.torque_limit) ** 2)
    early, late, keep = 0.0, 0.0, 0.0
    if p.lag > 0.0:
        half = math.exp(-0.5 * h / p.lag)
        early = (1.0 - half) * 2.0 * p.lag / h
        late, keep = early * half, half * half
    missing = s.motor_torque - target
    mean = 0.5 * (s.motor_half + target + early * missing)
    s.motor_half = target + late * missing
    s.motor_torque = target + keep * missing
    return float(mean)


@kernel
def ripple(p: Record, q: float) -> float:
    """Cogging of motor and bearings [N m]."""
    total = 0.0
    for i in range(p.wave_count):
        total += p.wave_amplitude[i] * math.sin(p.wave_order[i] * q + p.wave_phase[i])
    return total


@kernel
def lubricant(p: Record, v: float) -> float:
    """Torque of the lubricant ∝ |v|^(2/3) (Palmgren), linear near standstill [N m]."""
    if p.lubricant == 0.0:
        return 0.0
    return float(p.lubricant * v / (v * v + LUBRICANT_SPEED * LUBRICANT_SPEED) ** (1.0 / 6.0))


@kernel
def load_torque(p: Record, q: float) -> float:
    """What hangs on the shaft: an unbalanced mass and a spring [N m]."""
    return float(p.imbalance * math.sin(q + p.imbalance_phase) + p.spring * q)


@kernel
def brake(s: Record, braked: bool, v: float, h: float) -> float:
    """Torque of the holding brake, a stiff element of dry friction; forgets its tension when released."""
    if not braked:
        s.brake = 0.0
        return 0.0
    limit = BRAKE_TORQUE / BRAKE_STIFFNESS
    s.brake = min(max(s.brake + h * v, -limit), limit)
    return float(BRAKE_STIFFNESS * s.brake + BRAKE_DAMPING * v)


@kernel
def rub(p: Record, s: Record, side: int, share: float, q: float, v: float, h: float) -> None:
    """Moves the contacts of one side to position q with velocity v and lets them age."""
    level, scale = strength(p, s, q, v)
    slip = slide(p, s, side, share, h * v, level)
    slip += bend(p, s, side, share, v, h, level, scale)
    if side == 0 and p.dwell_ratio != 0.0:
        gain = h / p.dwell_time
        s.age = (s.age + gain) / (1.0 + gain + slip / p.dwell_slip)


@kernel
def one_mass(p: Record, s: Record, drive: float, braked: bool, h: float) -> None:
    """One step of the rigid axis."""
    v, q = s.velocity, s.position
    resisting = p.offset + ripple(p, q) + load_torque(p, q) + hard_stop(p, q, v)
    held = brake(s, braked, v, h)
    damping = s.damping[0] + p.viscous * math.exp(-p.thermal_softening * s.warming)
    push = drive - s.elastic[0] - resisting - lubricant(p, v) - held
    drag = 0.5 * h / p.inertia * damping
    new = ((1.0 - drag) * v + h / p.inertia * push) / (1.0 + drag)
    s.velocity = new
    s.position = q + h * new
    if p.load_ratio != 0.0:
        transmitted = abs(p.inertia * (new - v) / h + resisting)
        s.load += (transmitted - s.load) * h / (LOAD_FILTER + h)
    rub(p, s, 0, 1.0, s.position, new, h)


@kernel
def coupling(p: Record, twist: float, rate: float) -> float:
    """Torque from motor to load through a spring and damper with a gap; a contact cannot pull [N m]."""
    half = 0.5 * p.gap
    if half == 0.0:
        return float(p.transmission_stiffness * twist + p.transmission_damping * rate)
    if twist > half:
        torque = p.transmission_stiffness * (twist - half) + p.transmission_damping * rate
        return float(max(torque, 0.0))
    if twist < -half:
        torque = p.transmission_stiffness * (twist + half) + p.transmission_damping * rate
        return float(min(torque, 0.0))
    return 0.0


@kernel
def two_masses(p: Record, s: Record, drive: float, braked: bool, h: float) -> None:
    """One step of motor and load; each side has its share of inertia, viscosity and friction."""
    v, w = s.velocity, s.load_velocity
    passed = coupling(p, s.position - s.load_position, v - w)
    viscous = p.viscous * math.exp(-p.thermal_softening * s.warming)
    held = brake(s, braked, v, h)
    near, far = 1.0 - p.load_friction, p.load_friction
    gain = h / (p.inertia * (1.0 - p.load_inertia))
    push = drive - passed - s.elastic[0] - ripple(p, s.position) - p.offset - lubricant(p, v) - held
    drag = 0.5 * gain * (s.damping[0] + near * viscous)
    s.velocity = ((1.0 - drag) * v + gain * push) / (1.0 + drag)
    gain = h / (p.inertia * p.load_inertia)
    push = passed - s.elastic[1] - load_torque(p, s.load_position) - hard_stop(p, s.load_position, w)
    drag = 0.5 * gain * (s.damping[1] + far * viscous)
    s.load_velocity = ((1.0 - drag) * w + gain * push) / (1.0 + drag)
    s.position += h * s.velocity
    s.load_position += h * s.load_velocity
    s.load += (abs(passed) - s.load) * h / (LOAD_FILTER + h)
    rub(p, s, 0, near, s.position, s.velocity, h)
    rub(p, s, 1, far, s.load_position, s.load_velocity, h)


@kernel
def many_masses(p: Record, s: Record, drive: float, braked: bool, h: float) -> None:
    """One step of a composed machine; brake, hard stops and ripple act where the motor does."""
    q, v = s.machine_position[0], s.machine_velocity[0]
    if p.machine_amplifier[0] == 0.0:
        drive -= ripple(p, q) + hard_stop(p, q, v) + brake(s, braked, v, h)
    machine_step(p, s, drive, h)
    s.position, s.velocity = sensed(p, s.machine_position), sensed(p, s.machine_velocity)


@kernel
def warm(p: Record, s: Record, elapsed: float) -> None:
    """Warms bearing and winding with what they dissipated; each is one thermal mass."""
    lost = abs((s.elastic[0] + (s.damping[0] + p.viscous) * s.velocity) * s.velocity)
    s.warming += (lost * p.thermal_resistance - s.warming) * elapsed / p.thermal_time
    rise = WINDING_RISE * (s.motor_torque / p.torque_limit) ** 2
    s.winding += (rise - s.winding) * elapsed / WINDING_TIME
