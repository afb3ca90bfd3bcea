"""Recordings without repeats: a candidate must beat chance, matter, and be visible in them at all.

Held-out errors are predicted by a linear refit of all columns, which knows no bounds: it may run to a
negative Stribeck dip. No candidate gains more than its own fit, inside its bounds, lowers the error. On one
trajectory smooth structure that has nothing to do with an effect can still follow its columns: a candidate must
lower the held-out error more than on nearly all residuals with the same spectrum but random phases.

Another trajectory decides: a model fitted without it and carried there unchanged. The right effect lowers the error
there, wrong ones raise it. Each recording is held out in turn; a `veto` segment is held out always.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats, Integers
from autotune.diagnosis.candidates import FittedCandidate, Gain, ScreenedCandidate
from autotune.diagnosis.evidence.evidence import Effort, Evidence, HoldoutResult
from autotune.diagnosis.evidence.torque_path import WORTH_ALIGNING, without_chain
from autotune.diagnosis.evidence.visibility import (
    beside_chain,
    highest_frequency,
    loop_like,
    resolved_frequency,
    visible,
)
from autotune.estimation.alignment import also_there, away_from_reversals, best_shift, drives, shifted
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.coordinates import coordinates
from autotune.estimation.cross_validation import (
    beyond_presliding,
    chunks_held_out,
    gain_and_z,
    held_out,
    left_unseen,
)
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.least_squares import Fitted, followed
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem, refit, without_outlying
from autotune.estimation.residual import measured_motion
from autotune.estimation.twin_runs import SEED
from autotune.models.effect import Kind
from autotune.models.table import EFFECTS, usual_rivals
from autotune.signals.chunks import CHUNK

LEAST_ROWS = 60
LEAST_REST = 0.25
"""Of the rows: with fewer left the other recordings say too little to be carried anywhere."""
ITERATIONS = 10
MOST_LIKELY, SURROGATES = 6, 20
MOST_NEIGHBOURS, LEAST_NEIGHBOURS, NEIGHBOURS = 6000, 300, 40
APART = 0.5  # s, between rows that are compared
COARSE = (
    "The encoder's counts make a part of the acceleration however slow the motion that is compared: inertia is vague, "
    "and effects of quick motion cannot be told. Record a finer position, quicker motion, or the reference."
)
OF_DISTURBANCES = ("time", "acceleration")
"""Coordinates of which free functions say nothing where nothing is repeated. Each moment is there once: any level that
wanders has a course in time. And what a force from outside moves is the acceleration: where that is small it is the
force's own, and goes with what is left (an error in the variable, by which a regression on it is off)."""


