"""The inertial (stick-slip) drive of the thesis, section 6.2: steps by sawtooth, fine motion by the stack.

The stack moves a small slider slowly and the load rides along by friction; it flies back fast, the load's inertia
holds it, and a step is left. What a step leaves is limited by the amplifier: with 0.5 A on 1 µF the stack's voltage
changes by at most 0.5 V/µs, and over a flyback that long a load of 1 kg is dragged along by the 10 N of the contact.
Single steps leave 0.4 µm at most; near the resonance of the load on the ball (476 Hz while the guide slides) each
step begins with what the last one has left in motion, and 1.8 µm are reached: 20 µm in eleven steps.

What the contact between slider and load is, three sensors tell (`contact_record`): the thesis leaves the parameters
of its model open and asks for more sensors than one (6.2.4, chapter 7).

Simple control (section 6.2.2): sawtooth periods while the load is far (stepping mode), then the stack alone moves
the load, which sticks to the slider (scanning mode).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from autotune.core.errors import ConfigurationError
from autotune_sim.composition import plant_of, read_machine
from autotune_sim.machine import Machine, pack_machine, play
from autotune_sim.plant import fresh_state, pack

Floats = NDArray[np.float64]
Waveform = Literal["sawtooth", "cycloid"]
ROW = 2e-5
"""s between two values of the voltage."""
PARTS = 10
"""Of a row, over which a force is averaged."""
STACK, SLIDER, LOAD = 0, 1, 2


@dataclass(frozen=True)
class Motion:
    """Time [s], input voltage [V], and positions of stack, slider and load [m]; shapes (n,), (n,), (n, 3)."""

    time: Floats
    voltage: Floats
    position: Floats


@dataclass(frozen=True)
class ContactRecord:
    """What the slider does on the load; shapes (n,).

    Attributes:
        time: s; slip: of the slider on the load [m].
        force: mean from each row to the next of what pushes the slider through the ball, less what accelerates the
            slider with the load [N]: as seen from the load nothing else moves it but the contact.
    """

    time: Floats
    slip: Floats
    force: Floats

    def write(self, path: str | Path) -> None:
        """As CSV: time, slip, force."""
        columns = np.column_stack([self.time, self.slip, self.force])
        np.savetxt(path, columns, delimiter=",", header="time,slip,force", comments="", fmt="%.9g")


class InertialDrive:
    """The drive of a machine's file with a stack, a slider and a load, at rest at first.

    Args:
        load: mass that rides on it [kg]; None as in the file.
        force: on the load, against forward motion, as its weight would be on a vertical axis [N].
        finer: times the steps of integration, which is of first order: inertias are off by half a step times damping.

    Raises:
        ConfigurationError: a machine without amplifier, stack, slider and load.
    """

    def __init__(
        self, path: str | Path, *, load: float | None = None, force: float = 0.0, finer: int = 1
    ) -> None:
        file = read_machine(path)
        plant = plant_of(file, 1e-3)
        machine = plant.machine
        if machine is None or machine.amplifier is None or list(file.bodies) != ["stack", "slider", "load"]:
            raise ConfigurationError(
                f"machine {file.name} is no inertial drive: it needs an amplifier and the bodies stack, slider, load"
            )
        mass = (*machine.mass[:LOAD], machine.mass[LOAD] if load is None else load)
        self.machine: Machine = replace(machine, mass=mass, force=(0.0, 0.0, -force))
        self.limit = plant.torque_limit
        self._steps = finer * self.machine.steps(ROW)
        self._step = ROW / self._steps
        self._packed = pack(replace(plant, machine=self.machine), self._step)
        self._state = fresh_state()
        self._rows = 0

    @property
    def resonance(self) -> float:
        """Of slider and load on the ball while the guide slides [Hz]; a step rate above it leaves nothing."""
        machine = self.machine
        spring = next(
            s.stiffness for s in machine.springs if s.coefficients[STACK] and s.coefficients[SLIDER]
        )
        return math.sqrt(spring / (machine.mass[SLIDER] + machine.mass[LOAD])) / (2.0 * math.pi)

    def play(self, voltage: Floats) -> Motion:
        """Goes on from where it is with voltages at the amplifier's input, one every `ROW` seconds.

        Raises:
            ConfigurationError: a voltage beyond the amplifier's.
        """
        most = float(np.abs(voltage).max(initial=0.0))
        if most > self.limit * (1.0 + 1e-9):
            raise ConfigurationError(
                f"inertial drive: {most:.3g} V at the amplifier; allowed are ±{self.limit:g} V"
            )
        position = self._played(voltage, 1)
        time = ROW * (self._rows + np.arange(voltage.size, dtype=np.float64))
        self._rows += voltage.size
        return Motion(time, voltage, position)

    def _played(self, voltage: Floats, parts: int) -> Floats:
        """Positions at the end of each of so many parts of a row, shape (parts n, 3)."""
        steps = math.ceil(self._steps / parts)
        position = np.zeros((parts * voltage.size, len(self.machine.mass)))
        step = ROW / (parts * steps)
        if step != self._step:
            pack_machine(self._packed, self.machine, step)
            self._step = step
        play(self._packed[0], self._state[0], np.repeat(voltage, parts), steps, step, position)
        return position

    def contact_record(
        self, voltage: Floats, *, seed: int = 0, grain: float = 1e-9, noise: float = 0.02
    ) -> ContactRecord:
        """What three sensors see of the contact between slider and load, from where the drive is.

        Args:
            grain: of the sensor between slider and load [m], with noise of half of it.
            noise: of the force, root mean square [N].
        """
        random = np.random.default_rng(seed)
        x = self._played(voltage, PARTS)
        h = ROW / PARTS
        ball = next(
            s.stiffness for s in self.machine.springs if s.coefficients[STACK] and s.coefficients[SLIDER]
        )
        speed = np.gradient(x[:, LOAD], h)
        force = ball * (x[:, STACK] - x[:, SLIDER]) - self.machine.mass[SLIDER] * np.gradient(speed, h)
        slip = (x[:, SLIDER] - x[:, LOAD])[PARTS - 1 :: PARTS]
        slip = grain * np.round((slip + random.normal(0.0, 0.5 * grain, slip.size)) / grain)
        mean = force.reshape(-1, PARTS).mean(axis=1) + random.normal(0.0, noise, slip.size)
        # a row's force is the one that acts from its position to the next
        return ContactRecord(ROW * np.arange(slip.size - 1, dtype=np.float64), slip[:-1], mean[1:])


def step_voltage(amplitude: float, rate: float, steps: int, waveform: Waveform = "sawtooth") -> Floats:
    """Voltages of `steps` periods about zero [V]: slow forwards by `amplitude`, then back at once.

    A cycloid begins and ends its slow part without a jump of speed; a negative amplitude steps backwards.
    """
    rows = round(1.0 / (rate * ROW))
    share = np.arange(rows) / rows
    if waveform == "cycloid":
        share = share - np.sin(2.0 * math.pi * share) / (2.0 * math.pi)
    return np.tile(amplitude * (share - 0.5), steps)


def step_size(
    drive: InertialDrive, *, amplitude: float, rate: float, steps: int = 12, waveform: Waveform = "sawtooth"
) -> float:
    """Mean motion of the load a step [m], the first one left out.

    Raises:
        ConfigurationError: a rate above the resonance, where the load cannot follow the slider, or too large a voltage.
    """
    if rate > 1.25 * drive.resonance:
        raise ConfigurationError(
            f"inertial drive: {rate:g} steps a second; the load swings at {drive.resonance:.0f} Hz and does "
            f"not follow beyond: allowed are {1.25 * drive.resonance:.0f}"
        )
    rows = round(1.0 / (rate * ROW))
    load = drive.play(step_voltage(amplitude, rate, steps, waveform)).position[:, LOAD]
    return float(load[-1] - load[rows - 1]) / (steps - 1)


def mixed_steps(seconds: float, seed: int = 0) -> Floats:
    """Voltages of steps both ways, of all sizes, rates and waveforms: slow and fast slip, short and long."""
    random = np.random.default_rng(seed)
    parts: list[Floats] = []
    while sum(part.size for part in parts) * ROW < seconds:
        amplitude = float(random.choice([-1.0, 1.0]) * random.uniform(3.0, 9.5))
        waveform: Waveform = "sawtooth" if random.random() < 0.5 else "cycloid"
        parts.append(
            step_voltage(amplitude, float(random.uniform(100.0, 560.0)), int(random.integers(3, 9)), waveform)
        )
    return np.concatenate(parts)[: round(seconds / ROW)]


@dataclass(frozen=True)
class SimpleControl:
    """Section 6.2.2: steps of `amplitude` [V] at `rate` [Hz] while the load is farther off than `near` [m], then the
    voltage follows the error by integration, `gain` [V/(m s)]."""

    amplitude: float = 6.5
    rate: float = 510.0
    near: float = 1.5e-6
    gain: float = 1e8

    def go(self, drive: InertialDrive, distance: float, seconds: float) -> tuple[Motion, int]:
        """Moves the load by `distance` [m] within `seconds`; the motion, and how many steps it took."""
        parts = [drive.play(np.zeros(1))]
        goal = float(parts[0].position[-1, LOAD]) + distance
        steps, voltage = 0, 0.0
        while parts[-1].time[-1] < seconds:
            left = goal - float(parts[-1].position[-1, LOAD])
            if abs(left) > self.near and voltage == 0.0:
                parts.append(drive.play(step_voltage(math.copysign(self.amplitude, left), self.rate, 1)))
                steps += 1
                continue
            voltage = min(max(voltage + self.gain * left * 10 * ROW, -drive.limit), drive.limit)
            parts.append(drive.play(np.full(10, voltage)))
        joined = [
            np.concatenate(values)
            for values in zip(*((p.time, p.voltage, p.position) for p in parts), strict=True)
        ]
        return Motion(joined[0], joined[1], joined[2]), steps
