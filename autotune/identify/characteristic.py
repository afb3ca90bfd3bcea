"""Fits of the steady-state velocity–torque characteristic (3.41) with every shape of Table 2.1.

u = F_g + σ2·v + level(v)·sign(v), by bounded nonlinear least squares over weighted points, compared
on points held out (one speed at a time).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.identify.estimate import Quantity
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.lugre import SHAPES, Shape, level

LEAST_RISE = 0.03
"""Break-away within this share of Coulomb friction counts as equal to it."""
RELATIVE_STEP = 1e-7
"""Of the differences that stand for a derivative: between what rounding and what curvature allows."""
DIFFERENCE_OF_LEVELS = DIRECTION_ASYMMETRY.surface("coulomb")
DIFFERENCE_OF_SLOPES = DIRECTION_ASYMMETRY.surface("viscous")


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
