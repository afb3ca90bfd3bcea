"""Reduction: what is held where, the loss predicted as it is then measured on the simulated axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.control.closed_loop import steady_error
from autotune.control.feedforward import FixedFeedforward, LugreParameters
from autotune.control.reduction import (
    LUGRE,
    Remainder,
    direction,
    drive_torque,
    level_for_block,
    reduce,
    reduces,
    rises,
    with_one_level,
)
from autotune.control.refinement import PeriodAverage, error_response, periodic_feedforward
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.core.loop import LocalLoop
from autotune.experiments.path import Motion
from autotune.experiments.record import Recorder, metadata_for, play
from autotune.experiments.runner import Programme
from autotune.experiments.sines import BenchmarkSine
from autotune.recordings.recording import Controller
from autotune_sim.inprocess import SimDrive
from autotune_sim.plant import Bristle
from autotune_sim.presets import Preset, preset
from tests.drivers.simulator import axis_of

AXIS = axis_of()
KINETIC = ("enabled", "inertia", "viscous", "coulomb", "offset")
PROVED = LugreParameters(3.0e-4, 1.1e-3, 0.233, 35.7, 0.136, 0.0477, 0.275, 1.0)
"""What adaptation and refinement come to on `edm-vertical`."""
REFERENCE = np.asarray(0.2 * np.sin(2 * np.pi * np.arange(1000) / 1000))

STIFF = Controller(60.0, 0.15, 6000.0, 1.0)


class Kinetic:
    """The reduced feedforward played from outside, as a drive with a kinetic block would."""

    settled = False

    def __init__(self, values: dict[str, float]) -> None:
        self._values, self._sign = values, 0.0

    def prepare(self) -> None:
        return

    def step(self, reference: float, velocity: float, acceleration: float, previous: object) -> float:
        self._sign = self._sign if velocity == 0.0 else float(np.sign(velocity))
        v = self._values
        friction = v["viscous"] * velocity + v["coulomb"] * self._sign
        return v["inertia"] * acceleration + friction + v["offset"]


def measured(
    law: object, seed: int, axis: Preset | None = None, parameters: dict[str, float] | None = None
) -> tuple[PeriodAverage, Controller]:
    """The benchmark on the simulated axis, averaged over six periods; `parameters` are written before."""
    drive = SimDrive(axis or preset("edm-vertical", seed=seed), seed)
    drive.write_parameters(parameters or {})
    held = drive.read_parameters()
    gains = (held[f"controller.{name}"] for name in ("kp", "kd", "ki", "derivative_filter"))
    controller = Controller(*gains)
    sine = BenchmarkSine(Motion.of(AXIS), 1, 6, law, label="window")  # type: ignore[arg-type]
    programme = Programme((sine,), AXIS.limits, 200.0)
    recorder = Recorder(metadata_for(AXIS, controller), programme.labels)
    loop = LocalLoop(drive)
    play(loop, programme, recorder)
    loop.close()
    window = recorder.recording().select("window")
    mean = {
        name: window[name].reshape(6, -1).mean(axis=0)
        for name in ("reference", "position", "torque_feedback", "torque_feedforward")
    }
    error = mean["reference"] - mean["position"]
    average = PeriodAverage(
        mean["reference"], error, mean["torque_feedback"], mean["torque_feedforward"], 1e-3, 6
    )
    return average, controller


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_predicted_and_measured_loss_of_the_kinetic_model_agree_within_a_quarter(seed: int) -> None:
    full, controller = measured(FixedFeedforward(PROVED, 1e-3), seed)
    found = reduce(PROVED, KINETIC, full, controller, AXIS.limits.torque)
    reduced, _ = measured(Kinetic(dict(found.values)), seed)
    loss = reduced.peak_error - full.peak_error
    assert loss > 0.5e-3  # there is something to predict
    assert found.predicted_loss == pytest.approx(loss, rel=0.25)
    assert found.predicted_rms == pytest.approx(float(np.sqrt(np.mean(reduced.error**2))), rel=0.15)
    assert not found.host


@pytest.mark.slow
def test_the_reduced_feedforward_is_better_than_none_and_than_the_full_coulomb_torque() -> None:
    full, controller = measured(FixedFeedforward(PROVED, 1e-3), 0)
    found = reduce(PROVED, KINETIC, full, controller, AXIS.limits.torque)
    reduced, _ = measured(Kinetic(dict(found.values)), 0)
    nothing, _ = measured(None, 0)
    naive, _ = measured(Kinetic({**found.values, "coulomb": PROVED.coulomb}), 0)
    assert reduced.peak_error < 0.9 * nothing.peak_error < naive.peak_error
    assert 0.1 * PROVED.coulomb < found.values["coulomb"] < 0.8 * PROVED.coulomb
    assert found.values["inertia"] == PROVED.inertia


def tracked(controller: Controller = STIFF) -> tuple[PeriodAverage, Controller]:
    applied = periodic_feedforward(PROVED, REFERENCE, 1e-3)
    return PeriodAverage(REFERENCE, np.zeros(1000), np.zeros(1000), applied, 1e-3, 6), controller


RISING = LugreParameters(6.66e-4, 4.13e-3, 0.36, 40.0, 0.05, 0.048, 0.2, 0.6)
"""F_s well below F_c, as a boundary lubricant makes it (section 2.2.2)."""


def rising_axis() -> Preset:
    axis = preset("lugre")
    bristle = Bristle(RISING.coulomb, RISING.break_away, RISING.stribeck_velocity, RISING.stiffness, 0.05)
    return replace(axis, plant=replace(axis.plant, bristle=bristle))


def test_friction_that_rises_from_rest_is_played_and_not_dropped() -> None:
    """The same feedforward with F_s lifted to F_c leaves at least half as much error again."""
    played, _ = measured(FixedFeedforward(RISING, 1e-3), 0, rising_axis())
    dropped, _ = measured(FixedFeedforward(with_one_level(RISING), 1e-3), 0, rising_axis())
    assert played.peak_error < 0.67 * dropped.peak_error


def test_a_drive_s_block_cannot_rise_and_what_that_loses_is_told_as_it_is() -> None:
    """The level between F_s and F_c is better than the block's own F_c; the prediction holds within a quarter."""
    full, controller = measured(FixedFeedforward(RISING, 1e-3), 0, rising_axis())
    found = level_for_block(RISING, full, controller, AXIS.limits.torque)
    assert rises(RISING)
    assert found.lost == ("friction_that_rises_from_rest",)
    assert RISING.break_away <= found.values["coulomb"] == found.values["break_away"] <= RISING.coulomb
    block = with_one_level(RISING, found.values["coulomb"])
    written = block.drive_parameters() | {"feedforward.enabled": 1.0}
    alone, _ = measured(None, 0, rising_axis(), written)
    naive = RISING.drive_parameters() | {"feedforward.enabled": 1.0}
    as_it_was, _ = measured(None, 0, rising_axis(), naive)
    assert alone.smooth_peak < 0.9 * as_it_was.smooth_peak
    assert found.predicted_peak == pytest.approx(alone.peak_error, rel=0.25)


