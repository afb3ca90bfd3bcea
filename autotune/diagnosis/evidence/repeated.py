"""A programme played more than once: what repeats do not share is noise, all else could be explained.

An axis that hunts is told by it, too: a limit cycle of its loop has a phase of its own in every repeat, and there one
line holds most of what is quick. Whether the twin of a model hunts alike tells whether what hides the friction below it
is hidden from the model, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from autotune.core.arrays import Flags, Floats
from autotune.diagnosis.candidates import (
    FittedCandidate,
    ScreenedCandidate,
    error_left,
    explained_of_rest,
    gain_on_veto,
)
from autotune.diagnosis.evidence.evidence import Evidence, HoldoutResult
from autotune.diagnosis.evidence.single import folds_of, halves_unseen
from autotune.diagnosis.evidence.torque_path import without_chain
from autotune.diagnosis.evidence.visibility import (
    flank_in_sight,
    lag_turns_ringing,
    law_hides_ringing,
    loop_rings_otherwise,
    rings_unrecorded,
)
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.coordinates import Rests, without_rests
from autotune.estimation.cross_validation import beyond_rests, drift, rests_of
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.disturbance_estimate import LOUDNESS, null_errors
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Correction, Problem
from autotune.estimation.twin_runs import SEED, run_twin
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.elastic_transmission import creeps
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.table import EFFECTS
from autotune.models.torque_lag import TORQUE_LAG
from autotune.signals.chunks import beyond_chance

STRUCTURE_WITHOUT_TWIN = 1.0
"""Of the noise: the least rest where no twin takes out the bias of the measurement chain, a third of the noise, or
where the drive's loop works between the samples, so that half of what it makes of counts comes again in a repeat."""
PAIRS = 4.0
"""Times the variance of an error: that of the same from the difference of two twins, by noise alone."""
STANDS_OUT = 3.0
"""Times the noise of one experiment: what comes again there says something is missing, though it be next to nothing in
the mean of all. Where nothing is missing chance reaches 0.8 once in fifty experiments (a count that turns over alike in
two repeats); a motor that saturates in the fastest experiment only reaches 17."""
HUNTS_ABOVE, NARROW, MOST, LOUD = 10.0, 0.1, 0.5, 0.1
"""Of a limit cycle: the lowest frequency [Hz]; the width of its line, over that; its least share of all that repeats do
not share there; its least level over the torque's, where an axis has next to no friction."""
AS_LOUD = 1.5
"""Times as loud a twin's limit cycle may be as the axis's, or as faint: its bursts begin and end by chance."""
FEW = 3
"""Replicas, of eight: where most run away their law tells nothing."""


