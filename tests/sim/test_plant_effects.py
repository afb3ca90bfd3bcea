"""Each planted effect shows the law and the size that its table promises, and nothing where size is 0."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from autotune.core.errors import ConfigurationError
from autotune_sim.effects import EFFECTS, apply_effects
from autotune_sim.presets import Preset, preset
from autotune_sim.servo import Servo, ServoMode, ServoState

H = 1e-3
DESIGN = [
    "torque_ripple",
    "direction_asymmetry",
    "stribeck",
    "nonlinear_viscous",
    "position_dependent_friction",
    "gravity_imbalance",
    "spring",
    "reversal_memory",
    "thermal_drift",
    "elastic_transmission",
    "backlash",
    "torque_lag",
    "torque_saturation",
    "dwell_time_break_away",
    "load_dependent_friction",
    "encoder_eccentricity",
]


def axis(effect: str = "", size: float = 0.0, kind: str = "lugre", **changes: object) -> Preset:
    """A quiet axis, without ripple unless it is planted."""
    base = preset(kind)
    plant = replace(base.plant, ripple=(), process_noise=0.0, torque_noise=0.0, counts=50_000_000, **changes)  # type: ignore[arg-type]
    return replace(base, plant=apply_effects(plant, {effect: size} if effect else {}, 7))


def ramp(preset_: Preset, speed: float, seconds: float, start: float = 0.0) -> list[ServoState]:
    """Constant speed from rest at `start`."""
    servo = Servo(preset_)
    servo.power(True)
    for k in range(1000):
        servo.cycle(start * k / 1000)
    return [servo.cycle(start + speed * k * H) for k in range(round(seconds / H))]


def level(preset_: Preset, speed: float) -> float:
    """Mean torque at a constant speed [N m]."""
    return float(np.mean([s.torque_demand for s in ramp(preset_, speed, 2.0)[1000:]]))


def friction(preset_: Preset, speed: float) -> float:
    """Half the difference of the torques in the two directions [N m]."""
    return 0.5 * (level(preset_, speed) - level(preset_, -speed))


def sine(preset_: Preset, amplitude: float = 0.2, frequency: float = 1.0) -> NDArray[np.float64]:
    """Torque demands over two periods, the second one of them."""
    servo = Servo(preset_)
    servo.power(True)
    n = round(1 / frequency / H)
    target = amplitude * np.sin(2 * np.pi * np.arange(2 * n) / n)
    return np.array([servo.cycle(x).torque_demand for x in target.tolist()])[n:]


def test_the_effects_of_the_design_are_all_there() -> None:
    assert list(EFFECTS) == DESIGN


@pytest.mark.parametrize("kind", ["edm-vertical", "lugre"])
@pytest.mark.parametrize("name", DESIGN)
def test_size_zero_is_no_effect_and_the_default_is_one(name: str, kind: str) -> None:
    none, zero, some = (
        sine(axis(effect, size, kind))
        for effect, size in (("", 0.0), (name, 0.0), (name, EFFECTS[name].default))
    )
    if name not in ("backlash",):  # size 0 leaves the flanks' elasticity
        assert zero == pytest.approx(none, abs=1e-12)
    rms = float(np.sqrt(np.mean((some - none) ** 2)))
    assert 1e-5 < rms < 0.2


def test_ripple_has_its_amplitudes() -> None:
    states = ramp(axis("torque_ripple", 0.02, "frictionless", offset=0.0), 0.5, 14.0)[1000:]
    q = np.array([s.position for s in states])
    torque = np.array([s.torque_demand for s in states])
    basis = np.c_[np.ones_like(q), *(f(n * q) for n in (12, 24) for f in (np.sin, np.cos))]
    c = np.linalg.lstsq(basis, torque, rcond=None)[0]
    assert math.hypot(c[1], c[2]) == pytest.approx(0.02, rel=0.02)
    assert math.hypot(c[3], c[4]) == pytest.approx(0.01, rel=0.03)


def test_asymmetry_makes_one_direction_heavier() -> None:
    plain, planted = axis(), axis("direction_asymmetry", 0.1)
    assert level(planted, 2.0) - level(plain, 2.0) == pytest.approx(0.03, rel=0.03)
    assert level(planted, -2.0) - level(plain, -2.0) == pytest.approx(0.03, rel=0.03)


@pytest.mark.parametrize("speed", [0.05, 0.3, 1.0])
def test_stribeck_torque_falls_with_speed(speed: float) -> None:
    gain = friction(axis("stribeck", 0.06), speed) - friction(axis(), speed)
    assert gain == pytest.approx(0.06 * math.exp(-((speed / 0.3) ** 2)), abs=1e-3)


@pytest.mark.parametrize("speed", [1.0, 8.0])
def test_lubricant_torque_grows_with_the_two_thirds_power(speed: float) -> None:
    gain = friction(axis("nonlinear_viscous", 0.03), speed) - friction(axis(), speed)
    assert gain == pytest.approx(0.03 * speed ** (2 / 3), rel=0.02)


def test_tight_spot_is_where_it_was_put() -> None:
    planted = axis("position_dependent_friction", 0.3)
    states = ramp(planted, 1.0, 8.0, start=-4.0)
    plain = ramp(axis(), 1.0, 8.0, start=-4.0)
    gain = np.array([a.torque_demand - b.torque_demand for a, b in zip(states, plain, strict=True)])[500:]
    place = np.array([s.position for s in states])[500:]
    assert gain.max() == pytest.approx(0.3 * 0.3, rel=0.05)
    assert place[np.argmax(gain)] == pytest.approx(planted.plant.bump_centre, abs=0.1)


def test_imbalance_and_spring_depend_on_the_angle() -> None:
    planted = axis("gravity_imbalance", 0.03, "frictionless", offset=0.0)
    states = ramp(planted, 1.0, 7.0)[200:]
    torque = np.array([s.torque_demand for s in states])
    assert 0.5 * (torque.max() - torque.min()) == pytest.approx(0.03, rel=0.03)
    spring = ramp(axis("spring", 0.01, "frictionless", offset=0.0), 1.0, 5.0)
    slope = np.polyfit([s.position for s in spring[500:]], [s.torque_demand for s in spring[500:]], 1)[0]
    assert slope == pytest.approx(0.01, rel=0.02)


def test_reversal_memory_adds_its_torque_slowly() -> None:
    assert friction(axis("reversal_memory", 0.1), 1.0) - friction(axis(), 1.0) == pytest.approx(0.1, rel=0.02)
    short, long = (
        np.ptp(sine(axis("reversal_memory", 0.1), a, 0.25)) - np.ptp(sine(axis(), a, 0.25))
        for a in (0.01, 0.2)
    )
    assert 0.2 < short / long < 0.8


def test_warming_takes_friction_away() -> None:
    servo = Servo(axis("thermal_drift", 0.03))
    servo.power(True)
    torque = [servo.cycle(8.0 * k * H).torque_demand - 0.048 for k in range(120_000)]
    early, late = np.mean(torque[1000:3000]), np.mean(torque[-2000:])
    assert 0.5 < late / early < 0.85
    assert servo.temperature > 30.0


def test_compliance_is_seen_as_a_softer_axis_at_high_frequency() -> None:
    plain, planted = (sine(axis(e, s), 0.01, 25.0) for e, s in (("", 0.0), ("elastic_transmission", 0.02)))
    assert 0.02 < np.sqrt(np.mean((plain - planted) ** 2)) / plain.std() < 1.0


def test_lag_is_a_first_order_delay_of_the_torque() -> None:
    servo = Servo(axis("torque_lag", 2e-3, "frictionless", offset=0.0))
    servo.power(True, ServoMode.TORQUE)
    actual = [servo.cycle(target_torque=0.1).torque_actual for _ in range(6)]
    assert actual == pytest.approx([0.1 * (1 - math.exp(-k * H / 2e-3)) for k in range(6)], abs=1e-9)


def test_saturation_costs_its_share_at_the_limit() -> None:
    servo = Servo(axis("torque_saturation", 0.25, "frictionless"))
    servo.power(True, ServoMode.TORQUE)
    assert [servo.cycle(target_torque=1.34).torque_actual for _ in range(2)][1] == pytest.approx(1.34 * 0.75)


def break_away(preset_: Preset, rest: float) -> float:
    """Largest torque of a slow start after a rest of so many seconds [N m]."""
    servo = Servo(preset_)
    servo.power(True)
    for k in range(1000):
        servo.cycle(0.2 * k * H)
    for _ in range(round(rest / H)):
        servo.cycle(0.2)
    return max(servo.cycle(0.2 + 0.1 * k * H).torque_demand for k in range(1000))


def test_rest_raises_the_break_away_torque() -> None:
    planted, plain = (
        break_away(axis(name, size, "edm-vertical"), 4.0) - break_away(axis(name, size, "edm-vertical"), 0.05)
        for name, size in (("dwell_time_break_away", 0.08), ("", 0.0))
    )
    assert 0.02 < planted < 0.08
    assert abs(plain) < 5e-3


def test_transmitted_torque_raises_friction() -> None:
    heavy = axis("load_dependent_friction", 0.2, offset=0.3)
    assert friction(heavy, 1.0) - friction(axis(offset=0.3), 1.0) == pytest.approx(0.2 * 0.3, rel=0.03)


def test_eccentric_encoder_errs_once_a_revolution() -> None:
    servo = Servo(axis("encoder_eccentricity", 1e-3, "frictionless", offset=0.0))
    servo.power(True)
    for k in range(8000):
        servo.cycle(1.0 * k * H)
    # At constant measured speed the true speed swings by size times speed: seen in the accelerating torque.
    torque = [servo.cycle(1.0 * k * H).torque_demand for k in range(8000, 15000)]
    assert 0.3 * 6.66e-7 < 0.5 * np.ptp(torque) - 4.13e-6 < 10 * 6.66e-7 + 5e-4


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ({"stribek": 0.1}, "did you mean 'stribeck'"),
        ({"spring": 9.0}, "allowed is 0.0 to 0.04"),
        ({"spring": math.nan}, "allowed is"),
        ({"friction": -1.0}, "allowed is 0.0 to 5.0"),
    ],
)
def test_impossible_effects_are_refused_in_words(effects: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words.replace(".", r"\.")):
        preset("edm-vertical", effects=effects)


def test_effects_do_not_depend_on_each_other() -> None:
    one = preset("lugre", 3, {"gravity_imbalance": 0.03}).plant
    two = preset("lugre", 3, {"torque_ripple": 0.02, "gravity_imbalance": 0.03}).plant
    assert one.imbalance_phase == two.imbalance_phase
    assert preset("lugre", 4, {"gravity_imbalance": 0.03}).plant.imbalance_phase != one.imbalance_phase
