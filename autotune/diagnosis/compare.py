"""Measured against model: how large the error is, how much of it is noise, and where it sits.

The model is taken as it is, nothing is fitted. The torque residual is corrected by a twin where a
controller is known, so that the measurement chain is not blamed on the model.

The error on data that the model's fit never saw is that on a veto or a test trajectory where there is one. Else each
experiment is held out in turn: a refit of all the others, linearised round the model, predicts it.

Row by row, for pictures and for a fit's summary: the torque residual, and the model's motion in the closed loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Flags, Floats
from autotune.core.errors import ConfigurationError
from autotune.core.remembered import Remembered, digest_of
from autotune.core.units import torque_symbol
from autotune.diagnosis.candidates import free_of_model
from autotune.diagnosis.evidence.torque_path import (
    LATE_RECORD,
    SETTLED,
    is_recorded_late,
    recorded_late,
    without_chain,
)
from autotune.estimation.bandwidth import Bands, prepared_for
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.contact_start import usually_damped
from autotune.estimation.controller import controller_of, find_controller
from autotune.estimation.controller_law import PositionController
from autotune.estimation.coordinates import bins, coordinates, since_reversal, variance_shares
from autotune.estimation.cross_validation import held_out
from autotune.estimation.data import TEST, TRAINING, VETO, Prepared
from autotune.estimation.disturbance import STILL
from autotune.estimation.least_squares import Fitted, Free, done_alone, fitting
from autotune.estimation.model_error import (
    SIMULATIONS,
    ModelError,
    NoiseFloor,
    error_inside,
    model_error,
    noise_floor,
)
from autotune.estimation.pieces import Piece, cut, torque_error
from autotune.estimation.pieces import run_twin as run_piece
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import Problem, base_free, new_problem, refit
from autotune.estimation.residual import residual
from autotune.estimation.twin_runs import run_twin
from autotune.identify.refinement import surroundings
from autotune.models import layout
from autotune.models.drive_model import DriveModel, Packed
from autotune.recordings.checks import torque_of
from autotune.recordings.recording import Recording, refuse_twice
from autotune.signals.filters import low_pass

EACH_IN_TURN = "each experiment held out in turn"
WORST = 6
BINS = 12
REGIMES = ("presliding", "reversal", "low_speed", "high_speed", "acceleration")
AT_SPEED = ("low_speed", "high_speed")
"""Of them: what a curve of friction over speed has."""
STATED: Remembered[tuple[float, float]] = Remembered()
"""Rms of the error and its share of the torque's, by all that tells it: a fit has stated that of the model that a
diagnosis begins with."""
_LOGARITHMIC = ("travel_since_reversal", "time_since_reversal")


@dataclass(frozen=True, slots=True)
class Worst:
    """A stretch of a coordinate with more than its part of the error: `share` of all squared error."""

    coordinate: str
    low: float
    high: float
    share: float


@dataclass(frozen=True, slots=True)
class Compared:
    """Model against measurement. Torques in N m or N, motor side.

    Attributes:
        error_rms: of the residual; `relative_error`: over the rms of the torque.
        noise_floor_rms: estimate of what differs from repeat to repeat, with its interval of 95 %; nan and
            None without repeats.
        explained: share of the torque's explainable variance that the model explains, 0…1; without repeats
            of all its variance, the least that it can be.
        regimes: rms by kind of motion; nan where there is none.
        where: share of the residual's variance that each coordinate explains.
        position_rms: of the simulated against the measured position; nan without twin.
        error, torque: on the grid, shape (m,); `time` likewise.
        late_record: as of `ModelError`.
    """

    error_rms: float
    relative_error: float
    noise_floor_rms: float
    noise_floor_interval: tuple[float, float] | None
    explained: float
    worst: tuple[Worst, ...]
    regimes: Mapping[str, float]
    where: Mapping[str, float]
    twin: bool
    position_rms: float
    problem: Problem
    error: Floats
    rows: Flags
    notes: tuple[str, ...] = ()
    late_record: bool = False


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


@dataclass(frozen=True, slots=True)
class UnseenError:
    """Rms of the torque error [N m or N], the floor under it (None where unknown), and on which data."""

    rms: float
    floor: NoiseFloor | None
    data: str


def check_same_axis(model: DriveModel, recordings: Sequence[Recording]) -> None:
    """Raises ConfigurationError where model and recordings cannot be of the same axis; none may be given twice."""
    refuse_twice(recordings)
    for recording in recordings:
        other = recording.metadata
        if model.motion_unit != other.motion_unit:
            raise ConfigurationError(
                f"the model is for motion in {model.motion_unit}, the recording is in {other.motion_unit}; "
                "use the model of this axis, or fit one: autotune model fit"
            )
        if model.torque_unit != other.torque_unit:
            raise ConfigurationError(
                f"the model is for torque in {model.torque_symbol}, the recording is in "
                f"{torque_symbol(other.motion_unit, other.torque_unit)}; import the file with the unit of the model, "
                "or fit one to it: autotune model fit"
            )
        if model.fingerprint and other.fingerprint and model.fingerprint != other.fingerprint:
            raise ConfigurationError(
                f"the model is of axis {model.axis or model.fingerprint}, the recording of "
                f"{other.axis or other.fingerprint}; use the model of this axis, or fit one: autotune model fit"
            )


def compare(recordings: Sequence[Recording], model: DriveModel) -> Compared:
    """Compares a model with recordings.

    Raises:
        RecordingError, ConfigurationError, NotEnoughExcitation: recordings that cannot be used.
    """
    check_same_axis(model, recordings)
    left = stated_error(prepared_for(recordings), model)
    return _measures(left, model, _position_error(left.problem, model))


def stated(data: Prepared, model: DriveModel, policy: Policy = POLICY) -> tuple[float, float]:
    """Rms of what a model leaves of the torque [N m or N] (`stated_error`), and its share of the torque's rms.

    What has been stated of the same data and model is known.
    """

    def found() -> tuple[float, float]:
        left = _stated_error(data, model, policy)
        return left.error_rms, left.relative_error

    return STATED.answer(_question(data, model, policy), found)


def _question(data: Prepared, model: DriveModel, policy: Policy) -> tuple[object, ...]:
    """What an error is stated of, told apart by content."""
    known = {one.name: getattr(data, one.name) for one in fields(data)}
    columns = {name: value for name, value in known.items() if isinstance(value, np.ndarray)}
    rest = {name: value for name, value in known.items() if name not in columns}
    packed, effects = model.pack(), [(one.name, tuple(one.values)) for one in model.effects]
    content = digest_of(*columns.values(), packed.p, packed.on)
    return repr((tuple(columns), rest, effects, model.motion_unit, policy)), content


def stated_error(data: Prepared, model: DriveModel, policy: Policy = POLICY) -> ModelError:
    """What a model leaves of the torque, less what the measurement chain adds, as `fit` and `diagnose` state it.

    When the torque was recorded and how late an ordinary current loop makes it act is a nuisance of every fit. Here the
    model stays as it is: a refit beside it tells that delay, no parameter takes over anything.
    """
    left = _stated_error(data, model, policy)
    STATED.answer(_question(data, model, policy), lambda: (left.error_rms, left.relative_error))
    return left


def _stated_error(data: Prepared, model: DriveModel, policy: Policy) -> ModelError:
    left = model_error(data, model, policy)
    problem = left.problem
    if not data.repeated:
        return left
    if not problem.twin:
        return _running_late(left, data, model, policy)
    prompt = _behind_chain(problem, model, model.pack())
    if prompt is None:
        return left
    best = left if prompt[0] is problem else _less_left(left, prompt[0], model)
    late = _read_late(prompt, problem, model)
    if late is None:
        return best
    told = replace(best, late_record=True)
    found = _less_left(told, late, model)
    return found if found is told else replace(found, notes=(*left.notes, LATE_RECORD))


def _running_late(left: ModelError, data: Prepared, model: DriveModel, policy: Policy) -> ModelError:
    """The error in the loop of a torque that was recorded a sample late, where only that runs; else as it was.

    A model that was fitted in the slower loop may have a contact with which that one does not run.
    """
    law = find_controller(data, policy)
    sooner = recorded_late(new_problem(data, law, policy)) if law.usable and law.exact else None
    if sooner is None or sooner.controller is None:
        return left
    found = error_inside(sooner.data, sooner.controller, model, policy)
    if not found.problem.twin:
        return left
    late = replace(found, notes=(*found.notes, LATE_RECORD))
    return replace(late if late.error_rms < left.error_rms else left, late_record=True)


def _behind_chain(problem: Problem, model: DriveModel, packed: Packed) -> tuple[Problem, ModelFit] | None:
    """The problem with what the measurement chain adds taken out, told by a refit, and that; None where none fits.

    `packed`: what the refit begins with, under its bias.
    """
    free = _free(problem, model, packed)
    correction = problem.correction(packed, SIMULATIONS)
    fitted = refit(problem, packed, free, correction, 4)
    if not (correction.stable and np.isfinite(fitted.cost)):
        return None
    beside = ModelFit(fitted, correction, held_out(problem, fitted.error, fitted.jacobian))
    return without_chain(problem, beside), beside


def _read_late(prompt: tuple[Problem, ModelFit], problem: Problem, model: DriveModel) -> Problem | None:
    """The problem with its torque recorded a sample late, and the chain taken out then; None where it was not.

    A law of the samples that sees all a sample late explains its demand as well where the torque is read when the next
    one is due: when the torque acts tells the two apart, or what the model leaves, each refitted behind its own chain.
    Of laws between the samples a twin told that. A contact that was fitted in the slower loop may be undamped, and a
    fit under its bias ends there.
    """
    law = problem.controller
    sooner = recorded_late(problem) if law is not None and law.ticks == 1 else None
    if sooner is None:
        return None
    packed = model.pack()
    here, damped = _refitted(*prompt, packed), usually_damped(packed)
    late = _behind_chain(sooner, model, damped)
    told = late is not None and is_recorded_late(prompt[0], here, late[0], _refitted(*late, damped))
    return late[0] if late is not None and told else None


def _refitted(problem: Problem, beside: ModelFit, packed: Packed) -> Fitted:
    """A model once more, fitted from where it was elsewhere, under the bias of a model."""
    correction = problem.correction(packed, SIMULATIONS)
    return refit(problem, beside.fitted.packed, list(beside.free), correction, SETTLED)


def _less_left(left: ModelError, problem: Problem, model: DriveModel) -> ModelError:
    """The model's error in another problem where that is less; else as it was."""
    packed = model.pack()
    correction = problem.correction(packed, SIMULATIONS)
    error = residual(problem.data, packed, problem.moved) - correction.bias
    found = replace(left, problem=problem, error=error)
    return found if correction.stable and found.error_rms < left.error_rms else left


