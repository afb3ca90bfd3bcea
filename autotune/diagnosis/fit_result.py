"""A fitted model and all that is known about it: for programs, for people, for a notebook."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from autotune.core.documents import finite
from autotune.core.tables import frame, html_table
from autotune.core.units import percent
from autotune.diagnosis.compare import ClosedLoop, UnseenError
from autotune.identify.dahl import Complexity
from autotune.identify.estimate import Estimate
from autotune.identify.run import Identification
from autotune.identify.steady_state import SteadyState
from autotune.models.as_json import parameters_json
from autotune.models.drive_model import DriveModel

if TYPE_CHECKING:
    import pandas as pd

BEYOND_SPEEDS = ("inertia", "stiffness", "micro_damping")


@dataclass(frozen=True, slots=True, repr=False)
class FitResult:
    """A fitted model and all that is known about it.

    Attributes:
        method: `programme`, `twin`, `speed_curve` or `search`.
        estimate: by surface name, with intervals where they are known.
        error_rms: of the model on the recordings, as `compare` finds it; the estimate's relative error is that too.
        refinement_relative_error: of the refinement alone: the rows that it fitted, in its own bands.
        unseen: error on what the fit has not seen; None where unknown.
        found: the single experiments, where they were made.
        steady: the curve over constant speeds, where the recordings hold nothing else or the programme's.
        loop: the model in closed loop; None where there is no model, or only a speed curve.
        questions: about units that may have been declared wrongly; among the notes too.
    """

    model: DriveModel | None
    method: str
    estimate: Estimate
    notes: tuple[str, ...]
    error_rms: float | None = None
    refinement_relative_error: float = math.nan
    unseen: UnseenError | None = None
    complexity: Complexity | None = None
    found: Identification | None = None
    loop: ClosedLoop | None = None
    steady: SteadyState | None = None
    questions: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        return self.model is not None and self.estimate.valid

    @property
    def not_identified(self) -> list[str]:
        names = [name for name, quantity in self.estimate.parameters.items() if not quantity.identified]
        return [*BEYOND_SPEEDS, *names] if self.method == "speed_curve" else names

    @property
    def relative_error(self) -> float:
        """Norm of the error over the norm of the torque; nan where unknown."""
        return self.estimate.relative_error

    @property
    def reason(self) -> str:
        """Why the model must not be used, or what limits it."""
        return self.estimate.reason

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """One row a parameter: name, value, standard error, unit, ends of the 95 % interval, identified."""
        return [] if self.model is None else _rows(self.model, self.estimate)

    def to_json(self) -> dict[str, Any]:
        """The object of `autotune model fit --json`; what is not a finite number is None."""
        content: dict[str, Any] = finite(_content(self))
        return content

    def to_frame(self) -> pd.DataFrame:
        """The parameters as a pandas table, by name."""
        return frame(self.parameters, "name")

    def __repr__(self) -> str:
        lines = [
            f"  {row['name']:<28} {row['value']:.5g} {row['unit']}{_spread(row)}" for row in self.parameters
        ]
        return "\n".join([f"FitResult by {self.method}: {summary(self)}", *lines])

    def _repr_html_(self) -> str:
        return html_table(summary(self), self.parameters)


def summary(result: FitResult) -> str:
    """One or two sentences for the top of a page."""
    relative = result.estimate.relative_error
    parts = [
        f"The model leaves {percent(relative)} % of the torque unexplained."
        if math.isfinite(relative)
        else ""
    ]
    if not result.valid:
        parts.append(f"It must not be used: {result.estimate.reason}.")
    elif result.estimate.reason:
        parts.append(f"{result.estimate.reason}.")
    if result.complexity is not None:
        text = result.complexity.text
        parts.append(f"{text[0].upper()}{text[1:]}.")
    return " ".join(part for part in parts if part)


def _rows(model: DriveModel, estimate: Estimate) -> list[dict[str, Any]]:
    rows = []
    for name, value in model.parameters.items():
        found = estimate.parameters.get(name)
        low, high = found.interval if found is not None else (None, None)
        row: dict[str, Any] = {"name": name, "value": value.value, "standard_error": value.standard_error}
        known = found.identified if found is not None else True
        rows.append(row | {"unit": model.unit(name), "low": low, "high": high, "identified": known})
    return rows


def _spread(row: Mapping[str, Any]) -> str:
    if not row["identified"]:
        return "  not identified"
    return "" if row["standard_error"] is None else f"  ± {row['standard_error']:.2g}"


def _content(result: FitResult) -> dict[str, Any]:
    return {
        "parameters": parameters_json(result.model) if result.model is not None else {},
        "valid": result.valid,
        "reason": result.estimate.reason,
        "error_rms": result.error_rms,
        "relative_error": result.estimate.relative_error,
        "refinement_relative_error": result.refinement_relative_error,
        "method": result.method,
        "intervals": {
            name: list(q.interval)
            for name, q in result.estimate.parameters.items()
            if math.isfinite(q.standard_error)
        },
        "not_identified": result.not_identified,
        "complexity": _complexity_json(result.complexity),
        "closed_loop": _loop_json(result.loop),
        "steady_state": _steady_json(result.steady),
        "experiments": _experiments_json(result.found),
        "questions": list(result.questions),
        "notes": list(result.notes),
    }


def least_torque_speeds(steady: SteadyState) -> dict[str, float]:
    """Speed of the measured point with the least torque, in each direction [rad/s or m/s]."""
    speeds, torque = steady.points.velocity, steady.points.torque
    found = {}
    for name, sign in (("positive", 1.0), ("negative", -1.0)):
        there = np.flatnonzero(sign * speeds > 0.0)
        if len(there):
            found[name] = float(speeds[there[np.argmin(sign * torque[there])]])
    return found


def least_torque_line(steady: SteadyState, motion_unit: str) -> str:
    """Where friction at constant speed is least, in words."""
    texts = []
    for value in least_torque_speeds(steady).values():
        turns = f" ({value * 30.0 / math.pi:.3g} rpm)" if motion_unit == "rad" else ""
        texts.append(f"{value:.3g} {motion_unit}/s{turns}")
    return f"friction at constant speed, {len(steady.points)} points, is least at " + " and ".join(texts)


def _steady_json(steady: SteadyState | None) -> dict[str, Any] | None:
    if steady is None:
        return None
    return {
        "velocity": steady.points.velocity.tolist(),
        "torque": steady.points.torque.tolist(),
        "standard_error": steady.points.standard_error.tolist(),
        "least_torque_at": least_torque_speeds(steady),
        "shapes": [{"shape": curve.shape, "held_out_rms": curve.held_out_rms} for curve in steady.curves],
    }


def _loop_json(loop: ClosedLoop | None) -> dict[str, float] | None:
    """Position and torque of the model in the loop on the recorded references, against the measured ones."""
    if loop is None or not math.isfinite(loop.relative_position_error):
        return None
    return {
        "relative_position_error": loop.relative_position_error,
        "relative_torque_error": loop.relative_torque_error,
    }


def _complexity_json(complexity: Complexity | None) -> dict[str, Any] | None:
    if complexity is None:
        return None
    return {
        "displacement": complexity.displacement.value,
        "displacement_interval": list(complexity.displacement.interval),
        "precision": complexity.precision,
        "model": "lugre" if complexity.lugre_needed else "kinetic",
        "peak_difference": complexity.peak_difference,
        "duration": complexity.duration,
        "text": complexity.text,
    }


def _experiments_json(found: Identification | None) -> dict[str, Any]:
    if found is None:
        return {}
    return {
        name: {
            "valid": estimate.valid,
            "reason": estimate.reason,
            "parameters": {
                key: {"value": q.value, "standard_error": q.standard_error}
                for key, q in estimate.parameters.items()
            },
        }
        for name, estimate in found.estimates.items()
    }
