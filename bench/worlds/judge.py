"""One case: play it, fit a model, diagnose it, all by the public face; what came out as one JSON object."""

from __future__ import annotations

import math
import time
import warnings
from typing import Any

import numpy as np

import autotune
from autotune.models.table import EFFECTS
from bench.worlds.cases import Case, Ready, ready
from bench.worlds.names import LOOPS
from bench.worlds.play import RanAway, recording, whole
from bench.worlds.programme import Programme, programme
from bench.worlds.world import World

Line = dict[str, Any]


def judged(case: Case) -> Line:
    """Runs a case; a refusal or a failure is a result too."""
    warnings.simplefilter("ignore")
    line: Line = {"key": case.key, "kind": case.kind, "seed": case.seed, "truth": list(case.truth)}
    line |= {"laws": [law for _, law in case.effects], "asked_ratio": round(case.ratio, 3)}
    try:
        made = ready(case)
    except RanAway as reason:
        return line | {"verdict": "no world", "why": str(reason)}
    line |= _surroundings(made)
    return line | diagnosed(made)


def _surroundings(made: Ready) -> Line:
    """What the world is like, for tables by cause."""
    world, plant = made.world, made.world.plant
    return {
        "world": world.seed,
        "ratios": [round(r, 2) for r in made.ratios],
        "noise": made.noise,
        "noise_share": round(made.noise / plant.coulomb, 4),
        "unit": world.unit,
        "cycle": world.loop.period,
        "loop": LOOPS[world.loop.kind],
        "dead": world.loop.dead,
        "stated": world.loop.stated,
        "jitter": round(world.loop.jitter / world.loop.cycle, 3),
        "bandwidth_hz": round(world.loop.bandwidth / 6.2832, 1),
        "colour": world.around.colour,
        "memory": round(world.around.memory, 2),
        "level": round(world.around.level / plant.coulomb, 4),
        "sensor": round(world.around.sensor / plant.coulomb, 4),
        "torque_step": round(world.around.step / plant.coulomb, 5),
        "columns": world.around.columns,
        "instant": world.around.instant,
        "counts_a_reach": round(plant.reach / plant.resolution, 2),
        "travel": 2.0 * plant.travel,
        "other_family": round(plant.other, 3),
        "offset": round(plant.offset / plant.coulomb, 3),
        "load": [round(plant.load_inertia, 2), round(plant.load_friction, 2)],
        "planted": [[p.name, p.law, *p.e[:4]] for p in world.planted],
        "waves": [list(wave) for p in world.planted for wave in p.waves],
    }


def diagnosed(made: Ready) -> Line:
    """Fit and diagnosis of the case's recording."""
    taken = whole(made.world)
    hidden = made.case.truth if made.case.kind == "removed" else ()
    began = time.process_time()
    line: Line = {"rows": len(taken), "seconds_recorded": round(len(taken) * taken.period, 1)}
    try:
        fitted = autotune.fit(taken)
        between = time.process_time()
        if fitted.model is None:
            return line | {"verdict": "refused", "why": fitted.reason, "cpu": round(between - began, 2)}
        found = autotune.diagnose(taken, fitted, candidates=_without(hidden))
    except autotune.AutotuneError as refused:
        return line | {
            "verdict": "refused",
            "why": str(refused),
            "cpu": round(time.process_time() - began, 2),
        }
    except Exception as failed:  # noqa: BLE001 a crash of the diagnosis is a result of this bench
        return line | {"verdict": "crash", "why": repr(failed), "cpu": round(time.process_time() - began, 2)}
    line |= {"fit_cpu": round(between - began, 2), "cpu": round(time.process_time() - between, 2)}
    return line | _found(found, fitted) | _against_truth(made, found, fitted)


def _found(found: Any, fitted: Any) -> Line:
    best = sorted(found.candidates, key=lambda c: -c.gain)[:4]
    return {
        "valid": fitted.valid,
        "verdict": found.verdict,
        "effects": list(found.effects),
        "confidence": found.confidence,
        "confusable": [list(r) for r in found.confusable],
        "best": [[c.effect, round(c.gain, 4), c.accepted, c.why] for c in best],
        "twin": found.twin,
        "floor": found.noise_floor_rms,
        "error_test": found.error_test,
        "relative_error": round(found.relative_error, 4),
        "next": found.next_experiment,
        "notes": list(found.notes),
    }


def _against_truth(made: Ready, found: Any, fitted: Any) -> Line:
    """Error on the unseen test over what the true model would leave: what two plays of it do not share."""
    if not math.isfinite(found.error_test):
        return {"over_truth": None}
    try:
        floor = autotune.compare(_twice(made.world), fitted).noise_floor_rms
    except autotune.AutotuneError:
        return {"over_truth": None}
    return {"over_truth": round(found.error_test / floor, 4) if floor > 0 else None, "true_floor": floor}


def _twice(world: World) -> autotune.Recording:
    """The test trajectory alone, played twice with other noise, as two repeats of one experiment."""
    what = programme(world, 1)
    rows = what.names == "test"
    still = np.zeros(round(0.3 / world.loop.period))
    path = np.concatenate([still, what.reference[rows]])
    labels = np.concatenate([np.full(len(still), "conditioning"), np.full(int(rows.sum()), "probe")])
    parts = [
        recording(world, Programme(path, labels, np.full(len(path), repeat)), seed=500 + repeat)
        for repeat in range(2)
    ]
    both = {name: np.concatenate([part[name] for part in parts]) for name in parts[0].floats}
    both["time"] = np.arange(2 * len(path)) * world.loop.period
    return autotune.Recording.from_columns(
        both, parts[0].metadata, np.tile(labels, 2), np.repeat(np.arange(2), len(path))
    )


def _without(hidden: tuple[str, ...]) -> list[str]:
    """The library of effects without the true one."""
    return [name for name in EFFECTS if name not in hidden]
