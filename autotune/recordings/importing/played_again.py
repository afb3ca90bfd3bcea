"""Motions that one file plays several times: what a reference from rest to rest shows, where no column says so.

Without repeats nothing tells noise from what is missing. Most programmes play each motion more than once, and a file
that holds all of them in one piece seldom says which rows are which.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.recordings.recording import CONDITIONING, RESERVED_EXPERIMENTS, Recording, Segment

REST = 0.05
"""s for which a reference must stand still between two motions."""
STILL = 1e-6
"""Of its range: by how much it may change from row to row meanwhile."""
ALIKE = 1e-3
"""Of a motion's range: how much two of its plays may differ."""
SLACK = 1
"""Rows by which one motion may come sooner or later in another play."""
PART_OF_ROW = 0.6
"""Of a row, by which one motion may be read later in another play: half of one, and what rounding makes of that."""
SETTLED = 0.3
"""s after a motion that belong to it still, where the rest is twice as long."""
LEAST_PART, MOST_PARTS = 2.0, 12
"""s of motion that are an experiment by themselves, at least; and how many all plays are cut into."""
FEWEST = 4
"""Experiments that are played again: with fewer there is nothing left to be held out."""
FINER = (1, 2, 4)
"""Times as many parts, where there are fewer than that: a programme that is played three times has a third of them."""
MOST_MOTIONS, WORTH = 1500, 2e-3
"""What is looked through at most; and of all motion, what must come again to be told."""
NEAR, OVERLAP = 0.01, 0.8
"""Of its range: how much positions of two plays may differ (rms); and of its rows: how many both must have."""
Table = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Motion:
    """Rows from rest to rest: the reference leaves one at `start`, and is at the other from `stop` on.

    `low`, `high`: rows of the piece that it is in, within which its rests are.
    """

    start: int
    stop: int
    low: int
    high: int


@dataclass(frozen=True, slots=True)
class Play:
    """Rows of one play of an experiment; `repeat` counts its plays from 0."""

    experiment: int
    repeat: int
    start: int
    stop: int


def told_apart(recording: Recording) -> tuple[Recording, str | None]:
    """The recording with what its reference plays again as repeats, and a sentence on it.

    As it was where there is no reference, or hardly anything comes again; and where something is a repeat already, each
    as long as the others. Those that are not, as labels often include pauses, are put beside each other; where there is
    no reference, by the position.
    """
    groups: dict[str, list[Segment]] = {}
    for segment in recording.segments():
        groups.setdefault(segment.experiment, []).append(segment)
    lengths = {name: {one.stop - one.start for one in own} for name, own in groups.items()}
    differ = max((max(own) - min(own) for name, own in lengths.items() if name != CONDITIONING), default=0)
    uneven = differ > 0
    known = "reference" in recording
    if (not known or np.any(recording.repeat > 0)) and not uneven:
        return recording, None
    fitted = [one for name, own in groups.items() if name not in RESERVED_EXPERIMENTS for one in own]
    rows = sum(one.stop - one.start for one in fitted)
    for finer in FINER:
        labels = _labelled(recording, groups, rows / (finer * MOST_PARTS))
        if uneven or labels.number == 0 or labels.number >= FEWEST:
            break
    if not labels.number:
        return recording, _unlike(differ) if uneven and np.any(recording.repeat > 0) else None
    if not uneven and labels.number < FEWEST:
        return recording, None
    columns = {name: recording[name] for name in recording.floats}
    split = Recording.from_columns(
        columns, recording.metadata, labels.experiment.astype(str), labels.repeat, recording.missed
    )
    return split, _said(labels, differ)


def _labelled(recording: Recording, groups: Mapping[str, Sequence[Segment]], least: float) -> _Labels:
    """The labels of what comes again, in experiments of so many rows at least."""
    labels = _Labels(recording.experiment.astype(object), recording.repeat.copy())
    for name, own in groups.items():
        pieces = [(one.start, one.stop) for one in own]
        reserved = name in RESERVED_EXPERIMENTS
        if "reference" in recording:
            plays = played(recording["reference"], recording.period, pieces, np.inf if reserved else least)
        else:
            plays = beside(recording["position"], pieces)
        labels.put(name, reserved, pieces, plays)
    return labels


