"""The program in a process forked from a warm parent: its output, its end, and what is done to it.

Forked, a run of the command line costs neither a start of Python nor the loading of compiled code. The
child is a session of its own, so that whatever it starts can be ended with it.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from bench.faults.evidence import Ending

_LOOK = 0.01
_BUSY = 10  # times the patience that work may take on a loaded machine
_PROCESSOR = 240  # s of processor time: more is a program that goes round and round


@dataclass(frozen=True)
class Child:
    """A program under way; `output` is the file that it prints to."""

    pid: int
    output: Path
    began: float

    @property
    def running(self) -> bool:
        """Whether it has not ended; the end stays to be collected by `wait`."""
        return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None

    def wait(self, seconds: float, killed: bool = False, busy: Callable[[], bool] = lambda: False) -> Ending:
        """How it ended; after `seconds` without any work it is killed with all that it started.

        Args:
            killed: the case kills it.
            busy: whether others work for it, while it waits for them.
        """
        end = time.monotonic() + _BUSY * seconds
        looked, idle = time.monotonic(), 0.0
        while self.running and time.monotonic() < end and idle < seconds:
            time.sleep(_LOOK)
            before, looked = looked, time.monotonic()
            idle += (looked - before) * (self._asleep() and not busy())
        late = self.running
        if late:
            self.kill()
        _, status, usage = os.wait4(self.pid, 0)
        code = None if late else os.waitstatus_to_exitcode(status)
        text = self.output.read_text(encoding="utf-8", errors="replace")
        spent = usage.ru_utime + usage.ru_stime
        return Ending(code, text, self.began, time.monotonic(), spent, idle, killed)

    def _asleep(self) -> bool:
        """Whether it waits for something: on a loaded machine, work that takes long is no hang."""
        try:
            state = Path(f"/proc/{self.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
        except (OSError, IndexError):
            return False
        return state not in ("R", "D", "Z")

    def kill(self) -> None:
        """SIGKILL to it and to what is in its session's first group."""
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)


def start(work: Callable[[], None], output: Path) -> Child:
    """Does `work` in a forked process; what it prints goes to a file."""
    sys.stdout.flush()
    sys.stderr.flush()
    began = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _become(work, output)
    return Child(pid, output, began)


def _become(work: Callable[[], None], output: Path) -> NoReturn:
    """Never returns into the parent's code, whatever happens."""
    code = 70
    try:
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
        _redirect(output)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (_PROCESSOR, _PROCESSOR))
        work()
        code = 0
    except SystemExit as ending:
        code = ending.code if isinstance(ending.code, int) else 1
    except BaseException as error:  # noqa: BLE001 - what the program let through is a finding
        sys.stderr.write(f"Traceback (most recent call last): {type(error).__name__}: {error}\n")
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _redirect(output: Path) -> None:
    file = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for source, target in ((nothing, 0), (file, 1), (file, 2)):
        os.dup2(source, target)
    os.close(file)
    os.close(nothing)
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115 - for the process's life
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - for the process's life
    sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115


def program(arguments: Sequence[str]) -> None:
    """The command line, as a user has it."""
    from autotune.cli.main import main

    main(arguments)
