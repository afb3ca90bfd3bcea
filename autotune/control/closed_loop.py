"""The benchmark in a simulated closed loop: inertia, LuGre friction, and the drive's sampled PID.

    J v̇ = u − σ0 z − σ1 ż − σ2 v − F_g,   ż = v − |v| z / g(v)                       (3.8), (3.9)

The bristle is advanced exactly for a constant velocity (5.8), the velocity implicitly in the damping, in
`SUBSTEPS` parts of a sample. It is used for differences only: what another feedforward changes. Unlike
the linear response of `refinement`, it knows that the contact resists a wrong torque elastically until
it breaks away, so it is right for changes as large as the Coulomb torque.
"""

from __future__ import annotations

import math

import numpy as np

from autotune.control.feedforward import LugreParameters, stribeck_level
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.models.compiled import compiled
from autotune.recordings.recording import Controller

SUBSTEPS = 40
PERIODS = 8


@compiled
def _friction_step(p: Floats, state: Floats, torque: float, step: float) -> None:
    """One part of a sample; `state` is [q, v, z]."""
    v = state[1]
    saturation = stribeck_level(p, v) / p[3]
    if v != 0.0:
        decay = math.exp(-abs(v) / saturation * step)
        state[2] = decay * state[2] + math.copysign(saturation, v) * (1.0 - decay)
    z = state[2]
    rate = v - abs(v) / saturation * z
    friction = p[3] * z + p[4] * rate + p[1] * v + p[5]
    damping = p[1] + p[4] * max(0.0, 1.0 - abs(z) / saturation)
    state[1] = v + step * (torque - friction) / (p[0] + step * damping)
    state[0] += step * state[1]


@compiled
def _run(
    reference: Floats,
    feedforward: Floats,
    p: Floats,
    c: Floats,
    limit: float,
    period: float,
    state: Floats,
    error: Floats,
) -> None:
    """`error` is left with the last of `PERIODS` periods; `c` is kp, kd, ki, derivative filter."""
    count = len(reference)
    state[0] = reference[0]
    state[1] = (reference[1] - reference[count - 1]) / (2.0 * period)
    total = derivative = 0.0
    before, position = reference[0], reference[0]
    for k in range(PERIODS * count):
        i = k % count
        deviation = reference[i] - state[0]
        slope = ((reference[i] - before) - (state[0] - position)) / period
        derivative += c[3] * (slope - derivative)
        before, position = reference[i], state[0]
        summed = total + deviation * period
        torque = c[0] * deviation + c[1] * derivative + c[2] * summed + feedforward[i]
        if abs(torque) <= limit:
            total = summed
        else:
            torque = math.copysign(limit, torque)
        error[i] = deviation
        for _ in range(SUBSTEPS):
            _friction_step(p, state, torque, period / SUBSTEPS)


def steady_error(
    axis: LugreParameters,
    controller: Controller,
    reference: Floats,
    feedforward: Floats,
    period: float,
    limit: float = math.inf,
) -> Floats:
    """Tracking error of one period of a periodic reference in its steady cycle.

    Args:
        axis: inertia and friction of the axis.
        controller: the drive's position controller.
        reference, feedforward: one period each, shape (n,) [rad, N m].
        period: sample period [s].
        limit: of the torque [N m].

    Returns:
        reference − position, shape (n,) [rad].

    Raises:
        ConfigurationError: an axis without inertia, or a loop that is not stable on it.
    """
    if axis.inertia <= 0.0 or len(reference) != len(feedforward):
        raise ConfigurationError(
            f"the closed loop needs an inertia above 0 (it is {axis.inertia}) and a feedforward for each of the "
            f"{len(reference)} samples (there are {len(feedforward)})"
        )
    gains = (controller.kp, controller.kd, controller.ki, controller.derivative_filter)
    error = np.empty(len(reference))
    _run(reference, feedforward, axis.array(), np.array(gains), limit, period, np.zeros(3), error)
    if not np.all(np.isfinite(error)) or float(np.max(np.abs(error))) > float(np.ptp(reference)):
        raise ConfigurationError(
            "the drive's controller is not stable on the identified model; identify the axis again"
        )
    return error