def _unlike(differ: int) -> str:
    """What is said of repeats of unlike length whose motions do not come again; `differ`: as in `_said`."""
    return (
        f"repeats of one label differ in length, by {differ} row{'s' if differ > 1 else ''} at most, and no motion in "
        "them comes again row by row, as where plays begin at parts of a row: what they do not share is not taken for "
        "noise (begin each play on a whole row of what records, and pause for whole rows)"
    )


def _said(labels: _Labels, differ: int) -> str:
    """What was told apart; `differ`: rows by which repeats of one label do in length."""
    times = "twice" if labels.most == 2 else f"up to {labels.most} times"
    if differ:
        return (
            f"repeats of one label differ in length, by {differ} row{'s' if differ > 1 else ''} at most: by their "
            f"course {labels.number} motions in them are played {times}, and put beside each other"
        )
    return (
        f"the reference plays {labels.number} motions {times}: they are told apart as repeats (name the file's motion "
        "with --experiment to keep it in one piece)"
    )


@dataclass(slots=True)
class _Labels:
    """The experiment and repeat of each row, shape (n,); `number` of experiments that come again, `most` times."""

    experiment: NDArray[np.object_]
    repeat: NDArray[np.int64]
    number: int = 0
    most: int = 0

    def put(
        self, name: str, reserved: bool, pieces: Sequence[tuple[int, int]], plays: Sequence[Play]
    ) -> None:
        """Labels the plays of an experiment, and what lies between them; nothing where there are none."""
        if not plays:
            return
        between = [rows for start, stop in pieces for rows in _between(plays, start, stop)]
        for number, (start, stop) in enumerate(between, 1):
            self.experiment[start:stop] = CONDITIONING if reserved else f"{name}.0.{number}"
            self.repeat[start:stop] = number - 1 if reserved else 0
        for one in plays:
            rows = slice(one.start, one.stop)
            self.experiment[rows] = name if reserved else f"{name}.{one.experiment + 1}"
            self.repeat[rows] = one.repeat
        self.number += 0 if reserved else _number(plays)
        self.most = max(self.most, *(one.repeat + 1 for one in plays))


def played(
    reference: Floats, period: float, pieces: Sequence[tuple[int, int]], least: float = 0.0
) -> list[Play]:
    """What a reference of shape (n,) plays more than once in pieces of it, in order; none where nothing comes again.

    `least`: rows that an experiment lasts at least.
    """
    rest = max(5, round(REST / period))
    motions = [one for low, high in pieces for one in motions_of(reference, low, high, rest)]
    if not 2 <= len(motions) <= MOST_MOTIONS:
        return []
    plays: list[Play] = []
    for block, count in _blocks(reference, motions):
        for first, last in _parts(motions, block[0], count, max(LEAST_PART / period, least)):
            begun = [(at + first, at + last) for at in block]
            plays += _rows(motions, begun, round(SETTLED / period), _number(plays))
    return _nearest(reference, sorted(plays, key=lambda one: one.start), pieces)


def _nearest(reference: Floats, plays: Sequence[Play], pieces: Sequence[tuple[int, int]]) -> list[Play]:
    """Plays, in order, each from the row on from which it is nearest to the first of its experiment.

    In which row a motion begins is told by its slow start, by up to one row less or more.
    """
    edges = [low for low, _ in pieces], [high for _, high in pieces]
    first: dict[int, Floats] = {}
    moved: list[Play] = []
    for number, one in enumerate(plays):
        own = first.setdefault(one.experiment, reference[one.start : one.stop])
        low = max([moved[-1].stop if moved else 0, *(edge for edge in edges[0] if edge <= one.start)])
        after = plays[number + 1].start if number + 1 < len(plays) else len(reference)
        high = min([after, *(edge for edge in edges[1] if edge >= one.stop)])
        shifts = [by for by in (0, -1, 1) if low <= one.start + by and one.stop + by <= high]
        off = [float(np.sum((reference[one.start + by : one.stop + by] - own) ** 2)) for by in shifts]
        by = shifts[int(np.argmin(off))] if shifts else 0
        moved.append(Play(one.experiment, one.repeat, one.start + by, one.stop + by))
    return moved


