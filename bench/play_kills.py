"""`autotune play` beside a foreign master: kill -9 at random moments, the master's cycle, the peak error.

A simulated drive, a foreign master (PyPI's canopen, or raw slcan with `--raw`) and the sidecar are processes of their
own on one simulated bus. The master plays the benchmark without end.

    python -m bench.play_kills kills --kills 100      # struck while watching, fading in or playing, and started again
    python -m bench.play_kills jitter --pairs 8       # without and with in turn, so that the host's own drift cancels
    python -m bench.play_kills peak --windows 4       # means of 6 and of 18 periods

`kills` and `jitter` have a master with a pace of its own, which waits for nobody; `peak` has one that waits for the
sidecar's frame, as the drive's time does. Each prints a table, and writes everything with `--out FILE.json`.
"""

from __future__ import annotations

import argparse
import json
import secrets
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from autotune.core.paths import config_directory
from tests.tuning.play_rig import Columns, Rig, largest_step, longest_hold, peak_error, rig, stop

LIMIT = 1.34  # N m
ALLOWED = 0.05  # of it, in one cycle
GONE = 120  # cycles: the time-out of 20 ms and the ramp of 100 ms
SLACK = 3  # cycles between the sidecar's last frame and the first that the drive misses
ASKED = 0.25  # mrad
AROUND = 300  # cycles after a kill, and while a sidecar prepares
PERIODS = 18  # as in a run's proof: in means of six the encoder's count still shows
MOMENTS = {"watching": 0, "fading in": 0, "playing": 700}
"""Cycles after which the kill may come at the earliest; of the first from the start, of the others from the fade."""

Floats = NDArray[np.float64]


def kills(count: int, seed: int, master: Sequence[str]) -> dict[str, Any]:
    """Strikes `count` times; what acted in the drive, in every cycle, and what the master's cycle was around it."""
    random, moments, struck = Random(seed), dict.fromkeys(MOMENTS, 0), []
    with tempfile.TemporaryDirectory() as folder, rig(Path(folder), *master) as running:
        running.go()
        passed(running, 1000)
        sidecar = running.start()
        for _ in range(count):
            kind = random.choice(("watching", "fading in", "fading in", "playing", "playing"))
            if kind != "watching":
                sidecar.wait_for("playing")
            passed(running, MOMENTS[kind] + random.randrange(500))
            sidecar.kill()
            moments[kind] += 1
            struck.append(running.cycles)
            passed(running, AROUND)
            sidecar = running.start()
        sidecar.wait_for("playing")
        passed(running, 1000)
        code = stop(sidecar)
        seen = running.finish()
    near = np.zeros(len(seen["wall"]) - 1, dtype=bool)
    for cycle in struck:
        near[max(cycle - 100, 0) : cycle + AROUND] = True  # the master tells its cycle every hundred
    intervals, holds = 1e3 * np.diff(seen["wall"]), longest_hold(seen)
    return {
        "seed": seed,
        "kills": moments,
        "cycles": len(seen["offset"]),
        "largest_step_of_limit": largest_step(seen) / LIMIT,
        "steps_around_kills_of_limit": steps_around(seen, struck),
        "cycles_until_gone": {"ends": len(holds), "longest": max(holds)},
        "master_around_kills_ms": spread(intervals[near]),
        "master_elsewhere_ms": spread(intervals[~near]),
        "axis_always_enabled": set(seen["status"].astype(int) & 0x6F) == {0x27},
        "last_exit_code": code,
    }


def steps_around(seen: Columns, struck: Iterable[int]) -> list[float]:
    """The largest change of the acting offset in a cycle around each kill, of the torque limit."""
    change = np.abs(np.diff(seen["offset"])) / LIMIT
    return [float(change[max(cycle - 100, 0) : cycle + AROUND].max()) for cycle in struck]


def jitter(pairs: int, cycles: int, master: Sequence[str]) -> dict[str, Any]:
    """Intervals of the master's cycle without and with a sidecar, `pairs` times in turn [ms]."""
    spans: list[tuple[int, int]] = []
    with tempfile.TemporaryDirectory() as folder, rig(Path(folder), *master) as running:
        running.go()
        passed(running, 1000)
        for _ in range(pairs):
            spans.append(span(running, cycles))
            sidecar = running.start()
            sidecar.wait_for("playing")
            passed(running, 600)  # faded in
            spans.append(span(running, cycles))
            stop(sidecar)
            passed(running, AROUND)
        seen = running.finish()
    intervals = [1e3 * np.diff(seen["wall"][begin:end]) for begin, end in spans]
    return {
        "cycles": cycles,
        "without": [spread(one) for one in intervals[::2]],
        "with": [spread(one) for one in intervals[1::2]],
        "difference": {name: difference(intervals, name) for name in ("median", "std", "p95", "p99")},
        "largest_step_of_limit": largest_step(seen) / LIMIT,
    }


def span(running: Rig, cycles: int) -> tuple[int, int]:
    """So many cycles from now on, in which nothing else is done."""
    begin = running.cycles + 100
    passed(running, cycles + 200)
    return begin, begin + cycles


def difference(intervals: Sequence[Floats], name: str) -> dict[str, float]:
    """Of a figure of neighbours, with less without: mean and 95 % interval of the mean [ms]."""
    pairs = [spread(b)[name] - spread(a)[name] for a, b in zip(intervals[::2], intervals[1::2], strict=True)]
    if len(pairs) < 2:
        return {"mean": pairs[0], "half": float("inf")}
    half = float(stats.t.ppf(0.975, len(pairs) - 1) * np.std(pairs, ddof=1) / np.sqrt(len(pairs)))
    return {"mean": float(np.mean(pairs)), "half": half}


