"""Mechanics of the simulated axis against laws that can be written on paper."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from autotune_sim.effects import EFFECTS, scale_friction
from autotune_sim.plant import (
    Bristle,
    Element,
    PlantParameters,
    Wave,
    advance,
    fresh_state,
    pack,
    reading,
    substeps,
)
from autotune_sim.presets import PRESETS, Preset, preset
from autotune_sim.servo import Servo, ServoMode

H = 1e-3
QUIET = {"process_noise": 0.0, "torque_noise": 0.0}


def quiet(axis: Preset, **changes: object) -> Preset:
    """The axis without noise, with an encoder a thousand times finer."""
    plant = replace(axis.plant, **{**QUIET, "counts": 50_000_000, **changes})  # type: ignore[arg-type]
    return replace(axis, plant=plant)


def bare(**changes: object) -> PlantParameters:
    return PlantParameters(inertia=1e-3, viscous=0.0, offset=0.0, **changes)  # type: ignore[arg-type]


def push(plant: PlantParameters, torques: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions after each of the torques, one a cycle, shape (n,)."""
    packed, state, steps = pack(plant), fresh_state(), substeps(plant, H)
    out = []
    for torque in torques.tolist():
        advance(packed[0], state[0], torque, 0.0, False, steps, H / steps)
        out.append(float(state["position"][0]))
    return np.array(out)


def test_an_inertia_accelerates_as_it_should() -> None:
    position = push(bare(), np.full(1000, 1e-3))[-1]
    assert position == pytest.approx(0.5, rel=1e-6)  # ½·a·t²


def test_viscous_friction_sets_a_time_constant() -> None:
    plant = replace(bare(), viscous=1e-2)
    position = push(plant, np.full(300, 1e-2))
    t, tau = 0.3, 0.1
    assert position[-1] == pytest.approx(t - tau * (1 - math.exp(-t / tau)), rel=2e-3)


@pytest.mark.parametrize("level", [0.05, 0.2])
def test_an_element_is_a_spring_below_and_constant_torque_above_break_away(level: float) -> None:
    plant = bare(elements=(Element(1e-2, level),), micro_damping=0.02)
    slow = np.linspace(0.0, 0.9 * level, 4000)
    assert push(plant, slow)[-1] == pytest.approx(0.9e-2, rel=0.02)
    beyond = push(plant, np.r_[slow, np.full(2000, 1.01 * level)])
    assert beyond[-1] > 5e-2


def test_a_closed_inner_loop_returns_to_its_reversal_point() -> None:
    """Return-point memory: after a small loop the outer branch goes on as if there had been none."""
    axis = quiet(preset("edm-vertical"), ripple=())
    servo = Servo(axis)
    servo.power(True)
    outer = np.linspace(0.0, 0.05, 4000)
    inner = np.r_[np.linspace(0.05, 0.04, 2000), np.linspace(0.04, 0.05, 2000)]
    last = [servo.cycle(x).torque_demand for x in np.r_[outer, inner, np.full(200, 0.05)]][-1]
    straight = Servo(axis)
    straight.power(True)
    expected = [straight.cycle(x).torque_demand for x in np.r_[outer, np.full(200, 0.05)]][-1]
    assert last == pytest.approx(expected, abs=5e-3)  # N m, of 0.33: the corners of the path overshoot


def test_slow_motion_needs_friction_viscous_torque_and_offset() -> None:
    axis = quiet(preset("edm-vertical"), ripple=())
    plant = axis.plant
    for direction in (1.0, -1.0):
        servo = Servo(axis)
        servo.power(True)
        states = [servo.cycle(direction * 0.5 * k * H) for k in range(2000)]
        torque = np.mean([s.torque_demand for s in states[1500:]])
        expected = direction * (plant.friction + 0.5 * plant.viscous) + plant.offset
        assert torque == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("speed", [0.05, 0.2, 2.0])
