"""Columns of one recording that are not of one moment: a torque that comes after the motion that it causes."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
import scipy

from autotune.core.arrays import Floats
from autotune.diagnosis.fit_recordings import fit_recordings
from autotune.diagnosis.verdict import diagnose
from autotune.estimation.alignment import aligned, low_passed
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.controller import find_controller
from autotune.identify.fit import fit
from autotune.recordings.recording import Metadata, Recording
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


def _rolling(speed: float, seconds: float = 20.0) -> Recording:
    """A bare motor (A, rad) that a slow speed loop keeps rolling over its cogging, 18 and 72 waves a turn.

    The loop sees a velocity that went through 30 Hz, so that its answer looks like a filtered torque.
    """
    period, parts, inertia, friction = 1e-3, 10, 2.2e-4, 0.08
    rows = round(seconds / period)
    position, torque = np.empty(rows), np.empty(rows)
    q = v = seen = total = 0.0
    last = 0.0
    for row in range(rows):
        seen += 0.17 * ((q - last) / period - seen)
        last = q
        total += 0.3 * (speed - seen) * period
        position[row], torque[row] = q, 0.03 * (speed - seen) + total
        for _ in range(parts):
            cogging = 0.14 * np.sin(18.0 * q) + 0.12 * np.sin(72.0 * q + 1.0)
            v += (torque[row] - cogging - friction * np.tanh(v / 0.05)) / inertia * period / parts
            q += v * period / parts
    columns = {"time": period * np.arange(rows), "position": position, "torque": torque}
    return Recording.from_columns(columns, Metadata(), "rolling")


@pytest.mark.parametrize("speed", [6.0, 8.0])
def test_a_controller_s_answer_is_no_filtered_torque(speed: float) -> None:
    """It holds against velocity: taken for a filter, the motion was smoothed until no inertia was left, nor cogging."""
    recording = _rolling(speed)
    assert low_passed(prepared_for([recording])) is None
    model = fit_recordings([recording]).model
    assert model is not None
    assert model["inertia"] == pytest.approx(2.2e-4, rel=0.4)
    found = diagnose([recording], model)
    assert found.effects == ("torque_ripple",)
    assert not any(
        "whatever the motion" in note for note in found.notes
    )  # at one speed cogging is in step with time


def _under_gravity() -> Recording:
    """An arm's joint over a third of a turn: a load of 110 N m, 14 N m of friction, samples of 8 ms."""
    period = 8e-3
    time = period * np.arange(2500)
    q = 0.3 + 0.5 * np.sin(0.63 * time) + 0.35 * np.sin(1.7 * time + 1.0) + 0.1 * np.sin(4.4 * time)
    v, a = np.gradient(q, period), np.gradient(np.gradient(q, period), period)
    torque = 7.0 * a + 16.0 * v + 14.0 * np.tanh(v / 0.01) + 110.0 * np.sin(q + 0.2)
    torque += np.random.default_rng(3).normal(0.0, 0.3, len(q))
    return Recording.from_columns(
        {"time": time, "position": q, "torque": torque}, Metadata(sample_period=period), "joint"
    )


@pytest.mark.parametrize("rows", [0, 2])
def test_a_load_draws_the_torque_nowhere(rows: int) -> None:
    """What belongs to the place was missing when columns were brought together: it came out two samples off."""
    joint = _under_gravity()
    late = _with_torque(joint, _late(joint, rows) if rows else joint["torque"])
    data = aligned(prepared_for([late]))
    assert data.shift / data.upsampling == pytest.approx(2.0 * rows, abs=1.0)


def _accelerated(pressed: float, bent: float) -> Recording:
    """A screw in strokes up to 30 Hz, without a reference, rows of 1 ms.

    `pressed`: share of the inertia's torque by which friction grows under it; `bent`: friction that grows with the
    square of speed, at the highest, of all other.
    """
    period = 1e-3
    time = period * np.arange(20_000)
    phases = 2.0 * np.pi * np.cumsum(np.linspace(0.3, 8.0, len(time))) * period
    q = 4.0 / (1.0 + np.linspace(0.0, 20.0, len(time))) * np.sin(phases) + 0.3 * np.sin(0.9 * time)
    v, a = np.gradient(q, period), np.gradient(np.gradient(q, period), period)
    way = np.tanh(v / 0.02)
    top = float(np.max(np.abs(v)))
    torque = 1.5e-3 * a + 2e-3 * v + way * (0.1 + pressed * np.abs(1.5e-3 * a) + bent * 0.1 * (v / top) ** 2)
    torque += np.random.default_rng(5).normal(0.0, 1e-3, len(q))
    columns = {"time": time, "position": q, "torque": torque}
    return Recording.from_columns(columns, Metadata(sample_period=period), "screw")


@pytest.mark.parametrize(("pressed", "bent"), [(0.0, 0.0), (0.3, 0.0), (0.0, 1.0), (0.3, 1.0)])
def test_friction_under_load_and_one_that_bends_draw_the_torque_nowhere(pressed: float, bent: float) -> None:
    """It was moved by 4 ms, to where a delay stands for a part of what is missing; the torque is that of its row."""
    data = aligned(prepared_for([_accelerated(pressed, bent)]))
    assert data.shift / data.upsampling == pytest.approx(1.0, abs=0.3)


def _swinging_fast() -> Recording:
    """A motor under a sine of current, to and fro by four turns at 2 Hz, with a weight."""
    period, amplitude, turn = 1e-3, 12.0, 4.0 * np.pi
    time = period * np.arange(12_000)
    q, v = 0.4 * time + amplitude * np.sin(turn * time), 0.4 + amplitude * turn * np.cos(turn * time)
    a = -amplitude * turn**2 * np.sin(turn * time)
    torque = 2e-4 * a + 1e-4 * v + 0.08 * np.tanh(v / 2.0) + 0.08 * np.sin(q + 1.0)
    torque += np.random.default_rng(5).normal(0.0, 0.004, len(q))
    columns = {"time": time, "position": q, "torque": torque}
    return Recording.from_columns(columns, Metadata(sample_period=period), "swing")


def test_a_weight_is_no_filtered_position() -> None:
    """A filter of 16 ms takes away what it does at 24 turns a second: what that left was named another effect."""
    assert low_passed(prepared_for([_swinging_fast()])) is None


def test_a_filtered_position_is_told_beside_a_weight() -> None:
    swing = _swinging_fast()
    share = 1.0 - np.exp(-1.0 / 16.0)
    seen = scipy.signal.lfilter([share], [1.0, share - 1.0], swing["position"])
    columns = {**swing.floats, "position": seen}
    data = prepared_for([replace(swing, floats=MappingProxyType(columns))])
    assert low_passed(data) == ("position", pytest.approx(0.016))
