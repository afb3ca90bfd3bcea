"""When torque and position were taken is a nuisance of repeated recordings, as far as a measurement chain can do it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.candidates import FittedCandidate, again_explained, plainer
from autotune.diagnosis.evidence import repeated
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.evidence.repeated import RepeatedProgramme
from autotune.diagnosis.evidence.single import SingleRecording
from autotune.diagnosis.evidence.time_driven import TimeLine, without_line
from autotune.diagnosis.found_model import torque_late
from autotune.diagnosis.search import _Search
from autotune.diagnosis.wording import torque_path_notes
from autotune.estimation import disturbance_estimate
from autotune.estimation.alignment import behind_current_loop, shifted
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.contact_start import (
    _certainty,
    damped_as_twins_creep,
    less_after_rests,
    sticking,
)
from autotune.estimation.coordinates import since_rest, without_rests
from autotune.estimation.cross_validation import Explained, explained
from autotune.estimation.data import TRAINING, Prepared
from autotune.estimation.disturbance_estimate import (
    by_certainty,
    estimate_disturbance,
    null_errors,
    with_counts,
)
from autotune.estimation.least_squares import Free
from autotune.estimation.problem import Problem, refit
from autotune.estimation.residual import measured_motion, residual
from autotune.estimation.twin_runs import SEED
from autotune.models import layout
from autotune.models.drive_model import Packed, base_model
from autotune.models.dwell_time_break_away import DWELL_TIME_BREAK_AWAY
from autotune.models.torque_lag import IS_LATE, MOTOR_TORQUE, TIME_CONSTANT
from autotune.models.torque_path import delivered
from tests.support.axes import NOMINAL

Begun = tuple[Problem, ModelFit]
DWELL = DWELL_TIME_BREAK_AWAY.name


@pytest.fixture(scope="module")
def begun(short) -> Begun:
    return begin(prepared_to_fit([short]), base_model(NOMINAL))[:2]


def _spoilt(begun: Begun, data: Prepared, exact: bool) -> Begun:
    """Problem and fit with other data in place of those that fit, under a law of the samples or of a drive."""
    problem, model_fit = begun
    law = replace(problem.controller, exact=exact, in_band=not exact)
    data = replace(data, recorded_torque=data.torque, shift=0.0)
    problem = replace(problem, data=data, moved=measured_motion(data), controller=law)
    fitted = refit(problem, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, 2)
    return problem, replace(model_fit, fitted=fitted)


@pytest.mark.parametrize(
    ("late", "applied"), [(0.8, True), (-3.5, False)], ids=["recorded early", "more than any chain"]
)
def test_what_the_measurement_chain_can_do_is_taken_out(begun: Begun, late: float, applied: bool) -> None:
    """`late`: half samples of 1 ms by which the torque of a drive's own loop must be moved to be where it was.

    This axis has a quarter of a half sample of its own, whatever `late` is; the difference of two has not.
    """
    problem, model_fit = _spoilt(begun, shifted(begun[0].data, -late), exact=False)
    again = RepeatedProgramme().aligned(problem, model_fit)
    assert (again is not problem) == applied
    if applied:
        other = RepeatedProgramme().aligned(*_spoilt(begun, shifted(begun[0].data, late), exact=False))
        assert again.data.shift - other.data.shift == pytest.approx(2.0 * late, abs=0.1)
        assert again.data.shift == pytest.approx(late, abs=0.3)


def _demand(data: Prepared, lag: float) -> Floats:
    """What a current loop of this time constant [s] must be asked for to deliver the torque of these data."""
    ratio = data.period / lag
    left = math.exp(-ratio)
    mean = (1.0 - left) / ratio
    asked = data.torque.copy()
    for stretch in data.stretches:
        reached = float(data.torque[stretch.start])
        for k in range(stretch.start, stretch.stop):
            asked[k] = (data.torque[k] - reached * mean) / (1.0 - mean)
            reached = asked[k] - (asked[k] - reached) * left
    return asked


@pytest.mark.parametrize(
    ("lag", "cycles", "found"),
    [(3e-4, 0, 3e-4), (2e-4, 2, 2e-4), (6e-4, 0, None), (1.3e-3, 0, None)],
    ids=["a current loop", "behind a bus", "a slow one", "a filter of more than a cycle"],
)
@pytest.mark.parametrize("evidence", [RepeatedProgramme(), SingleRecording()], ids=["repeated", "single"])
def test_an_ordinary_current_loop_behind_a_held_demand_is_taken_out(
    begun: Begun, evidence: Evidence, lag: float, cycles: int, found: float | None
) -> None:
    """And whole cycles; a longer lag stays, whole cycles in its place would bend the torque otherwise."""
    asked = replace(begun[0].data, torque=_demand(begun[0].data, lag))
    asked = shifted(replace(asked, recorded_torque=asked.torque), 2.0 * cycles)
    problem, model_fit = _spoilt(begun, asked, exact=True)
    again = evidence.aligned(problem, model_fit)
    if found is None:
        assert again is problem
        return
    assert again.data.lag == pytest.approx(found, abs=3e-5)
    assert again.data.cycles == cycles
    assert 0.0 < again.data.lag_error < 3e-5
    fitted = refit(again, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, 4)
    settled = evidence.aligned(again, replace(model_fit, fitted=fitted))
    assert settled.data.lag == pytest.approx(again.data.lag, abs=2.0 * again.data.lag_error)
    assert settled.data.cycles == cycles, "nothing more is left to be taken out"
    late = replace(again, data=replace(again.data, recorded_torque=problem.data.torque))
    assert torque_late(cast(Any, SimpleNamespace(problem=late))) == pytest.approx(
        cycles * 1e-3 + found, abs=3e-5
    )
    notes = torque_path_notes(again.data)
    assert len(notes) == 1 + (cycles > 0)
    assert all("no effect of the axis" in note for note in notes)


def test_a_model_that_has_a_lag_keeps_it(begun: Begun) -> None:
    asked = replace(begun[0].data, torque=_demand(begun[0].data, 3e-4))
    problem, model_fit = _spoilt(begun, asked, exact=True)
    packed = model_fit.fitted.packed
    on = packed.on.copy()
    on[IS_LATE] = True
    own = replace(model_fit, fitted=replace(model_fit.fitted, packed=Packed(packed.p, on)))
    assert RepeatedProgramme().aligned(problem, own) is problem


def test_what_a_demand_becomes_behind_a_current_loop_is_what_the_model_makes_of_it(begun: Begun) -> None:
    data = begun[0].data
    data = replace(data, stretches=data.stretches[:1], torque=data.recorded_torque, shift=0.0)
    rows, lag = slice(0, 2000), 7e-4
    packed = begun[1].fitted.packed
    p, on = packed.p.copy(), packed.on.copy()
    p[TIME_CONSTANT], on[IS_LATE] = lag, True
    state = np.zeros(layout.STATES)
    state[MOTOR_TORQUE] = data.torque[rows][0]
    modelled = np.array([delivered(p, on, state, float(u), data.period) for u in data.torque[rows]])
    assert behind_current_loop(data, lag).torque[rows] == pytest.approx(modelled, rel=1e-9, abs=1e-12)
    assert behind_current_loop(behind_current_loop(data, lag), 0.0).torque == pytest.approx(
        data.recorded_torque
    )


def test_a_current_loop_is_no_noise_of_the_torque_sensor(begun: Begun) -> None:
    problem, model_fit = begun
    data = behind_current_loop(problem.data, 3e-4)
    late = replace(problem, data=data, moved=measured_motion(data))
    before, after = (estimate_disturbance(one, model_fit.fitted.packed) for one in (problem, late))
    step = 1e-3 * float(np.std(problem.data.torque))
    prompt = replace(late, data=replace(data, lag=0.0))
    wrong = estimate_disturbance(prompt, model_fit.fitted.packed)
    assert after.sensor < before.sensor + step
    assert wrong.sensor > after.sensor + step


def test_a_lag_is_no_candidate_where_nothing_tells_how_the_columns_belong_together(begun: Begun) -> None:
    problem, evidence = begun[0], RepeatedProgramme()
    assert "torque_lag" in {kind.name for kind in evidence.candidates(problem)}
    assert "torque_lag" not in {kind.name for kind in evidence.candidates(replace(problem, controller=None))}


@pytest.mark.parametrize(
    ("lag", "known", "before", "own"),
    [(1e-4, True, 0.0, True), (5e-4, True, 0.0, False), (5e-4, False, 0.0, True), (2e-4, True, 4e-4, False)],
    ids=["ordinary", "longer", "not beyond doubt", "longer with what was taken out"],
)
def test_a_lag_that_any_current_loop_has_is_no_effect(
    begun: Begun, lag: float, known: bool, before: float, own: bool
) -> None:
    problem, fitted = begun[0], begun[1].fitted
    problem = replace(problem, data=replace(problem.data, lag=before))
    p = fitted.packed.p.copy()
    p[TIME_CONSTANT] = lag
    free = Free("torque_lag.time_constant", TIME_CONSTANT, 0.0, 0.1, 1e-3)
    error = np.sin(np.arange(len(fitted.error))) * problem.training
    other = np.cos(np.arange(len(error)))[:, None] * (30.0 if known else 1.0)
    fitted = replace(
        fitted,
        packed=replace(fitted.packed, p=p),
        free=(free,),
        error=error,
        jacobian=other,
        scales=np.array([1e-3]),
    )
    model_fit = replace(begun[1], fitted=fitted)
    candidate = FittedCandidate("torque_lag", model_fit, 0.1, Explained(1.0, 0.0), None, named=True)
    for evidence in (RepeatedProgramme(), SingleRecording()):
        assert evidence.of_the_chain(problem, candidate) == own


def test_noise_that_is_swallowed_explains_nothing_again(begun: Begun) -> None:
    """What two repeats share falls by what is taken from both, not by what is taken from their difference."""
    problem, before = begun
    block = next(block for block in problem.data.blocks if block.repeats > 1)
    error = before.fitted.error.copy()
    apart = error[block.rows].reshape(block.repeats, block.count)
    apart[:] += np.array([1.0, -1.0])[:, None] * 0.1
    noisy = replace(before, fitted=replace(before.fitted, error=error))
    assert again_explained(problem, noisy, before) < 0.0
    together = before.fitted.error.copy()
    together[block.rows] += 0.1
    common = replace(before, fitted=replace(before.fitted, error=together))
    assert again_explained(problem, common, before) > 0.0


@pytest.mark.parametrize(
    ("effect", "gain", "named", "sure"),
    [
        ("reversal_memory", 0.7, True, True),
        ("reversal_memory", 0.7, False, False),
        ("reversal_memory", 0.05, True, False),
        ("torque_lag", 0.7, True, False),
    ],
)
def test_what_remembers_need_not_come_again_where_experiments_held_out_and_veto_are_explained(
    begun: Begun, effect: str, gain: float, named: bool, sure: bool
) -> None:
    """A lag smooths noise and says nothing of it; elements have another past in every repeat."""
    problem, root = begun
    all_of_it = Explained(1e-4, 1e-6)
    best = FittedCandidate(effect, root, gain, all_of_it, all_of_it, named)
    search = _Search(problem, root, root.fitted.packed, print, RepeatedProgramme())
    assert search._remembers(best) == sure
    assert not search._remembers(replace(best, veto=None))


@pytest.mark.parametrize(
    ("effect", "named", "more", "taken"),
    [
        ("spring", True, 0.5, True),
        ("spring", True, 2.0, False),
        ("spring", False, 0.5, False),
        ("torque_lag", True, 0.5, False),
    ],
)
def test_a_memory_that_a_spring_explains_as_well_is_that_spring(
    begun: Begun, effect: str, named: bool, more: float, taken: bool
) -> None:
    """`more`: what it leaves beyond the memory, over the 3 % of what is explained that count as alike."""
    problem, root = begun
    rows = problem.training > 0
    memory = FittedCandidate("reversal_memory", root, 0.9, Explained(1.0, 0.0), None, named=True)
    error = np.sqrt(root.fitted.error**2 + rows * more * 0.03)
    fitted = replace(root, fitted=replace(root.fitted, error=error))
    other = FittedCandidate(effect, fitted, 0.9, Explained(1.0, 0.0), None, named)
    assert plainer(problem, [memory, other], memory, 0.03) is (other if taken else memory)
    assert plainer(problem, [memory, other], other, 0.03) is other


@pytest.mark.slow
def test_damping_in_presliding_is_found_again_by_twins_where_a_fit_was_led_astray(begun: Begun) -> None:
    """From four times the damping, all else at its best there; what is left stays as it is."""
    problem, root = begun
    own = float(root.fitted.packed.p[layout.MICRO_DAMPING])
    astray = [replace(one, lower=4.0 * own) if one.slot == layout.MICRO_DAMPING else one for one in root.free]
    p = root.fitted.packed.p.copy()
    p[layout.MICRO_DAMPING] = 4.0 * own
    wrong = fit_inside_twin(problem, Packed(p, root.fitted.packed.on), astray, 2)
    assert wrong is not None
    assert wrong.fitted.cost > 1.05 * root.fitted.cost
    wrong = replace(wrong, fitted=replace(wrong.fitted, free=root.free))
    found = damped_as_twins_creep(problem, wrong)
    assert found.fitted.cost < 1.02 * root.fitted.cost
    assert float(found.fitted.packed.p[layout.MICRO_DAMPING]) == pytest.approx(own, rel=0.4)
    assert damped_as_twins_creep(replace(problem, controller=None), wrong) is wrong


@pytest.mark.slow
def test_counts_that_are_coarse_come_again_in_each_twin_and_differ_between_twins(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a fine encoder next to nothing, of one with twenty times the count far more than of that.

    Four draws of twins: by one of them it is known to a fifth of the noise.
    """
    problem, packed = begun[0], begun[1].fitted.packed
    coarse = replace(problem, data=replace(problem.data, resolution=20.0 * problem.data.resolution))
    draws = []
    for seed in range(4):
        monkeypatch.setattr(disturbance_estimate, "SEED", SEED + seed)
        draws.append([with_counts(one, packed).comes_by_counts(TRAINING)[0] for one in (problem, coarse)])
    fine, much = np.mean(draws, axis=0)
    noise = problem.noise_variance(begun[1].fitted.error, TRAINING)
    assert fine < 0.15 * noise
    assert much > 5.0 * fine


