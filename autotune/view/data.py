"""What the figures are drawn from: plain arrays, so that no figure depends on who made the numbers.

SI and motor side, as everywhere; the figures choose readable multiples (mrad, µm, mN m) themselves.
`motion_unit` is `rad` or `m`; torque is in N m or N accordingly. Arrays are one-dimensional unless
said otherwise, and all that belong together have one length.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from autotune.core.arrays import Floats
from autotune.core.units import torque_symbol


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Torque at constant velocity, section 3.4.2 (figure 6.11).

    Attributes:
        velocity, torque: measured points, shape (n,).
        torque_error: half width of the error bars (95 %), shape (n,); None without repeats.
        model_velocity, model_torque: the fitted characteristic, shape (m,); both branches in one
            array, the break at zero velocity is found by the sign.
    """

    velocity: Floats
    torque: Floats
    torque_error: Floats | None
    model_velocity: Floats
    model_torque: Floats
    motion_unit: str = "rad"
    torque_unit: str = ""


@dataclass(frozen=True, slots=True)
class Presliding:
    """Response inside presliding, section 3.4.3 (figure 6.12).

    Attributes:
        time, torque, position, model_position: one stretch of the experiment, shape (n,).
        estimates: stiffness at rest [N m/rad] of each data set by method, in the order shown.
        adopted: stiffness at rest that was taken, with its standard error; None where none was.
    """

    time: Floats
    torque: Floats
    position: Floats
    model_position: Floats
    estimates: Mapping[str, Sequence[float]] = field(default_factory=dict)
    adopted: tuple[float, float] | None = None
    motion_unit: str = "rad"


@dataclass(frozen=True, slots=True)
class DahlCurve:
    """Torque over position through slow reversals, section 3.4.4 (figure 6.13).

    Attributes:
        position, torque, model_torque: in the order of time, shape (n,).
        coulomb, offset: Coulomb torque and offset of the model, drawn as guide lines; None if unknown.
    """

    position: Floats
    torque: Floats
    model_torque: Floats
    coulomb: float | None = None
    offset: float = 0.0
    motion_unit: str = "rad"


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """The proof on the benchmark, section 6.3.6 (figure 6.17).

    Attributes:
        time: one period of the benchmark, from 0 [s], shape (n,).
        reference: over that period, shape (n,).
        before, after: period-averaged tracking error of each repeat, shape (repeats, n).
        resolution: one count of the position sensor; None if unknown.
        committed: as `before`, with what is in the drive now; None where nothing is.
    """

    time: Floats
    reference: Floats
    before: Floats
    after: Floats
    resolution: float | None = None
    motion_unit: str = "rad"
    before_name: str = "before"
    after_name: str = "after"
    committed: Floats | None = None
    committed_name: str = "the drive by itself"


@dataclass(frozen=True, slots=True)
class Simulated:
    """One period of a motion as it was measured, and as a model does it in the same loop.

    Attributes:
        time: from 0 [s], shape (n,); the motion is periodic.
        reference: shape (n,).
        error, torque: measured, each repeat, shape (repeats, n); `error` is reference less position.
        model_error, model_torque: simulated, shape (n,).
    """

    time: Floats
    reference: Floats
    error: Floats
    torque: Floats
    model_error: Floats
    model_torque: Floats
    motion_unit: str = "rad"
    torque_unit: str = ""


@dataclass(frozen=True, slots=True)
class Trace:
    """A parameter while it converges.

    Attributes:
        time: s, shape (n,).
        value: shape (n,), in `unit`.
        lower, upper: bounds that the adaptation was held to; None without.
        refined: value of the refinement, drawn to the right end; None without.
        error: standard error of the refined value; None if unknown.
    """

    name: str
    unit: str
    time: Floats
    value: Floats
    lower: float | None = None
    upper: float | None = None
    refined: float | None = None
    error: float | None = None


@dataclass(frozen=True, slots=True)
class Comparison:
    """Measured and modelled over time.

    Attributes:
        time, measured, modelled: shape (n,), torque [N m or N] unless `unit` says otherwise.
        noise_floor: estimated rms of what no model can explain; None without repeats.
        left_out: stretches of time [s] that were not compared.
    """

    time: Floats
    measured: Floats
    modelled: Floats
    unit: str = "N m"
    quantity: str = "torque"
    noise_floor: float | None = None
    left_out: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Residual:
    """Torque residual over the coordinate where it lives.

    Attributes:
        coordinate: its name, such as `position` or `time since reversal`.
        unit: of the coordinate.
        values, residual: shape (n,); residual is measured less modelled [`residual_unit`].
        noise_floor: estimated rms of what no model can explain; None without repeats.
        share: part of the residual's variance that the coordinate explains, 0…1; None if unknown.
        direction: of the motion, positive or negative, shape (n,): each is shown by itself; None if unknown.
    """

    coordinate: str
    unit: str
    values: Floats
    residual: Floats
    noise_floor: float | None = None
    share: float | None = None
    residual_unit: str = "N m"
    direction: Floats | None = None


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the model's history: what was added, and the error on unseen data after it."""

    name: str
    error: float


@dataclass(frozen=True, slots=True)
class Rank:
    """One candidate of a diagnosis: how far the error on unseen data falls with it.

    Attributes:
        gain: relative fall of the error, may be negative.
        accepted: whether the gates let it pass.
        why: one short sentence.
    """

    name: str
    gain: float
    accepted: bool
    why: str = ""


@dataclass(frozen=True, slots=True)
class History:
    """One number of an axis over its life, as the daily check sees it.

    Attributes:
        when: POSIX seconds, shape (n,).
        value: shape (n,), in `unit`.
        error: standard errors, shape (n,); None if unknown.
        warning: band (low, high) that the value should stay in; None without.
        events: (when, text), such as a re-tune.
    """

    name: str
    unit: str
    when: Floats
    value: Floats
    error: Floats | None = None
    warning: tuple[float, float] | None = None
    events: Sequence[tuple[float, str]] = ()


def torque_unit(motion_unit: str, torque: str = "") -> str:
    """N m for axes that turn, N for axes that slide; `torque` where it is in another unit."""
    return torque_symbol(motion_unit, torque)
