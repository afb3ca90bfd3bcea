"""Drives whose loop works between the samples: their law is found, and their twin answers as they do."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from autotune.estimation.alignment import shifted
from autotune.estimation.controller import (
    as_recorded,
    asked,
    by_sensor,
    controllers_of,
    identified,
    loop_samples,
)
from autotune.estimation.controller_between import (
    FED,
    answering_late,
    laws_between,
    laws_of_quick_rows,
    laws_of_slow_rows,
    read_before_steps,
    smooth_between,
)
from autotune.estimation.controller_law import (
    LoopSamples,
    PositionController,
    between_terms,
)
from autotune.estimation.data import Prepared, prepare
from autotune.estimation.disturbance import STILL
from autotune.estimation.policy import POLICY
from autotune.estimation.residual import Simulated
from autotune.estimation.twin_runs import acted_late, run_twin, run_twins, slower
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Metadata, Recording
from tests.estimation.simulated import AXIS, PERIOD, RESOLUTION, TRUE, followed, recorded


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


GAINS = (6.0, 0.03, 100.0)


def of_a_drive(
    taken: str, late: int, hertz: float = 12.0, stretches: int = 1, rate: float = 900.0, fed: float = 1.0
) -> LoopSamples:
    """A PID at 8 ticks a sample of 2 ms on set points on straight lines, `late` rows late.

    The torque is as at the sample, or a mean beside it; motion below `hertz`, in so many stretches. `rate`: of the
    velocity's filter [1/s]; `fed`: part of the reference's rate that goes through it.
    """
    period = 2e-3
    ticks, gains = 8, GAINS
    time = np.arange(6000 * ticks) * period / ticks
    slow = signal.butter(3, hertz, fs=ticks / period, output="sos")
    moved, pushed = signal.sosfilt(slow, np.random.default_rng(4).normal(size=(2, len(time))))
    place, wanted = np.roll(moved, 150) + 0.1 * pushed, moved[::ticks]
    fine = np.interp(time, time[::ticks] + late * period, wanted)
    share = 1.0 - np.exp(-rate * period / ticks)
    filtered = signal.lfilter(
        [share], [1.0, share - 1.0], np.diff(fed * fine - place, prepend=0.0) * ticks / period
    )
    error = fine - place
    torque = gains[0] * error + gains[1] * filtered + gains[2] * np.cumsum(error) * period / ticks
    rows = torque.reshape(-1, ticks)
    shown = {"moment": rows[:, 0], "next": rows.mean(axis=1), "before": np.roll(rows.mean(axis=1), 1)}[taken]
    edges = np.linspace(20, len(wanted), stretches + 1).astype(int).tolist()
    parts = tuple(slice(*ends) for ends in itertools.pairwise(edges))
    free = np.zeros(len(wanted), dtype=np.bool_)
    return LoopSamples(period, wanted, place[::ticks], shown, free, parts, None)


@pytest.mark.slow
@pytest.mark.parametrize(("taken", "late"), [("moment", 2), ("next", 1), ("before", 3)])
def test_set_points_and_torque_of_a_drive_are_seen_between_the_samples(taken: str, late: int) -> None:
    """At 12 Hz and 2 ms half a sample is a phase of 4 degrees, and a wrong way of recording takes kd a tenth off."""
    found = laws_between(of_a_drive(taken, late), PositionController(explained=0.5))[0]
    assert (found.taken, found.reference_delay) == (taken, late)
    assert (found.kp, found.kd, found.ki) == pytest.approx(GAINS, rel=0.02)


@pytest.mark.slow
def test_a_curve_between_set_points_is_left_out_by_no_rough_filter() -> None:
    """On lines that are fed by nine tenths cubics leave less at the nearest rough filter, a sample later at the finest.

    Told so the reference's acceleration makes up for the delay, and a fifth of an inertia is missing behind it.
    """
    samples = of_a_drive("moment", 1, hertz=4.0, rate=1577.0, fed=0.9)
    found = laws_between(samples, PositionController(explained=0.5))
    assert (found[0].taken, found[0].reference_delay, found[0].cubic) == ("moment", 1, False)
    assert (found[0].kp, found[0].kd, found[0].ki) == pytest.approx(GAINS, rel=0.02)


@pytest.mark.slow
def test_the_twin_is_asked_both_curves_between_set_points_where_columns_tell_neither() -> None:
    """Below 2 Hz lines and cubics are alike in what is recorded, but not in what a loop makes of their corners."""
    found = laws_between(of_a_drive("moment", 1, hertz=2.0), PositionController(explained=0.5))
    assert {law.cubic for law in found if law.taken == "moment"} == {False, True}


@pytest.mark.slow
def test_a_mean_by_a_sensor_is_told_beside_a_demand_that_was_read_at_the_samples() -> None:
    """On lines a loop's demand jumps where a set point begins: what is read there is not what acts until the next."""
    demand = laws_between(of_a_drive("moment", 1), PositionController(explained=0.5))[0]
    found = by_sensor(of_a_drive("before", 1), demand)
    assert all(law.sensed and law.ticks > 1 for law in found)
    best = max(found, key=lambda law: law.explained)
    assert (best.taken, best.reference_delay) == ("before", 1)
    assert (best.kp, best.kd, best.ki) == pytest.approx(GAINS, rel=0.02)


