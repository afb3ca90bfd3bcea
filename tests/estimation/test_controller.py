"""The one controller of both engines: known truth, known files, and what is said where they disagree."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from autotune.estimation.controller import controller_of, find_controller, identified, loop_samples
from autotune.estimation.controller_between import (
    FED,
    answering_late,
    laws_between,
    laws_of_slow_rows,
    smooth_between,
)
from autotune.estimation.controller_law import (
    LoopSamples,
    PositionController,
    between_terms,
    fitted_whole,
    late_samples,
    law_terms,
)
from autotune.estimation.controller_search import _late_trials, plain_in_band
from autotune.estimation.data import prepare
from autotune.estimation.disturbance import STILL
from autotune.estimation.policy import POLICY
from autotune.estimation.twin_runs import run_twin, run_twins
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Controller, Recording
from autotune.signals.between_samples import delayed
from autotune.signals.triangle import less_run_means
from tests.estimation.simulated import AXIS, OF_TRUE, PERIOD, RESOLUTION, TRUE, recorded


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
    assert "late by whole samples" in found.why


def test_a_filter_s_answer_to_late_samples_is_its_answer_late() -> None:
    """What the first look filters once for all delays is what it would filter for each."""
    samples = loop_samples(prepare([recorded(replace(TRUE, reference_delay=2, position_delay=1), None)]))
    for law, r, y in _late_trials(samples):
        late = late_samples(samples, r, y)
        alone = fitted_whole(late, law_terms(late, law.derivative_filter), law.derivative_filter)
        assert law.explained == pytest.approx(alone.explained, abs=1e-9)
        assert law.terms_gains == pytest.approx(alone.terms_gains, rel=1e-4, abs=1e-6 * abs(alone.kp))


def test_the_mean_of_each_run_is_taken_out() -> None:
    run = np.array([0, 0, 0, 2, 2, 5])  # of a run too short for every n-th row nothing may be left
    values = np.arange(12.0).reshape(2, 6) ** 2
    for number in (0, 2, 5):
        left, own = less_run_means(values, run)[:, run == number], values[:, run == number]
        assert left == pytest.approx(own - own.mean(axis=1, keepdims=True))
    assert less_run_means(values[:, :0], run[:0]).shape == (2, 0)


@pytest.mark.slow
def test_a_law_that_works_between_the_samples_is_found_below_the_compared_frequency() -> None:
    """A drive's own loop runs 8 times a sample on a coarse encoder, and its sum wanders from that of the samples."""
    ticks, rows, tick = 8, 15_000, 1.25e-4
    n, rng = ticks * rows, np.random.default_rng(6)
    time = np.arange(n) * tick
    reference = 0.3 * np.sin(2 * np.pi * 0.7 * time) + 0.02 * np.sin(2 * np.pi * 6.0 * time)
    shaken = np.convolve(rng.normal(0.0, 4e-5, n + 40), np.hanning(43)[1:-1], mode="valid")
    rubbed = 2e-3 * np.tanh(np.gradient(reference, tick) / 0.05)
    position = np.round((reference - rubbed + shaken) / 2e-4) * 2e-4
    error = reference - position
    rate = signal.lfilter([0.25], [1.0, -0.75], np.diff(error, prepend=0.0) / tick)
    demand = 40.0 * error + 0.2 * rate + 900.0 * np.cumsum(error) * tick
    samples = LoopSamples(
        ticks * tick, reference[::ticks], position[::ticks], demand[::ticks], np.zeros(rows, dtype=np.bool_),
        (slice(0, rows),), None,
    )  # fmt: skip
    found = identified(samples)
    assert found.usable
    assert found.in_band
    assert found.explained > POLICY.controller_explains_in_band
    # Gains wrong by a tenth do no harm to a twin.
    assert (found.kp, found.kd, found.ki) == pytest.approx((40.0, 0.2, 900.0), rel=0.1)
    assert "below 60 Hz" in found.why


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


