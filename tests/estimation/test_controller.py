"""The one controller of both engines: known truth, known files, and what is said where they disagree."""

import re
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage, signal

from autotune.core.arrays import Floats
from autotune.estimation import controller, controller_search, controller_unsaid
from autotune.estimation.alignment import a_row_sooner
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.controller import (
    as_read,
    as_wanted,
    asked,
    controller_of,
    find_controller,
    identified,
    loop_samples,
)
from autotune.estimation.controller_law import (
    LoopSamples,
    PositionController,
    fitted_whole,
    late_samples,
    law_terms,
    regular_rows,
)
from autotune.estimation.controller_search import (
    _late_trials,
    _leaves_as_little,
    _of_prompt_rows,
    first_look,
    law_from_data,
    plain_in_band,
    planner_rows,
    searched_late,
)
from autotune.estimation.controller_unsaid import (
    _is_kicked,
    fed_late,
    set_point_filter,
    with_feedforward_late,
    with_friction_fed,
    with_set_points_filtered,
    with_torque_added,
    with_torque_limit,
)
from autotune.estimation.data import prepare
from autotune.estimation.disturbance import STILL
from autotune.estimation.policy import POLICY
from autotune.estimation.twin_runs import run_twin, run_twins
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Controller, Metadata, Recording
from autotune.signals.between_samples import delayed
from autotune.signals.set_point_filters import SET_POINT_FILTERS
from autotune.signals.triangle import less_run_means
from tests.estimation.simulated import AXIS, OF_TRUE, PERIOD, RESOLUTION, TRUE, followed, recorded


def both(recording: Recording) -> PositionController:
    """What both engines find; they must agree."""
    found = controller_of(recording)
    other = find_controller(prepare([recording]))
    assert (other.source, other.gains.tolist()) == (found.source, found.gains.tolist())
    return found


def assert_is(found: PositionController, law: PositionController) -> None:
    """The torque follows from reference and logged position exactly: only the search's tolerance is left."""
    assert found.explained > POLICY.controller_explains
    for name in ("kp", "kd", "ki", "derivative_filter", "reference_rate"):
        assert getattr(found, name) == pytest.approx(getattr(law, name), rel=2e-3, abs=2e-3), name
    assert found.velocity_feedforward == pytest.approx(law.velocity_feedforward, abs=1e-4)


def test_the_files_controller_is_verified() -> None:
    found = both(recorded(TRUE, OF_TRUE))
    assert found.source == "metadata"
    assert (found.kp, found.kd, found.ki) == (TRUE.kp, TRUE.kd, TRUE.ki)
    assert found.notes == ()


def test_gains_that_are_right_in_a_file_whose_torque_is_late_need_no_mending() -> None:
    recording = recorded(TRUE, OF_TRUE)
    late = {name: recording[name][:-1] for name in ("time", "reference", "position")}
    late |= {"torque": np.concatenate([recording["torque"][:1], recording["torque"][:-2]])}
    found = controller_of(Recording.from_columns(late, recording.metadata, "x"))
    assert (found.source, found.reference_delay, found.position_delay) == ("identified", 1, 1)
    assert "a row late, and the gains need no mending" in " ".join(found.notes)


def test_gains_that_are_right_need_no_mending_where_a_filter_is_not_named() -> None:
    found = controller_of(recorded(TRUE, replace(OF_TRUE, derivative_filter=1.0)))
    assert found.source == "identified"
    assert "gains are the same: what differs is a filter" in " ".join(found.notes)


def test_a_filter_in_seconds_is_told_what_it_is() -> None:
    found = controller_of(recorded(TRUE, replace(OF_TRUE, derivative_filter=0.0009)))
    assert found.source == "identified"
    assert "Its derivative_filter of 0.0009 is the share of a new difference" in " ".join(found.notes)


@pytest.mark.parametrize(
    "named",
    [replace(OF_TRUE, kp=1.1 * TRUE.kp), replace(OF_TRUE, kd=0.9 * TRUE.kd), Controller(1.0, 2.0, 3.0, 0.4)],
    ids=["kp 10 % too large", "kd 10 % too small", "invented"],
)
def test_a_file_that_is_wrong_is_not_believed(named: Controller) -> None:
    found = both(recorded(TRUE, named))
    assert found.source == "identified"
    assert "the controller that the file names" in found.notes[0].lower()
    assert_is(found, TRUE)


@pytest.mark.parametrize(
    "law",
    [
        TRUE,
        replace(TRUE, derivative_filter=1.0),
        replace(TRUE, reference_rate=0.3),
        replace(TRUE, reference_rate=0.0, derivative_filter=1.0),
        replace(TRUE, velocity_feedforward=2e-3),
    ],
    ids=["pid", "no filter", "cascade", "rate of the position alone", "velocity feedforward"],
)
def test_without_a_file_the_law_is_identified(law: PositionController) -> None:
    found = both(recorded(law))
    assert found.source == "identified"
    assert_is(found, law)


def test_a_controller_without_integral_keeps_its_constant() -> None:
    law = replace(TRUE, ki=0.0, constant=0.02)
    found = both(recorded(law))
    assert found.kp == pytest.approx(law.kp, rel=2e-3)
    assert found.ki * 6.0 < 1e-3 * found.kp  # nothing over the whole recording
    assert found.constant == pytest.approx(law.constant, abs=1e-4)


def test_a_clamped_torque_tells_the_law_between_the_clamps() -> None:
    limit = float(np.percentile(np.abs(recorded(TRUE)["torque"]), 97.0))
    recording = recorded(TRUE, limit=limit)
    assert 0.003 < np.mean(np.abs(recording["torque"]) >= 0.999 * limit) < 0.3
    assert_is(both(recording), TRUE)
    assert both(recording.with_metadata(controller=OF_TRUE)).source == "metadata"


