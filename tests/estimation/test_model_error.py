"""Which of several laws a drive works by, where only its twin tells."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.estimation import model_error as model_error_module
from autotune.estimation.alignment import CURRENT_LOOP, followed_late, shifted
from autotune.estimation.bias_corrected_fit import twinned
from autotune.estimation.controller import as_recorded
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import TRAINING, Prepared, filtered_motion, prepare
from autotune.estimation.disturbance import STILL, Disturbance
from autotune.estimation.disturbance_estimate import with_counts
from autotune.estimation.model_error import PlainFit, model_error, plain_fit, told_beside, told_by_twin
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import Problem, Told, led
from autotune.estimation.residual import Simulated, smoothed
from autotune.estimation.twin_runs import run_twin, run_twins, slower
from autotune.models import layout
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.drive_model import Packed, base_model
from autotune.models.table import EFFECTS
from autotune.models.torque_lag import IS_LATE, TIME_CONSTANT
from autotune.recordings.recording import Metadata, Recording
from tests.estimation.simulated import AXIS, PERIOD, TRUE, recorded

COUNTS = 3e-5
"""rad: 40 of them to the presliding of the axis."""
LAW = PositionController(
    26.0, 0.086, 1400.0, 1.0 - np.exp(-2.2), explained=0.9999, source="identified", in_band=True, ticks=4
)

LATE = replace(LAW, reference_delay=20, ticks=6)


def _driven(ticks: int, seed: int) -> Prepared:
    """Moves of 0.4 s and rests of 0.6 s, in which the loop swings between two counts."""
    time = np.arange(8_000) * PERIOD
    moved = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time % 1.0, 0.4) / 0.4)
    return _along(0.3 * np.where(time % 2.0 < 1.0, moved, 1.0 - moved), ticks, seed)


def _along(wanted: Floats, ticks: int, seed: int) -> Prepared:
    """What the loop with so many ticks makes of a reference [rad], shape (n,)."""
    time = np.arange(len(wanted)) * PERIOD
    columns = {"time": time, "reference": wanted, "position": wanted + 1e-9, "torque": np.cos(time)}
    metadata = Metadata(sample_period=PERIOD, position_resolution=COUNTS)
    data = prepare([Recording.from_columns(columns, metadata, "motion")])
    shaken, random = Disturbance(white=3e-4), np.random.default_rng(seed)
    run = run_twin(data, base_model(AXIS).pack(), replace(LAW, ticks=ticks), shaken, random)
    assert run.stable
    motion = filtered_motion(run.position, data.stretches, PERIOD, data.motion_cutoff)
    return replace(
        data, measured=run.position, torque=run.torque, recorded_torque=run.torque,
        position=motion[0], velocity=motion[1], acceleration=motion[2],
    )  # fmt: skip


def _read_at_a_moment(alias: float) -> tuple[Prepared, Floats]:
    """The same moves twice, with noise that comes again in the torque that is recorded, and the torque that acted."""
    data = _driven(6, 4)
    columns = {name: getattr(data, name) for name in ("time", "reference", "torque")}
    repeats = (np.arange(len(data.time)) >= len(data.time) // 2).astype(np.int64)
    noise = np.tile(np.random.default_rng(8).normal(0.0, alias, len(data.time) // 2), 2)
    columns |= {"position": data.measured, "torque": data.torque + noise}
    metadata = Metadata(sample_period=PERIOD, position_resolution=COUNTS)
    names = np.full(len(data.time), "motion")
    return prepare([Recording.from_columns(columns, metadata, names, repeats)]), data.torque


def _left(ticks: int, others: tuple[int, ...]) -> list[float]:
    """Mean square that the twins of loops leave of a loop with so many ticks, over several disturbances."""
    every = []
    for seed in range(6):
        plain = plain_fit(_driven(ticks, seed), base_model(AXIS).pack(), POLICY)
        every.append([plain.left_by(replace(LAW, ticks=count), STILL)[0] for count in others])
    return [float(mean) for mean in np.mean(every, axis=0)]


def test_how_fast_a_drives_loop_is_shows_in_how_it_rests_between_two_counts() -> None:
    """The torque that a rest begins with goes faster behind a later loop; a single rest is a matter of luck."""
    slow, fast = _left(6, (6, 12))
    assert slow < fast
    slow, fast = _left(12, (4, 12))
    assert fast < slow


def test_which_loop_leaves_least_is_told_and_nothing_else_of_its_law() -> None:
    law, _ = told_by_twin(_driven(6, 3), [LAW], base_model(AXIS).pack())
    own = law.of_its_drive(PERIOD)
    assert own.ticks in (4, 6, 8)
    assert own == LAW.on_ticks(own.ticks, PERIOD)  # with gains that ask for the same


def test_a_twin_of_few_ticks_answers_as_soon_as_its_drive_of_many() -> None:
    """Each torque is held longer; as much as that is late the law is sooner. Once the start is forgotten."""
    data = replace(_driven(12, 1), resolution=0.0)
    fast = LAW.on_ticks(12, PERIOD)
    few, naive = fast.on_fewer(3, PERIOD), fast.on_ticks(3, PERIOD)
    assert few.of_its_drive(PERIOD) == fast
    random = np.random.default_rng(1)
    runs = [run_twin(data, base_model(AXIS).pack(), law, STILL, random) for law in (fast, few, naive)]
    follows, late = (np.std((run.position - runs[0].position)[500:]) for run in runs[1:])
    assert follows < 0.25 * late


def test_a_twin_takes_no_more_ticks_than_leave_as_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every run takes as long as its ticks; where fewer leave more the drive's own are kept."""
    left = {2: 1.1, 4: 1.01, 6: 1.0, 8: 0.995, 12: 1.0}
    monkeypatch.setattr(
        PlainFit,
        "left_by",
        lambda _, law, __: (1.5 if law.own_ticks and law.kp > 27.0 else left[law.ticks], 0.0),
    )
    data, model = _driven(6, 7), base_model(AXIS).pack()
    law, _ = told_by_twin(data, [LAW], model)
    assert (law.ticks, law.own_ticks) == (4, 8)
    law, _ = told_by_twin(data, [replace(LAW, kp=1.1 * LAW.kp)], model)
    assert (law.ticks, law.own_ticks) == (8, 0)


