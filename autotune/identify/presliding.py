"""Small displacements about relaxed junctions (section 3.4.3): inertia, σ1 + σ2 and stiffness at rest.

The data are cut into sets, each analysed by every method of Figure 6.12; the estimate is the mean of Box–Jenkins over
the sets, its error what the sets scatter by.

Five ways to fit (3.46) to one set: LS and IV fit the difference equation (ARX); `dv` says that deviation variables are
used, that is the means are taken out. The instruments of IV are the outputs of the model of the iteration before (20
iterations). Box–Jenkins fits the physical parameters themselves by the prediction error, with noise C/D of second
order; offsets are part of its model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.small_motion import SpringMass, from_difference
from autotune.identify.estimate import Estimate, Quantity, invalid
from autotune.recordings.checks import torque_of
from autotune.recordings.recording import Recording
from autotune.signals.filters import block_mean

SET_SECONDS = 3.0
MOST_SETS = 15
LEAST_COUNTS = 2.0
_NAMES = ("inertia", "presliding_damping", "stiffness")
MOST_REFLECTED = 0.98
"""Of the reflection coefficients of the noise model; stable below 1."""
ITERATIONS = 20
METHODS = ("LS", "LSdv", "IV", "IVdv", "BJ")


@dataclass(frozen=True, slots=True)
class Presliding:
    """Result of the experiment.

    Attributes:
        estimate: inertia, presliding_damping (σ1 + σ2) and stiffness.
        comparison: every method on every set, for the figure: `comparison[method][set]`.
        time, torque, position: the first set, for the figure; deviation from its means.
        predicted: position that the estimate predicts for it.
    """

    estimate: Estimate
    comparison: dict[str, tuple[LinearFit, ...]]
    time: Floats
    torque: Floats
    position: Floats
    predicted: Floats


def identify_presliding(recording: Recording, coulomb: float | None = None) -> Presliding:
    """All methods on all sets of the recording.

    Args:
        coulomb: friction level, to check that the excitation stayed small; None if unknown.

    Raises:
        NotEnoughExcitation: too short, or the position hardly left one count.
    """
    sets = _sets(recording)
    _refuse_still(recording, sets)
    period = recording.period
    fits: list[list[LinearFit]] = []
    rough: SpringMass | None = None
    for torque, position in sets:
        fits.append(all_methods(torque, position, period, rough))
        rough = rough or fits[-1][-1].system
    comparison = {method: tuple(fit[i] for fit in fits) for i, method in enumerate(METHODS)}
    torque, position = sets[0]
    estimate = _judged(comparison["BJ"], sets, period, coulomb)
    predicted = _prediction(comparison["BJ"][0].system, torque, position, period)
    time = np.arange(len(torque)) * period
    return Presliding(
        estimate,
        comparison,
        np.asarray(time, dtype=np.float64),
        np.asarray(torque - torque.mean()),
        np.asarray(position - position.mean()),
        predicted,
    )


def _sets(recording: Recording) -> list[tuple[Floats, Floats]]:
    """Torque and position of each set; sets are equal parts of segments, about three seconds long."""
    sets: list[tuple[Floats, Floats]] = []
    for _, segment in recording.split():
        torque, position = torque_of(segment), segment["position"]
        parts = max(1, round(len(segment) * segment.period / SET_SECONDS))
        edges = np.linspace(0, len(segment), parts + 1).astype(int)
        for start, stop in itertools.pairwise(edges.tolist()):
            if stop - start >= 300:
                sets.append((torque[start:stop], position[start:stop]))
    if not sets:
        raise NotEnoughExcitation(
            f"the presliding data are too short ({len(recording)} rows); at least 300 rows of one segment "
            f"are needed, {5 * SET_SECONDS:.0f} s are good"
        )
    keep = np.unique(np.linspace(0, len(sets) - 1, min(len(sets), MOST_SETS)).astype(int))
    return [sets[i] for i in keep]


def _refuse_still(recording: Recording, sets: list[tuple[Floats, Floats]]) -> None:
    resolution = recording.metadata.position_resolution or 0.0
    span = float(np.median([np.ptp(position) for _, position in sets]))
    if span <= LEAST_COUNTS * resolution or span == 0.0:
        raise NotEnoughExcitation(
            f"in presliding the axis moved {span:.3g} only, the sensor resolves {resolution:.3g}; raise the "
            "excitation, up to a tenth of the friction torque"
        )
    if min(float(np.ptp(torque)) for torque, _ in sets) == 0.0:
        raise NotEnoughExcitation("the torque is constant in presliding; the axis was not excited")


def _judged(
    fits: tuple[LinearFit, ...], sets: list[tuple[Floats, Floats]], period: float, coulomb: float | None
) -> Estimate:
    systems = [fit.system for fit in fits if fit.system is not None]
    if len(systems) < max(1, len(fits) // 2):
        return invalid("presliding", "the motion in presliding is not that of a spring-mass system")
    table = np.array([[s.inertia, s.damping, s.stiffness] for s in systems])
    formal = np.array([fit.errors for fit in fits if fit.system is not None])
    quantities = {name: _quantity(table[:, i], formal[:, i]) for i, name in enumerate(_NAMES)}
    mean = SpringMass(*(quantities[name].value for name in _NAMES))
    error = float(np.median([_relative_error(mean, torque, position, period) for torque, position in sets]))
    reason = _complaint(quantities, sets, coulomb, error)
    return Estimate("presliding", MappingProxyType(quantities), reason == "", reason, error)


def _quantity(values: Floats, formal: Floats) -> Quantity:
    """Median over the sets; the error is the larger of their scatter and what each promises."""
    count = len(values)
    typical = float(np.median(formal)) / math.sqrt(count)
    if count < 3:
        return Quantity(float(np.mean(values)), typical, 3.2 if count == 1 else 2.8)
    scatter = float(np.std(values, ddof=1)) / math.sqrt(count)
    return Quantity(float(np.mean(values)), max(scatter, typical), float(scipy.stats.t.ppf(0.975, count - 1)))


def _complaint(
    quantities: dict[str, Quantity], sets: list[tuple[Floats, Floats]], coulomb: float | None, error: float
) -> str:
    peak = max(float(np.max(np.abs(torque - torque.mean()))) for torque, _ in sets)
    if coulomb is not None and peak > 0.5 * coulomb:
        return (
            f"the excitation of {peak:.3g} reaches {100 * peak / coulomb:.0f} % of Coulomb friction: this is "
            "not presliding; use a tenth"
        )
    wide = [name for name in ("inertia", "stiffness") if quantities[name].relative_error > 0.25]
    if wide:
        return f"{' and '.join(wide)} scatter by more than 25 % between the sets; excite longer or stronger"
    if error > 0.7:
        return (
            f"the model explains {100 * (1 - error):.0f} % of the motion only; junctions were not relaxed "
            "or the axis slid. Prepare with a decaying sine and compensate the offset"
        )
    return ""


def _prediction(system: SpringMass | None, torque: Floats, position: Floats, period: float) -> Floats:
    """Position, as deviation from its mean, with the best offset, drift and initial motion."""
    count = len(torque)
    if system is None:
        return np.full(count, math.nan)
    response = system.respond(torque - torque.mean(), period)
    trend = np.vstack([np.ones(count), np.linspace(-1.0, 1.0, count), system.free(count, period)]).T
    fitted = trend @ np.linalg.lstsq(trend, position - response, rcond=None)[0]
    return np.asarray(response + fitted - position.mean())


def _relative_error(system: SpringMass, torque: Floats, position: Floats, period: float) -> float:
    deviation = position - position.mean()
    error = deviation - _prediction(system, torque, position, period)
    return float(np.linalg.norm(error) / np.linalg.norm(deviation))


@dataclass(frozen=True, slots=True)
class LinearFit:
    """One method on one set of data; `system` is None where the method failed.

    Attributes:
        errors: standard errors of inertia, damping and stiffness, nan where the method has none.
    """

    method: str
    system: SpringMass | None
    errors: tuple[float, float, float] = (math.nan, math.nan, math.nan)


def decimation(period: float, rough: SpringMass | None = None) -> int:
    """Samples to average for the difference equation: about 20 a period of the oscillation.

    Sampled much faster, the poles crowd at 1 and noise hides them; the thesis used 3.14 ms.
    """
    natural = math.sqrt(rough.stiffness / rough.inertia) if rough else 2.0 * math.pi / (20 * 3.14e-3)
    return max(1, round(2.0 * math.pi / natural / 20.0 / period))


def least_squares_arx(torque: Floats, position: Floats, period: float) -> SpringMass | None:
    """Ordinary least squares on the difference equation."""
    design, target = _regressors(torque, position)
    return _physical(_solve(design, target), period)


def instrumental_variables(torque: Floats, position: Floats, period: float) -> SpringMass | None:
    """Iterated instrumental variables; starts from least squares on low-passed signals."""
    design, target = _regressors(torque, position)
    parameters = _solve(design, target)
    for _ in range(ITERATIONS):
        model = _physical(parameters, period) or _stabilised(parameters, period)
        if model is None:
            return None
        instruments, _ = _regressors(torque, model.respond(torque, period))
        matrix = instruments.T @ design
        if np.linalg.cond(matrix) > 1e14:
            return None
        parameters = np.asarray(np.linalg.solve(matrix, instruments.T @ target), dtype=np.float64)
    return _physical(parameters, period)


def box_jenkins(torque: Floats, position: Floats, period: float, start: SpringMass) -> LinearFit:
    """Prediction-error fit of (3.46) with coloured noise, offset, drift and initial motion free.

    First as output error, then with the noise model; the offset columns are solved for exactly in each
    step (they enter linearly).
    """
    log_start = np.log([start.inertia, max(start.damping, 1e-9 * start.inertia), start.stiffness])

    def output_error(x: Floats) -> Floats:
        return _free_residual(_system(x), torque, position, period)

    bound = np.log(100.0)
    coarse = scipy.optimize.least_squares(
        output_error, log_start, bounds=(log_start - bound, log_start + bound)
    )
    noise = _noise_model(coarse.fun)

    def prediction_error(x: Floats) -> Floats:
        colour = (stable_polynomial(*x[5:7]), stable_polynomial(*x[3:5]))
        return _free_residual(_system(x[:3]), torque, position, period, colour)

    begin = np.concatenate([coarse.x, noise])
    limits = np.concatenate([np.full(3, bound), np.full(4, MOST_REFLECTED)])
    centre = np.concatenate([log_start, np.zeros(4)])
    begin = np.clip(begin, centre - 0.999 * limits, centre + 0.999 * limits)
    fine = scipy.optimize.least_squares(
        prediction_error, begin, bounds=(centre - limits, centre + limits), max_nfev=60
    )
    system = _system(fine.x[:3])
    freedom = max(len(torque) - len(fine.x) - 4, 1)
    jacobian = np.asarray(fine.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * 2.0 * fine.cost / freedom
    relative = np.sqrt(np.maximum(np.diag(covariance)[:3], 0.0))
    errors = relative * [system.inertia, system.damping, system.stiffness]
    return LinearFit("BJ", system, (float(errors[0]), float(errors[1]), float(errors[2])))


def all_methods(torque: Floats, position: Floats, period: float, rough: SpringMass | None) -> list[LinearFit]:
    """Every method of Figure 6.12 on one set of data, arrays of shape (n,)."""
    factor = decimation(period, rough)
    u, y, h = block_mean(torque, factor), position[factor - 1 :: factor], period * factor
    # the mean torque of a block acts until its end, where the position is read: one period of delay
    u, y = u[1:], y[: len(u)][:-1]
    u_dv, y_dv = u - u.mean(), y - y.mean()
    arx: list[tuple[str, Callable[..., SpringMass | None], Floats, Floats]] = [
        ("LS", least_squares_arx, u, y),
        ("LSdv", least_squares_arx, u_dv, y_dv),
        ("IV", instrumental_variables, u, y),
        ("IVdv", instrumental_variables, u_dv, y_dv),
    ]
    fits = [LinearFit(name, method(uu, yy, h)) for name, method, uu, yy in arx]
    start = fits[3].system or fits[1].system or rough
    if start is None:
        return [*fits, LinearFit("BJ", None)]
    return [*fits, box_jenkins(torque, position, period, start)]


def _regressors(torque: Floats, position: Floats) -> tuple[Floats, Floats]:
    columns = [-position[1:-1], -position[:-2], torque[1:-1], torque[:-2]]
    return np.stack(columns, axis=1), position[2:]


def _solve(design: Floats, target: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0], dtype=np.float64)


def _physical(parameters: Floats, period: float) -> SpringMass | None:
    a1, a2, b1, b2 = (float(x) for x in parameters)
    return from_difference(a1, a2, b1, b2, period)


def _stabilised(parameters: Floats, period: float) -> SpringMass | None:
    """The nearest stable oscillation, to go on iterating from."""
    roots = np.roots([1.0, parameters[0], parameters[1]])
    radius = np.clip(np.abs(roots), 0.05, 0.98)
    angle = np.clip(np.abs(np.angle(roots)), 0.02, 3.0)[0]
    pair = float(radius.mean()) * np.exp(1j * angle)
    a1, a2 = -2.0 * float(pair.real), float(abs(pair) ** 2)
    gain = abs(float(parameters[2] + parameters[3])) / max(abs(1.0 + parameters[0] + parameters[1]), 1e-3)
    half = 0.5 * gain * (1.0 + a1 + a2)
    return from_difference(a1, a2, half, half, period)


def _system(x: Floats) -> SpringMass:
    return SpringMass(*(float(v) for v in np.exp(x[:3])))


def _free_residual(
    system: SpringMass,
    torque: Floats,
    position: Floats,
    period: float,
    noise: tuple[list[float], list[float]] | None = None,
) -> Floats:
    """Prediction error after the best offset, drift and initial motion have been taken out."""
    count = len(torque)
    level = torque.mean()
    error = position - system.respond(torque - level, period)
    loose = np.vstack([np.ones(count), np.linspace(-1.0, 1.0, count), system.free(count, period)])
    if noise is not None:
        error = np.asarray(scipy.signal.lfilter(noise[0], noise[1], error))
        loose = np.asarray(scipy.signal.lfilter(noise[0], noise[1], loose, axis=1))
    return np.asarray(error - loose.T @ np.linalg.lstsq(loose.T, error, rcond=None)[0])


def stable_polynomial(first: float, second: float) -> list[float]:
    """Polynomial 1 + c₁z⁻¹ + c₂z⁻² of two reflection coefficients, stable where both are within ±1."""
    return [1.0, first * (1.0 + second), second]


def _noise_model(error: Floats) -> Floats:
    """Starting reflection coefficients of C and D: an autoregression of second order (1/D)."""
    design = np.stack([-error[1:-1], -error[:-2]], axis=1)
    d = np.linalg.lstsq(design, error[2:], rcond=None)[0]
    second = float(np.clip(d[1], -0.9, 0.9))
    return np.array([0.0, 0.0, float(np.clip(d[0] / (1.0 + second), -0.95, 0.95)), second])
