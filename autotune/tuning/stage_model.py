"""The feedforward of the diagnosed model: measured, refined on what is measured, and chosen or not.

It is chosen only where it is better than the refined LuGre feedforward beyond doubt on the benchmark; the
proof against the axis as it was comes after that, as for any other change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from autotune.control.model_feedforward import (
    ModelFeedforward,
    beyond_lugre,
    fed_forward,
    periodic_model_feedforward,
)
from autotune.control.model_refinement import refine_model
from autotune.control.refinement import PeriodAverage, periodic_feedforward
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording
from autotune.tuning.proof import fold
from autotune.tuning.session import Session
from autotune.tuning.stage_adapt import RefinementStep, measure_window, period_average, window_seconds

MOST_WINDOWS = 3
LEAST_GAIN = 0.1  # predicted, for which another step is worth its machine time
FARTHEST = 0.5  # of the torque of the LuGre feedforward
LEAST_MEASURED = 0.05  # gain of the step before, without which there is no other


@dataclass(frozen=True, slots=True)
class ModelStep:
    """One measured step: the model in force and the error that its feedforward gave."""

    model: DriveModel
    measured: PeriodAverage = field(repr=False)
    window: Recording = field(repr=False)


@dataclass(frozen=True, slots=True)
class ModelAdapted:
    """What the model's feedforward gave. `chosen`: it goes to the proof; `reason`: why, or why not."""

    steps: tuple[ModelStep, ...]
    chosen: bool
    reason: str

    @property
    def best(self) -> ModelStep:
        return min(self.steps, key=lambda step: step.measured.smooth_peak)


def adapt_model(
    session: Session, model: DriveModel, rival: RefinementStep, reserve: float
) -> ModelAdapted | None:
    """Measures the feedforward of a diagnosed model, refines it, and compares it with the refined LuGre one.

    Args:
        model: with the effects that were named.
        rival: the best LuGre step.
        reserve: machine time that must be left afterwards [s].

    Returns:
        None where the model has nothing that the LuGre feedforward lacks, or there is no machine time left.
    """
    if not fed_forward(model).effects and not beyond_lugre(model):
        return None
    if not plausible(model, rival, session.limits.torque):
        session.reporter.say(
            "the feedforward of the diagnosed model is far from the one that was measured; it is not played"
        )
        return None
    steps: list[ModelStep] = []
    current: DriveModel | None = model
    while current is not None and len(steps) < MOST_WINDOWS:
        if session.budget.left < reserve + window_seconds(session.axis.benchmark.frequency):
            break
        steps.append(_measured(session, current, len(steps)))
        current = _next(session, steps)
    if not steps:
        return None
    best = min(steps, key=lambda step: step.measured.smooth_peak)
    chosen, reason = beats(best.window, rival.window, session)
    return ModelAdapted(tuple(steps), chosen, reason)


def plausible(model: DriveModel, rival: RefinementStep, limit: float) -> bool:
    """Whether the model's torque is near enough to what was played already to be tried on the axis.

    A diagnosis that went wrong must not be found out by an impact: the difference may be half of the torque
    that is known to be right, and the whole must leave the controller a tenth of the limit.
    """
    reference, period = rival.measured.reference, rival.measured.period
    whole = periodic_model_feedforward(model, reference, period)
    known = periodic_feedforward(rival.parameters, reference, period)
    apart = float(np.max(np.abs(whole - known)))
    return apart < FARTHEST * float(np.max(np.abs(known))) and float(np.max(np.abs(whole))) < 0.9 * limit


def beats(one: Recording, other: Recording, session: Session) -> tuple[bool, str]:
    """Whether one window has less error than another beyond doubt, and a sentence.

    The mean square error of each period is one sample (Welch's test); the peak of the averages decides too,
    as that is what the proof goes by.
    """
    frequency = session.axis.benchmark.frequency
    squares = [_mean_squares(window, frequency) for window in (one, other)]
    doubt = float(scipy.stats.ttest_ind(squares[0], squares[1], equal_var=False, alternative="less").pvalue)
    peaks = [period_average(window, frequency).peak_error for window in (one, other)]
    better = doubt < 1.0 - session.axis.acceptance.confidence and peaks[0] < peaks[1]
    unit = session.axis.motion_unit
    told = f"{1e3 * peaks[0]:.2f} m{unit} against {1e3 * peaks[1]:.2f} m{unit} of the LuGre feedforward"
    return better, f"{told}: {'better beyond doubt' if better else 'not better beyond doubt'}"


def _mean_squares(window: Recording, frequency: float) -> Floats:
    samples = round(1.0 / (frequency * window.period))
    errors = fold(window["reference"] - window["position"], samples)
    return np.asarray(np.mean(errors**2, axis=1))


def _measured(session: Session, model: DriveModel, number: int) -> ModelStep:
    law = ModelFeedforward(model, session.axis.cycle)
    window = measure_window(session, law, f"model-{number}", number)
    return ModelStep(model, period_average(window, session.axis.benchmark.frequency), window)


def _next(session: Session, steps: Sequence[ModelStep]) -> DriveModel | None:
    """A model that is predicted to be clearly better than the last one; None where there is none."""
    last = steps[-1]
    if session.controller is None:
        return None
    before = min((step.measured.smooth_peak for step in steps[:-1]), default=math.inf)
    if last.measured.smooth_peak > (1.0 - LEAST_MEASURED) * before:
        return None
    # sensor and target are whole counts, met at the same places in every period: that does not average out
    noise = math.hypot(last.measured.noise, session.axis.position_resolution / math.sqrt(6.0))
    proposed = refine_model(last.measured, last.model, session.controller, session.limits.torque, noise)
    if proposed is None or proposed.predicted_smooth_peak > (1.0 - LEAST_GAIN) * last.measured.smooth_peak:
        return None
    return proposed.model
