"""Compare and diagnose for the API: of `autotune`, in a process of its own (`study`), one at a time.

What was found is kept for as long as recording and model are the files they were: a run under way writes its model
anew.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from autotune.service.launcher import environment

SECONDS = 120.0
MOST_KEPT = 100
_one_at_a_time = threading.Lock()
_Stamp = tuple[Path, int, int] | None
_kept: dict[tuple[str, _Stamp, _Stamp], Study] = {}


@dataclass(frozen=True, slots=True)
class Study:
    """`status` as HTTP has it; `content` where it is 200, else `detail` in words."""

    status: int
    detail: str = ""
    content: dict[str, Any] = field(default_factory=dict)


def study(what: str, recording: Path, model: Path) -> Study:
    """What `compare` or `diagnose` finds."""
    key = what, _stamp(recording), _stamp(model)
    known = _kept.get(key)
    if known is not None:
        return known
    if not _one_at_a_time.acquire(blocking=False):
        return Study(503, "another recording is being studied; ask again in a moment")
    try:
        done = _run(["-m", "autotune.service.study", what, str(recording), str(model)])
    except subprocess.TimeoutExpired:
        return Study(504, f"'{what}' took longer than {SECONDS:.0f} s")
    finally:
        _one_at_a_time.release()
    found = _found(what, done)
    if found.status == 200 and None not in key:
        if len(_kept) >= MOST_KEPT:
            _kept.clear()
        _kept[key] = found
    return found


def _stamp(file: Path) -> _Stamp:
    """A file as it is now; None where it cannot be looked at."""
    try:
        state = file.stat()
    except OSError:
        return None
    return file, state.st_mtime_ns, state.st_size


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Behind everything else, and ended when its time is over."""
    return subprocess.run(
        [sys.executable, "-m", "autotune.service.background", *command],
        capture_output=True, text=True, timeout=SECONDS, check=False, stdin=subprocess.DEVNULL,
        env=environment(), start_new_session=True,
    )  # fmt: skip


def _found(what: str, done: subprocess.CompletedProcess[str]) -> Study:
    if done.returncode != 0:
        return Study(409, done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"'{what}' failed")
    try:
        content = json.loads(done.stdout)
    except ValueError:
        return Study(409, f"'{what}' gave no result")
    return Study(200, content=content)
