"""The bristle at the first row of a piece, from the torques of its first moments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.estimation.twin import starting_state
from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.models.inverse import required
from autotune.models.layout import BRISTLE, POSITION, VELOCITY

PERIOD, ROWS = 1e-3, 60
MODEL = base_model(
    {
        "inertia": 6.66e-4,
        "viscous": 4e-3,
        "coulomb": 0.33,
        "stiffness": 100.0,
        "micro_damping": 0.1,
        "offset": 0.05,
        "break_away": 0.36,
        "stribeck_velocity": 0.3,
    }
)


def _played(share: float, speed: float, acceleration: float):
    """Motion at constant acceleration with a bristle that starts at `share` of its limit."""
    time = PERIOD * np.arange(ROWS)
    motion = (
        speed * time + 0.5 * acceleration * time**2,
        speed + acceleration * time,
        np.full(ROWS, acceleration),
    )
    packed = MODEL.pack()
    state, torque = np.zeros(layout.STATES), np.empty(ROWS)
    state[BRISTLE] = share * 0.33 / 100.0
    required(packed.p, packed.on, state, *motion, PERIOD, 4, torque)
    return packed, torque, motion


@settings(deadline=None)
@given(share=st.floats(-1.0, 1.0), acceleration=st.floats(-30.0, 30.0))
def test_the_bristle_is_found_through_a_reversal(share: float, acceleration: float) -> None:
    """Exact where the first moments do not wipe out the start: no filter and no noise here."""
    packed, torque, motion = _played(share, 0.0, acceleration)
    state = starting_state(packed, torque, *motion, PERIOD)
    assert state[BRISTLE] == pytest.approx(share * 0.33 / 100.0, abs=1e-9)
    assert state[POSITION] == motion[0][0]
    assert state[VELOCITY] == motion[1][0]


@settings(deadline=None)
@given(share=st.floats(-1.0, 1.0), speed=st.floats(0.5, 20.0), sign=st.sampled_from([-1.0, 1.0]))
def test_in_fast_sliding_the_bristle_stands_at_its_limit(share: float, speed: float, sign: float) -> None:
    packed, torque, motion = _played(share, sign * speed, 0.0)
    bristle = starting_state(packed, torque, *motion, PERIOD)[BRISTLE]
    assert np.sign(bristle) == sign or speed < 2.0
    assert abs(bristle) <= 0.36 / 100.0 * (1 + 1e-12)
