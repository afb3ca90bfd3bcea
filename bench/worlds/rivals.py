"""Rivals on the same data: what each names, misses and invents.

    python -m bench.worlds.rivals --seed 0 --cases 16 --nulls 8 --seconds 7 --out rivals.jsonl

Stepwise regression with BIC is always there; PySINDy, gplearn and cma where they are installed (the extra `bench`).
PySR is not run: it needs Julia. Each gets the recording's training rows, a base fit and columns named by effect (see
`rival_features`); the time is that of the diagnosis.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.worlds.cases import draw_case, ready
from bench.worlds.play import RanAway, whole
from bench.worlds.rival_features import Problem, problem
from bench.worlds.world import Floats

Rival = Callable[[Problem, float], list[str]]
LEAST = 0.02
"""Of the residual's variance: what explains less is not named."""


def stepwise(p: Problem, seconds: float) -> list[str]:
    """Forward selection with BIC; effects in the order in which they came in."""
    chosen: list[int] = []
    n, names = len(p.residual), []
    square = float(np.mean(p.residual**2))
    until = time.process_time() + seconds
    while len(chosen) < 12 and time.process_time() < until:
        scores = [(_left(p, [*chosen, i]), i) for i in range(len(p.names)) if i not in chosen]
        best, i = min(scores)
        if n * math.log(best / square) + math.log(n) >= 0.0:
            break
        names += [p.names[i]] if p.names[i] not in names else []
        chosen.append(i)
        square = best
    return names


def _left(p: Problem, chosen: Sequence[int]) -> float:
    columns = p.columns[:, list(chosen)]
    found = np.linalg.lstsq(columns, p.residual, rcond=None)[0]
    return float(np.mean((p.residual - columns @ found) ** 2))


def sindy(p: Problem, seconds: float) -> list[str]:
    """PySINDy's sequentially thresholded least squares; threshold a tenth of the residual's rms."""
    import pysindy

    size = float(np.sqrt(np.mean(p.residual**2)))
    fit = pysindy.STLSQ(threshold=0.1 * size, alpha=1e-3, max_iter=30)
    fit.fit(p.columns, p.residual[:, None])
    weights = np.abs(np.asarray(fit.coef_)[0])
    order = [i for i in np.argsort(-weights) if weights[i] > 0.0]
    return list(dict.fromkeys(p.names[i] for i in order))


