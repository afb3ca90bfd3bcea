"""Start values from any recording in which the axis moves, whatever it was made for.

Inertia, viscous and Coulomb friction and offset by weighted least squares on the filtered motion
(inverse dynamics), away from standstill; the stiffness by trying values over the range that the data
can tell, with the bristle driven by the measured motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.identify.pieces import Bands, Piece, torque_error
from autotune.models.drive_model import base_model
from autotune.signals.filters import low_pass

Floats = NDArray[np.float64]
TRIALS = 9
_SLIDING = 0.05
"""Rows slower than this share of the 95th percentile of speed do not enter the linear fit."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Base parameters by name, and the share of the torque they leave unexplained."""

    values: dict[str, float]
    relative_error: float


def guess(pieces: Sequence[Piece], bands: Bands, motion_unit: str) -> Guess:
    """Start values.

    Raises:
        NotEnoughExcitation: one direction only, no acceleration, or friction that cannot be seen.
        RecordingError: a negative inertia, that is a torque of the wrong sign.
    """
    design, target = _regressors(pieces, bands)
    scale = np.maximum(np.sqrt(np.mean(design**2, axis=0)), 1e-300)
    if np.linalg.cond(design / scale) > 1e6:
        raise NotEnoughExcitation(
            "inertia, viscous and Coulomb friction and offset cannot be told apart in this motion; record "
            "several speeds and accelerations in both directions"
        )
    solution = np.linalg.lstsq(design / scale, target, rcond=None)[0] / scale
    inertia, viscous, coulomb, offset = (float(x) for x in solution)
    _refuse(inertia, coulomb, design, target, solution)
    values = {
        "inertia": inertia,
        "viscous": max(viscous, 1e-3 * abs(coulomb) / float(np.max(np.abs(design[:, 1])))),
        "coulomb": coulomb,
        "offset": offset,
    }
    return _with_stiffness(values, pieces, bands, motion_unit)


def _regressors(pieces: Sequence[Piece], bands: Bands) -> tuple[Floats, Floats]:
    """Acceleration, velocity, direction, 1; and torque: filtered alike, decimated, sliding rows only."""
    fast = float(np.percentile(np.concatenate([np.abs(piece.velocity) for piece in pieces]), 95))
    if fast <= 0.0:
        raise NotEnoughExcitation("the axis stands still in this recording; nothing can be fitted to it")
    designs, targets = [], []
    for piece in pieces:
        columns = [
            piece.acceleration,
            piece.velocity,
            np.sign(piece.velocity),
            np.ones(len(piece)),
            0.5 * (piece.torque + np.concatenate([piece.torque[:1], piece.torque[:-1]])),
        ]
        table = low_pass(np.array(columns), bands.error, piece.period)[:, :: bands.decimation]
        moving = piece.use & (np.abs(piece.velocity[:: bands.decimation]) > _SLIDING * fast)
        designs.append(table[:4, moving].T)
        targets.append(table[4, moving])
    design, target = np.vstack(designs), np.concatenate(targets)
    directions = np.sign(design[:, 1])
    share = float(np.mean(directions > 0)) if len(directions) else 0.0
    if len(target) < 50 or min(share, 1.0 - share) < 0.02:
        word = "positive" if share > 0.5 else "negative"
        raise NotEnoughExcitation(
            f"the axis moved in the {word} direction only, or hardly at all ({len(target)} rows); Coulomb "
            "friction and offset cannot be told apart. Record both directions"
        )
    return design, target


def _refuse(inertia: float, coulomb: float, design: Floats, target: Floats, solution: Floats) -> None:
    error = target - design @ solution
    unexplained = float(np.var(error)) / max(float(np.var(target)), 1e-300)
    if unexplained > 0.9:
        raise NotEnoughExcitation(
            f"motion explains {100 * (1 - unexplained):.0f} % of the torque only; check that position and torque "
            "are of the same axis and aligned in time"
        )
    if coulomb <= 0.0 and inertia <= 0.0:
        raise RecordingError(
            f"inertia ({inertia:.3g}) and Coulomb friction ({coulomb:.3g}) come out negative: the torque has the "
            "wrong sign. Import it again with a factor of −1"
        )
    spread = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)) * float(np.var(error)))
    if inertia <= 3.0 * float(spread[0]):
        raise NotEnoughExcitation(
            f"inertia comes out as {inertia:.3g} ± {spread[0]:.2g}: the motion accelerates too little, or the "
            "torque is delayed. Record faster changes of speed"
        )
    if coulomb <= 0.0:
        raise NotEnoughExcitation(
            f"Coulomb friction comes out as {coulomb:.3g}; it must be above 0. Record slow moves in both "
            "directions, or check that friction is not compensated already"
        )


def _with_stiffness(
    values: dict[str, float], pieces: Sequence[Piece], bands: Bands, motion_unit: str
) -> Guess:
    """The stiffness whose bristle, driven by the measured motion, leaves the least error."""
    travel = max(float(np.ptp(piece.position)) for piece in pieces)
    trials: list[tuple[float, dict[str, float]]] = []
    for reach in np.geomspace(2e-5 * travel, 0.1 * travel, TRIALS).tolist():
        stiffness = values["coulomb"] / reach
        damping = 0.4 * float(np.sqrt(stiffness * values["inertia"]))
        trial = values | {"stiffness": stiffness, "micro_damping": damping}
        packed = base_model(trial, motion_unit=motion_unit).pack()
        rows = [torque_error(piece, packed, bands)[piece.use] for piece in pieces]
        error = float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))
        trials.append((error, trial))
    torque = np.concatenate([p.torque[:: bands.decimation][: len(p.use)][p.use] for p in pieces])
    error, best = min(trials, key=lambda pair: pair[0])
    return Guess(best, error / float(np.sqrt(np.mean(np.square(torque)))))
