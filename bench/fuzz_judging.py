"""What a kind of input is, and what is asked of everything that reads: an answer, or a refusal in words."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autotune.core.errors import AutotuneError

CORPUS = Path(__file__).resolve().parents[1] / "tests" / "fuzz" / "corpus"
LONGEST_MESSAGE = 6000
ONE_A_LINE = ("api", "link", "moteus_frame", "sdo")


class Found(Exception):
    """Something was accepted that must not be, or refused in a way that nobody can read."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of input.

    Attributes:
        share: of all inputs, relative: cheap kinds get more.
        make: an input from chance and the corpus.
        run: reads it below the folder given; see the module.
    """

    name: str
    share: float
    make: Callable[[random.Random, list[bytes]], bytes]
    run: Callable[[bytes, Path], bool]


def require(condition: bool, what: str) -> None:
    """Raises Found where something accepted is not as it must be."""
    if not condition:
        raise Found(what)


def refused(call: Callable[[], Any]) -> tuple[bool, Any]:
    """(False, result), or (True, None) where the program refused it in words that a person can read."""
    try:
        return False, call()
    except AutotuneError as error:
        text = str(error)
        require(10 < len(text) <= LONGEST_MESSAGE, f"a message of {len(text)} characters: {text[:200]!r}")
        bad = [letter for letter in text if not letter.isprintable() and letter != "\n"]
        require(not bad, f"a message with what a terminal would obey: {text[:300]!r}")
        return True, None


def corpus(kind: str) -> list[bytes]:
    """The files of a kind, in order of their names; where one line is one input, their lines."""
    files = [path.read_bytes() for path in sorted((CORPUS / kind).iterdir())]
    return [line for data in files for line in data.splitlines() if line] if kind in ONE_A_LINE else files
