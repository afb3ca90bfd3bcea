"""What docs/thesis-errata.md says is wrong in the thesis, each claim by numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.routh import Bristle, jacobian, pid_conditions, routh_stable
from autotune.control.gains.twin import follow, step_reference
from autotune.core.arrays import Floats
from autotune.models.drive_model import base_model

TABLE_63 = {
    "inertia": 6.66e-4, "viscous": 4.13e-3, "coulomb": 0.294, "stiffness": 31.6, "micro_damping": 0.112,
    "offset": 0.0482,
}  # fmt: skip


def drawn(random: np.random.Generator) -> Bristle:
    level = random.uniform(0.1, 0.5)
    return Bristle(
        10.0 ** random.uniform(-4, -2),
        10.0 ** random.uniform(1, 3),
        10.0 ** random.uniform(-2.5, -0.5),
        10.0 ** random.uniform(-4, -2),
        level,
        level * random.uniform(1.0, 1.6),
        10.0 ** random.uniform(-2, 0),
    )


def gain_of(axis: Bristle, kp: float, kv: float) -> float:
    """H∞ norm of G1 (4.27)."""
    w = np.geomspace(1e-2, 1e7, 4000)
    damping = kv + axis.viscous
    values = (axis.micro_damping * 1j * w + axis.stiffness) / (kp - axis.inertia * w**2 + 1j * damping * w)
    return float(np.max(np.abs(values)))


def test_corollary_42_bounds_the_gain_too_low_always() -> None:
    """(4.64): the true gain is at least twice the bound, wherever (4.62) and (4.63) hold."""
    random, ratios = np.random.default_rng(1), []
    while len(ratios) < 200:
        axis = drawn(random)
        kp = axis.inertia * (axis.stiffness / axis.micro_damping) ** 2 * random.uniform(1.0, 20.0)
        damping = np.sqrt(4.0 * kp * axis.inertia) * random.uniform(1.0, 10.0)
        bound = axis.micro_damping / (2.0 * damping)
        ratios.append(gain_of(axis, kp, damping - axis.viscous) / bound)
    assert min(ratios) > 1.99


def test_the_limit_443_is_four_times_too_large() -> None:
    """λmin/λmax of the ellipse times a → J·σ0/(2·σ1²) for a = b → ∞."""
    random = np.random.default_rng(2)
    for _ in range(20):
        axis = drawn(random)
        j, s0, s1 = axis.inertia, axis.stiffness, axis.micro_damping
        a = 1e6 * (1.0 + j * s0 / s1**2)
        kp, damping = a * s0, a * s1 + s0 / s1 * j
        ellipse = np.array([[kp * s1 / s0**2 + damping / s0, j / s1], [j / s1, j / s1]])
        low, high = np.linalg.eigvalsh(ellipse / np.max(ellipse))
        precise = np.linalg.det(ellipse) / np.trace(ellipse) ** 2  # low/high where the ratio is tiny
        assert a * precise == pytest.approx(0.5 * j * s0 / s1**2, rel=1e-3)
        assert low / high < 1e-3


def test_the_norm_411_misses_the_feedthrough() -> None:
    """Critically damped, t1 ≤ 0: (4.11) says σ1/J; an input of size 1 that turns reaches twice that."""
    j, s1 = 1e-3, 0.1
    damping = 2.0
    kp, s0 = damping**2 / (4.0 * j), 10.0
    assert s0 < 2.0 * (damping / (2.0 * j)) * s1  # t1 below 0
    time = np.linspace(0.0, 0.2, 20001)
    _, out, _ = lsim(([s1, s0, 0.0], [j, damping, kp]), np.where(time < 0.19, -1.0, 1.0), time, interp=False)
    assert np.max(np.abs(out)) == pytest.approx(2.0 * s1 / j, rel=0.02)


def motion(axis: Bristle, kp: float, kv: float, speed: float, x: Floats) -> Floats:
    """(4.4) in deviation variables."""
    e, rate, z = x
    v = speed - rate
    bristle = v - abs(v) / axis.level(v) * (z + axis.level(speed))
    force = -kp * e - (kv + axis.viscous) * rate + axis.stiffness * z + axis.micro_damping * bristle
    return np.array([rate, force / axis.inertia, bristle])


def test_the_jacobian_412_lacks_one_over_j() -> None:
    axis, kp, kv, speed = drawn(np.random.default_rng(3)), 30.0, 0.1, 0.2
    step = 1e-7
    numeric = np.column_stack(
        [
            (motion(axis, kp, kv, speed, d) - motion(axis, kp, kv, speed, -d)) / (2.0 * step)
            for d in step * np.eye(3)
        ]
    )
    ours = jacobian(axis, kp, kv, speed)
    assert ours == pytest.approx(numeric, rel=1e-4, abs=1e-4 * np.max(np.abs(numeric)))
    printed = axis.stiffness - axis.micro_damping * speed / axis.level(speed)
    assert ours[1, 2] == pytest.approx(printed / axis.inertia)
    assert abs(numeric[1, 2] / printed - 1.0) > 10.0


def test_419_needs_the_asymptote_too() -> None:
    """Without x_a < 0 it calls unstable motion stable; Routh's form agrees with the eigenvalues everywhere."""
    random, wrong = np.random.default_rng(4), 0
    for _ in range(2000):
        axis = replace(drawn(random), micro_damping=10.0 ** random.uniform(-2.0, 1.0))
        speed = axis.stribeck_velocity * 10.0 ** random.uniform(-1.5, 0.5)
        kp, kv = 10.0 ** random.uniform(-1, 4), 10.0 ** random.uniform(-4, 0)
        stable = bool(np.all(np.linalg.eigvals(jacobian(axis, kp, kv, speed)).real < 0.0))
        assert routh_stable(axis, kp, kv, speed) == stable
        rate, falling = speed / axis.level(speed), speed * axis.slope(speed) / axis.level(speed)
        printed = max(
            -axis.micro_damping * falling - axis.inertia * rate, -axis.stiffness * axis.slope(speed)
        )
        wrong += kv + axis.viscous > printed and not stable
    assert wrong > 0


