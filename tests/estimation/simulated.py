"""A simulated axis under a known position controller, without any drive."""

from __future__ import annotations

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.controller_law import PositionController
from autotune.models import layout
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.plant import seen_late, simulate, substeps_for
from autotune.recordings.recording import Controller, Metadata, Recording

PERIOD = 1e-3
RESOLUTION = 2e-6
TRUE = PositionController(6.0, 0.03, 100.0, 0.5)
AXIS = {
    "inertia": 1.6e-4,
    "viscous": 1e-3,
    "coulomb": 0.05,
    "stiffness": 40.0,
    "micro_damping": 0.03,
    "offset": 0.01,
}
OF_TRUE = Controller(TRUE.kp, TRUE.kd, TRUE.ki, TRUE.derivative_filter)


def recorded(
    law: PositionController,
    known: Controller | None = None,
    limit: float | None = None,
    model: DriveModel | None = None,
    seconds: float = 6.0,
    seed: int = 4,
    noise: float = 2e-3,
    period: float = PERIOD,
) -> Recording:
    """A multisine on an axis under this controller, with a torque that changes every sample as noise."""
    time = np.arange(round(seconds / period)) * period
    random = np.random.default_rng(seed)
    phases = random.uniform(0.0, 2.0 * np.pi, 5)
    tones = [
        np.sin(2.0 * np.pi * f * time + a) / f for f, a in zip((0.5, 1.1, 2.3, 4.9, 9.7), phases, strict=True)
    ]
    reference = 2.0 * np.sum(tones, axis=0) * np.minimum(time / 0.5, 1.0) ** 2
    shaken = random.normal(0.0, noise * np.sqrt(PERIOD / period), len(time))
    columns = followed(reference, shaken, law, model or base_model(AXIS), limit, period)
    metadata = Metadata(
        sample_period=period, position_resolution=RESOLUTION, torque_limit=limit, controller=known
    )
    return Recording.from_columns(columns, metadata, "motion")


def followed(
    reference: Floats,
    disturbance: Floats,
    law: PositionController,
    model: DriveModel,
    limit: float | None = None,
    period: float = PERIOD,
    added: Floats | float = 0.0,
) -> dict[str, Floats]:
    """Columns of a recording of an axis that follows a reference while a torque disturbs it, shape (n,) each.

    `added`: to what its controller asks for.
    """
    packed = model.pack()
    position, torque = np.empty_like(reference), np.empty_like(reference)
    seen = np.zeros(seen_late(law.position_delay))
    loop = np.array([period, limit or np.inf, RESOLUTION, 0.0, 0.0, reference[0], 0.0, *seen])
    done = simulate(
        packed.p,
        packed.on,
        np.zeros(layout.STATES),
        law.gains,
        loop,
        True,
        substeps_for(packed.p, period, packed.on),
        reference,
        law.feedforward(reference, reference[0], period) + added,
        disturbance,
        np.zeros_like(reference),
        position,
        torque,
    )
    assert done == len(reference)
    time = np.arange(len(reference)) * period
    return {"time": time, "reference": reference, "position": position, "torque": torque}
