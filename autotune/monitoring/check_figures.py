"""What the recordings of a check say: friction with its error, tracking, temperature, signal quality."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.control.steady_curves import AT_ZERO, friction_at
from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.core.units import torque_symbol
from autotune.identify.steady_state import Points, steady_points
from autotune.models.drive_model import DriveModel
from autotune.monitoring.friction_scale import FrictionScale, friction_scale
from autotune.recordings.recording import Recording, concatenate
from autotune.tuning.proof import TrackingError, fold, tracking_error

QUANTILE = 1.96
PLACES = 32


@dataclass(frozen=True, slots=True)
class Figure:
    """A number with its standard error."""

    value: float
    standard_error: float
    unit: str

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval."""
        reach = QUANTILE * self.standard_error
        return self.value - reach, self.value + reach


@dataclass(frozen=True, slots=True)
class Tracking:
    """The benchmark: figures of merit, and how far single periods scatter [motion unit]."""

    error: TrackingError
    spread: float


@dataclass(frozen=True, slots=True)
class CheckFigures:
    """All that one check measured.

    Attributes:
        level: mean friction over the speeds played [N m or N]; the figure that drift is judged by.
        parameters: coulomb, viscous, offset where the legs tell them.
        expected: what the committed model says `level` should be; None without a model.
        tracking: as the drive runs; `uncompensated`: its own feedforward off.
        temperature: median [°C], nan where the drive tells none.
        position_noise: rms of the second difference of position over √6, on the legs [motion unit].
        torque_noise: scatter of torque within the legs [N m or N].
        missed, samples: cycles lost, and played.
        scale: of all friction against the committed model's (5.11); None without a model.
    """

    level: Figure
    parameters: dict[str, Figure]
    expected: float | None
    tracking: Tracking
    uncompensated: Tracking
    temperature: float
    position_noise: float
    torque_noise: float
    missed: int
    samples: int
    scale: FrictionScale | None = None


def figures(
    legs: Recording,
    compensated: Recording,
    uncompensated: Recording,
    frequency: float,
    model: DriveModel | None,
) -> CheckFigures:
    """Evaluates a check.

    Raises:
        NotEnoughExcitation: the legs cannot tell friction.
    """
    moving = legs.select("steady_state")
    points = steady_points(moving)
    torque = torque_symbol(legs.metadata.motion_unit)
    level = friction_level(points)
    whole = concatenate([legs, compensated, uncompensated])
    units = {"coulomb": torque, "offset": torque, "viscous": torque + " s/" + legs.metadata.motion_unit}
    return CheckFigures(
        Figure(*level, torque),
        {name: Figure(*found, units[name]) for name, found in straight_line(points).items()},
        expected_level(model, points, _places(moving)) if model is not None else None,
        _tracking(compensated, frequency),
        _tracking(uncompensated, frequency),
        _temperature(whole),
        position_noise(moving),
        _torque_noise(moving),
        int(whole.missed.sum()),
        len(whole),
        friction_scale(points, model) if model is not None else None,
    )


def friction_level(points: Points) -> tuple[float, float]:
    """Half the difference of mean torque up and mean torque down, with its standard error [N m or N].

    Raises:
        NotEnoughExcitation: one direction is missing, or the torque does not oppose the motion.
    """
    up, down = points.velocity > 0, points.velocity < 0
    if not up.any() or not down.any():
        raise NotEnoughExcitation(
            "the check moved in one direction only; friction cannot be told from offset"
        )
    level = 0.5 * float(points.torque[up].mean() - points.torque[down].mean())
    error = points.standard_error
    variance = sum(float(np.sum(error[side] ** 2)) / int(side.sum()) ** 2 for side in (up, down))
    if not math.isfinite(level) or level <= 0.0:
        raise NotEnoughExcitation(
            f"the friction measured is {level:.3g}, which cannot be; check the torque signal of the drive"
        )
    return level, 0.5 * math.sqrt(variance)


def straight_line(points: Points) -> dict[str, tuple[float, float]]:
    """Coulomb, viscous and offset with their standard errors: T = F_c sgn v + σ2 v + F_g, weighted."""
    v = points.velocity
    design = np.column_stack([np.sign(v), v, np.ones_like(v)]) / points.standard_error[:, None]
    target = points.torque / points.standard_error
    inverse = np.linalg.pinv(design.T @ design)
    solution = inverse @ (design.T @ target)
    free = max(len(v) - 3, 1)
    scale = max(float(np.sum((target - design @ solution) ** 2)) / free, 1.0)
    errors = np.sqrt(scale * np.diag(inverse))
    names = ("coulomb", "viscous", "offset")
    return {name: (float(solution[i]), float(errors[i])) for i, name in enumerate(names)}


def expected_level(model: DriveModel, points: Points, places: Floats = AT_ZERO) -> float:
    """What the model says that `friction_level` would give at the same speeds [N m or N].

    `places`: where the legs have gone; friction that depends on the place is averaged over them.
    """
    torque = friction_at(model, points.velocity, places)
    sides = [torque[points.velocity > 0], torque[points.velocity < 0]]
    return 0.5 * float(sum(side.mean() for side in sides))


def _places(legs: Recording) -> Floats:
    """Where the legs have been, in equal shares of their time."""
    return np.quantile(legs["position"], (np.arange(PLACES) + 0.5) / PLACES)


def position_noise(legs: Recording) -> float:
    """Roughness of the position signal while the axis moves evenly: about 0.4 counts on a sound encoder."""
    parts = [np.diff(segment["position"], 2) for _, segment in legs.split() if len(segment) > 16]
    if not parts:
        return math.nan
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2) / 6.0))


def _torque_noise(legs: Recording) -> float:
    scatter = [float(np.std(np.diff(part["torque"]))) for _, part in legs.split() if len(part) > 16]
    return float(np.median(scatter)) / math.sqrt(2.0) if scatter else math.nan


def _temperature(recording: Recording) -> float:
    values = recording["temperature"] if "temperature" in recording else np.zeros(0)
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else math.nan


def _tracking(window: Recording, frequency: float) -> Tracking:
    error = tracking_error([window], frequency)
    samples = round(1.0 / (frequency * window.period))
    peaks = np.abs(fold(window["reference"] - window["position"], samples)).max(axis=1)
    return Tracking(error, _spread(peaks))


def _spread(peaks: Floats) -> float:
    return float(np.std(peaks, ddof=1)) if len(peaks) > 1 else 0.0
