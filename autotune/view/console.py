"""Progress on the console: stages with a bar and the time that remains; standard error only.

On a terminal it draws (rich); elsewhere (a log file, a pipe) it writes one line a stage and one for
each further tenth, so that logs stay readable. Nothing ever goes to standard output.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.text import Text

LINE_SECONDS, LINE_SECONDS_BEYOND = 1.0, 60.0


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage of the run and how long it is expected to take [s]."""

    name: str
    expected_s: float


class ConsoleProgress:
    """Shows where the run is and what remains.

    The time that remains of a stage is its expected time at first and follows the pace seen as it
    advances; that of the run adds the stages to come, scaled by how the stages so far went.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
        quiet: bool = False,
    ) -> None:
        self._stages = tuple(stages)
        self._console = Console(file=stream or sys.stderr, quiet=quiet, highlight=False, emoji=False)
        self._clock = clock
        self._index = -1
        self._open = False
        self._fraction = 0.0
        self._began = self._entered = 0.0
        self._spent = 0.0
        self._tenth = 0
        self._beyond = False
        self._last_line = -LINE_SECONDS
        self._bars = _bars(self._console, self) if self._console.is_terminal else None
        self._task = None if self._bars is None else self._bars.add_task("", total=1.0, start=True)

    def __enter__(self) -> ConsoleProgress:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def start(self, name: str) -> None:
        """The run enters a stage; one that was not announced is added.

        The stage before, if still open, counts as done. The one that is open goes on, with a part of it
        whose progress counts from nothing.
        """
        goes_on = name == self.stage
        self._close_stage()
        names = [stage.name for stage in self._stages]
        if name not in names:
            place = max(self._index + 1, 0)
            self._stages = (*self._stages[:place], Stage(name, 0.0), *self._stages[place:])
            names.insert(place, name)
        self._index = names.index(name)
        self._began, self._fraction, self._tenth, self._open = self._clock(), 0.0, 0, True
        self._beyond = False
        self._entered = self._entered if goes_on else self._began
        if self._bars is not None and self._task is not None:
            self._bars.update(self._task, completed=0.0)
        elif not goes_on:
            self._line(f"{self.label} …{_about(self.remaining_total_s())}")

    def advance(self, fraction: float) -> None:
        """The present stage has come so far, 0…1; never back."""
        self._fraction = min(1.0, max(self._fraction, fraction))
        if self._bars is not None and self._task is not None:
            self._bars.update(self._task, completed=self._fraction)
            return
        tenth = int(self._fraction * 10 + 1e-9)
        if self._open and self._tenth < tenth < 10 and self._clock() - self._last_line >= LINE_SECONDS:
            self._line(f"{self.label} {10 * tenth} % ({self.time_left()})")
        self._tenth = max(self._tenth, tenth)

    def beyond(self, what: str) -> None:
        """The present stage needs more steps than were foreseen, and `what` begins: nobody knows how many.

        What it took so far is told in the place of what is left; in a log once a minute.
        """
        self._beyond = True
        if self._bars is None and self._clock() - self._last_line >= LINE_SECONDS_BEYOND:
            self._line(f"{self.label} ({self.time_left()}): {what}")

    def time_left(self) -> str:
        """`about 12 s left`, with what the whole run needs where more stages come; or what it took so far."""
        if self._beyond:
            return f"{duration(self._clock() - self._entered)} so far, longer than usual"
        left = f"about {duration(self.remaining_s())} left"
        more = self._index + 1 < len(self._stages)
        return f"{left}, {duration(self.remaining_total_s())} in total" if more else left

    def finish(self, note: str = "") -> None:
        """The present stage is done; `note` says in few words what came out."""
        if not self._open:
            return
        took = self._clock() - self._entered
        self._close_stage()
        self._line(f"✓ {self._stages[self._index].name}{': ' + note if note else ''} ({duration(took)})")

    def message(self, text: str) -> None:
        """A line above the bar."""
        self._line(text)

    def remaining_s(self) -> float:
        """Time that the present stage still needs [s]."""
        if not self._open or self._fraction >= 1.0:
            return 0.0
        expected = self._stages[self._index].expected_s
        spent = self._clock() - self._began
        seen = spent / self._fraction if self._fraction > 0.02 else expected
        trust = min(1.0, self._fraction * 4)
        return max(0.0, (1 - trust) * expected + trust * seen - spent)

    def remaining_total_s(self) -> float:
        """Time that the run still needs [s]."""
        closed = self._index if self._open else self._index + 1
        done = sum(stage.expected_s for stage in self._stages[: max(closed, 0)])
        pace = min(3.0, max(0.3, self._spent / done)) if done > 0 and self._spent > 0 else 1.0
        later = sum(stage.expected_s for stage in self._stages[self._index + 1 :])
        return self.remaining_s() + pace * later

    @property
    def stage(self) -> str | None:
        """The stage that is open."""
        return self._stages[self._index].name if self._open else None

    @property
    def label(self) -> str:
        """What the bar is for."""
        if self._index < 0:
            return ""
        return f"[{self._index + 1}/{len(self._stages)}] {self._stages[self._index].name}"

    def _close_stage(self) -> None:
        if self._open:
            self._spent += self._clock() - self._began
        self._open, self._fraction = False, 1.0

    def _line(self, text: str) -> None:
        self._last_line = self._clock()
        self._console.print(text, markup=False, soft_wrap=True)


class _Remaining(ProgressColumn):
    """`about 12 s left, 1:40 in total`."""

    def __init__(self, progress: ConsoleProgress) -> None:
        super().__init__()
        self._progress = progress

    def render(self, task: Task) -> Text:
        return Text(self._progress.time_left(), style="dim")


class _Label(ProgressColumn):
    def __init__(self, progress: ConsoleProgress) -> None:
        super().__init__()
        self._progress = progress

    def render(self, task: Task) -> Text:
        return Text(self._progress.label)


def _bars(console: Console, progress: ConsoleProgress) -> Progress:
    return Progress(
        SpinnerColumn(),
        _Label(progress),
        BarColumn(bar_width=28),
        TextColumn("{task.percentage:>3.0f} %"),
        _Remaining(progress),
        console=console,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )


def duration(seconds: float) -> str:
    """Readable time.

    >>> duration(8.2), duration(100), duration(4000)
    ('8 s', '1:40', '1:06:40')
    """
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60}:{whole % 60:02d}"
    return f"{whole // 3600}:{whole % 3600 // 60:02d}:{whole % 60:02d}"


def _about(total_s: float) -> str:
    return f" (about {duration(total_s)} in total)" if total_s >= 1 else ""
