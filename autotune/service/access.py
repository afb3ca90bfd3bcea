"""What every request passes before anything else looks at it: token, host name, size, time.

Whatever may move an axis, write or cost minutes of computing needs the token, on the loopback too, and this is
asked first: a request without it learns nothing, not even whether the address exists. Other reading needs it only
where the service can be reached from other machines. The Host header is checked, so that a web page that a
browser shows cannot reach a service on the loopback under another name.

A client that is about to send the token can ask first whether this is the service that knows it: anybody may
listen on a port that is free. The proof is HMAC-SHA256(token, "autotune PORT NONCE") (RFC 2104); the port is in
it, so that nobody can pass on the proof of a service that listens elsewhere.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any

from starlette.exceptions import HTTPException

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

READING = ("GET", "HEAD", "OPTIONS")
BODY_SECONDS = 10.0
SEND_SECONDS = 10.0
UPLOAD_SECONDS = 900.0
"""For a recording to come, part by part, and to be looked through."""
SLOW = "/api/recordings/"
STUDIES = re.compile(r"/api/recordings/[^/]*/(compare|diagnose)/?")
PROOF = "/api/proof"
NONCE = re.compile(rb"[0-9a-f]{32,128}")
OPEN = ("/healthz", PROOF)
UPLOADS = re.compile(r"/api/workbench/(?:recordings|import)")
PAGES = re.compile(r"/|/workbench|/docs|/web/[A-Za-z0-9_./-]+")


@dataclass(frozen=True, slots=True)
class Rules:
    """What a request must respect. `names`: host names (without port) that it may come in under; `port`: ours;
    `open_pages`: the page itself needs no token where reading does: a browser cannot send one before it has it.
    `most_upload`: bytes of a recording that a page sends, where that may be more than `most_bytes`."""

    token: str
    reading_needs_token: bool
    names: frozenset[str]
    most_bytes: int
    seconds: float
    slow_seconds: float = 150.0
    port: int = 0
    open_pages: bool = False
    most_upload: int = 0


class AccessGuard:
    """ASGI application round another one."""

    def __init__(self, app: App, rules: Rules) -> None:
        self._app, self._rules = app, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        headers = {name.lower(): value for name, value in scope["headers"]}
        refusal = self._refusal(scope, headers)
        if refusal is not None:
            await _answer(send, *refusal)
            return
        if scope["path"] == PROOF and scope["method"] == "GET":
            await self._prove(headers.get(b"autotune-nonce", b""), send)
            return
        if UPLOADS.fullmatch(scope["path"]):
            await self._take(scope, receive, send, headers)
            return
        body = await _body(receive, headers, self._rules.most_bytes)
        if isinstance(body, tuple):
            await _answer(send, *body)
            return
        await self._pass_on(scope, _replay(body, receive), send, self._seconds(scope))

    async def _take(
        self, scope: Scope, receive: Receive, send: Send, headers: MutableMapping[bytes, bytes]
    ) -> None:
        """A recording goes through part by part: it is never whole in memory."""
        most = max(self._rules.most_bytes, self._rules.most_upload)
        if _too_large(headers, most):
            await _answer(send, 413, _larger(most))
            return
        await self._pass_on(scope, _counted(receive, most), send, UPLOAD_SECONDS)

    def _seconds(self, scope: Scope) -> float:
        return self._rules.slow_seconds if scope["path"].startswith(SLOW) else self._rules.seconds

    def _refusal(self, scope: Scope, headers: MutableMapping[bytes, bytes]) -> tuple[int, str] | None:
        rules = self._rules
        if self._needs_token(scope):
            given = headers.get(b"authorization", b"")
            if not given:
                return 401, "this needs the service's token: send 'Authorization: Bearer TOKEN'"
            scheme, _, value = given.partition(b" ")
            if scheme.lower() != b"bearer" or not secrets.compare_digest(value.strip(), rules.token.encode()):
                return 403, "the token is not the service's"
        host = headers.get(b"host", b"").decode("latin-1").lower()
        if _name(host) not in rules.names:
            return 403, "the service does not go by this host name; name it under http.names"
        return None

    def _needs_token(self, scope: Scope) -> bool:
        if scope["method"] not in READING or STUDIES.fullmatch(scope["path"]):
            return True
        if self._rules.open_pages and PAGES.fullmatch(scope["path"]):
            return False
        return self._rules.reading_needs_token and scope["path"] not in OPEN

    async def _prove(self, nonce: bytes, send: Send) -> None:
        if not NONCE.fullmatch(nonce):
            await _answer(send, 400, "the header Autotune-Nonce must be 32 to 128 hexadecimal digits")
            return
        await _answer(send, 200, proof_of(self._rules.token, self._rules.port, nonce.decode()), "proof")

    async def _pass_on(self, scope: Scope, receive: Receive, send: Send, seconds: float) -> None:
        watched = _Send(send)
        task = asyncio.ensure_future(self._app(scope, receive, watched))
        try:
            started = asyncio.ensure_future(watched.started.wait())
            await asyncio.wait({task, started}, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
            started.cancel()
            if not task.done() and not watched.started.is_set():
                task.cancel()
                await _answer(send, 504, f"no answer within {seconds:g} s")
                return
            await task
        except TimeoutError:
            watched.abort()
        finally:
            if not task.done():
                task.cancel()


def proof_of(token: str, port: int, nonce: str) -> str:
    """What only a service that knows the token, on this port, can answer to a nonce."""
    return hmac.new(token.encode(), f"autotune {port} {nonce}".encode(), "sha256").hexdigest()


class _Send:
    """Passes messages on; a reader that takes none for ten seconds is cut off."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self.started = asyncio.Event()

    async def __call__(self, message: Message) -> None:
        self.started.set()
        await asyncio.wait_for(self._send(message), SEND_SECONDS)

    def abort(self) -> None:
        """Closes the connection without waiting for what was not read."""
        transport = getattr(getattr(self._send, "__self__", None), "transport", None)
        if transport is not None:
            transport.abort()


