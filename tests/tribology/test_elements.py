"""Distributed elements and Dahl's equation: alike on the virgin curve, apart after a reversal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError
from autotune.tribology.elements import after_reversal, dahl, distributed_elements, virgin_curve

SIZES = {"stiffness": 5e8, "break_away": 90.0}
REACH = SIZES["break_away"] / SIZES["stiffness"]


def test_both_follow_the_virgin_curve() -> None:
    x = np.linspace(0.0, 5 * REACH, 200)
    wanted = virgin_curve(x, **SIZES)
    assert distributed_elements(x, **SIZES) == pytest.approx(wanted, abs=2e-3 * SIZES["break_away"])
    assert dahl(x, **SIZES) == pytest.approx(wanted, abs=1e-9 * SIZES["break_away"])


def test_after_a_reversal_they_differ_by_half_the_break_away_force() -> None:
    path = np.concatenate([np.linspace(0.0, 12 * REACH, 600), np.linspace(12 * REACH, 4 * REACH, 600)[1:]])
    elements, dahls = distributed_elements(path, **SIZES), dahl(path, **SIZES)
    masing, closed = after_reversal(12 * REACH - path[600:], **SIZES)
    assert elements[600:] == pytest.approx(masing, abs=5e-3 * SIZES["break_away"])
    assert dahls[600:] == pytest.approx(closed, abs=1e-4 * SIZES["break_away"])
    assert np.max(elements - dahls) == pytest.approx(0.5 * SIZES["break_away"], rel=0.01)


@given(turns=st.lists(st.floats(-6.0, 6.0), min_size=2, max_size=6))
def test_elements_are_bounded_and_forget_inner_loops(turns: list[float]) -> None:
    """A closed inner loop leaves no trace: the outer branch goes on as if it had not been (Madelung's rule)."""
    path = np.concatenate([[0.0], np.array(turns)]) * REACH
    force = distributed_elements(path, **SIZES, elements=400)
    assert np.abs(force).max() <= SIZES["break_away"] * (1 + 1e-9)
    end = path[-1]
    looped = np.concatenate([path, [end - 0.3 * REACH, end]])
    if path[-1] > path[-2] + 0.3 * REACH:  # the loop stays within the last branch
        assert distributed_elements(looped, **SIZES, elements=400)[-1] == pytest.approx(
            force[-1], abs=1e-9 * SIZES["break_away"]
        )


def test_sizes_that_are_none() -> None:
    with pytest.raises(ConfigurationError, match="above zero"):
        dahl(np.zeros(2), stiffness=0.0, break_away=1.0)
