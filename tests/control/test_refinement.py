"""The predicted effect of a changed feedforward is the one that a linear loop shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from autotune.control.feedforward import LugreParameters
from autotune.control.refinement import PeriodAverage, error_response, periodic_feedforward, refine
from autotune.core.arrays import Floats
from autotune.recordings.recording import Controller

CONTROLLER = Controller(60.0, 0.15, 6000.0, 0.5)
TRUE = LugreParameters(6.66e-4, 4.13e-3, 0.3, 35.0, 0.08, 0.05, 0.3)


def linear_loop(mismatch: Floats, periods: int = 6, substeps: int = 20) -> Floats:
    """Error of the sampled PID on a pure inertia when `mismatch` is missing in the feedforward."""
    h = 1e-3
    q = v = integral = derivative = last = 0.0
    error = np.empty(periods * len(mismatch))
    for k in range(len(error)):
        y = q
        e = -y
        derivative += 0.5 * (-(y - last) / h - derivative)
        last = y
        integral += e * h
        u = 60.0 * e + 0.15 * derivative + 6000.0 * integral - mismatch[k % len(mismatch)]
        for _ in range(substeps):
            v += h / substeps * u / TRUE.inertia
            q += h / substeps * v
        error[k] = e
    return error[-len(mismatch) :]


def test_the_error_response_is_that_of_the_sampled_loop() -> None:
    phase = 2 * np.pi * np.arange(1000) / 1000
    mismatch = 0.02 * np.sin(3 * phase) + 0.01 * np.cos(11 * phase)
    response = error_response(CONTROLLER, TRUE.inertia, 1000, 1e-3)
    predicted = np.fft.irfft(response * np.fft.rfft(mismatch), 1000)
    measured = linear_loop(mismatch)
    assert np.abs(predicted - measured).max() < 0.08 * np.abs(measured).max()


def average(reference: Floats, wrong: LugreParameters) -> PeriodAverage:
    """A period as the linear loop would show it with the feedforward of `wrong` on the axis `TRUE`."""
    applied = periodic_feedforward(wrong, reference, 1e-3)
    mismatch = periodic_feedforward(TRUE, reference, 1e-3) - applied
    response = error_response(CONTROLLER, TRUE.inertia, len(reference), 1e-3)
    error = np.fft.irfft(response * np.fft.rfft(mismatch), len(reference))
    return PeriodAverage(reference, np.asarray(error), mismatch, applied, 1e-3, 10)


@pytest.mark.parametrize(
    "wrong", [{"stiffness": 25.0}, {"coulomb": 0.24, "break_away": 0.24}, {"offset": 0.1}]
)
def test_refinement_finds_the_parameters_that_the_axis_has(wrong: dict[str, float]) -> None:
    reference = 0.2 * np.sin(2 * np.pi * np.arange(1000) / 1000)
    current = replace(TRUE, **wrong)
    low = LugreParameters(1e-4, 0.0, 0.1, 8.0, 0.0, -0.2, 0.1)
    high = LugreParameters(1e-3, 1e-2, 0.6, 140.0, 0.3, 0.3, 0.6)
    measured = average(reference, current)
    found = refine(measured, current, CONTROLLER, low, high)
    assert found.parameters.stiffness == pytest.approx(35.0, rel=0.03)
    assert found.parameters.coulomb == pytest.approx(0.3, rel=0.03)
    assert found.parameters.offset == pytest.approx(0.05, abs=0.01)
    assert found.predicted_peak < 0.15 * measured.peak_error or measured.peak_error < 1e-5


def test_refinement_never_leaves_its_bounds() -> None:
    reference = 0.2 * np.sin(2 * np.pi * np.arange(1000) / 1000)
    current = replace(TRUE, stiffness=15.0)
    low = LugreParameters(1e-4, 0.0, 0.29, 14.0, 0.07, 0.04, 0.29)
    high = LugreParameters(1e-3, 1e-2, 0.31, 18.0, 0.09, 0.06, 0.31)
    found = refine(average(reference, current), current, CONTROLLER, low, high).parameters
    assert 14.0 <= found.stiffness <= 18.0
    assert 0.29 <= found.coulomb <= 0.31
