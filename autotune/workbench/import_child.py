"""Imports one foreign file for the workbench, in a process of its own: one JSON line in, one out.

    python -m autotune.workbench.import_child

A file of somebody else may take several times its size in memory, for minutes. The service that is asked by pages
beside it, and the drives that its jobs move, are not to notice: this stands behind everything else, and what takes more
than `MOST_MEMORY` ends in a sentence.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

from autotune.core.errors import AutotuneError, RecordingError
from autotune.core.text import clean
from autotune.core.threads import one_thread

MOST_MEMORY = 4_000_000_000
"""Bytes of data."""
LONGEST = 600.0
"""s."""


def import_apart(
    foreign: Path, name: str, out: Path, options: dict[str, Any], *, most_memory: int = MOST_MEMORY
) -> None:
    """Writes the recording that a file of somebody else is to `out`.

    Args:
        name: what its owner calls it, for messages.
        options: of `autotune.import_recording`; `most_memory`: bytes that it may take.

    Raises:
        RecordingError: what is wrong with it, or what has to be said about it.
    """
    wish = json.dumps({"file": str(foreign), "out": str(out), "options": options, "most_memory": most_memory})
    too_much = (
        f"it takes more than {most_memory / 1e9:g} GB of memory to be read; cut the measurement into shorter files, or "
        "record fewer samples a second"
    )
    command = [sys.executable, "-m", "autotune.service.background", "-m", __name__]
    try:
        done = subprocess.run(
            command, input=wish + "\n", capture_output=True, text=True, timeout=LONGEST, check=False,
            start_new_session=True,
        )  # fmt: skip
        error = str(json.loads(done.stdout)["error"]) if done.returncode == 0 else f"{name}: {too_much}"
    except subprocess.TimeoutExpired:
        error = f"{name} was not read within {LONGEST:g} s; cut it into shorter files"
    except (ValueError, KeyError):
        error = f"{name}: the import gave no answer; please report it with the file"
    if error:
        raise RecordingError(error.replace(str(foreign), name))


def main() -> None:
    """Answers {"error": ""}, or what is wrong; ends with another code where the memory does not suffice."""
    one_thread()
    wish = json.loads(sys.stdin.readline())
    resource.setrlimit(resource.RLIMIT_DATA, (wish["most_memory"], wish["most_memory"]))
    sys.stdout.write(json.dumps({"error": imported(wish)}) + "\n")


def imported(wish: dict[str, Any]) -> str:
    """Does it, here; what is wrong, or ""."""
    from autotune.api.files import import_recording
    from autotune.recordings.files import write_recording

    try:
        write_recording(import_recording(wish["file"], **wish["options"]), wish["out"])
    except AutotuneError as error:
        return clean(str(error))
    return ""


if __name__ == "__main__":
    main()
