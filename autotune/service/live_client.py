"""Looking on at an axis of a service: its live traces, passed on to a view of this machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import BinaryIO

from autotune.core.errors import AutotuneError, LinkError
from autotune.service.client import ServiceClient
from autotune.view.messages import ROWS, decode_note, decode_rows, read_message
from autotune.view.teller import Teller

PATIENCE = 60.0
"""How long a service may be away before the view gives up [s]; a restart takes less."""
AGAIN = 1.0


def pass_on(source: BinaryIO, view: Teller) -> None:
    """Passes messages on until the source ends."""
    while (message := read_message(source)) is not None:
        kind, columns, payload = message
        if kind == ROWS:
            view.pass_rows(decode_rows(payload, columns))
        elif (note := decode_note(payload)).get("kind"):
            view.pass_note(note)


def follow(
    client: ServiceClient, axis: str, view: Teller, told: Callable[[str], None], ending: threading.Event
) -> None:
    """Shows an axis of a service until `ending` is set; a service that is restarted is waited for.

    Raises:
        ConfigurationError: refused; says why.
        LinkError: the service is away for too long.
    """
    away = 0.0
    while not ending.is_set():
        try:
            with client.live(axis) as source:
                if away:
                    told("the service is there again")
                away = 0.0
                pass_on(source, view)
            raise LinkError(f"the service at {client.address} has ended the live traces")
        except (LinkError, OSError) as error:
            if ending.is_set():
                return
            now = time.monotonic()
            if not away:
                away = now
                told(f"{error}; waiting for it")
            if now - away > PATIENCE:
                gone = f"the service at {client.address} was away for {PATIENCE:.0f} s; start it again"
                raise LinkError(gone) from None
        ending.wait(AGAIN)


class Following:
    """The same in a thread, beside a command that waits for a job of the service; it never ends the command."""

    def __init__(self, client: ServiceClient, axis: str, view: Teller) -> None:
        self._ending = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(client, axis, view), name="live-follow", daemon=True
        )

    def __enter__(self) -> Following:
        self._thread.start()
        return self

    def __exit__(self, *whatever: object) -> None:
        self._ending.set()
        self._thread.join(1.0)

    def _run(self, client: ServiceClient, axis: str, view: Teller) -> None:
        try:
            follow(client, axis, view, lambda sentence: None, self._ending)
        except (AutotuneError, OSError, ValueError):
            return
