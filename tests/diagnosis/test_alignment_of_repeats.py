"""When torque and position were taken is a nuisance of repeated recordings, as far as a measurement chain can do it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.diagnosis import baseline, settling
from autotune.diagnosis.base_laws import CURVE_LAW
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.candidates import FittedCandidate, again_explained, plainer
from autotune.diagnosis.evidence import torque_path as measured
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.evidence.repeated import RepeatedProgramme
from autotune.diagnosis.evidence.single import SingleRecording
from autotune.diagnosis.evidence.torque_path import (
    cycles_in_place,
    dead_time_in_place,
    is_longer,
    lag_in_loop,
    late_anew,
    recorded_otherwise,
    sees_late,
    without_long_lag,
)
from autotune.diagnosis.refits import settled_in
from autotune.diagnosis.search import _cycles_do, _is_dead_time, _lags_after_all, _without_chains_lag
from autotune.diagnosis.search_state import SearchState
from autotune.diagnosis.settling import _aligned
from autotune.diagnosis.wording import torque_path_notes
from autotune.estimation.alignment import behind_current_loop, followed_late, shifted
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.contact_start import (
    damped_as_twins_creep,
)
from autotune.estimation.controller import asked
from autotune.estimation.cross_validation import Explained
from autotune.estimation.data import TRAINING, Prepared, prepare
from autotune.estimation.disturbance import STILL
from autotune.estimation.disturbance_estimate import (
    asked_late,
    estimate_disturbance,
)
from autotune.estimation.least_squares import Fitted, Free, jacobian
from autotune.estimation.problem import Correction, Problem, Told, new_problem, refit
from autotune.estimation.residual import Simulated, measured_motion
from autotune.estimation.twin import loop_along
from autotune.estimation.twin_runs import _recorded, acted_late, run_twin, run_twins, shaken
from autotune.models import layout
from autotune.models.drive_model import Packed, base_model
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.torque_lag import IS_LATE, MOTOR_TORQUE, STAGES, TIME_CONSTANT
from autotune.models.torque_path import delivered
from autotune.models.torque_saturation import bent
from autotune.recordings.recording import Metadata, Recording
from autotune.signals.between_samples import delayed
from autotune.tuning.found_model import torque_late
from tests.estimation.simulated import AXIS, RESOLUTION, TRUE, followed
from tests.support.axes import NOMINAL, plain_axis
from tests.support.diagnosis_programme import play, programme

Begun = tuple[Problem, ModelFit]


def _spoilt(begun: Begun, data: Prepared, exact: bool) -> Begun:
    """Problem and fit with other data in place of those that fit, under a law of the samples or of a drive."""
    problem, model_fit = begun
    law = replace(problem.controller, exact=exact, in_band=not exact)
    data = replace(data, recorded_torque=data.torque, shift=0.0, late=0.0)
    problem = replace(problem, data=data, moved=measured_motion(data), controller=law)
    fitted = refit(problem, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, 2)
    return problem, replace(model_fit, fitted=fitted)


@pytest.mark.parametrize(
    ("late", "applied"), [(0.8, True), (-3.0, False)], ids=["recorded early", "more than any chain"]
)
def test_what_the_measurement_chain_can_do_is_taken_out(begun: Begun, late: float, applied: bool) -> None:
    """`late`: half samples of 1 ms by which the torque of a drive's own loop must be moved to be where it was.

    A cycle and a half later is as far from any number of cycles as can be.
    """
    problem, model_fit = _spoilt(begun, shifted(begun[0].data, -late), exact=False)
    again = RepeatedProgramme().aligned(problem, model_fit)
    assert (again is not problem) == applied
    if applied:
        other = RepeatedProgramme().aligned(*_spoilt(begun, shifted(begun[0].data, late), exact=False))
        assert again.data.shift - other.data.shift == pytest.approx(2.0 * late, abs=0.1)
        assert again.data.shift == pytest.approx(late, abs=0.3)


def test_a_delay_beside_which_the_axis_has_no_inertia_is_none(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fit may give all inertia to a delay: the twin of such an axis takes as many steps as there are, for nothing."""
    problem, model_fit = _spoilt(begun, shifted(begun[0].data, -0.8), exact=False)
    asked: list[Packed] = []

    def weightless(*args: Any) -> Fitted:
        fitted = refit(*args)
        (inertia,) = (one for one in fitted.free if one.slot == layout.INERTIA)
        p = fitted.packed.p.copy()
        p[layout.INERTIA] = inertia.lower + 1e-12 * inertia.scale  # as a step that ends there comes to
        asked.append(Packed(p, fitted.packed.on))
        return replace(fitted, packed=asked[-1])

    monkeypatch.setattr(measured, "refit", weightless)
    assert RepeatedProgramme().aligned(problem, model_fit) is problem
    assert len(asked) == 1


def test_a_lag_in_the_loop_is_told_from_rows_that_were_written_late(begun: Begun) -> None:
    """Along the measured motion both are a torque moved by 0.6 ms; in the twin only one of them delays the loop."""
    late = shifted(begun[0].data, 1.2)
    written = RepeatedProgramme().aligned(*_spoilt(begun, late, exact=False))
    assert written.data.late == pytest.approx(0.6, abs=0.15)
    lagging = play(plain_axis(3, {"torque_lag": 6e-4}), 3, programme(("sine", "points")))
    problem, model_fit = begin(prepared_to_fit([lagging]), base_model(NOMINAL))[:2]
    problem, model_fit = _spoilt((problem, model_fit), problem.data, exact=False)
    assert RepeatedProgramme().aligned(problem, model_fit) is problem


