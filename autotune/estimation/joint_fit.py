"""Joint refinement of all parameters on all experiments together (Gauss–Newton in the twin).

The residual is twin-corrected: measurement and closed loop simulation go through the same inverse
pipeline R and are subtracted, e(p) = R(measured; p) − mean R(simulated(p); p), so that what filters,
differences and the quantiser do to both cancels. Sensitivities are finite differences of R on the
measured motion, instruments the same on a simulated one. Pieces are weighted by their own scatter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.estimation.bandwidth import Bands
from autotune.estimation.disturbance_estimate import estimate_disturbance
from autotune.estimation.least_squares import Free, with_values
from autotune.estimation.pieces import (
    Piece,
    Surroundings,
    balanced,
    run_twin,
    run_twins,
    slides_freely,
    torque_error,
    torque_errors,
    with_motion,
    with_motions,
)
from autotune.estimation.problem import Problem
from autotune.estimation.small_motion import small_motion, suits
from autotune.models.drive_model import DriveModel, Packed, surface_parameter
from autotune.signals.normal_equations import BLOCK_SECONDS, Normal, Part, assemble, whitener

ITERATIONS = 25
LEAST_FINE, MOST_FINE = 2, 4
CONVERGED, STILL = 1.0, 0.01
"""Of a step: root of what it gains in information per parameter, and its largest part of a scale."""
KNOWN = 0.5
"""Standard error in scales below which a parameter is known."""
LARGEST_STEP = 0.3
ROUNDING = 1e-9
"""Of a scale: so far beyond a bound is on it."""
_DIFFERENCE = 1e-3
_COARSE, _FINE = 2, 6


@dataclass(frozen=True, slots=True)
class Refined:
    """Result of the refinement.

    Attributes:
        model: with values and standard errors.
        free: the parameters fitted; `covariance` is in their order, unscaled, shape (k, k).
        normal: of the last iteration, in parameters over their scales.
        errors: residual of each piece after the fit, rows compared only [N m].
        torque_rms: of the torque in the same bands, for relative errors.
        converged: whether the last step was small against the standard errors.
        bounded: names that ended at a bound.
        twin: share of the pieces that had a twin that followed.
    """

    model: DriveModel
    free: tuple[Free, ...]
    covariance: Floats
    normal: Normal
    errors: tuple[Floats, ...]
    torque_rms: float
    converged: bool
    bounded: tuple[str, ...]
    twin: float
    around: Surroundings

    @property
    def names(self) -> tuple[str, ...]:
        """Of the free parameters."""
        return tuple(parameter.name for parameter in self.free)

    @property
    def relative_error(self) -> float:
        error = np.concatenate(self.errors)
        return float(np.sqrt(np.mean(error**2))) / self.torque_rms if self.torque_rms else np.nan

    @property
    def standard_errors(self) -> dict[str, float]:
        spread = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return dict(zip(self.names, spread.tolist(), strict=True))


def refine(
    model: DriveModel,
    pieces: Sequence[Piece],
    around: Surroundings,
    bands: Bands,
    names: Sequence[str],
    seed: int = 0,
    iterations: int = ITERATIONS,
    repeats: Problem | None = None,
) -> Refined:
    """Refines the parameters of `model` that are named, as on every surface, on all pieces.

    `repeats`: the same recording where it has any; they tell the colour of the disturbance (`surrounded`).

    First with few runs of the twin until steps are small against the standard errors; then the noise is
    calibrated anew, as a bad start looks like noise, and with more runs a few steps follow. Steps stay at
    a few tenths of a standard error for ever, as the twin's noise differs from the axis's.
    """
    free, pieces, packed = free_by_name(model, names), list(pieces), model.pack()
    sweep = _Sweep(pieces, surrounded(packed, pieces, around, bands, seed, repeats), bands, free, seed)
    slots = [parameter.slot for parameter in free]
    packed = with_values(packed, free, packed.p[slots])
    runs, passes = _COARSE, 0
    linear = sweep.linearise(packed, runs)
    step = _step(linear.normal, packed, free)
    converged, still = _judged(linear.normal, step)
    for iteration in range(iterations):
        if passes >= MOST_FINE or (still and passes >= LEAST_FINE):
            break
        packed = with_values(packed, free, _moved(packed.p[slots], step, free))
        if runs == _COARSE and (converged or iteration >= iterations - MOST_FINE):
            runs = _FINE
            sweep = replace(sweep, around=surrounded(packed, pieces, around, bands, seed, repeats))
        passes += runs == _FINE
        linear = sweep.linearise(packed, runs)
        step = _step(linear.normal, packed, free)
        converged, still = _judged(linear.normal, step)
    return _result(model, packed.p[slots], linear, converged, sweep)


def _judged(normal: Normal, step: Floats) -> tuple[bool, bool]:
    """Whether the next `step` is within what the twin's noise makes of it, and whether it is small.

    A step is measured by the information of the data: directions that they do not tell cannot keep it
    from converging, nor can their large errors hide that it has not.
    """
    worth = float(np.sqrt(abs(step @ normal.matrix @ step) / len(step)))
    small = np.abs(step[_spread(normal) < KNOWN]) < STILL
    return worth < CONVERGED, worth < CONVERGED and bool(np.all(small))


def _spread(normal: Normal) -> Floats:
    return np.asarray(np.sqrt(np.maximum(np.diag(normal.covariance), 1e-300)))


def _result(model: DriveModel, values: Floats, linear: _Linear, converged: bool, sweep: _Sweep) -> Refined:
    covariance = linear.normal.covariance * np.outer(sweep.scale, sweep.scale)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    names = [parameter.name for parameter in sweep.free]
    fitted = dict(zip(names, values.tolist(), strict=True))
    packed = with_values(model.pack(), sweep.free, values)
    at_bound = tuple(
        f.name
        for f, value in zip(sweep.free, values, strict=True)
        if value <= f.least(packed.p) or value == f.upper
    )
    return Refined(
        model.with_values(fitted, dict(zip(names, spread.tolist(), strict=True))),
        sweep.free,
        covariance,
        linear.normal,
        tuple(linear.errors),
        _torque_rms(sweep.pieces, sweep.bands),
        converged,
        at_bound,
        linear.twin,
        sweep.around,
    )


@dataclass(frozen=True, slots=True)
class _Linear:
    normal: Normal
    errors: list[Floats]
    twin: float


@dataclass(frozen=True, slots=True)
class _Sweep:
    """Residuals and sensitivities over all pieces; the noise is the same in every iteration."""

    pieces: list[Piece]
    around: Surroundings
    bands: Bands
    free: tuple[Free, ...]
    seed: int

    @property
    def scale(self) -> Floats:
        return np.array([parameter.scale for parameter in self.free])

    def linearise(self, packed: Packed, runs: int) -> _Linear:
        parts: list[Part] = []
        errors: list[Floats] = []
        followed = 0
        for number, recorded in enumerate(self.pieces):
            piece = balanced(recorded, packed, self.bands)
            twins = self._twins(number, piece, packed, runs)
            followed += bool(twins)
            if twins and suits(piece, self.around):
                here, *rest = torque_errors([piece, *twins[1:]], [packed] * len(twins), self.bands)
                errors.append((here - np.mean(rest, axis=0))[piece.use])
                parts += small_motion(piece, twins[1:], packed, self.around, self.free)
            else:
                part, error = self._torque_part(piece, packed, twins)
                errors.append(error)
                parts.append(part)
        return _Linear(assemble(parts), errors, followed / len(self.pieces))

    def _torque_part(self, piece: Piece, packed: Packed, twins: list[Piece]) -> tuple[Part, Floats]:
        """The torque residual of a piece less the bias of its twins; the first twin gives the instruments.

        It is whitened by the colour that noise has in the twin, not by its own: what the model lacks is
        no noise, and must keep its weight. The second is the residual, rows that are compared.
        """
        changed, count = self._changed(packed), len(self.free)
        moved = [piece, *twins, *[piece] * count, *twins[:1] * count]
        models = [*[packed] * (1 + len(twins)), *changed, *changed[: count * len(twins[:1])]]
        found = torque_errors(moved, models, self.bands)
        here, own = found[0], found[1 : 1 + len(twins)]
        bias = np.mean(own[1:], axis=0) if twins else np.zeros(len(here))
        columns = (found[1 + len(twins) : 1 + len(twins) + count] - here).T / _DIFFERENCE
        other, white = columns, np.ones(1)
        if twins:
            other = (found[-count:] - own[0]).T / _DIFFERENCE
            white = whitener((own[0] - bias)[piece.use])
        rows = max(8, round(BLOCK_SECONDS * min(1.0, piece.pace) / (piece.period * self.bands.decimation)))
        all_three = np.column_stack([here - bias, columns, other])
        all_three = np.asarray(scipy.signal.lfilter(white, [1.0], all_three, axis=0))[piece.use]
        part = Part(all_three[:, 0], all_three[:, 1 : 1 + count], all_three[:, 1 + count :], rows)
        return part, (here - bias)[piece.use]

    def _twins(self, number: int, piece: Piece, packed: Packed, runs: int) -> list[Piece]:
        """Simulated pieces; the first is for instruments only. Empty where the twin does not follow."""
        noises = [np.random.default_rng([self.seed, number, run]) for run in range(runs + 1)]
        if slides_freely(piece):
            ran = [run_twin(piece, packed, self.around, noises[0])]
        else:
            ran = run_twins(piece, packed, self.around, noises)
        if not all(one.follows for one in ran):
            return []
        twins = with_motions(piece, ran, self.bands)
        return twins * 2 if slides_freely(piece) else twins

    def _changed(self, packed: Packed) -> list[Packed]:
        """The model with each free parameter moved by a little: forward differences give ∂R/∂(p/scale)."""
        moved = []
        for parameter in self.free:
            changed = packed.p.copy()
            changed[parameter.slot] += _DIFFERENCE * parameter.scale
            moved.append(Packed(changed, packed.on))
        return moved


def free_by_name(model: DriveModel, names: Sequence[str]) -> tuple[Free, ...]:
    """Parameters of a model that are named, each by what counts as a large change of it, within physical bounds.

    What must be positive stays within a hundredfold of its value.
    """
    free = []
    for name in names:
        parameter, value = surface_parameter(name), model[name]
        lower, upper = parameter.lower, parameter.upper
        if lower > 0 or name in ("stribeck_velocity", "stiffness", "inertia"):
            lower, upper = max(lower, 0.01 * value), min(upper, 100.0 * value)
        large = _large_change(model, name, parameter.unit)
        free.append(Free(name, parameter.slot, lower, upper, large, above=parameter.above))
    return tuple(free)


def _large_change(model: DriveModel, name: str, unit: str) -> float:
    """The parameter's value; for what may be zero, a part of friction or of another damping."""
    least = 0.0
    if unit == "N m":
        least = 0.05 * max(model["coulomb"], abs(model["offset"]), 1e-9)
    elif name == "viscous":
        least = 0.01 * model["micro_damping"]
    elif name == "micro_damping":
        least = 0.5 * math.sqrt(model["stiffness"] * model["inertia"])
    elif unit == "N m s/rad":
        least = 0.1 * model["viscous"]
    return max(abs(model[name]), least) or 1.0


