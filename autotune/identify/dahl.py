"""Dahl's curve: torque over position for very slow loops (section 3.4.4), and how much model an axis needs (3.3).

Δu = σ0·Δq − (σ0/F_s)·|Δq|·u + (σ0·F_g/F_s)·|Δq| (3.51), over equal steps of travel rather than of time
(friction filters in space), by iterated instrumental variables. With the exponent free, the slope is
σ0·|1 − F/F_s·sign|^i (2.22), fitted to the whole curve.

The characteristic displacement x_s is this curve's (6.2.3): of a reversal from −F_s to F_s all but a share e⁻¹ of it is
over after

    x_s = F_s/σ0 ∫ w^−i dw,  w = 1 − F/F_s from 2/e to 2,                       i = 1: x_s = F_s/σ0 (3.15)

The kinetic model (friction a function of velocity) reverses at once; on a reversal at constant acceleration a it is
wrong by p = 2·F_s·exp(−a·t²/(2·x_s))·(1 − σ1·a·t/F_s) (3.39), that is for about √(2·x_s/a) seconds (3.3.5). Where the
precision asked for is well above x_s, it does not matter. The stiffness of presliding sees the contact as it is before
any element has let go: on an axis with several elastic elements F_s/σ0 is then several times too short (Table 6.2: 3.3
against 14.8 mrad), which is the unsafe side. Without Dahl's curve it is a lower bound, and the sentence says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.core.units import torque_symbol
from autotune.identify.estimate import Estimate, Quantity, invalid
from autotune.models.compiled import compiled
from autotune.recordings.checks import clipped, guide_of, torque_of
from autotune.recordings.recording import Metadata, Recording

ITERATIONS = 20
STEPS_A_LOOP = 400
LEAST_COUNTS = 3.0
POOR_FIT = 0.1
_NAMES = ("stiffness", "break_away", "offset")
KINETIC_SUFFICES = 3.0
"""Precision over x_s from which the kinetic model will do."""


@dataclass(frozen=True, slots=True)
class Dahl:
    """Result of the experiment.

    Attributes:
        estimate: stiffness σ0, break_away F_s and offset F_g; with the exponent free also `exponent`.
        reversal: x_s, the displacement over which friction reverses; None where the curve does not tell.
        position, torque: the measured curve in equal steps of travel, shape (n,).
        predicted: the model's torque on the same path.
    """

    estimate: Estimate
    position: Floats
    torque: Floats
    predicted: Floats
    reversal: Quantity | None = None


@dataclass(frozen=True, slots=True)
class _Path:
    """One segment in steps of travel; `position` and `torque` are means over each step."""

    position: Floats
    torque: Floats


def identify_dahl(
    recording: Recording, viscous: float = 0.0, inertia: float = 0.0, free_exponent: bool = False
) -> Dahl:
    """Fits (3.51) to slow loops.

    Args:
        viscous, inertia: what is taken out of the torque before; small at the speeds in question.
        free_exponent: whether i of (2.22) is estimated too; 1 otherwise.

    Raises:
        NotEnoughExcitation: no travel, or the axis never came back.
    """
    paths = _paths(recording, viscous)
    sigma, force, offset = _instrumental(paths)
    exponent = 1.0
    if not (sigma > 0 and force > 0):
        failed = invalid(
            "dahl", "the curve does not bend as friction does; make the loops longer than 4·F_s/σ0"
        )
        return Dahl(failed, paths[0].position, paths[0].torque, np.full(len(paths[0].torque), math.nan))
    start = np.array([sigma, force, offset, exponent])
    bent = _free(paths, start)
    reversal = max(reversal_displacement(start), reversal_displacement(bent))
    if free_exponent:
        start = bent
    scatter = _scatter(paths, start, free_exponent)
    predicted = _curve(paths[0], start)
    error = math.sqrt(
        sum(float(np.sum((p.torque - _curve(p, start)) ** 2)) for p in paths)
        / sum(float(np.sum((p.torque - start[2]) ** 2)) for p in paths)
    )
    estimate = _judged(start, scatter, error, paths, free_exponent)
    return Dahl(estimate, paths[0].position, paths[0].torque, predicted, _told(reversal, estimate))


def reversal_displacement(curve: Floats) -> float:
    """x_s of σ0, F_s, (F_g) and exponent: where all but e⁻¹ of the way from −F_s to F_s is behind."""
    sigma, force, _, exponent = (float(x) for x in curve)
    near, far = 2.0 / math.e, 2.0
    if abs(exponent - 1.0) < 1e-6:
        return force / sigma
    power = 1.0 - exponent
    return force / sigma * (math.pow(far, power) - math.pow(near, power)) / power


def _told(reversal: float, estimate: Estimate) -> Quantity | None:
    """The longer of what one element and the bent curve say, as it errs to the safe side."""
    if not estimate.valid:
        return None
    force, sigma = estimate["break_away"], estimate["stiffness"]
    relative = math.hypot(force.relative_error, sigma.relative_error)
    return Quantity(reversal, reversal * relative, max(force.quantile, sigma.quantile))


def dahl_curve(position: Floats, sigma: float, force: float, exponent: float, start: float) -> Floats:
    """Friction (without offset) along a path, from (2.22) by the midpoint rule, shape (n,)."""
    result = np.empty(len(position))
    _follow(position, sigma, force, exponent, start, result)
    return result


@compiled
def _follow(
    position: Floats, sigma: float, force: float, exponent: float, start: float, result: Floats
) -> None:
    friction = start
    result[0] = friction
    for k in range(1, len(position)):
        step = position[k] - position[k - 1]
        direction = 1.0 if step >= 0.0 else -1.0
        if exponent == 1.0:
            steady = direction * force
            friction = steady + (friction - steady) * math.exp(-sigma * abs(step) / force)
        else:
            parts = 4
            for _ in range(parts):
                gap = 1.0 - friction / force * direction
                middle = friction + 0.5 * step / parts * sigma * abs(gap) ** exponent * np.sign(gap)
                gap = 1.0 - middle / force * direction
                friction += step / parts * sigma * abs(gap) ** exponent * np.sign(gap)
        result[k] = friction


def _paths(recording: Recording, viscous: float) -> list[_Path]:
    paths = []
    for _, segment in recording.split():
        if len(segment) < 100 or np.any(clipped(segment).rows):
            continue
        path = _in_travel(segment, viscous)
        if path is not None:
            paths.append(path)
    if not paths:
        raise NotEnoughExcitation(
            "Dahl's curve needs slow loops in both directions that are many counts long and not clipped; "
            "record triangles of several F_s/σ0 at a few hundredths of the Stribeck velocity"
        )
    return paths


def _in_travel(segment: Recording, viscous: float) -> _Path | None:
    """Means over equal steps of travel along the reference (the measured position if there is none)."""
    position = segment["position"]
    guide = guide_of(segment)
    torque = torque_of(segment)
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(guide)))])
    span = float(np.ptp(guide))
    resolution = segment.metadata.position_resolution or 0.0
    total = float(travel[-1])
    if span <= 10.0 * resolution or total < 1.5 * span or span == 0.0:
        return None
    step = max(2.0 * span / STEPS_A_LOOP, LEAST_COUNTS * resolution)
    number = np.minimum((travel / step).astype(int), int(total / step))
    counts = np.bincount(number)
    full = counts > 0
    mean_position = np.bincount(number, position)[full] / counts[full]
    mean_torque = np.bincount(number, torque)[full] / counts[full]
    speed = np.gradient(mean_position) / np.maximum(counts[full] * segment.period, segment.period)
    return _Path(mean_position[1:-1], (mean_torque - viscous * speed)[1:-1])


def _regressors(path: _Path, torque: Floats) -> tuple[Floats, Floats]:
    """Columns of (3.51) at the middle of each step, and Δu measured."""
    step = np.diff(path.position)
    middle = 0.5 * (torque[1:] + torque[:-1])
    design = np.stack([step, -np.abs(step) * middle, np.abs(step)], axis=1)
    return design, np.diff(path.torque)


def _instrumental(paths: list[_Path]) -> tuple[float, float, float]:
    """σ0, F_s, F_g by iterated instrumental variables: the model's own torque along the path."""
    designs, targets = zip(*(_regressors(path, path.torque) for path in paths), strict=True)
    design, target = np.concatenate(designs), np.concatenate(targets)
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    for _ in range(ITERATIONS):
        sigma, force, offset = _physical(solution)
        if not (sigma > 0 and force > 0):
            break
        model = np.array([sigma, force, offset, 1.0])
        instruments = np.concatenate([_regressors(path, _curve(path, model))[0] for path in paths])
        matrix = instruments.T @ design
        if np.linalg.cond(matrix) > 1e14:
            break
        solution = np.linalg.solve(matrix, instruments.T @ target)
    return _physical(solution)


