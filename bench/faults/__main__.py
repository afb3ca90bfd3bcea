"""`python -m bench.faults`: the fault campaign.

    python -m bench.faults --seed 1000 --runs 200 [--kind plant] [--out FILE]
    python -m bench.faults --case 1017 [1018 ...] [--kind plant] [--keep FOLDER]
    python -m bench.faults --named
    python -m bench.faults --table FILE

One line a case. With `--out` results are appended to a file of JSON lines, and cases that are already in it
are not played again: a campaign can be interrupted and continued. `--table` prints such a file as Markdown.
Seeds 1000 to 1999 are for development; what is reported is drawn afresh.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from bench.faults.cases import KINDS, NAMED, PREPARED, Case, draw

if TYPE_CHECKING:
    from bench.faults.pool import Result


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench.faults", description="The fault campaign.")
    parser.add_argument("--seed", type=int, default=1000, help="of the first case (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=100, help="number of cases (default: %(default)s)")
    parser.add_argument("--kind", choices=list(KINDS), help="only this kind (default: the mix)")
    parser.add_argument(
        "--fault", metavar="NAME", help="only cases with a fault whose name begins so (encoder)"
    )
    parser.add_argument("--case", type=int, nargs="+", metavar="SEED", help="these cases alone, one by one")
    parser.add_argument(
        "--named", action="store_true", help="the cases of reported batches that stay, one by one"
    )
    parser.add_argument(
        "--keep", type=Path, help="folder for what unsound cases leave; with --case for what all leave"
    )
    parser.add_argument("--workers", type=int, default=2, help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, help="results as JSON lines; cases in it are not played again")
    parser.add_argument(
        "--table", type=Path, metavar="FILE", help="print such a file as Markdown, play nothing"
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Plays cases; 1 where one of them was not sound."""
    options = _parser().parse_args(arguments)
    if options.named:
        options.case = list(NAMED)
    from bench.faults.table import read_results, table

    if options.table is not None:
        _say(table(read_results(options.table)))
        return 0
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    known = {one.seed for one in read_results(options.out)}
    cases = [case for case in _drawn(options) if case.seed not in known]
    from bench.faults.here import make_template, warm

    warm()
    with tempfile.TemporaryDirectory(prefix="hurt-template-") as folder:
        template = Path(folder) if any(case.programme in PREPARED for case in cases) else None
        if template is not None:
            make_template(template)
        results = []
        for result in _played(options, cases, template):
            results.append(result)
            _say(result.line())
            if options.out is not None:
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(result)) + "\n")
    if len(results) > 1:
        _say("\n" + table(results))
    return int(any(result.findings for result in results))


def _drawn(options: argparse.Namespace) -> list[Case]:
    """Single cases, or so many from the first seed on; with `--fault` those without it are passed over."""
    seeds = options.case or itertools.count(options.seed)
    cases = (draw(seed, options.kind) for seed in seeds)
    wanted = (
        case for case in cases if any(name.startswith(options.fault or "") for name in (*case.faults, ""))
    )
    return list(itertools.islice(wanted, None if options.case else options.runs))


def _played(options: argparse.Namespace, cases: Sequence[Case], template: Path | None) -> Iterator[Result]:
    """One by one where single cases are asked for, else by the workers."""
    from bench.faults.pool import play, play_all

    if options.case is None:
        yield from play_all(cases, template, options.workers, options.keep)
        return
    for case in cases:
        yield play(case, template, options.keep / str(case.seed) if options.keep else None)


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
