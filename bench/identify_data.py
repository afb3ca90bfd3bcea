"""The standard identification programme, played on the simulated axis without a wire.

Segments: conditioning, presliding (torque mode, multisine about the offset), dahl (slow loops),
steady_state (triangles, speeds in random order), high_speed (PRBS on a ramp), benchmark (sine), veto.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from autotune.core.recording import Controller, Metadata, Recording
from autotune_sim.plant import PlantParameters, Wave
from autotune_sim.presets import Preset, preset
from autotune_sim.servo import Servo, ServoMode

Floats = NDArray[np.float64]
COLUMNS = ("time", "reference", "position", "velocity", "torque_command", "torque", "torque_feedforward")


@dataclass(frozen=True, slots=True)
class Programme:
    """What is played, in the scale of the EDM axis (rad, s)."""

    speeds: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)
    path: float = math.pi / 2
    slow_path: float = 2.0 * math.pi / 7
    presliding_seconds: float = 10.0
    presliding_share: float = 0.1
    dahl_amplitude: float = 0.05
    dahl_speed: float = 0.02
    loops: int = 2
    repeats: int = 2


class Player:
    """Plays segments on a servo and gathers their rows."""

    def __init__(self, axis: Preset, seed: int) -> None:
        self.servo = Servo(axis, seed)
        self.random = np.random.default_rng([seed, 77])
        self.rows: list[tuple[float, ...]] = []
        self.names: list[str] = []
        self.counts: list[int] = []
        self.servo.power(True)

    def position(self, target: Floats, name: str, repeat: int = 0) -> None:
        """Follows `target`, shape (n,), in position control."""
        if self.servo.mode != ServoMode.POSITION:
            self.servo.power(True, ServoMode.POSITION)
        self._gather([self.servo.cycle(x) for x in target.tolist()], name, repeat)

    def torque(self, target: Floats, name: str, repeat: int = 0) -> None:
        """Applies `target`, shape (n,), in torque mode."""
        if self.servo.mode != ServoMode.TORQUE:
            self.servo.power(True, ServoMode.TORQUE)
        self._gather([self.servo.cycle(target_torque=x) for x in target.tolist()], name, repeat)

    def go_to(self, place: float) -> None:
        """Moves smoothly to a place as conditioning."""
        start = self.servo.position
        n = max(200, int(abs(place - start) / 2.0 / self.servo.period))
        shape = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, n))
        self.position(start + (place - start) * shape, "conditioning")
        self.position(np.full(100, place), "conditioning")

    def recording(self) -> Recording:
        plant, gains = self.servo.preset.plant, self.servo.preset.gains
        controller = Controller(gains.kp, gains.kd, gains.ki, gains.derivative_filter)
        table = np.array(self.rows)
        metadata = Metadata(
            sample_period=self.servo.period,
            position_resolution=plant.resolution,
            torque_limit=plant.torque_limit,
            controller=controller,
            axis="bench",
        )
        columns = {name: table[:, i] for i, name in enumerate(COLUMNS)}
        return Recording.from_columns(columns, metadata, self.names, self.counts)

    def _gather(self, states: list[object], name: str, repeat: int) -> None:
        for s in states:
            self.rows.append(
                (s.time, s.position_demand, s.position, s.velocity, s.torque_demand, s.torque_actual,
                 s.torque_offset)  # type: ignore[attr-defined]
            )  # fmt: skip
        self.names += [name] * len(states)
        self.counts += [repeat] * len(states)


def play(axis: Preset, seed: int = 0, programme: Programme | None = None) -> Recording:
    """Plays the programme on an axis; `seed` is of noise, order of speeds and excitation."""
    what = programme or Programme()
    player = Player(axis, seed)
    period = player.servo.period
    _presliding(player, what, period)
    _dahl(player, what, period)
    _steady_state(player, what, period)
    _high_speed(player, period)
    _benchmark(player, what, period)
    return player.recording()


def _presliding(player: Player, what: Programme, period: float) -> None:
    plant = player.servo.preset.plant
    n = round(what.presliding_seconds / period)
    time = np.arange(n) * period
    lines = np.unique(np.round(np.geomspace(1.0, 150.0, 25) * what.presliding_seconds))
    lines = lines / what.presliding_seconds
    for repeat in range(what.repeats):
        player.go_to(0.0)
        decay = np.geomspace(0.2, 1e-4, 3000)
        player.position(decay * np.sin(2 * np.pi * 4 * np.arange(3000) * period), "conditioning")
        phases = player.random.uniform(0, 2 * np.pi, len(lines))
        wave = np.sin(2 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
        wave *= what.presliding_share * plant.friction / np.abs(wave).max()
        player.torque(np.full(200, plant.offset), "conditioning")
        player.torque(plant.offset + wave, "presliding", repeat)


def _dahl(player: Player, what: Programme, period: float) -> None:
    player.go_to(0.0)
    for repeat in range(what.repeats):
        player.position(triangle(what.dahl_amplitude, what.dahl_speed, what.loops, period), "dahl", repeat)


def _steady_state(player: Player, what: Programme, period: float) -> None:
    order = player.random.permutation(len(what.speeds))
    for number, index in enumerate(order):
        speed = what.speeds[index]
        path = what.slow_path if speed < 0.3 else what.path
        cycles = 1 if speed < 1.0 else 2
        player.go_to(0.0)
        player.position(0.5 * path + triangle(0.5 * path, speed, cycles, period, -1), "steady_state", number)


def _high_speed(player: Player, period: float) -> None:
    player.go_to(0.0)
    n = round(4.0 / period)
    ramp = 6.0 * np.arange(n) * period
    excitation = np.repeat(player.random.choice([-1.0, 1.0], n // 4 + 1), 4)[:n] * 0.004
    player.position(ramp + excitation, "high_speed")
    player.go_to(24.0)
    player.go_to(0.0)


def _benchmark(player: Player, what: Programme, period: float) -> None:
    time = np.arange(round(2.0 / period)) * period
    player.go_to(0.0)
    for repeat in range(what.repeats):
        player.position(0.2 * np.sin(2 * np.pi * time), "benchmark", repeat)
    slow = np.arange(round(4.0 / period)) * period
    for repeat in range(what.repeats):
        wave = 0.3 * np.sin(2 * np.pi * 0.5 * slow) + 0.05 * np.sin(2 * np.pi * 2.75 * slow)
        player.position(wave, "veto", repeat)


def triangle(amplitude: float, speed: float, cycles: int, period: float, start: int = 0) -> Floats:
    """Triangles from zero (start 0) or from the lower end (start −1), shape (n,)."""
    time = np.arange(round(4.0 * amplitude / speed * cycles / period)) * period
    phase = time * speed / (4.0 * amplitude) + (0.25 if start == 0 else 0.0)
    return np.asarray(amplitude * (4.0 * np.abs(phase - np.floor(phase + 0.5)) - 1.0))


def varied_axis(seed: int, spread: float = 0.3) -> Preset:
    """A LuGre axis with every parameter within ±spread, ripple, noise and quantiser."""
    random = np.random.default_rng([seed, 5])
    axis = preset("lugre")
    bristle = axis.plant.bristle
    scale = lambda: float(random.uniform(1 - spread, 1 + spread))  # noqa: E731
    coulomb = bristle.coulomb * scale()
    plant: PlantParameters = replace(
        axis.plant,
        inertia=axis.plant.inertia * scale(),
        viscous=axis.plant.viscous * scale(),
        offset=axis.plant.offset * scale(),
        bristle=replace(
            bristle,
            coulomb=coulomb,
            break_away=coulomb * (1.0 + 0.2 * scale()),
            velocity=bristle.velocity * scale(),
            stiffness=bristle.stiffness * scale(),
            damping=bristle.damping * scale(),
        ),
        ripple=(Wave(7.0, 0.01 * scale(), float(random.uniform(0, 2 * np.pi))),),
    )
    return replace(axis, plant=plant, seed=seed)