@pytest.mark.parametrize(("lag", "told"), [(7e-4, True), (2e-4, False)])
def test_a_lag_is_told_where_another_way_of_recording_made_up_for_it(lag: float, told: bool) -> None:
    """A torque that was read a sample late passes for that of a host a sample slower; the lag is a part of that sample.

    The twin of the slower host is later than the axis, and that of a prompt one behind the lag is not. What is no
    longer than an ordinary current loop is no lag in either.
    """
    lagging = play(plain_axis(3, {"torque_lag": lag}), 3, programme(("sine", "points")))
    problem, model_fit = begin(prepared_to_fit([lagging]), base_model(NOMINAL))[:2]
    assert problem.controller is not None
    slower = replace(problem.controller, reference_delay=1, position_delay=1)
    read = shifted(replace(problem.data, cycles=0), -2.0)
    taken = _spoilt((replace(problem, controller=slower), model_fit), read, exact=False)
    moved = RepeatedProgramme().aligned(*taken)
    settled = fit_inside_twin(moved, taken[1].fitted.packed, list(taken[1].free), 2)
    assert settled is not None
    found = lag_in_loop(moved, settled)
    assert (found is not None) == told
    if found is not None:
        assert found[0].controller is not None
        assert found[0].controller.position_delay == 0
        assert found[1].effects == ("torque_lag",)
        assert found[1].fitted.packed.p[TIME_CONSTANT] == pytest.approx(lag, abs=1.5e-4)
        assert found[1].fitted.cost < 0.98 * settled.fitted.cost
        assert lag_in_loop(*found) is None, "a model that has a lag keeps it"
        others = tuple(kind for kind in moved.candidates if kind.name != "torque_lag")
        assert lag_in_loop(replace(moved, candidates=others), settled) is None, (
            "no name that was not asked about"
        )


def test_a_reading_behind_a_filter_is_taken_out(begun: Begun) -> None:
    """Drives filter the torque that they tell by a millisecond or so; no effect makes it come after its motion."""
    late = 3.0
    problem, model_fit = _spoilt(begun, shifted(begun[0].data, -late), exact=False)
    again = RepeatedProgramme().aligned(problem, model_fit)
    assert again.data.shift == pytest.approx(late, abs=0.3)


def test_whole_cycles_behind_a_drive_s_loop_are_no_lag(begun: Begun) -> None:
    """A demand that acts a cycle later and behind a current loop; more than that by half a cycle is neither."""
    late = shifted(begun[0].data, 2.0)
    asked = replace(late, torque=_demand(late, 2e-4), recorded_torque=late.torque)
    problem, model_fit = _spoilt(begun, asked, exact=False)
    assert problem.controller is not None
    law = replace(problem.controller, ticks=4)
    problem = replace(problem, controller=law)
    again = RepeatedProgramme().aligned(problem, model_fit)
    assert again.data.cycles == 1
    assert again.data.shift == -2.0
    assert again.data.lag == pytest.approx(2e-4, abs=1.5e-4)  # and a quarter of a half sample of this axis
    assert again.controller == law
    assert acted_late(again.data, law) == 1.0, "the twin is as late as its torque"
    fitted = refit(again, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, 4)
    settled = RepeatedProgramme().aligned(again, replace(model_fit, fitted=fitted))
    assert (settled.data.cycles, settled.data.shift) == (1, -2.0)


def test_whole_cycles_are_asked_for_behind_a_host_without_an_exact_law(begun: Begun) -> None:
    """It works several times a recorded row: its law sees all a cycle later, as an exact one does."""
    late = shifted(begun[0].data, 2.0)
    asked = replace(late, torque=_demand(late, 2e-4), recorded_torque=late.torque)
    problem, model_fit = _spoilt(begun, asked, exact=False)
    again = measured._without_cycles(problem, model_fit)
    assert (again.data.cycles, again.data.shift) == (1, -2.0)
    assert again.data.lag == pytest.approx(2e-4, abs=1.5e-4)
    assert problem.controller is not None
    assert again.controller is not None
    assert again.controller.position_delay == problem.controller.position_delay + 1
    assert again.controller.reference_delay == problem.controller.reference_delay + 1


@pytest.mark.parametrize(
    ("least", "lag", "taken"),
    [(("moment", 1), 2e-4, True), (("moment", 0), 1.3e-3, False), (("next", 1), 2e-4, False)],
    ids=["a cycle and a current loop", "a lag", "as it was told"],
)
def test_how_a_torque_was_recorded_is_told_again_once_it_is_known_to_be_late(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, least: tuple[str, int], lag: float, taken: bool
) -> None:
    """It was told by twins that act at once: a cycle later another way may leave clearly less."""
    problem, model_fit = _spoilt(begun, begun[0].data, exact=False)
    law = replace(problem.controller, ticks=4)
    laws = law, replace(law, taken="moment")
    moved = shifted(problem.data, -2.0)
    late = replace(problem, controller=law, told=Told(problem.data, laws), data=replace(moved, cycles=1))
    assert recorded_otherwise(replace(late, data=problem.data), model_fit) is None, "no cycle was found"

    def fitted(problem: Problem, model_fit: ModelFit, late: float, steepness: float) -> ModelFit:
        assert problem.controller is not None
        best = (problem.controller.taken, problem.data.cycles) == least and steepness == 0.0
        lags = _lagging((problem, model_fit), lag if best else 0.0, ("torque_lag",))
        cost = (0.5 if best else 2.0) * model_fit.fitted.cost
        return replace(lags, fitted=replace(lags.fitted, cost=cost))

    monkeypatch.setattr(measured, "_behind_lag", fitted)
    monkeypatch.setattr(measured, "_is_long", lambda _, one: one.fitted.packed.p[TIME_CONSTANT] > 4.5e-4)
    found = recorded_otherwise(late, model_fit)
    assert (found is not None) == taken
    if found is None:
        return
    again, settled = found
    assert again.controller is not None
    assert again.controller.taken == "moment"
    assert not settled.fitted.packed.on[IS_LATE]
    assert (again.data.cycles, again.data.lag) == (1, lag)


