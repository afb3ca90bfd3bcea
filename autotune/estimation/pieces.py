"""A recording cut into contiguous pieces, each ready for the inverse routine and for the twin.

A piece is one segment without gaps. Its motion comes from zero-phase filters; where its bristle and
controller stand at the start is read from the rows before it and from the balance of torques.

Each piece has its twin: the fitted model, the encoder and the controller, run on what the piece was led by.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.bandwidth import Bands, travel_near
from autotune.estimation.controller import is_closed
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import STANDSTILL_COUNTS, STANDSTILL_SECONDS
from autotune.estimation.disturbance import STILL, Disturbance
from autotune.estimation.residual import Motion, stretch_residual, stretch_residuals
from autotune.estimation.twin import leading, loop_along, simulate_stretch, simulate_stretches, start_state
from autotune.models.drive_model import Packed
from autotune.models.lanes import beside_or_one
from autotune.recordings.checks import clipped, guide_of, torque_of
from autotune.recordings.recording import RESERVED_EXPERIMENTS, Recording
from autotune.signals.filters import low_pass, motion

LEAST_SECONDS = 0.15
UNFITTED = RESERVED_EXPERIMENTS
_EDGE_SECONDS = 0.03
"""All at the usual cut-off; times its pace (`Bands.pace`) at others."""


@dataclass(frozen=True, slots=True)
class Piece:
    """One contiguous segment; arrays of shape (n,).

    Attributes:
        closed: whether `reference` was followed; else `torque` is the input.
        position, velocity, acceleration: filtered motion.
        measured: position as recorded.
        torque: demand [N m]; `feedforward` is the part that did not come from the controller.
        use: which decimated rows of the residual are compared, shape (m,).
        sticks: the axis hardly left where it stood, so that the start of its bristle is unknown.
        rate, last_reference, last_position: the controller's memory before the first row.
        lag, late: of the current loop that `torque` was put behind, and by which it was moved: none.
        pace: what lengths of time are multiplied by (`Bands.pace`).
    """

    experiment: str
    repeat: int
    start: int
    period: float
    closed: bool
    measured: Floats
    reference: Floats
    torque: Floats
    feedforward: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    use: Flags
    sticks: bool = False
    rate: float = 0.0
    last_reference: float = 0.0
    last_position: float = 0.0
    lag: float = 0.0
    late: int = 0
    pace: float = 1.0

    def __len__(self) -> int:
        return len(self.measured)


def cut(
    recording: Recording, bands: Bands, controller: PositionController, unfitted: tuple[str, ...] = UNFITTED
) -> list[Piece]:
    """All pieces of a recording that are long enough and not of the `unfitted` experiments.

    Raises:
        NotEnoughExcitation: none is left.
    """
    pieces = []
    least = round(LEAST_SECONDS * bands.pace / recording.period)
    rates = _rates(recording, controller)
    for segment in recording.segments():
        if segment.experiment in unfitted:
            continue
        for start, stop in _without_gaps(recording, segment.start, segment.stop):
            if stop - start >= least:
                pieces.append(_piece(recording, start, stop, bands, rates))
    if not pieces:
        raise NotEnoughExcitation(
            f"no stretch of the recording is longer than {least} rows without a gap and meant for fitting "
            f"({', '.join(unfitted)} are not); record longer"
        )
    return pieces


def with_motion(piece: Piece, measured: Floats, torque: Floats, bands: Bands) -> Piece:
    """The same piece with another motion, as a simulation gives it; what is compared stays the same."""
    position, velocity, acceleration = motion(measured, piece.period, bands.motion)
    return replace(
        piece,
        measured=measured,
        torque=torque,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
    )


def with_motions(piece: Piece, ran: Sequence[Simulated], bands: Bands) -> list[Piece]:
    """`with_motion` of several simulations."""
    moved = motion([one.position for one in ran], piece.period, bands.motion)
    return [
        replace(
            piece,
            measured=one.position,
            torque=one.torque,
            position=position,
            velocity=velocity,
            acceleration=acceleration,
        )
        for one, position, velocity, acceleration in zip(ran, *moved, strict=True)
    ]


def torque_error(piece: Piece, packed: Packed, bands: Bands) -> Floats:
    """L[u − required torque], decimated, shape (m,); all rows, also those not compared."""
    return _reduced(_error(piece, packed), piece, bands)


def torque_errors(pieces: Sequence[Piece], models: Sequence[Packed], bands: Bands) -> Floats:
    """`torque_error` of several models with the same effects, each along a motion of the same piece, shape (k, m)."""
    moved = {id(piece): _moved(piece) for piece in pieces}
    starts = [start_state(piece, packed) for piece, packed in zip(pieces, models, strict=True)]
    motions = [moved[id(piece)] for piece in pieces]
    errors = stretch_residuals(models, starts, motions, pieces[0].period)
    return np.stack([_reduced(error, pieces[0], bands) for error in errors])


def balanced(piece: Piece, packed: Packed, bands: Bands) -> Piece:
    """A piece in torque mode that sticks, with its torque freed of what the model has not at that place.

    Ripple and gravity differ from place to place. Bias makes a bristle creep, so it must be right here.
    """
    if not piece.sticks or piece.closed:
        return piece
    error = _error(piece, packed)
    return replace(piece, torque=piece.torque - float(np.mean(error[len(error) // 10 :])))


def required_error(pieces: list[Piece], packed: Packed, bands: Bands) -> Floats:
    """Residuals of all pieces, rows that are compared, one after another."""
    return np.concatenate([torque_error(piece, packed, bands)[piece.use] for piece in pieces])


def _error(piece: Piece, packed: Packed) -> Floats:
    return stretch_residual(packed, start_state(piece, packed), _moved(piece), piece.period)


def _moved(piece: Piece) -> Motion:
    return Motion(piece.torque, piece.position, piece.velocity, piece.acceleration)


def _reduced(error: Floats, piece: Piece, bands: Bands) -> Floats:
    reduced = low_pass(error, bands.error, piece.period)[:: bands.decimation]
    if piece.sticks:
        reduced = reduced - np.mean(reduced[piece.use]) if np.any(piece.use) else reduced
    return reduced


def _without_gaps(recording: Recording, start: int, stop: int) -> list[tuple[int, int]]:
    step = np.diff(recording["time"][start:stop])
    gaps = np.flatnonzero(np.abs(step - recording.period) > 0.5 * recording.period) + start + 1
    missed = np.flatnonzero(recording.missed[start:stop] > 0) + start
    edges = sorted({start, *gaps.tolist(), *missed.tolist(), stop})
    return list(itertools.pairwise(edges))


def _rates(recording: Recording, controller: PositionController) -> Floats:
    """The controller's filtered derivative at every row, as if it had run through."""
    if not controller.usable or "reference" not in recording:
        return np.zeros(len(recording))
    mixed = controller.reference_rate * recording["reference"] - recording["position"]
    change = np.diff(mixed, prepend=mixed[:1]) / recording.period
    a = controller.derivative_filter
    return np.asarray(scipy.signal.lfilter([a], [1.0, a - 1.0], change))


