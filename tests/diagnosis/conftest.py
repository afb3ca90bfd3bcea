"""Recordings of the simulated axis with planted effects, played once for all tests."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from autotune.diagnosis.baseline import begin
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.problem import Problem
from autotune.models.drive_model import DriveModel, base_model
from autotune.recordings.recording import Recording
from tests.support.axes import NOMINAL, plain_axis
from tests.support.diagnosis_programme import play, programme


@pytest.fixture(scope="session")
def recorded() -> Callable[..., Recording]:
    """recorded(seed, spring=0.004) plays the whole diagnosis programme; equal calls are played once."""

    @cache
    def make(seed: int, **effects: float) -> Recording:
        return play(plain_axis(seed, effects), seed)

    return make


@pytest.fixture(scope="session")
def short() -> Recording:
    """A few seconds of it, without effects."""
    return play(plain_axis(3), 3, programme(("sine", "points")))


@pytest.fixture(scope="session")
def begun(short: Recording) -> tuple[Problem, ModelFit]:
    """What a diagnosis of it begins with."""
    return begin(prepared_to_fit([short]), base_model(NOMINAL))[:2]


@pytest.fixture
def nominal() -> DriveModel:
    """The model before anything was fitted."""
    return base_model(NOMINAL)
