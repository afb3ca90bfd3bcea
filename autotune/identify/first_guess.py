"""Start values from any recording in which the axis moves, whatever it was made for.

With the bristle driven by the measured velocity and its reach x_s = F_c/σ0 given, torque is linear in
inertia, viscous and Coulomb friction, σ1 and offset (inverse dynamics): least squares for each of
several reaches. Of those that leave nearly the least error the shortest wins: a long one takes up whatever
lags. Gravity, a spring and waves over position are fitted beside them where the data show them (`signals.place_terms`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.estimation.bandwidth import Bands
from autotune.estimation.data import STANDSTILL_SECONDS
from autotune.estimation.pieces import Piece
from autotune.estimation.problem import ONE_WAY
from autotune.models.compiled import compiled
from autotune.models.gravity_imbalance import GRAVITY_IMBALANCE, LEAST_PERIODS, MOST_ORDERS, SPACING
from autotune.models.lugre import bristle_rate, bristle_step
from autotune.models.spring import SPRING
from autotune.signals.filters import low_pass
from autotune.signals.place_terms import ALIKE, LEAST_GAIN, PlaceTerms, find_lines, held_out_error

TRIALS = 12
MOST_WAVES, WAVE_ROWS, MOST_PERIODS = 8, 6000, 4000
"""Waves beside a model, rows in which they are looked for, and periods in the travel."""
LEAST_OF_A_TURN = 0.3
"""Of a load behind a gear: over less its gravity is a spring's."""
OTHER_ORDERS = np.array([0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.02, 1.05, 1.1, 1.25, 1.4, 2.0])
"""Times the order of gravity: others that are tried for what the offset owes to it."""
MATTERS = 0.05
"""Of inertia or Coulomb friction: terms of the place that change them by less are left to the diagnosis."""
PASSED = 0.8
"""Of the cut-off: waves that are faster at usual speeds are filtered away."""
LONGEST, SHORTEST = 0.1, 2e-5
"""Reaches that are tried, as shares of the longest travel."""
CLEARLY = 1.03
"""A longer reach must leave an error smaller than by this factor."""
_TWO_AXES = 1.5
_J, _VISCOUS, _COULOMB, _OFFSET, _BASE = 0, 1, 2, 4, 5
_SURE = [0, 2, 4]
_SHARED = [0, 2]
_FRICTION = [2, 4]
"""Columns that every recording must tell apart: inertia, Coulomb friction, offset; and two groups of them."""
_NOT_TOGETHER = 0.02
"""Of the torque's power: what a fit of one axis, or of two stretches of it, leaves at most."""
_SLIDES = 0.9
"""Of its friction that a contact comes to where it slides."""
_SHORT, _LONG = 200, 1600
"""Rows: shorter pieces tell nothing by themselves, longer ones are looked at in quarters."""


class OneDirection(NotEnoughExcitation):
    """The axis moved one way only: Coulomb friction and offset are one number."""


class NoDryFriction(NotEnoughExcitation):
    """Motion explains the torque, but with a Coulomb friction below zero: friction has another curve over speed."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Base parameters by name, and the share of the torque they leave unexplained.

    Attributes:
        place: what was fitted beside them, and `sizes`: of its columns [N m].
        offset_doubt: by how much the offset changes with orders of gravity that leave as little [N m or N].
    """

    values: dict[str, float]
    relative_error: float
    place: PlaceTerms
    sizes: Floats
    offset_doubt: float


@dataclass(frozen=True, slots=True)
class _Trial:
    """Least squares for one reach; `parts` are regressors and torque of each piece."""

    reach: float
    parts: list[tuple[Floats, Floats]]
    solution: Floats
    error: float

    @property
    def design(self) -> Floats:
        return np.vstack([part[0] for part in self.parts])

    @property
    def target(self) -> Floats:
        return np.concatenate([part[1] for part in self.parts])

    @property
    def rest(self) -> Floats:
        return np.asarray(self.target - self.design @ self.solution)


