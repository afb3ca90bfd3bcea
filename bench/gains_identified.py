"""Presets varied by ±20 %, tuned in process: what their models predict of gains, and how near they come to learning.

    python -m bench.gains_identified --seed S --count N

After each run: `N` gain sets near the boundary of hunting, shared by ten axes, predicted by the run's model and tried
on the plant (as `bench.gains boundary`); then iterative learning on the axis under the guard, beside the parameters
that the run proposed, on the benchmark and on ten sines (`autotune catalogue --ceiling`). The ratio of peaks on the
benchmark is given with the difference in encoder counts: both peaks are often below one.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from autotune.control.feedforward import FeedforwardLaw
from autotune.control.gains.loop import LoopTiming
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import AutotuneError
from autotune.experiments.path import Motion
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.tuning.ceiling import Ceiling, fixed_law, measure_ceiling
from autotune.tuning.gains import disturbance_of
from autotune.tuning.links import open_link
from autotune.tuning.preparation import SessionRequest
from autotune.tuning.progress import Silent
from autotune.tuning.run import Request, tune
from autotune_sim.presets import preset
from bench.gains import boundary_sets, compared, report
from bench.gains_plant import PERIOD, DrawnAxis

ROOT = Path(__file__).resolve().parents[1]
AXES = 10
KINDS = ("edm-vertical", "lugre")
Row = tuple[bool, bool, float, float]


@dataclass(frozen=True)
class Tuned:
    """One axis after its run: the plant, the model that the run left, its feedforward along the benchmark's motion, and
    what learning found; None where it failed."""

    axis: DrawnAxis
    model: DriveModel
    timing: LoopTiming
    law: FeedforwardLaw
    motion: Motion
    ceiling: Ceiling | None


def axis_in(folder: Path, kind: str, vary: int) -> Axis:
    """A preset's axis, varied; its file is written to the folder."""
    text = (ROOT / "config/axes/simulated.toml").read_text(encoding="utf-8")
    path = folder / "axis.toml"
    path.write_text(re.sub('link = ".*"', f'link = "sim://{kind}?seed={vary}"', text), encoding="utf-8")
    return read_axis(path)


def tuned(seed: int, number: int) -> Tuned:
    """Runs one axis in process, and learns on it."""
    kind, vary = KINDS[number % 2], seed + number
    with tempfile.TemporaryDirectory() as folder:
        axis, runs = axis_in(Path(folder), kind, vary), Path(folder) / "runs"
        result = tune(Request(axis, lambda: open_link(axis, Path(folder)), runs, Silent(), datetime.now))
        model = read_model(result.run_directory / "model.toml")
        shaken = disturbance_of(result.run_directory) or 0.0
        request = SessionRequest(axis, lambda: open_link(axis, Path(folder)), runs, Silent(), datetime.now)
        ceiling, law = None, fixed_law(axis, runs)
        try:
            ceiling = measure_ceiling(request, law)
        except AutotuneError as error:
            print(kind, vary, "ceiling:", error, flush=True)
    drawn = DrawnAxis(preset(kind, vary).plant, 0.0, 0.2, 1.26)
    plant = drawn.plant
    timing = LoopTiming(
        PERIOD, plant.resolution, plant.torque_limit, reference_filter=0.8, disturbance=shaken
    )
    return Tuned(drawn, model, timing, law, Motion.of(axis), ceiling)


def predictions(one: Tuned, seed: int, number: int, each: int) -> list[Row]:
    """Gain sets near the boundary of one identified axis."""
    random = np.random.default_rng([seed, 2000 + number])
    rows: list[Row] = []
    while len(rows) < each:
        gains = boundary_sets(one.axis, random)
        if gains is not None:
            rows.append(compared(one.axis, one.model, one.timing, gains))
    return rows


def in_words(found: Ceiling, resolution: float) -> str:
    """Ratio of peaks on the benchmark, and of the ten sines the range of what the others leave."""
    parts = [
        f"fixed {1e3 * found.fixed:.3f}, learnt {1e3 * found.learnt:.3f}, neither {1e3 * found.neither:.2f} mrad",
        f"{100 * (found.fixed / found.learnt - 1):+.0f} %, {(found.fixed - found.learnt) / resolution:+.2f} counts",
    ]
    ratios = {
        "by time": [one.by_time / one.fixed_raw for one in found.unseen],
        "stretched": [one.learnt / one.fixed for one in found.unseen],
        "neither": [one.neither / one.fixed for one in found.unseen],
    }
    parts += [f"{what} x{min(one):.1f} to x{max(one):.1f}" for what, one in ratios.items() if one]
    return f"{'; '.join(parts)}; on {len(found.unseen)} sines"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200)
    wanted = parser.parse_args()
    rows: list[Row] = []
    for number in range(AXES):
        one = tuned(wanted.seed, number)
        found = predictions(one, wanted.seed, number, wanted.count // AXES)
        rows += found
        print(KINDS[number % 2], wanted.seed + number, sum(r[0] == r[1] for r in found), "of", len(found))
        if one.ceiling is not None:
            print("   ", in_words(one.ceiling, one.axis.plant.resolution), flush=True)
    report(rows, f"identified axes from seed {wanted.seed}")


if __name__ == "__main__":
    main()
