"""What a diagnosis begins with where a drive's loop works between the samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.diagnosis import baseline
from autotune.diagnosis.candidates import no_progress
from autotune.diagnosis.compare import compare
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.repeated import RepeatedProgramme
from autotune.diagnosis.evidence.torque_path import LATE_RECORD, is_recorded_late
from autotune.diagnosis.fit_recordings import fit_recordings
from autotune.diagnosis.refits import judged
from autotune.diagnosis.search_state import SearchState
from autotune.diagnosis.settling import _recorded_late
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.controller import as_acted, as_recorded, by_sensor_compared, controller_of
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import TRAINING, Block, Prepared
from autotune.estimation.model_error import with_misfit
from autotune.estimation.problem import new_problem
from autotune.models import layout
from autotune.models.drive_model import Packed, base_model
from autotune.models.torque_lag import IS_LATE
from autotune.recordings.recording import Recording
from autotune.signals.between_samples import delayed
from tests.estimation.simulated import AXIS, PERIOD, TRUE, followed, recorded

LAW = PositionController(1.0, 0.1, explained=0.998, source="identified", in_band=True)


def with_sensor(recording: Recording, shaken: float) -> tuple[Prepared, Floats]:
    """Data with a demand that is as noisy as asked for, shape (n,), and a torque by its sensor; and the demand."""
    data = prepared_to_fit([recording])
    noise = np.random.default_rng(2).normal(0.0, 1.0, len(data.torque))
    demand = data.torque + shaken * noise
    sensed = data.torque + 1e-3 * noise[::-1]
    return replace(data, torque=demand, recorded_torque=demand, sensed=sensed), demand


@pytest.mark.parametrize(
    ("in_band", "shaken", "sensed"), [(True, 5e-3, True), (True, 0.0, False), (False, 5e-3, False)]
)
def test_the_sensors_torque_is_taken_where_the_drives_loop_shakes_its_demand_between_the_samples(
    short, in_band: bool, shaken: float, sensed: bool
) -> None:
    data, demand = with_sensor(short, shaken)
    found = as_recorded(data, replace(LAW, in_band=in_band))
    assert np.array_equal(found.torque, data.sensed if sensed else demand)
    assert by_sensor_compared(data, replace(LAW, in_band=in_band)) is sensed
    assert not by_sensor_compared(replace(data, sensed=None), LAW)


@pytest.mark.parametrize(
    ("repeated", "shaken", "sensed"), [(True, 5e-3, True), (True, 0.0, False), (False, 5e-3, False)]
)
def test_without_a_twin_the_quieter_torque_is_compared_where_repeats_are(
    short, repeated: bool, shaken: float, sensed: bool
) -> None:
    data, demand = with_sensor(short, shaken)
    if not repeated:
        data = replace(data, blocks=tuple(replace(block, repeats=1) for block in data.blocks))
    assert np.array_equal(as_acted(data).torque, data.sensed if sensed else demand)


def test_what_the_law_does_not_ask_for_and_the_error_has_as_well_is_no_structure(short) -> None:
    """A misfit that comes again excuses as much of an error as it makes, and nothing of an error of another shape."""
    data = prepared_to_fit([short])
    problem, random = new_problem(data, LAW), np.random.default_rng(7)
    noise = 0.1 * random.standard_normal(len(data.grid))
    alike, other = np.zeros((2, len(data.grid)))
    for block in data.blocks:
        alike[block.rows], other[block.rows] = (
            np.tile(random.standard_normal(block.count), block.repeats) for _ in range(2)
        )
    known = replace(problem, misfit=alike)
    assert known.of_chain(0.5 * alike + noise, TRAINING) == pytest.approx(0.25, rel=0.15)
    assert known.of_chain(alike + other, TRAINING) == pytest.approx(1.0, rel=0.2)
    assert known.of_chain(other + noise, TRAINING) < 0.05
    assert problem.of_chain(alike, TRAINING) == pytest.approx(0.0)
    evidence = RepeatedProgramme()
    assert evidence.rest_that_is_none(known, alike, 1e-9) == pytest.approx(known.of_chain(alike, TRAINING))


def test_a_law_that_works_between_the_samples_is_held_against_the_torque_it_left(short) -> None:
    data = prepared_to_fit([short])
    law = controller_of(short)
    pushed = replace(data, torque=data.torque + 0.02 * np.sin(np.arange(len(data.torque)) / 20.0))
    left, plain = (with_misfit(new_problem(one, replace(law, in_band=True))).misfit for one in (pushed, data))
    sine = data.blocks[0].rows  # where no torque is at its limit
    assert np.std((left - plain)[sine]) == pytest.approx(0.02 / np.sqrt(2.0), rel=0.3)
    own = replace(pushed, sensed=pushed.recorded_torque)
    assert with_misfit(new_problem(own, replace(law, in_band=True))).misfit is None
    assert with_misfit(new_problem(pushed, law)).misfit is None


def thirds(blocks: Iterable[Block]) -> Iterator[Block]:
    """Experiments of the same rows, a third as long."""
    for block in blocks:
        count = block.count // 3
        for i in range(3):
            yield replace(block, start=block.start + i * block.repeats * count, count=count)


def test_one_loud_experiment_hides_no_rest_of_the_others(short) -> None:
    data = prepared_to_fit([short])
    problem = new_problem(replace(data, blocks=tuple(thirds(data.blocks))), LAW)
    quiet = np.random.default_rng(5).normal(0.0, 1.0, len(data.grid))
    loud = quiet.copy()
    loud[problem.data.blocks[0].rows] *= 30.0
    evidence, noise = RepeatedProgramme(), problem.noise_variance(loud, "training")
    assert noise > 50.0
    # a variance of noise over some hundred rows is known to a fifth
    assert evidence.rest_that_is_none(problem, loud, noise) == pytest.approx(1.0, rel=0.2)
    assert evidence.rest_that_is_none(problem, quiet, 0.5) == pytest.approx(0.5)


def test_rows_that_do_not_count_hide_no_rest_of_the_others(short) -> None:
    """At rest, where a coarse encoder shows no presliding, friction holds any torque: it differs in every repeat."""
    data = prepared_to_fit([short])
    problem = new_problem(replace(data, blocks=tuple(thirds(data.blocks))), LAW)
    random, rests = np.random.default_rng(5), np.zeros(len(data.grid), dtype=np.bool_)
    for number, block in enumerate(problem.data.blocks):
        rows = block.by_repeat(np.arange(len(rests)))
        rests[rows if number == 0 else rows[:, : block.count // 2]] = True  # of the first all rows
    error = random.normal(0.0, 1.0, len(rests)) * np.where(rests, 10.0, 1.0)
    counting = replace(problem, weight=np.where(rests, 0.0, 1.0))
    evidence, noise = RepeatedProgramme(), counting.noise_variance(error, "training")
    assert evidence.rest_that_is_none(problem, error, 60.0) > 20.0
    assert noise == pytest.approx(1.0, rel=0.2)
    assert evidence.rest_that_is_none(counting, error, 60.0) == pytest.approx(1.0, rel=0.2)


@pytest.mark.long
@pytest.mark.parametrize(("times", "twin"), [(1.0, True), (3.0, False)])
def test_a_twin_that_explains_far_less_than_none_is_not_used(
    short, nominal, monkeypatch, times: float, twin: bool
) -> None:
    """Behind a loop whose integrator is three times the axis's: shaken or not, such a twin is equally wrong."""
    data = prepared_to_fit(
        [Recording.from_columns(dict(short.floats), short.metadata, np.full(len(short), "move"))]
    )
    law = PositionController(60.0, 0.15, times * 6000.0, 1.0, explained=1.0, source="metadata")
    monkeypatch.setattr(baseline, "find_controller", lambda *_: law)
    problem, _, _, notes = baseline.begin(data, nominal)
    assert problem.twin is twin
    assert any(note.startswith("No twin: a simulation of the model") for note in notes) is not twin


