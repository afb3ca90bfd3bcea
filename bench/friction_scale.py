"""θ of (5.11) from the legs of a check, on axes whose friction was scaled by 0.7 to 1.3 after their model was made.

    python -m bench.friction_scale --count 50 --seed 1

The legs are those of `autotune check`, played on the simulated drive; the model is that of the axis before, with its
parameters off by 0.3 %, as identification leaves them (identification itself is judged by `bench.identify`).
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from autotune.core.axis import read_axis
from autotune.core.loop import LocalLoop
from autotune.experiments.record import Recorder, metadata_for
from autotune.experiments.record import play as play_and_record
from autotune.experiments.runner import Programme
from autotune.identify.steady_state import steady_points
from autotune.models.drive_model import base_model
from autotune.monitoring.check_plan import plan_check
from autotune.monitoring.friction_scale import friction_scale
from autotune_sim.effects import scale_friction
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset, vary
from bench.identify_data import AXIS


def one(seed: int, number: int) -> tuple[float, float, float, bool]:
    """True θ, θ found, machine seconds, and whether a scale was found enough."""
    random = np.random.default_rng([seed, number, 5])
    axis = preset("edm-vertical")
    plant = vary(axis.plant, random)
    true = float(random.uniform(0.7, 1.3))
    off = {name: 1.0 + random.normal(0.0, 0.003) for name in ("viscous", "coulomb")}
    values = {"inertia": plant.inertia, "viscous": plant.viscous * off["viscous"], "offset": plant.offset}
    values |= {"coulomb": plant.friction * off["coulomb"], "stiffness": plant.stiffness}
    model = base_model({**values, "micro_damping": plant.micro_damping})  # fmt: skip
    described = read_axis(AXIS)
    legs = plan_check(described, number).legs
    programme = Programme((legs,), described.limits, seconds=1000.0)
    recorder = Recorder(metadata_for(described, None), programme.labels)
    drive = SimDrive(replace(axis, plant=scale_friction(plant, 1.0 / true)), number)
    play_and_record(LocalLoop(drive), programme, recorder)
    found = friction_scale(steady_points(recorder.recording().select("steady_state")), model)
    if found is None:
        return true, float("nan"), legs.duration, False
    return true, found.theta, legs.duration, found.enough


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    rows = np.array([one(wanted.seed, number) for number in range(wanted.count)])
    error = np.abs(rows[:, 1] / rows[:, 0] - 1.0)
    print(f"{wanted.count} axes of seed {wanted.seed}, {rows[0, 2]:.0f} s of motion each:")
    print(f"θ off by {np.median(error):.2%} (median), {np.nanmax(error):.2%} at most")
    print(f"within 2 %: {np.mean(error <= 0.02):.0%}; a scale is enough on {np.mean(rows[:, 3]):.0%}")


if __name__ == "__main__":
    main()
