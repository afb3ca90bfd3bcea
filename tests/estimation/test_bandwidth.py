"""Up to which frequency repeated recordings are compared."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.estimation.bandwidth import COUNTED, Bands, counts_over_motion, of_one_moment, prepared_for
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import CUTOFF, compared_below
from autotune.recordings.recording import Metadata, Recording

PERIOD, ROWS, INERTIA = 2e-3, 8000, 0.02


def twice(resolution: float) -> Recording:
    """A sum of sines, played twice, with 5 mN m of noise that the repeats do not share."""
    time = np.arange(ROWS) * PERIOD
    parts = [(1.0, 0.3), (0.2, 1.1), (0.02, 4.0)]
    position = sum(size * np.sin(2 * np.pi * rate * time) for size, rate in parts)
    bend = sum(-size * (2 * np.pi * rate) ** 2 * np.sin(2 * np.pi * rate * time) for size, rate in parts)
    told = resolution * np.round(np.tile(position, 2) / resolution)
    torque = np.tile(INERTIA * bend, 2) + 5e-3 * np.random.default_rng(1).normal(size=2 * ROWS)
    columns = {"time": np.arange(2 * ROWS) * PERIOD, "position": told, "torque": torque}
    metadata = Metadata(sample_period=PERIOD, position_resolution=resolution)
    return Recording.from_columns(columns, metadata, "moves", np.repeat([0, 1], ROWS))


def test_a_fine_encoder_leaves_the_band_as_it_is() -> None:
    assert prepared_for([twice(1e-7)]).motion_cutoff == pytest.approx(2.5 * 0.09 / PERIOD)
    assert compared_below(1e-3) == CUTOFF


@pytest.mark.parametrize("resolution", [3e-4, 1e-3])
def test_counts_are_no_louder_than_what_repeats_do_not_share(resolution: float) -> None:
    """1e-3 rad at 60 Hz come to 0.18 N m by way of the inertia, 40 times the noise; they grow as f to the 2.5."""
    data = prepared_for([twice(resolution)])
    cutoff = data.motion_cutoff / 2.5
    white = resolution / np.sqrt(12.0) * np.sqrt(2.0 * PERIOD * cutoff / 5.0)
    assert 15.0 <= cutoff < 60.0
    assert INERTIA * white * (2.0 * np.pi * cutoff) ** 2 < 6e-3


def test_slow_sampling_is_compared_below_a_tenth_of_its_rate() -> None:
    """Central differences at 60 Hz of 4 ms are short by a third."""
    fast = twice(1e-7)
    slow = fast.rows(slice(None, None, 2))
    columns = dict(slow.floats)
    metadata = Metadata(sample_period=2.0 * PERIOD, position_resolution=1e-7)
    thinned = Recording.from_columns(columns, metadata, slow.experiment, slow.repeat)
    assert prepared_for([thinned]).motion_cutoff == pytest.approx(2.5 * 0.09 / (2.0 * PERIOD))


def test_a_fit_ends_where_counts_are_a_hundredth_of_the_acceleration() -> None:
    """Counts of 0.015 rad make a seventieth of it below 30 Hz; they grow with the fifth power of the frequency."""
    usual = Bands.usual(twice(1.5e-2))
    found = Bands.of(twice(1.5e-2))
    assert counts_over_motion(twice(1.5e-2), usual.error) > 1.2 * COUNTED
    assert found.lowered
    assert found.counted < 1.1 * COUNTED
    assert 15.0 <= found.error < usual.error
    assert found.motion == pytest.approx(2.5 * found.error)


def test_a_fine_encoder_leaves_a_fit_its_band() -> None:
    found, usual = Bands.of(twice(1e-5)), Bands.usual(twice(1e-5))
    assert (found.motion, found.error, found.decimation) == (usual.motion, usual.error, usual.decimation)
    assert not found.lowered
    assert 0.0 < found.counted < 1e-3


@pytest.mark.parametrize(("in_band", "doubted"), [(True, True), (False, False)])
def test_a_law_below_a_frequency_leaves_half_a_sample_of_viscous_friction_in_doubt(
    in_band: bool, doubted: bool
) -> None:
    """Of a motor at a voltage: its own field brakes it, and half a sample of that is a share of its inertia."""
    viscous, period = 2.6, 5e-3
    time = np.arange(0.0, 40.0, period)
    sizes = ((0.6, 0.15), (0.3, 0.4), (0.1, 1.1))
    position = sum(size * np.sin(2 * np.pi * rate * time + rate) for size, rate in sizes)
    speed = np.gradient(position, period)
    torque = 0.06 * np.gradient(speed, period) + viscous * speed + 0.2 * np.tanh(speed / 1e-2)
    columns = {"time": time, "position": position, "torque": torque, "reference": position}
    recording = Recording.from_columns(columns, Metadata(sample_period=period), "servo")
    law = PositionController(60.0, 0.6, explained=0.99, source="identified", in_band=in_band)
    doubt = of_one_moment(recording, law).doubt
    assert doubt[0] == (pytest.approx(viscous * period / 2.0 / 0.06, rel=0.3) if doubted else 0.0)
    assert np.all(doubt[1:3] < 0.05)
