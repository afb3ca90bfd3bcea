"""What only a person can know about a file, asked for all at once: the doubts, and one command to complete.

The command has every column: those that were recognised as they are, the others with a placeholder in
capitals (`NAME`, `UNIT`, `FACTOR`), which the next import refuses if it was left in.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from autotune.core.errors import ConfigurationError, a_few
from autotune.recordings.importing.options import Options
from autotune.recordings.recording import FLOAT_COLUMNS

_MOST_FILES = 3
_BLANK = re.compile(r"\b(?:NAME|UNIT|FACTOR|CONSTANT|COUNTS|RATED)\b")
_ORDER = (*FLOAT_COLUMNS, "experiment", "repeat")


@dataclass(frozen=True, slots=True)
class Doubt:
    """One thing that the file does not say.

    Attributes:
        target: column of the recording it is about.
        sentence: what is in doubt, and what settles it.
        field: what the command has as `target=field`, with a placeholder.
    """

    target: str
    sentence: str
    field: str


def ask(
    path: Path, paths: Sequence[Path], doubts: Sequence[Doubt], written: Mapping[str, str], options: Options
) -> ConfigurationError:
    """The error that asks for everything in doubt.

    Args:
        path: the file that the doubts are about, one of `paths`.
        written: for each column that is beyond doubt, what `--column` says for it.
    """
    columns = dict(written) | {doubt.target: doubt.field for doubt in doubts}
    sentences = ";\n  ".join(dict.fromkeys(doubt.sentence for doubt in doubts))
    return ConfigurationError(f"{path}: {sentences}. {_to_do(doubts)}:\n  {command(paths, columns, options)}")


def _to_do(doubts: Sequence[Doubt]) -> str:
    """The placeholders by name, as a column may be called by a capital too; none where one only agrees."""
    blanks = dict.fromkeys(blank for doubt in doubts for blank in _BLANK.findall(doubt.field))
    return f"Fill in {a_few(list(blanks), len(blanks))}" if blanks else "If that is so, say"


def command(paths: Sequence[Path], columns: Mapping[str, str], options: Options) -> str:
    """One `data import` that says everything, as a shell reads it."""
    files = [str(path) for path in paths] if len(paths) <= _MOST_FILES else [str(paths[0]), "FILE..."]
    parts = ["autotune", "data", "import", *files, "--format", options.format]
    for target in sorted(columns, key=_ORDER.index):
        parts += ["--column", f"{target}={columns[target]}"]
    out = options.out or f"{paths[0].stem}-imported.parquet"
    return shlex.join([*parts, *_rest(options), "--out", out])


def _rest(options: Options) -> list[str]:
    """The other options, as they were given."""
    wishes, controller = options.wishes, options.controller
    given = {
        "--unit": wishes.motion_unit,
        "--torque-unit": wishes.torque_unit,
        "--resolution": wishes.resolution,
        "--period": wishes.period,
        "--torque-limit": options.torque_limit,
        "--controller": str(controller) if controller is not None else None,
        "--experiment": options.experiment,
    }
    flags = {
        "--keep-signs": options.keep_signs,
        "--keep-leaps": options.keep_leaps,
        "--speed-curve": wishes.speed_curve,
    }
    words = [word for name, value in given.items() if value is not None for word in (name, _word(value))]
    return words + [name for name, wanted in flags.items() if wanted]


def _word(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.9g}"