def surrounded(
    packed: Packed,
    pieces: list[Piece],
    around: Surroundings,
    bands: Bands,
    seed: int,
    repeats: Problem | None,
) -> Surroundings:
    """Surroundings with the noise that shakes the axis: by what repeats do not share, where that has a memory.

    Friction averages what shakes the velocity, and how much that is depends on the colour: white noise that is as rough
    in what is compared takes out too much or too little. Without repeats the model's error would look like a memory.
    """
    around = calibrated(packed, pieces, around, bands, seed)
    if repeats is None:
        return around
    found = estimate_disturbance(repeats, packed)
    return replace(around, disturbance=found) if found.coloured > 0.0 else around


def calibrated(
    packed: Packed, pieces: list[Piece], around: Surroundings, bands: Bands, seed: int
) -> Surroundings:
    """Surroundings with the process noise at which the twin's residual is as rough as the measured one.

    Roughness is the mean square difference of neighbouring rows, which slow model errors hardly touch.
    """
    chosen = [piece for piece in pieces if np.count_nonzero(piece.use) > 50]
    measured = np.array([_roughness(piece, packed, bands) for piece in chosen])
    level = 3.0 * float(np.sqrt(np.median(measured))) if len(measured) else 0.0
    if level == 0.0:
        return around
    without_noise = np.array(
        [_twin_roughness(i, p, packed, around, bands, seed) for i, p in enumerate(chosen)]
    )
    for _ in range(2):
        trial = replace(around, process_noise=level)
        with_noise = np.array(
            [_twin_roughness(i, p, packed, trial, bands, seed) for i, p in enumerate(chosen)]
        )
        usable = np.isfinite(with_noise) & np.isfinite(without_noise) & (with_noise > 1.05 * without_noise)
        if not np.any(usable):
            return around
        ratio = np.median(
            np.maximum(measured - without_noise, 0.0)[usable] / (with_noise - without_noise)[usable]
        )
        level *= float(np.sqrt(ratio))
    return replace(around, process_noise=level)


