"""Grid, blocks of repeats, roles and cuts."""

from unittest import mock

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.diagnosis.fitting import fit_model
from autotune.diagnosis.verdict import diagnose
from autotune.estimation.data import TEST, TRAINING, VETO, prepare
from autotune.recordings.recording import Metadata, Recording
from autotune.signals.periodic import period_of


def test_repeats_are_paired_row_by_row(short) -> None:
    data = prepare([short])
    names = {block.name: block for block in data.blocks}
    assert names["sine"].repeats == 2
    assert names["veto"].role == VETO
    assert names["test"].role == TEST
    block = names["points"]
    rows = data.grid[block.rows].reshape(block.repeats, block.count)
    np.testing.assert_allclose(short["reference"][rows[0]], short["reference"][rows[1]], atol=1e-12)


def test_conditioning_is_never_on_the_grid(short) -> None:
    data = prepare([short])
    assert "conditioning" not in set(short.experiment[data.grid])
    assert data.role(TRAINING).sum() > 1000


def test_rows_at_rest_are_left_out(short) -> None:
    data = prepare([short])
    step = data.resolution
    spread = [np.ptp(short["position"][k - 10 : k + 11]) for k in data.grid[::50]]
    assert min(spread) >= 2.0 * step


def test_lost_samples_cut_the_recording(short) -> None:
    n = len(short)
    missed = np.zeros(n, dtype=np.int64)
    missed[n // 2] = 3
    cut = Recording(short.metadata, short.floats, short.experiment, short.repeat, missed)
    data = prepare([cut])
    assert [stretch.start for stretch in data.stretches] == [0, n // 2]


def test_an_axis_that_rests_on_its_target_is_still_controlled(short) -> None:
    """Seventy samples without any error at the end of a recording once cost a run its twin."""
    columns = {name: np.array(short[name]) for name in ("time", "reference", "position", "torque")}
    last = slice(len(short) - 70, len(short))
    columns["reference"][last] = columns["position"][last] = columns["position"][last.start - 1]
    names = [*short.experiment[: last.start], *["conditioning"] * 70]
    repeats = [*short.repeat[: last.start], *[7] * 70]
    rests = Recording.from_columns(columns, short.metadata, names, repeats)
    assert prepare([rests]).closed


def test_a_reference_that_is_the_position_is_no_control(short) -> None:
    columns = {name: np.array(short[name]) for name in ("time", "position", "torque")}
    loose = Recording.from_columns(
        columns | {"reference": columns["position"]}, short.metadata, short.experiment, short.repeat
    )
    assert not prepare([loose]).closed


def test_only_conditioning_is_nothing_to_fit(short) -> None:
    part = short.rows(slice(0, 2000))
    renamed = Recording.from_columns(dict(part.floats), part.metadata, "conditioning")
    with pytest.raises(NotEnoughExcitation, match="record the programme 'diagnosis'"):
        prepare([renamed])


def test_axes_are_not_mixed(short) -> None:
    other = short.with_metadata(motion_unit="m")
    with pytest.raises(RecordingError, match="mix axes"):
        prepare([short, other])


def test_one_long_trajectory_is_cut_into_blocks_to_hold_out() -> None:
    time = np.arange(20_000) * 1e-3
    q = np.sin(2 * np.pi * 0.5 * time)
    columns = {"time": time, "position": q, "torque": np.cos(2 * np.pi * 0.5 * time)}
    data = prepare([Recording.from_columns(columns, Metadata())])
    assert len({block.name for block in data.blocks}) >= 8
    assert not data.repeated


def _periodic(seconds: float = 24.0, hertz: float = 0.5) -> Recording:
    """Two harmonics again and again, and a torque of the place times the speed, which no known effect is."""
    time = np.arange(0.0, seconds, 1e-3)
    count = 2 * np.pi / 20_000
    q = 1.2 * np.sin(2 * np.pi * hertz * time) + 0.3 * np.sin(6 * np.pi * hertz * time + 1.0)
    v = np.gradient(q, 1e-3)
    needed = 3e-4 * np.gradient(v, 1e-3) + 1.2e-3 * v + 0.06 * np.tanh(v / 5e-3) + 4e-3 * v * np.sin(2 * q)
    held = 0.5 * (needed + np.append(needed[1:], needed[-1]))
    torque = held + np.random.default_rng(3).normal(0.0, 2e-3, len(q))
    columns = {"time": time, "position": np.round(q / count) * count, "torque": torque}
    return Recording.from_columns(columns, Metadata(position_resolution=count), "again")


def test_a_motion_that_repeats_itself_is_held_out_by_phase() -> None:
    data = prepare([_periodic()])
    (part,) = data.periodic
    assert part.samples == pytest.approx(2000.0, abs=0.1)
    assert len(set(data.folds)) == part.folds
    phase = (data.grid - part.start) % part.samples
    for number in set(data.folds):
        assert np.ptp(phase[data.folds == number]) <= part.samples / part.folds + 1.0
    assert not data.repeated


def test_by_time_place_times_speed_would_be_learned_by_heart() -> None:
    recording = _periodic(seconds=12.0)
    model = fit_model([recording]).model
    by_phase = diagnose([recording], model)
    assert (by_phase.verdict, by_phase.effects) == ("unknown", ())
    with mock.patch("autotune.estimation.data.periodic", return_value=None):
        by_time = diagnose([recording], model)
    gains = [found.candidates[0].gain for found in (by_phase, by_time)]
    assert [found.candidates[0].effect for found in (by_phase, by_time)] == [
        "position_dependent_friction"
    ] * 2
    assert gains[1] > 1.4 * gains[0]  # by heart: a wrong name, were its parts in proportion


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_motion_that_never_comes_again_has_no_period(seed: int) -> None:
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 1e-3)
    waves = [np.sin(2 * np.pi * f * time) / f for f in random.uniform(0.1, 3.0, 4)]
    assert period_of(np.sum(waves, axis=0)) is None
    assert period_of(np.linspace(0.0, 5.0, 4000)) is None
    assert period_of(np.zeros(4000)) is None


@hypothesis.given(
    st.floats(37.0, 4000.0), st.floats(0.0, 6.28), st.floats(0.0, 1e-3), st.integers(2_200, 60_000)
)
@hypothesis.example(samples=37.5, phase=0.0, noise=0.0, rows=2_200)
@hypothesis.settings(max_examples=40, deadline=None)
def test_a_period_is_found_to_a_fraction_of_a_row(
    samples: float, phase: float, noise: float, rows: int
) -> None:
    hypothesis.assume(rows > 2.6 * samples)
    angle = 2 * np.pi * np.arange(rows) / samples
    wave = np.sin(angle) + 0.4 * np.sin(3 * angle + phase)
    wave += noise * np.random.default_rng(1).normal(size=rows)
    found = period_of(wave)
    assert found is not None
    assert found == pytest.approx(samples, rel=2e-3, abs=0.1)
