"""`check.json`: what earlier checks left, without loading what makes them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from autotune.monitoring.drift import Before, Drift
from autotune.tuning.results import run_results

FILE_NAME = "check.json"
REMEMBERED = 400


def earlier_checks(runs: Path, axis: str) -> list[dict[str, Any]]:
    """Checks of an axis that left their result in the runs folder, oldest first."""
    found = []
    for _, content in run_results(runs, axis, FILE_NAME):
        found.append(content)
        if len(found) == REMEMBERED:
            break
    return found[::-1]


def before_of(content: dict[str, Any]) -> Before | None:
    """An earlier check from its JSON object; None where it does not say enough."""
    try:
        drift, temperature, noise = content["drift"], content["temperature"], content["position_noise"]
        committed = content["committed"] or {}
        return Before(
            content["at"],
            committed.get("accepted") or committed.get("run", ""),
            drift["change"],
            bool(drift["beyond"]),
            float(content["friction"]["level"]["value"]),
            math.nan if temperature is None else float(temperature),
            math.nan if noise is None else float(noise),
        )
    except (KeyError, TypeError, ValueError):
        return None


def sound_checks(contents: Iterable[dict[str, Any]]) -> list[Before]:
    """Earlier checks whose friction can be believed, in their order: their signal was not too rough to tell any."""
    found = ((before_of(content), content) for content in contents)
    return [
        one for one, content in found if one is not None and content["drift"].get("state") != Drift.SIGNAL
    ]
