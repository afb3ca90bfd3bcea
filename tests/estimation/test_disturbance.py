"""A disturbance with its colour: drawn as stated, found again beside the noise of the torque sensor."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from autotune.core.arrays import Floats
from autotune.estimation.controller import find_controller
from autotune.estimation.data import Prepared, filtered_motion, prepare
from autotune.estimation.disturbance import STILL, Disturbance, jitter_of, memory_of
from autotune.estimation.disturbance_estimate import _errors_of, estimate_disturbance, level_of_least
from autotune.estimation.problem import new_problem
from autotune.estimation.residual import compared_motion, residual
from autotune.estimation.twin_runs import run_twin
from autotune.models.drive_model import Packed, base_model
from autotune.recordings.recording import Recording
from tests.support.axes import NOMINAL, plain_axis
from tests.support.diagnosis_programme import play, programme
from tests.support.truth import true_model

SENSOR = 3e-3  # N m
LEVEL = 2e-3  # N m


@pytest.fixture(scope="module")
def recording() -> Recording:
    return play(plain_axis(3), 3, programme(("scans", "points", "sine")))


@pytest.mark.parametrize("memory", [0.0, 0.8, 0.95])
def test_what_is_drawn_has_its_level_and_its_memory(memory: float) -> None:
    """A tenth: the standard error of the level of 100 000 samples with a memory of 20 is 2 %."""
    correlation = -1e-3 / np.log(memory) if memory else 0.0
    values = Disturbance(coloured=LEVEL, correlation=correlation).drawn(
        np.random.default_rng(1), 100_000, 1e-3
    )
    assert np.std(values) == pytest.approx(LEVEL, rel=0.1)
    assert np.corrcoef(values[1:], values[:-1])[0, 1] == pytest.approx(memory, abs=0.02)
    assert memory_of(correlation, 1e-3) == pytest.approx(memory)


def _shaken(recording: Recording, packed: Packed, memory: float) -> Prepared:
    """The reference played by the twin, shaken with a noise of that memory, its torque read by a noisy sensor."""

    def noise(random: np.random.Generator, n: int) -> Floats:
        drawn = lfilter([1.0], [1.0, -memory], random.normal(0, 1, n))
        return np.asarray(LEVEL * np.sqrt(1 - memory**2) * drawn)

    return _shaken_by(recording, packed, noise)


def _shaken_by(
    recording: Recording,
    packed: Packed,
    noise: Callable[[np.random.Generator, int], Floats],
    encoder: float = 0.0,
) -> Prepared:
    """The same with a noise that is made here, and one of the encoder [rad]."""
    data = prepare([recording])
    random = np.random.default_rng(7)
    n = len(data.time)
    made = noise(random, n)

    class Given(Disturbance):
        def drawn(self, random, size, period):
            return made

    run = run_twin(data, packed, find_controller(data), Given(white=LEVEL, position=encoder), random)
    torque = run.torque + random.normal(0, SENSOR, n)
    moved = filtered_motion(run.position, data.stretches, data.period, data.motion_cutoff)
    return replace(
        data, measured=run.position, torque=torque, recorded_torque=torque,
        position=moved[0], velocity=moved[1], acceleration=moved[2],
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8, 0.95])
def test_process_and_sensor_noise_are_told_apart(recording: Recording, memory: float) -> None:
    """2 mN m of process noise beside 3 of the sensor; a fifth is what half a minute's bands tell."""
    packed = base_model(NOMINAL).pack()
    data = _shaken(recording, packed, memory)
    found = estimate_disturbance(new_problem(data, find_controller(data)), packed)
    assert found.sensor == pytest.approx(SENSOR, rel=0.1)
    correlation = -data.period / np.log(memory) if memory else 0.0
    true = Disturbance(coloured=LEVEL, correlation=correlation).level_at(30.0, data.period)
    assert found.level_at(30.0, data.period) == pytest.approx(true, rel=0.2)
    if (
        memory >= 0.8
    ):  # with less all bands that the motion shows are flat, and the level beyond them is a guess
        assert found.process == pytest.approx(LEVEL, rel=0.25)
        assert found.coloured > found.white
        assert memory_of(found.correlation, data.period) == pytest.approx(memory, abs=0.1)