def guess(
    pieces: Sequence[Piece], bands: Bands, motion_unit: str = "rad", wanted: Collection[str] = ()
) -> Guess:
    """Start values.

    Args:
        wanted: effects that will be fitted; gravity or a spring among them is one of the place's terms.

    Raises:
        NotEnoughExcitation: one direction only, no acceleration, or friction that cannot be seen.
        RecordingError: a torque of the wrong sign, or two axes in one recording.
    """
    _refuse_one_direction(pieces)
    if not any(np.any(piece.use) for piece in pieces):
        raise NotEnoughExcitation(
            "the encoder's counts are so coarse for this motion that the axis never seems to move: within "
            f"{2e3 * STANDSTILL_SECONDS * bands.pace:.3g} ms by hardly more than two of them; move faster, or record a "
            "finer position"
        )
    travel = max(float(np.ptp(piece.position)) for piece in pieces)
    reaches = np.geomspace(SHORTEST * travel, LONGEST * travel, TRIALS).tolist()
    plain = [_solved(reach, [_regressors(piece, bands, reach) for piece in pieces]) for reach in reaches]
    terms, trials = _beside(plain, pieces, bands, 1.0 if motion_unit == "rad" else 2.0 * math.pi, wanted)
    best = _best(trials)
    if best.error**2 > _NOT_TOGETHER:
        refuse_two_axes([trial.parts for trial in trials])
    _refuse(best)
    inertia, viscous, coulomb, damping, offset = (float(x) for x in best.solution[:_BASE])
    speed = max(float(np.max(np.abs(piece.velocity))) for piece in pieces)
    stiffness = coulomb / best.reach
    usual = 0.4 * math.sqrt(stiffness * inertia)
    values = {
        "inertia": inertia,
        "viscous": max(viscous, 1e-3 * coulomb / speed),
        "coulomb": coulomb,
        "stiffness": stiffness,
        "micro_damping": min(max(damping, 0.1 * usual), 5.0 * usual),
        "offset": offset,
    }
    doubt = _offset_doubt(best, terms, plain, pieces, bands)
    return Guess(values, best.error, terms, best.solution[_BASE:], doubt)


def _best(trials: Sequence[_Trial]) -> _Trial:
    """The shortest reach of those that leave nearly the least error."""
    physical = [trial for trial in trials if trial.solution[_J] > 0 and trial.solution[_COULOMB] > 0]
    least = min(trial.error for trial in physical or trials)
    return next(trial for trial in physical or trials if trial.error <= CLEARLY * least)


def _beside(
    plain: list[_Trial], pieces: Sequence[Piece], bands: Bands, scale: float, wanted: Collection[str]
) -> tuple[PlaceTerms, list[_Trial]]:
    """What belongs to the place, and the trials with it: gravity or a spring, waves, and gravity again under waves."""
    terms = PlaceTerms(scale, SPRING.name in wanted)
    if GRAVITY_IMBALANCE.name in wanted:
        load = _of_a_gear(_best(plain), pieces, bands)
        terms = replace(terms, orders=(load,), load=load)
    asked = terms, _with_place(plain, pieces, bands, terms)
    terms, trials = asked
    for look in (_slow, _waves, _slow):
        found = look(terms, trials, plain, pieces, bands)
        if found is not None:
            terms, trials = found
    return (terms, trials) if _matters(_best(asked[1]), _best(trials)) else asked


def _matters(without: _Trial, beside: _Trial) -> bool:
    """Whether inertia or friction would be another without the terms, or none at all."""
    alone, found = without.solution[_SHARED], beside.solution[_SHARED]
    return bool(np.any(alone <= 0.0) or np.any(np.abs(alone - found) > MATTERS * np.abs(found)))


_Found = tuple[PlaceTerms, list[_Trial]]


