"""What reaches the terminal: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from autotune.service.files import finite


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
