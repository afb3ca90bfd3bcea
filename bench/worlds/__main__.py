"""Runs a batch of worlds; restartable: what stands in the file is not run again.

    python -m bench.worlds --seed 0 --singles 40 --nulls 20 --workers 2 --out worlds.jsonl --table worlds.md

One line of JSON a case. `--hash` prints the hash of the list of cases and runs nothing: it is written down first.
Seeds below 100000 are for development.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from autotune.core.memory import large_arrays_kept
from bench.worlds.cases import Case, Wanted, batch_hash, draw_batch
from bench.worlds.judge import judged
from bench.worlds.names import BASES, LOOPS
from bench.worlds.table import lines_of, table

PLURALS = {
    "singles": "single",
    "halves": "half",
    "nulls": "null",
    "aliens": "alien",
    "pairs": "pair",
    "lones": "lone",
    "seconds": "second",
}
SAME = ("removed", "disturbed")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="first seed of each kind")
    for name in (*PLURALS, *SAME):
        parser.add_argument(f"--{name}", type=int, default=0, metavar="N")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("worlds.jsonl"))
    parser.add_argument("--table", type=Path)
    parser.add_argument("--hash", action="store_true", help="print the batch's hash and stop")
    parser.add_argument("--only", nargs="*", default=[], metavar="EFFECT", help="of the singles, these only")
    parser.add_argument(
        "--loops", nargs="*", default=LOOPS, choices=LOOPS, help="worlds with these loops only"
    )
    parser.add_argument("--cycle", nargs=2, type=float, default=(0.0, 1.0), metavar=("LEAST", "MOST"),
                        help="worlds recorded at these periods only [s]")  # fmt: skip
    parser.add_argument("--base", default="", choices=BASES, help="worlds with this base, the rest as without it;\n"
                        "a file of its own")  # fmt: skip
    return parser.parse_args()


def chosen(given: argparse.Namespace) -> list[Case]:
    counts = {kind: getattr(given, plural) for plural, kind in PLURALS.items()}
    counts |= {kind: getattr(given, kind) for kind in SAME}
    cases = draw_batch(given.seed, counts)
    return [case for case in cases if not given.only or set(case.truth) & set(given.only)]


def results(cases: list[Case], workers: int, wanted: Wanted) -> Iterator[dict[str, Any]]:
    judge = partial(judged, wanted=wanted)
    if workers <= 1:
        large_arrays_kept()
        yield from map(judge, cases)
        return
    with multiprocessing.get_context("spawn").Pool(workers, large_arrays_kept, maxtasksperchild=20) as pool:
        yield from pool.imap_unordered(judge, cases)


def main() -> int:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    given = arguments()
    cases = chosen(given)
    wanted = Wanted(tuple(LOOPS.index(loop) for loop in given.loops), *given.cycle, given.base)
    head = f"{len(cases)} cases, seed {given.seed}, sha256 {batch_hash(cases)}"
    sys.stdout.write(head + "\n")
    if given.hash:
        return 0
    done = {line["key"] for line in lines_of(given.out)}
    with given.out.open("a") as file:
        for line in results([case for case in cases if case.key not in done], given.workers, wanted):
            file.write(json.dumps(line) + "\n")
            file.flush()
    wanted = {case.key for case in cases}
    text = table([line for line in lines_of(given.out) if line["key"] in wanted], head + "\n")
    (given.table.write_text if given.table else sys.stdout.write)(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