@pytest.mark.parametrize("share", [0.8, 1.0])
def test_a_limit_is_told_where_noise_hides_it_and_where_only_it_leaves_a_law(share: float) -> None:
    """A measured torque scatters about its limit; a loop that never came to one has its law without."""
    time = np.arange(12_000) * PERIOD
    moved = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time % 1.0, 0.2) / 0.2)
    wanted, random = 0.6 * np.where(time % 2.0 < 1.0, moved, 1.0 - moved), np.random.default_rng(4)
    shaken = random.normal(0.0, 2e-3, len(time))
    peak = float(np.max(np.abs(followed(wanted, shaken, TRUE, base_model(AXIS))["torque"])))
    limit = share * peak
    columns = followed(wanted, shaken, TRUE, base_model(AXIS), limit)
    columns["torque"] = columns["torque"] + random.normal(0.0, 3e-3 * peak, len(time))
    metadata = Metadata(sample_period=PERIOD, position_resolution=RESOLUTION)
    measured = Recording.from_columns(columns, metadata, "motion")
    assert find_controller(prepare([measured])).usable is (share == 1.0)
    data = prepared_for([measured])
    law = find_controller(data)
    assert (law.kp, law.kd, law.ki) == pytest.approx((TRUE.kp, TRUE.kd, TRUE.ki), rel=0.01)
    if share == 1.0:
        assert data.metadata.torque_limit is None
    else:  # by its lower edge: three deviations of that noise, and what the loop's own adds to it
        assert data.metadata.torque_limit == pytest.approx(limit, rel=0.02)
        assert any("--torque-limit" in said for said in data.metadata.remarks)


@pytest.mark.parametrize(("explained", "told"), [(0.99902, False), (0.9999, True)])
def test_a_limit_is_told_only_where_its_law_leaves_clearly_less(
    monkeypatch: pytest.MonkeyPatch, explained: float, told: bool
) -> None:
    """The top of a chirp on a sound screw was taken for one: its law left 0.10 %, where that without it left 0.04 % and
    was refused for other reasons. The twin behind it showed a transmission that is not there."""
    measured = recorded(TRUE)
    limit = 0.9 * float(np.max(np.abs(measured["torque"])))

    def law(data: object, _: object) -> PositionController:
        if data.metadata.torque_limit is None:
            return replace(TRUE, explained=0.99964, source="none", why="one recording")
        return replace(TRUE, explained=explained, source="identified")

    monkeypatch.setattr(controller_unsaid, "find_controller", law)
    monkeypatch.setattr(controller_unsaid, "noisy_limit", lambda _: limit)
    data = prepare([measured.with_metadata(controller=None)])
    (said,) = with_torque_limit([measured], data, POLICY)
    assert (said.metadata.torque_limit is not None) is told


def test_a_torque_that_is_always_clamped_cannot_verify_and_that_is_said() -> None:
    recording = recorded(TRUE, OF_TRUE)
    columns = dict(recording.floats)
    columns["torque"] = np.where(recording["torque"] > 0.0, 0.01, -0.01)
    clamped = Recording.from_columns(columns, replace(recording.metadata, torque_limit=0.01), "motion")
    found = both(clamped)
    assert found.source == "trusted"
    assert found.usable
    assert "could not be verified" in found.notes[0]
    assert not both(clamped.with_metadata(controller=None)).usable


