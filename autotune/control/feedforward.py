"""LuGre feedforward on the reference (section 5.1.2): what torque tracks it if the axis obeys the model.

    u_ff = J r̈ + σ2 ṙ + σ0 z + σ1 ż + F_g                              (5.2)
    ż    = ṙ − |ṙ| z / g(ṙ),  g(ṙ) = (F_c + (F_s − F_c) e^−(ṙ/v_s)²) / σ0   (5.3), (3.5)

The friction state is advanced by the exact solution for a velocity that is constant over one sample
(5.8), which is stable at any speed. The torque depends on the reference only: it can be wrong, or
late, but it cannot destabilise the loop (Fact 5.2).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields, replace
from typing import Protocol

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.drive import Sample
from autotune.core.errors import ConfigurationError
from autotune.models.compiled import compiled


@dataclass(frozen=True, slots=True)
class LugreParameters:
    """Parameters of the feedforward; SI, motor side.

    `break_away` = `coulomb` where friction does not change with speed; it is below where friction rises from
    rest, as a boundary lubricant makes it (section 2.2.2).
    """

    inertia: float
    viscous: float
    coulomb: float
    stiffness: float
    micro_damping: float
    offset: float
    break_away: float
    stribeck_velocity: float = 1.0

    def __post_init__(self) -> None:
        values = astuple(self)
        if not all(math.isfinite(value) for value in values):
            raise ConfigurationError(f"feedforward parameters must be finite numbers, got {self}")
        if min(self.coulomb, self.break_away, self.stiffness, self.stribeck_velocity) <= 0:
            raise ConfigurationError(
                "feedforward parameters coulomb, break_away, stiffness and stribeck_velocity must be above "
                f"0, got {self}"
            )

    def array(self) -> Floats:
        """Values in field order, shape (8,), for the kernels."""
        return np.array(astuple(self), dtype=np.float64)

    @classmethod
    def from_array(cls, values: Floats) -> LugreParameters:
        return cls(*(float(value) for value in values))

    def with_friction(self, stiffness: float, coulomb: float, offset: float) -> LugreParameters:
        """The same with the three adapted parameters replaced; F_s keeps its ratio to F_c, σ1 to σ0."""
        return replace(
            self,
            stiffness=stiffness,
            coulomb=coulomb,
            offset=offset,
            break_away=coulomb * (self.break_away / self.coulomb),
            micro_damping=stiffness * (self.micro_damping / self.stiffness),
        )

    def drive_parameters(self) -> dict[str, float]:
        """As the drive's feedforward block names them."""
        return {f"feedforward.{field.name}": getattr(self, field.name) for field in fields(self)}


class FeedforwardLaw(Protocol):
    """Gives the torque offset for the reference of one cycle; sees the sample before it."""

    @property
    def settled(self) -> bool: ...

    def step(
        self, reference: float, velocity: float, acceleration: float, previous: Sample | None
    ) -> float: ...

    def prepare(self) -> None:
        """Compiles or loads what the first `step` would otherwise wait for."""


@compiled
def stribeck_level(p: Floats, velocity: float) -> float:
    """σ0 g(v) of (3.5): friction level in steady sliding [N m]. `p` as in LugreParameters."""
    level: float = p[2] + (p[6] - p[2]) * math.exp(-((velocity / p[7]) ** 2))
    return level


@compiled
def advance(p: Floats, state: Floats, velocity: float, acceleration: float, period: float) -> float:
    """One sample of (5.2) and (5.8); `state` is [z, ż] and is updated. Returns the torque."""
    z = state[0]
    speed = abs(velocity)
    saturation = stribeck_level(p, velocity) / p[3]
    rate = velocity - speed / saturation * z
    torque: float = p[0] * acceleration + p[1] * velocity + p[3] * z + p[4] * rate + p[5]
    if speed > 0.0:
        decay = math.exp(-speed / saturation * period)
        state[0] = decay * z + saturation * (1.0 - decay) * math.copysign(1.0, velocity)
    state[1] = rate
    return torque


@compiled
def _along(
    p: Floats, state: Floats, velocity: Floats, acceleration: Floats, period: float, torque: Floats
) -> None:
    for index in range(len(velocity)):
        torque[index] = advance(p, state, velocity[index], acceleration[index], period)


def feedforward_along(
    parameters: LugreParameters, velocity: Floats, acceleration: Floats, period: float, z: float = 0.0
) -> Floats:
    """Torque along a whole reference.

    Args:
        parameters: of (5.2).
        velocity, acceleration: of the reference, shape (n,) [rad/s, rad/s²].
        period: sample period [s].
        z: friction state at the first sample [rad].

    Returns:
        Torque, shape (n,) [N m].
    """
    torque = np.empty(len(velocity))
    state = np.array([z, 0.0])
    _along(parameters.array(), state, velocity, acceleration, period, torque)
    return torque


class FixedFeedforward:
    """Feedforward with fixed parameters (the second phase of section 6.3.8)."""

    settled = False

    def __init__(self, parameters: LugreParameters, period: float) -> None:
        self._parameters = parameters.array()
        self._period = period
        self._state = np.zeros(2)

    def prepare(self) -> None:
        """Compiles the kernel without changing the state."""
        advance(self._parameters, np.zeros(2), 0.0, 0.0, self._period)

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        return float(advance(self._parameters, self._state, velocity, acceleration, self._period))
