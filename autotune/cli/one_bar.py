"""One bar for a command whose number of steps is known only roughly beforehand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from autotune.view.console import ConsoleProgress, Stage

SECONDS_A_STEP, SECONDS_A_ROW = 0.15, 8e-5
"""About what a step takes at first, beside what the rows of the recordings take; the pace that is seen takes over."""
LEAST_LEFT = 4
"""Steps that may always be to come."""
LONG = (
    ("motor and load fitted from elsewhere", 40),
    ("motor and load led on", 10),
    ("candidate elastic_transmission", 5),
    ("candidate backlash", 5),
    ("refit inside the twin", 3),
    ("refinement", 3),
)
"""What some steps take, by how they begin, as so many of the others."""


@contextmanager
def one_bar(name: str, steps: int, rows: int = 0) -> Iterator[Callable[[str], None]]:
    """A bar for about `steps` steps; call what this yields with the name of each step as it begins.

    `rows`: of the recordings that are worked through, all together.
    """
    done = here = 0
    with ConsoleProgress([Stage(name, SECONDS_A_STEP * steps + SECONDS_A_ROW * rows)]) as console:
        console.start(name)

        def step(what: str) -> None:
            nonlocal done, here
            done += here
            here = next((count for begins, count in LONG if what.startswith(begins)), 1)
            console.advance(done / max(steps, done + here + LEAST_LEFT))
            if done + here > steps:
                console.beyond(what)

        yield step
        console.finish()
