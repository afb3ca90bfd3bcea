"""A fitted candidate as a decision sees it, without a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace

from autotune.diagnosis.candidates import FittedCandidate


@dataclass(frozen=True)
class Item:
    """A fit of which only its effects, what it leaves and what it explains count."""

    effect: str
    model_fit: SimpleNamespace
    gain: float = 0.85
    share: float = 0.97
    named: bool = True
    freed: Mapping[str, bool] = field(default_factory=dict)
    with_courses_of = FittedCandidate.with_courses_of
