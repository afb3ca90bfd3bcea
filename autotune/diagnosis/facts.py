"""What a verdict stands on: what a search found, what other trajectories said of it, and what speaks against it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from autotune.diagnosis.backward import MOTOR
from autotune.diagnosis.base_laws import without_effects
from autotune.diagnosis.candidates import (
    FittedCandidate,
    ScreenedCandidate,
    again_explained,
    exchanged_for,
    explained_of_rest,
    is_end_of,
)
from autotune.diagnosis.contact_laws import climbs_otherwise, is_a_memory
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.evidence import Evidence, HoldoutResult
from autotune.diagnosis.evidence.repeated import hunts_alike, limit_cycle
from autotune.diagnosis.evidence.time_driven import (
    Moment,
    TimeLine,
    acted_once,
    breathing_friction,
    louder_than_all,
    time_driven_line,
    without_line,
)
from autotune.diagnosis.free_shape import (
    OtherProportion,
    Relaxed,
    any_course,
    at_an_edge,
    like_a_motor,
    like_a_spring,
    like_a_weight,
    out_of_proportion,
    relaxing,
    with_free_shape,
    without_own_course,
)
from autotune.diagnosis.refits import REFINED, adds_beside, inside_twin, without_effect
from autotune.diagnosis.ripple_orders import candidate_orders
from autotune.diagnosis.search_state import Found
from autotune.diagnosis.starts import own_course
from autotune.diagnosis.transmission import GAP, SPRING, by_another_law, gap_is_told, hardly_a_gap
from autotune.diagnosis.wording import rms_unexplained
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.cross_validation import (
    Explained,
    beyond_presliding,
    gain_and_z,
    goes_with_place,
    still_explainable,
)
from autotune.estimation.data import TRAINING
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem
from autotune.models.gravity_imbalance import GRAVITY_IMBALANCE
from autotune.models.reversal_memory import REVERSAL_MEMORY, contact, stands_alone
from autotune.models.spring import SPRING as PULL
from autotune.models.table import EFFECTS, usual_rivals
from autotune.models.thermal_drift import WARMS
from autotune.models.torque_ripple import TORQUE_RIPPLE, scale_slot
from autotune.signals.missing_codes import Gap

OUTDONE = 1.5
"""Times the gain of what is named: what a candidate that could not pass may gain at most beside it."""
LAW_DIFFERS, LAW_LEAD = 0.9, 0.6
"""Share explained from which one effect is named though its law differs, and what another may gain of its gain."""
MOST_NOISE = 0.25
"""Of a recording's torque (rms): so loud is no sensor, and no disturbance of an axis that is used."""
LAWS_DIFFER = 0.85
"""The same of several effects, each of which explains half of what the others leave."""
LAW_DIFFERS_ALONE = 0.8
"""The same where all that can look like it was looked for too and is left behind: what takes the place of an effect
that was looked for loses to it, and what takes that of one that nobody knows explains less of both trajectories."""

OWN_FORM = 2 / 3
"""Of training and veto each: what a law with a form of its own explains at least where it is as likely as elements."""


