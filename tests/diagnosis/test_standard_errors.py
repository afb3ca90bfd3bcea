"""Standard errors of a fit hold what its model lacks, and what the torque that is compared leaves open."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from autotune.diagnosis.fitting import fit_model
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.contact_start import inertia_between_torques
from autotune.estimation.data import Prepared
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording
from tests.support.axes import MEDIUM, plain_axis

SEED = 44
INERTIA = "inertia"
Played = Callable[..., Recording]


def coulomb_off(model: DriveModel) -> float:
    """Coulomb friction that was fitted less the true one, in its standard errors."""
    bristle = plain_axis(SEED).plant.bristle
    assert bristle is not None
    return abs(model["coulomb"] - bristle.coulomb) / error_of(model, "coulomb")


def error_of(model: DriveModel, name: str) -> float:
    error = model.parameters[name].standard_error
    assert error is not None
    return error


@pytest.mark.parametrize("effect", ["stribeck", "dwell_time_break_away", "nonlinear_viscous"])
def test_beside_a_hidden_effect_they_are_of_the_size_of_the_error(recorded: Played, effect: str) -> None:
    """By rows a few apart it is 17 to 60 of them."""
    assert coulomb_off(fit_model([recorded(SEED, **{effect: MEDIUM[effect]})]).model) < 8.0


def test_where_nothing_is_missing_they_are_as_small_as_the_noise(recorded: Played) -> None:
    model = fit_model([recorded(SEED)]).model
    assert coulomb_off(model) < 4.0
    assert error_of(model, "coulomb") < 2e-3 * model["coulomb"]
    assert error_of(model, INERTIA) < 5e-3 * model[INERTIA]


@pytest.fixture(scope="module")
def data(recorded: Played) -> Prepared:
    return prepared_to_fit([recorded(SEED)])


@pytest.mark.parametrize("part", [-0.15, 0.0, 0.08])
def test_what_two_torques_differ_by_is_told_whatever_the_sensors_scale_and_delay(
    data: Prepared, part: float
) -> None:
    inertia = plain_axis(SEED).plant.inertia
    later = np.concatenate([data.recorded_torque[:1], data.recorded_torque[:-1]])
    sensed = replace(data, sensed=0.9 * (later + part * inertia * data.acceleration) + 0.01)
    assert inertia_between_torques(sensed) / inertia == pytest.approx(part, abs=0.01)


def test_one_torque_differs_from_nothing(data: Prepared) -> None:
    assert math.isnan(inertia_between_torques(replace(data, sensed=None)))


def test_an_inertia_between_two_torques_is_known_as_well_as_they_agree(recorded: Played) -> None:
    whole = recorded(SEED)
    position, period = whole["position"], whole.metadata.sample_period
    speed = np.gradient(position, period)
    more = 0.1 * plain_axis(SEED).plant.inertia * np.gradient(speed, period)
    columns = {name: whole[name] for name in ("time", "position")}
    columns |= {"torque_command": whole["torque_command"], "torque": whole["torque_command"] - more}
    one = Recording.from_columns(
        columns, replace(whole.metadata, controller=None), whole.experiment, whole.repeat
    )
    fitted = fit_model([one])
    assert error_of(fitted.model, INERTIA) == pytest.approx(
        0.1 / math.sqrt(12.0) * fitted.model[INERTIA], rel=0.2
    )
    assert any("less than by the demand" in one for one in fitted.notes)