def test_a_delay_with_which_the_loop_would_be_unstable_is_none_of_the_axis(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The axis ran in that loop: with a twin that cannot run nothing could be fitted any more."""
    late = shifted(begun[0].data, 2.0)
    asked = replace(late, torque=_demand(late, 2e-4), recorded_torque=late.torque)
    problem, model_fit = _spoilt(begun, asked, exact=False)
    assert problem.controller is not None
    problem = replace(problem, controller=replace(problem.controller, ticks=4))
    assert RepeatedProgramme().aligned(problem, model_fit).data.cycles == 1
    correction = Problem.correction

    def unstable_behind_a_bus(self: Problem, packed: Packed, simulations: int | None = None) -> Correction:
        return replace(correction(self, packed, simulations), stable=self.data.cycles == 0)

    monkeypatch.setattr(Problem, "correction", unstable_behind_a_bus)
    assert RepeatedProgramme().aligned(problem, model_fit) is problem


def test_a_running_mean_is_not_taken_for_whole_cycles(begun: Begun, monkeypatch: pytest.MonkeyPatch) -> None:
    """It bends the torque as several stages do; cycles that were taken out before that was seen come back."""
    monkeypatch.setattr(
        "autotune.diagnosis.evidence.torque_path.CLEARLY_LESS", 0.993
    )  # much of this rest is noise
    data = begun[0].data
    for _ in range(STAGES):
        data = replace(data, torque=_demand(data, 1.1e-3 / STAGES))
    problem, model_fit = _spoilt(begun, data, exact=True)
    assert RepeatedProgramme().aligned(problem, model_fit) is problem
    cycle = replace(shifted(problem.data, -2.0), cycles=1)
    law = problem.controller
    assert law is not None
    later = replace(law, reference_delay=law.reference_delay + 1, position_delay=law.position_delay + 1)
    taken = replace(problem, data=cycle, moved=measured_motion(cycle), controller=later)
    fitted = refit(taken, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, 2)
    again = RepeatedProgramme().aligned(taken, replace(model_fit, fitted=fitted))
    assert (again.data.cycles, again.data.shift, again.data.lag) == (0, 0.0, 0.0)
    assert again.controller == law


@pytest.mark.parametrize(("left", "taken"), [(1.0, True), (1.5, False)])
def test_a_lag_that_the_twin_does_not_bear_out_is_not_taken_out(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, left: float, taken: bool
) -> None:
    """An asymmetry looked like 0.26 ms of a current loop, and the twin in such a loop left 1.6 times as much.

    `left`: by the twin with the lag, of what it leaves without.
    """
    data = replace(begun[0].data, lag=0.0)
    problem, model_fit = _spoilt(begun, replace(data, torque=_demand(data, 3e-4)), exact=True)
    fitted = replace(model_fit.fitted, cost=left * model_fit.fitted.cost)
    monkeypatch.setattr(baseline, "fit_inside_twin", lambda *_: replace(model_fit, fitted=fitted))
    monkeypatch.setattr(baseline, "with_noise_of", lambda *both: both)
    again, _ = baseline._aligned(problem, model_fit)
    assert (again.data.lag > 0.0) == taken


def test_a_lag_that_was_found_beside_another_model_is_found_anew(begun: Begun) -> None:
    """What an effect left was taken for 0.3 ms of a current loop, in what is compared and in the twin's loop."""
    problem, model_fit = _spoilt(begun, replace(begun[0].data, lag=0.0), exact=True)
    assert late_anew(problem, model_fit) is None, "nothing is late"
    wrong = behind_current_loop(problem.data, 3e-4)
    late = replace(problem, data=wrong, moved=measured_motion(wrong))
    found = late_anew(late, model_fit)
    assert found is not None
    assert found[0].data.lag < 1e-4
    prompt = settled_in(problem, model_fit)
    assert prompt is not None
    assert found[1].fitted.cost <= prompt[1].fitted.cost * 1.02


@pytest.mark.parametrize(("lag", "ordinary"), [(3e-4, True), (9e-4, False)])
def test_a_delay_that_was_taken_for_the_moment_of_recording_is_found_in_the_loop(
    begun: Begun, lag: float, ordinary: bool
) -> None:
    """Where it is longer than a current loop's it is left to be named."""
    data = begun[0].data
    asked = replace(data, torque=_demand(data, lag))
    problem, model_fit = _spoilt(begun, asked, exact=False)
    assert problem.controller is not None
    problem = replace(problem, controller=replace(problem.controller, ticks=4))
    moved = shifted(problem.data, -2.0 * lag / problem.data.period)
    taken = replace(problem, data=moved, moved=measured_motion(moved))
    assert taken.data.late > 0.0
    found = late_anew(taken, model_fit)
    assert found is not None
    assert (found[0].data.late, found[0].data.shift) == (0.0, 0.0)
    assert found[0].data.lag == pytest.approx(lag, abs=1.5e-4)
    kept = without_long_lag(*found)
    assert (kept.data.lag > 0.0) == ordinary
    assert kept.data.shift == 0.0
    if ordinary:
        again = RepeatedProgramme().aligned(kept, found[1])
        assert again.data.lag == kept.data.lag, "the twin told, and the torque is not moved again"


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
    assert problem.controller is not None
    assert again.controller is not None
    later = again.controller.position_delay - problem.controller.position_delay
    assert later == cycles, "the twin's controller must be as late as its torque"
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
    made_up = replace(again.data, late=0.0)  # for a record that was taken to be late by as much
    assert len(torque_path_notes(made_up)) == 1


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
    modelled = np.array(
        [delivered(p, on, state, float(u), data.period, bent(p, on)) for u in data.torque[rows]]
    )
    assert behind_current_loop(data, lag).torque[rows] == pytest.approx(modelled, rel=1e-9, abs=1e-12)
    assert behind_current_loop(behind_current_loop(data, lag), 0.0).torque == pytest.approx(
        data.recorded_torque
    )


def test_the_twin_moves_behind_the_current_loop_that_was_taken_out(begun: Begun) -> None:
    """As an axis does that has the lag as an effect; and what it records is behind that loop, as the recording is."""
    problem, model_fit = begun
    law, packed, lag = problem.controller, model_fit.fitted.packed, 3e-4
    assert law is not None
    on, p = packed.on.copy(), packed.p.copy()
    p[TIME_CONSTANT], on[IS_LATE] = lag, True
    prompt = behind_current_loop(problem.data, 0.0)
    late = replace(prompt, lag=lag)  # it begins as the other does

    def run(data: Prepared, model: Packed) -> Simulated:
        return run_twin(data, model, law, STILL, np.random.default_rng(0))

    own, taken_out, none = run(prompt, Packed(p, on)), run(late, packed), run(prompt, packed)
    assert taken_out.position == pytest.approx(own.position, abs=1e-12)
    assert taken_out.torque == pytest.approx(followed_late(prompt, own.torque, lag), abs=1e-12)
    assert np.abs(none.position - own.position).max() > problem.data.resolution
    twins = run_twins(late, [packed] * 2, law, [shaken(late, STILL, np.random.default_rng(0))] * 2)
    assert twins[1].torque == pytest.approx(taken_out.torque, abs=1e-12)
    both = run(late, Packed(p, on)).position
    p[TIME_CONSTANT] = 2.0 * lag
    assert both == pytest.approx(run(prompt, Packed(p, on)).position, abs=1e-12)


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


@pytest.mark.parametrize(
    ("lag", "between", "longer"), [(4.7e-4, True, False), (4.7e-4, False, True), (9e-4, True, True)]
)
def test_behind_a_drives_loop_a_lag_is_longer_by_what_an_ordinary_one_would_leave(
    begun: Begun, lag: float, between: bool, longer: bool
) -> None:
    """However well it is known: 20 µs beyond the slowest current loop say nothing of an axis behind a fitted loop."""
    problem = begun[0]
    assert problem.controller is not None
    problem = replace(problem, controller=replace(problem.controller, ticks=4 if between else 1))
    left = np.random.default_rng(3).standard_normal(len(problem.training)) * (problem.training > 0)
    error = 0.1e-3 * math.sqrt(4.0 / np.count_nonzero(problem.training))  # noise is as much as 0.1 ms leave
    assert is_longer(problem, left, lag, error) == longer


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


def test_what_differs_between_repeats_is_told_from_what_they_share(begun: Begun) -> None:
    """Of a sum of squares; an experiment that was played once has nothing that differs."""
    problem, _ = begun
    random, rows = np.random.default_rng(5), len(problem.training)
    noise, alike, repeated = random.standard_normal(rows), np.zeros(rows), np.zeros(rows)
    for block in problem.data.blocks:
        if block.role == TRAINING and block.repeats > 1:
            alike[block.rows] = np.tile(random.standard_normal(block.count), block.repeats)
            repeated[block.rows] = 1.0
    apart = measured._not_shared(problem, np.ones(rows), alike + 0.5 * noise)
    assert apart == pytest.approx(0.25 * repeated.sum(), rel=0.1)  # of 1360 pairs
    assert measured._not_shared(problem, np.ones(rows), alike) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("effect", "gain", "left", "sure"),
    [
        ("reversal_memory", 0.7, 0.01, True),
        ("dwell_time_break_away", 0.7, 0.01, True),  # older in every repeat
        ("reversal_memory", 0.7, 0.2, False),
        ("reversal_memory", 0.05, 0.01, False),
        ("torque_lag", 0.7, 0.01, False),
    ],
)
def test_what_remembers_need_not_come_again_where_experiments_held_out_and_veto_are_explained(
    begun: Begun, effect: str, gain: float, left: float, sure: bool
) -> None:
    """A lag smooths noise and says nothing of it; elements have another past in every repeat."""
    problem, root = begun
    part = Explained(1e-4, left * 1e-4)
    best = FittedCandidate(effect, root, gain, part, part, False)
    search = SearchState(problem, root, root.fitted.packed, print, RepeatedProgramme())
    assert search.remembers(best) == sure
    assert not search.remembers(replace(best, veto=None))


