"""Gravity, a spring and waves over position beside a model that does not hold them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import autotune
from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.diagnosis.fit_recordings import fit_recordings
from autotune.diagnosis.fit_result import FitResult
from autotune.diagnosis.verdict import diagnose
from autotune.estimation.problem import one_way
from autotune.identify.steady_state import fit_speed_curve
from autotune.recordings.recording import Metadata, Recording
from autotune.recordings.speed_points import speed_points
from tests.support.arm import COULOMB, INERTIA, OFFSET, arm


def behind(gear: float, load: Recording) -> Recording:
    """The same as a motor sees it."""
    columns = {name: load[name] for name in ("time", "torque")} | {"position": gear * load["position"]}
    return Recording.from_columns(columns, load.metadata, "moves")


def said(result: FitResult) -> str:
    return " ".join(result.notes)


def test_an_arm_under_gravity_has_the_inertia_that_it_has() -> None:
    """Two thirds of the torque is gravity's; without the sine beside it inertia came out at several times its value."""
    found = fit_recordings([arm(gravity=8.0)])
    assert found.valid, found.reason
    assert found.model is not None
    assert found.model["inertia"] == pytest.approx(INERTIA, rel=0.03)
    assert found.model["coulomb"] == pytest.approx(COULOMB, rel=0.02)
    assert found.model["offset"] == pytest.approx(OFFSET, abs=0.1)
    assert "The offset holds" not in said(found)
    assert not found.model.effects
    assert "as gravity makes it, of 8" in said(found)
    assert "--effects gravity_imbalance" in said(found)


def test_what_bends_over_a_small_part_of_a_turn_is_no_gravity_that_an_offset_balances() -> None:
    """Over 0.16 rad sine, cosine and offset are one another: it was 800 N m, and the model wrong by 375 times."""
    found = fit_recordings([arm(narrow=0.07, curved=400.0)])
    assert found.valid, found.reason
    assert found.model is not None
    assert found.model["coulomb"] == pytest.approx(COULOMB, rel=0.05)
    assert 0.0 < found.model["offset"] - OFFSET < 400.0 * 0.08**2  # the parabola's mean
    assert "as gravity makes it" not in said(found)


@pytest.mark.parametrize(
    ("gear", "spring", "curved"),
    [
        pytest.param(1.0, 3.0, 4.0, id="one sine a turn, and an offset of 10 N m"),
        pytest.param(100.0, 1.0, 0.4, id="a load that turns a hundredth"),
        pytest.param(100.0, 1.0, 0.05, id="an order at the end of what is searched"),
    ],
)
def test_a_spring_that_is_not_straight_is_no_sine_that_an_offset_balances(
    gear: float, spring: float, curved: float
) -> None:
    """Sine and offset were each as large as the other made them, and the offset stayed in a model without the sine."""
    recording = arm(spring=spring, curved=curved)
    found = fit_recordings([behind(gear, recording)])
    assert found.valid, found.reason
    assert found.model is not None
    place = recording["position"]
    mean = OFFSET + float(np.mean(spring * place + curved * (place - 0.4) ** 2))
    offset = found.estimate["offset"]
    assert offset.value == pytest.approx(mean, abs=0.02)
    assert 0.0 < offset.standard_error < 0.02
    assert found.model["coulomb"] == pytest.approx(COULOMB, rel=0.02)
    assert found.relative_error < 0.5
    assert "The offset holds the mean over this travel" in said(found)


def test_an_offset_beside_gravity_over_a_small_part_of_a_turn_is_as_sure_as_its_order() -> None:
    """It was 10.2 ± 0.1 N m where a spring is taken for gravity: in the model it balances the sine."""
    found = fit_recordings([arm(spring=3.0, curved=4.0)], effects=["gravity_imbalance"])
    assert found.model is not None
    assert found.relative_error < 0.2
    offset = found.estimate["offset"]
    assert abs(offset.value - OFFSET) < 2.0 * offset.standard_error
    assert offset.standard_error < 50.0
    assert "known together with gravity's sine only" in said(found)
    assert "The offset holds" not in said(found)


def test_gravity_that_is_asked_for_is_in_the_model() -> None:
    found = fit_recordings([arm(gravity=8.0)], effects=["gravity_imbalance"])
    assert found.model is not None
    size = math.hypot(found.model["gravity_imbalance.sin"], found.model["gravity_imbalance.cos"])
    assert size == pytest.approx(8.0, rel=0.02)
    assert found.relative_error < 0.03
    assert "beside the model" not in said(found)


