"""The twin: the fitted model, the encoder and the controller, run on the recorded references.

It starts every piece from what was measured, follows the same reference (or takes the same torque
where the axis ran in torque mode) and gives position and torque as the drive would have logged them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.identify.controller import ControlLaw
from autotune.identify.pieces import Piece, start_state
from autotune.models.drive_model import Packed
from autotune.models.plant import simulate, substeps_for

Floats = NDArray[np.float64]
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

    law: ControlLaw | None
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

    A piece in closed loop without a usable control law does not follow, nor one that slides in torque
    mode, where every error adds up.
    """
    n = len(piece)
    position, torque = np.empty(n), np.empty(n)
    law = around.law
    if (piece.closed and (law is None or not law.usable)) or not (piece.closed or piece.sticks):
        return Simulated(piece.measured, piece.torque, False)
    gains = law.gains if law is not None else np.zeros(5)
    resolution = around.resolution if quantised else 0.0
    loop = np.array([piece.period, around.limit, resolution, *_memory(piece, law)])
    zero = np.zeros(n)
    disturbed = zero if noise is None else noise.normal(0.0, 1.0, n) * around.process_noise
    shaken = zero if noise is None else noise.normal(0.0, 1.0, n) * around.position_noise
    feedforward = piece.feedforward + (law.constant if law is not None and piece.closed else 0.0)
    done = simulate(
        packed.p,
        packed.on,
        start_state(piece, packed),
        gains,
        loop,
        piece.closed,
        substeps_for(packed.p, piece.period, packed.on),
        piece.reference if piece.closed else piece.torque,
        feedforward,
        disturbed,
        shaken,
        position,
        torque,
    )
    if done < n:
        return Simulated(piece.measured, piece.torque, False)
    return Simulated(position, torque, _follows(piece, position, around.resolution))


def _memory(piece: Piece, law: ControlLaw | None) -> tuple[float, float, float, float]:
    """Sum, filtered derivative, reference and position before the first row.

    The sum is what makes the twin's first torque equal the measured one.
    """
    if law is None or not piece.closed:
        return 0.0, 0.0, piece.last_reference, piece.last_position
    error = piece.reference[0] - piece.measured[0]
    change = law.reference_rate * (piece.reference[0] - piece.last_reference)
    change = (change - piece.measured[0] + piece.last_position) / piece.period
    rate = piece.rate + law.derivative_filter * (change - piece.rate)
    total = 0.0
    if law.ki > 0:
        rest = piece.torque[0] - piece.feedforward[0] - law.kp * error - law.kd * rate
        total = rest / law.ki - error * piece.period
    return total, piece.rate, piece.last_reference, piece.last_position


def _follows(piece: Piece, position: Floats, resolution: float) -> bool:
    away = float(np.sqrt(np.mean((position - piece.measured) ** 2)))
    return away < max(ASTRAY * float(np.std(piece.measured)), 20.0 * resolution)
