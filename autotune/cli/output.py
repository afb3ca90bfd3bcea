"""What reaches the terminal: results on standard output, everything else on standard error.

Whatever is printed here may quote a file or an answer of somebody else, so control characters are replaced.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from autotune.core.text import clean
from autotune.tuning.files import finite


def complain(sentence: str, code: int) -> int:
    """Prints one error for the person at the machine; returns the exit code."""
    sys.stderr.write(f"autotune: {clean(sentence)}\n")
    return code


def say(sentence: str) -> None:
    """Prints a line that is not part of the result."""
    sys.stderr.write(clean(sentence) + "\n")
    sys.stderr.flush()


def answer(text: str) -> None:
    """Prints a line of the result."""
    sys.stdout.write(clean(text) + "\n")
    sys.stdout.flush()


def answer_json(content: Mapping[str, Any]) -> None:
    """Prints the one JSON object of `--json`; what is not a finite number becomes null."""
    answer(json.dumps(finite(content), indent=2, allow_nan=False))
