"""What a driver in front of the drive would do: now and then it reads back which target the drive has.

In process nothing can get lost but what a rehearsal takes away, so looking is only needed while one does.
As behind a wire, an older target counts as ours, and it takes two disagreements among the last looks.
"""

from __future__ import annotations

from collections import deque

from autotune.core.errors import LinkError

EVERY = 20  # cycles
RECENT = 8  # commands that may still be on their way
LOOKS = 4
BAD = 2


class ReadBack:
    """Compares what was sent in a cycle with what the drive obeys."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, float]] = deque(maxlen=RECENT)
        self._bad: deque[bool] = deque(maxlen=LOOKS)
        self._cycles = 0

    def cycle(self, sent: tuple[float, float], obeyed: tuple[float, float]) -> None:
        """One cycle: target and torque offset, as they were sent and as the drive has them.

        Raises:
            LinkError: the drive has a target that it was not sent.
        """
        self._sent.append(sent)
        self._cycles += 1
        if self._cycles % EVERY:
            return
        self._bad.append(obeyed not in self._sent)
        if sum(self._bad) >= BAD:
            raise LinkError(
                f"the simulated drive does not have the target that it was sent: it follows {obeyed[0]:g}, in the last "
                f"{len(self._sent)} cycles it was sent {self._sent[0][0]:g} to {self._sent[-1][0]:g}. Its commands "
                "do not arrive, or another master writes them"
            )