def _slow(
    terms: PlaceTerms, trials: list[_Trial], plain: list[_Trial], pieces: Sequence[Piece], bands: Bands
) -> _Found | None:
    """The terms with gravity or a spring, where the data show either."""
    if terms.spring or terms.gravity:
        return None
    kinds = [replace(terms, spring=True)]
    if terms.scale == 1.0:
        kinds.insert(0, replace(terms, orders=(1.0, *terms.orders)))
        order = _of_a_gear(_best(trials), pieces, bands)
        kinds += [replace(terms, orders=(order, *terms.orders), load=order)] if order < 1.0 else []
    looked = [(kind, _with_place(plain, pieces, bands, kind)) for kind in kinds]
    looked = [one for one in looked if not (one[0].gravity and _heavier_than_seen(*one))]
    if not looked:
        return None
    left = [held_out_error(_best(found).parts) for _, found in looked]
    # a load behind a gear has one more number that is free: it must be plainly better than what has not
    freedom = [1.0 if kind.load == 1.0 else 1.0 / (1.0 - LEAST_GAIN) for kind, _ in looked]
    chosen = int(np.argmin(np.multiply(left, freedom)))
    if left[chosen] > (1.0 - LEAST_GAIN) * held_out_error(_best(trials).parts):
        return None
    told = looked[chosen][0].spring
    others = [one for (kind, _), one in zip(looked, left, strict=True) if kind.spring is not told]
    alike = bool(others) and max(left[chosen], min(others)) <= ALIKE * min(left)
    return replace(looked[chosen][0], spring_like=alike), looked[chosen][1]


def _of_a_gear(best: _Trial, pieces: Sequence[Piece], bands: Bands) -> float:
    """Turns of a load behind a gear for one of the axis, below 1, at which gravity explains most; 1 where none is told.

    Over less than a good part of a turn of the load a spring has the same course, and an offset the rest.
    """
    position = np.concatenate([_reduced(piece.position, piece, bands) for piece in pieces])
    turns = float(np.ptp(position)) / (2.0 * math.pi)
    if turns <= LEAST_PERIODS:
        return 1.0
    step = SPACING / turns
    every = math.ceil(len(position) / WAVE_ROWS)
    place, target = position[::every], best.target[::every]
    fixed = best.design[::every]
    fixed = fixed / np.maximum(np.sqrt(np.mean(fixed**2, axis=0)), 1e-300)

    def left(order: float) -> float:
        table = np.column_stack([fixed, np.sin(order * place), np.cos(order * place)])
        return float(np.sum((target - table @ np.linalg.lstsq(table, target, rcond=1e-9)[0]) ** 2))

    orders = np.arange(LEAST_OF_A_TURN / turns, 1.0 - step, step)[:MOST_ORDERS]
    order = min([*orders.tolist(), 1.0], key=left)
    if order == 1.0:
        return 1.0
    least = 0.5 * LEAST_OF_A_TURN / turns
    near = max(order - step, least), min(order + step, 1.0)
    found = scipy.optimize.minimize_scalar(
        left, bounds=near, method="bounded", options={"xatol": 1e-3 * step}
    )
    if found.x <= least + 2e-3 * step:  # there is no best order: the less of a wave, the better
        return 1.0
    return float(found.x) if left(float(found.x)) <= (1.0 - LEAST_GAIN) * left(1.0) else 1.0


def _offset_doubt(
    best: _Trial, terms: PlaceTerms, plain: Sequence[_Trial], pieces: Sequence[Piece], bands: Bands
) -> float:
    """By how much the offset changes with orders of gravity that leave as little as the one that is held [N m or N].

    Such a sine is any course that bends a little, whatever the order: there its constant part is none of gravity's.
    """
    if not terms.gravity:
        return 0.0
    same, doubt = [trial for trial in plain if trial.reach == best.reach], 0.0
    for order in (terms.load * OTHER_ORDERS).tolist():
        orders = tuple(order if one == terms.load else one for one in terms.orders)
        other = _with_place(same, pieces, bands, replace(terms, orders=orders, load=order))[0]
        if other.error**2 <= ALIKE * best.error**2:
            doubt = max(doubt, abs(float(other.solution[_OFFSET] - best.solution[_OFFSET])))
    return doubt


def _heavier_than_seen(terms: PlaceTerms, trials: list[_Trial]) -> bool:
    """Whether gravity would be more than any torque that was recorded, but for an offset that balances it.

    Over a small part of a turn sine, cosine and offset are one another; what bends there by another cause is then a
    difference of large torques, from which no refinement comes back.
    """
    best = _best(trials)
    sine, cosine = best.solution[-terms.count :][:2]
    return math.hypot(sine, cosine) > float(np.max(np.abs(best.target)))