def test_lugre_bristle_follows_its_steady_state_characteristic(speed: float) -> None:
    axis = quiet(preset("lugre"))
    b, plant = axis.plant.bristle, axis.plant
    assert b is not None
    servo = Servo(axis)
    servo.power(True)
    torque = np.mean([servo.cycle(speed * k * H).torque_demand for k in range(3000)][2000:])
    level = b.coulomb + (b.break_away - b.coulomb) * math.exp(-((speed / b.velocity) ** 2))
    assert torque == pytest.approx(level + plant.viscous * speed + plant.offset, abs=1e-3)


def test_stiffness_at_rest_of_the_bristle_is_its_stiffness() -> None:
    plant = bare(bristle=Bristle(0.3, 0.3, 0.1, 100.0, 0.1))
    position = push(plant, np.linspace(0.0, 0.015, 3000))[-1]
    assert 0.015 / position == pytest.approx(100.0 * (1 - 0.015 / 0.3 / 2), rel=0.01)  # g: the first 5 %


def test_offset_and_ripple_oppose_positive_motion() -> None:
    axis = quiet(preset("frictionless"), ripple=(Wave(10.0, 0.05, 0.0),), offset=0.1)
    servo = Servo(axis)
    servo.power(True)
    states = [servo.cycle(0.3 * k * H) for k in range(4000)][1000:]
    position = np.array([s.position for s in states])
    torque = np.array([s.torque_demand for s in states])
    basis = np.c_[np.ones_like(position), np.sin(10 * position), np.cos(10 * position)]
    constant, sine, cosine = np.linalg.lstsq(basis, torque, rcond=None)[0]
    assert constant == pytest.approx(0.1 + 0.3 * axis.plant.viscous, abs=1e-3)
    assert sine == pytest.approx(0.05, rel=0.05)
    assert abs(cosine) < 5e-3


def test_the_encoder_tells_whole_counts() -> None:
    plant = bare(counts=1000)
    packed, state = pack(plant), fresh_state()
    state["position"] = 0.0123
    counts = reading(packed[0], state[0]) / plant.resolution
    assert counts == pytest.approx(round(0.0123 / plant.resolution), abs=1e-9)


def test_the_brake_stops_and_holds_a_moving_axis() -> None:
    packed, state = pack(replace(preset("edm-vertical").plant, offset=0.5)), fresh_state()
    state["velocity"] = 20.0
    for _ in range(300):
        advance(packed[0], state[0], 0.0, 0.0, True, 10, 1e-4)
    rest = float(state["position"][0])
    for _ in range(2000):
        advance(packed[0], state[0], 0.0, 0.0, True, 10, 1e-4)
    assert abs(float(state["position"][0]) - rest) < 1e-5
    assert 0.02 < rest < 0.2


@pytest.mark.parametrize("name", ["", *EFFECTS])
def test_the_integration_step_is_fine_enough(name: str) -> None:
    """Against four times finer steps: 0.02 mrad of a 2 mrad glitch, and 0.1 % of the torque."""
    axis = quiet(preset("edm-vertical", effects={name: EFFECTS[name].default} if name else {}))
    runs = []
    for refine in (1, 4):
        servo = Servo(axis, refine=refine)
        servo.power(True)
        target = 0.2 * np.sin(2 * np.pi * np.arange(1500) * H)
        runs.append(np.array([servo.cycle(x)[2:5:2] for x in target.tolist()]))
    difference = np.abs(runs[0] - runs[1])
    assert difference[:, 0].max() < 2e-5
    assert np.sqrt(np.mean(difference[:, 1] ** 2)) < 4e-4


def test_an_elastic_transmission_resonates_where_two_masses_do() -> None:
    plant = replace(preset("frictionless").plant, transmission_stiffness=50.0, ripple=(), offset=0.0)
    rng = np.random.default_rng(1)
    torque = rng.choice([-0.2, 0.2], 8192)
    spectrum = np.abs(np.fft.rfft(np.diff(push(plant, torque), 2, prepend=[0, 0]) / H**2))
    response = spectrum / np.abs(np.fft.rfft(torque))
    frequency = np.fft.rfftfreq(8192, H)
    band = (frequency > 20) & (frequency < 300)
    peak = frequency[band][np.argmax(np.convolve(response, np.ones(9) / 9, "same")[band])]
    motor, load = plant.inertia * 0.6, plant.inertia * 0.4
    expected = math.sqrt(50.0 * (1 / motor + 1 / load)) / (2 * math.pi)
    assert peak == pytest.approx(expected, rel=0.05)


