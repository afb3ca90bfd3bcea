"""What counts, replicas and rests make of what repeats share: it is told, excused, and takes nothing from an effect."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.diagnosis.candidates import FittedCandidate
from autotune.diagnosis.evidence import repeated
from autotune.diagnosis.evidence.repeated import RepeatedProgramme
from autotune.diagnosis.evidence.time_driven import TimeLine, without_line
from autotune.diagnosis.evidence.visibility import visible
from autotune.estimation import disturbance_estimate
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.contact_start import (
    _certainty,
    less_after_rests,
    sticking,
)
from autotune.estimation.coordinates import since_rest, without_rests
from autotune.estimation.cross_validation import Explained, _explainable_fall, explained, of_friction
from autotune.estimation.data import TEST, TRAINING, VETO, Block, prepare
from autotune.estimation.disturbance_estimate import (
    by_certainty,
    null_errors,
    with_counts,
    with_expected_noise,
)
from autotune.estimation.problem import Problem, new_problem
from autotune.estimation.residual import residual
from autotune.estimation.twin_runs import SEED
from autotune.models import layout
from autotune.models.drive_model import Packed, base_model
from autotune.models.dwell_time_break_away import DWELL_TIME_BREAK_AWAY
from autotune.models.reversal_memory import REMEMBERS, REVERSAL_MEMORY
from autotune.recordings.recording import Recording
from tests.support.axes import NOMINAL

Begun = tuple[Problem, ModelFit]
DWELL = DWELL_TIME_BREAK_AWAY.name


@pytest.mark.slow
def test_counts_that_are_coarse_come_again_in_each_twin_and_differ_between_twins(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a fine encoder next to nothing, of one with twenty times the count far more than of that.

    Four draws of twins: by one of them it is known to a fifth of the noise. Where the recording is quieter than twins
    behind coarse counts, it holds no more of what they share than of what they do not.
    """
    problem, packed = begun[0], begun[1].fitted.packed
    coarse = replace(problem.data, resolution=20.0 * problem.data.resolution)
    quiet = replace(problem, data=coarse)
    shaken = problem.moved.torque + 0.1 * np.random.default_rng(9).standard_normal(len(coarse.time))
    loud = replace(quiet, moved=replace(problem.moved, torque=shaken))
    draws = []
    for seed in range(4):
        monkeypatch.setattr(disturbance_estimate, "SEED", SEED + seed)
        draws.append([
            with_counts(one, packed).comes_by_counts(TRAINING)[0] for one in (problem, loud, quiet)
        ])  # fmt: skip
    fine, much, quieter = np.mean(draws, axis=0)
    noise = problem.noise_variance(begun[1].fitted.error, TRAINING)
    assert fine < 0.15 * noise
    assert much > 5.0 * fine
    assert quieter < 0.2 * much


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


@pytest.mark.parametrize(("times", "seen"), [(0.7, False), (1.3, True)])
@pytest.mark.parametrize("everywhere", [True, False])
def test_an_effect_must_explain_what_would_be_something_without_it(
    begun: Begun, everywhere: bool, times: float, seen: bool
) -> None:
    """So much of an experiment's noise as says that something is missing, in all experiments or in one alone."""
    problem, after = begun
    own, part = after.fitted.error, times * problem.policy.structure_part
    noise = problem.repeatable_by_block(own, after.correction, TRAINING)[:, 1]
    repeated_ones = [one for one in problem.data.blocks if one.role == TRAINING and one.repeats > 1]
    more = own.copy()
    for block, level in list(zip(repeated_ones, noise, strict=True))[: None if everywhere else 1]:
        more[block.rows] = np.sqrt(own[block.rows] ** 2 + part * level)
    before = replace(after, fitted=replace(after.fitted, error=more))
    assert RepeatedProgramme().in_sight(problem, before, after) is seen
    assert not RepeatedProgramme().in_sight(problem, after, before), "it errs more"


@pytest.mark.parametrize(("played", "counts"), [(1, True), (2, True), (0, False)])
def test_a_veto_trajectory_counts_once_played_where_repeats_of_the_training_tell_the_noise(
    begun: Begun, played: int, counts: bool
) -> None:
    problem = begun[0]
    assert _with_veto(problem, played).has_veto is counts
    alone = _with_veto(problem, played, training=1)
    assert alone.has_veto is (played > 1), "nothing tells what of it is noise"
    assert alone.veto_repeats is (played > 1)