def _physical(solution: Floats) -> tuple[float, float, float]:
    sigma, ratio, third = (float(x) for x in solution)
    if ratio == 0.0:
        return sigma, math.nan, math.nan
    return sigma, sigma / ratio, third / ratio


def _curve(path: _Path, parameters: Floats) -> Floats:
    """Torque along a path, started where the measured curve starts."""
    sigma, force, offset, exponent = (float(x) for x in parameters)
    start = min(max(float(path.torque[:3].mean()) - offset, -force), force)
    return np.asarray(offset + dahl_curve(path.position, sigma, force, exponent, start))


def _free(paths: list[_Path], start: Floats) -> Floats:
    """Refinement of the whole curve with the exponent free."""

    def error(x: Floats) -> Floats:
        model = np.array([math.exp(x[0]), math.exp(x[1]), x[2], x[3]])
        return np.concatenate([path.torque - _curve(path, model) for path in paths])

    begin = np.array([math.log(start[0]), math.log(start[1]), start[2], 1.3])
    lower = np.array([begin[0] - 3.0, begin[1] - 1.0, -np.inf, 0.3])
    upper = np.array([begin[0] + 4.0, begin[1] + 1.0, np.inf, 6.0])
    x = scipy.optimize.least_squares(error, begin, bounds=(lower, upper), diff_step=np.full(4, 1e-4)).x
    return np.array([math.exp(x[0]), math.exp(x[1]), x[2], x[3]])


