"""A fitted candidate as a decision sees it, without a fit."""

from dataclasses import dataclass
from types import SimpleNamespace


@dataclass(frozen=True)
class Item:
    """A fit of which only its effects, what it leaves and what it explains count."""

    effect: str
    model_fit: SimpleNamespace
    gain: float = 0.85
    share: float = 0.97
    named: bool = True
