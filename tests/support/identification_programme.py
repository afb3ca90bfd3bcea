"""Recordings of the identification programme from simulated axes in this process, with known truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from autotune.core.axis import read_axis
from autotune.core.loop import LocalLoop
from autotune.core.paths import config_directory
from autotune.experiments.programmes import Choices, build
from autotune.experiments.record import Recorder, metadata_for
from autotune.experiments.record import play as play_and_record
from autotune.experiments.runner import Programme
from autotune.recordings.recording import Controller, Recording
from autotune_sim.inprocess import SimDrive
from autotune_sim.plant import PlantParameters, Wave
from autotune_sim.presets import Preset, preset

AXIS = config_directory() / "axes" / "edm-vertical.toml"


def play(
    axis: Preset,
    seed: int = 0,
    programmes: tuple[str, ...] = ("identification",),
    rivals: tuple[str, ...] | None = None,
) -> Recording:
    """What `autotune record` would have recorded on the axis.

    `seed` is of noise and random orders, `rivals` are what programme `decide` is to tell apart.
    """
    described = read_axis(AXIS)
    gains = axis.gains
    drive = SimDrive(axis, seed)
    experiments = [
        one
        for name in programmes
        for one in build(name, described, Choices(seed=seed, centre=0.0, rivals=rivals))
    ]
    programme = Programme(tuple(experiments), described.limits, seconds=1000.0)
    controller = Controller(gains.kp, gains.kd, gains.ki, gains.derivative_filter)
    recorder = Recorder(metadata_for(described, controller), programme.labels)
    play_and_record(LocalLoop(drive), programme, recorder)
    return recorder.recording()


def varied_axis(seed: int, spread: float = 0.3) -> Preset:
    """A LuGre axis with every parameter within ±spread, ripple, noise and quantiser."""
    random = np.random.default_rng([seed, 5])

    def scale() -> float:
        return float(random.uniform(1 - spread, 1 + spread))

    axis = preset("lugre")
    bristle = axis.plant.bristle
    if bristle is None:
        raise ValueError("the preset lugre has no bristle")
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
        ripple=(Wave(7.0, 0.01 * scale(), float(random.uniform(0, 2 * math.pi))),),
    )
    return replace(axis, plant=plant, seed=seed)


def truth(plant: PlantParameters) -> dict[str, float]:
    """The plant's parameters by the names that the model uses."""
    bristle = plant.bristle
    if bristle is None:
        raise ValueError("only a plant with one bristle has these parameters")
    return {
        "inertia": plant.inertia,
        "coulomb": bristle.coulomb,
        "offset": plant.offset,
        "stiffness": bristle.stiffness,
        "micro_damping": bristle.damping,
        "viscous": plant.viscous,
        "break_away": bristle.break_away,
        "stribeck_velocity": bristle.velocity,
    }


def reversal_of(plant: PlantParameters, acceleration: float) -> tuple[float, float]:
    """Displacement and time after which friction lacks e⁻¹ of a reversal at constant acceleration (3.36).

    The plant's own elements, followed from all bent backwards.
    """
    time = np.arange(0.0, 0.3, 1e-5)
    travel = 0.5 * acceleration * time**2
    friction = sum(e.torque * np.minimum(travel / e.displacement - 1.0, 1.0) for e in plant.elements)
    after = int(np.argmax(plant.friction - friction < 2.0 * plant.friction / math.e))
    return float(travel[after]), float(time[after])