def _scatter(paths: list[_Path], best: Floats, free_exponent: bool) -> Floats:
    """Standard errors from fits to single parts of the data (repeats, else halves)."""
    parts = paths if len(paths) >= 3 else [half for path in paths for half in _halves(path)]
    results = []
    for part in parts:
        sigma, force, offset = _instrumental([part])
        if sigma > 0 and force > 0:
            one = np.array([sigma, force, offset, 1.0])
            results.append(_free([part], one) if free_exponent else one)
    if len(results) < 2:
        return np.full(4, math.nan)
    return np.asarray(np.std(results, axis=0, ddof=1) / math.sqrt(len(results)))


def _halves(path: _Path) -> list[_Path]:
    middle = len(path.torque) // 2
    return [
        _Path(path.position[:middle], path.torque[:middle]),
        _Path(path.position[middle:], path.torque[middle:]),
    ]


def _judged(best: Floats, scatter: Floats, error: float, paths: list[_Path], free_exponent: bool) -> Estimate:
    parts = len(paths) if len(paths) >= 3 else 2 * len(paths)
    reach = float(scipy.stats.t.ppf(0.975, max(parts - 1, 1)))
    names = (*_NAMES, "exponent") if free_exponent else _NAMES
    quantities = {
        name: Quantity(float(value), float(one), reach)
        for name, value, one in zip(names, best, scatter, strict=False)
    }
    notes = []
    if error > POOR_FIT:
        notes.append(
            f"one elastic element leaves {100 * error:.0f} % of Dahl's curve unexplained: "
            "friction has several"
        )
    valid, reason = True, ""
    if not np.all(np.isfinite(scatter[:3])):
        valid, reason = False, "the curve is too short to say how certain it is; record at least two loops"
    elif error > 0.5:
        valid, reason = False, f"the model explains {100 * (1 - error):.0f} % of Dahl's curve only"
    return Estimate("dahl", MappingProxyType(quantities), valid, reason, error, tuple(notes))