def test_of_a_veto_trajectory_that_was_played_once_no_more_is_left_than_is_beyond_the_loudest_experiment(
    begun: Begun,
) -> None:
    """Its noise is known by a bound only; an error far beyond that is left, and lowers the share for a name."""
    problem, model_fit = _with_veto(begun[0], 1), begun[1]
    size = 10.0 * np.sqrt(problem.noise_variance(model_fit.fitted.error, TRAINING))
    wave = size * problem.data.role(VETO) * np.sin(np.arange(len(problem.weight)) / 15.0)

    def with_part(part: float) -> ModelFit:
        error = model_fit.fitted.error + part * wave
        return replace(model_fit, fitted=replace(model_fit.fitted, error=error))

    def share(part: float) -> float:
        before, after = with_part(1.0).fitted, with_part(part).fitted
        return explained(problem, before, after, model_fit.correction, VETO).share

    assert share(0.0) > 0.98
    # 1 - 0.6², and some hundredths by what rests take and noise adds
    assert share(0.6) == pytest.approx(0.64, abs=0.1)
    assert share(1.2) == 0.0


def _with_veto(problem: Problem, played: int, training: int = 2) -> Problem:
    """The problem with its veto trajectory played so often, and each experiment of the training so often."""

    def as_played(block: Block) -> Block:
        if block.role == VETO:
            return replace(block, repeats=played) if played else replace(block, role=TEST)
        return replace(block, repeats=training) if block.role == TRAINING else block

    return replace(problem, data=replace(problem.data, blocks=tuple(map(as_played, problem.data.blocks))))


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


def _turned_in_every_second(problem: Problem, wave: np.ndarray) -> np.ndarray:
    """The wave with its sign turned from repeat to repeat: all of it is noise."""
    turned = np.zeros_like(wave)
    for block in problem.data.blocks:
        signs = np.resize([1.0, -1.0], block.repeats)
        turned[block.rows] = (signs[:, None] * block.by_repeat(wave)).ravel()
    return turned


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
    turned = _turned_in_every_second(problem, 3.0 * wave)
    monkeypatch.setattr(repeated, "null_errors", lambda *_: [error + turned for error in own])
    assert RepeatedProgramme().structure_left(problem, spoilt), "replicas that swing far more than the axis"


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


@pytest.mark.parametrize("effect", [DWELL, "backlash"])
@pytest.mark.parametrize(("size", "only"), [(0.0, True), (1.0, False)])
def test_what_stretches_at_rests_leave_tells_a_break_away_of_which_they_take_most(
    monkeypatch: pytest.MonkeyPatch, begun: Begun, effect: str, size: float, only: bool
) -> None:
    """Three tenths of a true one were left, nine tenths of which it explained: with half asked it was refused."""
    monkeypatch.setattr(repeated, "_told_by_shaking", lambda *_: 1.0)
    problem, model_fit = begun
    packed = model_fit.fitted.packed
    crept = 12.0 * _crept(problem, packed)
    missing = model_fit.fitted.error + crept + size * _broken_away(problem, packed, 1.5)
    lacking = replace(model_fit, fitted=replace(model_fit.fitted, error=missing))
    candidate = FittedCandidate(effect, model_fit, 0.3, Explained(1.0, 0.0), None, named=True)
    assert RepeatedProgramme().only_at_rests(problem, lacking, candidate) == only


@pytest.mark.parametrize(
    ("effect", "shaken", "only"),
    [
        (DWELL, 0.0, True),
        ("stribeck", 1.0, False),
        ("elastic_transmission", 1.0, True),
        ("backlash", 1.0, True),
        ("elastic_transmission", 0.0, False),
    ],
)
def test_what_ends_with_the_stretch_at_a_rest_is_no_break_away(
    monkeypatch: pytest.MonkeyPatch, begun: Begun, effect: str, shaken: float, only: bool
) -> None:
    """Nor a load that moves by itself, where the axis creeps as it is shaken: friction that winds up a spring holds a
    stretch as well. Of effects that other motion shows too nothing is said.
    """
    monkeypatch.setattr(repeated, "_told_by_shaking", lambda *_: shaken)
    problem, model_fit = begun
    missing = model_fit.fitted.error + _crept(problem, model_fit.fitted.packed)
    lacking = replace(model_fit, fitted=replace(model_fit.fitted, error=missing))
    candidate = FittedCandidate(effect, model_fit, 0.3, Explained(1.0, 0.0), None, named=True)
    assert RepeatedProgramme().only_at_rests(problem, lacking, candidate) == only


