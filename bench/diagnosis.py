"""Bench of the diagnosis on the simulated axis: planted effects, nothing planted, aliens, pairs.

    python -m bench.diagnosis singles --runs 3 --seed 5000
    python -m bench.diagnosis nulls --runs 20
    python -m bench.diagnosis pairs | aliens | removed

Every line on standard output is one run, as JSON; a summary ends it. Seeds below 5000 were used while
thresholds were chosen, those from 5000 on only for the figures in docs/benchmarks.md.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from autotune.diagnosis.candidates import model_from
from autotune.diagnosis.verdict import Diagnosis, diagnose
from autotune.estimation.data import TEST, TRAINING
from autotune.estimation.residual import residual
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.effect import Kind
from autotune.models.table import EFFECTS as LIBRARY
from autotune.recordings.recording import Recording
from autotune_sim.presets import Preset
from bench.diagnosis_summary import summary
from tests.support.axes import ALIENS, MEDIUM, NOMINAL, plain_axis, planted_size
from tests.support.diagnosis_programme import play
from tests.support.truth import coefficient_error, true_model


@dataclass(frozen=True, slots=True)
class Run:
    """One diagnosis: what was planted and what came out.

    Attributes:
        ratio: repeatable residual over noise before anything is added.
        rank: of the effect that was planted first, 1 for the best; 0 where it is not a candidate.
        test: error on the test trajectory over that of the true model; nan where not known.
        coefficients: relative errors of the sizes of what was planted and named.
    """

    planted: tuple[str, ...]
    result: Diagnosis
    ratio: float
    seconds: float
    rank: int
    test: float = math.nan
    coefficients: tuple[float, ...] = ()


def judge(
    recording: Recording,
    planted: tuple[str, ...],
    axis: Preset | None = None,
    candidates: Sequence[Kind] | None = None,
) -> Run:
    """Diagnoses a recording with the nominal model; `axis` where the truth is in the library.

    `candidates` are all effects of the library where None.
    """
    start = time.process_time()
    result = diagnose([recording], base_model(NOMINAL), candidates=candidates)
    seconds = time.process_time() - start
    order = [c.effect for c in sorted(result.candidates, key=lambda c: -c.gain)]
    rank = order.index(planted[0]) + 1 if planted and planted[0] in order else 0
    if axis is None or set(result.effects) != set(planted):
        return Run(planted, result, _ratio(result), seconds, rank)
    truth = true_model(axis.plant, planted)
    return Run(
        planted,
        result,
        _ratio(result),
        seconds,
        rank,
        _against(result, truth),
        _coefficients(result, truth, planted),
    )


def _against(result: Diagnosis, truth: DriveModel) -> float:
    """Error on the test trajectory over that of the true model."""
    problem = result.problem
    if problem is None:
        return math.nan
    packed = truth.pack()
    right = residual(problem.data, packed, problem.moved) - problem.correction(packed).bias
    return result.error_test / math.sqrt(problem.mean_square(right, TEST))


def _coefficients(result: Diagnosis, truth: DriveModel, planted: tuple[str, ...]) -> tuple[float, ...]:
    if result.model_fit is None:
        return ()
    found = model_from(base_model(NOMINAL), result.model_fit.fitted.packed, result.model_fit.free)
    return tuple(coefficient_error(found, truth, effect) for effect in planted)


def _ratio(result: Diagnosis) -> float:
    problem, root = result.problem, result.root
    if problem is None or root is None:
        return math.nan
    variance, _ = problem.repeatable(root.fitted.error, root.correction, TRAINING)
    noise = problem.noise_variance(root.fitted.error, TRAINING)
    return math.copysign(math.sqrt(abs(variance) / noise), variance)


def as_line(run: Run, size: float) -> dict[str, Any]:
    """What is kept of a run; errors in mN m."""
    r = run.result
    best = sorted(r.candidates, key=lambda c: -c.gain)[:3]
    return {
        "planted": list(run.planted),
        "size": size,
        "verdict": r.verdict,
        "effects": list(r.effects),
        "confidence": r.confidence,
        "rank": run.rank,
        "ratio": round(run.ratio, 2),
        "seconds": round(run.seconds, 1),
        "over_truth": round(run.test, 3),
        "coefficients": [round(100 * c, 1) for c in run.coefficients],
        "test": round(r.error_test * 1e3, 2),
        "floor": round(r.noise_floor_rms * 1e3, 2),
        "best": [f"{c.effect}: {c.gain:.2f}, {c.why}" for c in best],
    }


def singles(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    for number in range(runs):
        for i, (effect, medium) in enumerate(MEDIUM.items()):
            if names and effect not in names:
                continue
            own = seed + 100 * number + i
            axis = plain_axis(own, {effect: planted_size(effect, medium * size)})
            yield judge(play(axis, own), (effect,), axis)


def nulls(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    for number in range(runs):
        yield judge(play(plain_axis(seed + number), seed + number), ())


def pairs(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    every = list(MEDIUM)
    for number in range(runs):
        random = np.random.default_rng([seed, number])
        one, two = (names or random.choice(every, 2, replace=False).tolist())[:2]
        axis = plain_axis(
            seed + number, {name: planted_size(name, MEDIUM[name] * size) for name in (one, two)}
        )
        yield judge(play(axis, seed + number), (one, two), axis)


def removed(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    """The library lacks what was planted; nothing may be named."""
    for number in range(runs):
        for i, (effect, medium) in enumerate(MEDIUM.items()):
            if names and effect not in names:
                continue
            own = seed + 100 * number + i
            recording = play(plain_axis(own, {effect: planted_size(effect, medium * size)}), own)
            others = [kind for name, kind in LIBRARY.items() if name != effect]
            yield judge(recording, (f"-{effect}",), candidates=others)


def aliens(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    for number in range(runs):
        for i, (name, alien) in enumerate(ALIENS.items()):
            if names and name not in names:
                continue
            own = seed + 100 * number + i
            yield judge(play(plain_axis(own), own, alien=alien()), (f"alien {name}",))


KINDS: dict[str, Callable[[int, int, float, list[str]], Iterator[Run]]] = {
    "singles": singles, "nulls": nulls, "pairs": pairs, "removed": removed,
    "aliens": aliens,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kind", choices=list(KINDS))
    parser.add_argument("names", nargs="*")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=5000)
    parser.add_argument("--size", type=float, default=1.0)
    given = parser.parse_args()
    lines = []
    for run in KINDS[given.kind](given.runs, given.seed, given.size, given.names):
        lines.append(as_line(run, given.size))
        print(json.dumps(lines[-1]), flush=True)
    print(summary(lines), file=sys.stderr)


if __name__ == "__main__":
    main()