def _measures(left: ModelError, model: DriveModel, position: float) -> Compared:
    problem, error, rows = left.problem, left.error, left.rows
    data = problem.data
    square = left.error_rms**2
    noise = noise_floor(problem, error, rows)
    floor = noise.rms**2 if noise is not None else 0.0
    explainable = max(float(np.var(left.torque)) - floor, 1e-300)
    return Compared(
        left.error_rms,
        left.relative_error,
        noise.rms if noise is not None else math.nan,
        noise.interval if noise is not None else None,
        float(np.clip(1.0 - max(square - floor, 0.0) / explainable, 0.0, 1.0)),
        worst_places(data, error, rows),
        regimes(data, model, error, rows),
        variance_shares(data, error, rows),
        problem.twin,
        position,
        problem,
        error,
        rows,
        left.notes,
        left.late_record,
    )


def _position_error(problem: Problem, model: DriveModel) -> float:
    if problem.controller is None:
        return math.nan
    run = run_twin(problem.data, model.pack(), problem.controller, STILL, np.random.default_rng(0))
    return float(np.sqrt(np.mean((run.position - problem.data.measured) ** 2))) if run.stable else math.nan


def worst_places(data: Prepared, error: Floats, rows: Flags) -> tuple[Worst, ...]:
    """Where the squared error is most above its even share."""
    table = coordinates(data)
    total = max(float(np.sum(error[rows] ** 2)), 1e-300)
    found: list[tuple[float, Worst]] = []
    for name, values in table.items():
        if name == "direction":  # velocity says it
            continue
        member = bins(values, BINS, rows)
        for column in member.T:
            inside = rows & (column > 0)
            if inside.sum() < 20:
                continue
            share = float(np.sum(error[inside] ** 2)) / total
            low, high = float(values[inside].min()), float(values[inside].max())
            if name in _LOGARITHMIC:
                low, high = 10.0**low, 10.0**high
            found.append((share * rows.sum() / inside.sum(), Worst(name, low, high, share)))
    found.sort(key=lambda item: -item[0])
    return tuple(worst for _, worst in found[:WORST])


