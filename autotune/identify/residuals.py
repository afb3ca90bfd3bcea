"""What a model says about a recording: its torque residual, and its motion in the closed loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.estimation.bandwidth import Bands
from autotune.estimation.controller import controller_of
from autotune.estimation.controller_law import PositionController
from autotune.estimation.pieces import Piece, cut, run_twin, torque_error
from autotune.identify.refinement import surroundings
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording
from autotune.signals.filters import low_pass


@dataclass(frozen=True, slots=True)
class Residual:
    """What a model leaves unexplained, rows decimated, arrays of shape (m,).

    Attributes:
        row: row of the recording; time: s.
        error: torque that the motion needed less what the model says [N m or N].
        torque, position, velocity, acceleration: filtered alike.
        use: whether the row is compared (it moves, is not clipped, not at an edge).
    """

    row: NDArray[np.int64]
    time: Floats
    error: Floats
    torque: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    use: NDArray[np.bool_]
    experiment: NDArray[np.str_]
    repeat: NDArray[np.int64]

    @property
    def relative_error(self) -> float:
        used = self.use
        return float(np.linalg.norm(self.error[used]) / np.linalg.norm(self.torque[used]))


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """The model in the loop on the recorded references, arrays as long as the recording.

    Attributes:
        position, torque: nan where no twin could be run.
        relative_position_error, relative_torque_error: norm of the error over norm of the signal.
        controller: used, or why there is none.
    """

    position: Floats
    torque: Floats
    relative_position_error: float
    relative_torque_error: float
    controller: PositionController


def torque_residual(recording: Recording, model: DriveModel) -> Residual:
    """Torque residual of a model on a recording, through filters that are the same for everybody."""
    controller = controller_of(recording)
    bands = Bands.of(recording)
    packed = model.pack()
    pieces = cut(recording, bands, controller, ())
    parts = []
    for piece in pieces:
        every = slice(None, None, bands.decimation)
        rows = np.arange(len(piece))[every]
        error = torque_error(piece, packed, bands)
        parts.append(
            (
                rows + piece.start,
                error,
                _filtered(piece.torque, piece, bands)[every],
                piece.position[every],
                piece.velocity[every],
                piece.acceleration[every],
                piece.use,
            )
        )
    row, error, torque, position, velocity, acceleration, use = (
        np.concatenate([part[i] for part in parts]) for i in range(7)
    )
    return Residual(
        row,
        recording["time"][row],
        error,
        torque,
        position,
        velocity,
        acceleration,
        use,
        recording.experiment[row],
        recording.repeat[row],
    )


def simulate_closed_loop(recording: Recording, model: DriveModel, seed: int | None = None) -> ClosedLoop:
    """Runs the model on the recorded references with the recorded (or identified) controller.

    Without `seed` the twin is free of noise and of the quantiser.
    """
    controller = controller_of(recording)
    bands = Bands.of(recording)
    around = surroundings(recording, controller)
    position = np.full(len(recording), math.nan)
    torque = np.full(len(recording), math.nan)
    packed = model.pack()
    for number, piece in enumerate(cut(recording, bands, controller, ())):
        noise = None if seed is None else np.random.default_rng([seed, number])
        result = run_twin(piece, packed, around, noise, quantised=seed is not None)
        if result.follows:
            position[piece.start : piece.start + len(piece)] = result.position
            torque[piece.start : piece.start + len(piece)] = result.torque
    return ClosedLoop(
        position,
        torque,
        _relative(position, recording["position"]),
        _relative(torque, recording["torque"]),
        controller,
    )


def _relative(simulated: Floats, measured: Floats) -> float:
    there = np.isfinite(simulated)
    if not np.any(there):
        return math.nan
    return float(np.linalg.norm((simulated - measured)[there]) / np.linalg.norm(measured[there]))


def _filtered(values: Floats, piece: Piece, bands: Bands) -> Floats:
    return low_pass(values, bands.error, piece.period)
