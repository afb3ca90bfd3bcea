"""What a guard's stop says about the axis, told from the last samples: an axis to refuse, or something in the way.

Only what cannot be anything else is taken for the axis's own doing: a loop that swings ever wider by itself, a gap
that closed several times at the same distance after a reversal, an axis that has not even begun to move.
Everything else, an impact at one place above all, stays a stop by the guard.
"""

from __future__ import annotations

import itertools

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Axis
from autotune.recordings.recording import Recording
from autotune.tuning.unfit_axes import POLICY, oscillates, oscillation

TAIL_SECONDS = 0.3
LEAST_SAMPLES = 20
LEAST_SWINGS = (
    4  # crossings of the mean, each from beyond `POLICY.counts` on one side to beyond it on the other
)
UNMOVED = (
    0.25  # of the benchmark's amplitude: an axis that gave way by less, against all its torque, has not moved
)
IMPACT = 20.0  # times the usual error: what a gap makes when it closes; sound axes stay below 11
RISE = 5.0  # times the error where the look begins: an impact comes out of nothing, friction at a reversal dies away
SAME_PLACE, LEAST_IMPACTS = 0.1, 3
BESIDE_IMPACTS = 0.6  # share of all impacts that must be at that distance
LOAD_SECONDS = 3.0  # of a window that motion in both directions tells the load of
LEAST_MOVING = 0.05  # s in each direction of it
LOAD_CHANGE = 0.5  # of friction: gravity that turns with the axis makes less than a quarter


def explained(recording: Recording, axis: Axis, *, baseline: bool) -> str:
    """Why the axis must not be tuned, in words; "" where the stop says nothing of the kind.

    Args:
        recording: until the guard stopped the axis.
        baseline: it was the first motion of the run.
    """
    if "reference" not in recording or len(recording) < LEAST_SAMPLES:
        return ""
    error = recording["reference"] - recording["position"]
    if not np.all(np.isfinite(error)):
        return ""
    if words := swings(error, recording.period, axis):
        return words
    if baseline and float(np.ptp(recording["position"])) < UNMOVED * axis.benchmark.amplitude:
        return (
            "the axis has not broken away: its friction is above the torque that limits.torque allows, it is blocked, "
            "or a brake is on. Nothing can be told from an axis that does not move; free it, then run again"
        )
    return loose(recording, axis) or pushed(recording)


def pushed(recording: Recording) -> str:
    """A load that changes in time: half the sum of the torques that slide the axis up and down."""
    velocity = np.gradient(recording["position"], recording.period)
    torque, window = recording["torque"], round(LOAD_SECONDS / recording.period)
    slow = 0.1 * float(np.percentile(np.abs(velocity), 99.0))
    loads, levels = [], []
    for begin in range(0, len(torque) - window + 1, window):
        part, speed = torque[begin : begin + window], velocity[begin : begin + window]
        up, down = part[speed > slow], part[speed < -slow]
        if min(len(up), len(down)) * recording.period >= LEAST_MOVING:
            loads.append(0.5 * float(np.median(up) + np.median(down)))
            levels.append(0.5 * float(np.median(up) - np.median(down)))
    if len(loads) < LEAST_IMPACTS or np.ptp(loads) <= LOAD_CHANGE * np.median(levels):
        return ""
    return (
        f"the load changes in time: the mean of the torques that move the axis up and down went from {min(loads):.3g} "
        f"to {max(loads):.3g}, where friction takes {np.median(levels):.3g}. Somebody leans on the axis, or a process "
        "force acts; what is learned so is wrong a moment later. Keep the axis free, then run again"
    )


def swings(error: Floats, period: float, axis: Axis) -> str:
    """A loop that oscillates by itself at the end of a recording."""
    tail = error[-round(TAIL_SECONDS / period) :]
    beyond = POLICY.counts * axis.position_resolution
    sides = np.sign(tail - tail.mean())[np.abs(tail - tail.mean()) > beyond]
    if np.count_nonzero(np.diff(sides)) < LEAST_SWINGS:
        return ""
    found = oscillation(tail, period, axis.benchmark.frequency)
    return oscillates(found, axis.motion_unit) if found.share > POLICY.oscillating else ""


def loose(recording: Recording, axis: Axis) -> str:
    """Backlash wider than the benchmark: the load is struck at the same distance after each reversal."""
    gap = gap_of(recording, axis.benchmark.amplitude)
    if gap is None:
        return ""
    return (
        f"the load follows the motor only after about {gap:.3g} {axis.motion_unit} from each reversal: backlash, wider "
        f"than the benchmark's amplitude of {axis.benchmark.amplitude:g} {axis.motion_unit}. What would be learned is "
        "the motor without its load. Repair the transmission, or choose a larger benchmark.amplitude, then run again"
    )


def gap_of(recording: Recording, beyond: float) -> float | None:
    """Distance after a reversal, above `beyond`, at which the load is struck [motion unit]; None for no such place.

    Nearer to the reversal friction turns round, which is an error too.
    """
    reference = recording["reference"]
    error = np.abs(reference - recording["position"])
    direction = np.sign(np.diff(reference, append=reference[-1]))
    moving = np.flatnonzero(direction)
    if not len(moving):
        return None
    usual = float(np.median(error[moving]))
    turned = direction[moving][1:] != direction[moving][:-1]
    turns = [int(moving[0]), *(int(k) for k in moving[1:][turned]), len(reference)]
    impacts = []
    for begin, end in itertools.pairwise(turns):
        way = np.abs(reference[begin:end] - reference[begin])
        far = np.flatnonzero(way > beyond)
        hit = int(far[np.argmax(error[begin:end][far])]) if len(far) else 0
        if len(far) and error[begin + hit] > max(IMPACT * usual, RISE * error[begin + far[0]]):
            impacts.append((float(way[hit]), float(direction[begin])))
    return _same_place(impacts)


def _same_place(impacts: list[tuple[float, float]]) -> float | None:
    """The distance at which most impacts are, in both directions."""
    if len(impacts) < LEAST_IMPACTS:
        return None
    middle = float(np.median([distance for distance, _ in impacts]))
    same = [impact for impact in impacts if abs(impact[0] - middle) <= SAME_PLACE * middle]
    enough = len(same) >= max(LEAST_IMPACTS, BESIDE_IMPACTS * len(impacts))
    return middle if enough and len({direction for _, direction in same}) == 2 else None
