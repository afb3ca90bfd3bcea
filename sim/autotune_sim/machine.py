"""Mechanics of a composed machine: bodies, springs, contacts with friction, and an amplifier with a piezo stack.

Bodies that gears couple rigidly are one coordinate; there are n of them, with masses M (diagonal), and

    M v̇ = f − Σ c (k e + d ė) − Σ c (σ0 z + σ1 ż + σ2 ė),    e = c·x,    ż = ė − |ė| z/g(ė),

summed over the springs, and over the contacts with LuGre's friction (thesis, Appendix A: velocities of rigid bodies
and bristles are the states, so that no algebraic loop is left). Damping that does not change is taken at the new
velocity, (M + h D) v' = …, springs and bristles at the old position; bristles follow (5.8).

A piezo stack on an amplifier, (6.1) to (6.4): C u̇ = i − g_a v, i = (g u_in − u)/R held to ±i_max, force g_a u.

Kernels read and change the fields `machine_…` of the plant's records (`plant.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune_sim.kernel import Record, kernel

MAX_BODIES = 8
MAX_SPRINGS = 12
MAX_CONTACTS = 8
MOST_STEPS = 5000
"""Of integration in a cycle; a machine that needs more is stiffer than a drive's cycle can show."""
_PHASE = 0.25  # rad that the fastest mode turns in a step

Floats = NDArray[np.float64]
Array = NDArray[np.void]


@dataclass(frozen=True, slots=True)
class Spring:
    """Stiffness [N/m or N m/rad], damping and clearance over the elongation coefficients·x."""

    coefficients: tuple[float, ...]
    stiffness: float
    damping: float
    gap: float = 0.0


@dataclass(frozen=True, slots=True)
class Contact:
    """LuGre friction over the relative motion coefficients·x: F_c, F_s, v_s, σ0, σ1, σ2."""

    coefficients: tuple[float, ...]
    coulomb: float
    break_away: float
    velocity: float
    stiffness: float
    damping: float
    viscous: float


@dataclass(frozen=True, slots=True)
class Amplifier:
    """Voltage gain [1], output resistance [Ω], capacitance [F], largest current [A], piezo coupling g_a [N/V]."""

    gain: float
    resistance: float
    capacitance: float
    current: float
    coupling: float


@dataclass(frozen=True, slots=True)
class Machine:
    """A composed machine; coordinate 0 is the driven one.

    Args:
        mass: of each coordinate [kg m² or kg].
        force: constant force on each [N m or N].
        sensed: what the encoder reads: coefficients·x.
    """

    mass: tuple[float, ...]
    force: tuple[float, ...]
    springs: tuple[Spring, ...]
    contacts: tuple[Contact, ...]
    sensed: tuple[float, ...]
    amplifier: Amplifier | None = None

    @property
    def damping(self) -> Floats:
        """D, of springs without clearance and of contacts, shape (n, n)."""
        total = np.zeros((len(self.mass), len(self.mass)))
        for spring in self.springs:
            if spring.gap == 0.0:
                total += spring.damping * np.outer(spring.coefficients, spring.coefficients)
        for contact in self.contacts:
            both = contact.damping + contact.viscous
            total += both * np.outer(contact.coefficients, contact.coefficients)
        return total

    @property
    def stiffness(self) -> Floats:
        """K with all contacts sticking, shape (n, n)."""
        total = np.zeros((len(self.mass), len(self.mass)))
        parts: tuple[Spring | Contact, ...] = (*self.springs, *self.contacts)
        for part in parts:
            total += part.stiffness * np.outer(part.coefficients, part.coefficients)
        return total

    @property
    def free_inertia(self) -> float:
        """Inertia at coordinate 0 when every spring and gear is taken for rigid and no contact holds."""
        total = np.zeros((len(self.mass), len(self.mass)))
        for spring in self.springs:
            total += np.outer(spring.coefficients, spring.coefficients)
        motion = np.ones(len(self.mass))
        motion[1:] = np.linalg.lstsq(total[1:, 1:], -total[1:, 0], rcond=None)[0]
        return float(motion**2 @ np.array(self.mass))

    def steps(self, period: float) -> int:
        """Integration steps of a cycle of `period` [s]."""
        root = np.sqrt(np.array(self.mass))
        fastest = math.sqrt(max(np.linalg.eigvalsh(self.stiffness / np.outer(root, root)).max(), 1.0))
        return max(math.ceil(period * fastest / _PHASE), math.ceil(period / 1e-4))


