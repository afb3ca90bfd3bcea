"""Hysteresis that remembers where the motion turned: elastic elements in parallel (Maxwell slip).

Element i follows the motion until it is bent by its displacement d_i, then slides and carries its torque
W_i: z_i ← clip(z_i + Δq, −d_i, d_i), T = Σ W_i·z_i/d_i (Iwan 1966; Al-Bender, Lampaert and Swevers 2005).
Every reversal leaves elements bent, and a loop closes at the point where it began: the reversal-point
memory that the single bristle of LuGre does not have (thesis, sections 3.2.3 and 7.2).

Contacts that yield before they slide forget on the way what others keep: dz = dq·(1 − b·s·z/d), s the direction, until
|z| = d. That is Bouc and Wen's equation with an exponent of 1 (Wen 1976); with b = 1 it is Dahl's (1968), and Valanis'
endochronic element. `yielding` is the b of all elements.

While it sticks an element is damped, too (the same paper's generalised model: σ_i·ż_i in each); all have one relaxation
time, so that the `damping` of all is shared as their stiffness is. A model without it has the bristle's.

Elements that are the contact itself carry more where its level is higher (at rest, by Stribeck's curve, under load):
each slides at m, its part of that level, and comes down to it with a rate of its own where it falls,
z → m + (z − m)·e^(−C·t), the attraction of the same paper's model. Elements without one lie beside a contact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter, Terms
from autotune.models.lanes import anywhere, where
from autotune.models.layout import COULOMB, MICRO_DAMPING, STIFFNESS, block, flag, state_block
from autotune.models.look_alikes import AT_REVERSALS, AT_STARTS
from autotune.models.start_values import StartContext, StartValues, Vary

ELEMENTS = 10
_AT = block("reversal_memory")
ELEMENT_STATES = state_block("reversal_memory")
"""Where those of the elements begin; at a load beyond a transmission there are others (`transmission`)."""
REMEMBERS = flag("reversal_memory")
DAMPING = _AT + 2 * ELEMENTS
YIELDING = DAMPING + 1
ATTRACTION = YIELDING + 1
AT_ONCE = 1e6
"""1/s: so fast an element comes down to a level that has fallen where no data tell how fast."""
LEAST_MORE = 0.02
"""Of what a contact carries: less is left of it by no effect."""
_DAMPING = Parameter(
    "damping",
    "N m s/rad",
    0.0,
    0.0,
    1e12,
    "of all elements together, while they stick",
    DAMPING,
    optional=True,
    held=True,
)
_YIELDING = Parameter(
    "yielding",
    "1",
    0.0,
    0.0,
    1.0,
    "part of its stiffness that an element has lost when it slides",
    YIELDING,
    optional=True,
    held=True,
)
_ATTRACTION = Parameter(
    "attraction",
    "1/s",
    0.0,
    0.0,
    AT_ONCE,
    "how fast elements follow the contact's level where it falls; 0: they have no part in it",
    ATTRACTION,
    optional=True,
    held=True,
)


def _element(number: int) -> tuple[Parameter, ...]:
    at, later = _AT + 2 * (number - 1), number > 1
    return (
        Parameter(
            f"displacement_{number}", "rad", 0.0, 0.0, 1e6, "travel until it slides", at, later, held=True
        ),
        Parameter(
            f"torque_{number}",
            "N m",
            0.0,
            0.0,
            1e6,
            "what it carries when it slides",
            at + 1,
            later,
            refined=0.05,
        ),
    )


@compiled
def memory_torque(
    p: Floats, state: Floats, at: int, displacement: float, more: float, duration: float
) -> float:
    """Moves the elements whose states begin at `at` by `displacement` in `duration` [s]; what they carry [N m].

    Those of a contact slide at `more` times what they are said to carry (`more_to_carry`).
    """
    total = 0.0
    kept = 0.0 * more
    if anywhere(p[ATTRACTION] > 0.0):
        kept = math.exp(-p[ATTRACTION] * duration)
    for i in range(ELEMENTS):
        limit = p[_AT + 2 * i]
        if not anywhere(limit > 0.0):
            break
        z = state[at + i] + displacement
        if anywhere(p[YIELDING] > 0.0):
            some = where(limit > 0.0, limit, 1.0)
            part = where(p[YIELDING] > 0.0, p[YIELDING], 1.0)
            end = where(displacement < 0.0, -some / part, some / part)
            bent = end + (state[at + i] - end) * math.exp(-part * abs(displacement) / some)
            z = where(p[YIELDING] > 0.0, bent, z)
        most = limit
        if anywhere(p[ATTRACTION] > 0.0):
            most = limit * more
            most = most + max(abs(state[at + i]) - most, 0.0) * kept
        z = min(max(z, -most), most)
        state[at + i] = z
        total += where(limit > 0.0, p[_AT + 2 * i + 1] * z / limit, 0.0)
    return total


@compiled
def side_of_elements(p: Floats, share: float) -> tuple[float, float]:
    """Parts of the elements on the motor and on a load that has so much of the friction.

    Those that are the contact itself are on both, as its bristle is; those beside a contact are on the motor.
    """
    load = where(p[ATTRACTION] > 0.0, share, 0.0)
    return 1.0 - load, load


@compiled
def more_to_carry(p: Floats, level: float) -> float:
    """By how much all of a contact carries more where effects raise its bristle to a `level` [N m]; 1 beside one."""
    whole = p[COULOMB]
    for i in range(ELEMENTS):
        whole = whole + p[_AT + 2 * i + 1]
    return float(max(where(p[ATTRACTION] > 0.0, 1.0 + (level - p[COULOMB]) / whole, 1.0), LEAST_MORE))


@compiled
def memory_stiffness(p: Floats) -> float:
    """Stiffness of all elements together at rest [N m/rad]."""
    total = 0.0
    for i in range(ELEMENTS):
        if p[_AT + 2 * i] > 0.0:
            total += p[_AT + 2 * i + 1] / p[_AT + 2 * i]
    return total


@compiled
def memory_damping(p: Floats, state: Floats, at: int, displacement: float, more: float) -> float:
    """Damping of elements over a displacement that they have yet to make [N m s/rad]; the rest as in `memory_torque`.

    Each has the share of its stiffness, for that part of the way on which it sticks; of what yields, as it is now.
    """
    way = abs(displacement)
    whole = 0.0
    sticking = 0.0
    for i in range(ELEMENTS):
        limit = p[_AT + 2 * i]
        if not anywhere(limit > 0.0):
            break
        stiffness = where(limit > 0.0, p[_AT + 2 * i + 1] / limit, 0.0)
        bent = where(displacement < 0.0, -state[at + i], state[at + i])
        most = limit
        if anywhere(p[ATTRACTION] > 0.0):
            most = limit * more
        room = max(most - bent, 0.0)
        kept = 1.0 - where(limit > 0.0, p[YIELDING] * bent / limit, 0.0)
        whole += stiffness
        sticking += stiffness * kept * where(room < way, room / way, 1.0)
    return float(where(whole > 0.0, p[DAMPING] * sticking / whole, 0.0))


def share_damping(p: Floats, on: Flags) -> None:
    """Spreads the bristle's damping over bristle and elements as their stiffness is, in place.

    For a model that says nothing of the elements' own. At rest both forms are the same; the bristle's ends where the
    first element slides, this one with the last.
    """
    if on[REMEMBERS]:
        elements = memory_stiffness(p)
        part = elements / (elements + p[STIFFNESS])
        p[DAMPING] = part * p[MICRO_DAMPING]
        p[MICRO_DAMPING] *= 1.0 - part


STEPS = (0.5, 1.0, 2.0, 4.0, 9.0, 25.0, 80.0)
"""Of the bristle's reach: where the elements of a start slide."""
SHORTEST_COUNTS = 3.0
"""Of the encoder: a contact shorter than that was fitted to nothing, and its elements would be as short."""
ONE_REACH, FOUR_FIFTHS, NINE_TENTHS, HALVINGS = 1.0 - math.exp(-1.0), 0.8, 0.9, 50
CLIMBS, HUNDREDTH = 5.0, 0.01
"""Times its reach: so far on a bristle's exponential has come to within a hundredth of its level, as the laws of all
single contacts have."""
SMALL_LOOP = (-1.2, 0.6, -0.6)
"""Of the way to 1 − 1/e of the level, one after the other where all slides: a small loop behind a reversal."""
A_BRISTLE_FORGETS, HALF = 0.0743, 0.5
"""Of its level: what a LuGre bristle is off where that loop should close; and how much of it is next to nothing."""
DECADE = 10.0
"""Times the way to 1 − 1/e of the level: so far a sum of contacts climbs at least, however few of them can be told."""
IN_USE = 0.05
"""Of what all elements carry: an element that carries more may be moved."""


