"""What a drive can hold of a feedforward: a LuGre model reduced to less, and what that loses.

A drive that knows no presliding holds the kinetic model, or part of it,

    u = J r̈ + b ṙ + F_c sign ṙ + F_g,

or a table of torque over velocity (`velocity_table`). Inertia and viscous friction are what they are: bent to
imitate presliding on one motion they would do harm on a faster one. The Coulomb torque is free, and of a table the
share of friction and the first point. They are chosen so that the squared tracking error over the user's motion is
least, as predicted by the closed loop with the full model as its axis (`closed_loop`). The torque's own least squares,
F_c nearly as it is, give a jump at every reversal that the axis cannot follow elastically: worse than no feedforward
on stiff loops.

A drive with a LuGre block of its own holds all parameters, yet not every friction: such blocks know a level
that falls from F_s to F_c. Friction that rises from rest (F_s < F_c, section 2.2.2 and Table 6.2) is played by
them as F_c at every speed. What is written then is one level between the two, by the same least error.

The loss is the predicted error with the reduced feedforward less that with the full one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from autotune.control.closed_loop import steady_error
from autotune.control.feedforward import FeedforwardLaw, LugreParameters, advance
from autotune.control.refinement import PeriodAverage, periodic_feedforward
from autotune.control.velocity_table import Points, TableBlock
from autotune.core.arrays import Floats
from autotune.core.documents import numbers_of
from autotune.core.drive import Sample
from autotune.core.errors import ConfigurationError
from autotune.recordings.recording import Controller

LUGRE = frozenset({"inertia", "viscous", "coulomb", "break_away", "stiffness", "micro_damping", "offset"})
KINETIC = ("inertia", "viscous", "coulomb", "offset")
RISING = "friction_that_rises_from_rest"
MEASURES = ("full_peak", "full_rms", "predicted_peak", "predicted_rms", "residual_rms")
SEARCH_POINTS = 13
KNEES = (0.005, 0.6)
"""Of the user's top speed: where the first point of a table over velocity may be."""
SMALL = 0.02  # part of the feedforward's rms below which nothing has to be played for it


@dataclass(frozen=True, slots=True)
class Reduction:
    """A feedforward reduced to what a drive holds, and what it costs.

    Attributes:
        values: of the parameters in the drive, by name without prefix; SI.
        host: parts that the drive cannot hold and the host has to play; empty where the drive does without.
        full_peak, full_rms: measured error with the full feedforward [motion unit].
        predicted_peak, predicted_rms: error with the drive's part (and the host's, where there is one).
        residual_rms: what the drive's part leaves of the full feedforward [N m].
        lost: effects beyond what a drive's block knows: lost where the host does not play.
        note: why a table of the drive's is not used; "" where it is, or there is none.
    """

    values: Mapping[str, float]
    host: tuple[str, ...]
    full_peak: float
    full_rms: float
    predicted_peak: float
    predicted_rms: float
    residual_rms: float
    lost: tuple[str, ...] = ()
    note: str = ""

    @property
    def predicted_loss(self) -> float:
        """Of the peak error [motion unit]."""
        return self.predicted_peak - self.full_peak

    def as_json(self) -> dict[str, Any]:
        """Plain data, by the names of the attributes."""
        return {name: _plain(getattr(self, name)) for name in self.__dataclass_fields__}

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> Reduction:
        """Back from `as_json`.

        Raises:
            KeyError, TypeError, ValueError: something is missing, or no finite number.
        """
        numbers = numbers_of({name: content[name] for name in MEASURES})
        values = MappingProxyType(numbers_of(content["values"]))
        host, lost = (tuple(str(part) for part in content[name]) for name in ("host", "lost"))
        note = str(content.get("note", ""))
        return Reduction(values=values, host=host, lost=lost, note=note, **numbers)


def _plain(
    value: Mapping[str, float] | tuple[str, ...] | str | float,
) -> dict[str, float] | list[str] | str | float:
    if isinstance(value, Mapping):
        return dict(value)
    return list(value) if isinstance(value, tuple) else value


def rises(full: LugreParameters) -> bool:
    """F_s < F_c: friction that a drive's LuGre block does not know."""
    return full.break_away < full.coulomb


def level_for_block(
    full: LugreParameters, measured: PeriodAverage, controller: Controller, limit: float = np.inf
) -> Reduction:
    """The one friction level that serves a drive's LuGre block where friction rises from rest; see `reduce`."""
    predict = _Prediction(full, measured, controller, limit)

    def error(level: float) -> Floats:
        torque = periodic_feedforward(with_one_level(full, level), measured.reference, measured.period)
        return predict.error(torque)

    low, high = sorted((full.break_away, full.coulomb))
    found = scipy.optimize.minimize_scalar(
        lambda level: _rms(error(float(level))),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-3 * full.coulomb},
    )
    flat = with_one_level(full, float(found.x))
    part = periodic_feedforward(flat, measured.reference, measured.period)
    left = error(float(found.x))
    return Reduction(
        MappingProxyType({name: float(getattr(flat, name)) for name in sorted(LUGRE)}),
        (),
        measured.peak_error,
        _rms(measured.error),
        float(np.max(np.abs(left))),
        _rms(left),
        _rms(predict.applied - part),
        (RISING,),
    )


