"""Commits cut at random bytes of their exchange with the simulated drive, over its real byte stream.

    python bench/commit_cut.py --places 500 --seed 1
    python bench/commit_cut.py --what gains --places 100 --seed 1
    python bench/commit_cut.py --what gains-moteus --places 100 --seed 1

Host killed, cable pulled or drive without power; afterwards the drive may be switched off and on, and the
next start may be killed too. No drive may be left with mixed parameters, or with heartbeats, reactions and PDOs
as a session had set them, and no backup may be lost.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "sim"), str(ROOT / "drivers")]

from tests.tuning.cut_rig import Case, factory, length, play  # noqa: E402
from tests.tuning.gains_cut_rig import canopen_cuts, moteus_cuts  # noqa: E402

GAINS = {"gains": canopen_cuts, "gains-moteus": moteus_cuts}


def gains(what: str, places: int, seed: int) -> int:
    """Commits of gains; 1 where any was left wrong."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        endings = GAINS[what](Path(folder), places, seed)
    wrong = [one.wrong for one in endings if one.wrong]
    print(
        f"{what}: {places} cuts of seed {seed}, {time.monotonic() - began:.0f} s: {len(wrong)} wrong, "
        f"{sum(one.mixed for one in endings)} mixed until the next start, "
        f"{sum(one.kept for one in endings)} complete in spite of the cut"
    )
    for one in wrong:
        print(one)
    return int(bool(wrong))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--places", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--what", choices=("feedforward", *GAINS), default="feedforward")
    wanted = parser.parse_args()
    if wanted.what in GAINS:
        sys.exit(gains(wanted.what, wanted.places, wanted.seed))
    random, stored = Random(wanted.seed), factory()
    counted: Counter[str] = Counter()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        whole = length(stored, Path(folder) / "whole")
        for number in range(wanted.places):
            case = Case.draw(random, whole)
            ending = play(case, stored, Path(folder) / str(number))
            counted[case.kind] += 1
            counted["mixed until the next start"] += ending.mixed
            counted["session changed until the next start"] += ending.changed
            counted["kept in spite of the cut"] += ending.kept
            counted["wrong"] += bool(ending.wrong)
            if ending.wrong:
                print(case, ending.wrong)
    print(
        f"{wanted.places} cuts in a commit of {whole} bytes, {time.monotonic() - began:.0f} s: {dict(counted)}"
    )
    sys.exit(counted["wrong"] > 0)


if __name__ == "__main__":
    main()
