"""What a single recording, without repeats, allows to be said about a candidate.

Held-out errors are predicted by a linear refit of all columns, which knows no bounds: it may run to a
negative Stribeck dip. No candidate gains more than its own fit, inside its bounds, lowers the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from autotune.diagnose.search import Level, Screened


def capped(level: Level, ranked: Sequence[Screened]) -> list[Screened]:
    """Candidates with gains that their own fits bear out, the best first."""
    cost = max(level.fitted.cost, 1e-300)
    found = [replace(item, gain=min(item.gain, 1.0 - item.fitted.cost / cost)) for item in ranked]
    return sorted(found, key=lambda item: -item.gain)
