"""Hysteresis that remembers where the motion turned: elastic elements in parallel (Maxwell slip).

Element i follows the motion until it is bent by its displacement d_i, then slides and carries its torque
W_i: z_i ← clip(z_i + Δq, −d_i, d_i), T = Σ W_i·z_i/d_i (Iwan 1966; Al-Bender, Lampaert and Swevers 2005).
Every reversal leaves elements bent, and a loop closes at the point where it began: the reversal-point
memory that the single bristle of LuGre does not have (thesis, sections 3.2.3 and 7.2).
"""

from __future__ import annotations

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, state_block

ELEMENTS = 10
_AT = block("reversal_memory")
_STATE = state_block("reversal_memory")


def _element(number: int) -> tuple[Parameter, ...]:
    at, later = _AT + 2 * (number - 1), number > 1
    return (
        Parameter(f"displacement_{number}", "rad", 0.0, 0.0, 1e6, "travel until it slides", at, later),
        Parameter(f"torque_{number}", "N m", 0.0, 0.0, 1e6, "what it carries when it slides", at + 1, later),
    )


REVERSAL_MEMORY = Kind(
    name="reversal_memory",
    parameters=tuple(parameter for number in range(1, ELEMENTS + 1) for parameter in _element(number)),
    looks_like="After a reversal the torque climbs in several stages over a long way; small loops inside "
    "large ones close where they began.",
    cause="Many contacts that let go one after another: preloaded balls and rollers, seals, wipers, cables.",
    remedy="Nothing is broken; compensate it. If the way has grown, look at preload and seals.",
)


@compiled
def memory_torque(p: Floats, state: Floats, displacement: float) -> float:
    """Moves all elements by `displacement` and returns what they carry [N m]."""
    total = 0.0
    for i in range(ELEMENTS):
        limit = p[_AT + 2 * i]
        if limit <= 0.0:
            break
        z = min(max(state[_STATE + i] + displacement, -limit), limit)
        state[_STATE + i] = z
        total += p[_AT + 2 * i + 1] * z / limit
    return total


@compiled
def memory_stiffness(p: Floats) -> float:
    """Stiffness of all elements together at rest [N m/rad]."""
    total = 0.0
    for i in range(ELEMENTS):
        if p[_AT + 2 * i] > 0.0:
            total += p[_AT + 2 * i + 1] / p[_AT + 2 * i]
    return total
