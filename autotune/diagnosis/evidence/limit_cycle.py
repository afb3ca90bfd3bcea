"""An axis that hunts: a limit cycle of its loop, with a phase of its own in every repeat.

It is told by what two repeats of an experiment do not share: there one line holds most of what is quick. Whether the
twin of a model hunts alike tells whether what hides the friction below it is hidden from the model, too.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import welch

from autotune.core.arrays import Floats
from autotune.estimation.data import TRAINING
from autotune.estimation.problem import Problem
from autotune.estimation.twin_runs import SEED, run_twin
from autotune.models.drive_model import Packed

HUNTS_ABOVE, NARROW, MOST, LOUD = 10.0, 0.1, 0.5, 0.1
"""Of a limit cycle: the lowest frequency [Hz]; the width of its line, over that; its least share of all that repeats do
not share there; its least level over the torque's, where an axis has next to no friction."""
AS_LOUD = 1.5
"""Times as loud a twin's limit cycle may be as the axis's, or as faint: its bursts begin and end by chance."""


def limit_cycle(problem: Problem, coulomb: float) -> float:
    """Frequency at which the axis hunts with more torque than its friction [Hz]; 0 where it does not.

    `coulomb` is its dry friction [N m]. A limit cycle has a phase of its own in every repeat, so that it is no part of
    the motion, and keeps the contact sliding to and fro: what is left below it is not friction as any model has it.
    """
    level, hertz = _between_repeats(problem, problem.data.torque)
    return hertz if level > coulomb else 0.0


def hunts_alike(problem: Problem, packed: Packed) -> bool:
    """Whether the twin of a model hunts as the axis does: at its frequency, and with as much torque, to `AS_LOUD`.

    The loop of a rigid axis is quiet with gains that let the load swing on its spring. Where the model with that
    spring hunts alike, its twins go through the same friction, and what is left has nothing of it.
    """
    if not problem.twin or problem.controller is None:
        return False
    random = np.random.default_rng(SEED)
    run = run_twin(problem.data, packed, problem.controller, problem.disturbance, random)
    if not run.stable:
        return False
    torques = problem.data.torque, run.torque
    (_, hertz), (_, its) = (_between_repeats(problem, one) for one in torques)
    if abs(hertz - its) > 0.5 * NARROW * hertz:
        return False
    loud, as_loud = (_level_at(problem, *one) for one in zip(torques, (hertz, its), strict=True))
    return loud <= AS_LOUD * as_loud and as_loud <= AS_LOUD * loud


def _level_at(problem: Problem, torque: Floats, hertz: float) -> float:
    """Level of a line over all repeats that are trained [N m], in whatever phase it is there."""
    powers = []
    for block in problem.data.blocks:
        if block.role != TRAINING or block.repeats < 2:
            continue
        for rows in block.by_repeat(problem.data.grid):
            at, power = _spectrum(torque[rows[0] : rows[-1] + 1], problem.data.period)
            powers.append(float(power[np.abs(at - hertz) <= NARROW * hertz].sum() * at[1]))
    return math.sqrt(sum(powers) / max(len(powers), 1))


def _between_repeats(problem: Problem, torque: Floats) -> tuple[float, float]:
    """Level [N m] and frequency [Hz] of the loudest line that two repeats of a trained experiment do not share; zeros
    where there is none.
    """
    data, found = problem.data, [(0.0, 0.0)]
    for block in data.blocks:
        if block.role != TRAINING or block.repeats < 2:
            continue
        first, second = data.grid[block.by_repeat(np.arange(len(data.grid)))][:2]
        count = int(min(first[-1] - first[0], second[-1] - second[0]))
        if count * data.period < 2.0 / HUNTS_ABOVE:
            continue
        one, other = (torque[rows[0] : rows[0] + count] for rows in (first, second))
        level, hertz = _loudest((one - other) / math.sqrt(2.0), data.period)
        found.append((level if level > LOUD * float(np.std(one)) else 0.0, hertz))
    return max(found)


def _loudest(values: Floats, period: float) -> tuple[float, float]:
    """Level of the line that holds most of what is quick, and its frequency [Hz]; zeros where none does."""
    hertz, power = _spectrum(values, period)
    quick = hertz > HUNTS_ABOVE
    if not quick.any():
        return 0.0, 0.0
    peak = float(hertz[quick][np.argmax(power[quick])])
    line = quick & (np.abs(hertz - peak) <= NARROW * peak)
    if float(power[line].sum()) < MOST * float(power[quick].sum()):
        return 0.0, 0.0
    return math.sqrt(float(power[line].sum() * hertz[1])), peak


def _spectrum(values: Floats, period: float) -> tuple[Floats, Floats]:
    """Frequencies [Hz] and density of power, from windows of a second."""
    hertz, power = welch(values, 1.0 / period, nperseg=min(len(values), round(1.0 / period)))
    return np.asarray(hertz), np.asarray(power)