def regimes(data: Prepared, model: DriveModel, error: Floats, rows: Flags) -> dict[str, float]:
    """Rms of the error by kind of motion; nan where the recordings have none."""
    return {name: _rms(error[of]) for name, of in regime_rows(data, model, rows).items()}


def regime_rows(data: Prepared, model: DriveModel, rows: Flags) -> dict[str, Flags]:
    """Which of `rows` belong to each kind of motion, shape (m,) each; a row may belong to several."""
    p = model.pack().p
    reach = p[layout.COULOMB] / p[layout.STIFFNESS]
    travel, _ = since_reversal(data)
    speed, change = np.abs(data.velocity[data.grid]), np.abs(data.acceleration[data.grid])
    fast, hard = np.percentile(speed[rows], 99.5), np.percentile(change[rows], 99.5)
    kinds = {
        "presliding": travel < 3.0 * reach,
        "reversal": (travel >= 3.0 * reach) & (travel < 30.0 * reach),
        "low_speed": (travel >= 3.0 * reach) & (speed < 0.1 * fast),
        "high_speed": speed > 0.5 * fast,
        "acceleration": change > 0.4 * hard,
    }
    return {name: rows & kinds[name] & (not data.steady or name in AT_SPEED) for name in REGIMES}


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def roles_unseen(problem: Problem) -> list[str]:
    """Which of the roles that are never fitted the recordings have."""
    return [role for role in (VETO, TEST) if problem.has(role)]


