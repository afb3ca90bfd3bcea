"""The controller of an axis in one form, whatever structure its drive has, and the loop round it.

    u = kp·(b·r − y) + kd·d + ki·Σe·h,   d ← d + α·((w·Δr − Δy)/h − d)

PID (4.67): b = w = 1. Cascaded P-PI, u = kv·(kx·e − v) + kiv·Σ(kx·e − v)·h, is kp = kv·kx + kiv, kd = kv,
ki = kiv·kx, b = kv·kx/kp, w = 0 (the sum of v·h is y less a constant). PI velocity control (4.2) is the same as
proportional and derivative control of the position whose reference is the sum of the velocity's: ki = 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.recordings.recording import Controller

Structure = Literal["pid", "p_pi", "pi_velocity"]
STRUCTURES: Mapping[Structure, str] = {
    "pid": "PID position control",
    "p_pi": "proportional position control round a PI velocity loop",
    "pi_velocity": "PI velocity control",
}


@dataclass(frozen=True, slots=True)
class Notch:
    """A notch at `frequency` [Hz] on the torque demand: (s² + 2·depth·width·ω·s + ω²)/(s² + 2·width·ω·s + ω²)."""

    frequency: float
    width: float = 0.5
    depth: float = 0.1

    def coefficients(self, period: float) -> Floats:
        """b0, b1, b2, a1, a2 of the bilinear form, exact at its own frequency; shape (5,)."""
        rate = 2.0 * math.pi * self.frequency
        if not 0.0 < rate * period < 0.95 * math.pi:
            raise ConfigurationError(
                f"a notch at {self.frequency:.4g} Hz is beyond what a cycle of {period:g} s can hold; "
                f"below {0.475 / period:.4g} Hz it can"
            )
        tangent = math.tan(0.5 * rate * period)
        narrow, wide = 2.0 * self.depth * self.width * tangent, 2.0 * self.width * tangent
        scale = 1.0 + wide + tangent**2
        middle = 2.0 * (tangent**2 - 1.0) / scale
        return np.array(
            [
                (1.0 + narrow + tangent**2) / scale,
                middle,
                (1.0 - narrow + tangent**2) / scale,
                middle,
                (1.0 - wide + tangent**2) / scale,
            ]
        )


@dataclass(frozen=True, slots=True)
class Gains:
    """A controller in the form above; SI, motor side.

    Attributes:
        proportional_weight, derivative_weight: b and w, the parts of the reference in both terms.
        structure: how the drive names them (`named`).
    """

    kp: float
    kd: float
    ki: float = 0.0
    derivative_filter: float = 1.0
    proportional_weight: float = 1.0
    derivative_weight: float = 1.0
    structure: Structure = "pid"
    notch: Notch | None = None

    def __post_init__(self) -> None:
        numbers = (self.kp, self.kd, self.ki, self.derivative_filter)
        if not all(math.isfinite(number) and number >= 0.0 for number in numbers):
            raise ConfigurationError(
                f"gains must be finite and not below 0; found kp {self.kp!r}, kd {self.kd!r}, ki {self.ki!r}, "
                f"derivative filter {self.derivative_filter!r}. Read them from the drive again"
            )
        if not 0.0 < self.derivative_filter <= 1.0:
            raise ConfigurationError(
                f"the derivative filter is {self.derivative_filter!r}; it must be above 0 and at most 1 (no filter)"
            )

    def array(self, period: float) -> Floats:
        """As the kernel takes them: kp, kd, ki, α, b, w and the notch's five coefficients; shape (11,)."""
        notch = self.notch.coefficients(period) if self.notch else np.array([1.0, 0.0, 0.0, 0.0, 0.0])
        own = (
            self.kp,
            self.kd,
            self.ki,
            self.derivative_filter,
            self.proportional_weight,
            self.derivative_weight,
        )
        return np.concatenate([own, notch])

    def named(self) -> dict[str, float]:
        """The gains as a drive of this structure has them, with the filter and the notch where there is one."""
        if self.structure == "p_pi":
            own = cascade_of(self)
        elif self.structure == "pi_velocity":
            own = {"velocity_gain": self.kd, "integral_gain": self.kp}
        else:
            own = {"kp": self.kp, "kd": self.kd, "ki": self.ki}
        own["derivative_filter"] = self.derivative_filter
        if self.notch is not None:
            own["notch_frequency"] = self.notch.frequency
        return own

    def as_controller(self) -> Controller:
        """As recordings name it; only PID is held there whole."""
        return Controller(self.kp, self.kd, self.ki, self.derivative_filter)

    def scaled(self, kp: float, kd: float, ki: float) -> Gains:
        """Other gains in the same structure; the weight of a cascade follows."""
        if self.structure == "p_pi":
            return cascaded_from(kp, kd, ki, self.derivative_filter, self.notch)
        if self.structure == "pi_velocity":
            return replace(self, kp=kp, kd=kd, ki=0.0)
        return replace(self, kp=kp, kd=kd, ki=ki)