def test_a_law_without_gains_is_never_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clamped and free by turns, a demand may leave no run that varies: nothing explains all of nothing."""
    monkeypatch.setattr(controller, "_identified", lambda _: PositionController(explained=1.0))
    recording = recorded(TRUE)
    columns = {
        **recording.floats,
        "torque": np.roll(recording["torque"], 7),
    }  # not the one that is remembered
    hunting = Recording.from_columns(columns, recording.metadata, "motion")
    found = controller_of(hunting)
    assert not found.usable
    assert not found.exact
    assert as_read(hunting, found) is hunting


@pytest.mark.slow
def test_a_torque_that_no_controller_made_gives_none_even_if_the_file_names_one() -> None:
    recording = recorded(TRUE, OF_TRUE)
    columns = dict(recording.floats)
    columns["torque"] = recording["torque"] + np.random.default_rng(1).normal(0.0, 0.1, len(recording))
    found = both(Recording.from_columns(columns, recording.metadata, "motion"))
    assert not found.usable
    assert "99.9 %" in found.why


def test_torque_mode_has_no_controller() -> None:
    recording = recorded(TRUE, OF_TRUE)
    columns = dict(recording.floats) | {"reference": recording["position"]}
    assert not both(Recording.from_columns(columns, recording.metadata, "motion")).usable


@pytest.mark.slow
@pytest.mark.parametrize(("reference_delay", "position_delay"), [(2, 2), (1, 0), (3, 1)])
def test_a_law_that_sees_its_inputs_late_is_found_with_its_delays(
    reference_delay: int, position_delay: int
) -> None:
    """A host with dead time; a drive that interpolates its set points, with feedforward of speed and acceleration."""
    h, n = 1e-3, 12_000
    rng = np.random.default_rng(4)
    time = np.arange(n) * h
    reference = 0.3 * np.sin(2 * np.pi * 0.7 * time) + 0.02 * np.sin(2 * np.pi * 6.0 * time)
    reference += 0.05 * signal.sawtooth(2 * np.pi * 3.1 * time, 0.5)  # corners tell how late the reference is
    noise = np.convolve(rng.normal(0.0, 5e-4, n + 4), np.hanning(7)[1:-1] / 3.0, mode="valid")
    position = np.round((reference - 0.002 * np.gradient(reference, h) + noise) / 1e-5) * 1e-5
    true = PositionController(
        kp=40.0, kd=0.2, ki=900.0, derivative_filter=0.4, reference_rate=0.9, velocity_feedforward=0.01,
        acceleration_feedforward=6e-4, reference_delay=reference_delay, position_delay=position_delay,
    )  # fmt: skip
    r = delayed(reference, reference_delay, float(reference[0]))
    y = delayed(position, position_delay, float(position[0]))
    change = (0.9 * np.diff(r, prepend=r[0]) - np.diff(y, prepend=y[0])) / h
    rate = signal.lfilter([0.4], [1.0, -0.6], change)
    demand = 40.0 * (r - y) + 0.2 * rate + 900.0 * np.cumsum(r - y) * h + true.feedforward(r, float(r[0]), h)
    samples = LoopSamples(h, reference, position, demand, np.zeros(n, dtype=np.bool_), (slice(0, n),), None)
    found = identified(samples)
    assert found.source == "identified"
    assert (found.reference_delay, found.position_delay) == (reference_delay, position_delay)
    assert found.explained > 0.99999
    assert (found.kp, found.kd, found.ki) == pytest.approx((40.0, 0.2, 900.0), rel=0.02)
    assert f"{reference_delay} sample" in found.why
    if position_delay != reference_delay:
        assert (f"its position {position_delay} sample" in found.why) == (position_delay > 0)


def test_delays_are_told_where_the_filter_lies_between_those_that_are_tried() -> None:
    """A host that is three samples late: with the filters that are tried first, laws of other delays leave less."""
    h, n = 1e-3, 60_000
    random = np.random.default_rng(6)
    time = np.arange(n) * h
    phases = random.uniform(0.0, 2.0 * np.pi, 4)
    tones = [
        np.sin(2.0 * np.pi * f * time + a) / f for f, a in zip((0.4, 1.3, 3.7, 9.1), phases, strict=True)
    ]
    reference = 20.0 * np.sum(tones, axis=0) * np.minimum(time / 0.5, 1.0) ** 2
    slow = signal.lfilter([0.03], [1.0, -0.97], random.normal(0.0, 0.05, n))
    position = signal.lfilter([0.05], [1.0, -0.95], reference) + slow
    r, y = (delayed(values, 3, float(values[0])) for values in (reference, position))
    rate = signal.lfilter([0.1715], [1.0, -0.8285], np.diff(r - y, prepend=r[0] - y[0]) / h)
    demand = 1.63 * (r - y) + 0.0434 * rate + 10.2 * np.cumsum(r - y) * h
    step = 1e-3 * float(np.std(demand))
    rounded = np.round(demand / step) * step
    free = np.zeros(n, dtype=np.bool_)
    samples = LoopSamples(h, reference, position, rounded, free, (slice(0, n),), None)
    late = searched_late(samples)
    assert (late.reference_delay, late.position_delay) == (3, 3)
    found = identified(samples)
    assert found.exact
    assert (found.reference_delay, found.position_delay) == (3, 3)
    assert (found.kp, found.kd, found.ki) == pytest.approx((1.63, 0.0434, 10.2), rel=1e-3)
    assert found.derivative_filter == pytest.approx(0.1715, rel=0.01)


def planned(late: int, backward: bool, step: float = 0.0) -> tuple[LoopSamples, Floats]:
    """A host that feeds speed and acceleration forward, so many rows late; and its planner's acceleration, shape (n,).

    Moves of sin² speed begin on a row and end between two. `backward`: by differences of its rows up to now. The demand
    is rounded to `step` times its spread.
    """
    h, seconds, size = 1e-3, 0.2437, 0.8
    time = np.arange(40_000) * h
    since = np.clip(time % 0.5, 0.0, seconds)
    sign = np.where(time % 1.0 < 0.5, 1.0, -1.0)
    turn = 2.0 * np.pi / seconds
    way = since / seconds - np.sin(turn * since) / (2.0 * np.pi)
    reference = size * np.where(sign > 0.0, way, 1.0 - way)
    moves = (since > 0.0) & (since < seconds)
    speed = sign * moves * size * (1.0 - np.cos(turn * since)) / seconds
    acceleration = sign * moves * size * turn * np.sin(turn * since) / seconds
    for hertz in (0.7, 3.1):
        reference = reference + 0.1 * np.sin(2.0 * np.pi * hertz * time)
        speed = speed + 0.1 * 2.0 * np.pi * hertz * np.cos(2.0 * np.pi * hertz * time)
        acceleration = acceleration - 0.1 * (2.0 * np.pi * hertz) ** 2 * np.sin(2.0 * np.pi * hertz * time)
    noise = np.convolve(
        np.random.default_rng(4).normal(0.0, 5e-4, len(time) + 4), np.ones(5) / 5.0, mode="valid"
    )
    position = np.round((signal.lfilter([0.2], [1.0, -0.8], reference) + noise) / 1e-5) * 1e-5
    fed = speed, acceleration
    if backward:
        rate = np.diff(reference, prepend=reference[0]) / h
        fed = rate, np.diff(rate, prepend=rate[0]) / h
    change = np.diff(reference - position, prepend=reference[0] - position[0]) / h
    demand = 40.0 * (reference - position) + 0.2 * signal.lfilter([0.4], [1.0, -0.6], change)
    demand += 900.0 * h * np.cumsum(reference - position) + 0.05 * fed[0] + 0.02 * fed[1]
    demand = delayed(demand, late, float(demand[0]))
    if step > 0.0:
        demand = np.rint(demand / (step * np.std(demand))) * step * np.std(demand)
    free = np.zeros(len(time), dtype=np.bool_)
    return LoopSamples(h, reference, position, demand, free, (slice(0, len(time)),), None), acceleration


@pytest.mark.parametrize(("late", "step"), [(0, 0.0), (1, 0.0), (2, 0.0), (1, 3e-3)])
def test_a_host_that_feeds_its_planners_acceleration_has_an_exact_law(late: int, step: float) -> None:
    """By differences around the row: those up to it leave what no rounding explains, and behind a delay another one."""
    samples, acceleration = planned(late, backward=False, step=step)
    found = identified(samples)
    assert found.exact
    assert found.smooth
    assert (found.reference_delay, found.position_delay) == (late, late)
    assert (found.kp, found.kd, found.ki) == pytest.approx((40.0, 0.2, 900.0), rel=0.01)
    # beside the rate's own gain, 0.2, a demand in steps tells it less well
    assert found.velocity_feedforward == pytest.approx(0.05, abs=0.005)
    assert found.acceleration_feedforward == pytest.approx(0.02, rel=0.01)
    assert "what its planner knows" in found.why
    alone = replace(found, velocity_feedforward=0.0, position_feedforward=0.0, constant=0.0)
    fed = alone.feedforward(samples.reference, float(samples.reference[0]), samples.period)
    assert np.median(np.abs(fed - 0.02 * acceleration)) < 1e-2 * 0.02 * np.std(acceleration)


@pytest.mark.parametrize("late", [0, 2])
def test_a_host_that_feeds_differences_of_its_rows_keeps_its_law(late: int) -> None:
    found = identified(planned(late, backward=True)[0])
    assert found.exact
    assert not found.smooth
    assert (found.reference_delay, found.position_delay) == (late, late)
    assert found.acceleration_feedforward == pytest.approx(0.02, rel=1e-3)


def test_a_planners_law_is_exact_or_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """A torque by a noisy sensor hides whose differences were fed: what was found before stays, to the last bit."""
    samples, _ = planned(1, backward=False)
    noise = np.random.default_rng(3).normal(0.0, 0.02 * np.std(samples.demand), len(samples.demand))
    noisy = replace(samples, demand=samples.demand + noise)
    found = law_from_data(noisy)
    monkeypatch.setattr(controller_search, "_planned", lambda *_: None)
    assert not found.smooth
    assert found == law_from_data(noisy)


def test_set_points_on_lines_and_in_counts_tell_no_planners_acceleration() -> None:
    samples, _ = planned(0, backward=False)
    assert np.mean(planner_rows(samples)) > 0.9
    rows = np.arange(len(samples.reference))
    lines = np.interp(rows, rows[::8], samples.reference[::8])
    assert not np.any(planner_rows(replace(samples, reference=lines)))
    assert not np.any(planner_rows(replace(samples, reference=np.rint(samples.reference / 1e-3) * 1e-3)))


def test_an_exact_law_tells_a_demand_as_it_was_before_it_was_rounded() -> None:
    recording = recorded(TRUE)
    step = 0.05 * float(np.std(recording["torque"]))
    coarse = with_torque(recording, np.rint(recording["torque"] / step) * step)
    data = prepare([coarse])
    law = find_controller(data)
    wanted = as_wanted(data, law)
    assert law.exact
    assert np.abs(wanted.torque - data.torque).max() <= 0.5 * step * (1.0 + 1e-9)
    assert np.std(wanted.torque - recording["torque"]) < 0.1 * np.std(data.torque - recording["torque"])
    assert as_wanted(data, replace(law, exact=False)) is data
    fine = prepare([recording])
    assert as_wanted(fine, find_controller(fine)) is fine


def test_a_filter_s_answer_to_late_samples_is_its_answer_late() -> None:
    """What the first look filters once for all delays is what it would filter for each."""
    samples = loop_samples(prepare([recorded(replace(TRUE, reference_delay=2, position_delay=1), None)]))
    for law, r, y in _late_trials(samples):
        late = late_samples(samples, r, y)
        alone = fitted_whole(late, law_terms(late, law.derivative_filter), law.derivative_filter)
        assert law.explained == pytest.approx(alone.explained, abs=1e-9)
        assert law.terms_gains == pytest.approx(alone.terms_gains, rel=1e-4, abs=1e-6 * abs(alone.kp))


def test_terms_of_several_filters_are_those_of_each() -> None:
    """What does not depend on the filter is made once; the filter sums as the library's does."""
    samples = loop_samples(prepare([recorded(TRUE, None)]))
    (rows,) = samples.stretches
    rates = [
        np.diff(one[rows], prepend=one[rows.start]) / PERIOD for one in (samples.position, samples.reference)
    ]
    for smoothing in (0.05, 0.5, 1.0):
        terms = law_terms(samples, smoothing)
        for column, sign, rate in zip((1, 3), (-1.0, 1.0), rates, strict=True):
            filtered = signal.lfilter([smoothing], [1.0, smoothing - 1.0], rate)
            np.testing.assert_array_equal(terms[rows, column], sign * filtered)
        np.testing.assert_array_equal(terms[:, 0], samples.reference - samples.position)
        skipped = max(20, round(10.0 / smoothing))
        assert not regular_rows(samples, smoothing)[0][rows][:skipped].any()


