"""The rivals: stepwise regression with BIC, PySINDy, gplearn and a CMA-ES ladder of BAM's friction models M1 to M6.

Each is given a problem (see `rival_features`) and processor time, fits the rows of training and says which effects it
takes the residual for, the one that it would miss most first, and the torque that it predicts.

What counts as a name:

- stepwise BIC: the effects of the columns that BIC let in, in their order.
- PySINDy: sparse least squares at twelve thresholds, BIC chooses one; the effects of the columns left, that first
  whose columns leave most when they are taken out and the others refitted.
- gplearn: the effect whose columns come nearest to the formula; none below 2 % of the residual's variance.
- CMA-ES: the step of the ladder that BIC likes best: M2 `stribeck`; M3 `load_dependent_friction`; M4 to M6 both,
  that first whose part is larger. M1 is nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from bench.worlds.rival_features import Problem
from bench.worlds.world import Floats

LEAST = 0.02
"""Of the residual's variance: a formula that explains less is none."""
MOST_COLUMNS = 12


@dataclass(frozen=True, slots=True)
class Said:
    """Effects, the most needed first, and the torque predicted on all rows of the problem, shape (n,)."""

    names: tuple[str, ...]
    torque: Floats


def nothing(p: Problem) -> Said:
    return Said((), np.zeros(len(p.residual)))


def _fitted(p: Problem, chosen: Sequence[int]) -> Floats:
    """Least squares in training on some columns; the torque on all rows."""
    columns = p.columns[:, list(chosen)]
    return np.asarray(columns @ np.linalg.lstsq(columns[p.training], p.residual[p.training], rcond=None)[0])


def _left(p: Problem, chosen: Sequence[int]) -> float:
    """Mean square that some columns leave in training."""
    rest = p.residual - _fitted(p, chosen) if chosen else p.residual
    return float(np.mean(rest[p.training] ** 2))


def _bic(p: Problem, square: float, unknowns: int) -> float:
    n = int(p.training.sum())
    return n * math.log(max(square, 1e-300)) + unknowns * math.log(n)


def stepwise(p: Problem, seconds: float) -> Said:
    """Forward selection with BIC."""
    chosen: list[int] = []
    score = _bic(p, _left(p, chosen), 0)
    until = time.process_time() + seconds
    while len(chosen) < MOST_COLUMNS and time.process_time() < until:
        square, i = min((_left(p, [*chosen, i]), i) for i in range(len(p.names)) if i not in chosen)
        better = _bic(p, square, len(chosen) + 1)
        if better >= score:
            break
        chosen.append(i)
        score = better
    return _said(p, chosen, list(dict.fromkeys(p.names[i] for i in chosen)))


def _said(p: Problem, chosen: Sequence[int], names: Sequence[str]) -> Said:
    return Said(tuple(names), _fitted(p, chosen)) if chosen else nothing(p)


def sindy(p: Problem, seconds: float) -> Said:
    """PySINDy's sequentially thresholded least squares; of thresholds from 2 to 90 % of the rms, BIC's."""
    import pysindy

    size = math.sqrt(_left(p, []))
    columns, target = p.columns[p.training], p.residual[p.training, None]
    best: tuple[float, list[int]] = (_bic(p, size**2, 0), [])
    until = time.process_time() + seconds
    for threshold in np.geomspace(0.9, 0.02, 12):
        if time.process_time() > until:
            break
        fit = pysindy.STLSQ(threshold=float(threshold) * size, alpha=1e-3, max_iter=30)
        fit.fit(columns, target)
        chosen = np.flatnonzero(np.abs(np.asarray(fit.coef_)[0]) > 0.0).tolist()
        best = min(best, (_bic(p, _left(p, chosen), len(chosen)), chosen))
    chosen = best[1]
    names = sorted({p.names[i] for i in chosen})
    needed = {name: _left(p, [i for i in chosen if p.names[i] != name]) for name in names}
    return _said(p, chosen, sorted(names, key=lambda name: -needed[name]))


