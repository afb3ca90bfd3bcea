"""Which of two fits a recording gets: that of all motion in a loop of the rows, or the search's along the motion."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis import fit_recordings
from autotune.diagnosis.fit_result import FitResult
from autotune.identify.estimate import Estimate, Quantity
from autotune.models.drive_model import DriveModel, base_model
from autotune.recordings.recording import Recording
from tests.support.arm import COULOMB, INERTIA, arm

NUMBERS = {
    "inertia": 1.5e-3, "viscous": 2.4e-3, "coulomb": 0.05, "stiffness": 86.0, "micro_damping": 0.15, "offset": 0.0,
}  # fmt: skip
FLOOR = 0.83e-3


def fitted(method: str, **values: float) -> FitResult:
    model = base_model({**NUMBERS, **values})
    model = model.with_values({"inertia": model["inertia"]}, {"inertia": 1e-6})
    return FitResult(model, method, Estimate(method, {}, True, "", 0.01, ()), ())


def compared(error: float, lag: float = 0.0, late_record: bool = False, repeated: bool = True) -> Any:
    data = SimpleNamespace(lag=lag, lag_error=1e-5, late=0.0, cycles=0, repeated=repeated)
    problem = SimpleNamespace(data=data)
    return SimpleNamespace(
        problem=problem, twin=True, late_record=late_record, error_rms=error, noise_floor_rms=FLOOR
    )


@pytest.mark.parametrize(
    ("first", "search", "known", "taken"),
    [
        (2.36e-3, 0.836e-3, {}, True),
        (2.36e-3, 2.1e-3, {}, False),
        (0.9e-3, 0.83e-3, {}, None),
        (2.36e-3, 0.836e-3, {"repeated": False}, None),
        (0.9e-3, 0.85e-3, {"lag": 1e-3}, True),
        (0.9e-3, 0.899e-3, {"lag": 1e-3}, False),
        (0.9e-3, 1.1e-3, {"late_record": True}, True),
    ],
    ids=[
        "a drive between the rows", "a missing effect", "noise", "nothing repeats", "a late torque",
        "a late torque that changes nothing", "a late record",
    ],
)  # fmt: skip
def test_the_search_fits_where_the_loop_of_the_rows_leaves_what_is_no_noise(
    monkeypatch: pytest.MonkeyPatch, first: float, search: float, known: dict[str, Any], taken: bool | None
) -> None:
    """Behind drives faster than rows viscosity came out at 1.06 to 2.25 times the truth, at 7 to 18 standard errors,
    on axes that lack nothing; the search leaves their noise. `taken`: None where it is not asked."""
    asked: list[bool] = []

    def by_search(*_: Any) -> FitResult:
        asked.append(True)
        return fitted("search", inertia=1.45e-3)

    def told(_: Any, model: DriveModel) -> Any:
        return compared(search if model["inertia"] == 1.45e-3 else first, **known)

    monkeypatch.setattr(fit_recordings, "_by_search", by_search)
    monkeypatch.setattr(fit_recordings, "compared_or_none", told)
    whole: Any = None
    result, its = fit_recordings._behind_the_chain(
        fitted("twin", viscous=3.8e-3), whole, [], (), lambda _: None
    )
    assert bool(asked) == (taken is not None)
    assert result.method == ("search" if taken else "twin")
    assert its is not None
    assert its.error_rms == (search if taken else first)


def test_an_inertia_is_no_surer_than_two_ways_of_taking_the_torque_agree(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Rows in step with a drive's loop: 3 % less inertia, told to 0.03 %."""
    monkeypatch.setattr(fit_recordings, "_by_search", lambda *_: fitted("search", inertia=1.45e-3))
    monkeypatch.setattr(
        fit_recordings,
        "compared_or_none",
        lambda _, model: compared(0.84e-3 if model["inertia"] == 1.45e-3 else 2.36e-3),
    )
    whole: Any = None
    result, _ = fit_recordings._behind_the_chain(fitted("twin"), whole, [], (), lambda _: None)
    assert result.model is not None
    assert result.model.parameters["inertia"].standard_error == pytest.approx(0.05e-3)
    assert result.model["inertia"] == 1.45e-3


def _by_chance() -> Recording:
    """A joint whose experiments have two names of the standard programme, and are none of it."""
    moves = arm()
    columns = {name: moves[name] for name in ("time", "position", "torque")}
    early = np.arange(len(moves)) < len(moves) // 2
    return Recording.from_columns(columns, moves.metadata, np.where(early, "presliding", "high_speed"))


def test_experiments_that_are_of_the_standard_programme_by_name_only_are_fitted_together() -> None:
    """Files with the labels 'presliding' and 'high_speed' were refused: there was no 'steady_state' in them."""
    found = fit_recordings.fit_recordings([_by_chance()])
    assert (found.valid, found.method) == (True, "twin")
    assert found.model is not None
    assert found.model["coulomb"] == pytest.approx(COULOMB, rel=0.05)
    assert found.model["inertia"] == pytest.approx(INERTIA, rel=0.05)


def test_where_that_fails_too_the_programme_says_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> FitResult:
        raise NotEnoughExcitation("the axis was not excited")

    monkeypatch.setattr(fit_recordings, "_together", refused)
    found = fit_recordings.fit_recordings([_by_chance()])
    assert not found.valid
    assert "there is no experiment 'steady_state'" in found.reason


@pytest.mark.parametrize(
    ("left", "noise", "identified", "valid", "said"),
    [
        (0.13, 0.05, False, True, "'autotune model diagnose' tells whether something is missing"),
        (0.35, float("nan"), False, False, "without --model tells whether something is missing"),
        (0.13, 0.12, False, True, ""),
        (0.05, 0.01, False, True, ""),
        (0.13, 0.05, True, True, ""),
    ],
    ids=["hidden", "not valid, played once", "noise", "hardly anything is left", "all is known"],
)
def test_what_is_not_identified_may_be_hidden_by_what_the_model_leaves(
    left: float, noise: float, identified: bool, valid: bool, said: str
) -> None:
    """A file that had all its speeds was to "move faster": a tight place and a saturation hid its friction."""
    known = {"viscous": Quantity(1e-3, 1e-2, math.nan, identified, "")}
    estimate = Estimate("joint", known, valid, "" if identified else "viscous not identified", left, ())
    found: Any = SimpleNamespace(relative_error=left, error_rms=left, noise_floor_rms=noise)
    told = fit_recordings._hidden(estimate, found)
    assert bool(told) is bool(said)
    assert said in told
    assert not told or f"{100 * left:.0f} % of the torque" in told


@pytest.mark.parametrize(
    ("left", "repeated", "said"),
    [(0.0368, True, "2.3 %"), (0.0298, True, ""), (0.0368, False, ""), (0.6, True, "")],
    ids=["a contact by another law", "noise", "nothing repeats", "said already"],
)
def test_what_comes_again_and_is_not_explained_is_said_beside_the_numbers(
    left: float, repeated: bool, said: str
) -> None:
    """On Dahl's contact viscous friction was 15 % off with a standard error of 1.4 %, without a word."""
    found = compared(left, repeated=repeated)
    found.relative_error, found.noise_floor_rms = left, 0.0284
    told = fit_recordings._comes_again(found)
    assert len(told) == bool(said)
    assert all(f"{said} of the torque (rms) is left in every repeat" in note for note in told)
    assert all("beside 2.8 % of noise" in note for note in told)