def with_one_level(full: LugreParameters, level: float | None = None) -> LugreParameters:
    """The same with F_s = F_c = `level`, by default F_c: what a drive's block plays where friction rises."""
    level = full.coulomb if level is None else level
    return replace(full, coulomb=level, break_away=level)


def reduces(held: Collection[str]) -> bool:
    """True where a drive that holds these parameters cannot run the full LuGre feedforward."""
    return not set(held) >= LUGRE


def reduce(
    full: LugreParameters,
    held: Collection[str],
    measured: PeriodAverage,
    controller: Controller,
    limit: float = np.inf,
    table: TableBlock | None = None,
    top: float = np.inf,
) -> Reduction:
    """Reduces the proved parameters to what a drive holds.

    Args:
        full: proved parameters; also the model that the loss is predicted with.
        held: names that the drive can hold.
        measured: the user's motion with the full feedforward in force.
        controller: of the drive.
        limit: of the torque [N m].
        table: over velocity, where the drive has one; then friction goes in there.
        top: fastest motion of the axis, to which the table reaches.

    Raises:
        ConfigurationError: the drive holds no part of a feedforward.
    """
    names = sorted(
        (set(held) & LUGRE) - ({"break_away", "micro_damping"} if "stiffness" not in held else set())
    )
    note = table.refuses(full, top) if table is not None else ""
    table = None if note else table
    if not names and table is None:
        raise ConfigurationError(
            f"the drive holds no part of a feedforward{': ' if note else ''}{note}; the host has to play all of it"
        )
    predict = _Prediction(full, measured, controller, limit)
    values = {name: float(getattr(full, name)) for name in names}
    lost = (RISING,) if rises(full) and "break_away" in values else ()
    if lost:
        values["break_away"] = full.coulomb
    friction = ("coulomb", "viscous") if table is not None else ()
    host = _left_to_the_host(full, {*names, *friction}, measured, controller)
    if table is not None:
        values |= _best_table(values, full, table, top, predict)
    elif "stiffness" not in names and "coulomb" in names and not host:
        values["coulomb"] = _least_error(values, full, predict)
    part = drive_torque(values, measured.reference, measured.period)
    wanted = predict.applied
    error = measured.error if host else predict.error(part)
    return Reduction(
        MappingProxyType(values),
        host,
        measured.peak_error,
        _rms(measured.error),
        float(np.max(np.abs(error))),
        _rms(error),
        _rms(wanted - part),
        lost,
        note,
    )


class _Prediction:
    """The measured error, changed by what the closed loop says of another feedforward."""

    def __init__(
        self, full: LugreParameters, measured: PeriodAverage, controller: Controller, limit: float
    ) -> None:
        self.applied = periodic_feedforward(full, measured.reference, measured.period)
        self._full, self.measured, self._controller, self._limit = full, measured, controller, limit
        self._base = self._simulated(self.applied)

    def error(self, torque: Floats) -> Floats:
        return self.measured.error + self._simulated(torque) - self._base

    def _simulated(self, torque: Floats) -> Floats:
        m = self.measured
        return steady_error(self._full, self._controller, m.reference, torque, m.period, self._limit)


