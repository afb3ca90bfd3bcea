"""Effects planted in measured data of others: is what was added to a real axis's torque named, and nothing else?

    python -m bench.planted --cases 60 --seed SEED [--hash] [--out FILE.jsonl]

The torque that was measured is raised by what an effect, by a law of this file's own, would have asked for along the
measured motion. All else (noise, controller, transmission, clock) is a machine's own. The reference is left out: by it
the torque would no longer be its controller's. Half of the cases are one recording, half are cut into two, the second
of which confirms or refutes. Effects that their authors know to be in the data are no wrong names.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

import autotune
from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError
from autotune.recordings.importing.importing import import_files
from autotune.recordings.importing.options import Options, Wishes
from autotune.recordings.recording import Recording
from bench.measured import DATA

SMOOTHED = 0.02
"""Seconds over which position and velocity are smoothed before a law sees them."""
REACH = 2e-4
"""Of the travel: what a contact bends before it slides, so that friction turns round where the axis does."""
SMALLEST, LARGEST = 0.04, 0.4
"""Of the torque's rms: how large an effect is."""


@dataclass(frozen=True, slots=True)
class MeasuredAxis:
    """A file of others; `hides`: what its authors know to be in it; `one_way`: it moves in one direction only."""

    file: str
    kind: str
    columns: tuple[str, ...]
    unit: str
    torque_unit: str | None
    hides: tuple[str, ...]
    one_way: bool = False

    def recording(self) -> Recording:
        """The file without its reference."""
        wishes = Wishes(self.unit, self.torque_unit, None, None)
        options = Options(self.kind, self.columns, wishes, None, None, None, False)
        return import_files([DATA / self.file], options).recording