def _roughness(piece: Piece, packed: Packed, bands: Bands) -> float:
    return float(np.mean(np.diff(torque_error(piece, packed, bands))[piece.use[1:]] ** 2))


def _twin_roughness(
    number: int, piece: Piece, packed: Packed, around: Surroundings, bands: Bands, seed: int
) -> float:
    result = run_twin(piece, packed, around, np.random.default_rng([seed, number, 99]))
    if not result.follows:
        return np.nan
    return _roughness(with_motion(piece, result.position, result.torque, bands), packed, bands)


def _step(normal: Normal, packed: Packed, free: Sequence[Free]) -> Floats:
    """The step over the scales that ends inside the bounds, with the others solved for beside what is held there."""
    rows, room = _room(packed, free)
    held, step = np.zeros(len(rows), dtype=np.bool_), normal.step
    for _ in range(len(free)):
        outside = ~held & (rows @ _limited(step) < room - ROUNDING)
        if not outside.any():
            break
        held |= outside
        step = normal.step_on(rows[held], room[held])
    return step


def _room(packed: Packed, free: Sequence[Free]) -> tuple[Floats, Floats]:
    """Bounds of a step over the scales: rows·step ≥ room, shapes (b, k) and (b,)."""
    places = {parameter.slot: i for i, parameter in enumerate(free)}
    unit = np.eye(len(free))
    rows: list[Floats] = []
    room: list[float] = []
    for i, one in enumerate(free):
        value = float(packed.p[one.slot])
        rows += [unit[i], -unit[i]]
        room += [(one.lower - value) / one.scale, (value - one.upper) / one.scale]
        if one.above >= 0:
            other = places.get(one.above)
            along = one.times * free[other].scale / one.scale * unit[other] if other is not None else 0.0
            rows.append(unit[i] - along)
            room.append((one.times * float(packed.p[one.above]) - value) / one.scale)
    return np.array(rows).reshape(-1, len(free)), np.array(room)


def _limited(step: Floats) -> Floats:
    """A step by which none moves by more than 30 % of its scale at once; the direction is kept."""
    largest = float(np.max(np.abs(step))) if len(step) else 0.0
    return step * min(1.0, LARGEST_STEP / largest) if largest > 0 else step


def _moved(values: Floats, step: Floats, free: Sequence[Free]) -> Floats:
    """Values after a step, limited."""
    change = _limited(step) * np.array([parameter.scale for parameter in free])
    return np.asarray(np.clip(values + change, [f.lower for f in free], [f.upper for f in free]))


def _torque_rms(pieces: list[Piece], bands: Bands) -> float:
    rows = [piece.torque[:: bands.decimation][: len(piece.use)][piece.use] for piece in pieces]
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))
