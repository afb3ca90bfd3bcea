"""Stage `adapt`: the thesis's laws until they settle (section 5.1.4), then refinement step by step."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from autotune.control.adaptation import AdaptationResult, AdaptiveFeedforward, Bounds
from autotune.control.feedforward import FeedforwardLaw, FixedFeedforward, LugreParameters
from autotune.control.refinement import PeriodAverage, refine
from autotune.core.errors import NotEnoughExcitation
from autotune.experiments.sines import AdaptiveSine, BenchmarkSine
from autotune.recordings.recording import Recording
from autotune.tuning.convergence import Convergence
from autotune.tuning.proof import fold
from autotune.tuning.session import Session

LONGEST_SECONDS, LEAST_SECONDS = 60.0, 25.0
REFINEMENT_STEPS = 4
REFINEMENT_PERIODS = 6
LEAST_GAIN = 0.03  # predicted, for which another step is worth its machine time
WORSE = 1.1  # measured, at which refinement gives up


@dataclass(frozen=True, slots=True)
class RefinementStep:
    """One measured step: parameters in force and the error that they gave [motion unit].

    `peak_error` comes in fractions of a sensor count; `smooth_peak`, the 8-norm, tells steps apart.
    """

    parameters: LugreParameters
    measured: PeriodAverage = field(repr=False)
    window: Recording = field(repr=False)

    @property
    def peak_error(self) -> float:
        return self.measured.peak_error

    @property
    def smooth_peak(self) -> float:
        return self.measured.smooth_peak


@dataclass(frozen=True, slots=True)
class Adapted:
    """What the stage found: the laws alone, then each refinement step; `best` goes to the proof."""

    laws: AdaptationResult
    steps: tuple[RefinementStep, ...]

    @property
    def best(self) -> RefinementStep:
        return min(self.steps, key=lambda step: step.smooth_peak)


def adapt(
    session: Session, start: LugreParameters, stiffness_range: tuple[float, float], reserve: float = 0.0
) -> Adapted:
    """Adapts and refines from the identified values.

    Args:
        session: of the run.
        start: identified parameters; `stiffness` somewhere inside `stiffness_range`.
        stiffness_range: bounds of the stiffness, from what presliding and Dahl's curve say.
        reserve: machine time that must be left afterwards [s].

    Raises:
        NotEnoughExcitation: adaptation gave nothing that may be used.
    """
    steps = REFINEMENT_STEPS * (REFINEMENT_PERIODS + 3) / session.axis.benchmark.frequency
    session.begin("adapt", LONGEST_SECONDS + steps)
    bounds = Bounds.around(start, stiffness_range)
    law = AdaptiveFeedforward(start, bounds, session.axis.benchmark.frequency, session.axis.cycle)
    left = session.budget.left - reserve - 2.0 * window_seconds(session.axis.benchmark.frequency)
    longest = min(max(left, LEAST_SECONDS), LONGEST_SECONDS)
    sine = AdaptiveSine(session.motion, law, longest)
    shown = (
        Convergence(law, sine, session.observers, session.axis.motion_unit).watch
        if session.observers
        else None
    )
    _, played = session.play("adaptation", [sine], shown)
    settled = played.result("adaptation")
    if not isinstance(settled, AdaptiveFeedforward):
        raise NotEnoughExcitation("the adaptation gave no result; run again")
    laws = settled.result()
    if not laws.valid:
        session.reporter.say(f"adaptation: {laws.reason}")
    return Adapted(laws, tuple(_refine(session, laws.parameters, bounds, reserve)))


def _refine(session: Session, start: LugreParameters, bounds: Bounds, reserve: float) -> list[RefinementStep]:
    """Measures, predicts a better step, measures again; ends where the next gains next to nothing."""
    current = start
    done: list[RefinementStep] = []
    for number in range(REFINEMENT_STEPS + 1):
        law = FixedFeedforward(current, session.axis.cycle)
        window = measure_window(session, law, f"refinement-{number}", number)
        measured = period_average(window, session.axis.benchmark.frequency)
        done.append(RefinementStep(current, measured, window))
        worse = measured.smooth_peak > WORSE * min(step.smooth_peak for step in done)
        if worse or number == REFINEMENT_STEPS or session.controller is None:
            break
        if session.budget.left < reserve + window_seconds(session.axis.benchmark.frequency):
            break
        low, high = limits_of(current, bounds)
        proposed = refine(measured, current, session.controller, low, high)
        if proposed.predicted_smooth_peak > (1.0 - LEAST_GAIN) * measured.smooth_peak:
            break
        current = proposed.parameters
    return done


def window_seconds(frequency: float) -> float:
    """Machine time of one measured step, with its way there and its fading in and out [s]."""
    return (REFINEMENT_PERIODS + 2) / frequency + 1.0


def measure_window(session: Session, law: FeedforwardLaw, name: str, number: int) -> Recording:
    """Whole periods of the benchmark with a law in force."""
    sine = BenchmarkSine(session.motion, 1, REFINEMENT_PERIODS, law, first_repeat=number, label="refinement")
    recording, _ = session.play(name, [sine])
    return recording.select("refinement")


def period_average(window: Recording, frequency: float) -> PeriodAverage:
    """Averages whole periods of a window of the benchmark."""
    samples = round(1.0 / (frequency * window.period))
    errors = fold(window["reference"] - window["position"], samples)
    spread = float(np.sqrt(errors.var(axis=0, ddof=1).mean() / len(errors))) if len(errors) > 1 else 0.0
    average = {
        name: fold(window[name], samples).mean(axis=0)
        for name in ("reference", "position", "torque_feedback", "torque_feedforward")
    }
    return PeriodAverage(
        average["reference"],
        average["reference"] - average["position"],
        average["torque_feedback"],
        average["torque_feedforward"],
        window.period,
        len(window) // samples,
        spread,
    )


def limits_of(current: LugreParameters, bounds: Bounds) -> tuple[LugreParameters, LugreParameters]:
    """Bounds of the refinement: those of the adaptation, and a factor of 4 in micro-damping."""
    (low_s, high_s), (low_c, high_c), (low_o, high_o) = bounds.stiffness, bounds.coulomb, bounds.offset
    ratio = current.break_away / current.coulomb
    damping = max(current.micro_damping, 1e-3 * current.stiffness)
    low = replace(
        current,
        stiffness=low_s,
        coulomb=low_c,
        offset=low_o,
        break_away=low_c * ratio,
        micro_damping=damping / 4.0,
    )
    high = replace(
        current,
        stiffness=high_s,
        coulomb=high_c,
        offset=high_o,
        break_away=high_c * ratio,
        micro_damping=damping * 4.0,
    )
    return low, high


def starting_stiffness(presliding: float, dahl: float) -> tuple[float, tuple[float, float]]:
    """Where to start, and the bounds, from the two experiments that know the stiffness at rest.

    Where friction has several elastic elements, presliding sees them all (the stiffest value) and
    Dahl's curve mostly the soft ones; what serves the benchmark lies between. nan: not known.
    """
    known = [value for value in (presliding, dahl) if math.isfinite(value) and value > 0.0]
    if not known:
        raise NotEnoughExcitation(
            "neither presliding nor Dahl's curve gave a stiffness; look at their reasons"
        )
    low, high = min(known), max(known)
    return float(np.sqrt(low * high)), (low / 3.0, high * 1.5)
