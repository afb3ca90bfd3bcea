"""The bristle where recordings hardly tell it: where its stiffness starts, and whether the data tell it at all.

Without presliding experiments the error has several minima over the stiffness, and a base model left in a
poor one makes every candidate look good that moves it. Free although the data say nothing about it, the
bristle makes predictions of held-out data worse.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Flags, Floats, Integers
from autotune.estimation.bias_corrected_fit import PROMISED, ModelFit, Projected, fit_inside_twin
from autotune.estimation.controller import asked
from autotune.estimation.coordinates import FORGOTTEN, since_rest
from autotune.estimation.data import TRAINING, Prepared
from autotune.estimation.disturbance import STILL
from autotune.estimation.least_squares import Fitted, Free, followed, standard_errors
from autotune.estimation.problem import LONGEST_REACH, Correction, Problem, refit
from autotune.estimation.residual import residual, residuals, smoothed
from autotune.estimation.twin_runs import SEED, run_twin
from autotune.models import layout
from autotune.models.drive_model import Packed, base_model
from autotune.models.reversal_memory import REMEMBERS, as_one_bristle
from autotune.models.transmission import has_load

REACHES = (1e-5, 1e-4, 1e-3)  # of the travel
BEGUN_REACHES = (1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
"""The same where nothing is known yet."""
LEAST_ROWS = 50
"""Moving rows of the grid, below which nothing is told."""
DAMPING = 0.3
"""Of sqrt(stiffness · inertia)."""
UNDAMPED = 0.05
"""Of the usual damping: a fit that ends there knows nothing about it."""
STIFFER = (1.0, 3.0, 10.0, 30.0)
QUIETER = 0.7
"""Of the cost: less must be left for another contact to be taken."""
MOST_NOISE = 25.0
"""Times its variance, by which the noise is corrected at most."""
LOOSE = 1.0
"""Relative standard error from which a contact parameter is held."""
RIGID = 25.0
"""Times the stiffness: what is tried where the axis sticks without presliding."""
TIMES = (0.125, 0.25, 0.5, math.sqrt(0.5), 1.0, math.sqrt(2.0), 2.0, 4.0)
"""The damping in presliding, whose twins fill a pass."""
CONTACT = ("stiffness", "micro_damping")
WITHIN = 0.5
"""Mean square of the stretch that is left, above which most rows of an experiment are within the bristle's reach."""


@dataclass(frozen=True, slots=True)
class BaseTold:
    """Inertia, viscous and Coulomb friction and offset as torque and motion tell them by least squares.

    Attributes:
        found: by name; any of them may come out below zero.
        table, target: what they were found in, shape (r, 4) and (r,): moving rows of the training.
        rows: these rows of the grid, shape (m,).
    """

    found: Mapping[str, float]
    table: Floats
    target: Floats
    rows: Flags

    @classmethod
    def of(cls, data: Prepared) -> BaseTold:
        """What prepared data tell."""
        rows = data.role(TRAINING)
        speed = np.percentile(np.abs(data.velocity[data.grid[rows]]), 90)
        moving = rows & (np.abs(data.velocity[data.grid]) > 0.02 * speed)
        parts = {
            "inertia": data.acceleration,
            "viscous": data.velocity,
            "coulomb": np.sign(data.velocity),
            "offset": np.ones(len(data.velocity)),
        }
        table = np.column_stack([smoothed(data, np.ascontiguousarray(x))[moving] for x in parts.values()])
        held = 0.5 * (data.torque + np.concatenate([data.torque[:1], data.torque[:-1]]))
        target = smoothed(data, held)[moving]
        size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
        found = np.linalg.lstsq(table / size, target, rcond=1e-10)[0] / size
        return cls(dict(zip(parts, found.tolist(), strict=True)), table, target, moving)

    def values(self, one_way: bool) -> dict[str, float]:
        """What a fit may begin with: nothing below zero; on an axis that moves one way all friction is Coulomb's."""
        values, scale = dict(self.found), float(np.std(self.target))
        for place, name in enumerate(("inertia", "viscous")):
            values[name] = max(values[name], 1e-3 * scale / max(float(np.std(self.table[:, place])), 1e-300))
        values["coulomb"] = max(values["coulomb"], 1e-2 * scale)
        if one_way:
            values["coulomb"] = max(values["coulomb"] + values["offset"], 1e-2 * scale)
            values["offset"] = 0.0
        return values