def test_rows_where_the_twin_is_chaotic_count_less(begun: Begun) -> None:
    """Between counts a twin has a course of its own in every repeat; where it moves on all twins agree."""
    problem, model_fit = begun
    plain = replace(
        problem,
        data=replace(problem.data, certainty=None),
        weight=np.ones_like(problem.weight),
        disturbance=replace(problem.disturbance, jitter=0.0),
    )
    weighted = by_certainty(plain, model_fit.fitted.packed)
    certainty = weighted.data.certainty
    assert certainty is not None
    assert weighted.weight == pytest.approx(certainty)
    rows = problem.data.role(TRAINING)
    speed = np.abs(problem.data.velocity[problem.data.grid])[rows]
    slow, quick = speed < np.quantile(speed, 0.1), speed > np.quantile(speed, 0.5)
    assert np.mean(certainty[rows][slow]) < 0.75 * np.mean(certainty[rows][quick])
    # what all rows have alike is the same either way
    alike = np.random.default_rng(3).normal(0.0, 1e-3, len(rows))
    for one in (plain, weighted):
        assert one.noise_variance(alike, TRAINING) == pytest.approx(1e-6, rel=0.15)
        assert one.noise_variance(alike, TRAINING, plain=True) == pytest.approx(1e-6, rel=0.1)
        assert one.mean_square(alike, TRAINING) == pytest.approx(1e-6, rel=0.15)