@pytest.mark.parametrize(
    ("effect", "curved", "veto", "more"),
    [
        ("dwell_time_break_away", True, False, True),
        ("reversal_memory", True, False, True),
        ("dwell_time_break_away", False, False, False),
        ("dwell_time_break_away", True, True, False),
        ("spring", True, False, False),
    ],
)
def test_what_a_base_of_another_presliding_may_leave_must_be_clear_where_no_veto_bears_it_out(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, effect: str, curved: bool, veto: bool, more: bool
) -> None:
    """A dwell time of 10 % was named where nothing was planted but Bouc and Wen's law."""
    problem, root = begun
    monkeypatch.setattr(type(problem), "has_veto", property(lambda _: veto))
    packed = root.fitted.packed
    p = packed.p.copy()
    p[list(CURVE_LAW.slots)] = 0.5 if curved else 0.0
    root = replace(root, fitted=replace(root.fitted, packed=Packed(p, packed.on)))
    best = FittedCandidate(effect, root, 0.1, Explained(1e-4, 0.0), None, True)
    search = SearchState(problem, root, packed, print, RepeatedProgramme())
    assert CURVE_LAW.there(root.fitted.packed) == curved
    assert search.may_be_presliding(best) == more


@pytest.mark.parametrize("more", [True, False])
def test_a_lag_of_the_loop_is_asked_for_where_anything_comes_again(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, more: bool
) -> None:
    """What it does comes again in every repeat."""
    problem, root = begun
    asked: list[ModelFit] = []
    monkeypatch.setattr("autotune.diagnosis.search.lag_in_loop", lambda _, left: asked.append(left))
    monkeypatch.setattr(SearchState, "more_to_explain", lambda *_: more)
    search = SearchState(problem, root, root.fitted.packed, print, RepeatedProgramme())
    assert not _lags_after_all(search)
    assert len(asked) == int(more)


