"""Sampled margins against what is known by other means: scipy, brute force in time, and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import cont2discrete

from autotune.control.gains.loop import Gains, LoopTiming, Notch, cascade, cascade_of, cascaded_from
from autotune.control.gains.regimes import (
    LinearAxis,
    Regime,
    characteristic_space,
    linear_axis,
    torque_stages,
)
from autotune.control.gains.sampled import (
    axis_response,
    closed_loop_radius,
    controller_response,
    frequencies,
    margins,
    sampled_axis,
    torque_noise,
)
from autotune.control.gains.twin import follow
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.models.inverse import required
from autotune.models.table import EFFECTS
from autotune.models.total_friction import stiffness_at_rest
from tests.control.gains_axis import TIMING, lugre, vertical

H = TIMING.period


def late(cycles: float) -> LoopTiming:
    return LoopTiming(H, TIMING.resolution, 1.34, cycles * H)


def test_the_regimes_are_those_of_the_thesis() -> None:
    model = vertical()
    stiffness = stiffness_at_rest(model)
    assert stiffness == pytest.approx(100.0, rel=0.15)  # Table 6.2
    assert characteristic_space(model) == pytest.approx(3.3e-3, rel=0.15)
    assert linear_axis(model, "sliding").stiffness == 0.0
    assert linear_axis(model, "sticking").damping == pytest.approx(model["viscous"] + model["micro_damping"])


def test_the_held_axis_is_scipys() -> None:
    axis = linear_axis(vertical(), "sticking")
    a, b, c = axis.state_space()
    expected = cont2discrete((a, b[:, None], c[None, :], 0.0), H)[0]
    assert sampled_axis(axis, TIMING).a == pytest.approx(expected, rel=1e-9)


def test_a_broken_cycle_of_dead_time_lies_between_whole_ones() -> None:
    axis = linear_axis(vertical(), "sliding")
    gains = Gains(20.0, 0.1, 500.0)
    found = [margins(sampled_axis(axis, late(d)), gains, H).phase for d in (0.0, 0.5, 1.0, 1.5, 2.0)]
    assert all(one > other for one, other in pairwise(found))
    crossover = margins(sampled_axis(axis, TIMING), gains, H).crossover
    assert found[0] - found[2] == pytest.approx(360.0 * crossover * H, rel=0.1)  # ωc·h


@pytest.mark.parametrize("cycles", [0.0, 0.3, 1.0, 2.0])
@pytest.mark.parametrize("regime", ["sticking", "sliding"])
def test_eigenvalues_and_the_loop_in_time_agree(cycles: float, regime: str) -> None:
    """Gains just inside and just outside the limit, in the twin without friction (and with a spring for sticking)."""
    model = lugre().without_effect("stribeck").with_values({"coulomb": 0.0, "offset": 0.0})
    if regime == "sticking":
        model = model.with_effect(EFFECTS["spring"].make({"stiffness": 80.0}, {}))
    timing = LoopTiming(H, 0.0, math.inf, cycles * H)
    axis = sampled_axis(linear_axis(model, "sliding"), timing)

    def radius(kd: float) -> float:
        return closed_loop_radius(axis, Gains(10.0, kd, 100.0), H)

    low, high = 0.05, 3.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) < 1.0 else (low, middle)
    reference = np.concatenate([np.zeros(5), np.full(1500, 1e-3)])
    calm = follow(model, Gains(10.0, 0.93 * low, 100.0), timing, reference)
    wild = follow(model, Gains(10.0, 1.07 * low, 100.0), timing, reference)
    assert np.ptp(calm.position[-200:]) < np.ptp(calm.position[:300])
    assert not wild.bounded or np.ptp(wild.position[-200:]) > 10.0 * np.ptp(wild.position[:300])


def test_margins_say_how_far_the_gain_may_go() -> None:
    axis = sampled_axis(linear_axis(vertical(), "sliding"), TIMING)
    found = margins(axis, Gains(60.0, 0.15, 6000.0), H)
    assert found.stable
    for part, stable in ((0.97, True), (1.03, False)):
        up = part * 10.0 ** (found.gain / 20.0)
        assert margins(axis, Gains(60.0 * up, 0.15 * up, 6000.0 * up), H).stable == stable
        down = 10.0 ** (-part * found.gain_down / 20.0)
        assert margins(axis, Gains(60.0 * down, 0.15 * down, 6000.0 * down), H).stable == stable


def test_theorem_42_asks_for_what_a_cycle_of_1_ms_cannot_bear() -> None:
    """(4.73) on edm-vertical: kd above 1.46; the sampled loop ends at 1.27."""
    axis = sampled_axis(linear_axis(vertical(), "sliding"), TIMING)
    assert margins(axis, Gains(60.0, 1.25), H).stable
    assert not margins(axis, Gains(60.0, 1.29), H).stable


def test_a_lag_of_several_stages_turns_the_phase_like_a_dead_time() -> None:
    axis, where = replace(linear_axis(vertical(), "sliding"), lags=()), frequencies(H)
    near = where < 80.0

    def turned(stages: tuple[float, ...]) -> Floats:
        lagged = sampled_axis(replace(axis, lags=stages), TIMING)
        return np.angle(axis_response(lagged, H) / axis_response(sampled_axis(axis, TIMING), H))[near]

    dead = -2.0 * math.pi * where[near] * 2e-3
    assert turned((5e-4,) * 4) == pytest.approx(dead, abs=0.05 * abs(dead[-1]))
    assert turned((2e-3,))[-1] > 0.8 * dead[-1]


def test_a_lag_in_a_model_is_that_of_its_stages() -> None:
    for steepness, stages in ((0.0, (2e-3,)), (0.6, (8e-4, 4e-4, 4e-4, 4e-4)), (1.0, (2e-3 / 3.0,) * 3)):
        lag = EFFECTS["torque_lag"].make({"time_constant": 2e-3, "steepness": steepness})
        assert torque_stages(vertical().with_effect(lag)) == pytest.approx(stages)
    assert torque_stages(vertical()) == ()


def test_a_resonance_is_in_the_response() -> None:
    axis = LinearAxis(1e-3, 1e-3, 0.0, 1e-3 * 0.25 * (2.0 * math.pi * 120.0) ** 2, 0.01, 0.5, 0.5)
    assert axis.resonance == pytest.approx(120.0, rel=1e-6)
    size = np.abs(axis_response(sampled_axis(axis, TIMING), H))
    where = frequencies(H)
    near = (where > 60.0) & (where < 250.0)
    assert where[near][np.argmax(size[near] * where[near] ** 2)] == pytest.approx(120.0, rel=0.05)


def test_a_notch_takes_out_its_own_frequency_only() -> None:
    gains = Gains(1.0, 0.0, notch=Notch(120.0))
    size = np.abs(controller_response(gains, H))
    where = frequencies(H)
    assert size[np.argmin(np.abs(where - 120.0))] == pytest.approx(0.1, abs=0.01)
    assert size[0] == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(ConfigurationError, match="beyond what a cycle"):
        Notch(499.0).coefficients(H)


def test_a_cascade_is_a_pid_loop_with_weights() -> None:
    gains = cascade(50.0, 0.1, 2.0)
    assert (gains.kp, gains.kd, gains.ki) == pytest.approx((7.0, 0.1, 100.0))
    assert cascade_of(gains) == pytest.approx(
        {"position_gain": 50.0, "velocity_gain": 0.1, "integral_gain": 2.0}
    )
    again = cascaded_from(7.0, 0.1, 100.0)
    assert (again.kp, again.kd, again.ki) == pytest.approx((7.0, 0.1, 100.0))
    assert cascaded_from(1.0, 1.0, 100.0).ki == pytest.approx(0.25)  # the most that a cascade has


def test_a_cascade_in_time_is_its_own_equations() -> None:
    """u = kv·(kx·e − v) + kiv·Σ(kx·e − v)·h, written out, gives the torque of the weighted form."""
    model, timing = lugre(), LoopTiming(H, 0.0, math.inf)
    reference = np.concatenate([np.zeros(50), np.full(400, 0.05)])
    motion = follow(model, cascade(40.0, 0.08, 1.5), timing, reference)
    rate = np.diff(motion.position, prepend=0.0) / H
    wanted = 40.0 * motion.error - rate
    expected = 0.08 * wanted + 1.5 * np.cumsum(wanted) * H + model["offset"]
    assert motion.torque == pytest.approx(expected, abs=1e-9)


def test_noise_of_a_count_and_wrong_gains() -> None:
    assert torque_noise(Gains(60.0, 0.15), TIMING) == pytest.approx(TIMING.resolution * (60.0 + 150.0))
    for wrong in ({"kp": -1.0}, {"kd": math.nan}, {"derivative_filter": 0.0}):
        with pytest.raises(ConfigurationError):
            Gains(**{"kp": 1.0, "kd": 1.0, **wrong})


SPRUNG: dict[str, dict[str, float]] = {"spring": {"stiffness": 10.0}}
MEMORY: dict[str, dict[str, float]] = {
    "reversal_memory": {"displacement_1": 0.05, "torque_1": 0.5, "damping": 1e-2}
}


@pytest.mark.parametrize(
    ("beside", "regime"), [(SPRUNG, "sliding"), (MEMORY, "sticking")], ids=["spring", "memory"]
)
@pytest.mark.parametrize("rub", [0.0, 0.5, 1.0])
def test_what_pulls_at_the_motor_alone_is_not_shared_with_the_load(
    beside: dict[str, dict[str, float]], regime: Regime, rub: float
) -> None:
    """The torque that a small sine at the motor needs, by the inverse and by the regime's two masses."""
    friction = (1e-9, 1e-3, 1e-9) if regime == "sliding" else (0.2, 10.0, 1e-2)
    base = dict(zip(("coulomb", "stiffness", "micro_damping"), friction, strict=True))
    elastic = {"compliance": 0.05, "load_inertia": 0.5, "load_friction": rub, "damping": 0.05}
    model = base_model({"inertia": 1e-3, "viscous": 2e-3, "offset": 0.0, **base})
    for name, values in {"elastic_transmission": elastic, **beside}.items():
        model = model.with_effect(EFFECTS[name].make(values))
    packed, rate, step = model.pack(), 2.0 * math.pi * 25.0, 1e-4
    time = step * np.arange(round(40.0 / 25.0 / step))
    place = 1e-5 * np.sin(rate * time)
    speed = 1e-5 * rate * np.cos(rate * time)
    torque, state = np.empty(len(time)), np.zeros(layout.STATES)
    required(packed.p, packed.on, state, place, speed, -(rate**2) * place, step, 4, torque)
    late = slice(len(time) // 2, None)  # once the load swings as it will
    turning = np.exp(-1j * rate * time[late])
    needed = np.mean(torque[late] * turning) / np.mean(place[late] * turning)
    a, b, c = linear_axis(model, regime).state_space()
    told = 1.0 / (c @ np.linalg.solve(1j * rate * np.eye(len(b)) - a, b))
    assert abs(told - needed) < 0.01 * abs(needed)
