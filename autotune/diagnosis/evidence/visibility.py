"""Could a single recording show an effect, with the parameters that were fitted? Or is it the measurement chain, or the
controller?

A fit whose parameters lie where the recording cannot show the effect is something else in disguise: play below the
encoder's count, a warming within seconds, a resonance beyond what is compared. What an effect needs is among the
traits of its `Kind`.

A measurement chain delays, filters, bends a sensor's line, and its zero wanders. To first order each of these is a
column of its own beside the model, made of the torque that the model needs (free of the noise of what was recorded).
What an effect still gains once these are projected out of error and sensitivities alike (Frisch and Waugh 1933) is no
chain's, however small it is.

In closed loop two laws hold at once: the torque is what the axis needs, and what the controller makes of reference and
position. Where the reference causes the motion the first can be found in spite of the second, but for effects that are
linear in the motion themselves: a controller's law looks like them. Where something else causes the motion (a hand,
another axis) the torque is the controller's answer to it and says nothing of the axis.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis.candidates import ScreenedCandidate
from autotune.estimation.bandwidth import loud_below
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.cross_validation import beyond_presliding
from autotune.estimation.data import FASTEST, Prepared, compared_below, filtered_motion
from autotune.estimation.least_squares import Fitted
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import Problem
from autotune.estimation.residual import raw_residual, smoothed
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.layout import flag
from autotune.models.table import EFFECTS, names

FLANK = 3.0
"""Times the cut-off: motor and load that ring above it change the torque that is compared by less than a ninth of what
the load's inertia takes, which a current loop's lag does too."""
STILL, SHORTEST_REST = 0.002, 0.05
"""Of the largest speed: slower is rest; and the time [s] that a reversal takes too."""
TIME_CONSTANTS = 2.0
"""Of a warming: a recording that holds fewer shows a slope."""
APART, NEAR = 0.5, 1e-5
"""Of a count, and of the travel where none is known: by which places differ to tell how a torque changes over them."""
LAGS = 4
LOOP_LIKE = names(kind for kind in EFFECTS.values() if kind.loop_like)
"""Effects that are linear in the motion, as a controller is."""
LONGEST_DELAY = 0.1  # s


def visible(problem: Problem, item: ScreenedCandidate) -> bool:
    """Whether this recording could show the effect with the parameters that were fitted."""
    kind = EFFECTS[item.effect]
    if kind.quick and (problem.data.filtered or problem.data.coarse):
        return False
    too_slow = highest_frequency(problem) > problem.policy.beyond * resolved_frequency(problem)
    if too_slow and not kind.of_place:
        return False
    return _parameters_in_sight(problem, kind, item.fitted.packed.p)


def beside_chain(
    problem: Problem, base: Fitted, candidate: Fitted, effect: str
) -> tuple[Problem, Fitted, Fitted] | None:
    """Model and candidate without all that a measurement chain could make, in error and sensitivities.

    With the problem where the contact slides: what a chain does to a reversal is no column of first order. None where
    the axis hardly slides.
    """
    sliding = beyond_presliding(problem, base.packed)
    if sliding is None:
        return None
    chain = np.hstack([of_chain(problem, base.packed), read_as(problem, candidate, effect)])
    weight = np.sqrt(sliding.training)[:, None]
    chain = chain / np.maximum(np.linalg.norm(weight * chain, axis=0), 1e-300)

    def without(values: Floats) -> Floats:
        table = values.reshape(len(values), -1)
        slope = np.linalg.lstsq(weight * chain, weight * table, rcond=1e-10)[0]
        return np.asarray((table - chain @ slope).reshape(values.shape))

    both = [
        replace(one, error=without(one.error), jacobian=without(one.jacobian)) for one in (base, candidate)
    ]
    return sliding, both[0], both[1]


def of_chain(problem: Problem, packed: Packed) -> Floats:
    """What a measurement chain may add to the torque that a model needs, on the grid, shape (m, 8).

    Its change with time (a delay), and the change of that (a filter, a compliance before the encoder); its size,
    square, cube and sign (gains that differ by direction, a bent line, a dead band); and a zero that wanders.
    """
    data = problem.data
    needed = problem.moved.torque - raw_residual(data, packed, problem.moved)
    first = _change(data, needed)
    second = _change(data, first)
    parts = (first, second, np.abs(needed), needed**2, needed**3, np.sign(needed))
    time = data.time[data.grid] - data.time[data.grid].mean()
    return np.column_stack([*(smoothed(data, part) for part in parts), time, time**2])


def read_as(problem: Problem, candidate: Fitted, effect: str) -> Floats:
    """Torques of an encoder that errs over the place as an effect's torque does, on the grid, shape (m, 0 or 2).

    In its phase and beside it: the lines of an encoder that interpolates are waves over place, as those of a motor are,
    but what they add to the acceleration grows with the square of the speed.
    """
    data, kind = problem.data, EFFECTS[effect]
    if kind.kernels.torque is None:
        return np.zeros((len(data.grid), 0))
    p, on = candidate.packed.p, candidate.packed.on.copy()
    on[flag(effect)] = False
    step = APART * data.resolution if data.resolution > 0.0 else NEAR * float(np.ptp(data.position))

    def over(place: Floats) -> Floats:
        moved = replace(problem.moved, position=place)
        return raw_residual(data, Packed(p, on), moved) - raw_residual(data, candidate.packed, moved)

    place = problem.moved.position
    waves = over(place), over(place + step) - over(place - step)
    return np.column_stack([smoothed(data, _change(data, _change(data, wave))) for wave in waves])


def _change(data: Prepared, values: Floats) -> Floats:
    """By time, sample by sample within each stretch, shape (n,)."""
    change = np.zeros_like(values)
    for stretch in data.stretches:
        change[stretch.rows] = np.gradient(values[stretch.rows], data.period)
    return change


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


def loop_rings_otherwise(problem: Problem) -> bool:
    """Whether the twin's loop may have another phase than the axis's where motor and load of a model ring.

    A law that is not exact may lack a dead time: by so much less phase the twin rings less than the axis, and motor and
    load make up for it.
    """
    return problem.controller is not None and not problem.controller.exact


def rings_unrecorded(problem: Problem, model_fit: ModelFit) -> bool:
    """Whether motor and load of a model ring above half the sampling rate, where nothing that was recorded rings.

    All that they are there is a load with a stretch and friction of its own: an element of a memory.
    """
    return not _rings_below(model_fit, 0.5 / (problem.data.upsampling * problem.data.period))


def lag_turns_ringing(problem: Problem, model_fit: ModelFit) -> bool:
    """Whether the current loop's lag that the twin was given turns the phase where motor and load of a model ring.

    It is one stage, and known to some microseconds; what acts so late on the axis is that only about.
    """
    lag = problem.data.lag
    return lag > 0.0 and not _rings_below(model_fit, 1.0 / (FLANK**2 * 2.0 * math.pi * lag))


def _rings_below(model_fit: ModelFit, hertz: float) -> bool:
    """Whether motor and load ring below a frequency; a single mass does."""
    measures = (EFFECTS[name].resonance for name in model_fit.effects)
    p = model_fit.fitted.packed.p
    return all(measure is None or measure(p) < hertz for measure in measures)


def _parameters_in_sight(problem: Problem, kind: Kind, p: Floats) -> bool:
    policy = problem.policy
    if kind.both_ways and problem.scales.one_way:
        return False
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
    """Whether the axis rested often, and for times that differ: else it is friction at every start.

    Rows between stretches, which were lost, are no rests, and none goes on from one stretch into the next.
    """
    data, policy = problem.data, problem.policy
    still = np.abs(data.velocity) < STILL * float(np.percentile(np.abs(data.velocity), 99.5))
    labelled = (scipy.ndimage.label(still[stretch.rows])[0] for stretch in data.stretches)
    rests = data.period * np.concatenate([np.bincount(label)[1:] for label in labelled])
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


def linear_share(data: Prepared) -> float:
    """Share of the torque's variance that is linear in reference and position of the last few samples."""
    if not data.recorded_reference:
        return 0.0
    rows = _rows(data, LAGS)
    columns = [
        np.roll(values, lag)[rows] for values in (data.reference, data.measured) for lag in range(LAGS)
    ]
    total = np.cumsum(data.reference - data.measured)
    return _explained(np.column_stack([*columns, total[rows], np.ones(len(rows))]), data.torque[rows])


