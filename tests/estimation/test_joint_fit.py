"""What shakes an axis while it is fitted: friction averages it, and a twin in another colour averages it wrongly."""

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.estimation.controller_law import PositionController
from autotune.estimation.disturbance import Disturbance
from autotune.identify.fit import fit
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Controller, Metadata, Recording
from tests.estimation.simulated import AXIS, PERIOD, RESOLUTION, followed

ROUND = 2000
"""Rows of a repeat."""
ROUNDS = 21
SPEED = 2.0 * np.pi * 12.0
"""Of the loop [rad/s]: a soft one, in which a disturbance moves the axis as far as the reference does between
reversals."""
LAW = PositionController(
    3.0 * AXIS["inertia"] * SPEED**2, 3.0 * AXIS["inertia"] * SPEED, AXIS["inertia"] * SPEED**3, 1.0
)
LEVEL = 0.04 * AXIS["coulomb"]


def _repeated(disturbance: Disturbance, seed: int) -> Recording:
    """Slow sines that come again every two seconds; the first round is not fitted."""
    time = np.arange(ROUND * ROUNDS) * PERIOD
    tones = {1.0: 0.1, 4.5: 0.025, 13.0: 0.002}
    reference: Floats = np.sum([a * np.sin(2.0 * np.pi * f * time) for f, a in tones.items()], axis=0)
    shaken = disturbance.drawn(np.random.default_rng(seed), len(time), PERIOD)
    columns = followed(reference, shaken, LAW, base_model(AXIS))
    known = Controller(LAW.kp, LAW.kd, LAW.ki, LAW.derivative_filter)
    metadata = Metadata(sample_period=PERIOD, position_resolution=RESOLUTION, controller=known)
    number = np.arange(len(time)) // ROUND
    return Recording.from_columns(columns, metadata, np.where(number == 0, "conditioning", "sine"), number)


@pytest.mark.slow(3)
@pytest.mark.parametrize("milliseconds", [0.0, 4.5, 20.0])
def test_friction_is_as_stated_whatever_the_colour_of_what_shakes_the_axis(milliseconds: float) -> None:
    """4 % of Coulomb friction. A twin shaken by white noise as rough stated 1 to 2 % too much Coulomb friction, 50 to
    80 % too little viscous friction and 3 % too little stiffness of a coloured one, three to seven half intervals off.

    1.5 half intervals: three parameters of three recordings are all within them in 97 of 100 draws.
    """
    correlation = 1e-3 * milliseconds
    colour = {"coloured": LEVEL, "correlation": correlation} if correlation else {"white": LEVEL}
    found = fit(_repeated(Disturbance(**colour), seed=2)).estimate
    assert found.valid
    for name in ("coulomb", "viscous", "stiffness"):
        low, high = found[name].interval
        assert abs(found[name].value - AXIS[name]) < 1.5 * 0.5 * (high - low), name
    assert found["coulomb"].value == pytest.approx(AXIS["coulomb"], rel=0.005)