@pytest.mark.slow
def test_an_encoder_s_noise_is_told_where_there_is_some(recording: Recording) -> None:
    """20 µrad, a sixth of a count; a fifth is what half a minute's bands tell."""
    packed = true_model(plain_axis(3).plant, ()).pack()
    data = _shaken_by(recording, packed, lambda random, n: LEVEL * random.normal(0, 1, n), 2e-5)
    found = estimate_disturbance(new_problem(data, find_controller(data)), packed)
    assert found.position == pytest.approx(2e-5, rel=0.2)


@pytest.mark.slow
def test_a_torque_that_grows_with_frequency_is_no_noise_of_the_encoder(recording: Recording) -> None:
    """Its spectrum tells 55 µrad; a twin that hears them leaves 15 % more than one that is shaken by torque alone."""
    packed = true_model(plain_axis(3).plant, ()).pack()
    data = _shaken_by(recording, packed, lambda random, n: 2e-2 * np.diff(random.normal(0, 1, n + 1)))
    found = estimate_disturbance(new_problem(data, find_controller(data)), packed)
    assert found.position == 0.0
    assert found.process > 0.0


def test_without_a_controller_nothing_is_shaken(recording: Recording) -> None:
    problem = new_problem(prepare([recording]), None)
    assert estimate_disturbance(problem, base_model(NOMINAL).pack()) == STILL


@pytest.mark.parametrize("spread", [0.0, 2e-5])
def test_rows_written_at_moments_that_scatter_are_told_by_the_position(spread: float) -> None:
    """A sine of 1 rad at 0.5 Hz and 1 ms, counts of a microradian: 60 microradians where it is fastest."""
    random = np.random.default_rng(6)
    time = np.arange(20_000) * 1e-3
    written = time + spread * random.standard_normal(len(time))
    position = np.rint(np.sin(np.pi * written) / 1e-6) * 1e-6
    assert jitter_of(position, [slice(0, len(time))], 1e-3) == pytest.approx(spread, rel=0.1)


def test_what_the_twin_leaves_tells_how_much_the_axis_is_shaken(recording: Recording) -> None:
    """5 mN m on the simulated axis; a recording without repeats holds the model's error beside it, so that the spectrum
    alone says too much, and a twin that is shaken three times as much averages its friction at low speed."""
    data = prepare([recording])
    problem = new_problem(data, find_controller(data))
    levels = [Disturbance(white=part * 5e-3) for part in (3.0, 1.0, 0.1)]
    truth = true_model(plain_axis(3).plant, ()).pack()
    assert level_of_least(problem, truth, levels) is levels[1]


@pytest.mark.parametrize("jitter", [0.0, 2e-4])
def test_replicas_side_by_side_leave_what_each_leaves(recording: Recording, jitter: float) -> None:
    """Each is shaken by what is drawn after the one before it, also where rows are written at moments that scatter."""
    data = prepare([recording])
    law = find_controller(data)
    problem = new_problem(data, law)
    shaken = Disturbance(white=2e-3, jitter=jitter)
    models = [base_model({**NOMINAL, "coulomb": c * NOMINAL["coulomb"]}).pack() for c in (1.0, 1.01, 0.99)]
    twins = [(packed, law, shaken.louder(1.0 + 0.1 * i)) for i, packed in enumerate(models)]
    together = _errors_of(problem, twins, np.random.default_rng(3))
    random = np.random.default_rng(3)
    for (packed, _, disturbance), found in zip(twins, together, strict=True):
        run = run_twin(data, packed, law, disturbance, random)
        alone = residual(data, packed, compared_motion(data, run))
        assert found is not None
        np.testing.assert_allclose(
            found, alone, rtol=0.0, atol=1e-9
        )  # far below what other steps would change