def loop_like(data: Prepared, policy: Policy = POLICY) -> frozenset[str]:
    """Effects that a regression on these data could take the controller for; empty where it is no danger."""
    return LOOP_LIKE if not data.repeated and linear_share(data) > policy.answer_explains else frozenset()


def loop_note(data: Prepared, policy: Policy = POLICY) -> tuple[str, ...]:
    """A sentence where the torque may be just the controller's."""
    if not loop_like(data, policy):
        return ()
    alike = ", ".join(sorted(LOOP_LIKE)).replace("_", " ")
    return (
        f"Reference and position make {100 * linear_share(data):.1f} % of the torque, as a controller does, but not "
        f"one that can be simulated here: {alike} may be that controller instead of the axis and stay suspected. "
        "Record its gains, or every sample of torque command, reference and position.",
    )


def refuse_answers(data: Prepared, policy: Policy = POLICY) -> None:
    """Raises NotEnoughExcitation where the torque answers a motion that it did not cause."""
    if data.repeated or data.steady:
        return
    foreign = _foreign_to_reference(data, policy) if data.recorded_reference else _holds_back(data, policy)
    if foreign:
        raise NotEnoughExcitation(
            "the torque is just a controller's answer to a motion that something else caused (it follows position and "
            "velocity, and holds against them); it tells the controller, not the axis. Record a motion that the "
            "drive itself makes"
        )