_NEEDED: Mapping[Structure, tuple[str, ...]] = {
    "pid": ("kp", "kd", "ki"),
    "p_pi": ("position_gain", "velocity_gain", "integral_gain"),
    "pi_velocity": ("velocity_gain", "integral_gain"),
}


def parse_gains(text: str) -> Gains:
    """Reads `pid kp=60 kd=0.15 ki=6000`, `p_pi position_gain=…` or `pi_velocity velocity_gain=…`, as `named` has them.

    Raises:
        ConfigurationError: another structure, a gain that is missing, unknown, no number or below 0.
    """
    kind, *pairs = text.split() or [""]
    structure = next((one for one in STRUCTURES if one == kind), None)
    needed = _NEEDED[structure] if structure else ()
    values = dict(pair.partition("=")[::2] for pair in pairs)
    if structure is None or not set(needed) <= set(values) <= {*needed, "derivative_filter"}:
        forms = "; ".join(
            f"'{one} {' '.join(f'{name}=…' for name in names)}'" for one, names in _NEEDED.items()
        )
        raise ConfigurationError(
            f"the controller {text!r} is not understood; write {forms}, each with derivative_filter=… where it has one"
        )
    try:
        numbers = {name: float(value) for name, value in values.items()}
    except ValueError as error:
        raise ConfigurationError(f"the controller {text!r}: {error}; every gain must be a number") from error
    smooth = numbers.pop("derivative_filter", 1.0)
    if structure == "pid":
        return Gains(numbers["kp"], numbers["kd"], numbers["ki"], smooth)
    if structure == "p_pi":
        return cascade(numbers["position_gain"], numbers["velocity_gain"], numbers["integral_gain"], smooth)
    return Gains(numbers["integral_gain"], numbers["velocity_gain"], 0.0, smooth, structure="pi_velocity")


def of_controller(controller: Controller) -> Gains:
    """The gains of a drive with PID control."""
    return Gains(controller.kp, controller.kd, controller.ki, controller.derivative_filter)


def cascade(kx: float, kv: float, kiv: float, derivative_filter: float = 1.0) -> Gains:
    """Cascaded P-PI: position gain kx [1/s], velocity gain kv [N m s/rad], its integral gain kiv [N m/rad]."""
    kp = kv * kx + kiv
    weight = kv * kx / kp if kp > 0.0 else 1.0
    return Gains(kp, kv, kiv * kx, derivative_filter, weight, 0.0, "p_pi")


def cascaded_from(
    kp: float, kd: float, ki: float, derivative_filter: float = 1.0, notch: Notch | None = None
) -> Gains:
    """The cascade whose loop is that of a PID controller: kx solves kv·kx² − kp·kx + ki = 0.

    A PID controller whose zeros are complex has no cascade: then the integral is as large as the cascade allows.
    """
    ki = min(ki, 0.25 * kp * kp / kd) if kd > 0.0 else 0.0
    root = math.sqrt(max(kp * kp - 4.0 * kd * ki, 0.0))
    kx = (kp + root) / (2.0 * kd) if kd > 0.0 else 0.0
    kiv = ki / kx if kx > 0.0 else 0.0
    # the slower zero belongs to the integral of the velocity loop
    return replace(cascade(kx, kd, kiv, derivative_filter), notch=notch)


def cascade_of(gains: Gains) -> dict[str, float]:
    """Position gain, velocity gain and its integral gain of a cascade."""
    kx = gains.kp * gains.proportional_weight / gains.kd if gains.kd > 0.0 else 0.0
    return {
        "position_gain": kx,
        "velocity_gain": gains.kd,
        "integral_gain": gains.kp * (1.0 - gains.proportional_weight),
    }


@dataclass(frozen=True, slots=True)
class LoopTiming:
    """What stands between controller and axis.

    Attributes:
        period: of the loop [s].
        dead_time: from the sample to the torque, beside the hold [s].
        dead_time_error: standard error of it [s].
        resolution: of the position sensor [rad or m].
        torque_limit: of the drive [N m or N].
        reference_filter: α of (6.14), 0 for none.
        disturbance: torque that shakes the axis, standard deviation of white noise from sample to sample [N m or N];
            0 where it is not known.
        shared_damping: whether the damping of presliding acts in all elements of reversal memory, each while it sticks,
            or in the bristle alone, where the model does not say what that of the elements is.
    """

    period: float
    resolution: float
    torque_limit: float
    dead_time: float = 0.0
    dead_time_error: float = 0.0
    reference_filter: float = 0.0
    disturbance: float = 0.0
    shared_damping: bool = True
