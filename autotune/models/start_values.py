"""Where a fit of an effect begins: values, which of them are free, and what an effect may look at to find them.

A missing effect distorts the base fit, and some laws have several minima; an effect may have several starts, and
what counts is the best of their refits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

from autotune.core.arrays import Floats, Integers

FAR, NEAR = 10.0, 2.0
"""Times what is left: from the first no linear model leads back; at the second an effect begins then."""


def at_first(usual: float, left: float) -> float:
    """How large an effect begins: as usual, unless that drowns what is left; both in one unit."""
    return usual if usual <= FAR * left else NEAR * left


@dataclass(frozen=True, slots=True)
class Vary:
    """How a free parameter varies: its typical size, its longest step, and bounds inside the physical ones."""

    scale: float
    step: float = math.inf
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True, slots=True)
class StartValues:
    """Where a fit begins: the effect's parameters (else neutral), the free ones, and base values by their place."""

    values: Mapping[str, float]
    free: Mapping[str, Vary]
    base: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))


class ResidualRows(Protocol):
    """A part of the fitted rows, to look for places in, with what the fitted parameters explain taken out."""

    @property
    def rows(self) -> Integers: ...

    def share(self, columns: Floats) -> float:
        """Share of the residual that columns of shape (t, k) explain."""
        ...


class StartContext(Protocol):
    """What a start may look at: the fit without the effect, and the motion."""

    @property
    def p(self) -> Floats:
        """The vector of parameters, fitted without the effect."""
        ...

    @property
    def coulomb(self) -> float:
        """Level of dry friction, never next to nothing [N m]."""
        ...

    @property
    def left(self) -> float:
        """Rms of what the fit without the effect leaves [N m].

        An effect that begins far larger than that begins in a place from which no linear model leads back.
        """
        ...

    @property
    def reach(self) -> float:
        """Travel over which the bristle bends [motion unit]."""
        ...

    @property
    def angle(self) -> float:
        """Radians per motion unit and cycle: 1 on rotary axes, 2π on linear ones."""
        ...

    @property
    def torque(self) -> float:
        """Typical torque [N m]."""
        ...

    @property
    def speed(self) -> float:
        """Typical high speed [rad/s]."""
        ...

    @property
    def travel(self) -> float:
        """[motion unit]"""
        ...

    @property
    def mean_speed(self) -> float:
        """Mean of the speed's absolute value [rad/s]."""
        ...

    @property
    def largest_torque(self) -> float:
        """Largest torque recorded, the drive's limit where that is lower [N m]."""
        ...

    @property
    def high_torque(self) -> float:
        """Torque that a twentieth of the rows exceed, no more than the largest [N m]."""
        ...

    @property
    def resolution(self) -> float:
        """One count of the encoder [motion unit]."""
        ...

    @property
    def period(self) -> float:
        """Of the samples that are fitted [s]."""
        ...

    @property
    def cutoff(self) -> float:
        """Frequency below which torques are compared [Hz]."""
        ...

    @property
    def constant_speeds(self) -> bool:
        """Whether the data are mean torques at constant speeds."""
        ...

    def position(self) -> Floats:
        """Of the fitted rows, shape (m,) [motion unit]."""
        ...

    def sensitivity(self, name: str) -> Floats:
        """d(residual)/d(parameter) on the fitted rows, shape (m,)."""
        ...

    def thinned(self) -> ResidualRows:
        """A part of the rows that are fitted."""
        ...

    def orders_in_residual(self, most: int) -> list[float]:
        """Orders of position that stand out of the residual, strongest first, those in the model left out."""
        ...


def stiffer(_: StartContext) -> StartValues:
    """A contact that is stiffer in proportion to what an effect adds to its friction (`effect.part_that_stiffens`)."""
    return StartValues({"stiffens": 1.0}, {})
