"""Torque ripple stored in simulated drives: how much of it is gone, judged by the plant; and commits cut anywhere.

    python -m bench.ripple_stored --axes 5 --cuts 250 --seed 1

Axes are drawn once from the seed: another plant, ripple of two to four orders with 8 to 25 mN m each. A model as a
diagnosis leaves it (amplitudes 5 % and phases 0.05 rad beside the truth) is aligned and committed on both kinds of
drive; then power is lost, and the plant judges what is stored, without a host. Commits are cut on a third kind too, of
friction over velocity.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "sim"), str(ROOT / "drivers")]

from tests.tuning.cut_rig import Case  # noqa: E402
from tests.tuning.ripple_cut_rig import RIGS, factory, length, play  # noqa: E402
from tests.tuning.ripple_rig import RIGS as HOLD_RIPPLE  # noqa: E402
from tests.tuning.ripple_rig import judged, model_of, planted  # noqa: E402

ORDERS = (6.0, 12.0, 24.0, 36.0, 72.0, 144.0)
LEAST = 0.9


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--axes", type=int, default=5)
    parser.add_argument("--cuts", type=int, default=250, help="of each kind of drive")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(RIGS), help="of drives whose commits are cut")
    wanted = parser.parse_args()
    bad = sum(_ripple(kind, wanted.axes, wanted.seed) for kind in HOLD_RIPPLE)
    bad += sum(_cuts(kind, wanted.cuts, wanted.seed) for kind in wanted.kinds.split(","))
    sys.exit(bad > 0)


def _ripple(kind: str, axes: int, seed: int) -> int:
    random, bad = Random(seed), 0
    for number in range(axes):
        orders = tuple(sorted(random.sample(ORDERS, random.randint(2, 4))))
        axis = planted(random.randrange(1, 1 << 16), orders)
        with tempfile.TemporaryDirectory() as folder:
            found = judged(kind, axis, model_of(axis), Path(folder))
        told = found.plan if isinstance(found.plan, str) else f"table as before the reset: {found.same}"
        print(
            f"{kind} {number}: orders {orders}: torque {100 * found.torque:.1f} %, speed {100 * found.speed:.1f} %, "
            f"tracking error {100 * found.share:.1f} % gone; {told}",
            flush=True,
        )
        bad += not (found.torque >= LEAST and found.speed >= LEAST and found.same)
    return bad


def _cuts(kind: str, cuts: int, seed: int) -> int:
    random, counted = Random(seed), Counter[str]()
    stored = factory(kind)
    with tempfile.TemporaryDirectory() as folder:
        whole = length(kind, stored, Path(folder) / "whole")
        for number in range(cuts):
            case = Case.draw(random, whole)
            ending = play(kind, case, stored, Path(folder) / str(number))
            counted[case.kind] += 1
            counted["mixed until the next start"] += ending.mixed
            counted["kept in spite of the cut"] += ending.kept
            counted["wrong"] += bool(ending.wrong)
            if ending.wrong:
                print(case, ending.wrong, flush=True)
    print(f"{kind}: {cuts} cuts in {whole} bytes or frames: {dict(counted)}", flush=True)
    return counted["wrong"]


if __name__ == "__main__":
    main()
