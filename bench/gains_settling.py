"""Gains proposed on axes as a run identifies them: how long they settle on the plant, beside a long search there.

    python -m bench.gains_settling --seed S --count N [--cycles 0 1 2]

Axis i is the preset of `KINDS` in turn, varied by seed S + i and tuned in process; the dead time of so many cycles is
in the plant's loop and told with ±20 % (`autotune gains --dead-time`). Judge, search and requirements are those of
`bench.gains axes`.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import numpy as np

from autotune.control.gains.judge import Task
from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.members import family
from autotune.control.gains.propose import propose
from autotune.control.gains.requirements import corners_of, shortfall
from autotune.control.gains.steps import step_sizes
from autotune.core.errors import AutotuneError
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.models.total_friction import damping_at_rest, stiffness_at_rest
from autotune.tuning.gains import disturbance_of
from autotune.tuning.links import open_link
from autotune.tuning.progress import Silent
from autotune.tuning.run import Request, tune
from autotune_sim.presets import preset
from bench.gains import JUDGED, as_array, best_settling, kin_of, settles, within_intervals
from bench.gains_identified import axis_in
from bench.gains_plant import PERIOD, DrawnAxis, stands, swinging

KINDS = ("edm-vertical", "edm-vertical", "lugre")
STEP, SPEED, FILTER = 0.2, 1.26, 0.8


def tuned(kind: str, vary: int) -> tuple[DriveModel, float]:
    """The model that a run leaves, and what it found to shake the axis [N m]."""
    with tempfile.TemporaryDirectory() as folder:
        axis, runs = axis_in(Path(folder), kind, vary), Path(folder) / "runs"
        result = tune(Request(axis, lambda: open_link(axis, Path(folder)), runs, Silent(), datetime.now))
        return read_model(result.run_directory / "model.toml"), disturbance_of(result.run_directory) or 0.0


def settling(
    kind: str, vary: int, model: DriveModel, shaken: float, cycles: int, search: bool = True
) -> dict[str, object]:
    """Proposal for one axis, told a dead time of so many cycles, tried on the plant."""
    axis = DrawnAxis(preset(kind, vary).plant, cycles * PERIOD, STEP, SPEED)
    plant, late = axis.plant, axis.dead_time
    timing = LoopTiming(PERIOD, plant.resolution, plant.torque_limit, late, 0.1 * late, FILTER, shaken)
    kin, task = family(model, timing), Task(step_sizes(model, timing, axis.step), axis.speed)
    row: dict[str, object] = {"axis": f"{kind} {vary}", "cycles": cycles}
    began = time.monotonic()
    try:
        proposal = propose(kin, task, Gains(1.0, 1.0, 1.0))
    except AutotuneError as error:
        return row | {"refused": str(error)}
    row["seconds"] = round(time.monotonic() - began, 1)
    if proposal.verdict is None:
        return row | {"refused": proposal.limited_by}
    gains = as_array(proposal.verdict.gains)
    sizes = (task.steps.small, task.steps.large)
    row["gains"] = [round(float(one), 5) for one in gains]
    row["hunts"] = any(
        swinging(axis, gains, sign * size) is not None for size in sizes for sign in (1.0, -1.0)
    )
    free = [float(v) for v in proposal.verdict.slow.speeds if v > proposal.verdict.stick_slip_below]
    row["sticks"] = any(stands(axis, gains, v) for v in free)
    truth = corners_of(kin_of(axis, None)[0])[:1]
    row["short of margins"] = round(shortfall(truth, proposal.verdict.gains, within_intervals()), 3)
    row["settles"], row["twin"] = settles(axis, gains, sizes, JUDGED), proposal.verdict.settling
    if search:
        row["best"] = best_settling(axis, sizes)
    return row


def rows(seed: int, count: int, cycles: list[int]) -> Iterator[dict[str, object]]:
    for number in range(count):
        kind, vary = KINDS[number % len(KINDS)], seed + number
        model, shaken = tuned(kind, vary)
        plant = preset(kind, vary).plant
        true = plant.micro_damping if plant.elements else getattr(plant.bristle, "damping", math.nan)
        print(
            f"{kind} {vary}: damping at rest {damping_at_rest(model):.4g} (± {model.damping_error or math.nan:.2g}) of "
            f"{true:.4g}, stiffness {stiffness_at_rest(model):.4g} of {plant.stiffness:.4g}",
            flush=True,
        )
        for one in cycles:
            yield settling(kind, vary, model, shaken, one)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--cycles", type=int, nargs="+", default=[0, 1, 2])
    wanted = parser.parse_args()
    found = []
    for row in rows(wanted.seed, wanted.count, wanted.cycles):
        print(row, flush=True)
        found.append(row)
    done = [row for row in found if "refused" not in row]
    ratio = np.array([float(str(row["settles"])) / float(str(row["best"])) for row in done])
    ratio = ratio[np.isfinite(ratio)]
    print(
        f"{len(found)} of seed {wanted.seed}: {len(done)} proposals, {sum(bool(r['hunts']) for r in done)} hunt, "
        f"{sum(bool(r['sticks']) for r in done)} stick-slip, "
        f"{sum(float(str(r['short of margins'])) > 0.0 for r in done)} short of a margin; settling over the best of "
        f"{len(ratio)}: median {np.median(ratio):.2f}, largest {ratio.max():.2f}, within 1.3 "
        f"{np.mean(ratio <= 1.3):.0%}"
    )


if __name__ == "__main__":
    main()