def beside(position: Floats, pieces: Sequence[tuple[int, int]]) -> list[Play]:
    """Pieces of a position of shape (n,) that hold one motion, from where it begins in all; none where they do not.

    Nothing says when each begins but the motion: by whole rows, where it differs least.
    """
    first = position[slice(*pieces[0])]
    lags = [_lag(first, position[slice(*piece)]) for piece in pieces]
    if len(pieces) < 2 or any(lag is None for lag in lags):
        return []
    known = [lag for lag in lags if lag is not None]
    lead = max(known)
    starts = [low + lead - lag for (low, _), lag in zip(pieces, known, strict=True)]
    rows = min(high - start for start, (_, high) in zip(starts, pieces, strict=True))
    return [Play(0, k, start, start + rows) for k, start in enumerate(starts)]


def _lag(one: Floats, other: Floats) -> int | None:
    """Rows by which a motion comes later in `one`; None where the other is another motion, or hardly overlaps it."""
    least = round(OVERLAP * min(len(one), len(other)))
    size = float(np.ptp(one))
    if size <= 0.0:
        return None
    a, b = one - one.mean(), other - one.mean()
    lags = scipy.signal.correlation_lags(len(a), len(b))
    both = scipy.signal.correlate(a, b, method="fft")
    low, high = np.maximum(lags, 0), np.minimum(len(a), len(b) + lags)
    squares = [np.concatenate([[0.0], np.cumsum(part**2)]) for part in (a, b)]
    rows = high - low
    sums = squares[0][high] - squares[0][low] + squares[1][high - lags] - squares[1][low - lags]
    apart = np.where(rows >= least, (sums - 2.0 * both) / np.maximum(rows, 1), np.inf)
    best = int(np.argmin(apart))
    return int(lags[best]) if apart[best] <= (NEAR * size) ** 2 else None


def motions_of(reference: Floats, low: int, high: int, rest: int) -> list[Motion]:
    """All motions from row `low` to `high` between rests of so many rows at least."""
    piece = reference[low:high]
    moves = np.abs(np.diff(piece)) > STILL * max(float(np.ptp(piece)), 1e-300)
    rows = low + np.flatnonzero(moves)
    if len(rows) == 0:
        return []
    ends = np.flatnonzero(np.diff(rows) > rest)
    firsts = rows[np.concatenate([[0], ends + 1])]
    lasts = rows[np.concatenate([ends, [len(rows) - 1]])]
    return [Motion(int(a), int(b) + 1, low, high) for a, b in zip(firsts, lasts, strict=True)]


def _number(plays: Sequence[Play]) -> int:
    return len({one.experiment for one in plays})


def _blocks(reference: Floats, motions: Sequence[Motion]) -> list[tuple[list[int], int]]:
    """Runs of motions that come again, those that last longest first: where their plays begin, and how many motions."""
    alike = _alike(reference, motions)
    starts = np.array([one.start for one in motions])
    begins = np.array([one.low for one in motions])
    moved = np.cumsum([0, *(one.stop - one.start for one in motions)])
    number = np.arange(len(motions))
    blocks: list[tuple[list[int], int]] = []
    while True:
        shared = _shared(alike, starts, begins)
        before = np.minimum(shared, number - number[:, None])  # a play ends before the next one begins
        lasts = moved[number[:, None] + np.maximum(before, 0)] - moved[:-1, None]
        at, again = np.unravel_index(int(np.argmax(lasts)), lasts.shape)
        count = int(before[at, again])
        if lasts[at, again] <= WORTH * moved[-1]:
            return blocks
        count = _root(shared, int(at), count)
        begun = [int(at)]
        for one in np.flatnonzero(shared[at] >= count).tolist():
            if one >= begun[-1] + count:
                begun.append(one)
        for one in begun:
            alike[one : one + count, :] = alike[:, one : one + count] = False
        blocks.append((begun, count))


