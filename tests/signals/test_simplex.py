"""Descents side by side: each takes the steps that scipy's takes alone."""

import numpy as np
import pytest
import scipy

from autotune.signals.simplex import Descent, lowest_places

NEAR, FLAT, MOST, PROBING = 0.1, 0.01, 40, 15


class _Hills:
    """A bowl with waves on it, endless beyond a wall."""

    def __init__(self, random: np.random.Generator, size: int) -> None:
        self.matrix, self.middle = random.normal(size=(size, size)), 3.0 * random.normal(size=size)
        self.waves = float(random.uniform(0.5, 5.0))

    def __call__(self, place: np.ndarray) -> float:
        bowl = float(np.sum((self.matrix @ (place - self.middle)) ** 2))
        return bowl + self.waves * float(np.sum(np.sin(3.0 * place))) if place[0] < 4.0 else np.inf


def _alone(cost: _Hills, corners: np.ndarray, promised: float) -> np.ndarray:
    asked = 0

    def counted(place: np.ndarray) -> float:
        nonlocal asked
        asked += 1
        return cost(place)

    def in_vain(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        if asked >= PROBING and intermediate_result.fun > promised:
            raise StopIteration

    options = {"initial_simplex": corners, "maxfev": MOST, "xatol": NEAR, "fatol": FLAT}
    return scipy.optimize.minimize(
        counted, corners[0], method="Nelder-Mead", callback=in_vain, options=options
    ).x


@pytest.mark.parametrize("seed", range(20))
def test_each_descent_ends_where_it_ends_alone(seed: int) -> None:
    random = np.random.default_rng(seed)
    size, promised = int(random.integers(1, 6)), float(10.0 * random.normal())
    hills = [_Hills(random, size) for _ in range(3)]
    corners = [random.normal(size=(size + 1, size)) for _ in hills]
    passes = []

    def costs_of(places):
        passes.append(len(places))
        return [hills[number](place) for number, place in places]

    descents = [Descent(begun, NEAR, FLAT, MOST, PROBING, promised) for begun in corners]
    ends = lowest_places(descents, costs_of, lambda number, place: int(place[0] > 0.0), 8)
    for cost, begun, end in zip(hills, corners, ends, strict=True):
        np.testing.assert_array_equal(end, _alone(cost, begun, promised))
    assert len(passes) <= 2 * MOST  # what one needs next is looked at beside what the others need now
