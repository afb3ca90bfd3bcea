"""Rows that were written late, one by one, and the positions that belong to their time.

A drive or a logger that misses its moment writes a row by a tick of its own too late. The position there is ahead by
its way in a row, v, times that delay, and as no axis moves so fourth differences tell it:

    Δ⁴y[k] = Δ⁴x[k] + δ·Σ_i c_i·v[k+i]·l[k+i],  c = 1, −4, 6, −4, 1,  i = −2 to 2

x is the motion, δ the tick as a part of a row, l[k] is 1 in rows that are late. Two of them beside each other, or with
one between them, hide each other from any look at single rows: of rows that are late by chance, a share p of all, about
4·p have such a neighbour. So δ is told by rows that stand out alone, and l is the sequence that is most likely where
Δ⁴x is noise as loud as it is around there. Five rows meet in every difference: it is found by going through the rows
with the last four of them as state (Viterbi 1967).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats, Integers
from autotune.core.kernel_cache import kernel
from autotune.core.remembered import Remembered, digest_of

LEAST_LATE, ONE_DELAY = 50, 0.25
"""Rows that tell a delay, at least, and by how much of it their quartiles are apart at most."""
OUT, AROUND = 4.0, 64
"""Times the median of so many rows around it: a row that stands out."""
MOST_COUNTS = 1.5
"""Steps of the encoder by which rounding alone puts a row beside its neighbours, at most 1.33."""
QUIET, OF_NORMAL = 0.25, 0.3186
"""Quantile of sizes that tells noise where most rows have a late one around them, and that of a normal number."""
PIECES = 5
"""Pieces of `AROUND` rows over which the noise of one is the median: by chance one may hold late rows nearly alone."""
FIRST_SHARE, SAME_SHARE, ROUNDS = 0.05, 3e-3, 10
"""Of rows that are late, before any is known; by how little it changes at last, and in how many rounds at most."""
BY_ROUNDING = math.sqrt(70.0 / 12.0)
"""Counts, of fourth differences of rounded positions."""


def in_time(measured: Floats, stretches: Sequence[slice], counts: float) -> Floats:
    """Positions without what rows have more that were written late, shape (n,); as they are where none tells a delay.

    Args:
        measured: positions, shape (n,).
        stretches: contiguous rows.
        counts: of the encoder, in the position's unit; 0 for none.

    Of the positions that were asked for last it is remembered: a fit asks a dozen times.
    """
    question = digest_of(measured), tuple((rows.start, rows.stop) for rows in stretches), float(counts)
    return _IN_TIME.answer(question, lambda: _in_time(measured, stretches, counts)).copy()


_IN_TIME: Remembered[Floats] = Remembered(4)


def _in_time(measured: Floats, stretches: Sequence[slice], counts: float) -> Floats:
    """`in_time`, found anew."""
    position = measured.copy()
    long = [rows for rows in stretches if rows.stop - rows.start > AROUND]
    delay = tick_of([measured[rows] for rows in long], counts)
    if delay == 0.0:
        return position
    share = FIRST_SHARE
    for _ in range(ROUNDS):
        told = hit = 0
        for rows in long:
            ahead, noise = delay * np.gradient(position[rows]), _noise(position[rows], counts)
            late = _late(measured[rows], ahead, noise, share)
            position[rows] = measured[rows] - _of_counts(ahead * late, counts)
            tells = np.abs(ahead) > noise
            told, hit = told + int(tells.sum()), hit + int(late[tells].sum())
        before, share = share, min(max(hit / max(told, 1), SAME_SHARE), 0.5)
        if abs(share - before) < SAME_SHARE:
            break
    return position


def tick_of(positions: Sequence[Floats], counts: float) -> float:
    """By which part of a row rows are written late, as those tell that stand out of their neighbours; 0 where none is.

    Where all that stand out tell the same delay they are rows, and no motion.
    """
    told = np.concatenate([np.zeros(0), *(_standing_out(position, counts) for position in positions)])
    if len(told) < LEAST_LATE:
        return 0.0
    low, delay, high = np.quantile(told, [0.25, 0.5, 0.75]).tolist()
    return float(delay) if high - low <= ONE_DELAY * delay else 0.0


def _of_counts(way: Floats, counts: float) -> Floats:
    """A way as an encoder tells it: what is less than half a count stays unseen, and readings stay readings."""
    return way if counts == 0.0 else np.asarray(counts * np.rint(way / counts))


def _standing_out(position: Floats, counts: float) -> Floats:
    """Parts of a row by which rows are late that are far more beside their neighbours than is usual around them.

    They are on the side that the axis moves to.
    """
    off, moved = _fourth(position) / 6.0, np.gradient(position)
    size = np.abs(off)
    beside = np.maximum.reduce([np.roll(size, by) for by in (-2, -1, 1, 2)])
    usual = np.repeat(*_of_pieces(size, np.median))
    hit = (size > np.maximum(OUT * usual, MOST_COUNTS * counts)) & (size >= beside) & (off * moved > 0.0)
    return np.asarray(off[hit] / moved[hit])


def _late(measured: Floats, ahead: Floats, noise: Floats, share: float) -> Flags:
    """Rows of a stretch that are late, most likely; arrays of shape (n,).

    Args:
        ahead: by which a row is that is late; `noise`: of fourth differences; `share`: of rows that are late.
    """
    price = 2.0 * math.log((1.0 - share) / share)
    return np.asarray(_most_likely(_fourth(measured) / noise, ahead, 1.0 / noise, price))


def _noise(position: Floats, counts: float) -> Floats:
    """Standard deviation of fourth differences around each row, shape (n,); no less than rounding makes."""
    quiet, rows = _of_pieces(np.abs(_fourth(position)), partial(np.quantile, q=QUIET))
    usual = quiet / OF_NORMAL
    usual = scipy.ndimage.median_filter(usual, PIECES, mode="nearest")
    least = max(BY_ROUNDING * counts, 1e-12 * float(np.ptp(position)), 1e-300)
    return np.repeat(np.maximum(usual, least), rows)


def _fourth(position: Floats) -> Floats:
    """Fourth differences about each row, shape (n,); 0 at the ends."""
    return np.pad(np.diff(position, 4), 2)


def _of_pieces(values: Floats, told: Callable[..., Floats]) -> tuple[Floats, Integers]:
    """What is told of pieces of about `AROUND` values of shape (n,), and how many values each has, shape (pieces,).

    As `numpy.array_split` cuts them: the first pieces have one more.
    """
    count = max(1, len(values) // AROUND)
    short, longer = divmod(len(values), count)
    cut = longer * (short + 1)
    parts = values[:cut].reshape(longer, short + 1), values[cut:].reshape(count - longer, short)
    return np.concatenate([told(part, axis=1) for part in parts]), np.repeat(
        [short + 1, short], [longer, count - longer]
    )


@kernel
def _most_likely(told: Floats, ahead: Floats, weight: Floats, price: float) -> Flags:
    """Which rows are late, shape (n,), so that squares of what is left and prices of late rows come to least.

    The state: whether the last four rows are late, the last one as its lowest bit. Arguments of shape (n,):
        told: fourth differences over their noise; `weight`: 1 over that noise.
        ahead: what a late row is ahead by.
    """
    n = len(told)
    least, later = np.full(16, np.inf), np.empty(16)
    least[0] = 0.0
    oldest = np.zeros((n, 16), dtype=np.uint8)
    for k in range(n):
        later[:] = np.inf
        for state in range(16):
            left = 0.0
            if k >= 4:
                of = weight[k - 2]
                left = told[k - 2] + 4.0 * of * ((state & 1) * ahead[k - 1] + (state >> 2 & 1) * ahead[k - 3])
                left -= of * (6.0 * (state >> 1 & 1) * ahead[k - 2] + (state >> 3) * ahead[k - 4])
            for late in range(2):
                rest = left - weight[k - 2] * late * ahead[k] if k >= 4 else 0.0
                cost = least[state] + late * price + rest * rest
                to = (state << 1 | late) & 15
                if cost < later[to]:
                    later[to] = cost
                    oldest[k, to] = state >> 3
        least[:] = later
    found = np.zeros(n, dtype=np.bool_)
    state = int(np.argmin(least))
    for k in range(n - 1, -1, -1):
        found[k] = state & 1 == 1
        state = state >> 1 | oldest[k, state] << 3
    return found
