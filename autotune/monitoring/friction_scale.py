"""One scale on all friction (5.11), (5.12): what a preload, a temperature, another day do, as one number.

With ż = q̇ − θ·|q̇|/g·z the steady level is 1/θ times the model's. From the legs of a check:

    T_i = F_g' + (1/θ)·σ0 g(v_i)·sign v_i + σ2 v_i

weighted least squares for F_g' and 1/θ; then once more with σ2 free. Where the first leaves what the second does not
(F test, 1 %), friction has not only been scaled. One number explains a changed preload (θ at the same temperature) or
a changed temperature (θ that went with it); wear changes the shape as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.control.steady_curves import friction_at
from autotune.core.arrays import Floats
from autotune.identify.characteristic import Points
from autotune.models.drive_model import DriveModel

LEAST_POINTS = 6
CHANCE = 0.01
CHANGED = 0.03
"""Of friction: less is one day and another."""
WARMER = 5.0
"""K: a temperature that differs by less does not explain a change."""


@dataclass(frozen=True, slots=True)
class FrictionScale:
    """θ of (5.11) with its standard error, and whether it is the whole story.

    Attributes:
        theta: the model's friction level over today's: above 1 friction has fallen.
        enough: a scale alone explains the legs as well as a scale and another viscous friction do.
        rest: torque that the scale leaves, rms [N m or N]; floor: what the points' own scatter would leave.
    """

    theta: float
    standard_error: float
    enough: bool
    rest: float
    floor: float

    def as_json(self) -> dict[str, float | bool]:
        return {
            "theta": self.theta,
            "standard_error": self.standard_error,
            "enough": self.enough,
            "rest": self.rest,
            "floor": self.floor,
        }


def friction_scale(points: Points, model: DriveModel) -> FrictionScale | None:
    """θ from the legs of a check; None where there are too few points, one direction, or no friction."""
    v = points.velocity
    if len(v) < LEAST_POINTS or not (v > 0).any() or not (v < 0).any():
        return None
    speed = np.abs(v)
    level = friction_at(model, speed) - model["viscous"] * speed
    if not np.all(np.isfinite(level)) or float(np.max(level)) <= 0.0:
        return None
    shape, line = level * np.sign(v), model["viscous"] * v
    one, left = _solved([np.ones_like(v), shape], points.torque - line, points.standard_error)
    _, less = _solved([np.ones_like(v), shape, v], points.torque - line, points.standard_error)
    part, error = one[1]
    if not part > 0.0:
        return None
    free = len(v) - 3
    ratio = max(left - less, 0.0) / max(less / free, 1e-12)
    rest = points.torque - line - one[0][0] - part * shape
    return FrictionScale(
        1.0 / part,
        error * math.sqrt(max(left / (len(v) - 2), 1.0)) / part**2,
        bool(scipy.stats.f.sf(ratio, 1, free) > CHANCE),
        float(np.sqrt(np.mean(rest**2))),
        float(np.sqrt(np.mean(points.standard_error**2))),
    )


def _solved(columns: list[Floats], target: Floats, errors: Floats) -> tuple[list[tuple[float, float]], float]:
    """Weighted least squares: (value, standard error) of each column, and the weighted sum of squares left."""
    design = np.column_stack(columns) / errors[:, None]
    inverse = np.linalg.pinv(design.T @ design)
    solution = inverse @ (design.T @ (target / errors))
    rest = target / errors - design @ solution
    spread = np.sqrt(np.diag(inverse))
    return [(float(a), float(b)) for a, b in zip(solution, spread, strict=True)], float(rest @ rest)


def scale_in_words(scale: FrictionScale, warmer: float) -> str:
    """What has happened to friction as a whole; "" where nothing has.

    Args:
        warmer: temperature now less that at which the model holds [K]; nan where not known.
    """
    change = 1.0 / scale.theta - 1.0
    if abs(change) < max(CHANGED, 2.0 * scale.standard_error / scale.theta**2):
        return ""
    direction = "higher" if change > 0 else "lower"
    sentence = (
        f"all friction is {100 * abs(change):.0f} % {direction} than the model's (θ = {scale.theta:.3f})"
    )
    if not scale.enough:
        return f"{sentence}, and its shape has changed too: that is wear or another lubricant, not preload alone."
    if math.isfinite(warmer) and abs(warmer) >= WARMER and (warmer < 0) == (change > 0):
        colder = "less" if warmer < 0 else "more"
        return f"{sentence}, with its shape kept, at {abs(warmer):.0f} K {colder}: the temperature."
    return f"{sentence}, with its shape kept and no such change of temperature: the preload. One scale corrects it."
