"""What an experiment tells: numbers with intervals, whether they may be used, and why not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from autotune.models.effect import Value

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Quantity:
    """One estimated number.

    Attributes:
        value, standard_error: in the unit of the parameter.
        quantile: how many standard errors the 95 % interval reaches to each side.
        identified: False where the data say next to nothing about it; never use the value then.
        note: in words, where there is something to say (a bound was hit, why it is not identified).
    """

    value: float
    standard_error: float
    quantile: float = 1.96
    identified: bool = True
    note: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval."""
        reach = self.quantile * self.standard_error
        return self.value - reach, self.value + reach

    @property
    def relative_error(self) -> float:
        """Standard error over the value's magnitude; infinite where the value is zero."""
        return self.standard_error / abs(self.value) if self.value else math.inf

    def as_value(self) -> Value:
        return Value(self.value, self.standard_error if math.isfinite(self.standard_error) else None)


@dataclass(frozen=True, slots=True)
class Estimate:
    """The result of one experiment or of a fit.

    Attributes:
        source: name of the experiment or method.
        parameters: by surface name; empty where nothing could be estimated.
        valid: whether the numbers may be used.
        reason: why not, or what limits them; a sentence.
        relative_error: norm of the error over the norm of what was predicted; nan where not computed.
        notes: further sentences for the report.
    """

    source: str
    parameters: Mapping[str, Quantity] = field(default_factory=lambda: MappingProxyType({}))
    valid: bool = True
    reason: str = ""
    relative_error: float = math.nan
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Quantity:
        return self.parameters[name]

    def __contains__(self, name: str) -> bool:
        return name in self.parameters and self.parameters[name].identified

    def value(self, name: str, otherwise: float = math.nan) -> float:
        """The value where the estimate is valid and the parameter identified."""
        return self.parameters[name].value if self.valid and name in self else otherwise


def invalid(source: str, reason: str) -> Estimate:
    """An estimate that says why there is none."""
    return Estimate(source, valid=False, reason=reason)
