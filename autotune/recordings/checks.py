"""What a recording must be before anything is fitted to it.

Everything here raises with a sentence that names the row, the value and what to do; a recording that
passes has finite numbers, increasing time and enough rows that move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.recordings.limits import refuse_time
from autotune.recordings.recording import Recording
from autotune.signals.runs import runs_of, white_noise

LEAST_SECONDS = 0.5
LEAST_ROWS = 200
GRAVE_CLIPPING = 0.05
GRAVE_LIMITING = 0.3
"""Share of rows at the torque limit: where nothing says that the flat tops are a limit, and where it is known."""
AMPLIFIED = 2.0
"""Times what its reference moves, at one frequency: more is no answer of a loop with usual margins (a resonance peak of
6 dB), and the axis swings there by itself."""
SWING_SECONDS = 1.0
"""Of the windows in which a swing is looked for."""
_FLAT_TOP = 5
_LEAST_TOPS = 3
"""Visits to the extreme: one or two may be a plateau that was commanded."""
WITHIN = 3.0
"""Standard deviations of its noise by which a torque is off the level that it is cut off at, on either side."""


@dataclass(frozen=True, slots=True)
class Clipping:
    """Rows whose torque sits at a limit: shape (n,) of bool, and the limit [N m]."""

    rows: NDArray[np.bool_]
    limit: float

    @property
    def share(self) -> float:
        return float(np.mean(self.rows)) if len(self.rows) else 0.0


def check_recording(recording: Recording) -> None:
    """Refuses what cannot be a recording of one moving axis.

    Raises:
        RecordingError: empty, NaN, time that stands still or runs backwards, two axes in one file.
        NotEnoughExcitation: too short, or position or torque never changes.
    """
    rows = len(recording)
    if rows == 0:
        raise RecordingError("the recording is empty; record the programme again")
    for name in ("time", "position", "torque", "reference", "torque_command", "torque_feedforward"):
        if name in recording:
            _finite(name, recording[name], recording["time"])
    refuse_time(recording)
    if rows < LEAST_ROWS or rows * recording.period < LEAST_SECONDS:
        raise NotEnoughExcitation(
            f"the recording is too short: {rows} rows, {rows * recording.period:.3g} s; at least "
            f"{LEAST_ROWS} rows and {LEAST_SECONDS} s are needed"
        )
    for name in ("position", "torque"):
        if np.ptp(recording[name]) == 0.0:
            raise NotEnoughExcitation(
                f"{name} is {recording[name][0]:g} in all {rows} rows; the axis was not excited. "
                "Check that power was on and that the column is the right one"
            )


def torque_of(recording: Recording) -> Floats:
    """The torque that acts during each sample: the demand where recorded, else the measured torque."""
    return recording["torque_command"] if "torque_command" in recording else recording["torque"]


def guide_of(recording: Recording) -> Floats:
    """The reference where there is one, else the measured position."""
    return recording["reference" if "reference" in recording else "position"]


def clipped(recording: Recording) -> Clipping:
    """Rows at the torque limit: of the metadata, else where the torque is cut off again and again."""
    return at_limit(torque_of(recording), recording.metadata.torque_limit)


def at_limit(torque: Floats, limit: float | None) -> Clipping:
    """Rows at a torque limit; where none is known, where the torque is cut off again and again.

    A torque that is held is no torque that is cut: a step that was commanded is flat before and after too.
    """
    if limit is not None:
        return Clipping(np.abs(torque) >= limit * (1.0 - 1e-3), limit)
    peak = float(np.max(np.abs(torque)))
    at_peak = np.abs(np.abs(torque) - peak) <= 1e-6 * peak
    return Clipping(_cut_off(torque, at_peak), peak)


def noisy_limit(torque: Floats) -> float | None:
    """Where a measured torque, shape (n,), may be cut off as its noise lets one see, by its lower edge; else None.

    There it scatters about one level, and no value comes again. A torque that only comes so far looks alike: this is to
    be asked, and not believed.
    """
    noise, size = white_noise(torque), np.abs(torque)
    near = size[size >= float(np.max(size)) - 2.0 * WITHIN * noise]
    limit = float(np.median(near)) - WITHIN * noise
    return limit if noise > 0.0 and limit > 0.0 and len(runs_of(size >= limit)) > 1 else None


def refuse_clipping(recording: Recording) -> Clipping:
    """Raises NotEnoughExcitation where the torque sits at its limit for a grave share of the time.

    At a limit that the recording names, the demand is what the drive delivers: such rows are only left out.
    """
    found = clipped(recording)
    allowed = GRAVE_CLIPPING if recording.metadata.torque_limit is None else GRAVE_LIMITING
    if found.share > allowed:
        raise NotEnoughExcitation(
            f"{_where(recording, found)}; at most {100 * allowed:.0f} % are allowed. {_instead(recording)}"
        )
    return found


def refuse_limits_throughout(recording: Recording) -> None:
    """Raises NotEnoughExcitation where the torque keeps coming to its limit, of rows of which none was left to compare.

    Around a limit nothing is compared; a loop that hunts between its limits is at one of them a hundred times a second.
    """
    found = clipped(recording)
    if found.share > GRAVE_CLIPPING:
        raise NotEnoughExcitation(
            f"{_where(recording, found)}, and nowhere is it away from it for long enough. {_instead(recording)}"
        )


def swings_at(recording: Recording) -> float:
    """Frequency at which the torque is strongest, where the axis moves there far more than its reference asks [Hz].

    0 where it does not, or where the recording has no reference to tell it by.
    """
    if "reference" not in recording:
        return 0.0
    rows = min(len(recording) - 2, max(round(SWING_SECONDS / recording.period), 8))
    columns = (torque_of(recording)[2:], *(np.diff(recording[one], 2) for one in ("position", "reference")))
    spectra = [welch(one, 1.0 / recording.period, nperseg=rows) for one in columns]
    hertz, power = spectra[0]
    best = int(np.argmax(power[1:])) + 1
    near = slice(max(best - 2, 1), best + 3)  # the lobe of the window
    moved, asked = (float(one[1][near].sum()) for one in spectra[1:])
    return float(hertz[best]) if moved > AMPLIFIED**2 * asked else 0.0


def _where(recording: Recording, found: Clipping) -> str:
    first = recording["time"][int(np.argmax(found.rows))]
    share = f"{100 * found.share:.0f} %"
    return f"the torque is clipped at {found.limit:.4g} in {share} of the rows (first at {first:.3f} s)"


def _instead(recording: Recording) -> str:
    """What to do about a torque at its limit."""
    hertz = swings_at(recording)
    if hertz == 0.0:
        return "Record with gentler motion"
    return (
        f"The axis swings at {hertz:.3g} Hz, where its reference does not move: the loop hunts. Lower the gains until "
        "it is quiet, and record again; play or a spring between motor and load often is the cause"
    )


def _cut_off(torque: Floats, at_peak: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows of flat tops, where enough of them cut off a torque that was moving: shape (n,)."""
    tops = [(start, stop) for start, stop in runs_of(at_peak) if stop - start >= _FLAT_TOP]
    rows = np.zeros(len(at_peak), dtype=np.bool_)
    if sum(_moving(torque[max(a - 2, 0) : a]) or _moving(torque[b : b + 2]) for a, b in tops) >= _LEAST_TOPS:
        for start, stop in tops:
            rows[start:stop] = True
    return rows


def _moving(two: Floats) -> bool:
    """Two rows beside a flat top that are not on a plateau of their own."""
    return len(two) == 2 and bool(two[0] != two[1])


def _finite(name: str, values: Floats, time: Floats) -> None:
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        raise RecordingError(
            f"column {name} has {len(wrong)} values that are not numbers, the first in row {wrong[0]} "
            f"(time {time[wrong[0]]:.6g} s); remove those rows or record again"
        )