class SingleRecording(Evidence):
    """An effect found on one trajectory is suspected; another trajectory confirms or refutes it."""

    def candidates(self, problem: Problem) -> list[Kind]:
        """Not what aligning torque with motion hides, where no controller tells how they belong together.

        Nor two masses: what is named so without a twin is a loop's doing, or a memory's.
        """
        kinds = super().candidates(problem)
        return kinds if problem.twin else [kind for kind in kinds if not bends(kind)]

    def borne_out(self, model_fit: ModelFit, found: Sequence[ScreenedCandidate]) -> list[ScreenedCandidate]:
        """With gains that their own fits bear out."""
        cost = max(model_fit.fitted.cost, 1e-300)
        return [replace(item, gain=min(item.gain, 1.0 - item.fitted.cost / cost)) for item in found]

    def bears_out(self, problem: Problem, before: ModelFit, after: ModelFit) -> bool:
        """As far as an effect: by a clear gain, in most of the data, and beyond what chance would gain."""
        policy, (gain, z) = problem.policy, gain_and_z(before.unseen, after.unseen)
        enough = gain >= policy.least_gain_single and z >= policy.least_z_single
        return enough and beats_chance(problem, before.fitted, after.fitted)

    def worth_fitting(
        self, problem: Problem, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate]
    ) -> list[ScreenedCandidate]:
        likely = self._likely(problem, model_fit, ranked, problem.policy.least_gain_single)
        likely = [item for item in likely if matters(problem, model_fit, item)]
        return [item for item in likely if beats_chance(problem, model_fit.fitted, item.fitted)]

    def _likely(
        self, problem: Problem, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate], least: float
    ) -> list[ScreenedCandidate]:
        large = [item for item in ranked if item.gain >= least_of(problem.policy, item, least)]
        likely = [item for item in large if no_accident(problem, model_fit, item)]
        return [item for item in likely if visible(problem, item)][:MOST_LIKELY]

    def stopped_by(self, problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> str:
        least = least_of(problem.policy, item, problem.policy.least_gain_single)
        if item.gain < least:
            return f"{100 * least:.0f} % are needed"
        if not visible(problem, item):
            return "with parameters that these data cannot show"
        if not self._likely(problem, model_fit, [item], least):
            return "not in enough of them to be no chance"
        if not matters(problem, model_fit, item):
            part = 100 * part_of_torque(problem, model_fit, item)
            return f"{part:.2g} % of the torque: so little is as often the measurement chain as the axis"
        return "" if beats_chance(problem, model_fit.fitted, item.fitted) else "as much as chance would gain"

    def best(self, problem: Problem, fitted: Sequence[FittedCandidate]) -> FittedCandidate:
        """Of candidates that explain nearly alike the one that errs least on other trajectories."""
        best = max(fitted, key=lambda item: item.gain)
        near = [item for item in fitted if item.gain >= problem.policy.rival_gain * best.gain]
        folds = self.other_trajectories(problem) if len(near) > 1 else []
        if not folds:
            return best
        return min(near, key=lambda item: _error_elsewhere(problem, folds, item.model_fit))

    def accepts(self, policy: Policy, chosen: FittedCandidate) -> bool:
        return chosen.share >= policy.partly

    def alike(self, problem: Problem) -> float:
        return problem.policy.alike if len(problem.data.starts) > 1 else problem.policy.alike_single

    def look_alikes(self, problem: Problem, effect: str) -> list[str]:
        """Those that share a set with it; nothing repeats here that would have made them candidates.

        Not what bends to any dynamics: beside that nothing could be named.
        """
        rivals = usual_rivals(effect)
        return [kind.name for kind in problem.candidates if kind.name in rivals and not bends(kind)]

    def explains_rest_of(self, problem: Problem, chosen: FittedCandidate, item: FittedCandidate) -> bool:
        """Whether the chosen one errs clearly less on unseen stretches: nothing else tells here what noise is.

        A memory that left four tenths of what a spring leaves, beyond eight standard errors, is told from it. Not so
        what looks alike: on one trajectory a law that is not quite the axis's errs by as much as another effect.
        """
        policy = problem.policy
        gain, z = gain_and_z(item.model_fit.unseen, chosen.model_fit.unseen)
        clearly = gain >= policy.confirming_gain and z >= policy.least_z
        return clearly and item.effect not in usual_rivals(chosen.effect)

    def telling(self, policy: Policy, generic: Mapping[str, Gain]) -> Mapping[str, float]:
        """A level that wanders has any shape over a coordinate that the axis goes through once."""
        return {
            name: one.gain
            for name, one in generic.items()
            if name not in OF_DISTURBANCES and beyond_chance_by(policy, one) >= policy.least_z_single
        }

    def structure_left(self, problem: Problem, model_fit: ModelFit) -> bool:
        return alike_where_motion_is(problem, model_fit.fitted.error)

    def overlooked(
        self, problem: Problem, model_fit: ModelFit, first: Sequence[ScreenedCandidate]
    ) -> ScreenedCandidate | None:
        """One that explains half of unseen stretches, and more than measurement chains leave; or is only too small.

        What is too small for a name may be the measurement chain, but no chance; it is neither a presliding by another
        law nor a delay of the columns, nor what else bends to any dynamics.
        """
        policy = problem.policy
        large = halves_unseen(problem, model_fit, first)
        if large is not None:
            return large
        small = [
            item
            for item in self._likely(problem, model_fit, first, policy.least_gain_single)
            if not bends(EFFECTS[item.effect])
            and part_of_torque(problem, model_fit, item) >= policy.clear_single_part
            and while_sliding(problem, model_fit, item)
            and beats_chance(problem, model_fit.fitted, item.fitted)
        ]
        return max(small, key=lambda item: item.gain, default=None)

    def doubted(
        self,
        problem: Problem,
        root: ModelFit,
        model_fit: ModelFit,
        first: Sequence[ScreenedCandidate] = (),
        unloaded: ModelFit | None = None,
        bare: ModelFit | None = None,
    ) -> bool:
        """Whether more is left that some model could explain than the effects explain.

        That is what goes with the motion still, or what is more than measurement chains leave; or the rows that were
        left out say the contrary. Effects that the model has explain their part, too: three that are found one after
        the other are as sure as three that are found at once.
        """
        if worse_on_the_whole(problem, root, model_fit):
            return True
        near = _neighbours(problem)
        if near is None:
            return False
        before, after = (_with_motion(near, item.fitted.error) for item in (bare or root, model_fit))
        torque = problem.data.torque[problem.data.grid[problem.training > 0]]
        noise = min(after[1], problem.policy.large_rest**2 * float(np.mean(torque**2)))
        return after[0] - noise > (before[0] - after[0]) * (1.0 / problem.policy.partly - 1.0)

    def confirms(self, problem: Problem, effects: Sequence[str], carried: Sequence[HoldoutResult]) -> bool:
        """By another trajectory each; not what could be the controller, where that is not known."""
        sure = {item.effect for item in carried if item.confirmed}
        return set(effects) <= (sure if problem.twin else sure - loop_like(problem.data, problem.policy))

    def other_trajectories(self, problem: Problem) -> list[Flags]:
        return list(folds_of(problem))

    def aligned(self, problem: Problem, model_fit: ModelFit) -> Problem:
        """Also with other rows left out, where no controller says how the columns belong together."""
        if problem.twin:
            return without_chain(problem, model_fit)
        weight = without_outlying(problem, model_fit.fitted.error)
        if np.mean(weight != problem.weight) > 1e-3:
            problem = replace(problem, weight=weight)

        def moved_by(shift: float) -> Problem:
            data = shifted(problem.data, shift)
            return replace(problem, data=data, moved=measured_motion(data))

        an_axis = drives(problem.data, away_from_reversals(problem.data))

        def cost(shift: float) -> float:
            moved = moved_by(shift)
            fitted = refit(moved, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, 6)
            if not an_axis:
                return fitted.cost
            # what is missing must not draw the torque to where it stands for it
            beside = np.column_stack([fitted.jacobian, also_there(moved.data)])
            return moved.mean_square(followed(beside, fitted.error, moved.training), TRAINING)

        here = problem.data.shift
        best, lowest = best_shift(cost, here, problem.data.upsampling)
        worth = best != here and lowest <= WORTH_ALIGNING * cost(here)
        return moved_by(best) if worth else problem

    def weights(self, problem: Problem, error: Floats) -> Floats | None:
        return without_outlying(problem, error)

    def limits(self, problem: Problem) -> tuple[str, ...]:
        coarse = (COARSE,) * problem.data.coarse
        if highest_frequency(problem) <= problem.policy.beyond * resolved_frequency(problem):
            return coarse
        period = 1e3 * problem.data.upsampling * problem.data.period
        return (
            *coarse,
            f"The torque holds frequencies up to {highest_frequency(problem):.3g} Hz, samples of {period:.3g} ms "
            f"allow {resolved_frequency(problem):.2g} Hz: only effects of place and direction can be told. Record "
            "faster, or move more gently.",
        )

    def explains(self, candidate: FittedCandidate) -> str:
        return f"lowers the squared error on unseen stretches by {100 * candidate.gain:.0f} %"

    def explains_part(self, chosen: FittedCandidate) -> str:
        return "fits some of it"


class SpeedCurve(SingleRecording):
    """Mean torques at constant speeds, few, without noise: all starts are followed, chance and size are not asked."""

    def candidates(self, problem: Problem) -> list[Kind]:
        return [kind for kind in Evidence.candidates(self, problem) if kind.at_constant_speed]

    def effort(self, problem: Problem) -> Effort:
        return Effort(0.0, 9, 15, follows_promises=False)

    def worth_fitting(
        self, problem: Problem, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate]
    ) -> list[ScreenedCandidate]:
        return self._likely(problem, model_fit, ranked, problem.policy.least_gain)

    def stopped_by(self, problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> str:
        least = problem.policy.least_gain
        return (
            ""
            if self._likely(problem, model_fit, [item], least)
            else f"{100 * least:.0f} % beyond chance are needed"
        )

    def best(self, problem: Problem, fitted: Sequence[FittedCandidate]) -> FittedCandidate:
        return max(fitted, key=lambda item: item.gain)

    # points have no motion to align, to weigh, or to hold out
    alike, aligned, look_alikes = Evidence.alike, Evidence.aligned, Evidence.look_alikes
    weights, other_trajectories = Evidence.weights, Evidence.other_trajectories


def least_of(policy: Policy, item: ScreenedCandidate, least: float) -> float:
    """The least gain of a candidate: a lag and a second mass bend to what any dynamics leave, and must be plain."""
    return max(least, policy.clear_single_gain) if bends(EFFECTS[item.effect]) else least


def bends(kind: Kind) -> bool:
    """Whether an effect bends to what any dynamics leave."""
    return kind.lost_in_alignment or kind.in_transmission


def beyond_chance_by(policy: Policy, item: Gain | ScreenedCandidate) -> float:
    """Standard errors by which a gain is beyond its scatter over chunks.

    Of an effect that explains half of all, most of it in a few quick moves, the scatter is the effect's own: then also
    by how many chunks err less.
    """
    return max(item.z, item.evenly if item.gain >= policy.clear_single_gain else 0.0)


def no_accident(problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> bool:
    """Whether a gain is beyond its scatter over chunks; or beyond that of errors whose chunks have random signs.

    What shows in a few quick strokes only gains there alone, and its scatter over all chunks is the effect's own: a
    single one of n is never beyond one standard error, however large. Of such an error the strokes have to agree. That
    is no chance, and no more: what the law of another effect leaves agrees in every stroke, too; and of one motion that
    comes again and again all strokes agree about whatever is learned by heart.
    """
    policy = problem.policy
    least = policy.apart_z if problem.data.periodic else policy.least_z_single
    if beyond_chance_by(policy, item) >= least:
        return True
    if problem.data.steady or problem.data.periodic or model_fit.effects:
        return False
    return beats_signs(problem, model_fit.fitted, item.fitted, least)


def beats_signs(problem: Problem, base: Fitted, candidate: Fitted, z: float) -> bool:
    """Whether the candidate's columns explain more of the residual than of any with chunks of random signs.

    So many of them as make it as improbable as so many standard errors.
    """
    chunks = chunks_held_out(problem)
    draws = math.ceil(1.0 / float(scipy.stats.norm.sf(z)))
    signs = np.random.default_rng(SEED).choice([-1.0, 1.0], (len(chunks), draws))
    errors = np.zeros((len(base.error), draws))
    for rows, sign in zip(chunks, signs, strict=True):
        errors[rows] = base.error[rows, None] * sign
    real, chance = _gains(problem, base, candidate, errors)
    return bool(real > chance.max())


def matters(problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> bool:
    """Whether the effect is large enough: less is as often the measurement chain as the axis.

    No size is asked of what gains beside all that a chain could make (`beyond_chain`); but it is beside another effect,
    whose law is not quite the axis's and leaves as little. Nor is one where a law gives the demand to rounding from
    what was recorded: then the columns are what acted and what was read, and the twin does to them all that scaling,
    filters and rounding do; what such an effect gains must be no presliding by another law.
    """
    policy, law = problem.policy, problem.controller
    part = part_of_torque(problem, model_fit, item)
    clear = item.gain >= policy.clear_single_gain and beyond_chance_by(policy, item) >= policy.least_z
    if part >= (policy.clear_single_part if clear else policy.least_part):
        return True
    if bends(EFFECTS[item.effect]):
        return False
    known = problem.twin and law is not None and law.exact
    if known and while_sliding(problem, model_fit, item):
        return True
    return not model_fit.effects and beyond_chain(problem, model_fit.fitted, item)


def beyond_chain(problem: Problem, base: Fitted, item: ScreenedCandidate) -> bool:
    """Whether a candidate gains beyond chance what no measurement chain could make (`beside_chain`)."""
    policy, beside = problem.policy, beside_chain(problem, base, item.fitted, item.effect)
    if beside is None:
        return False
    sliding, before, after = beside
    gain, z = _gain_unseen(sliding, before, after)
    if gain < policy.least_gain_single:
        return False
    return z >= policy.least_z_single or beats_signs(sliding, before, after, policy.least_z_single)


def while_sliding(problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> bool:
    """Whether a candidate gains beyond chance where the contact slides, too."""
    policy, sliding = problem.policy, beyond_presliding(problem, model_fit.fitted.packed)
    if sliding is None:
        return False
    gain, z = _gain_unseen(sliding, model_fit.fitted, item.fitted)
    return gain >= policy.least_gain_single and z >= policy.least_z_single


def _gain_unseen(problem: Problem, before: Fitted, after: Fitted) -> tuple[float, float]:
    """What one fit gains over another on stretches held out, and its z."""
    return gain_and_z(*(held_out(problem, one.error, one.jacobian) for one in (before, after)))


def halves_unseen(
    problem: Problem, model_fit: ModelFit, first: Sequence[ScreenedCandidate]
) -> ScreenedCandidate | None:
    """The best candidate, where it explains half of unseen data and more than measurement chains leave."""
    best = max(first, key=lambda item: item.gain, default=None)
    if best is None or best.gain < problem.policy.clear_single_gain:
        return None
    return best if part_of_torque(problem, model_fit, best) >= problem.policy.least_part else None


def part_of_torque(problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> float:
    """Rms of what a candidate explains, of the torque."""
    return math.sqrt(max(item.gain * model_fit.fitted.cost, 0.0)) / problem.scales.torque


def beats_chance(problem: Problem, base: Fitted, candidate: Fitted) -> bool:
    """Whether the candidate's columns explain more of the residual than of randomised ones."""
    random = np.random.default_rng(SEED)
    errors = np.column_stack([_randomised(problem, base.error, random) for _ in range(SURROGATES)])
    real, chance = _gains(problem, base, candidate, errors)
    return real > float(np.percentile(chance, 100.0 * problem.policy.surrogates_beaten))


def _gains(problem: Problem, base: Fitted, candidate: Fitted, errors: Floats) -> tuple[float, Floats]:
    """What the candidate's columns gain on stretches held out, of the base's error and of others, shape (m, k)."""
    columns = np.hstack([base.jacobian, candidate.jacobian[:, base.jacobian.shape[1] :]])
    table = np.column_stack([base.error, errors])
    before, after = (left_unseen(problem, table, one) for one in (base.jacobian, columns))
    gains = 1.0 - after / np.maximum(before, 1e-300)
    return float(gains[0]), gains[1:]


def _randomised(problem: Problem, error: Floats, random: np.random.Generator) -> Floats:
    """An error of the same spectrum with random phases."""
    order = np.argsort(problem.data.grid, kind="stable")
    spectrum = np.fft.rfft(error[order])
    spectrum[1:] *= np.exp(2j * np.pi * random.uniform(size=len(spectrum) - 1))
    result = np.empty_like(error)
    result[order] = np.fft.irfft(spectrum, len(error))
    return result


def _error_elsewhere(problem: Problem, folds: Sequence[Flags], model_fit: ModelFit) -> float:
    return sum(float(np.sum(carried_error(problem, model_fit, held)[held] ** 2)) for held in folds)


def worse_on_the_whole(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether effects raise the error of the rows that were left out by more than they lower that of the others.

    A single event neither falls nor rises much with an effect that the axis has. Where starts and stops were left out
    because what is missing rings there, an effect that is none of it is bent to what is left.
    """
    change = problem.data.role(TRAINING) * (after.fitted.error**2 - before.fitted.error**2)
    return float(change.sum()) > 0.0


def alike_where_motion_is(problem: Problem, error: Floats) -> bool:
    """Whether what is left is large and alike where the motion is alike, so that a model could explain more."""
    rows = _thinned_rows(problem)
    torque = problem.data.torque[problem.data.grid[rows]]
    least = problem.policy.large_rest**2 * np.mean(torque**2)
    if len(rows) < LEAST_NEIGHBOURS or np.var(error[rows]) < least:
        return False
    near = _neighbours(problem)
    if near is None:
        return False
    variance, noise = _with_motion(near, error)
    return noise < problem.policy.most_noise * variance


def _thinned_rows(problem: Problem) -> Integers:
    rows = np.flatnonzero(problem.training > 0)
    return rows[:: max(1, len(rows) // MOST_NEIGHBOURS)]


def _with_motion(near: tuple[Integers, Integers], error: Floats) -> tuple[float, float]:
    """Variance of an error, and what of it no function of the motion explains: half the mean squared difference of rows
    and their `_neighbours`."""
    rest, other = (error[rows] for rows in near)
    return float(np.var(rest)), 0.5 * float(np.mean((rest - other) ** 2))


def _neighbours(problem: Problem) -> tuple[Integers, Integers] | None:
    """Rows, and to each the one that is nearest in position, velocity, acceleration and travel since the reversal, at
    another time; None where too few tell."""
    rows = _thinned_rows(problem)
    if len(rows) < LEAST_NEIGHBOURS:
        return None
    time, places = problem.data.grid[rows] * problem.data.period, _places(problem, rows)
    near = np.asarray(scipy.spatial.cKDTree(places).query(places, k=NEIGHBOURS)[1])
    apart = np.abs(time[near] - time[:, None]) > APART
    found = apart.any(axis=1)
    if found.mean() < 0.5:
        return None
    other = near[np.arange(len(rows)), np.argmax(apart, axis=1)]
    return rows[found], rows[other[found]]


def _places(problem: Problem, rows: Integers) -> Floats:
    """Where rows are in the space of motion, each coordinate by its spread; shape (rows, 4)."""
    table = coordinates(problem.data)
    names = ("position", "velocity", "acceleration", "travel_since_reversal")
    place = np.column_stack([table[name][rows] for name in names if name in table])
    return np.asarray((place - place.mean(axis=0)) / np.maximum(place.std(axis=0), 1e-300))


def folds_of(problem: Problem) -> Iterator[Flags]:
    """Grid rows to be held out: the veto trajectory, else each recording in turn."""
    data = problem.data
    if problem.has(VETO):
        yield data.role(VETO) & (problem.weight > 0)
        return
    if len(data.starts) < 2:
        return
    number = np.searchsorted(np.array(data.starts), data.grid, side="right")
    fitted = problem.training > 0
    for one in np.unique(number):
        held = fitted & (number == one)
        left = fitted & (number != one)
        if held.sum() >= LEAST_ROWS and left.sum() >= LEAST_REST * fitted.sum():
            yield held


def carried_error(problem: Problem, model_fit: ModelFit, held: Flags) -> Floats:
    """Error of the model fitted without the rows held out, shape (m,)."""
    others = replace(problem, weight=problem.weight * ~held)
    return refit(
        others, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, ITERATIONS
    ).error


def chunks_of(error: Floats) -> list[float]:
    """Squared error of pieces that are compared pairwise."""
    pieces = max(1, min(len(error) // 20, max(10, len(error) // CHUNK)))
    return [float(np.sum(part**2)) for part in np.array_split(error, pieces)]
