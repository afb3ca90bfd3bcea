"""Compares or diagnoses in a process of its own, for the API: one JSON object on standard output.

    python -m autotune.service.study compare|diagnose RECORDING MODEL

What went wrong is one sentence on standard error, with the exit code of its kind.
"""

from __future__ import annotations

import json
import sys

from autotune.core.errors import AutotuneError
from autotune.core.garbage import seldom_collected
from autotune.core.memory import large_arrays_kept
from autotune.core.text import clean
from autotune.core.threads import one_thread


def main(what: str, recording: str, model: str) -> int:
    """Returns the exit code."""
    one_thread()
    seldom_collected()
    large_arrays_kept()
    import autotune

    try:
        found = (
            autotune.diagnose(recording, model) if what == "diagnose" else autotune.compare(recording, model)
        )
    except AutotuneError as error:
        sys.stderr.write(clean(f"autotune: {error}") + "\n")
        return error.exit_code
    sys.stdout.write(json.dumps(found.to_json(), allow_nan=False) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