def test_the_mean_of_each_run_is_taken_out() -> None:
    run = np.array([0, 0, 0, 2, 2, 5])  # of a run too short for every n-th row nothing may be left
    values = np.arange(12.0).reshape(2, 6) ** 2
    for number in (0, 2, 5):
        left, own = less_run_means(values, run)[:, run == number], values[:, run == number]
        assert left == pytest.approx(own - own.mean(axis=1, keepdims=True))
    assert less_run_means(values[:, :0], run[:0]).shape == (2, 0)


@pytest.mark.slow
def test_a_law_found_in_band_drives_no_twin_of_a_single_recording() -> None:
    recording = recorded(TRUE, seconds=8.0)
    columns = dict(recording.floats)
    noise = np.random.default_rng(3).normal(0.0, 0.05 * float(np.std(recording["torque"])), len(recording))
    columns["torque"] = recording["torque"] + noise
    heard = Recording.from_columns(columns, recording.metadata, "motion")
    assert controller_of(heard).in_band
    assert not find_controller(prepare([heard])).usable


def with_torque(recording: Recording, torque: np.ndarray) -> Recording:
    return Recording.from_columns(
        dict(recording.floats) | {"torque": torque}, recording.metadata, recording.experiment
    )


@pytest.mark.slow
def test_a_law_is_exact_where_it_leaves_no_more_than_rounding_of_the_torque() -> None:
    recording, step = recorded(TRUE), 2e-3
    rounded = np.rint(recording["torque"] / step) * step
    noise = np.random.default_rng(3).normal(0.0, step, len(recording))
    assert both(recording).exact
    assert both(with_torque(recording, rounded)).exact
    assert not both(with_torque(recording, recording["torque"] + noise)).exact


@pytest.mark.parametrize(("bend", "repeated", "others"), [(2e-3, True, 1), (0.0, True, 0), (2e-3, False, 0)])
def test_an_exact_law_that_needs_its_references_bend_may_be_a_drives(
    monkeypatch: pytest.MonkeyPatch, bend: float, repeated: bool, others: int
) -> None:
    """A drive's loop of 8 kHz looked like one of 1 ms with a velocity feedforward of -2026: the torque's steps, and
    smooth motion, hide what is between the samples. It stays the first; a twin tells.
    """
    between = PositionController(ticks=4, source="identified", in_band=True)
    monkeypatch.setattr(controller, "laws_between", lambda _, law, __: (between, law))
    law = replace(TRUE, acceleration_feedforward=bend, exact=True, source="identified")
    samples = controller.loop_samples(prepare([recorded(TRUE, seconds=8.0)]))
    found = controller._or_between(SimpleNamespace(repeated=repeated, sensed=None), samples, law)
    assert found == (law, between)[: 1 + others]
    # what a planner knows of the row to come no drive has that is on its way there, but where a demand's steps hide it
    for explained, more in ((1.0 - 1e-7, 0), (1.0 - 1e-5, others)):
        ahead = replace(law, smooth=True, explained=explained)
        beside = controller._or_between(SimpleNamespace(repeated=repeated, sensed=None), samples, ahead)
        assert beside == (ahead, between)[: 1 + more]


def test_a_torque_by_its_sensor_holds_a_part_of_the_sample_before() -> None:
    recording = recorded(TRUE)
    torque = recording["torque"]
    before = np.concatenate([torque[:1], torque[:-1]])
    found = both(with_torque(recording, 0.8 * torque + 0.2 * before))
    assert found.smeared == pytest.approx(0.2, abs=5e-3)
    assert (found.reference_delay, found.position_delay) == (0, 0)
    for name in ("kp", "kd", "ki", "derivative_filter"):
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), rel=5e-3), name


