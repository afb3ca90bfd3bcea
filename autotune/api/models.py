"""Models and recordings: fit, compare, diagnose, add an effect, simulate a model.

A recording is given as such or as a file's name, one or several of one axis; a model likewise, or as the result
of a fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from threadpoolctl import threadpool_limits

from autotune.api.known_laws import take_laws
from autotune.api.results import AddedEffect, Comparison, DiagnosisResult
from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.diagnosis import fitting
from autotune.diagnosis.candidates import no_progress
from autotune.diagnosis.compare import compare as compare_model
from autotune.diagnosis.compare import regime_rows, simulate_closed_loop
from autotune.diagnosis.fit_recordings import fit_recordings
from autotune.diagnosis.fit_result import FitResult
from autotune.diagnosis.verdict import diagnose as diagnose_model
from autotune.estimation.coordinates import coordinates
from autotune.estimation.residual import smoothed
from autotune.models.drive_model import DriveModel, HistoryEntry
from autotune.models.model_file import read_model
from autotune.models.table import effect_kind
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording

Source: TypeAlias = Recording | str | Path
Recordings: TypeAlias = Source | Sequence[Source]
Model: TypeAlias = DriveModel | FitResult | AddedEffect | str | Path
Progress: TypeAlias = Callable[[str], None]


def fit(
    recordings: Recordings,
    *,
    effects: Sequence[str] = (),
    precision: float | None = None,
    progress: Progress = no_progress,
    source: str = "",
) -> FitResult:
    """Fits a model; every number with its uncertainty.

    Args:
        effects: names of effects to fit beside the base model.
        precision: what positions are to be held to [rad or m]; by default 1 mrad or 10 µm.
        progress: hears what is being done.
        source: what the data are, for the model's history; by default the names of the files.

    Raises:
        RecordingError, NotEnoughExcitation: what is wrong with the data, in a sentence.
        ConfigurationError: an unknown effect, one named twice, a precision that is none.
    """
    with _one_thread():
        result = fit_recordings(
            _read(recordings), effects=tuple(effects), precision=precision, progress=progress
        )
    if result.model is None:
        return result
    unseen = result.unseen
    entry = HistoryEntry(_now(), "fitted", source or _named(recordings))
    if unseen is not None:
        floor = unseen.floor.rms if unseen.floor is not None else None
        entry = replace(entry, error_after=unseen.rms, noise_floor=floor, unseen=unseen.data)
    return replace(result, model=result.model.with_history(entry))


def compare(recordings: Recordings, model: Model) -> Comparison:
    """How large a model's error is, how much of it is noise, and where it sits. Nothing is fitted.

    Raises:
        RecordingError, ConfigurationError, NotEnoughExcitation: recordings that cannot be used.
    """
    known = _model(model)
    with _one_thread():
        found = compare_model(_read_beside(model, recordings), known)
    data = found.problem.data
    order = np.argsort(data.grid, kind="stable")
    return Comparison(
        known.torque_symbol, found.error_rms, found.relative_error, found.noise_floor_rms,
        found.noise_floor_interval, found.explained, found.worst, found.regimes, found.where, found.position_rms,
        found.twin, np.asarray(data.grid[order] * data.period, dtype=np.float64),
        smoothed(data, data.torque)[order], found.error[order],
        {name: values[order] for name, values in coordinates(data).items()},
        {name: of[order] for name, of in regime_rows(data, known, found.rows).items()}, found.notes, known, found,
    )  # fmt: skip


def diagnose(
    recordings: Recordings,
    model: Model,
    *,
    candidates: Sequence[str] | None = None,
    at_most: float = math.inf,
    progress: Progress = no_progress,
) -> DiagnosisResult:
    """Which physical effect the model lacks, with the evidence.

    `candidates` are the names of the effects that may be missing; all of the library where none are given. After
    `at_most` seconds no more is searched for: the verdict is on what was found until then, and not `complete`.

    Raises:
        RecordingError, ConfigurationError: recordings that cannot be used; no such effect; a limit that is none.
        NotEnoughExcitation: nothing to fit, or a model that does not fit the axis at all.
    """
    if not at_most > 0.0:
        raise ConfigurationError(f"at_most is {at_most}, and must be a time above 0 s")
    known = _model(model)
    with _one_thread():
        kinds = None if candidates is None else [effect_kind(name) for name in candidates]
        read = _read_beside(model, recordings)
        found = diagnose_model(read, known, progress, candidates=kinds, at_most=at_most)
    return DiagnosisResult(
        known.torque_symbol, found.verdict, found.effects, found.confidence, found.candidates, found.confusable,
        found.where, found.noise_floor_rms, found.next_experiment, found.twin, found.error_rms,
        found.relative_error, found.error_test, found.notes, found.complete,
        known, found,
    )  # fmt: skip


def add_effect(
    effect: str, recordings: Recordings, model: Model, *, progress: Progress = no_progress, source: str = ""
) -> AddedEffect:
    """Refits the model with an effect, and tells how far the error falls on data that the fit never saw.

    Raises:
        ConfigurationError: no such effect, or a model of another axis.
        NotEnoughExcitation: these data cannot say anything about the effect.
    """
    known = _model(model)
    with _one_thread():
        added = fitting.add_effect(
            effect, _read_beside(model, recordings), known, _now(), source or _named(recordings), progress
        )
    return AddedEffect(
        effect,
        added.model,
        added.error_before,
        added.error_after,
        added.noise_floor_rms,
        added.unseen,
        added.notes,
    )


def simulate_model(model: Model, recording: Source) -> Recording:
    """What a recording would have been were the axis the model: references and controller are the recording's.

    Raises:
        NotEnoughExcitation: the loop cannot be simulated (no controller known or found, or it is not stable).
    """
    real = _read(recording)[0]
    with _one_thread():
        loop = simulate_closed_loop(real, _model(model))
    rows = np.isfinite(loop.position)
    if not rows.any():
        raise NotEnoughExcitation(
            "the model cannot be simulated on this recording: it needs references, and a controller with which the "
            "loop is stable; give the controller with the recording ('controller' in its metadata)"
        )
    shown = real.rows(rows)
    kept = {name: shown[name] for name in ("time", "reference") if name in shown}
    simulated = {"position": loop.position[rows], "torque": loop.torque[rows]}
    return replace(shown, floats=MappingProxyType(kept | simulated))


def _one_thread() -> threadpool_limits:
    """At these sizes threads of the linear algebra only wait for each other; as it was when the block ends."""
    return threadpool_limits(1)


def _read(recordings: Recordings) -> list[Recording]:
    given = [recordings] if isinstance(recordings, (Recording, str, Path)) else list(recordings)
    if not given:
        raise ConfigurationError("no recording was given; give at least one")
    return [one if isinstance(one, Recording) else read_recording(one) for one in given]


def _read_beside(model: Model, recordings: Recordings) -> list[Recording]:
    """The recordings, after what lies beside a model's file about their loops was taken up."""
    read = _read(recordings)
    if isinstance(model, (str, Path)):
        take_laws(Path(model), read)
    return read


def _named(recordings: Recordings) -> str:
    """The data in words, for a model's history."""
    given = [recordings] if isinstance(recordings, (Recording, str, Path)) else list(recordings)
    return ", ".join(Path(one).name if not isinstance(one, Recording) else "a recording" for one in given)


def _model(model: Model) -> DriveModel:
    if isinstance(model, (str, Path)):
        return read_model(model)
    if isinstance(model, DriveModel):
        return model
    if model.model is None:
        raise ConfigurationError(f"there is no model: {getattr(model, 'reason', '')}")
    return model.model


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
