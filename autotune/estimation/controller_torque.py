"""Is the torque just the controller? A regression then finds the controller instead of the axis.

In closed loop two laws hold at once: the torque is what the axis needs, and what the controller makes of
reference and position. Where the reference causes the motion the first can be found in spite of the second, but
for effects that are linear in the motion themselves: a controller's law looks like them. Where something else
causes the motion (a hand, another axis) the torque is the controller's answer to it and says nothing of the axis.
"""

from __future__ import annotations

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.data import Prepared, filtered_motion
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.residual import smoothed
from autotune.models.table import EFFECTS, names

LAGS = 4
LOOP_LIKE = names(kind for kind in EFFECTS.values() if kind.loop_like)
"""Effects that are linear in the motion, as a controller is."""
LONGEST_DELAY = 0.1  # s


def linear_share(data: Prepared) -> float:
    """Share of the torque's variance that is linear in reference and position of the last few samples."""
    if not data.recorded_reference:
        return 0.0
    rows = _rows(data, LAGS)
    columns = [
        np.roll(values, lag)[rows] for values in (data.reference, data.measured) for lag in range(LAGS)
    ]
    total = np.cumsum(data.reference - data.measured)
    return _explained(np.column_stack([*columns, total[rows], np.ones(len(rows))]), data.torque[rows])


def loop_like(data: Prepared, policy: Policy = POLICY) -> frozenset[str]:
    """Effects that a regression on these data could take the controller for; empty where it is no danger."""
    return LOOP_LIKE if not data.repeated and linear_share(data) > policy.answer_explains else frozenset()


def loop_note(data: Prepared, policy: Policy = POLICY) -> tuple[str, ...]:
    """A sentence where the torque may be just the controller's."""
    if not loop_like(data, policy):
        return ()
    alike = ", ".join(sorted(LOOP_LIKE)).replace("_", " ")
    return (
        f"Reference and position make {100 * linear_share(data):.1f} % of the torque, as a controller does, but not "
        f"one that can be simulated here: {alike} may be that controller instead of the axis and stay suspected. "
        "Record its gains, or every sample of torque command, reference and position.",
    )


def refuse_answers(data: Prepared, policy: Policy = POLICY) -> None:
    """Raises NotEnoughExcitation where the torque answers a motion that it did not cause."""
    if data.repeated or data.steady:
        return
    foreign = _foreign_to_reference(data, policy) if data.recorded_reference else _holds_back(data, policy)
    if foreign:
        raise NotEnoughExcitation(
            "the torque is just a controller's answer to a motion that something else caused (it follows position and "
            "velocity, and holds against them); it tells the controller, not the axis. Record a motion that the "
            "drive itself makes"
        )


def _foreign_to_reference(data: Prepared, policy: Policy) -> bool:
    """Whether the torque is linear in the motion and the reference does not cause the motion."""
    wanted = filtered_motion(data.reference, data.stretches, data.period, data.motion_cutoff)[1]
    velocity = data.velocity[data.grid]
    best = 0.0
    for delay in np.linspace(0.0, LONGEST_DELAY, 11):
        late = np.roll(wanted, round(float(delay) / data.period))[data.grid]
        best = max(best, _explained(np.column_stack([late, np.ones(len(late))]), velocity))
    return best < policy.reference_causes and linear_share(data) > policy.answer_explains


def _holds_back(data: Prepared, policy: Policy) -> bool:
    """Whether the torque is linear in the motion, against position and against velocity."""
    acted = smoothed(data, data.torque)
    parts = [smoothed(data, values) for values in (data.position, data.velocity, data.acceleration)]
    table = np.column_stack([*parts, np.ones(len(acted))])
    scale = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    stiffness, damping, _, _ = np.linalg.lstsq(table / scale, acted, rcond=1e-10)[0] / scale
    against = stiffness < 0.0 and damping < 0.0
    strong = abs(stiffness) * float(np.std(parts[0])) > policy.answer_holds * float(np.std(acted))
    return bool(against and strong and _explained(table, acted) > policy.answer_explains)


def _rows(data: Prepared, margin: int, most: int = 40_000) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Samples inside the stretches, at most so many."""
    inside = np.concatenate([np.arange(s.start + margin, s.stop, dtype=np.int64) for s in data.stretches])
    return inside[:: max(1, len(inside) // most)]


def _explained(columns: Floats, target: Floats) -> float:
    """Share of the target's variance that columns of shape (n, k), a constant among them, explain."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    slope = np.linalg.lstsq(columns / scale, target, rcond=1e-10)[0]
    return 1.0 - float(np.var(target - columns / scale @ slope)) / max(float(np.var(target)), 1e-300)
