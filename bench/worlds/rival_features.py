"""What the rivals get: the residual of a base fit, and columns that each mean one effect. Nothing of the library.

The base is inertia, viscous, Coulomb with an exponential bristle and offset, by least squares. Each column is what is
left of a feature after the base; its name is the effect that a reader would take it for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.recordings.recording import Recording
from bench.worlds.programme import EXPERIMENTS
from bench.worlds.sizes import MOTION, _bristle, smooth
from bench.worlds.world import Floats


@dataclass(frozen=True, slots=True)
class Problem:
    """Residual, shape (n,), and columns, shape (n, m), of unit rms; `names`: the effect that each column means.

    `motion`: place, speed, acceleration, bristle, torque, time, all (n,) in their own scales.
    """

    residual: Floats
    columns: Floats
    names: tuple[str, ...]
    motion: dict[str, Floats]
    base: Floats
    before: float


def problem(taken: Recording) -> Problem:
    """The training rows of a recording, 200 a second."""
    period = taken.period
    rows = np.isin(taken.experiment, EXPERIMENTS)
    rows = np.flatnonzero(rows if rows.any() else taken.experiment != "conditioning")
    rows = rows[:: max(round(5e-3 / period), 1)]
    y = smooth(taken["position"], period, MOTION)
    u = taken["torque_command" if "torque_command" in taken else "torque"]
    v, a = np.gradient(y, period), np.gradient(np.gradient(y, period), period)
    torque = smooth(u, period)[rows]
    swing = float(np.ptp(y))
    best: tuple[float, Floats, Floats] | None = None
    for reach in swing * np.geomspace(3e-6, 0.03, 12):
        z = _bristle(y, float(reach))
        base = smooth(np.column_stack([a, v, np.ones(len(y)), z, np.gradient(z, period)]), period)[rows]
        base = base / np.maximum(np.sqrt(np.mean(base**2, axis=0)), 1e-300)
        left = torque - base @ np.linalg.lstsq(base, torque, rcond=None)[0]
        if best is None or float(np.mean(left**2)) < best[0]:
            best = (float(np.mean(left**2)), z, base)
    square, z, base = best if best is not None else (0.0, np.zeros(len(y)), np.zeros((len(rows), 5)))
    motion = {
        "place": y,
        "speed": v,
        "acceleration": a,
        "bristle": z,
        "torque": u,
        "time": taken["time"] - taken["time"][0],
    }
    names, raw = _features(motion, period, taken.metadata.motion_unit, _lines(torque, base, y[rows]))
    columns = _beside(base, smooth(np.column_stack(raw), period)[rows])
    residual = torque - base @ np.linalg.lstsq(base, torque, rcond=None)[0]
    shown = {name: smooth(values, period)[rows] for name, values in motion.items()}
    return Problem(residual, columns, tuple(names), shown, base, square)


def _beside(base: Floats, columns: Floats) -> Floats:
    """What the base cannot make of each column, at unit rms."""
    columns = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    columns = columns - base @ np.linalg.lstsq(base, columns, rcond=None)[0]
    return np.asarray(columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-6))


def _lines(torque: Floats, base: Floats, place: Floats) -> list[float]:
    """The three wave numbers that explain most of the residual [rad per unit]."""
    left = torque - base @ np.linalg.lstsq(base, torque, rcond=None)[0]
    travel = float(np.ptp(place))
    numbers = 2.0 * math.pi * np.arange(1.5, 200.0, 0.5) / travel
    power = np.array([abs(np.vdot(np.exp(1j * k * place), left)) for k in numbers])
    out: list[float] = []
    for i in np.argsort(-power):
        if all(abs(numbers[i] - k) * travel > 2.0 * math.pi for k in out):
            out.append(float(numbers[i]))
        if len(out) == 3:
            break
    return out


def _features(
    m: dict[str, Floats], period: float, unit: str, lines: list[float]
) -> tuple[list[str], list[Floats]]:
    y, v, a, z, u, t = (m[name] for name in ("place", "speed", "acceleration", "bristle", "torque", "time"))
    top, half = float(np.abs(v).max()), 0.5 * float(np.ptp(y))
    x, s = y / half, v / top
    table: list[tuple[str, Floats]] = []
    for k in lines:
        table += [("torque_ripple", np.sin(k * y)), ("torque_ripple", np.cos(k * y))]
    table += [("direction_asymmetry", np.abs(z)), ("direction_asymmetry", np.abs(s))]
    table += [("stribeck", z * np.exp(-np.abs(s) / w)) for w in (0.005, 0.02, 0.06)]
    table += [("nonlinear_viscous", np.sign(s) * np.abs(s) ** power) for power in (0.3, 2.0, 3.0)]
    table += [
        ("position_dependent_friction", z * np.exp(-(((x - c) / 0.3) ** 2)))
        for c in (-0.8, -0.4, 0, 0.4, 0.8)
    ]
    table += [("spring", x), ("spring", x**3)]
    table += [("reversal_memory", _bristle(y, half * w)) for w in (0.003, 0.02, 0.1)]
    table += [("thermal_drift", z * t / t[-1]), ("thermal_drift", z * np.exp(-t / 40.0))]
    jerk = np.gradient(a, period)
    table += [
        ("elastic_transmission", np.gradient(jerk, period)),
        ("torque_lag", np.gradient(smooth(u, period), period)),
    ]
    table += [("backlash", np.gradient(_bristle(y, 1e-3 * half), period)), ("torque_saturation", u**3)]
    table += [("dwell_time_break_away", z * _rested(v, period, 5e-4 * top))]
    table += [("load_dependent_friction", z * np.abs(a)), ("load_dependent_friction", z * np.abs(u))]
    if unit == "rad":
        table += [("gravity_imbalance", np.sin(y)), ("gravity_imbalance", np.cos(y))]
        table += [("encoder_eccentricity", v**2 * np.sin(y)), ("encoder_eccentricity", v**2 * np.cos(y))]
    return [name for name, _ in table], [values for _, values in table]


def _rested(v: Floats, period: float, slow: float) -> Floats:
    """Logarithm of the last rest, forgotten within a tenth of a second of motion."""
    out, age = np.zeros(len(v)), 0.0
    keep = math.exp(-period / 0.1)
    still: NDArray[np.bool_] = np.abs(v) < slow
    for k in range(len(v)):
        age = age + period if still[k] else age * keep
        out[k] = math.log1p(age / 0.05)
    return out
