"""What the daily check is going to move, in numbers, before a person is asked."""

from __future__ import annotations

from autotune.core.axis import Axis
from autotune.monitoring.check_plan import COMPENSATED, plan_check
from autotune.tuning.motion_plan import MotionPlan, planned


def planned_check(axis: Axis) -> MotionPlan:
    """Travel, speed and machine time of the check.

    Raises:
        ConfigurationError: the limits leave no room for it.
    """
    plan = plan_check(axis)
    found = planned((plan.legs, plan.window(COMPENSATED)), axis)
    return MotionPlan(found.low, found.high, found.speed, plan.duration)