PARAMETERS: list[tuple[str, type] | tuple[str, type, tuple[int, ...]]] = [
    ("machine_bodies", np.int64),
    ("machine_springs", np.int64),
    ("machine_contacts", np.int64),
    ("machine_mass", np.float64, (MAX_BODIES,)),
    ("machine_force", np.float64, (MAX_BODIES,)),
    ("machine_sensed", np.float64, (MAX_BODIES,)),
    ("machine_inverse", np.float64, (MAX_BODIES, MAX_BODIES)),
    ("machine_stretch", np.float64, (MAX_SPRINGS, MAX_BODIES)),
    ("machine_spring", np.float64, (MAX_SPRINGS, 3)),  # stiffness, damping, half clearance
    ("machine_slip", np.float64, (MAX_CONTACTS, MAX_BODIES)),
    ("machine_contact", np.float64, (MAX_CONTACTS, 5)),  # F_c, F_s, v_s, σ0, σ1
    ("machine_amplifier", np.float64, (5,)),  # gain, R, C, i_max, g_a; gain 0: none
]
STATE: list[tuple[str, type, tuple[int, ...]]] = [
    ("machine_position", np.float64, (MAX_BODIES,)),
    ("machine_velocity", np.float64, (MAX_BODIES,)),
    ("machine_push", np.float64, (MAX_BODIES,)),
    ("machine_bristle", np.float64, (MAX_CONTACTS,)),
    ("machine_voltage", np.float64, (1,)),
]


def pack_machine(packed: Array, machine: Machine, step: float) -> None:
    """Fills the fields of a plant's record for integration steps of `step` [s]."""
    n = len(machine.mass)
    packed["machine_bodies"], packed["machine_springs"] = n, len(machine.springs)
    packed["machine_contacts"] = len(machine.contacts)
    for name in ("mass", "force", "sensed"):
        packed["machine_" + name][0, :n] = getattr(machine, name)
    packed["machine_inverse"][0, :n, :n] = np.linalg.inv(np.diag(machine.mass) + step * machine.damping)
    for i, spring in enumerate(machine.springs):
        packed["machine_stretch"][0, i, :n] = spring.coefficients
        packed["machine_spring"][0, i] = spring.stiffness, spring.damping, 0.5 * spring.gap
    for i, contact in enumerate(machine.contacts):
        packed["machine_slip"][0, i, :n] = contact.coefficients
        packed["machine_contact"][0, i] = (
            contact.coulomb, contact.break_away, contact.velocity, contact.stiffness, contact.damping,
        )  # fmt: skip
    one = machine.amplifier
    if one is not None:
        packed["machine_amplifier"][0] = (
            one.gain, one.resistance, one.capacitance, one.current, one.coupling,
        )  # fmt: skip


@kernel
def machine_step(p: Record, s: Record, drive: float, h: float) -> None:
    """One step of h seconds; `drive` is the force on coordinate 0, or the amplifier's input voltage."""
    n = p.machine_bodies
    for i in range(n):
        s.machine_push[i] = p.machine_mass[i] * s.machine_velocity[i] + h * p.machine_force[i]
    s.machine_push[0] += h * (_stack(p, s, drive, h) if p.machine_amplifier[0] != 0.0 else drive)
    for k in range(p.machine_springs):
        force = _pull(p, s, k, n)
        for i in range(n):
            s.machine_push[i] -= h * p.machine_stretch[k, i] * force
    for k in range(p.machine_contacts):
        force = _hold(p, s, k, n)
        for i in range(n):
            s.machine_push[i] -= h * p.machine_slip[k, i] * force
    for i in range(n):
        v = 0.0
        for j in range(n):
            v += p.machine_inverse[i, j] * s.machine_push[j]
        s.machine_velocity[i] = v
        s.machine_position[i] += h * v
    for k in range(p.machine_contacts):
        _bend(p, s, k, n, h)


