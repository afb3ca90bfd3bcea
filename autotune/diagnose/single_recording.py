"""What a single recording, without repeats, allows to be said about a candidate.

Held-out errors are predicted by a linear refit of all columns, which knows no bounds: it may run to a
negative Stribeck dip. No candidate gains more than its own fit, inside its bounds, lowers the error. And
a fit whose parameters lie where the recording cannot show the effect is something else in disguise: play
below the encoder's count, a warming within seconds, a resonance beyond what is compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from autotune.core.arrays import Floats
from autotune.diagnose.candidates import Screened
from autotune.estimation.bandwidth import FASTEST, loud_below
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.coordinates import coordinates
from autotune.estimation.problem import Study
from autotune.models import layout
from autotune.models.reversal_memory import ELEMENTS
from autotune.models.table import EFFECTS

MOST_NEIGHBOURS, LEAST_NEIGHBOURS, NEIGHBOURS = 6000, 300, 40
APART = 0.5  # s
DYNAMIC = frozenset(
    {
        "elastic_transmission",
        "backlash",
        "encoder_eccentricity",
        "torque_lag",
        "torque_saturation",
        "load_dependent_friction",
        "reversal_memory",
        "dwell_time_break_away",
    }
)
"""Effects that live in quick changes of torque: not to be told where a column was filtered."""
OF_PLACE = frozenset(
    {"torque_ripple", "direction_asymmetry", "position_dependent_friction", "gravity_imbalance", "spring"}
)
"""Effects that show even where the sampling does not follow the torque."""
Credible = Callable[[Study, Floats], bool]


def capped(level: Level, ranked: Sequence[Screened]) -> list[Screened]:
    """Candidates with gains that their own fits bear out, the best first."""
    cost = max(level.fitted.cost, 1e-300)
    found = [replace(item, gain=min(item.gain, 1.0 - item.fitted.cost / cost)) for item in ranked]
    return sorted(found, key=lambda item: -item.gain)


def noticeable(study: Study, level: Level, item: Screened) -> bool:
    """Whether the effect is large enough to matter: less is as often the measurement chain as the axis."""
    part = math.sqrt(max(item.gain * level.fitted.cost, 0.0)) / study.scales.torque
    clear = (
        item.gain >= study.policy.clear_single_gain
        and item.z >= study.policy.clear_single_z
        and part >= study.policy.clear_single_part
    )
    return clear or part >= study.policy.least_part


def credible(study: Study, item: Screened) -> bool:
    """Whether this recording could show the effect with the parameters that were fitted."""
    if item.effect in DYNAMIC and study.data.filtered:
        return False
    if item.effect not in OF_PLACE and _highest(study) > study.policy.unresolved * _resolved(study):
        return False
    check = _CHECKS.get(item.effect)
    return check is None or check(study, item.fitted.packed.p)


def _value(p: Floats, effect: str, name: str) -> float:
    return float(p[EFFECTS[effect].parameter(name).slot])


def _warms_slowly(study: Study, p: Floats) -> bool:
    seconds = _value(p, "thermal_drift", "time_constant")
    return (
        seconds >= study.policy.least_warming
        and study.scales.seconds > study.policy.least_recording * study.policy.least_warming
    )


def _long_memory(study: Study, p: Floats) -> bool:
    """Whether the elements that carry most of the torque bend further than the encoder's grain."""
    lines = [n for n in range(1, ELEMENTS + 1) if _value(p, "reversal_memory", f"displacement_{n}") > 0.0]
    torque = np.array([_value(p, "reversal_memory", f"torque_{n}") for n in lines])
    reach = np.array([_value(p, "reversal_memory", f"displacement_{n}") for n in lines])
    mean = float(torque @ reach) / max(float(torque.sum()), 1e-300)
    return mean > study.policy.least_counts * study.data.resolution


def _rests_differ(study: Study, p: Floats) -> bool:
    """Whether the axis rested often, and for times that differ: else it is friction at every start."""
    data = study.data
    least = 0.002 * float(np.percentile(np.abs(data.velocity), 99.5))
    label, count = ndimage.label(np.abs(data.velocity) < least)
    rests = np.bincount(label)[1:] * data.period if count else np.zeros(0)
    rests = rests[rests > study.policy.shortest_rest]
    return len(rests) >= study.policy.least_rests and float(np.ptp(np.log(rests))) > math.log(
        study.policy.rest_ratio
    )