BLDC = ("time=Time", "position=Position", "velocity=Velocity", "torque=Iq")
AXES: Mapping[str, MeasuredAxis] = {
    "emps": MeasuredAxis(
        "emps/DATA_EMPS.mat", "mat", ("time=t", "position=qm", "torque=vir*35.15"), "m", None,
        ("direction_asymmetry", "nonlinear_viscous", "torque_ripple", "stribeck"),
    ),
    "bldc-current": MeasuredAxis(
        "bldc_cogging/acc_current.txt", "csv", BLDC, "rad", "A", ("torque_ripple",)
    ),
    "bldc-speed": MeasuredAxis(
        "bldc_cogging/speed_test1.txt", "csv", BLDC, "rad", "A", ("torque_ripple",), one_way=True
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class MeasuredMotion:
    """Position [motion unit], velocity [per second], torque and time [s] of a recording, shape (n,) each.

    Attributes:
        slides: friction of a contact of one, −1 to 1, shape (n,).
        place: position over the travel, 0 to 1, shape (n,); `speed`: velocity over its 95th percentile, shape (n,).
    """

    position: Floats
    velocity: Floats
    torque: Floats
    time: Floats
    slides: Floats
    place: Floats
    speed: Floats

    @classmethod
    def of(cls, recording: Recording) -> MeasuredMotion:
        rows = max(5, int(SMOOTHED / recording.period) | 1)
        position = savgol_filter(recording["position"], rows, 2)
        velocity = savgol_filter(recording["position"], rows, 2, deriv=1, delta=recording.period)
        travel = float(np.ptp(position))
        return cls(
            position,
            velocity,
            recording["torque"],
            recording["time"] - recording["time"][0],
            bent(position, REACH * travel),
            (position - position.min()) / travel,
            velocity / float(np.percentile(np.abs(velocity), 95)),
        )


def bent(position: Floats, reach: float) -> Floats:
    """Friction of one by Dahl's law along a motion, of a contact that slides after some `reach`; shape (n,)."""
    found, z = np.empty_like(position), 0.0
    for i, step in enumerate(np.diff(position, prepend=position[:1])):
        z = float(np.clip((z + step / reach) / (1.0 + abs(step) / reach), -1.0, 1.0))
        found[i] = z
    return found


Law = Callable[[MeasuredMotion, np.random.Generator], Floats]


def spring(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    return m.place - random.uniform(0.2, 0.8)


def hardening_spring(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    away = m.place - random.uniform(0.3, 0.7)
    return away + random.uniform(2.0, 20.0) * away**3


def buffer(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    return np.maximum(m.place - random.uniform(0.4, 0.75), 0.0)


def weight(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    return np.sin(m.position + random.uniform(0.0, 2.0 * np.pi))


def waves(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    return np.sin(2.0 * np.pi * m.place * random.uniform(8.0, 60.0) + random.uniform(0.0, 2.0 * np.pi))


def tight_spot(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    away = (m.place - random.uniform(0.2, 0.8)) / random.uniform(0.03, 0.12)
    return m.slides * np.exp(-(away**2))


def falling_friction(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    slow = np.abs(m.speed) / random.uniform(0.02, 0.15)
    return m.slides * np.exp(-(slow ** random.uniform(0.7, 2.0)))


def loaded_friction(m: MeasuredMotion, _random: np.random.Generator) -> Floats:
    return m.slides * np.abs(m.torque)


def settling_friction(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    passed = m.time / (random.uniform(0.3, 2.0) * m.time[-1])
    return np.asarray(random.choice([-1.0, 1.0]) * m.slides * (1.0 - np.exp(-passed)))


def drag(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    return m.slides * np.abs(m.speed) ** float(random.uniform(1.6, 3.0))


def one_sided_drag(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    return np.asarray(np.maximum(random.choice([-1.0, 1.0]) * m.speed, 0.0))


def long_memory(m: MeasuredMotion, random: np.random.Generator) -> Floats:
    return bent(m.place, random.uniform(0.01, 0.08))


@dataclass(frozen=True, slots=True)
class Plant:
    """A law and the effect it is.

    Attributes:
        one_way: motion in one direction shows it; there each place is a time, and friction an offset.
        round_only: it is of rotary axes.
        largest: of the torque's rms.
    """

    law: Law
    effect: str
    one_way: bool = False
    round_only: bool = False
    largest: float = LARGEST


PLANTS: Mapping[str, Plant | None] = {
    "nothing": None,
    "spring": Plant(spring, "spring"),
    "hardening spring": Plant(hardening_spring, "spring"),
    "buffer": Plant(buffer, "spring"),
    "weight": Plant(weight, "gravity_imbalance", one_way=True, round_only=True),
    "waves": Plant(waves, "torque_ripple"),
    "tight spot": Plant(tight_spot, "position_dependent_friction"),
    "falling friction": Plant(falling_friction, "stribeck"),
    "loaded friction": Plant(loaded_friction, "load_dependent_friction"),
    "settling friction": Plant(settling_friction, "thermal_drift", one_way=True, largest=0.15),
    "drag": Plant(drag, "nonlinear_viscous"),
    "one-sided drag": Plant(one_sided_drag, "direction_asymmetry"),
    "long memory": Plant(long_memory, "reversal_memory"),
}


@dataclass(frozen=True, slots=True)
class PlantedCase:
    """What is planted in which axis, how large [of the torque's rms], and whether a second recording confirms it."""

    axis: str
    plant: str
    level: float
    two: bool
    seed: int


def drawn(number: int, seed: int) -> Iterator[PlantedCase]:
    """Cases: an axis by chance, and something that can be in it."""
    for i in range(number):
        random = np.random.default_rng([seed, i])
        axis = str(random.choice(list(AXES), p=[0.5, 0.4, 0.1]))
        fits = [name for name, plant in PLANTS.items() if plant is None or suits(AXES[axis], plant)]
        name = str(random.choice(fits))
        plant = PLANTS[name]
        largest = plant.largest if plant is not None else SMALLEST
        level = float(np.exp(random.uniform(np.log(SMALLEST), np.log(largest))))
        yield PlantedCase(axis, name, round(level, 4), bool(random.integers(2)), int(random.integers(2**31)))


def suits(axis: MeasuredAxis, plant: Plant) -> bool:
    return (plant.one_way or not axis.one_way) and not (plant.round_only and axis.unit == "m")


def batch_hash(cases: list[PlantedCase]) -> str:
    """sha256 over the list of cases, to be written down before they are run."""
    return hashlib.sha256(json.dumps([asdict(case) for case in cases]).encode()).hexdigest()


def planted(case: PlantedCase) -> Recording:
    """The measured recording with the effect in its torque."""
    recording = AXES[case.axis].recording()
    plant = PLANTS[case.plant]
    if plant is None:
        return recording
    law, random = plant.law, np.random.default_rng(case.seed)
    return raised(recording, lambda motion: law(motion, random), case.level)


def raised(recording: Recording, law: Callable[[MeasuredMotion], Floats], level: float) -> Recording:
    """A recording whose torque holds what a law asks for along its motion, too, of a level over the torque's rms."""
    motion = MeasuredMotion.of(recording)
    own = law(motion)
    torque = motion.torque + own * level * float(np.std(motion.torque) / np.std(own))
    return replace(recording, floats={**recording.floats, "torque": torque})


def judged(case: PlantedCase) -> dict[str, Any]:
    """A case's verdict, whether it is right, and the processor time."""
    whole, began = planted(case), time.process_time()
    first = np.arange(len(whole)) < len(whole) // 2
    recordings = [whole.rows(first), whole.rows(~first)] if case.two else [whole]
    plant = PLANTS[case.plant]
    effect = plant.effect if plant is not None else ""
    row: dict[str, Any] = asdict(case) | {"effect": effect}
    try:
        found = autotune.diagnose(recordings, autotune.fit(recordings[0]))
    except AutotuneError as error:
        return row | {
            "verdict": "refused",
            "why": str(error),
            "found": False,
            "wrong": [],
            "confidence": None,
        }
    own = {effect, *AXES[case.axis].hides}
    doubtful = {one for group in found.confusable for one in group} if found.verdict == "ambiguous" else set()
    wrong = [one for one in found.effects if one not in own and not (one in doubtful and effect in doubtful)]
    row |= {"verdict": found.verdict, "effects": list(found.effects), "confidence": found.confidence}
    row |= {"confusable": [list(group) for group in found.confusable], "wrong": wrong}
    row |= {"found": effect in found.effects, "error": round(found.relative_error, 4)}
    return row | {"cpu": round(time.process_time() - began, 1)}


def table(rows: list[dict[str, Any]]) -> str:
    """What was seen in a batch, of one recording and of two, and of each law."""
    halves = [[row for row in rows if row["two"] is two] for two in (False, True)]
    there = [[row for row in half if row["effect"]] for half in halves]
    wrong = [[row for row in half if row["wrong"]] for half in halves]
    sure = [[row for row in half if row["confidence"] == "confirmed"] for half in wrong]
    refused = [[row for row in half if row["verdict"] == "refused"] for half in halves]
    named = [[row for row in half if row["found"]] for half in there]
    lines = ["| what | one recording | two |", "|---|---|---|"]
    for what, seen, among in (
        ("planted effect named", named, there),
        ("a wrong name", wrong, halves),
        ("a wrong name, confirmed", sure, halves),
        ("refused", refused, halves),
    ):
        shown = [f"{len(part)} of {len(whole)}" for part, whole in zip(seen, among, strict=True)]
        lines.append(f"| {what} | {' | '.join(shown)} |")
    lines += ["", "| planted | named | verdicts |", "|---|---|---|"]
    for plant in PLANTS:
        own = [row for row in rows if row["plant"] == plant]
        verdicts = Counter(row["verdict"] for row in own)
        told = ", ".join(f"{verdict} {count}" for verdict, count in sorted(verdicts.items()))
        lines.append(f"| {plant} | {sum(row['found'] for row in own)} of {len(own)} | {told} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--hash", action="store_true", help="print the sum over the cases, and end")
    parser.add_argument("--out", type=Path, help="a JSON line for each case")
    wanted = parser.parse_args()
    cases = list(drawn(wanted.cases, wanted.seed))
    sys.stdout.write(f"{len(cases)} cases, seed {wanted.seed}, sha256 {batch_hash(cases)}\n")
    if wanted.hash:
        return
    if not DATA.is_dir():
        sys.stdout.write("skipped: ../shared/data is not here\n")
        return
    rows = []
    for case in cases:
        rows.append(judged(case))
        sys.stdout.write(json.dumps(rows[-1]) + "\n")
        sys.stdout.flush()
        if wanted.out is not None:
            wanted.out.write_text("".join(json.dumps(row) + "\n" for row in rows))
    sys.stdout.write(table(rows))


if __name__ == "__main__":
    main()
