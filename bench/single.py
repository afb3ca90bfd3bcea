"""Bench of the diagnosis on recordings as others make them: one trajectory, no repeats, often no controller.

    python -m bench.single --runs 24 --seed 30000

Each run plants one effect or none on the simulated axis, plays two different trajectories once, dresses the
recording (sampling, units, encoder, columns), fits a model to the first and diagnoses it with the first alone
and with both. Every line on standard output is one run, as JSON; a summary ends it. Seeds below 30000 were
used while the method was made.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError
from autotune.diagnose.baseline import quiet
from autotune.diagnose.fit_recordings import fit_recordings
from autotune.diagnose.general_fit import fit_model
from autotune.diagnose.verdict import Diagnosis, diagnose
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording
from autotune_sim.presets import Preset
from bench.diagnosis import MEDIUM, plain_axis, planted_size
from bench.diagnosis_data import Programme, move, play

NULL_SHARE = 0.3
AMPERE = 0.12  # N m/A
LEAD = 5e-3 / (2 * math.pi)  # m/rad
PLANTED = tuple(name for name in MEDIUM if name not in ("torque_lag", "encoder_eccentricity"))
"""What one trajectory can show."""


def points(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """Moves from place to place at many speeds, with short rests."""
    parts, place, rows = [np.zeros(1)], 0.0, round(seconds / period)
    while sum(map(len, parts)) < rows:
        target = random.uniform(-4.5, 4.5)
        speed, acceleration = 10 ** random.uniform(-0.5, 1.1), 10 ** random.uniform(1.2, 2.4)
        step = move(place, target, speed, acceleration)
        if period != 1e-3:
            step = np.interp(np.arange(0, len(step) * 1e-3, period), np.arange(len(step)) * 1e-3, step)
        parts += [step, np.full(round(random.uniform(0.02, 0.4) / period), target)]
        place = target
    return np.concatenate(parts)[:rows]


def waves(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """A slow and a quick wave and some between, never twice the same."""
    t = np.arange(round(seconds / period)) * period
    q = np.zeros(len(t))
    for low, high, speed in ((0.05, 0.15, 2.0), (0.2, 0.6, 2.5), (0.8, 2.0, 1.5), (3.0, 7.0, 0.8)):
        f = random.uniform(low, high)
        q += speed / (2 * np.pi * f) * np.sin(2 * np.pi * f * t + random.uniform(0, 6.28))
    return np.asarray((q - q[0]) * np.minimum(1.0, t / 0.5))


def sweep(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """A sine that grows quicker and smaller."""
    t = np.arange(round(seconds / period)) * period
    low, high = random.uniform(0.1, 0.3), random.uniform(3.0, 8.0)
    rate = math.log(high / low) / seconds
    f = low * np.exp(rate * t)
    phase = 2 * np.pi * (f - low) / rate
    speed = random.uniform(2.0, 6.0)
    return np.asarray(speed / (2 * np.pi * f) * np.sin(phase))


def periodic(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """One period again and again: two harmonics."""
    t = np.arange(round(seconds / period)) * period
    f = random.uniform(0.25, 0.6)
    a = random.uniform(2.0, 6.0) / (2 * np.pi * f)
    p = random.uniform(0.0, 6.28)
    return np.asarray(a * (np.sin(2 * np.pi * f * t) + 0.35 * (np.sin(6 * np.pi * f * t + p) - np.sin(p))))


def triangles(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """Constant speeds back and forth, each twice, with rounded corners."""
    parts, rows = [np.zeros(1)], round(seconds / period)
    while sum(map(len, parts)) < rows:
        speed, reach = 10 ** random.uniform(-0.7, 1.0), random.uniform(0.5, 4.0)
        for target in (reach, -reach, 0.0):
            step = move(parts[-1][-1], target, speed, 80.0)
            parts.append(np.interp(np.arange(0, len(step) * 1e-3, period), np.arange(len(step)) * 1e-3, step))
    return np.concatenate(parts)[:rows]


TRAJECTORIES: Mapping[str, Callable[[np.random.Generator, float, float], Floats]] = {
    "points": points, "waves": waves, "sweep": sweep, "periodic": periodic, "triangles": triangles,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Dress:
    """How a recording looks: every `every`-th sample, what is known, in which units."""

    name: str
    every: int = 1
    period: float = 1e-3
    counts: int = 50_000
    reference: bool = True
    controller: bool = True
    metres: bool = False
    amperes: bool = False
    command: bool = True


DRESSES = (
    Dress("plain"),
    Dress("no controller", controller=False),
    Dress("no reference", controller=False, reference=False),
    Dress("500 Hz", every=2, controller=False),
    Dress("250 Hz", every=4, controller=False, reference=False),
    Dress("100 Hz", every=10, controller=False, reference=False),
    Dress("loop of 2 ms", period=2e-3),
    Dress("metres", controller=False, metres=True),
    Dress("amperes", controller=False, reference=False, amperes=True),
    Dress("coarse", counts=4000, controller=False),
    Dress("measured torque", controller=False, reference=False, command=False),
)


def dressed(recording: Recording, dress: Dress) -> Recording:
    """The recording as its maker would hand it over."""
    motion = LEAD if dress.metres else 1.0
    torque = (1.0 / LEAD if dress.metres else 1.0) * (1.0 / AMPERE if dress.amperes else 1.0)
    held = recording["torque_command"] if dress.command else recording["torque"]
    columns = {
        "time": recording["time"],
        "position": motion * recording["position"],
        "torque": torque * held,
    }
    if dress.reference:
        columns["reference"] = motion * recording["reference"]
    columns = {name: values[:: dress.every] for name, values in columns.items()}
    old = recording.metadata
    limit = None if old.torque_limit is None else torque * old.torque_limit
    metadata = replace(
        old,
        sample_period=old.sample_period * dress.every,
        motion_unit="m" if dress.metres else "rad",
        position_resolution=None,
        torque_limit=limit if dress.controller else None,
        controller=old.controller if dress.controller else None,
        extra={"torque_unit": "A"} if dress.amperes else {},
    )
    return Recording.from_columns(columns, metadata, "move")


def played(axis: Preset, dress: Dress, kind: str, seed: int, seconds: float) -> Recording:
    axis = replace(axis, period=dress.period, plant=replace(axis.plant, counts=dress.counts))
    path = TRAJECTORIES[kind](np.random.default_rng([seed, 3]), seconds, dress.period)
    what = Programme(path, ["move"] * len(path), [0] * len(path))
    return dressed(play(axis, seed, what), dress)


@dataclass(frozen=True, slots=True)
class Case:
    """What one run is: drawn from its seed."""

    seed: int
    planted: tuple[str, ...]
    size: float
    dress: Dress
    kinds: tuple[str, str]


def case(seed: int, plain: bool = False) -> Case:
    random = np.random.default_rng([seed, 1])
    null = random.uniform() < NULL_SHARE
    effect = str(random.choice(PLANTED))
    size = float(random.choice([0.7, 1.0, 1.5]))
    dress = DRESSES[int(random.integers(len(DRESSES)))]
    one, two = random.choice(list(TRAJECTORIES), 2, replace=False).tolist()
    return Case(seed, () if null else (effect,), size, DRESSES[0] if plain else dress, (str(one), str(two)))


def run(one: Case, seconds: float) -> dict[str, Any]:
    """Fits a model to the first trajectory, then diagnoses it, and with both."""
    effects = {name: planted_size(name, one.size * MEDIUM[name]) for name in one.planted}
    axis = plain_axis(one.seed, effects)
    first, second = (
        played(axis, one.dress, kind, one.seed + 7 * i, seconds) for i, kind in enumerate(one.kinds)
    )
    line: dict[str, Any] = {
        "seed": one.seed, "planted": list(one.planted), "size": one.size, "dress": one.dress.name,
        "kinds": list(one.kinds),
    }  # fmt: skip
    began = time.process_time()
    try:
        model = fitted(first)
        line["alone"] = told(diagnose([first], model))
        line["both"] = told(diagnose([first, second], model))
    except AutotuneError as refused:
        line["refused"] = str(refused)
    line["seconds"] = round(time.process_time() - began, 1)
    return line


def fitted(recording: Recording) -> DriveModel:
    """The model that the command line would write, else that of the search."""
    result = fit_recordings([recording], progress=quiet)
    return result.model if result.model is not None and result.valid else fit_model([recording]).model


def told(result: Diagnosis) -> dict[str, Any]:
    best = sorted(result.candidates, key=lambda c: -c.gain)[:4]
    return {
        "verdict": result.verdict,
        "effects": list(result.effects),
        "confidence": result.confidence,
        "twin": result.twin,
        "confusable": [list(rivals) for rivals in result.confusable],
        "best": [f"{c.effect} {100 * c.gain:.0f}" for c in best],
        "notes": [note for note in result.notes if "Carried" in note or "controller" in note],
    }


def _wrong(line: dict[str, Any], found: dict[str, Any]) -> bool:
    """Whether something is named that is not there, and not in doubt with what is there.

    On an axis in metres an imbalance is a ripple.
    """
    planted = set(line["planted"])
    if line["dress"] == "metres" and "gravity_imbalance" in planted:
        planted.add("torque_ripple")
    doubted = found["verdict"] == "ambiguous" and planted & set(found["confusable"][0])
    return bool(set(found["effects"]) - planted) and not doubted


def summary(lines: list[dict[str, Any]]) -> str:
    """Wrong names, wrong confirmed ones, nulls named, right ones; by number of files."""
    rows = [f"{len(lines)} runs, {sum('refused' in one for one in lines)} refused"]
    for files in ("alone", "both"):
        done = [one for one in lines if files in one]
        nulls = [one for one in done if not one["planted"]]
        planted = [one for one in done if one["planted"]]
        wrong = [one for one in done if _wrong(one, one[files])]
        sure = [one for one in wrong if one[files]["confidence"] == "confirmed"]
        right = [one for one in planted if one[files]["effects"] == one["planted"]]
        proven = [one for one in right if one[files]["confidence"] == "confirmed"]
        rows.append(
            f"{files}: nulls {len(nulls)}, named {sum(bool(one[files]['effects']) for one in nulls)}; planted "
            f"{len(planted)}, right {len(right)}, confirmed {len(proven)}; wrong name {len(wrong)}, confirmed "
            f"{len(sure)}: seeds {[one['seed'] for one in wrong]}"
        )
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=30_000)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--plain", action="store_true", help="always 1 kHz with reference and controller")
    given = parser.parse_args()
    lines = list(_lines(given.runs, given.seed, given.seconds, given.plain))
    print(summary(lines), file=sys.stderr)


def _lines(runs: int, seed: int, seconds: float, plain: bool) -> Iterator[dict[str, Any]]:
    for number in range(runs):
        line = run(case(seed + number, plain), seconds)
        print(json.dumps(line), flush=True)
        yield line


if __name__ == "__main__":
    main()