def _alike(reference: Floats, motions: Sequence[Motion]) -> Table:
    """Which later motions are the same as each, shape (m, m)."""
    kinds: list[Motion] = []
    kind = np.empty(len(motions), dtype=np.int64)
    for i, one in enumerate(motions):
        there = (k for k, known in enumerate(kinds) if _same(reference, known, one))
        kind[i] = next(there, len(kinds))
        if kind[i] == len(kinds):
            kinds.append(one)
    number = np.arange(len(motions))
    return np.asarray((kind[:, None] == kind) & (number > number[:, None]))


def _shared(alike: Table, starts: NDArray[np.int64], begins: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many motions from each one on come again from a later one on, in the same time; shape (m, m).

    `starts`, `begins`: where each motion and its piece begin, shape (m,); no run goes on in another piece.
    """
    found = np.zeros(alike.shape, dtype=np.int64)
    after, within = np.diff(starts), np.diff(begins) == 0
    for i in range(len(starts) - 1, -1, -1):
        found[i] = alike[i]
        if i < len(after) and within[i]:
            in_time = within & (np.abs(after - after[i]) <= SLACK)
            found[i, :-1] += np.where(alike[i, :-1] & in_time, found[i + 1, 1:], 0)
    return found


def _root(shared: NDArray[np.int64], at: int, count: int) -> int:
    """The fewest motions of which a run is a whole number of plays."""
    parts = (part for part in range(1, count // 2 + 1) if count % part == 0)
    return next((part for part in parts if shared[at, at + part] >= count - part), count)


def _same(reference: Floats, known: Motion, one: Motion) -> bool:
    """Whether a motion is the same as one that is known, from its row on, or from the one before or after it.

    Where what records is not in step with what commands, one comes later by part of a row.
    """
    if abs(one.stop - one.start - known.stop + known.start) > SLACK:
        return False
    own = reference[known.start : known.stop + 1]
    tolerance = ALIKE * max(float(np.ptp(own)), 1e-300)
    if abs(reference[one.start] - own[0]) > tolerance:
        return False
    for first in (one.start, max(one.start - 1, 0), one.start + 1):
        off = reference[first : first + len(own)] - own[: len(reference) - first]
        if len(off) == len(own) and _off_at_most(off, own) <= tolerance:
            return True
    return False


def _off_at_most(off: Floats, own: Floats) -> float:
    """By how much a motion of shape (n,) is off at most, once it is moved by the part of a row that is best."""
    rate = np.gradient(own)
    part = float(np.clip(rate @ off / max(float(rate @ rate), 1e-300), -PART_OF_ROW, PART_OF_ROW))
    return float(np.max(np.abs(off - part * rate)))


def _parts(motions: Sequence[Motion], at: int, count: int, least: float) -> Iterator[tuple[int, int]]:
    """A run cut at rests into parts that last so many rows at least: their first and last motion in it."""
    first = 0
    for k in range(count):
        lasts = motions[at + k].stop - motions[at + first].start
        rest = motions[at + count - 1].stop - motions[at + k].stop
        if k == count - 1 or (lasts >= least and rest >= least):
            yield first, k
            first = k + 1


def _rows(
    motions: Sequence[Motion], begun: Sequence[tuple[int, int]], settled: int, number: int
) -> list[Play]:
    """The plays of one part, with as much of the rests around them as all of them have."""
    before, after = [], []
    for first, last in begun:
        start = max(motions[first - 1].stop, motions[first].low) if first else motions[first].low
        stop = motions[last].high
        if last + 1 < len(motions):
            stop = min(motions[last + 1].start, stop)
        rest, alone = motions[first].start - start, start == motions[first].low
        before.append(rest if alone else rest - min(settled, rest // 2))
        after.append(min(settled, (stop - motions[last].stop) // 2))
    lead, tail = min(before), min(after)
    length = min(motions[last].stop - motions[first].start for first, last in begun) + lead + tail
    return [
        Play(number, k, motions[first].start - lead, motions[first].start - lead + length)
        for k, (first, _) in enumerate(begun)
    ]


def _between(plays: Sequence[Play], low: int, high: int) -> Iterator[tuple[int, int]]:
    """Rows of a piece that belong to no play."""
    inside = [one for one in plays if low <= one.start < high]
    edges = [low, *itertools.chain.from_iterable((one.start, one.stop) for one in inside), high]
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop > start:
            yield start, stop
