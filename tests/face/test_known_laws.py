"""What a fit found out about a loop lies beside the model, and is taken up for the same question only."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.api import known_laws
from autotune.api.known_laws import keep_laws, take_laws
from autotune.core.arrays import Floats
from autotune.core.durable import write_checked
from autotune.core.remembered import Remembered
from autotune.diagnosis import compare
from autotune.estimation import controller, controller_unsaid, model_error
from autotune.estimation.controller_law import MOMENT, PositionController
from autotune.estimation.disturbance import STILL, Disturbance
from autotune.recordings.recording import Metadata, Recording

LAW = PositionController(
    16.4,
    0.02 / 3.0,
    1e3,
    source="identified",
    ticks=4,
    taken=MOMENT,
    answer_delay=1.0 / 3.0,
    explained=np.nan,
)
SHAKEN = Disturbance(white=1.0 / 7.0, coloured=1e-17, correlation=0.03)
ASKED, TOLD = (b"between", "of these columns"), ("with this model", b"\x00\xff")
Laws = tuple[PositionController, ...]


@pytest.fixture(autouse=True)
def forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    _forget(monkeypatch)


def _forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """From here on as in a process of its own."""
    laws: Remembered[Laws] = Remembered()
    told: Remembered[tuple[PositionController, Disturbance]] = Remembered()
    for place in (controller, known_laws):
        monkeypatch.setattr(place, "KNOWN_LAWS", laws)
    for place in (model_error, known_laws):
        monkeypatch.setattr(place, "TOLD_LAWS", told)
    fed: Remembered[Floats | None] = Remembered()
    for place in (controller_unsaid, known_laws):
        monkeypatch.setattr(place, "KNOWN_FED", fed)
    filters: Remembered[tuple[int, float] | None] = Remembered()
    for place in (controller_unsaid, known_laws):
        monkeypatch.setattr(place, "KNOWN_FILTERS", filters)
    stated: Remembered[tuple[float, float]] = Remembered()
    for place in (compare, known_laws):
        monkeypatch.setattr(place, "STATED", stated)


def _recording(off: float = 0.0, limit: float | None = None) -> Recording:
    time = np.arange(200) * 1e-3
    columns = {"time": time, "position": np.sin(time), "torque": np.cos(time) + off * (time > 0.1)}
    return Recording.from_columns(columns, Metadata(torque_limit=limit))


def _kept(folder: Path) -> Path:
    """A model's place with what a fit has left beside it."""
    known_laws.KNOWN_LAWS.answer(ASKED, lambda: (LAW, replace(LAW, ticks=6)))
    known_laws.TOLD_LAWS.answer(TOLD, lambda: (LAW, SHAKEN))
    known_laws.KNOWN_FED.answer("feeds none", lambda: None)
    known_laws.KNOWN_FED.answer("feeds some", lambda: np.ones(3))
    known_laws.KNOWN_FILTERS.answer("filters none", lambda: None)
    known_laws.KNOWN_FILTERS.answer("filters some", lambda: (2, 1.0 / 70.0))
    known_laws.STATED.answer("of the model", lambda: (1.0 / 3.0, 0.1))
    known_laws.STATED.answer("of no torque", lambda: (math.nan, math.nan))
    keep_laws(folder / "model.toml", [_recording()])
    return folder / "model.toml"


def _refuse() -> Laws:
    raise LookupError


def test_another_process_is_given_the_same_law_to_the_last_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = _kept(tmp_path)
    _forget(monkeypatch)
    with pytest.raises(LookupError):
        known_laws.KNOWN_LAWS.answer(ASKED, _refuse)
    assert take_laws(model, [_recording()])
    assert repr(known_laws.KNOWN_LAWS.answer(ASKED, _refuse)) == repr((LAW, replace(LAW, ticks=6)))
    assert repr(known_laws.TOLD_LAWS.answer(TOLD, lambda: (LAW, STILL))) == repr((LAW, SHAKEN))


def test_that_no_friction_is_fed_is_known_and_a_column_is_looked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = _kept(tmp_path)
    _forget(monkeypatch)
    assert take_laws(model, [_recording()])
    assert known_laws.KNOWN_FED.answer("feeds none", lambda: np.zeros(3)) is None
    assert np.array_equal(known_laws.KNOWN_FED.answer("feeds some", lambda: np.zeros(3)), np.zeros(3))


def test_a_filter_of_set_points_is_known_and_that_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = _kept(tmp_path)
    _forget(monkeypatch)
    assert take_laws(model, [_recording()])
    assert known_laws.KNOWN_FILTERS.answer("filters none", lambda: (0, 1.0)) is None
    assert known_laws.KNOWN_FILTERS.answer("filters some", lambda: None) == (2, 1.0 / 70.0)


def test_the_error_that_was_stated_of_a_model_is_known_to_the_last_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is no number is told again."""
    model = _kept(tmp_path)
    _forget(monkeypatch)
    assert take_laws(model, [_recording()])
    assert known_laws.STATED.answer("of the model", lambda: (0.0, 0.0)) == (1.0 / 3.0, 0.1)
    assert known_laws.STATED.answer("of no torque", lambda: (0.0, 0.0)) == (0.0, 0.0)


def test_a_question_that_was_not_asked_has_no_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = _kept(tmp_path)
    _forget(monkeypatch)
    assert take_laws(model, [_recording()])
    for other in (("between", "of these columns"), (b"between", "of other columns")):
        with pytest.raises(LookupError):
            known_laws.KNOWN_LAWS.answer(other, _refuse)


@pytest.mark.parametrize("other", [_recording(1e-15), _recording(limit=3.0)], ids=["a bit", "a setting"])
def test_other_recordings_leave_it_aside(tmp_path: Path, other: Recording) -> None:
    model = _kept(tmp_path)
    assert not take_laws(model, [other])
    assert not take_laws(model, [_recording(), other])
    assert take_laws(model, [_recording()])


def test_other_code_leaves_it_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = _kept(tmp_path)
    monkeypatch.setattr(known_laws, "_code", lambda: "of another day")
    assert not take_laws(model, [_recording()])


def test_a_changed_byte_leaves_it_aside(tmp_path: Path) -> None:
    model = _kept(tmp_path)
    file = model.with_suffix(".laws.json")
    text = file.read_text(encoding="utf-8")
    assert "16.4" in text
    file.write_text(text.replace("16.4", "16.5", 1), encoding="utf-8")
    assert not take_laws(model, [_recording()])
    file.write_text("{", encoding="utf-8")
    assert not take_laws(model, [_recording()])
    file.unlink()
    assert not take_laws(model, [_recording()])


def test_what_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    keep_laws(tmp_path / "no folder" / "model.toml", [_recording()])
    assert not take_laws(tmp_path / "no folder" / "model.toml", [_recording()])


@pytest.mark.parametrize("wrong", ["a text", None, {"kp": "1"}], ids=["text", "nothing", "no law"])
def test_what_is_no_law_is_none(tmp_path: Path, wrong: object) -> None:
    """Also where its checksum is right."""
    model = _kept(tmp_path)
    file = model.with_suffix(".laws.json")
    content = json.loads(file.read_text(encoding="utf-8"))
    content.pop("checksum")
    content["laws"] = {"mark": [wrong]}
    write_checked(file, content)
    assert not take_laws(model, [_recording()])
