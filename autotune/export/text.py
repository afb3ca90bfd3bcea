"""Text of generated files: templates, plain ASCII, headers that say what is in and what is left out."""

from __future__ import annotations

import textwrap
import unicodedata
from collections.abc import Sequence
from importlib.resources import files
from string import Template

from autotune import __version__
from autotune.export.request import Lost, Request, lost_in_words, played

_PLAIN = {"²": "^2", "µ": "u", "·": "*", "≥": ">=", "–": "-", "−": "-", "σ": "sigma", "°": "deg"}
WIDTH = 100


def filled(template: str, /, **values: object) -> str:
    """A template of this package with its places filled; plain ASCII."""
    text = (files("autotune.export") / "templates" / f"{template}.in").read_text(encoding="utf-8")
    return ascii_only(Template(text).substitute({key: str(value) for key, value in values.items()}))


def ascii_only(text: str) -> str:
    """The text for tools that know nothing else; what has no plain form becomes a question mark."""
    for letter, plain in _PLAIN.items():
        text = text.replace(letter, plain)
    return unicodedata.normalize("NFKD", text).encode("ascii", "replace").decode("ascii")


def headline(request: Request) -> str:
    """The first line of a generated file."""
    return f"Feedforward of {_named(request)}, made by autotune {__version__}. Generated: export again, do not edit."


def about(
    request: Request, lost: Sequence[Lost], prefix: str, extra: Sequence[str] = (), kept: str = ""
) -> str:
    """What is in (`kept`; by default all that can be fed forward) and what is left out, as lines of a comment."""
    inside = kept or ", ".join(["inertia", "friction with presliding", *played(request)])
    sentences = [
        f"Inside: {inside}.",
        *(f"{sentence[0].upper()}{sentence[1:]}." for sentence in lost_in_words(request, tuple(lost))),
        *(f"Note: {warning}." for warning in request.warnings),
        *extra,
    ]
    lines = [line for sentence in sentences for line in textwrap.wrap(_harmless(sentence), WIDTH)]
    return "\n".join(f"{prefix}{line}" for line in lines)


def _named(request: Request) -> str:
    name = request.model.axis or "an axis"
    return _harmless(f"{name} ({request.source})")


_PARTED = ("*/", "/*", "*)", "(*", "--", "??")


def _harmless(text: str) -> str:
    """A file's or an axis's name must not end the comment or the string that it stands in."""
    kept = "".join(letter if letter.isprintable() else "?" for letter in text)
    for pair in _PARTED:
        while pair in kept:
            kept = kept.replace(pair, f"{pair[0]} {pair[1]}")
    return kept.replace("\\", "/").replace('"', "'")
