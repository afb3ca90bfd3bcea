"""The standard programme as a whole: parameters, disagreements in words, and bad recordings."""

import math

import numpy as np
import pytest

from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.identify.dahl import kinetic_difference
from autotune.identify.run import identify_run
from autotune.recordings.checks import (
    check_recording,
    refuse_clipping,
    refuse_limits_throughout,
    swings_at,
)
from autotune.recordings.recording import Metadata, Recording
from tests.support.identification_programme import reversal_of

ACCELERATION = 0.2 * (2.0 * math.pi) ** 2


@pytest.fixture(scope="module")
def identified_vertical(vertical):
    return vertical[0].plant, identify_run(vertical[1], precision=0.1)


def test_all_parameters_of_a_lugre_axis_come_back(identified) -> None:
    plant, result = identified
    truth = {
        "inertia": plant.inertia,
        "coulomb": plant.bristle.coulomb,
        "offset": plant.offset,
        "stiffness": plant.bristle.stiffness,
        "micro_damping": plant.bristle.damping,
        "viscous": plant.viscous,
        "break_away": plant.bristle.break_away,
        "stribeck_velocity": plant.bristle.velocity,
    }
    assert result.joint.valid
    for name, value in truth.items():
        tolerance = 0.15 if name in ("stribeck_velocity", "micro_damping") else 0.06
        assert result.joint[name].value == pytest.approx(value, rel=tolerance), name
    assert result.model is not None
    assert result.model["inertia"] == result.joint["inertia"].value
    assert "stribeck" in result.model


def test_one_element_agrees_and_the_axis_needs_lugre(identified) -> None:
    plant, result = identified
    assert any("they agree" in note for note in result.notes)
    assert result.complexity.lugre_needed
    x_s = plant.bristle.break_away / plant.bristle.stiffness
    assert result.complexity.displacement.value == pytest.approx(x_s, rel=0.08)
    assert "mrad" in result.complexity.text


def test_several_elements_are_named_as_the_reason(identified_vertical) -> None:
    _, result = identified_vertical
    assert any("several elastic elements" in note for note in result.notes)
    assert not result.complexity.lugre_needed
    assert "kinetic model" in result.complexity.text


def test_the_reversal_is_as_long_as_the_plant_s_own_and_never_shorter(identified_vertical) -> None:
    """Presliding alone said 2.5 mrad and 25 ms. At most 15 % too long (the time 8 %, its root)."""
    plant, result = identified_vertical
    travel, duration = reversal_of(plant, ACCELERATION)
    found = result.complexity
    assert not found.lower_bound
    assert travel <= found.displacement.value < 1.15 * travel
    assert duration <= found.duration < 1.08 * duration
    assert found.peak_difference == pytest.approx(2.0 * plant.friction, rel=0.1)


def test_a_missing_experiment_is_said_and_the_others_are_used(varied) -> None:
    result = identify_run(varied[1].select("steady_state", "benchmark"))
    assert not result.joint.valid
    assert "inertia" in result.joint.reason
    assert "no experiment 'presliding'" in result.estimates["presliding"].reason
    assert result.model is None
    assert result.estimates["steady_state"].valid


def _made(columns: dict, **metadata) -> Recording:
    return Recording.from_columns(columns, Metadata(**metadata), "x")


def _moving(n: int = 2000) -> dict[str, np.ndarray]:
    time = np.arange(n) * 1e-3
    return {"time": time, "position": np.sin(6 * time), "torque": np.sin(6 * time + 1.0)}


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"time": lambda t: t[::-1].copy()}, RecordingError, "decreases at row 1 "),
        ({"time": lambda t: np.repeat(t[::2], 2)}, RecordingError, "duplicated"),
        ({"torque": lambda u: np.where(np.arange(len(u)) == 700, np.nan, u)}, RecordingError, "row 700"),
        ({"position": np.zeros_like}, NotEnoughExcitation, "position is 0 in all 2000"),
        ({"torque": lambda u: np.full_like(u, 0.25)}, NotEnoughExcitation, "torque is 0.25"),
    ],
)
def test_bad_recordings_get_a_sentence(change, error, says) -> None:
    columns = _moving()
    for name, alter in change.items():
        columns[name] = alter(columns[name])
    with pytest.raises(error, match=says):
        check_recording(_made(columns))


def test_too_short_and_empty() -> None:
    with pytest.raises(NotEnoughExcitation, match="too short: 100 rows"):
        check_recording(_made(_moving(100)))
    with pytest.raises(RecordingError, match="empty"):
        check_recording(_made(_moving(0)))


def test_two_axes_row_by_row_in_one_file_are_recognised() -> None:
    time = np.repeat(np.arange(2000) * 1e-3, 2)
    position = np.where(np.arange(4000) % 2, 5.0 + np.cos(3 * time), np.sin(6 * time))
    with pytest.raises(RecordingError, match="two axes are mixed"):
        check_recording(_made({"time": time, "position": position, "torque": np.sin(time)}))


def test_a_clipped_torque_is_refused_with_place_and_share() -> None:
    columns = _moving()
    columns["torque"] = np.clip(columns["torque"], -0.7, 0.7)
    with pytest.raises(NotEnoughExcitation, match=r"clipped at 0\.7 .* of the rows \(first at 0\.00"):
        refuse_clipping(_made(columns))
    assert refuse_clipping(_made(_moving())).share == 0.0


@pytest.mark.parametrize(
    ("swing", "follows", "says"),
    [(2e-3, True, "swings at 150 Hz.*the loop hunts.*Lower the gains"), (0.0, False, "gentler motion")],
    ids=["it hunts", "it is asked too much"],
)
def test_a_loop_that_hunts_between_its_limits_is_told_from_motion_that_asks_too_much(
    swing: float, follows: bool, says: str
) -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    reference = 0.5 * np.sin(2 * np.pi * 0.8 * time)
    hunts = np.sin(2 * np.pi * 150.0 * time)
    torque = 2.0 * hunts if swing else 2.0 * np.sin(2 * np.pi * 0.8 * time)
    position = reference + swing * hunts if follows else 0.7 * np.roll(reference, 40)
    columns = {
        "time": time,
        "position": position,
        "reference": reference,
        "torque": np.clip(torque, -1.0, 1.0),
    }
    recording = _made(columns).with_metadata(torque_limit=1.0)
    with pytest.raises(NotEnoughExcitation, match=says):
        refuse_clipping(recording)
    with pytest.raises(NotEnoughExcitation, match=f"away from it for long enough.*{says}"):
        refuse_limits_throughout(recording)
    assert swings_at(_made({name: columns[name] for name in ("time", "position", "torque")})) == 0.0


def test_the_kinetic_model_is_wrong_by_twice_the_friction_at_a_reversal() -> None:
    """(3.39) and its slope (3.40)."""
    time = np.array([0.0, 1e-6, 1.0])
    p = kinetic_difference(time, 0.3, 100.0, 0.1, 8.0)
    assert p[0] == pytest.approx(0.6)
    assert (p[1] - p[0]) / 1e-6 == pytest.approx(-2 * 0.1 * 8.0, rel=1e-3)
    assert p[2] == pytest.approx(0.0, abs=1e-9)
    assert math.isfinite(p[2])
