"""Failures of the in-process drive, on demand: for rehearsals and tests.

| name | what happens |
|---|---|
| silent | nobody answers any more; the drive stops the axis by itself |
| power-loss | power goes and comes back: one missing answer, volatile parameters are lost |
| drive-fault | a fault (2310h) that can be reset |
| following-error | a following error (8611h) is reported |
| blocked | the axis cannot move: the brake stays on |
| enable-missing | the enable input is open: torque off, no way to be enabled |
| brake-missing | the brake's feedback is missing: cannot be enabled, a fault while running |
| hot | the motor is 200 °C warmer |
| missed-cycles | three cycles pass without the host |
| write-refused | parameters cannot be written |
| store-refused | parameters cannot be stored |
| nvm | storing is confirmed, but nothing is kept |
| stop-fault | over-current (2310h) in the middle of the next controlled stop: power goes at once |
| rpdo-lost | the drive does not hear commands any more and goes on with the last one |
| second-master | another master puts its own target, `=RAD` (0.1) away, in place of ours |
| clear | all of the above is over |

Besides these, everything that can break inside the axis: `hurts`.
"""

from __future__ import annotations

import difflib
import heapq
import math
import re

from autotune.core.errors import ConfigurationError
from autotune_sim.hurts import HURTS, check_hurt

REHEARSALS = (
    "silent", "power-loss", "drive-fault", "following-error", "blocked", "enable-missing", "brake-missing",
    "hot", "missed-cycles", "write-refused", "store-refused", "nvm", "stop-fault", "rpdo-lost",
    "second-master", "clear",
)  # fmt: skip
_NUMBER = re.compile(r"[+-]?\d+(\.\d*)?")


def check_failure(name: str, value: str = "") -> None:
    """Raises ConfigurationError where there is no such failure or it cannot have that value."""
    if name in HURTS:
        check_hurt(name, value)
        return
    if name not in REHEARSALS:
        known = (*REHEARSALS, *HURTS)
        near = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"
        raise ConfigurationError(f"there is no fault {name!r} to rehearse; {hint}")
    if value and not (name == "second-master" and _NUMBER.fullmatch(value)):
        raise ConfigurationError(f"fault {name!r}: value {value!r} must be left out")


class Agenda:
    """Failures to come.

    Attributes:
        due: drive time of the next one [s]; infinite where there is none.
    """

    def __init__(self) -> None:
        self.due = math.inf
        self._queue: list[tuple[float, int, str, str]] = []
        self._count = 0

    def add(self, name: str, time: float, value: str = "") -> None:
        """Plans one failure.

        Raises:
            ConfigurationError: an unknown name, with the nearest right one, or a time that is none.
        """
        check_failure(name, value)
        if not (math.isfinite(time) and time >= 0.0):
            raise ConfigurationError(f"fault {name!r} is planned at {time} s; the time must be 0 s or later")
        self._count += 1
        heapq.heappush(self._queue, (time, self._count, name, value))
        self.due = self._queue[0][0]

    def take(self, now: float) -> list[tuple[str, str]]:
        """What is due at `now` [s], in order, as names and values; it is taken off the agenda."""
        names = []
        while self._queue and self._queue[0][0] <= now:
            names.append(heapq.heappop(self._queue)[2:])
        self.due = self._queue[0][0] if self._queue else math.inf
        return names
