"""Jobs of the workbench: one at a time, in a process that stands behind everything else on this host."""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import sys
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import IO, Any

from autotune.core.errors import ConfigurationError

MOST_JOBS = 50
MOST_WAITING = 8
MOST_ANSWERS = 30_000_000
"""Characters of all answers that are kept; the oldest go first, with their jobs: a page reads its own at once."""
_ANSWER = '{"answer": '
LONGEST = 1800.0
"""s, of one computation: a diagnosis of hours of data takes minutes."""


@dataclass
class Job:
    """One computation: `state` is queued, running, done, failed or stopped; `answer`: as JSON."""

    id: str
    wish: dict[str, Any]
    state: str = "queued"
    progress: list[str] = field(default_factory=list)
    answer: str | None = None
    error: str | None = None
    began: float = 0.0
    ended: float = 0.0

    def text(self) -> str:
        """As a page is told it, JSON; an answer of a million numbers is passed on as it came."""
        return f'{json.dumps(self.view())[:-1]}, "answer": {self.answer or "null"}}}'

    def view(self) -> dict[str, Any]:
        """How it is, without its answer."""
        end = self.ended or time.monotonic()
        return {
            "id": self.id,
            "kind": self.wish["kind"],
            "state": self.state,
            "steps": len(self.progress),
            "message": self.progress[-1] if self.progress else "",
            "seconds": round(end - self.began, 1) if self.began else 0.0,
            "error": self.error,
        }


class Engine:
    """Takes jobs, and does them one after the other."""

    def __init__(self) -> None:
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._waiting: list[Job] = []
        self._change = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, daemon=True, name="workbench")

    def submit(self, wish: dict[str, Any]) -> Job:
        """A new job at the end of the queue.

        Raises:
            ConfigurationError: too many wait already.
        """
        with self._change:
            if len(self._waiting) >= MOST_WAITING:
                raise ConfigurationError(f"{MOST_WAITING} computations wait already; wait, or stop some")
            job = Job(secrets.token_hex(16), wish)
            self._jobs[job.id] = job
            self._waiting.append(job)
            if self._thread.ident is None:
                self._thread.start()
            while len(self._jobs) > MOST_JOBS:
                self._jobs.popitem(last=False)
            self._change.notify_all()
        return job

    def get(self, id: str) -> Job:
        """Raises KeyError: it is not, or no longer, known."""
        return self._jobs[id]

    def stop(self, id: str) -> Job:
        """Ends a job, whatever it is doing."""
        with self._change:
            job = self._jobs[id]
            if job in self._waiting:
                self._waiting.remove(job)
                job.state = "stopped"
            elif job.state == "running":
                job.state = "stopped"
                self._kill()
        return job

    def close(self) -> None:
        """Ends everything."""
        with self._change:
            self._closed = True
            self._waiting.clear()
            self._kill()
            self._change.notify_all()
        if self._thread.ident is not None:
            self._thread.join(5.0)

    def _work(self) -> None:
        while True:
            with self._change:
                while not self._waiting and not self._closed:
                    self._change.wait()
                if self._closed:
                    self._let_go()
                    return
                job = self._waiting.pop(0)
                job.state, job.began = "running", time.monotonic()
            try:
                self._do(job)
            except (OSError, ValueError) as error:
                self._failed(job, f"the computation ended unexpectedly ({error}); ask again")
            job.ended = time.monotonic()

    def _do(self, job: Job) -> None:
        given, answers = self._pipes()
        given.write(json.dumps(job.wish) + "\n")
        given.flush()
        limit = threading.Timer(LONGEST, self._kill)
        limit.daemon = True
        limit.start()
        try:
            for line in answers:
                if line.startswith(_ANSWER):
                    self._done(job, line[len(_ANSWER) :].rstrip()[:-1])
                    return
                message = json.loads(line)
                if "error" in message:
                    self._failed(job, message["error"])
                    return
                job.progress.append(message["progress"])
        finally:
            limit.cancel()
        self._let_go()
        self._failed(
            job, "the computation ended before it had a result: out of memory or time? Ask again with less"
        )

    def _done(self, job: Job, answer: str) -> None:
        with self._change:
            if job.state != "running":
                return
            job.answer, job.state = answer, "done"
            kept = sum(len(one.answer or "") for one in self._jobs.values())
            for one in list(self._jobs.values()):
                if kept > MOST_ANSWERS and one.answer is not None and one is not job:
                    kept -= len(one.answer)
                    del self._jobs[one.id]

    def _failed(self, job: Job, sentence: str) -> None:
        with self._change:
            if job.state == "running":
                job.state, job.error = "failed", sentence

    def _pipes(self) -> tuple[IO[str], IO[str]]:
        if self._process is not None and self._process.poll() is not None:
            self._let_go()
        process = self._process
        if process is None:
            command = [sys.executable, "-m", "autotune.service.background", "-m", "autotune.workbench.worker"]
            process = self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
                env={**os.environ, "PYTHONSAFEPATH": "1"},
            )  # fmt: skip
        if process.stdin is None or process.stdout is None:
            raise OSError("no pipes")
        return process.stdin, process.stdout

    def _kill(self) -> None:
        """Ends the process; the thread that reads from it sees the end, and lets go of it."""
        process = self._process
        if process is not None and process.poll() is None:
            process.kill()

    def _let_go(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()
