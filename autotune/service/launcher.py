"""Starting workers, and hearing of them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

import autotune
from autotune.service.live_hub import LiveHubs
from autotune.service.live_pipe import VARIABLE
from autotune.service.orders import Done, Order, read_done

Message = dict[str, Any]
MOST_MESSAGES = 1000
PRIVATE = (
    "AUTOTUNE_TOKEN",
    "NOTIFY_SOCKET",
    "WATCHDOG_USEC",
    "WATCHDOG_PID",
    "PGPASSWORD",
    "CREDENTIALS_DIRECTORY",
)


class Handle(Protocol):
    """A job under way."""

    def messages(self) -> list[Message]:
        """What it has told since the last call."""

    def done(self) -> Done | None:
        """How it ended, once it has; `died` where its process ended without a result."""

    def stop(self) -> None:
        """Asks it to come to rest and end."""

    def kill(self) -> None:
        """Ends its process at once."""

    def let_go(self) -> None:
        """Ends it without a result: the next start of the service does it again."""


class Launcher(Protocol):
    """Starts jobs."""

    def start(self, order: Order) -> Handle: ...


class ProcessLauncher:
    """Each job in a process of its own. `hubs`: where its live traces go."""

    def __init__(self, hubs: LiveHubs | None = None) -> None:
        self._hubs = hubs or LiveHubs()

    def start(self, order: Order) -> Handle:
        return _Process(order, self._hubs)


def place_for_kernels(state: Path) -> None:
    """Compiled kernels go below `state` where an installation and its user's home cannot take them.

    A system user has no home and may not write into the installation; without a place a job cannot begin.
    """
    beside = Path(autotune.__file__).parent
    home = Path(os.environ.get("XDG_CACHE_HOME", "") or Path("~/.cache").expanduser())
    if any(os.access(folder, os.W_OK) for folder in (beside, home, home.parent)):
        return
    os.environ.setdefault("NUMBA_CACHE_DIR", str(state / "kernels"))


def environment() -> dict[str, str]:
    """What the service's own processes are given: all but what is for the service alone, its secrets first."""
    return {name: value for name, value in os.environ.items() if name not in PRIVATE}


class _Process:
    def __init__(self, order: Order, hubs: LiveHubs) -> None:
        self._order = order
        self._told: deque[Message] = deque(maxlen=MOST_MESSAGES)
        live, written = os.pipe()
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "autotune.service.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
                env=environment() | {VARIABLE: str(written)},
                pass_fds=(written,),
            )
        except OSError:
            os.close(live)
            raise
        finally:
            os.close(written)
        hubs.listen(order.axis, os.fdopen(live, "rb"))
        with suppress(BrokenPipeError):
            if self._process.stdin is not None:
                self._process.stdin.write(json.dumps(order.as_json()).encode() + b"\n")
                self._process.stdin.flush()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def messages(self) -> list[Message]:
        found = []
        while self._told:
            found.append(self._told.popleft())
        return found

    def done(self) -> Done | None:
        code = self._process.poll()
        if code is None:
            return None
        self._reader.join(1.0)
        self._close()
        died = Done("died", 5, f"The worker process ended with code {code} and without a result.")
        return read_done(Path(self._order.runs), self._order.id) or died

    def stop(self) -> None:
        self._signal(signal.SIGTERM)

    def kill(self) -> None:
        self._signal(signal.SIGKILL)

    def let_go(self) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()

    def _signal(self, number: signal.Signals) -> None:
        if self._process.poll() is None:
            self._process.send_signal(number)

    def _close(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def _read(self) -> None:
        if self._process.stdout is None:
            return
        try:
            for line in self._process.stdout:
                try:
                    self._told.append(json.loads(line))
                except ValueError:
                    continue
        except ValueError:
            return  # closed under the reader's hands