@pytest.mark.parametrize(
    ("effects", "left", "dropped"),
    [
        (("torque_lag", "spring"), 1.0, True),
        (("torque_lag", "spring"), 1.05, False),
        (("torque_lag",), 1.0, False),
        (("spring", "stribeck"), 1.0, False),
    ],
)
def test_a_lag_beside_others_goes_where_the_chain_beside_them_is_as_late(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, effects: tuple[str, ...], left: float, dropped: bool
) -> None:
    """What they explain was missing as the chain was asked; `left`: by the chain in its place, of what the lag does."""
    problem, root = begun
    again = replace(problem, data=shifted(problem.data, -1.0))
    explained = Explained(1.0, 0.0)
    chosen = FittedCandidate(effects[-1], replace(root, effects=effects), 0.6, explained, None, named=True)
    bare = replace(root, fitted=replace(root.fitted, cost=left * root.fitted.cost), effects=("spring",))
    less = replace(chosen, model_fit=bare)
    monkeypatch.setattr(RepeatedProgramme, "aligned", lambda *_: again)
    monkeypatch.setattr("autotune.diagnosis.search.without_effect", lambda *_: less)
    monkeypatch.setattr("autotune.diagnosis.search_state.fitted_again", lambda *_: (bare, [less]))
    search = SearchState(problem, root, root.fitted.packed, print, RepeatedProgramme(), chosen=chosen)
    _without_chains_lag(search)
    assert (search.chosen is less) == dropped
    assert (search.problem is again) == dropped
    assert (search.root is root) == (not dropped)


def _lagging(begun: Begun, lag: float, effects: tuple[str, ...]) -> ModelFit:
    """The fit with a lag of its loop [s] among its effects."""
    p, on = begun[1].fitted.packed.p.copy(), begun[1].fitted.packed.on.copy()
    p[TIME_CONSTANT], on[IS_LATE] = lag, True
    free = [*begun[1].free, Free("time_constant", TIME_CONSTANT, 0.0, 0.01, 1e-4)]
    fitted = replace(begun[1].fitted, packed=Packed(p, on), free=tuple(free))
    return replace(begun[1], fitted=fitted, effects=effects)


@pytest.mark.parametrize(
    ("lag", "cycles", "behind"),
    [(0.98e-3, 1, 0.0), (1.2e-3, 1, 2e-4), (1.7e-3, 2, 0.0), (3e-4, 0, 0.0), (6e-3, 0, 0.0)],
    ids=["a cycle", "behind a current loop", "nearly two", "less than half", "more than any bus"],
)
def test_whole_cycles_are_asked_for_a_lag_in_the_twin(
    begun: Begun, lag: float, cycles: int, behind: float
) -> None:
    """With all else as it was found, in a loop that is as late."""
    problem = replace(begun[0], data=shifted(begun[0].data, 0.0))
    found = cycles_in_place(problem, _lagging(begun, lag, ("spring", "torque_lag")))
    assert [one[0].data.cycles for one in found] == [cycles] * (cycles > 0)
    for again, bare in found:
        assert problem.controller is not None
        assert again.controller is not None
        assert again.controller.position_delay == problem.controller.position_delay + cycles
        assert again.controller.reference_delay == problem.controller.reference_delay + cycles
        assert again.data.late == problem.data.late + cycles
        assert again.data.lag == pytest.approx(behind)
        assert 0.0 < again.data.lag_error < 3e-4
        assert not bare.fitted.packed.on[IS_LATE]
        assert bare.effects == ("spring",)
        assert len(bare.free) == len(begun[1].free)


def test_no_torque_is_recorded_two_samples_late(begun: Begun) -> None:
    """A law that sees all two samples late was told twice; the torque had been moved by one of them only."""
    problem = begun[0]
    assert problem.controller is not None
    law = replace(problem.controller, reference_delay=2, position_delay=2)
    late = measured.recorded_late(replace(problem, controller=law))
    assert late is not None
    assert late.controller is not None
    assert (late.controller.position_delay, late.data.shift, late.data.late) == (1, 2.0, -1.0)
    assert measured.recorded_late(late) is None
    behind = replace(late, data=behind_current_loop(late.data, 3e-4))
    ((prompt, lag),) = measured._ways_of_recording(behind)
    assert (prompt.data.shift, prompt.data.lag) == (2.0, 0.0), "it acts at once where it was moved to"
    assert lag == pytest.approx(3e-4)