@pytest.mark.parametrize(("far", "within"), [(1.0, 0.15), (4.0, 0.03)])
def test_gravity_of_a_load_behind_a_gear_has_its_own_order(far: float, within: float) -> None:
    """It was told as a spring and eight waves, as cogging makes them, and the offset was ten times too large."""
    gear = 20.0
    recording = behind(gear, arm(gravity=8.0, narrow=far))
    found = fit_recordings([recording])
    assert "as gravity makes it" in said(found)
    assert "a load that turns 0.05" in said(found)
    assert "as cogging makes them" not in said(found)
    taken_in = fit_recordings([recording], effects=["gravity_imbalance"]).model
    assert taken_in is not None
    assert taken_in["gravity_imbalance.order"] == pytest.approx(1.0 / gear, rel=0.03)
    assert taken_in["inertia"] == pytest.approx(INERTIA / gear, rel=within)
    assert taken_in["coulomb"] == pytest.approx(COULOMB, rel=within)


@pytest.mark.parametrize(("narrow", "alike"), [(0.3, True), (1.0, False), (3.0, False)])
def test_a_spring_is_like_gravity_only_where_that_leaves_as_little(narrow: float, alike: bool) -> None:
    """Over 0.7 rad a sine bends as little as noise tells; over two and seven it leaves many times as much."""
    found = fit_recordings([arm(spring=8.0, narrow=narrow)])
    assert "as a spring makes it, of 8" in said(found)
    assert ("gravity and a spring look alike" in said(found)) is alike


def test_gravity_over_a_turn_is_no_effect_of_an_axis_that_slides() -> None:
    """Over a quarter of a metre it was a wave like the offset, and the fit was four times as bad as without."""
    turning = arm(spring=5.0)
    sliding = replace(turning, metadata=replace(turning.metadata, motion_unit="m"))
    model = fit_recordings([sliding], effects=["spring"]).model
    assert model is not None
    assert model["spring.stiffness"] == pytest.approx(5.0, rel=0.05)
    with pytest.raises(NotEnoughExcitation, match=r"axes that turn, and this one moves in m\."):
        fit_recordings([sliding], effects=["gravity_imbalance"])
    with pytest.raises(NotEnoughExcitation, match="axes that turn"):
        autotune.add_effect("gravity_imbalance", sliding, model=model)


def test_a_joint_without_gravity_has_nothing_beside_its_model() -> None:
    found = fit_recordings([arm()])
    assert found.model is not None
    assert found.model["inertia"] == pytest.approx(INERTIA, rel=0.03)
    assert "beside the model" not in said(found)


@pytest.mark.parametrize("gravity", [0.0, 8.0])
def test_a_wrong_sign_is_found_under_gravity_too(gravity: float) -> None:
    with pytest.raises(RecordingError, match="wrong sign"):
        fit_recordings([arm(gravity, sign=-1.0)])


def test_an_inertia_that_comes_out_right_has_no_wrong_sign() -> None:
    """An oscillator with next to no friction was told that its torque counts the other way."""
    with pytest.raises(NotEnoughExcitation, match="Coulomb friction comes out as -0"):
        fit_recordings([arm(spring=5.0, coulomb=-0.2)])


@pytest.mark.parametrize("period", [4e-3, 1e-2])
def test_gravity_in_slow_samples_is_found_alone(period: float) -> None:
    """A bristle held at what the fit without gravity had made of it brought memory beside it."""
    recording = arm(gravity=2.0, period=period)
    fitted = fit_recordings([recording])
    assert fitted.model is not None
    assert diagnose([recording], fitted.model).effects == ("gravity_imbalance",)


@pytest.mark.long
def test_a_spring_is_no_bristle_as_long_as_the_way() -> None:
    """At constant speeds it was, with Coulomb friction eight times too large, and was named an elastic transmission."""
    played = autotune.simulate("sim://lugre?seed=3&effect=spring:0.01", programme="high-speed")
    recording = played.with_metadata(axis="", fingerprint="")
    fitted = autotune.fit([recording])
    assert fitted.model is not None
    assert fitted.model["coulomb"] < 0.4
    assert "--effects spring" in said(fitted)
    assert autotune.diagnose([recording], fitted.model).effects == ("spring",)


