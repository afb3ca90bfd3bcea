"""Jobs done at once in this process, for rehearsals with a clock of their own: a year in minutes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from autotune.service.daemon.orders import Done, Order, write_begun, write_done
from autotune.service.daemon.work import Tools, perform


@dataclass
class _Ended:
    result: Done | None

    def messages(self) -> list[dict[str, Any]]:
        return []

    def done(self) -> Done | None:
        return self.result

    def stop(self) -> None:
        return

    def kill(self) -> None:
        return

    def let_go(self) -> None:
        return


class InlineLauncher:
    """Does each job when it is started; `tools_for` gives axis, drive and clock of an order."""

    def __init__(self, tools_for: Callable[[Order], Tools]) -> None:
        self._tools_for = tools_for

    def start(self, order: Order) -> _Ended:
        tools = self._tools_for(order)
        write_begun(order, 0, tools.clock())
        done = perform(order, tools)
        write_done(order, done)
        return _Ended(done)