def _added(late: int) -> tuple[Problem, Packed]:
    """An axis without noise whose host's torque, and what was added to it, act so many rows after they are written."""
    time = np.arange(3000) * 1e-3
    reference = 2.0 * (1.0 - np.cos(math.pi * time)) + 0.3 * (1.0 - np.cos(14.0 * time))
    added = 0.05 * np.sign(np.gradient(reference)) + 0.03 * np.sin(44.0 * time)
    model = base_model(AXIS)
    seen = replace(TRUE, reference_delay=late, position_delay=late)
    wanted, acts = (delayed(one, late, float(one[0])) for one in (reference, added))
    columns = followed(wanted, np.zeros(len(time)), seen, model, added=acts)
    written = np.concatenate([columns["torque"][late:], np.full(late, columns["torque"][-1])])
    columns |= {"reference": reference, "torque": written, "torque_feedforward": added}
    metadata = Metadata(sample_period=1e-3, position_resolution=RESOLUTION)
    data = prepare([Recording.from_columns(columns, metadata, "motion")])
    return new_problem(data, replace(TRUE, exact=True, source="identified")), model.pack()


def test_what_was_added_to_a_host_s_torque_acts_as_many_cycles_later() -> None:
    """Two cycles: added at once it moved the twin by 0.6 mrad, and the law left 7 mN m of an exact torque."""
    problem, packed = _added(2)
    again = measured._later_by(problem, 2, measured._acting_later(problem.data, 2, 2))
    dead = measured._after_dead_time(problem, 2.0)
    for one in (again, dead):
        assert one.controller is not None
        data = one.data
        run = run_twin(data, packed, one.controller, STILL, np.random.default_rng(1))
        inside = slice(1500, -100)  # where the twin began has gone
        assert float(np.max(np.abs((run.position - data.measured)[inside]))) < 5e-5, "a few counts"
        assert float(np.max(np.abs((data.torque - asked_late(data, one.controller))[inside]))) < 1e-9
    back = measured._with_cycles_again(again)
    kept = slice(None, -2)
    assert np.array_equal(back.data.feedforward[kept], problem.data.feedforward[kept])
    between = replace(problem, controller=replace(TRUE, ticks=4))
    moved = measured._later_by(between, 2, between.data)
    assert moved.data.feedforward is between.data.feedforward, "there the twin sees to it"


@pytest.mark.parametrize("late", [0, 2])
def test_what_was_added_between_the_samples_acts_as_late_as_the_torque(late: int) -> None:
    problem, _ = _added(0)
    data, law = problem.data, replace(TRUE, ticks=4)
    data = replace(data, cycles=late)
    (stretch,) = data.stretches
    loops = [
        loop_along(_recorded(one, law, stretch), law).feedforward
        for one in (data, replace(data, feedforward=np.zeros(len(data.time))))
    ]
    added = np.repeat(delayed(data.feedforward, late, float(data.feedforward[0])), 4)
    assert loops[0] - loops[1] == pytest.approx(added, abs=1e-12)


@pytest.mark.parametrize(
    ("lag", "known"),
    [(6e-4, True), (1.3e-3, True), (1.6e-3, False)],
    ids=["a part of a row", "a row and a current loop", "more"],
)
def test_a_dead_time_of_a_part_of_a_row_is_asked_for_a_lag_in_the_twin(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, lag: float, known: bool
) -> None:
    """With all else as it was found, in a loop that is as late; what a fit leaves of the lag is a current loop's."""
    problem = replace(begun[0], data=shifted(begun[0].data, 0.0))
    lags = _lagging(begun, lag, ("spring", "torque_lag"))
    monkeypatch.setattr(measured, "fit_inside_twin", _as_begun(lags))
    found = dead_time_in_place(problem, lags)
    assert (found is not None) == known
    if found is None:
        return
    again, bare = found
    assert problem.controller is not None
    assert again.controller is not None
    late = again.controller.position_delay + again.controller.part_late - problem.controller.position_delay
    assert again.controller.reference_delay - problem.controller.reference_delay == int(late)
    assert 0.0 < late <= 1.0
    assert again.data.late - problem.data.late == pytest.approx(late)
    assert again.data.lag + late * again.data.period == pytest.approx(lag, abs=3e-5)
    assert again.data.cycles == problem.data.cycles
    assert not bare.fitted.packed.on[IS_LATE]
    assert bare.effects == ("spring",)


@pytest.mark.parametrize(("ticks", "known"), [(1, True), (2, False)])
def test_a_dead_time_is_asked_for_behind_any_law_of_the_samples(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, ticks: int, known: bool
) -> None:
    """A host that works twice a row has no exact law in the rows, and a dead time as well."""
    problem = replace(begun[0], data=shifted(begun[0].data, 0.0))
    assert problem.controller is not None
    problem = replace(problem, controller=replace(problem.controller, exact=False, ticks=ticks))
    lags = _lagging(begun, 1.3e-3, ("spring", "torque_lag"))
    monkeypatch.setattr(measured, "fit_inside_twin", _as_begun(lags))
    assert (dead_time_in_place(problem, lags) is not None) == known


