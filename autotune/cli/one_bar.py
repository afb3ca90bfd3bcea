"""One bar for a command whose number of steps is known only roughly beforehand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from autotune.view.console import ConsoleProgress, Stage

SECONDS_A_STEP, SECONDS_A_ROW = 0.05, 2e-5
"""About what a step takes at first, and what each row of the recordings adds; the pace that is seen takes over."""
LEAST_LEFT = 1.0
"""Steps that may always be to come."""
OTHERWISE = (
    ("fit of all motion together", 3.0),
    ("motor and load", 5.0),
    ("candidate elastic_transmission", 1.2),
    ("candidate backlash", 1.6),
    ("candidate", 0.07),
)
"""Steps that take as long as so many fits, by how they begin, the first that fits; all others are a fit."""


@contextmanager
def one_bar(name: str, steps: int, rows: int = 0) -> Iterator[Callable[[str], None]]:
    """A bar for about as much as `steps` fits; call what this yields with the name of each step as it begins.

    `rows`: of the recordings that are worked through, all together.
    """
    done = here = 0.0
    with ConsoleProgress([Stage(name, steps * (SECONDS_A_STEP + SECONDS_A_ROW * rows))]) as console:
        console.start(name)

        def step(what: str) -> None:
            nonlocal done, here
            done += here
            here = next((count for begins, count in OTHERWISE if what.startswith(begins)), 1.0)
            console.advance(done / max(steps, done + here + LEAST_LEFT))
            if done + here > steps:
                console.beyond(what)

        yield step
        console.finish()