@dataclass(frozen=True, slots=True)
class Facts:
    """All that a verdict depends on.

    Attributes:
        carried: what other trajectories said of the effects; `line`: a disturbance that follows the clock.
        coordinate, generic: the free function that gains most, and its gain.
        left: what the root leaves is more than noise, chance and the measurement chain make; where that is asked.
        overlooked: a candidate that gains too much to be nothing, though it cannot be named.
        by_twin_only: where there is no twin, a second mass that gains more than anything else: told, and no reason.
        rivals: effects that explain as much as the chosen one, or as that one of several in whose place they are.
        freed: those whose course was fitted freely, and whether their own law would have named them too.
        presliding: that of another law, which the root has.
        breathing: a friction level that rises and falls with the clock; looked for where nothing is named.
        once: a force that one repeat had for a while and another had not; looked for where nothing is named.
        climbing: something is left beside another law of presliding, but not where its contact slides: the law's own
            rest, where that law explains enough.
        unlike: an experiment in which one effect leaves what it explains in all others; looked for where it is named.
        edge: the one effect would go on beyond the bounds of its law; likewise.
        proportion: an effect that has two parts, and not as its law has them; likewise.
        relaxed: an effect of the place whose torque does not hold at rest; likewise.
        base: sentences on laws of the base that were found: they are no effects.
        spring: the chosen model with a spring where it has hardly a gap.
        unloaded: the chosen effects without a second mass among them, where that tells of it.
        bare: the root without the effects that the model was given with; where it has any, and nothing repeats.
        delayed: whether a dead time of some rows does as well as the lag that was found.
        each_told: several effects without a name explain most, and each of them half of what the others leave.
        cut_short: the time of the search was up before all was asked.
        hunts: frequency of a limit cycle with more torque than friction [Hz]; 0 where there is none.
        alike: whether the twin of the chosen model hunts as the axis does; looked for where it is named.
    """

    problem: Problem
    root: ModelFit
    chosen: FittedCandidate | None
    evidence: Evidence
    carried: Sequence[HoldoutResult]
    line: TimeLine | None
    coordinate: str
    generic: float
    lead: float
    rivals: tuple[str, ...]
    first: Sequence[ScreenedCandidate] = ()
    tried: Sequence[FittedCandidate] = ()
    freed: Mapping[str, bool] = field(default_factory=dict)
    presliding: FittedCandidate | None = None
    left: bool = True
    breathing: TimeLine | None = None
    once: Moment | None = None
    overlooked: ScreenedCandidate | None = None
    by_twin_only: ScreenedCandidate | None = None
    hunts: float = 0.0
    alike: bool = False
    climbing: bool = False
    unlike: str = ""
    edge: bool = False
    proportion: OtherProportion | None = None
    relaxed: Relaxed | None = None
    base: tuple[str, ...] = ()
    spring: FittedCandidate | None = None
    unloaded: ModelFit | None = None
    bare: ModelFit | None = None
    delayed: bool = False
    each_told: bool = False
    cut_short: bool = False

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Where the encoder leaves codes out: what the controller answers to then comes again, and is no effect."""
        return self.problem.data.gaps

    @property
    def loud(self) -> bool:
        """Whether more than noise usually is stays unexplained, and no repeats tell it from what is missing.

        Also with the rows that were left out: what the model lacks may be why they stand out.
        """
        if self.chosen is not None or self.evidence.repeats:
            return False
        whole = self.problem.data.role(TRAINING)
        parts = (rms_unexplained(self.problem, self.root, rows) for rows in (None, whole))
        return max(parts) > MOST_NOISE

    @property
    def drowned(self) -> bool:
        """What was found is smaller than a disturbance in time, and so may be its shadow.

        Or nothing was found, and a disturbance that is not of the mains is louder than all else: it has a cause.
        """
        if self.chosen is None and louder_than_all(self.problem.data):
            return True
        if self.line is None:
            return False
        if self.chosen is None:
            return self.line.share > 1.0 - self.line.share
        left = self.problem.mean_square(self.chosen.model_fit.fitted.error, TRAINING)
        fall = self.chosen.training.fall
        if self.evidence.repeats:
            fall = min(fall, again_explained(self.problem, self.root, self.chosen.model_fit))
        return fall < self.line.share * left

    @property
    def structured(self) -> bool:
        """A free function of one coordinate explains plainly more than any physics, and something is missing.

        What is missing is measured by leaving each experiment out. An effect that shows itself in one only (a motor
        that saturates in the fastest) never gains so, though repeats and the veto say that it explains all there is:
        where they do, nothing is missing.
        """
        chosen = self.chosen
        if self.plainly and self.left and not self._explained:
            return True
        if chosen is None or (self._or_a_spring and self.accepted):
            return False
        return any_course(self.problem, self.root, chosen.model_fit)

    @property
    def _or_a_spring(self) -> bool:
        """Whether a spring does as well along a lone trajectory: over so little travel it is the other smooth course.

        Which of the two it is, is in doubt, not that it is one of them.
        """
        return not self.evidence.repeats and PULL.name in self.rivals

    @property
    def _explained(self) -> bool:
        """Enough for a name of what repeats share, in the training and on the veto trajectory."""
        problem, chosen = self.problem, self.chosen
        known = self.evidence.repeats and problem.has_veto
        return known and chosen is not None and self.evidence.accepts(problem.policy, chosen)

    @property
    def plainly(self) -> bool:
        policy = self.problem.policy
        return self.generic > max(policy.generic_gain, policy.generic_lead * self.lead)

    @property
    def accepted(self) -> bool:
        """Enough is explained for a name, and a gap is no name for chance."""
        policy = self.problem.policy
        chosen = self.chosen
        return (
            chosen is not None
            and self.evidence.accepts(policy, chosen)
            and not self._needless_gap
            and (all(self.freed.values()) or self.leads)
            and not self._doubted
        )

    @property
    def _needless_gap(self) -> bool:
        """Hardly a gap, and no spring in its place was left behind."""
        problem, chosen, spring = self.problem, self.chosen, self.spring
        if chosen is None or not hardly_a_gap(problem.policy, chosen.model_fit):
            return False
        if spring is None or not self.evidence.apart(problem, chosen.model_fit, spring.model_fit):
            return True
        return not gap_is_told(problem, chosen, spring)

    @property
    def _doubted(self) -> bool:
        chosen = self.chosen
        return chosen is not None and self.evidence.doubted(
            self.problem, self.root, chosen.model_fit, self.first, self.unloaded, self.bare
        )

    @property
    def leads(self) -> bool:
        """No other effect gains nearly as much as the chosen one by its own law; several together always lead."""
        return self.chosen is not None and not self._unbeaten

    @property
    def _unbeaten(self) -> tuple[str, ...]:
        """Effects that gain nearly as much as a single chosen one, and are not far behind it inside the twin.

        What gains on the measured motion only, and inside the twin does not even partly explain it, is no rival. Nor is
        what is fitted inside the twin, its own course as free, and far behind the chosen one there.
        """
        chosen = self.chosen
        if chosen is None or len(chosen.model_fit.effects) > 1:
            return ()
        gains = [(item.effect, item.gain) for item in self.first]
        gains += [(item.effect, item.gain) for item in self.tried]
        own = max((gain for effect, gain in gains if effect == chosen.effect), default=chosen.gain)
        least = LAW_LEAD * max(own, chosen.gain)
        fitted = {item.effect: item for item in self.tried}
        if SPRING.name in fitted:  # what explains as much without a gap stands for one
            fitted.setdefault(GAP.name, fitted[SPRING.name])
        refuted = {item.effect for item in self.tried if item.share < self.problem.policy.partly}
        near = {effect for effect, gain in gains if gain > least} - {chosen.effect} - refuted
        if chosen.effect == SPRING.name in fitted and fitted[GAP.name] is fitted[SPRING.name]:
            near -= {GAP.name}  # given up for it: no rival of what explains as much
        near -= {one for one in self.rivals if self._any_course(fitted.get(one))}  # named beside it
        return tuple(
            effect
            for effect in sorted(near)
            if effect not in fitted or not self._far_behind(chosen, fitted[effect])
        )

    @property
    def contested(self) -> tuple[str, ...]:
        """Effects that keep the chosen one's free course from its name, where each explains nearly as much.

        As much of what the chosen one does as a name asks of all. One of them is missing; which, only another motion
        tells.
        """
        chosen, shares = self.chosen, {item.effect: item.share for item in self.tried}
        if chosen is None or self.accepted or self.law_differs or not self.freed:
            return ()
        if not self._explained or self._needless_gap or self._doubted:
            return ()
        alike = self._unbeaten
        least = self.problem.policy.named * min(chosen.share, 1.0)
        return alike if all(shares.get(one, 0.0) >= least for one in alike) else ()

    def _any_course(self, rival: FittedCandidate | None) -> bool:
        """Whether a rival's course could be any smooth one over so little travel."""
        return rival is not None and rival.effect in without_own_course(self.problem, rival.model_fit)

    def _far_behind(self, chosen: FittedCandidate, rival: FittedCandidate) -> bool:
        """Whether a rival errs more beyond chance, and nothing is left with the chosen one, with nothing excused.

        Or of what the rival leaves that can be explained the chosen one explains as much as a name asks of all. Or the
        rival adds next to nothing beside it: what both leave is the base's, and says nothing of either. That says
        nothing of a spring beside a gap, which has one in its contact, whichever of them is true; of one that hardens
        or relaxes, which no contact does, it says as much as of another effect.
        """
        problem, policy = self.problem, self.problem.policy
        if not self.evidence.apart(problem, chosen.model_fit, rival.model_fit):
            return False
        if chosen.plain_share >= REFINED:
            return True
        if _names_rest_of(problem, rival, chosen):
            return True
        if (chosen.effect, rival.effect) == (GAP.name, SPRING.name) and not by_another_law(rival.model_fit):
            return False
        return adds_beside(problem, self.root, chosen.model_fit, rival.model_fit) <= 1.0 - policy.named

    @property
    def outdone(self) -> str:
        """A candidate that is not named although it gains far more than all that is; empty where there is none."""
        if self.chosen is None or self.evidence.repeats:
            return ""
        own = gain_and_z(self.root.unseen, self.chosen.model_fit.unseen)[0]
        own = max(own, self.chosen.gain)
        others = [item for item in self.first if item.effect not in self.chosen.model_fit.effects]
        best = max(others, key=lambda item: item.gain, default=None)
        return best.effect if best is not None and best.gain > OUTDONE * own else ""

    @property
    def law_differs(self) -> bool:
        """One effect explains most of the error, far ahead of any other, but not all that its place holds; or several.

        A spring between two masses takes the shape of much that a twin is not, with stiffness, damping and shares free:
        it must explain more than others. A gap need not: nothing in a loop has a width.
        """
        chosen = self.chosen
        if chosen is None or not self.evidence.repeats or not self.problem.has_veto:
            return False
        if self._needless_gap or self._doubted:
            return False
        if len(chosen.model_fit.effects) > 1:
            return self.each_told
        return chosen.share >= self._least_by_another_law(chosen.effect) and self.leads

    def _least_by_another_law(self, effect: str) -> float:
        """Share explained that names an effect whose law differs."""
        return LAW_DIFFERS_ALONE if _alone(self.problem, effect) else LAW_DIFFERS

    @property
    def veto_silent(self) -> bool:
        """On the veto trajectory less than half is explained unless what is left there is excused: it tells nothing."""
        veto = self.chosen.veto if self.chosen is not None else None
        return veto is not None and veto.plain_share < self.problem.policy.partly

    @property
    def little_told(self) -> bool:
        """Named for less than what names an effect that look-alikes might stand for, or several: suspected at best."""
        if self.accepted or self.chosen is None:
            return False
        return self.chosen.share < LAW_DIFFERS or len(self.chosen.model_fit.effects) > 1

    @property
    def shared_out(self) -> bool:
        """Whether one of several effects explains less than a name asks of what the others leave: suspected at best.

        All together explain enough; but beside that one's part what is left of training and veto is no crumb, and what
        leaves it (another law of the first effect, or of the base) may have lent it that part, too.
        """
        problem, chosen = self.problem, self.chosen
        if chosen is None or len(chosen.model_fit.effects) < 2 or not self.evidence.repeats:
            return False
        for parts in _parts_of_each(problem, self.root, chosen.model_fit):
            fall, left = sum(part.fall for part in parts), sum(part.left for part in parts)
            if left > (1.0 - problem.policy.named) * (fall + left):
                return True
        return False

    @property
    def all_contact(self) -> bool:
        """Whether a memory was found beside which no contact is left that forgets: suspected at best.

        A memory is told by what it adds to a contact. Where its own fit closes the small loops of all friction, and no
        gap parts its elements, it is only another writing of one contact of many, and no data tell the two apart.
        """
        chosen = self.chosen
        if chosen is None or REVERSAL_MEMORY.name not in chosen.model_fit.effects:
            return False
        packed = chosen.model_fit.fitted.packed
        return stands_alone(packed.p, packed.on)

    @property
    def own_law(self) -> bool:
        """Another law of presliding explains enough, and nothing else was found."""
        with_it = replace(self, chosen=self.presliding, freed={})
        return self.chosen is None and not self.left and (with_it.accepted or with_it.law_differs)