def genetic(p: Problem, seconds: float) -> list[str]:
    """gplearn on the residual over the motion; the formula is named by the columns that it is most like."""
    from gplearn.genetic import SymbolicRegressor

    scales = {name: max(float(np.abs(values).max()), 1e-300) for name, values in p.motion.items()}
    inputs = np.column_stack([values / scales[name] for name, values in p.motion.items()])
    rows = np.arange(0, len(inputs), max(len(inputs) // 2000, 1))
    until, best = time.process_time() + seconds, None
    model = SymbolicRegressor(
        population_size=400, generations=1, function_set=("add", "sub", "mul", "div", "sin", "cos", "abs", "sqrt"),
        parsimony_coefficient=1e-4, metric="rmse", random_state=1, warm_start=True,
    )  # fmt: skip
    target = p.residual / max(float(np.sqrt(np.mean(p.residual**2))), 1e-300)
    while time.process_time() < until and model.generations < 40:
        model.fit(inputs[rows], target[rows])
        best = np.asarray(model.predict(inputs))
        model.generations += 1
    if best is None or not np.all(np.isfinite(best)) or float(np.std(best)) == 0.0:
        return []
    best = best - p.base @ np.linalg.lstsq(p.base, best, rcond=None)[0]
    explained = float(np.corrcoef(best, target)[0, 1]) ** 2
    return [_most_like(p, best)] if explained > LEAST else []


def _most_like(p: Problem, shape: Floats) -> str:
    groups = {name: [i for i, own in enumerate(p.names) if own == name] for name in set(p.names)}

    def left(name: str) -> float:
        columns = p.columns[:, groups[name]]
        return float(np.mean((shape - columns @ np.linalg.lstsq(columns, shape, rcond=None)[0]) ** 2))

    return min(sorted(groups), key=left)


LADDER: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("M1", ()), ("M2", ("stribeck",)), ("M3", ("load_dependent_friction",)),
    ("M4", ("load_dependent_friction", "stribeck")),
    ("M5", ("load_dependent_friction", "direction_asymmetry", "stribeck")),
    ("M6", ("load_dependent_friction", "nonlinear_viscous", "stribeck")),
)  # fmt: skip


def ladder(p: Problem, seconds: float) -> list[str]:
    """Extended friction models M1 to M6 (after BAM) fitted by CMA-ES; the step that BIC likes best is named."""
    import cma

    n, share = len(p.residual), seconds / len(LADDER)
    best: tuple[float, tuple[str, ...]] = (math.inf, ())
    for _, effects in LADDER:
        until = time.process_time() + share
        unknowns = 2 + 3 * len(effects)
        search = cma.CMAEvolutionStrategy(np.zeros(unknowns), 0.3, {"seed": 1, "verbose": -9})
        square = math.inf
        while time.process_time() < until and not search.stop():
            guesses = search.ask()
            losses = [float(np.mean((p.residual - _rung(p, effects, guess)) ** 2)) for guess in guesses]
            search.tell(guesses, losses)
            square = min(square, *losses)
        score = n * math.log(max(square, 1e-300)) + unknowns * math.log(n)
        if score < best[0]:
            best = (score, effects)
    return list(best[1])


def _rung(p: Problem, effects: tuple[str, ...], guess: Floats) -> Floats:
    """Torque of a step of the ladder: corrections of Coulomb and viscous, and two or three shapes for each effect."""
    size = float(np.sqrt(np.mean(p.residual**2)))
    speed = p.motion["speed"] / max(float(np.abs(p.motion["speed"]).max()), 1e-300)
    z, load = p.motion["bristle"], p.motion["torque"] / max(float(np.abs(p.motion["torque"]).max()), 1e-300)
    out = size * (guess[0] * z + guess[1] * speed)
    for i, name in enumerate(effects):
        a, b, c = guess[2 + 3 * i : 5 + 3 * i]
        if name == "stribeck":
            out = out + size * a * z * np.exp(
                -((np.abs(speed) / (0.02 * math.exp(b))) ** (1.0 + 0.5 * math.tanh(c)))
            )
        elif name == "load_dependent_friction":
            out = out + size * z * (a * np.abs(load) + b * load * z + c)
        elif name == "direction_asymmetry":
            out = out + size * (a * np.abs(z) + b * np.abs(speed) + c * np.abs(z) * np.abs(load))
        else:
            out = out + size * (a * speed * np.abs(speed) + b * z * load**2 + c * speed**3)
    return np.asarray(out)


RIVALS: dict[str, tuple[str, Rival]] = {
    "stepwise BIC": ("numpy", stepwise), "PySINDy": ("pysindy", sindy), "gplearn": ("gplearn", genetic),
    "CMA-ES M1-M6": ("cma", ladder),
}  # fmt: skip


def installed() -> dict[str, Rival]:
    return {name: rival for name, (module, rival) in RIVALS.items() if importlib.util.find_spec(module)}


def run(kind: str, seed: int, seconds: float) -> dict[str, Any] | None:
    """What each rival says of one case, best first."""
    try:
        made = ready(draw_case(kind, seed))
    except RanAway:
        return None
    given = problem(whole(made.world))
    line: dict[str, Any] = {"key": made.case.key, "kind": kind, "truth": list(made.case.truth)}
    for name, rival in installed().items():
        began = time.process_time()
        try:
            line[name] = {"names": rival(given, seconds)}
        except Exception as failed:  # noqa: BLE001 a rival's failure is its result
            line[name] = {"names": [], "why": repr(failed)}
        line[name]["cpu"] = round(time.process_time() - began, 2)
    return line


def summary(lines: Sequence[dict[str, Any]]) -> str:
    """Names right, wrong, invented, by rival."""
    out = [
        "| rival | named first | only that | a wrong name | nulls with a name | s |",
        "|---|---|---|---|---|---|",
    ]
    for name in RIVALS:
        own = [line for line in lines if name in line]
        planted = [line for line in own if line["truth"]]
        nulls = [line for line in own if not line["truth"]]
        if not own:
            out.append(f"| {name} | not installed | | | | |")
            continue
        first = sum(line[name]["names"][:1] == line["truth"] for line in planted)
        only = sum(line[name]["names"] == line["truth"] for line in planted)
        wrong = sum(bool(set(line[name]["names"]) - set(line["truth"])) for line in planted)
        invented = sum(bool(line[name]["names"]) for line in nulls)
        seconds = np.median([line[name]["cpu"] for line in own])
        out.append(
            f"| {name} | {first} of {len(planted)} | {only} | {wrong} | {invented} of {len(nulls)} | {seconds:.1f} |"
        )
    return "\n".join(out) + "\n"


def main() -> int:
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, default=16)
    parser.add_argument("--nulls", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=7.0, help="processor time for each rival and case")
    parser.add_argument("--out", type=Path, default=Path("rivals.jsonl"))
    given = parser.parse_args()
    wanted = [("single", given.seed + i) for i in range(given.cases)]
    wanted += [("null", given.seed + i) for i in range(given.nulls)]
    lines = [json.loads(text) for text in given.out.read_text().splitlines()] if given.out.exists() else []
    done = {line["key"] for line in lines}
    for kind, seed in wanted:
        if f"{kind}:{seed}" in done:
            continue
        line = run(kind, seed, given.seconds)
        if line is not None:
            lines.append(line)
            with given.out.open("a") as file:
                file.write(json.dumps(line) + "\n")
    sys.stdout.write(summary(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
