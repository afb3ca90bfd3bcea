"""One case: play it, fit a model, diagnose it, all by the public face; what came out as one JSON object."""

from __future__ import annotations

import math
import time
import warnings
from typing import Any

import numpy as np

import autotune
from autotune.models.table import EFFECTS
from autotune.models.torque_lag import IS_LATE, TIME_CONSTANT
from bench.worlds import sizes
from bench.worlds.cases import ANY, LONELY, Case, Ready, Wanted, ready
from bench.worlds.lone import CHANGES, DISTURBED, TRAJECTORIES, alone, second_file
from bench.worlds.names import LOOPS
from bench.worlds.play import RanAway, recording, whole
from bench.worlds.programme import Programme, programme
from bench.worlds.world import Floats, World

Line = dict[str, Any]


def judged(case: Case, wanted: Wanted = ANY) -> Line:
    """Runs a case; a refusal or a failure is a result too."""
    warnings.simplefilter("ignore")
    line: Line = {"key": case.key, "kind": case.kind, "seed": case.seed, "truth": list(case.truth)}
    line |= {"laws": [law for _, law in case.effects], "asked_ratio": round(case.ratio, 3)}
    try:
        made = ready(case, wanted)
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
        "fading": [plant.fade_law, round(plant.fade_speed / plant.top_speed, 4)],
        "falling": [
            plant.low_law,
            round(plant.low_speed / plant.top_speed, 4),
            round(plant.low_size / plant.coulomb, 3),
        ],
        "load": [round(plant.load_inertia, 2), round(plant.load_friction, 2)],
        "late": lateness(world),
        "planted": [[p.name, p.law, *p.e[:4]] for p in world.planted],
        "waves": [list(wave) for p in world.planted for wave in p.waves],
    }


def diagnosed(made: Ready) -> Line:
    """Fit and diagnosis of the case's recording."""
    if made.case.kind in LONELY:
        return _lonely(made)
    taken = whole(made.world)
    hidden = made.case.truth if made.case.kind == "removed" else ()
    began = time.process_time()
    line: Line = {"rows": len(taken), "seconds_recorded": round(len(taken) * taken.period, 1)}
    try:
        fitted = autotune.fit(taken, effects=_of_base(made))
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
    return line | _found(found, fitted) | _against_truth(made, found) | {"late_told": _late_told(found)}


def lateness(world: World) -> float:
    """By how much the torque comes after the demand that asked for it, in the mean [s]: its lag and the current loop.

    Less what this simulation acts early by: half a tick, as a current loop is stepped at the end of one, and as much as
    two poles (a tick) and a running mean (half of one) begin with.
    """
    tick = world.loop.tick
    early = {1: 0.0, 2: tick, 3: 0.5 * tick}
    lags = sum(one.e[0] - early[one.law] for one in world.planted if one.name == "torque_lag")
    return float(lags + world.plant.current_tau - 0.5 * tick)


def _of_base(made: Ready) -> list[str]:
    """Effects that the world's base has, and the first fit is told of."""
    return ["stribeck"] if made.world.plant.low_law else []


def _lonely(made: Ready) -> Line:
    """A trajectory without repeats, fitted and diagnosed; with a second file where the case has one."""
    rng = np.random.default_rng([made.world.seed, 1404])
    one, two = rng.permutation(list(TRAJECTORIES))[:2].tolist()
    change = str(rng.choice(DISTURBED if made.case.kind == "disturbed" else CHANGES))
    files = [alone(made.world, one, rng, 0)]
    line: Line = {"kinds": [one], "rows": len(files[0])}
    if made.case.kind != "lone":
        files.append(second_file(made.world, change, two, rng, 1))
        line |= {"kinds": [one, two], "change": change}
    began = time.process_time()
    try:
        fitted = autotune.fit(files[0], effects=_of_base(made))
        if fitted.model is None:
            return line | {"verdict": "refused", "why": fitted.reason}
        found = autotune.diagnose(files, fitted)
    except autotune.AutotuneError as refused:
        return line | {"verdict": "refused", "why": str(refused)}
    except Exception as failed:  # noqa: BLE001 a crash of the diagnosis is a result of this bench
        return line | {"verdict": "crash", "why": repr(failed)}
    return line | {"lone_cpu": round(time.process_time() - began, 2)} | _found(found, fitted)


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


def _against_truth(made: Ready, found: Any) -> Line:
    """Error on the unseen test over what the true model would leave: what two plays of it do not share."""
    try:
        taps = np.asarray(found._diagnosis.problem.data.taps)
    except AttributeError:
        return {"over_truth": None}
    floor = _floor(made.world, taps / taps.sum())
    known = math.isfinite(found.error_test) and floor > 0.0
    return {"over_truth": round(found.error_test / floor, 4) if known else None, "true_floor": floor}


def _late_told(found: Any) -> float | None:
    """By how much the torque comes late as it was found [s]: what was taken out, and a lag of the model."""
    problem = found._diagnosis.problem
    if problem is None or not problem.twin:
        return None
    fit, data = found._diagnosis.model_fit or found._diagnosis.root, problem.data
    own = float(fit.fitted.packed.p[TIME_CONSTANT]) if fit.fitted.packed.on[IS_LATE] else 0.0
    return float(data.late * data.period + data.lag + own)


def _floor(world: World, taps: Floats) -> float:
    """Rms of half the difference of two plays of the test, torque less the true base's, through the same low-pass."""
    what = programme(world, 1)
    chosen = what.names == "test"
    path = np.concatenate([np.zeros(round(0.3 / world.loop.period)), what.reference[chosen]])
    probe = Programme(path, np.full(len(path), "scans"), np.zeros(len(path), dtype=np.int64))
    errors, rows = [], np.ones(len(path), dtype=np.bool_)
    for seed in (500, 501):
        taken = recording(world, probe, seed)
        errors.append(np.convolve(sizes.unexplained(world, taken), taps, mode="same"))
        rows &= sizes.moving(probe, world, taken["position"])
    rows[: len(taps)] = rows[-len(taps) :] = False
    scale = 1.0 + world.around.unit_error
    return scale * float(np.sqrt(np.mean(0.5 * (errors[0] - errors[1])[rows] ** 2))) if rows.any() else 0.0


def _without(hidden: tuple[str, ...]) -> list[str]:
    """The library of effects without the true one."""
    return [name for name in EFFECTS if name not in hidden]