def peak(windows: int, master: Sequence[str]) -> dict[str, Any]:
    """Peak of the mean error, without and with: of each window of 18 periods, and of its parts of six [mrad]."""
    with tempfile.TemporaryDirectory() as folder, rig(Path(folder), *master) as running:
        running.go()
        passed(running, 2000)
        alone = span(running, 1000 * PERIODS)[0]
        sidecar = running.start()
        sidecar.wait_for("playing")
        passed(running, 1000)
        begins = [(running.missed, span(running, 1000 * PERIODS)[0], running.missed) for _ in range(windows)]
        stop(sidecar)
        seen = running.finish()
    return {
        "without": 1e3 * peak_error(seen, alone, PERIODS),
        "windows": [
            {
                "of_18": 1e3 * peak_error(seen, begin, PERIODS),
                "of_6": [1e3 * peak_error(seen, begin + 6000 * part, 6) for part in range(PERIODS // 6)],
                "cycles_without_sidecar": after - before,
            }
            for before, begin, after in begins
        ],
    }


def passed(running: Rig, cycles: int) -> None:
    """Waits while the master plays so many, a thousand at a time: a slow host may take long."""
    until = running.cycles + cycles
    while (left := until - running.cycles) > 0:
        running.pass_cycles(min(left, 1000))


def spread(intervals: Floats) -> dict[str, float]:
    if not len(intervals):
        return dict.fromkeys(("median", "p95", "p99", "max", "std"), float("nan"))
    median, p95, p99 = (float(one) for one in np.quantile(intervals, (0.5, 0.95, 0.99)))
    return {
        "median": median, "p95": p95, "p99": p99, "max": float(intervals.max()), "std": float(intervals.std()),
    }  # fmt: skip


# Tables


def kills_table(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    steps, gone = np.array(found["steps_around_kills_of_limit"]), found["cycles_until_gone"]
    words = ", ".join(f"{number} {kind}" for kind, number in found["kills"].items())
    largest = 100 * found["largest_step_of_limit"]
    return [
        ("kills", "100", f"{sum(found['kills'].values())} ({words}), seed {found['seed']}"),
        ("cycles of the drive", "", str(found["cycles"])),
        ("largest jump of the offset, of the limit", f"{100 * ALLOWED:g} %", f"{largest:.2f} %"),
        (
            "around the kills: median, largest",
            "",
            f"{100 * np.median(steps):.2f} %, {100 * steps.max():.2f} %",
        ),
        (
            "cycles until the offset is gone",
            f"{GONE} + {SLACK}",
            f"at most {gone['longest']} ({gone['ends']} ends)",
        ),
        ("master's interval around kills [ms]", "as elsewhere", in_words(found["master_around_kills_ms"])),
        ("master's interval elsewhere [ms]", "", in_words(found["master_elsewhere_ms"])),
        ("the axis stays enabled", "always", "always" if found["axis_always_enabled"] else "NOT always"),
    ]


def jitter_table(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    rows = [
        (f"{kind}, block {number} [ms]", "", in_words(one))
        for number, pair in enumerate(zip(found["without"], found["with"], strict=True), 1)
        for kind, one in zip(("without", "with"), pair, strict=True)
    ]
    return rows + [
        (f"with less without: {name} [ms]", "0 within", f"{one['mean']:+.3f} ± {one['half']:.3f}")
        for name, one in found["difference"].items()
    ]


def peak_table(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    rows = [("without, mean of 18 periods [mrad]", "", f"{found['without']:.3f}")]
    for number, one in enumerate(found["windows"], 1):
        six, missed = ", ".join(f"{value:.3f}" for value in one["of_6"]), one["cycles_without_sidecar"]
        rows.append(
            (f"window {number}: of 18 [mrad]", f"{ASKED}", f"{one['of_18']:.3f} ({missed} cycles missed)")
        )
        rows.append((f"window {number}: of 6 [mrad]", "", six))
    return rows


def in_words(one: dict[str, float]) -> str:
    return (
        f"median {one['median']:.2f}, p95 {one['p95']:.2f}, p99 {one['p99']:.2f}, longest {one['max']:.2f}, "
        f"σ {one['std']:.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("kills", "jitter", "peak"))
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--cycles", type=int, default=3000, help="of either part of a pair")
    parser.add_argument("--windows", type=int, default=4)
    parser.add_argument("--seed", type=int, default=None, help="drawn if not given")
    parser.add_argument(
        "--pace", type=float, default=0.005, help="s between two SYNCs of a master of its own pace"
    )
    parser.add_argument(
        "--raw", action="store_true", help="the master is raw slcan instead of PyPI's canopen"
    )
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    master = [] if options.raw else ["--canopen", str(config_directory() / "eds" / "autotune-sim.eds")]
    paced = [*master, "--pace", str(options.pace)]
    if options.what == "kills":
        seed = secrets.randbelow(100_000) if options.seed is None else options.seed
        found = kills(options.kills, seed, paced)
        rows = kills_table(found)
    elif options.what == "jitter":
        found = jitter(options.pairs, options.cycles, paced)
        rows = jitter_table(found)
    else:
        found = peak(options.windows, master)
        rows = peak_table(found)
    print(
        "\n".join(f"{what:<44}{asked:<14}{seen}" for what, asked, seen in [("what", "asked", "seen"), *rows])
    )
    if options.out is not None:
        options.out.write_text(json.dumps(found, indent=2, default=float) + "\n")


if __name__ == "__main__":
    main()