LATE = [(TRUE, PERIOD), (PositionController(1.5, 0.016, 10.0, 0.7), 4e-3)]
"""Laws and rows' periods of late records; at 4 ms the slower loop that explains the columns as well does not run."""


@pytest.mark.slow
@pytest.mark.parametrize(("law", "period"), LATE)
def test_a_late_record_is_told_whatever_contact_the_wrong_loop_left(
    law: PositionController, period: float
) -> None:
    """A torque that is written a row late; the model was fitted in the slower loop that explains its columns as well.

    There the contact had to be undamped, and a fit that began with it ended with it.
    """
    problem, fit, _, notes = baseline.begin(
        prepared_to_fit([_written_late(law, period)]), base_model({**AXIS, "micro_damping": 0.0})
    )
    assert LATE_RECORD in notes
    assert problem.controller is not None
    assert (problem.controller.position_delay, problem.data.shift) == (0, 2.0)
    assert fit.fitted.packed.p[layout.MICRO_DAMPING] == pytest.approx(AXIS["micro_damping"], rel=0.2)
    assert fit.fitted.packed.p[layout.INERTIA] == pytest.approx(AXIS["inertia"], rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("law", "period"), LATE)
def test_a_fit_of_all_motion_and_its_comparison_ask_for_a_late_record(
    law: PositionController, period: float
) -> None:
    """An exact law with a delay explains the demand in either row; the axis does not."""
    late = _written_late(law, period)
    model = fit_recordings([late]).model
    assert model is not None
    compared = compare([late], model)
    assert LATE_RECORD in compared.notes
    assert model["micro_damping"] == pytest.approx(AXIS["micro_damping"], rel=0.2)
    assert model["viscous"] == pytest.approx(AXIS["viscous"], rel=0.1)


