"""How good a fit is on data that it has not seen, and which share of the explainable it explains."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats, Integers
from autotune.estimation.coordinates import (
    Rests,
    generic_columns,
    since_rest,
    travel_since_reversal,
    without_rests,
)
from autotune.estimation.data import TRAINING, VETO, Block
from autotune.estimation.least_squares import DIFFERENCE, Fitted
from autotune.estimation.problem import Correction, Problem
from autotune.estimation.residual import residual
from autotune.models.drive_model import Packed
from autotune.models.reversal_memory import CLIMBS, climbing, contact, contact_remembers, with_level
from autotune.signals.chunks import CHUNK

MOST_OF_THE_FALL = 0.25
"""Of what an effect explains: no more of what is left is put down to counts and to what a loop makes of them."""

HARDLY_TOLD = 2.0
"""Times the standard error of an answer with its own experiment: so uncertain without it, others do not tell it."""
LEAST_SLIDING = 0.1
"""Of the rows that are fitted: with fewer on which the contact slides they tell too little."""


@dataclass(frozen=True, slots=True)
class Unseen:
    """Squared error of predictions of held-out experiments.

    Attributes:
        chunks: of `CHUNK` rows, shape (chunks,); on a coarse grid several seconds, or an experiment, are one.
        seconds: of about a second, shape (seconds,); None where the chunks are that.
    """

    chunks: Floats
    seconds: Floats | None = None

    @property
    def total(self) -> float:
        return float(self.chunks.sum())


def held_out(problem: Problem, error: Floats, columns: Floats) -> Unseen:
    """Leave one experiment (or range of phases) out: the rest refits the columns, linearised, and predicts it."""
    return _by_chunk(problem, _rests_unseen(problem, error, columns, _folds(problem)))


def there_and_back(problem: Problem, fitted: Fitted) -> Unseen:
    """As `held_out`, each way of each experiment by itself: the way back tells it, too, with friction turned round.

    Where an experiment goes that no other reaches, no other predicts it.
    """
    onward = problem.data.velocity[problem.data.grid] >= 0.0
    ways = (rows[onward[rows] == way] for rows in _folds(problem) for way in (True, False))
    return _by_chunk(
        problem, _rests_unseen(problem, fitted.error, fitted.jacobian, (rows for rows in ways if len(rows)))
    )


def where_others_tell(problem: Problem, before: Fitted, after: Fitted) -> tuple[float, float]:
    """What `held_out` leaves of two models on the rows that other experiments tell of the second, as weighted squares.

    Those are the rows of which the model's answer is no more than `HARDLY_TOLD` times less certain without their own
    experiment.
    """
    table, folds = after.jacobian, list(_folds(problem))
    inner = _normal(problem, table, slice(None))
    told = [
        _variance(table[rows], inner - _normal(problem, table, rows))
        <= HARDLY_TOLD**2 * _variance(table[rows], inner)
        for rows in folds
    ]
    first, second = (
        sum(
            float(rest @ rows)
            for rest, rows in zip(_rests_unseen(problem, one.error, one.jacobian, folds), told, strict=True)
        )
        for one in (before, after)
    )
    return first, second


def chunks_held_out(problem: Problem) -> list[Integers]:
    """Rows of each chunk of `held_out`, in its order."""
    return [chunk for rows in _folds(problem) for chunk in _in_chunks(rows)]


def left_unseen(problem: Problem, errors: Floats, columns: Floats) -> Floats:
    """What `held_out` leaves in all of several errors, shape (m, k) → (k,)."""
    left = np.zeros(errors.shape[1])
    for rest in _rests_unseen(problem, errors, columns, _folds(problem)):
        left += np.sum(rest, axis=0)
    return left


def _folds(problem: Problem) -> Iterator[Integers]:
    """Rows of each experiment (or range of phases) that is held out in turn."""
    fold, fitted = problem.data.folds, problem.data.role(TRAINING)
    return (np.flatnonzero(fitted & (fold == number)) for number in np.unique(fold[fitted]))


def _in_chunks(values: NDArray[Any], size: int = CHUNK) -> list[NDArray[Any]]:
    return np.array_split(values, max(1, len(values) // size))


def _by_chunk(problem: Problem, rests: Iterable[Floats]) -> Unseen:
    kept = list(rests)

    def sums(size: int) -> Floats:
        return np.array([float(chunk.sum()) for rest in kept for chunk in _in_chunks(rest, size)])

    second = problem.data.second
    return Unseen(sums(CHUNK), sums(second) if second < CHUNK else None)


def _normal(problem: Problem, columns: Floats, rows: Integers | slice) -> Floats:
    """Normal equations of some rows that are fitted, shape (k, k)."""
    part = columns[rows]
    return np.asarray(part.T @ (part * problem.training[rows, None]))


def _ridge(inner: Floats) -> Floats:
    return np.asarray(1e-7 * np.trace(inner) / max(len(inner), 1) * np.eye(len(inner)))


def _variance(part: Floats, inner: Floats) -> Floats:
    """Of the answers to a fit with such normal equations, over that of a row's noise, shape (m,)."""
    return np.asarray(np.einsum("ij,ji->i", part, np.linalg.solve(inner + _ridge(inner), part.T)))


