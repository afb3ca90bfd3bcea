"""`autotune workbench`: the page on this machine only, with a token of its own, until it is ended."""

from __future__ import annotations

import secrets
import shutil
import socket
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import uvicorn

from autotune.core.errors import ConfigurationError
from autotune.service.access import AccessGuard, Rules
from autotune.workbench.engine import Engine
from autotune.workbench.files import MOST_SENT, Files
from autotune.workbench.routes import make_app

HOST = "127.0.0.1"
MOST_BYTES = 16_000_000
"""Of a request that is no recording: models as text."""


def serve(paths: Sequence[Path], port: int, ready: Callable[[str], None]) -> None:
    """Serves until SIGINT or SIGTERM; `ready` hears the address to open, the token in it.

    Raises:
        RecordingError, ConfigurationError: a file that is no recording, or a port that is taken.
    """
    folder = Path(tempfile.mkdtemp(prefix="autotune-workbench-"))
    engine = None
    try:
        files = Files(folder)
        for path in paths:
            files.add_path(path)
        listening = _listen(port)
        engine = Engine()
        token = secrets.token_urlsafe(24)
        bound = int(listening.getsockname()[1])
        rules = Rules(
            token, True, frozenset({HOST, "localhost"}), MOST_BYTES, 60.0, port=bound, open_pages=True,
            most_upload=MOST_SENT,
        )  # fmt: skip
        config = uvicorn.Config(
            AccessGuard(make_app(files, engine), rules), lifespan="off", log_config=None, access_log=False,
            server_header=False, timeout_graceful_shutdown=1, ws="none",
        )  # fmt: skip
        ready(f"http://{HOST}:{bound}/#token={token}")
        uvicorn.Server(config).run(sockets=[listening])
    finally:
        if engine is not None:
            engine.close()
        shutil.rmtree(folder, ignore_errors=True)


def _listen(port: int) -> socket.socket:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((HOST, port))
        listening.listen(100)
    except OSError as error:
        listening.close()
        raise ConfigurationError(
            f"nothing can be served at {HOST}:{port} ({error.strerror}); choose another --port, or leave it out"
        ) from error
    return listening