def test_what_was_identified_once_is_remembered() -> None:
    recording = recorded(replace(TRUE, reference_rate=0.3))
    assert controller_of(recording) is find_controller(prepare([recording]))


def test_a_law_is_found_in_the_rows_that_are_not_written_late() -> None:
    """One in 25 is up to 0.2 ms late: three in a row that are not hold the law exactly."""
    recording = recorded(TRUE)
    random = np.random.default_rng(8)
    late = np.where(
        random.uniform(size=len(recording)) < 0.04, random.integers(1, 3, len(recording)) * 1e-4, 0.0
    )
    moved = recording["position"] + late * np.gradient(recording["position"], PERIOD)
    columns = dict(recording.floats) | {"position": np.round(moved / RESOLUTION) * RESOLUTION}
    found = controller_of(Recording.from_columns(columns, recording.metadata, "motion"))
    assert found.exact
    assert not found.prompt  # nine rows of ten: it needs no other beside it
    assert "written late" in found.why
    assert found.kp == pytest.approx(TRUE.kp, rel=1e-4)
    assert found.kd == pytest.approx(TRUE.kd, rel=1e-4)
    assert found.ki == pytest.approx(TRUE.ki, rel=1e-4)


def test_rows_that_are_not_late_tell_a_law_of_a_rounded_demand() -> None:
    """One row of twenty late by a tenth of a sample, and the demand in steps of half a hundredth of its size."""
    recording = recorded(TRUE)
    random = np.random.default_rng(8)
    late = np.where(random.uniform(size=len(recording)) < 0.05, 0.1 * PERIOD, 0.0)
    moved = recording["position"] + late * np.gradient(recording["position"], PERIOD)
    step = 5e-3 * float(np.std(recording["torque"]))
    columns = dict(recording.floats) | {
        "position": np.round(moved / RESOLUTION) * RESOLUTION,
        "torque": np.round(recording["torque"] / step) * step,
    }
    found = controller_of(Recording.from_columns(columns, recording.metadata, "motion"))
    assert found.exact
    assert "written late" in found.why
    assert (found.kp, found.kd, found.ki) == pytest.approx((TRUE.kp, TRUE.kd, TRUE.ki), rel=0.01)


@pytest.mark.parametrize("fed", [0.0, 1.0], ids=["late", "fed"])
def test_rows_that_a_feedforward_tells_are_not_late(fed: float) -> None:
    """Moves to and fro: where they turn round a drive feeds the acceleration between its set points forward."""
    corners = np.interp(np.arange(8000) * PERIOD, np.arange(17) * 0.5, np.arange(17) % 2 * 2.0)
    reference = ndimage.gaussian_filter1d(corners, 25.0, mode="nearest")
    bend = np.diff(reference, 2, prepend=reference[:2]) / PERIOD**2
    forward = fed * AXIS["inertia"] * np.convolve(bend, (0.1, 0.3, 0.3, 0.2, 0.1), "same")
    random = np.random.default_rng(5)
    columns = followed(reference, forward + random.normal(0.0, 2e-3, len(bend)), TRUE, base_model(AXIS))
    late = 2e-4 * (random.uniform(size=len(bend)) < 0.04) * (1.0 - fed)
    moved = columns["position"] + late * np.gradient(columns["position"], PERIOD)
    columns |= {
        "position": np.round(moved / RESOLUTION) * RESOLUTION,
        "torque": np.round((columns["torque"] + forward) / 3e-4) * 3e-4,
    }
    metadata = Metadata(sample_period=PERIOD, position_resolution=RESOLUTION)
    whole = prepare([Recording.from_columns(columns, metadata, "motion")])
    found = _of_prompt_rows(controller.loop_samples(whole))
    assert (found is None) == bool(fed)
    assert found is None or found.kp == pytest.approx(TRUE.kp, rel=0.02)


@pytest.mark.parametrize("late", [0, 3], ids=["rows written late", "set points late"])
def test_a_law_of_rows_that_are_not_late_holds_in_all_rows_as_another_does(late: int) -> None:
    """A reading that is late is off in any law; one that misses what another tells is a law of the recursion only: a
    slow cascade's changes were told to their rounding in 93 of 100 rows, by gains that were none (half 74010)."""
    recording = recorded(TRUE)
    moved = recording["position"]
    if not late:
        by = np.where(np.random.default_rng(8).uniform(size=len(recording)) < 0.05, 0.1 * PERIOD, 0.0)
        moved = moved + by * np.gradient(moved, PERIOD)
    ahead = np.concatenate([recording["reference"][late:], np.full(late, recording["reference"][-1])])
    columns = dict(recording.floats) | {"position": moved, "reference": ahead}
    whole = prepare([Recording.from_columns(columns, recording.metadata, "motion")])
    samples = controller.loop_samples(whole)
    assert _leaves_as_little(samples, TRUE, searched_late(samples)) is (late == 0)


@pytest.mark.parametrize("step", [0.0, 1e-6])
@pytest.mark.parametrize("delay", [0, 1])
def test_an_exact_law_tells_what_was_read_where_rows_are_late(step: float, delay: int) -> None:
    """One in fifty is 0.2 ms late; the demand is exact, or in steps of a millionth of its size."""
    recording = recorded(TRUE)
    late = np.where(np.random.default_rng(8).uniform(size=len(recording)) < 0.02, 2e-4, 0.0)
    moved = recording["position"] + late * np.gradient(recording["position"], PERIOD)
    torque = delayed(recording["torque"], delay, 0.0)
    rounded = step * float(np.std(torque)) or 1e-15
    columns = dict(recording.floats) | {
        "position": np.round(moved / RESOLUTION) * RESOLUTION,
        "torque": np.round(torque / rounded) * rounded,
    }
    shaken = Recording.from_columns(columns, recording.metadata, "motion")
    read = as_read(shaken, controller_of(shaken))
    assert np.mean(np.abs(shaken["position"] - recording["position"]) > 0.5 * RESOLUTION) > 0.01
    assert np.mean(np.abs(read["position"] - recording["position"]) > 0.5 * RESOLUTION) < 1e-4
    assert controller_of(read).exact


def test_positions_stay_where_no_row_is_late_or_another_law_would_tell_them() -> None:
    recording = recorded(TRUE)
    law = controller_of(recording)
    assert as_read(recording, law) is recording
    assert as_read(recording, replace(law, kd=1.05 * law.kd)) is recording


