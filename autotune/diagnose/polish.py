"""More rounds for fits that two do not settle: two masses, and effects beside others.

What an unsettled fit leaves would look like a further effect, and a rival that has settled sooner like the
better name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from autotune.diagnose.families import FAMILIES, Context
from autotune.diagnose.prepared import TRAINING, VETO
from autotune.diagnose.search import Progress, Refitted, judged
from autotune.diagnose.settling import Level, settle
from autotune.diagnose.study import Study
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS

POLISHED = 0.99
NEARLY = 0.8
MOST_POLISHES, WORTH_POLISHING = 3, 0.02
PLAINER, AS_PLAIN = 1.2, 1.1
"""What a plain spring may leave of what a spring with a gap leaves, to be preferred: by itself, beside others."""
LOAD = ("load_inertia", "load_friction", "damping")


def without_needless_gap(study: Study, refits: Sequence[Refitted]) -> list[Refitted]:
    """The refits without backlash where an elastic transmission without a gap explains about as much."""
    found = {item.effect: item for item in refits}
    spring, gap = found.get("elastic_transmission"), found.get("backlash")
    if spring is None or gap is None or spring.share < NEARLY:
        return list(refits)
    if error_left(study, spring.level) > PLAINER * error_left(study, gap.level):
        return list(refits)
    return [item for item in refits if item is not gap]


def with_spring_for_gap(
    study: Study,
    root: Level,
    nominal: Packed,
    chosen: Refitted,
    refits: Sequence[Refitted],
    progress: Progress,
) -> Refitted:
    """An elastic transmission in place of backlash that was found first, where it does as well.

    As long as something else is missing, a gap takes a part of it over, and is preferred for that; and where a gap
    explains nearly all, the spring may not have been among the `refits`.
    """
    level = chosen.level
    tried = len(level.effects) < 2 and any(item.effect == "elastic_transmission" for item in refits)
    if "backlash" not in level.effects or tried or "elastic_transmission" not in FAMILIES:
        return chosen
    progress("an elastic transmission in place of backlash")
    p, on = level.fitted.packed.p.copy(), level.fitted.packed.on.copy()
    gap, spring = EFFECTS["backlash"], EFFECTS["elastic_transmission"]
    taken = {"compliance": "contact_compliance"} | {name: name for name in LOAD}
    start = next(FAMILIES[spring.name](Context(study, level.fitted, nominal)))
    for name, source in taken.items():
        p[spring.parameter(name).slot] = p[gap.parameter(source).slot]
    on[layout.flag(spring.name)], on[layout.flag(gap.name)] = True, False
    slots = {parameter.slot for parameter in gap.parameters}
    for slot in slots:
        p[slot] = root.fitted.packed.p[slot]
    free = [*(f for f in level.free if f.slot not in slots), *start.free]
    effects = tuple(spring.name if name == gap.name else name for name in level.effects)
    settled = settle(study, Packed(p, on), free, 2, effects, target=AS_PLAIN * level.fitted.cost)
    if settled is None or error_left(study, settled) > AS_PLAIN * error_left(study, level):
        return chosen
    effect = spring.name if chosen.effect == gap.name else chosen.effect
    return replace(judged(study, root, settled, effect), gain=chosen.gain)


def best_polished(
    study: Study, root: Level, refits: Sequence[Refitted], progress: Progress
) -> list[Refitted]:
    """The refit that leaves least, polished: beside another effect it has not settled after two rounds."""
    if not refits:
        return []
    best = min(refits, key=lambda item: error_left(study, item.level))
    if not NEARLY < best.share < POLISHED:
        return list(refits)
    done = polished(study, root, best, progress)
    return [replace(done, effect=best.effect, gain=max(best.gain, done.gain))]


def polished(study: Study, root: Level, chosen: Refitted, progress: Progress) -> Refitted:
    """More rounds of the same fit, as long as they help: two masses need them, and what they leave misleads."""
    for _ in range(MOST_POLISHES):
        level = chosen.level
        if level.settled:
            break
        progress(f"refinement with {' and '.join(level.effects)}")
        better = settle(study, level.fitted.packed, list(level.free), 4, level.effects, level.fitted)
        if better is None or better.fitted.cost >= level.fitted.cost:
            return replace(chosen, level=replace(level, settled=True))
        gained = 1.0 - better.fitted.cost / level.fitted.cost
        settled = better.settled or gained < WORTH_POLISHING
        chosen = judged(study, root, replace(better, settled=settled), chosen.effect)
        if chosen.share >= POLISHED:
            break
    return chosen


def error_left(study: Study, level: Level) -> float:
    """Error on training and veto together, each by its own share of the rows."""
    error = level.fitted.error
    total = study.mean_square(error, TRAINING)
    return total + (study.mean_square(error, VETO) if study.has(VETO) else 0.0)
