"""Fits of recordings whose encoder is coarse, and no controller is known for a twin."""

from __future__ import annotations

import pytest

from autotune.identify.fit import FitResult, fit
from tests.support.axes import plain_axis
from tests.support.recorded_once import Dress, played

SEED, SECONDS = 9102, 15.0
AXIS = plain_axis(SEED, {})


def fitted(counts: int) -> FitResult:
    """The axis on waves of many frequencies, with so many counts a turn."""
    dress = Dress("coarse", counts=counts, controller=False, reference=False)
    return fit(played(AXIS, dress, "waves", SEED, SECONDS))


@pytest.fixture(scope="module")
def coarse() -> FitResult:
    """Friction reverses over 2.4 mrad here, four tenths of a count."""
    return fitted(1000)


def test_the_interval_of_a_coarse_encoder_holds_the_inertia(coarse: FitResult) -> None:
    """Up to 60 Hz it came out a quarter too large, "known" to 1.4 %."""
    low, high = coarse.estimate["inertia"].interval
    assert low <= float(AXIS.plant.inertia) <= high


def test_friction_that_reverses_within_a_count_is_not_identified(coarse: FitResult) -> None:
    for name in ("stiffness", "micro_damping"):
        assert not coarse.estimate[name].identified
        assert coarse.model.base[name].standard_error is None
    assert "a finer position" in coarse.reason
    assert "less than a count of the encoder" in " ".join(coarse.estimate.notes)


def test_a_fine_encoder_shows_all_of_it() -> None:
    fine = fitted(50_000)
    assert fine.valid
    assert fine.model["inertia"] == pytest.approx(float(AXIS.plant.inertia), rel=0.03)
    assert fine.model["stiffness"] == pytest.approx(float(AXIS.plant.bristle.stiffness), rel=0.1)
    assert fine.estimate["stiffness"].identified