def starts(c: StartContext) -> Iterator[StartValues]:
    """Elements on a raster of displacements: what they carry enters linearly, from nothing where the bristle stays."""
    reach = min(max(c.reach, SHORTEST_COUNTS * c.resolution), 0.01 * c.travel)
    for stiffer in (1.0, 3.0, 9.0):
        values: dict[str, float] = {}
        free: dict[str, Vary] = {}
        for i, factor in enumerate(STEPS, 1):
            values[f"displacement_{i}"] = factor * reach / stiffer
            values[f"torque_{i}"] = 0.0 if stiffer == 1.0 else 0.01 * c.coulomb
            free[f"torque_{i}"] = Vary(0.1 * c.coulomb, 0.5 * c.coulomb)
        yield StartValues(values, free, {STIFFNESS: float(c.p[STIFFNESS]) * stiffer})


def displacements(p: Floats) -> dict[str, Vary]:
    """Those of the elements that carry; free once a first fit is there."""
    numbers = range(1, len(STEPS) + 1)
    total = sum(float(p[_AT + 2 * i - 1]) for i in numbers)
    free: dict[str, Vary] = {}
    for i in numbers:
        value = float(p[_AT + 2 * (i - 1)])
        if p[_AT + 2 * i - 1] > IN_USE * total:
            free[f"displacement_{i}"] = Vary(0.5 * value, 0.4 * value, 0.2 * value, 5.0 * value)
    return free


