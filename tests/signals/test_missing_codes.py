"""Codes that an encoder leaves out are told; what creeps, sticks and slips, or only goes fast, tells none."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.signals.missing_codes import missing_codes

COUNT = 2e-5
ROWS = 6000


def creeping(speed: float, noise: float = 0.0, seed: int = 3) -> Floats:
    """There and back three times, by so many counts a row at most; shape (n,), in counts."""
    phase = np.linspace(0.0, 3.0, ROWS)
    path = speed * ROWS / 12.0 * np.sin(2.0 * np.pi * phase) / (np.pi / 2.0)
    return np.asarray(path + np.random.default_rng(seed).normal(0.0, noise, ROWS))


def read(path: Floats, gap: int = 0, at: int = 20) -> Floats:
    """What an encoder tells that leaves out the codes from `at` to `at + gap`."""
    told = np.where((path > at) & (path < at + gap), at + gap, path) if gap else path
    return np.asarray(np.rint(told) * COUNT)


@pytest.mark.parametrize("gap", [4, 12, 60])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_codes_that_are_never_told_are_found(gap: int, noise: float) -> None:
    (found,) = missing_codes(read(creeping(0.5, noise), gap), [slice(0, ROWS)], COUNT)
    assert found.place == pytest.approx(20 * COUNT, abs=COUNT)
    assert found.width == pytest.approx(gap * COUNT, abs=COUNT)
    assert found.passes >= 6


@pytest.mark.parametrize("noise", [0.0, 0.3, 1.0, 4.0])
@pytest.mark.parametrize("speed", [0.2, 1.0, 1.4, 3.0, 40.0])
def test_an_encoder_that_tells_all_has_no_gap(noise: float, speed: float) -> None:
    assert missing_codes(read(creeping(speed, noise)), [slice(0, ROWS)], COUNT) == ()


def test_what_is_passed_at_speed_only_tells_nothing() -> None:
    assert missing_codes(read(creeping(40.0), 12), [slice(0, ROWS)], COUNT) == ()


def test_an_axis_that_sticks_and_slips_jumps_elsewhere_each_time() -> None:
    rng, path = np.random.default_rng(8), []
    for way in (1.0, -1.0) * 6:
        place = 0.0 if way > 0 else 300.0
        while 0.0 <= place <= 300.0:
            path += [place] * 30
            place += way * rng.uniform(4.0, 14.0)
    told = read(np.array(path))
    assert missing_codes(told, [slice(0, len(told))], COUNT) == ()


def test_a_file_that_is_printed_finer_than_it_was_read_has_no_gaps() -> None:
    """Six digits of an encoder whose counts are five of their last: every count is left out, so it is none."""
    told = read(creeping(0.5))
    assert missing_codes(told, [slice(0, ROWS)], COUNT / 5.0) == ()


@pytest.mark.parametrize("resolution", [0.0, COUNT])
def test_a_file_too_short_or_without_counts_tells_nothing(resolution: float) -> None:
    assert missing_codes(read(creeping(0.5), 12)[:9], [slice(0, 9)], resolution) == ()
    assert missing_codes(read(creeping(0.5), 12), [slice(0, ROWS)], 0.0) == ()
