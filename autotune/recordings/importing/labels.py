"""A column that says which experiment each row belongs to: texts, or numbers that stay for a while.

`--column experiment=FIELD` names it; a column with the recording's own name `experiment`, in whatever case, is taken
without being named. The recording is cut where the label changes.
"""

from __future__ import annotations

import numpy as np

from autotune.core.errors import ConfigurationError, RecordingError, a_few
from autotune.recordings.importing.clock import LEAST_ROWS
from autotune.recordings.importing.options import Options
from autotune.recordings.importing.source import Column, Source, by_name, by_number, near, short, within
from autotune.recordings.importing.texts import Labels
from autotune.recordings.recording import RESERVED_EXPERIMENTS

TARGET = "experiment"
_FEW = 8
_RESERVED = dict(
    zip(RESERVED_EXPERIMENTS, ("is never fitted", "only gates a verdict", "is only reported on"), strict=True)
)


def label_column(options: Options, source: Source) -> tuple[list[str], Column | None]:
    """The `--column` options that name numbers, and the column of labels, where there is one.

    Raises:
        ConfigurationError: no such column, named twice, or all segments have a name already.
    """
    split = [(text, *(part.strip() for part in text.partition("=")[::2])) for text in options.columns]
    fields = [wanted for _, target, wanted in split if target == TARGET and wanted]
    others = [text for text, target, wanted in split if target != TARGET or not wanted]
    if len(fields) > 1:
        raise ConfigurationError(f"--column gives {TARGET} twice; keep one of the two")
    if fields:
        column = _named(fields[0], source)
        if options.experiment is not None:
            raise ConfigurationError(
                f"{source.path}: --experiment {options.experiment} names all segments, and {column} names each; leave "
                "one of the two out"
            )
        return others, column
    own = by_name(TARGET, source.texts)
    return others, own[0] if len(own) == 1 and options.experiment is None else None


def load_labels(source: Source, column: Column) -> Labels:
    """The labels of all rows.

    Raises:
        RecordingError: they change too often to be labels, or the format has no texts.
    """
    if column in source.columns:
        values = source.load([source.columns.index(column)]).columns[0]
        found, codes = np.unique(np.where(np.isfinite(values), values, np.inf), return_inverse=True)
        names = tuple(f"{column.name}_{value:.6g}" if np.isfinite(value) else "" for value in found)
        labels = Labels(np.asarray(codes, dtype=np.float64), names)
    elif source.labels is None:
        raise RecordingError(
            f"{source.path}: the texts of {column} cannot be read from this format; export it as CSV"
        )
    else:
        labels = source.labels(column.number)
    changes = int(np.count_nonzero(np.diff(labels.codes)))
    if changes * LEAST_ROWS > len(labels.codes):
        raise RecordingError(
            f"{source.path}: {column} changes {changes} times in {len(labels.codes)} rows, and an experiment has at "
            f"least {LEAST_ROWS}: it is no column of labels; name another one, or leave '{TARGET}=' out"
        )
    return labels


def told(column: Column, labels: Labels) -> list[str]:
    """For the person: what was taken, and which labels have a meaning of their own."""
    named = [short(name, 30) for name in labels.names if name]
    lines = [
        f"{TARGET} = {column}: {len(named)} labels, {a_few(named, _FEW)}" if named else f"{column} is empty"
    ]
    lines += [f"experiment '{name}' {what}" for name, what in _RESERVED.items() if name in labels.names]
    return lines


def _named(wanted: str, source: Source) -> Column:
    """The column of that name or number, texts included."""
    every = (*source.texts, *source.columns)
    hits = by_name(wanted, every) or by_number(wanted, every)
    if len(hits) == 1:
        return hits[0]
    shown = within([f"{column.number} {column}" for column in every])
    if hits:
        raise ConfigurationError(
            f"--column '{TARGET}={wanted}': {source.path} has {len(hits)} columns of that name; say which by its "
            f"number, of {shown}"
        )
    raise ConfigurationError(
        f"--column '{TARGET}={wanted}': {source.path} has no column {wanted!r}{near(wanted, every)}; it has {shown}"
    )
