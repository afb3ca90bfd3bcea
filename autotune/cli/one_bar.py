"""One bar for a command whose number of steps is known only roughly beforehand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from autotune.view.console import ConsoleProgress, Stage

SECONDS_A_STEP = 0.15
"""About what a step takes at first; the pace that is seen takes over."""
LEAST_LEFT = 4
"""Steps that may always be to come."""


@contextmanager
def one_bar(name: str, steps: int) -> Iterator[Callable[[str], None]]:
    """A bar for about `steps` steps; call what this yields with the name of each step as it begins."""
    done = 0
    with ConsoleProgress([Stage(name, SECONDS_A_STEP * steps)]) as console:
        console.start(name)

        def step(_what: str) -> None:
            nonlocal done
            console.advance(done / max(steps, done + LEAST_LEFT))
            done += 1

        yield step
        console.finish()
