"""Text that others wrote, made fit for a terminal and a log: no escape sequence gets through.

What is in files, on the wire or in an answer of another program may hold control characters (ECMA-48, C0 and
C1) that move the cursor, recolour or rename the window, or marks that turn the direction of writing (UAX #9).
"""

from __future__ import annotations

import re

_HIDDEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]"
)
SHOWN = "\ufffd"


def clean(text: str) -> str:
    """The same text with everything that is not seen replaced; line feeds and tabs stay."""
    return _HIDDEN.sub(SHOWN, text)


def clean_line(text: str, most: int = 200) -> str:
    """One line of at most `most` characters."""
    line = " ".join(clean(text).split())
    return line if len(line) <= most else line[: most - 1] + "…"