def test_the_decimals_of_a_file_are_no_late_rows() -> None:
    """Set points to a few decimals, as text files hold them, a twentieth of a count: most rows were told as late."""
    recording = recorded(TRUE)
    decimals = {name: np.round(recording[name], 7) for name in ("reference", "position")}
    written = Recording.from_columns(dict(recording.floats) | decimals, recording.metadata, "motion")
    law = controller_of(written)
    assert law.exact
    assert as_read(written, law) is written


def test_a_hosts_law_keeps_its_gains_where_rows_are_late_and_the_torque_is_sensed() -> None:
    """Every row some hundredths of a sample late, and a sensor with noise: no row holds the law exactly."""
    recording = recorded(TRUE)
    random = np.random.default_rng(8)
    late = 0.02 * np.abs(random.normal(size=len(recording)))
    moved = recording["position"] + late * np.gradient(recording["position"])
    torque = recording["torque"] + random.normal(0.0, 0.01 * np.std(recording["torque"]), len(recording))
    columns = dict(recording.floats) | {"position": moved, "torque": torque}
    samples = loop_samples(prepare([Recording.from_columns(columns, recording.metadata, "motion")]))
    found = plain_in_band(samples)
    assert found is not None
    assert (found.reference_delay, found.position_delay) == (0, 0)
    assert (found.kp, found.kd) == pytest.approx((TRUE.kp, TRUE.kd), rel=0.03)
    assert found.ki == pytest.approx(TRUE.ki, rel=0.2)  # the sum of what rows are off by wanders


def test_pieces_that_lie_side_by_side_are_looked_at_as_pieces_again() -> None:
    """Run together they jump, which a law's filter and sum would go across."""
    one = loop_samples(prepare([recorded(TRUE)]))
    long = {name: np.tile(getattr(one, name), 8) for name in ("reference", "position", "demand", "clamped")}
    looked = first_look(replace(one, stretches=(slice(0, 8 * len(one.demand)),), **long))
    again = first_look(looked)
    assert len(looked.stretches) > 1
    assert again.stretches == looked.stretches
    assert np.array_equal(again.position, looked.position)


def test_a_demand_under_a_second_name_is_no_sensor() -> None:
    recording = recorded(TRUE)
    sensor = np.random.default_rng(2).normal(0.0, 1e-3, len(recording))
    for beside, known in ((0.0, False), (sensor, True)):
        columns = dict(recording.floats) | {"torque_command": recording["torque"] + beside}
        both_named = Recording.from_columns(columns, recording.metadata, "motion")
        assert (prepare([both_named]).sensed is not None) is known


@pytest.mark.slow
def test_what_runs_away_leaves_the_others_of_its_pass_as_they_are() -> None:
    """And models that need other steps ride along in the finer ones."""
    data = prepare([recorded(TRUE)])
    law = replace(TRUE, source="identified")
    models = [base_model(AXIS | {"stiffness": times * AXIS["stiffness"]}).pack() for times in (1.0, 1.2, 9.0)]
    still = np.zeros(len(data.reference))
    noise = [(still, still), (np.full(len(still), 1e12), still), (still, still)]
    one, away, stiff = run_twins(data, models, law, noise)
    assert (one.stable, away.stable, stiff.stable) == (True, False, True)
    alone = run_twin(data, models[2], law, STILL, np.random.default_rng(1))
    assert stiff.position == pytest.approx(alone.position, abs=1e-9)
    alone = run_twin(data, models[0], law, STILL, np.random.default_rng(1))
    assert (
        np.sqrt(np.mean((one.position - alone.position) ** 2)) < RESOLUTION
    )  # five steps a sample, and fifteen


def test_a_law_beside_a_recorded_feedforward_is_exact_to_the_step_of_their_sum() -> None:
    """The feedforward is on no step, nor is what is left of a rounded torque without it."""
    recording = recorded(TRUE)
    forward = 0.02 * np.sin(3.0 * recording["time"])
    step = 5e-3 * float(np.std(recording["torque"]))
    torque = np.round((recording["torque"] + forward) / step) * step
    columns = dict(recording.floats) | {"torque": torque, "torque_feedforward": forward}
    found = controller_of(Recording.from_columns(columns, recording.metadata, "motion"))
    assert found.exact
    assert (found.kp, found.kd, found.ki) == pytest.approx((TRUE.kp, TRUE.kd, TRUE.ki), rel=0.01)


def test_a_recorded_feedforward_is_as_late_as_the_torque_that_holds_it() -> None:
    """A law that sees all a row sooner, of a torque that is read a row late, asks for the same a row sooner."""
    recording = recorded(TRUE)
    forward = 0.02 * np.sin(30.0 * recording["time"])
    torque = delayed(recording["torque"], 1, 0.0) + forward
    columns = dict(recording.floats) | {"torque": torque, "torque_feedforward": forward}
    data = prepare([Recording.from_columns(columns, recording.metadata, "motion")])
    law = find_controller(data)
    assert (law.reference_delay, law.position_delay) == (1, 1)
    late = asked(data, law)[1:]
    off = (asked(a_row_sooner(data), law.sooner())[:-1] - late)[100:]
    assert np.ptp(off) < 1e-3 * np.ptp(data.feedforward)  # their sums begin a row apart


class _FeedsFriction(PositionController):
    """Adds Coulomb friction by the sign of its reference's speed, 0.04 N m over 0.4 rad/s."""

    def feedforward(self, reference: np.ndarray, before: float, period: float) -> np.ndarray:
        rate = np.diff(reference, prepend=before) / period
        return PositionController.feedforward(self, reference, before, period) + 0.04 * np.tanh(rate / 0.4)


class _FeedsObserved(_FeedsFriction):
    """The same ahead of a disturbance observer of 8 rad/s, whose filter makes a sum of it as well."""

    def feedforward(self, reference: np.ndarray, before: float, period: float) -> np.ndarray:
        plain = PositionController.feedforward(self, reference, before, period)
        fed = _FeedsFriction.feedforward(self, reference, before, period) - plain
        return plain + fed + 8.0 * period * np.cumsum(fed)


