"""The history of an axis as data and in words; the same for the command line and the API."""

from __future__ import annotations

import json
import threading
from typing import Any

from autotune.monitoring.trend import Trend, sentence
from autotune.service.observe import trend_of
from autotune.service.store import Store, contents
from autotune.tuning.files import finite

QUANTILE = 1.96
FEW = 6
MOST_KEPT = 32


class Histories:
    """Histories as JSON texts, made anew only where something was added: reading them costs nothing else."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._kept: dict[tuple[str, int], tuple[int, bytes]] = {}
        self._making = threading.Lock()

    def of(self, axis: str, checks: int) -> bytes:
        """The JSON text of `history_of`."""
        with self._making:
            additions = self._store.additions
            known = self._kept.get((axis, checks))
            if known is not None and known[0] == additions:
                return known[1]
            made = json.dumps(finite(history_of(self._store, axis, checks)), allow_nan=False).encode()
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[axis, checks] = additions, made
            return made


def history_of(store: Store, axis: str, checks: int = 400) -> dict[str, Any]:
    """Everything that is known of an axis over time."""
    looked = store.list_checks(axis, checks)
    trend = trend_of(contents(looked))
    return {
        "axis": axis,
        "sentences": sentences(looked, trend),
        "changes": [
            {
                "kind": change.kind,
                "at": change.at.isoformat(timespec="seconds"),
                "size": change.size,
                "standard_error": change.standard_error,
                "sentence": sentence(change, "Coulomb friction"),
            }
            for change in (trend.changes if trend else ())
        ],
        "temperature_coefficient": trend.temperature_coefficient if trend else None,
        "checks": [_without_content(row) for row in looked],
        "runs": [_without_content(row) for row in store.list_runs(axis)],
        "parameters": _parameters(store, axis),
        "events": [_event(row) for row in store.list_events(axis)],
    }


def sentences(checks: list[dict[str, Any]], trend: Trend | None) -> list[str]:
    """What a person should read first."""
    if not checks:
        return ["There is no check of this axis yet; 'autotune check' makes one."]
    found = [sentence(change, "Coulomb friction") + "." for change in (trend.changes if trend else ())]
    if trend is None:
        found.append(f"There are {len(checks)} checks; from {FEW} on a trend can be told.")
    elif not found:
        found.append(f"Friction has been steady over {len(checks)} checks.")
    if trend is not None and trend.temperature_coefficient is not None:
        found.append(
            f"Friction changes by {100 * trend.temperature_coefficient:+.1f} % a kelvin; this is taken out."
        )
    return [*found, f"Last check: {checks[-1]['sentence']}"]


def _parameters(store: Store, axis: str) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    for row in store.list_parameters(axis):
        error = row["standard_error"]
        reach = QUANTILE * error if error is not None else None
        found.setdefault(row["name"], []).append(
            {
                "at": row["at"],
                "run": row["run"],
                "source": row["source"],
                "value": row["value"],
                "standard_error": error,
                "interval": [row["value"] - reach, row["value"] + reach] if reach is not None else None,
                "unit": row["unit"],
            }
        )
    return found


def _without_content(row: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in row.items() if name != "content"}


def _event(row: dict[str, Any]) -> dict[str, Any]:
    return {name: row[name] for name in ("at", "kind", "sentence")}