def gathered(found: Found, carried: Sequence[HoldoutResult]) -> Facts:
    """The facts of a search and of other trajectories."""
    problem, root, chosen = found.problem, found.root, found.chosen
    evidence = evidence_of(problem.data)
    own = [] if found.presliding is None or found.sliding is not None else [found.presliding.gain]
    lead = max((*own, *(item.gain for item in found.first)), default=0.0)
    if chosen is not None:
        lead = max(lead, gain_and_z(root.unseen, chosen.model_fit.unseen)[0])
    coordinate, generic = max(found.generic.items(), key=lambda item: item[1], default=("", 0.0))
    final = found.model_fit
    line = time_driven_line(problem, final.fitted.error)
    several = chosen is not None and len(chosen.model_fit.effects) > 1
    fits = found.exchanged if several else found.tried
    contest = [item for item in fits if item.effect not in found.told_apart]
    sought = _rivals_beside if several else _rivals
    rivals = tuple(sought(problem, evidence, root, chosen, contest)) if chosen is not None else ()
    seen = (problem, root, chosen, evidence, carried, line, coordinate, generic, lead, rivals)
    hunts = limit_cycle(problem, contact(root.fitted.packed.p, root.fitted.packed.on)[0])
    freed = chosen.freed if chosen is not None else {}
    facts = Facts(
        *seen, found.first, found.tried, freed, found.presliding, hunts=hunts, base=found.base,
        spring=found.spring, unloaded=found.unloaded, delayed=found.delayed, cut_short=found.cut_short,
        bare=None if chosen is None or evidence.repeats else without_effects(problem, root),
    )  # fmt: skip
    facts = replace(facts, each_told=_each_told(facts))
    named = (facts.accepted or facts.law_differs or bool(facts.contested)) and not facts.structured
    if named and chosen is not None:
        facts = replace(facts, alike=hunts > 0.0 and hunts_alike(problem, chosen.model_fit.fitted.packed))
        facts = replace(facts, proportion=out_of_proportion(problem, root, chosen.model_fit))
        facts = replace(facts, relaxed=relaxing(problem, chosen.model_fit))
    if named and several and not rivals and PULL.name not in found.told_apart:
        facts = replace(facts, rivals=_springs_as_well(facts))
    if named and chosen is not None and not several:
        unlike = evidence.unlike_in_one(problem, root, chosen.model_fit)
        facts = replace(facts, unlike=unlike, edge=at_an_edge(problem, chosen.model_fit))
        behind = [one for one in facts.rivals if _left_behind(facts, one)]
        doubtful = tuple(one for one in facts.rivals if one not in behind)
        facts = replace(facts, rivals=doubtful or _untold(facts, found.told_apart, behind))
    if named:
        return _or_a_ripple(_or_a_weight(facts, found.told_apart), found.told_apart)
    facts = replace(facts, overlooked=evidence.overlooked(problem, root, [*found.first, *found.without_twin]))
    facts = replace(facts, by_twin_only=_leading_mass(problem.policy, found))
    if found.cut_short and not facts.plainly:  # nothing of what is asked below changes the verdict
        return facts
    # beside friction that warms, what is left of its slow course is no preload that something moves
    slow = evidence.repeats and not final.fitted.packed.on[WARMS]
    facts = replace(facts, breathing=breathing_friction(problem, final) if slow else None)
    facts = replace(facts, once=acted_once(problem, final) if evidence.repeats else None)
    left = _something_left(facts, found.sliding or problem)
    left = left or (chosen is None and _of_place(problem, root))
    climbing = found.sliding is not None and not left and _something_left(facts, problem)
    return replace(facts, left=left, climbing=climbing)


