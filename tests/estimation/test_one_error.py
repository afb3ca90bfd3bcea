"""fit, compare, diagnose and run state one error for one model on one recording."""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import autotune
from autotune.cli.main import main
from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis import fit_recordings as fit_module
from autotune.diagnosis.compare import compare
from autotune.diagnosis.fit_recordings import fit_recordings
from autotune.diagnosis.fit_result import FitResult
from autotune.diagnosis.verdict import diagnose
from autotune.identify.estimate import Estimate
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.model_file import read_model, write_model
from autotune.models.table import EFFECTS
from autotune.recordings.files import read_recording, write_recording
from autotune.recordings.recording import Controller, Recording, concatenate
from autotune.tuning.stage_diagnose import error_as_given, found_in
from tests.estimation.simulated import AXIS, OF_TRUE, TRUE, recorded

AGREE = 1e-9
CURRENT_LOOP = 3e-4
"""s, of an ordinary one."""
KINDS = (
    "known controller",
    "no controller named",
    "wrong controller named",
    "no reference",
    "no torque known but noise",
    "played three times",
    "cascade",
    "coarse in time",
    "lag",
    "spring that the model lacks",
    "saturation",
    "clamped",
    "three times behind a current loop",
)
"""What can be different in how the engines prepare a recording."""
QUICK = KINDS[:3]


def _quiet(_: str) -> None:
    pass


def simulated(kind: str, seed: int) -> Recording:
    """Three seconds of an axis drawn from the seed, recorded in one of the ways."""
    random = np.random.default_rng([seed, KINDS.index(kind)])
    values = {name: value * float(random.uniform(0.7, 1.4)) for name, value in AXIS.items()}
    model = base_model(values)
    law = replace(TRUE, kp=TRUE.kp * float(random.uniform(0.8, 1.2)))
    known: Controller | None = replace(OF_TRUE, kp=law.kp)
    if kind == "lag":
        model = model.with_effect(EFFECTS["torque_lag"].make({"time_constant": 1e-3}))
    if kind == "three times behind a current loop":
        model = model.with_effect(EFFECTS["torque_lag"].make({"time_constant": CURRENT_LOOP}))
    if kind == "saturation":
        model = model.with_effect(EFFECTS["torque_saturation"].make({"loss": 0.1, "torque": 0.6}))
    if kind == "spring that the model lacks":
        model = model.with_effect(EFFECTS["spring"].make({"stiffness": 5e-3}))
    if kind == "cascade":
        law, known = replace(law, reference_rate=0.3), None
    if kind == "no controller named":
        known = None
    if kind == "wrong controller named":
        known = OF_TRUE if abs(law.kp / TRUE.kp - 1.0) > 0.02 else replace(OF_TRUE, kp=2.0 * law.kp)
    limit = 0.4 if kind == "clamped" else None
    noise = 8e-3 if kind == "no torque known but noise" else 2e-3
    repeats = 3 if "three times" in kind else 1
    parts = [
        recorded(law, known, limit, model, 3.0, seed, noise * (1.0 + 0.01 * number))
        for number in range(repeats)
    ]
    recording = _numbered(parts) if repeats > 1 else parts[0]
    if kind == "no reference":
        columns = {name: values for name, values in recording.floats.items() if name != "reference"}
        recording = Recording.from_columns(columns, replace(recording.metadata, controller=None), "motion")
    if kind == "coarse in time":
        every = {name: values[::4] for name, values in recording.floats.items()}
        metadata = replace(recording.metadata, sample_period=4e-3)
        recording = Recording.from_columns(every, metadata, "motion")
    return recording


def _numbered(parts: list[Recording]) -> Recording:
    return concatenate(
        Recording.from_columns(part.floats, part.metadata, "motion", np.full(len(part), number))
        for number, part in enumerate(parts)
    )


Figures = tuple[float | None, float | None]


def stated(recording: Recording) -> dict[str, Figures]:
    """Error and relative error, by who states them."""
    fitted = fit_recordings([recording], progress=_quiet)
    assert fitted.model is not None
    compared = compare([recording], fitted.model)
    found = diagnose([recording], fitted.model)
    return {
        "fit": (fitted.error_rms, fitted.estimate.relative_error),
        "compare": (compared.error_rms, compared.relative_error),
        "diagnose": (found.error_rms, found.relative_error),
        "run": error_as_given(recording, fitted.model),
    }


def one_error(statements: dict[str, Figures]) -> dict[str, object]:
    """What all of them would state, were it what `compare` states."""
    return dict.fromkeys(statements, pytest.approx(statements["compare"], rel=AGREE))


def check_run(recording: Recording, model: DriveModel) -> tuple[str, ...]:
    """The run's stage and the library's diagnosis come to the same, model included; what they name."""
    ours, theirs = found_in([recording], model, "now", "here"), autotune.diagnose(recording, model)
    assert (ours.verdict, ours.effects, ours.confidence) == (
        theirs.verdict,
        theirs.effects,
        theirs.confidence,
    )
    assert [(c["effect"], c["gain"]) for c in ours.candidates] == [
        (c.effect, pytest.approx(c.gain, rel=AGREE)) for c in theirs.candidates
    ]
    richer = theirs.found_model()
    assert (ours.model is None) == (richer is None)
    if ours.model is not None and richer is not None:
        values = {name: value.value for name, value in richer.parameters.items()}
        assert {name: v.value for name, v in ours.model.parameters.items()} == pytest.approx(
            values, rel=AGREE
        )
    return ours.effects


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["spring that the model lacks", "no controller named"])
def test_run_and_diagnose_find_the_same(kind: str) -> None:
    effects = check_run(simulated(kind, 1), base_model(AXIS))
    assert ("spring" in effects) == kind.startswith("spring")