def elements_of(positions: Floats, friction: float, stiffness: float, count: int = 4000) -> Floats:
    """Elements with exponentially distributed strength (2.18) along a path, shape (n,)."""
    strength = -friction * np.log(1.0 - (np.arange(count) + 0.5) / count)
    z, force = np.zeros(count), []
    last = positions[0]
    for position in positions:
        z = np.clip(z + stiffness * (position - last), -strength, strength)
        last = position
        force.append(float(z.mean()))
    return np.array(force)


def test_219_is_dahls_curve_before_the_first_reversal_only() -> None:
    """After it the elements follow Masing's rule, twice as wide; Dahl's model does not."""
    friction, stiffness = 0.3, 100.0
    reach = friction / stiffness
    up = np.linspace(0.0, 12.0 * reach, 400)
    down = np.linspace(12.0 * reach, 8.0 * reach, 400)
    force = elements_of(np.concatenate([up, down]), friction, stiffness)
    assert force[:400] == pytest.approx(friction * (1.0 - np.exp(-up / reach)), abs=2e-3 * friction)
    way = 12.0 * reach - down
    masing = friction - 2.0 * friction * (1.0 - np.exp(-way / (2.0 * reach)))
    dahl = friction - 2.0 * friction * (1.0 - np.exp(-way / reach))
    assert force[400:] == pytest.approx(masing, abs=5e-3 * friction)
    assert np.max(np.abs(force[400:] - dahl)) > 0.4 * friction


def test_474_needs_the_damping_of_the_bristle() -> None:
    """q̇/z of the loop itself at some s is (σ0 + σ1·s)·s²/(J·s³ + …), up to its sign; not (σ0 + σ1)·s²/…."""
    m, gains, s = TABLE_63, Gains(60.0, 0.15, 6000.0), 3.0 + 40.0j
    below = m["inertia"] * s**3 + (m["viscous"] + gains.kd) * s**2 + gains.kp * s + gains.ki
    impedance = m["inertia"] * s + m["viscous"] + gains.kd + gains.kp / s + gains.ki / s**2
    true = (m["stiffness"] + m["micro_damping"] * s) / impedance
    assert true == pytest.approx((m["stiffness"] + m["micro_damping"] * s) * s**2 / below)
    assert abs(true / ((m["stiffness"] + m["micro_damping"]) * s**2 / below) - 1.0) > 0.1


def test_341_without_the_square_is_not_the_model() -> None:
    """exp(−q̇/v_s) grows without bound for negative speeds; (3.5) does not."""
    axis = Bristle(1.0, 1.0, 0.0, 0.0, 0.3, 0.5, 0.1)
    printed = 0.3 + 0.2 * np.exp(0.5 / 0.1)
    assert axis.level(-0.5) == pytest.approx(0.3, abs=1e-6)
    assert printed > 10.0


def test_table_63_does_not_meet_473() -> None:
    """0.154 against 0.188."""
    found = pid_conditions(base_model(TABLE_63), Gains(60.0, 0.15, 6000.0))
    assert found.damping == pytest.approx((0.154, 0.188), abs=1e-3)
    assert not found.sufficient


def test_theorem_42_holds_where_its_conditions_do() -> None:
    """Random bristles and gains that meet (4.72), (4.73), nearly continuous: none hunts."""
    random = np.random.default_rng(6)
    timing = LoopTiming(5e-5, 0.0, np.inf)
    for _ in range(3):
        axis = drawn(random)
        axis = replace(axis, micro_damping=axis.stiffness / random.uniform(100.0, 600.0))
        excess = (axis.break_away - axis.coulomb) / axis.coulomb
        kd = 1.1 * (excess * axis.micro_damping + axis.stiffness * axis.inertia / axis.micro_damping)
        ki = 10.0 * axis.stiffness
        kp = 1.1 * (excess * axis.stiffness + ki * axis.micro_damping / axis.stiffness)
        values = {
            "inertia": axis.inertia, "viscous": axis.viscous, "coulomb": axis.coulomb, "stiffness": axis.stiffness,
            "micro_damping": axis.micro_damping, "offset": 0.0, "break_away": axis.break_away,
            "stribeck_velocity": axis.stribeck_velocity,
        }  # fmt: skip
        model = base_model(values)
        assert pid_conditions(model, Gains(kp, kd, ki)).sufficient
        reach = axis.coulomb / axis.stiffness
        motion = follow(model, Gains(kp, kd, ki), timing, step_reference(5.0 * reach, 0.05, 0.8, timing))
        assert motion.bounded
        assert np.ptp(motion.position[-3000:]) < 0.02 * reach