def test_without_a_twin_all_rows_count_alike(begun: Begun) -> None:
    without = replace(begun[0], controller=None)
    assert by_certainty(without, begun[1].fitted.packed) is without


def test_what_counts_make_come_again_is_no_structure_and_is_excused_in_part(begun: Begun) -> None:
    problem, model_fit = begun
    missing = 0.02 * np.sin(np.arange(len(model_fit.fitted.error)) / 15.0)
    wave = np.zeros_like(missing)
    for block in problem.data.blocks:
        wave[block.rows] = np.tile(missing[: block.count], block.repeats)
    spoilt = replace(model_fit, fitted=replace(model_fit.fitted, error=model_fit.fitted.error + wave))
    known = replace(problem, by_counts=np.full((3, len(problem.data.blocks)), 4e-4))
    unknown = replace(problem, by_counts=None)
    assert RepeatedProgramme().structure_left(unknown, spoilt)
    assert not RepeatedProgramme().structure_left(known, spoilt)
    worse = replace(model_fit.fitted, error=model_fit.fitted.error + 2.0 * wave)
    shares = [
        explained(one, worse, spoilt.fitted, model_fit.correction, TRAINING) for one in (unknown, known)
    ]
    assert shares[0].excused == 0.0
    assert shares[1].share > shares[0].share
    assert shares[1].plain_share == pytest.approx(shares[0].share)
    assert shares[1].excused <= 0.25 * shares[1].fall * (1.0 + 1e-9)