def floor_of_unseen(problem: Problem, error: Floats) -> NoiseFloor | None:
    """The floor on the repeated rows that were not fitted, else on those that were."""
    counted = problem.weight > 0
    unseen = noise_floor(problem, error, counted & problem.data.role(VETO, TEST))
    return unseen or noise_floor(problem, error, counted & problem.data.role(TRAINING))


def unseen_error(result: Compared, model: DriveModel) -> UnseenError:
    """What `compare` found, on the data that the model's fit has not seen."""
    problem, error = result.problem, result.error
    floor = floor_of_unseen(problem, error)
    if roles := roles_unseen(problem):
        rows = result.rows & problem.data.role(*roles)
        return UnseenError(math.sqrt(float(np.mean(error[rows] ** 2))), floor, " and ".join(roles))
    total = held_out(problem, error, _sensitivities(problem, model, error)).total
    return UnseenError(math.sqrt(total / max(float(problem.training.sum()), 1.0)), floor, EACH_IN_TURN)


def _sensitivities(problem: Problem, model: DriveModel, error: Floats) -> Floats:
    """Columns of the residual's change with the model's parameters, shape (m, parameters)."""
    packed = model.pack()
    free = _free(problem, model, packed)
    bias = residual(problem.data, packed, problem.moved) - error
    steps = fitting(problem.data, packed, free, bias, problem.training, iterations=0)
    return done_alone(steps, problem.moved).jacobian


def _free(problem: Problem, model: DriveModel, packed: Packed) -> list[Free]:
    """All parameters of the model, within bounds that hold what it has."""
    inside = Packed(packed.p.copy(), packed.on)
    free = [*base_free(inside, problem.scales, model.motion_unit), *free_of_model(model, problem.scales)]
    return [replace(one, lower=min(one.lower, packed.p[one.slot])) for one in free]


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
        result = run_piece(piece, packed, around, noise, quantised=seed is not None)
        if result.follows:
            position[piece.start : piece.start + len(piece)] = result.position
            torque[piece.start : piece.start + len(piece)] = result.torque
    return ClosedLoop(
        position,
        torque,
        _relative(position, recording["position"]),
        _relative(torque, torque_of(recording)),
        controller,
    )


def _relative(simulated: Floats, measured: Floats) -> float:
    there = np.isfinite(simulated)
    if not np.any(there):
        return math.nan
    return float(np.linalg.norm((simulated - measured)[there]) / np.linalg.norm(measured[there]))


def _filtered(values: Floats, piece: Piece, bands: Bands) -> Floats:
    return low_pass(values, bands.error, piece.period)
