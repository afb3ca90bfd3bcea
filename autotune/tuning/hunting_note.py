"""What a run's report says of the drive's own gains: whether the axis hunts with them, by its model."""

from __future__ import annotations

from math import pi

from autotune.control.gains.hunting import predicted
from autotune.control.gains.loop import LoopTiming, of_controller
from autotune.control.gains.regimes import linear_axis
from autotune.control.gains.sampled import margins, sampled_axis
from autotune.control.gains.steps import step_sizes
from autotune.control.gains.stick_slip import sticks_at
from autotune.control.gains.words import cycle_in_words
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.tuning.session import Session

MORE = "'autotune gains' says more, and proposes others."


def hunting_note(session: Session, model: DriveModel, disturbance: float = 0.0, late: float = 0.0) -> str:
    """One or two sentences; "" where the drive does not tell its gains, or nothing can be said.

    `disturbance` is what shakes the axis [N m or N], `late` by how much the torque is late beside what the model
    knows [s]; 0 where it is not known.
    """
    if session.controller is None or model.torque_unit:
        return ""
    axis, benchmark = session.axis, session.axis.benchmark
    timing = LoopTiming(
        axis.cycle,
        axis.position_resolution,
        session.limits.torque,
        late,
        reference_filter=axis.reference.filter,
        disturbance=disturbance,
    )
    sizes = step_sizes(model, timing, benchmark.amplitude)
    try:
        gains = of_controller(session.controller)
        cycle = predicted(model, gains, timing, (sizes.large, sizes.small), slow=False)
        sliding = margins(sampled_axis(linear_axis(model, "sliding"), timing), gains, timing.period)
        sticks = sticks_at(model, gains, timing, 2.0 * pi * benchmark.frequency * benchmark.amplitude)
    except (ConfigurationError, FloatingPointError):
        return ""
    if cycle is not None:
        return f"With the drive's gains the axis hunts after a step, {cycle_in_words(cycle, axis.motion_unit)}. {MORE}"
    if not sliding.stable:
        return (
            f"The drive's gains are unstable while the axis slides; at a set point friction holds it. {MORE}"
        )
    if sticks:
        return f"With the drive's gains the axis stick-slips at the benchmark's own speed. {MORE}"
    return (
        f"With the drive's gains the axis does not hunt on the model; {sliding.phase:.0f}° and "
        f"{min(sliding.gain, sliding.gain_down):.1f} dB of margin are left while it slides."
    )