def _rests_unseen(
    problem: Problem, error: Floats, columns: Floats, folds: Iterable[Integers]
) -> Iterator[Floats]:
    """Of each fold its weighted squared error, predicted by a refit of the others; `error`: shape (m,) or (m, k)."""
    weight = problem.training[:, None]
    inner = _normal(problem, columns, slice(None))
    ridge = _ridge(inner)
    own = weight if error.ndim > 1 else problem.training
    slope = columns.T @ (error * own)
    for rows in folds:
        part = columns[rows]
        others = inner - _normal(problem, columns, rows) + ridge
        change = -np.linalg.solve(others, slope - part.T @ (error[rows] * own[rows]))
        yield own[rows] * (error[rows] + part @ change) ** 2


LEAST_CHUNKS, NEXT_TO_NOTHING = 3, 0.1
"""Of unseen data, of each of which so little is left that it is no chance."""


NO_LOAN = 0.3
"""Of the error of unseen data: what the law of another effect lends a candidate is less."""


def gain_and_z(before: Unseen, after: Unseen) -> tuple[float, float]:
    """Relative fall of the error on unseen data, and its paired z over chunks.

    A small gain may be lent by whatever else is missing, whose error holds for as long as a motion does: chunks are
    long. Of a large one only noise could make a part, and its seconds are many.
    """
    fall = before.chunks - after.chunks
    gain = float(fall.sum() / max(before.total, 1e-300))
    if gain >= NO_LOAN and before.seconds is not None and after.seconds is not None:
        fall = before.seconds - after.seconds
    spread = float(fall.std(ddof=1)) if len(fall) > 1 else math.inf
    z = float(fall.mean() / max(spread / math.sqrt(len(fall)), 1e-300))
    return gain, z


def evenly(before: Unseen, after: Unseen) -> float:
    """By how many standard errors of a coin more chunks err less than more: a sign test of the gain.

    The paired z takes it for scatter that an effect is large in one experiment and small in another. Of few chunks a
    coin tells little, however much each of them falls: beyond any number where next to nothing is left of each.
    """
    if len(before.chunks) >= LEAST_CHUNKS and np.all(after.chunks <= NEXT_TO_NOTHING * before.chunks):
        return math.inf
    fell = int(np.sum(after.chunks < before.chunks))
    return (2 * fell - len(before.chunks)) / math.sqrt(max(len(before.chunks), 1))


