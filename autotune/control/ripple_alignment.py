"""Where a drive counts its turn from, and what must be written so that it takes ripple away: by trial waves.

The method of influence coefficients, as rotors are balanced. At constant speed v a torque wave Re(T·e^{inθ}) gives
the tracking error Re(G(jnv)·T·e^{inθ}), with the loop's own G, which nobody has to know. Three sweeps, each
forward and backward: as it is, with a trial wave of phase 0, and with one of phase 90°:

    E_0 = G·R,   H = (E_A − E_0) / a,   (E_B − E_A's part) = H·e^{±j90°}

R is the ripple as the axis feels it, H the error for 1 N m written at phase 0: it has in it G, the zero of the
drive's angle, and every sign. The sign of the quarter turn says which way the drive's phases count (`sense`).
Written is c = −Σ H*·E_0 / Σ |H|² over both directions. Held against the model's wave, arg c gives the zero.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation

Lines = Mapping[int, tuple[complex, complex]]
"""Order → line of the tracking error, forward and backward: Re(E·e^{inθ}) [motion unit]."""
ALIKE = 0.8
"""Least agreement of the two trials, 1 for alike: both are the same wave, a quarter turn apart."""
STANDS_OUT = 4.0
"""A trial must move its line this many times as far as two sweeps alike differ."""


NEIGHBOURS = 2
"""Orders to either side that a model may have taken for each other: its motions are shorter than a turn."""
OF_THE_LARGEST = 0.3
"""A line among neighbours is one of the axis's own where it is at least so large as the largest of them."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """What the trials say.

    Attributes:
        waves: order → C to be written, of the drive's angle in the axis's direction [N m].
        sense: −1 where the drive's phases count the other way.
        influence: order → H forward and backward [motion unit/(N m)].
        left: predicted share of the lines' rms that stays.
        zero: position at which the drive's angle is 0 [rad]; nan where no model is held against it.
        agreement: of the model's waves with what is written, after that shift: 1 alike, 0 unrelated.
        weak: orders whose trial did not stand out; nothing is written of them.
        ratio: what is written over what the model asks for: 1 where the drive's torque is what it says.
    """

    waves: Mapping[int, complex]
    sense: int
    influence: Mapping[int, tuple[complex, complex]]
    left: float
    zero: float = math.nan
    agreement: float = math.nan
    ratio: float = math.nan
    weak: tuple[int, ...] = ()


def lines_of(position: Floats, error: Floats, orders: Sequence[int]) -> dict[int, complex]:
    """Lines of a tracking error over position, beside a constant and a slope; both of shape (n,).

    Raises:
        NotEnoughExcitation: less than one turn.
    """
    if len(position) < 8 * len(orders) + 8 or float(np.ptp(position)) < 2.0 * math.pi * 0.98:
        raise NotEnoughExcitation(
            f"a sweep of {np.ptp(position) if len(position) else 0.0:.3g} rad does not cover one turn; torque over "
            "position cannot be told from it"
        )
    middle = position - position.mean()
    waves = [part(order * position) for order in orders for part in (np.cos, np.sin)]
    columns = np.stack([np.ones(len(position)), middle, *waves], axis=1)
    found = np.linalg.lstsq(columns, error, rcond=None)[0][2:].reshape(-1, 2)
    return {
        order: complex(cosine, -sine) for order, (cosine, sine) in zip(orders, found.tolist(), strict=True)
    }


def around(orders: Collection[int], highest: int) -> list[int]:
    """The orders and their neighbours, up to the highest that the drive holds."""
    every = {n + k for n in orders for k in range(-NEIGHBOURS, NEIGHBOURS + 1)}
    return sorted(n for n in every if 1 <= n <= highest)


def resolved(model: Mapping[int, complex], rest: Lines) -> dict[int, complex]:
    """The waves of a model at the orders that the axis shows over a whole turn; `rest`: with all neighbours.

    A model that was found on shorter motions may have split a wave into its neighbours, or be beside it. Where a
    neighbour stands out in their place it gets their size, and a phase that means nothing.
    """
    found: dict[int, complex] = {}
    for group in _groups(sorted(model)):
        near = {n: max(abs(side) for side in rest[n]) for n in around(group, max(rest)) if n in rest}
        largest = max(near.values())
        lines = [n for n, size in near.items() if size >= OF_THE_LARGEST * largest]
        if set(lines) == set(group) or len(lines) > len(group):  # where all are alike, none stands out
            found |= {n: model[n] for n in group}
            continue
        total = math.sqrt(sum(abs(model[n]) ** 2 for n in group))
        square = math.sqrt(sum(near[n] ** 2 for n in lines))
        found |= {n: complex(total * near[n] / square) for n in lines}
    return found


def _groups(orders: Sequence[int]) -> list[list[int]]:
    """Orders whose neighbours touch belong together."""
    groups: list[list[int]] = []
    for order in orders:
        if groups and order - groups[-1][-1] <= NEIGHBOURS:
            groups[-1].append(order)
        else:
            groups.append([order])
    return groups


def align(
    rest: Lines, first: Lines, second: Lines, trial: Mapping[int, float], noise: float = 0.0
) -> Alignment:
    """From the lines as they are, and with both trials.

    Args:
        trial: order → amplitude of the trial waves [N m].
        noise: how far lines of two sweeps alike are apart [motion unit].

    Raises:
        NotEnoughExcitation: no trial stands out, or they are not the same wave a quarter turn apart.
    """
    sense = _sense(rest, first, second, trial)
    turn = np.exp(-0.5j * np.pi * sense)
    influence: dict[int, tuple[complex, complex]] = {}
    weak: list[int] = []
    for order, size in trial.items():
        sides = []
        for side in (0, 1):
            one = (first[order][side] - rest[order][side]) / size
            other = (second[order][side] - rest[order][side]) / size * turn
            sides.append(complex(0.5 * (one + other)))
        if max(abs(side) for side in sides) * size < STANDS_OUT * noise:
            weak.append(order)
        else:
            influence[order] = (sides[0], sides[1])
    if not influence:
        raise NotEnoughExcitation(
            f"trial waves of at most {1e3 * max(trial.values()):.3g} mN m do not stand out of the tracking error "
            f"({1e6 * noise:.3g}e-6): the ripple is too small to matter on this axis, or the drive does not add "
            "what is written to it"
        )
    waves = correction(rest, influence)
    return Alignment(waves, sense, influence, remaining(rest, influence, waves), weak=tuple(weak))


def _sense(rest: Lines, first: Lines, second: Lines, trial: Mapping[int, float]) -> int:
    """Which way a phase of 90° turns the wave. Raises NotEnoughExcitation: neither."""
    turned, size = 0.0, 0.0
    for order in trial:
        for side in (0, 1):
            one, other = first[order][side] - rest[order][side], second[order][side] - rest[order][side]
            turned += (other * one.conjugate()).imag
            size += 0.5 * (abs(one) ** 2 + abs(other) ** 2)
    if size == 0.0 or abs(turned) < ALIKE * size:
        raise NotEnoughExcitation(
            f"two trial waves a quarter turn apart are not seen so (agreement {turned / size if size else 0.0:.2f} of "
            f"{ALIKE:g} at least): the drive does not add what is written to it, or something else moves the axis"
        )
    return 1 if turned > 0.0 else -1


def correction(lines: Lines, influence: Mapping[int, tuple[complex, complex]]) -> dict[int, complex]:
    """What to write, or to add to what is written, so that the lines go: order → C."""
    found = {}
    for order, (forward, backward) in influence.items():
        along = forward.conjugate() * lines[order][0] + backward.conjugate() * lines[order][1]
        found[order] = -along / (abs(forward) ** 2 + abs(backward) ** 2)
    return found


def remaining(
    lines: Lines, influence: Mapping[int, tuple[complex, complex]], waves: Mapping[int, complex]
) -> float:
    """Share of the lines' rms that stays with these waves written."""
    left = {
        order: tuple(
            line + side * waves[order] for line, side in zip(lines[order], influence[order], strict=True)
        )
        for order in influence
    }
    return size_of(left) / max(size_of({order: lines[order] for order in influence}), 1e-300)


