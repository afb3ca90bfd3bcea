"""What a page is told: results of the public face as plain JSON, with the arrays that its pictures need."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import autotune
from autotune.api.overlay import Overlay
from autotune.core.arrays import Flags, Floats
from autotune.core.documents import finite
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import parse_model, write_model
from autotune.models.table import effect_kind
from autotune.recordings.files import read_recording
from autotune.recordings.recording import CONDITIONING, Recording
from autotune.tuning.question import rivals_of

MOST_ROWS = 30_000
"""Of a comparison, sent to a page; more are thinned evenly."""
MOST_OVERLAID = 10_000
"""Of what every candidate explains: there are sixteen of them."""
Tell = Callable[[str], None]
Wish = Mapping[str, Any]


def fit(wish: Wish, tell: Tell) -> dict[str, Any]:
    """A model of the recordings; `model` is its text, None where the data do not say enough."""
    found = autotune.fit(_recordings(wish), effects=tuple(wish.get("effects", ())), progress=tell)
    answer = found.to_json()
    answer["model"] = None if found.model is None or not found.valid else text_of(found.model)
    answer["notes"] = list(found.notes)
    return answer


def compare(wish: Wish, tell: Tell) -> dict[str, Any]:
    """Model against measurement, with the rows of time, torque, error and every coordinate."""
    tell("simulating the model in the same loop")
    found = autotune.compare(_recordings(wish), model_of(wish["model"]))
    answer = found.to_json()
    step = max(1, -(-len(found.time) // MOST_ROWS))
    rows = {"time": found.time, "torque": found.torque, "error": found.error, **found.coordinates}
    answer["rows"] = {name: _single(values[::step]) for name, values in rows.items() if name != "direction"}
    answer["kinds"] = list(found.kinds)
    answer["rows"]["kind"] = _bits(found.kinds)[::step].tolist()
    answer["notes"] = list(found.notes)
    answer["spectrum"] = _spectrum(found.coordinates["position"], found.error)
    return answer


def diagnose(wish: Wish, tell: Tell) -> dict[str, Any]:
    """Which effect the model lacks, each candidate with what people read about it."""
    found = autotune.diagnose(_recordings(wish), model_of(wish["model"]), progress=tell)
    answer = found.to_json()
    for candidate in answer["candidates"]:
        candidate.update(about(candidate["effect"]))
    answer["sentence"] = repr(found).partition(": ")[2]
    answer["overlay"] = _overlay(found.overlay())
    rivals = rivals_of(answer)
    answer["rivals"] = None if rivals is None else list(rivals)
    return answer


def _overlay(found: Overlay | None) -> dict[str, Any] | None:
    if found is None:
        return None
    step = slice(None, None, max(1, -(-len(found.time) // MOST_OVERLAID)))
    rows = {"time": found.time, "error": found.residual, **found.coordinates}
    return {
        "rows": {name: _single(values[step]) for name, values in rows.items() if name != "direction"},
        "contributions": {effect: _single(values[step]) for effect, values in found.contributions.items()},
        "follows": dict(found.follows),
    }


def add(wish: Wish, tell: Tell) -> dict[str, Any]:
    """The model with one effect after the other, and the error on unseen data after each."""
    names = list(wish["effects"])
    if not names:
        raise ConfigurationError("no effect was chosen; choose at least one")
    recordings, model = _recordings(wish), model_of(wish["model"])
    steps, before = [], {name: value.value for name, value in model.parameters.items()}
    answer: dict[str, Any] = {}
    for name in names:
        tell(f"adding {name.replace('_', ' ')}")
        added = autotune.add_effect(
            name, recordings, model, progress=tell, source=str(wish.get("source", ""))
        )
        model, answer = added.model, added.to_json()
        steps.append(
            {"effect": name, "error_before": answer["error_before"], "error_after": answer["error_after"]}
        )
    answer["steps"], answer["model"] = steps, text_of(model)
    answer["previous"] = finite(before)
    return answer


def about(effect: str) -> dict[str, str]:
    """What an effect looks like, what causes it, and what can be done."""
    kind = effect_kind(effect)
    return {"looks_like": kind.looks_like, "cause": kind.cause, "remedy": kind.remedy}


ANSWERS: dict[str, Callable[[Wish, Tell], dict[str, Any]]] = {
    "fit": fit,
    "compare": compare,
    "diagnose": diagnose,
    "add": add,
}


def text_of(model: DriveModel) -> str:
    """A model's TOML."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.toml"
        write_model(model, path)
        return path.read_text(encoding="utf-8")


def model_of(text: object) -> DriveModel:
    """The model of a TOML text.

    Raises:
        ConfigurationError: no model, with what is wrong.
    """
    if not isinstance(text, str) or not text.strip():
        raise ConfigurationError("there is no model yet; fit one, or open a model file")
    return parse_model(text)


def _recordings(wish: Wish) -> list[Recording]:
    """Those that were asked for; rows within `left_out` ([first, last] in s, by recording) are not fitted."""
    paths: Sequence[str] = wish["paths"]
    if not paths:
        raise ConfigurationError("no recording is chosen; drop one on the page, or choose one in the list")
    gaps: Sequence[Sequence[Sequence[float]]] = wish.get("left_out") or [[]] * len(paths)
    return [_without(read_recording(path), gap) for path, gap in zip(paths, gaps, strict=True)]


def _without(recording: Recording, gaps: Sequence[Sequence[float]]) -> Recording:
    if not gaps:
        return recording
    time = recording["time"]
    out = np.zeros(len(time), dtype=bool)
    for first, last in gaps:
        out |= (time >= first) & (time <= last)
    names = recording.experiment.astype(object)
    names[out] = CONDITIONING
    return replace(recording, experiment=names.astype(np.str_))


def _single(values: Floats) -> list[float]:
    """Six digits suffice for a picture."""
    return [float(f"{value:.6g}") if np.isfinite(value) else 0.0 for value in values.tolist()]


def _bits(kinds: Mapping[str, Flags]) -> NDArray[np.int64]:
    """Kinds of motion of every row as bits of a number, in their order."""
    return np.asarray(
        sum(of.astype(np.int64) << bit for bit, of in enumerate(kinds.values())), dtype=np.int64
    )


def _spectrum(position: Floats, error: Floats) -> dict[str, list[float]]:
    """Amplitude of the error over cycles per motion unit: least squares on a grid at the travel's resolution.

    Returns:
        `order` [periods per motion unit], `amplitude` [N m or N] and `phase` [rad]: the error has a wave
        amplitude·cos(2π·order·position + phase). Empty where nothing moves.
    """
    travel = float(np.ptp(position))
    if not travel > 0.0:
        return {"order": [], "amplitude": [], "phase": []}
    bins = 4096
    slot = np.minimum(((position - position.min()) / travel * bins).astype(np.int64), bins - 1)
    count = np.bincount(slot, minlength=bins)
    mean = np.bincount(slot, error, bins) / np.maximum(count, 1)
    mean -= mean[count > 0].mean()
    mean[count == 0] = 0.0
    filled = max(float((count > 0).mean()), 1e-3)
    wave = np.fft.rfft(mean)
    amplitude = 2.0 * np.abs(wave) / bins / filled
    order = np.arange(len(amplitude)) / travel
    phase = np.angle(wave) - 2.0 * np.pi * order * (float(position.min()) + 0.5 * travel / bins)
    keep = slice(2, min(len(order), bins // 4))
    shown = {"order": order, "amplitude": amplitude, "phase": phase}
    return {name: values[keep].tolist() for name, values in shown.items()}