def genetic(p: Problem, seconds: float) -> Said:
    """gplearn on the residual over the motion, generation by generation until the time is over."""
    from gplearn.genetic import SymbolicRegressor

    inputs = np.column_stack(
        [values / max(float(np.abs(values).max()), 1e-300) for values in p.motion.values()]
    )
    rows = np.flatnonzero(p.training)
    rows = rows[:: max(len(rows) // 2000, 1)]
    model = SymbolicRegressor(
        population_size=400, generations=1, function_set=("add", "sub", "mul", "div", "sin", "cos", "abs", "sqrt"),
        parsimony_coefficient=1e-4, metric="rmse", random_state=1, warm_start=True,
    )  # fmt: skip
    size = math.sqrt(_left(p, []))
    until = time.process_time() + seconds
    while time.process_time() < until and model.generations <= 60:
        model.fit(inputs[rows], p.residual[rows] / size)
        model.generations += 1
    shape = p.beside_base(np.asarray(model.predict(inputs), dtype=float))
    square = float(np.mean(shape[p.training] ** 2))
    if not np.all(np.isfinite(shape)) or square <= 0.0:
        return nothing(p)
    torque = shape * float(np.mean((shape * p.residual)[p.training])) / square
    explained = 1.0 - float(np.mean((p.residual - torque)[p.training] ** 2)) / size**2
    return Said((_most_like(p, torque),), torque) if explained > LEAST else nothing(p)


def _most_like(p: Problem, shape: Floats) -> str:
    """The effect whose columns come nearest to a torque in training."""
    target = shape[p.training]

    def left(name: str) -> float:
        own = p.columns[p.training][:, [own == name for own in p.names]]
        return float(np.mean((target - own @ np.linalg.lstsq(own, target, rcond=None)[0]) ** 2))

    return min(sorted(set(p.names)), key=left)


STEPS: Mapping[str, tuple[int, bool, bool]] = MappingProxyType(
    {"M1": (2, False, False), "M2": (5, True, False), "M3": (3, False, True), "M4": (7, True, True),
     "M5": (9, True, True), "M6": (11, True, True)}
)  # fmt: skip
"""Of each of BAM's models: unknowns, whether it has a Stribeck part, whether one that depends on the load."""


def ladder(p: Problem, seconds: float) -> Said:
    """BAM's friction models M1 to M6, each fitted by CMA-ES for a sixth of the time."""
    import cma

    best: tuple[float, tuple[str, ...], Floats] | None = None
    for model, (unknowns, _, _) in STEPS.items():
        until = time.process_time() + seconds / len(STEPS)
        search = cma.CMAEvolutionStrategy(np.zeros(unknowns), 0.3, {"seed": 1, "verbose": -9})
        found, square = np.zeros(unknowns), math.inf
        while time.process_time() < until and not search.stop():
            guesses = search.ask()
            losses = [_loss(p, sum(_rung(p, model, guess), np.zeros(len(p.residual)))) for guess in guesses]
            search.tell(guesses, losses)
            if min(losses) < square:
                square, found = min(losses), guesses[int(np.argmin(losses))]
        score = _bic(p, square, unknowns)
        if best is None or score < best[0]:
            plain, fallen, loaded = _rung(p, model, found)
            best = (score, _needed(p, fallen, loaded), p.beside_base(plain + fallen + loaded))
    return nothing(p) if best is None or not best[1] else Said(best[1], best[2])


def _loss(p: Problem, torque: Floats) -> float:
    return float(np.mean((p.residual - p.beside_base(torque))[p.training] ** 2))


def _needed(p: Problem, fallen: Floats, loaded: Floats) -> tuple[str, ...]:
    parts = {"stribeck": fallen, "load_dependent_friction": loaded}
    size = {name: float(np.mean(p.beside_base(part)[p.training] ** 2)) for name, part in parts.items()}
    return tuple(name for name in sorted(size, key=lambda name: -size[name]) if size[name] > 0.0)


def _rung(p: Problem, model: str, guess: Floats) -> tuple[Floats, Floats, Floats]:
    """Torque of a model beside the base: corrections of Coulomb and viscous, Stribeck part, part by load.

    The bristle carries the direction; motor torque and inertia's are in shares of their largest.
    """
    _, falls, loads = STEPS[model]
    z, g = p.motion["bristle"], math.sqrt(_left(p, [])) * guess
    speed = p.motion["speed"] / np.abs(p.motion["speed"]).max()
    motor = p.motion["torque"] / np.abs(p.motion["torque"]).max()
    inert = p.motion["acceleration"] / np.abs(p.motion["acceleration"]).max()
    plain, none = g[0] * z + g[1] * speed, np.zeros(len(z))
    if not (falls or loads):
        return plain, none, none
    if model == "M3":
        return plain, none, g[2] * z * np.abs(motor)
    dip = np.exp(-((np.abs(speed) / (0.02 * math.exp(guess[2]))) ** (1.0 + 0.5 * math.tanh(guess[3]))))
    fallen = g[4] * z * dip
    if model == "M2":
        return plain, fallen, none
    if model == "M4":
        return plain, fallen, z * np.abs(motor) * (g[5] + g[6] * dip)
    load = np.abs(g[5] * motor + g[6] * inert) * math.copysign(1.0, guess[5])
    dipped = np.abs(g[7] * motor + g[8] * inert) * dip
    if model == "M6":
        load = load + g[9] * motor**2 + g[10] * inert**2
    return plain, fallen, z * (load + dipped)


Rival = Callable[[Problem, float], Said]
RIVALS: Mapping[str, tuple[str, Rival]] = MappingProxyType(
    {"stepwise BIC": ("numpy", stepwise), "PySINDy": ("pysindy", sindy), "gplearn": ("gplearn", genetic),
     "CMA-ES M1 to M6": ("cma", ladder)}
)  # fmt: skip
"""Name, module that it needs, and what it does."""