@kernel
def sensed(p: Record, values: Record) -> float:
    """What the encoder sees of positions or velocities."""
    total = 0.0
    for i in range(p.machine_bodies):
        total += p.machine_sensed[i] * values[i]
    return total


@kernel
def _stack(p: Record, s: Record, volts: float, h: float) -> float:
    """Force of the piezo [N]; its voltage moves on by one step, the resistance taken implicitly."""
    gain, resistance, capacitance, largest, coupling = p.machine_amplifier
    before, back = s.machine_voltage[0], coupling * s.machine_velocity[0]
    ratio = h / (resistance * capacitance)
    after = (before + ratio * gain * volts - h * back / capacitance) / (1.0 + ratio)
    current = (gain * volts - after) / resistance
    if abs(current) > largest:
        after = before + h * (math.copysign(largest, current) - back) / capacitance
    s.machine_voltage[0] = after
    return float(coupling * 0.5 * (before + after))


@kernel
def _pull(p: Record, s: Record, k: int, n: int) -> float:
    """Force of a spring; its damping only where it has a clearance, as a contact that cannot pull."""
    stretch, rate = 0.0, 0.0
    for i in range(n):
        stretch += p.machine_stretch[k, i] * s.machine_position[i]
        rate += p.machine_stretch[k, i] * s.machine_velocity[i]
    stiffness, damping, half = p.machine_spring[k]
    if half == 0.0:
        return float(stiffness * stretch)
    if stretch > half:
        return float(max(stiffness * (stretch - half) + damping * rate, 0.0))
    if stretch < -half:
        return float(min(stiffness * (stretch + half) + damping * rate, 0.0))
    return 0.0


@kernel
def _slip(p: Record, s: Record, k: int, n: int) -> float:
    rate = 0.0
    for i in range(n):
        rate += p.machine_slip[k, i] * s.machine_velocity[i]
    return rate


@kernel
def _hold(p: Record, s: Record, k: int, n: int) -> float:
    """Friction that is not in D: the bristle, and the part of its damping that sliding takes away."""
    coulomb, break_away, velocity, stiffness, damping = p.machine_contact[k]
    z, rate = s.machine_bristle[k], _slip(p, s, k, n)
    level = coulomb + (break_away - coulomb) * math.exp(-((rate / velocity) ** 2))
    if level == 0.0:
        return 0.0
    return float(stiffness * z - damping * abs(rate) * z * stiffness / level)


@kernel
def _bend(p: Record, s: Record, k: int, n: int, h: float) -> None:
    """(5.8): the bristle after a step at constant velocity."""
    coulomb, break_away, velocity, stiffness, _ = p.machine_contact[k]
    rate = _slip(p, s, k, n)
    level = coulomb + (break_away - coulomb) * math.exp(-((rate / velocity) ** 2))
    if rate == 0.0 or level == 0.0:
        return
    full = math.copysign(level / stiffness, rate)
    keep = math.exp(-h * abs(rate) * stiffness / level)
    s.machine_bristle[k] = full + (s.machine_bristle[k] - full) * keep


@kernel
def play(p: Record, s: Record, drive: Floats, steps: int, h: float, positions: Floats) -> None:
    """Row by row `steps` steps of h seconds with one value of `drive`; positions (rows, coordinates) are filled in."""
    for k in range(len(drive)):
        for _ in range(steps):
            machine_step(p, s, drive[k], h)
        for i in range(p.machine_bodies):
            positions[k, i] = s.machine_position[i]
