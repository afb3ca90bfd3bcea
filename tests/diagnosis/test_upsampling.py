"""A coarse recording on a finer raster: derivatives are right, cuts stay cuts, no effect comes from the sampling."""

from dataclasses import replace

import numpy as np
import pytest

from autotune.diagnosis.fitting import fit_model
from autotune.diagnosis.verdict import diagnose
from autotune.estimation.alignment import needed, upsampled
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.data import stretches_of
from autotune.recordings.recording import Metadata, Recording
from autotune.signals.filters import motion

PERIOD = 0.01
FASTEST = 2 * np.pi * 9.0


def _wave(seconds: float = 6.0) -> Recording:
    time = np.arange(0.0, seconds, PERIOD)
    position = np.sin(FASTEST * time)
    columns = {"time": time, "position": position, "torque": np.cos(FASTEST * time)}
    return Recording.from_columns(columns, Metadata(sample_period=PERIOD, position_resolution=1e-4), "wave")


def _coarse(every: int) -> Recording:
    """Inertia and friction only, sampled slowly; the torque is that of the instant."""
    time = np.arange(0.0, 25.0, 1e-3)
    q = sum(
        a * np.sin(2 * np.pi * f * time + p)
        for a, f, p in ((1.5, 0.31, 0.0), (0.9, 0.83, 2.2), (0.03, 5.1, 0.5))
    )
    v = np.gradient(q, 1e-3)
    torque = 3e-4 * np.gradient(v, 1e-3) + 1.2e-3 * v + 0.06 * np.tanh(v / 5e-3)
    torque += np.random.default_rng(3).normal(0.0, 1e-3, len(q))
    thin = {"time": time[::every], "position": np.asarray(q)[::every], "torque": torque[::every]}
    return Recording.from_columns(thin, Metadata(sample_period=1e-3 * every), "coarse")


def test_a_raster_fine_enough_is_left_alone() -> None:
    recording = _wave()
    assert upsampled(recording, 1) is recording
    assert needed(4.0, PERIOD) == 1
    assert needed(9.0, PERIOD) == 2
    assert needed(1e4, PERIOD) == 4


def test_differences_on_the_finer_raster_are_derivatives() -> None:
    recording, inner = _wave(), slice(100, -100)
    coarse = motion(recording["position"], PERIOD, 45.0)[1]
    fine = upsampled(recording, 3)
    velocity = motion(fine["position"], fine.period, 135.0)[1]
    true = FASTEST * np.cos(FASTEST * fine["time"])
    assert np.max(np.abs(coarse[inner])) / FASTEST == pytest.approx(0.948, abs=0.005)
    np.testing.assert_allclose(velocity[inner], true[inner], atol=0.01 * FASTEST)
    np.testing.assert_allclose(fine["position"][::3], recording["position"], atol=1e-12)


def test_time_rises_within_segments_of_which_each_begins_at_zero() -> None:
    plain = _wave()
    count = len(plain) // 2
    time = np.concatenate([plain["time"][:count], plain["time"][: len(plain) - count]])
    names = np.where(np.arange(len(plain)) < count, "one", "two")
    twice = Recording(plain.metadata, {**plain.floats, "time": time}, names, plain.repeat, plain.missed)
    fine = upsampled(twice, 3)
    for segment in fine.segments():
        steps = np.diff(fine["time"][segment.rows])
        np.testing.assert_allclose(steps, PERIOD / 3, rtol=1e-6)


def test_cuts_segments_and_the_count_of_the_position_stay() -> None:
    plain = _wave()
    missed = np.zeros(len(plain), dtype=np.int64)
    missed[200] = 3
    names = np.where(np.arange(len(plain)) < 400, "one", "two")
    cut = Recording(plain.metadata, plain.floats, names, plain.repeat, missed)
    fine = upsampled(cut, 2)
    assert [s.experiment for s in fine.segments()] == ["one", "two"]
    assert fine.segments()[1].start == 800
    assert [s.start for s in stretches_of(fine, 0)] == [0, 400]
    assert fine.metadata.position_resolution == 1e-4
    whole = replace(plain.metadata, position_resolution=None)
    counts = np.round(np.sin(plain["time"]) / 0.01) * 0.01
    stepped = Recording.from_columns(dict(plain.floats) | {"position": counts}, whole)
    assert upsampled(stepped, 2).metadata.position_resolution == pytest.approx(0.01, rel=1e-6)


def test_slow_sampling_alone_is_no_missing_effect() -> None:
    recording = _coarse(10)
    data = prepared_for([recording])
    assert data.upsampling > 1
    model = fit_model([recording]).model
    assert model["inertia"] == pytest.approx(3e-4, rel=0.05)
    found = diagnose([recording], model)
    assert (found.verdict, found.effects) == ("none", ())


def test_codes_that_the_encoder_leaves_out_are_those_of_the_file() -> None:
    """Between the rows of the file the finer raster has readings that nobody read."""
    whole, count = _coarse(10), 5e-3
    read = np.where((whole["position"] > 0.0) & (whole["position"] < 0.2), 0.2, whole["position"])
    counted = {name: whole[name] for name in whole.floats} | {"position": np.rint(read / count) * count}
    metadata = replace(whole.metadata, position_resolution=count)
    data = prepared_for([Recording.from_columns(counted, metadata, "coarse")])
    assert data.upsampling > 1
    (gap,) = data.gaps
    assert gap.place == pytest.approx(0.0, abs=count)
    assert gap.width == pytest.approx(0.2, abs=2 * count)
