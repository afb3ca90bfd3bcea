"""The command line's way to a service that owns an axis: start a job there, follow it, fetch what it left.

The address comes from the service file. Before the token is sent, whoever listens there must prove that it knows
it (`guard`), on the same connection. Nothing here follows a redirection or uses a proxy.
"""

from __future__ import annotations

import http.client
import json
import secrets
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any, BinaryIO
from urllib.parse import urlsplit

from autotune.core.errors import AutotuneError, ConfigurationError, Interrupted, LinkError
from autotune.core.text import clean, clean_line
from autotune.service.access import PROOF, proof_of
from autotune.service.service_file import address_of, known_token, token_file, users_token_file
from autotune.service.settings import Configuration
from autotune.tuning.progress import Reporter

SECONDS = 10.0
POLL = 0.3
PATIENCE = 60.0
"""How long a service may be silent before it counts as lost [s]; a restart takes less."""
STOP_SECONDS = 60.0
"""How long a stopped job is waited for [s]: the service ends one that does not come to rest in 30."""
MOST_BYTES = 64_000_000


class NoService(LinkError):
    """Nobody listens where the service should be."""


class ServiceClient:
    """Speaks to the service of a configuration."""

    def __init__(self, configuration: Configuration, poll: float = POLL, patience: float = PATIENCE) -> None:
        self._configuration = configuration
        self.address = address_of(configuration)
        self._token = known_token(configuration)
        self._poll, self._patience = poll, patience

    def start(self, axis: str, kind: str, **wish: Any) -> dict[str, Any]:
        """Starts a job.

        Raises:
            ConfigurationError: refused; says why. LinkError: the service does not answer.
            Interrupted: by Ctrl-C before the service has answered.
        """
        try:
            return self._ask("POST", f"/api/axes/{axis}/jobs", {"kind": kind, **wish})
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted before the service at {self.address} had answered; the {kind} may have been queued: "
                f"look at {self.address}/api/jobs?axis={axis} and stop it there"
            ) from None

    def holds(self, axis: str) -> bool:
        """The service has the axis's link.

        Raises:
            NoService: nobody listens there.
        """
        return bool(self._ask("GET", f"/api/axes/{axis}").get("held"))

    def follow(self, job: dict[str, Any], reporter: Reporter) -> dict[str, Any]:
        """Waits for the end of a job, telling its stages; Ctrl-C stops it there.

        Raises:
            Interrupted: stopped by Ctrl-C; says how the job ended, or that it could not be stopped.
            LinkError: the service is silent for too long; says how the job was when it was last seen.
        """
        told: dict[str, str] = {}
        try:
            while job["state"] != "done":
                time.sleep(self._poll)
                job = self._look(job)
                _report(job, reporter, told)
        except KeyboardInterrupt:
            raise Interrupted(self._stop(job)) from None
        return job

    def result(self, job: dict[str, Any]) -> dict[str, Any]:
        """What a check or run has found."""
        return self._ask("GET", f"/api/jobs/{job['id']}/result")

    def proposal_of(self, job: dict[str, Any]) -> dict[str, Any] | None:
        """What a run has proved and a person has to approve; None where there is nothing."""
        waiting = self._ask_list("GET", "/api/proposals")
        return next((one for one in waiting if one["run"] == job["run"] and one["state"] == "open"), None)

    def approve(self, proposal: dict[str, Any]) -> dict[str, Any]:
        """A person has approved; the job that commits."""
        return self._ask("POST", f"/api/proposals/{proposal['id']}/approve", {})

    def history(self, axis: str) -> dict[str, Any]:
        """The history of an axis."""
        return self._ask("GET", f"/api/axes/{axis}/history?checks=1000")

    @contextmanager
    def live(self, axis: str) -> Iterator[BinaryIO]:
        """The live traces of an axis as they come (`live_hub`).

        Raises:
            ConfigurationError: refused; says why. LinkError: the service does not answer.
        """
        with self._reached("is silent"), self._connected() as (connection, headers):
            connection.request("GET", f"/api/axes/{axis}/live", headers=headers)
            answer = connection.getresponse()
            if answer.status >= 400:
                raise self._refusal(answer.status, _json_or_none(answer.read(4096)))
            yield answer

    def _look(self, job: dict[str, Any]) -> dict[str, Any]:
        """The job as it is now; a service that is restarted is waited for."""
        end = time.monotonic() + self._patience
        while True:
            try:
                return self._ask("GET", f"/api/jobs/{job['id']}")
            except AutotuneError as error:
                if not isinstance(error, LinkError) or time.monotonic() >= end:
                    raise LinkError(f"{error}. {_last_seen(job)}") from None
            time.sleep(self._poll)

    def _stop(self, job: dict[str, Any]) -> str:
        """Stops a job and waits for its end; how that went, in words."""
        try:
            job = self._told_to_stop(job)
            end = time.monotonic() + STOP_SECONDS
            while job["state"] != "done" and time.monotonic() < end:
                time.sleep(self._poll)
                job = self._ask("GET", f"/api/jobs/{job['id']}")
        except AutotuneError as error:
            return _not_stopped(job, str(error))
        except KeyboardInterrupt:
            return _not_stopped(job, "interrupted again")
        if job["state"] != "done":
            return _not_stopped(job, f"it has not ended within {STOP_SECONDS:.0f} s")
        return f"the {job['kind']} was stopped at the service: {job.get('sentence') or job.get('outcome')}"

    def _told_to_stop(self, job: dict[str, Any]) -> dict[str, Any]:
        try:
            return self._ask("POST", f"/api/jobs/{job['id']}/stop", {})
        except ConfigurationError:  # refused; where it has ended meanwhile that is as good
            now = self._ask("GET", f"/api/jobs/{job['id']}")
            if now["state"] != "done":
                raise
            return now

    def _ask(self, method: str, path: str, content: dict[str, Any] | None = None) -> dict[str, Any]:
        found = self._answer(method, path, content)
        if not isinstance(found, dict):
            raise self._garbled("not an object")
        return found

    def _ask_list(self, method: str, path: str) -> list[dict[str, Any]]:
        found = self._answer(method, path, None)
        if not isinstance(found, list):
            raise self._garbled("not a list")
        return found

    def _answer(self, method: str, path: str, content: dict[str, Any] | None) -> Any:
        try:
            with self._reached("does not answer", "; look at it ('systemctl status autotune'), or stop it"):
                status, text = self._exchange(method, path, content)
            found = _cleaned(json.loads(text))
        except AutotuneError:
            raise
        except (ValueError, RecursionError):
            raise self._garbled("no JSON") from None
        if status >= 400:
            raise self._refusal(status, found)
        return found

    @contextmanager
    def _reached(self, fault: str, advice: str = "") -> Iterator[None]:
        """The block speaks to the service; what comes between is an error of the link, with what it is said to be."""
        try:
            yield
        except AutotuneError:
            raise
        except ConnectionRefusedError:
            raise NoService(
                f"no service listens at {self.address}; look at it ('systemctl status autotune')"
            ) from None
        except (http.client.HTTPException, OSError) as error:
            why = clean_line(str(error)) or type(error).__name__
            raise LinkError(f"the service at {self.address} {fault} ({why}){advice}") from None

    def _exchange(self, method: str, path: str, content: dict[str, Any] | None) -> tuple[int, bytes]:
        """One request and its answer, on the connection on which the other end has proved itself.

        Raises:
            ConfigurationError: what listens there does not know the token, which goes to nobody else.
        """
        with self._connected() as (connection, headers):
            body = json.dumps(content).encode() if content is not None else None
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            return answer.status, answer.read(MOST_BYTES)

    @contextmanager
    def _connected(self) -> Iterator[tuple[http.client.HTTPConnection, dict[str, str]]]:
        """A connection whose other end has proved itself, and the headers for it."""
        parts = urlsplit(self.address)
        connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=SECONDS)
        headers = {"Content-Type": "application/json"}
        with closing(connection):
            connection.connect()
            connection.auto_open = 0  # one that is closed and opened again may have another end
            if self._token:
                self._demand_proof(connection, parts.port or 80)
                headers["Authorization"] = f"Bearer {self._token}"
            yield connection, headers

    def _demand_proof(self, connection: http.client.HTTPConnection, port: int) -> None:
        nonce = secrets.token_hex(32)
        connection.request("GET", PROOF, headers={"Autotune-Nonce": nonce})
        if not _proves(connection.getresponse().read(4096), proof_of(self._token, port, nonce)):
            raise ConfigurationError(
                f"what listens at {self.address} does not know the token of the service of "
                f"{self._configuration.file}; nothing was sent to it. Look who it is (ss -ltnp), or whether the "
                "token is that of another service"
            )

    def _refusal(self, status: int, found: Any) -> AutotuneError:
        detail = clean_line(str(found.get("detail", "")) if isinstance(found, dict) else "", 500)
        if status >= 500:
            return LinkError(f"the service at {self.address} cannot answer now: {detail or f'HTTP {status}'}")
        if status == 401:
            detail += (
                f"; its token is in {token_file(self._configuration.state)} for who may read it, else set "
                f"AUTOTUNE_TOKEN, or write it to {users_token_file()}"
            )
        return ConfigurationError(f"the service at {self.address} refuses: {detail or f'HTTP {status}'}")

    def _garbled(self, what: str) -> LinkError:
        return LinkError(f"the service at {self.address} answers what is {what}; look at what listens there")


