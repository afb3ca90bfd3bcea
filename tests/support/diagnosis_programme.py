"""The diagnosis programme played on the simulated axis with planted effects, in one fast loop.

Segments: a conditioning move, then seven experiments twice (57 s a round), the veto trajectory twice and
an unseen test trajectory, all in position control by the drive's own PID.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from autotune.core.arrays import Floats
from autotune.recordings.recording import Controller, Metadata, Recording
from autotune_sim.presets import Preset
from autotune_sim.servo import Servo, ServoState

PERIOD = 1e-3
TRAVEL = 9.4  # rad, about one and a half turns, from -TRAVEL/2 to TRAVEL/2


class Line:
    """A reference that grows by pieces and stays continuous."""

    def __init__(self) -> None:
        self.parts: list[Floats] = [np.zeros(1)]
        self.names: list[str] = ["conditioning"]
        self.repeats: list[int] = [0]

    @property
    def end(self) -> float:
        return float(self.parts[-1][-1])

    def add(self, values: Floats, name: str, repeat: int = 0) -> None:
        if len(values):
            self.parts.append(np.asarray(values, dtype=float))
            self.names += [name] * len(values)
            self.repeats += [repeat] * len(values)

    def go(self, target: float) -> None:
        """Moves to a place as conditioning and rests there."""
        self.add(move(self.end, target, 3.0, 40.0), "conditioning")
        self.add(np.full(150, target), "conditioning")


def move(start: float, target: float, speed: float, acceleration: float) -> Floats:
    """A smooth move (sin² velocity flanks) with given greatest speed and acceleration."""
    distance = abs(target - start)
    if distance == 0.0:
        return np.zeros(0)
    flank = speed / acceleration * math.pi / 2
    speed = min(speed, distance / flank) if speed * flank > distance else speed
    seconds = distance / speed
    time = np.arange(0.0, seconds + flank, PERIOD)

    def ramp(t: Floats) -> Floats:
        inside = np.clip(t, 0.0, flank)
        half = inside / 2 - flank / (2 * math.pi) * np.sin(math.pi * inside / flank)
        return half + np.maximum(t - flank, 0.0)

    shape = speed * (ramp(time) - ramp(time - seconds))
    shape *= distance / shape[-1]
    return start + math.copysign(1.0, target - start) * shape


def _hold(line: Line, seconds: float) -> Floats:
    return np.full(round(seconds / PERIOD), line.end)


def _sine(amplitude: float, frequency: float, cycles: float) -> Floats:
    time = np.arange(round(cycles / frequency / PERIOD)) * PERIOD
    return amplitude * np.sin(2 * np.pi * frequency * time)


def _triangle(amplitude: float, speed: float, cycles: float) -> Floats:
    phase = np.arange(round(4 * amplitude / speed * cycles / PERIOD)) * PERIOD * speed / (4 * amplitude)
    phase = phase + 0.25
    return amplitude * (4 * np.abs(phase - np.floor(phase + 0.5)) - 1.0)


def _presliding(line: Line, rng: np.random.Generator) -> Floats:
    rows = [(0.4e-3, 2.0), (0.8e-3, 1.0), (1.5e-3, 1.0), (3e-3, 1.0), (8e-3, 0.8), (20e-3, 0.8)]
    return np.concatenate([_sine(a, f, 2.0) for a, f in rows])


def _sines(line: Line, rng: np.random.Generator) -> Floats:
    return _sine(0.2, 1.0, 4)


def _triangles(line: Line, rng: np.random.Generator) -> Floats:
    rows = [(0.03, 0.03, 1), (0.05, 0.1, 1), (0.1, 0.3, 1), (0.3, 1.0, 1), (0.5, 3.0, 2)]
    return np.concatenate([_triangle(*row) for row in rows])


def _scans(line: Line, rng: np.random.Generator) -> Floats:
    half = TRAVEL / 2
    a = move(0.0, half, 2.5, 40.0)
    b = move(half, -half, 2.5, 40.0)
    c = move(-half, half, 10.0, 100.0)
    d = move(half, -half, 10.0, 100.0)
    return np.concatenate([a, b, c, d, move(-half, 0.0, 5.0, 60.0)])


def _dwells(line: Line, rng: np.random.Generator) -> Floats:
    out: list[Floats] = []
    place = 0.0
    for i, rest in enumerate((0.05, 0.1, 0.2, 0.4, 0.8, 1.5, 2.5, 2.5, 1.0, 0.3, 0.15)):
        target = 0.15 if i % 2 == 0 else 0.0
        out += [move(place, target, 0.8, 20.0), np.full(round(rest / PERIOD), target)]
        place = target
    return np.concatenate([*out, move(place, 0.0, 0.8, 20.0)])


def _multisine(line: Line, rng: np.random.Generator) -> Floats:
    frequencies = np.array([2, 3, 5, 7, 9.5, 12.5, 16.5, 19.5, 23.0])
    time = np.arange(4000) * PERIOD
    phases = np.random.default_rng(5).uniform(0, 2 * np.pi, len(frequencies))
    waves = np.sin(2 * np.pi * np.outer(time, frequencies) + phases) * (0.03 / frequencies**0.8)
    ramp = np.minimum(1.0, np.minimum(time, time[::-1]) / 0.3)
    return waves.sum(axis=1) * ramp


def _points(line: Line, rng: np.random.Generator) -> Floats:
    places = [0.0, 2.0, -1.5, 4.0, -4.0, 1.0, 0.0]
    speeds = [6.0, 10.0, 15.0, 15.0, 8.0, 6.0]
    out: list[Floats] = []
    for a, b, speed in zip(places, places[1:], speeds, strict=False):
        out += [move(a, b, speed, 300.0), np.full(120, b)]
    return np.concatenate(out)


def _veto(line: Line, rng: np.random.Generator) -> Floats:
    own = np.random.default_rng(17)
    out: list[Floats] = [_triangle(0.06, 0.06, 0.5)[:800]]
    out = []
    place = 0.0
    for speed, acceleration, rest in (
        (1.2, 30.0, 0.6), (4.0, 80.0, 0.1), (12.0, 200.0, 0.05), (0.4, 10.0, 1.2), (7.0, 250.0, 0.2),
        (2.0, 40.0, 0.05), (14.0, 280.0, 0.4),
    ):  # fmt: skip
        far = own.uniform(0.3, 0.6) if speed < 1.5 else own.uniform(2.0, 4.2)
        target = -far if place > 0 else far
        if speed < 1.5:
            target = place + (0.4 if place < 0 else -0.4)
        out += [move(place, target, speed, acceleration), np.full(round(rest / PERIOD), target)]
        place = target
    out.append(move(place, 0.0, 3.0, 40.0))
    out += [_sine(0.12, 0.7, 2), _sine(4e-3, 1.3, 2), _sine(0.9, 0.5, 1), _sine(15e-3, 6.0, 9)]
    return np.concatenate(out)


def _test(line: Line, rng: np.random.Generator) -> Floats:
    out = [
        _sine(0.15, 1.2, 2), _sine(6e-3, 0.9, 1), _triangle(0.4, 0.8, 1), _sine(1.6, 0.6, 1),
        move(0.0, 3.0, 9.0, 150.0), np.full(300, 3.0), move(3.0, -2.0, 5.0, 220.0), np.full(80, -2.0),
        move(-2.0, 0.0, 2.0, 40.0), _sine(0.02, 4.5, 5),
    ]  # fmt: skip
    return np.concatenate(out)


EXPERIMENTS: dict[str, Callable[[Line, np.random.Generator], Floats]] = {
    "presliding": _presliding, "sine": _sines, "triangles": _triangles, "scans": _scans,
    "dwells": _dwells, "multisine": _multisine, "points": _points,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Programme:
    """A reference with the name and repeat of every row; arrays of shape (n,)."""

    reference: Floats
    names: list[str]
    repeats: list[int]


def programme(names: tuple[str, ...] = tuple(EXPERIMENTS), repeats: int = 2) -> Programme:
    """The programme of the diagnosis study."""
    line, rng = Line(), np.random.default_rng(1)
    line.add(move(0.0, 2.0, 4.0, 60.0), "conditioning")
    line.add(move(2.0, -2.0, 4.0, 60.0), "conditioning")
    line.go(0.0)
    for repeat in range(repeats):
        for name in names:
            line.add(EXPERIMENTS[name](line, rng), name, repeat)
            line.go(0.0)
    for repeat in range(repeats):
        line.add(_veto(line, rng), "veto", repeat)
        line.go(0.0)
    line.add(_test(line, rng), "test")
    line.go(0.0)
    return Programme(np.concatenate(line.parts), line.names, line.repeats)


class Alien(Protocol):
    """A torque that the library does not know, acting on the motor beside the drive's own."""

    def __call__(self, time: float, position: float, velocity: float, acceleration: float) -> float:
        """Torque [N m] at this instant."""


