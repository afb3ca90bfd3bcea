"""Disturbances that follow the clock, not the motion: one frequency in every experiment.

Repeats of a trajectory do not start in the phase of such a disturbance, so that it looks like noise; but
its phase runs on through all experiments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.data import TRAINING
from autotune.estimation.problem import Problem

LEAST_HERTZ = 0.7


@dataclass(frozen=True, slots=True)
class TimeLine:
    """A disturbance of constant frequency [Hz] and its share of the residual's variance."""

    hertz: float
    share: float


def time_driven_line(problem: Problem, error: Floats) -> TimeLine | None:
    """The strongest line whose phase runs on through all experiments; None where there is none."""
    data = problem.data
    if len(data.stretches) != 1 or len({b.name for b in data.blocks if b.role == TRAINING}) < 3:
        return None
    rows = problem.training > 0
    clock = _clock(problem)
    time, values = clock[rows], error[rows] - error[rows].mean()
    step = float(np.median(np.diff(np.sort(time))))
    series = np.zeros(math.ceil(time.max() / step) + 2)
    series[np.round(time / step).astype(np.int64)] = values
    power = np.abs(np.fft.rfft(series)) ** 2
    hertz = np.fft.rfftfreq(len(series), step)
    band = (hertz > LEAST_HERTZ) & (hertz < 0.8 * hertz[-1])
    best = int(np.argmax(np.where(band, power, 0.0)))
    if power[best] < problem.policy.line_contrast * np.median(power[band]):
        return None
    finest = min(
        hertz[best] + np.linspace(-1.0, 1.0, 41) / time.max(), key=lambda f: -_share(time, values, float(f))
    )
    if any(_of_the_motion(float(finest), part.samples * data.period, time.max()) for part in data.periodic):
        return None
    share = _share(time, values, float(finest))
    everywhere = _everywhere(problem, error, float(finest))
    return TimeLine(float(finest), share) if share > problem.policy.line_part and everywhere else None


def without_line(problem: Problem, error: Floats, line: TimeLine) -> Floats:
    """An error without such a disturbance, shape (m,)."""
    terms, rows = _terms(_clock(problem), line.hertz), problem.training > 0
    return np.asarray(error - terms @ np.linalg.lstsq(terms[rows], error[rows], rcond=None)[0])


def _of_the_motion(hertz: float, period: float, seconds: float) -> bool:
    """Whether a line is a harmonic of a motion that repeats itself: nothing says then that time drives it."""
    return abs(hertz - round(hertz * period) / period) < 2.0 / seconds


def _clock(problem: Problem) -> Floats:
    """Time of each grid row [s], shape (m,)."""
    return np.asarray(problem.data.grid * problem.data.period, dtype=np.float64)


def _terms(time: Floats, hertz: float) -> Floats:
    angle = 2.0 * math.pi * hertz * time
    return np.asarray(np.column_stack([np.sin(angle), np.cos(angle)]), dtype=np.float64)


def _share(time: Floats, values: Floats, hertz: float) -> float:
    terms = _terms(time, hertz)
    slope = np.linalg.lstsq(terms, values, rcond=None)[0]
    return float(1.0 - np.sum((values - terms @ slope) ** 2) / max(float(np.sum(values**2)), 1e-300))


def _everywhere(problem: Problem, error: Floats, hertz: float) -> bool:
    """Whether amplitude and phase are about the same in nearly every experiment."""
    data = problem.data
    rows, clock = problem.training > 0, _clock(problem)
    whole = np.linalg.lstsq(_terms(clock[rows], hertz), error[rows], rcond=None)[0]
    alike = []
    for block in data.blocks:
        if block.role == TRAINING:
            own = np.arange(block.rows.start, block.rows.stop)
            found = np.linalg.lstsq(_terms(clock[own], hertz), error[own], rcond=None)[0]
            alike.append(float(np.linalg.norm(found - whole)) < 0.5 * float(np.linalg.norm(whole)))
    return float(np.mean(alike)) >= problem.policy.line_everywhere
