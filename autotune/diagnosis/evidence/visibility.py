"""Could a single recording show an effect, with the parameters that were fitted?

A fit whose parameters lie where the recording cannot show the effect is something else in disguise: play below the
encoder's count, a warming within seconds, a resonance beyond what is compared. What an effect needs is among the
traits of its `Kind`.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.diagnosis.candidates import ScreenedCandidate
from autotune.estimation.bandwidth import loud_below
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.data import FASTEST, compared_below
from autotune.estimation.problem import Problem
from autotune.models.effect import Kind
from autotune.models.table import EFFECTS

FLANK = 3.0
"""Times the cut-off: motor and load that ring above it change the torque that is compared by less than a ninth of what
the load's inertia takes, which a current loop's lag does too."""
STILL, SHORTEST_REST = 0.002, 0.05
"""Of the largest speed: slower is rest; and the time [s] that a reversal takes too."""
TIME_CONSTANTS = 2.0
"""Of a warming: a recording that holds fewer shows a slope."""


def visible(problem: Problem, item: ScreenedCandidate) -> bool:
    """Whether this recording could show the effect with the parameters that were fitted."""
    kind = EFFECTS[item.effect]
    if kind.quick and problem.data.filtered:
        return False
    too_slow = highest_frequency(problem) > problem.policy.beyond * resolved_frequency(problem)
    if too_slow and not kind.of_place:
        return False
    return _parameters_in_sight(problem, kind, item.fitted.packed.p)


def flank_in_sight(problem: Problem, model_fit: ModelFit) -> bool:
    """Whether motor and load of a model ring where a programme that was repeated shows at least the flank of it."""
    return _rings_below(model_fit, FLANK * problem.data.cutoff)


def law_hides_ringing(problem: Problem, model_fit: ModelFit) -> bool:
    """Whether motor and load ring above the frequency that a drive's law is known below.

    What its loop makes between the samples, and how its torque was recorded, bends what is compared as they would. It
    is known to as far as samples tell, also where an encoder's counts let models be compared at lower frequencies only.
    """
    law = problem.controller
    known = compared_below(problem.data.period)
    return law is not None and law.within and not _rings_below(model_fit, known)


def _rings_below(model_fit: ModelFit, hertz: float) -> bool:
    """Whether motor and load ring below a frequency; a single mass does."""
    measures = (EFFECTS[name].resonance for name in model_fit.effects)
    p = model_fit.fitted.packed.p
    return all(measure is None or measure(p) < hertz for measure in measures)


def _parameters_in_sight(problem: Problem, kind: Kind, p: Floats) -> bool:
    policy = problem.policy
    if kind.extent is not None and not kind.extent(p) > policy.least_counts * problem.data.resolution:
        return False
    if kind.resonance is not None and not kind.resonance(p) < policy.beyond * problem.data.cutoff:
        return False
    if kind.slow_change is not None:
        long = problem.scales.seconds > TIME_CONSTANTS * policy.least_warming
        if not (long and kind.slow_change(p) >= policy.least_warming):
            return False
    return not kind.needs_rests or _rests_differ(problem)


def _rests_differ(problem: Problem) -> bool:
    """Whether the axis rested often, and for times that differ: else it is friction at every start."""
    data, policy = problem.data, problem.policy
    still = np.abs(data.velocity) < STILL * float(np.percentile(np.abs(data.velocity), 99.5))
    label, count = scipy.ndimage.label(still)
    rests = np.bincount(label)[1:] * data.period if count else np.zeros(0)
    rests = rests[rests > SHORTEST_REST]
    return len(rests) >= policy.least_rests and float(np.ptp(np.log(rests))) > math.log(policy.rest_ratio)


def highest_frequency(problem: Problem) -> float:
    """Frequency below which nearly all of the torque's power lies [Hz]; 0 where a twin accounts for it."""
    if problem.twin or problem.data.steady:
        return 0.0
    longest = max(problem.data.stretches, key=lambda stretch: stretch.stop - stretch.start)
    every = problem.data.upsampling
    torque = problem.data.recorded_torque[longest.rows][::every]
    return loud_below(torque, every * problem.data.period) if len(torque) > 64 else 0.0


def resolved_frequency(problem: Problem) -> float:
    """Highest frequency that the samples of the file allow [Hz]."""
    return FASTEST / (problem.data.upsampling * problem.data.period)
