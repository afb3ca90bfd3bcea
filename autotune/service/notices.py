"""Notices by webhook: a thread of its own posts them, with time-out and retries; nobody ever waits for it."""

from __future__ import annotations

import http.client
import json
import logging
import queue
import threading
import urllib.error
import urllib.request
from collections.abc import Mapping
from typing import Any

from autotune.service.settings import Notices

MOST_WAITING = 200
GROWTH, LONGEST_PAUSE = 4.0, 600.0  # s between attempts: 1, 4, 16, 64, 256, 600, 600, …
log = logging.getLogger("autotune.notices")


class Webhook:
    """Posts JSON objects `{kind, axis, at, sentence}` to a URL."""

    def __init__(self, settings: Notices) -> None:
        self._settings = settings
        self._waiting: queue.Queue[Mapping[str, Any]] = queue.Queue(MOST_WAITING)
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self.lost = 0

    def tell(self, notice: Mapping[str, Any]) -> None:
        """Queues a notice; without a webhook nothing happens."""
        if not self._settings.webhook:
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, daemon=True, name="notices")
            self._thread.start()
        try:
            self._waiting.put_nowait(notice)
        except queue.Full:
            self.lost += 1
            log.warning("a notice was lost: %d are waiting for the webhook already", MOST_WAITING)

    def change(self, settings: Notices) -> None:
        """Takes over other settings, also for what is waiting."""
        self._settings = settings

    def close(self) -> None:
        """Stops after the notice in hand."""
        self._ended.set()

    def _work(self) -> None:
        while not self._ended.is_set():
            try:
                notice = self._waiting.get(timeout=1.0)
            except queue.Empty:
                continue
            self._deliver(notice)

    def _deliver(self, notice: Mapping[str, Any]) -> None:
        """Tries as often as the settings say; a network that is down for minutes costs no notice."""
        pause, attempt = 1.0, 0
        while True:
            settings = self._settings
            attempt += 1
            problem = post(settings.webhook, notice, settings.seconds) if settings.webhook else ""
            if not problem:
                return
            log.warning("notice not delivered (attempt %d of %d): %s", attempt, settings.attempts, problem)
            if attempt >= settings.attempts or self._ended.wait(pause):
                break
            pause = min(GROWTH * pause, LONGEST_PAUSE)
        self.lost += 1


def post(url: str, content: Mapping[str, Any], seconds: float) -> str:
    """Posts once; returns what went wrong, or nothing."""
    body = json.dumps(dict(content)).encode()
    headers = {"Content-Type": "application/json"}
    request = urllib.request.Request(url, body, headers, method="POST")  # noqa: S310 - http(s) by `settings.Notices`
    try:
        with urllib.request.urlopen(request, timeout=seconds) as answer:  # noqa: S310 - as above
            return "" if 200 <= answer.status < 300 else f"HTTP {answer.status}"
    except (urllib.error.URLError, http.client.HTTPException, OSError, ValueError) as error:
        return str(error)
