"""Steady-state characteristic (section 3.4.1): points from legs of constant speed, and a curve through them.

Every leg gives one point: its mean torque, after what repeats with position has been taken out (the
waves are fitted over all legs together) and after the torque that accelerates the inertia. The error
of a point comes from the scatter of its parts.

The curve is the velocity–torque characteristic (3.41), u = F_g + σ2·v + level(v)·sign(v), with every shape of
Table 2.1: bounded nonlinear least squares over weighted points, compared on points held out (one speed at a time).

Recordings may hold constant speeds only, one file a speed, as some test benches record them. They tell friction over
speed and nothing of inertia and contact stiffness; those are placeholders in the model, without a standard error,
and the reason says so (`fit_speed_curve`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.pieces import UNFITTED
from autotune.identify.estimate import Estimate, Quantity
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.lugre import SHAPES, Shape, level
from autotune.models.stribeck import STRIBECK
from autotune.recordings.checks import clipped, guide_of, torque_of
from autotune.recordings.recording import Recording
from autotune.signals.filters import motion
from autotune.signals.legs import Leg, find_legs
from autotune.signals.place_terms import Line, columns, find_lines

LEAST_SPEEDS = 4
NO_SCATTER = 1e-6
"""Of the torque: less is rounding, as where each speed has its mean only."""
_BLOCKS = 48
_PARTS = 6
LEAST_RISE = 0.03
"""Break-away within this share of Coulomb friction counts as equal to it."""
RELATIVE_STEP = 1e-7
"""Of the differences that stand for a derivative: between what rounding and what curvature allows."""
DIFFERENCE_OF_LEVELS = DIRECTION_ASYMMETRY.surface("coulomb")
DIFFERENCE_OF_SLOPES = DIRECTION_ASYMMETRY.surface("viscous")


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Result of the experiment.

    Attributes:
        estimate: parameters of the Gaussian shape (3.5), or of the linear one where friction does not fall.
        points: what was measured.
        curves: every shape, best on held-out points first.
        asymmetric: the chosen shape with directions apart.
        ripple: torque waves over position found in the legs.
    """

    estimate: Estimate
    points: Points
    curves: tuple[CurveFit, ...]
    asymmetric: CurveFit | None
    ripple: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Block means of all legs: arrays of shape (m,); `leg` is the number of each block's leg."""

    leg: NDArray[np.int64]
    position: Floats
    acceleration: Floats
    torque: Floats
    velocity: Floats


def identify_steady_state(recording: Recording, settle_distance: float = 0.0) -> SteadyState:
    """Characteristic from every leg of constant speed in the recording.

    Args:
        settle_distance: travel after a reversal that is not used; several times F_s/σ0.

    Raises:
        NotEnoughExcitation: no legs, fewer than four speeds, or one direction only.
    """
    blocks, velocity = _gather(recording, settle_distance)
    _refuse_poor(velocity)
    scale = 1.0 if recording.metadata.motion_unit == "rad" else 2.0 * np.pi
    points, ripple = _points(blocks, velocity, scale)
    curves = compare_shapes(points)
    chosen = _chosen(curves)
    asymmetric = fit_curve(points, chosen.shape, True) if len(points) > 9 else None
    estimate = Estimate("steady_state", chosen.parameters, True, "", chosen.relative_error, _notes(chosen))
    return SteadyState(estimate, points, tuple(curves), asymmetric, tuple(ripple))


def steady_points(recording: Recording, settle_distance: float = 0.0) -> Points:
    """Only the points, without a fit; raises as `identify_steady_state`."""
    blocks, velocity = _gather(recording, settle_distance)
    return _points(blocks, velocity, 1.0 if recording.metadata.motion_unit == "rad" else 2.0 * np.pi)[0]


