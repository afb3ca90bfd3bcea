"""The command line's way to a service that owns an axis: start a job there, follow it, fetch what it left."""

from __future__ import annotations

import http.client
import json
import os
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError, Interrupted, LinkError
from autotune.service.ownership import Owner
from autotune.service.progress import Reporter

SECONDS = 10.0
POLL = 0.3


class ServiceClient:
    """Speaks to the service at an address. The token is read from its file, or from AUTOTUNE_TOKEN."""

    def __init__(self, owner: Owner) -> None:
        self.address = owner.address
        self._token_file = Path(owner.token_file) if owner.token_file else None

    def start(self, axis: str, kind: str, **wish: Any) -> dict[str, Any]:
        """Starts a job.

        Raises:
            ConfigurationError: refused; says why. LinkError: the service does not answer.
        """
        return self._ask("POST", f"/api/axes/{axis}/jobs", {"kind": kind, **wish}, self._token())

    def follow(self, job: dict[str, Any], reporter: Reporter) -> dict[str, Any]:
        """Waits for the end of a job, telling its stages; Ctrl-C stops it there.

        Raises:
            Interrupted: stopped by Ctrl-C; the axis is at rest.
        """
        stage, waits = "", ""
        try:
            while job["state"] != "done":
                time.sleep(POLL)
                job = self._ask("GET", f"/api/jobs/{job['id']}")
                if job.get("waits_for") and job["waits_for"] != waits:
                    waits = job["waits_for"]
                    reporter.say(f"the service waits: {waits}")
                if job.get("stage") and job["stage"] != stage:
                    stage = job["stage"]
                    reporter.stage(stage, 30.0)
                reporter.progress(job.get("fraction") or 0.0)
        except KeyboardInterrupt:
            self._ask("POST", f"/api/jobs/{job['id']}/stop", {}, self._token())
            raise Interrupted("stopped; the service brings the axis to rest and takes power off") from None
        return job

    def history(self, axis: str) -> dict[str, Any]:
        """The history of an axis."""
        return self._ask("GET", f"/api/axes/{axis}/history?checks=1000")

    def _token(self) -> str:
        token = os.environ.get("AUTOTUNE_TOKEN", "")
        if token or self._token_file is None:
            return token
        try:
            return self._token_file.read_text(encoding="utf-8").strip()
        except OSError as error:
            raise ConfigurationError(
                f"the service at {self.address} owns this axis, and its token in {self._token_file} cannot be read "
                f"({error.strerror}); set the environment variable AUTOTUNE_TOKEN, or ask who runs the service"
            ) from None

    def _ask(
        self, method: str, path: str, content: dict[str, Any] | None = None, token: str = ""
    ) -> dict[str, Any]:
        headers = {"Content-Type": "application/json"}
        if token:
            headers["Authorization"] = f"Bearer {token}"
        body = json.dumps(content).encode() if content is not None else None
        request = urllib.request.Request(self.address + path, body, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=SECONDS) as answer:
                found: dict[str, Any] = json.loads(answer.read())
                return found
        except urllib.error.HTTPError as error:
            raise ConfigurationError(f"the service at {self.address} refuses: {_detail(error)}") from None
        except (urllib.error.URLError, http.client.HTTPException, OSError, ValueError) as error:
            raise LinkError(
                f"the service at {self.address} owns this axis but does not answer ({error}); look at it "
                "('systemctl status autotune'), or stop it"
            ) from None


def _detail(error: urllib.error.HTTPError) -> str:
    try:
        return str(json.loads(error.read())["detail"])
    except (ValueError, KeyError, OSError):
        return f"HTTP {error.code}"