def _in_the_fastest(problem: Problem, size: float) -> np.ndarray:
    """An error that comes again in one experiment: a wave of this size [N m], shape (m,)."""
    block = next(block for block in problem.data.blocks if block.name == "points")
    wave = np.zeros(len(problem.data.grid))
    wave[block.rows] = np.tile(size * np.sin(np.arange(block.count) / 3.0), block.repeats)
    return wave


def test_what_replicas_that_lack_nothing_leave_is_no_structure(begun: Begun, monkeypatch) -> None:
    """The same rest is unknown beside a twin that is exact, and the chain's own beside one that makes as much of it."""
    problem, model_fit = begun
    wave = _in_the_fastest(problem, 0.03)
    spoilt = replace(model_fit, fitted=replace(model_fit.fitted, error=model_fit.fitted.error + wave))
    assert RepeatedProgramme().structure_left(problem, spoilt)
    own = [model_fit.fitted.error + scale * wave for scale in (0.8, 0.9, 1.0, 1.1)]
    monkeypatch.setattr(repeated, "null_errors", lambda *_: own)
    assert not RepeatedProgramme().structure_left(problem, spoilt)
    monkeypatch.setattr(repeated, "null_errors", lambda *_: own[:2])
    assert RepeatedProgramme().structure_left(problem, spoilt), "two of eight tell nothing"


