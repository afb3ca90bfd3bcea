"""Eight models in one pass: each as it is by itself, up to the rounding of another exponential function."""

import math

import numpy as np
import pytest

from autotune.models import layout
from autotune.models.compiled import compiled
from autotune.models.drive_model import Packed, base_model
from autotune.models.inverse import (
    applied_in_lanes,
    applied_torque,
    load_substeps,
    required,
    required_in_lanes,
)
from autotune.models.lanes import (
    LINE,
    WIDTH,
    along,
    anywhere,
    beside_or_one,
    filled,
    room_for,
    side_by_side,
    where,
    zeros_for,
)
from autotune.models.plant import seen_late, simulate, simulate_in_lanes, substeps_for
from autotune.models.table import EFFECTS
from tests.models.test_effects import NUMBERS, SHAPED, VALUES

PERIOD, ROWS = 1e-3, 300
ROUNDING = 1e-10
"""Of torque [N m] and position [rad], both about 1: rounding, carried through 300 samples."""
SHARED = "elements that share a level that falls"
TIME = PERIOD * np.arange(ROWS)
POSITION = 0.4 * np.sin(2.0 * math.pi * 4.0 * TIME) + 0.7 * TIME


def _models(effect: str) -> list[Packed]:
    """Eight with other numbers, every second one with the effect's own law where it has a shape of its own too."""
    random, models = np.random.default_rng(1), []
    for lane in range(WIDTH):
        numbers = {name: value * random.uniform(0.9, 1.1) for name, value in NUMBERS.items()}
        if effect == SHARED:
            elements = {**VALUES["reversal_memory"], "attraction": 40.0 if lane % 2 else 0.0}
            model = base_model(numbers).with_effect(EFFECTS["stribeck"].make(VALUES["stribeck"]))
            models.append(model.with_effect(EFFECTS["reversal_memory"].make(elements)).pack())
            continue
        values = SHAPED.get(effect, VALUES[effect]) if lane % 2 else VALUES[effect]
        models.append(base_model(numbers).with_effect(EFFECTS[effect].make(values)).pack())
    return models


@pytest.mark.parametrize("count", [1, 7, 526])
def test_eight_numbers_lie_in_one_line_of_the_cache(count: int) -> None:
    """Across two lines they take twice as long; where an array begins is otherwise chance."""
    for table in (room_for(count), zeros_for(count), filled([np.arange(float(count))] * WIDTH)):
        assert table.shape == (count, WIDTH)
        assert table.flags.c_contiguous
        assert table.ctypes.data % LINE == 0
    assert not zeros_for(count).any()