def inertia_between_torques(data: Prepared) -> float:
    """Inertia by the torque's sensor less that by the demand [kg m² or kg]; nan where files do not hold both.

    Least squares of the sensor in demand, its slope and bend (the one is later), acceleration, velocity and a
    constant. Zero where both are of one torque, whatever the sensor's scale. A loop between the rows changes its
    torque within each, and where its position loop works less often than its velocity loop it does so with the
    acceleration, by as much as the velocity moves meanwhile: what is read at a moment has too little or too much of
    the inertia, and the newest demand and the torque before it have it wrong by opposite parts.
    """
    if data.sensed is None:
        return math.nan
    rows, demand = data.role(TRAINING), data.recorded_torque
    slope = np.gradient(demand)
    parts = (data.acceleration, demand, slope, np.gradient(slope), data.velocity, np.ones(len(demand)))
    table = np.column_stack([smoothed(data, np.ascontiguousarray(one))[rows] for one in parts])
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    found = np.linalg.lstsq(table / size, smoothed(data, data.sensed)[rows], rcond=1e-10)[0] / size
    return float(found[0] / found[1]) if found[1] > 0.0 else math.nan


def begun_contact(problem: Problem, values: Mapping[str, float]) -> Packed:
    """A base model of these values with the stiffness, of several presliding distances, that leaves least."""
    trials = []
    for reach in BEGUN_REACHES[:1] if problem.data.steady else BEGUN_REACHES:
        stiffness = values["coulomb"] / (reach * problem.scales.travel)
        damping = usual_damping(stiffness, values["inertia"])
        contact = {"stiffness": stiffness, "micro_damping": damping}
        trials.append(base_model({**values, **contact}, motion_unit=problem.data.metadata.motion_unit).pack())
    rows = problem.training > 0
    errors = residuals(problem.data, trials, problem.moved)
    costs = np.array([float(np.mean(error[rows] ** 2)) for error in errors])
    return trials[int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))]


def usual_damping(stiffness: float, inertia: float) -> float:
    """Damping that a contact usually has in presliding, where a fit of it begins [N m s/rad or N s/m]."""
    return DAMPING * math.sqrt(stiffness * inertia)


def usually_damped(packed: Packed) -> Packed:
    """The model with as much damping in presliding as a contact usually has, at least.

    A fit under another law, or without one, may have taken it to nothing, from where no step leads back.
    """
    p = packed.p.copy()
    usual = usual_damping(float(p[layout.STIFFNESS]), float(p[layout.INERTIA]))
    p[layout.MICRO_DAMPING] = max(float(p[layout.MICRO_DAMPING]), usual)
    return Packed(p, packed.on)


def best_contact(problem: Problem, fitted: Fitted, correction: Correction) -> Fitted:
    """The best of several fits that start from other stiffnesses; never worse than `fitted`."""
    found = [fitted, *_short_contacts(problem, fitted.packed, fitted.free, correction)]
    return min(found, key=lambda item: item.cost)


def _short_contacts(
    problem: Problem, packed: Packed, free: Sequence[Free], correction: Correction
) -> list[Fitted]:
    """Fits that start from contacts which slide after each of `REACHES`, without those that do not end."""
    found = []
    for reach in REACHES:
        p = packed.p.copy()
        p[layout.STIFFNESS] = p[layout.COULOMB] / (reach * problem.scales.travel)
        p[layout.MICRO_DAMPING] = usual_damping(p[layout.STIFFNESS], p[layout.INERTIA])
        found.append(refit(problem, Packed(p, packed.on), list(free), correction, 8))
    return [one for one in found if np.isfinite(one.cost)]


def identifiable(problem: Problem, fitted: Fitted, free: Sequence[Free]) -> list[Free]:
    """The free parameters without those of the bristle that a single recording says nothing about."""
    errors = dict(zip((f.name for f in free), standard_errors(fitted, problem.training), strict=True))
    values = fitted.packed.p
    return [f for f in free if f.name not in CONTACT or errors[f.name] < LOOSE * abs(values[f.slot])]


def fitted_contact(
    problem: Problem, fitted: Fitted, correction: Correction, free: Sequence[Free]
) -> tuple[Fitted, list[Free]]:
    """Fit and free parameters that the search of a single recording begins with."""
    best = best_contact(problem, fitted, correction)
    kept = identifiable(problem, best, free)
    held = [f for f in kept if f.name not in CONTACT]
    short = _short_contact(problem, best, correction, held)
    if short is not None:
        best, kept = short, held
    packed = quiet_contact(problem, best.packed)
    if packed is None:
        return best, kept
    again = refit(problem, packed, held, correction, 4)
    return (again, held) if np.isfinite(again.cost) else (best, kept)


