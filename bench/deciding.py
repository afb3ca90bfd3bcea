"""Bench of the deciding experiment: a diagnosis in doubt, the programme it asks for, and the verdict after it.

    python -m bench.deciding --runs 24 --seed 40000

Each run plants one effect or none on the simulated axis, records the identification programme once, and diagnoses
it. Where the verdict leaves something open, `autotune record AXIS decide` is played as the diagnosis asks, and both
recordings are diagnosed together. Every line on standard output is one run, as JSON; a summary ends it. Seeds below
40000 were used while the method was made.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

import numpy as np

from autotune.core.errors import AutotuneError
from autotune.diagnosis.verdict import Diagnosis, diagnose
from autotune.tuning.question import rivals_of
from bench.single import fitted
from tests.support.axes import MEDIUM, plain_axis, planted_size
from tests.support.identification_programme import play

NULL_SHARE = 0.2
FIRST = ("identification",)


def run(seed: int) -> dict[str, Any]:
    """One axis: the first verdict, what it asks for, the second verdict."""
    random = np.random.default_rng([seed, 3])
    null = random.uniform() < NULL_SHARE
    effect, size = str(random.choice(sorted(MEDIUM))), float(random.choice([0.7, 1.0, 1.5]))
    planted = {} if null else {effect: planted_size(effect, size * MEDIUM[effect])}
    axis = plain_axis(seed, planted)
    line: dict[str, Any] = {"seed": seed, "planted": sorted(planted), "size": size}
    began = time.process_time()
    try:
        first = play(axis, seed, FIRST)
        model = fitted(first)
        found = diagnose([first], model)
        line["first"] = told(found)
        rivals = rivals_of(line["first"])
        line["rivals"] = None if rivals is None else list(rivals)
        if rivals is not None:
            second = play(axis, seed + 500_000, ("decide",), rivals)
            line["played"] = round(len(second) * second.period, 1)
            line["second"] = told(diagnose([first, second], model))
    except AutotuneError as refused:
        line["refused"] = str(refused)
    line["seconds"] = round(time.process_time() - began, 1)
    return line


def told(found: Diagnosis) -> dict[str, Any]:
    candidates = sorted(found.candidates, key=lambda one: -one.gain)[:5]
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "confidence": found.confidence,
        "confusable": [list(rivals) for rivals in found.confusable],
        "candidates": [{"effect": one.effect, "gain": round(one.gain, 3), "why": one.why} for one in candidates],
    }  # fmt: skip


def right(line: dict[str, Any], found: dict[str, Any]) -> bool:
    """The planted effect and nothing else is named; nothing where nothing was planted."""
    return found["effects"] == line["planted"] and found["verdict"] in ("named", "none")


def summary(lines: list[dict[str, Any]]) -> str:
    asked = [one for one in lines if "second" in one]
    doubted = [one for one in asked if one["first"]["verdict"] == "ambiguous"]
    rows = [
        f"{len(lines)} runs, {sum('refused' in one for one in lines)} refused; "
        f"{sum(right(one, one['first']) for one in lines if 'first' in one)} right at once"
    ]
    for name, some in (("left open", asked), ("ambiguous", doubted)):
        after = [one["second"] for one in some]
        good = sum(right(one, one["second"]) for one in some)
        sure = sum(one["confidence"] == "confirmed" for one in after)
        wrong = sum(bool(set(one["second"]["effects"]) - set(one["planted"])) for one in some)
        before = sum(right(one, one["first"]) for one in some)
        rows.append(
            f"{name} {len(some)}: right before {before}, after {good} ({sure} confirmed), wrong name {wrong}"
        )
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=40_000)
    given = parser.parse_args()
    lines = []
    for number in range(given.runs):
        lines.append(run(given.seed + number))
        print(json.dumps(lines[-1]), flush=True)
    print(summary(lines), file=sys.stderr)


if __name__ == "__main__":
    main()
