"""What runs and checks left in the runs folder, taken up into the history; nothing twice.

The files are the source: a history that was lost, or restored from an older backup, is complete again
after this, and what the command line did without the service is in it as well.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError
from autotune.monitoring.check_file import FILE_NAME as CHECK_FILE
from autotune.service.store import Store, text
from autotune.service.tables import checks, runs
from autotune.tuning.files import finite, read_json

RUN_FILE = "run.json"


def absorb(store: Store, folder: Path) -> int:
    """Takes up every run folder that the history does not know; returns how many."""
    known_checks, known_runs = store.known_runs(checks), store.known_runs(runs)
    count = 0
    for directory in sorted(folder.glob("[0-9]*-*")):
        if directory.name not in known_checks and (directory / CHECK_FILE).is_file():
            count += absorb_check(store, directory)
        if directory.name not in known_runs and (directory / RUN_FILE).is_file():
            count += absorb_run(store, directory)
    return count


def absorb_check(store: Store, directory: Path) -> bool:
    """Takes up one check; False where it is known or its file does not say what it must."""
    try:
        content = read_json(directory / CHECK_FILE, "check")
        row = _check_row(directory.name, content)
    except (ConfigurationError, KeyError, TypeError, ValueError):
        return False
    found = _parameters(directory.name, row["axis"], row["at"], "check", content["friction"])
    return store.add_measured(checks, row, found, {})


def absorb_run(store: Store, directory: Path) -> bool:
    """Takes up one run; False where it is known or its file does not say what it must."""
    try:
        content = read_json(directory / RUN_FILE, "run")
        row = _run_row(directory.name, content)
    except (ConfigurationError, KeyError, TypeError, ValueError):
        return False
    found = _parameters(directory.name, row["axis"], row["at"], "run", content.get("parameters") or {})
    event = {
        "key": f"run:{directory.name}",
        "axis": row["axis"],
        "at": row["at"],
        "kind": {"kept": "commit"}.get(row["outcome"], row["outcome"]),
        "sentence": row["sentence"],
    }
    return store.add_measured(runs, row, found, event)


def _check_row(name: str, content: Mapping[str, Any]) -> dict[str, Any]:
    drift = content["drift"]
    return {
        "run": name,
        "axis": content["axis"],
        "at": text(datetime.fromisoformat(content["at"])),
        "drift": drift["state"],
        "beyond": bool(drift["beyond"]),
        "change": drift["change"],
        "level": float(content["friction"]["level"]["value"]),
        "level_error": float(content["friction"]["level"]["standard_error"]),
        "temperature": _number(content["temperature"]),
        "peak_error": float(content["tracking_error"]["peak_error"]),
        "uncompensated": float(content["uncompensated"]["peak_error"]),
        "missed": int(content["missed"]),
        "samples": int(content["samples"]),
        "sentence": content["verdict"],
        "content": json.dumps(finite(content)),
    }


def _run_row(name: str, content: Mapping[str, Any]) -> dict[str, Any]:
    def peak(part: str) -> float | None:
        return float(content[part]["peak_error"]) if content.get(part) else None

    return {
        "run": name,
        "axis": content["axis"],
        "at": text(_aware(content["started"])),
        "outcome": content["outcome"],
        "before": peak("before"),
        "after": peak("after"),
        "committed": peak("committed"),
        "machine_seconds": float(content["machine_seconds"]),
        "sentence": content["verdict"],
        "content": json.dumps(finite(content)),
    }


def _parameters(
    run: str, axis: str, at: str, source: str, found: Mapping[str, Mapping[str, Any]]
) -> list[dict[str, Any]]:
    return [
        {
            "run": run,
            "axis": axis,
            "at": at,
            "source": source,
            "name": name,
            "value": float(value["value"]),
            "standard_error": _number(value.get("standard_error")),
            "unit": value["unit"],
        }
        for name, value in found.items()
    ]


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else None


def _aware(stamp: str) -> datetime:
    """Runs of the command line are stamped in local time."""
    return datetime.fromisoformat(stamp).astimezone(UTC)
