"""Who looks on while an axis is worked on: the live view, and the service's hub. Nothing waits for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from autotune.core.loop import Watch
from autotune.tuning.progress import Reporter
from autotune.view.pages import Page


class Observer(Protocol):
    """Sees every programme's rows, the stages, and what each stage found. Every method returns at once."""

    def programme(self, labels: Sequence[str]) -> Watch:
        """A programme begins, whose segments have these names; its rows go to what this returns."""

    def stage(self, name: str) -> None:
        """A stage begins."""

    def parameters(self, values: Mapping[str, tuple[float, float | None, str]]) -> None:
        """Parameters while they converge: name → value, spread, unit."""

    def page(self, page: Page) -> None:
        """What a stage found."""


def show(observers: Sequence[Observer], reporter: Reporter, make: Callable[[], Page]) -> None:
    """Shows what a stage found to all observers; made only where there is one, and never the end of a run."""
    if not observers:
        return
    try:
        page = make()
        for observer in observers if page.filled else ():
            observer.page(page)
    except Exception as error:  # noqa: BLE001 - what cannot be drawn must not end what moves an axis
        reporter.say(f"the view does not show this stage: {type(error).__name__}: {error}")