@pytest.mark.slow
def test_a_drive_that_works_between_the_samples_is_found_and_simulated_so() -> None:
    """Eight ticks a sample, and a reference that the drive reaches a sample later."""
    ticks, rate = 8, 900.0
    share = 1.0 - np.exp(-rate * PERIOD / ticks)
    law = PositionController(6.0, 0.03, 100.0, float(share))
    fine = recorded(law, period=PERIOD / ticks, noise=2e-4)
    columns = {name: fine[name][::ticks].copy() for name in ("position", "torque")}
    columns["reference"] = np.append(fine["reference"][ticks::ticks], fine["reference"][-1])
    columns["time"] = np.arange(len(columns["position"])) * PERIOD
    metadata = replace(fine.metadata, sample_period=PERIOD)
    data = prepare([Recording.from_columns(columns, metadata, "motion")])
    rows = tuple(stretch.rows for stretch in data.stretches)
    free = np.zeros(len(data.torque), dtype=np.bool_)
    samples = LoopSamples(PERIOD, data.reference, data.measured, data.torque, free, rows, None)
    found = laws_between(samples, PositionController(explained=0.99))[0]
    assert found.ticks > 1
    assert found.kp == pytest.approx(law.kp, rel=0.03)
    assert found.kd == pytest.approx(law.kd, rel=0.05)
    run = run_twin(data, base_model(AXIS).pack(), found, STILL, np.random.default_rng(1))
    lag = np.std(data.reference - data.measured)
    assert run.stable
    assert np.std(run.position - data.measured) < 0.01 * lag  # 0.02 at the samples with the true gains


@pytest.mark.slow
@pytest.mark.parametrize(("taken", "late"), [("moment", 2), ("next", 1), ("before", 3)])
def test_set_points_and_torque_of_a_drive_are_seen_between_the_samples(taken: str, late: int) -> None:
    """Set points on straight lines, `late` rows late; the torque as at the sample, or a mean beside it.

    At 12 Hz and 2 ms half a sample is a phase of 4 degrees, and a wrong way of recording takes kd a tenth off.
    """
    period, ticks, rate, gains = 2e-3, 8, 900.0, (6.0, 0.03, 100.0)
    time = np.arange(6000 * ticks) * period / ticks
    slow = signal.butter(3, 12.0, fs=ticks / period, output="sos")
    moved, pushed = signal.sosfilt(slow, np.random.default_rng(4).normal(size=(2, len(time))))
    place, wanted = np.roll(moved, 150) + 0.1 * pushed, moved[::ticks]
    fine = np.interp(time, time[::ticks] + late * period, wanted)
    share = 1.0 - np.exp(-rate * period / ticks)
    filtered = signal.lfilter(
        [share], [1.0, share - 1.0], np.diff(fine - place, prepend=0.0) * ticks / period
    )
    error = fine - place
    torque = gains[0] * error + gains[1] * filtered + gains[2] * np.cumsum(error) * period / ticks
    rows = torque.reshape(-1, ticks)
    shown = {"moment": rows[:, 0], "next": rows.mean(axis=1), "before": np.roll(rows.mean(axis=1), 1)}[taken]
    free, stretch = np.zeros(len(wanted), dtype=np.bool_), (slice(20, len(wanted)),)
    samples = LoopSamples(period, wanted, place[::ticks], shown, free, stretch, None)
    found = laws_between(samples, PositionController(explained=0.5))[0]
    assert (found.taken, found.reference_delay) == (taken, late)
    assert (found.kp, found.kd, found.ki) == pytest.approx(gains, rel=0.02)


@pytest.mark.slow
def test_behind_a_drive_whose_rows_are_written_late_slow_rows_tell_the_law() -> None:
    """Half of the rows are late by one to three ticks of an eighth of 2 ms, in position and torque alike.

    The drive does not answer to what they are late by: least squares of all rows explain too little to drive a twin,
    and take kd for 0.9 of what it is and set points for a sample sooner than they come.
    """
    period, ticks, rate, gains = 2e-3, 8, 900.0, (6.0, 0.03, 100.0)
    rng = np.random.default_rng(4)
    time = np.arange(12000 * ticks) * period / ticks
    slow = signal.butter(3, 12.0, fs=ticks / period, output="sos")
    lively = np.where(np.sin(0.7 * time) > 0.0, 1.0, 0.03)
    moved, pushed = lively * signal.sosfilt(slow, rng.normal(size=(2, len(time))))
    place, wanted = np.roll(moved, 24) + 0.03 * pushed, moved[::ticks]
    fine = np.interp(time, time[::ticks] + period, wanted)
    share = 1.0 - np.exp(-rate * period / ticks)
    filtered = signal.lfilter(
        [share], [1.0, share - 1.0], np.diff(fine - place, prepend=0.0) * ticks / period
    )
    error = fine - place
    torque = gains[0] * error + gains[1] * filtered + gains[2] * np.cumsum(error) * period / ticks
    late = np.minimum(np.rint(0.8 * np.abs(rng.normal(size=len(wanted)))), ticks - 1).astype(int)
    rows = np.arange(len(wanted)) * ticks + late
    free, stretch = np.zeros(len(wanted), dtype=np.bool_), (slice(20, len(wanted)),)
    samples = LoopSamples(period, wanted, place[rows], torque[rows], free, stretch, None)
    plain = laws_between(samples, PositionController(explained=0.5))[0]
    found = laws_of_slow_rows(samples)[0]
    assert plain.ticks == 1  # nothing between the samples explains enough
    assert found.slow
    assert (found.taken, found.reference_delay) == ("moment", 1)
    assert (found.kp, found.kd, found.ki) == pytest.approx(gains, rel=0.06)


