"""Fits inside the twin: what a model's own bias makes of its residual, followed to where nothing is better.

On a rigid axis the bias changes slowly with the parameters: it is held during a fit and renewed after it.
Two masses ring, and their bias changes as fast as the residual itself: there every single step is judged by
the bias that belongs to it, and runs of the twin tell how everything moves it (`_sensed`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.cross_validation import Unseen, held_out
from autotune.estimation.data import TEST, TRAINING, Prepared, first_round, spread
from autotune.estimation.least_squares import Fitted, Free, done_alone, fitting, jacobian
from autotune.estimation.problem import Correction, Problem, refit
from autotune.estimation.residual import residual, residuals
from autotune.models.drive_model import Packed
from autotune.models.lanes import WIDTH
from autotune.models.transmission import BETWEEN

FreeAt: TypeAlias = Callable[[Packed], Sequence[Free]]
"""What is free of a fit that begins at a model: scale and step of a parameter may go by where it begins."""
LEVEL_GROUND = 1.005
"""What the cost may rise by from a twin to the next: its noise."""
MOST_HALVINGS = 3
ACROSS_A_RIDGE = 1.5
"""What the cost may rise by where only a whole step is left to try."""
STEPS_A_ROUND = 4
COARSE = 0.15
"""Of a parameter, or of its scale where that is less: difference for what it changes of two masses' bias; contact makes
small ones noise."""
STUCK, NEAR = 0.9, 0.5
"""Of the cost at its start: a fit that comes no lower has not found its way, unless it began so near the end."""
LEAST_CHANGE = 0.2
"""Of the scale of a parameter that has come near zero: what its difference goes by."""
MOST_PLACES = 4
NEAR_NOISE = 1.5
"""Times the variance between repeats: a fit that comes so low has found its way."""
SHARP = 9
"""Simulations for the bias that two masses are judged by: their contact makes that of a few a matter of luck."""
PROMISED = 0.995
"""Of the cost before a change (`Projected`): what it must get below to be followed."""
ENOUGH = 0.01
"""Relative fall of the cost that is not worth another step between two masses: the chance of their bias."""


@dataclass(frozen=True, slots=True)
class ModelFit:
    """A model at its best: fit, the bias that belongs to it, and its error on unseen experiments.

    `converged`: more rounds would not make it better.
    """

    fitted: Fitted
    correction: Correction
    unseen: Unseen
    effects: tuple[str, ...] = ()
    converged: bool = False

    @property
    def free(self) -> tuple[Free, ...]:
        return self.fitted.free


def fit_inside_twin(
    problem: Problem,
    start: Packed | Twinned,
    free: Sequence[Free],
    rounds: int,
    effects: tuple[str, ...] = (),
    near: Fitted | None = None,
    target: float = math.inf,
) -> ModelFit | None:
    """Fits inside the twin. None where the twin is unstable.

    `start` is a model, or a place whose bias is known. `near` is a fit of the same parameters nearby, whose
    sensitivities serve the first step. Between two masses a fit that cannot be expected to reach the cost `target`
    is given up.
    """
    here = start if isinstance(start, Twinned) else twinned(problem, start)
    if here is None:
        return None
    best = here
    if problem.two_masses(here.packed):
        return _step_by_step(problem, here, free, STEPS_A_ROUND * rounds, effects, target)
    last: Fitted | None = None
    for _ in range(rounds):
        last = refit(problem, here.packed, list(free), here.correction, 4 if problem.twin else 12, near)
        found = _downhill(problem, last, here)
        if found is None:
            break
        here, near = found, last
        best = here if here.cost < best.cost else best
    if last is None:
        return None
    fitted = replace(last, packed=best.packed, error=best.error, cost=best.cost)
    return _model_fit(problem, fitted, best.correction, effects)


def fit_from_starts(
    problem: Problem,
    starts: Sequence[Packed],
    enough: float,
    free: Sequence[Free] | FreeAt,
    effects: tuple[str, ...],
    target: float = math.inf,
) -> ModelFit | None:
    """Fits from the first of several places that costs at most `enough`, and from the next where one is stuck.

    Where none costs so little, from the best of them. For two masses, whose way downhill chance may bar. None where
    the twin is unstable everywhere. `free`: at every place, or by place.
    """

    def fit(here: Twinned, least: float) -> ModelFit | None:
        own = free(here.packed) if callable(free) else free
        return fit_inside_twin(problem, here, own, 2, effects, target=least)

    best: ModelFit | None = None
    dear: list[Twinned] = []
    tried = 0
    for number, packed in enumerate(starts):
        if number % 2 == 0:  # two starts fill a pass
            problem.known_together(starts[number : number + 2], problem.simulations + 1)
        here = twinned(problem, packed)
        if here is None:
            continue
        if here.cost > enough:
            dear.append(here)
            continue
        least = target if best is None else min(target, best.fitted.cost)
        model_fit = fit(here, least)
        tried += 1
        if model_fit is not None and (best is None or model_fit.fitted.cost < best.fitted.cost):
            best = model_fit
        if tried >= MOST_PLACES or (
            model_fit is not None and _arrived(problem, model_fit, here.cost, enough)
        ):
            break
    if best is not None or not dear:
        return best
    here = min(dear, key=lambda place: place.cost)
    return fit(here, target)


def _arrived(problem: Problem, model_fit: ModelFit, before: float, enough: float) -> bool:
    """Whether a fit has found its way: to the noise where that is known, else far enough down."""
    floor = problem.noise_variance(model_fit.fitted.error, TRAINING)
    cost = model_fit.fitted.cost
    if math.isfinite(floor):
        return cost < NEAR_NOISE * floor
    return cost < STUCK * before or before < NEAR * enough


def _step_by_step(
    problem: Problem,
    here: Twinned,
    free: Sequence[Free],
    steps: int,
    effects: tuple[str, ...],
    target: float,
) -> ModelFit | None:
    """A fit whose every step is judged by its own bias."""
    found = stepped(problem, here, free, steps, target, all_sensed=True)
    sharp = twinned(problem, found.packed, SHARP if found.cost < target else None)
    if sharp is None:
        return None
    fitted = replace(found, error=sharp.error, cost=sharp.cost)
    return replace(_model_fit(problem, fitted, sharp.correction, effects), converged=found.converged)


def stepped(
    problem: Problem,
    here: Twinned,
    free: Sequence[Free],
    steps: int,
    target: float = math.inf,
    hopeful: float = math.inf,
    all_sensed: bool = False,
) -> Fitted:
    """So many steps between two masses, each with the bias that belongs to it; `target`, `hopeful`: as in `fitting`.

    What is between them moves the bias; `all_sensed`: so does everything else that is free, for a run of the twin each.
    """
    fitted_part = problem.until_trained()

    def judged(models: Sequence[Packed]) -> list[tuple[Floats, Floats] | None]:
        models = models[: fitted_part.twins_alike(models)]
        found = fitted_part.corrections(models, problem.simulations + 1)
        return [
            (fitted_part.raw(packed), correction.bias) if correction.stable else None
            for packed, correction in zip(models, found, strict=True)
        ]

    def sensed(packed: Packed, bias: Floats) -> tuple[Floats, Floats]:
        return _sensed(fitted_part, packed, free, bias, all_sensed)

    steps_of_fit = fitting(
        problem.data, here.packed, free, here.correction.bias, problem.training, steps, ENOUGH,
        judged=judged, sensed=sensed, whole=False, target=target, hopeful=hopeful,
    )  # fmt: skip
    return done_alone(steps_of_fit, problem.moved)


def _sensed(
    problem: Problem, packed: Packed, free: Sequence[Free], bias: Floats, everything: bool = False
) -> tuple[Floats, Floats]:
    """Sensitivities between two masses, as `least_squares.jacobian` gives them.

    What is between the masses changes the bias alone, by runs that are all shaken alike. What acts at the motor changes
    the inverse of the measured motion, and the bias less: it is held unless `everything` is sensed.
    """
    columns, scales = jacobian(problem.data, problem.moved, packed, free, problem.raw(packed))
    columns[:, [i for i, one in enumerate(free) if one.slot in BETWEEN]] = 0.0
    moving = [i for i, one in enumerate(free) if everything or one.slot in BETWEEN]
    models: list[Packed] = []
    changes: list[float] = []
    for i in moving:
        value = float(packed.p[free[i].slot])
        change = COARSE * max(min(free[i].scale, abs(value)), LEAST_CHANGE * free[i].scale)
        changes.append(change if value + change <= free[i].upper else -change)
        p = packed.p.copy()
        p[free[i].slot] = value + changes[-1]
        models.append(Packed(p, packed.on))
    rows = problem.training > 0
    biases = problem.biases(models, problem.simulations + 1)
    for i, change, moved in zip(moving, changes, biases, strict=True):
        if moved is not None:
            columns[rows, i] += ((bias - moved) * (scales[i] / change))[rows]
    return columns, scales


@dataclass(frozen=True, slots=True)
class Twinned:
    """A residual with the bias that belongs to its parameters, and its mean square."""

    packed: Packed
    error: Floats
    correction: Correction
    cost: float


def twinned(
    problem: Problem, packed: Packed, simulations: int | None = None, raw: Floats | None = None
) -> Twinned | None:
    """The residual at `packed`, `raw` where it is known already. None where the twin is unstable."""
    correction = problem.correction(packed, simulations or problem.simulations + 1)
    if not correction.stable:
        return None
    if raw is None:
        raw = problem.raw(packed)
    error = raw - correction.bias
    return Twinned(packed, error, correction, problem.mean_square(error, TRAINING))


@dataclass(frozen=True, slots=True)
class Projected:
    """Costs of a model with an effect more, or another value of what is in it, all that was fitted solved for.

    Attributes:
        once: the data that sensitivities need; `without`: residual there before the change, shape (m,).
        raw: residual before it and without a bias, shape (m,).
        held: bias of the twin before it, shape (m,).
        weight, basis: of the training rows, shape (r,), and the fitted columns there, shape (r, parameters).
    """

    problem: Problem
    once: Prepared
    without: Floats
    raw: Floats
    held: Floats
    weight: Floats
    basis: Floats

    @classmethod
    def of(cls, problem: Problem, model_fit: ModelFit, moved: Sequence[int] = ()) -> Projected:
        """Before a change of what is at the slots `moved`: what is moved itself is not solved for.

        Its columns are of the place before, and would explain there what a move is to win.
        """
        before, rows = model_fit.fitted, problem.training > 0
        weight = np.sqrt(problem.training[rows])
        solved = [i for i, one in enumerate(before.free) if one.slot not in moved]
        basis = np.linalg.qr(before.jacobian[rows][:, solved] * weight[:, None])[0]
        once = first_round(problem.data, before.packed.on)
        held = model_fit.correction.bias
        without = residual(once, before.packed, problem.moved)
        return cls(problem, once, without, before.error + held, held, weight, basis)

    @property
    def before(self) -> float:
        """Mean square on the training rows before the change [(N m)²]."""
        return self.cost(0.0, self.held)

    def changes(self, models: Sequence[Packed]) -> Floats:
        """What is another residual in each of several models; shape (k, m)."""
        found = residuals(self.once, models, self.problem.moved) - self.without
        for change, packed in zip(found, models, strict=True):
            spread(self.problem.data, change[:, None], packed.on)
        return found

    def cost(self, change: Floats | float, bias: Floats) -> float:
        """Mean square on the training rows [(N m)²], with the twin's `bias`, shape (m,)."""
        error: Floats = (self.raw + change - bias)[self.problem.training > 0] * self.weight
        left = float(error @ error) - float(np.sum((self.basis.T @ error) ** 2))
        return left / float(self.problem.training.sum()) if math.isfinite(left) else math.inf

    def costs_in_twins(self, models: Sequence[Packed], simulations: int) -> Floats:
        """Mean squares of models whose bias alone is another [(N m)²]; infinite where a twin is unstable."""
        biases = self.problem.biases(models, simulations)
        return np.array([math.inf if bias is None else self.cost(0.0, bias) for bias in biases])


