"""What a run fits its diagnosis on, what it chooses a model by, and what a drive keeps of it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from autotune.control.feedforward import LugreParameters
from autotune.control.model_feedforward import beyond_lugre, lugre_model
from autotune.control.reduction import LUGRE, Reduction
from autotune.control.refinement import PeriodAverage
from autotune.core.arrays import Floats
from autotune.core.axis import read_axis
from autotune.diagnosis.verdict import Diagnosis
from autotune.experiments.diagnosis import confirmation
from autotune.experiments.path import Motion
from autotune.experiments.runner import Budget
from autotune.models.drive_model import base_model
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Metadata, Recording
from autotune.tuning import stage_diagnose
from autotune.tuning.found_model import FoundModel
from autotune.tuning.proof import TrackingError
from autotune.tuning.session import Session
from autotune.tuning.stage_adapt import RefinementStep
from autotune.tuning.stage_diagnose import SECONDS, confirming, found_in
from autotune.tuning.stage_model import beats, plausible
from autotune.tuning.stage_reduce import announcement, comparison, holds_predicted
from tests.end_to_end.support import EXAMPLE
from tests.support.axes import NOMINAL

AXIS = read_axis(EXAMPLE)
N = 1000


def session_with(left: float, **limits: float) -> Session:
    """As much of a session as the choice of the confirming trajectory looks at."""
    known = SimpleNamespace(
        motion=Motion.of(AXIS),
        limits=AXIS.limits.model_copy(update=limits),
        budget=Budget(left),
        axis=AXIS,
        loop=SimpleNamespace(period=AXIS.cycle),
    )
    return cast(Session, known)


def test_the_confirming_trajectory_is_left_out_where_there_is_no_time_or_no_room() -> None:
    played = confirming(session_with(100.0), 60.0)
    assert [one.name for one in played] == ["veto", "veto"]
    assert SECONDS < sum(one.duration for one in played) <= 2.0 * SECONDS + 1.0
    assert confirming(session_with(70.0), 60.0) == ()
    assert confirming(session_with(100.0, position_max=0.05), 60.0) == ()


def test_the_confirming_trajectory_is_the_same_in_every_run_and_ends_where_it_began() -> None:
    one, other = (confirmation(Motion.of(AXIS), SECONDS, np.random.default_rng(7)) for _ in range(2))
    first, second = (cast(Any, parts[0]).positions for parts in (one, other))
    np.testing.assert_array_equal(first, second)
    assert abs(first[0]) < 1e-6
    assert abs(first[-1]) < 1e-6


def test_a_run_goes_on_with_another_law_of_the_base_where_nothing_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = base_model(NOMINAL)
    richer = FoundModel(given.with_fading(0.1, 0.0), 2e-3, 1e-3, None, "a veto trajectory")
    none = Diagnosis("none", (), None, (), (), {}, math.nan, None, True, base=("It fades.",))
    monkeypatch.setattr(stage_diagnose, "diagnose", lambda *_: none)
    monkeypatch.setattr(stage_diagnose, "found_model", lambda *_: richer)
    found = found_in([], given, "2024-05-01", "bench")
    assert found.model is richer.model
    assert "another law of its base" in found.notes[0]
    assert beyond_lugre(richer.model) == ("damping_velocity",)
    monkeypatch.setattr(stage_diagnose, "diagnose", lambda *_: replace(none, base=()))
    assert found_in([], given, "2024-05-01", "bench").model is None


def window(error: Floats, seed: int) -> Recording:
    """Six periods with a repeated error and noise of 40 µrad."""
    noise = np.random.default_rng(seed).normal(0.0, 40e-6, 6 * N)
    reference = np.tile(np.sin(2.0 * np.pi * np.arange(N) / N), 6)
    zero = np.zeros(6 * N)
    columns = {
        "time": np.arange(6 * N) * 1e-3, "reference": reference, "position": reference - np.tile(error, 6) - noise,
        "torque": zero, "torque_feedback": zero, "torque_feedforward": zero,
    }  # fmt: skip
    return Recording.from_columns(columns, Metadata(sample_period=1e-3), "refinement")


def test_a_model_is_chosen_only_where_it_is_better_beyond_doubt() -> None:
    glitch = 5e-4 * np.exp(-(((np.arange(N) - 300.0) / 15.0) ** 2))
    session = session_with(100.0)
    better, told = beats(window(0.3 * glitch, 1), window(glitch, 2), session)
    assert better
    assert "better beyond doubt" in told
    same, told = beats(window(glitch, 1), window(glitch, 2), session)
    assert not same
    assert "not better" in told
    assert not beats(window(glitch, 1), window(0.3 * glitch, 2), session)[0]


def test_a_model_that_is_far_from_what_was_played_is_not_tried_on_the_axis() -> None:
    reference = 0.2 * np.sin(2.0 * np.pi * np.arange(N) / N)
    nothing = np.zeros(N)
    known = LugreParameters(6.66e-4, 4.13e-3, 0.30, 60.0, 0.05, 0.048, 0.30)
    measured = PeriodAverage(reference, nothing, nothing, nothing, 1e-3, 6)
    rival = RefinementStep(known, measured, window(nothing, 1))
    model = lugre_model(known).with_effect(
        EFFECTS["torque_ripple"].make({"order_1": 72.0, "sin_1": 0.02, "cos_1": 0.0})
    )
    assert plausible(model, rival, 1.34)
    assert not plausible(model.with_values({"torque_ripple.sin_1": 0.5}), rival, 1.34)
    assert not plausible(model, rival, 0.4)


def test_what_a_drive_loses_of_a_model_is_said_and_measured() -> None:
    values = dict.fromkeys(LUGRE, 0.1)
    part = Reduction(values, (), 0.2e-3, 0.1e-3, 0.5e-3, 0.2e-3, 0.01, ("reversal_memory", "torque_ripple"))
    told = announcement(part, "rad")
    assert "0.50 mrad instead of 0.20 mrad" in told
    assert "reversal_memory, torque_ripple would have to come from the host" in told
    before = TrackingError(2.0e-3, 2.1e-3, 0.5e-3)
    assert holds_predicted(before, TrackingError(1.2e-3, 1.3e-3, 0.2e-3), part)
    assert not holds_predicted(before, TrackingError(1.3e-3, 1.3e-3, 0.2e-3), part)
    content = comparison(part, TrackingError(0.53e-3, 0.6e-3, 0.2e-3))
    assert content["lost"] == ["reversal_memory", "torque_ripple"]
    assert content["agreement"] == pytest.approx(1.1)
