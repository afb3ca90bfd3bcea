"""`autotune init`: finds adapters and drives, and writes an axis file with the questions that a person must answer."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.output import answer, say
from autotune.core.errors import ConfigurationError
from autotune.core.text import clean_line

if TYPE_CHECKING:
    from autotune_drivers.seen import Adapter, Seen

_EXAMPLES = {
    "canopen+slcan": "canopen+slcan://{0}?bitrate=1000000",
    "canopen+socketcan": "canopen+socketcan://{0}",
    "moteus+serial": "moteus+serial://{0}",
}


def init(
    at: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="Where to look, such as canopen+slcan:///dev/ttyACM0?bitrate=1000000; every node is asked, or "
            "the one that the link names. Without it, what is plugged in is listed.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="AXIS.toml", help="The axis file to write.")] = Path(
        "axis.toml"
    ),
) -> None:
    """Find the drive, read what it says of itself, and write an axis file; nothing moves or is written to it."""
    from autotune_drivers.seen import adapters, look

    if out.exists():
        raise ConfigurationError(f"{out} is there already; name another file with --out")
    if not out.resolve().parent.is_dir():
        raise ConfigurationError(
            f"there is no folder {out.resolve().parent} for {out.name}; make it, or name another --out"
        )
    link = at or _chosen_adapter(adapters())
    seen = _chosen_drive(look(link, out.resolve().parent))
    _write(out, seen)


def _chosen_adapter(found: list[Adapter]) -> str:
    """The link of the one adapter that needs nothing more to be said."""
    if not found:
        raise ConfigurationError(
            "no USB serial port is plugged in and this host has no CAN interface; plug the adapter in, or name where "
            "to look: autotune init --at 'canopen+slcan:///dev/ttyACM0?bitrate=1000000'"
        )
    lines = []
    for one in found:
        schemes = [one.scheme] if one.scheme else ["canopen+slcan", "moteus+serial"]
        ways = " or ".join(f"--at '{_EXAMPLES[scheme].format(one.name)}'" for scheme in schemes)
        lines.append(f"{one.name} ({clean_line(one.about, 80)}): {ways}")
    if len(found) == 1 and found[0].scheme in ("canopen+socketcan", "moteus+serial"):
        say(f"looking at {lines[0]}")
        return _EXAMPLES[str(found[0].scheme)].format(found[0].name)
    raise ConfigurationError(
        "say where to look; a wrong bit rate or protocol disturbs whoever else is on the line:\n  "
        + "\n  ".join(lines)
    )


def _chosen_drive(found: list[Seen]) -> Seen:
    if len(found) == 1:
        return found[0]
    lines = "\n  ".join(f"--at '{one.link}' ({_who(one)})" for one in found)
    raise ConfigurationError(f"{len(found)} drives answer; say which one is meant:\n  {lines}")


def _who(seen: Seen) -> str:
    name = clean_line(str(seen.identity.get("name") or "a drive without a name"), 60)
    firmware = clean_line(str(seen.identity.get("firmware", "")), 30)
    return f"{name}, firmware {firmware}" if firmware else name


def _write(out: Path, seen: Seen) -> None:
    from autotune.cli.axis_draft import Draft, ask_all, text_of

    say(f"{_who(seen)} answers at {seen.link}")
    draft = Draft.of(_name(out), seen)
    if sys.stdin.isatty():
        say("Enter leaves a question open; it then stands in the file.")
        ask_all(draft, _ask, say)
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text_of(draft))
    except FileExistsError:
        raise ConfigurationError(f"{out} is there already; name another file with --out") from None
    left = [question.name for question in draft.open()]
    if left:
        answer(
            f"{out} has {len(left)} open questions: {', '.join(left)}. Answer them there, then: autotune link {out}"
        )
    else:
        answer(f"{out} is complete. Next: autotune link {out}, which holds still, then autotune check {out}")


def _ask(words: str) -> str:
    sys.stderr.write(words)
    sys.stderr.flush()
    line = sys.stdin.readline()
    return line if line else ""


def _name(out: Path) -> str:
    """The axis is called as its file, as far as a name allows."""
    name = re.sub(r"[^a-z0-9]+", "-", out.stem.lower()).strip("-")[:40]
    return name or "axis"
