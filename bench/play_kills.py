"""kill -9 of `autotune play` at random moments, and the master's jitter with and without it.

A simulated drive, a foreign master and the sidecar are processes of their own on one simulated bus. The master plays
the benchmark without end; the sidecar is started, struck at a random moment of watching, fading in or playing, and
started again, which puts back what was left. Judged is what acts in the drive, in every cycle. The jitter is that of
a master with a pace of its own, in its own process: intervals of its cycle first without, then with a sidecar.

    python -m bench.play_kills [--kills 20] [--seed 1] [--pace 0.005] [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from autotune.core.paths import config_directory
from tests.tuning.play_rig import Columns, largest_step, longest_hold, peak_error, rig, stop

LIMIT = 1.34  # N m
PERIODS = 18
"""That are averaged, as in a run's proof: in the mean of six the encoder's count still shows."""
WINDOWS = 2
"""A busy host may hold the sidecar up for longer than the master waits."""


def kills(count: int, seed: int, *options: str) -> dict[str, Any]:
    """Strikes `count` times; what acted in the drive. `options` of the foreign master."""
    random = Random(seed)
    moments: dict[str, int] = {"watching": 0, "fading in": 0, "playing": 0}
    with tempfile.TemporaryDirectory() as folder, rig(Path(folder), *options) as running:
        sidecar = running.start()
        running.go()
        sidecar.wait_for("playing")
        running.pass_cycles(1000)
        windows = []
        for _ in range(WINDOWS):
            begin, missed = running.cycles + 100, running.missed
            running.pass_cycles(1000 * PERIODS + 200)
            windows.append((begin, running.missed - missed))
        for _ in range(count):
            kind = random.choice(("watching", "fading in", "fading in", "playing", "playing"))
            if kind != "watching":
                sidecar.wait_for("playing")
            running.pass_cycles({"watching": 0, "fading in": 0, "playing": 700}[kind] + random.randrange(500))
            sidecar.kill()
            moments[kind] += 1
            running.pass_cycles(300)
            sidecar = running.start()
        sidecar.wait_for("playing")
        running.pass_cycles(300)
        code = stop(sidecar)
        seen = running.finish()
    holds = longest_hold(seen)
    return {
        "kills": moments,
        "cycles": len(seen["offset"]),
        "largest_step_of_limit": largest_step(seen) / LIMIT,
        "cycles_until_gone": {"ends": len(holds), "longest": max(holds)},
        "peak_error_mrad": [
            {"peak": 1e3 * peak_error(seen, begin, PERIODS), "cycles_without_sidecar": missed}
            for begin, missed in windows
        ],
        "axis_always_enabled": set(seen["status"].astype(int) & 0x6F) == {0x27},
        "last_exit_code": code,
    }


def jitter(pace: float, cycles: int) -> dict[str, Any]:
    """Intervals of a master with a pace of its own, without and with a sidecar [ms]."""
    with tempfile.TemporaryDirectory() as folder, rig(Path(folder), "--pace", str(pace)) as running:
        running.go()
        running.pass_cycles(cycles)
        alone = running.cycles
        sidecar = running.start()
        sidecar.wait_for("playing")
        with_it = running.cycles + 100
        running.pass_cycles(cycles + 100)
        stop(sidecar)
        seen = running.finish()
    return {
        "pace_ms": 1e3 * pace,
        "without": _spread(seen, 0, alone),
        "with": _spread(seen, with_it, with_it + cycles),
        "largest_step_of_limit": largest_step(seen) / LIMIT,
    }


def _spread(seen: Columns, start: int, stop: int) -> dict[str, float]:
    intervals = 1e3 * np.diff(seen["wall"][start:stop])
    median, p95, p99 = np.quantile(intervals, (0.5, 0.95, 0.99))
    return {"median": median, "p95": p95, "p99": p99, "max": intervals.max(), "std": intervals.std()}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pace", type=float, default=0.005, help="s")
    parser.add_argument("--cycles", type=int, default=3000, help="of either part of the jitter")
    parser.add_argument("--canopen", action="store_true", help="the master is PyPI's canopen, not raw slcan")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    eds = config_directory() / "eds" / "autotune-sim.eds"
    result = {
        "seed": options.seed,
        "jitter": jitter(options.pace, options.cycles),
        "kills": kills(options.kills, options.seed, *(("--canopen", str(eds)) if options.canopen else ())),
    }
    text = json.dumps(result, indent=2, default=float)
    print(text)
    if options.out is not None:
        options.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
