"""What is between the samples of a signal."""

import numpy as np
import pytest
from scipy import signal

from autotune.signals.between_samples import around, later, mean_answer, missed_around, row_means


def test_a_laws_mean_answer_is_what_it_makes_of_straight_lines_between_the_samples() -> None:
    """Of a filtered PID by a thousand ticks a sample, in every row of a table."""
    period, ticks, gains, rate = 2e-3, 1000, (6.0, 0.03, 100.0), 900.0
    values = np.cumsum(np.random.default_rng(2).normal(size=(2, 60)), axis=1)
    values[:, 0] = 0.0
    at = np.arange(59 * ticks) / ticks
    for row, answer in zip(values, mean_answer(values, period, gains, rate), strict=True):
        fine = np.interp(at, np.arange(60), row)
        share = 1.0 - np.exp(-rate * period / ticks)
        change = np.diff(fine, prepend=0.0) * ticks / period
        filtered = signal.lfilter([share], [1.0, share - 1.0], change)
        law = gains[0] * fine + gains[1] * filtered + gains[2] * np.cumsum(fine) * period / ticks
        assert answer[:-1] == pytest.approx(law.reshape(-1, ticks).mean(axis=1), abs=0.01 * np.std(law))


@pytest.mark.parametrize("ticks", [1, 2, 6, 7, 8, 9, 16, 25])
def test_a_mean_over_a_samples_ticks_is_numpys_to_the_last_bit(ticks: int) -> None:
    random = np.random.default_rng(3)
    table = random.normal(size=(400, ticks)) * 10.0 ** random.integers(-6, 6, size=(400, ticks))
    assert np.array_equal(row_means(table), table.mean(axis=1))


@pytest.mark.parametrize("count", [0.0, 0.25, 1.0, 5.5, 100.0])
def test_of_what_comes_late_some_may_be_asked_for_alone(count: float) -> None:
    values = np.random.default_rng(4).normal(size=(3, 60))
    for every in (1, 2, 4):
        assert np.array_equal(later(values, count, every), later(values, count)[:, ::every])


@pytest.mark.parametrize("hertz", [1.0, 8.0])
def test_differences_around_a_row_are_the_rates_there_but_for_what_they_are_said_to_miss(
    hertz: float,
) -> None:
    period, turn = 1e-3, 2.0 * np.pi * hertz
    time = np.arange(2000) * period
    rate, bend = around(np.sin(turn * time), period)
    inside = slice(3, -3)  # the parabolas at both ends are of another kind
    off = np.abs(bend + turn**2 * np.sin(turn * time))[inside]
    missed = missed_around(bend)[inside]
    rounding = 1e-15 / period**2
    assert np.all(off <= 1.01 * missed + rounding)
    assert np.max(off) > 0.9 * np.max(missed)
    # the rate is off by a sixth of the square of what a period turns by
    assert np.max(np.abs(rate - turn * np.cos(turn * time))[inside]) < 0.17 * turn * (turn * period) ** 2
    straight = around(np.arange(2.0), period)
    assert np.all(np.concatenate(straight) == 0.0)