@dataclass(frozen=True, slots=True)
class Explained:
    """What a model explains of one role's residual: X the fall, U what is still explainable [(N m)²].

    Attributes:
        fall: X with what rests make; left: U without it.
        certain: what is left repeats beyond doubt, so that the model cannot be all of the truth.
        excused: what is left beside U, but is put down to the measurement chain or to chance.
        moved: X without what rests make, a bristle's stretch; None where nothing is known of it.
    """

    fall: float
    left: float
    certain: bool = False
    excused: float = 0.0
    moved: float | None = None

    @property
    def plain_share(self) -> float:
        """The share with nothing excused."""
        return self._share(self.left + self.excused)

    @property
    def share(self) -> float:
        """X/(X + U), 0 where nothing was explained."""
        return self._share(self.left)

    def _share(self, left: float) -> float:
        moved = self.fall if self.moved is None else self.moved
        return moved / (moved + left) if min(self.fall, moved) > 0.0 else 0.0


def still_explainable(problem: Problem, fitted: Fitted, correction: Correction, role: str) -> float:
    """Repeatable variance, certain to one standard error, and drifting friction level [(N m)²].

    Also without what rests make: a stretch that differs between two repeats lowers what they share.
    """
    rested, quiet, settled = beyond_rests(problem, fitted.error, correction, rests_of(problem, fitted.packed))
    again = max(
        _comes_again(problem, fitted.error, correction, role), _comes_again(quiet, rested, settled, role)
    )
    return again + drift(problem, fitted, correction, role)[0]


def _comes_again(problem: Problem, error: Floats, correction: Correction, role: str) -> float:
    """Repeatable variance of an error, certain to one standard error [(N m)²]; 0 without repeats."""
    variance, spread = problem.repeatable(error, correction, role)
    certain = problem.repeatable_for_certain(error, correction, role)
    return max(variance - spread, certain) if math.isfinite(variance) else 0.0


def shared(problem: Problem, fitted: Fitted, correction: Correction, rests: Rests | None = None) -> float:
    """Variance of the training rows that repeats share, and of a level that drifts between them [(N m)²].

    What drifts up in one repeat and down in the other has lowered the product of the two: of two it counts twice.
    `rests`: without what these make.
    """
    error, column = fitted.error, of_friction(problem, fitted, correction, TRAINING)
    if rests is not None:
        error, problem, correction = beyond_rests(problem, error, correction, rests)
        column = _beyond(rests, column)
    variance, _ = problem.repeatable(error, correction, TRAINING)
    level = _level_between(problem, error, column, TRAINING)
    return variance + level.variance + level.lowers


def drift(problem: Problem, fitted: Fitted, correction: Correction, role: str) -> tuple[float, float]:
    """Variance that a friction level differing between repeats explains [(N m)²], and its z.

    How far a bristle is stretched where a repeat begins differs between repeats, too, and is no level.
    """
    rests, column = rests_of(problem, fitted.packed), of_friction(problem, fitted, correction, role)
    found = _level_between(problem, without_rests(fitted.error, rests), _beyond(rests, column), role)
    return _of_slopes(problem, found.slopes, column, role), found.z


def _beyond(rests: Rests, column: Floats | None) -> Floats | None:
    """A sensitivity as it is in an error without what rests make, shape (m,); None where there is none."""
    return None if column is None else without_rests(column, rests)


@dataclass(frozen=True, slots=True)
class _Level:
    """By how much a friction level differs between the first repeat of each experiment and the last.

    Attributes:
        slopes: relative, by experiment with repeats, in the order of its rows; 0 where by chance.
        z: of one slope of all experiments; variance: that the levels explain [(N m)²].
        lowers: by how much they lower the mean product of two repeats [(N m)²].
    """

    slopes: tuple[float, ...]
    z: float
    variance: float
    lowers: float


class _Differs(NamedTuple):
    """How the last repeats of experiments differ from the first along a friction level's sensitivity."""

    slope: float
    z: float
    share: float