def _short_contact(
    problem: Problem, best: Fitted, correction: Correction, held: Sequence[Free]
) -> Fitted | None:
    """The fit with a contact that slides soon, where beside a spring it leaves less than one that hardly ever does.

    None elsewhere. Without the spring, a contact that bends over much of the travel is fitted to what is missing, and
    hides it.
    """
    p = best.packed.p
    if p[layout.COULOMB] <= LONGEST_REACH * problem.scales.travel * p[layout.STIFFNESS]:
        return None
    place = smoothed(problem.data, problem.data.position)[:, None]
    found = []
    for short in _short_contacts(problem, best.packed, held, correction):
        beside = followed(np.hstack([short.jacobian, place]), short.error, problem.training)
        found.append((problem.mean_square(beside, TRAINING), short))
    least, short = min(found, key=lambda one: one[0], default=(math.inf, best))
    return short if least < problem.mean_square(best.error, TRAINING) else None


def quiet_contact(problem: Problem, packed: Packed) -> Packed | None:
    """The model with another contact where its twin rings and the axis did not; None where it does not ring.

    Of presliding a single recording may tell nothing, but the loop would not have been stable on any contact. Where the
    recording contradicts the usual damping, it tells: memory would be found in what that leaves.
    """
    own = packed.p.copy()
    usual = usual_damping(own[layout.STIFFNESS], own[layout.INERTIA])
    undamped = bool(own[layout.MICRO_DAMPING] < UNDAMPED * usual)
    if not undamped and not problem.twin:
        return None
    trials = []
    for stiffer in STIFFER:
        p = own.copy()
        p[layout.STIFFNESS] *= stiffer
        p[layout.MICRO_DAMPING] = max(p[layout.MICRO_DAMPING], usual * math.sqrt(stiffer))
        trials.append(Packed(p, packed.on))
    if not problem.twin:
        return trials[0]
    costs = [_twin_cost(problem, trial) for trial in trials]
    at, as_found = int(np.argmin(costs)), _twin_cost(problem, packed)
    rings = costs[at] < QUIETER * as_found
    contradicted = QUIETER * costs[at] > as_found
    return trials[at] if rings or (undamped and not contradicted) else None


def sticking(problem: Problem, packed: Packed) -> tuple[Problem, tuple[Packed, ...]]:
    """The problem without rows at rest and with what a fit may start from, where no count of presliding is seen.

    There friction holds any torque, and a bristle that is to explain that torque gives way when the axis reverses. No
    starts where the contact is seen, in its bristle or in elements beside that, or has no static friction to stick by.
    """
    p = packed.p
    reach = as_one_bristle(p)[1] if packed.on[REMEMBERS] else float(p[layout.COULOMB] / p[layout.STIFFNESS])
    sticks = reach < problem.data.resolution and p[layout.CREEP_VELOCITY] == 0.0
    if not problem.data.repeated or not sticks or has_load(packed.on):
        return problem, ()
    weight = problem.weight * np.isfinite(since_rest(problem.data, reach)[1])
    if not np.any(weight * problem.training > 0.0):
        return problem, ()
    rigid = p.copy()
    rigid[layout.STIFFNESS] *= RIGID
    return replace(problem, weight=weight), (packed, Packed(rigid, packed.on))


def less_after_rests(problem: Problem, fitted: Fitted) -> Problem:
    """The problem with rows after a rest weighted by how unlike the bristle's stretch at that rest is in repeats.

    Nothing tells how a bristle was stretched at a rest, and slow motion forgets it over its reach only. What one repeat
    has of it and another has not is no level of friction that drifts. So it is in experiments most of whose rows stay
    within that reach, which are little else, however quiet the rest is; in others few rows know of it.
    """
    p = fitted.packed.p
    number, left = since_rest(problem.data, float(p[layout.COULOMB] / p[layout.STIFFNESS]))
    share = np.where(np.isnan(left), 1.0, left)
    weight = problem.weight.copy()
    for block in problem.data.blocks:
        kept = block.by_repeat(share)[0]
        if block.role == TRAINING and block.repeats > 1 and float(np.mean(kept**2)) > WITHIN:
            known = _certainty(block.by_repeat(fitted.error), kept, block.by_repeat(number)[0])
            weight[block.rows] *= np.tile(known, block.repeats)
    return replace(problem, weight=weight)


