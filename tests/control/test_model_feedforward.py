"""The feedforward of a drive model: equal to LuGre's where the model is LuGre's, exact where the truth is known."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from autotune.control.feedforward import FeedforwardLaw, LugreParameters, feedforward_along
from autotune.control.model_feedforward import (
    ModelFeedforward,
    fed_forward,
    left_out,
    lugre_model,
    periodic_model_feedforward,
    torque_along,
)
from autotune.control.model_refinement import refine_model, simulated_error
from autotune.control.refinement import PeriodAverage
from autotune.core.arrays import Floats
from autotune.core.drive import Command, Mode
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Controller
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset

H = 1e-3
N = 1000
COUNT = 2.0 * np.pi / 50_000
CONTROLLER = Controller(60.0, 0.15, 6000.0, 1.0)
LUGRE = LugreParameters(6.66e-4, 4.13e-3, 0.30, 60.0, 0.05, 0.048, 0.33, 0.5)


def sine(amplitude: float = 0.2) -> tuple[Floats, Floats, Floats]:
    """One period of 1 s with its central differences, which are periodic."""
    reference = amplitude * np.sin(2.0 * np.pi * np.arange(N) / N)
    ahead, behind = np.roll(reference, -1), np.roll(reference, 1)
    return reference, (ahead - behind) / (2.0 * H), (ahead - 2.0 * reference + behind) / H**2


def true_model(scale: Mapping[str, float] | None = None) -> DriveModel:
    """The simulated axis in the words of a drive model: what a perfect identification would find."""
    plant, factor = preset("edm-vertical").plant, dict(scale or {})
    base = {
        "inertia": plant.inertia,
        "viscous": plant.viscous,
        "coulomb": 1e-3,
        "stiffness": 1.0,
        "micro_damping": plant.micro_damping,
        "offset": plant.offset,
    }
    memory: dict[str, float] = {}
    for i, element in enumerate(plant.elements, 1):
        memory |= {
            f"displacement_{i}": element.displacement,
            f"torque_{i}": element.torque * factor.get("memory", 1.0),
        }
    ripple: dict[str, float] = {}
    for i, wave in enumerate(plant.ripple, 1):
        size = wave.amplitude * factor.get("ripple", 1.0)
        ripple |= {
            f"order_{i}": wave.order,
            f"sin_{i}": size * np.cos(wave.phase),
            f"cos_{i}": size * np.sin(wave.phase),
        }
    model = base_model(base).with_effect(EFFECTS["reversal_memory"].make(memory))
    return model.with_effect(EFFECTS["torque_ripple"].make(ripple))


def measured_with(law: FeedforwardLaw, periods: int = 10, skipped: int = 2) -> PeriodAverage:
    """The benchmark on the simulated drive, period by period, after the first ones."""
    drive = SimDrive(preset("edm-vertical"), seed=3)
    reference, velocity, acceleration = sine()
    rows = []
    drive.enable(Mode.POSITION)
    for k in range((periods + skipped) * N):
        i, fade = k % N, min(k / N, 1.0)
        torque = law.step(reference[i], velocity[i], acceleration[i], None)
        sample = drive.step(Command(fade * reference[i], 0.0, 0.0, fade * torque))
        rows.append((sample.reference, sample.position, sample.torque_feedback, sample.torque_feedforward))
    drive.disable()
    table = np.array(rows)[skipped * N :].reshape(periods, N, 4)
    mean = table.mean(axis=0)
    error = table[:, :, 0] - table[:, :, 1]
    noise = float(np.sqrt(error.var(axis=0, ddof=1).mean() / periods))
    return PeriodAverage(mean[:, 0], error.mean(axis=0), mean[:, 2], mean[:, 3], H, periods, noise)


@pytest.mark.parametrize("parameters", [LUGRE, replace(LUGRE, break_away=0.2)], ids=["falling", "rising"])
def test_a_plain_model_gives_the_lugre_feedforward_one_sample_ahead_at_most(
    parameters: LugreParameters,
) -> None:
    reference, velocity, acceleration = (np.tile(column, 2) for column in sine())
    mine = torque_along(lugre_model(parameters), reference, velocity, acceleration, H)
    theirs = feedforward_along(parameters, velocity, acceleration, H)
    change = np.abs(np.diff(theirs, append=theirs[-1:]))
    assert np.all(np.abs(mine - theirs) <= change + np.roll(change, 1) + 2e-4)
    assert np.max(np.abs(mine)) == pytest.approx(np.max(np.abs(theirs)), rel=0.01)


@pytest.mark.parametrize("name", [name for name, kind in EFFECTS.items() if kind.fed_forward])
def test_every_effect_is_stepped_as_it_is_computed_along_a_reference(name: str) -> None:
    values = {
        "torque_ripple": {"order_1": 72.0, "sin_1": 0.01, "cos_1": 0.0},
        "direction_asymmetry": {"coulomb": 0.02, "viscous": 0.001},
        "stribeck": {"break_away": 0.35, "stribeck_velocity": 0.3},
        "nonlinear_viscous": {"torque": 0.02, "exponent": 0.6, "knee": 0.01},
        "position_dependent_friction": {"height": 0.3, "centre": 0.1, "width": 0.05},
        "gravity_imbalance": {"sin": 0.02, "cos": 0.03, "order": 1.0},
        "spring": {"stiffness": 0.2},
        "reversal_memory": {"displacement_1": 0.02, "torque_1": 0.05},
    }
    plain = lugre_model(LugreParameters(6.66e-4, 4.13e-3, 0.3, 60.0, 0.05, 0.048, 0.3))
    model = plain.with_effect(EFFECTS[name].make(values[name]))
    reference, velocity, acceleration = sine()
    law = ModelFeedforward(model, H)
    law.prepare()
    stepped = np.array([law.step(*row, None) for row in zip(reference, velocity, acceleration, strict=True)])
    along = torque_along(model, reference, velocity, acceleration, H)
    # by central differences, the mean of two middles' velocities is that of the set point between them
    np.testing.assert_allclose(stepped, along, rtol=0.0, atol=1e-12)
    assert np.max(np.abs(along - torque_along(plain, reference, velocity, acceleration, H))) > 5e-3


def mean_friction(
    parameters: LugreParameters, amplitude: float, frequency: float, period: float
) -> tuple[Floats, Floats]:
    """Position, velocity and acceleration of two periods from rest, shape (n, 3), and the mean friction up to the next
    sample, (n,), by the thesis's own law at steps a fiftieth of a sample.
    """
    fine, rate, samples = 50, 2.0 * np.pi * frequency, round(2.0 / (frequency * period))

    def motion(time: Floats) -> Floats:
        turn = rate * time
        parts = (1.0 - np.cos(turn), rate * np.sin(turn), rate**2 * np.cos(turn))
        return amplitude * np.column_stack(parts)

    _, velocity, acceleration = motion((np.arange(fine * samples) + 0.5) * period / fine).T
    torque = feedforward_along(parameters, velocity, 0.0 * acceleration, period / fine)
    return motion(np.arange(samples) * period), np.mean(torque.reshape(samples, fine), axis=1)


@pytest.mark.parametrize("period", [2.5e-4, 1e-3, 4e-3])
@pytest.mark.parametrize(("amplitude", "frequency"), [(0.2, 1.0), (0.2, 3.0), (0.002, 8.0)])
def test_it_plays_the_mean_torque_up_to_the_next_sample(
    period: float, amplitude: float, frequency: float
) -> None:
    """Viscous friction and what damps the contact are not of the set point's speed, which is half a sample late."""
    parameters = replace(LUGRE, viscous=0.03, micro_damping=0.3)
    rows, needed = mean_friction(parameters, amplitude, frequency, period)
    law, late = (ModelFeedforward(lugre_model(parameters), period) for _ in range(2))
    inertial = LUGRE.inertia * rows[:, 2]
    error = np.array([law.step(*row, None) for row in rows.tolist()]) - inertial - needed
    without = np.array([late.step(q, v, 0.0, None) for q, v, _ in rows.tolist()]) - needed
    assert 1e-7 < np.std(error) < 0.25 * np.std(without)  # 0.02 to 0.15