def _differs(difference: Floats, level: Floats) -> _Differs:
    """By arrays of shape (m,); all 0 where friction has no share in it."""
    power = float(level @ level)
    if power <= 0.0:
        return _Differs(0.0, 0.0, 0.0)
    slope = float(level @ difference) / power
    rest = difference - slope * level
    z = slope / max(math.sqrt(float(rest @ rest) / len(difference) * 4.0 / power), 1e-300)
    return _Differs(slope, z, 1.0 - float(rest @ rest) / max(float(difference @ difference), 1e-300))


def _level_of(problem: Problem, block: Block, column: Floats) -> Floats:
    """Sensitivity of an experiment to the level on the rows that count: the mean of its first and last repeat."""
    counts = np.all(block.by_repeat(problem.weight) > 0.0, axis=0)
    level = block.by_repeat(column)[:, counts]
    return np.asarray(0.5 * (level[-1] + level[0]))


def _variances(slopes: Sequence[float], levels: Sequence[Floats], blocks: Sequence[Block]) -> Floats:
    """What levels that go in even steps make of the mean square of all experiments, by experiment [(N m)²]."""
    parts = zip(slopes, levels, blocks, strict=True)
    powers = [slope**2 * float(level @ level) * _late(one.repeats).var() for slope, level, one in parts]
    return np.array(powers) / sum(len(level) for level in levels)


def _of_slopes(problem: Problem, slopes: Sequence[float], column: Floats | None, role: str) -> float:
    """Variance that such levels explain by a sensitivity of shape (m,) [(N m)²]."""
    if column is None or not any(slopes):
        return 0.0
    blocks = _repeated(problem, role)
    levels = [_level_of(problem, block, column) for block in blocks]
    return float(_variances(slopes, levels, blocks).sum())


def _level_between(problem: Problem, error: Floats, column: Floats | None, role: str) -> _Level:
    """By an error and the sensitivity to friction, both of shape (m,); None where that was not fitted.

    Of rows that count, as all else that repeats tell; from the first repeat to the last a level goes in even steps. One
    slope for all experiments, where it is no chance. Or each has its own that is half of what differs between its
    repeats, where these explain twice as much: an axis that warms while the first is played, and hardly after it,
    differs in none of the others.
    """
    policy, differences, levels = problem.policy, [], []
    blocks = _repeated(problem, role) if column is not None else []
    for block in blocks:
        counts = np.all(block.by_repeat(problem.weight) > 0.0, axis=0)
        table = block.by_repeat(error)[:, counts]
        differences.append(np.asarray(table[-1] - table[0]))
        levels.append(_level_of(problem, block, np.asarray(column)))
    if not any(len(level) for level in levels):
        return _Level((0.0,) * len(levels), 0.0, 0.0, 0.0)

    together = _differs(np.concatenate(differences), np.concatenate(levels))
    alike = abs(together.z) >= policy.drift_z and together.share >= policy.drift_part
    slopes = (together.slope if alike else 0.0,) * len(levels)
    alone = [_differs(one, level) for one, level in zip(differences, levels, strict=True)]
    counts = [abs(one.z) >= policy.drift_z and one.share >= policy.partly for one in alone]
    own = tuple(one.slope if is_one else 0.0 for one, is_one in zip(alone, counts, strict=True))
    explain = _variances(slopes, levels, blocks)
    if policy.partly * _variances(own, levels, blocks).sum() > explain.sum():
        slopes, explain = own, _variances(own, levels, blocks)
    lowers = sum(part / (block.repeats - 1) for part, block in zip(explain.tolist(), blocks, strict=True))
    return _Level(slopes, together.z, float(explain.sum()), lowers)


def _late(repeats: int) -> Floats:
    """When each repeat was played, from half before the middle to half after it, shape (repeats,)."""
    return np.linspace(-0.5, 0.5, repeats)


def _repeated(problem: Problem, role: str) -> list[Block]:
    """Experiments of a role that were played more than once."""
    return [block for block in problem.data.blocks if block.role == role and block.repeats > 1]


