"""What reaches the terminal: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from typing import Any


def complain(sentence: str, code: int) -> int:
    """Prints one error for the person at the machine; returns the exit code."""
    sys.stderr.write(f"autotune: {sentence}\n")
    return code


def say(sentence: str) -> None:
    """Prints a line that is not part of the result."""
    sys.stderr.write(sentence + "\n")
    sys.stderr.flush()


def answer(text: str) -> None:
    """Prints a line of the result."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def answer_json(content: Mapping[str, Any]) -> None:
    """Prints the one JSON object of `--json`; what is not a finite number becomes null."""
    answer(json.dumps(finite(content), indent=2, allow_nan=False))


def finite(value: Any) -> Any:
    """The same with nan and infinities replaced by None, recursively."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