def test_replicas_are_as_noisy_as_the_axis_and_share_next_to_nothing(begun: Begun) -> None:
    """The disturbance is varied by a factor of 1.4 either way; noise is its square. None without a law."""
    problem, model_fit = begun
    noise = problem.noise_variance(model_fit.fitted.error, TRAINING)
    replicas = null_errors(problem, model_fit)
    levels = [problem.noise_variance(error, TRAINING) / noise for error in replicas]
    again = [problem.repeatable(error, model_fit.correction, TRAINING)[0] / noise for error in replicas]
    over = np.array(again) / levels
    assert len(replicas) == 8
    assert 0.5 < float(np.median(levels)) < 2.0
    assert abs(float(np.mean(over))) < 0.15
    assert np.max(np.abs(over)) < 0.5, "half a minute"
    assert levels[-1] > 1.5 * levels[0]
    assert null_errors(replace(problem, controller=None), model_fit) == []
    rough = replace(problem, controller=None, rough=problem.controller)
    assert len(null_errors(rough, model_fit)) == 8


def test_how_far_a_bristle_is_stretched_at_a_rest_is_taken_out_and_nothing_else(begun: Begun) -> None:
    problem, model_fit = begun
    data, p = problem.data, model_fit.fitted.packed.p
    reach = float(p[layout.COULOMB] / p[layout.STIFFNESS])
    number, left = since_rest(data, reach)
    moving = np.isfinite(left)
    assert 0.5 < moving.mean() <= 1.0
    assert number.max() > 5, "the standard programme rests often"
    random = np.random.default_rng(3)
    stretched = np.where(moving, np.nan_to_num(left) * random.normal(0.0, 1.0, number.max() + 1)[number], 0.0)
    known = np.where(np.nan_to_num(left) >= 0.05, stretched, 0.0)
    assert np.max(np.abs(without_rests(known, (number, left)))) < 1e-9
    far = np.where(moving & (np.nan_to_num(left) < 0.05), random.standard_normal(len(left)), 0.0)
    assert without_rests(far, (number, left)) == pytest.approx(far)


