"""The compiled routine against an independent integration of the same equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.models.lugre import SHAPES, bristle_step, level
from autotune.models.plant import simulate, substeps_for

PERIOD = 1e-3
MODEL = base_model(
    {
        "inertia": 6.66e-4,
        "viscous": 4.13e-3,
        "coulomb": 0.33,
        "stiffness": 60.0,
        "micro_damping": 0.1,
        "offset": 0.048,
        "break_away": 0.40,
        "stribeck_velocity": 0.3,
    }
)


def _open_loop(torque: np.ndarray) -> np.ndarray:
    packed = MODEL.pack()
    n = len(torque)
    position, demand = np.empty(n), np.empty(n)
    loop = np.array([PERIOD, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    zero = np.zeros(n)
    done = simulate(
        packed.p,
        packed.on,
        np.zeros(layout.STATES),
        np.zeros(4),
        loop,
        False,
        substeps_for(packed.p, PERIOD),
        torque,
        zero,
        zero,
        zero,
        position,
        demand,
    )
    assert done == n
    return position


def _reference_solution(torque: np.ndarray) -> np.ndarray:
    """(3.8)–(3.10) by a stiff solver with tight tolerances, written from the thesis."""

    def rates(_: float, x: np.ndarray, u: float) -> list[float]:
        _, v, z = x
        g = (0.33 + (0.40 - 0.33) * np.exp(-((v / 0.3) ** 2))) / 60.0
        dz = v - abs(v) * z / g
        return [v, (u - 60.0 * z - 0.1 * dz - 4.13e-3 * v - 0.048) / 6.66e-4, dz]

    x = np.zeros(3)
    positions = []
    for u in torque:
        positions.append(x[0])
        x = solve_ivp(rates, (0, PERIOD), x, "LSODA", args=(u,), rtol=1e-9, atol=1e-12).y[:, -1]
    return np.array(positions)


def test_open_loop_motion_matches_a_stiff_solver() -> None:
    """Presliding, break-away, sliding and reversal; the bound is 0.5 % of the range."""
    t = np.arange(800) * PERIOD
    torque = 0.048 + 0.6 * np.sin(2 * np.pi * 2.5 * t) * np.minimum(t / 0.2, 1.0)
    ours, theirs = _open_loop(torque), _reference_solution(torque)
    assert np.ptp(theirs) > 0.3
    assert np.max(np.abs(ours - theirs)) < 0.005 * np.ptp(theirs)


def test_presliding_motion_matches_a_stiff_solver() -> None:
    """A tenth of the break-away torque: the linear regime (3.46)."""
    t = np.arange(600) * PERIOD
    torque = 0.048 + 0.03 * np.sign(np.sin(2 * np.pi * 17 * t))
    ours, theirs = _open_loop(torque), _reference_solution(torque)
    assert np.max(np.abs(ours - theirs)) < 0.005 * np.ptp(theirs)


@pytest.mark.parametrize("speed", [1e-4, 0.1, -7.0])
def test_the_bristle_step_is_exact_for_any_duration(speed: float) -> None:
    """(5.8) composes: one step of 20 ms equals 2000 of 10 µs."""
    one = bristle_step(0.001, speed, 0.006, 0.02)
    many = 0.001
    for _ in range(2000):
        many = bristle_step(many, speed, 0.006, 1e-5)
    assert one == pytest.approx(many, rel=1e-9)


def test_every_shape_falls_from_break_away_to_coulomb() -> None:
    speeds = np.array([0.0, 1e-3, 0.1, 0.3, 1.0, 1e4])
    for shape in SHAPES:
        values = level(shape, speeds, 0.3, 0.4, 0.3)
        assert np.all(np.diff(values) <= 0)
        assert values[-1] == pytest.approx(0.3, rel=1e-6)
        assert values[0] == pytest.approx(0.3 if shape == "linear" else 0.4)