@pytest.mark.slow
def test_a_host_with_dead_time_has_no_late_record() -> None:
    law = replace(TRUE, kp=3.0, ki=30.0, reference_delay=1, position_delay=1)
    compared = compare([_twice(law, PERIOD, late=0)], base_model(AXIS))
    assert compared.twin
    assert not compared.late_record


@pytest.mark.parametrize(
    ("prompt", "other", "less", "late"),
    [
        (0.0, 0.0, 0.5, False),  # moved away from the row it was given: the loop is as late as its law
        (0.0, -1.0, 0.9, True),  # each says what it was begun with: the twin tells
        (0.0, -1.0, 0.99, False),
        (-0.9, -1.0, 1.05, True),  # it acts a row sooner: what a model lacks may leave less in the other loop
        (-0.9, -1.0, 2.5, False),  # but no loop spoils a fit that is its own
        (-0.9, -0.2, 0.5, False),
    ],
)
def test_a_loop_is_as_late_as_its_law_sees_and_its_torque_acts(
    short, prompt: float, other: float, less: float, late: bool
) -> None:
    problem = new_problem(prepared_to_fit([short]), LAW)
    one, two = (replace(problem, data=replace(problem.data, late=rows)) for rows in (prompt, other))
    left = np.ones(len(problem.data.grid))
    fits = [SimpleNamespace(error=scale * left) for scale in (1.0, less**0.5)]
    assert is_recorded_late(one, fits[0], two, fits[1]) is late
    exact = replace(one, controller=replace(LAW, exact=True))  # told by the motion: at its own row here
    assert not is_recorded_late(exact, fits[0], two, fits[1])
    cycle_later = replace(two, data=replace(two.data, cycles=1))
    assert not is_recorded_late(one, fits[0], cycle_later, fits[1])


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, 1])
def test_the_other_row_is_taken_where_it_is_asked_for(late: int) -> None:
    """Whatever the model as it is says of the row: what it lacks may be what told it."""
    law = TRUE if late else replace(TRUE, kp=3.0, ki=30.0, reference_delay=1, position_delay=1)
    data = prepared_to_fit([_twice(law, PERIOD, late=late)])
    told, other = (baseline.begin(data, base_model(AXIS), contrary=contrary) for contrary in (False, True))
    assert (LATE_RECORD in told[3], LATE_RECORD in other[3]) == (bool(late), not late)
    assert told[1].fitted.cost < other[1].fitted.cost


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, 1])
def test_the_row_is_told_again_beside_what_was_found(late: int) -> None:
    """A torque that was recorded a sample late, and that the model without the effect was told of otherwise."""
    law = TRUE if late else replace(TRUE, kp=3.0, ki=30.0, reference_delay=1, position_delay=1)
    data = prepared_to_fit([_twice(law, PERIOD, late=late)])
    problem, root, nominal, notes = baseline.begin(data, base_model(AXIS), contrary=bool(late))
    assert LATE_RECORD not in notes
    state = SearchState(problem, root, nominal, no_progress, evidence_of(data))
    found = judged(problem, root, root, "stribeck")
    best = _recorded_late(state, found)
    told = baseline.notes_after(notes, problem, state.problem)
    assert (best is found) is not bool(late)
    assert (LATE_RECORD in told) is bool(late)
    assert best.model_fit.fitted.cost <= root.fitted.cost
    on = root.fitted.packed.on.copy()
    on[IS_LATE] = True  # a lag in the loop undoes it
    packed = Packed(root.fitted.packed.p, on)
    lags = replace(found, model_fit=replace(root, fitted=replace(root.fitted, packed=packed)))
    state = SearchState(problem, root, nominal, no_progress, evidence_of(data))
    assert _recorded_late(state, lags) is lags


