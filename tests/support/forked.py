"""Programs of ours in processes of their own, forked from one in which everything is imported already.

A simulated drive costs a second of processor time before it can be opened, a run or a service two: nearly all of it
imports and compiled code that is loaded. The tests that need such a program beside them, or kill it, start it here, as
they would with `subprocess.Popen`. How a program starts from nothing is seen by those that call `sys.executable`.
"""

from __future__ import annotations

import atexit
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import IO, Any

from tests.support.forking import LARGEST

ROOT = Path(__file__).resolve().parents[2]
PIPE, DEVNULL, STDOUT = subprocess.PIPE, subprocess.DEVNULL, subprocess.STDOUT
NEEDED = {
    "serve": ["autotune.cli.serve", "autotune.service.daemon"],
    "workbench": ["autotune.cli.workbench", "autotune.service.workbench_page"],
}
"""What else is imported before the first program of this command begins."""
AUTOTUNE, SIMULATOR = "autotune.cli.main", "autotune_sim.__main__"


class _Source:
    """The process that forks, and what it has told of those that have ended."""

    def __init__(self) -> None:
        self._line, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._ended: dict[int, int] = {}
        path = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
        environment = os.environ | {"PYTHONPATH": path}
        with there:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.support.forking", str(there.fileno())],
                pass_fds=(there.fileno(),), stdin=DEVNULL, env=environment,
            )  # fmt: skip
        atexit.register(self.close)

    def close(self) -> None:
        self._line.close()
        self._process.wait()

    def begin(self, request: Mapping[str, Any], files: Sequence[int]) -> int:
        """The number of the new process."""
        socket.send_fds(self._line, [json.dumps(request).encode()], files)
        while True:
            heard = self._hear()
            if "begun" in heard:
                return heard["begun"]

    def ended(self, process: int, seconds: float) -> int | None:
        """How it ended, if it does within this time."""
        end = time.monotonic() + seconds
        while process not in self._ended:
            left = max(end - time.monotonic(), 0.0)
            if not select.select([self._line], [], [], left)[0]:
                return None
            self._hear()
        return self._ended[process]

    def _hear(self) -> dict[str, int]:
        text = self._line.recv(LARGEST)
        if not text:
            raise RuntimeError("the process that programs are forked from is gone; what it said is above")
        heard: dict[str, int] = json.loads(text)
        if "ended" in heard:
            self._ended[heard["ended"]] = heard["code"]
        return heard


@cache
def _source() -> _Source:
    return _Source()


class Program:
    """`python -m PROGRAM ARGUMENTS` with the attributes of a `subprocess.Popen` that tests use."""

    def __init__(
        self,
        program: str,
        *arguments: str,
        stdin: int | IO[Any] = DEVNULL,
        stdout: int | IO[Any] = PIPE,
        stderr: int | IO[Any] | None = None,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
    ) -> None:
        self.args, self.returncode = (program, *arguments), None
        self.stdin: IO[str] | None = None
        self.stdout: IO[str] | None = None
        self.stderr: IO[str] | None = None
        request = {
            "program": program,
            "arguments": arguments,
            "imports": NEEDED.get(arguments[0], []),
            "folder": str(cwd or Path.cwd()),
            "environment": dict(os.environ if env is None else env),
        }
        theirs = [self._end(0, stdin), self._end(1, stdout)]
        theirs.append(
            os.dup(theirs[1]) if stderr is STDOUT else self._end(2, 2 if stderr is None else stderr)
        )
        try:
            self.pid = _source().begin(request, theirs)
        finally:
            for file in theirs:
                os.close(file)

    returncode: int | None

    def _end(self, place: int, wanted: int | IO[Any]) -> int:
        """The program's end of what was asked for; ours, of a pipe, becomes an attribute."""
        if wanted == PIPE:
            reading, writing = os.pipe()
            if place == 0:
                self.stdin = os.fdopen(writing, "w")
                return reading
            setattr(self, ("", "stdout", "stderr")[place], os.fdopen(reading, "r"))
            return writing
        if wanted == DEVNULL:
            return os.open(os.devnull, os.O_RDWR)
        return os.dup(wanted if isinstance(wanted, int) else wanted.fileno())

    def poll(self) -> int | None:
        """How it ended; None while it runs."""
        if self.returncode is None:
            self.returncode = _source().ended(self.pid, 0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            self.returncode = _source().ended(self.pid, 1e6 if timeout is None else timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return self.returncode

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """What it says until it has ended; nothing where that was read before."""
        if self.stdin is not None:
            self.stdin.close()
        texts = ["", ""]

        def read(place: int, stream: IO[str]) -> None:
            with stream:
                texts[place] = stream.read()

        both = enumerate((self.stdout, self.stderr))
        streams = [(place, stream) for place, stream in both if stream is not None and not stream.closed]
        readers = [threading.Thread(target=read, args=stream, daemon=True) for stream in streams]
        for reader in readers:
            reader.start()
        self.wait(timeout)
        for reader in readers:
            reader.join()
        return texts[0], texts[1]

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)
