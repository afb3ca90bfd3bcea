"""The kinetic model with Karnopp's zone does what section 3.1 and Figures 3.2, 3.5 to 3.7 say of it."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.errors import ConfigurationError
from autotune.models.kinetic import KineticAxis, kinetic_step, pulled

UNIT = KineticAxis(1.0, 0.0, 1.0, 1.0, zone=1e-5)


def test_positive_damping_reaches_the_fixed_point() -> None:
    """(3.6) with kv > 0: the error comes to rest at 1, the speed at that of the reference (Figure 3.2, left)."""
    position, velocity = pulled(UNIT, 1.0, 0.5, 1.0, 60.0, 1e-4)
    assert velocity[-1] == pytest.approx(1.0, abs=1e-3)
    assert 1.0 * (len(position) - 1) * 1e-4 - position[-1] == pytest.approx(1.0, abs=1e-3)


def test_negative_damping_sticks_and_slips_for_ever() -> None:
    """kv < 0: an attractive limit cycle with rests (Figure 3.2, right)."""
    _, velocity = pulled(UNIT, 1.0, -0.2, 1.0, 80.0, 1e-4)
    late = velocity[-200_000:]
    assert np.mean(late == 0.0) > 0.02
    assert np.max(late) > 1.5


def test_falling_friction_sticks_and_slips_where_it_is_slow_and_soft() -> None:
    axis = KineticAxis(1e-3, 1e-3, 0.3, 0.5, 0.2)
    cases = ((0.005, 0.02), (0.1, 2.0))  # a soft damper at a crawl, a stiff one at speed
    rests = [float(np.mean(pulled(axis, 5.0, kv, speed, 6.0)[1][-300_000:] == 0.0)) for kv, speed in cases]
    assert rests[0] > 0.2
    assert rests[1] == 0.0


def test_at_rest_friction_takes_what_is_applied_up_to_break_away() -> None:
    """(3.3): nothing moves below F_s, whatever the sign; offset counts."""
    axis = KineticAxis(1e-3, 0.0, 0.3, 0.5, offset=0.1)
    state = np.zeros(2)
    for torque in (0.59, -0.39):
        kinetic_step(axis.array(), state, torque, 1e-4)
        assert state.tolist() == [0.0, 0.0]
    kinetic_step(axis.array(), state, 0.61, 1e-4)
    assert state[1] == pytest.approx(1e-4 * 0.01 / 1e-3)


def test_a_zone_of_no_width_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="zone must be above 0"):
        KineticAxis(1.0, 0.0, 1.0, 1.0, zone=0.0)
