"""The drive drops a torque offset whose sender has gone silent (event timer of the RPDO, CiA 301 1400h:05).

For receive PDOs the event timer is a deadline; what a drive does about it is its own. This one takes the
offset out with a gain that falls from 1 to 0 within `RAMP`, and brings it back as slowly when the sender is
heard again. An offset that has been dropped is forgotten: 60B2h is 0 then. The timer runs in the axis's time,
so that in lock-step a slow host is no silent one.
"""

from __future__ import annotations

from autotune_sim.object_dictionary import ObjectDictionary
from autotune_sim.pdo import NUMBER, ReceivePdo

RAMP = 0.1  # s
_OFFSET = 0x60B2


class OffsetGuard:
    """Gain of the torque offset.

    Attributes:
        gain: 0…1.
    """

    def __init__(self, objects: ObjectDictionary, pdos: list[ReceivePdo], period: float) -> None:
        self._offset = objects[_OFFSET]
        self._timers = [objects[0x1400 + number, 5] for number in range(NUMBER)]
        self._pdos = pdos
        self._period = period
        self.reset()

    def reset(self) -> None:
        """As at power-up."""
        self.gain = 1.0
        self._received = 0
        self._silent = 0.0
        self._dropping = False
        self._deadline: float | None = None

    def cycle(self) -> float:
        """One servo period; the gain in it."""
        self._watch()
        step = self._period / RAMP
        self.gain = max(self.gain - step, 0.0) if self._dropping else min(self.gain + step, 1.0)
        if self._dropping and self.gain == 0.0:
            self._offset.value = 0
            self._dropping = self._deadline is not None
        return self.gain

    def _watch(self) -> None:
        """Counts the time since a guarded PDO was heard; a PDO that goes while dropping changes nothing."""
        self._deadline, received = self._guarded()
        if self._deadline is None:
            self._silent = 0.0
            return
        heard, self._received = received != self._received, received
        self._silent = 0.0 if heard else self._silent + self._period
        if heard:
            self._dropping = False
        elif self._silent > self._deadline and int(self._offset.value):
            self._dropping = True

    def _guarded(self) -> tuple[float | None, int]:
        """Deadline [s] of the PDO that carries the offset, and how many frames of it have come."""
        for pdo, timer in zip(self._pdos, self._timers, strict=True):
            if pdo.valid and int(timer.value) and any(entry.index == _OFFSET for entry in pdo.mapped):
                return int(timer.value) * 1e-3, pdo.received
        return None, 0