def size_of(lines: Mapping[int, Sequence[complex]]) -> float:
    """Rms of all lines together [motion unit]."""
    return math.sqrt(sum(abs(side) ** 2 for sides in lines.values() for side in sides) / 4.0)


def held_against(alignment: Alignment, model: Mapping[int, complex]) -> Alignment:
    """With the zero of the drive's angle, from the waves of a model in the axis's angle.

    c·e^{in(θ − θ_0)} = C·e^{inθ}: θ_0 is the shift at which both agree best. Where all orders are multiples of one,
    it is known up to a turn by that.
    """
    shared = [order for order in alignment.waves if order in model]
    weight = {order: abs(alignment.waves[order]) * abs(model[order]) for order in shared}
    total = math.fsum(weight.values())
    if not total > 0.0:
        return alignment
    whole = math.gcd(*shared)
    shifts = np.linspace(0.0, 2.0 * np.pi / whole, 64 * max(shared) // whole + 1)[:-1]
    fit = np.zeros(len(shifts))
    for order in shared:
        product = alignment.waves[order] * model[order].conjugate()
        fit += np.real(product * np.exp(-1j * order * shifts))
    best = int(np.argmax(fit))
    ratio = math.sqrt(
        math.fsum(abs(alignment.waves[o]) ** 2 for o in shared)
        / math.fsum(abs(model[o]) ** 2 for o in shared)
    )
    return replace(alignment, zero=float(shifts[best]), agreement=float(fit[best] / total), ratio=ratio)
