"""The contact of the thesis's inertial drive, identified and diagnosed from one second at 50 kHz, with known truth.

    python -m bench.inertial_drive [RECORDINGS] [FIRST_SEED]

Half of the recordings as the drive is; half with a break-away force of 13 N over 10 N that falls within 1 mm/s.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import autotune
from autotune.recordings.recording import Metadata, Recording
from autotune_sim.inertial_drive import LOAD, ROW, SLIDER, InertialDrive, mixed_steps

MACHINE = Path(__file__).resolve().parents[1] / "config" / "machines" / "inertial-drive.toml"
FINER = 10
GRAIN = 1e-9
CONTACT = "coulomb = 10.0"
STICTION = "break_away = 13.0\nstribeck_velocity = 1e-3"
SHOWN = ("inertia", "coulomb", "stiffness", "viscous", "micro_damping")
TOLERANCE = {"inertia": 3.0, "coulomb": 2.0, "stiffness": 3.0}
"""% of the truth, of the plain contact; where it holds more than it drags, Coulomb and viscous friction are known
together better than each by itself."""


def drive(stiction: bool) -> InertialDrive:
    """The drive of the thesis, or one whose contact holds more than it drags."""
    if not stiction:
        return InertialDrive(MACHINE, finer=FINER)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / MACHINE.name
        file.write_text(MACHINE.read_text().replace(CONTACT, f"{CONTACT}\n{STICTION}"))
        return InertialDrive(file, finer=FINER)


def truth(made: InertialDrive) -> dict[str, float]:
    """What a fit of the contact should find."""
    one = next(c for c in made.machine.contacts if c.coefficients[SLIDER] and c.coefficients[LOAD])
    return {
        "inertia": made.machine.mass[SLIDER],
        "coulomb": one.coulomb,
        "stiffness": one.stiffness,
        "viscous": one.viscous,
        "micro_damping": one.damping,
    }


def recorded(made: InertialDrive, seed: int, seconds: float = 1.0) -> Recording:
    """The drive's contact during steps of all sizes."""
    record = made.contact_record(mixed_steps(seconds, seed), seed=seed, grain=GRAIN)
    columns = {"time": record.time, "position": record.slip, "torque": record.force}
    metadata = Metadata(motion_unit="m", sample_period=ROW, position_resolution=GRAIN)
    return Recording.from_columns(columns, metadata, "steps")


def measure(seed: int, stiction: bool) -> tuple[Mapping[str, float], str]:
    """Errors of the fit [%] and the names that the diagnosis of the plain model gives, or `none`, `unknown`."""
    made = drive(stiction)
    recording = recorded(made, seed)
    plain = autotune.fit([recording])
    found = autotune.fit([recording], effects=["stribeck"]) if stiction else plain
    model, base = found.model, plain.model
    if model is None or base is None:
        return {}, "no fit"
    errors = {name: 100.0 * (model[name] / value - 1.0) for name, value in truth(made).items()}
    verdict = autotune.diagnose([recording], base)
    return errors, "+".join(verdict.effects) or verdict.verdict


def main(arguments: list[str]) -> int:
    """Runs the benchmark; 1 where a value is off by more than `TOLERANCE` or a name is wrong."""
    count = int(arguments[0]) if arguments else 6
    first = int(arguments[1]) if len(arguments) > 1 else 41
    good = True
    print("seed  contact    verdict    " + "".join(f"{name:>15}" for name in SHOWN))
    for seed in range(first, first + count):
        stiction = seed >= first + (count + 1) // 2
        errors, verdict = measure(seed, stiction)
        near = all(abs(errors.get(name, np.inf)) <= most for name, most in TOLERANCE.items())
        good &= (near or stiction) and verdict in (
            ("stribeck", "unknown") if stiction else ("none", "unknown")
        )
        cells = "".join(f"{errors.get(name, np.nan):14.2f}%" for name in SHOWN)
        print(f"{seed:4}  {'stiction' if stiction else 'plain':9}  {verdict:9}  {cells}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