def _name(host: str) -> str:
    """Without the port; `[::1]:80` is `::1`."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if host.count(":") == 1 else host


async def _body(
    receive: Receive, headers: MutableMapping[bytes, bytes], most: int
) -> bytes | tuple[int, str]:
    """The whole body, or a refusal."""
    refusal = 413, _larger(most)
    if _too_large(headers, most):
        return refusal
    if b"content-length" not in headers and b"transfer-encoding" not in headers:
        return b""
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_SECONDS):
            while True:
                message = await receive()
                body += message.get("body", b"")
                if len(body) > most:
                    return refusal
                if message["type"] == "http.disconnect" or not message.get("more_body"):
                    return bytes(body)
    except TimeoutError:
        return 408, f"the body did not arrive within {BODY_SECONDS:g} s"


def _larger(most: int) -> str:
    return f"the body is larger than {most} bytes"


def _too_large(headers: MutableMapping[bytes, bytes], most: int) -> bool:
    """By what the head says."""
    length = headers.get(b"content-length")
    return length is not None and (not length.isdigit() or int(length) > most)


def _counted(receive: Receive, most: int) -> Receive:
    """Parts of a body as they come; too many bytes, or none for ten seconds, end it."""
    had = 0

    async def next_part() -> Message:
        nonlocal had
        try:
            message = await asyncio.wait_for(receive(), BODY_SECONDS)
        except TimeoutError:
            raise HTTPException(408, f"no more of the body arrived within {BODY_SECONDS:g} s") from None
        had += len(message.get("body", b""))
        if had > most:
            raise HTTPException(413, _larger(most))
        return message

    return next_part


def _replay(body: bytes, receive: Receive) -> Receive:
    given = False

    async def again() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


async def _answer(send: Send, status: int, detail: str, key: str = "detail") -> None:
    body = json.dumps({key: detail}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    if status == 401:
        headers.append((b"www-authenticate", b"Bearer"))
    if status in (408, 413):
        headers.append((b"connection", b"close"))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
