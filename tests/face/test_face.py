"""The public face: its names, what it refuses, and that it leaves the process as it was."""

from __future__ import annotations

import html
import importlib
import json
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import autotune
from autotune.cli.model_text import compared_lines, diagnosis_lines
from autotune.core.paths import config_directory
from autotune.models.drive_model import base_model

NUMBERS = {
    "inertia": 6.7e-4, "viscous": 4e-3, "coulomb": 0.33, "stiffness": 60.0, "micro_damping": 0.1, "offset": 0.05,
}  # fmt: skip


@pytest.fixture(scope="module")
def recording() -> autotune.Recording:
    return autotune.simulate("sim://edm-vertical?seed=3", programme="high-speed")


@pytest.fixture(scope="module")
def model() -> autotune.DriveModel:
    return base_model(NUMBERS)


def test_every_name_is_there_and_documented() -> None:
    assert set(autotune.__all__) <= set(dir(autotune))
    for name in autotune.__all__:
        assert getattr(autotune, name).__doc__, name


def test_an_unknown_name_is_an_attribute_error_that_lists_the_known() -> None:
    with pytest.raises(AttributeError, match="diagnose"):
        autotune.diagnos  # noqa: B018


def test_loading_the_package_diagnosis_leaves_the_function_diagnose() -> None:
    importlib.import_module("autotune.diagnosis.verdict")
    assert callable(autotune.diagnose)
    assert autotune.diagnose is importlib.import_module("autotune.api.models").diagnose


def test_results_are_json_words_and_a_page(
    recording: autotune.Recording, model: autotune.DriveModel, tmp_path: Path
) -> None:
    compared = autotune.compare(recording, model)
    content = compared.to_json()
    assert json.loads(json.dumps(content, allow_nan=False)) == json.loads(json.dumps(content))
    assert repr(compared).startswith("Comparison: error ")
    assert "<table>" in compared._repr_html_()
    inside = np.sqrt(np.mean(compared.error**2))
    assert 0.5 * compared.error_rms < inside < 2.0 * compared.error_rms  # rows left out are in the arrays
    compared.write_html(tmp_path / "compared.html")
    page = (tmp_path / "compared.html").read_text(encoding="utf-8")
    assert "plotly" in page.lower()
    assert not unsaid(page, compared_lines(compared))


def unsaid(page: str, lines: Iterable[str]) -> list[str]:
    """Words and numbers that the terminal says and the page does not."""
    shown = re.sub(r"<(script|style).*?</\1>|<[^>]+>", " ", page, flags=re.DOTALL)
    shown = html.unescape(shown).replace("−", "-").replace("_", " ").lower()
    words = re.findall(r"-?[0-9]+(?:\.[0-9]+)?|[a-z]{5,}", "\n".join(lines).lower().replace("_", " "))
    return sorted({word for word in words if word not in shown} - {"worst", "nothing", "recorded", "twice"})


def test_the_page_of_a_diagnosis_says_what_the_terminal_says(
    recording: autotune.Recording, model: autotune.DriveModel, tmp_path: Path
) -> None:
    found = autotune.diagnose(recording, model, candidates=["stribeck", "torque_ripple"])
    found.write_html(tmp_path / "diagnosis.html")
    page = (tmp_path / "diagnosis.html").read_text(encoding="utf-8")
    assert len(page.encode()) <= 1_500_000
    assert not [word for word in unsaid(page, diagnosis_lines(found)) if word not in ("could", "these")]
    over = found.overlay()
    assert over is not None
    assert list(over.contributions) == [one.effect for one in found.candidates]
    for effect, taken in over.contributions.items():  # none makes it worse where it was fitted
        assert taken.shape == over.time.shape == over.coordinates[over.follows[effect]].shape
        assert np.std(over.residual - taken) <= 1.001 * np.std(over.residual)


@pytest.mark.slow
def test_the_fit_of_the_face_tells_the_error_that_compare_finds(recording: autotune.Recording) -> None:
    fitted = autotune.fit(recording, source="ten seconds")
    assert fitted.valid
    assert fitted.model is not None
    assert fitted.model.history[-1].data == "ten seconds"
    assert fitted.error_rms == pytest.approx(autotune.compare(recording, fitted).error_rms, rel=1e-12)
    rows = {row["name"]: row for row in fitted.parameters}
    assert rows["inertia"]["low"] < rows["inertia"]["value"] < rows["inertia"]["high"]
    assert rows["inertia"]["value"] == fitted.to_json()["parameters"]["inertia"]["value"]
    assert "inertia" in repr(fitted)


def test_a_model_follows_the_references_of_a_recording(
    recording: autotune.Recording, model: autotune.DriveModel
) -> None:
    simulated = autotune.simulate(model, recording)
    assert set(simulated.floats) == {"time", "reference", "position", "torque"}
    off = simulated["position"] - simulated["reference"]
    assert math.sqrt(float(np.mean(off**2))) < 0.02 * float(np.std(simulated["reference"]))


def test_a_real_axis_does_not_move_unasked(tmp_path: Path) -> None:
    with pytest.raises(autotune.AutotuneError, match="yes=True"):
        autotune.tune(config_directory() / "axes" / "edm-vertical.toml", runs=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_one_stage_of_a_simulated_axis(tmp_path: Path) -> None:
    heard: list[str] = []
    result = autotune.tune("sim://edm-vertical", only="check", runs=tmp_path, progress=heard.append)
    assert result.stage_done
    assert result.run_directory.parent == tmp_path
    assert any(line.startswith("check") for line in heard)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: autotune.fit([]), "no recording"),
        (lambda: autotune.fit("absent.parquet"), "there is no recording"),
        (lambda: autotune.simulate("model.toml"), "simulate\\(model, recording\\)"),
        (lambda: autotune.simulate("sim://edm-vertcal"), "did you mean 'edm-vertical'"),
        (lambda: autotune.compare("absent.parquet", "absent.toml"), "there is no model"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(call, says: str) -> None:
    with pytest.raises(autotune.AutotuneError, match=says):
        call()


def test_threads_of_the_linear_algebra_are_as_the_caller_had_them(
    recording: autotune.Recording, model: autotune.DriveModel
) -> None:
    def threads() -> Mapping[str, int]:
        return {pool["filepath"]: pool["num_threads"] for pool in threadpool_info()}

    with threadpool_limits(2):
        before = threads()
        autotune.compare(recording, model)
        assert threads() == before


def test_a_table_without_pandas_is_refused_in_a_sentence(
    recording: autotune.Recording, model: autotune.DriveModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(importlib.import_module("sys").modules, "pandas", None)
    with pytest.raises(autotune.AutotuneError, match="needs pandas"):
        autotune.compare(recording, model).to_frame()