def of_a_cascade(ticks: int, period: float, late: float) -> tuple[LoopSamples, tuple[float, float, float]]:
    """P-PI at `ticks` a sample on a filtered velocity, with the reference's own rate, and its torque so much later."""
    position_gain, speed_gain, reset, rate = 60.0, 0.05, 2.0, 500.0
    step = period / ticks
    slow = signal.butter(3, 12.0, fs=1.0 / step, output="sos")
    moved, pushed = signal.sosfilt(slow, np.random.default_rng(4).normal(size=(2, 6000 * ticks)))
    place = np.roll(moved, 15 * ticks) + 0.1 * pushed
    time = np.arange(len(moved)) * step
    wanted = np.interp(time, time[::ticks], moved[::ticks])
    share = 1.0 - np.exp(-rate * step)
    speed = signal.lfilter([share], [1.0, share - 1.0], np.diff(place, prepend=0.0) / step)
    rest = position_gain * (wanted - place) + 0.9 * np.diff(wanted, prepend=0.0) / step - speed
    torque = speed_gain * rest + reset * np.cumsum(rest) * step
    shown = np.interp(time[::ticks] - late, time, torque)
    free, stretch = np.zeros(len(shown), dtype=np.bool_), (slice(20, len(shown)),)
    samples = LoopSamples(period, moved[::ticks].copy(), place[::ticks].copy(), shown, free, stretch, None)
    # the sum of a filtered velocity is the place less the velocity's share: u = (Kv·Kp + Ki)·e − (Kv − Ki/λ)·v …
    return samples, (speed_gain * position_gain + reset, speed_gain - reset / rate, reset * position_gain)


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.4e-3, 0.9e-3], ids=["current loop", "and dead time"])
def test_a_cascade_whose_torque_answers_late_is_found(late: float) -> None:
    """A loop that is computed in two ticks and a current loop that follows: the torque as the axis felt it."""
    period = 1e-3
    samples, gains = of_a_cascade(8, period, late)
    found = answering_late(samples, FED)[0]
    assert 1.0 - found.explained < 1e-4  # of gains that are off by a hundredth
    assert (found.kp, found.kd, found.ki) == pytest.approx(gains, rel=0.05)
    assert found.answer_delay * period == pytest.approx(late, abs=0.15e-3)  # of the search: a third of a tick


def test_a_cascade_that_feeds_its_rate_past_the_filter_is_found() -> None:
    samples, gains = of_a_cascade(8, 1e-3, 0.0)
    found = laws_between(samples, PositionController(explained=0.5))[0]
    assert (found.kp, found.kd, found.ki) == pytest.approx(gains, rel=0.03)
    # what it feeds forward trades with whole samples of delay: together they explain the demand
    assert found.reference_rate == 0.0
    assert found.velocity_feedforward > 0.0
    assert 1.0 - found.explained < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.4, 0.9])
def test_a_twin_answers_as_late_as_the_axis_did(delay: float) -> None:
    """Against the same loop, late by whole ticks of a far faster one."""
    ticks = 20
    fine_share = 1.0 - np.exp(-900.0 * PERIOD / ticks)
    law = PositionController(6.0, 0.03, 100.0, float(fine_share), source="identified")
    whole = round(delay * ticks)
    fine = recorded(replace(law, position_delay=whole), period=PERIOD / ticks, noise=2e-4)
    columns = {name: fine[name][: -2 * ticks : ticks].copy() for name in ("position", "torque")}
    columns["reference"] = fine["reference"][whole:][::ticks][: len(columns["position"])]  # seen as late
    columns["time"] = np.arange(len(columns["position"])) * PERIOD
    metadata = replace(fine.metadata, sample_period=PERIOD)
    data = prepare([Recording.from_columns(columns, metadata, "motion")])
    share = 1.0 - np.exp(-900.0 * PERIOD)
    between = replace(law, derivative_filter=float(share), ticks=8, taken="moment")
    errors = []
    for one in (between, replace(between, answer_delay=delay)):
        run = run_twin(data, base_model(AXIS).pack(), one, STILL, np.random.default_rng(1))
        assert run.stable
        errors.append(float(np.std(run.position - data.measured)))
    assert errors[1] < 0.25 * errors[0]


