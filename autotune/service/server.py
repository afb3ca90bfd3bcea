"""uvicorn in a thread, on a socket that is ours: the address is known before anything is served."""

from __future__ import annotations

import asyncio
import socket
import threading
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from autotune.core.errors import ConfigurationError
from autotune.service.access import AccessGuard, Rules
from autotune.service.api import make_api
from autotune.service.manager import Manager
from autotune.service.service_file import url_of
from autotune.service.settings import LOOPBACK, Http
from autotune.workbench.files import MOST_SENT

HEADER_SECONDS = 15.0
KEPT_SECONDS = 15
MOST_CONNECTIONS = 1000


class _Protocol(H11Protocol):
    """Cuts off who connects, or keeps a connection, and does not send a request's head in time.

    One timer at a time, none after the end: a timer holds its connection with all that the last request left.
    """

    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._expect(HEADER_SECONDS, self.cycle)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._forget()

    def on_response_complete(self) -> None:
        ended = self.cycle
        super().on_response_complete()  # may begin what was sent ahead
        if not self.transport.is_closing():
            self._expect(KEPT_SECONDS + HEADER_SECONDS, ended)

    def _expect(self, seconds: float, before: object) -> None:
        self._forget()
        self._timer = asyncio.get_running_loop().call_later(seconds, self._cut_if_still, before)

    def _forget(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _cut_if_still(self, before: object) -> None:
        now: object = self.cycle
        if now is before and not self.transport.is_closing():
            self.transport.abort()


class HttpServer:
    """The API on its socket."""

    def __init__(self, manager: Manager, http: Http, token: str, listening: socket.socket) -> None:
        self.port = int(listening.getsockname()[1])
        self.address = url_of(http, self.port)
        names = {*LOOPBACK, http.host, *http.names}
        rules = Rules(
            token,
            not http.loopback,
            frozenset(names),
            http.body_kilobytes * 1024,
            http.seconds,
            port=self.port,
            open_pages=True,
            most_upload=MOST_SENT,
        )
        self._api = make_api(manager)
        config = uvicorn.Config(
            AccessGuard(self._api, rules),
            http=_Protocol,
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            limit_concurrency=MOST_CONNECTIONS,
            timeout_keep_alive=KEPT_SECONDS,
            timeout_graceful_shutdown=2,
            ws="none",
        )
        self._server = uvicorn.Server(config)
        self._listening = listening
        self._thread = threading.Thread(target=self._run, daemon=True, name="http")

    def start(self) -> None:
        """Serves from now on."""
        self._thread.start()

    @property
    def alive(self) -> bool:
        """The thread is there."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Ends serving, streams included; also where it has not begun."""
        self._server.should_exit = True
        if self._thread.ident is not None:
            self._thread.join(5.0)
        self._listening.close()
        self._api.state.ended()

    def _run(self) -> None:
        self._server.run(sockets=[self._listening])


def listen(http: Http) -> socket.socket:
    """The socket of the API.

    Raises:
        ConfigurationError: the address is in use or not this machine's.
    """
    family = socket.AF_INET6 if ":" in http.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((http.host, http.port))
        listening.listen(MOST_CONNECTIONS)
    except OSError as error:
        listening.close()
        raise ConfigurationError(
            f"nothing can be served at {http.host}:{http.port} ({error.strerror}); set another http.port in the "
            "service file, or stop what is there"
        ) from error
    return listening
