"""The servo loop keeps its published contract, its limits and its parameters."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune_sim import kernel
from autotune_sim.parameters import NAMES
from autotune_sim.presets import preset, with_dead_time
from autotune_sim.servo import Servo, ServoMode, ServoState

H = 1e-3
LAW = {
    "feedforward.enabled": 1.0,
    "feedforward.inertia": 6.66e-4,
    "feedforward.viscous": 4.13e-3,
    "feedforward.coulomb": 0.27,
    "feedforward.break_away": 0.3,
    "feedforward.stribeck_velocity": 0.2,
    "feedforward.stiffness": 40.0,
    "feedforward.micro_damping": 0.05,
    "feedforward.offset": 0.048,
}


def servo(seed: int = 0, **parameters: float) -> Servo:
    out = Servo(preset("edm-vertical"), seed)
    out.parameters.restore({name.replace("_", ".", 1): value for name, value in parameters.items()})
    return out


def sine(machine: Servo, n: int = 1500, amplitude: float = 0.2) -> list[ServoState]:
    return [machine.cycle(amplitude * math.sin(2 * math.pi * k * H)) for k in range(n)]


@given(
    gains=st.tuples(st.floats(5, 80), st.floats(0, 0.2), st.floats(0, 8000), st.floats(0.3, 1.0)),
    limit=st.floats(0.2, 1.34),
    targets=st.lists(st.floats(-0.05, 0.05), min_size=10, max_size=80),
    offset=st.floats(-0.3, 0.3),
)
@settings(max_examples=60, deadline=None)
def test_position_control_is_the_published_law(
    gains: tuple[float, ...], limit: float, targets: list[float], offset: float
) -> None:
    names = ("controller.kp", "controller.kd", "controller.ki", "controller.derivative_filter")
    machine = Servo(preset("edm-vertical"))
    machine.parameters.restore(dict(zip(names, gains, strict=True)) | {"limit.torque": limit})
    kp, kd, ki, keep = (machine.parameters[name] for name in names)
    limit = machine.parameters["limit.torque"]
    machine.power(True)
    r_before = y_before = machine.position
    d = total = 0.0
    for r in targets:
        state = machine.cycle(r, 0.0, 0.0, offset)
        y = state.position
        e = r - y
        d += keep * ((r - r_before - (y - y_before)) / H - d)
        u = kp * e + kd * d + ki * (total + e * H) + offset
        if abs(u) <= limit:
            total += e * H
        assert state.torque_demand == pytest.approx(min(max(u, -limit), limit), abs=1e-9)
        assert state.saturated == (abs(u) > limit)
        assert state.following_error == pytest.approx(e, abs=1e-12)
        assert state.torque_offset == pytest.approx(offset)
        r_before, y_before = r, y


def test_velocity_control_reaches_its_speed_without_error() -> None:
    machine = servo()
    machine.power(True, ServoMode.VELOCITY)
    states = [machine.cycle(target_velocity=2.0) for _ in range(2000)]
    travelled = states[-1].position - states[999].position
    assert travelled == pytest.approx(2.0, rel=2e-3)
    assert states[-1].velocity == pytest.approx(2.0, rel=0.1)


def test_velocity_control_holds_its_sum_while_clamped() -> None:
    machine = servo(limit_torque=0.2)  # below friction: the axis cannot start
    machine.power(True, ServoMode.VELOCITY)
    for _ in range(1000):
        machine.cycle(target_velocity=5.0)
    back = [machine.cycle(target_velocity=0.0).torque_demand for _ in range(20)]
    assert abs(back[-1]) < 0.3


def test_torque_control_reports_the_measured_position_as_its_reference() -> None:
    machine = servo()
    machine.power(True, ServoMode.TORQUE)
    state = [machine.cycle(target_torque=0.5, torque_offset=0.1) for _ in range(100)][-1]
    assert state.torque_demand == pytest.approx(0.6)
    assert state.torque_offset == pytest.approx(0.1)
    assert state.position_demand == state.position > 0.0
    assert state.following_error == 0.0


def test_total_torque_is_clamped_with_the_offset() -> None:
    machine = servo()
    machine.power(True, ServoMode.TORQUE)
    state = machine.cycle(target_torque=1.0, torque_offset=1.0)
    assert state.torque_demand == pytest.approx(1.34)
    assert state.saturated


def test_power_comes_without_a_jump_at_any_position() -> None:
    machine = servo()
    machine.power(True)
    for k in range(500):
        machine.cycle(k * 2e-3)
    machine.power(False)
    for _ in range(200):
        machine.idle()
    place = machine.position
    machine.power(True)
    states = [machine.cycle(place) for _ in range(300)]
    assert states[0].torque_demand == 0.0
    assert max(abs(s.position - place) for s in states) < 4e-3  # the brake's tension lets go


def test_without_power_there_is_no_torque_and_the_brake_holds() -> None:
    heavy = preset("frictionless")
    machine = Servo(replace(heavy, plant=replace(heavy.plant, offset=0.5)))
    states = [machine.idle() for _ in range(1000)]
    assert all(s.torque_demand == 0.0 for s in states)
    assert max(abs(s.position) for s in states) < 1e-3
    assert [s.time for s in states[:3]] == pytest.approx([0.0, H, 2 * H])


def test_a_brake_that_sticks_keeps_the_axis_where_it_is() -> None:
    machine = servo()
    machine.brake_stuck = True
    machine.power(True)
    assert max(abs(s.position) for s in sine(machine, 250)) < 5e-3


def test_equal_seeds_are_equal_and_others_are_not() -> None:
    runs = []
    for seed in (1, 1, 2):
        machine = servo(seed)
        machine.power(True)
        runs.append([s.torque_demand for s in sine(machine)])
    assert runs[0] == runs[1] != runs[2]


def test_noise_is_as_large_as_the_preset_says() -> None:
    machine = servo()
    machine.power(True, ServoMode.TORQUE)
    actual = np.array([machine.cycle().torque_actual for _ in range(5000)])
    assert actual.std() == pytest.approx(machine.preset.plant.torque_noise, rel=0.05)


@pytest.mark.parametrize("period", [1e-3, 2e-3, 4e-3])
def test_slower_cycles_work_too(period: float) -> None:
    machine = Servo(replace(preset("edm-vertical"), period=period))
    machine.parameters.restore({"controller.kp": 15.0, "controller.kd": 0.05, "controller.ki": 200.0})
    machine.power(True)
    n = round(1.0 / period)
    states = [machine.cycle(0.2 * math.sin(2 * math.pi * k / n)) for k in range(2 * n)]
    assert states[-1].time == pytest.approx(2.0 - period)
    assert 1e-3 < max(abs(s.following_error) for s in states[n:]) < 0.06


def test_a_cycle_outside_its_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"0.0005 s; allowed is 0.001 to 0.004 s"):
        Servo(replace(preset("edm-vertical"), period=5e-4))


def test_the_block_predicts_what_the_equations_say() -> None:
    """(5.2) with the exact step (5.8); differences of the demand, no delay of the friction state."""
    machine = Servo(preset("edm-vertical"))
    machine.parameters.restore(LAW)
    p = {name.split(".")[1]: machine.parameters[name] for name in LAW}
    machine.power(True)
    r_before, v_before, z = machine.position, 0.0, 0.0
    for k in range(800):
        r = 0.1 * math.sin(2 * math.pi * 2 * k * H)
        got = machine.cycle(r).torque_offset
        v = (r - r_before) / H
        rate = 0.0
        if v:
            excess = (p["break_away"] - p["coulomb"]) * math.exp(-((v / p["stribeck_velocity"]) ** 2))
            g = (p["coulomb"] + excess) / p["stiffness"]
            z += (math.copysign(g, v) - z) * -math.expm1(-abs(v) * H / g)
            rate = v - abs(v) * z / g
        expected = p["inertia"] * (v - v_before) / H + p["viscous"] * v + p["offset"]
        expected += p["stiffness"] * z + p["micro_damping"] * rate
        assert got == pytest.approx(expected, abs=1e-9)
        r_before, v_before = r, v


def test_the_block_without_stiffness_is_kinetic() -> None:
    machine = Servo(preset("edm-vertical"))
    machine.parameters.restore(
        {"feedforward.enabled": 1, "feedforward.coulomb": 0.3, "feedforward.offset": 0.05}
    )
    machine.power(True)
    offsets = [machine.cycle(x).torque_offset for x in (0.0, 1e-3, 2e-3, 1e-3, 1e-3)]
    assert offsets == pytest.approx([0.05, 0.35, 0.35, -0.25, 0.05], abs=1e-6)


def test_the_block_helps_and_is_silent_when_switched_off() -> None:
    peaks = []
    for enabled in (0.0, 1.0):
        machine = Servo(preset("edm-vertical"))
        machine.parameters.restore(LAW | {"feedforward.enabled": enabled})
        machine.power(True)
        states = sine(machine, 3000)[1000:]
        peaks.append(max(abs(s.following_error) for s in states))
        assert any(s.torque_offset for s in states) == bool(enabled)
    assert peaks[1] < 0.6 * peaks[0]


def test_parameters_are_kept_in_single_precision() -> None:
    machine = servo()
    for name in NAMES:
        machine.parameters.set(name, machine.parameters.range(name).default)
        assert machine.parameters[name] == np.float32(machine.parameters.range(name).default)
    machine.parameters.set("controller.kp", 12.3456789012)
    assert machine.parameters["controller.kp"] == float(np.float32(12.3456789012))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("controller.kp", -1.0, "cannot be -1.0; allowed is 0 to 10000"),
        ("controller.derivative_filter", 1.5, "allowed is 0.01 to 1"),
        ("limit.torque", 2.0, "allowed is 0 to 1.34"),
        ("limit.speed", math.nan, "cannot be nan"),
        ("feedforward.enabled", 0.5, "allowed is 0 to 1"),
    ],
)
def test_values_out_of_range_are_refused_in_words(name: str, value: float, words: str) -> None:
    machine = servo()
    before = machine.parameters.snapshot()
    with pytest.raises(ValueError, match=words):
        machine.parameters.restore({"controller.ki": 1.0, name: value})
    assert machine.parameters.snapshot() == before


def test_an_unknown_parameter_names_its_neighbour() -> None:
    with pytest.raises(KeyError, match=r"did you mean 'controller\.kp'"):
        servo().parameters.set("controler.kp", 1.0)


def test_snapshots_restore_what_was_there() -> None:
    machine = servo()
    before = machine.parameters.snapshot()
    machine.parameters.set("controller.kp", 30.0)
    machine.parameters.restore(before)
    assert machine.parameters.snapshot() == before
    assert machine.parameters.record["controller_kp"][0] == 60.0


def test_the_cache_of_kernels_knows_every_file_that_has_some() -> None:
    folder = Path(kernel.__file__).parent
    users = {f.name for f in folder.glob("*.py") if "import Record, kernel" in f.read_text("utf-8")}
    assert users == set(kernel._SOURCES)


def test_temperature_rises_with_torque() -> None:
    machine = servo()
    machine.brake_stuck = True
    machine.power(True, ServoMode.TORQUE)
    for _ in range(30_000):
        state = machine.cycle(target_torque=1.2)
    assert 27.0 < state.temperature < 40.0


@pytest.mark.parametrize("cycles", [1, 2, 4])
def test_a_drive_with_a_dead_time_acts_so_many_cycles_later(cycles: int) -> None:
    """In torque mode, with nothing that moves it by itself: the same motion, later; none on its way after power off."""
    quiet = preset("edm-vertical")
    quiet = replace(
        quiet, plant=replace(quiet.plant, process_noise=0.0, torque_noise=0.0, offset=0.0, ripple=())
    )
    prompt, late = Servo(quiet), Servo(with_dead_time(quiet, cycles * H))
    torques = 0.4 * np.sin(0.05 * np.arange(300))
    moved = []
    for machine in (prompt, late):
        machine.power(True, ServoMode.TORQUE)
        moved.append([machine.cycle(target_torque=float(one)).position for one in torques])
    assert moved[1][cycles:] == moved[0][:-cycles]
    assert np.ptp(moved[0]) > 100 * quiet.plant.resolution
    late.power(False)
    late.power(True, ServoMode.TORQUE)
    assert [late.cycle().torque_demand for _ in range(cycles)] == [0.0] * cycles
    assert not late._memory["held"].any()
