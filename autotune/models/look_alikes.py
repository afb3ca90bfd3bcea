"""Effects that look alike, and the experiment that tells them apart.

An effect names in its `Kind` the sets that it belongs to; who else is in a set follows from the table.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LookAlikes:
    """A set of effects that can look alike: what they have in common, and the experiment that separates them."""

    what: str
    experiment: str


IN_PLACE = LookAlikes(
    "torque that changes with position",
    "slow scans over several revolutions (or the whole travel), forward and backward",
)
IN_A_PART_OF_A_TURN = LookAlikes(
    "torque that changes smoothly over a part of a turn",
    "slow scans over a turn and a half or more; where the axis cannot turn so far, the same scans with another load: "
    "the torque of a weight changes with it, that of a spring does not",
)
IN_SPEED = LookAlikes(
    "torque that is not straight over speed",
    "point-to-point moves, fast scans and a multisine, so that speed and reversals vary apart",
)
IN_TORQUE = LookAlikes(
    "torque that falls short when it is large",
    "point-to-point moves near the torque limit, then the same moves with another load",
)
AT_REVERSALS = LookAlikes(
    "torque that differs between the directions",
    "small loops inside presliding, and moves at high torque",
)
IN_QUICK_MOTION = LookAlikes("torque that comes late or rings", "a multisine up to 25 Hz and above")
AT_STARTS = LookAlikes(
    "torque that is higher at a start",
    "starts after rests of 0.05 to 2.5 s, and slow triangles without any rest",
)
IN_TIME = LookAlikes(
    "friction that falls in the course of a recording",
    "the same slow motion, repeated cold and after minutes of fast moves",
)
LOOK_ALIKES = (
    IN_PLACE, IN_A_PART_OF_A_TURN, IN_SPEED, IN_TORQUE, AT_REVERSALS, IN_QUICK_MOTION, AT_STARTS, IN_TIME,
)  # fmt: skip
