"""What a verdict says to people: rivals, what separates them, and what the data cannot tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Separation:
    """Effects that can look alike, and the experiment that tells them apart."""

    effects: frozenset[str]
    experiment: str


SEPARATIONS: tuple[Separation, ...] = (
    Separation(
        frozenset({"spring", "gravity_imbalance", "torque_ripple", "position_dependent_friction"}),
        "slow scans over several revolutions (or the whole travel), forward and backward",
    ),
    Separation(
        frozenset({"nonlinear_viscous", "backlash", "stribeck"}),
        "point-to-point moves, fast scans and a multisine, so that speed and reversals vary apart",
    ),
    Separation(
        frozenset({"torque_saturation", "load_dependent_friction"}),
        "point-to-point moves near the torque limit, then the same moves with another load",
    ),
    Separation(
        frozenset({"direction_asymmetry", "torque_saturation", "reversal_memory"}),
        "small loops inside presliding, and moves at high torque",
    ),
    Separation(
        frozenset({"torque_lag", "elastic_transmission", "backlash", "encoder_eccentricity"}),
        "a multisine up to 25 Hz and above",
    ),
    Separation(
        frozenset({"stribeck", "dwell_time_break_away", "reversal_memory"}),
        "starts after rests of 0.05 to 2.5 s, and slow triangles without any rest",
    ),
    Separation(
        frozenset({"thermal_drift", "stribeck", "dwell_time_break_away"}),
        "the same slow motion, repeated cold and after minutes of fast moves",
    ),
)
TORQUE_CONSTANT = (
    "A wrong torque constant cannot be seen in these data: all torques scale with it. An independent "
    "inertia or a known added mass would show it."
)
PROGRAMME = "autotune record AXIS.toml diagnosis --out FILE"
ELSEWHERE = (
    "record it with your own controller or scope, at least twice, and import both: autotune data import FILE"
)
"""Where the axis is not one that this program has recorded."""
MOST_NAMES = 4
"""In one sentence: a longer list tells nobody what to look at."""


def separating_experiment(rivals: Sequence[str], own_axis: bool) -> str:
    """The experiment that tells most of the rivals apart, in words, and how to come by it.

    Args:
        rivals: effects, the likeliest first.
        own_axis: whether the recordings came from an axis that this program can move.
    """
    best = max(SEPARATIONS, key=lambda item: (len(item.effects & set(rivals)), -len(item.effects)))
    told_apart = len(best.effects & set(rivals)) > 1
    words = best.experiment if told_apart else "small and large, slow and fast motion over the whole travel"
    names = [rival.replace("_", " ") for rival in rivals[:MOST_NAMES]]
    aim = f"To tell {' from '.join(names)}" if len(names) == 2 else f"To tell {', '.join(names)} apart"
    aim = aim if len(names) > 1 else "To learn more"
    how = f"record it: {PROGRAMME}" if own_axis else ELSEWHERE
    return f"{aim}, move the axis so: {words}; {how}"


def usual_rivals(effect: str) -> list[str]:
    """Effects that can look like this one."""
    rivals: dict[str, None] = {}
    for item in SEPARATIONS:
        if effect in item.effects:
            rivals |= dict.fromkeys(sorted(item.effects - {effect}))
    return list(rivals)
