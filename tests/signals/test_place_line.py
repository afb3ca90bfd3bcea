"""A wave over place in a signal along a motion, told from noise."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.signals.place_line import strongest_line

TIME = np.arange(20_000) * 1e-3
PLACE = 0.4 * np.sin(2.0 * np.pi * 0.3 * TIME) + 0.2 * np.sin(2.0 * np.pi * 1.1 * TIME)


@pytest.mark.parametrize("wavenumber", [150.0, 1024.0, 20_000.0])
def test_a_wave_is_found_to_a_part_of_its_width(wavenumber: float) -> None:
    """In ten times as much noise; two waves are as wide as one over the travel."""
    noise = 7.0 * np.random.default_rng(3).standard_normal(len(TIME))
    line = strongest_line(PLACE, np.sin(wavenumber * PLACE + 0.7) + noise, (100.0, 5e4))
    assert line is not None
    assert line.contrast > 60.0
    assert line.wavenumber == pytest.approx(wavenumber, abs=0.1 * 2.0 * np.pi / np.ptp(PLACE))


def test_noise_has_no_line_that_stands_out() -> None:
    line = strongest_line(PLACE, np.random.default_rng(3).standard_normal(len(TIME)), (100.0, 5e4))
    assert line is not None
    assert line.contrast < 30.0
    assert (
        strongest_line(PLACE, np.random.default_rng(3).standard_normal(len(TIME)), (100.0, 5e4), 30.0) is None
    )


def test_between_no_wavenumbers_and_on_no_way_there_is_none() -> None:
    assert strongest_line(PLACE, PLACE, (10.0, 5.0)) is None
    assert strongest_line(np.zeros(9), np.ones(9), (1.0, 5.0)) is None