def mean_reach(p: Floats) -> float:
    """Mean displacement of the elements, weighted by what they carry [rad]."""
    reach, torque = p[_AT : _AT + 2 * ELEMENTS : 2], p[_AT + 1 : _AT + 2 * ELEMENTS : 2]
    used = reach > 0.0
    return float(torque[used] @ reach[used]) / max(float(torque[used].sum()), 1e-300)


def drawn_out(p: Floats) -> float:
    """How drawn out the climb of friction after a rest is, beside a bristle's: stiffness at rest, times the way to nine
    tenths of the level, over the level.

    One bristle has 1 (it comes exponentially), one contact that is elastic until it slides 0.4. Contacts that let go
    one after another, which is what remembers, have more than 1.
    """
    return _way_to(p, NINE_TENTHS) / (-math.log1p(-NINE_TENTHS) * _level(p) / _stiffness(p))


def of_one_contact(p: Floats) -> bool:
    """Whether friction climbs after a rest as that of one contact does, so that its elements are no memory.

    It comes to its level sooner than a bristle's, or to within a hundredth of it no later: beyond 1 − 1/e of it, where
    it goes on to four fifths. How stiff a part of it is at first does not matter.
    """
    begins = _way_to(p, ONE_REACH)
    reach = (_way_to(p, FOUR_FIFTHS) - begins) / (-math.log1p(-FOUR_FIFTHS) - 1.0)
    left = 1.0 - _carried(p, begins + (CLIMBS - 1.0) * reach) / _level(p)
    return drawn_out(p) < 1.0 or left < HUNDREDTH


def of_many_contacts(p: Floats) -> bool:
    """Whether all friction is a sum of many contacts that let go within their own presliding (Maxwell slip).

    So it is where the contact itself remembers: small loops close where they began, as those of a bristle do not, and
    where it ends (`_ends_at`) it has come to within a hundredth of its level. Elements beside a contact that forgets
    are an effect, and so are those that go on beyond.
    """
    return 1.0 - _carried(p, _ends_at(p)) / _level(p) < HUNDREDTH and closes_loops(p)


