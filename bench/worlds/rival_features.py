"""What the rivals get: the residual of a base fit, and columns that each mean one effect. Nothing of the library.

The base is inertia, viscous, Coulomb with an exponential bristle and offset, by least squares; the bristle's reach and
the delay between torque and motion are searched. Each column is what is left of a feature after the base; its name is
the effect that a reader would take it for. Everything is fitted to the rows of training; the veto trajectory is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from autotune.recordings.recording import Recording
from bench.worlds.programme import EXPERIMENTS
from bench.worlds.sizes import MOTION, _bristle, smooth
from bench.worlds.world import Floats

DELAYS = np.arange(-1.0, 5.0, 0.5)
"""Rows by which the torque is taken earlier than it is written, for the best fit of the base."""


@dataclass(frozen=True, slots=True)
class Problem:
    """Residual, shape (n,), and columns, shape (n, m), of unit rms in training; `names`: the effect of each column.

    `training`: rows to be fitted, (n,); the others are the veto trajectory.
    `motion`: place, speed, acceleration, bristle, torque, time, all (n,) in their own scales; `base`: (n, 5).
    """

    residual: Floats
    columns: Floats
    names: tuple[str, ...]
    motion: dict[str, Floats]
    base: Floats
    training: NDArray[np.bool_]

    def beside_base(self, shape: Floats) -> Floats:
        """What the base, refitted in training, leaves of a torque, shape (n,)."""
        return _beside(self.base, shape[:, None], self.training)[:, 0]

    def held_out(self, shape: Floats) -> float:
        """Share of the residual that a torque, shape (n,), takes away from the veto trajectory."""
        kept = ~self.training
        whole = float(np.mean(self.residual[kept] ** 2))
        return 1.0 - float(np.mean((self.residual - shape)[kept] ** 2)) / max(whole, 1e-300)


def problem(taken: Recording) -> Problem:
    """The moving rows of training and veto of a recording, 200 a second."""
    period = taken.period
    y = smooth(taken["position"], period, MOTION)
    u = taken["torque_command" if "torque_command" in taken else "torque"]
    v, a = np.gradient(y, period), np.gradient(np.gradient(y, period), period)
    rows = _rows(taken)
    training = np.isin(taken.experiment[rows], EXPERIMENTS)
    z, base, torque, late = _base((y, v, a, u), period, rows, training)
    motion = {
        "place": y,
        "speed": v,
        "acceleration": a,
        "bristle": z,
        "torque": _earlier(u, late),
        "time": taken["time"] - taken["time"][0],
    }
    residual = _beside(base, torque[:, None], training)[:, 0]
    lines = _lines(residual[training], y[rows][training])
    names, raw = _features(motion, period, taken.metadata.motion_unit, lines)
    columns = _beside(base, smooth(np.column_stack(raw), period)[rows], training)
    columns = columns / np.maximum(_rms(columns[training]), 1e-6 * _rms(np.column_stack(raw)))
    shown = {name: smooth(values, period)[rows] for name, values in motion.items()}
    return Problem(residual, columns, tuple(names), shown, base, training)


def _rows(taken: Recording) -> NDArray[np.int64]:
    """Rows of training and veto, every 5 ms, where the reading moves by more than two counts in 20 ms."""
    width = 2 * max(round(0.01 / taken.period), 1) + 1
    place = taken["position"]
    swing = maximum_filter1d(place, width) - minimum_filter1d(place, width)
    rows = np.isin(taken.experiment, (*EXPERIMENTS, "veto"))
    rows &= swing > 2.1 * (taken.metadata.position_resolution or 0.0)
    step = max(round(5e-3 / taken.period), 1)
    return np.flatnonzero(rows)[::step]


def _base(
    motion: tuple[Floats, Floats, Floats, Floats],
    period: float,
    rows: NDArray[np.int64],
    training: NDArray[np.bool_],
) -> tuple[Floats, Floats, Floats, float]:
    """Bristle, base columns, torque and its delay [rows] of the reach and the delay that leave least in training."""
    y, v, a, u = motion
    torques = smooth(np.column_stack([_earlier(u, late) for late in DELAYS]), period)[rows]
    best: tuple[float, Floats, Floats, int] | None = None
    for reach in float(np.ptp(y)) * np.geomspace(3e-6, 0.03, 16):
        z = _bristle(y, float(reach))
        base = smooth(np.column_stack([a, v, np.ones(len(y)), z, np.gradient(z, period)]), period)[rows]
        base = base / np.maximum(_rms(base), 1e-300)
        left = np.mean(_beside(base, torques, training)[training] ** 2, axis=0)
        i = int(np.argmin(left))
        if best is None or float(left[i]) < best[0]:
            best = (float(left[i]), z, base, i)
    assert best is not None
    _, z, base, i = best
    return z, base, np.asarray(torques[:, i]), float(DELAYS[i])


def _earlier(values: Floats, rows: float) -> Floats:
    """Values as they were some rows before."""
    at = np.arange(len(values), dtype=float)
    return np.asarray(np.interp(at - rows, at, values))


def _rms(columns: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(columns**2, axis=0)))


def _beside(base: Floats, columns: Floats, training: NDArray[np.bool_]) -> Floats:
    """What the base, fitted to each column in training, leaves of it."""
    return np.asarray(columns - base @ np.linalg.lstsq(base[training], columns[training], rcond=None)[0])


def _lines(left: Floats, place: Floats) -> list[float]:
    """The three wave numbers that explain most of the residual [rad per unit]."""
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
