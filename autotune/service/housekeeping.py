"""Disk: recordings, traces and reports within their budget, oldest removed first.

A run folder keeps its small files (result, journal, model, findings), so that history and recovery never
suffer. The heavy files of a folder that a committed model rests on are never removed: the newest two
kept runs of every axis, and every run that has not ended.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from autotune.core.errors import ConfigurationError
from autotune.tuning.files import read_json
from autotune.tuning.results import run_folders, run_results

HEAVY = ("recordings", "run.rrd", "report.html")
KEPT_RUNS = 2
MEGABYTE = 1_000_000


@dataclass(frozen=True, slots=True)
class Folder:
    """A run folder and what its heavy files take [bytes]."""

    path: Path
    size: int


def prune(runs: Path, axes: Iterable[str], budget: int) -> list[Path]:
    """Removes heavy files, oldest folder first, until all take at most `budget` bytes; returns the folders."""
    folders = [Folder(path, _heavy(path)) for path in sorted(runs.glob("[0-9]*-*")) if path.is_dir()]
    total = sum(folder.size for folder in folders)
    if total <= budget:
        return []
    rests = protected(runs, axes)
    removed = []
    for folder in folders:
        if total <= budget:
            break
        if folder.size and folder.path.name not in rests and _ended(folder.path):
            remove_heavy(folder.path)
            total -= folder.size
            removed.append(folder.path)
    return removed


def protected(runs: Path, axes: Iterable[str]) -> set[str]:
    """Names of the folders that committed models rest on."""
    names: set[str] = set()
    for axis in axes:
        kept = [p for p, content in run_results(runs, axis, "run.json") if content.get("outcome") == "kept"]
        with_model = [path for path in run_folders(runs, axis) if (path / "model.toml").is_file()]
        for one in kept[:KEPT_RUNS]:  # an approved commit rests on the run that proposed it
            names |= {one.name, *[path.name for path in with_model if path.name <= one.name][:1]}
    return names


def used(runs: Path) -> int:
    """What heavy files take at present [bytes]."""
    return sum(_heavy(path) for path in runs.glob("[0-9]*-*") if path.is_dir())


def free(runs: Path) -> int:
    """Room left on the disk [bytes]."""
    folder = runs
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def remove_heavy(directory: Path) -> None:
    """Removes what takes room; small files stay."""
    for name in HEAVY:
        path = directory / name
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _heavy(directory: Path) -> int:
    """What its heavy files take [bytes]; what goes meanwhile takes nothing."""
    total = 0
    for name in HEAVY:
        path = directory / name
        try:
            files = list(path.rglob("*")) if path.is_dir() else [path]
        except OSError:
            continue
        for file in files:
            try:
                total += file.stat().st_size
            except OSError:
                continue
    return total


def _ended(directory: Path) -> bool:
    """The run has closed its journal; one that has not may still be put right."""
    try:
        return bool(read_json(directory / "journal.json", "journal").get("outcome"))
    except ConfigurationError:
        return False