def _as_begun(lags: ModelFit) -> Callable[..., ModelFit]:
    """A fit that stays where it is begun."""

    def fit(_: Problem, packed: Packed, free: list[Free], rounds: int, effects: tuple[str, ...]) -> ModelFit:
        jacobian = np.random.default_rng(1).standard_normal((len(lags.fitted.error), len(free)))
        told = {"jacobian": jacobian, "scales": np.array([one.scale for one in free])}
        fitted = replace(lags.fitted, packed=packed, free=tuple(free), **told)
        return replace(lags, fitted=fitted, effects=effects)

    return fit


def test_a_law_asks_for_the_mean_of_what_acts_behind_a_dead_time(begun: Begun) -> None:
    """Of each row a part has the demand before; the law that sees all as much later asks for the mean of both."""
    data, law = begun[0].data, begun[0].controller
    assert law is not None
    prompt, late = asked(data, law), asked(data, replace(law, part_late=0.3))
    prompt, late = prompt[:20000], late[:20000]  # before any clamp, which each of them would have elsewhere
    assert late[1:] == pytest.approx(0.7 * prompt[1:] + 0.3 * prompt[:-1], abs=1e-3 * float(np.std(prompt)))
    assert replace(law, part_late=0.3).gains[-1] == pytest.approx(law.gains[-1] + 0.3)


@pytest.mark.parametrize(
    ("better", "taken", "delayed"),
    [("delay", True, False), ("lag", False, False), ("neither", False, True)],
)
def test_a_lag_is_told_from_a_dead_time_by_what_errs_less_beyond_chance(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, better: str, taken: bool, delayed: bool
) -> None:
    """A host's demand that acts half a row later is no effect; where neither is told the name is not confirmed."""
    problem, root = begun
    lags = _lagging(begun, 6e-4, ("torque_lag",))
    chosen = FittedCandidate("torque_lag", lags, 0.6, Explained(1.0, 0.0), None, named=True)
    behind, other = replace(problem), {"delay": root, "lag": lags}.get(better)
    monkeypatch.setattr("autotune.diagnosis.search.dead_time_in_place", lambda *_: (behind, root))
    monkeypatch.setattr("autotune.diagnosis.search.with_noise_of", lambda *both: both)
    monkeypatch.setattr(RepeatedProgramme, "apart", lambda _, __, less, more: less is other)
    search = SearchState(problem, root, root.fitted.packed, print, RepeatedProgramme(), chosen=chosen)
    assert _is_dead_time(search) == taken
    assert (search.problem is behind) == taken
    assert search.delayed == delayed


@pytest.mark.parametrize("told", [False, True], ids=["as well", "better"])
def test_a_dead_time_of_some_rows_is_asked_as_one_of_a_row_is(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, told: bool
) -> None:
    """Whole cycles of as many rows are a bus; where the longer dead time is not told either, no name is confirmed."""
    problem, root = begun
    lags = _lagging(begun, 2.4e-3, ("torque_lag",))
    chosen = FittedCandidate("torque_lag", lags, 0.6, Explained(1.0, 0.0), None, named=True)

    def found(_: Problem, __: ModelFit, most: int) -> Begun | None:
        return (behind, root) if most > 1 else None

    behind = replace(problem)
    monkeypatch.setattr("autotune.diagnosis.search.dead_time_in_place", found)
    monkeypatch.setattr("autotune.diagnosis.search.with_noise_of", lambda *both: both)
    monkeypatch.setattr(RepeatedProgramme, "apart", lambda _, __, less, more: told and less is root)
    search = SearchState(problem, root, root.fitted.packed, print, RepeatedProgramme(), chosen=chosen)
    assert _is_dead_time(search) == told
    assert search.delayed != told
    assert search.problem is (behind if told else problem)


@pytest.mark.parametrize(("left", "taken"), [(1.0, True), (1.05, False)])
def test_a_lag_gives_way_to_cycles_that_leave_as_little(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, left: float, taken: bool
) -> None:
    """A record that was not late had its sample back as a lag beside a spring that relaxes, and that was named."""
    problem, root = begun
    lags = _lagging(begun, 1e-3, ("spring", "torque_lag"))
    chosen = FittedCandidate("torque_lag", lags, 0.6, Explained(1.0, 0.0), None, named=True)
    cost = left * lags.fitted.cost
    bare = replace(root, fitted=replace(root.fitted, cost=cost), effects=("spring",))
    monkeypatch.setattr("autotune.diagnosis.search.cycles_in_place", lambda *_: [(problem, bare)])
    search = SearchState(
        replace(problem), root, root.fitted.packed, print, RepeatedProgramme(), chosen=chosen
    )
    assert _cycles_do(search, chosen) == taken
    assert search.chosen is not None
    assert search.chosen.model_fit.effects == (("spring",) if taken else ("spring", "torque_lag"))
    assert (search.problem is problem) == taken


