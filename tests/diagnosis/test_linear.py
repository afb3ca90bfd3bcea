"""Is the torque just the controller? What a hand moved is refused; a loop that cannot be simulated is said."""

import numpy as np
import pytest

from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis.evidence.evidence import HoldoutResult
from autotune.diagnosis.evidence.single import SingleRecording
from autotune.diagnosis.evidence.visibility import (
    LOOP_LIKE,
    linear_share,
    loop_like,
    loop_note,
    refuse_answers,
)
from autotune.diagnosis.verdict import diagnose
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.data import prepare
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Metadata, Recording
from tests.support.axes import plain_axis
from tests.support.recorded_once import DRESSES, played

PERIOD = 1e-3
COUNT = 2 * np.pi / 20_000


def _wave(seconds: float = 15.0) -> np.ndarray:
    time = np.arange(0.0, seconds, PERIOD)
    return sum(
        a * np.sin(2 * np.pi * f * time + p)
        for a, f, p in ((1.5, 0.11, 0.3), (0.8, 0.43, 1.0), (0.1, 1.7, 2.0))
    )


def _recording(torque: np.ndarray, q: np.ndarray, reference: np.ndarray | None = None) -> Recording:
    columns = {"time": np.arange(len(q)) * PERIOD, "position": np.round(q / COUNT) * COUNT, "torque": torque}
    if reference is not None:
        columns["reference"] = reference
    return Recording.from_columns(columns, Metadata(sample_period=PERIOD, position_resolution=COUNT), "hand")


def _answer(q: np.ndarray) -> np.ndarray:
    """What a controller holds against a hand that moves the axis."""
    noise = np.random.default_rng(2).normal(0.0, 1e-3, len(q))
    return -0.2 * q - 0.01 * np.gradient(q, PERIOD) + noise


@pytest.mark.parametrize("resting", [True, False])
def test_an_axis_moved_by_hand_tells_only_its_controller(nominal: DriveModel, resting: bool) -> None:
    q = _wave()
    recording = _recording(_answer(q), q, np.zeros(len(q)) if resting else None)
    with pytest.raises(NotEnoughExcitation, match="just a controller's answer"):
        diagnose([recording], nominal)


def test_a_spring_that_the_drive_moves_is_no_answer() -> None:
    q = _wave()
    data = prepared_for([_recording(0.2 * q + 0.01 * np.gradient(q, PERIOD), q)])
    refuse_answers(data)
    assert loop_note(data) == ()


def test_a_reference_that_is_followed_causes_the_motion() -> None:
    recording = played(plain_axis(20_028), DRESSES[1], "periodic", 20_028, 8.0)
    data = prepare([recording])
    assert linear_share(data) > 0.99
    refuse_answers(data)
    assert loop_like(data) == LOOP_LIKE
    assert "may be that controller" in loop_note(data)[0]
    measured = played(plain_axis(20_028), DRESSES[-1], "periodic", 20_028, 8.0)
    assert loop_note(prepare([measured])) == ()


def test_what_looks_like_the_loop_is_not_confirmed_without_a_twin() -> None:
    from autotune.estimation.problem import new_problem

    recording = played(plain_axis(20_028), DRESSES[1], "periodic", 20_028, 8.0)
    problem = new_problem(prepare([recording]), None)
    carried = [HoldoutResult(name, 0.9, 9.0, lowers=True) for name in ("spring", "torque_ripple")]
    assert not SingleRecording().confirms(problem, ["spring"], carried)
    assert SingleRecording().confirms(problem, ["torque_ripple"], carried)
