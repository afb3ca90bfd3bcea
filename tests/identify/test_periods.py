"""The fit follows the recording: its sampling period, and an axis that is much faster than a servo axis.

The truth is that of the simulation. Tolerances: three times what seeds differ by at 1 kHz, and for the stiffness,
whose reversal takes 1.25 mrad, what is left of it where a cycle of 2 ms passes it in a few samples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from autotune.estimation.bandwidth import Bands, busy_below
from autotune.estimation.controller_law import PositionController
from autotune.identify.fit import FitResult, fit
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Recording
from tests.estimation.simulated import AXIS, recorded

SOFT = PositionController(1.0, 0.015, 5.0, 1.0)
"""A controller that is stable at 4 ms too."""
TOLERANCE = {"inertia": 2e-3, "coulomb": 5e-3, "viscous": 1e-2, "stiffness": 0.05, "micro_damping": 0.1}


def _without_reference(recording: Recording) -> Recording:
    columns = {name: recording[name] for name in ("time", "position", "torque")}
    return Recording.from_columns(columns, recording.metadata, "motion")


def _faster(recording: Recording, times: float) -> Recording:
    """The same motion on an axis that is so many times faster: no force and no travel is another."""
    columns = {name: recording[name] for name in recording.floats}
    columns["time"] = columns["time"] / times
    metadata = replace(recording.metadata, sample_period=recording.period / times)
    return Recording.from_columns(columns, metadata, "motion")


def _far(found: FitResult, times: float = 1.0) -> dict[str, float]:
    """Parameters that are farther from the truth than they may be, with their relative error."""
    power = {"inertia": 2, "viscous": 1, "micro_damping": 1}
    true = {name: AXIS[name] / times ** power.get(name, 0) for name in TOLERANCE}
    errors = {name: found.model[name] / true[name] - 1.0 for name in TOLERANCE}
    return {name: error for name, error in errors.items() if not abs(error) <= TOLERANCE[name]}


@pytest.mark.parametrize("period", [2.5e-4, 2e-3])
@pytest.mark.parametrize("led", [True, False])
def test_an_axis_is_the_same_at_every_sampling_period(period: float, led: bool) -> None:
    """With its controller known and in torque mode, where filters once made the damping 12 to 70 % too large."""
    recording = recorded(SOFT, seconds=5.0, period=period)
    assert _far(fit(recording if led else _without_reference(recording))) == {}


def test_at_four_milliseconds_what_the_samples_can_show_is_right() -> None:
    """Eighty hertz of resonance on the bristle are beyond such samples: the intervals of stiffness say so."""
    found = fit(recorded(SOFT, seconds=12.0, period=4e-3)).model
    for name in ("inertia", "coulomb", "viscous"):
        assert found[name] == pytest.approx(AXIS[name], rel=TOLERANCE[name]), name
    assert found["stiffness"] == pytest.approx(AXIS["stiffness"], rel=0.2)


@pytest.mark.parametrize("times", [50.0])
def test_an_axis_fifty_times_as_fast_is_identified_at_50_khz(times: float) -> None:
    found = fit(_faster(_without_reference(recorded(SOFT, seconds=30.0)), times))
    assert _far(found, times) == {}


def test_bands_are_the_usual_ones_where_the_axis_is_usual() -> None:
    usual = Bands.of(recorded(SOFT))
    assert (usual.motion, usual.error, usual.decimation, usual.pace) == (150.0, 60.0, 8, 1.0)
    fine = Bands.of(recorded(SOFT, period=2.5e-4))
    assert (fine.error, fine.decimation) == (60.0, 33)
    coarse = Bands.of(recorded(SOFT, period=4e-3))
    assert (coarse.motion, coarse.error, coarse.decimation, coarse.pace) == (37.5, 15.0, 8, 4.0)


def test_ripple_of_a_current_does_not_make_an_axis_fast() -> None:
    """Twenty times the torque of the axis at 3 kHz: nothing moves by it."""
    slow = recorded(SOFT, period=1e-4, seconds=3.0)
    time = slow["time"]
    columns = {name: slow[name] for name in ("time", "position")}
    columns["torque"] = slow["torque"] + 1.0 * np.sin(2.0 * np.pi * 3e3 * time)
    assert busy_below(Recording.from_columns(columns, slow.metadata, "motion")) == 0.0
    assert Bands.of(_faster(_without_reference(recorded(SOFT)), 50.0)).error > 400.0


def test_the_stiffness_of_another_axis_is_not_pulled_to_the_usual_one() -> None:
    """A twin in torque mode is led along the motion with what its own inertia needs."""
    stiff = base_model({**AXIS, "stiffness": 160.0})
    found = fit(_without_reference(recorded(SOFT, model=stiff, seconds=8.0))).model
    assert found["stiffness"] == pytest.approx(160.0, rel=0.15)
