"""Rows that are written late, on sines whose positions at the right time are known."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.arrays import Flags, Floats
from autotune.signals.late_rows import in_time, tick_of

PERIOD, COUNTS, DELAY = 1e-3, 2e-6, 6e-5
TIME: Floats = np.asarray(np.arange(40_000) * PERIOD, dtype=np.float64)
STRETCHES = [slice(0, 25_000), slice(25_000, 40_000)]


def told(time: Floats, noise: float = 0.0) -> Floats:
    """A sine of 1 rad at half a Hertz: up to 1570 counts in a row."""
    shaken = noise * np.random.default_rng(9).standard_normal(len(time))
    return np.asarray(np.rint((np.sin(np.pi * time) + shaken) / COUNTS) * COUNTS)


def left(late: Flags, noise: float = 0.0, delay: float = DELAY) -> float:
    """Rms of what rows are off by afterwards, over that before."""
    position, right = told(np.asarray(TIME + delay * late), noise), told(TIME, noise)
    found = in_time(position, STRETCHES, COUNTS)
    return float(np.std(found - right) / np.std(position - right))


@pytest.mark.parametrize("share", [0.005, 0.025, 0.1, 0.25])
def test_rows_that_are_late_by_chance_are_taken_in_time(share: float) -> None:
    """60 us late at up to 3 rad/s; of a quarter of all rows most have a late one beside them."""
    late = np.random.default_rng(6).uniform(size=len(TIME)) < share
    position = told(np.asarray(TIME + DELAY * late))
    assert tick_of([position], COUNTS) == pytest.approx(DELAY / PERIOD, rel=0.02)
    assert left(late) < 0.05


@pytest.mark.parametrize("apart", [1, 2])
def test_late_rows_that_hide_each_other_are_found(apart: int) -> None:
    """In pairs, beside single ones that tell the delay."""
    late = np.zeros(len(TIME), dtype=np.bool_)
    late[50::100] = late[100::200] = late[100 + apart :: 200] = True
    assert left(late) < 0.05


def test_rows_in_time_stay_as_they_are() -> None:
    for noise in (0.0, 1e-5):
        position = told(TIME, noise)
        assert np.array_equal(in_time(position, STRETCHES, COUNTS), position)


def test_what_is_remembered_is_nobodys_to_change() -> None:
    late = np.random.default_rng(6).uniform(size=len(TIME)) < 0.05
    position = told(np.asarray(TIME + DELAY * late))
    first = in_time(position, STRETCHES, COUNTS)
    changed = in_time(position, STRETCHES, COUNTS)
    changed[:] = 0.0
    assert np.array_equal(in_time(position, STRETCHES, COUNTS), first)
    other = in_time(position, [slice(0, 12_000)], COUNTS)
    assert np.array_equal(other[12_000:], position[12_000:])
    assert not np.array_equal(other, first)


def test_what_is_late_by_less_than_noise_is_no_worse_for_it() -> None:
    """Noise of 5 counts; a tick of 10 us is half a count to 16 counts."""
    late = np.random.default_rng(6).uniform(size=len(TIME)) < 0.05
    assert left(late, noise=1e-5, delay=1e-5) < 1.05


def test_rows_that_scatter_without_a_tick_tell_none() -> None:
    """Late by anything up to 200 us: no single delay, and nothing is taken for one."""
    random = np.random.default_rng(6)
    position = told(np.asarray(TIME + 2e-4 * random.uniform(size=len(TIME))))
    assert tick_of([position], COUNTS) == 0.0
    assert np.array_equal(in_time(position, STRETCHES, COUNTS), position)


def test_a_recording_shorter_than_its_surroundings_stays() -> None:
    assert np.array_equal(in_time(np.arange(8.0), [slice(0, 8)], 0.0), np.arange(8.0))