@pytest.mark.parametrize(("hangs", "loudest", "told"), [(0.0, 2.0, 0.0), (0.5, 2.0, 0.5625), (0.0, 1.0, 0.0)])
def test_how_much_is_left_by_how_loud_a_twin_is_shaken(hangs: float, loudest: float, told: float) -> None:
    """Between 0.7 and 1.4 of the level, whichever leaves less; without a twin nothing is told, nor by one that is
    unstable above the `loudest` level, which has no bias.
    """
    problem = SimpleNamespace(twin=True, disturbance=SimpleNamespace(louder=lambda part: part))
    problem.raw = lambda _: np.ones(8)
    problem.corrections_under = lambda levels, _: [
        SimpleNamespace(
            bias=np.full(8, hangs * (level > 1.0) - hangs * (level < 1.0) - 3.0 * (level > loudest)),
            stable=level <= loudest,
        )
        for level in levels
    ]
    problem.has = lambda role: role == TRAINING  # no veto trajectory
    problem.mean_square = lambda error, _: 0.28125 * float(np.mean(error**2))
    model_fit = SimpleNamespace(fitted=SimpleNamespace(packed=None))
    assert repeated._told_by_shaking(problem, model_fit) == pytest.approx(told)
    problem.twin = False
    assert repeated._told_by_shaking(problem, model_fit) == 0.0


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