def test_a_question_that_was_asked_is_not_simulated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same data, laws and model; a diagnosis asks it twice."""
    asked: list[int] = []
    original = PlainFit.left_by
    monkeypatch.setattr(PlainFit, "left_by", lambda *given: asked.append(1) or original(*given))
    model = base_model(AXIS).pack()
    first = told_by_twin(_driven(6, 5), [LAW], model)
    count = len(asked)
    assert told_by_twin(_driven(6, 5), [LAW], model) == first
    assert count == len(asked) > 0
    told_by_twin(_driven(6, 5), [replace(LAW, kp=1.01 * LAW.kp)], model)
    assert len(asked) > count


@pytest.mark.parametrize("off", [0.8, 1.3])
def test_which_base_is_asked_about_does_not_change_the_law(
    off: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bases that fit to the same place are one question; a base that nothing leads there from is told beside itself."""
    data, model = _driven(6, 7), base_model(AXIS)
    law, _ = told_by_twin(data, [LAW], model.pack())
    asked: list[int] = []
    original = PlainFit.left_by
    monkeypatch.setattr(PlainFit, "left_by", lambda *given: asked.append(1) or original(*given))
    other = model.with_values({name: off * model[name] for name in ("inertia", "coulomb", "viscous")})
    assert told_by_twin(data, [LAW], other.pack())[0] == law
    assert not asked
    uneven = model.with_effect(DIRECTION_ASYMMETRY.make({"coulomb": 0.01 * off, "viscous": 0.0}))
    told_by_twin(data, [LAW], uneven.pack())
    assert asked


def test_a_law_of_the_samples_is_not_asked_about() -> None:
    law = replace(TRUE, source="identified")
    assert told_by_twin(prepare([recorded(TRUE)]), [law], base_model(AXIS).pack()) == (law, STILL)


@pytest.mark.parametrize("alias", [0.0, 6e-3])
def test_what_a_law_asks_for_is_compared_where_the_recorded_torque_is_noisy(alias: float) -> None:
    """Noise that comes again in every repeat, as what a moment's torque has of the encoder's counts."""
    data, acted = _read_at_a_moment(alias)
    law, _ = told_by_twin(data, [replace(LAW, ticks=6)], base_model(AXIS).pack())
    taken = as_recorded(data, law)
    assert (law.asked > 0.0) == (alias > 0.0) == (taken.asked is not None)
    off = smoothed(taken, taken.torque - acted)
    assert np.std(off) < 0.5 * np.std(smoothed(taken, data.torque - acted)) or alias == 0.0


def test_what_was_told_by_chance_under_noise_does_not_hide_what_another_law_asks_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What counts make of a moment's torque drowns which law it is; what a wrong one asks for goes off by itself."""

    def left_by(_: PlainFit, law: PositionController, __: Disturbance) -> tuple[float, float]:
        return ((50.0 if law.held else 0.1) if law.asked > 0.0 else (0.9 if law.held else 1.0)), 0.0

    monkeypatch.setattr(PlainFit, "left_by", left_by)
    data, _ = _read_at_a_moment(5e-3)
    law, _ = told_by_twin(
        data, [replace(LAW, ticks=6), replace(LAW, ticks=6, held=True)], base_model(AXIS).pack()
    )
    assert not law.held
    assert law.asked > 0.0


