"""What follows from a check: a re-tune, a proposal, a word to a person. Decisions only, nothing done here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from autotune.monitoring.check_file import sound_checks
from autotune.monitoring.trend import Change, Trend, sentence, trend_over

TOLD_DAYS = 25
NOTICEABLE = 0.05
PAUSE = timedelta(hours=12)
PAUSE_AFTER_FAILURE = timedelta(days=14)
REMIND = 7


@dataclass(frozen=True, slots=True)
class Told:
    """A change that has been told already."""

    kind: str
    at: datetime
    size: float


def trend_of(contents: Sequence[dict[str, Any]]) -> Trend | None:
    """Trend of the friction level over checks, given as their JSON objects, oldest first."""
    return trend_over(sound_checks(contents))


def news(trend: Trend | None, told: Sequence[Told]) -> list[tuple[Told, str]]:
    """Changes that nobody has heard of yet, with their sentences; a trend again when it has gone on."""
    found: list[tuple[Told, str]] = []
    for change in trend.changes if trend else ():
        if abs(change.size) < NOTICEABLE or _known(change, told):
            continue
        found.append((Told(change.kind, change.at, change.size), sentence(change, "Coulomb friction")))
    return found


def _known(change: Change, told: Sequence[Told]) -> bool:
    for one in told:
        near = abs(change.at - one.at) <= timedelta(days=TOLD_DAYS if change.kind == "trend" else 4)
        same = one.kind == change.kind and (one.size > 0) == (change.size > 0)
        if near and same and (change.until is not None or abs(change.size) < abs(one.size) + 0.10):
            return True
    return False


def encode(told: Told) -> str:
    """As the key of an event."""
    return f"{told.kind}|{told.at.isoformat(timespec='seconds')}|{told.size:.4f}"


def decode(text: str) -> Told | None:
    """The reverse of `encode`; None where it is something else."""
    try:
        kind, at, size = text.rsplit(":trend:", 1)[-1].split("|")
        return Told(kind, datetime.fromisoformat(at), float(size))
    except ValueError:
        return None


def worth_a_notice(states: Sequence[str]) -> bool:
    """Of the newest check's state, given all states oldest first: when it is new, and then once a week."""
    same = 0
    for state in reversed(states):
        if state != states[-1]:
            break
        same += 1
    return same % REMIND == 1


def may_tune(last: dict[str, Any] | None, last_time: datetime | None, now: datetime) -> bool:
    """Not twice in one night, and not again and again where tuning has not helped."""
    if last is None or last_time is None:
        return True
    pause = PAUSE if last.get("outcome") == "kept" else PAUSE_AFTER_FAILURE
    return not timedelta(0) <= now - last_time < pause
