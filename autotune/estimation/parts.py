"""Parts of a recording: as much of it as a fit looks at, and as much as its sensitivities need.

What comes after the last fitted row (veto and test) need not be computed during a fit. Sensitivities are the
same in every repeat of an experiment, as long as nothing but the motion decides them: they are taken on the
first round and copied.

Of the standard programme a diagnosis is not fitted on everything.
Presliding stays out: it is measured in torque mode, where no twin of the closed loop can be made. The strokes of the
steady state are single experiments here, as they differ in speed; taken for repeats of one another they made every
difference between speeds look like noise. So are the passes at high speed, up and down in turn: what one of them has of
friction, the next has with the other sign, and an effect that explained it in both took off noise and nothing that
comes again. Recordings of anything else are fitted as they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.estimation.data import LEAST_ROWS, TRAINING, Block, Prepared, Stretch
from autotune.models import layout
from autotune.models.table import EFFECTS
from autotune.recordings.recording import CONDITIONING, Recording, Segment

SETTLED = 6.0
"""Periods of the motion's cut-off: so far away a filter does not feel the end of what it is given."""
FORGOTTEN = 20.0
"""The same where nothing may be told from all the data: its slowest part falls to e^-48, less than rounding."""
SAME_PLACE = 0.01
"""Of the travel: repeats that are further apart are not the same motion."""
_DRIFTING = [layout.flag(kind.name) for kind in EFFECTS.values() if kind.drifts]


def until_last(data: Prepared, rows: Flags, settled: float = SETTLED) -> Prepared:
    """The data up to the last sample that these grid rows need; residuals are 0 after it."""
    needed = data.grid[rows]
    if len(needed) == 0:
        return data
    return until_sample(data, int(needed.max()) + len(data.taps) // 2 + 1, settled)


def until_sample(data: Prepared, end: int, settled: float = SETTLED) -> Prepared:
    """The data up to a sample, and as far beyond as filters need: so many periods of the motion's cut-off.

    Where that ends just behind the beginning of a stretch, the stretch keeps as many rows as every one has.
    """
    end += math.ceil(settled / (data.motion_cutoff * data.period))
    begun = [s for s in data.stretches if s.start < end]
    stretches = (Stretch(s.start, min(s.stop, max(end, s.start + LEAST_ROWS)), s.closed) for s in begun)
    return replace(data, stretches=tuple(stretches))


def first_round(data: Prepared, on: Flags) -> Prepared:
    """The data up to the end of the first repeats; all that is fitted where repeats are not alike.

    What drifts makes them differ, and so does another place.
    """
    rows = data.role(TRAINING)
    if not on[_DRIFTING].any():
        for block in _alike(data):
            rows[block.rows] = np.arange(block.repeats * block.count) < block.count
    return until_last(data, rows)


def spread(data: Prepared, columns: Floats, on: Flags) -> None:
    """Copies what `first_round` gives of columns, shape (m, k), to the other repeats; other roles get 0."""
    columns[~data.role(TRAINING)] = 0.0
    if on[_DRIFTING].any():
        return
    for block in _alike(data):
        part = columns[block.rows]
        part[:] = np.tile(part[: block.count], (block.repeats, 1))


def repeats_alike(data: Prepared) -> bool:
    """Whether every fitted repeat is the same motion at the same place."""
    repeated = [block for block in data.blocks if block.role == TRAINING and block.repeats > 1]
    return len(_alike(data)) == len(repeated)


def _alike(data: Prepared) -> list[Block]:
    """Fitted blocks whose repeats are the same motion at the same place."""
    position = data.position[data.grid]
    apart = SAME_PLACE * float(np.ptp(position)) if len(position) else 0.0
    found: list[Block] = []
    for block in data.blocks:
        if block.role == TRAINING and block.repeats > 1:
            table = block.by_repeat(position)
            if float(np.max(np.abs(table[1:] - table[0]))) <= apart:
                found.append(block)
    return found


_LEFT_OUT = "presliding"
_STROKES = "steady_state"
_SINGLE = (_STROKES, "high_speed")
"""Experiments whose repeats are none of one another."""
_REPEATED = "dahl"
REPEATS = 2
"""Of Dahl's curve: more say nothing more."""


def fitted_part(recording: Recording) -> Recording:
    """The position-controlled experiments; each stroke of the steady state, and each fast pass, by a name of its own.

    A recording that is none of the standard programme is given back as it is.

    Every second speed and two repeats of Dahl's curve say as much as all of them, in half the time.
    """
    segments = recording.segments()
    out = [i for i, segment in enumerate(segments) if _in_torque_mode(recording, segment)]
    keep = np.ones(len(recording), dtype=np.bool_)
    if out:  # with the relaxing before and the way back after it, which are partly in torque mode
        for segment in segments[max(out[0] - 1, 0) : out[-1] + 2]:
            keep[segment.rows] = False
    for i in _spare(recording, segments):
        keep[segments[i].rows] = False
        if i > 0 and segments[i - 1].experiment == CONDITIONING:
            keep[segments[i - 1].rows] = False
    if keep.all() and all(segment.experiment not in _SINGLE for segment in segments):
        return recording
    kept = recording.rows(keep)
    names = kept.experiment.astype(f"<U{max(kept.experiment.dtype.itemsize // 4, len(_STROKES) + 5)}")
    for segment in kept.segments():
        if segment.experiment in _SINGLE:
            names[segment.rows] = f"{segment.experiment}/{segment.repeat}"
    return Recording(kept.metadata, kept.floats, names, kept.repeat, kept.missed)


def _in_torque_mode(recording: Recording, segment: Segment) -> bool:
    """Whether a segment is presliding that no position controller took part in."""
    if segment.experiment != _LEFT_OUT or "reference" not in recording:
        return segment.experiment == _LEFT_OUT
    return bool(np.all(recording["reference"][segment.rows] == recording["position"][segment.rows]))


def _spare(recording: Recording, segments: Sequence[Segment]) -> list[int]:
    """Segments that are not needed: pairs of strokes (there and back) at every second speed, spare repeats."""
    strokes = [i for i, segment in enumerate(segments) if segment.experiment == _STROKES]
    ordered = sorted(strokes, key=lambda i: -_speed(recording, segments[i]))
    spare = [i for place, i in enumerate(ordered) if place // 2 % 2 == 1]
    return spare + [i for i, s in enumerate(segments) if s.experiment == _REPEATED and s.repeat >= REPEATS]


def _speed(recording: Recording, segment: Segment) -> float:
    position = recording["position"][segment.rows]
    return abs(float(position[-1] - position[0])) / len(position)