def _written_late(law: PositionController, period: float) -> Recording:
    return _twice(law, period, late=1)


def _twice(law: PositionController, period: float, late: int) -> Recording:
    """The same motion two times, disturbed by chance, with every torque so many rows after its own."""
    like = recorded(law, seconds=30.0, period=period)
    rows, rounds = len(like), []
    for seed in (1, 2):
        shaken = np.random.default_rng(seed).normal(0.0, 1e-3, rows)
        columns = followed(like["reference"], shaken, law, base_model(AXIS), None, period)
        columns["torque"] = delayed(columns["torque"], late, float(columns["torque"][0]))
        rounds.append(columns)
    both = {name: np.concatenate([one[name] for one in rounds]) for name in rounds[0]}
    both["time"] = np.arange(2 * rows) * period
    return Recording.from_columns(both, like.metadata, "motion", np.repeat([0, 1], rows))


@pytest.mark.parametrize(
    ("rows", "repeats", "late"), [(0.6, 2, 0.6), (0.1, 2, None), (3.0, 2, None), (0.6, 1, None)]
)
def test_a_twin_that_explains_nothing_is_tried_with_the_torque_as_late_as_it_acts(
    short, rows: float, repeats: int, late: float | None
) -> None:
    """Later than a row is no moment of recording, and of a single recording nothing is moved before its fit."""
    data = prepared_to_fit([short])
    at = np.arange(len(data.torque), dtype=np.float64)
    torque = np.concatenate(
        [np.interp(at[s.rows] + rows, at[s.rows], data.torque[s.rows]) for s in data.stretches]
    )
    blocks = tuple(replace(block, repeats=repeats) for block in data.blocks)
    data = replace(data, torque=torque, recorded_torque=torque, blocks=blocks)
    found = baseline._as_it_acts(new_problem(data, LAW))
    if late is None:
        assert found is None
    else:
        assert found is not None
        assert found.data.late == pytest.approx(late, abs=0.15)  # the bristle bends as a part of a row does
