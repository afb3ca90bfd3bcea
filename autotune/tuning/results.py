"""Result files in run folders, read without loading what made them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError
from autotune.tuning.files import read_json

STAMP = len("20260301-120000")


def run_folders(runs: Path, axis: str) -> list[Path]:
    """Run folders of an axis, newest first; those of an axis whose name ends like this one's are not among them.

    The year is whatever the clock said: one without a battery begins in 1970.
    """
    found = (path for path in runs.glob(f"[0-9]*-{axis}") if path.name[STAMP:] == f"-{axis}")
    return sorted(found, reverse=True)


def run_results(runs: Path, axis: str, name: str) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Result files of an axis by the name of the file, newest first; damaged ones are passed over."""
    for directory in run_folders(runs, axis):
        try:
            content = read_json(directory / name, "result")
        except ConfigurationError:
            continue
        if content.get("axis") == axis:
            yield directory, content