def beyond_a_decade(p: Floats) -> bool:
    """Whether some of many contacts (`of_many_contacts`) let go only beyond a decade of the way on which most climb."""
    return 1.0 - _carried(p, DECADE * _way_to(p, ONE_REACH)) / _level(p) >= HUNDREDTH


def _ends_at(p: Floats) -> float:
    """Way on which a sum of many contacts ends [rad or m]: a decade, and on as long as no gap parts the next of them.

    So where they stand in the place of the bristle (`attraction`).
    """
    return _joined_to(p) if p[ATTRACTION] > 0.0 else DECADE * _way_to(p, ONE_REACH)


def _joined_to(p: Floats) -> float:
    """Way up to which elements follow each other without a gap, a decade at least [rad or m].

    An element joins the one before where even a single bristle that bends on the other's way would still climb.
    """
    end = DECADE * _way_to(p, ONE_REACH)
    reach, torque = _used(p)
    ways = np.sort(reach[torque > HUNDREDTH * _level(p)])
    for before, after in pairwise(ways):
        if after > max(end, CLIMBS * before):
            break
        end = max(end, float(after))
    return end


def closes_loops(p: Floats) -> bool:
    """Whether small loops of all friction close where they began, as those of elements do and of a bristle do not."""
    return abs(forgotten(p)) < HALF * A_BRISTLE_FORGETS


def stands_alone(p: Floats, on: Flags) -> bool:
    """Whether a model's elements are one contact's as well as a memory's: nothing beside them forgets.

    Small loops of all friction close, and no gap parts some elements from the others, beyond which they would be a
    memory whatever the contact is.
    """
    return (
        bool(on[REMEMBERS]) and closes_loops(p) and 1.0 - _carried(p, _joined_to(p)) / _level(p) < HUNDREDTH
    )


def of_contacts(p: Floats) -> bool:
    """Whether bristle and elements are the friction of one contact or of many: then its elements are no memory."""
    return of_one_contact(p) or of_many_contacts(p)


def contact_remembers(p: Floats, on: Flags) -> bool:
    """Whether a model has elements, and they are its contact's own."""
    return bool(on[REMEMBERS]) and of_contacts(p)


def forgotten(p: Floats) -> float:
    """By how much of its level friction is off where a small loop behind a reversal should close.

    One bristle: 0.074; elements that slide at once: 0.
    """
    begins, (reach, torque) = _way_to(p, ONE_REACH), _used(p)
    bristle, bent, carried = float(p[COULOMB] / p[STIFFNESS]), reach, []
    for way in SMALL_LOOP:
        bristle, bent = _moved(p, bristle, bent, way * begins)
        carried.append(float(p[STIFFNESS] * bristle + torque @ (bent / reach)))
    return (carried[2] - carried[0]) / _level(p)


def _moved(p: Floats, bristle: float, bent: Floats, way: float) -> tuple[float, Floats]:
    """Bristle and elements [rad or m] after a way in one direction."""
    reach, sign, part = _used(p)[0], math.copysign(1.0, way), float(p[YIELDING])
    slid = sign * float(p[COULOMB] / p[STIFFNESS])
    bristle = slid + (bristle - slid) * math.exp(-abs(way * p[STIFFNESS] / p[COULOMB]))
    if part > 0.0:
        end = sign * reach / part
        bent = end + (bent - end) * np.exp(-part * abs(way) / reach)
    else:
        bent = bent + way
    return bristle, np.clip(bent, -reach, reach)


def as_one_bristle(p: Floats) -> tuple[float, float]:
    """Level [N m or N] and reach [rad or m] of the bristle that climbs after a rest as bristle and elements do."""
    return _level(p), _way_to(p, ONE_REACH)


def contact(p: Floats, on: Flags) -> tuple[float, float]:
    """Level [N m or N] and reach [rad or m] of the axis's contact, with the elements that are its own."""
    if contact_remembers(p, on):
        return as_one_bristle(p)
    return float(p[COULOMB]), float(p[COULOMB] / p[STIFFNESS])


