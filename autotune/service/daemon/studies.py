"""Compare and diagnose for the API: the command line's own, in a process of its own, one at a time."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SECONDS = 120.0
_one_at_a_time = threading.Lock()


@dataclass(frozen=True, slots=True)
class Study:
    """`status` as HTTP has it; `content` where it is 200, else `detail` in words."""

    status: int
    detail: str = ""
    content: dict[str, Any] = field(default_factory=dict)


def study(what: str, recording: Path, model: Path) -> Study:
    """Runs `autotune model compare|diagnose`."""
    if importlib.util.find_spec("autotune.cli.model") is None:
        return Study(501, f"this installation of autotune has no '{what}'; update it")
    if not _one_at_a_time.acquire(blocking=False):
        return Study(503, "another recording is being studied; ask again in a moment")
    try:
        done = subprocess.run(
            [sys.executable, "-m", "autotune.cli.main", "model", what, str(recording), "--model", str(model), "--json"],
            capture_output=True, text=True, timeout=SECONDS, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Study(504, f"'{what}' took longer than {SECONDS:.0f} s")
    finally:
        _one_at_a_time.release()
    if done.returncode != 0:
        return Study(409, done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"'{what}' failed")
    try:
        content = json.loads(done.stdout)
    except ValueError:
        return Study(409, f"'{what}' gave no result")
    return Study(200, content=content)
