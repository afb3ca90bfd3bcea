"""The lightest and the laziest axis that the real one can be: what they do while the encoder tells nothing.

See `motion_watch`, which knows how heavy they are and what holds them.
"""

from __future__ import annotations

import math

LAZY_COUNTS = 3.0  # of progress that an encoder at work must show


class VirtualAxes:
    """Both virtual axes in one direction; positions and torques are counted along it.

    Attributes:
        may, must: torque that holds the lightest and the laziest; lightest, heaviest: their inertias.
        run, way: speed of the lightest, and how far it is from where the encoder last told where it was.
        pushed: more torque than `may` has acted since then.
    """

    __slots__ = (
        "_from", "_impulse", "_lazy", "_start", "heaviest", "lightest", "may", "must", "pushed", "run", "way",
    )  # fmt: skip

    def __init__(self) -> None:
        self.may = self.must = math.inf
        self.lightest = self.heaviest = 1.0
        self.run = self.way = 0.0  # of the lightest
        self.pushed = self._lazy = False
        self._from = self._impulse = self._start = 0.0

    def live(self, speed: float) -> None:
        """The encoder has moved: what the lightest axis has become is known again."""
        self.run, self.way, self.pushed = max(speed, 0.0), 0.0, False

    def still(self) -> None:
        """Neither axis has anything to show."""
        self.run = self.way = 0.0
        self.pushed = self._lazy = False

    def idle(self) -> None:
        """Nothing pushes this way: the laziest axis begins anew where it is pushed again."""
        self._lazy = False

    def light(self, torque: float, cycle: float) -> None:
        """The lightest axis moves for one cycle."""
        self.pushed |= torque > self.may
        self.run = max(self.run + (torque - self.may) / self.lightest * cycle, 0.0)
        self.way += self.run * cycle

    def lazy(self, torque: float, position: float, speed: float, count: float, cycle: float) -> bool:
        """The laziest axis moves for one cycle; True where it should have been followed.

        Args:
            speed: of the axis lately, not above the truth.
        """
        if torque <= self.must:
            self._lazy = False
            return False
        if not self._lazy or position - self._start >= LAZY_COUNTS * count:
            self._lazy, self._start, self._from = True, position, position
            self._impulse = self.heaviest * min(speed, 0.0)
        self._impulse += (torque - self.must) * cycle
        self._from += self._impulse / self.heaviest * cycle
        return self._from - position > (LAZY_COUNTS + 1.0) * count