def _leading_mass(policy: Policy, found: Found) -> ScreenedCandidate | None:
    """The second mass that gains more along the measured motion than anything else, beyond doubt; None where none does.

    What halves the error on unseen experiments is a reason for "unknown" (`Evidence.overlooked`); what gains less is
    none, and still the first thing to look for.
    """
    best = max(found.without_twin, key=lambda item: item.gain, default=None)
    others = max((item.gain for item in found.first), default=0.0)
    if best is None or best.gain < max(policy.clear_gain, others) or best.z < policy.least_z:
        return None
    return best


def _or_a_weight(facts: Facts, told_apart: Sequence[str]) -> Facts:
    """The facts with the weight among the rivals that may stand for a spring by another law."""
    chosen, weight = facts.chosen, GRAVITY_IMBALANCE.name
    if chosen is None or weight in (*facts.rivals, *told_apart, *chosen.model_fit.effects):
        return facts
    alike = facts.evidence.alike(facts.problem)
    as_well = like_a_weight(facts.problem, facts.root, chosen.model_fit, alike)
    return replace(facts, rivals=(*facts.rivals, weight)) if as_well else facts


def _or_a_ripple(facts: Facts, told_apart: Sequence[str]) -> Facts:
    """The facts with a ripple among the rivals of a weight behind a gear that needs a second wave a turn.

    A weight makes one wave a turn of its load; with a lever that changes, two. A ripple of a belt or a gear has any
    order and any number of them.
    """
    chosen, ripple = facts.chosen, TORQUE_RIPPLE.name
    if chosen is None or GRAVITY_IMBALANCE.name not in chosen.model_fit.effects:
        return facts
    if ripple in (*facts.rivals, *told_apart) or ripple not in {
        kind.name for kind in facts.problem.candidates
    }:
        return facts
    own = {name: GRAVITY_IMBALANCE.slot(name) for name in ("order", "sin_2", "cos_2")}
    free = {one.slot for one in chosen.model_fit.free}
    geared = own["order"] in free and not free.isdisjoint((own["sin_2"], own["cos_2"]))
    return replace(facts, rivals=(*facts.rivals, ripple)) if geared else facts


