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

from autotune.diagnose.search import Level, Screened
from autotune.diagnose.study import Study
from autotune.models import layout
from autotune.models.lugre import Floats
from autotune.models.table import EFFECTS

COUNTS = 5.0
"""Of the encoder: shorter displacements and gaps cannot be seen."""
LEAST_WARMING = 5.0  # s
LEAST_RECORDING = 2.0  # time constants of warming
LEAST_RESTS = 6
REST_RATIO = 3.0
SHORTEST_REST = 0.05  # s
BEYOND = 1.5
"""Of the cut-off: the highest resonance that can be seen."""
Credible = Callable[[Study, Floats], bool]


def capped(level: Level, ranked: Sequence[Screened]) -> list[Screened]:
    """Candidates with gains that their own fits bear out, the best first."""
    cost = max(level.fitted.cost, 1e-300)
    found = [replace(item, gain=min(item.gain, 1.0 - item.fitted.cost / cost)) for item in ranked]
    return sorted(found, key=lambda item: -item.gain)


def credible(study: Study, item: Screened) -> bool:
    """Whether this recording could show the effect with the parameters that were fitted."""
    check = _CHECKS.get(item.effect)
    return check is None or check(study, item.fitted.packed.p)


def _value(p: Floats, effect: str, name: str) -> float:
    return float(p[EFFECTS[effect].parameter(name).slot])


def _warms_slowly(study: Study, p: Floats) -> bool:
    seconds = _value(p, "thermal_drift", "time_constant")
    return seconds >= LEAST_WARMING and study.scales.seconds > LEAST_RECORDING * LEAST_WARMING


def _long_memory(study: Study, p: Floats) -> bool:
    """Whether the elements that carry most of the torque bend further than the encoder's grain."""
    lines = [n for n in range(1, 6) if _value(p, "reversal_memory", f"displacement_{n}") > 0.0]
    torque = np.array([_value(p, "reversal_memory", f"torque_{n}") for n in lines])
    reach = np.array([_value(p, "reversal_memory", f"displacement_{n}") for n in lines])
    mean = float(torque @ reach) / max(float(torque.sum()), 1e-300)
    return mean > COUNTS * study.data.resolution


def _rests_differ(study: Study, p: Floats) -> bool:
    """Whether the axis rested often, and for times that differ: else it is friction at every start."""
    data = study.data
    least = 0.002 * float(np.percentile(np.abs(data.velocity), 99.5))
    label, count = ndimage.label(np.abs(data.velocity) < least)
    rests = np.bincount(label)[1:] * data.period if count else np.zeros(0)
    rests = rests[rests > SHORTEST_REST]
    return len(rests) >= LEAST_RESTS and float(np.ptp(np.log(rests))) > math.log(REST_RATIO)


def _rings_in_band(study: Study, p: Floats) -> bool:
    share = _value(p, "elastic_transmission", "load_inertia")
    reduced = share * (1.0 - share) * float(p[layout.INERTIA])
    compliance = _value(p, "elastic_transmission", "compliance")
    if reduced <= 0.0 or compliance <= 0.0:
        return False
    hertz = 1.0 / (2.0 * math.pi * math.sqrt(compliance * reduced))
    return hertz < BEYOND * _cutoff(study)


def _wide_gap(study: Study, p: Floats) -> bool:
    return _value(p, "backlash", "gap") > COUNTS * study.data.resolution


def _seen_eccentricity(study: Study, p: Floats) -> bool:
    size = math.hypot(*(_value(p, "encoder_eccentricity", name) for name in ("sin", "cos")))
    return size > study.data.resolution


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