def held_out_of(problem: Problem, model_fit: ModelFit) -> ModelFit:
    """The same fit by experiments of a problem with other rows, or another weight of them, held out."""
    fitted = model_fit.fitted
    return replace(model_fit, unseen=held_out(problem, fitted.error, fitted.jacobian))


def unseen_error(problem: Problem, model_fit: ModelFit, *, sharp: bool = True) -> float:
    """Rms on the test trajectory [N m or N]; nan without one.

    What chance has in the bias of the few runs that a fit takes would be added to it: so it is told by a pass of the
    twin more, unless it need not be `sharp`.
    """
    if not problem.has(TEST):
        return math.nan
    packed, error = model_fit.fitted.packed, model_fit.fitted.error
    correction = (
        problem.correction(packed, problem.simulations + 1 + WIDTH) if problem.twin and sharp else None
    )
    if correction is not None and correction.stable:
        error = problem.raw(packed) - correction.bias
    return math.sqrt(problem.mean_square(error, TEST))


def _downhill(problem: Problem, fitted: Fitted, best: Twinned) -> Twinned | None:
    """The fit with its own bias where that is better than before, else a point on the way there.

    A fit holds the bias; near the limit of stability it changes so fast with the parameters that a whole step
    leads uphill. Where no part of the step is better the whole of it may still lead across a ridge; None where it
    is far worse.
    """
    whole = twinned(problem, fitted.packed, raw=fitted.error + best.correction.bias)
    found, packed = whole, fitted.packed
    for number in range(MOST_HALVINGS):
        if found is not None and found.cost <= LEVEL_GROUND * best.cost:
            return found
        packed = Packed(0.5 * (packed.p + best.packed.p), packed.on)
        if number % 2 == 0:
            shorter = Packed(0.5 * (packed.p + best.packed.p), packed.on)
            problem.known_together([packed, shorter], problem.simulations + 1)
        found = twinned(problem, packed)
    if found is not None and found.cost <= LEVEL_GROUND * best.cost:
        return found
    return whole if whole is not None and whole.cost <= ACROSS_A_RIDGE * best.cost else None


def _model_fit(
    problem: Problem, fitted: Fitted, correction: Correction, effects: tuple[str, ...]
) -> ModelFit:
    return ModelFit(fitted, correction, held_out(problem, fitted.error, fitted.jacobian), effects)
