"""From foreign files to one recording, and what was understood on the way.

Nothing is guessed silently: what is recognised is said, what is in doubt is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError, RecordingError, plain
from autotune.recordings.axis_sizes import refuse_unlike_axis, sizes_line
from autotune.recordings.importing import FORMATS
from autotune.recordings.importing.asking import Doubt, ask
from autotune.recordings.importing.cleaning import (
    grain,
    refuse_absurd,
    unwrap_clock,
    without_copies,
    without_missing,
)
from autotune.recordings.importing.clock import (
    LEAST_ROWS,
    RegularPiece,
    resampled,
)
from autotune.recordings.importing.factor import parse_assignments
from autotune.recordings.importing.labels import (
    TARGET,
    label_column,
    load_labels,
    told,
)
from autotune.recordings.importing.leaps import Steps, judge_leaps, steps_of
from autotune.recordings.importing.mapping import (
    REPEAT,
    Choice,
    also_asked,
    choose,
    counts_repeats,
    motion_unit,
    said,
    value_doubt,
    written,
)
from autotune.recordings.importing.options import Options
from autotune.recordings.importing.pieces import (
    continuous,
    on_one_grid,
    pieces_of,
    positioned,
    without_held,
)
from autotune.recordings.importing.plausible import (
    clipping_note,
    constant_notes,
    refuse_other_velocity,
    refuse_wrong_sign,
    sizes_of_dynamics,
)
from autotune.recordings.importing.played_again import ALIKE, told_apart
from autotune.recordings.importing.source import Column, Source
from autotune.recordings.importing.speed_table import as_stretches
from autotune.recordings.importing.stated import with_stated_period
from autotune.recordings.limits import refuse_impossible
from autotune.recordings.recording import RESERVED_EXPERIMENTS, Metadata, Recording, concatenate
from autotune.recordings.turn_lines import unit_question

_FAR = 1e7
COUNTS_NONE = "counts no repetitions and is left out: it never changes, too often, or is no whole number"


@dataclass(frozen=True, slots=True)
class Imported:
    """The recording, and a line for each thing that was recognised, changed or left out."""

    recording: Recording
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _File:
    """One file, cut into regular stretches with one period."""

    path: Path
    stretches: list[RegularPiece]
    period: float
    unit: str
    facts: Mapping[str, str]
    lines: list[str]
    labels: tuple[str, ...] = ()
    resolution: float | None = None
    steps: Steps | None = None


def import_files(paths: Sequence[Path], options: Options) -> Imported:
    """Reads all files into one recording; each file is a segment, more where its clock is interrupted.

    Raises:
        RecordingError: a file cannot be a recording of one axis.
        ConfigurationError: an option is wrong, or one is needed to settle a doubt.
    """
    if options.format not in FORMATS:
        raise ConfigurationError(f"--format is {options.format!r}; known are {', '.join(FORMATS)}")
    files = [_read(source, paths, options) for source in FORMATS[options.format](paths)]
    if not files:
        raise ConfigurationError("no file was given; name at least one")
    units = {file.unit for file in files}
    if len(units) > 1:
        raise RecordingError("the files mix linear and rotary axes; import each axis by itself")
    leaps = judge_leaps([file.steps for file in files if file.steps], files[0].unit, options.keep_leaps)
    period = min(file.period for file in files)
    labelled: dict[str, list[RegularPiece]] = {}
    parts = [
        part
        for number, file in enumerate(files)
        for part in _segments(file, number, period, labelled if file.labels else {}, options)
    ]
    recording = concatenate(parts) if len(parts) > 1 else parts[0]
    del parts
    lines = _lines(files) + _periods(files, period) + leaps
    if not options.experiment:
        recording, plays = told_apart(recording)
        lines += [plays] if plays else []
    recording, remarks = _judged(recording, files, options)
    return Imported(recording, tuple(plain(line) for line in lines + remarks))


def _read(source: Source, paths: Sequence[Path], options: Options) -> _File:
    path = source.path
    said_columns, labelled = label_column(options, source)
    assigned = parse_assignments(said_columns, source)
    source = with_stated_period(source, assigned, options.wishes.period)
    choices, doubts = choose(source, assigned, options.wishes)
    unit, why = motion_unit(choices, options.wishes)
    lines = [*source.notes, *said(choices, source, labelled), f"motion unit {unit} ({why})"]
    columns, more = _load(source, [choice for choice in choices if choice.target], lines)
    doubts += more
    if doubts:
        known = written(choices, source, assigned) | ({TARGET: source.name_of(labelled)} if labelled else {})
        raise ask(path, paths, doubts + also_asked(choices, source), known, options)
    facts: dict[str, str] = {}
    if options.wishes.speed_curve:
        columns, labelled = as_stretches(columns, path, lines), None
    columns, names = _labelled(columns, source, labelled, lines)
    clock, columns = "time" in columns, _with_clock(columns, source, options, lines)
    rows, columns = len(columns["time"]), without_missing(columns, path, lines)
    if options.wishes.period is not None and len(columns["time"]) < rows:
        options = _with_holes(options, clock, path)
    columns = without_copies(columns, lines)
    refuse_absurd(columns, path)
    if len(columns["time"]) < LEAST_ROWS:
        raise RecordingError(
            f"{path} has {len(columns['time'])} rows; a recording needs at least {LEAST_ROWS}"
        )
    columns = _completed(columns, lines, facts)
    factor = next((choice.factor for choice in choices if choice.target == "position"), 1.0)
    pieces, period = without_held(*pieces_of(columns, path, source, options, lines), lines, facts)
    pieces = [continuous(piece, unit, factor, lines, facts) for piece in pieces]
    steps = steps_of(pieces, path, period)
    if options.wishes.period is None:
        pieces = on_one_grid(pieces, period, lines, facts)
    stretches = [positioned(piece, lines, facts) for piece in pieces]
    resolution = _resolution(columns, options, unit, lines)
    return _File(path, stretches, period, unit, facts, lines, names, resolution, steps)


def _resolution(columns: dict[str, Floats], options: Options, unit: str, lines: list[str]) -> float | None:
    """One count of the position, as said or as the steps in the file show."""
    if options.wishes.resolution is not None or "position" not in columns:
        return options.wishes.resolution
    found = grain(columns["position"])
    if found is not None:
        lines.append(
            f"position moves in steps of {found:.6g} {unit}: taken as its resolution (else --resolution)"
        )
    return found


def _load(source: Source, choices: list[Choice], lines: list[str]) -> tuple[dict[str, Floats], list[Doubt]]:
    """The chosen columns in SI, and doubts about their values."""
    if not choices:
        return {}, []
    loaded = source.load([choice.index for choice in choices])
    lines += loaded.notes
    columns: dict[str, Floats] = {}
    doubts: list[Doubt] = []
    for number, choice in enumerate(choices):
        values, loaded.columns[number] = loaded.columns[number], np.empty(0)
        if choice.target == REPEAT and not choice.trusted and not counts_repeats(values):
            lines.append(f"{REPEAT} {COUNTS_NONE}")
            continue
        doubts += value_doubt(choice, values, source)
        if choice.target == "time":
            values = unwrap_clock(values, lines)
        columns[choice.target] = values * choice.factor if choice.factor != 1.0 else values
    return columns, doubts


def _labelled(
    columns: dict[str, Floats], source: Source, labelled: Column | None, lines: list[str]
) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """The columns with the number of each row's label, and what the labels are called."""
    if labelled is None:
        return columns, ()
    labels = load_labels(source, labelled)
    lines += told(labelled, labels)
    return {**columns, TARGET: labels.codes}, labels.names


