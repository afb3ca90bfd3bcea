"""Live traces over HTTP: the last minute at once, then what comes, until the reader closes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path
from fastapi.responses import StreamingResponse

from autotune.service.event_stream import Followed
from autotune.service.live_hub import ALIVE, Follower
from autotune.service.manager import Manager
from autotune.workbench.routes import REFUSALS

POLL = 0.05
HEARTBEAT = 5.0
PIECE = 1 << 20
MEDIA = "application/vnd.autotune.live"
_STREAM: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {MEDIA: {"schema": {"type": "string", "format": "binary"}}},
        "description": "Rows and notes, each with its length before it.",
    }
}


def live_routes(manager: Manager) -> APIRouter:
    """The address of an axis's live traces."""
    routes = APIRouter(prefix="/api/axes", tags=["axes"], responses=REFUSALS)

    @routes.get("/{axis}/live", response_class=StreamingResponse, responses=_STREAM)
    def live(axis: Annotated[str, Path(pattern=r"^[a-z0-9][a-z0-9-]{0,40}$")]) -> StreamingResponse:
        """Live traces of an axis: its last minute at once, then what comes ('autotune view' shows them)."""
        if manager.configuration.axis(axis) is None:
            raise HTTPException(404, f"the service has no axis {axis!r}")
        hub = manager.live.of(axis)
        follower = hub.follow()
        if follower is None:
            raise HTTPException(503, "too many look on at this axis; close one")
        return Followed(_messages(follower), MEDIA, lambda: hub.leave(follower))

    return routes


async def _messages(follower: Follower) -> AsyncIterator[bytes]:
    quiet = HEARTBEAT  # the first word at once: the reader knows that it is heard
    while True:
        data = follower.take()
        if data:
            quiet = 0.0
            for start in range(0, len(data), PIECE):
                yield data[start : start + PIECE]
        elif quiet >= HEARTBEAT:
            quiet = 0.0
            yield ALIVE
        await asyncio.sleep(POLL)
        quiet += POLL