def _each_told(facts: Facts) -> bool:
    """Whether several effects explain most, and each of them half of what the others leave of training and veto.

    Where one of them may be another one that was not looked for, that is not enough, nor where one is a spring between
    two masses (`Facts.law_differs`): what names an effect by another law is asked of them all.
    """
    problem, chosen = facts.problem, facts.chosen
    if chosen is None or facts.accepted or len(chosen.model_fit.effects) < 2 or not facts.evidence.repeats:
        return False
    alone = all(_alone(problem, effect) for effect in chosen.model_fit.effects)
    if chosen.share < (LAWS_DIFFER if alone else LAW_DIFFERS):
        return False
    return all(
        parts and all(part.plain_share >= problem.policy.partly for part in parts)
        for parts in _parts_of_each(problem, facts.root, chosen.model_fit)
    )


def _alone(problem: Problem, effect: str) -> bool:
    """Whether all that can look like an effect was looked for; of a spring between two masses nobody can say so."""
    sought = {kind.name for kind in problem.candidates}
    return effect != SPRING.name and sought.issuperset(usual_rivals(effect))


def _parts_of_each(problem: Problem, root: ModelFit, model_fit: ModelFit) -> Iterator[list[Explained]]:
    """What each of several effects explains of what the others leave, of training and veto; none where it is needed for
    a twin that is stable."""
    for effect in model_fit.effects:
        less = without_effect(problem, root, model_fit, effect)
        yield explained_of_rest(problem, less.model_fit, model_fit) if less is not None else []