def play(axis: Preset, seed: int = 0, what: Programme | None = None, alien: Alien | None = None) -> Recording:
    """Plays the programme on an axis; the torque of an alien acts on the plant but is not recorded."""
    what = what or programme()
    servo = Servo(axis, seed)
    servo.power(True)
    states = _played(servo, what.reference.tolist(), alien)
    gains, plant = servo.preset.gains, servo.preset.plant
    metadata = Metadata(
        sample_period=servo.period,
        position_resolution=plant.resolution,
        torque_limit=plant.torque_limit,
        controller=Controller(gains.kp, gains.kd, gains.ki, gains.derivative_filter),
        axis="bench",
    )
    columns = {
        "time": np.array([s.time for s in states]),
        "reference": np.array([s.position_demand for s in states]),
        "position": np.array([s.position for s in states]),
        "torque_command": np.array([s.torque_demand - s.torque_offset for s in states]),
        "torque": np.array([s.torque_actual - s.torque_offset for s in states]),
    }
    return Recording.from_columns(columns, metadata, what.names, what.repeats)


def _played(servo: Servo, targets: list[float], alien: Alien | None) -> list[ServoState]:
    cycle = servo.cycle
    if alien is None:
        return [cycle(target) for target in targets]
    states: list[ServoState] = []
    velocity = acceleration = extra = 0.0
    for target in targets:
        state = cycle(target, torque_offset=extra)
        acceleration += 0.2 * ((state.velocity - velocity) / servo.period - acceleration)
        velocity = state.velocity
        states.append(state)
        extra = alien(state.time, state.position, velocity, acceleration)
    return states
