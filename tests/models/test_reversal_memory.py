"""What the elements of a memory say together: how drawn out the climb of friction is."""

from __future__ import annotations

import pytest

from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.models.reversal_memory import REVERSAL_MEMORY, drawn_out
from tests.support.axes import NOMINAL


@pytest.mark.parametrize(
    ("coulomb", "elements", "least", "most"),
    [
        (1.0, [], 1.0, 1.0),  # the bristle's own exponential
        (1e-6, [(1.0, 1.0)], 0.38, 0.40),  # straight up, then slides: 0.9 of the way, over ln 10
        (0.3, [(1.0, 0.7)], 0.4, 0.9),
        (1e-3, [(1.0, 0.8), (1.4, 0.2), (100.0, 0.01)], 0.38, 0.6),  # a far element next to nothing
        (1.0, [(4.0, 0.1)], 1.02, 1.2),  # a weak memory, hardly longer than the bristle
        (1.0, [(6.0, 0.3), (30.0, 0.2)], 1.5, 3.0),
    ],
)
def test_a_memory_draws_the_climb_out_and_one_contact_does_not(
    coulomb: float, elements: list[tuple[float, float]], least: float, most: float
) -> None:
    """Against a bristle that reaches its level along 1 (in the unit of the elements' displacements)."""
    p = base_model(NOMINAL).pack().p
    p[layout.COULOMB], p[layout.STIFFNESS] = coulomb, min(coulomb, 1e-2 if coulomb < 0.1 else coulomb)
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert least - 1e-9 <= drawn_out(p) <= most + 1e-9
