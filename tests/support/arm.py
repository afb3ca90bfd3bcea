"""A joint that moves slowly, without a reference, as the torque of its friction, gravity and springs makes it."""

from __future__ import annotations

import math

import numpy as np

from autotune.recordings.recording import Metadata, Recording

PERIOD, SECONDS = 2e-3, 16.0
INERTIA, COULOMB, VISCOUS, OFFSET = 0.4, 2.0, 0.3, 0.5


def arm(
    gravity: float = 0.0,
    spring: float = 0.0,
    sign: float = 1.0,
    narrow: float = 1.0,
    curved: float = 0.0,
    period: float = PERIOD,
    coulomb: float = COULOMB,
) -> Recording:
    """A joint on four sines, without a reference: friction reverses over a milliradian, noise of 0.02 N m."""
    time = np.arange(round(SECONDS / period)) * period
    position, velocity, acceleration = np.full(len(time), 0.4), np.zeros(len(time)), np.zeros(len(time))
    for size, rate, phase in ((0.7, 0.13, 0.0), (0.3, 0.41, 1.0), (0.12, 0.97, 2.0), (0.03, 2.3, 3.0)):
        angle, turn = 2.0 * math.pi * rate * time + phase, 2.0 * math.pi * rate
        position += narrow * size * np.sin(angle)
        velocity += narrow * size * turn * np.cos(angle)
        acceleration -= narrow * size * turn**2 * np.sin(angle)
    bent = np.zeros(len(time))
    for k in range(1, len(time)):
        way = (position[k] - position[k - 1]) / 1e-3
        bent[k] = math.copysign(1.0, way) + (bent[k - 1] - math.copysign(1.0, way)) * math.exp(-abs(way))
    torque = INERTIA * acceleration + VISCOUS * velocity + coulomb * bent + OFFSET
    torque += gravity * np.sin(position + 0.6) + spring * position + curved * (position - 0.4) ** 2
    # what acts until the next sample is logged at the sample, and noise beside it
    torque = 0.5 * (torque + np.append(torque[1:], torque[-1]))
    torque = sign * torque + 0.02 * np.random.default_rng(3).normal(size=len(time))
    return Recording.from_columns(
        {"time": time, "position": position, "torque": torque}, Metadata(sample_period=period), "moves"
    )