def test_a_motor_that_rolls_over_its_cogging_is_not_refused() -> None:
    """At one constant speed friction explains none of the torque's changes: the waves do, and are said."""
    time = np.arange(15_000) * 1e-3
    position = 2.0 * time + 1e-4 * np.random.default_rng(1).normal(size=len(time))
    torque = 0.1 + sum(
        size * np.sin(order * 2.0 * time) for order, size in ((12, 0.03), (36, 0.05), (72, 0.2))
    )
    torque = torque + 0.005 * np.random.default_rng(2).normal(size=len(time))
    found = autotune.fit(
        [
            Recording.from_columns(
                {"time": time, "position": position, "torque": torque}, Metadata(), "rolling"
            )
        ]
    )
    assert not found.valid
    assert "waves over position, as cogging makes them" in said(found)
    assert "orders 12" in said(found)
    assert "model add torque_ripple" in said(found)


def test_what_a_spring_holds_where_the_axis_moves_is_an_offset_of_a_model_without_it() -> None:
    """About half a turn an inverted pendulum is a spring that pushes, from a place where the axis never was: the model
    without it was wrong by ten times the torque.
    """
    time = np.arange(0.0, 20.0, 2e-3)
    q = np.pi + 0.2 * np.sin(0.8 * time) + 0.15 * np.sin(2.1 * time + 1.0) + 0.05 * np.sin(5.0 * time)
    v, a = np.gradient(q, time), np.gradient(np.gradient(q, time), time)
    torque = 0.015 * a + 4e-3 * v + 0.02 * np.tanh(v / 5e-3) + 0.15 * np.sin(q)
    torque += np.random.default_rng(1).normal(0.0, 1e-3, len(q))
    columns = {"time": time, "position": q, "torque": torque}
    found = fit_recordings([Recording.from_columns(columns, Metadata(sample_period=2e-3), "inverted")])
    assert "spring" in said(found)
    assert found.model is not None
    assert abs(found.model["offset"]) < 0.02
    assert found.relative_error < 1.2


def test_motion_one_way_is_one_way_for_the_guess_and_for_the_search() -> None:
    """With 4 % of the travel back the guess left both numbers to a search that fitted both, and knew neither."""
    speed = np.concatenate([np.full(960, 1.0), np.full(40, -1.0)])
    assert one_way(speed)
    assert not one_way(np.concatenate([speed, np.full(40, -1.0)]))
    period = 1e-3
    position = np.cumsum(5.0 + 6.2 * np.sin(40.0 * period * np.arange(8000))) * period
    velocity = np.gradient(position, period)
    assert 0.03 < -velocity[velocity < 0].sum() / np.abs(velocity).sum() < 0.05
    torque = 0.1 * np.sign(velocity) + 2e-4 * np.gradient(velocity, period)
    torque += 1e-3 * np.random.default_rng(1).normal(size=len(torque))
    columns = {"time": period * np.arange(8000), "position": position, "torque": torque}
    found = fit_recordings([Recording.from_columns(columns, Metadata(), "rolling")])
    assert found.valid
    assert found.model is not None
    assert found.model["offset"] == 0.0


def test_a_speed_curve_is_of_what_is_fitted() -> None:
    """Three speeds of a veto, with 1 N m more, and one of conditioning tripled Coulomb friction."""
    time, rng = 0.01 * np.arange(400), np.random.default_rng(0)
    speeds = [side * speed for speed in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0) for side in (1.0, -1.0)]
    named = [(speed, f"speed {number}", 0.0) for number, speed in enumerate(speeds)]
    named += [(speed, "veto", 1.0) for speed in (0.7, 3.0, 10.0)] + [(5.0, "conditioning", 1.0)]
    columns = {
        "time": np.tile(time, len(named)),
        "position": np.concatenate([speed * time for speed, _, _ in named]),
        "torque": np.concatenate(
            [
                0.1 * np.sign(speed) + 0.01 * speed + more + 1e-4 * rng.standard_normal(400)
                for speed, _, more in named
            ]
        ),
    }
    names = np.repeat([name for _, name, _ in named], 400)
    repeats = np.repeat(
        [sum(one[1] == name for one in named[:i]) for i, (_, name, _) in enumerate(named)], 400
    )
    recording = Recording.from_columns(columns, Metadata(sample_period=0.01), names, repeats)
    found = fit_speed_curve(recording, ())
    assert found.model["coulomb"] == pytest.approx(0.1, rel=0.01)
    assert found.model["viscous"] == pytest.approx(0.01, rel=0.01)
    assert len(speed_points([recording])) == len(speeds)
