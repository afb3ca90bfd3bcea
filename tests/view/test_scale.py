"""Readable numbers and thinned lines."""

from __future__ import annotations

import doctest
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from autotune.view import console, scale

FINITE = st.floats(-1e6, 1e6, allow_subnormal=False)
LINES = arrays(np.float64, st.integers(1, 3000), elements=FINITE)


@pytest.mark.parametrize("module", [scale, console])
def test_examples_in_docstrings(module: object) -> None:
    result = doctest.testmod(module)  # type: ignore[arg-type]
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize(
    ("largest", "unit", "expected"),
    [
        (2.04e-3, "rad", "mrad"),
        (0.2, "rad", "mrad"),
        (1.26e-4, "rad", "µrad"),
        (3.0, "N m", "N m"),
        (0.33, "N m", "mN m"),
        (4e-9, "m", "nm"),
        (6.66e-4, "kg m²", "kg m²"),
        (0.0, "rad", "rad"),
        (float("nan"), "rad", "rad"),
        (80.0, "°C", "°C"),
    ],
)
def test_multiple_brings_numbers_to_a_readable_size(largest: float, unit: str, expected: str) -> None:
    assert scale.multiple(largest, unit)[1] == expected


@given(st.floats(1e-8, 1e3))
def test_multiple_gives_one_to_a_thousand(largest: float) -> None:
    factor, _ = scale.multiple(largest, "rad")
    assert 0.99 <= largest * factor < 1000.01


@pytest.mark.parametrize(
    ("value", "unit", "error", "expected"),
    [
        (39.5, "N m/rad", 1.6, "39.5 ± 1.6 N m/rad"),
        (-0.0487, "N m", 0.0004, "−48.70 ± 0.40 mN m"),
        (0.048, "N m", None, "48.0 mN m"),
        (0.048, "N m", float("nan"), "48.0 mN m"),
        (0.0, "N m", None, "0 N m"),
        (float("nan"), "N m", 0.1, "– N m"),
        (0.00096, "N m s/rad", 0.003, "0.0010 ± 0.0030 N m s/rad"),
    ],
)
def test_quantity_in_words(value: float, unit: str, error: float | None, expected: str) -> None:
    assert scale.quantity(value, unit, error) == expected


@given(LINES, st.integers(10, 500))
def test_thinning_keeps_extremes_and_ends(values: np.ndarray, points: int) -> None:
    rows = scale.thin(values, points)
    assert len(rows) <= max(points, len(values) if len(values) <= points else 0) + 4
    assert values[rows].min() == values.min()
    assert values[rows].max() == values.max()
    assert rows[0] == 0
    assert rows[-1] == len(values) - 1
    assert (np.diff(rows) > 0).all()


def test_thinning_keeps_a_spike_of_one_sample() -> None:
    values = np.zeros(100_000)
    values[54_321] = 1.0
    assert 54_321 in scale.thin(values, 200)


@given(arrays(np.float64, st.integers(2, 4000), elements=FINITE))
def test_path_thinning_is_ascending_and_short(values: np.ndarray) -> None:
    rows = scale.thin_path(np.cumsum(values), values, 300)
    assert len(rows) <= 302
    assert (np.diff(rows) > 0).all()
    assert rows[-1] == len(values) - 1


def test_path_thinning_spends_points_where_the_curve_is_long() -> None:
    rest = np.zeros(50_000)
    loop = np.linspace(0, 2 * np.pi, 5_000)
    x, y = np.concatenate([rest, np.sin(loop)]), np.concatenate([rest, 1 - np.cos(loop)])
    rows = scale.thin_path(x, y, 400)
    assert (rows >= 50_000).sum() > 300


def test_bins_recover_the_mean_curve() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(0, 1, 40_000)
    centre, mean, error = scale.binned(x, 2 * x + 0.1 * rng.normal(size=x.size), 20)
    assert len(centre) == 20
    # 5 standard errors: one of 20 bins outside has a chance of 1e-5
    assert (np.abs(mean - 2 * centre) < 5 * error).all()
    assert (error < 0.01).all()


def test_bins_of_nothing_are_nothing() -> None:
    for x in (np.empty(0), np.ones(50), np.full(50, np.nan)):
        assert [len(part) for part in scale.binned(x, x)] == [0, 0, 0]


@given(st.lists(st.floats(0, 1e3), min_size=1, max_size=60), st.floats(1e-4, 1e-2))
def test_time_always_runs_on(time: list[float], period: float) -> None:
    running = scale.continuous(np.array(time), period)
    assert running[0] == pytest.approx(time[0])
    for (before, after), step in zip(itertools.pairwise(time), np.diff(running), strict=True):
        expected = after - before if after > before else period
        # sums of a few hundred numbers up to 1e3: 1e-9 is far above rounding
        assert step == pytest.approx(expected, abs=1e-9)