def _broken_away(problem: Problem, packed: Packed, reaches: float) -> np.ndarray:
    """Torque of friction that is a fifth higher after a rest, until it has slipped so many reaches, shape (m,)."""
    p, on = packed.p.copy(), packed.on.copy()
    values = {"rise": 0.2 * p[layout.COULOMB], "time_constant": 0.2}
    values["slip"] = reaches * p[layout.COULOMB] / p[layout.STIFFNESS]
    for name, value in values.items():
        p[DWELL_TIME_BREAK_AWAY.slot(name)] = value
    on[layout.flag(DWELL)] = True
    young, aged = (residual(problem.data, one, problem.moved) for one in (packed, Packed(p, on)))
    return young - aged


def _crept(problem: Problem, packed: Packed) -> np.ndarray:
    """Torque of a bristle that every rest has stretched by a tenth of its friction at most, shape (m,)."""
    coulomb = float(packed.p[layout.COULOMB])
    number, left = since_rest(problem.data, coulomb / float(packed.p[layout.STIFFNESS]))
    stretch = 0.1 * coulomb * np.random.default_rng(4).uniform(-1.0, 1.0, number.max() + 1)
    return np.nan_to_num(left) * stretch[number]


@pytest.mark.parametrize("reaches", [0.3, 1.5, 10.0])
def test_friction_that_is_higher_after_a_rest_shows_beyond_the_stretch_at_it(
    begun: Begun, reaches: float
) -> None:
    problem, model_fit = begun
    missing = model_fit.fitted.error + _broken_away(problem, model_fit.fitted.packed, reaches)
    lacking = replace(model_fit, fitted=replace(model_fit.fitted, error=missing))
    candidate = FittedCandidate(DWELL, model_fit, 0.3, Explained(1.0, 0.0), None, named=True)
    assert not RepeatedProgramme().only_at_rests(problem, lacking, candidate)


@pytest.mark.parametrize(("size", "only"), [(0.0, True), (1.0, False)])
def test_what_stretches_at_rests_leave_tells_a_break_away_of_which_they_take_most(
    begun: Begun, size: float, only: bool
) -> None:
    """Three tenths of a true one were left, nine tenths of which it explained: with half asked it was refused."""
    problem, model_fit = begun
    packed = model_fit.fitted.packed
    crept = 12.0 * _crept(problem, packed)
    missing = model_fit.fitted.error + crept + size * _broken_away(problem, packed, 1.5)
    lacking = replace(model_fit, fitted=replace(model_fit.fitted, error=missing))
    candidate = FittedCandidate(DWELL, model_fit, 0.3, Explained(1.0, 0.0), None, named=True)
    assert RepeatedProgramme().only_at_rests(problem, lacking, candidate) == only


@pytest.mark.parametrize(("effect", "only"), [(DWELL, True), ("stribeck", False)])
def test_what_ends_with_the_stretch_at_a_rest_is_no_break_away(begun: Begun, effect: str, only: bool) -> None:
    """Of effects that other motion shows too nothing is said."""
    problem, model_fit = begun
    missing = model_fit.fitted.error + _crept(problem, model_fit.fitted.packed)
    lacking = replace(model_fit, fitted=replace(model_fit.fitted, error=missing))
    candidate = FittedCandidate(effect, model_fit, 0.3, Explained(1.0, 0.0), None, named=True)
    assert RepeatedProgramme().only_at_rests(problem, lacking, candidate) == only