def with_level(p: Floats, on: Flags, times: float) -> Floats:
    """Parameters with the level of the axis's contact so many times as high, its own elements' with the bristle's."""
    other = p.copy()
    other[COULOMB] *= times
    if contact_remembers(p, on):
        other[_AT + 1 : _AT + 2 * ELEMENTS : 2] *= times
    return other


def _used(p: Floats) -> tuple[Floats, Floats]:
    """Displacements [rad or m] and torques [N m or N] of the elements in use."""
    reach, torque = p[_AT : _AT + 2 * ELEMENTS : 2], p[_AT + 1 : _AT + 2 * ELEMENTS : 2]
    return reach[reach > 0.0], torque[reach > 0.0]


def _level(p: Floats) -> float:
    """What bristle and elements carry while all slides [N m or N]."""
    return float(p[COULOMB] + _used(p)[1].sum())


def _stiffness(p: Floats) -> float:
    """Of bristle and elements at rest [N m/rad or N/m]."""
    reach, torque = _used(p)
    return float(p[STIFFNESS] + (torque / reach).sum())


def _carried(p: Floats, way: float) -> float:
    """What bristle and elements carry on a way from rest [N m or N]."""
    reach, torque = _used(p)
    bristle = -float(p[COULOMB]) * math.expm1(-way * p[STIFFNESS] / p[COULOMB])
    bent, part = way / reach, float(p[YIELDING])
    if part > 0.0:
        bent = -np.expm1(-part * bent) / part
    return bristle + float(torque @ np.minimum(bent, 1.0))


def _way_to(p: Floats, part: float) -> float:
    """Way from rest on which friction comes to a part of its level [rad or m]."""
    longest = _used(p)[0].max(initial=0.0) * (1.0 if p[YIELDING] == 0.0 else max(1.0, -math.log1p(-part)))
    least, far = 0.0, float(max(longest, -math.log1p(-part) * p[COULOMB] / p[STIFFNESS]))
    for _ in range(HALVINGS):
        way = 0.5 * (least + far)
        least, far = (least, way) if _carried(p, way) >= part * _level(p) else (way, far)
    return far


def climbing(p: Floats) -> tuple[list[int], float]:
    """Numbers of the elements that slide while a bristle as stiff at rest still climbs, and the way on which it does.

    Or while many contacts do, where some of them climb for longer: their virgin curve may come to its level as soon as
    that of one contact does, and yet no part of it forgets. Elements that go on beyond it [rad or m] are memory.
    """
    reach = p[_AT : _AT + 2 * ELEMENTS : 2]
    used = np.flatnonzero(reach > 0.0)
    way = CLIMBS * max(_level(p) / _stiffness(p), _way_to(p, ONE_REACH))
    if longest_displacement(p) > way and of_many_contacts(p):
        way = max(way, _ends_at(p))
    return [int(i) + 1 for i in used if reach[i] <= way], way


def shows_course(p: Floats, travel: float) -> bool:
    """Whether elements slide on most of a stroke over the travel [rad or m].

    After a reversal an element is bent over twice its displacement, and follows the place there as a spring does.
    """
    reach, torque = _used(p)
    in_use = torque > IN_USE * torque.sum()
    return bool(4.0 * reach[in_use].max(initial=0.0) <= travel)


def longest_displacement(p: Floats) -> float:
    """Travel after which all elements slide [rad or m]."""
    return float(np.max(p[_AT : _AT + 2 * ELEMENTS : 2]))


REVERSAL_MEMORY = Kind(
    name="reversal_memory",
    parameters=(
        *(one for number in range(1, ELEMENTS + 1) for one in _element(number)),
        _DAMPING,
        _YIELDING,
        _ATTRACTION,
    ),
    looks_like="After a reversal the torque climbs in several stages over a long way; small loops inside "
    "large ones close where they began.",
    cause="Many contacts that let go one after another: preloaded balls and rollers, seals, wipers, cables.",
    remedy="Nothing is broken; compensate it. If the way has grown, look at preload and seals.",
    look_alikes=(AT_REVERSALS, AT_STARTS),
    starts=starts,
    freed_later=displacements,
    terms=Terms("displacement", ("torque",)),
    extent=mean_reach,
    shows_course=shows_course,
    quick=True,
    approximate=True,
)