def _gather(recording: Recording, settle_distance: float) -> tuple[_Blocks, Floats]:
    parts: list[tuple[Floats, ...]] = []
    speeds: list[float] = []
    resolution = recording.metadata.position_resolution or 0.0
    for _, segment in recording.split():
        if len(segment) < 16:
            continue
        path = guide_of(segment)
        smooth = motion(segment["position"], segment.period, min(20.0, 0.1 / segment.period))
        at_limit = clipped(segment).rows
        for leg in find_legs(path, segment.period, resolution, settle_distance):
            if np.any(at_limit[leg.rows]) or len(leg) < _PARTS * 2:
                continue
            parts.append(_blocks_of(leg, len(speeds), smooth, torque_of(segment)))
            speeds.append(float(np.mean(smooth[1][leg.rows])))
    if not parts:
        raise NotEnoughExcitation(
            "there is no stretch of constant speed in the data; play triangles at several speeds, "
            "both directions, over at least one period of the torque ripple"
        )
    leg_number, position, velocity, acceleration, torque = (
        np.concatenate([part[i] for part in parts]) for i in range(5)
    )
    blocks = _Blocks(leg_number.astype(np.int64), position, acceleration, torque, velocity)
    return blocks, np.array(speeds)


def _blocks_of(
    leg: Leg, number: int, smooth: tuple[Floats, Floats, Floats], torque: Floats
) -> tuple[Floats, ...]:
    edges = np.linspace(leg.start, leg.stop, min(_BLOCKS, len(leg) // 2) + 1).astype(int)
    widths = np.diff(edges)
    means = [np.add.reduceat(signal[: leg.stop], edges[:-1]) / widths for signal in (*smooth, torque)]
    return (np.full(len(widths), float(number)), *means)


def _refuse_poor(velocity: Floats) -> None:
    directions = np.unique(np.sign(velocity))
    if len(directions) < 2:
        word = "positive" if directions[0] > 0 else "negative"
        raise NotEnoughExcitation(
            f"the axis moved in the {word} direction only; Coulomb friction and offset cannot be told apart. "
            "Record both directions"
        )
    speeds = distinct_speeds(velocity, 1.2)
    if speeds < LEAST_SPEEDS:
        raise NotEnoughExcitation(
            f"the legs have {speeds} different speeds; at least {LEAST_SPEEDS} are needed to tell Coulomb "
            "from viscous friction. Play triangles at more speeds, evenly spaced on a log scale"
        )


def _points(blocks: _Blocks, velocity: Floats, scale: float) -> tuple[Points, list[Line]]:
    """Least squares with one level a leg, waves and inertia in common."""
    count = len(velocity)
    levels = (blocks.leg[:, None] == np.arange(count)).astype(float)
    fixed = np.hstack([levels, blocks.acceleration[:, None]])
    first = blocks.torque - fixed @ np.linalg.lstsq(fixed, blocks.torque, rcond=None)[0]
    least = NO_SCATTER * float(np.max(np.abs(blocks.torque)))
    steady = _steady(first, blocks.leg, count, least)
    ripple = find_lines(blocks.position[steady], first[steady], fixed[steady], scale)
    waves = columns(blocks.position, [line.order for line in ripple], scale)
    design = np.hstack([fixed, waves])
    weight = 1.0 / _leg_scatter(first, blocks.leg, count, least)
    weighted = design * weight[:, None]
    solution = np.linalg.lstsq(weighted, blocks.torque * weight, rcond=None)[0]
    rest = blocks.torque - design @ solution
    level = np.asarray(solution[:count], dtype=np.float64)
    mean_velocity = np.array([blocks.velocity[blocks.leg == leg].mean() for leg in range(count)])
    errors = np.array([_scatter(rest[blocks.leg == leg]) for leg in range(count)])
    return Points(mean_velocity, level, _pooled(errors, level)), ripple


def _leg_scatter(rest: Floats, leg: NDArray[np.int64], count: int, least: float) -> Floats:
    """Standard deviation of each block's leg, shape (m,); never below a tenth of the typical one, nor `least`."""
    scatter = np.array([np.std(rest[leg == number]) for number in range(count)])
    return np.asarray(np.maximum(scatter, max(0.1 * float(np.median(scatter)), least))[leg])


def _steady(rest: Floats, leg: NDArray[np.int64], count: int, least: float) -> NDArray[np.bool_]:
    """Blocks of legs whose torque is not dominated by what the control loop does."""
    scatter = _leg_scatter(rest, leg, count, least)
    return scatter <= 2.0 * np.median(scatter)


def _scatter(rest: Floats) -> float:
    """Standard error of the mean from the means of six parts, which allows for slow disturbances."""
    edges = np.linspace(0, len(rest), min(_PARTS, len(rest)) + 1).astype(int)
    means = np.add.reduceat(rest, edges[:-1]) / np.diff(edges)
    return float(np.std(means, ddof=1) / np.sqrt(len(means)))


def _pooled(errors: Floats, level: Floats) -> Floats:
    """Six parts tell a scatter only to 30 %: half of each leg's own, half of the typical one."""
    typical = max(float(np.median(errors)), NO_SCATTER * float(np.max(np.abs(level))))
    return np.asarray(np.sqrt(0.5 * errors**2 + 0.5 * typical**2))


def _chosen(curves: list[CurveFit]) -> CurveFit:
    """The Gaussian shape of the LuGre model, unless a straight line predicts held-out points as well."""
    by_shape = {curve.shape: curve for curve in curves}
    straight, gaussian = by_shape["linear"], by_shape.get("gaussian")
    if gaussian is None or "stribeck_velocity" not in gaussian.parameters:
        return straight
    if not gaussian.parameters["stribeck_velocity"].identified:
        return straight
    worse = straight.held_out_rms > 1.1 * gaussian.held_out_rms or straight.rms > 1.5 * gaussian.rms
    return gaussian if worse else straight


def _notes(chosen: CurveFit) -> tuple[str, ...]:
    notes = [f"{name}: {q.note}" for name, q in chosen.parameters.items() if q.note]
    if chosen.shape == "linear":
        notes.append("friction does not fall with speed here: break-away equals Coulomb friction")
    return tuple(notes)


PLACEHOLDER_INERTIA = 1e-9
LEAST_SEGMENTS = 4
_COVERED, _OF_ROWS = 0.6, 0.8


@dataclass(frozen=True, slots=True)
class SpeedCurve:
    """A model for constant speeds, its estimate, and the curve with its points."""

    model: DriveModel
    estimate: Estimate
    steady_state: SteadyState


def holds_constant_speeds_only(recording: Recording) -> bool:
    """Whether nearly every segment is one stretch of constant speed, at speeds enough for a curve in both directions.

    One speed that lost samples cut into segments is no curve: what it tells is where the torque waves.
    """
    resolution = recording.metadata.position_resolution or 0.0
    single = total = 0
    speeds: list[float] = []
    for segment, part in recording.split():
        if segment.experiment in UNFITTED or len(part) < 16:
            continue
        legs = find_legs(guide_of(part), part.period, resolution)
        total += len(part)
        if len(legs) == 1 and len(legs[0]) > _COVERED * len(part):
            single += len(part)
            speeds.append(float(part["position"][-1] - part["position"][0]) / (len(part) * part.period))
    if len(speeds) < LEAST_SEGMENTS or single <= _OF_ROWS * total:
        return False
    velocity = np.array(speeds)
    both = len(np.unique(np.sign(velocity))) > 1
    return both and distinct_speeds(velocity, 1.2) >= LEAST_SPEEDS


def fit_speed_curve(recording: Recording, effects: Sequence[str]) -> SpeedCurve:
    """A model of friction at constant speeds.

    Raises:
        NotEnoughExcitation: too few speeds, or one direction only.
    """
    state = identify_steady_state(recording.rows(~np.isin(recording.experiment, UNFITTED)))
    shape: Shape = "gaussian" if STRIBECK.name in effects else "linear"
    curve = fit_curve(state.points, shape, DIRECTION_ASYMMETRY.name in effects)
    found = curve.parameters
    values = {name: quantity.value for name, quantity in found.items() if "." not in name}
    reach = float(np.min(np.abs(state.points.velocity))) * recording.period
    stiffness = values["coulomb"] / max(reach, 1e-12)
    metadata = recording.metadata
    model = base_model(
        values | {"inertia": PLACEHOLDER_INERTIA, "stiffness": stiffness, "micro_damping": 0.0},
        {name: q.standard_error for name, q in found.items() if math.isfinite(q.standard_error)},
        metadata.motion_unit,
        metadata.axis,
        metadata.fingerprint,
        metadata.torque_unit,
    )
    if DIRECTION_ASYMMETRY.name in effects:
        name = DIRECTION_ASYMMETRY.surface("viscous")
        asymmetry = {"coulomb": 0.0, "viscous": found[name].value}
        model = model.with_effect(
            DIRECTION_ASYMMETRY.make(asymmetry, {"viscous": found[name].standard_error})
        )
    reason = (
        f"only the speed curve: {len(state.points)} points. Inertia, stiffness and micro_damping are not "
        "identified by these experiments; record accelerations and reversals"
    )
    estimate = Estimate("steady_state", found, True, reason, curve.relative_error)
    return SpeedCurve(model, estimate, state)


@dataclass(frozen=True, slots=True)
class Points:
    """Points of the characteristic, arrays of shape (n,): velocity, torque and its standard error."""

    velocity: Floats
    torque: Floats
    standard_error: Floats

    def __len__(self) -> int:
        return len(self.velocity)

    def where(self, rows: NDArray[np.bool_]) -> Points:
        return Points(self.velocity[rows], self.torque[rows], self.standard_error[rows])


@dataclass(frozen=True, slots=True)
class CurveFit:
    """One shape fitted.

    Attributes:
        parameters: coulomb, viscous, offset; break_away, stribeck_velocity (and exponent) where the shape
            has them; with asymmetry `direction_asymmetry.viscous` (at
            steady speed a difference of Coulomb levels cannot be told from the offset).
        rms, held_out_rms: weighted torque error on the points fitted, and on points left out [N m].
        relative_error: norm of the torque error over the norm of the torque.
        chi_square: mean square of error over standard error.
    """

    shape: Shape
    asymmetric: bool
    parameters: Mapping[str, Quantity] = field(default_factory=lambda: MappingProxyType({}))
    rms: float = math.nan
    held_out_rms: float = math.nan
    relative_error: float = math.nan
    chi_square: float = math.nan

    @property
    def values(self) -> dict[str, float]:
        return {name: quantity.value for name, quantity in self.parameters.items()}

    def predict(self, velocity: Floats) -> Floats:
        """Torque [N m] at each velocity, shape (n,)."""
        return predict(self.shape, self.values, velocity)


def predict(shape: Shape, values: Mapping[str, float], velocity: Floats) -> Floats:
    """(3.41) with any shape; what is missing in `values` is neutral."""
    direction = np.sign(velocity)
    base = level(
        shape,
        velocity,
        values["coulomb"],
        values.get("break_away", values["coulomb"]),
        values.get("stribeck_velocity", 1.0),
        values.get("exponent", 2.0),
    )
    base = base + direction * values.get(DIFFERENCE_OF_LEVELS, 0.0)
    slope = values["viscous"] + direction * values.get(DIFFERENCE_OF_SLOPES, 0.0)
    return np.asarray(values["offset"] + slope * velocity + direction * base)


def fit_curve(points: Points, shape: Shape = "gaussian", asymmetric: bool = False) -> CurveFit:
    """Fits one shape; needs both directions and more points than parameters."""
    names, solution = _solve(points, shape, asymmetric)
    values = dict(zip(names, solution.x.tolist(), strict=True))
    error = points.torque - predict(shape, values, points.velocity)
    freedom = max(len(points) - len(names), 1)
    chi_square = float(np.sum((error / points.standard_error) ** 2) / freedom)
    weights = points.standard_error**-2.0
    return CurveFit(
        shape,
        asymmetric,
        MappingProxyType(_quantities(names, solution, points, chi_square, freedom)),
        rms=float(np.sqrt(np.average(error**2, weights=weights))),
        held_out_rms=math.nan,
        relative_error=float(np.linalg.norm(error) / np.linalg.norm(points.torque)),
        chi_square=chi_square,
    )


def held_out_error(points: Points, shape: Shape, asymmetric: bool = False) -> float:
    """Root of the weighted mean square error on speeds left out of the fit, one at a time [N m].

    The slowest and the fastest speed are never left out: nobody should extrapolate.
    """
    groups = speed_groups(points.velocity)
    errors: list[Floats] = []
    weights: list[Floats] = []
    for group in range(1, int(groups.max())):
        out = groups == group
        names, solution = _solve(points.where(~out), shape, asymmetric)
        values = dict(zip(names, solution.x.tolist(), strict=True))
        errors.append((points.torque[out] - predict(shape, values, points.velocity[out])) ** 2)
        weights.append(points.standard_error[out] ** -2.0)
    if not errors:
        return math.nan
    return float(np.sqrt(np.average(np.concatenate(errors), weights=np.concatenate(weights))))


def speed_groups(velocity: Floats, ratio: float = 1.05) -> NDArray[np.int64]:
    """Number of the speed (0 is the slowest) of each point; speeds within 5 % are one."""
    speed = np.abs(velocity)
    order = np.argsort(speed)
    jumps = np.concatenate([[0], np.cumsum(speed[order][1:] > ratio * speed[order][:-1])])
    groups = np.empty(len(speed), dtype=np.int64)
    groups[order] = jumps
    return groups


def distinct_speeds(velocity: Floats, ratio: float) -> int:
    """How many speeds there are of which each is faster than the next slower one by a factor.

    Of a dense curve neighbours are not, and all of them would be one group (`speed_groups`).
    """
    count, least = 0, 0.0
    for speed in np.sort(np.abs(velocity)).tolist():
        if speed > least:
            count, least = count + 1, ratio * speed
    return count


def parameter_names(shape: Shape, asymmetric: bool) -> list[str]:
    """What a shape has to be fitted."""
    names = ["coulomb", "viscous", "offset"]
    if shape != "linear":
        names += ["break_away", "stribeck_velocity"]
    if shape == "generalised_exponential":
        names.append("exponent")
    if asymmetric:
        names.append(DIFFERENCE_OF_SLOPES)
    return names


def _bounds(names: list[str], points: Points) -> tuple[Floats, Floats]:
    """What is physically possible: friction falls, if at all, and does so within the speeds measured."""
    speed = np.abs(points.velocity)
    top = 3.0 * float(np.max(np.abs(points.torque)))
    slope = 10.0 * top / float(speed.max())
    lower = {"coulomb": 0.0, "viscous": 0.0, "break_away": 0.0, "exponent": 0.5}
    upper = {"viscous": slope, "exponent": 4.0, DIFFERENCE_OF_SLOPES: slope}
    lower["stribeck_velocity"] = 0.5 * float(speed.min())
    upper["stribeck_velocity"] = max(float(speed.max()), 2.0 * float(speed.min()))
    lower[DIFFERENCE_OF_SLOPES] = -slope
    return (
        np.array([lower.get(name, -top) for name in names]),
        np.array([upper.get(name, top) for name in names]),
    )


def _solve(points: Points, shape: Shape, asymmetric: bool) -> tuple[list[str], scipy.optimize.OptimizeResult]:
    """Several starts in v_s, since the cost has side minima there; the rest is nearly linear.

    What is solved for in the place of break-away is its rise above Coulomb friction.
    """
    names = parameter_names(shape, asymmetric)
    lower, upper = _bounds(names, points)
    start = _start(points, names)
    rises = names.index("break_away") if "break_away" in names else -1

    def values_of(x: Floats) -> dict[str, float]:
        values = dict(zip(names, x.tolist(), strict=True))
        return values | ({"break_away": values["coulomb"] + values["break_away"]} if rises >= 0 else {})

    def error(x: Floats) -> Floats:
        return (predict(shape, values_of(x), points.velocity) - points.torque) / points.standard_error

    def slopes(x: Floats) -> Floats:
        columns = _derivatives(shape, names, values_of(x), points.velocity)
        if rises >= 0:
            columns[:, 0] += columns[:, rises]
        return columns / points.standard_error[:, np.newaxis]

    best: scipy.optimize.OptimizeResult | None = None
    for stribeck in _stribeck_starts(points) if shape != "linear" else [1.0]:
        begin = np.array([stribeck if name == "stribeck_velocity" else start[name] for name in names])
        begin = np.clip(begin, lower + 1e-9 * (upper - lower), upper - 1e-9 * (upper - lower))
        result = scipy.optimize.least_squares(
            error, begin, slopes, bounds=(lower, upper), x_scale=np.maximum(abs(begin), 1e-6)
        )
        if best is None or result.cost < best.cost:
            best = result
    if best is None:
        raise ValueError("no start for the fit of the characteristic")
    if rises >= 0:
        best.jac[:, 0] -= best.jac[:, rises]
        best.x[rises] += best.x[0]
    return names, best


def _derivatives(shape: Shape, names: list[str], values: Mapping[str, float], velocity: Floats) -> Floats:
    """Of `predict` by each parameter, shape (n, p); only Stribeck velocity and exponent are not linear in it."""
    direction = np.sign(velocity)

    def share(at: Mapping[str, float]) -> Floats:
        """What is left of the rise from Coulomb friction to break-away."""
        return level(shape, velocity, 0.0, 1.0, at.get("stribeck_velocity", 1.0), at.get("exponent", 2.0))

    left = share(values)
    rise = values.get("break_away", values["coulomb"]) - values["coulomb"]
    columns = {
        "coulomb": direction * (1.0 - left),
        "break_away": direction * left,
        "viscous": velocity,
        "offset": np.ones_like(velocity),
        DIFFERENCE_OF_SLOPES: direction * velocity,
    }
    for name in {"stribeck_velocity", "exponent"} & set(names):
        step = RELATIVE_STEP * values[name]
        columns[name] = direction * rise * (share({**values, name: values[name] + step}) - left) / step
    return np.stack([columns[name] for name in names], axis=1)


def _stribeck_starts(points: Points) -> list[float]:
    speed = np.abs(points.velocity)
    return [float(s) for s in np.geomspace(1.5 * speed.min(), 0.5 * speed.max(), 4)]


def _start(points: Points, names: list[str]) -> dict[str, float]:
    """Linear least squares over the faster half of the points, and the slowest for break-away."""
    v, u = points.velocity, points.torque
    fast = np.abs(v) >= np.median(np.abs(v))
    rows = fast if len(np.unique(np.sign(v[fast]))) == 2 else np.ones_like(fast)
    design = np.stack([np.sign(v), v, np.ones_like(v)], axis=1)
    coulomb, viscous, offset = np.linalg.lstsq(design[rows], u[rows], rcond=None)[0]
    slowest = np.argmin(np.abs(v))
    start = dict.fromkeys(names, 0.0)
    start |= {"coulomb": abs(float(coulomb)), "viscous": max(float(viscous), 0.0), "offset": float(offset)}
    rise = float(abs(u[slowest] - offset)) - start["coulomb"]
    return start | {"break_away": rise, "stribeck_velocity": 1.0, "exponent": 1.5}


def _quantities(
    names: list[str], solution: scipy.optimize.OptimizeResult, points: Points, chi_square: float, freedom: int
) -> dict[str, Quantity]:
    covariance = np.linalg.pinv(solution.jac.T @ solution.jac) * max(chi_square, 1.0)
    reach = float(scipy.stats.t.ppf(0.975, freedom))
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    result = {}
    for name, value, error, bound in zip(names, solution.x, errors, solution.active_mask, strict=True):
        note = f"at its {'lower' if bound < 0 else 'upper'} bound" if bound else ""
        result[name] = Quantity(float(value), float(error), reach, not bound or name == "viscous", note)
    return _without_rise(result)


def _without_rise(result: dict[str, Quantity]) -> dict[str, Quantity]:
    """Without a clear rise to break-away there is no Stribeck velocity to be had."""
    if "break_away" not in result:
        return result
    rise = result["break_away"].value - result["coulomb"].value
    error = math.hypot(result["break_away"].standard_error, result["coulomb"].standard_error)
    if rise < max(LEAST_RISE * result["coulomb"].value, 2.0 * error):
        note = "break-away equals Coulomb friction within its uncertainty, so this velocity means nothing"
        old = result["stribeck_velocity"]
        result["stribeck_velocity"] = Quantity(
            old.value, old.standard_error, old.quantile, False, old.note or note
        )
    return result


def compare_shapes(points: Points) -> list[CurveFit]:
    """Every shape of Table 2.1 with its held-out error, best first."""
    fits = []
    for shape in SHAPES:
        if len(points) <= len(parameter_names(shape, False)) + 2:
            continue
        fit = fit_curve(points, shape)
        fits.append(
            CurveFit(
                fit.shape,
                fit.asymmetric,
                fit.parameters,
                fit.rms,
                held_out_error(points, shape),
                fit.relative_error,
                fit.chi_square,
            )
        )
    return sorted(fits, key=lambda fit: (math.isnan(fit.held_out_rms), fit.held_out_rms))