def _piece(recording: Recording, start: int, stop: int, bands: Bands, rates: Floats) -> Piece:
    part = recording.rows(slice(start, stop))
    measured, torque = part["position"], torque_of(part)
    smooth = motion(measured, part.period, bands.motion)
    reference = guide_of(part)
    before = start - 1 if start > 0 and _joined(recording, start) else start
    resolution = recording.metadata.position_resolution or 0.0
    return Piece(
        experiment=str(part.experiment[0]),
        repeat=int(part.repeat[0]),
        start=start,
        period=part.period,
        closed=is_closed(part),
        measured=measured,
        reference=reference,
        torque=torque,
        feedforward=part["torque_feedforward"] if "torque_feedforward" in part else np.zeros(len(part)),
        position=smooth[0],
        velocity=smooth[1],
        acceleration=smooth[2],
        use=_compared(measured, clipped(part).rows, resolution, part.period, bands),
        rate=float(rates[before]),
        last_reference=float(reference[0] if before == start else recording["reference"][before])
        if "reference" in recording
        else 0.0,
        last_position=float(recording["position"][before]),
        pace=bands.pace,
    )


def _joined(recording: Recording, start: int) -> bool:
    step = recording["time"][start] - recording["time"][start - 1]
    return bool(abs(step - recording.period) < 0.5 * recording.period)


def _compared(measured: Floats, at_limit: Flags, resolution: float, period: float, bands: Bands) -> Flags:
    """Decimated rows away from the edges and from clipping, where the axis moves by more than two counts."""
    n = len(measured)
    use = np.ones(n, dtype=np.bool_)
    edge = round(_EDGE_SECONDS * bands.pace / period)
    use[:edge] = use[max(n - edge, 0) :] = False
    reach = max(1, round(STANDSTILL_SECONDS * bands.pace / period))
    if np.any(at_limit):
        use &= np.convolve(at_limit, np.ones(2 * reach + 1), "same") < 0.5
    if resolution > 0.0:
        use &= travel_near(measured, reach) >= STANDSTILL_COUNTS * resolution
    return use[:: bands.decimation]


