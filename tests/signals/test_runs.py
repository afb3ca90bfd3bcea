"""Runs of chosen rows, and white noise on what goes smoothly on."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.signals.runs import runs_of, white_noise


@given(st.lists(st.booleans(), max_size=40))
def test_runs_are_the_chosen_rows_and_never_touch(chosen: list[bool]) -> None:
    runs = runs_of(np.array(chosen, dtype=np.bool_))
    rows = [row for start, stop in runs for row in range(start, stop)]
    assert rows == [row for row, one in enumerate(chosen) if one]
    assert all(before[1] < after[0] for before, after in itertools.pairwise(runs))


@pytest.mark.parametrize("size", [0.0, 0.02])
def test_noise_is_told_on_a_motion_that_leaps_now_and_then(size: float) -> None:
    """5 000 second differences tell it to some hundredths; the motion's own are ten thousand times smaller."""
    time = np.linspace(0.0, 20.0, 5_000)
    values = np.sin(time) + np.floor(time / 3.0) + size * np.random.default_rng(3).normal(size=len(time))
    assert white_noise(values) == pytest.approx(size, rel=0.08, abs=1e-4)