def _least_error(values: Mapping[str, float], full: LugreParameters, predict: _Prediction) -> float:
    """The Coulomb torque between 0 and the full one with the least squared error."""
    m = predict.measured

    def squares(coulomb: float) -> float:
        torque = drive_torque({**values, "coulomb": coulomb}, m.reference, m.period)
        return _rms(predict.error(torque))

    grid = np.linspace(0.0, full.coulomb, SEARCH_POINTS)
    best = int(np.argmin([squares(float(value)) for value in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = scipy.optimize.minimize_scalar(
        squares, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * full.coulomb}
    )
    return float(found.x) if found.fun < squares(float(grid[best])) else float(grid[best])


def _best_table(
    values: Mapping[str, float], full: LugreParameters, table: TableBlock, top: float, predict: _Prediction
) -> dict[str, float]:
    """The points with the least squared error: knee over two decades, share of friction from 0 to 1."""
    m = predict.measured
    fastest = float(np.max(np.abs(motion_columns(m.reference, m.period)["viscous"])))
    top = max(min(top, table.largest_velocity), fastest)

    def points(knee: float, share: float) -> dict[str, float]:
        return table.filled(full, fastest * knee, share, top)

    def squares(knee: float, share: float) -> float:
        torque = drive_torque({**values, **points(knee, share)}, m.reference, m.period)
        return _rms(predict.error(torque))

    grid = [(float(k), float(s)) for k in np.geomspace(*KNEES, 7) for s in np.linspace(0.25, 1.0, 4)]
    knee, share = min(grid, key=lambda pair: squares(*pair))
    share = _bounded(lambda s: squares(knee, s), max(share - 0.25, 0.0), min(share + 0.25, 1.0))
    nearest = _bounded(lambda k: squares(k, share), max(knee / 2.2, KNEES[0]), min(knee * 2.2, KNEES[1]))
    knee = min(knee, nearest, key=lambda k: squares(k, share))
    return points(knee, share)


def _bounded(function: Callable[[float], float], low: float, high: float) -> float:
    found = scipy.optimize.minimize_scalar(
        function, bounds=(low, high), method="bounded", options={"xatol": 0.02 * (high - low)}
    )
    return float(found.x)


def _left_to_the_host(
    full: LugreParameters, names: Collection[str], measured: PeriodAverage, controller: Controller
) -> tuple[str, ...]:
    """What is missing in the drive and is felt on the user's motion.

    A drive that holds the Coulomb torque does without presliding; one that does not needs the host for
    friction, and the host then plays presliding as well. A constant is the integrator's, where there is one.
    """
    columns = motion_columns(measured.reference, measured.period)
    size = _rms(periodic_feedforward(full, measured.reference, measured.period))
    missing = [
        name
        for name in KINETIC
        if name not in names
        and not (name == "offset" and controller.ki > 0.0)
        and _rms(getattr(full, name) * columns[name]) > SMALL * size
    ]
    return tuple(missing)


def motion_columns(reference: Floats, period: float) -> dict[str, Floats]:
    """Torque of each kinetic parameter at 1, along one period of a periodic reference; shape (n,) each."""
    ahead, behind = np.roll(reference, -1), np.roll(reference, 1)
    velocity = (ahead - behind) / (2.0 * period)
    return {
        "inertia": (ahead - 2.0 * reference + behind) / period**2,
        "viscous": velocity,
        "coulomb": direction(velocity),
        "offset": np.ones(len(reference)),
    }


def direction(velocity: Floats) -> Floats:
    """Sign of the velocity; while it is 0, of the motion before, as in a drive. Periodic, shape (n,)."""
    sign = np.asarray(np.sign(velocity))
    moving = np.flatnonzero(sign)
    if not len(moving):
        return sign
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), -1))
    return np.asarray(sign[np.where(last >= 0, last, moving[-1])])


def drive_torque(values: Mapping[str, float], reference: Floats, period: float) -> Floats:
    """What a drive with these parameters plays along one period of a periodic reference; shape (n,) [N m]."""
    if "stiffness" in values:
        return periodic_feedforward(_elastic(values), reference, period)
    columns = motion_columns(reference, period)
    points = Points.among(values)
    torque = np.zeros(len(reference)) if points is None else points.at(columns["viscous"])
    for name in KINETIC:
        torque += values.get(name, 0.0) * columns[name]
    return torque


def _elastic(values: Mapping[str, float]) -> LugreParameters:
    """A drive with a spring rate of friction, but not all of the LuGre model."""
    coulomb = max(values.get("coulomb", 0.0), 1e-9)
    whole = {"inertia": 0.0, "viscous": 0.0, "micro_damping": 0.0, "offset": 0.0, "break_away": coulomb}
    return LugreParameters(**(whole | dict(values) | {"coulomb": coulomb}))


class DrivePart:
    """Law that plays what a drive with these parameters plays by itself."""

    settled = False

    def __init__(self, values: Mapping[str, float], period: float) -> None:
        self._period = period
        self._elastic = "stiffness" in values
        self._points = Points.among(values)
        own = dict(values) if self._elastic else {"stiffness": 1.0, "coulomb": 1.0}
        self._own = _elastic(own).array()
        self._kinetic = tuple(values.get(name, 0.0) for name in KINETIC)
        self._state = np.zeros(2)
        self._sign = 0.0

    def prepare(self) -> None:
        """Compiles the kernels without changing the state."""
        advance(self._own, np.zeros(2), 0.0, 0.0, self._period)

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        if self._elastic:
            return float(advance(self._own, self._state, velocity, acceleration, self._period))
        self._sign = self._sign if velocity == 0.0 else float(np.sign(velocity))
        inertia, viscous, coulomb, offset = self._kinetic
        table = float(self._points.at(velocity)) if self._points is not None else 0.0
        return inertia * acceleration + viscous * velocity + coulomb * self._sign + offset + table


class Remainder:
    """Law for the host: the full feedforward less what the drive plays by itself."""

    settled = False

    def __init__(self, full: FeedforwardLaw, values: Mapping[str, float], period: float) -> None:
        self._full, self._part = full, DrivePart(values, period)

    def prepare(self) -> None:
        """Compiles the kernels without changing the state."""
        self._full.prepare()
        self._part.prepare()

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        whole = self._full.step(reference, velocity, acceleration, previous)
        return whole - self._part.step(reference, velocity, acceleration, previous)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
