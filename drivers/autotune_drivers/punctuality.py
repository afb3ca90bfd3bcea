"""How late this host was, by its own doing: to be told apart from a drive that is silent.

A drive watches its host by the clock: a loop that was not run in time looks to it like a cut cable. What is
noted is only what the host owes: a heartbeat sent after it was due, a sleep that lasted too long. Waiting for
the drive's answer is none of it.

A host is to blame where its silence was longer than `BLAMED` of what the drive (or we, for its answer) wait
for: adapter and drive have to share the rest, and were delayed by the same load where they hang on this host.
"""

from __future__ import annotations

import logging
import os
import time

from autotune.core.errors import HostLate

BLAMED = 0.5
LASTS = 2.0
_log = logging.getLogger("autotune.drivers")


class Punctuality:
    """The longest delays of this host [s].

    Attributes:
        worst: since power was asked for.
        spell: since somebody has set it to 0, to judge one exchange.
    """

    def __init__(self) -> None:
        self.worst = self.spell = 0.0
        self._recent = self._at = 0.0

    def begin(self) -> None:
        """Power is to come on: what was before does not count."""
        self.worst = self.spell = self._recent = 0.0

    def note(self, late: float) -> None:
        """Something was due so many seconds ago; 0 or less is in time."""
        if late <= 0.0:
            return
        self.worst = max(self.worst, late)
        self.spell = max(self.spell, late)
        now = time.monotonic()
        if late > self._recent or now - self._at > LASTS:
            self._recent, self._at = late, now

    @property
    def recent(self) -> float:
        """The longest delay of the last seconds."""
        return self._recent if time.monotonic() - self._at <= LASTS else 0.0

    def blamed(self, patience: float, usual: float = 0.0) -> bool:
        """True where this host was silent long enough to try somebody's `patience` [s].

        Args:
            usual: silence between two signs of life of a host that is in time [s].
        """
        return self.recent > 0.0 and self.recent + usual >= BLAMED * patience


def host_late(who: str, silent: float, patience: float, then: str) -> HostLate:
    """The error for a run that this host has ended.

    Args:
        who: the drive. silent: how long it heard nothing [s]. patience: for how long it would wait [s].
        then: what came of it.
    """
    return HostLate(
        f"this host was late: {who} heard nothing from it for {silent * 1e3:.0f} ms, where {patience * 1e3:.0f} ms "
        f"are allowed, and {then}. Neither drive nor cable is the cause ({_load()}). Give autotune real-time priority "
        "('rtprio 20' in /etc/security/limits.conf), run fewer programs beside it, or choose a longer cycle in the "
        "axis file; 'autotune link AXIS.toml' measures what this host holds. Then start again",
        silent,
    )


def warn(who: str, silent: float, patience: float) -> None:
    """A sentence for a host that was nearly too late; for moments without power, as writing may block."""
    _log.warning(
        "this host is hardly fast enough: %s heard nothing from it for %.0f ms, after %.0f ms it stops its axis (%s). "
        "Give autotune real-time priority ('rtprio 20' in /etc/security/limits.conf), run fewer programs beside it, "
        "or choose a longer cycle; 'autotune link AXIS.toml' measures what this host holds",
        who,
        silent * 1e3,
        patience * 1e3,
        _load(),
    )


def _load() -> str:
    """The load of this host, in words."""
    return f"load {os.getloadavg()[0]:.1f} on {os.cpu_count() or 1} processors"


def busy() -> str:
    """A remark where this host has more to do than processors: what hangs on it is slow then; or nothing."""
    load, processors = os.getloadavg()[0], os.cpu_count() or 1
    if load <= processors:
        return ""
    return (
        f". This host is busy (load {load:.1f} on {processors} processors): an adapter or a simulated drive that "
        "hangs on it may be late for that reason alone"
    )
