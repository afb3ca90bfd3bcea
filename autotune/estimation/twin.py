"""The twin: the fitted model, the encoder and the controller, run on the recorded references.

It starts every piece from what was measured, follows the same reference (or takes the same torque
where the axis ran in torque mode) and gives position and torque as the drive would have logged them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.controller import PositionController
from autotune.estimation.pieces import Piece
from autotune.estimation.stretch_twin import simulate_stretch
from autotune.models.drive_model import Packed

ASTRAY = 0.5
"""A twin whose position differs by this share of the travel (and 20 counts) does not follow."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What the twin needs beside the model.

    Attributes:
        resolution: of the encoder; 0 for none.
        limit: of the torque; infinite where unknown.
        process_noise, position_noise: standard deviations of a torque that changes every sample [N m],
            and of the position before it is quantised.
    """

    controller: PositionController
    resolution: float = 0.0
    limit: float = np.inf
    process_noise: float = 0.0
    position_noise: float = 0.0


@dataclass(frozen=True, slots=True)
class Simulated:
    """Position and torque of a piece in the twin, arrays of shape (n,); `follows` where it did not go astray."""

    position: Floats
    torque: Floats
    follows: bool


def run_twin(
    piece: Piece,
    packed: Packed,
    around: Surroundings,
    noise: np.random.Generator | None = None,
    quantised: bool = True,
) -> Simulated:
    """Simulates one piece; without `noise` it is free of noise.

    A piece in closed loop without a usable controller does not follow, nor one that slides in torque
    mode, where every error adds up.
    """
    controller = around.controller
    if (piece.closed and not controller.usable) or not (piece.closed or piece.sticks):
        return Simulated(piece.measured, piece.torque, False)
    n = len(piece)
    zero = np.zeros(n)
    disturbed = zero if noise is None else noise.normal(0.0, 1.0, n) * around.process_noise
    shaken = zero if noise is None else noise.normal(0.0, 1.0, n) * around.position_noise
    resolution = around.resolution if quantised else 0.0
    position, torque, inside = simulate_stretch(
        piece, packed, controller, around.limit, resolution, disturbed, shaken
    )
    if not inside:
        return Simulated(piece.measured, piece.torque, False)
    return Simulated(position, torque, _follows(piece, position, around.resolution))


def _follows(piece: Piece, position: Floats, resolution: float) -> bool:
    away = float(np.sqrt(np.mean((position - piece.measured) ** 2)))
    return away < max(ASTRAY * float(np.std(piece.measured)), 20.0 * resolution)