def _of_place(problem: Problem, root: ModelFit) -> bool:
    return goes_with_place(beyond_presliding(problem, root.fitted.packed), root.fitted)


def _untold(facts: Facts, told_apart: Sequence[str] = (), behind: Sequence[str] = ()) -> tuple[str, ...]:
    """Look-alikes of one effect that is not quite what these data show: those that gain half as much, or were no
    candidates; not what such an axis cannot have.
    """
    problem, chosen = facts.problem, facts.chosen
    if chosen is None:
        return ()
    alike = facts.evidence.alike(problem)
    motor = like_a_motor(problem, facts.root, chosen.model_fit, alike)
    spring = like_a_spring(problem, facts.root, chosen.model_fit, alike)
    else_as_well = facts.edge or motor or spring
    if not (else_as_well or facts.unlike or not own_course(problem, chosen.model_fit, chosen.effect)):
        return ()
    gains = {item.effect: item.gain for item in facts.first}
    # what only one experiment shows gains nothing while that is held out
    gained = max(gains.get(chosen.effect, chosen.gain), chosen.gain)
    least = max(problem.policy.rival_gain * gained, problem.policy.least_gain)
    unit = problem.data.metadata.motion_unit
    alike_to = [*usual_rivals(chosen.effect), *((PULL.name, *usual_rivals(PULL.name)) if spring else ())]
    alike_to = [one for one in dict.fromkeys(alike_to) if one != chosen.effect]
    near = [one for one in alike_to if EFFECTS[one].is_of(unit)]
    as_well = {MOTOR} if motor and not _errs_more(facts, MOTOR) else set()
    gained_by = {one: gains[one] if one in gains else _unsought(facts, one) for one in near}
    near = [one for one in near if one in as_well or gained_by[one] >= least]
    near = [one for one in near if one not in told_apart]
    if else_as_well:
        return tuple(near)
    return tuple(one for one in near if one not in behind and not _explained_away(facts, one))