def _waves(
    terms: PlaceTerms, trials: list[_Trial], plain: list[_Trial], pieces: Sequence[Piece], bands: Bands
) -> _Found | None:
    """The terms with waves that stand out of what the best trial leaves.

    At constant speed a wave makes the axis speed up and slow down, and inertia takes it: then they are looked for in
    what friction alone leaves.
    """
    best = _best(trials)
    position = np.concatenate([_reduced(piece.position, piece, bands) for piece in pieces])
    speed = np.concatenate([_reduced(np.abs(piece.velocity), piece, bands) for piece in pieces])
    every = math.ceil(len(position) / WAVE_ROWS)
    slow = terms.scale * max(float(np.percentile(speed, 25)), 1e-3 * float(np.max(speed)))
    most = MOST_PERIODS * 2.0 * math.pi / max(float(np.ptp(position)) * terms.scale, 1e-300)
    highest = min(most, 2.0 * math.pi * PASSED * bands.error / slow)
    for fixed in (best.design, best.design[:, _FRICTION]):
        rows, torque = position[::every], best.target[::every]
        lines = find_lines(rows, torque, fixed[::every], terms.scale, MOST_WAVES, highest)
        more = replace(terms, orders=(*terms.orders, *(line.order for line in lines)))
        found = _with_place(plain, pieces, bands, more)
        if held_out_error(_best(found).parts) <= (1.0 - LEAST_GAIN) * held_out_error(best.parts):
            return more, found
    return None


def _with_place(
    plain: list[_Trial], pieces: Sequence[Piece], bands: Bands, terms: PlaceTerms
) -> list[_Trial]:
    """The trials with columns of the place, filtered as the others are."""
    if not terms.count:
        return plain
    place = []
    for piece in pieces:
        table = low_pass(terms.columns(piece.position).T, bands.error, piece.period)
        place.append(table[:, :: bands.decimation][:, piece.use].T)
    return [
        _solved(
            trial.reach,
            [(np.hstack([part[0], more]), part[1]) for part, more in zip(trial.parts, place, strict=True)],
        )
        for trial in plain
    ]


def _reduced(values: Floats, piece: Piece, bands: Bands) -> Floats:
    """Of the rows that are compared."""
    return np.asarray(values[:: bands.decimation][piece.use])