def _json_or_none(text: bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _proves(answer: bytes, expected: str) -> bool:
    try:
        given = json.loads(answer)["proof"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return False
    return isinstance(given, str) and secrets.compare_digest(given.encode(), expected.encode())


def _cleaned(value: Any) -> Any:
    """The same with every text fit for a terminal."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, list):
        return [_cleaned(one) for one in value]
    if isinstance(value, dict):
        return {clean(name): _cleaned(one) for name, one in value.items()}
    return value


def _report(job: dict[str, Any], reporter: Reporter, told: dict[str, str]) -> None:
    """Says what is new about a job."""
    if job.get("waits_for") and job["waits_for"] != told.get("waits_for"):
        told["waits_for"] = job["waits_for"]
        reporter.say(f"the service waits: {clean_line(job['waits_for'])}")
    if job.get("stage") and job["stage"] != told.get("stage"):
        told["stage"] = job["stage"]
        reporter.stage(clean_line(job["stage"], 40), 30.0)
    reporter.progress(job.get("fraction") or 0.0)


def _last_seen(job: dict[str, Any]) -> str:
    """What is known of a job that cannot be seen any more."""
    stage = f", stage {job['stage']}" if job.get("stage") else ""
    return (
        f"The {job['kind']} (job {job['id']}) was {job['state']}{stage} when it was last seen, and goes on by itself: "
        "THE AXIS MAY MOVE. The service tells when it answers again (GET /api/jobs/ID), and its journal"
    )


def _not_stopped(job: dict[str, Any], why: str) -> str:
    return (
        f"the {job['kind']} (job {job['id']}) COULD NOT BE STOPPED: {why}. THE AXIS MAY STILL MOVE: use the emergency "
        "stop where that matters, then stop the service ('systemctl stop autotune')"
    )
