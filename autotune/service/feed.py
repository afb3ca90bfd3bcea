"""Who follows what happens: every follower has a queue of its own, and one that never reads is dropped."""

from __future__ import annotations

import queue
import threading
from dataclasses import dataclass, field
from typing import Any

MOST_WAITING = 500
MOST_FOLLOWERS = 100


@dataclass(eq=False)
class Follower:
    """One follower; `job` or `axis` restrict what it hears. `dropped` once it was too slow."""

    job: str | None = None
    axis: str | None = None
    dropped: bool = False
    waiting: queue.Queue[dict[str, Any]] = field(default_factory=lambda: queue.Queue(MOST_WAITING))

    def wants(self, message: dict[str, Any]) -> bool:
        return (self.job in (None, message.get("job"))) and (self.axis in (None, message.get("axis")))


class Feed:
    """Passes messages to all followers without ever waiting for one."""

    def __init__(self) -> None:
        self._followers: list[Follower] = []
        self._lock = threading.Lock()

    def follow(self, job: str | None = None, axis: str | None = None) -> Follower | None:
        """A new follower; None where there are too many."""
        with self._lock:
            if len(self._followers) >= MOST_FOLLOWERS:
                return None
            follower = Follower(job, axis)
            self._followers.append(follower)
            return follower

    def leave(self, follower: Follower) -> None:
        """Ends following. Idempotent."""
        with self._lock:
            if follower in self._followers:
                self._followers.remove(follower)

    def tell(self, message: dict[str, Any]) -> None:
        """Passes a message on."""
        with self._lock:
            for follower in list(self._followers):
                if not follower.wants(message):
                    continue
                try:
                    follower.waiting.put_nowait(message)
                except queue.Full:
                    follower.dropped = True
                    self._followers.remove(follower)

    @property
    def count(self) -> int:
        """Followers at present."""
        with self._lock:
            return len(self._followers)