def test_a_drive_that_holds_part_of_the_block_is_predicted_with_the_level_that_it_plays() -> None:
    torque = periodic_feedforward(RISING, REFERENCE, 1e-3)
    periods = PeriodAverage(REFERENCE, np.zeros(1000), np.zeros(1000), torque, 1e-3, 6)
    found = reduce(RISING, LUGRE - {"inertia"}, periods, STIFF)
    assert found.values["break_away"] == RISING.coulomb
    assert found.lost


def test_a_drive_without_coulomb_friction_leaves_it_to_the_host() -> None:
    found = reduce(PROVED, ("inertia", "viscous"), *tracked())
    assert found.host == ("coulomb",)  # the constant is the integrator's
    assert dict(found.values) == {"inertia": PROVED.inertia, "viscous": PROVED.viscous}
    proportional = reduce(PROVED, ("inertia", "viscous"), *tracked(Controller(60.0, 0.15, 0.0, 1.0)))
    assert proportional.host == ("coulomb", "offset")


def test_a_spring_rate_of_friction_needs_neither_host_nor_reduction() -> None:
    found = reduce(PROVED, ("stiffness", "coulomb", "viscous"), *tracked())
    assert not found.host
    assert found.values["coulomb"] == PROVED.coulomb
    assert 0.0 < found.predicted_loss < 1e-3


