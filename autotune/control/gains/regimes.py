"""The two quasi-linear regimes of an axis (section 4.2.2), from its model.

Sliding (4.68): J·q'' + σ2·q' = u. Sticking, in presliding (4.69): J·q'' + (σ1 + σ2)·q' + σ0·q = u, where σ0 is the
stiffness at rest of all that is elastic: the bristle, the elements of reversal memory, a spring. Where the
transmission is elastic, motor and load are two masses and friction is shared between them; a spring, and elements
beside the contact, are at the motor (`models.inverse`). A drive's torque lag is one state more for each of its stages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.models.backlash import BACKLASH
from autotune.models.drive_model import DriveModel
from autotune.models.elastic_transmission import ELASTIC_TRANSMISSION
from autotune.models.reversal_memory import REMEMBERS, side_of_elements
from autotune.models.spring import SPRING
from autotune.models.torque_lag import STAGES, TORQUE_LAG
from autotune.models.total_friction import (
    damping_at_rest,
    stiffness_at_rest,
    stiffness_of_elements,
    total_friction,
)

Regime = Literal["sticking", "sliding"]
REGIMES: tuple[Regime, ...] = ("sticking", "sliding")
COMPLIANT = ((ELASTIC_TRANSMISSION, "compliance"), (BACKLASH, "contact_compliance"))
"""What makes motor and load two masses, and its parameter that says how soft it is."""


@dataclass(frozen=True, slots=True)
class LinearAxis:
    """What a regime is made of; SI, motor side.

    Attributes:
        inertia, damping, stiffness: J, all damping and all stiffness to the ground.
        coupling, coupling_damping: spring and damper between motor and load; 0 for one mass.
        load_share, load_friction: parts of inertia and of friction beyond the spring.
        lags: time constants of the torque's stages [s].
        near_stiffness, near_damping: of all stiffness and damping to the ground, what is at the motor and not shared.
    """

    inertia: float
    damping: float
    stiffness: float
    coupling: float = 0.0
    coupling_damping: float = 0.0
    load_share: float = 0.0
    load_friction: float = 0.0
    lags: tuple[float, ...] = ()
    near_stiffness: float = 0.0
    near_damping: float = 0.0

    def __post_init__(self) -> None:
        if not self.inertia > 0.0:
            raise ConfigurationError(
                f"the inertia is {self.inertia!r}; it must be above 0. Identify the axis again"
            )

    @property
    def resonance(self) -> float:
        """Of motor against load [Hz]; 0 for one mass."""
        if self.coupling == 0.0:
            return 0.0
        reduced = self.inertia * self.load_share * (1.0 - self.load_share)
        return math.sqrt(self.coupling / reduced) / (2.0 * math.pi)

    def state_space(self) -> tuple[Floats, Floats, Floats]:
        """A (n, n), b (n,), c (n,) from torque to motor position, in continuous time."""
        a, b = self._two_masses() if self.coupling > 0.0 else self._one_mass()
        c = np.zeros(len(b))
        c[0] = 1.0
        for lag in self.lags:
            a, b, c = _lagged(a, b, c, lag)
        return a, b, c

    def _one_mass(self) -> tuple[Floats, Floats]:
        a = np.array([[0.0, 1.0], [-self.stiffness / self.inertia, -self.damping / self.inertia]])
        return a, np.array([0.0, 1.0 / self.inertia])

    def _two_masses(self) -> tuple[Floats, Floats]:
        load = self.inertia * self.load_share
        motor, rub = self.inertia - load, self.load_friction
        k, d = self.coupling, self.coupling_damping
        far_k, far_d = (self.stiffness - self.near_stiffness) * rub, (self.damping - self.near_damping) * rub
        near_k, near_d = self.stiffness - far_k, self.damping - far_d
        a = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-(k + near_k) / motor, -(d + near_d) / motor, k / motor, d / motor],
                [0.0, 0.0, 0.0, 1.0],
                [k / load, d / load, -(k + far_k) / load, -(d + far_d) / load],
            ]
        )
        return a, np.array([0.0, 1.0 / motor, 0.0, 0.0])


def _lagged(a: Floats, b: Floats, c: Floats, lag: float) -> tuple[Floats, Floats, Floats]:
    """The same behind one stage more."""
    n = len(b)
    wide = np.zeros((n + 1, n + 1))
    wide[:n, :n], wide[:n, n], wide[n, n] = a, b, -1.0 / lag
    drive = np.zeros(n + 1)
    drive[n] = 1.0 / lag
    return wide, drive, np.append(c, 0.0)


def linear_axis(model: DriveModel, regime: Regime) -> LinearAxis:
    """The axis in one regime."""
    sticks = regime == "sticking"
    damping = model["viscous"] + (damping_at_rest(model) if sticks else 0.0)
    spring = model[SPRING.surface("stiffness")] if SPRING.name in model else 0.0
    stiffness = spring + (stiffness_at_rest(model) if sticks else 0.0)
    lags = torque_stages(model)
    found = next(((kind, name) for kind, name in COMPLIANT if kind.name in model), None)
    if found is None:
        return LinearAxis(model["inertia"], damping, stiffness, lags=lags)
    kind, compliance = found[0], model[found[0].surface(found[1])]
    share = model[kind.surface("load_inertia")]
    coupling = 1.0 / max(compliance, 1e-12)
    reduced = model["inertia"] * share * (1.0 - share)
    near, its_damping = _beside_the_contact(model) if sticks else (0.0, 0.0)
    return LinearAxis(
        model["inertia"],
        damping,
        stiffness,
        coupling,
        2.0 * model[kind.surface("damping")] * math.sqrt(coupling * reduced),
        share,
        model[kind.surface("load_friction")],
        lags,
        spring + near,
        its_damping,
    )


def _beside_the_contact(model: DriveModel) -> tuple[float, float]:
    """Stiffness and damping at rest of elements that are no part of the contact, and so at the motor alone."""
    packed = model.pack()
    if not packed.on[REMEMBERS] or side_of_elements(packed.p, 1.0)[1] > 0.0:
        return 0.0, 0.0
    return stiffness_of_elements(model), damping_at_rest(model) - model["micro_damping"]


def torque_stages(model: DriveModel) -> tuple[float, ...]:
    """Time constants of the stages that the torque goes through [s], those that are not 0."""
    if TORQUE_LAG.name not in model:
        return ()
    whole = model[TORQUE_LAG.surface("time_constant")]
    further = whole * steepness_of(model)
    return tuple(one for one in (whole - further, *STAGES * (further / STAGES,)) if one > 0.0)


def steepness_of(model: DriveModel) -> float:
    """Share of the torque's lag in further stages; 0 where the model does not say it."""
    found = model.parameters.get(TORQUE_LAG.surface("steepness"))
    return found.value if found is not None else 0.0


def characteristic_space(model: DriveModel) -> float:
    """x_s = F/σ0, the way of a small step (section 4.2.1) [rad or m]; 0 without friction."""
    stiffness = stiffness_at_rest(model)
    return total_friction(model).value / stiffness if stiffness > 0.0 else 0.0
