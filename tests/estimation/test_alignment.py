"""Columns of one recording that are not of one moment: a torque that comes after the motion that it causes."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.controller import find_controller
from autotune.identify.fit import fit
from autotune.recordings.recording import Recording
from tests.estimation.simulated import AXIS, TRUE, recorded

TOLERANCE = {"inertia": 0.01, "coulomb": 0.02, "viscous": 0.03}


def _with_torque(recording: Recording, torque: Floats, reference: bool = True) -> Recording:
    columns = {**recording.floats, "torque": torque}
    if not reference:
        columns.pop("reference")
    return replace(recording, floats=MappingProxyType(columns)).with_metadata(controller=None)


def _late(recording: Recording, rows: int) -> Floats:
    torque = recording["torque"]
    return np.concatenate([np.full(rows, torque[0]), torque[:-rows]])


@pytest.mark.parametrize("rows", [3, 10])
def test_a_torque_recorded_late_leads_no_twin(rows: int) -> None:
    """The law of a slower loop explains it to rounding; taken for it, the inertia was 2 to 14 % too small."""
    whole = recorded(TRUE, seconds=12.0)
    late = _with_torque(whole, _late(whole, rows))
    law = find_controller(prepared_for([late]))
    assert not law.usable
    assert "after the motion that it causes" in law.why
    found = fit(late)
    for name, tolerance in TOLERANCE.items():
        assert found.model[name] == pytest.approx(AXIS[name], rel=tolerance), name
    assert any("after the motion that it causes" in note for note in found.estimate.notes)


def test_a_loop_with_dead_time_is_no_late_record() -> None:
    """Reference and position are late there, and so is what the torque does: it acts when it was recorded."""
    whole = recorded(TRUE, seconds=12.0)
    assert find_controller(prepared_for([_with_torque(whole, whole["torque"])])).usable


@pytest.mark.parametrize("rows", [0, 2, 5])
def test_without_a_reference_a_fit_moves_the_torque_as_a_diagnosis_does(rows: int) -> None:
    whole = recorded(TRUE, seconds=12.0)
    torque = _late(whole, rows) if rows else whole["torque"]
    found = fit(_with_torque(whole, torque, reference=False))
    for name, tolerance in TOLERANCE.items():
        assert found.model[name] == pytest.approx(AXIS[name], rel=tolerance), name
