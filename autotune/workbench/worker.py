"""Computes for the workbench in a process of its own: one request a line in, progress and one answer a line out.

    python -m autotune.workbench.worker

It lives as long as its standard input, so that compiled code is loaded once; to stop a computation, end it.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any, TextIO

from autotune.core.errors import AutotuneError
from autotune.core.garbage import seldom_collected
from autotune.core.memory import large_arrays_kept
from autotune.core.text import clean
from autotune.core.threads import one_thread


def main() -> None:
    """Reads until the end of standard input; libraries that print do so on standard error."""
    one_thread()
    seldom_collected()
    large_arrays_kept()
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for line in sys.stdin:
        _say(out, _answered(json.loads(line), out))


def _answered(wish: dict[str, Any], out: TextIO) -> dict[str, Any]:
    from autotune.workbench.answers import ANSWERS

    def tell(text: str) -> None:
        _say(out, {"progress": clean(text)})

    try:
        return {"answer": ANSWERS[wish["kind"]](wish, tell)}
    except AutotuneError as error:
        return {"error": clean(str(error))}
    except MemoryError:
        return {"error": "there is not enough memory for these recordings; choose fewer or shorter ones"}
    except Exception as error:  # noqa: BLE001 - the page gets a sentence, the process lives on
        return {
            "error": f"an unexpected defect ({type(error).__name__}); please report it with the recording"
        }


def _say(out: TextIO, message: dict[str, Any]) -> None:
    out.write(json.dumps(message, allow_nan=False) + "\n")
    out.flush()


if __name__ == "__main__":
    main()