def _rings_in_band(study: Study, p: Floats) -> bool:
    share = _value(p, "elastic_transmission", "load_inertia")
    reduced = share * (1.0 - share) * float(p[layout.INERTIA])
    compliance = _value(p, "elastic_transmission", "compliance")
    if reduced <= 0.0 or compliance <= 0.0:
        return False
    hertz = 1.0 / (2.0 * math.pi * math.sqrt(compliance * reduced))
    return hertz < study.policy.resonance_beyond * _cutoff(study)


def _wide_gap(study: Study, p: Floats) -> bool:
    return _value(p, "backlash", "gap") > study.policy.least_counts * study.data.resolution


def _seen_eccentricity(study: Study, p: Floats) -> bool:
    size = math.hypot(*(_value(p, "encoder_eccentricity", name) for name in ("sin", "cos")))
    return size > study.data.resolution


def limits(study: Study) -> tuple[str, ...]:
    """What the sampling of a single recording does not allow to be told, in words."""
    if study.data.repeated or _highest(study) <= study.policy.unresolved * _resolved(study):
        return ()
    period = 1e3 * study.data.finer * study.data.period
    return (
        f"The torque holds frequencies up to {_highest(study):.3g} Hz, samples of {period:.3g} ms "
        f"allow {_resolved(study):.2g} Hz: only effects of place and direction can be told. Record faster, or "
        "move more gently.",
    )


def alike_where_motion_is(study: Study, error: Floats) -> bool:
    """Whether what is left is large and alike where the motion is alike, so that a model could explain more.

    Rows are compared with their nearest neighbours in position, velocity, acceleration and travel since the
    reversal, at another time; half their mean squared difference is what no function of these explains.
    """
    rows = np.flatnonzero(study.training > 0)
    rows = rows[:: max(1, len(rows) // MOST_NEIGHBOURS)]
    rest = error[rows]
    torque = study.data.torque[study.data.grid[rows]]
    if (
        study.data.repeated
        or len(rows) < LEAST_NEIGHBOURS
        or np.var(rest) < study.policy.large_rest**2 * np.mean(torque**2)
    ):
        return False
    table = coordinates(study.data)
    names = ("position", "velocity", "acceleration", "travel_since_reversal")
    place = np.column_stack([table[name][rows] for name in names])
    place = (place - place.mean(axis=0)) / np.maximum(place.std(axis=0), 1e-300)
    time = study.data.grid[rows] * study.data.period
    near = np.asarray(cKDTree(place).query(place, k=NEIGHBOURS)[1])
    apart = np.abs(time[near] - time[:, None]) > APART
    found = apart.any(axis=1)
    if found.mean() < 0.5:
        return False
    other = near[np.arange(len(rows)), np.argmax(apart, axis=1)]
    noise = 0.5 * float(np.mean((rest[found] - rest[other[found]]) ** 2))
    return noise < study.policy.most_noise * float(np.var(rest[found]))


def _highest(study: Study) -> float:
    """Frequency below which nearly all of the torque's power lies [Hz]; 0 where a twin accounts for it."""
    if study.twin or study.data.steady:
        return 0.0
    longest = max(study.data.stretches, key=lambda stretch: stretch.stop - stretch.start)
    every = study.data.finer
    torque = study.data.recorded_torque[longest.rows][::every]
    return loud_below(torque, every * study.data.period) if len(torque) > 64 else 0.0


def _resolved(study: Study) -> float:
    """Highest frequency that the samples of the file allow [Hz]."""
    return FASTEST / (study.data.finer * study.data.period)


def _cutoff(study: Study) -> float:
    return 0.9 / (study.data.period * max(len(study.data.taps) // 2, 1))


_CHECKS: Mapping[str, Credible] = {
    "thermal_drift": _warms_slowly,
    "reversal_memory": _long_memory,
    "dwell_time_break_away": _rests_differ,
    "elastic_transmission": _rings_in_band,
    "backlash": _wide_gap,
    "encoder_eccentricity": _seen_eccentricity,
}
