"""A torque that comes late: τ·T' = u − T, the current loop; `torque_path` has the equations.

One that comes by a bus, or through several filters, is late as a whole: `steepness` is the share of the lag that three
further stages have; at three quarters all four are alike, and the step of the torque is nearly that of a delay.
"""

from __future__ import annotations

from collections.abc import Iterator

from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, flag, state_block
from autotune.models.look_alikes import IN_QUICK_MOTION
from autotune.models.start_values import StartContext, StartValues, Vary

TIME_CONSTANT = block("torque_lag")
STEEPNESS = TIME_CONSTANT + 1
STAGES = 3
"""Further stages of a lag that is late as a whole."""
IS_LATE = flag("torque_lag")
MOTOR_TORQUE = state_block("torque_lag")


def starts(c: StartContext) -> Iterator[StartValues]:
    """A third of a sample."""
    h = c.period
    yield StartValues({"time_constant": 0.3 * h}, {"time_constant": Vary(0.5 * h, h)})


def free_shape(c: StartContext) -> StartValues:
    """Half of the lag in further stages, to begin with."""
    return StartValues({"steepness": 0.5}, {"steepness": Vary(0.3, 0.3)})


TORQUE_LAG = Kind(
    name="torque_lag",
    parameters=(
        Parameter("time_constant", "s", 0.0, 0.0, 0.1, "of the torque loop", TIME_CONSTANT),
        Parameter("steepness", "1", 0.0, 0.0, 1.0, "share of it in further stages", STEEPNESS, True),
    ),
    looks_like="The torque comes late: the error grows with how fast the torque changes, not with its size.",
    cause="A slow current loop, a filter on the torque demand, a delay on the bus.",
    remedy="Tune the current loop, remove torque filters, use a shorter bus cycle.",
    look_alikes=(IN_QUICK_MOTION,),
    not_fed_forward="its inverse amplifies what the torque loop cannot follow",
    starts=starts,
    free_shape=free_shape,
    quick=True,
    lost_in_alignment=True,
    loop_like=True,
)