def _foreign_to_reference(data: Prepared, policy: Policy) -> bool:
    """Whether the torque is linear in the motion and the reference does not cause the motion."""
    wanted = filtered_motion(data.reference, data.stretches, data.period, data.motion_cutoff)[1]
    velocity = data.velocity[data.grid]
    best = 0.0
    for delay in np.linspace(0.0, LONGEST_DELAY, 11):
        late = np.roll(wanted, round(float(delay) / data.period))[data.grid]
        best = max(best, _explained(np.column_stack([late, np.ones(len(late))]), velocity))
    return best < policy.reference_causes and linear_share(data) > policy.answer_explains


def _holds_back(data: Prepared, policy: Policy) -> bool:
    """Whether the torque is linear in the motion, against position and against velocity."""
    acted = smoothed(data, data.torque)
    parts = [smoothed(data, values) for values in (data.position, data.velocity, data.acceleration)]
    table = np.column_stack([*parts, np.ones(len(acted))])
    scale = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    stiffness, damping, _, _ = np.linalg.lstsq(table / scale, acted, rcond=1e-10)[0] / scale
    against = stiffness < 0.0 and damping < 0.0
    strong = abs(stiffness) * float(np.std(parts[0])) > policy.answer_holds * float(np.std(acted))
    return bool(against and strong and _explained(table, acted) > policy.answer_explains)


def _rows(data: Prepared, margin: int, most: int = 40_000) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Samples inside the stretches, at most so many."""
    inside = np.concatenate([np.arange(s.start + margin, s.stop, dtype=np.int64) for s in data.stretches])
    return inside[:: max(1, len(inside) // most)]


def _explained(columns: Floats, target: Floats) -> float:
    """Share of the target's variance that columns of shape (n, k), a constant among them, explain."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    slope = np.linalg.lstsq(columns / scale, target, rcond=1e-10)[0]
    return 1.0 - float(np.var(target - columns / scale @ slope)) / max(float(np.var(target)), 1e-300)
