"""What each threshold of the policy decides: verdicts on a fixed batch with it at 0.7 and at 1.4 times its value.

    python -m bench.thresholds [NAME...] [--workers 2] [--out FILE.json]

The batch is small and fixed, of development seeds (below 5000): planted effects of several sizes, nothing, pairs, a
true effect that is not among the candidates, effects outside the library, recordings without repeats. Changed is a
verdict, a name or a confidence. What is printed is the table of `docs/thresholds.md`.

A run notes every comparison with a threshold: where none would turn out otherwise, the changed threshold gives the same
run, and nothing is computed. Fits do not depend on thresholds; those that come again are remembered.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import operator
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
    (problem.Problem, "correction"),
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
    Case("dwell time", 313, (("dwell_time_break_away", 1.0),)),
    Case("backlash", 310, (("backlash", 1.0),)),
    Case("Stribeck, not a candidate", 382, (("stribeck", 1.0),), without="stribeck"),
    Case("a disturbance in time", 391, alien="mains"),
    Case("a law that is unknown", 390, alien="dip"),
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


class Watched(np.float64):
    """A threshold that notes what would be decided otherwise with it at 0.7 and at 1.4 times its value.

    Where no comparison of a run would be, the changed threshold gives the same run: nothing need be computed.
    """

    __array_ufunc__ = None
    turned: ClassVar[set[tuple[str, float]]] = set()
    others: dict[str, tuple[Any, ...]]

    def __new__(cls, value: float, others: dict[str, tuple[Any, ...]]) -> Watched:
        made = super().__new__(cls, value)
        made.others = others
        return made

    def _by_threshold(self, other: Any, of: Callable[[Any, Any], Any]) -> dict[str, tuple[Any, ...]]:
        """The result with each of the thresholds changed that this number or the other comes from."""
        plain = other if isinstance(other, np.ndarray) else float(other)
        own, his = self.others, getattr(other, "others", {})
        same, alike = (float(self),) * len(FACTORS), (plain,) * len(FACTORS)
        return {
            name: tuple(of(a, b) for a, b in zip(own.get(name, same), his.get(name, alike), strict=True))
            for name in own.keys() | his.keys()
        }

    def _made(self, other: Any, of: Callable[[Any, Any], Any]) -> Watched:
        return Watched(of(float(self), float(other)), self._by_threshold(other, of))

    def _asked(self, other: Any, of: Callable[[Any, Any], Any]) -> Any:
        value = of(float(self), other if isinstance(other, np.ndarray) else float(other))
        for name, variants in self._by_threshold(other, of).items():
            for factor, variant in zip(FACTORS, variants, strict=True):
                if not np.array_equal(variant, value):
                    Watched.turned.add((name, factor))
        return value

    def __mul__(self, other: Any) -> Any:
        return self._made(other, operator.mul)

    __rmul__ = __mul__

    def __add__(self, other: Any) -> Any:
        return self._made(other, operator.add)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self._made(other, operator.sub)

    def __rsub__(self, other: Any) -> Any:
        return self._made(other, lambda a, b: b - a)

    def __truediv__(self, other: Any) -> Any:
        return self._made(other, operator.truediv)

    def __pow__(self, other: Any, _: Any = None) -> Any:
        return self._made(other, operator.pow)

    def __lt__(self, other: Any) -> Any:
        return self._asked(other, operator.lt)

    def __le__(self, other: Any) -> Any:
        return self._asked(other, operator.le)

    def __gt__(self, other: Any) -> Any:
        return self._asked(other, operator.gt)

    def __ge__(self, other: Any) -> Any:
        return self._asked(other, operator.ge)


NOT_WATCHED = ("rest_ratio", "surrogates_beaten", "term_chance")
"""Used in functions that a watched number does not pass through; likewise whole numbers."""


class Noting(Policy):
    """The policy with thresholds that are watched; `asked` are those that a run has used."""

    asked: ClassVar[set[str]] = set()

    def __getattribute__(self, name: str) -> Any:
        Noting.asked.add(name)
        value = super().__getattribute__(name)
        if name.startswith("__") or not watched(name):
            return value
        return Watched(value, {name: tuple(scaled_value(name, factor) for factor in FACTORS)})


def watched(name: str) -> bool:
    """Whether comparisons with a threshold can be followed."""
    return name not in NOT_WATCHED and not isinstance(getattr(POLICY, name), int)


def scaled_value(name: str, factor: float) -> float:
    """A threshold changed by a factor; of shares near 1 what they leave, and whole numbers by one at least."""
    value = getattr(POLICY, name)
    if isinstance(value, int):
        new = round(factor * value)
        return new if new != value else value + (1 if factor > 1.0 else -1)
    return 1.0 - (1.0 - value) / factor if 0.5 < value < 1.0 else float(factor * value)


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
        Watched.turned.clear()
        usual = verdict_of(case, recordings, Noting())
        asked, turned = [name for name in names if name in Noting.asked], frozenset(Watched.turned)
        other = {
            f"{name} x {factor}": verdict_of(
                case, recordings, replace(POLICY, **{name: scaled_value(name, factor)})
            )
            for name in asked
            for factor in FACTORS
            if not watched(name) or (name, factor) in turned
        }
    changed = {key: verdict for key, verdict in other.items() if verdict != usual}
    return {"case": case.name, "verdict": usual, "asked": asked, "tried": list(other), "changed": changed}


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