def test_a_gap_lets_the_motor_turn_alone() -> None:
    plant = replace(
        preset("frictionless").plant,
        transmission_stiffness=300.0,
        gap=0.02,
        ripple=(),
        offset=0.0,
        viscous=0.0,
    )
    packed, state = pack(plant), fresh_state()
    state["velocity"] = 0.5
    for _ in range(18):
        advance(packed[0], state[0], 0.0, 0.0, False, 20, 5e-5)
    assert float(state["load_velocity"][0]) == 0.0
    for _ in range(200):
        advance(packed[0], state[0], 0.0, 0.0, False, 20, 5e-5)
    momentum = 0.6 * state["velocity"][0] + 0.4 * state["load_velocity"][0]
    assert momentum == pytest.approx(0.6 * 0.5, rel=1e-6)
    assert float(state["load_velocity"][0]) > 0.1


@given(
    torques=st.lists(st.floats(-1.3, 1.3), min_size=5, max_size=60),
    name=st.sampled_from(["", *EFFECTS]),
    kind=st.sampled_from(sorted(PRESETS)),
)
@settings(max_examples=120, deadline=None)
def test_no_torque_drives_the_state_out_of_its_bounds(torques: list[float], name: str, kind: str) -> None:
    plant = preset(kind, effects={name: EFFECTS[name].default} if name else {}).plant
    packed, state, steps = pack(plant), fresh_state(), substeps(plant, H)
    for torque in torques:
        advance(packed[0], state[0], torque, 0.0, False, steps, H / steps)
    assert all(np.all(np.isfinite(state[field])) for field in state.dtype.names)
    elastic = float(np.abs(state["elastic"]).sum())
    most = plant.friction + plant.stribeck + plant.dwell + plant.load_factor * 2.0
    excess = plant.bristle.break_away - plant.bristle.coulomb if plant.bristle else 0.0
    assert elastic <= 1.3 * (1 + plant.bump) * (most + excess) + 1e-9


@pytest.mark.parametrize("kind", ["edm-vertical", "lugre"])
def test_seeds_vary_the_six_parameters_within_a_fifth(kind: str) -> None:
    nominal = preset(kind).plant

    def ratios(plant: PlantParameters) -> list[float]:
        values = [
            (p.inertia, p.viscous, p.friction, p.offset, p.friction / p.stiffness) for p in (plant, nominal)
        ]
        out = [one / other for one, other in zip(*values, strict=True)]
        return out + [w.amplitude / n.amplitude for w, n in zip(plant.ripple, nominal.ripple, strict=True)]

    table = np.array([ratios(preset(kind, seed).plant) for seed in range(1, 60)])
    assert np.all((table > 0.8) & (table < 1.2))
    assert np.all(table.std(axis=0) > 0.08)  # uniform: 0.115
    assert preset(kind, 0) == preset(kind, None) == preset(kind)
    assert preset(kind, 5) == preset(kind, 5)


def test_friction_can_be_scaled_away() -> None:
    plant = scale_friction(preset("edm-vertical").plant, 0.0)
    assert plant.friction == 0.0
    assert plant.stiffness == 0.0
    assert scale_friction(preset("lugre").plant, 0.5).friction == pytest.approx(0.15)


def test_torque_mode_passes_the_demand_through() -> None:
    servo = Servo(quiet(preset("frictionless"), offset=0.0, ripple=(), viscous=0.0))
    servo.power(True, ServoMode.TORQUE)
    states = [servo.cycle(target_torque=0.01, torque_offset=0.01) for _ in range(201)]
    assert states[-1].position == pytest.approx(0.5 * 0.02 / 6.66e-4 * 0.2**2, rel=0.01)
