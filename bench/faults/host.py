"""What happens to the program and its machine while it runs in one process: signals, disks, clocks.

All of it happens in the forked child, after the drive was opened: the plant's log and the drive's memory are
not the program's, and are left alone.
"""

from __future__ import annotations

import errno
import os
import resource
import signal
import sys
import time
from collections.abc import Callable
from datetime import datetime as true_datetime
from datetime import timedelta
from pathlib import Path
from typing import Any

import autotune_sim.inprocess as inprocess
from autotune.core.drive import Command, Sample
from bench.faults.cases import Case

TORN = 71  # exit code of a run that was cut off in the middle of a write
_SPARED = ("truth", "mem", ".mem", "out.txt")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_SHIFTS = {"back-a-day": timedelta(days=-1), "forward-a-year": timedelta(days=365)}
_SMALLEST = 16_384  # bytes


def prepare(case: Case, folder: Path) -> None:
    """Arranges in this process what the case does to its host."""
    if case.host is None:
        return
    what, which, when = case.host
    if what == "signal":
        _on_opening(lambda drive: _at_time(drive, when, lambda: _raise_signals(which)))
    elif what == "clock":
        _on_opening(lambda drive: _at_time(drive, when, lambda: _shift_clock(which)))
    elif which == "small-files":
        _on_opening(lambda drive: _limit_files(round(when)))
    else:
        _on_opening(lambda drive: sys.addaudithook(_Disk(folder, which, round(when))))


def _on_opening(act: Callable[[Any], None]) -> None:
    """Acts as soon as the simulated drive is open."""
    opener = inprocess.open_sim

    def opened(*arguments: Any, **options: Any) -> Any:
        drive = opener(*arguments, **options)
        act(drive)
        return drive

    inprocess.open_sim = opened


def _at_time(drive: Any, when: float, act: Callable[[], None]) -> None:
    """Acts once the drive has played `when` seconds; tells the log."""
    step = drive.step
    waiting = True

    def stepped(command: Command) -> Sample:
        nonlocal waiting
        sample: Sample = step(command)
        if waiting and sample.time >= when:
            waiting = False
            drive.servo.truth.note("fault put in", sample.time, name="host")
            act()
        return sample

    drive.step = stepped


def _raise_signals(which: str) -> None:
    number = getattr(signal, f"SIG{which.partition('-')[0]}")
    os.kill(os.getpid(), number)
    if which.endswith("twice"):
        os.kill(os.getpid(), number)


def _shift_clock(which: str) -> None:
    """The wall clock jumps; the monotonic clock does not."""
    shift = _SHIFTS.get(which, true_datetime(1970, 1, 1, 0, 10) - true_datetime.now())
    true_time = time.time

    class Shifted(true_datetime):
        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return true_datetime.now(tz) + shift

    time.time = lambda: true_time() + shift.total_seconds()
    for module in [module for name, module in list(sys.modules.items()) if name.startswith("autotune")]:
        if getattr(module, "datetime", None) is true_datetime:
            module.datetime = Shifted  # type: ignore[attr-defined]


def _limit_files(size: int) -> None:
    """No file may become larger than that, as on a disk that fills up in the middle of one."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    most = _SMALLEST + size * 4096
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


class _Disk:
    """An audit hook: from the n-th write on, files of the case's folder cannot be written."""

    def __init__(self, folder: Path, which: str, after: int) -> None:
        self._folder = f"{folder}/"
        self._which = which
        self._left = after

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, mode, flags = arguments
            writing = isinstance(mode, str) and any(letter in mode for letter in "wax+")
            writing = writing or (isinstance(flags, int) and bool(flags & _WRITING))
            if not writing:
                return
        elif event in ("os.mkdir", "os.rename", "os.remove"):
            path = arguments[0]
        else:
            return
        if self._ours(path):
            self._count(str(path))

    def _ours(self, path: Any) -> bool:
        text = os.fsdecode(path) if isinstance(path, str | bytes | os.PathLike) else ""
        return text.startswith(self._folder) and not text[len(self._folder) :].startswith(_SPARED)

    def _count(self, path: str) -> None:
        self._left -= 1
        if self._left > 0:
            return
        if self._which == "torn":
            os._exit(TORN)
        code = errno.ENOSPC if self._which == "full" else errno.EROFS
        raise OSError(code, os.strerror(code), path)