def _twice(law: PositionController) -> Recording:
    """The same motion two times, each disturbed by chance of its own."""
    rounds = [recorded(law, seed=4, seconds=10.0), recorded(law, seed=4, seconds=10.0)]
    columns = {
        name: np.concatenate([one[name] for one in rounds]) for name in ("reference", "position", "torque")
    }
    rows = len(columns["torque"])
    columns["torque"] += np.random.default_rng(5).normal(0.0, 1e-3, rows)
    columns["time"] = np.arange(rows) * PERIOD
    return Recording.from_columns(columns, rounds[0].metadata, "motion", np.repeat([0, 1], rows // 2))


@pytest.mark.parametrize("played", [recorded, _twice], ids=["once", "twice"])
def test_friction_that_a_controller_feeds_forward_is_told_and_leaves_its_law(
    played: Callable[[PositionController], Recording],
) -> None:
    recording = played(_FeedsFriction(TRUE.kp, TRUE.kd, TRUE.ki, TRUE.derivative_filter))
    data = prepare([recording])
    assert not find_controller(data).usable
    (told,) = with_friction_fed([recording], data, POLICY)
    rate = np.diff(recording["reference"], prepend=recording["reference"][0]) / PERIOD
    off = told["torque_feedforward"] - 0.04 * np.tanh(rate / 0.4)
    assert np.sqrt(np.mean(off**2)) < 0.03 * 0.04
    found = find_controller(prepare([told]))
    assert found.usable
    assert (found.kp, found.kd) == pytest.approx((TRUE.kp, TRUE.kd), rel=0.05)
    assert "feeds friction forward" in told.metadata.remarks[-1]


def test_friction_that_is_fed_forward_ahead_of_a_disturbance_observer_is_told() -> None:
    """A PD with an observer is a PID but for what is fed forward: of a sign, the demand has the sum as well."""
    recording = _twice(_FeedsObserved(TRUE.kp, TRUE.kd, TRUE.ki, TRUE.derivative_filter))
    data = prepare([recording])
    assert not find_controller(data).usable
    (told,) = with_friction_fed([recording], data, POLICY)
    found = find_controller(prepare([told]))
    assert found.usable
    assert (found.kp, found.kd) == pytest.approx((TRUE.kp, TRUE.kd), rel=0.05)
    assert re.search(
        r"feeds friction forward, 0\.0(39|4|41).* N m .*ahead of a disturbance observer",
        told.metadata.remarks[-1],
    )


def _filtered(law: PositionController, kind: int, rows: float) -> Recording:
    """Ramps of the speed two times, behind a drive that filters its set points, which the file holds before that."""
    time = np.arange(20_000) * PERIOD
    speed = sum(
        size * np.clip(4.0 * np.sin(hertz * time), -1.0, 1.0) for size, hertz in ((10.0, 4.1), (4.0, 11.3))
    )
    plain = np.cumsum(speed) * PERIOD
    shown, parts = SET_POINT_FILTERS[kind].apply(plain, rows), []
    for chance in (5, 6):
        noise = np.random.default_rng(chance).normal(0.0, 2e-3, len(plain))
        parts.append(followed(shown, noise, law, base_model(AXIS)) | {"reference": plain})
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    whole["torque"] += np.random.default_rng(7).normal(0.0, 1e-3, len(whole["torque"]))
    whole["time"] = np.arange(len(whole["torque"])) * PERIOD
    metadata = Metadata(sample_period=PERIOD, position_resolution=RESOLUTION)
    return Recording.from_columns(whole, metadata, "motion", np.repeat([0, 1], len(plain)))


@pytest.mark.parametrize(("kind", "rows", "named"), [(0, 25.0, "running mean"), (1, 18.0, "first-order lag")])
def test_a_filter_of_the_set_points_is_told_by_the_demand(kind: int, rows: float, named: str) -> None:
    """Delays and terms of the reference stood for it, below some hertz."""
    recording = _filtered(TRUE, kind, rows)
    data = prepare([recording])
    before = find_controller(data)
    assert not before.usable or before.reference_delay - before.position_delay > 3
    (told,) = with_set_points_filtered([recording], data, POLICY)
    behind = np.tile(SET_POINT_FILTERS[kind].apply(recording["reference"][: len(recording) // 2], rows), 2)
    off, whole = told["reference"] - behind, recording["reference"] - behind
    assert np.std(off) < 0.05 * np.std(whole)
    found = find_controller(prepare([told]))
    assert found.usable
    assert found.reference_delay - found.position_delay <= 3
    assert (found.kp, found.kd) == pytest.approx((TRUE.kp, TRUE.kd), rel=0.05)
    assert f"filters its set points: by a {named} of" in told.metadata.remarks[-1]


def test_friction_that_is_fed_forward_behind_a_filter_of_the_set_points_is_told_with_it() -> None:
    """Neither has a law without the other."""
    law = _FeedsFriction(TRUE.kp, TRUE.kd, TRUE.ki, TRUE.derivative_filter)
    recording = _filtered(law, 0, 15.0)
    data = prepare([recording])
    assert not find_controller(data).usable
    (told,) = with_set_points_filtered([recording], data, POLICY)
    filtered, fed = told.metadata.remarks[-2:]
    assert "filters its set points" in filtered
    assert "feeds friction forward, 0.0" in fed
    found = find_controller(prepare([told]))
    assert found.usable
    assert (found.kp, found.kd) == pytest.approx((TRUE.kp, TRUE.kd), rel=0.1)


def test_no_filter_is_looked_for_in_a_recording_that_ends_before_one_has_forgotten_its_start() -> None:
    samples = loop_samples(prepare([_filtered(TRUE, 0, 25.0).rows(slice(0, 520))]))
    assert set_point_filter(samples, fed=False) is None
    assert set_point_filter(samples, fed=True) is None


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_set_points_that_no_filter_explains_stay_as_they_are(noise: float) -> None:
    plain = _twice(TRUE)
    recording = (
        with_torque(plain, np.random.default_rng(6).normal(0.0, noise, len(plain))) if noise else plain
    )
    assert with_set_points_filtered([recording], prepare([recording]), POLICY)[0] is recording


def _feeding_late(late: int, smeared: float = 0.0, read: float = 1e-3) -> tuple[Recording, np.ndarray]:
    """The same motion twice, behind a host that logs its feedforward as it asks for it; and what of it is in a torque.

    All that the host asks for is in the torque so many rows later, a share of it in the row after that.
    """
    plain, law = recorded(TRUE, seed=4, seconds=10.0), replace(TRUE, position_delay=late, kp=2.0, ki=20.0)
    reference = plain["reference"]
    rate = np.diff(reference, prepend=reference[0]) / PERIOD
    fed = 0.04 * np.tanh(rate / 0.4) + 1.6e-4 * np.gradient(rate, PERIOD)

    def later(values: np.ndarray) -> np.ndarray:
        shown = delayed(values, late, float(values[0]))
        return (1.0 - smeared) * shown + smeared * delayed(shown, 1, float(shown[0]))

    parts = []
    for chance in (5, 6):
        noise = np.random.default_rng(chance).normal(0.0, 2e-3, len(fed))
        columns = followed(delayed(reference, late, reference[0]), noise + later(fed), law, base_model(AXIS))
        torque = (
            columns["torque"] + later(fed) + np.random.default_rng(chance + 2).normal(0.0, read, len(fed))
        )
        parts.append(columns | {"torque": torque, "reference": reference, "torque_feedforward": fed})
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    whole["time"] = np.arange(len(whole["torque"])) * PERIOD
    repeat = np.repeat([0, 1], len(fed))
    return Recording.from_columns(whole, plain.metadata, "motion", repeat), np.tile(later(fed), 2)


@pytest.mark.parametrize(("late", "smeared"), [(2, 0.0), (3, 0.0), (1, 0.2)])
def test_a_feedforward_that_was_logged_before_the_loops_dead_time_is_taken_as_it_acts(
    late: int, smeared: float
) -> None:
    """Of hosts with a dead time no law was found: their feedforward was taken off the torque rows too soon."""
    recording, acts = _feeding_late(late, smeared)
    data = prepare([recording])
    assert not find_controller(data).usable
    (told,) = with_feedforward_late([recording], data, POLICY)
    assert np.std(told["torque_feedforward"] - acts) < 0.02 * np.std(acts)
    found = find_controller(prepare([told]))
    assert (found.position_delay, found.kp) == (late, pytest.approx(2.0, rel=0.02))
    assert "before the dead time" in told.metadata.remarks[-1]


def test_a_feedforward_is_taken_as_it_acts_in_one_recording_without_repeats_too() -> None:
    twice, acts = _feeding_late(2, read=1e-5)
    once = twice.rows(slice(0, len(twice) // 2))
    data = prepared_for([once])
    assert data.closed
    assert not data.repeated
    assert find_controller(data).usable
    assert np.std(data.feedforward - acts[: len(once)]) < 0.02 * np.std(acts)


def test_a_feedforward_that_is_in_step_with_its_torque_stays_as_it_is() -> None:
    recording, acts = _feeding_late(0)
    data = prepare([recording])
    assert fed_late(loop_samples(data), data.feedforward) is None
    assert with_feedforward_late([recording], data, POLICY)[0] is recording
    other = with_torque(recording, np.random.default_rng(6).normal(0.0, 0.1, len(acts)))
    assert with_feedforward_late([other], prepare([other]), POLICY)[0] is other


def _shaken_in_one(size: float) -> tuple[Recording, np.ndarray]:
    """Two motions, each two times; in the second a torque is added that stands in no column but the torque's."""
    plain = recorded(TRUE, seed=4, seconds=10.0)
    time = plain["time"]
    added = size * (np.sin(2.0 * np.pi * 3.1 * time) + np.sin(2.0 * np.pi * 7.3 * time + 1.0))
    parts, names, extra = [], [], []
    for name, forced in (("motion", 0.0 * added), ("shaken", added)):
        for chance in (5, 6):
            noise = np.random.default_rng(chance).normal(0.0, 2e-3, len(time))
            columns = followed(plain["reference"], noise + forced, TRUE, base_model(AXIS))
            parts.append(columns | {"torque": columns["torque"] + forced, "reference": plain["reference"]})
            names += [name] * len(time)
            extra.append(forced)
    whole = {
        key: np.concatenate([part[key] for part in parts]) for key in ("reference", "position", "torque")
    }
    whole["torque"] += np.random.default_rng(7).normal(0.0, 1e-3, len(whole["torque"]))
    whole["time"] = np.arange(len(whole["torque"])) * PERIOD
    repeat = np.tile(np.repeat([0, 1], len(time)), 2)
    return Recording.from_columns(whole, plain.metadata, names, repeat), np.concatenate(extra)


def test_a_torque_that_one_experiment_adds_leaves_the_law_of_the_others() -> None:
    """An excitation that a drive adds by itself and no column holds: no law was found in all rows, and no twin."""
    recording, added = _shaken_in_one(0.02)
    data = prepare([recording])
    assert not find_controller(data).usable
    (told,) = with_torque_added([recording], data, POLICY)
    assert "in 'shaken', which no column of the file holds" in told.metadata.remarks[-1]
    there = recording.experiment == "shaken"
    assert np.all(told["torque_feedforward"][~there] == 0.0)
    assert np.std(told["torque_feedforward"][there] - added[there]) < 0.05 * np.std(added[there])
    found = find_controller(prepare([told]))
    assert found.usable
    assert (found.kp, found.kd) == pytest.approx((TRUE.kp, TRUE.kd), rel=0.05)
    assert "speed of the reference steps" not in told.metadata.remarks[-1]


@pytest.mark.parametrize("step", [100, 0])
def test_a_torque_that_is_added_where_the_reference_steps_in_speed_is_said_to_be_so(step: int) -> None:
    """Hand-written set points that begin with a corner, behind an acceleration feedforward."""
    data = prepare([_shaken_in_one(0.0)[0]])
    within = np.arange(len(data.reference)) < 1000
    corner = 300
    bent = np.where(np.arange(1000) > corner, step * np.abs(np.diff(data.reference[:1000], 2)).max(), 0.0)
    reference = data.reference.copy()
    reference[:1000] += np.cumsum(bent)
    added = np.where(np.arange(len(reference)) == corner + 1, 5.0, 0.1)
    assert _is_kicked(replace(data, reference=reference), added, within) is (step > 0)


def test_a_controller_without_an_added_torque_keeps_its_recording() -> None:
    recording, _ = _shaken_in_one(0.0)
    assert with_torque_added([recording], prepare([recording]), POLICY)[0] is recording
    noise = np.random.default_rng(6).normal(0.0, 0.1, len(recording))
    other = with_torque(recording, noise)
    assert with_torque_added([other], prepare([other]), POLICY)[0] is other


def test_a_controller_that_feeds_none_keeps_its_recording() -> None:
    recording = _twice(TRUE)
    told = with_friction_fed([recording], prepare([recording]), POLICY)
    assert told[0] is recording


@pytest.mark.parametrize("played", [recorded, _twice], ids=["once", "twice"])
def test_a_torque_that_no_controller_made_is_no_friction_fed_forward(
    played: Callable[[PositionController], Recording],
) -> None:
    recording = played(TRUE)
    noise = np.random.default_rng(6).normal(0.0, 0.1, len(recording))
    other = with_torque(recording, noise)
    assert with_friction_fed([other], prepare([other]), POLICY)[0] is other
