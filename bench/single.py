"""Bench of the diagnosis on recordings as others make them: one trajectory, no repeats, often no controller.

    python -m bench.single --runs 24 --seed 30000

Each run plants one effect or none on the simulated axis, plays two different trajectories once, dresses the
recording (sampling, units, encoder, columns), fits a model to the first and diagnoses it with the first alone
and with both. Every line on standard output is one run, as JSON; a summary ends it. Seeds below 30000 were
used while the method was made.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from autotune.core.errors import AutotuneError
from autotune.diagnosis.candidates import no_progress
from autotune.diagnosis.fit_recordings import fit_recordings
from autotune.diagnosis.fitting import fit_model
from autotune.diagnosis.verdict import Diagnosis, diagnose
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording
from tests.support.axes import MEDIUM, plain_axis, planted_size
from tests.support.recorded_once import DRESSES, TRAJECTORIES, Dress, played

NULL_SHARE = 0.3
PLANTED = tuple(name for name in MEDIUM if name not in ("torque_lag", "encoder_eccentricity"))
"""What one trajectory can show."""


@dataclass(frozen=True, slots=True)
class Case:
    """What one run is: drawn from its seed."""

    seed: int
    planted: tuple[str, ...]
    size: float
    dress: Dress
    kinds: tuple[str, str]


def case(seed: int, plain: bool = False) -> Case:
    random = np.random.default_rng([seed, 1])
    null = random.uniform() < NULL_SHARE
    effect = str(random.choice(PLANTED))
    size = float(random.choice([0.7, 1.0, 1.5]))
    dress = DRESSES[int(random.integers(len(DRESSES)))]
    one, two = random.choice(list(TRAJECTORIES), 2, replace=False).tolist()
    return Case(seed, () if null else (effect,), size, DRESSES[0] if plain else dress, (str(one), str(two)))


def run(one: Case, seconds: float) -> dict[str, Any]:
    """Fits a model to the first trajectory, then diagnoses it, and with both."""
    effects = {name: planted_size(name, one.size * MEDIUM[name]) for name in one.planted}
    axis = plain_axis(one.seed, effects)
    first, second = (
        played(axis, one.dress, kind, one.seed + 7 * i, seconds) for i, kind in enumerate(one.kinds)
    )
    line: dict[str, Any] = {
        "seed": one.seed, "planted": list(one.planted), "size": one.size, "dress": one.dress.name,
        "kinds": list(one.kinds),
    }  # fmt: skip
    began = time.process_time()
    try:
        model = fitted(first)
        line["alone"] = told(diagnose([first], model))
        line["both"] = told(diagnose([first, second], model))
    except AutotuneError as refused:
        line["refused"] = str(refused)
    line["seconds"] = round(time.process_time() - began, 1)
    return line


def fitted(recording: Recording) -> DriveModel:
    """The model that the command line would write, else that of the search."""
    result = fit_recordings([recording], progress=no_progress)
    return result.model if result.model is not None and result.valid else fit_model([recording]).model


def told(result: Diagnosis) -> dict[str, Any]:
    best = sorted(result.candidates, key=lambda c: -c.gain)[:4]
    return {
        "verdict": result.verdict,
        "effects": list(result.effects),
        "confidence": result.confidence,
        "twin": result.twin,
        "confusable": [list(rivals) for rivals in result.confusable],
        "best": [f"{c.effect} {100 * c.gain:.0f}" for c in best],
        "notes": [note for note in result.notes if "Carried" in note or "controller" in note],
    }


def _wrong(line: dict[str, Any], found: dict[str, Any]) -> bool:
    """Whether something is named that is not there, and not in doubt with what is there.

    On an axis in metres an imbalance is a ripple.
    """
    planted = set(line["planted"])
    if line["dress"] == "metres" and "gravity_imbalance" in planted:
        planted.add("torque_ripple")
    doubted = found["verdict"] == "ambiguous" and planted & set(found["confusable"][0])
    return bool(set(found["effects"]) - planted) and not doubted


def summary(lines: list[dict[str, Any]]) -> str:
    """Wrong names, wrong confirmed ones, nulls named, right ones; by number of files."""
    rows = [f"{len(lines)} runs, {sum('refused' in one for one in lines)} refused"]
    for files in ("alone", "both"):
        done = [one for one in lines if files in one]
        nulls = [one for one in done if not one["planted"]]
        planted = [one for one in done if one["planted"]]
        wrong = [one for one in done if _wrong(one, one[files])]
        sure = [one for one in wrong if one[files]["confidence"] == "confirmed"]
        right = [one for one in planted if one[files]["effects"] == one["planted"]]
        proven = [one for one in right if one[files]["confidence"] == "confirmed"]
        rows.append(
            f"{files}: nulls {len(nulls)}, named {sum(bool(one[files]['effects']) for one in nulls)}; planted "
            f"{len(planted)}, right {len(right)}, confirmed {len(proven)}; wrong name {len(wrong)}, confirmed "
            f"{len(sure)}: seeds {[one['seed'] for one in wrong]}"
        )
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=30_000)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--plain", action="store_true", help="always 1 kHz with reference and controller")
    given = parser.parse_args()
    lines = list(_lines(given.runs, given.seed, given.seconds, given.plain))
    print(summary(lines), file=sys.stderr)


def _lines(runs: int, seed: int, seconds: float, plain: bool) -> Iterator[dict[str, Any]]:
    for number in range(runs):
        line = run(case(seed + number, plain), seconds)
        print(json.dumps(line), flush=True)
        yield line


if __name__ == "__main__":
    main()
