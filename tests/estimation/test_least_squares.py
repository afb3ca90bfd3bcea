"""Steps of a fit: as low as the quadratic model goes inside their box, and none that keeps little of its promise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from autotune.core.arrays import Floats
from autotune.estimation.least_squares import (
    Fitted,
    Free,
    Steps,
    _lowest_in_box,
    _Place,
    _Problem,
    done_together,
    followed,
    followed_within,
    with_values,
)
from autotune.models.drive_model import Packed

SPEEDS = np.linspace(0.02, 4.0, 400)
KNEE = 0.4


@pytest.mark.parametrize("seed", range(6))
def test_a_step_is_the_lowest_place_in_its_box(seed: int) -> None:
    random = np.random.default_rng(seed)
    table = random.normal(size=(9, 6)) * 10.0 ** random.uniform(-2.0, 1.0, 6)
    wanted = random.normal(size=9)
    low, high = -(10.0 ** random.uniform(-2.0, 1.0, 6)), 10.0 ** random.uniform(-2.0, 1.0, 6)

    step = _lowest_in_box(table.T @ table, -table.T @ wanted, low, high)

    best = lsq_linear(table, wanted, (low, high), method="bvls").x
    assert np.all((low <= step) & (step <= high))
    assert np.sum((table @ step - wanted) ** 2) <= np.sum((table @ best - wanted) ** 2) * (1.0 + 1e-9)


def test_a_step_that_leads_uphill_in_its_own_model_is_none() -> None:
    """Held at the bounds that each of them goes beyond, both would go up: the second only follows the first there."""
    matrix, slope = np.array([[1.0, 0.99], [0.99, 1.0]]), np.array([-2.0, -1.9])

    step = _lowest_in_box(matrix, slope, np.array([-1.0, -1.0]), np.array([1.0, 1.0]))

    assert step == pytest.approx([1.0, 0.91])


class _Curved(_Problem):
    """torque·speed^exponent, beside a friction that is linear in speed: of an asinh."""

    def error(self, p: Floats) -> Floats:
        return np.asarray(p[0] * SPEEDS + p[1] * SPEEDS ** p[2] - np.arcsinh(SPEEDS / KNEE))

    def _places(self, models: Sequence[Packed], correction: Floats) -> Steps[list[_Place | None]]:
        yield from ()
        return [self._place(packed, self.error(packed.p), correction) for packed in models]


def test_a_step_that_is_hardly_lower_than_its_start_is_compared_with_shorter_ones() -> None:
    none = cast(Any, None)
    free = (
        Free("viscous", 0, 0.0, 9.0, 1.0),
        Free("torque", 1, 0.0, 9.0, 0.5),
        Free("exponent", 2, 0.1, 3.0, 1.0, 2.5),
    )
    weight = np.ones(len(SPEEDS))
    problem = _Curved(none, weight > 0.0, weight, free, None, None)
    p = np.array([0.9, 0.2, 1.8])
    here = problem._place(Packed(p, np.zeros(0, dtype=np.bool_)), problem.error(p), np.zeros(len(SPEEDS)))
    shape = p[1] * SPEEDS ** p[2] * np.log(SPEEDS)
    columns = np.column_stack([SPEEDS, SPEEDS ** p[2], shape]) * [one.scale for one in free]
    normal, slope = problem.linearised(here, columns)

    steps = problem.downhill(here, normal, slope, 1e-4, np.array([one.scale for one in free]))
    ((found, damping),) = done_together([steps], none)

    assert found is not None
    assert found.cost < 0.5 * here.cost
    assert damping > 1e-4  # the first of them is lower than its start, by a tenth


@pytest.mark.parametrize("lower", [-np.inf, 0.0])
def test_parameters_follow_an_error_no_further_than_their_bounds(lower: float) -> None:
    """Friction below zero would take up what speed leaves; where it must not, inertia takes what it can beside it."""
    random = np.random.default_rng(5)
    jacobian = random.normal(size=(400, 2)) @ np.array([[1.0, 0.3], [0.0, 1.0]])
    free = (Free("inertia", 0, 0.0, np.inf, 1.0), Free("viscous", 1, lower, np.inf, 1.0))
    scales, values, weight = np.array([2.0, 0.5]), np.array([1.0, 0.2]), np.ones(400)
    error = jacobian @ np.array([0.4, 3.0])  # viscous friction would follow to 0.2 − 3·0.5
    fitted = Fitted(Packed(values, np.zeros(1, dtype=np.bool_)), free, error, jacobian, scales, 1.0)
    left = followed_within(fitted, error, weight)
    if np.isinf(lower):
        np.testing.assert_array_equal(left, followed(jacobian, error, weight))
        assert np.std(left) < 1e-9
        return
    bounds = [-np.inf, -np.inf], [values[0] / scales[0], values[1] / scales[1]]
    expected = error - jacobian @ lsq_linear(jacobian, error, bounds).x
    np.testing.assert_allclose(left, expected, atol=1e-6)
    assert np.std(left) > 1.0


def test_a_parameter_stays_above_so_many_times_another() -> None:
    """As a stiffness above what lets a contact slide within the travel, whatever its friction becomes."""
    friction = Free("coulomb", 0, 0.0, 100.0, 1.0)
    stiffness = Free("stiffness", 1, 5.0, 1e6, 1.0, above=0, times=4.0)
    free = [friction, stiffness]

    moved = with_values(Packed(np.array([10.0, 400.0]), np.zeros(1, bool)), free, np.array([20.0, 1.0]))

    assert moved.p == pytest.approx([20.0, 80.0])
    assert [one.least(moved.p) for one in free] == [0.0, 80.0]
    assert stiffness.least(np.array([1.0, 80.0])) == 5.0