def _errs_more(facts: Facts, rival: str) -> bool:
    """Whether a rival was followed inside the twin and errs more there, beyond chance."""
    problem, chosen = facts.problem, facts.chosen
    fits = [item.model_fit for item in facts.tried if item.effect == rival]
    return chosen is not None and any(facts.evidence.apart(problem, chosen.model_fit, one) for one in fits)


def _springs_as_well(facts: Facts) -> tuple[str, ...]:
    """The spring that may stand for one of several effects, which over so little travel could be any smooth course."""
    problem, chosen = facts.problem, facts.chosen
    if chosen is None:
        return ()
    found, alike = chosen.model_fit, facts.evidence.alike(problem)
    shapeless = without_own_course(problem, found)
    as_well = any(like_a_spring(problem, facts.root, found, alike, effect) for effect in shapeless)
    return (PULL.name,) if as_well else ()


def _left_behind(facts: Facts, rival: str) -> bool:
    """Whether the chosen effect leaves nothing, with nothing excused, and a rival's rest is explained by it."""
    chosen = facts.chosen
    if chosen is None or chosen.plain_share < REFINED or _certain(chosen):
        return False
    return _explained_away(facts, rival)


def _explained_away(facts: Facts, rival: str) -> bool:
    """Whether what an effect leaves is there beyond doubt, and the chosen one explains as much of it as a name asks.

    The rival is followed inside the twin for it, its own course as free. One that was no candidate is never refuted.
    Where there is no time for that, only one is that was followed there, and explains less than half.
    """
    problem, chosen = facts.problem, facts.chosen
    best = _followed(facts, rival) if facts.cut_short else _with_own_course(facts, rival)
    if chosen is None or best is None or not _certain(best):
        return False
    if facts.cut_short and best.share >= problem.policy.partly:
        return False
    if not facts.evidence.apart(problem, chosen.model_fit, best.model_fit):
        return False
    return _names_rest_of(problem, best, chosen)


def _names_rest_of(problem: Problem, rival: FittedCandidate, chosen: FittedCandidate) -> bool:
    """Whether of what a rival leaves that can be explained a candidate explains as much as a name asks of all."""
    parts = explained_of_rest(problem, rival.model_fit, chosen.model_fit)
    return all(part.share >= problem.policy.named for part in parts)


def _certain(item: FittedCandidate) -> bool:
    """Whether a model leaves something that repeats beyond doubt."""
    return item.training.certain or (item.veto is not None and item.veto.certain)


def _followed(facts: Facts, effect: str) -> FittedCandidate | None:
    """An effect as it was fitted inside the twin by itself; None where it was not."""
    return next((one for one in facts.tried if one.effect == effect), None)


def _with_own_course(facts: Facts, effect: str) -> FittedCandidate | None:
    """An effect fitted inside the twin, its course free where that explains more; None where it was no candidate."""
    problem, root = facts.problem, facts.root
    item = _followed(facts, effect)
    if item is None:
        screened = next((one for one in facts.first if one.effect == effect), None)
        item = inside_twin(problem, root, root, screened) if screened is not None else None
    if item is None:
        return None
    return with_free_shape(problem, root, root.fitted.packed, item) or item


def _unsought(facts: Facts, effect: str) -> float:
    """What an effect that was no candidate may gain: nothing where it was looked for and no term of it stood out."""
    kind, problem = EFFECTS[effect], facts.problem
    if effect == REVERSAL_MEMORY.name and _remembers_in_the_base(facts):
        return 0.0
    if not kind.may_grow or kind not in problem.candidates:
        return math.inf
    orders = candidate_orders(problem, float(facts.root.fitted.packed.p[scale_slot()]))
    return 0.0 if len(orders) > 0 else math.inf


