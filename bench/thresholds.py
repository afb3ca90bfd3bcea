"""What each threshold of the policy decides: verdicts on a fixed batch with it at 0.7 and at 1.4 times its value.

    python -m bench.thresholds [NAME...] [--workers 2] [--out FILE.json]

The batch is small and fixed, of development seeds (below 5000): planted effects of several sizes, nothing, pairs, a
true effect that is not among the candidates, effects outside the library, recordings without repeats. Changed is a
verdict, a name or a confidence. What is printed is the table of `docs/thresholds.md`. Fits do not depend on thresholds;
those that come again are remembered, which makes a run some times faster and changes none of its numbers.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, fields, is_dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, ClassVar
from unittest import mock

import numpy as np

from autotune.core.errors import AutotuneError
from autotune.diagnosis import screening
from autotune.diagnosis.evidence import single
from autotune.diagnosis.verdict import diagnose
from autotune.estimation import bias_corrected_fit, controller, problem
from autotune.estimation.data import Prepared
from autotune.estimation.policy import POLICY, Policy, thresholds
from autotune.models.drive_model import base_model
from autotune.models.effect import Kind
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Recording
from tests.support.axes import ALIENS, MEDIUM, NOMINAL, plain_axis, planted_size
from tests.support.diagnosis_programme import play, programme

FACTORS = (0.7, 1.4)
REMEMBERED: tuple[tuple[Any, str], ...] = (
    (controller, "_searched"),
    (problem.Study, "correction"),
    (problem, "fit"),
    (screening, "fit"),
    (screening, "held_out"),
    (screening, "_short_fits"),
    (bias_corrected_fit, "fit"),
    (bias_corrected_fit, "held_out"),
    (bias_corrected_fit, "_step_by_step"),
    (single, "held_out"),
)
"""What costs time and does not depend on thresholds."""


@dataclass(frozen=True, slots=True)
class Case:
    """A recording of the batch.

    Attributes:
        planted: effect → multiple of its medium size.
        without: an effect that is not among the candidates.
        files: experiments of each file that is recorded once, without repeats; empty for the whole programme.
        known: whether these name the controller.
    """

    name: str
    seed: int
    planted: tuple[tuple[str, float], ...] = ()
    alien: str = ""
    without: str = ""
    files: tuple[tuple[str, ...], ...] = ()
    known: bool = True


SLOW, FAST = ("sine", "scans", "points"), ("triangles", "multisine", "points")
BATCH = (
    Case("nothing", 360),
    Case("spring of half size", 306, (("spring", 0.5),)),
    Case("elastic transmission and asymmetry", 373, (("elastic_transmission", 1.0), ("direction_asymmetry", 1.0))),
    Case("thermal drift and spring", 371, (("thermal_drift", 1.0), ("spring", 1.0))),
    Case("Stribeck, not a candidate", 382, (("stribeck", 1.0),), without="stribeck"),
    Case("a disturbance in time", 391, alien="mains"),
    Case("nothing, one file", 361, files=(SLOW,), known=False),
    Case("Stribeck, two files", 400, (("stribeck", 1.0),), files=(SLOW, FAST), known=False),
    Case("asymmetry, two files", 402, (("direction_asymmetry", 1.0),), files=(SLOW, FAST), known=False),
    Case("spring, one file", 411, (("spring", 1.0),), files=(("scans", "triangles", "points"),)),
)  # fmt: skip


def recordings_of(case: Case) -> list[Recording]:
    """The files of a case, played on the simulated axis."""
    axis = plain_axis(
        case.seed, {name: planted_size(name, MEDIUM[name] * size) for name, size in case.planted}
    )
    if not case.files:
        return [play(axis, case.seed, alien=ALIENS[case.alien]() if case.alien else None)]
    played = [play(axis, case.seed + i, programme(names, 1)) for i, names in enumerate(case.files)]
    return played if case.known else [one.with_metadata(controller=None) for one in played]


class Remembered:
    """Results of a function by the content of its arguments."""

    def __init__(self) -> None:
        self.results: dict[tuple[Any, ...], Any] = {}
        self.keys: dict[int, tuple[Any, Any]] = {}

    def key(self, thing: Any) -> Any:
        """A hashable stand-in for the content, thresholds left out: they decide nothing in a fit."""
        if thing is None or isinstance(thing, (bool, int, float, str)):
            return thing
        if id(thing) in self.keys:
            return self.keys[id(thing)][1]
        if isinstance(thing, Policy):
            return None
        if isinstance(thing, Kind):
            return thing.name
        if isinstance(thing, np.ndarray):
            return (thing.shape, hashlib.blake2b(np.ascontiguousarray(thing)).hexdigest())
        if isinstance(thing, (tuple, list)):
            return tuple(self.key(one) for one in thing)
        if not is_dataclass(thing):
            return repr(thing)
        found = (type(thing).__name__, *(self.key(getattr(thing, one.name)) for one in fields(thing)))
        if isinstance(thing, Prepared):
            self.keys[id(thing)] = (thing, found)  # it is kept, so that no other gets its id
        return found

    def of(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            if named.get("bias_at") is not None:
                return function(*given, **named)
            key = (
                *(self.key(one) for one in given),
                *((k, self.key(v)) for k, v in sorted(named.items())),
            )
            if key not in self.results:
                self.results[key] = function(*given, **named)
            return self.results[key]

        return call


class Noting(Policy):
    """A policy that notes which of its thresholds were asked: the others decide nothing in this case."""

    asked: ClassVar[set[str]] = set()

    def __getattribute__(self, name: str) -> Any:
        Noting.asked.add(name)
        return super().__getattribute__(name)


def verdict_of(case: Case, recordings: list[Recording], policy: Policy) -> str:
    """Verdict, names and confidence in one line."""
    candidates = [kind for name, kind in EFFECTS.items() if name != case.without]
    try:
        found = diagnose(recordings, base_model(NOMINAL), policy=policy, candidates=candidates)
    except AutotuneError as error:
        return f"refused: {type(error).__name__}"
    return " ".join(filter(None, (found.verdict, " + ".join(found.effects), found.confidence)))


def changed_of(case: Case, names: Iterable[str]) -> dict[str, Any]:
    """The verdict on one case, and every other one that a changed threshold gives."""
    recordings = recordings_of(case)
    memory_of: dict[str, Remembered] = {}
    with ExitStack() as stack:
        for place, name in REMEMBERED:
            memory = memory_of.setdefault(name, Remembered())
            stack.enter_context(mock.patch.object(place, name, memory.of(getattr(place, name))))
        Noting.asked.clear()
        usual = verdict_of(case, recordings, Noting())
        asked = [name for name in names if name in Noting.asked]
        other = {
            f"{name} x {factor}": verdict_of(case, recordings, _scaled(name, factor))
            for name in asked
            for factor in FACTORS
        }
    return {
        "case": case.name,
        "verdict": usual,
        "asked": asked,
        "changed": {k: v for k, v in other.items() if v != usual},
    }


def _scaled(name: str, factor: float) -> Policy:
    """The policy with one threshold changed; shares stay below 1, numbers of things stay whole."""
    value = getattr(POLICY, name)
    new = factor * value
    if isinstance(value, int):
        new = round(new) if round(new) != value else value + (1 if factor > 1.0 else -1)
    elif 0.5 < value < 1.0:
        new = 1.0 - (1.0 - value) / factor  # what is left to explain is changed by the factor
    return replace(POLICY, **{name: new})


def table(results: list[dict[str, Any]], names: Iterable[str]) -> str:
    """The table of thresholds in Markdown: in how many cases it was asked, and what changed at each factor."""
    lines = ["| threshold | value | asked | at 0.7 | at 1.4 |", "|---|---|---|---|---|"]
    values = {one.name: one for one in thresholds()}
    for name in names:
        cells = []
        for factor in FACTORS:
            said = [
                f"{r['case']}: {r['changed'][key]}"
                for r in results
                if (key := f"{name} x {factor}") in r["changed"]
            ]
            cells.append("; ".join(said) or "–")
        asked = sum(name in r["asked"] for r in results)
        lines.append(f"| `{name}` | {values[name].value:g} | {asked} | {cells[0]} | {cells[1]} |")
    return "\n".join(lines)


def _job(given: tuple[Case, tuple[str, ...]]) -> dict[str, Any]:
    return changed_of(*given)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", help="thresholds; all where none is named")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    names = tuple(given.names) or tuple(one.name for one in thresholds())
    results = []
    with get_context("spawn").Pool(given.workers, maxtasksperchild=1) as pool:
        for result in pool.imap(_job, [(case, names) for case in BATCH], chunksize=1):
            results.append(result)
            print(f"{result['case']}: {result['verdict']}; {len(result['changed'])} changed", flush=True)
            if given.out:
                given.out.write_text(json.dumps(results, indent=1))
    print(table(results, names))


if __name__ == "__main__":
    main()
