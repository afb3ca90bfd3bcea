"""Rivals on the same data: what each names, misses and invents, beside this project's diagnosis.

    python -m bench.worlds.rivals --seed 0 --singles 12 --nulls 5 --aliens 3 --out rivals.jsonl

Stepwise regression with BIC is always there; PySINDy, gplearn and cma where they are installed (the extra `bench`);
PySR is not run: it needs Julia. Each gets the recording of the whole programme, a base fit and columns named by effect
(see `rival_features`), and the processor time that fit and diagnosis took on the same case. How a result counts as a
name stands in `rival_methods`. The largest is the name that counts; each rival is also shown with a gate of ours: its
names stand only where its torque takes 3 % away from the veto trajectory, which it was not fitted to.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.worlds.cases import Case, batch_hash, draw_batch, ready
from bench.worlds.judge import diagnosed
from bench.worlds.play import RanAway, whole
from bench.worlds.rival_features import Problem, problem
from bench.worlds.rival_methods import RIVALS, Rival
from bench.worlds.table import ALLOWED, lines_of

Line = dict[str, Any]
OWN = "autotune"
LEAST_HELD_OUT = 0.03
"""Of the veto trajectory's residual: the gate that is lent to the rivals."""
LEAST_SECONDS = 5.0


def installed() -> dict[str, Rival]:
    return {name: rival for name, (module, rival) in RIVALS.items() if importlib.util.find_spec(module)}


def run(case: Case) -> Line:
    """What each says of one case, best first."""
    line: Line = {"key": case.key, "kind": case.kind, "truth": list(case.truth)}
    try:
        made = ready(case)
    except RanAway as reason:
        return line | {"why": str(reason)}
    own = diagnosed(made)
    spent = own.get("fit_cpu", 0.0) + own.get("cpu", 0.0)
    names = own.get("effects") or []
    line |= {"ratios": [round(r, 2) for r in made.ratios], "laws": [law for _, law in case.effects]}
    line[OWN] = {"names": names, "verdict": own["verdict"], "held_out": None, "cpu": round(spent, 2)}
    given = problem(whole(made.world))
    for name, rival in installed().items():
        line[name] = _asked(rival, given, max(spent, LEAST_SECONDS))
    return line


def _asked(rival: Rival, given: Problem, seconds: float) -> Line:
    began = time.process_time()
    try:
        said = rival(given, seconds)
    except Exception as failed:  # noqa: BLE001 a rival's failure is its result
        return {
            "names": [],
            "held_out": None,
            "why": repr(failed),
            "cpu": round(time.process_time() - began, 2),
        }
    return {
        "names": list(said.names),
        "held_out": round(given.held_out(said.torque), 4),
        "cpu": round(time.process_time() - began, 2),
    }


def ungated(result: Line) -> list[str]:
    return list(result["names"])


def gated(result: Line) -> list[str]:
    """The names that hold on the veto trajectory."""
    return list(result["names"]) if (result["held_out"] or 0.0) >= LEAST_HELD_OUT else []


def summary(lines: Sequence[Line]) -> str:
    """Names right, wrong, invented, by rival; each with its own criterion and with the gate lent."""
    out = [
        "| who | named first | only that | first name wrong | any name wrong | nothing said | "
        "nothing planted: a name | aliens: a name | s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    out.append(_row(OWN, [line for line in lines if OWN in line], OWN, ungated))
    for name, (module, _) in RIVALS.items():
        own = [line for line in lines if name in line]
        if not own:
            out.append(f"| {name} | not installed ({module}) | | | | | | | |")
            continue
        out += [_row(name, own, name, ungated), _row(f"{name}, with the gate", own, name, gated)]
    return "\n".join(out) + "\n"


def _row(title: str, lines: Sequence[Line], who: str, names: Callable[[Line], list[str]]) -> str:
    said = [(line["kind"], line["truth"], names(line[who])) for line in lines]
    planted = [(truth, found) for kind, truth, found in said if kind == "single"]
    none = [found for kind, _, found in said if kind == "null"]
    aliens = [set(found) - ALLOWED.get(truth[0], set()) for kind, truth, found in said if kind == "alien"]
    first = sum(found[:1] == truth for truth, found in planted)
    only = sum(found == truth for truth, found in planted)
    wrong = sum(bool(found) and found[:1] != truth for truth, found in planted)
    beside = sum(bool(set(found) - set(truth)) for truth, found in planted)
    silent = sum(not found for _, found in planted)
    seconds = np.median([line[who]["cpu"] for line in lines]) if lines else float("nan")
    return (
        f"| {title} | {first} of {len(planted)} | {only} | {wrong} | {beside} | {silent} | "
        f"{sum(map(bool, none))} of {len(none)} | {sum(map(bool, aliens))} of {len(aliens)} | {seconds:.1f} |"
    )


def by_case(lines: Sequence[Line]) -> str:
    """What each named first, case by case; in brackets what the gate takes back."""
    whom = [OWN, *(name for name in RIVALS if any(name in line for line in lines))]
    out = ["| planted | " + " | ".join(whom) + " |", "|---" * (len(whom) + 1) + "|"]
    for line in lines:
        words = [_word(line, name) for name in whom]
        truth = ", ".join(line["truth"]) or "nothing"
        out.append(f"| {truth} | " + " | ".join(words) + " |")
    return "\n".join(out) + "\n"


def _word(line: Line, who: str) -> str:
    result = line.get(who)
    if result is None:
        return "–"
    if not result["names"]:
        return str(result.get("verdict", "nothing"))
    more = len(result["names"]) - 1
    word = result["names"][0] + (f" and {more} more" if more else "")
    word = f"**{word}**" if result["names"][:1] == line["truth"] else word
    return word if who == OWN or gated(result) else f"({word})"


def main() -> int:
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    for name, count in (("singles", 12), ("nulls", 5), ("aliens", 3)):
        parser.add_argument(f"--{name}", type=int, default=count, metavar="N")
    parser.add_argument("--out", type=Path, help="file to go on with: what stands in it is not run again")
    parser.add_argument("--hash", action="store_true", help="print the batch's hash and stop")
    given = parser.parse_args()
    cases = draw_batch(given.seed, {"single": given.singles, "null": given.nulls, "alien": given.aliens})
    sys.stdout.write(f"{len(cases)} cases, seed {given.seed}, sha256 {batch_hash(cases)}\n")
    if given.hash:
        return 0
    lines = lines_of(given.out) if given.out else []
    done = {line["key"] for line in lines}
    for case in (case for case in cases if case.key not in done):
        lines.append(run(case))
        if given.out:
            with given.out.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    sys.stdout.write(summary(lines) + "\n" + by_case(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