def test_a_drive_that_has_set_points_with_their_rates_feeds_them_forward_on_lines() -> None:
    """Against a reference fed forward in steps: at 2 ms those come half a sample late, and at 12 Hz a tenth off."""
    period, ticks, fed = 2e-3, 8, 0.05
    slow = signal.butter(3, 12.0, fs=1.0 / period, output="sos")
    wanted, place = signal.sosfilt(slow, np.random.default_rng(6).normal(size=(2, 4000)))
    form = PositionController(
        6.0, 0.03, 100.0, derivative_filter=0.8, explained=0.5, ticks=ticks, taken="next"
    )
    law = replace(form, acceleration_feedforward=fed, cubic=True, smooth=True)
    free, stretch = np.zeros(len(wanted), dtype=np.bool_), (slice(20, len(wanted)),)
    silent = LoopSamples(period, wanted, place, np.zeros(len(wanted)), free, stretch, None)
    rate = -np.log(1.0 - law.derivative_filter) / period
    samples = replace(silent, demand=between_terms(silent, law, rate) @ law.terms_gains)
    found = smooth_between(samples, form)
    assert found is not None
    assert found.smooth
    assert found.acceleration_feedforward == pytest.approx(fed, rel=0.02)
    assert (found.kp, found.kd) == pytest.approx((law.kp, law.kd), rel=0.02)
    held = laws_between(samples, form)[0]
    assert 1.0 - found.explained < 0.1 * (1.0 - held.explained)


@pytest.mark.slow
@pytest.mark.parametrize("taken", ["moment", "next"])
def test_twins_of_one_pass_record_their_torque_as_one_alone_does(taken: str) -> None:
    data = prepare([recorded(TRUE)])
    law = replace(TRUE, source="identified", ticks=4, taken=taken)
    models = [base_model(AXIS).pack(), base_model(AXIS | {"inertia": 1.1 * AXIS["inertia"]}).pack()]
    still = np.zeros(len(data.reference))
    for model, run in zip(models, run_twins(data, models, law, [(still, still)] * 2), strict=True):
        alone = run_twin(data, model, law, STILL, np.random.default_rng(1))
        assert run.torque == pytest.approx(alone.torque, abs=1e-9)


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


def test_a_demand_under_a_second_name_is_no_sensor() -> None:
    recording = recorded(TRUE)
    sensor = np.random.default_rng(2).normal(0.0, 1e-3, len(recording))
    for beside, known in ((0.0, False), (sensor, True)):
        columns = dict(recording.floats) | {"torque_command": recording["torque"] + beside}
        both_named = Recording.from_columns(columns, recording.metadata, "motion")
        assert (prepare([both_named]).sensed is not None) is known


@pytest.mark.slow
def test_steps_of_a_fed_acceleration_are_looked_for_in_a_torque_at_the_samples() -> None:
    """A mean over the last sample and a later set point explain as much below the compared frequency."""
    period, ticks = 2e-3, 8
    slow = signal.butter(3, 12.0, fs=1.0 / period, output="sos")
    wanted, place = signal.sosfilt(slow, np.random.default_rng(6).normal(size=(2, 4000)))
    form = PositionController(6.0, 0.03, 100.0, derivative_filter=0.8, explained=0.5, ticks=ticks)
    law = replace(form, acceleration_feedforward=2e-4, taken="moment", reference_delay=2)
    free, stretch = np.zeros(len(wanted), dtype=np.bool_), (slice(20, len(wanted)),)
    silent = LoopSamples(period, wanted, place, np.zeros(len(wanted)), free, stretch, None)
    rate = -np.log(1.0 - law.derivative_filter) / period
    told = between_terms(silent, law, rate) @ law.terms_gains
    noise = np.random.default_rng(7).normal(0.0, 0.05 * np.std(told), len(told))
    found = laws_between(replace(silent, demand=told + noise), form)
    assert {"moment", "next", "before"} == {one.taken for one in found if one.ticks > 1}
    assert len(found) <= 4  # with the law at the samples


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


def test_where_counts_lie_is_moved_and_nothing_else() -> None:
    """Reference, reading and start are moved together: without counts a twin does the same."""
    data = prepare([recorded(TRUE)])
    model, law = base_model(AXIS).pack(), replace(TRUE, source="identified", ticks=4, adrift=True)
    still = np.zeros(len(data.reference))
    moved = still + 0.4 * RESOLUTION
    smooth = replace(data, resolution=0.0)
    alone, beside = run_twins(smooth, [model, model], law, [(still, still), (still, moved)])
    assert beside.position == pytest.approx(alone.position, abs=1e-12)
    assert beside.torque == pytest.approx(alone.torque, abs=1e-9)
    counted = run_twins(data, [model, model], law, [(still, still), (still, moved)])
    apart = counted[1].position - counted[0].position
    assert 0.1 * RESOLUTION < np.std(apart) < RESOLUTION
