"""What a drive has recorded by itself meets the samples that the host has seen.

The drive samples at its own rate and cannot be late; the host knows which experiment was being played.
Both know the SYNC counter: the host's sample of SYNC n is the drive's sample in which the counter is n.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from autotune.core.arrays import Flags, Integers
from autotune.core.drive_recording import DriveRecording
from autotune.core.errors import LinkError, RecordingError
from autotune.recordings.recording import Recording

_WRAP = 1 << 16
EDGE = 2  # cycles by which host and drive may differ at the ends of a segment


def join(host: Recording, drive: DriveRecording) -> Recording:
    """The drive's samples with the host's labels, in the host's time.

    Samples between two that the host has seen are kept where the host had lost them, and dropped where
    nothing was being played (power off and on between experiments).

    Raises:
        LinkError: the drive has lost samples, or recorded none of what was played.
        RecordingError: the host has no samples.
    """
    if not len(host):
        raise RecordingError(
            "the host has seen no samples; there is nothing to join the drive's recording to"
        )
    _refuse_gaps(drive)
    seen = _syncs_of(host, drive)
    syncs = _unwrapped(drive.sync)
    syncs += _aligned(int(seen[0]), int(syncs[0]))
    place = np.searchsorted(seen, syncs, side="right") - 1
    wanted = _wanted(seen, syncs, place, host.missed)
    if not wanted.any():
        raise LinkError(
            "the drive's recorder has nothing of what was played: its SYNC counter and the host's do not meet. "
            "Record without it, or check recorder.columns.sync in the profile"
        )
    _refuse_missing(seen, syncs[wanted])
    cycles = _unwrapped(drive.cycle)[wanted]
    first = place[wanted][0]
    began = round(float(host["time"][first]) / drive.period)
    time = (began + cycles - cycles[0]) * drive.period
    columns = {name: values[wanted] for name, values in drive.columns.items()}
    rows = np.clip(place[wanted], 0, None)
    return Recording.from_columns(
        {"time": np.asarray(time), **columns},
        replace(host.metadata, sample_period=drive.period),
        host.experiment[rows],
        host.repeat[rows],
        np.zeros(len(rows), dtype=np.int64),
    )


def _refuse_gaps(drive: DriveRecording) -> None:
    steps = np.diff(drive.cycle) % _WRAP
    lost = np.flatnonzero(steps != 1)
    if len(lost):
        raise LinkError(
            f"the drive's recorder has lost {int((steps[lost] - 1).sum())} samples in {len(lost)} places, the "
            f"first after sample {int(lost[0])} of {len(drive.cycle)}; record without it"
        )


def _syncs_of(host: Recording, drive: DriveRecording) -> Integers:
    """SYNC counter of each host sample, unwrapped."""
    period = host.metadata.sample_period or 1.0
    count = np.rint(host["time"] / period).astype(np.int64) + 1
    if not drive.marks:
        raise LinkError("the host has not seen the drive's SYNC counter; name it in signals.sync_counter")
    starts = np.array([mark[0] for mark in drive.marks])
    values = np.array([mark[1] for mark in drive.marks])
    index = np.clip(np.searchsorted(starts, count, side="right") - 1, 0, None)
    return _unwrapped((values[index] + count - starts[index]) % _WRAP)


def _unwrapped(low: Integers) -> Integers:
    """A 16-bit counter that never goes back, as it would be with more bits."""
    steps = np.diff(low) % _WRAP
    return np.asarray(np.concatenate([low[:1], low[0] + np.cumsum(steps)]), dtype=np.int64)


def _aligned(host: int, drive: int) -> int:
    """What has to be added to the drive's counter: a multiple of 2¹⁶ that brings it next to the host's."""
    return round((host - drive) / _WRAP) * _WRAP


def _wanted(seen: Integers, syncs: Integers, place: Integers, missed: Integers) -> Flags:
    inside = (place >= 0) & (syncs <= seen[-1])
    exact = inside & (seen[np.clip(place, 0, None)] == syncs)
    after = np.clip(place + 1, 0, len(seen) - 1)
    bridged = inside & ~exact & (missed[after] > 0)
    return np.asarray(exact | bridged)


def _refuse_missing(seen: Integers, recorded: Integers) -> None:
    """Both ends must be there; between them two SYNCs may fall into one cycle of the drive's own clock."""
    before = int(np.count_nonzero(seen < recorded[0]))
    after = int(np.count_nonzero(seen > recorded[-1]))
    if before > EDGE or after > EDGE:
        raise LinkError(
            f"the drive's recorder lacks {before + after} of {len(seen)} samples that the host has seen, {before} "
            f"at the beginning and {after} at the end: it started late or was full. Record a shorter programme"
        )