def _remembers_in_the_base(facts: Facts) -> bool:
    """Whether elements of the contact stand where a memory would, and none that go on beyond it would gain anything."""
    chosen = facts.chosen
    if chosen is None or not climbs_otherwise(facts.root.fitted.packed):
        return False
    return not is_a_memory(facts.problem, chosen.model_fit)


def _something_left(facts: Facts, rows: Problem) -> bool:
    """Whether what the root leaves is more than noise; a disturbance that follows the clock is taken out first.

    `rows`: the problem on those rows that tell; beside another law of presliding where its contact slides.
    So it is where the chosen effect, or the best of those that were tried, lowers what repeats share by as much, and by
    more than the measurement chain may leave of it; not what is there by chance only. Or where one that is not named
    halves the error of experiments held out (beside another law of presliding that may be the law's own rest). Without
    repeats a gain on unseen stretches says it.
    """
    problem, root, evidence, chosen = facts.problem, facts.root, facts.evidence, facts.chosen
    if not evidence.repeats and (chosen is not None or facts.plainly):
        return True
    if facts.overlooked is not None and not (evidence.repeats and facts.presliding is not None):
        return True
    told = chosen or max(facts.tried, key=lambda item: item.share, default=None)
    if evidence.repeats and told is not None and told.share >= problem.policy.partly:
        noise = problem.noise_variance(root.fitted.error, TRAINING)
        least = evidence.rest_that_is_none(problem, root.fitted.error, noise)
        least = max(least, problem.policy.structure_part * noise)
        there = still_explainable(problem, root.fitted, root.correction, TRAINING)
        if min(again_explained(problem, root, told.model_fit), there) > least:
            return True
    if facts.line is not None:
        error = without_line(problem, root.fitted.error, facts.line)
        root = replace(root, fitted=replace(root.fitted, error=error))
    return evidence.structure_left(rows, root)


def _rivals(
    problem: Problem,
    evidence: Evidence,
    root: ModelFit,
    chosen: FittedCandidate,
    tried: Sequence[FittedCandidate],
) -> list[str]:
    """Single effects that explain as much as the chosen single one, or stand beside elements by a form of their own."""
    of_elements = EFFECTS[chosen.effect].approximate
    return [
        item.effect
        for item in tried
        if item.effect != chosen.effect
        and (_does_as_well(problem, evidence, root, chosen, item) or (of_elements and item.share >= OWN_FORM))
    ]


def _does_as_well(
    problem: Problem, evidence: Evidence, root: ModelFit, chosen: FittedCandidate, item: FittedCandidate
) -> bool:
    """Whether a single effect explains as much as the chosen one; hardly a gap is no rival of a spring.

    Nor is what becomes the chosen one at an end of its parameters: that cannot explain less. What need not be excused
    in the chosen one is not excused in a rival.
    """
    if not item.named or is_end_of(chosen, item):
        return False
    named = problem.policy.named
    if chosen.plain_share >= named > item.plain_share:
        return False
    gap_for_spring = chosen.effect == SPRING.name and item.effect == GAP.name
    if gap_for_spring and hardly_a_gap(problem.policy, item.model_fit):
        return False
    return evidence.comes_near(problem, root, chosen, item)


def _rivals_beside(
    problem: Problem,
    evidence: Evidence,
    root: ModelFit,
    chosen: FittedCandidate,
    exchanged: Sequence[FittedCandidate],
) -> list[str]:
    """Effects that explain as much as one of several does beside the others, of what it explains beyond them."""
    near: list[str] = []
    for item in exchanged:
        own, new = exchanged_for(chosen, item)
        if len(own) != 1 or len(new) != 1:  # what was chosen is another set since
            continue
        others = without_effect(problem, root, chosen.model_fit, own.pop())
        before = others.model_fit if others is not None else root
        if (item.named or not chosen.named) and evidence.comes_near(problem, before, chosen, item):
            near += new
    return list(dict.fromkeys(near))