def _with_clock(
    columns: dict[str, Floats], source: Source, options: Options, lines: list[str]
) -> dict[str, Floats]:
    """Time from the period where the file has no clock."""
    if "time" in columns:
        return _with_near_origin(columns, lines)
    period = options.wishes.period or source.period or 1.0
    rows = len(next(iter(columns.values())))
    lines.append(f"no clock in the file: time counts rows of {period:g} s")
    return {"time": np.arange(rows, dtype=np.float64) * period, **columns}


def _with_holes(options: Options, clock: bool, path: Path) -> Options:
    """What was asked for where rows are missing that `--period` would count: time was counted before they went.

    Raises: RecordingError where a clock stands beside the period: which of the two tells the holes is not said.
    """
    if clock:
        raise RecordingError(
            f"{path}: rows without a number are missing among those that --period counts, so that all later ones would "
            "come too soon; leave --period out, and the clock tells the holes, or fill the rows in"
        )
    return replace(options, wishes=replace(options.wishes, period=None))


def _with_near_origin(columns: dict[str, Floats], lines: list[str]) -> dict[str, Floats]:
    """Dates in seconds since 1970 leave few digits for the steps: time then starts at 0."""
    finite = columns["time"][np.isfinite(columns["time"])]
    if not len(finite) or abs(finite[0]) < _FAR:
        return columns
    lines.append(f"time starts at {finite[0]:.9g} s: counted from there")
    return {**columns, "time": columns["time"] - finite[0]}


def _completed(columns: dict[str, Floats], lines: list[str], facts: dict[str, str]) -> dict[str, Floats]:
    if "torque" not in columns:
        lines.append("torque is the torque commanded: no column was taken for a measured one")
        facts["torque_source"] = "torque_command"
        columns = {**columns, "torque": columns["torque_command"]}
    return columns


def _segments(
    file: _File, number: int, period: float, seen: dict[str, list[RegularPiece]], options: Options
) -> list[Recording]:
    """The stretches of the file as recordings with the common period; `seen` is told them by name."""
    metadata = Metadata(
        motion_unit=file.unit,
        sample_period=period,
        position_resolution=file.resolution,
        torque_limit=options.torque_limit,
        controller=options.controller,
    )
    parts = []
    for stretch in file.stretches:
        label, repeat = _label(_name(file, stretch, options), number, stretch, seen, options)
        lost = stretch.missed
        if abs(file.period / period - 1.0) > 1e-6:
            stretch = resampled(stretch, period)
            lost = round((lost + 1) * file.period / period) - 1 if lost else 0
        columns = {name: values for name, values in stretch.columns.items() if name not in (TARGET, REPEAT)}
        missed = np.zeros(len(stretch), dtype=np.int64)
        missed[0] = lost
        parts.append(Recording.from_columns(columns, metadata, label, repeat, missed))
    return parts


