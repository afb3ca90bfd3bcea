"""How a run tells where it is; the command line shows it, the service streams it."""

from __future__ import annotations

from typing import Protocol


class Reporter(Protocol):
    """Hears of stages, of the progress within one, and of what is worth a sentence."""

    def stage(self, name: str, seconds: float) -> None:
        """A stage begins that will take about `seconds`."""

    def progress(self, fraction: float) -> None:
        """Part of the stage that is done, 0…1."""

    def say(self, sentence: str) -> None:
        """Something happened that a person should know."""


class Silent:
    """Tells nobody."""

    def stage(self, name: str, seconds: float) -> None:
        return

    def progress(self, fraction: float) -> None:
        return

    def say(self, sentence: str) -> None:
        return
