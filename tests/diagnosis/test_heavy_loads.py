"""Plain fits of what a plain model lacks most of: a joint under its own weight, a fan, and a torque of the wrong sign.

The axis is a few lines of its own, with the torque computed from the motion, so that what is hidden is known exactly.
"""

from __future__ import annotations

import numpy as np
import pytest

import autotune
from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.diagnosis.baseline import begin
from autotune.estimation.bandwidth import prepared_for
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Metadata, Recording

PERIOD = 4e-3
INERTIA, COULOMB, VISCOUS, WEIGHT = 0.4, 0.8, 0.7, 12.0


def _recorded(q: np.ndarray, torque: np.ndarray, noise: float) -> Recording:
    time = np.arange(len(q)) * PERIOD
    held = 0.5 * (torque + np.concatenate([torque[1:], torque[-1:]]))
    held += np.random.default_rng(2).normal(0.0, noise, len(q))
    metadata = Metadata(sample_period=PERIOD, position_resolution=1e-6)
    return Recording.from_columns({"time": time, "position": q, "torque": held}, metadata, "lab")


def _moved(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    v = np.gradient(q, PERIOD)
    return v, np.gradient(v, PERIOD)


def _joint(weight: float, sign: float = 1.0) -> Recording:
    """A shoulder that swings within a quarter of a turn; `weight` in N m with the arm level."""
    time = np.arange(0.0, 40.0, PERIOD)
    q = sum(
        a * np.sin(2 * np.pi * f * time + p) for a, f, p in ((0.6, 0.11, 0), (0.25, 0.37, 1), (0.06, 1.3, 2))
    )
    q = q - 1.0
    v, a = _moved(q)
    torque = INERTIA * a + VISCOUS * v + COULOMB * np.tanh(v / 2e-3) + weight * np.sin(q)
    return _recorded(q, sign * torque, 0.02)


def _pendulum() -> Recording:
    """An arm that swings at about its own rate: its inertia takes most of the weight, little is left to the motor."""
    time = np.arange(0.0, 40.0, PERIOD)
    q = sum(
        a * np.sin(2 * np.pi * f * time + p) for a, f, p in ((0.9, 0.8, 0), (0.4, 0.95, 1), (0.05, 2.0, 2))
    )
    v, a = _moved(q)
    torque = INERTIA * a + 0.1 * v + COULOMB * np.tanh(v / 2e-3) + WEIGHT * np.sin(q)
    return _recorded(q, torque, 0.02)


def _fan(dry: float = 0.03) -> Recording:
    """A fan: drag with the square of the speed, and next to no dry friction."""
    time = np.arange(0.0, 40.0, PERIOD)
    v = 120.0 * np.sin(2 * np.pi * 0.11 * time) + 60.0 * np.sin(2 * np.pi * 0.41 * time + 1.0)
    q = np.cumsum(v) * PERIOD
    v, a = _moved(q)
    torque = 3e-3 * a + dry * np.tanh(v / 0.5) + 1e-3 * v + 4e-5 * np.abs(v) * v
    return _recorded(q, torque, 0.01)


@pytest.mark.parametrize("weight", [3.0, WEIGHT])
def test_a_heavy_arm_is_fitted_however_heavy_it_is_and_its_weight_is_named(weight: float) -> None:
    recording = _joint(weight)
    found = autotune.fit([recording])
    assert found.valid
    assert any("as gravity makes it" in note for note in found.notes)
    assert found.model["inertia"] == pytest.approx(INERTIA, rel=0.05)
    assert found.model["coulomb"] == pytest.approx(COULOMB, rel=0.05)
    verdict = autotune.diagnose([recording], found.model)
    assert verdict.effects[:1] == ("gravity_imbalance",)


def test_a_model_that_leaves_more_than_the_torque_is_not_valid_however_well_the_rest_is_known() -> None:
    """Inertia is right, but a model without the weight asks for several times the torque that the arm takes."""
    recording = _pendulum()
    found = autotune.fit([recording])
    assert found.model["inertia"] == pytest.approx(INERTIA, rel=0.05)
    assert found.relative_error > 1.0
    assert not found.valid
    assert "take it in with --effects" in found.reason
    taken_in = autotune.fit([recording], effects=["gravity_imbalance"])
    assert taken_in.valid
    assert taken_in.relative_error < 0.1


def test_a_torque_of_the_wrong_sign_is_no_heavy_arm() -> None:
    with pytest.raises((RecordingError, NotEnoughExcitation)):
        autotune.fit([_joint(0.0, -1.0)])
    base = {
        "inertia": INERTIA,
        "viscous": VISCOUS,
        "coulomb": COULOMB,
        "stiffness": 500.0,
        "micro_damping": 2.0,
    }
    with pytest.raises(NotEnoughExcitation):
        begin(prepared_for([_joint(WEIGHT, -1.0)]), base_model(base | {"offset": 0.0}))


def test_drag_that_makes_coulomb_friction_come_out_below_zero_is_left_to_the_search() -> None:
    recording = _fan()
    found = autotune.fit([recording])
    assert found.valid
    assert found.method == "search"
    assert "below zero" in found.reason
    assert "coulomb" in found.not_identified
    assert found.model["inertia"] == pytest.approx(3e-3, rel=0.1)
    low, high = found.to_json()["intervals"]["inertia"]
    assert low < found.model["inertia"] < high
    assert "coulomb" not in found.to_json()["intervals"]
    assert "nonlinear_viscous" in autotune.diagnose([recording], found.model).effects


def test_friction_over_place_is_not_told_from_motion_one_way() -> None:
    """A motor that rolls on: any friction over the place is a torque over the place."""
    time = np.arange(0.0, 25.0, PERIOD)
    q = 5.0 * time + 0.3 * np.sin(2 * np.pi * 0.4 * time)
    v, a = _moved(q)
    waves = 0.3 * np.sin(3 * q) + 0.1 * np.sin(14 * q)
    recording = _recorded(q, 5e-3 * a + 0.5 + 0.01 * v + waves, 0.02)
    verdict = autotune.diagnose([recording], autotune.fit([recording]).model)
    assert "position_dependent_friction" not in verdict.effects
