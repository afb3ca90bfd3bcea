"""Twin-corrected residual, controller, noise."""

from dataclasses import replace

import numpy as np
import pytest

from autotune.diagnosis.evidence.repeated import RepeatedProgramme
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.controller import find_controller
from autotune.estimation.cross_validation import Unseen
from autotune.estimation.data import TRAINING, prepare
from autotune.estimation.disturbance_estimate import estimate_disturbance
from autotune.estimation.least_squares import Fitted
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import new_problem
from autotune.estimation.residual import residual
from autotune.models.drive_model import base_model
from tests.support.axes import plain_axis


def _truth():
    plant = plain_axis(3).plant
    bristle = plant.bristle
    return base_model(
        {
            "inertia": plant.inertia, "viscous": plant.viscous, "coulomb": bristle.coulomb,
            "stiffness": bristle.stiffness, "micro_damping": bristle.damping, "offset": plant.offset,
        }
    ).pack()  # fmt: skip


def test_the_true_model_leaves_nothing_repeatable(short) -> None:
    """What repeats in the residual of the true parameters is within the noise; raw it is not."""
    data = prepare([short])
    problem = new_problem(data, find_controller(data))
    packed = _truth()
    raw = residual(data, packed, problem.moved)
    problem = replace(problem, disturbance=estimate_disturbance(problem, packed))
    correction = problem.correction(packed, 4)
    corrected, error = problem.repeatable(raw - correction.bias, correction, TRAINING)
    uncorrected, _ = problem.repeatable(raw, problem.correction(packed, 4), TRAINING)
    noise = problem.noise_variance(raw, TRAINING)
    assert abs(corrected) < max(3.0 * error, 0.15 * noise)
    assert uncorrected > 3.0 * abs(corrected)


def test_the_noise_of_the_plant_is_found(short) -> None:
    """5 mN m were simulated; a fifth is what a minute of data can tell."""
    data = prepare([short])
    problem = new_problem(data, find_controller(data))
    found = estimate_disturbance(problem, _truth())
    assert found.process == pytest.approx(5e-3, rel=0.2)


def test_the_controller_is_taken_from_the_metadata_or_identified(short) -> None:
    known = find_controller(prepare([short]))
    assert known.source == "metadata"
    found = find_controller(prepare([short.with_metadata(controller=None)]))
    assert found.source == "identified"
    assert found.explained > POLICY.controller_explains
    for gain in ("kp", "kd", "ki"):
        expected = getattr(short.metadata.controller, gain)
        assert getattr(found, gain) == pytest.approx(expected, rel=0.02)


def test_wrong_gains_in_the_metadata_are_not_believed(short) -> None:
    wrong = replace(short.metadata.controller, kp=0.7 * short.metadata.controller.kp)
    found = find_controller(prepare([short.with_metadata(controller=wrong)]))
    assert found.source == "identified"
    assert found.kp == pytest.approx(short.metadata.controller.kp, rel=0.02)


def test_a_controller_that_is_none_says_so(short) -> None:
    random = np.random.default_rng(0)
    noisy = dict(short.floats) | {
        "torque_command": short["torque_command"] + random.normal(0, 0.1, len(short))
    }
    from autotune.recordings.recording import Recording

    spoiled = Recording.from_columns(
        noisy, replace(short.metadata, controller=None), short.experiment, short.repeat
    )
    found = find_controller(prepare([spoiled]))
    assert not found.usable
    assert "99.9 %" in found.why


def test_what_comes_again_in_one_experiment_only_is_no_noise(short) -> None:
    """Half a second in which both repeats of one experiment err alike: too short to move the mean of all.

    A motor that saturates shows it in the fastest moves only, and "nothing is missing" was said of it.
    """
    data = prepare([short])
    problem = new_problem(data, find_controller(data))
    rng = np.random.default_rng(7)
    error = 2e-3 * rng.standard_normal(len(data.grid))
    fitted = Fitted(_truth(), (), error, np.empty((len(error), 0)), np.empty(0), 0.0)
    fit = ModelFit(fitted, problem.correction(_truth(), 2), Unseen(np.zeros(1)))
    assert not RepeatedProgramme().structure_left(problem, fit)
    points = next(block for block in data.blocks if block.name == "points")
    table = error[points.rows].reshape(points.repeats, points.count)
    table[:, 40:60] += 0.1 * rng.standard_normal(20)
    assert RepeatedProgramme().structure_left(problem, fit)
