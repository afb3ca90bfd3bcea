"""Of the standard programme what one twin can fit: a diagnosis is not fitted on everything.

Presliding stays out: it is measured in torque mode, where no twin of the closed loop can be made. The strokes of the
steady state are single experiments here, as they differ in speed; taken for repeats of one another they made every
difference between speeds look like noise. So are the passes at high speed, up and down in turn: what one of them has of
friction, the next has with the other sign, and an effect that explained it in both took off noise and nothing that
comes again. Recordings of anything else are fitted as they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from autotune.recordings.recording import CONDITIONING, Recording, Segment

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
