"""High speed (section 3.4.2) in noise far above the excitation: the inertia stays unbiased."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from autotune.core.errors import NotEnoughExcitation
from autotune.identify.estimate import Estimate, Quantity
from autotune.identify.high_speed import antiresonance, identify_high_speed
from autotune.identify.run import identify_run, with_unknown_lag
from autotune.recordings.recording import Metadata, Recording
from autotune.signals.excitation import prbs
from autotune_sim.presets import Preset
from tests.support.identification_programme import play, varied_axis

PERIOD, INERTIA, VISCOUS, SPEED, SIZE = 1e-3, 6.66e-4, 4e-3, 4.0, 0.067
LOAD = 0.4
PASSES = 40


def closed_loop(
    torque: NDArray[np.float64], noise: NDArray[np.float64], spring: float = 0.0
) -> NDArray[np.float64]:
    """Position and torque, shape (2, n), of an inertia under PID; every column is a pass of its own.

    `spring` [N m/rad]: 40 % of the inertia hangs on it.
    """
    y, v, total, before, far, fast = (np.zeros(torque.shape[1]) for _ in range(6))
    load = LOAD * INERTIA if spring else 0.0
    found = np.empty((2, *torque.shape))
    for k in range(len(torque)):
        total -= y * PERIOD
        u = -20.0 * y - 0.05 * (y - before) / PERIOD + 500.0 * total + torque[k]
        before = y.copy()
        found[:, k] = y, u
        held = spring * (far - y) + 2e-3 * (fast - v) if spring else 0.0
        acceleration = (u + noise[k] - VISCOUS * v + held) / (INERTIA - load)
        if spring:
            fast = fast - PERIOD * held / load
            far = far + PERIOD * fast
        y = y + PERIOD * v + 0.5 * PERIOD**2 * acceleration
        v = v + PERIOD * acceleration
    return found


def passes(noise: float, seed: int, spring: float = 0.0) -> Recording:
    """Passes up and down in turn, with a torque noise of `noise` [N m] in the loop."""
    generator = np.random.default_rng(seed)
    signal = np.tile(prbs(9, 2, SIZE), 2)
    n = len(signal)
    excitation = np.tile(signal[:, None], (1, PASSES))
    position, torque = closed_loop(excitation, noise * generator.standard_normal((n, PASSES)), spring)
    speed = np.where(np.arange(PASSES) % 2 == 0, SPEED, -SPEED)
    reference = speed * np.arange(n)[:, None] * PERIOD
    start = (n * PERIOD + 1.0) * np.arange(PASSES)
    columns = {
        "time": np.arange(n)[:, None] * PERIOD + start,
        "reference": reference,
        "position": reference + position,
        "torque": torque + VISCOUS * speed,
        "torque_feedforward": excitation,
    }
    metadata = Metadata(sample_period=PERIOD, position_resolution=1e-6, torque_limit=5.0)
    flat = {name: np.ravel(column, order="F") for name, column in columns.items()}
    return Recording.from_columns(flat, metadata, "high_speed", np.repeat(np.arange(PASSES), n))


@pytest.mark.parametrize("noise", [0.005, 0.1, 0.15])
def test_the_inertia_is_unbiased_whatever_the_noise(noise: float) -> None:
    """Mean of six records within 1.5 %: their scatter of 0.6 % over √6, and 0.5 % of the windows' ends."""
    found = [identify_high_speed(passes(noise, seed)).estimate for seed in range(6)]
    assert all(one.valid for one in found)
    errors = np.array([one["inertia"].value / INERTIA - 1.0 for one in found])
    assert abs(errors.mean()) < 0.015
    promised = np.array([one["inertia"].relative_error for one in found])
    assert 0.4 < np.sqrt(np.mean((errors - errors.mean()) ** 2)) / promised.mean() < 2.0


def test_noise_in_which_nothing_is_left_of_the_excitation_is_refused() -> None:
    with pytest.raises(NotEnoughExcitation, match="coherent"):
        identify_high_speed(passes(2.0, 0))


LAG_AXIS_DAMPING = 0.11
SAMPLED = Recording.from_columns(
    dict.fromkeys(("time", "position", "torque"), np.arange(100) * PERIOD), Metadata(), "x"
)
"""A recording of which only the sampling period is asked."""


