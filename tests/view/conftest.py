"""Data that looks like an axis: enough physics to judge a figure by, all from one seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from autotune.view.data import (
    BeforeAfter,
    Comparison,
    DahlCurve,
    History,
    Presliding,
    Rank,
    Residual,
    SteadyState,
    Step,
    Trace,
)


@dataclass(frozen=True)
class Sampled:
    """One example of each kind of data."""

    steady_state: SteadyState
    presliding: Presliding
    dahl: DahlCurve
    before_after: BeforeAfter
    traces: tuple[Trace, ...]
    comparison: Comparison
    residual: Residual
    steps: tuple[Step, ...]
    ranks: tuple[Rank, ...]
    history: History


@pytest.fixture(scope="session")
def sampled() -> Sampled:
    return make_sampled()


def make_sampled(seed: int = 7) -> Sampled:
    rng = np.random.default_rng(seed)
    return Sampled(
        steady_state(rng),
        presliding(rng),
        dahl(rng),
        before_after(rng),
        traces(rng),
        comparison(rng),
        residual(rng),
        (
            Step("base", 0.0262),
            Step("torque_ripple", 0.0141),
            Step("reversal_memory", 0.0071),
            Step("stribeck", 0.0064),
        ),
        (
            Rank("torque_ripple", 0.46, True, "seen on every trajectory, 72 per revolution"),
            Rank("reversal_memory", 0.21, True, "seen on the veto trajectory too"),
            Rank("stribeck", 0.031, False, "gain within the noise"),
            Rank("thermal_drift", 0.004, False, "gain within the noise"),
            Rank("backlash", -0.012, False, "makes the error larger"),
        ),
        History(
            "coulomb",
            "N m",
            1.75e9 + 86400.0 * np.arange(120),
            0.316 + 0.0004 * np.arange(120) + 0.004 * rng.normal(size=120),
            np.full(120, 0.004),
            (0.28, 0.35),
            ((1.75e9 + 86400.0 * 80, "re-tuned"),),
        ),
    )


def characteristic(velocity: np.ndarray) -> np.ndarray:
    return 0.048 + np.sign(velocity) * 0.33 + 0.00413 * velocity


def steady_state(rng: np.random.Generator) -> SteadyState:
    velocity = np.concatenate([-np.geomspace(0.05, 10, 12)[::-1], np.geomspace(0.05, 10, 12)])
    curve = np.concatenate([np.linspace(-10, -0.01, 60), np.linspace(0.01, 10, 60)])
    torque = characteristic(velocity) + 0.008 * rng.normal(size=24)
    error = 0.01 + 0.006 * rng.random(24)
    return SteadyState(velocity, torque, error, curve, characteristic(curve))


def presliding(rng: np.random.Generator) -> Presliding:
    time = np.arange(9000) * 1e-3
    torque = 0.05 + 0.033 * np.sign(np.sin(2 * np.pi * 1.5 * time + 3 * np.sin(1.1 * time)))
    position = np.zeros_like(time)
    velocity = 0.0
    for k in range(1, len(time)):
        velocity += 1e-3 * ((torque[k] - 0.05) - 101 * position[k - 1] - 0.117 * velocity) / 6.66e-4
        position[k] = position[k - 1] + 1e-3 * velocity
    count = 2 * np.pi / 50000
    measured = np.round((position + 1.2) / count) * count + 2e-5 * np.sin(0.7 * time)
    spread = {"LS": (31, 4), "LSdv": (104, 4), "IV": (38, 9), "IVdv": (101, 3), "BJ": (99, 5)}
    estimates = {name: list(mean + s * rng.normal(size=15)) for name, (mean, s) in spread.items()}
    return Presliding(time, torque, measured, position + 1.2, estimates, (101.0, 2.5))


def dahl(rng: np.random.Generator) -> DahlCurve:
    time = np.arange(24000) * 1e-3
    position = 0.1 * np.sin(2 * np.pi * time / 12)
    state, modelled = 0.0, np.zeros_like(time)
    for k in range(1, len(time)):
        step = position[k] - position[k - 1]
        state += step * (1 - state * np.sign(step) / 0.33 * 30 / 30) * 30
        state = float(np.clip(state, -0.33, 0.33))
        modelled[k] = state + 0.048
    measured = modelled + 0.01 * np.sin(24 * position * 8) + 0.005 * rng.normal(size=len(time))
    return DahlCurve(position, measured, modelled, 0.33, 0.048)


def before_after(rng: np.random.Generator, repeats: int = 6) -> BeforeAfter:
    time = np.arange(1000) * 1e-3
    reference = 0.2 * np.sin(2 * np.pi * time)

    def glitch(size: float, width: float) -> np.ndarray:
        shape = np.zeros_like(time)
        for turn, sign in ((0.25, 1.0), (0.75, -1.0)):
            since = (time - turn) % 1.0
            shape += sign * size * (since / width) * np.exp(1 - since / width)
        return shape - 0.03 * size * np.cos(2 * np.pi * time)

    noise = 3e-5 * rng.normal(size=(2, repeats, 1000)).cumsum(axis=2) / 8
    noise -= noise.mean(axis=2, keepdims=True)
    before = glitch(2.0e-3, 0.02) * (1 + 0.03 * rng.normal(size=(repeats, 1))) + noise[0]
    after = glitch(0.45e-3, 0.03) * (1 + 0.05 * rng.normal(size=(repeats, 1))) + noise[1]
    return BeforeAfter(time, reference, before, after, 2 * np.pi / 50000)


def traces(rng: np.random.Generator) -> tuple[Trace, ...]:
    time = np.arange(0, 40, 0.01)
    made = []
    for name, unit, start, end, refined, error in (
        ("stiffness", "N m/rad", 100.0, 28.4, 39.5, 0.8),
        ("coulomb", "N m", 0.33, 0.316, 0.272, 0.003),
        ("offset", "N m", 0.08, 0.050, 0.0487, 0.0004),
        ("inertia", "kg m²", 6.9e-4, 6.66e-4, 6.7e-4, 1e-5),
    ):
        wobble = 0.01 * end * np.sin(2 * np.pi * time) + 0.002 * end * rng.normal(size=len(time))
        value = end + (start - end) * np.exp(-time / 7) + wobble
        made.append(Trace(name, unit, time, value, 0.2 * end, 1.6 * max(start, end), refined, error))
    return tuple(made)


def comparison(rng: np.random.Generator) -> Comparison:
    time = np.arange(20000) * 1e-3
    velocity = 2 * np.cos(2 * np.pi * 0.5 * time)
    modelled = characteristic(velocity) * np.tanh(np.abs(velocity) * 20)
    ripple = 0.012 * np.sin(72 * np.sin(2 * np.pi * 0.5 * time) / np.pi)
    return Comparison(time, modelled + ripple + 0.005 * rng.normal(size=20000), modelled, noise_floor=0.005)


def residual(rng: np.random.Generator) -> Residual:
    position = rng.uniform(0, 2 * np.pi, 60000)
    torque = 0.012 * np.sin(6 * position) + 0.004 * np.sin(12 * position + 1) + 0.005 * rng.normal(size=60000)
    return Residual("position", "rad", position, torque, 0.005, 0.78)
