"""Bench of the diagnosis on the simulated axis: planted effects, nothing planted, aliens, pairs.

    python bench/diagnosis.py singles --runs 3 --seed 5000
    python bench/diagnosis.py nulls --runs 20
    python bench/diagnosis.py pairs | aliens | removed

Seeds from 5000 on were not used to choose thresholds. Every line is one run; a summary ends it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "sim")]

from diagnosis_data import play  # noqa: E402

from autotune.core.recording import Recording  # noqa: E402
from autotune.diagnose import families  # noqa: E402
from autotune.diagnose.prepared import TRAINING  # noqa: E402
from autotune.diagnose.verdict import Diagnosis, diagnose  # noqa: E402
from autotune.models.drive_model import DriveModel, base_model  # noqa: E402
from autotune_sim.presets import Preset, preset  # noqa: E402

MEDIUM = {
    "torque_ripple": 0.01, "direction_asymmetry": 0.06, "stribeck": 0.04, "nonlinear_viscous": 0.02,
    "position_dependent_friction": 0.15, "gravity_imbalance": 0.015, "spring": 0.004,
    "reversal_memory": 0.06, "thermal_drift": 0.03, "elastic_transmission": 0.01, "backlash": 4e-3,
    "torque_lag": 5e-4, "torque_saturation": 0.2, "dwell_time_break_away": 0.08,
    "load_dependent_friction": 0.15, "encoder_eccentricity": 8e-3,
}  # fmt: skip
NOMINAL = {
    "inertia": 6.66e-4, "viscous": 4.13e-3, "coulomb": 0.30, "stiffness": 100.0, "micro_damping": 0.05,
    "offset": 0.048,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Run:
    """One diagnosis: what was planted and what came out."""

    planted: tuple[str, ...]
    result: Diagnosis
    ratio: float
    seconds: float
    rank: int


def plain_axis(seed: int, effects: Mapping[str, float] | None = None) -> Preset:
    """A LuGre axis without Stribeck effect, every parameter within ±20 %, with planted effects."""
    axis = preset("lugre", seed=seed, effects=effects)
    bristle = axis.plant.bristle
    if bristle is None:
        raise ValueError("the preset 'lugre' has a bristle")
    return replace(axis, plant=replace(axis.plant, bristle=replace(bristle, break_away=bristle.coulomb)))


def judge(recording: Recording, planted: tuple[str, ...], model: DriveModel | None = None) -> Run:
    """Diagnoses a recording with the nominal model."""
    start = time.process_time()
    result = diagnose([recording], model or base_model(NOMINAL))
    seconds = time.process_time() - start
    order = [c.effect for c in sorted(result.candidates, key=lambda c: -c.gain)]
    rank = order.index(planted[0]) + 1 if planted and planted[0] in order else 0
    return Run(planted, result, _ratio(result), seconds, rank)


def _ratio(result: Diagnosis) -> float:
    study, root = result.study, result.root
    if study is None or root is None:
        return math.nan
    variance, _ = study.repeatable(root.fitted.error, root.correction, TRAINING)
    noise = study.noise_variance(root.fitted.error, TRAINING)
    return math.copysign(math.sqrt(abs(variance) / noise), variance)


def report(run: Run) -> None:
    r = run.result
    best = [f"{c.effect}:{c.gain:.2f}" for c in sorted(r.candidates, key=lambda c: -c.gain)[:3]]
    shown = {
        "planted": "+".join(run.planted), "verdict": r.verdict, "effects": "+".join(r.effects),
        "confidence": r.confidence, "rank": run.rank, "ratio": round(run.ratio, 2),
        "seconds": round(run.seconds, 1), "best": best, "test": round(r.error_test * 1e3, 2),
        "floor": round(r.noise_floor_rms * 1e3, 2), "why": [c.why for c in r.candidates[:2]],
    }  # fmt: skip
    print(json.dumps(shown), flush=True)


def singles(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    for number in range(runs):
        for i, (effect, medium) in enumerate(MEDIUM.items()):
            if names and effect not in names:
                continue
            own = seed + 100 * number + i
            axis = plain_axis(own, {effect: medium * size})
            yield judge(play(axis, own), (effect,))


def nulls(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    for number in range(runs):
        yield judge(play(plain_axis(seed + number), seed + number), ())


def pairs(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    every = list(MEDIUM)
    for number in range(runs):
        random = np.random.default_rng([seed, number])
        one, two = (names or random.choice(every, 2, replace=False).tolist())[:2]
        axis = plain_axis(seed + number, {one: MEDIUM[one] * size, two: MEDIUM[two] * size})
        yield judge(play(axis, seed + number), (one, two))


def removed(runs: int, seed: int, size: float, names: list[str]) -> Iterator[Run]:
    """The library lacks what was planted; nothing may be named."""
    for number in range(runs):
        for i, (effect, medium) in enumerate(MEDIUM.items()):
            if names and effect not in names:
                continue
            own = seed + 100 * number + i
            recording = play(plain_axis(own, {effect: medium * size}), own)
            kept = {name: f for name, f in families.FAMILIES.items() if name != effect}
            with mock.patch("autotune.diagnose.search.FAMILIES", kept):
                yield judge(recording, (f"-{effect}",))


def _dip(time: float, position: float, velocity: float, acceleration: float) -> float:
    return -0.05 * velocity * math.exp(-((velocity / 1.5) ** 2))


def _crank(time: float, position: float, velocity: float, acceleration: float) -> float:
    return -1.5e-4 * acceleration * math.cos(2 * position)


def _uneven_oil(time: float, position: float, velocity: float, acceleration: float) -> float:
    return -0.006 * velocity * math.sin(position)


def _mains(time: float, position: float, velocity: float, acceleration: float) -> float:
    return 0.012 * math.sin(2 * math.pi * 7.3 * time)


class _Creep:
    """A dashpot behind a spring: torque follows velocity late."""

    def __init__(self) -> None:
        self.late = 0.0

    def __call__(self, time: float, position: float, velocity: float, acceleration: float) -> float:
        self.late += 1e-3 / 0.3 * (velocity - self.late)
        return -0.01 * self.late


ALIENS = {"dip": lambda: _dip, "crank": lambda: _crank, "uneven_oil": lambda: _uneven_oil,
          "mains": lambda: _mains, "creep": _Creep}  # fmt: skip


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
    done = []
    for run in KINDS[given.kind](given.runs, given.seed, given.size, given.names):
        report(run)
        done.append(run)
    right = sum(set(r.result.effects) == set(r.planted) and r.result.verdict == "named" for r in done)
    wrong = sum(bool(set(r.result.effects) - set(r.planted)) for r in done)
    print(f"{given.kind}: {len(done)} runs, right {right}, with a wrong name {wrong}, "
          f"median {np.median([r.seconds for r in done]):.1f} s")  # fmt: skip


if __name__ == "__main__":
    main()
