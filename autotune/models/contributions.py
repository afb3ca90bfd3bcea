"""What all effects contribute to one quantity of the contact, as one compiled kernel.

Each effect names its kernels in its `Kind`; here those for one quantity become a chain, in the order of the table.
Compiled into the routine that calls it, the chain is as fast as if it were written out there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from autotune.models.compiled import built_in
from autotune.models.layout import flag
from autotune.models.table import EFFECTS

Chain: TypeAlias = Callable[..., float]
"""(value, p, on, …) → the value with what every effect that is present does to it."""


@built_in
def _unchanged(value: float, p: Any, on: Any, *rest: Any) -> float:
    return value


def _adding(chain: Chain, at: int, kernel: Callable[..., float]) -> Chain:
    @built_in
    def both(value: float, p: Any, on: Any, *rest: Any) -> float:
        value = chain(value, p, on, *rest)
        if on[at]:
            value += kernel(p, *rest)
        return value

    return both


def _multiplying(chain: Chain, at: int, kernel: Callable[..., float]) -> Chain:
    @built_in
    def both(value: float, p: Any, on: Any, *rest: Any) -> float:
        value = chain(value, p, on, *rest)
        if on[at]:
            value *= kernel(p, *rest)
        return value

    return both


def all_added(quantity: str) -> Chain:
    """A kernel that adds what the effects' kernels for `quantity` (a field of `Kernels`) give."""
    return _chained(quantity, _adding)


def all_multiplied(quantity: str) -> Chain:
    """A kernel that multiplies by what they give."""
    return _chained(quantity, _multiplying)


def _chained(quantity: str, link: Callable[[Chain, int, Callable[..., float]], Chain]) -> Chain:
    chain: Chain = _unchanged
    for kind in EFFECTS.values():
        kernel = getattr(kind.kernels, quantity)
        if kernel is not None:
            chain = link(chain, flag(kind.name), kernel)
    return chain
