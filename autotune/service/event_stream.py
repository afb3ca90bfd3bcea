"""Server-sent events: what happens to one job or to everything, as it happens."""

from __future__ import annotations

import asyncio
import json
import queue
from collections.abc import AsyncIterator, Callable
from typing import Any

from fastapi import HTTPException
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from autotune.service.feed import Follower
from autotune.service.manager import Manager
from autotune.service.store import Row

HEARTBEAT = 10.0  # s of silence after which a comment keeps the connection open
EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {
            "text/event-stream": {
                "schema": {
                    "description": "Of each event; its data are a JSON object.",
                    "type": "object",
                    "properties": {"event": {"type": "string"}, "data": {"type": "string"}},
                    "required": ["event", "data"],
                }
            }
        },
        "description": "Events, as they happen.",
    }
}


class Followed(StreamingResponse):
    """What a follower is sent, and its leaving, also where the reader is gone before the first word."""

    def __init__(
        self, content: AsyncIterator[str | bytes], media_type: str, leave: Callable[[], None]
    ) -> None:
        super().__init__(content, media_type=media_type, headers={"Cache-Control": "no-store"})
        self._leave = leave

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._leave()


def stream(manager: Manager, job: str | None, row: Row | None) -> StreamingResponse:
    """The events of a job from its state now to its end, or all events until the reader leaves.

    Raises: HTTPException 503 when too many streams are open.
    """
    follower = manager.feed.follow(job)
    if follower is None:
        raise HTTPException(503, "too many event streams are open; close one")
    first = (
        []
        if row is None
        else [{"event": "state", "job": job, "state": row["state"], "outcome": row["outcome"]}]
    )
    ended = row is not None and row["state"] == "done"
    return Followed(
        _events(follower, first, ended, job is not None),
        "text/event-stream",
        lambda: manager.feed.leave(follower),
    )


async def _events(
    follower: Follower, first: list[dict[str, Any]], ended: bool, one_job: bool
) -> AsyncIterator[str]:
    quiet = 0.0
    for message in first:
        yield _sse(message)
    while not ended and not follower.dropped:
        try:
            message = follower.waiting.get_nowait()
        except queue.Empty:
            await asyncio.sleep(0.1)
            quiet += 0.1
            if quiet >= HEARTBEAT:
                quiet = 0.0
                yield ": alive\n\n"
            continue
        quiet = 0.0
        yield _sse(message)
        ended = one_job and message.get("event") == "done"


def _sse(message: dict[str, Any]) -> str:
    return f"event: {message.get('event', 'message')}\ndata: {json.dumps(message)}\n\n"