def _of_drift(problem: Problem, error: Floats, column: Floats | None, role: str) -> float:
    """Of the variance between repeats, what a friction level makes that differs between them beyond doubt [(N m)²].

    A disturbance that was estimated beside a model without it has it too, as the slowest of its colours.
    """
    found = _level_between(problem, error, column, role)
    if column is None or found.variance == 0.0:
        return 0.0
    level = error.copy()
    for block, slope in zip(_repeated(problem, role), found.slopes, strict=True):
        late = _late(block.repeats)[:, None]
        level[block.rows] -= (slope * late * block.by_repeat(column)).ravel()
    return problem.noise_variance(error, role) - problem.noise_variance(level, role)


def of_friction(problem: Problem, fitted: Fitted, correction: Correction, role: str) -> Floats | None:
    """Sensitivity to the level of friction on the rows of a role, shape (m,); None where it was not fitted.

    Contacts that let go one after another carry the level together: it rises and falls in all of them.
    """
    names = [f.name for f in fitted.free]
    if "coulomb" not in names:
        return None
    index, packed = names.index("coulomb"), fitted.packed
    if role == TRAINING and not contact_remembers(packed.p, packed.on):
        return np.asarray(fitted.jacobian[:, index])
    change = DIFFERENCE * fitted.scales[index]
    p = with_level(packed.p, packed.on, 1.0 + change / contact(packed.p, packed.on)[0])
    moved = residual(problem.data, Packed(p, packed.on), problem.moved)
    return np.asarray((moved - fitted.error - correction.bias) / DIFFERENCE)


def _tells_nothing(problem: Problem, before: Floats, correction: Correction, counts: float) -> bool:
    """Whether on the veto trajectory not even what is missing is beyond doubt: training tells what is explained."""
    missing, error = problem.repeatable(before, correction, VETO)
    return missing - counts <= problem.policy.rest_errors * error


def rests_of(problem: Problem, packed: Packed) -> Rests:
    """The rests, and how far the contact of a model has forgotten each."""
    return since_rest(problem.data, contact(packed.p, packed.on)[1])


def beyond_presliding(problem: Problem, packed: Packed) -> Problem | None:
    """The problem on those rows where a contact slides, whatever its law: neither after a reversal nor after a rest.

    As far as a bristle that is as stiff climbs; the filters reach from there into the rows around. None where the axis
    hardly slides, or at constant speeds only.
    """
    data = problem.data
    if data.steady:
        return None
    _, way = climbing(packed.p)
    _, left = since_rest(data, way / CLIMBS)
    climbs = travel_since_reversal(data) < way
    near = scipy.ndimage.maximum_filter1d(climbs, len(data.taps))[data.grid]
    slides = ~near & ~np.isnan(left) & (left < math.exp(-CLIMBS))
    sliding = replace(problem, weight=problem.weight * slides)
    enough = np.count_nonzero(sliding.training) >= LEAST_SLIDING * np.count_nonzero(problem.training)
    return sliding if enough else None


def with_columns(problem: Problem, fitted: Fitted, columns: Floats) -> Unseen:
    """Errors of experiments held out, with free functions of a coordinate beside a model; `columns`: shape (m, k)."""
    table = np.hstack([fitted.jacobian, columns * float(np.std(fitted.error))])
    return held_out(problem, fitted.error, table)


def goes_with_place(problem: Problem | None, fitted: Fitted) -> bool:
    """Whether a function of the place explains experiments held out, where a contact slides (`beyond_presliding`).

    No encoder's count and no loop between the samples follows the place, nor does any law of presliding: what they may
    leave hides nothing of it.
    """
    if problem is None:
        return False
    policy = problem.policy
    columns = generic_columns(problem.data, problem.training > 0)["position"]
    before = held_out(problem, fitted.error, fitted.jacobian)
    gain, z = gain_and_z(before, with_columns(problem, fitted, columns))
    return gain >= policy.clear_gain and z >= policy.least_z