def _certainty(error: Floats, share: Floats, rest: Integers) -> Floats:
    """Variance of the noise over that with what stretches make, row by row; shape (rows,).

    Args:
        error: by repeat, shape (repeats, rows).
        share, rest: what a bristle has left of its stretch at the last rest, and the number of that rest.
    """
    repeats = len(error)
    unlike = (error - error.mean(axis=0)) * math.sqrt(repeats / (repeats - 1.0))
    group = rest - rest.min()
    power = np.bincount(group, share**2)
    told = power > FORGOTTEN
    stretch = np.array([np.bincount(group, share * row) for row in unlike]) / np.maximum(power, FORGOTTEN)
    noise = float(np.mean((unlike - share * stretch[:, group]) ** 2))
    beyond = float(np.sum(power * np.mean(stretch**2, axis=0) * told)) - noise * float(told.sum())
    if beyond <= 0.0 or noise <= 0.0:
        return np.ones(len(share))
    return np.asarray(noise / (noise + beyond / float(power[told].sum()) * share**2))


def damped_as_twins_creep(problem: Problem, model_fit: ModelFit) -> ModelFit:
    """The model fitted again from the damping in presliding by which its twins leave least; as it is where none do.

    Within the band damping hardly turns the torque. By it an axis that disturbances shake below break-away creeps, and
    that is bias, which a fit holds: it ended at up to five times the damping, and what the creep left there drowned
    half of a ripple. Where the least is left at an end of what was tried, it is tried again from there.
    """
    slot, fitted = layout.MICRO_DAMPING, model_fit.fitted
    if (
        not problem.twin
        or problem.two_masses(fitted.packed)
        or all(one.slot != slot for one in model_fit.free)
    ):
        return model_fit
    packed, now = fitted.packed, TIMES.index(1.0)
    usual = usual_damping(float(packed.p[layout.STIFFNESS]), float(packed.p[layout.INERTIA]))
    damping = np.array(TIMES) * max(float(packed.p[slot]), UNDAMPED * usual)
    damping[now] = packed.p[slot]
    models = [Packed(packed.p.copy(), packed.on) for _ in TIMES]
    for model, value in zip(models, damping, strict=True):
        model.p[slot] = value
    projected = Projected.of(problem, model_fit, (slot,))
    changes, biases = projected.changes(models), problem.until_judged().biases(models, 1)
    costs = np.array([
        math.inf if bias is None else projected.cost(change, bias)
        for change, bias in zip(changes, biases, strict=True)
    ])  # fmt: skip
    best = int(np.argmin(costs))
    if not costs[best] < PROMISED * costs[now]:
        return model_fit
    again = fit_inside_twin(problem, models[best], list(model_fit.free), 2, model_fit.effects)
    if again is None or again.fitted.cost >= fitted.cost:
        return model_fit
    return damped_as_twins_creep(problem, again) if best in (0, len(TIMES) - 1) else again


def as_rough(problem: Problem, packed: Packed) -> Problem:
    """The problem with the noise that makes the twin's torque change from sample to sample as the measured one does.

    Without repeats what the model lacks would pass for noise, and a twin that is disturbed so slides where the axis
    stuck.
    """
    if problem.data.repeated or problem.controller is None or problem.disturbance.process <= 0.0:
        return problem
    measured = _roughness(problem, asked(problem.data, problem.controller))
    shares = []
    for disturbance in (STILL, problem.disturbance):
        run = run_twin(problem.data, packed, problem.controller, disturbance, np.random.default_rng(SEED))
        if not run.stable:
            return problem
        shares.append(_roughness(problem, run.torque))
    calm, rough = shares
    if rough <= calm:
        return problem
    factor = max(measured - calm, 0.0) / (rough - calm)
    return replace(problem, disturbance=problem.disturbance.louder(math.sqrt(min(factor, MOST_NOISE))))


def _roughness(problem: Problem, torque: Floats) -> float:
    """Variance of the torque's changes from sample to sample [(N m)²], by the quieter half of the recording."""
    pieces = [
        np.array_split(np.diff(torque[s.rows]), max(1, (s.stop - s.start) // 200))
        for s in problem.data.stretches
    ]
    return float(np.median([np.var(piece) for part in pieces for piece in part]))


def _twin_cost(problem: Problem, packed: Packed) -> float:
    """Mean square of the residual less the bias of the twin [(N m)²]; infinite where it is unstable."""
    correction = problem.correction(packed, 1)
    if not correction.stable:
        return math.inf
    error = residual(problem.data, packed, problem.moved) - correction.bias
    weight = problem.training
    return float(np.dot(weight, error**2) / max(weight.sum(), 1.0))
