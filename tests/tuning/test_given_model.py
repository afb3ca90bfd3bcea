"""A run with a model of the user's: what the report and run.json say of which model."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from autotune.models.drive_model import base_model
from autotune.models.table import EFFECTS
from autotune.tuning import summary
from autotune.tuning.diagnosis_pages import diagnosis_pictures, diagnosis_tables
from autotune.tuning.findings import Findings
from autotune.tuning.given_model import NOT_PLAYED, Given, not_proved, sentence
from autotune.tuning.stage_adapt import Adapted
from autotune.tuning.stage_diagnose import Diagnosed
from autotune.tuning.stage_model import ModelAdapted

BASE = base_model(
    {"inertia": 6.7e-4, "viscous": 4.2e-3, "coulomb": 0.33, "stiffness": 35.0, "micro_damping": 0.1, "offset": 0.05}
)  # fmt: skip
MINE = BASE.with_effect(EFFECTS["gravity_imbalance"].make({"sin": 0.02, "cos": 0.01}))
OWN = Diagnosed(
    "named", ("torque_ripple",), "confirmed", error_rms=0.02, error_before=0.02, error_after=0.005,
    candidates=({"effect": "torque_ripple", "gain": 0.9, "accepted": True, "why": ""},),
)  # fmt: skip


def modelled(*, chosen: bool) -> ModelAdapted:
    measured = SimpleNamespace(peak_error=2e-4, smooth_peak=2e-4)
    step = SimpleNamespace(measured=measured)
    return cast(ModelAdapted, SimpleNamespace(steps=(step,), best=step, chosen=chosen, reason="not better"))


def findings(given: Given | None, *, chosen: bool = True) -> Findings:
    lugre = SimpleNamespace(peak_error=1e-3)
    adapted = cast(Adapted, SimpleNamespace(steps=(lugre,), best=lugre))
    return Findings(diagnosed=OWN, given=given, modelled=modelled(chosen=chosen), adapted=adapted)


def texts(found: Findings) -> dict[str, str]:
    """Every table as its rows and note, by title."""
    return {
        one.title: "\n".join(["; ".join(row) for row in one.rows] + [one.note])
        for one in diagnosis_tables(found, "rad")
    }


def test_the_given_model_stands_first_and_under_its_own_name() -> None:
    tables = texts(findings(Given(MINE, 0.011, 0.02, 0.005)))
    assert next(iter(tables)) == "The model that was given"
    told = tables["The model that was given"]
    assert "effects; gravity imbalance" in told
    assert "on this run's experiments; 11.0 mN m" in told
    assert "that this run identified; 20.0 mN m" in told
    assert "that this run diagnosed; 5.00 mN m" in told
    assert "went to the proof; yes" in told
    assert "not about the one that was given" in tables["Diagnosis of the identified model"]
    assert "model that was given; 200 µrad" in tables["Feedforward candidates"]
    assert "diagnosed model" not in tables["Feedforward candidates"]
    captions = [
        picture.caption for picture in diagnosis_pictures(findings(Given(MINE, 0.011, 0.02, None)), "rad")
    ]
    assert captions
    assert all("not about the one that was given" in caption for caption in captions)


def test_without_one_nothing_is_said_of_it() -> None:
    tables = texts(findings(None))
    assert list(tables) == ["Diagnosis", "Effects", "Candidates", "Feedforward candidates"]
    assert "diagnosed model; 200 µrad" in tables["Feedforward candidates"]
    assert "given" not in " ".join(tables.values())
    assert summary.given(findings(None)) == {}
    assert summary.diagnosis(findings(None))["feedforward"]["chosen"]


def test_run_json_keeps_both_apart() -> None:
    found = findings(Given(MINE, 0.011, 0.02, None), chosen=False)
    said: dict[str, Any] = summary.given(found)
    assert said["effects"] == ["gravity_imbalance"]
    assert (said["error_rms"], said["identified_error_rms"], said["diagnosed_error_rms"]) == (
        0.011,
        0.02,
        None,
    )
    assert said["proved"] is False
    assert said["feedforward"]["steps"] == [{"peak_error": 2e-4, "smooth_peak": 2e-4}]
    own = summary.diagnosis(found)
    assert own["effects"] == ["torque_ripple"]
    assert own["feedforward"] is None, "what was played was not the diagnosed model's"


def test_why_it_did_not_go_to_the_proof() -> None:
    assert not_proved(None) == NOT_PLAYED
    assert not_proved(modelled(chosen=False)) == "not better"
    assert not_proved(modelled(chosen=True)) == ""
    told = texts(findings(Given(MINE, None, 0.02, None), chosen=False))["The model that was given"]
    assert "went to the proof; no: not better" in told
    assert "not comparable" in told
    assert "not comparable" in sentence(Given(MINE, None, 0.02, None))
