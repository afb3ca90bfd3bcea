"""Feedforward from a drive model: the torque that the reference needs, with every effect that it decides.

    u_ff = J r̈ + F(r, ṙ; contact) + σ2 ṙ + F_g + Σ (ripple, imbalance, spring, reversal memory, …)

with the kernels of the inverse routine (`models.inverse`) stepped along the reference. Position, velocity and
acceleration are those of the set point at this sample. The torque is held from here to the next sample, so place
and speed are those of the middle between the two, half a sample ahead, r + T/2·ṙ and ṙ + T/2·r̈; the contact bends
with the mean velocity up to there, which is ṙ. The acceleration stays that of the set point. As in section 5.1.2
the torque depends on the reference only and cannot destabilise the loop.

Not every effect of a model belongs into a feedforward; `Kind.not_fed_forward` says which do not, and why.
"""

from __future__ import annotations

import numpy as np

from autotune.control.feedforward import LugreParameters
from autotune.core.arrays import Floats
from autotune.core.drive import Sample
from autotune.models import layout
from autotune.models.drive_model import CREEP, CURVE, DAMPING_VELOCITY, DriveModel, base_model
from autotune.models.inverse import required, required_after


def fed_forward(model: DriveModel) -> DriveModel:
    """The model with those effects only that a feedforward can play."""
    for effect in model.effects:
        if not effect.kind.fed_forward:
            model = model.without_effect(effect.name)
    return model


def left_out(model: DriveModel) -> dict[str, str]:
    """Effects of the model that the feedforward does not play, and why."""
    return {
        effect.name: effect.kind.not_fed_forward for effect in model.effects if not effect.kind.fed_forward
    }


def beyond_lugre(model: DriveModel) -> tuple[str, ...]:
    """Effects, and laws of the base, that this feedforward plays and that of the thesis does not have."""
    laws = tuple(one.name for one in (DAMPING_VELOCITY, CURVE[0], CREEP[0]) if one.name in model.base)
    effects = tuple(e.name for e in model.effects if e.kind.fed_forward and not e.kind.in_lugre)
    return (*laws, *effects)


def lugre_model(parameters: LugreParameters, motion_unit: str = "rad") -> DriveModel:
    """The drive model that LuGre feedforward parameters describe."""
    names = ("inertia", "viscous", "coulomb", "stiffness", "micro_damping", "offset")
    values = {name: float(getattr(parameters, name)) for name in names}
    if parameters.break_away != parameters.coulomb:
        values |= {
            "break_away": parameters.break_away,
            "stribeck_velocity": parameters.stribeck_velocity,
        }
    return base_model(values, None, motion_unit)


class ModelFeedforward:
    """Feedforward law of a drive model; see `control.feedforward.FeedforwardLaw`."""

    settled = False

    def __init__(self, model: DriveModel, period: float) -> None:
        packed = fed_forward(model).pack()
        self._p, self._on = packed.p, packed.on
        self._period = period
        self._state = np.zeros(layout.STATES)
        self._row = np.zeros((4, 1))

    def prepare(self) -> None:
        """Compiles the kernel without changing the state."""
        row = np.zeros((4, 1))
        state = np.zeros(layout.STATES)
        required_after(self._p, self._on, state, 0.0, row[0], row[1], row[2], self._period, 1, row[3])

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        row, half = self._row, 0.5 * self._period
        row[0, 0] = reference + half * velocity
        row[1, 0] = velocity + half * acceleration
        row[2, 0] = acceleration
        before = velocity - half * acceleration  # in the middle of the sample before: the mean is `velocity`
        required_after(
            self._p, self._on, self._state, before, row[0], row[1], row[2], self._period, 1, row[3]
        )
        return float(row[3, 0])


def torque_along(
    model: DriveModel, reference: Floats, velocity: Floats, acceleration: Floats, period: float
) -> Floats:
    """Torque that `ModelFeedforward` plays along a reference, from relaxed junctions; shapes (n,) [N m]."""
    packed = fed_forward(model).pack()
    torque = np.empty(len(reference))
    middle = reference + 0.5 * period * velocity
    # the inverse takes the mean of this velocity and the one before: that of the middles is `velocity`
    between = velocity + 0.5 * period * acceleration
    state = np.zeros(layout.STATES)
    required(packed.p, packed.on, state, middle, between, acceleration, period, 1, torque)
    return torque


def periodic_model_feedforward(model: DriveModel, reference: Floats, period: float) -> Floats:
    """Torque along one period of a periodic reference in its steady cycle; shape (n,)."""
    ahead, behind = np.roll(reference, -1), np.roll(reference, 1)
    velocity = (ahead - behind) / (2.0 * period)
    acceleration = (ahead - 2.0 * reference + behind) / period**2
    place, speed, change = (np.tile(column, 2) for column in (reference, velocity, acceleration))
    return torque_along(model, place, speed, change, period)[len(reference) :]