def test_how_bristles_are_stretched_at_rests_takes_nothing_from_what_an_effect_explains(begun: Begun) -> None:
    """It comes again in repeats; what an effect leaves of its own beside it counts as before."""
    problem, model_fit = begun
    fitted, number = model_fit.fitted, since_rest(problem.data, 1e-3)[0]
    crept = _crept(problem, fitted.packed)
    for block in problem.data.blocks:
        crept[block.rows] = np.tile(crept[block.rows][: block.count], block.repeats)
    assert number.max() > 5
    wave = _in_the_fastest(problem, 0.1)
    clean, spoilt = (
        explained(
            problem,
            replace(fitted, error=fitted.error + wave + beside),
            replace(fitted, error=fitted.error + 0.4 * wave + beside),
            model_fit.correction,
            TRAINING,
        )
        for beside in (0.0, crept)
    )
    assert 0.8 < clean.share < 0.95
    assert spoilt.share == pytest.approx(clean.share, abs=0.02)
    assert spoilt.plain_share == pytest.approx(clean.plain_share, abs=0.02)


def test_a_disturbance_that_follows_the_clock_is_no_structure(begun: Begun) -> None:
    """A line that repeats meet in phase comes again, and is gone once it is taken out."""
    problem = begun[0]
    clock = problem.data.grid * problem.data.period
    line = 0.02 * np.sin(2.0 * np.pi * 16.7 * clock + 0.3)
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(line))
    left = without_line(problem, line + noise, TimeLine(16.7, 0.9))
    assert float(np.std(left)) == pytest.approx(1e-3, rel=0.05)


def test_rows_after_a_rest_count_by_how_unlike_its_stretch_is_in_repeats() -> None:
    """Two rests, each forgotten after some hundred rows; a stretch that repeats share is no reason to doubt."""
    way = np.tile(np.arange(600) / 100.0, 2)
    share, rest = np.exp(-way), np.repeat([3, 4], 600)
    noise = np.random.default_rng(5).normal(0.0, 1e-3, (2, 1200))
    size = 0.02
    same = _certainty(noise + size * share, share, rest)
    unlike = _certainty(noise + size * share * np.array([[1.0], [-1.0]]), share, rest)
    assert same.min() > 0.9
    assert unlike[0] == pytest.approx((noise.std() / size) ** 2 / 2.0, rel=0.2)
    assert unlike[599] == pytest.approx(1.0, abs=0.01)


def test_experiments_that_leave_the_bristles_reach_keep_their_weights(begun: Begun) -> None:
    problem, model_fit = begun
    assert np.array_equal(less_after_rests(problem, model_fit.fitted).weight, problem.weight)


def test_where_no_count_of_presliding_is_seen_rows_at_rest_are_left_out(begun: Begun) -> None:
    """Stiction without presliding: friction holds any torque at rest, and a bristle far stiffer is tried."""
    problem, model_fit = begun
    packed = model_fit.fitted.packed
    assert sticking(problem, packed) == (problem, ())
    p = packed.p.copy()
    p[layout.STIFFNESS] = p[layout.COULOMB] / (0.2 * problem.data.resolution)
    without, starts = sticking(problem, Packed(p, packed.on))
    out = without.weight == 0.0
    assert 0.0 < out.mean() < 0.5
    assert np.array_equal(without.weight[~out], problem.weight[~out])
    assert [start.p[layout.STIFFNESS] / p[layout.STIFFNESS] for start in starts] == pytest.approx([1.0, 25.0])
    error = model_fit.fitted.error + np.where(out, 1.0, 0.0)
    alike = [
        without.repeatable(one, model_fit.correction, TRAINING)[0] for one in (error, model_fit.fitted.error)
    ]
    assert alike[0] == pytest.approx(alike[1])
    assert without.noise_variance(error, TRAINING) == pytest.approx(
        without.noise_variance(model_fit.fitted.error, TRAINING)
    )