@dataclass(frozen=True, slots=True)
class Complexity:
    """x_s [rad or m], the verdict and the sentence that explains it.

    Attributes:
        displacement: x_s, from Dahl's curve where there is one.
        lower_bound: there was none: friction reverses over `displacement` at least.
        lugre_needed: whether friction must be modelled through the reversal for `precision`.
        peak_difference: largest error of the kinetic model at a reversal, 2·F_s [N m].
        duration: how long it lasts at `acceleration` [s].
        acceleration: at the reversal that is judged [rad/s² or m/s²].
    """

    displacement: Quantity
    precision: float
    lugre_needed: bool
    peak_difference: float
    duration: float
    text: str
    lower_bound: bool = False
    acceleration: float = math.nan


def kinetic_difference(
    time: Floats, break_away: float, stiffness: float, micro_damping: float, acceleration: float
) -> Floats:
    """p(t) of (3.39) [N m] after a reversal at constant acceleration, shape as `time`."""
    exponent = -acceleration * time**2 * stiffness / (2.0 * break_away)
    return np.asarray(
        2.0 * break_away * np.exp(exponent) * (1.0 - micro_damping / break_away * acceleration * time)
    )


def judge_complexity(
    parameters: Mapping[str, Quantity],
    precision: float,
    acceleration: float,
    metadata: Metadata,
    reversal: Quantity | None = None,
) -> Complexity | None:
    """Whether the axis needs LuGre for a precision [rad or m]; None without friction or stiffness.

    Args:
        reversal: x_s of Dahl's curve; None where none was recorded.
        acceleration: at the reversals of the application [rad/s² or m/s²].
    """
    levels = [q for q in (parameters.get("break_away"), parameters.get("coulomb")) if q is not None]
    if not levels or max(q.value for q in levels) <= 0.0:
        return None
    friction = max(levels, key=lambda q: q.value)
    at_rest = _at_rest(friction, parameters.get("stiffness"))
    known = [q for q in (reversal, at_rest) if q is not None]
    if not known:
        return None
    displacement = max(known, key=lambda q: q.value)
    value = displacement.value
    duration = math.sqrt(2.0 * value / acceleration) if acceleration > 0 else math.inf
    judged = Complexity(
        displacement,
        precision,
        precision < KINETIC_SUFFICES * max(value, displacement.interval[1]),
        2.0 * friction.value,
        duration,
        "",
        reversal is None,
        acceleration,
    )
    return replace(judged, text=_sentence(judged, metadata))


def _at_rest(friction: Quantity, stiffness: Quantity | None) -> Quantity | None:
    """F_s/σ0 with the stiffness at rest."""
    if stiffness is None or stiffness.value <= 0.0:
        return None
    value = friction.value / stiffness.value
    relative = math.hypot(friction.relative_error, stiffness.relative_error)
    return Quantity(value, value * relative, max(friction.quantile, stiffness.quantile))


def _sentence(judged: Complexity, metadata: Metadata) -> str:
    scale, unit = (1e3, "mrad") if metadata.motion_unit == "rad" else (1e6, "µm")
    torque = torque_symbol(metadata.motion_unit, metadata.torque_unit)
    verdict = (
        "the axis needs the LuGre model"
        if judged.lugre_needed
        else "the kinetic model (friction as a function of velocity) will do"
    )
    least = "at least " if judged.lower_bound else ""
    hint = (
        ". That is what stiffness at rest says; where several elastic elements let go one after another, "
        "friction reverses over more: record Dahl's curve"
        if judged.lower_bound and not judged.lugre_needed
        else ""
    )
    return (
        f"friction reverses over x_s = {least}{scale * judged.displacement.value:.3g} {unit}; for a precision "
        f"of {scale * judged.precision:.3g} {unit} {verdict}. At a reversal with {judged.acceleration:.2g} "
        f"{metadata.motion_unit}/s² the kinetic model is wrong by up to {judged.peak_difference:.3g} {torque} "
        f"for {least or 'about '}{1e3 * judged.duration:.0f} ms{hint}"
    )