@pytest.mark.slow
def test_a_mean_until_the_next_sample_is_told_where_stretches_end_in_motion() -> None:
    """The mean after a stretch's last sample would need a position that was not recorded: that row tells no law."""
    samples = of_a_drive("next", 1, stretches=40)
    found = laws_between(samples, PositionController(explained=0.5))[0]
    assert (found.taken, found.reference_delay) == ("next", 1)
    assert (found.kp, found.kd, found.ki) == pytest.approx(GAINS, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_however_a_torque_was_recorded_set_points_are_as_late(noise: float) -> None:
    """Slow motion and a noisy torque: no way of recording it explains more, and a wrong delay hardly less.

    Below 2 Hz a sample's delay is made up for by the reference's own terms to within the noise: each of the laws must
    be the one that needs none.
    """
    samples = of_a_drive("moment", 2, hertz=2.0)
    heard = noise * np.std(samples.demand) * np.random.default_rng(1).normal(size=len(samples.demand))
    laws = laws_between(replace(samples, demand=samples.demand + heard), PositionController(explained=0.5))
    found = [law for law in laws if law.ticks > 1]
    assert {law.taken for law in found} == {"moment", "next", "before"}
    assert [law.reference_delay for law in found] == [2] * len(found)


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


@pytest.mark.slow
@pytest.mark.parametrize("few", [True, False])
def test_laws_between_the_rows_are_asked_beside_one_that_is_exact_in_few_of_them(few: bool) -> None:
    """A loop of four times the rows' rate, its demand in steps of a fiftieth of its size, disturbed slowly.

    Where motion is smooth a law of the rows is off by less than such a step, so that it explains them exactly: in few
    of the rows that move it is no law of rows that are written late beyond doubt.
    """
    law, ticks = replace(TRUE, derivative_filter=1.0), 4
    period = PERIOD / ticks
    time = np.arange(round(6.0 / period)) * period
    phases = np.random.default_rng(4).uniform(0.0, 2.0 * np.pi, 5)
    tones = [
        np.sin(2.0 * np.pi * f * time + a) / f for f, a in zip((0.5, 1.1, 2.3, 4.9, 9.7), phases, strict=True)
    ]
    reference = 2.0 * np.sum(tones, axis=0) * np.minimum(time / 0.5, 1.0) ** 2
    fades, played = np.exp(-2.0 * np.pi * 2.0 * period), []
    for repeat in range(2):
        shaken = np.random.default_rng(repeat).normal(0.0, 4e-3, len(time))
        shaken = signal.lfilter([1.0 - fades], [1.0, -fades], shaken)
        played.append(followed(reference, shaken, law, base_model(AXIS), period=period))
    columns = {
        name: np.concatenate([one[name][::ticks] for one in played])
        for name in ("reference", "position", "torque")
    }
    step = 0.02 * float(np.std(columns["torque"]))
    columns["torque"] = np.round(columns["torque"] / step) * step
    columns["time"] = np.arange(len(columns["torque"])) * PERIOD
    repeats = np.repeat([0, 1], len(columns["time"]) // 2)
    metadata = Metadata(sample_period=PERIOD, position_resolution=RESOLUTION)
    data = prepare([Recording.from_columns(columns, metadata, "motion", repeats)])
    found = replace(identified(loop_samples(data)), prompt=few)
    laws = controllers_of(data, found)
    assert "written late" in found.why
    assert found in laws
    assert any(one.ticks > 1 for one in laws) == few


QUICK = (10.0, 0.05, 500.0)


def of_a_loop_on_counts(count: float) -> LoopSamples:
    """A PID at 8 ticks a sample of 1 ms on a reading in whole counts, of which the file has another one with noise.

    The axis moves for half of the time, and hardly for the rest. The torque is a mean over the sample.
    """
    period, ticks, rate = 1e-3, 8, 900.0
    rng = np.random.default_rng(4)
    time = np.arange(24000 * ticks) * period / ticks
    slow = signal.butter(3, 12.0, fs=ticks / period, output="sos")
    lively = np.where(np.sin(0.7 * time) > 0.0, 1.0, 1e-3)
    moved, pushed = lively * signal.sosfilt(slow, rng.normal(size=(2, len(time))))
    place, wanted = np.roll(moved, 10) + 0.03 * pushed, moved[::ticks]
    fine = np.interp(time, time[::ticks] + period, wanted)
    told = np.floor(place / count + 0.5) * count
    share = 1.0 - np.exp(-rate * period / ticks)
    filtered = signal.lfilter([share], [1.0, share - 1.0], np.diff(fine - told, prepend=0.0) * ticks / period)
    error = fine - told
    torque = QUICK[0] * error + QUICK[1] * filtered + QUICK[2] * np.cumsum(error) * period / ticks
    read = np.floor(place[::ticks] / count + 0.5 + 0.5 * rng.normal(size=len(wanted))) * count
    free, stretch = np.zeros(len(wanted), dtype=np.bool_), (slice(20, len(wanted)),)
    return LoopSamples(period, wanted, read, torque.reshape(-1, ticks).mean(axis=1), free, stretch, None)


@pytest.mark.slow
def test_behind_a_drive_on_coarse_counts_quick_rows_tell_the_law() -> None:
    """While the axis hardly moves the file's count is off from the loop's for seconds, and the sum goes with it."""
    samples = of_a_loop_on_counts(count=1.2e-3)
    plain = laws_between(samples, PositionController(explained=0.5))[0]
    found = laws_of_quick_rows(samples)[0]
    assert plain.ticks == 1  # nothing between the samples explains enough
    assert found.quick
    assert "counts are coarse" in found.why
    assert (found.kp, found.ki) == pytest.approx((QUICK[0], QUICK[2]), rel=0.05)


@pytest.mark.slow
def test_a_demand_that_quick_rows_explain_no_better_has_no_law_by_its_counts() -> None:
    samples = of_a_loop_on_counts(count=1e-5)
    other = 0.1 * np.std(samples.demand) * np.sin(2.0 * np.pi * 5.0 * np.arange(len(samples.demand)) * 1e-3)
    assert laws_of_quick_rows(replace(samples, demand=samples.demand + other)) == ()


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


@pytest.mark.parametrize("taken", ["moment", "next", "before"])
def test_a_twin_acts_as_late_as_the_torque_was_taken(taken: str) -> None:
    """A torque that acts a cycle later than it was recorded is that of a loop that answers so much later."""
    law = replace(TRUE, source="identified", ticks=4, taken=taken, answer_delay=0.2)
    data = as_recorded(prepare([recorded(TRUE)]), law)
    later = replace(shifted(data, data.shift - 2.0), cycles=1)
    assert (acted_late(data, law), acted_late(later, law)) == (0, 1)
    assert acted_late(later, replace(law, ticks=1)) == 0

    def run(data: Prepared, law: PositionController) -> Simulated:
        return run_twin(data, base_model(AXIS).pack(), law, STILL, np.random.default_rng(1))

    moved, slower, prompt = run(later, law), run(data, replace(law, answer_delay=1.2)), run(data, law)
    apart = moved.position - slower.position  # they begin alike but for the torque of the first row
    assert np.std(apart[200:]) < 0.05 * np.std((moved.position - prompt.position)[200:])


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
    *found, given = laws_between(replace(silent, demand=told + noise), form)
    assert given is form  # the twin is asked that one too
    assert {"moment", "next", "before"} == {one.taken for one in found if one.ticks > 1}
    assert len(found) <= 4  # with the law at the samples


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


def test_what_a_sum_wanders_is_told_to_the_last_sample_whatever_that_one_holds() -> None:
    """The last sample of a difference of two torques may be anything: a law asks there for what is to come."""
    data = prepare([recorded(TRUE, seconds=12.0)])
    time = np.arange(len(data.torque)) * data.period
    wanders = 0.01 * np.sin(0.3 * time)
    noisy = wanders.copy()
    noisy[-1] += 1.0
    found = slower(data, np.array([wanders, noisy]), 0.5)
    assert found.shape == (2, len(time))
    np.testing.assert_allclose(found[1], wanders, atol=0.01)
    np.testing.assert_allclose(found[0], slower(data, wanders, 0.5))


def no_speed_fed_forward() -> tuple[LoopSamples, PositionController]:
    """Set points and position of a cascade that feeds no velocity forward, and its law.

    The position follows at speed over gain behind, so that the proportional part is many times the torque, and the
    reference's own place takes it off again.
    """
    position_gain, speed_gain, reset, period = 60.0, 0.5, 40.0, 1e-3
    time = np.arange(6000) * period
    wanted = 4.0 * (1.0 - np.cos(2.0 * np.pi * 0.6 * time)) + 0.5 * np.sin(2.0 * np.pi * 3.0 * time)
    left = np.exp(-period * position_gain)
    slow = signal.butter(3, 20.0, fs=1.0 / period, output="sos")
    pushed = signal.sosfilt(slow, np.random.default_rng(4).normal(size=len(time)))
    place = signal.lfilter([1.0 - left], [1.0, -left], wanted) + 0.05 * pushed
    gains = speed_gain * position_gain + reset, speed_gain, reset * position_gain
    law = PositionController(*gains, 0.9, ticks=4, taken="moment", reference_rate=0.0, reference_delay=2)
    law = replace(law, position_feedforward=-reset, source="identified", in_band=True)
    free, stretch = np.zeros(len(wanted), dtype=np.bool_), (slice(20, len(wanted)),)
    return LoopSamples(period, wanted, place, np.zeros(len(wanted)), free, stretch, None), law


def test_a_law_asks_for_the_same_on_more_ticks() -> None:
    """Where the sum of a large following error has the error of the tick already, shorter ticks have less of it."""
    samples, law = no_speed_fed_forward()

    def asked_for(one: PositionController) -> np.ndarray:
        terms = between_terms(samples, one, one.filter_rate(samples.period)) @ one.terms_gains
        return np.asarray(terms[200:] - terms[200:].mean())

    same, naive = law.on_ticks(16, samples.period), replace(law, ticks=16)
    assert same.ticks == 16
    assert law.on_ticks(law.ticks, samples.period) == law
    off = [float(np.std(asked_for(one) - asked_for(law))) for one in (same, naive)]
    assert off[0] < 0.1 * off[1]


@pytest.mark.parametrize(("late", "answer"), [(1, 0.0), (2, 0.0), (1, 0.4)])
def test_on_fewer_ticks_a_torque_is_as_many_cycles_late(late: int, answer: float) -> None:
    """A torque that is held for a tick is half of one late; that is the drive's tick, however few its twin takes."""
    law = replace(TRUE, ticks=12, answer_delay=answer)
    few = law.on_fewer(4, PERIOD).answering(late)
    assert few.ticks_late / 4 + 0.5 / 4 == pytest.approx(late + max(answer, 0.5 / 12))
    assert few.held_longer == 0.0


@pytest.mark.slow
def test_a_torque_read_before_its_feedforward_steps_is_told_from_one_at_the_samples() -> None:
    """What is held is a set point old then, and the law at the samples has its set points a sample later."""
    samples, law = no_speed_fed_forward()
    law = replace(law, acceleration_feedforward=0.02, taken="eve", stepped=True)
    samples = replace(samples, demand=between_terms(samples, law, law.filter_rate(1e-3)) @ law.terms_gains)
    seen = replace(law, acceleration_feedforward=0.0, taken="moment", stepped=False, reference_delay=3)
    prompt, younger = read_before_steps(samples, seen)
    assert (prompt.taken, prompt.reference_delay, prompt.stepped) == ("eve", 2, True)
    assert (prompt.kp, prompt.kd, prompt.ki) == pytest.approx((law.kp, law.kd, law.ki), rel=0.02)
    assert prompt.acceleration_feedforward == pytest.approx(0.02, rel=0.02)
    assert prompt.position_feedforward == pytest.approx(law.position_feedforward, rel=0.02)
    assert younger.answer_delay == 0.0  # what acts
    # half a tick of 250 us less
    assert 1.0 / younger.filter_rate(1e-3) == pytest.approx(
        1.0 / prompt.filter_rate(1e-3) - 1.25e-4, rel=1e-3
    )
    still = replace(law, acceleration_feedforward=0.0)
    silent = replace(samples, demand=between_terms(samples, still, law.filter_rate(1e-3)) @ still.terms_gains)
    noise = 1e-2 * np.std(silent.demand) * np.random.default_rng(1).normal(size=len(silent.demand))
    assert (
        read_before_steps(replace(silent, demand=silent.demand + noise), replace(seen, taken="moment")) == ()
    )


def test_a_torque_read_before_its_feedforward_steps_is_compared_as_it_acts() -> None:
    """Twin and recording alike: what is held is that of now, and not the mean of the steps before and now."""
    fine = recorded(TRUE, noise=0.0)
    data = prepare([fine])
    form = replace(TRUE, source="identified", in_band=True, ticks=4, stepped=True, reference_delay=1)
    law = replace(form, acceleration_feedforward=2e-4, taken="eve")
    mean = asked(data, replace(law, taken="next"))
    rows = slice(50, -50)
    assert np.std((asked(data, law) - mean)[rows]) < 0.1 * np.std(
        (asked(data, replace(law, taken="moment", stepped=False)) - mean)[rows]
    )
    shown = asked(data, replace(law, acceleration_feedforward=0.0))
    smoothly = replace(law, taken="moment", cubic=True)
    read = as_recorded(data, law).torque - as_recorded(data, smoothly).torque
    held = law.held_until_read(data.reference, data.period)
    assert np.roll(held, 1)[rows] == pytest.approx(read[rows], abs=1e-9)
    assert shown.shape == read.shape


def test_the_noise_of_an_encoder_is_not_held_from_row_to_row() -> None:
    """A reading of every tick has its own: the mean of sixteen demands has a quarter of one's noise."""
    data = prepare([recorded(TRUE)])
    law = PositionController(20.0, ticks=16, source="identified")
    still = np.zeros(len(data.reference))
    noise = np.random.default_rng(3).normal(0.0, 0.1 * RESOLUTION, len(still))
    smooth, model = replace(data, resolution=0.0), base_model(AXIS).pack()
    quiet, noisy = run_twins(smooth, [model, model], law, [(still, still), (still, noise)])
    read = noisy.position - quiet.position
    assert np.std(np.diff(read)) == pytest.approx(np.std(np.diff(noise)), rel=0.1)
    asked_for = np.diff(noisy.torque - quiet.torque)
    # the axis, which the noise moves, adds a fifth; held, the noise would be four times as much
    assert np.std(asked_for) == pytest.approx(0.25 * law.kp * np.std(np.diff(noise)), rel=0.35)
