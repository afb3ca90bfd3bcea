"""Result files in run folders, read without loading what made them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError
from autotune.service.files import read_json


def run_results(runs: Path, axis: str, name: str) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Result files of an axis by the name of the file, newest first; damaged ones are passed over."""
    for directory in sorted(runs.glob(f"2*-{axis}"), reverse=True):
        try:
            content = read_json(directory / name, "result")
        except ConfigurationError:
            continue
        if content.get("axis") == axis:
            yield directory, content