def test_what_is_one_for_all_lanes_is_as_if_each_had_it() -> None:
    models = _models("stribeck")
    p, on, steps = filled([one.p for one in models]), models[0].on, 1
    velocity = np.gradient(POSITION, PERIOD)
    motion = [part[None] for part in (POSITION, velocity, np.gradient(velocity, PERIOD))]
    found = []
    for parts in (motion, [np.repeat(part, WIDTH, axis=0) for part in motion]):
        found.append(room_for(ROWS))
        required_in_lanes(p, on, zeros_for(layout.STATES), *parts, PERIOD, steps, found[-1])
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("effect", [*EFFECTS, SHARED])
def test_the_torque_that_a_motion_needs_is_that_of_each_model(effect: str) -> None:
    models = _models(effect)
    velocity = np.gradient(POSITION, PERIOD)
    motion = POSITION, velocity, np.gradient(velocity, PERIOD)
    steps = max(load_substeps(one.p, one.on, PERIOD) for one in models)
    found = np.empty((ROWS, WIDTH))
    required_in_lanes(
        filled([one.p for one in models]), models[0].on, np.zeros((layout.STATES, WIDTH)),
        *(part[None] for part in motion), PERIOD, steps, found,
    )  # fmt: skip
    for lane, one in enumerate(models):
        alone = np.empty(ROWS)
        required(one.p, one.on, np.zeros(layout.STATES), *motion, PERIOD, steps, alone)
        np.testing.assert_allclose(found[:, lane], alone, rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize("effect", ["torque_lag", "torque_saturation"])
def test_the_torque_that_acts_is_that_of_each_model(effect: str) -> None:
    models, demand = _models(effect), 0.6 * np.sin(2.0 * math.pi * 9.0 * TIME)
    found = np.empty((ROWS, WIDTH))
    state = np.zeros((layout.STATES, WIDTH))
    applied_in_lanes(filled([one.p for one in models]), models[0].on, state, demand[None], PERIOD, found)
    for lane, one in enumerate(models):
        alone = np.empty(ROWS)
        applied_torque(one.p, one.on, np.zeros(layout.STATES), demand, PERIOD, alone)
        np.testing.assert_allclose(found[:, lane], alone, rtol=0.0, atol=ROUNDING)


def _loop(limit: float = 3.0) -> np.ndarray:
    return np.array([PERIOD, limit, 1e-4, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("effect", [*EFFECTS, SHARED])
def test_a_simulated_axis_moves_as_it_does_alone(effect: str) -> None:
    """In closed loop with a coarse encoder, each with a disturbance of its own."""
    models, gains = _models(effect), np.array([8.0, 0.05, 20.0, 0.5])
    steps = max(substeps_for(one.p, PERIOD, one.on) for one in models)
    shaken, still = 0.02 * np.random.default_rng(2).normal(size=(WIDTH, ROWS)), np.zeros(ROWS)
    position, torque = np.empty((2, WIDTH, ROWS))
    done = simulate_in_lanes(
        filled([one.p for one in models]), models[0].on, np.zeros((layout.STATES, WIDTH)), gains,
        filled([_loop()] * WIDTH), True, steps, POSITION[None], still[None], beside_or_one(shaken), still[None],
        position, torque,
    )  # fmt: skip
    assert done == ROWS
    for lane, one in enumerate(models):
        moved, asked = np.empty((2, ROWS))
        simulate(
            one.p, one.on, np.zeros(layout.STATES), gains, _loop(), True, steps, POSITION, still, shaken[lane], still,
            moved, asked,
        )  # fmt: skip
        np.testing.assert_allclose(position[lane], moved, rtol=0.0, atol=ROUNDING)
        np.testing.assert_allclose(torque[lane], asked, rtol=0.0, atol=1e3 * ROUNDING)


def test_where_one_axis_runs_away_all_of_them_stop() -> None:
    model, unstable = base_model(NUMBERS).pack(), np.array([8.0, -5.0, 0.0, 1.0])
    zero, shaken = np.zeros((1, ROWS)), np.zeros((ROWS, WIDTH))
    shaken[:, 3] = 1e12
    done = simulate_in_lanes(
        filled([model.p] * WIDTH), model.on, np.zeros((layout.STATES, WIDTH)), 0.0 * unstable,
        filled([_loop()] * WIDTH), False, 5, zero, zero, shaken, zero, *np.empty((2, WIDTH, ROWS)),
    )  # fmt: skip
    assert done < 3


@compiled
def _functions(given, result):
    for k in range(len(given)):
        x = given[k]
        result[k] = math.exp(x)
        if anywhere(x > 2.0):
            result[k] = where(x > 2.0, math.copysign(math.floor(x), -x), result[k])


@compiled
def _in_lanes(given, result):
    _functions(side_by_side(given), along(result))


def test_functions_and_choices_lane_by_lane() -> None:
    """The exponential of what is far below nothing is nothing; what is no number stays none."""
    random = np.random.default_rng(3)
    given = random.uniform(-40.0, 2.0, (200, WIDTH))
    given[0] = -np.inf, -1e5, -0.0, np.nan, 2.5, 700.0, -1e-300, -705.0
    result = np.empty((WIDTH, 200))
    _in_lanes(given, result)
    with np.errstate(all="ignore"):
        right = np.where(given > 2.0, -np.floor(given), np.exp(given))
    np.testing.assert_allclose(result.T, right, rtol=1e-15)


@compiled
def _powers(given, exponent, result):
    for k in range(len(given)):
        result[k] = given[k] ** exponent[k]


@compiled
def _powers_in_lanes(given, exponent, result):
    _powers(side_by_side(given), side_by_side(exponent), side_by_side(result))


@compiled
def _angles(given, sine, cosine):
    for k in range(len(given)):
        sine[k], cosine[k] = math.sin(given[k]), math.cos(given[k])


@compiled
def _angles_in_lanes(given, sine, cosine):
    _angles(side_by_side(given), side_by_side(sine), side_by_side(cosine))


@pytest.mark.parametrize("largest", [1.0, 1e3, 5e7])
def test_sine_and_cosine_are_those_of_the_library(largest: float) -> None:
    """To two last digits of 1; what is far beyond, or no number, is asked of the library itself."""
    given = np.random.default_rng(5).uniform(-largest, largest, (500, WIDTH))
    given[0] = 0.0, -0.0, math.pi, 1e12, -1e300, np.inf, np.nan, 0.5 * math.pi
    sine, cosine = np.empty((2, 500, WIDTH))
    _angles_in_lanes(given, sine, cosine)
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(sine, np.sin(given), rtol=0.0, atol=5e-16)
        np.testing.assert_allclose(cosine, np.cos(given), rtol=0.0, atol=5e-16)


def test_powers_are_those_of_the_library() -> None:
    """Of ratios up to a million and the exponents of effects; also of 0, of what is negative and of no number."""
    random = np.random.default_rng(6)
    given, exponent = (
        np.exp(random.uniform(-14.0, 14.0, (500, WIDTH))),
        random.uniform(-10.0, 10.0, (500, WIDTH)),
    )
    given[0] = 0.0, 0.0, 0.0, 1.0, -2.0, np.nan, np.inf, 1e-310
    exponent[0] = 2.5, -1.0, 0.0, 7.0, 3.0, 1.0, -2.0, 0.5
    found = np.empty((500, WIDTH))
    _powers_in_lanes(given, exponent, found)
    with np.errstate(divide="ignore"):
        right = given**exponent
    np.testing.assert_allclose(found, right, rtol=1e-13)


@pytest.mark.parametrize("late", [0.0, 0.4, 2.0, 3.7])
def test_ticks_of_a_loop_say_at_each_sample_what_a_twin_of_its_ticks_says(late: float) -> None:
    """A torque is told as the mean over a sample, or as at its beginning; readings that are late come from ticks."""
    model, ticks = base_model(NUMBERS).pack(), 4
    gains = np.array([8.0, 0.05, 20.0, 0.5, 1.0, late])
    loop = np.concatenate([_loop(), np.zeros(seen_late(late))])
    command, still = np.repeat(POSITION, ticks), np.zeros(ROWS * ticks)
    shaken = 0.02 * np.random.default_rng(4).normal(size=ROWS)
    every, asked = np.empty((2, ROWS * ticks))
    simulate(
        model.p, model.on, np.zeros(layout.STATES), gains, loop.copy(), True, 2, command, still,
        np.repeat(shaken, ticks), still, every, asked,
    )  # fmt: skip
    assert np.ptp(every) > 0.0
    if late > 0.0:  # without room for what is seen late nothing is simulated
        nothing = simulate(
            model.p, model.on, np.zeros(layout.STATES), gains, _loop(), True, 2, command, still, shaken, shaken,
            np.empty(ROWS), np.empty(ROWS),
        )  # fmt: skip
        assert nothing == 0
    for averaged in (True, False):
        position, torque = np.empty((2, WIDTH, ROWS))
        done = simulate_in_lanes(
            filled([model.p] * WIDTH), model.on, np.zeros((layout.STATES, WIDTH)), gains, filled([loop] * WIDTH),
            True, 2, command[None], still[None], shaken[None], np.zeros((1, ROWS)), position, torque, averaged,
        )  # fmt: skip
        assert done == ROWS
        told = asked.reshape(-1, ticks)
        wanted = told.mean(axis=1) if averaged else told[:, 0]
        np.testing.assert_allclose(position[3], every[::ticks], rtol=0.0, atol=ROUNDING)
        np.testing.assert_allclose(torque[3], wanted, rtol=0.0, atol=1e3 * ROUNDING)