def _label(
    name: str, number: int, stretch: RegularPiece, seen: dict[str, list[RegularPiece]], options: Options
) -> tuple[str, int]:
    """Experiment and repeat: runs with the same reference are repetitions, other pieces are not."""
    if REPEAT in stretch.columns:
        return name, int(stretch.columns[REPEAT][0])
    before = seen.setdefault(name, [])
    same = [i for i, other in enumerate(before) if _same_reference(other, stretch)]
    before.append(stretch)
    if same and not stretch.missed:
        return name if same[0] == 0 else f"{name}-{same[0] + 1}", len(same)
    repeat = number if options.experiment else 0
    return (name if len(before) == 1 else f"{name}-{len(before)}"), repeat


def _same_reference(one: RegularPiece, other: RegularPiece) -> bool:
    if "reference" not in one.columns or abs(len(one) - len(other)) > 2:
        return False
    rows = min(len(one), len(other))
    first, second = one.columns["reference"][:rows], other.columns["reference"][:rows]
    return bool(np.max(np.abs(first - second)) <= ALIKE * max(float(np.ptp(first)), 1e-12))


def _name(file: _File, stretch: RegularPiece, options: Options) -> str:
    """What the stretch is called: its label, or the option, or the file's name.

    Reserved names change what is done with the data: only a person or a label gives them.
    """
    label = file.labels[int(stretch.columns[TARGET][0])] if file.labels else ""
    if label or options.experiment:
        return options.experiment or _plain_name(label)
    name = _plain_name(file.path.stem)
    if name not in RESERVED_EXPERIMENTS:
        return name
    line = f"experiment {name!r} has a meaning of its own here; this one is named 'file-{name}'"
    file.lines.extend([line] * (line not in file.lines))
    return f"file-{name}"


def _plain_name(text: str) -> str:
    return re.sub(r"[^\w.+-]+", "_", text) or "import"


def _lines(files: list[_File]) -> list[str]:
    """What was said of the files, each sentence once."""
    if len(files) == 1:
        return files[0].lines
    texts = dict.fromkeys(line for file in files for line in file.lines)
    return [f"{_whose(text, files)}: {text}" for text in texts]


def _whose(text: str, files: list[_File]) -> str:
    names = [file.path.name for file in files if text in file.lines]
    if len(names) == len(files):
        return f"all {len(files)} files"
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _periods(files: list[_File], period: float) -> list[str]:
    others = sorted({file.period for file in files if abs(file.period / period - 1.0) > 1e-6})
    if not others:
        return []
    text = ", ".join(f"{other:g}" for other in others)
    return [f"sample periods differ: files with {text} s are interpolated to {period:g} s, the shortest"]


def _judged(recording: Recording, files: list[_File], options: Options) -> tuple[Recording, list[str]]:
    """Refuses what cannot be an axis; adds what is to be known to the metadata."""
    where = str(files[0].path) if len(files) == 1 else f"{files[0].path} and {len(files) - 1} more"
    recording = _with_facts(recording, files, options)
    refuse_impossible(recording, where)
    if not options.keep_signs:
        refuse_other_velocity(recording, where)
        refuse_wrong_sign(recording, where)
    remarks = refuse_unlike_axis(recording, where, sizes_of_dynamics(recording))
    remarks += [question] if (question := unit_question(recording)) else []
    remarks += [*constant_notes(recording), sizes_line(recording)]
    if symbol := recording.metadata.torque_unit:
        remarks.append(f"torque is in {symbol}, and so will be everything that is identified")
    clipping = clipping_note(recording)
    if clipping:
        remarks.append(clipping + ("" if options.torque_limit else "; say the limit with --torque-limit"))
        recording = _with_extra(recording, {"torque_clipped": clipping})
    return recording, remarks


def _with_facts(recording: Recording, files: list[_File], options: Options) -> Recording:
    """The recording with what was done to it, and the unit of its torque, in the metadata."""
    extra = {"imported_from": ", ".join(file.path.name for file in files[:40]).replace("\n", " ")}
    for file in files:
        extra |= file.facts
    if options.wishes.torque_unit in ("A", "V"):
        extra["torque_unit"] = options.wishes.torque_unit
    changed = _periods(files, recording.period)
    if changed:
        extra["periods"] = changed[0]
    return _with_extra(recording, extra)


def _with_extra(recording: Recording, extra: Mapping[str, str]) -> Recording:
    metadata = recording.metadata
    return replace(recording, metadata=replace(metadata, extra={**metadata.extra, **extra}))
