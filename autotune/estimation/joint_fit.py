"""Joint refinement of all parameters on all experiments together (Gauss–Newton in the twin).

The residual is twin-corrected: measurement and closed loop simulation go through the same inverse
pipeline R and are subtracted, e(p) = R(measured; p) − mean R(simulated(p); p), so that what filters,
differences and the quantiser do to both cancels. Sensitivities are finite differences of R on the
measured motion, instruments the same on a simulated one. Pieces are weighted by their own scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.estimation.bandwidth import Bands
from autotune.estimation.normal_equations import BLOCK_SECONDS, Normal, Part, assemble, whitener
from autotune.estimation.pieces import (
    Piece,
    Surroundings,
    balanced,
    run_twin,
    slides_freely,
    torque_error,
    with_motion,
)
from autotune.estimation.small_motion import small_motion, suits
from autotune.models.drive_model import DriveModel, Packed, surface_parameter

ITERATIONS = 25
LEAST_FINE, MOST_FINE = 2, 4
CONVERGED, STILL = 1.0, 0.01
"""Of a step: root of what it gains in information per parameter, and its largest part of a scale."""
KNOWN = 0.5
"""Standard error in scales below which a parameter is known."""
LARGEST_STEP = 0.3
_DIFFERENCE = 1e-3
_COARSE, _FINE = 2, 6


@dataclass(frozen=True, slots=True)
class Refined:
    """Result of the refinement.

    Attributes:
        model: with values and standard errors.
        names: the free parameters; `covariance` is in their order, unscaled, shape (k, k).
        normal: of the last iteration, in parameters scaled by `scale`.
        errors: residual of each piece after the fit, rows compared only [N m].
        torque_rms: of the torque in the same bands, for relative errors.
        converged: whether the last step was small against the standard errors.
        bounded: names that ended at a bound.
        twin: share of the pieces that had a twin that followed.
    """

    model: DriveModel
    names: tuple[str, ...]
    covariance: Floats
    normal: Normal
    scale: Floats
    errors: tuple[Floats, ...]
    torque_rms: float
    converged: bool
    bounded: tuple[str, ...]
    twin: float
    around: Surroundings

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
    free: Sequence[str],
    seed: int = 0,
) -> Refined:
    """Refines the `free` parameters (surface names) of `model` on all pieces.

    First with few runs of the twin until steps are small against the standard errors; then the noise is
    calibrated anew, as a bad start looks like noise, and with more runs a few steps follow. Steps stay at
    a few tenths of a standard error for ever, as the twin's noise differs from the axis's.
    """
    names, pieces = tuple(free), list(pieces)
    sweep = _Sweep(pieces, calibrated(model.pack(), pieces, around, bands, seed), bands, seed)
    scale = _scales(model, names)
    lower, upper = _bounds(names, model)
    values = np.array([model[name] for name in names])
    runs, passes = _COARSE, 0
    linear = sweep.linearise(_packed(model, names, values), names, scale, runs)
    converged, still = _judged(linear.normal)
    for iteration in range(ITERATIONS):
        if passes >= MOST_FINE or (still and passes >= LEAST_FINE):
            break
        values = np.clip(values + _limited(linear.normal) * scale, lower, upper)
        packed = _packed(model, names, values)
        if runs == _COARSE and (converged or iteration >= ITERATIONS - MOST_FINE):
            runs = _FINE
            sweep = replace(sweep, around=calibrated(packed, pieces, around, bands, seed))
        passes += runs == _FINE
        linear = sweep.linearise(packed, names, scale, runs)
        converged, still = _judged(linear.normal)
    return _result(model, names, values, (lower, upper), scale, linear, converged, sweep)


def _judged(normal: Normal) -> tuple[bool, bool]:
    """Whether the next step is within what the twin's noise makes of it, and whether it is small.

    A step is measured by the information of the data: directions that they do not tell cannot keep it
    from converging, nor can their large errors hide that it has not.
    """
    step = normal.step
    worth = float(np.sqrt(abs(step @ normal.matrix @ step) / len(step)))
    small = np.abs(step[_spread(normal) < KNOWN]) < STILL
    return worth < CONVERGED, worth < CONVERGED and bool(np.all(small))


def _spread(normal: Normal) -> Floats:
    return np.asarray(np.sqrt(np.maximum(np.diag(normal.covariance), 1e-300)))


def _result(
    model: DriveModel,
    names: tuple[str, ...],
    values: Floats,
    bounds: tuple[Floats, Floats],
    scale: Floats,
    linear: _Linear,
    converged: bool,
    sweep: _Sweep,
) -> Refined:
    covariance = linear.normal.covariance * np.outer(scale, scale)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    fitted = dict(zip(names, values.tolist(), strict=True))
    at_bound = tuple(
        name for name, value, low, high in zip(names, values, *bounds, strict=True) if value in (low, high)
    )
    return Refined(
        model.with_values(fitted, dict(zip(names, spread.tolist(), strict=True))),
        names,
        covariance,
        linear.normal,
        scale,
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
    seed: int

    def linearise(self, packed: Packed, names: Sequence[str], scale: Floats, runs: int) -> _Linear:
        parts: list[Part] = []
        errors: list[Floats] = []
        followed = 0
        for number, recorded in enumerate(self.pieces):
            piece = balanced(recorded, packed, self.bands)
            twins = self._twins(number, piece, packed, runs)
            followed += bool(twins)
            here = torque_error(piece, packed, self.bands)
            rest = [torque_error(twin, packed, self.bands) for twin in twins[1:]]
            bias = np.mean(rest, axis=0) if twins else np.zeros(len(here))
            errors.append((here - bias)[piece.use])
            if twins and suits(piece, self.around):
                parts += small_motion(piece, twins[1:], packed, self.around, names, scale)
            else:
                parts.append(self._torque_part(piece, packed, names, scale, twins, here, bias))
        return _Linear(assemble(parts), errors, followed / len(self.pieces))

    def _torque_part(
        self,
        piece: Piece,
        packed: Packed,
        names: Sequence[str],
        scale: Floats,
        twins: list[Piece],
        here: Floats,
        bias: Floats,
    ) -> Part:
        """The torque residual `here` of a piece less the `bias` of its twins; the first twin gives the instruments.

        It is whitened by the colour that noise has in the twin, not by its own: what the model lacks is
        no noise, and must keep its weight.
        """
        columns = self._columns(piece, packed, names, scale, here)
        other, white = columns, np.ones(1)
        if twins:
            first = torque_error(twins[0], packed, self.bands)
            other = self._columns(twins[0], packed, names, scale, first)
            white = whitener((first - bias)[piece.use])
        rows = max(8, round(BLOCK_SECONDS * min(1.0, piece.pace) / (piece.period * self.bands.decimation)))
        all_three = np.column_stack([here - bias, columns, other])
        all_three = np.asarray(scipy.signal.lfilter(white, [1.0], all_three, axis=0))[piece.use]
        count = len(names)
        return Part(all_three[:, 0], all_three[:, 1 : 1 + count], all_three[:, 1 + count :], rows)

    def _twins(self, number: int, piece: Piece, packed: Packed, runs: int) -> list[Piece]:
        """Simulated pieces; the first is for instruments only. Empty where the twin does not follow."""
        twins: list[Piece] = []
        for run in range(runs + 1):
            if run and slides_freely(piece):
                twins.append(twins[0])
                break
            noise = np.random.default_rng([self.seed, number, run])
            result = run_twin(piece, packed, self.around, noise)
            if not result.follows:
                return []
            twins.append(with_motion(piece, result.position, result.torque, self.bands))
        return twins

    def _columns(
        self, piece: Piece, packed: Packed, names: Sequence[str], scale: Floats, here: Floats
    ) -> Floats:
        """∂R/∂(p/scale) by forward differences, shape (m, k)."""
        columns = np.empty((len(here), len(names)))
        for index, name in enumerate(names):
            changed = packed.p.copy()
            changed[surface_parameter(name).slot] += _DIFFERENCE * scale[index]
            columns[:, index] = (
                torque_error(piece, Packed(changed, packed.on), self.bands) - here
            ) / _DIFFERENCE
        return columns


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


def _packed(model: DriveModel, names: Sequence[str], values: Floats) -> Packed:
    packed = model.pack()
    for name, value in zip(names, values.tolist(), strict=True):
        packed.p[surface_parameter(name).slot] = value
    return packed


def _scales(model: DriveModel, names: Sequence[str]) -> Floats:
    """What counts as a large change of each parameter: its value, or friction for what may be zero."""
    friction = max(model["coulomb"], abs(model["offset"]), 1e-9)
    scales = []
    for name in names:
        size = abs(model[name])
        unit = surface_parameter(name).unit
        if unit == "N m":
            size = max(size, 0.05 * friction)
        elif name == "viscous":
            size = max(size, 0.01 * model["micro_damping"])
        elif unit == "N m s/rad" and name != "micro_damping":
            size = max(size, 0.1 * model["viscous"])
        elif name == "micro_damping":
            size = max(size, 0.5 * float(np.sqrt(model["stiffness"] * model["inertia"])))
        scales.append(size if size > 0 else 1.0)
    return np.array(scales)


def _bounds(names: Sequence[str], model: DriveModel) -> tuple[Floats, Floats]:
    """Physical bounds, and a hundredfold either way for what must be positive."""
    lower, upper = [], []
    for name in names:
        parameter = surface_parameter(name)
        value = model[name]
        low, high = parameter.lower, parameter.upper
        if low > 0 or name in ("stribeck_velocity", "stiffness", "inertia"):
            low, high = max(low, 0.01 * value), min(high, 100.0 * value)
        lower.append(low)
        upper.append(high)
    return np.array(lower), np.array(upper)


def _limited(normal: Normal) -> Floats:
    """No parameter moves by more than 30 % of its scale at once; the direction is kept."""
    step = normal.step
    largest = float(np.max(np.abs(step))) if len(step) else 0.0
    return np.asarray(step * min(1.0, LARGEST_STEP / largest) if largest > 0 else step)


def _torque_rms(pieces: list[Piece], bands: Bands) -> float:
    rows = [piece.torque[:: bands.decimation][: len(piece.use)][piece.use] for piece in pieces]
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))
