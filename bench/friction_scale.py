"""θ of (5.11) from the legs of a check, on axes whose friction was scaled by 0.7 to 1.3 after their model was made.

    python -m bench.friction_scale --count 50 --seed 1
    python -m bench.friction_scale --year --seed 1

With --year: the days of `bench.year`, and a preload that rises by a fifth on day 160, check by check without the
service; the model is made anew where it would be (first day, re-greased, preload told, at the year's end). What each
check says is held against what had moved friction since the model was made: heat, wear (it creeps), at once (preload or
grease). Days on which no cause moved it by 4 %, or none by twice what the others together did, are not counted.

The legs are those of `autotune check`, played on the simulated drive; the model is that of the axis before, with its
parameters off by 0.3 %, as identification leaves them (identification itself is judged by `bench.identify`).
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import replace
from datetime import timedelta

import numpy as np

from autotune.core.axis import Axis, read_axis
from autotune.core.loop import LocalLoop
from autotune.experiments.record import Recorder, metadata_for
from autotune.experiments.record import play as play_and_record
from autotune.experiments.runner import Programme
from autotune.identify.steady_state import Points, steady_points
from autotune.models.drive_model import DriveModel, base_model
from autotune.monitoring.check import cause_in_words
from autotune.monitoring.check_figures import friction_level
from autotune.monitoring.check_plan import plan_check
from autotune.monitoring.drift import Before
from autotune.monitoring.friction_scale import friction_scale
from autotune_sim.effects import scale_friction
from autotune_sim.inprocess import SimDrive
from autotune_sim.plant import PlantParameters
from autotune_sim.presets import preset, vary
from bench.year import BAD_ENCODER, CUTS, GREASED, SLOW_WEAR, START, STUCK, Day, day_of
from tests.support.identification_programme import AXIS


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
    found = friction_scale(measured_legs(described, scale_friction(plant, 1.0 / true), number), model)
    seconds = plan_check(described, number).legs.duration
    if found is None:
        return true, float("nan"), seconds, False
    return true, found.theta, seconds, found.enough


PRELOAD, MODELS = 160, (0, 132, 175, 331)
CAUSES = ("heat", "wear", "at once")
WORDS = {
    "the temperature": "heat",
    "it crept": "wear",
    "wear or": "wear",
    "at once": "at once",
    "the preload": "at once",
}
"""What a check says, by its words; the first that is found."""


def parts_of(number: int, temperature: float) -> dict[str, float]:
    """Logarithm of what each cause makes of friction on a day."""
    wear = 1.0 + 0.4 * np.clip((number - 60) / 70, 0.0, 1.0)
    slow = 1.0 + 0.2 * np.clip((number - SLOW_WEAR) / 40, 0.0, 1.0)
    once = (0.65 if number >= GREASED else 1.0) * (1.2 if number >= PRELOAD else 1.0)
    return {
        "heat": math.log(1.0 - 0.007 * (temperature - 25.0)),
        "wear": math.log(wear * slow),
        "at once": math.log(once),
    }


def model_on(plant: PlantParameters, random: np.random.Generator) -> DriveModel:
    """As identification leaves it."""
    off = {name: 1.0 + random.normal(0.0, 0.003) for name in ("viscous", "coulomb")}
    values = {"inertia": plant.inertia, "viscous": plant.viscous * off["viscous"], "offset": plant.offset}
    values |= {"coulomb": plant.friction * off["coulomb"], "stiffness": plant.stiffness}
    return base_model({**values, "micro_damping": plant.micro_damping})


def plant_on(day: Day, number: int) -> PlantParameters:
    """The axis of a day; a preload acts on dry friction alone."""
    plant = scale_friction(preset("edm-vertical").plant, day.at_temperature)
    plant = replace(plant, viscous=plant.viscous * day.at_temperature)
    return scale_friction(plant, 1.2) if number >= PRELOAD else plant


def lived(seed: int, days: int) -> list[tuple[int, str, str, str]]:
    """(day, true cause or "", what was said by its words, the sentence) of each check."""
    random, described = np.random.default_rng(seed), read_axis(AXIS)
    known: list[Before] = []
    said: list[tuple[int, str, str, str]] = []
    model, run, begun = None, "", parts_of(0, 25.0)
    for number in range(days):
        day = day_of(number, random)
        if number in CUTS or number in BAD_ENCODER or number == STUCK:
            continue
        plant, now = plant_on(day, number), parts_of(number, day.temperature)
        if number in MODELS or model is None:
            model, run, begun = model_on(plant, random), f"run-{number}", now
        points = measured_legs(described, plant, number)
        level, _ = friction_level(points)
        at = START + timedelta(days=number)
        today = Before(at.isoformat(), run, None, False, level, day.temperature, math.nan)
        sentence = judged(points, model, known, today)
        known.append(today)
        said.append((number, true_cause(begun, now), spoken(sentence), sentence))
    return said


def judged(points: Points, model: DriveModel, known: list[Before], today: Before) -> str:
    """What the check of today says of friction as a whole."""
    scale = friction_scale(points, model)
    if scale is None:
        return ""
    mine = next((one for one in known if one.run == today.run), today)
    return cause_in_words(scale, known, today, mine.temperature)


def true_cause(begun: dict[str, float], now: dict[str, float]) -> str:
    """What moved friction since the model was made; "" where nothing did, or nothing clearly."""
    moved = {name: abs(now[name] - begun[name]) for name in CAUSES}
    most = max(CAUSES, key=lambda name: moved[name])
    others = sum(moved.values()) - moved[most]
    return most if moved[most] >= 0.04 and moved[most] >= 2.0 * others else ""


def spoken(sentence: str) -> str:
    """The cause that a sentence names; "" for none."""
    return next((cause for words, cause in WORDS.items() if words in sentence), "")


def measured_legs(described: Axis, plant: PlantParameters, seed: int) -> Points:
    """The legs of a check on a plant."""
    legs = plan_check(described, seed).legs
    programme = Programme((legs,), described.limits, seconds=1000.0)
    recorder = Recorder(metadata_for(described, None), programme.labels)
    play_and_record(
        LocalLoop(SimDrive(replace(preset("edm-vertical"), plant=plant), seed)), programme, recorder
    )
    return steady_points(recorder.recording().select("steady_state"))


def year(seed: int, days: int) -> None:
    rows = lived(seed, days)
    print(f"{len(rows)} checks of seed {seed}; what moved friction, and what was said:")
    for true in (*CAUSES, ""):
        counted = Counter(said for _, cause, said, _ in rows if cause == true)
        told = ", ".join(f"{said or 'nothing'} {count}" for said, count in counted.most_common())
        print(f"  {true or 'nothing clearly'}: {told}")
    wrong = [(day, true, sentence) for day, true, said, sentence in rows if true and said not in (true, "")]
    for one in wrong[:20]:
        print("  wrong:", *one)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--year", action="store_true")
    parser.add_argument("--days", type=int, default=365)
    wanted = parser.parse_args()
    if wanted.year:
        year(wanted.seed, wanted.days)
        return
    rows = np.array([one(wanted.seed, number) for number in range(wanted.count)])
    error = np.abs(rows[:, 1] / rows[:, 0] - 1.0)
    print(f"{wanted.count} axes of seed {wanted.seed}, {rows[0, 2]:.0f} s of motion each:")
    print(f"θ off by {np.median(error):.2%} (median), {np.nanmax(error):.2%} at most")
    print(f"within 2 %: {np.mean(error <= 0.02):.0%}; a scale is enough on {np.mean(rows[:, 3]):.0%}")


if __name__ == "__main__":
    main()
