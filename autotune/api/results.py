"""What comparing, diagnosing and adding find: plain numbers and arrays, torques in N m or N, motor side."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autotune.api.overlay import Overlay, overlay_of
from autotune.core.arrays import Flags, Floats
from autotune.core.documents import finite
from autotune.core.tables import frame, html_table
from autotune.diagnosis.compare import Compared, Worst
from autotune.diagnosis.verdict import Diagnosis
from autotune.diagnosis.wording import Candidate, headline
from autotune.models.as_json import parameters_json, waves_json
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd


class Result(ABC):
    """What all results can: the object of `--json`, and themselves in words and as a table."""

    __slots__ = ()

    def to_json(self) -> dict[str, Any]:
        """The object that the command prints with `--json`; what is not a finite number is None."""
        content: dict[str, Any] = finite(self._content())
        return content

    def to_frame(self) -> pd.DataFrame:
        """The table of this result, as pandas has it.

        Raises:
            ConfigurationError: pandas is not installed.
        """
        return frame(self._table())

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self._sentence()}"

    def _repr_html_(self) -> str:
        return html_table(self._sentence(), self._rows())

    @abstractmethod
    def _content(self) -> dict[str, Any]:
        """The object of `--json`, before what is not finite is taken out."""

    @abstractmethod
    def _sentence(self) -> str:
        """What was found, in one sentence."""

    @abstractmethod
    def _rows(self) -> list[dict[str, Any]]:
        """The rows of its table."""

    def _table(self) -> Any:
        return self._rows()


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(Result):
    """Model against measurement.

    Attributes:
        error_rms: of the measured torque less the model's; `relative_error`: over the rms of the torque.
        noise_floor_rms: what differs from repeat to repeat, with its interval of 95 %; nan and None without repeats.
        explained: share of the torque's explainable variance that the model explains.
        worst: where the squared error is most above its even share; `regimes`: rms by kind of motion.
        where: share of the error's variance that follows each coordinate.
        position_error_rms: of the simulated against the measured position; nan without twin.
        time, torque, error: what was compared, in order, shape (m,); time goes on over pauses [s].
        coordinates: position, velocity and what else the error may live in, of the same rows, shape (m,) each.
        kinds: which of the rows belong to each kind of motion, shape (m,) each.
    """

    torque_unit: str
    error_rms: float
    relative_error: float
    noise_floor_rms: float
    noise_floor_interval: tuple[float, float] | None
    explained: float
    worst: tuple[Worst, ...]
    regimes: Mapping[str, float]
    where: Mapping[str, float]
    position_error_rms: float
    twin: bool
    time: Floats
    torque: Floats
    error: Floats
    coordinates: Mapping[str, Floats]
    kinds: Mapping[str, Flags]
    notes: tuple[str, ...]
    _model: DriveModel = field(repr=False)
    _compared: Compared = field(repr=False)

    def write_html(self, path: str | Path) -> None:
        """Writes a page: measured and model over time, and the error where it lives."""
        from autotune.view.model_pages import write_comparison

        write_comparison(Path(path), self._compared, self._model)

    def write_rrd(self, path: str | Path, recordings: Sequence[Recording]) -> None:
        """Writes a file for the Rerun viewer; `recordings`: those that were compared.

        Raises:
            RecordingError: the file cannot be written.
        """
        from autotune.view.compared_pages import write_comparison_rrd

        write_comparison_rrd(Path(path), recordings, self._compared, self._model)

    def _content(self) -> dict[str, Any]:
        return {
            "torque_unit": self.torque_unit,
            "error_rms": self.error_rms,
            "relative_error": self.relative_error,
            "noise_floor_rms": self.noise_floor_rms,
            "noise_floor_interval": self.noise_floor_interval,
            "explained": self.explained,
            "worst": [
                {"coordinate": w.coordinate, "range": [w.low, w.high], "share": w.share} for w in self.worst
            ],
            "regimes": dict(self.regimes),
            "where": dict(self.where),
            "position_error_rms": self.position_error_rms,
            "twin": self.twin,
        }

    def _sentence(self) -> str:
        text = f"error {self.error_rms:.4g} {self.torque_unit} rms, {100 * self.relative_error:.2f} % of the torque"
        if self.noise_floor_interval is None:
            return f"{text}; noise floor unknown: nothing was recorded twice"
        return f"{text}; noise floor {self.noise_floor_rms:.4g} {self.torque_unit} rms"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"regime": name, "error_rms": value}
            for name, value in self.regimes.items()
            if math.isfinite(value)
        ]

    def _table(self) -> Any:
        return {
            "time": self.time,
            "torque": self.torque,
            "model": self.torque - self.error,
            "error": self.error,
        }


@dataclass(frozen=True, slots=True, repr=False)
class DiagnosisResult(Result):
    """What a model lacks, with all the evidence.

    Attributes:
        verdict: `named`, `none`, `unknown` or `ambiguous`; `effects`: names, strongest first.
        confidence: `confirmed`, `suspected` or None.
        candidates: every effect that was tried; `gain`: how far the squared error falls on unseen data.
        confusable: sets of effects that these data cannot tell apart.
        where: share of the residual's variance by coordinate.
        next_experiment: what would tell more, in words; None where nothing is asked.
        error_rms, relative_error: of the model as it was given, as `compare` finds it.
        error_test: rms on the unseen test trajectory; nan without one.
        complete: all was asked; else the time it was given was up.
    """

    torque_unit: str
    verdict: str
    effects: tuple[str, ...]
    confidence: str | None
    candidates: tuple[Candidate, ...]
    confusable: tuple[tuple[str, ...], ...]
    where: Mapping[str, float]
    noise_floor_rms: float
    next_experiment: str | None
    twin: bool
    error_rms: float
    relative_error: float
    error_test: float
    notes: tuple[str, ...]
    complete: bool
    _model: DriveModel = field(repr=False)
    _diagnosis: Diagnosis = field(repr=False)

    def found_model(self, source: str = "") -> DriveModel | None:
        """The model with the named effects, fitted together, as `autotune run` writes it; None where none is named.

        Where nothing is missing but a law of the base is another one, the model with that law.

        `source`: what the data were, for the model's history.
        """
        from autotune.tuning.found_model import found_model

        when = datetime.now(UTC).isoformat(timespec="seconds")
        found = found_model(self._diagnosis, self._model, when, source)
        return None if found is None else found.model

    def overlay(self) -> Overlay | None:
        """What each candidate explains, beside what the model misses; None where nothing was fitted."""
        return overlay_of(self._diagnosis)

    def write_html(self, path: str | Path) -> None:
        """Writes a page: verdict, ranking with evidence, and the residual where it lives."""
        from autotune.view.model_pages import write_diagnosis

        write_diagnosis(Path(path), self._diagnosis, self._model)

    def write_rrd(self, path: str | Path, recordings: Sequence[Recording]) -> None:
        """Writes a file for the Rerun viewer; `recordings`: those that were diagnosed.

        Raises:
            RecordingError: the file cannot be written.
        """
        from autotune.view.compared_pages import write_diagnosis_rrd

        write_diagnosis_rrd(Path(path), recordings, self._diagnosis, self._model)

    def _content(self) -> dict[str, Any]:
        return {
            "torque_unit": self.torque_unit,
            "verdict": self.verdict,
            "effects": list(self.effects),
            "confidence": self.confidence,
            "candidates": self._rows(),
            "confusable": [list(rivals) for rivals in self.confusable],
            "where": dict(self.where),
            "noise_floor_rms": self.noise_floor_rms,
            "next_experiment": self.next_experiment,
            "twin": self.twin,
            "error_rms": self.error_rms,
            "relative_error": self.relative_error,
            "error_test": self.error_test,
            "notes": list(self.notes),
            "complete": self.complete,
        }

    def _sentence(self) -> str:
        return headline(self.verdict, self.effects, self.confidence, self.complete, self.twin)

    def _rows(self) -> list[dict[str, Any]]:
        keys = ("effect", "gain", "error_before", "error_after", "accepted", "why")
        return [{key: getattr(candidate, key) for key in keys} for candidate in self.candidates]


@dataclass(frozen=True, slots=True, repr=False)
class AddedEffect(Result):
    """A model with one effect more, and how far the error fell.

    Attributes:
        error_before, error_after, noise_floor_rms: rms on data not used for the fit; `unseen`: which, in words.
            Before: the model without the effect, refitted on these data.
    """

    effect: str
    model: DriveModel
    error_before: float
    error_after: float
    noise_floor_rms: float
    unseen: str
    notes: tuple[str, ...]

    @property
    def better(self) -> bool:
        """Whether the error on unseen data fell; else keep the model without the effect."""
        return self.error_after < self.error_before

    def write_rrd(self, path: str | Path, recordings: Sequence[Recording], before: DriveModel) -> None:
        """Writes a file for the Rerun viewer: the model `before` beside this one, on these recordings.

        Raises:
            RecordingError: the file cannot be written.
        """
        from autotune.view.compared_pages import write_added_rrd

        write_added_rrd(Path(path), recordings, before, self.model)

    def _content(self) -> dict[str, Any]:
        return {
            "torque_unit": self.model.torque_symbol,
            "error_before": self.error_before,
            "error_after": self.error_after,
            "noise_floor_rms": self.noise_floor_rms,
            "parameters": parameters_json(self.model),
            "waves": waves_json(self.model),
            "unseen": self.unseen,
        }

    def _sentence(self) -> str:
        unit = self.model.torque_symbol
        return (
            f"{self.effect}: error on {self.unseen} {self.error_before:.4g} {unit} refitted without it, "
            f"{self.error_after:.4g} {unit} with it"
        )

    def _rows(self) -> list[dict[str, Any]]:
        return [{"name": name, **numbers} for name, numbers in parameters_json(self.model).items()]