@pytest.mark.parametrize(
    ("left", "named", "course", "moved"),
    [
        (0.9, True, None, True),
        (1.05, True, None, False),
        (0.9, False, 0.95, True),
        (0.9, False, None, True),
        (0.9, False, 0.8, False),  # a moving mean, of which the lag's course knows more than the shift takes
    ],
)
def test_a_candidate_is_aligned_where_the_twin_leaves_no_more(
    begun: Begun, monkeypatch: pytest.MonkeyPatch, left: float, named: bool, course: float | None, moved: bool
) -> None:
    """A lag that explained 95 % was moved to 52 %, as rows that are late explain as much along the measured motion."""
    problem, root = begun
    again = replace(problem, data=shifted(problem.data, -1.0))

    def leaves(part: float) -> ModelFit:
        return replace(root, fitted=replace(root.fitted, cost=part * root.fitted.cost))

    before = FittedCandidate("torque_lag", root, 0.6, Explained(1.0, 0.0), None, named=True)
    after = replace(before, model_fit=leaves(left), named=named)
    shaped = None if course is None else replace(before, model_fit=leaves(course))
    monkeypatch.setattr(RepeatedProgramme, "aligned", lambda *_: again)
    monkeypatch.setattr("autotune.diagnosis.search_state.fitted_again", lambda *_: (after.model_fit, [after]))
    monkeypatch.setattr(settling, "with_free_shape", lambda *_: shaped)
    search = SearchState(problem, root, root.fitted.packed, print, RepeatedProgramme())
    found = _aligned(search, before)
    assert (found is after) == moved
    assert search.problem is (again if moved else problem)
    assert (search.root is root) == (not moved)


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


@pytest.mark.parametrize(
    ("bent", "gain", "taken"), [(0.9, 0.80, True), (0.9, 0.60, False), (0.05, 0.80, False)]
)
def test_a_memory_without_a_name_that_predicts_no_more_than_a_spring_is_that_spring(
    begun: Begun, bent: float, gain: float, taken: bool
) -> None:
    """`bent`: displacement of its element, of the travel. A spring beside another effect leaves what a sum of elements
    bends to, and so less is left by that, of what was fitted."""
    problem, root = begun
    packed = Packed(root.fitted.packed.p.copy(), root.fitted.packed.on.copy())
    packed.p[REVERSAL_MEMORY.slot("displacement_1")] = bent * problem.scales.travel
    packed.p[REVERSAL_MEMORY.slot("torque_1")] = problem.scales.torque
    bending = replace(root, fitted=replace(root.fitted, packed=packed))
    memory = FittedCandidate("reversal_memory", bending, 0.81, Explained(0.88, 0.0), None, named=False)
    error = 2.0 * root.fitted.error
    other = replace(root, fitted=replace(root.fitted, error=error))
    spring = FittedCandidate("spring", other, gain, Explained(0.83, 0.0), None, named=False)
    assert plainer(problem, [memory, spring], memory, 0.03) is (spring if taken else memory)


@pytest.mark.slow
@pytest.mark.parametrize("times", [4.0, 24.0])
def test_damping_in_presliding_is_found_again_by_twins_where_a_fit_was_led_astray(
    begun: Begun, times: float
) -> None:
    """From so many times the damping, all else at its best there; what is left stays as it is.

    But for what two fits of one model differ by, as few twins tell their bias: fitted on from their own end, fits end
    up to 3 % lower.
    """
    problem, root = begun
    own = float(root.fitted.packed.p[layout.MICRO_DAMPING])
    astray = [
        replace(one, lower=times * own) if one.slot == layout.MICRO_DAMPING else one for one in root.free
    ]
    p = root.fitted.packed.p.copy()
    p[layout.MICRO_DAMPING] = times * own
    wrong = fit_inside_twin(problem, Packed(p, root.fitted.packed.on), astray, 2)
    assert wrong is not None
    assert wrong.fitted.cost > 1.3 * root.fitted.cost
    wrong = replace(wrong, fitted=replace(wrong.fitted, free=root.free))
    found = damped_as_twins_creep(problem, wrong)
    assert found.fitted.cost < 1.05 * root.fitted.cost
    assert float(found.fitted.packed.p[layout.MICRO_DAMPING]) == pytest.approx(own, rel=0.4)
    assert damped_as_twins_creep(replace(problem, controller=None), wrong) is wrong


@pytest.mark.slow
def test_damping_that_is_tried_is_not_solved_for(recorded: Callable[..., Recording]) -> None:
    """By its slope any damping made the torque of the one before: none left less, and 24 times as much was kept."""
    problem, root = begin(prepared_to_fit([recorded(5)]), base_model(NOMINAL))[:2]
    own = float(root.fitted.packed.p[layout.MICRO_DAMPING])
    p = root.fitted.packed.p.copy()
    p[layout.MICRO_DAMPING] = 24.0 * own
    held = [one for one in root.free if one.slot != layout.MICRO_DAMPING]
    wrong = fit_inside_twin(problem, Packed(p, root.fitted.packed.on), held, 2)
    assert wrong is not None
    there = wrong.fitted.packed
    columns, scales = jacobian(problem.data, problem.moved, there, list(root.free), problem.raw(there))
    fitted = replace(wrong.fitted, free=root.free, jacobian=columns, scales=scales)
    found = damped_as_twins_creep(problem, replace(wrong, fitted=fitted))
    assert found.fitted.cost < 1.3 * root.fitted.cost < 1e-2 * wrong.fitted.cost
    assert float(found.fitted.packed.p[layout.MICRO_DAMPING]) == pytest.approx(own, rel=0.4)


@pytest.mark.parametrize(
    ("delay", "cycles", "late"), [(0, 0, False), (1, 0, True), (1, 1, False), (2, 1, True)]
)
def test_a_law_that_sees_later_than_its_cycles_has_told_when_its_torque_acts(
    begun: Begun, delay: int, cycles: int, late: bool
) -> None:
    problem = begun[0]
    assert problem.controller is not None
    rows = problem.data.upsampling * delay
    law = replace(problem.controller, position_delay=rows)
    seen = replace(problem, controller=law, data=replace(problem.data, cycles=cycles))
    assert sees_late(seen) is late
    assert not sees_late(replace(seen, controller=None))