@pytest.mark.parametrize(("carried", "seen"), [(0.9, True), (0.1, False)])
def test_a_contact_is_seen_in_the_elements_that_carry_most_of_it(
    begun: Begun, carried: float, seen: bool
) -> None:
    """Beside a stiff bristle with a tenth of the friction they bend over many counts, and no rest holds any torque."""
    problem, model_fit = begun
    p, on = model_fit.fitted.packed.p.copy(), model_fit.fitted.packed.on.copy()
    whole, count = p[layout.COULOMB], problem.data.resolution
    p[layout.COULOMB] *= 1.0 - carried
    p[layout.STIFFNESS] = p[layout.COULOMB] / (0.2 * count)
    on[REMEMBERS] = True
    for number, far in enumerate((10.0, 40.0), 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = far * count
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = 0.5 * carried * whole
    without, starts = sticking(problem, Packed(p, on))
    assert (starts == ()) is seen
    assert (without is problem) is seen


def test_a_friction_level_that_drifts_is_explained_though_the_disturbance_was_told_with_it(
    begun: Begun,
) -> None:
    """Told beside a model without drift, a disturbance makes all that repeats do not share."""
    problem, model_fit = begun
    column = of_friction(problem, model_fit.fitted, model_fit.correction, TRAINING)
    assert column is not None
    drifted = model_fit.fitted.error.copy()
    for block in problem.data.blocks:
        if block.repeats > 1:
            late = np.linspace(-0.5, 0.5, block.repeats)[:, None]
            drifted[block.rows] += (0.01 * late * block.by_repeat(column)).ravel()
    loud = replace(problem, expected=np.full(len(problem.data.blocks), 1.0))
    after = model_fit.fitted.error
    whole = problem.mean_square(drifted, TRAINING) - problem.mean_square(after, TRAINING)
    assert _explainable_fall(loud, drifted, after, TRAINING, None) < 0.0
    assert _explainable_fall(loud, drifted, after, TRAINING, column) == pytest.approx(whole, rel=0.1)
    noisier = after + 0.1 * after.std() * np.random.default_rng(7).standard_normal(len(after))
    without = [_explainable_fall(loud, noisier, after, TRAINING, one) for one in (None, column)]
    assert without[0] == without[1]


def test_the_level_of_a_chain_of_contacts_drifts_in_all_of_them(begun: Begun) -> None:
    """Where elements carry nearly all of it, a bristle's own part says next to nothing of the level."""
    problem, model_fit = begun
    fitted = model_fit.fitted
    plain = of_friction(problem, fitted, model_fit.correction, TRAINING)
    p, on = fitted.packed.p.copy(), fitted.packed.on.copy()
    on[REMEMBERS] = True
    p[REVERSAL_MEMORY.slot("displacement_1")] = p[layout.COULOMB] / p[layout.STIFFNESS]
    p[REVERSAL_MEMORY.slot("torque_1")] = 0.95 * p[layout.COULOMB]
    p[layout.COULOMB] *= 0.05
    chain = Packed(p, on)
    fitted = replace(fitted, packed=chain, error=problem.raw(chain) - model_fit.correction.bias)
    column = of_friction(problem, fitted, model_fit.correction, TRAINING)
    assert plain is not None
    assert column is not None
    rows = problem.training > 0
    assert np.corrcoef(plain[rows], column[rows])[0, 1] > 0.95


def test_a_crumb_of_the_torque_says_of_no_axis_that_something_is_missing(begun: Begun) -> None:
    """However quiet it is and however well its loop is known: the law of no base is the axis's to that."""
    problem, model_fit = begun
    assert problem.controller is not None
    problem = replace(problem, controller=replace(problem.controller, exact=True))
    crumb = 0.8 * problem.policy.least_part * problem.scales.torque
    wave = np.zeros_like(model_fit.fitted.error)
    for block in problem.data.blocks:
        shape = np.sin(np.arange(block.count) / 15.0)
        wave[block.rows] = np.tile(crumb * shape / np.std(shape), block.repeats)
    quiet = replace(model_fit, fitted=replace(model_fit.fitted, error=wave))
    loud = replace(model_fit, fitted=replace(model_fit.fitted, error=2.0 * wave))
    assert not RepeatedProgramme().structure_left(problem, quiet)
    assert RepeatedProgramme()._structured(problem, quiet, crumbs=True)
    assert RepeatedProgramme().structure_left(problem, loud)


def test_what_twins_differ_and_share_by_is_that_of_the_rows_that_count(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motion that rests for half of its time, where a coarse encoder sticks: those rows are compared with nothing."""
    problem, packed = begun[0], begun[1].fitted.packed
    random, rests = np.random.default_rng(4), np.zeros(len(problem.weight), dtype=np.bool_)
    for block in problem.data.blocks:
        rests[block.by_repeat(np.arange(len(rests)))[:, : block.count // 2]] = True
    weight = np.where(rests, 0.0, 1.0)
    steady = replace(problem, weight=weight, disturbance=replace(problem.disturbance, sensor=0.0, uneven=1.0))
    noise = steady.noise_variance(residual(problem.data, packed, problem.moved), TRAINING)
    size = np.sqrt(noise) * np.where(rests, 30.0, 1.0)
    loud = [size * one for one in random.standard_normal((6, len(rests)))]
    monkeypatch.setattr(disturbance_estimate, "_errors_of_twins", lambda *_: loud[:1])
    monkeypatch.setattr(disturbance_estimate, "_errors_of", lambda *_: loud)
    repeated = [block.repeats > 1 for block in problem.data.blocks]
    expected = with_expected_noise(steady, packed).expected
    assert expected is not None
    assert np.mean(expected[repeated]) == pytest.approx(noise, rel=0.2), "of all rows 450 times that"
    counted = with_counts(steady, packed).by_counts
    assert counted is not None
    assert np.max(np.abs(counted)) < 0.5 * noise, (
        "nothing is shared, but for chance: of all rows 450 times that"
    )


@pytest.mark.parametrize("lost", [False, True])
def test_rows_that_were_lost_are_no_rests(short: Recording, lost: bool) -> None:
    """A sine never rests; ten runs of lost rows, of 30 to 600 each, are no rests of times that differ."""
    sine = short.select("sine")
    missed = np.zeros(len(sine), dtype=np.int64)
    for first, rows in zip(np.linspace(400, len(sine) - 1500, 10), np.geomspace(30, 600, 10), strict=True):
        missed[int(first) : int(first + rows)] = int(lost)
    columns = dict(sine.floats)
    data = prepare([Recording.from_columns(columns, sine.metadata, sine.experiment, sine.repeat, missed)])
    item = SimpleNamespace(effect=DWELL, fitted=SimpleNamespace(packed=base_model(NOMINAL).pack()))
    assert not visible(new_problem(data, None), item)
    rested = prepare([short])
    assert visible(new_problem(rested, None), item)
