"""Small displacements about relaxed junctions (section 3.4.3): inertia, σ1 + σ2 and stiffness at rest.

The data are cut into sets, each analysed by every method of Figure 6.12; the estimate is the mean of
Box–Jenkins over the sets, its error what the sets scatter by.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.small_motion import SpringMass
from autotune.identify.estimate import Estimate, Quantity, invalid
from autotune.identify.linear_methods import METHODS, LinearFit, all_methods
from autotune.recordings.checks import torque_of
from autotune.recordings.recording import Recording

SET_SECONDS = 3.0
MOST_SETS = 15
LEAST_COUNTS = 2.0
_NAMES = ("inertia", "presliding_damping", "stiffness")


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
