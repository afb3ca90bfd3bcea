"""One scale on all friction (5.11), (5.12): what a preload, a temperature, another day do, as one number.

With ż = q̇ − θ·|q̇|/g·z the steady level is 1/θ times the model's. From the legs of a check:

    T_i = F_g' + (1/θ)·σ0 g(v_i)·sign v_i + σ2 v_i

weighted least squares for F_g' and 1/θ; then once more with σ2 free. Where the first leaves what the second does not
(F test, 1 %), friction has not only been scaled. What did it shows in how it came: heat goes with the temperature,
by so much a kelvin as the history of checks tells; a preload, or fresh grease, comes at once; wear creeps, or changes
the shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
import scipy

from autotune.control.steady_curves import friction_at
from autotune.core.arrays import Floats
from autotune.identify.steady_state import Points
from autotune.models.drive_model import DriveModel
from autotune.monitoring.trend import Change

LEAST_POINTS = 6
CHANCE = 0.01
CHANGED = 0.03
"""Of friction: less is one day and another."""
WARMER = 5.0
"""K: a temperature that differs by less does not explain a change."""
PER_KELVIN = 0.02
"""Relative: more than this a temperature does not do, where the history does not tell how much."""
UNKNOWN, AT_ONCE, CREPT = "", "at once", "crept"


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


@dataclass(frozen=True, slots=True)
class Background:
    """What is known beside one check.

    Attributes:
        warmer: temperature now less that at which the model holds [K]; nan where not known.
        coefficient: of friction a kelvin, relative, where the history of checks tells it.
        course: how friction has changed since the model was made, its temperature taken out: `AT_ONCE`, `CREPT`, or
            `UNKNOWN` where the history is too short to tell, or shows nothing.
    """

    warmer: float = math.nan
    coefficient: float | None = None
    course: str = UNKNOWN

    def heat(self, change: float) -> float:
        """The part of a relative change that the temperature explains."""
        if not math.isfinite(self.warmer):
            return 0.0
        if self.coefficient is not None:
            return self.coefficient * self.warmer
        explained = abs(self.warmer) >= WARMER and (self.warmer < 0.0) == (change > 0.0)
        return math.copysign(min(abs(change), PER_KELVIN * abs(self.warmer)), change) if explained else 0.0


def course_of(changes: Sequence[Change], since: datetime | None, rises: bool) -> str:
    """How friction came to be higher (`rises`) or lower than the model's, made at `since`: the largest such change."""
    mine = [
        one
        for one in changes
        if one.kind in ("step", "trend")
        and (one.size > 0.0) == rises
        and (since is None or (one.until or one.at) > since or (one.kind == "trend" and one.until is None))
    ]
    if not mine:
        return UNKNOWN
    return AT_ONCE if max(mine, key=lambda one: abs(one.size)).kind == "step" else CREPT


def scale_in_words(scale: FrictionScale, known: Background) -> str:
    """What has happened to friction as a whole, and its cause; "" where nothing has."""
    change = 1.0 / scale.theta - 1.0
    sure = max(CHANGED, 2.0 * scale.standard_error / scale.theta**2)
    if abs(change) < sure:
        return ""
    direction = "higher" if change > 0 else "lower"
    said = f"all friction is {100 * abs(change):.0f} % {direction} than the model's (θ = {scale.theta:.3f})"
    heat = known.heat(change)
    rest = (1.0 + change) / max(1.0 + heat, 0.2) - 1.0
    if heat and abs(rest) < sure:
        colder = "less" if known.warmer < 0 else "more"
        return f"{said} at {abs(known.warmer):.0f} K {colder}: the temperature."
    if abs(heat) >= sure:
        said += f", {100 * abs(rest):.0f} % {'higher' if rest > 0 else 'lower'} at the same temperature"
    return f"{said}{_cause(scale.enough, known.course, rest > 0)}"


def _cause(enough: bool, course: str, rises: bool) -> str:
    """What did it, by how it came and whether its shape is kept."""
    if course == CREPT:
        return (
            "; it crept there: wear, or a lubricant that ages." if rises else "; it crept there: running in."
        )
    if course == AT_ONCE:
        if rises:
            return (
                "; it came at once: the preload. One scale corrects it."
                if enough
                else ("; it came at once, and its shape has changed too: another lubricant, or damage.")
            )
        return "; it came at once: less preload, or fresh grease. One scale corrects it."
    if not enough:
        return ", and its shape has changed too: that is wear or another lubricant, not preload alone."
    return ", with its shape kept and no such change of temperature: the preload. One scale corrects it."