def beyond_rests(
    problem: Problem, error: Floats, correction: Correction, rests: Rests
) -> tuple[Floats, Problem, Correction]:
    """An error without what rests make, shape (m,); problem and correction, whose variances rests make likewise."""
    rested = without_rests(error, rests)
    quieter = np.array([
        min(
            problem.compared(block, rested).var(axis=0).mean()
            / max(problem.compared(block, error).var(axis=0).mean(), 1e-300),
            1.0,
        )
        for block in problem.data.blocks
    ])  # fmt: skip
    by_counts, expected = (
        None if one is None else one * quieter for one in (problem.by_counts, problem.expected)
    )
    quiet = replace(problem, by_counts=by_counts, expected=expected)
    return rested, quiet, replace(correction, variance=correction.variance * quieter)


def explained(
    problem: Problem, before: Fitted, after: Fitted, correction: Correction, role: str
) -> Explained:
    """What `after` explains beyond `before` of a role's residual.

    How far a bristle is stretched at a rest comes again in repeats, and no effect explains it: neither what counts as
    explained nor what is left holds it.
    """
    column = of_friction(problem, after, correction, role)
    fall = _explainable_fall(problem, before.error, after.error, role, column)
    if not math.isfinite(problem.noise_variance(after.error, role)):
        return Explained(fall, _beyond_loudest(problem, after, correction, role))
    rests = rests_of(problem, after.packed)
    rested, quiet, settled = beyond_rests(problem, after.error, correction, rests)
    missing = without_rests(before.error, rests)
    moving = _beyond(rests, column)
    moved = _explainable_fall(quiet, missing, rested, role, moving)
    variance, error = quiet.repeatable(rested, settled, role)
    counts, _ = quiet.comes_by_counts(role)
    beyond = variance if variance > problem.policy.rest_errors * error else 0.0
    beyond = max(beyond, quiet.repeatable_for_certain(rested, settled, role))
    certain = beyond > max(problem.policy.rest_part * quiet.noise_variance(rested, role), counts)
    drifting = _level_between(quiet, rested, moving, role).variance
    left = whole = _comes_again(quiet, rested, settled, role) + drifting
    if role == VETO and not certain and _tells_nothing(quiet, missing, settled, counts):
        left = max(left - (problem.policy.rest_errors - 1.0) * error, 0.0)
    of_chain = max(quiet.of_chain(rested, role), counts)
    of_chain = min(of_chain, MOST_OF_THE_FALL * max(moved, 0.0))
    still = max(left - of_chain, 0.0)
    return Explained(fall, still, certain, whole - still, moved)


def _beyond_loudest(problem: Problem, after: Fitted, correction: Correction, role: str) -> float:
    """What is left of a role that was played once beyond the noise of any repeated experiment [(N m)²].

    Which of them its own noise is like nothing tells, so that it may be as loud as the loudest; without repeats
    nothing is known, and nothing counts as left.
    """
    if not math.isfinite(problem.noise_variance(after.error, TRAINING)):
        return 0.0
    rested, quiet, settled = beyond_rests(problem, after.error, correction, rests_of(problem, after.packed))
    loudest = float(quiet.repeatable_by_block(rested, settled, TRAINING)[:, 1].max())
    return max(quiet.mean_square(rested, role) - loudest, 0.0)


def _explainable_fall(
    problem: Problem, before: Floats, after: Floats, role: str, column: Floats | None
) -> float:
    """Fall of a role's mean square [(N m)²]; `column`: sensitivity to friction, shape (m,).

    Of what repeats do not share only what the disturbance does not make can be explained: a lag that smooths the
    noise of the torque explains nothing. A friction level that differs between repeats is no disturbance.
    """
    fall = problem.mean_square(before, role) - problem.mean_square(after, role)
    noise = problem.noise_variance(after, role)
    if not math.isfinite(noise):
        return fall
    quieter = problem.noise_variance(before, role) - noise
    if quieter <= 0.0:
        return fall
    known = max(problem.noise_explainable(before, role), _of_drift(problem, before, column, role))
    return fall - max(quieter - known, 0.0)