def test_who_holds_all_is_not_reduced_and_who_holds_nothing_cannot_be() -> None:
    assert not reduces({*LUGRE, "enabled"})
    assert reduces(KINETIC)
    with pytest.raises(ConfigurationError, match="no part"):
        reduce(PROVED, ("enabled",), *tracked())


@pytest.mark.parametrize(
    "held", [("inertia", "viscous"), ("coulomb", "viscous"), ("stiffness", "coulomb", "viscous")]
)
def test_host_and_drive_together_play_the_full_feedforward(held: tuple[str, ...]) -> None:
    values = {name: float(getattr(PROVED, name)) for name in held}
    law = Remainder(FixedFeedforward(PROVED, 1e-3), values, 1e-3)
    law.prepare()
    ahead, behind = np.roll(REFERENCE, -1), np.roll(REFERENCE, 1)
    rows = zip(REFERENCE, (ahead - behind) / 2e-3, (ahead - 2 * REFERENCE + behind) / 1e-6, strict=True)
    rest = [tuple(map(float, row)) for row in rows]
    host = np.array([law.step(r, v, a, None) for r, v, a in (*rest, *rest)])[1000:]
    together = host + drive_torque(values, REFERENCE, 1e-3)
    assert together == pytest.approx(periodic_feedforward(PROVED, REFERENCE, 1e-3), abs=1e-6)


def test_the_closed_loop_agrees_with_the_linear_response_where_nothing_rubs() -> None:
    smooth = LugreParameters(3e-4, 0.0, 1e-9, 1e-3, 0.0, 0.0, 1e-9)
    controller = Controller(60.0, 0.15, 6000.0, 1.0)
    torque = 0.01 * np.cos(2 * np.pi * 5 * np.arange(1000) / 1000)
    exact = 3e-4 * (np.roll(REFERENCE, -1) - 2 * REFERENCE + np.roll(REFERENCE, 1)) / 1e-6
    difference = steady_error(smooth, controller, REFERENCE, exact + torque, 1e-3) - steady_error(
        smooth, controller, REFERENCE, exact, 1e-3
    )
    response = error_response(controller, 3e-4, 1000, 1e-3)
    linear = -np.fft.irfft(response * np.fft.rfft(torque), 1000)
    assert difference == pytest.approx(linear, abs=0.05 * float(np.abs(linear).max()))


def test_a_loop_that_is_not_stable_on_the_model_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="not stable"):
        steady_error(PROVED, Controller(60.0, 5.0, 6000.0, 1.0), REFERENCE, np.zeros(1000), 1e-3)
    with pytest.raises(ConfigurationError, match="inertia above 0"):
        steady_error(
            replace(PROVED, inertia=0.0), Controller(60.0, 0.1, 0.0, 1.0), REFERENCE, np.zeros(1000), 1e-3
        )


@settings(max_examples=100, deadline=None)
@given(st.lists(st.sampled_from([-1.0, 0.0, 0.5]), min_size=1, max_size=40))
def test_the_direction_at_rest_is_the_one_of_the_motion_before(values: list[float]) -> None:
    velocity: Floats = np.array(values)
    found = direction(velocity)
    assert np.array_equal(found[velocity != 0.0], np.sign(velocity[velocity != 0.0]))
    for index in np.flatnonzero(velocity == 0.0):
        if np.any(velocity):
            assert found[index] == found[index - 1]