class RepeatedProgramme(Evidence):
    """A candidate must explain nearly all that can be explained, on a veto trajectory too."""

    repeats = True

    def candidates(self, problem: Problem) -> list[Kind]:
        """Without a twin not what aligning torque with motion hides, nor two masses, which its bias looks like."""
        kinds = super().candidates(problem)
        if problem.twin:
            return kinds
        return [kind for kind in kinds if not (kind.lost_in_alignment or kind.in_transmission)]

    def aligned(self, problem: Problem, model_fit: ModelFit) -> Problem:
        """Torque moved to where the model explains it best, if the measurement chain can be what moves it."""
        return without_chain(problem, model_fit)

    def worth_fitting(
        self, problem: Problem, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate]
    ) -> list[ScreenedCandidate]:
        return [item for item in ranked if not self.stopped_by(problem, model_fit, item)]

    def stopped_by(self, problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> str:
        policy = problem.policy
        least = policy.least_gain if problem.twin else policy.clear_gain
        if item.gain < least:
            return f"{100 * least:.0f} % are needed"
        return "" if policy.no_chance(item.gain, item.z) else "not in enough of them to be no chance"

    def best(self, problem: Problem, fitted: Sequence[FittedCandidate]) -> FittedCandidate:
        return min(fitted, key=lambda item: error_left(problem, item.model_fit))

    def accepts(self, policy: Policy, chosen: FittedCandidate) -> bool:
        return chosen.named

    def apart(self, problem: Problem, better: ModelFit, worse: ModelFit) -> bool:
        """Second by second of training and veto."""
        weight = problem.weight * problem.data.role(TRAINING, VETO)
        surplus = weight * (worse.fitted.error**2 - better.fitted.error**2)
        return beyond_chance(surplus, problem.policy.apart_z)

    def rest_that_is_none(self, problem: Problem, error: Floats, noise: float) -> float:
        # one experiment below a count, where motion is chaotic, hides nothing of the others
        usual = min(noise, problem.usual_noise(error, TRAINING))
        least = problem.policy.rest_part * noise if _exact(problem) else _of_the_chain(problem, error, usual)
        return max(least, problem.comes_by_counts(TRAINING)[0])

    def in_sight(self, problem: Problem, before: ModelFit, after: ModelFit) -> bool:
        """Whether of any experiment so much is explained as says that something is missing, where nothing explains it.

        Less is nothing (`structure_part` of the noise): no base is the axis's to a thousandth of its friction, and what
        its law of presliding leaves has the shape of several effects.
        """
        part, falls = problem.policy.structure_part, before.fitted.error**2 - after.fitted.error**2
        for role in (TRAINING, VETO):
            repeated = [block for block in problem.data.blocks if block.role == role and block.repeats > 1]
            noise = problem.repeatable_by_block(after.fitted.error, after.correction, role)[:, 1]
            for block, level in zip(repeated, noise, strict=True):
                counts = problem.weight[block.rows] > 0.0
                if counts.any() and float(falls[block.rows][counts].mean()) >= part * level:
                    return True
        return False

    def only_at_rests(self, problem: Problem, before: ModelFit, candidate: FittedCandidate) -> bool:
        """Less than half of what it explains is left where every rest and repeat has a stretch of its own, and such
        stretches leave nothing that it would explain.

        Friction that is higher after a rest climbs beyond the stretch it began with; a contact that is young again
        within a part of the bristle's reach only changes how its stretch creeps while the axis rests. How much of a
        true effect free stretches take is a matter of its slip: what they leave, if anything, tells one from the other.

        A second mass moves otherwise than one mass wherever the axis moves; at rests it is shaken otherwise. A spring
        that friction winds up holds a stretch as well: so one mass must do as much by how loud it is shaken.
        """
        kind = EFFECTS[candidate.effect]
        if not (kind.needs_rests or kind.in_transmission):
            return False
        after = candidate.model_fit
        rests = rests_of(problem, before.fitted.packed)
        rested = [without_rests(item.fitted.error, rests) for item in (before, after)]
        plain = _fall(problem, before.fitted.error, after.fitted.error)
        if _fall(problem, *rested) >= problem.policy.partly * plain:
            return False
        parts = explained_of_rest(problem, before, after)
        if kind.in_transmission and _told_by_shaking(problem, before) < problem.policy.partly * plain:
            return False
        explains = all(part.plain_share >= problem.policy.partly for part in parts)
        return not (explains and self._structured(problem, before, crumbs=True))

    def structure_left(self, problem: Problem, model_fit: ModelFit) -> bool:
        """What comes again beyond doubt, in more than replicas that lack nothing have of it; or a level that drifts.

        Not what is next to nothing beside the noise or the torque, however well the loop is known: no base has its law
        to that. Nor what a bristle's stretch at a rest makes.
        """
        if drift(problem, model_fit.fitted, model_fit.correction, TRAINING)[0] > 0.0:
            return True
        return self._structured(problem, model_fit, crumbs=False)

    def overlooked(
        self, problem: Problem, model_fit: ModelFit, first: Sequence[ScreenedCandidate]
    ) -> ScreenedCandidate | None:
        """One that halves the error of experiments that it was not fitted to, and by more than measurement chains
        leave: its name may be refuted, but something is there.
        """
        return halves_unseen(problem, model_fit, first)

    def _structured(self, problem: Problem, model_fit: ModelFit, crumbs: bool) -> bool:
        """Whether more comes again than replicas have of it, without what a stretch of its own at each rest makes."""
        rests = rests_of(problem, model_fit.fitted.packed)
        seen = _shared(problem, model_fit.correction, model_fit.fitted.error, rests)
        if not math.isfinite(seen.variance) or not self._left(problem, model_fit, seen, [], crumbs):
            return False
        replicas = _replicas(problem, model_fit, rests)
        return len(replicas) < FEW or self._left(problem, model_fit, seen, replicas, crumbs)

    def _left(
        self,
        problem: Problem,
        model_fit: ModelFit,
        seen: _Shared,
        replicas: Sequence[_Shared],
        crumbs: bool,
    ) -> bool:
        """Whether the mean of all experiments, or one of them, shares more than chance, counts and replicas do.

        `crumbs`: where the loop is known to rounding, also less than measurement chains of others leave.
        """
        policy, rest = problem.policy, model_fit.fitted.error
        noise = problem.noise_variance(rest, TRAINING)
        least = policy.structure_part * noise if _exact(problem) else _of_the_chain(problem, rest, noise)
        if not crumbs or problem.controller is None or not problem.controller.exact:
            least = max(least, (policy.least_part * problem.scales.torque) ** 2)
        counts, scatter = problem.comes_by_counts(TRAINING)
        error = math.sqrt(max(scatter**2, PAIRS * seen.error**2) - (PAIRS - 1.0) * seen.error**2)
        if replicas:
            levels = np.array([one.variance for one in replicas])
            counts = max(counts, float(levels.mean()))
            error = max(error, math.hypot(seen.error, float(levels.std(ddof=1))))
        if seen.variance - counts > policy.structure_errors * error and seen.variance > least:
            return True
        usual = _usual(problem, seen, least)
        for one in replicas:  # which experiment chance makes loud differs from replica to replica
            usual = np.maximum(usual, one.blocks[:, 0].max())
        return bool(np.any(seen.blocks[:, 0] > STANDS_OUT * usual))

    def unlike_in_one(self, problem: Problem, root: ModelFit, model_fit: ModelFit) -> str:
        """Where more than a tenth of what comes again is left, far above noise, and not so in replicas that have these
        effects.

        What takes the place of another effect explains nearly all in most experiments, and in some it does not: there
        the other one acts otherwise. An approximate law leaves some of its own.
        """
        if any(EFFECTS[name].approximate for name in model_fit.effects):
            return ""
        rests = rests_of(problem, model_fit.fitted.packed)
        missing = _shared(problem, root.correction, root.fitted.error, rests).blocks[:, 0]
        seen = _shared(problem, model_fit.correction, model_fit.fitted.error, rests)
        noise = problem.noise_variance(model_fit.fitted.error, TRAINING)
        floor = 0.0 if _exact(problem) else _of_the_chain(problem, model_fit.fitted.error, noise)
        least = np.maximum(
            (1.0 - problem.policy.named) * missing, STANDS_OUT * np.maximum(seen.blocks[:, 1], floor)
        )
        if not np.any(seen.blocks[:, 0] > least):
            return ""
        replicas = np.array([one.blocks[:, 0] for one in _replicas(problem, model_fit, rests)])
        if len(replicas) < FEW:
            loud = seen.blocks[:, 0] > np.maximum(least, STANDS_OUT * _usual(problem, seen, floor))
        else:
            left = seen.blocks[:, 0] - np.maximum(replicas.mean(axis=0), 0.0)
            loud = left > np.maximum(least, problem.policy.rest_errors * replicas.std(axis=0, ddof=1))
        names = [block.name for block in problem.data.blocks if block.role == TRAINING and block.repeats > 1]
        return names[int(np.argmax(loud * seen.blocks[:, 0]))] if loud.any() else ""

    def doubted(
        self,
        problem: Problem,
        root: ModelFit,
        model_fit: ModelFit,
        first: Sequence[ScreenedCandidate] = (),
        unloaded: ModelFit | None = None,
        bare: ModelFit | None = None,
    ) -> bool:
        """Whether motor and load ring far above all that is compared, and nothing tells them from a lag.

        A lag tells itself where it is among the candidates: one that gains far less is not what was found. So does a
        memory, which they may as well be where they ring above all that was recorded; far below it c·s² is told, of
        compliance and the load's share of the inertia, and not where they ring. But what the axis's loop has of a lag,
        and its twin has not, is none of these. That, and what a drive's law hides, is part of the error only: motor and
        load that lower nearly a third of it on experiments held out are no loop's rest.

        Nor does a load that does not ring at all tell of a transmission, however much of the error it lowers: a lag of
        the loop, or a contact of another law, has that shape too.
        """
        if creeps(model_fit.fitted.packed.p, model_fit.fitted.packed.on):
            return True
        gains = {item.effect: item.gain for item in first}
        own = max((gains.get(effect, 0.0) for effect in model_fit.effects), default=0.0)
        hidden = law_hides_ringing(problem, model_fit)
        if flank_in_sight(problem, model_fit) and not hidden:
            return False
        little = _gain_of_load(problem, root, model_fit, gains, unloaded) < problem.policy.confirming_gain
        if problem.controller is not None and problem.controller.within:
            return little
        if loop_rings_otherwise(problem) or (little and lag_turns_ringing(problem, model_fit)):
            return True
        stands_for = {TORQUE_LAG.name}
        if rings_unrecorded(problem, model_fit):
            stands_for.add(REVERSAL_MEMORY.name)
        return any(gains.get(one, math.inf) >= problem.policy.rival_gain * own for one in stands_for)

    def confirms(self, problem: Problem, effects: Sequence[str], carried: Sequence[HoldoutResult]) -> bool:
        """By the veto trajectory, which was never fitted, or by another recording; without a twin not at all.

        Played once the veto trajectory is as another recording: what is left there is known by a bound only.
        """
        sure = {item.effect for item in carried if item.confirmed}
        return problem.twin and (problem.veto_repeats or set(effects) <= sure)

    def other_trajectories(self, problem: Problem) -> list[Flags]:
        """A veto trajectory that was played once, or other recordings, where none was played more often."""
        return [] if problem.veto_repeats else list(folds_of(problem))

    def noise_rms(self, problem: Problem, model_fit: ModelFit) -> float:
        return math.sqrt(max(problem.noise_variance(model_fit.fitted.error, TRAINING, plain=True), 0.0))

    def explains(self, candidate: FittedCandidate) -> str:
        veto = f", {100 * candidate.veto.share:.0f} % on the veto trajectory" if candidate.veto else ""
        return f"explains {100 * candidate.training.share:.0f} % of the explainable error{veto}"

    def explains_part(self, chosen: FittedCandidate) -> str:
        return f"explains {100 * chosen.share:.0f} % of it"


@dataclass(frozen=True, slots=True)
class _Shared:
    """What repeats of the training share, without what rests make: variance and its error, and by block [(N m)²].

    `blocks`, shape (b, 2): variance that comes again and variance that does not.
    """

    variance: float
    error: float
    blocks: Floats


def _shared(problem: Problem, correction: Correction, error: Floats, rests: Rests) -> _Shared:
    rested, quiet, settled = beyond_rests(problem, error, correction, rests)
    found = quiet.repeatable(rested, settled, TRAINING)
    return _Shared(*found, quiet.repeatable_by_block(rested, settled, TRAINING))


def _replicas(problem: Problem, model_fit: ModelFit, rests: Rests) -> list[_Shared]:
    """What repeats of replicas share, as far as a replica's noise is the axis's own.

    What counts, chaos and parameters that are a little off make comes again in a part of a replica, and differs from
    repeat to repeat in another. One that swings by far more than the axis did has made more of either.
    """
    own = problem.noise_variance(model_fit.fitted.error, TRAINING)
    replicas = []
    for error in null_errors(problem, model_fit):
        noise = problem.noise_variance(error, TRAINING)
        known = min(own / noise, 1.0) if noise > 0.0 else 1.0
        one = _shared(problem, model_fit.correction, error, rests)
        replicas.append(_Shared(known * one.variance, known * one.error, known * one.blocks))
    return replicas


def _usual(problem: Problem, seen: _Shared, least: float) -> Floats:
    """What of the variance of each experiment is noise or counts, shape (b,) [(N m)²]; at least `least`."""
    usual = np.maximum(seen.blocks[:, 1], least)
    if problem.by_counts is None:
        return np.asarray(usual)
    known = zip(problem.by_counts.mean(axis=0), problem.data.blocks, strict=True)
    return np.maximum(usual, [v for v, b in known if b.role == TRAINING and b.repeats > 1])


def _fall(problem: Problem, before: Floats, after: Floats) -> float:
    """Of the mean square of training and veto, each by its own share of the rows [(N m)²]."""
    roles = [role for role in (TRAINING, VETO) if problem.has(role)]
    return sum(problem.mean_square(before, role) - problem.mean_square(after, role) for role in roles)


def _told_by_shaking(problem: Problem, model_fit: ModelFit) -> float:
    """By how much what a model leaves hangs on how loud its twin is shaken, as far as that is not known [(N m)²].

    A twin that is unstable, shaken so, tells nothing.
    """
    if not problem.twin:
        return 0.0
    packed, raw = model_fit.fitted.packed, problem.raw(model_fit.fitted.packed)
    levels = [problem.disturbance.louder(part) for part in (LOUDNESS[0], 1.0, LOUDNESS[-1])]
    errors = [raw - one.bias for one in problem.corrections_under(levels, packed) if one.stable]
    return max((_fall(problem, more, less) for more in errors for less in errors), default=0.0)


def _exact(problem: Problem) -> bool:
    """Whether the twin takes out all that the measurement chain does."""
    return problem.controller is not None and not problem.controller.in_band


def _gain_of_load(
    problem: Problem,
    root: ModelFit,
    model_fit: ModelFit,
    gains: Mapping[str, float],
    unloaded: ModelFit | None,
) -> float:
    """What motor and load lower of the error that was not fitted: on the veto trajectory, else as screened.

    Beside others, of what these leave (`unloaded`).
    """
    before = unloaded if len(model_fit.effects) > 1 else root
    if before is None or not problem.has_veto:
        loads = [effect for effect in model_fit.effects if EFFECTS[effect].in_transmission]
        return max((gains.get(effect, 0.0) for effect in loads), default=0.0)
    return gain_on_veto(problem, before, model_fit)


def _of_the_chain(problem: Problem, error: Floats, noise: float) -> float:
    """Variance that may come again though no model lacks anything: counts shake a drive alike in every repeat."""
    return max(STRUCTURE_WITHOUT_TWIN * noise, problem.of_chain(error, TRAINING))


def limit_cycle(problem: Problem, coulomb: float) -> float:
    """Frequency at which the axis hunts with more torque than its friction [Hz]; 0 where it does not.

    `coulomb` is its dry friction [N m]. A limit cycle has a phase of its own in every repeat, so that it is no part of
    the motion, and keeps the contact sliding to and fro: what is left below it is not friction as any model has it.
    """
    level, hertz = _between_repeats(problem, problem.data.torque)
    return hertz if level > coulomb else 0.0


def hunts_alike(problem: Problem, packed: Packed) -> bool:
    """Whether the twin of a model hunts as the axis does: at its frequency, and with as much torque, to `AS_LOUD`.

    The loop of a rigid axis is quiet with gains that let the load swing on its spring. Where the model with that
    spring hunts alike, its twins go through the same friction, and what is left has nothing of it.
    """
    if not problem.twin or problem.controller is None:
        return False
    random = np.random.default_rng(SEED)
    run = run_twin(problem.data, packed, problem.controller, problem.disturbance, random)
    if not run.stable:
        return False
    torques = problem.data.torque, run.torque
    (_, hertz), (_, its) = (_between_repeats(problem, one) for one in torques)
    if abs(hertz - its) > 0.5 * NARROW * hertz:
        return False
    loud, as_loud = (_level_at(problem, *one) for one in zip(torques, (hertz, its), strict=True))
    return loud <= AS_LOUD * as_loud and as_loud <= AS_LOUD * loud


def _level_at(problem: Problem, torque: Floats, hertz: float) -> float:
    """Level of a line over all repeats that are trained [N m], in whatever phase it is there."""
    powers = []
    for block in problem.data.blocks:
        if block.role != TRAINING or block.repeats < 2:
            continue
        for rows in block.by_repeat(problem.data.grid):
            at, power = _spectrum(torque[rows[0] : rows[-1] + 1], problem.data.period)
            powers.append(float(power[np.abs(at - hertz) <= NARROW * hertz].sum() * at[1]))
    return math.sqrt(sum(powers) / max(len(powers), 1))


def _between_repeats(problem: Problem, torque: Floats) -> tuple[float, float]:
    """Level [N m] and frequency [Hz] of the loudest line that two repeats of a trained experiment do not share; zeros
    where there is none.
    """
    data, found = problem.data, [(0.0, 0.0)]
    for block in data.blocks:
        if block.role != TRAINING or block.repeats < 2:
            continue
        first, second = data.grid[block.by_repeat(np.arange(len(data.grid)))][:2]
        count = int(min(first[-1] - first[0], second[-1] - second[0]))
        if count * data.period < 2.0 / HUNTS_ABOVE:
            continue
        one, other = (torque[rows[0] : rows[0] + count] for rows in (first, second))
        level, hertz = _loudest((one - other) / math.sqrt(2.0), data.period)
        found.append((level if level > LOUD * float(np.std(one)) else 0.0, hertz))
    return max(found)


def _loudest(values: Floats, period: float) -> tuple[float, float]:
    """Level of the line that holds most of what is quick, and its frequency [Hz]; zeros where none does."""
    hertz, power = _spectrum(values, period)
    quick = hertz > HUNTS_ABOVE
    if not quick.any():
        return 0.0, 0.0
    peak = float(hertz[quick][np.argmax(power[quick])])
    line = quick & (np.abs(hertz - peak) <= NARROW * peak)
    if float(power[line].sum()) < MOST * float(power[quick].sum()):
        return 0.0, 0.0
    return math.sqrt(float(power[line].sum() * hertz[1])), peak


def _spectrum(values: Floats, period: float) -> tuple[Floats, Floats]:
    """Frequencies [Hz] and density of power, from windows of a second."""
    hertz, power = welch(values, 1.0 / period, nperseg=min(len(values), round(1.0 / period)))
    return np.asarray(hertz), np.asarray(power)
