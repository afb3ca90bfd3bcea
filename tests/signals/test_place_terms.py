"""Waves over position beside other columns, and what columns leave on stretches that were left out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autotune.signals.place_terms import find_lines, held_out_error


def test_waves_are_found_over_hundreds_of_turns() -> None:
    random = np.random.default_rng(4)
    position = np.sort(random.uniform(0.0, 600.0, 6000))
    torque = (
        0.2 * np.sin(72.0 * position + 1.0) + 0.1 * np.cos(20.64 * position) + 0.05 * random.normal(size=6000)
    )
    found = find_lines(position, torque, np.ones((6000, 1)), 1.0, most=4, highest=100.0)
    assert [line.order for line in found] == pytest.approx([72.0, 20.64], abs=2e-3)
    assert [line.amplitude for line in found] == pytest.approx([0.2, 0.1], rel=0.05)


def test_what_is_left_on_stretches_left_out_grows_with_terms_that_mean_nothing() -> None:
    random = np.random.default_rng(5)
    target, useful, useless = random.normal(size=400), np.ones((400, 1)), random.normal(size=(400, 20))
    assert held_out_error([(useful, target)]) < held_out_error([(np.hstack([useful, useless]), target)])


@pytest.mark.parametrize(("travel", "order"), [(1.0, 41.2), (0.5, 41.45), (1.6, 24.15)])
def test_waves_a_metre_are_as_likely_no_whole_number(travel: float, order: float) -> None:
    """Rounded to 41 a metre, magnets 24 mm apart left three more waves around them."""
    way = np.concatenate([np.linspace(0.0, travel, 4000), np.linspace(travel, 0.0, 4000)])
    torque = np.sin(2.0 * math.pi * order * way + 0.3) + 0.05 * np.random.default_rng(0).standard_normal(8000)
    (line,) = find_lines(way, torque, np.ones((8000, 1)), 2.0 * math.pi, most=4, highest=100)
    assert line.order == pytest.approx(order, abs=0.01)
    assert line.amplitude == pytest.approx(1.0, abs=0.01)
