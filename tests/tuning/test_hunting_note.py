"""What a run's report says of the drive's own gains."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from autotune.core.axis import Axis
from autotune.recordings.recording import Controller
from autotune.tuning.hunting_note import hunting_note
from autotune.tuning.session import Session
from tests.control.gains_axis import lugre, vertical
from tests.drivers.simulator import axis_of


def session(controller: Controller | None) -> Session:
    axis: Axis = axis_of()
    return cast(Session, SimpleNamespace(axis=axis, controller=controller, limits=axis.limits))


@pytest.mark.parametrize(
    ("controller", "words"),
    [
        (Controller(60.0, 0.15, 6000.0), "does not hunt on the model"),
        (Controller(16.4, 0.02, 2000.0), "hunts after a step, by about ±"),
        (Controller(16.4, 0.02, 1000.0), "unstable while the axis slides; at a set point friction holds it"),
        (None, ""),
    ],
)
def test_the_note_says_whether_the_axis_hunts(controller: Controller | None, words: str) -> None:
    note = hunting_note(session(controller), vertical())
    assert words in note if words else note == ""


def test_an_axis_that_is_shaken_hunts_in_bursts_where_one_at_rest_would_hold() -> None:
    """Friction that falls with speed, a soft loop and a slow integral: it sticks, and noise sets it free."""
    slow = session(Controller(0.5, 0.012, 2.0))
    model = lugre(0.3, 0.36)
    assert "hunts after a step" in hunting_note(slow, model, 0.005)
    assert "hunts after a step" not in hunting_note(slow, model)
