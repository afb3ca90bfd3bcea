"""Reads our own targets back from the drive while it moves: are they what we have sent?

Process data are sent without an answer. A receive PDO that is lost for good, or a second master that
overwrites it, leaves the drive with a target that is not ours, which in torque mode nothing else shows. So an
object of our process data is read by SDO now and then, beside the cycle and without waiting for the answer,
and compared with what was sent in the last `RECENT` cycles: later answers and single losses are no
disagreement. `BAD` disagreements among the last `LOOKS` looks at an object are.

Not every drive shows in the object what came by PDO. A disagreement therefore counts only where the object
has been seen to follow us from what it was before power came on, or changes without us after it had agreed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import suppress

from autotune.core.errors import LinkError, LinkTimeout, TransferAborted
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.sdo import Sdo

EVERY_SECONDS = 0.02
RECENT = 8
LOOKS = 4
BAD = 2
UNANSWERED = 50


class _Watched:
    """One object: what was seen of it."""

    def __init__(self, ref: ObjectRef, place: int, before: Raw) -> None:
        self.ref = ref
        self.place = place
        self._before = before
        self._agreed: Raw | None = None
        self._follows = False
        self._bad: deque[bool] = deque(maxlen=LOOKS)

    def compare(self, found: Raw, sent: Sequence[Raw]) -> bool:
        """True where the object is certainly not ours any more."""
        if found in sent:
            self._follows = self._follows or found != self._before
            self._agreed = found
            self._bad.append(False)
            return False
        self._bad.append(self._follows or self._agreed not in (None, found))
        return sum(self._bad) >= BAD


class ReadBack:
    """Looks at the targets of one drive in turn."""

    def __init__(self, sdo: Sdo, period: float) -> None:
        self._sdo = sdo
        self._every = max(round(EVERY_SECONDS / period), 1)
        self._watched: list[_Watched] = []
        self._recent: deque[tuple[Raw, ...]] = deque(maxlen=RECENT)
        self._since: list[tuple[Raw, ...]] = []
        self._asked: _Watched | None = None
        self._cycle = self._turn = self._unanswered = 0
        self._answered = False

    def begin(self, places: Sequence[tuple[ObjectRef, int]]) -> None:
        """Power is to come on, with these objects at these places of the outputs. Raises LinkError."""
        self._watched = []
        for ref, place in places:
            with suppress(TransferAborted):  # what cannot be read cannot be watched
                self._watched.append(_Watched(ref, place, self._sdo.read(ref)))
        self._recent.clear()
        self._asked = None
        self._cycle = self._unanswered = 0
        self._answered = False

    def cycle(self, outputs: tuple[Raw, ...]) -> None:
        """To be called once a cycle, after `outputs` were sent and answered.

        Raises:
            LinkError: the drive has a target that we did not send. LinkTimeout: it no longer lets us look.
        """
        self._recent.append(outputs)
        self._cycle += 1
        if self._asked is not None:
            self._since.append(outputs)
            self._look(self._asked)
        if self._cycle % self._every == 0 and self._watched:
            self._ask()

    def _ask(self) -> None:
        if self._asked is not None:
            self._unanswered += 1
            if self._answered and self._unanswered >= UNANSWERED:
                raise LinkTimeout(
                    f"node {self._sdo.node} answers SYNC, but {self._asked.ref} can no longer be read back "
                    f"({self._unanswered} requests without an answer): frames from this host to the drive get lost. "
                    "Check cable and adapter, and what else is on the bus"
                )
        self._turn = (self._turn + 1) % len(self._watched)
        self._asked = self._watched[self._turn]
        self._since = list(self._recent)
        self._sdo.ask(self._asked.ref)

    def _look(self, asked: _Watched) -> None:
        answer = self._sdo.answer(asked.ref)
        if answer is None:
            return
        self._asked = None
        self._unanswered = 0
        self._answered = True
        if answer == b"":  # this drive does not let it be read now
            self._watched.remove(asked)
            return
        found = asked.ref.decode(answer)
        sent = [asked.ref.decode(asked.ref.encode(outputs[asked.place])) for outputs in self._since]
        if asked.compare(found, sent):
            raise LinkError(
                f"node {self._sdo.node} does not have the target that it was sent: {asked.ref} is {found:g}, in the "
                f"last {len(sent)} cycles it was sent {min(sent):g} to {max(sent):g}. Its process data do not arrive, "
                "or another master writes them. Look for a second master (a PLC, the vendor's tool), and check "
                "cable and adapter"
            )
