"""Where a history breaks: the best cut into straight pieces, found exactly.

    min over m and cuts of  Σ_k RSS_k / s² + β·m,   RSS_k: of the line through piece k, s: scatter of a point

by dynamic programming over all n²/2 pieces, their sums of squares from running sums (Bellman and Roth,
"Curve fitting by segmented straight lines", 1969). A piece is worth β only where chance could hardly make it.
"""

from __future__ import annotations

import numpy as np

from autotune.core.arrays import Floats

LEAST = 2  # points of a piece


def breaks(t: Floats, y: Floats, scatter: float, penalty: float) -> list[int]:
    """Indices at which a new piece begins, in order; none where one line does.

    Args:
        t, y: shape (n,), t in order. scatter: standard deviation of a point of y. penalty: β, in variances.
    """
    count = len(y)
    if count < 2 * LEAST:
        return []
    cost = _costs(t - t.mean(), y - y.mean()) / scatter**2 + penalty
    best = np.full(count + 1, np.inf)
    best[0] = 0.0
    came = np.zeros(count + 1, dtype=np.int64)
    for end in range(LEAST, count + 1):
        total = best[: end - LEAST + 1] + cost[: end - LEAST + 1, end]
        came[end] = int(np.argmin(total))
        best[end] = total[came[end]]
    found, end = [], count
    while (end := int(came[end])) > 0:
        found.append(end)
    return found[::-1]


def _costs(t: Floats, y: Floats) -> Floats:
    """Sum of squares about the line through points i to j − 1, at [i, j]; shape (n + 1, n + 1)."""

    def between(values: Floats) -> Floats:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(total[None, :] - total[:, None])

    size = np.maximum(between(np.ones_like(t)), 1.0)
    st, sy = between(t), between(y)
    stt = between(t * t) - st * st / size
    sty = between(t * y) - st * sy / size
    syy = between(y * y) - sy * sy / size
    return np.asarray(np.maximum(syy - sty**2 / np.maximum(stt, 1e-12), 0.0))