def test_every_effect_is_either_fed_forward_or_left_out_with_a_reason() -> None:
    whole = true_model()
    for name, kind in EFFECTS.items():
        values = {q.name: max(q.neutral, q.lower) for q in kind.parameters if not q.optional}
        with_it = whole.with_effect(kind.make(values))
        assert (name in fed_forward(with_it)) != bool(left_out(with_it).get(name))
    lag = EFFECTS["torque_lag"].make({"time_constant": 2e-3})
    model = true_model().with_effect(lag)
    assert list(left_out(model)) == ["torque_lag"]
    assert "torque_lag" not in fed_forward(model)
    np.testing.assert_array_equal(
        periodic_model_feedforward(model, sine()[0], H),
        periodic_model_feedforward(true_model(), sine()[0], H),
    )


def test_the_law_travels_to_another_process_and_copies_do_not_share_state() -> None:
    law = ModelFeedforward(true_model(), H)
    other = pickle.loads(pickle.dumps(copy.deepcopy(law)))
    first = [law.step(0.01 * k, 10.0, 0.0, None) for k in range(5)]
    assert [other.step(0.01 * k, 10.0, 0.0, None) for k in range(5)] == first


def test_the_true_model_cancels_ripple_and_memory_of_the_simulated_axis() -> None:
    """The plant is written independently. What is left is encoder counts and torque noise of ten periods."""
    exact = measured_with(ModelFeedforward(true_model(), H))
    plain = true_model().without_effect("torque_ripple")
    without_ripple = measured_with(ModelFeedforward(plain, H))
    assert 0.01e-3 < exact.peak_error < 0.15e-3
    assert without_ripple.peak_error > 2.0 * exact.peak_error


def test_refinement_finds_levels_that_are_wrong_and_predicts_what_it_gains() -> None:
    wrong = true_model({"memory": 0.9, "ripple": 1.3})
    start = measured_with(ModelFeedforward(wrong, H))
    found = refine_model(start, wrong, CONTROLLER, 1.34, max(start.noise, COUNT / np.sqrt(12.0)))
    assert found is not None
    after = measured_with(ModelFeedforward(found.model, H))
    assert after.smooth_peak < 0.7 * start.smooth_peak
    assert after.smooth_peak == pytest.approx(found.predicted_smooth_peak, rel=0.6)
    assert found.model["torque_ripple.cos_1"] == pytest.approx(0.01, rel=0.15)


def test_a_model_whose_loop_is_not_stable_cannot_be_refined() -> None:
    model = true_model()
    torque = periodic_model_feedforward(model, sine()[0], H)
    still = PeriodAverage(sine()[0], np.zeros(N), np.zeros(N), torque, H, 3)
    wild = Controller(60.0, 50.0, 6000.0, 1.0)
    assert simulated_error(model, wild, still, torque, 1e6) is None
    assert refine_model(still, model, wild, 1e6, COUNT) is None