@pytest.mark.parametrize("lag", [0.0, 1e-4, 3e-4])
def test_a_lag_of_the_torque_path_is_told_within_its_interval(lag: float) -> None:
    """On the simulated axis, from the programme's own high speed experiment; 3 standard errors and 5 %."""
    axis = lagged(lag)
    found = identify_high_speed(play(axis, 3, ("high-speed",)).select("high_speed")).lag
    assert abs(found.value - lag) < 3.0 * found.standard_error + 0.05 * lag
    assert found.standard_error < 2e-5


def lagged(lag: float) -> Preset:
    axis = varied_axis(3)
    bristle = axis.plant.bristle
    assert bristle is not None
    bristle = replace(bristle, damping=LAG_AXIS_DAMPING, stiffness=60.0)
    return replace(axis, plant=replace(axis.plant, lag=lag, bristle=bristle))


@pytest.mark.parametrize("known", [True, False])
def test_the_interval_of_micro_damping_holds_the_truth_whatever_the_lag_adds(known: bool) -> None:
    """0.1 ms at 60 N m/rad adds 0.006 to 0.11; the refinement alone promises 0.0005."""
    lag = Quantity(1.05e-4, 8e-6) if known else None
    values = {
        "micro_damping": Quantity(LAG_AXIS_DAMPING + 60.0 * 1e-4, 0.0005),
        "stiffness": Quantity(60.0, 0.1),
    }
    found = with_unknown_lag(Estimate("joint", values), lag, SAMPLED)
    low, high = found["micro_damping"].interval
    assert low < LAG_AXIS_DAMPING < high
    assert high - low < 0.3 * LAG_AXIS_DAMPING
    assert any("lag of the torque path" in note for note in found.notes)


@pytest.mark.parametrize("errors", [0.0, 0.5, 1.0, 1.5, 2.0, 3.0])
def test_the_interval_of_micro_damping_covers_its_share_for_every_lag(errors: float) -> None:
    """95 % is promised. The lag is so many of its errors long; one of them does as much as the fit errs by itself."""
    generator, own, stiffness, share = np.random.default_rng(8), 0.001, 100.0, 0.001 / 100.0
    inside = []
    for wrong, noise in generator.standard_normal((2000, 2)).tolist():
        value = LAG_AXIS_DAMPING + own * (errors + wrong)
        values = {"micro_damping": Quantity(value, own), "stiffness": Quantity(stiffness, 0.1)}
        lag = Quantity(share * (errors + noise), share)
        found = with_unknown_lag(Estimate("joint", values), lag, SAMPLED)["micro_damping"]
        inside.append(found.interval[0] < LAG_AXIS_DAMPING < found.interval[1])
    assert 0.90 < np.mean(inside) < 0.99


def test_a_lag_that_comes_out_below_zero_widens_nothing() -> None:
    values = {"micro_damping": Quantity(LAG_AXIS_DAMPING, 0.0005), "stiffness": Quantity(60.0, 0.1)}
    estimate = Estimate("joint", values)
    assert with_unknown_lag(estimate, Quantity(-2e-5, 8e-6), SAMPLED) == estimate


@pytest.mark.long
def test_the_interval_of_micro_damping_holds_the_truth_on_an_axis_with_a_lag() -> None:
    axis = lagged(1e-4)
    found = identify_run(play(axis, 3, ("identification",))).joint["micro_damping"]
    low, high = found.interval
    assert low < LAG_AXIS_DAMPING < high
    assert high - low < 0.5 * LAG_AXIS_DAMPING


@pytest.mark.parametrize(("frequency", "noise"), [(30.0, 0.0), (45.0, 0.2)])
def test_the_motor_stands_where_its_load_resonates(frequency: float, noise: float) -> None:
    spring = LOAD * INERTIA * (2.0 * np.pi * frequency) ** 2
    found = antiresonance(passes(noise, 3, spring))
    assert found is not None
    assert found.frequency == pytest.approx(frequency, abs=6.0)  # lines of 2 Hz, smoothed over three
    assert found.inertia == pytest.approx((1.0 - LOAD) * INERTIA, rel=0.25)


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.5])
def test_one_mass_stands_nowhere(noise: float) -> None:
    assert antiresonance(passes(noise, 4)) is None