def marked_sticking(pieces: list[Piece], displacement: float) -> list[Piece]:
    """Pieces that never left x_s of where they started have a bristle of unknown start.

    There, small movements are all there is: none is taken for standstill.
    """
    marked = []
    for piece in pieces:
        sticks = bool(np.ptp(piece.position) < 2.0 * displacement)
        use = piece.use
        if sticks and np.ptp(piece.torque) > 0:
            use = np.ones_like(use)
            edge = math.ceil(len(use) * _EDGE_SECONDS * piece.pace / (piece.period * len(piece)))
            use[:edge] = use[len(use) - edge :] = False
        marked.append(replace(piece, sticks=sticks, use=use))
    return marked


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
        disturbance: what shakes the twin in place of both, where its colour is known.
    """

    controller: PositionController
    resolution: float = 0.0
    limit: float = np.inf
    process_noise: float = 0.0
    position_noise: float = 0.0
    disturbance: Disturbance = STILL

    def shaken(self, noise: np.random.Generator, size: int, period: float) -> tuple[Floats, Floats]:
        """Torque [N m] and position noise of a twin, shape (size,)."""
        known = self.disturbance
        if known.process > 0.0:
            return known.drawn(noise, size, period), noise.normal(0.0, 1.0, size) * known.position
        torque = noise.normal(0.0, 1.0, size) * self.process_noise
        return torque, noise.normal(0.0, 1.0, size) * self.position_noise


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

    A piece in closed loop without a usable controller does not follow. One that slides in torque mode, where every
    error would add up, is led along the measured motion (`led`), without noise; what leads it sees no counts.
    """
    controller = around.controller
    if piece.closed and not controller.usable:
        return Simulated(piece.measured, piece.torque, False)
    free = slides_freely(piece)
    if free:
        piece, controller, noise = led(piece), leading(packed, piece.pace), None
    n = len(piece)
    still = np.zeros(n), np.zeros(n)
    disturbed, position_noise = still if noise is None else around.shaken(noise, n, piece.period)
    resolution = around.resolution if quantised else 0.0
    seen = 0.0 if free else resolution
    position, torque, inside = simulate_stretch(
        piece, packed, controller, around.limit, seen, disturbed, position_noise
    )
    if not inside:
        return Simulated(piece.measured, piece.torque, False)
    if free and resolution > 0.0:
        position = resolution * np.round(position / resolution)
    return Simulated(position, torque, _follows(piece, position, around.resolution))


def run_twins(
    piece: Piece, packed: Packed, around: Surroundings, noises: Sequence[np.random.Generator]
) -> list[Simulated]:
    """`run_twin` once with each noise, at most eight of them, side by side: of a piece that does not slide freely.

    Where one leaves all bounds none follows.
    """
    controller, count = around.controller, len(noises)
    if count == 1 or (piece.closed and not controller.usable):
        return [run_twin(piece, packed, around, noise) for noise in noises]
    shaken = [around.shaken(noise, len(piece), piece.period) for noise in noises]
    disturbed, position_noise = (beside_or_one([one[part] for one in shaken]) for part in (0, 1))
    position, torque, inside = simulate_stretches(
        piece,
        [packed] * count,
        controller,
        (around.limit, around.resolution),
        disturbed,
        position_noise,
        loop_along(piece, controller),
    )
    if not inside[:count].all():
        return [Simulated(piece.measured, piece.torque, False)] * count
    return [
        Simulated(position[i], torque[i], _follows(piece, position[i], around.resolution))
        for i in range(count)
    ]


def slides_freely(piece: Piece) -> bool:
    """Whether a piece slides without a controller that is known to have led it: in torque mode."""
    return not (piece.closed or piece.sticks)


def led(piece: Piece) -> Piece:
    """A piece in torque mode as if a controller had added to its torque what keeps it on its way."""
    return replace(
        piece,
        closed=True,
        reference=piece.measured,
        feedforward=piece.torque,
        rate=0.0,
        last_reference=float(piece.measured[0]),
        last_position=float(piece.measured[0]),
    )


def _follows(piece: Piece, position: Floats, resolution: float) -> bool:
    away = float(np.sqrt(np.mean((position - piece.measured) ** 2)))
    return away < max(ASTRAY * float(np.std(piece.measured)), 20.0 * resolution)