def test_what_a_law_asks_for_is_levelled_from_clamp_to_clamp() -> None:
    """A clamp leaves another sum than the law's: torques step there by what nothing tells."""
    data, acted = _read_at_a_moment(6e-3)
    clamp, step = slice(3_000, 3_010), 0.3 * float(np.std(acted))
    limit = 1.1 * float(np.max(np.abs(data.torque)))
    torque = data.torque + np.where(np.arange(len(acted)) < clamp.start, 0.0, step)
    torque[clamp] = limit
    limited = replace(
        data, torque=torque, recorded_torque=torque, metadata=replace(data.metadata, torque_limit=limit)
    )
    taken = as_recorded(limited, replace(LAW, ticks=6, asked=1.0))
    near = np.r_[2_500 : clamp.start, clamp.stop : 3_500]
    off = taken.torque[near] - acted[near] - step * (near >= clamp.stop)
    assert np.std(off) < 0.5 * np.std((data.torque - acted)[near])
    assert taken.torque[clamp] == pytest.approx(limit, rel=0.01)  # and what is slow of its edges


def test_a_models_error_is_of_the_torque_that_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """As diagnosis has it: else what a moment's torque has of counts would be the model's fault once it is compared."""
    data, _ = _read_at_a_moment(6e-3)
    law, model = replace(LAW, ticks=6), base_model(AXIS)
    monkeypatch.setattr(model_error_module, "find_controller", lambda *_: law)
    monkeypatch.setattr(model_error_module, "controllers_of", lambda *_: (law,))
    left = model_error(data, model)
    assert left.problem.data.asked is not None
    monkeypatch.setattr(model_error_module, "told_by_twin", lambda *_: (replace(law, ticks=1), STILL))
    assert left.error_rms < 0.5 * model_error(data, model).error_rms


def test_a_twins_torque_is_what_its_law_asks_for_too() -> None:
    """A twin that moves as the axis did has the axis's torque above that frequency; one alone as in a pass."""
    data, _ = _read_at_a_moment(6e-3)
    law, model = replace(LAW, ticks=6, asked=1.0), base_model(AXIS).pack()
    taken, still = as_recorded(data, law), np.zeros(len(data.time))
    alone = run_twin(taken, model, law, STILL, np.random.default_rng(1))
    one, _ = run_twins(taken, [model, model], law, [(still, still)] * 2)
    assert one.torque == pytest.approx(alone.torque, abs=1e-9)
    apart = replace(taken, measured=alone.position)
    again = run_twin(apart, model, law, STILL, np.random.default_rng(1))
    assert taken.asked is not None
    quick = again.torque - taken.asked
    assert np.std(smoothed(taken, quick - slower(taken, quick, 5.0))) < 1e-2 * np.std(taken.asked)


@pytest.mark.parametrize("lanes", [1, 2], ids=["alone", "in a pass"])
def test_what_a_law_asks_for_is_behind_the_current_loop_too(lanes: int) -> None:
    """An axis behind a lag that was taken out is one that has it; all that its twin records is behind it."""
    data, _ = _read_at_a_moment(6e-3)
    law, model, lag = replace(LAW, ticks=6, asked=1.0), base_model(AXIS).pack(), 3e-4
    prompt, still = as_recorded(data, law), np.zeros(len(data.time))
    p, on = model.p.copy(), model.on.copy()
    p[TIME_CONSTANT], on[IS_LATE] = lag, True

    def run(taken: Prepared, packed: Packed) -> Simulated:
        return run_twins(taken, [packed] * lanes, law, [(still, still)] * lanes)[0]

    own, taken_out = run(prompt, Packed(p, on)), run(replace(prompt, lag=lag), model)
    assert taken_out.position == pytest.approx(own.position, abs=1e-12)
    assert taken_out.torque == pytest.approx(followed_late(prompt, own.torque, lag), abs=1e-12)


def test_without_a_law_a_fit_is_led_by_the_torque_alone() -> None:
    """So fast an axis is led along its way; what leads it asks for no torque that a law could be held to."""
    data, _ = _read_at_a_moment(6e-3)
    taken = replace(as_recorded(data, replace(LAW, ticks=6, asked=1.0)), pace=0.5)
    assert taken.asked is not None
    assert led(taken).asked is None
    model = base_model(AXIS).pack()
    left = plain_fit(taken, model, POLICY).problem.correction(model)
    assert left.stable
    assert np.isfinite(left.bias).all()


