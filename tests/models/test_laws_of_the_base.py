"""Laws of the base in every form of the model: damping in presliding that fades, curves by which friction falls or
the contact bends, friction without a static part."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.control.model_feedforward import ModelFeedforward, beyond_lugre, torque_along
from autotune.core.errors import ConfigurationError
from autotune.models import layout
from autotune.models.drive_model import BRISTLES_CURVE, DriveModel, base_model
from autotune.models.inverse import required, required_in_lanes
from autotune.models.lanes import WIDTH, filled
from autotune.models.lugre import (
    bends,
    bent_on,
    bristle_step,
    crept,
    faded_part,
    fallen,
    falling_level,
    level,
)
from autotune.models.model_file import model_text, read_model, write_model
from autotune.models.plant import simulate, simulate_in_lanes, substeps_for
from autotune.models.stribeck import STRIBECK
from autotune.models.table import EFFECTS
from tests.models.test_effects import NUMBERS, VALUES

PERIOD, ROWS = 1e-3, 400
TIME = PERIOD * np.arange(ROWS)
POSITION = 0.02 * np.sin(2.0 * math.pi * 7.0 * TIME) + 0.01 * np.sin(2.0 * math.pi * 23.0 * TIME)
GAINS = np.array([8.0, 0.05, 20.0, 0.5])
speeds = st.floats(1e-4, 10.0)


ELASTIC = (1.0, 1.0, 0.9, 0.4)


def fading(
    velocity: float = 0.1, tail: float = 0.0, memory: bool = False, curve: tuple[float, ...] = ()
) -> DriveModel:
    model = base_model({**NUMBERS, "damping_velocity": velocity, "damping_tail": tail})
    model = model.with_curve(curve) if curve else model
    return model.with_effect(EFFECTS["reversal_memory"].make(VALUES["reversal_memory"])) if memory else model


def creeping(velocity: float = 0.1, tail: float = 0.0, curve: tuple[float, ...] = ()) -> DriveModel:
    """A model whose contact has no static friction."""
    return fading(curve=curve).with_creep(velocity, tail)


@given(v=st.floats(-100.0, 100.0), at=speeds, tail=st.floats(0.0, 2.0), more=st.floats(1.0, 10.0))
def test_damping_is_whole_at_rest_and_falls_with_speed_alike_in_both_directions(v, at, tail, more) -> None:
    part = faded_part(v, at, tail)
    assert faded_part(0.0, at, tail) == 1.0
    assert 0.0 <= faded_part(more * v, at, tail) <= part <= 1.0
    assert faded_part(-v, at, tail) == part
    assert faded_part(v, 0.0, tail) == 1.0


@given(v=st.floats(0.0, 100.0), at=speeds)
def test_the_tail_leads_from_the_exponential_to_the_rational_law(v, at) -> None:
    ratio = (v / at) ** 2
    assert faded_part(v, at, 0.0) == pytest.approx(math.exp(-ratio), abs=1e-12)
    assert faded_part(v, at, 1.0) == pytest.approx(1.0 / (1.0 + ratio), rel=1e-9)
    assert faded_part(v, at, 1e-6) == pytest.approx(math.exp(-ratio), abs=1e-5)


@pytest.mark.parametrize(
    ("shape", "exponent", "tail"),
    [("exponential", 1.0, 0.0), ("gaussian", 2.0, 0.0), ("lorentzian", 2.0, 1.0)],
)
def test_all_curves_of_table_21_are_one(shape, exponent, tail) -> None:
    velocity = np.linspace(-2.0, 2.0, 81)
    found = [falling_level(v, 0.3, 0.4, 0.2, exponent, tail) for v in velocity]
    np.testing.assert_allclose(found, level(shape, velocity, 0.3, 0.4, 0.2), rtol=1e-12)
    assert fallen(0.2, 0.2, 1.0, 1.0) == pytest.approx(0.5)  # the hyperbola


@given(start=st.floats(-1.0, 1.0), way=st.floats(0.0, 0.05), back=st.floats(-1.0, 1.0))
def test_a_bristles_own_curve_is_the_exponential(start, way, back) -> None:
    assert bends(back, *BRISTLES_CURVE) == pytest.approx(1.0 - back, abs=1e-12)
    assert bent_on(start, way, *BRISTLES_CURVE) == pytest.approx(bristle_step(start, 1.0, 1.0, way), abs=1e-6)


@given(start=st.floats(-1.5, 1.5), way=st.floats(0.0, 100.0), curve=st.tuples(*[st.floats(0.02, 3.0)] * 4))
def test_a_contact_with_any_curve_comes_to_its_level_and_not_beyond(start, way, curve) -> None:
    after = bent_on(start, way, *curve)
    assert start - 1e-12 <= after <= 1.0 + 1e-12 if start <= 1.0 else 1.0 - 1e-12 <= after <= start + 1e-12
    assert bent_on(start, 1e6, *curve) == pytest.approx(1.0)
    assert bends(0.0, *curve) == 1.0


@given(v=st.floats(-100.0, 100.0), at=speeds, tail=st.floats(0.0, 3.0), more=st.floats(1.0, 10.0))
def test_friction_without_a_static_part_grows_with_speed_to_its_level(v, at, tail, more) -> None:
    part = crept(v, at, tail)
    assert 0.0 < part <= crept(more * v, at, tail) * (1.0 + 1e-9) <= 1.0 + 1e-9
    assert crept(-v, at, tail) == part
    assert crept(0.0, at, tail) < 1e-5
    assert crept(1e9 * at, at, tail) == pytest.approx(1.0, abs=1e-5)


@given(ratio=st.floats(1e-3, 100.0))
def test_its_tail_leads_from_tanh_to_slower_curves(ratio) -> None:
    assert crept(ratio, 1.0, 0.0) == pytest.approx(math.tanh(ratio), rel=1e-9)
    assert crept(ratio, 1.0, 1e-4) == pytest.approx(math.tanh(ratio), abs=1e-4)
    assert crept(ratio, 1.0, 1.0) == pytest.approx(ratio / math.sqrt(1.0 + ratio**2), rel=1e-9)


def _pace(model: DriveModel, torque: float) -> float:
    """Speed at which a torque that is held moves the model in the end."""
    packed, held = model.pack(), np.full(3 * ROWS, torque)
    still, (position, acted) = np.zeros(len(held)), np.empty((2, len(held)))
    loop, steps = np.array([PERIOD, 10.0, *[0.0] * 5]), 4 * substeps_for(packed.p, PERIOD, packed.on)
    state = np.zeros(layout.STATES)
    simulate(
        packed.p, packed.on, state, GAINS, loop, False, steps, held, still, still, still, position, acted
    )
    return float(position[-1] - position[-ROWS]) / ((ROWS - 1) * PERIOD)


def test_an_axis_without_static_friction_creeps_under_any_torque() -> None:
    """At the speed at which friction is that torque; an axis with static friction stays."""
    torque, numbers = 0.4 * NUMBERS["coulomb"], {**NUMBERS, "offset": 0.0, "viscous": 0.0}
    pace = _pace(base_model(numbers).with_creep(0.05, 0.0), torque)
    assert pace == pytest.approx(0.05 * math.atanh(0.4), rel=0.02)
    assert abs(_pace(base_model(numbers), torque)) < 0.01 * pace


def _moved(model: DriveModel) -> tuple[np.ndarray, np.ndarray]:
    """Position and torque of the model in closed loop."""
    packed, still = model.pack(), np.zeros(ROWS)
    position, torque = np.empty((2, ROWS))
    loop = np.array([PERIOD, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    steps = 4 * substeps_for(packed.p, PERIOD, packed.on)
    done = simulate(
        packed.p, packed.on, np.zeros(layout.STATES), GAINS, loop, True, steps, POSITION, still, still, still, position,
        torque,
    )  # fmt: skip
    assert done == ROWS
    return position, torque


def _needed(model: DriveModel, position: np.ndarray) -> np.ndarray:
    velocity = np.gradient(position, PERIOD)
    acceleration = np.zeros(ROWS)
    acceleration[1:-1] = np.diff(position, 2) / PERIOD**2
    return model.torque(position, velocity, acceleration, PERIOD)


@pytest.mark.parametrize("tail", [0.0, 1.0])
@pytest.mark.parametrize(("memory", "curve"), [(False, ()), (True, ()), (False, ELASTIC)])
def test_the_inverse_gives_back_the_torque(memory: bool, curve: tuple[float, ...], tail: float) -> None:
    model = fading(tail=tail, memory=memory, curve=curve)
    position, torque = _moved(model)
    acted = 0.5 * (torque + np.roll(torque, 1))
    rows = slice(20, -5)
    right = np.std((_needed(model, position) - acted)[rows])
    plain = fading(velocity=0.0, memory=memory, curve=curve)
    assert np.std((_needed(plain, position) - acted)[rows]) > 3.0 * right


@pytest.mark.parametrize("tail", [0.0, 1.0])
def test_the_inverse_gives_back_that_of_a_film(tail: float) -> None:
    position, torque = _moved(creeping(tail=tail))
    acted = 0.5 * (torque + np.roll(torque, 1))
    rows = slice(20, -5)
    right = np.std((_needed(creeping(tail=tail), position) - acted)[rows])
    assert np.std((_needed(fading(), position) - acted)[rows]) > 3.0 * right


@pytest.mark.parametrize("memory", [False, True])
def test_eight_models_in_one_pass_are_each_as_alone(memory: bool) -> None:
    """With and without fading, by both laws; with and without a curve of its own, and static friction."""
    curves = [(), ELASTIC, BRISTLES_CURVE]
    bare = [fading(0.05 * lane, 0.5 * (lane % 3), memory, curves[lane % 3]) for lane in range(WIDTH)]
    models = [one.with_creep(0.1 * (lane % 2), 0.5 * (lane % 4)).pack() for lane, one in enumerate(bare)]
    velocity = np.gradient(POSITION, PERIOD)
    motion = POSITION, velocity, np.gradient(velocity, PERIOD)
    found, still = np.empty((ROWS, WIDTH)), np.zeros(ROWS)
    table, on = filled([one.p for one in models]), models[0].on
    required_in_lanes(
        table, on, np.zeros((layout.STATES, WIDTH)), *(part[None] for part in motion), PERIOD, 1, found
    )
    position, torque = np.empty((2, WIDTH, ROWS))
    loop = np.array([PERIOD, 3.0, 1e-4, 0.0, 0.0, 0.0, 0.0])
    steps = max(substeps_for(one.p, PERIOD, one.on) for one in models)
    done = simulate_in_lanes(
        table, on, np.zeros((layout.STATES, WIDTH)), GAINS, filled([loop.copy() for _ in models]), True, steps,
        POSITION[None], *[still[None]] * 3, position, torque,
    )  # fmt: skip
    assert done == ROWS
    for lane, one in enumerate(models):
        alone, moved, asked = np.empty((3, ROWS))
        required(one.p, on, np.zeros(layout.STATES), *motion, PERIOD, 1, alone)
        np.testing.assert_allclose(found[:, lane], alone, rtol=0.0, atol=1e-10)
        simulate(
            one.p, on, np.zeros(layout.STATES), GAINS, loop.copy(), True, steps, POSITION, still, still, still, moved,
            asked,
        )  # fmt: skip
        np.testing.assert_allclose(position[lane], moved, rtol=0.0, atol=1e-10)


def test_a_model_file_holds_it_only_where_the_model_has_it(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    models = (
        fading(0.1, 0.7),
        base_model(NUMBERS, motion_unit="m"),
        fading(memory=True),
        fading(curve=ELASTIC),
        creeping(0.1, 0.7),
    )
    for model in models:
        write_model(model, path)
        assert read_model(path) == model
    assert "damping_velocity" not in model_text(base_model(NUMBERS))
    assert fading().unit("damping_velocity") == "rad/s"
    assert fading(0.1).with_fading(0.0, 0.0) == base_model(NUMBERS)
    assert base_model(NUMBERS).with_fading(0.1, 0.7) == fading(0.1, 0.7)
    assert fading(curve=ELASTIC).with_curve((0.0,) * 4) == fading()
    assert creeping().with_creep(0.0, 0.0) == fading()
    with pytest.raises(ConfigurationError, match="damping_velocity"):
        fading(-0.1)


def test_a_feedforward_plays_it_and_says_that_the_plain_one_does_not() -> None:
    model, law = fading(), ModelFeedforward(fading(), PERIOD)
    velocity = np.gradient(POSITION, PERIOD)
    acceleration = np.gradient(velocity, PERIOD)
    law.prepare()
    stepped = np.array([law.step(*row, None) for row in zip(POSITION, velocity, acceleration, strict=True)])
    along = torque_along(model, POSITION, velocity, acceleration, PERIOD)
    plain = torque_along(base_model(NUMBERS), POSITION, velocity, acceleration, PERIOD)
    assert np.std(stepped - along) < 0.3 * np.std(stepped - plain)
    assert beyond_lugre(model) == ("damping_velocity",)
    assert beyond_lugre(base_model(NUMBERS)) == ()
    assert beyond_lugre(fading(curve=ELASTIC)) == ("damping_velocity", "bends_back")
    assert beyond_lugre(base_model(NUMBERS).with_creep(0.1, 0.0)) == ("creep_velocity",)


@pytest.mark.parametrize(
    ("break_away", "speed", "viscous", "falls"),
    [(0.4, 0.3, 4e-3, True), (0.4, 6.0, 4e-3, True), (0.4, 6.0, 0.03, False), (0.3, 0.3, 4e-3, False)],
)
def test_a_fall_that_viscous_friction_makes_up_everywhere_is_none(
    break_away: float, speed: float, viscous: float, falls: bool
) -> None:
    model = base_model(
        {**NUMBERS, "coulomb": 0.3, "viscous": viscous, "break_away": break_away, "stribeck_velocity": speed}
    )
    assert STRIBECK.own_course is not None
    assert STRIBECK.own_course(SimpleNamespace(p=model.pack().p, speed=15.0)) is falls