@pytest.mark.long
@pytest.mark.parametrize("seed", [3, 4])
def test_run_and_diagnose_find_the_same_in_the_standard_programme(seed: int) -> None:
    recording = autotune.simulate(f"sim://edm-vertical?seed={seed}", programme="identification")
    model = fit_recordings([recording], progress=_quiet).model
    assert model is not None
    statements = stated(recording)
    assert statements == one_error(statements)
    assert set(check_run(recording, model)) == {"reversal_memory", "torque_ripple"}  # what it was built with
    added = autotune.add_effect("reversal_memory", recording, model)
    assert added.model["reversal_memory.displacement_1"] < 0.01  # resolved down to the first contacts


@pytest.mark.parametrize(
    "kind", [kind if kind in QUICK else pytest.param(kind, marks=pytest.mark.slow) for kind in KINDS]
)
def test_fit_compare_diagnose_and_run_state_one_error(kind: str) -> None:
    statements = stated(simulated(kind, 1))
    assert statements == one_error(statements)


@pytest.mark.slow
def test_a_fit_behind_a_current_loop_is_the_axis_s_own() -> None:
    """Taken as recorded, the torque made viscosity 8 % smaller, damping in presliding a third larger."""
    kind = "three times behind a current loop"
    random = np.random.default_rng([1, KINDS.index(kind)])
    true = {name: value * float(random.uniform(0.7, 1.4)) for name, value in AXIS.items()}
    fitted = fit_recordings([simulated(kind, 1)], progress=_quiet)
    assert fitted.model is not None
    for name, near in {"inertia": 0.005, "viscous": 0.03, "coulomb": 0.01, "micro_damping": 0.1}.items():
        assert fitted.model[name] == pytest.approx(true[name], rel=near), name


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize("kind", KINDS)
def test_fit_compare_diagnose_and_run_state_one_error_on_many(kind: str, seed: int) -> None:
    statements = stated(simulated(kind, seed))
    assert statements == one_error(statements)


def test_the_error_of_a_run_is_what_compare_finds_in_its_files(tmp_path: Path) -> None:
    """Recording and model go through their files, as they do between `run` and `model compare`."""
    recording = simulated("known controller", 1)
    model = fit_recordings([recording], progress=_quiet).model
    assert model is not None
    write_recording(recording, tmp_path / "experiment.parquet")
    write_model(model, tmp_path / "model.toml")
    compared = compare([read_recording(tmp_path / "experiment.parquet")], read_model(tmp_path / "model.toml"))
    found = error_as_given(recording, model)
    assert found == pytest.approx((compared.error_rms, compared.relative_error), rel=AGREE)


def test_a_run_without_a_fit_for_comparison_says_nothing() -> None:
    recording = simulated("known controller", 1)
    short = recording.rows(slice(0, 150))
    with pytest.raises(NotEnoughExcitation):
        compare([short], base_model(AXIS))
    assert error_as_given(short, base_model(AXIS)) == (None, None)


def test_the_command_line_prints_one_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, model = tmp_path / "axis.parquet", tmp_path / "model.toml"
    write_recording(simulated("no controller named", 1), recording)
    found = []
    for arguments in (
        ("fit", recording, "--out", model),
        ("compare", recording, "--model", model),
        ("diagnose", recording, "--model", model),
    ):
        with pytest.raises(SystemExit):
            main(["model", *map(str, arguments), "--json"])
        printed = json.loads(capsys.readouterr().out)
        found.append((printed["error_rms"], printed["relative_error"]))
    assert found[0] == pytest.approx(found[1], rel=AGREE)
    assert found[2] == pytest.approx(found[1], rel=AGREE)


@pytest.mark.parametrize(
    ("error", "noise", "valid", "said"),
    [
        (0.2, 0.0, True, ""),
        (0.7, 0.1, True, "leaves 70 % of the torque (rms) unexplained"),
        (0.7, 0.65, True, ""),
        (0.7, math.nan, True, "leaves 70 % of the torque (rms) unexplained"),
        (1.11, 0.0, False, "hardly any"),
    ],
)
def test_a_fit_says_how_little_it_explains(
    monkeypatch: pytest.MonkeyPatch, error: float, noise: float, valid: bool, said: str
) -> None:
    """An encoder of 0.7 mm eccentricity: the fit was valid with an error of 111 % of the torque."""
    once: Any = SimpleNamespace(data=SimpleNamespace(repeated=False))
    compared = SimpleNamespace(problem=once, relative_error=error, error_rms=error, noise_floor_rms=noise)
    monkeypatch.setattr(fit_module, "unseen_error", lambda *_: None)
    result = FitResult(base_model(AXIS), "programme", Estimate("all", relative_error=0.02), ())
    found = fit_module._with_error(result, cast(Any, compared))
    assert found.valid is valid
    assert said in found.reason
    assert bool(said) is bool(found.reason)