@pytest.mark.parametrize(("late", "most"), [(0.3e-3, 0.3e-3), (1.5e-3, CURRENT_LOOP)])
def test_a_law_is_told_beside_an_ordinary_delay_of_its_torque(late: float, most: float) -> None:
    """The recorded demand acts so much later; what is longer than a current loop takes stays for a torque lag."""
    time = np.arange(6_000) * PERIOD
    data = _along(0.5 * np.sin(6.0 * time) + 0.05 * np.sin(60.0 * time), 6, 1)
    told = replace(data, recorded_torque=shifted(data, 2.0 * late / PERIOD).torque)
    plain = plain_fit(shifted(told, 0.0), base_model(AXIS).pack(), POLICY)
    _, later = plain.left_by(replace(LAW, ticks=6), STILL)
    assert 0.5 * PERIOD * later == pytest.approx(most, abs=0.06e-3)


def _asked_again(
    data: Prepared, law: PositionController | None, rough: PositionController | None
) -> tuple[Problem, Problem]:
    """The problem with a law, and as told beside the model that fits these data: of the true law and a late one."""
    plain = plain_fit(data, base_model(AXIS).pack(), POLICY)
    known = Told(data, (LAW, LATE))
    problem = replace(plain.problem, controller=law, rough=rough, told=known, disturbance=STILL)
    error = problem.raw(plain.fitted.packed) - problem.correction(plain.fitted.packed).bias
    fitted = replace(plain.fitted, error=error, cost=problem.mean_square(error, TRAINING))
    return problem, told_beside(problem, fitted)


@pytest.mark.parametrize("twin", [True, False])
def test_what_is_found_tells_the_law_again(twin: bool) -> None:
    """Whether another one was told without it, or none was good enough; asked once more it stays."""
    data = _driven(6, 2)
    _, again = _asked_again(data, LATE if twin else None, None if twin else LATE)
    law = again.controller
    assert law is not None
    own = law.of_its_drive(PERIOD)
    assert own == LAW.on_ticks(own.ticks, PERIOD)
    assert again.rough is None
    if twin:
        asked, told = _asked_again(data, law, None)
        assert told is asked


def test_what_counts_make_is_known_beside_another_law_of_two_masses_too() -> None:
    """No twins tell it of these; those of the rigid axis do, where it was known of them and the law changes."""
    data, _ = _read_at_a_moment(0.0)
    problem, _ = _asked_again(data, LATE, None)
    rigid = plain_fit(data, base_model(AXIS).pack(), POLICY).fitted
    between = {"compliance": 1e-3, "load_inertia": 0.3, "load_friction": 0.0, "damping": 0.3}
    loaded = base_model(AXIS).with_effect(EFFECTS["elastic_transmission"].make(between)).pack()
    loaded.p[: len(layout.BASE)] = rigid.packed.p[: len(layout.BASE)]
    here = twinned(problem, loaded)
    assert here is not None
    found = replace(rigid, packed=loaded, error=here.error, cost=here.cost)
    again = told_beside(problem, found, rigid.packed)
    assert again.controller != problem.controller
    level, chance = again.comes_by_counts(TRAINING)
    assert (level, chance) == with_counts(again, rigid.packed).comes_by_counts(TRAINING)
    assert chance > 0.0, "known, though on these counts it is within its chance"


@pytest.mark.parametrize(
    ("told", "left", "asked"),
    [
        (replace(LAW, ticks=1, in_band=False), 0.5, True),
        (replace(LAW, ticks=1, in_band=False), 0.99, False),
        (replace(LAW, ticks=1, in_band=False, exact=True), 0.5, False),
    ],
    ids=["by chance", "leaves no less", "exact"],
)
def test_what_a_drives_law_asks_for_is_tried_beside_a_law_of_the_rows(
    told: PositionController, left: float, asked: bool
) -> None:
    """A PID of 16 kHz on 13 counts to the reach, rows of 2 ms: a law of the rows left 0.8 % less than the drive's, and
    with what that asks for in place of the torque two thirds of it were left (development half 74005)."""

    def left_by(law: PositionController, _: Disturbance) -> tuple[float, float]:
        return (left if law.asked > 0.0 else 1.0), 0.0

    data: Any = SimpleNamespace(repeated=True, period=PERIOD)
    known = model_error_module._Least(told, STILL, 1.0)
    plain: Any = SimpleNamespace(left_by=left_by)
    found = model_error_module._or_asked(data, [told, LAW], known, lambda _: plain)
    assert (found.law.asked > 0.0) is asked
    assert found.law.ticks > 1 if asked else found is known
