"""The noise floor as an estimate, the error on unseen data, and terms that chance made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from autotune.diagnosis import compare as comparing
from autotune.diagnosis.compare import EACH_IN_TURN, compare, unseen_error
from autotune.diagnosis.fitting import add_effect, fit_model
from autotune.diagnosis.refits import is_chance, without_insignificant_terms
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.data import TRAINING, Block
from autotune.estimation.least_squares import Fitted, Free, covariance
from autotune.estimation.model_error import noise_floor
from autotune.estimation.problem import new_problem
from autotune.models.drive_model import REFITTED, HistoryEntry, Packed, staircase
from autotune.models.table import EFFECTS
from autotune.models.waves import ripple_waves
from autotune.recordings.recording import Metadata, Recording

TRUE = 0.003
RIPPLE = EFFECTS["torque_ripple"]


def _problem(short, rows: int, repeats: int):
    """A problem of one experiment, `repeats` times `rows` long, whose only content is what a test puts there."""
    problem = new_problem(compare([short], _plain()).problem.data, None)
    block = Block("one", TRAINING, 0, repeats, rows)
    grid = np.arange(rows * repeats)
    return replace(problem, data=replace(problem.data, grid=grid, blocks=(block,)), weight=np.ones(len(grid)))


def _plain():
    from autotune.models.drive_model import base_model
    from tests.support.axes import NOMINAL

    return base_model(NOMINAL)


def test_what_was_stated_of_a_model_is_known_and_of_another_is_not(
    short: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, asked = _plain(), []
    compared = compare([short], model)
    own = comparing._stated_error
    monkeypatch.setattr(comparing, "_stated_error", lambda *about: asked.append(about) or own(*about))
    assert comparing.stated(prepared_for([short]), model) == (compared.error_rms, compared.relative_error)
    assert not asked
    heavier = model.with_values({"inertia": model["inertia"] * (1.0 + 1e-15)})
    comparing.stated(prepared_for([short]), heavier)
    assert len(asked) == 1


@pytest.mark.parametrize("colour", [0.0, 0.8, 0.95])
def test_the_interval_of_the_floor_contains_the_noise(short, colour: float) -> None:
    """Of 200 draws 95 % ± 5 % (three binomial standard deviations): with coloured noise too."""
    problem = _problem(short, 2000, 2)
    random = np.random.default_rng(7)
    inside = 0
    for _ in range(200):
        white = random.normal(0.0, TRUE * np.sqrt(1.0 - colour**2), (2, 2400))
        noise = lfilter([1.0], [1.0, -colour], white, axis=1)[:, 400:]
        missing = 0.02 * np.sin(np.arange(2000) / 50.0)  # what a model lacks is in all repeats alike
        found = noise_floor(problem, (noise + missing).ravel(), np.ones(4000, dtype=bool))
        inside += found.low <= TRUE <= found.high
    assert 0.90 * 200 <= inside <= 0.99 * 200


def test_without_repeats_the_floor_is_unknown(short) -> None:
    assert noise_floor(_problem(short, 2000, 1), np.ones(2000), np.ones(2000, dtype=bool)) is None


def test_the_error_on_unseen_data_is_not_the_fits_own(recorded, nominal) -> None:
    result = compare([recorded(41, spring=0.004)], nominal)
    unseen = unseen_error(result, nominal)
    rows = result.rows & result.problem.data.role("veto", "test")
    assert unseen.data == "veto and test"
    assert unseen.rms == pytest.approx(float(np.sqrt(np.mean(result.error[rows] ** 2))))
    assert unseen.rms != pytest.approx(result.error_rms, rel=0.01)


def test_without_a_veto_each_experiment_is_held_out(short, nominal) -> None:
    result = compare([short.rows(~np.isin(short.experiment, ["veto", "test"]))], nominal)
    unseen = unseen_error(result, nominal)
    assert unseen.data == EACH_IN_TURN
    assert (
        unseen.floor.low < unseen.rms < 1.5 * result.error_rms
    )  # the others' refit predicts it, at most noise


def test_stairs_tell_what_a_later_step_found_on_other_data() -> None:
    old = HistoryEntry("1", "fitted", "a", None, 0.0212, 0.003)
    new = HistoryEntry("2", "+ spring", "a", 0.0168, 0.005, 0.003, "veto and test")
    assert [stair.error for stair in staircase([old, new])] == [0.0168, 0.005]
    same = replace(old, unseen="veto and test")
    refitted = staircase([same, new])
    assert [stair.error for stair in refitted] == [0.0212, 0.0168, 0.005]
    assert [stair.action for stair in refitted] == ["fitted", REFITTED, "+ spring"]
    chained = replace(new, error_before=0.0212)
    assert [stair.error for stair in staircase([same, chained])] == [0.0212, 0.005]


@pytest.mark.slow(5)
def test_waves_that_chance_made_are_pruned_and_the_real_one_kept(recorded, nominal) -> None:
    """One wave of 10 mN m is planted; five more orders are put into the model at a tenth of their error."""
    from autotune.diagnosis.baseline import begin
    from autotune.diagnosis.fitting import grown
    from autotune.estimation.bandwidth import prepared_for

    recording = recorded(45, torque_ripple=0.01)
    problem, root, start, _ = begin(prepared_for([recording]), nominal)
    _, _, model_fit = grown(problem, root, start, "torque_ripple", nominal)
    kept = RIPPLE.terms_in_use(model_fit.fitted.packed.p)
    assert not is_chance(problem, model_fit, RIPPLE)
    crowded = _with_chance_waves(problem, model_fit, len(kept))
    pruned = without_insignificant_terms(problem, crowded)
    assert RIPPLE.terms_in_use(pruned.fitted.packed.p) == kept
    orders = [model_fit.fitted.packed.p[RIPPLE.parameter(f"order_{i}").slot] for i in kept]
    found = [pruned.fitted.packed.p[RIPPLE.parameter(f"order_{i}").slot] for i in kept]
    assert found == pytest.approx(orders, abs=0.01), (
        "far within what the travel of one and a half turns resolves"
    )


def test_an_effect_that_is_chance_alone_is_said_to_be_where_it_was_asked_for() -> None:
    """One term of it stays, as asked; four seconds of a sine with noise, and nothing planted."""
    time = 1e-3 * np.arange(4000)
    position, velocity = 0.5 * np.sin(2.0 * np.pi * time), np.pi * np.cos(2.0 * np.pi * time)
    torque = 0.3 * np.sign(velocity) + 4e-3 * velocity - 6.6e-4 * 4.0 * np.pi**2 * position
    columns = {
        "time": time,
        "position": position,
        "velocity": velocity,
        "torque": torque + 1e-3 * np.random.default_rng(1).normal(size=4000),
    }
    plain = Recording.from_columns(columns, Metadata(sample_period=1e-3), "sine")
    added = add_effect("torque_ripple", [plain], fit_model([plain]).model, "now", "here")
    assert any("no more than chance" in note for note in added.notes)
    assert len(list(ripple_waves(added.model))) == 1


def _with_chance_waves(problem, model_fit: ModelFit, present: int) -> ModelFit:
    from autotune.estimation.problem import refit

    p, free = model_fit.fitted.packed.p.copy(), list(model_fit.free)
    for number, order in enumerate((31.0, 53.0, 87.0), present + 1):
        p[RIPPLE.parameter(f"order_{number}").slot] = order
        for part in ("sin", "cos"):
            parameter = RIPPLE.parameter(f"{part}_{number}")
            surface = RIPPLE.surface(parameter.name)
            free.append(Free(surface, parameter.slot, parameter.lower, parameter.upper, 0.01))
    fitted = refit(problem, Packed(p, model_fit.fitted.packed.on), free, model_fit.correction, 3)
    return ModelFit(fitted, model_fit.correction, model_fit.unseen, model_fit.effects)


def test_covariance_of_a_straight_line() -> None:
    """Two known columns and unit noise: the textbook (XᵀX)⁻¹·s², rows counted one by one."""
    random = np.random.default_rng(3)
    columns = np.column_stack([np.ones(400), np.linspace(-1, 1, 400)])
    error = random.normal(0.0, 1.0, 400)
    free = (Free("offset", 0, -1, 1, 1.0), Free("viscous", 1, -1, 1, 1.0))
    fitted = Fitted(Packed(np.zeros(2), np.zeros(0, dtype=bool)), free, error, columns, np.ones(2), 1.0)
    found = covariance(fitted, np.ones(400), correlated=1.0)
    wanted = np.linalg.inv(columns.T @ columns) * float(error @ error) / 398.0
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def test_a_wave_has_amplitude_phase_and_an_error(nominal) -> None:
    values = {"order_1": 12.0, "sin_1": 0.03, "cos_1": 0.04}
    errors = {"sin_1": 0.001, "cos_1": 0.001}
    (wave,) = ripple_waves(nominal.with_effect(RIPPLE.make(values, errors)))
    assert (wave.order, wave.amplitude) == (12.0, pytest.approx(0.05))
    assert wave.phase == pytest.approx(np.arctan2(0.04, 0.03))
    assert wave.standard_error == pytest.approx(0.001)
