"""Spring or gap: which of two transmissions that look alike is between motor and load.

Backlash has a spring in its flanks and one parameter more. As long as another effect is missing, a gap takes a part
of it over; and a small gap that is begun far from its size looks worse than a spring. So each is tried in the
other's place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from autotune.diagnose.candidates import Progress, Refitted, judged
from autotune.diagnose.further_rounds import error_left
from autotune.diagnose.starts import FAMILIES, Context
from autotune.estimation.bias_corrected_fit import Level, settle_somewhere
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Study
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS

SPRING, GAP = "elastic_transmission", "backlash"
OF_THE_GAP = {"compliance": "contact_compliance"} | {
    name: name for name in ("load_inertia", "load_friction", "damping")
}
"""Parameters of a spring that begin at those of a gap."""


def without_needless_gap(study: Study, refits: Sequence[Refitted]) -> list[Refitted]:
    """The refits without backlash where an elastic transmission without a gap explains about as much."""
    found = {item.effect: item for item in refits}
    spring, gap = found.get(SPRING), found.get(GAP)
    if spring is None or gap is None or spring.share < study.policy.nearly:
        return list(refits)
    if error_left(study, spring.level) > study.policy.spring_instead * error_left(study, gap.level):
        return list(refits)
    return [item for item in refits if item is not gap]


def the_other_tried(
    study: Study,
    root: Level,
    nominal: Packed,
    chosen: Refitted,
    seen: Sequence[Level],
    progress: Progress,
) -> Refitted:
    """The chosen model with the other transmission, where that does better.

    A spring is tried for every gap; a gap for a spring where that alone does not explain enough, and the gap was not
    `seen` by itself.
    """
    effects = chosen.level.effects
    if GAP in effects:
        least = (
            study.policy.spring_instead
            if hardly_a_gap(study.policy, chosen.level.fitted.packed)
            else study.policy.spring_instead_beside
        )
        return _in_place_of(study, root, nominal, chosen, GAP, SPRING, least, progress)
    if effects == (SPRING,) and not chosen.named and all(level.effects != (GAP,) for level in seen):
        return _in_place_of(study, root, nominal, chosen, SPRING, GAP, study.policy.gap_instead, progress)
    return chosen


def hardly_a_gap(policy: Policy, packed: Packed) -> bool:
    """Whether the flanks give way by far more than the gap already at the torque of friction."""
    gap, compliance = (packed.p[EFFECTS[GAP].parameter(name).slot] for name in ("gap", "contact_compliance"))
    return bool(gap < policy.hardly_a_gap * compliance * packed.p[layout.COULOMB])


def _in_place_of(
    study: Study,
    root: Level,
    nominal: Packed,
    chosen: Refitted,
    old: str,
    new: str,
    least: float,
    progress: Progress,
) -> Refitted:
    """The chosen model with `new` for `old` if that leaves at most `least` of the error."""
    if new not in study.candidates:
        return chosen
    progress(f"{new} in place of {old}")
    level = chosen.level
    was, becomes = EFFECTS[old], EFFECTS[new]
    slots = {parameter.slot for parameter in was.parameters}
    starts: list[Packed] = []
    begun = list(FAMILIES[new](Context(study, level.fitted, nominal)))
    for start in begun[:1] if new == SPRING else begun:
        p, on = start.packed.p.copy(), start.packed.on.copy()
        for name, source in OF_THE_GAP.items() if new == SPRING else ():
            p[becomes.parameter(name).slot] = p[was.parameter(source).slot]
        p[list(slots)] = root.fitted.packed.p[list(slots)]
        on[layout.flag(old)] = False
        starts.append(Packed(p, on))
    free = [*(f for f in level.free if f.slot not in slots), *begun[-1].free]
    effects = tuple(new if name == old else name for name in level.effects)
    cost = level.fitted.cost
    settled = settle_somewhere(study, starts, 0.0, free, effects, max(least, 1.0) * cost)
    if settled is None or error_left(study, settled) > least * error_left(study, level):
        return chosen
    effect = new if chosen.effect == old else chosen.effect
    return replace(judged(study, root, settled, effect), gain=chosen.gain)
