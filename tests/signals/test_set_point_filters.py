"""Filters of set points, against the same on a far finer raster."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.signals.set_point_filters import SET_POINT_FILTERS, equal_lags, running_mean

FINE = 200
MEAN, *LAGS = range(len(SET_POINT_FILTERS))


def _on_lines() -> tuple[np.ndarray, np.ndarray]:
    """Values that wander, one a row, and the same on lines between the rows."""
    values = 3.0 + np.cumsum(np.random.default_rng(1).normal(0.0, 1.0, 300))
    return values, np.interp(np.arange(299 * FINE + 1) / FINE, np.arange(300), values)


@pytest.mark.parametrize("rows", [0.4, 2.5, 17.0])
def test_a_running_mean_is_that_of_the_lines_between_the_rows(rows: float) -> None:
    values, fine = _on_lines()
    width = round(rows * FINE)
    stood = np.concatenate([np.full(width, values[0]), fine])
    summed = np.cumsum(0.5 * (stood[1:] + stood[:-1]))
    whole = np.concatenate([[0.0], summed])
    mean = (whole[width:] - whole[:-width]) / width
    assert running_mean(values, rows) == pytest.approx(mean[::FINE], abs=1e-9)


@pytest.mark.parametrize("rows", [0.6, 4.0, 30.0])
@pytest.mark.parametrize("kind", LAGS)
def test_lags_are_those_of_the_lines_between_the_rows(kind: int, rows: float) -> None:
    values, fine = _on_lines()
    shown = fine
    for _ in range(kind):
        shown = equal_lags(1, shown, rows / kind * FINE)
    # between the rows one lag goes on a curve, which the next one has on a line: an eighth of the bend there
    scale = np.abs(np.diff(values, 2)).max() if kind > 1 else 1e-9
    assert SET_POINT_FILTERS[kind].apply(values, rows) == pytest.approx(shown[::FINE], abs=0.125 * scale)


@given(st.sampled_from(range(len(SET_POINT_FILTERS))), st.floats(0.1, 60.0), st.floats(-5.0, 5.0))
def test_a_filter_leaves_what_stands_and_follows_a_ramp_by_its_delay(
    kind: int, rows: float, slope: float
) -> None:
    delay = 0.5 * rows if kind == MEAN else rows
    shown = SET_POINT_FILTERS[kind].apply(7.0 + slope * np.arange(2000.0), rows)
    assert shown[0] == pytest.approx(7.0, abs=1e-9)
    assert shown[-1] == pytest.approx(7.0 + slope * (1999.0 - delay), abs=1e-6)


def test_every_filter_is_told_with_its_time() -> None:
    assert all("12.5 ms" in one.named.format(12.5) for one in SET_POINT_FILTERS)