def _solved(reach: float, parts: list[tuple[Floats, Floats]]) -> _Trial:
    design, target = np.vstack([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    scale = np.maximum(np.sqrt(np.mean(design**2, axis=0)), 1e-300)
    solution = np.linalg.lstsq(design / scale, target, rcond=1e-9)[0] / scale
    error = float(np.linalg.norm(target - design @ solution)) / max(float(np.linalg.norm(target)), 1e-300)
    return _Trial(reach, parts, np.asarray(solution, dtype=np.float64), error)


def _regressors(piece: Piece, bands: Bands, reach: float) -> tuple[Floats, Floats]:
    """Acceleration, velocity, bristle (±1 when sliding), its rate, 1; and torque; all filtered alike."""
    bent, rate = np.empty(len(piece)), np.empty(len(piece))
    _bend(piece.velocity, reach, piece.period, bent, rate)
    columns = [
        piece.acceleration,
        piece.velocity,
        bent,
        rate,
        np.ones(len(piece)),
        0.5 * (piece.torque + np.concatenate([piece.torque[:1], piece.torque[:-1]])),
    ]
    table = low_pass(np.array(columns), bands.error, piece.period)[:, :: bands.decimation]
    return table[:5, piece.use].T, table[5, piece.use]


@compiled
def _bend(velocity: Floats, reach: float, period: float, bent: Floats, rate: Floats) -> None:
    bristle = 0.0
    before = velocity[0]
    for k in range(len(velocity)):
        bristle = bristle_step(bristle, 0.5 * (before + velocity[k]), reach, period)
        before = velocity[k]
        bent[k] = bristle / reach
        rate[k] = bristle_rate(bristle, before, reach)


def refuse_two_axes(trials: Sequence[Sequence[tuple[Floats, Floats]]]) -> None:
    """Raises RecordingError where what comes first and what comes after tell two inertias and two frictions.

    `trials` are regressors and torques of the pieces, one list for each reach; long pieces are looked at in quarters.
    Each stretch speaks by the reach that explains it best: by another one the torque of a bending contact is inertia.
    """
    known = []
    for piece in zip(*trials, strict=True):
        count = len(piece[0][1])
        for rows in np.array_split(np.arange(count), 4 if count > _LONG else 1):
            found = _alone([(design[rows], target[rows]) for design, target in piece])
            if found is not None:
                known.append(found)
    for one, other in itertools.combinations(range(len(known)), 2):
        if _two_axes(known, one, other):
            first, second = known[one], known[other]
            raise RecordingError(
                f"the recording mixes axes: one stretch has inertia {first.inertia:.3g} and friction "
                f"{first.friction:.3g}, another {second.inertia:.3g} and {second.friction:.3g}; fit each axis "
                "by itself"
            )


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Regressors and torque of a stretch, and what it tells by itself."""

    design: Floats
    target: Floats
    inertia: float
    friction: float


def _two_axes(known: Sequence[_Stretch], one: int, other: int) -> bool:
    """Whether two stretches disagree, and neither's axis is met again on the other's side.

    What small motion tells, and large motion before and after it does not, is the model's: a contact with a memory is a
    spring as long as it hardly slides, and a spring's torque is taken for inertia.
    """
    if not (_differ(known[one], known[other]) and _apart(known[one], known[other])):
        return False
    later = any(not _apart(known[one], again) for again in known[other + 1 :])
    return not later and all(_apart(known[other], before) for before in known[:one])


def _differ(one: _Stretch, other: _Stretch) -> bool:
    ratios = (one.inertia / other.inertia, one.friction / other.friction)
    return all(max(ratio, 1.0 / ratio) > _TWO_AXES for ratio in ratios)


def _apart(one: _Stretch, other: _Stretch) -> bool:
    """Whether no inertia and friction serve both stretches, each with a viscous friction and offset of its own.

    Where friction is curved over speed, stretches of different speed disagree by themselves, not together.
    """
    size, own = len(one.target), [i for i in range(one.design.shape[1]) if i not in _SHARED]
    tables = [np.vstack([one.design[:, _SHARED], other.design[:, _SHARED]])]
    for first, stretch in ((True, one), (False, other)):
        table = np.zeros((size + len(other.target), len(own)))
        table[:size] = stretch.design[:, own] if first else 0.0
        table[size:] = 0.0 if first else stretch.design[:, own]
        tables.append(table)
    design, target = np.hstack(tables), np.concatenate([one.target, other.target])
    scale = _size(design)
    error = target - design @ (np.linalg.lstsq(design / scale, target, rcond=1e-9)[0] / scale)
    shares = [
        float(np.mean(error[rows] ** 2)) / float(np.mean(target[rows] ** 2))
        for rows in (slice(0, size), slice(size, None))
    ]
    return max(shares) > _NOT_TOGETHER


def _alone(trials: Sequence[tuple[Floats, Floats]]) -> _Stretch | None:
    """Inertia and friction of a stretch by itself, at its best reach, where it tells both within 5 %.

    A contact that hardly bends by that reach is a spring: its friction was never there.
    """
    if len(trials[0][1]) < _SHORT:
        return None
    design, target, solution, error = min(
        (_by_itself(*trial) for trial in trials), key=lambda found: found[-1]
    )
    if np.linalg.cond(design[:, _SURE] / _size(design[:, _SURE])) > 1e3:
        return None
    slid = float(np.max(np.abs(design[:, _COULOMB])))
    if slid < _SLIDES or error > _NOT_TOGETHER * float(np.mean(target**2)):
        return None
    spread = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)) * error)
    inertia, friction = float(solution[_J]), float(solution[_COULOMB])
    sure = inertia > 0 and friction > 0
    sure = sure and spread[_J] < 0.05 * inertia and spread[_COULOMB] < 0.05 * friction
    return _Stretch(design, target, inertia, friction) if sure else None


def _by_itself(design: Floats, target: Floats) -> tuple[Floats, Floats, Floats, float]:
    """Regressors, torque, least squares solution and its mean square error."""
    solution = np.asarray(np.linalg.lstsq(design, target, rcond=1e-9)[0], dtype=np.float64)
    return design, target, solution, float(np.mean((target - design @ solution) ** 2))


def _size(design: Floats) -> Floats:
    return np.asarray(np.maximum(np.sqrt(np.mean(design**2, axis=0)), 1e-300))


def _refuse_one_direction(pieces: Sequence[Piece]) -> None:
    """Both directions must be there, at speed."""
    speed = np.concatenate([piece.velocity[:: len(piece) // 5000 + 1] for piece in pieces])
    fast = float(np.percentile(np.abs(speed), 95))
    if fast <= 0.0:
        raise NotEnoughExcitation("the axis stands still in this recording; nothing can be fitted to it")
    moving = speed[np.abs(speed) > 0.05 * fast]
    share = float(np.sum(moving[moving > 0])) / float(np.sum(np.abs(moving)))
    if min(share, 1.0 - share) < ONE_WAY:
        word = "positive" if share > 0.5 else "negative"
        raise OneDirection(
            f"the axis moved in the {word} direction only; Coulomb friction and offset cannot be told apart. "
            "Record both directions"
        )


def _bends_up(design: Floats, target: Floats) -> bool:
    """Whether a drag with the square of the speed beside the rest leaves a Coulomb friction above zero.

    Friction that is compensated beforehand, and too much, does not come back with it.
    """
    speed = design[:, _VISCOUS]
    table = np.column_stack([design, speed * np.abs(speed)])
    found = np.linalg.lstsq(table / _size(table), target, rcond=1e-9)[0]
    return bool(found[_COULOMB] > 0.0 and found[-1] > 0.0)


def _refuse(best: _Trial) -> None:
    """Raises where the least squares solution is no drive's."""
    design, target = best.design, best.target
    varying = target - target.mean()
    error = target - design @ best.solution
    unexplained = float(error @ error) / max(float(varying @ varying), 1e-300)
    if unexplained > 0.8:
        raise NotEnoughExcitation(
            f"motion explains {100 * (1 - unexplained):.0f} % of the torque only; check that position and torque "
            "are of the same axis and aligned in time"
        )
    if np.linalg.cond(design[:, _SURE] / _size(design[:, _SURE])) > 1e6:
        raise NotEnoughExcitation(
            "inertia, friction and offset cannot be told apart in this motion; record several speeds and "
            "accelerations in both directions"
        )
    inertia, coulomb = float(best.solution[_J]), float(best.solution[_COULOMB])
    variance = float(error @ error) / max(len(target) - 5, 1)
    spread = math.sqrt(float(np.linalg.pinv(design.T @ design)[_J, _J]) * variance)
    moved = varying - design[:, _BASE:] @ best.solution[_BASE:]
    braked = inertia <= 3.0 * spread and float(np.mean(moved * design[:, _COULOMB])) < 0.0
    if coulomb < 0.0 and (inertia < 0.0 or braked):
        raise RecordingError(
            f"inertia ({inertia:.3g}) and Coulomb friction ({coulomb:.3g}) come out negative: the torque has the "
            "wrong sign. Import it again with a factor of −1"
        )
    if inertia <= 3.0 * spread:
        raise NotEnoughExcitation(
            f"inertia comes out as {inertia:.3g} ± {spread:.2g}: the motion accelerates too little, the torque is "
            "delayed, or gravity stands for inertia, as in a swing of one frequency and size. Record faster changes "
            "of speed, swings of several sizes"
        )
    if coulomb <= 0.0:
        kind = NoDryFriction if _bends_up(design, target) else NotEnoughExcitation
        raise kind(
            f"Coulomb friction comes out as {coulomb:.3g}; it must be above 0. Record slow moves in both "
            "directions, or check that friction is not compensated already"
        )
