"""Drives that take their set points as they come, and stay at each until the next."""

from dataclasses import replace

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.estimation import controller as controller_module
from autotune.estimation.controller import (
    AS_ACTED,
    as_acted_in_rows,
    as_recorded,
    asked,
    recorded_late_by,
)
from autotune.estimation.controller_between import holding, laws_between
from autotune.estimation.controller_law import LoopSamples, PositionController, between_terms
from autotune.estimation.data import Prepared, prepare
from autotune.estimation.disturbance import STILL
from autotune.estimation.model_error import plain_fit, told_by_twin
from autotune.estimation.policy import POLICY
from autotune.estimation.twin_runs import run_twin
from autotune.identify import fit as fit_module
from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Metadata, Recording
from tests.estimation.simulated import AXIS, RESOLUTION, followed

ROW, TICKS, RATE = 2e-3, 8, 1500.0
CASCADE = PositionController(6.0, 0.06, 100.0, 1.0 - float(np.exp(-RATE * ROW / TICKS)), reference_rate=0.0)
"""On ticks of 250 us: it feeds no rate forward, so that the set points' steps reach the torque by kp alone."""
ON_ERRORS = replace(
    CASCADE,
    reference_rate=1.0,
    ticks=TICKS,
    derivative_filter=1.0 - float(np.exp(-RATE * ROW)),
    taken="moment",
)
"""As it is found in rows, of the error's derivative: on lines the rate of its set points steps with each."""


def of_a_drive(
    taken: str, held: bool = True, reference_rate: float = 0.0, fed: float = 0.0, summed: float = 0.0
) -> tuple[Prepared, LoopSamples, Floats]:
    """What such a drive makes of a multisine, its torque read as `taken`; and the mean that acted in each row.

    `fed`: on the rate that comes with each set point [N m s/rad]; `summed`: on the way by which that rate goes on until
    the next, as the sum of a velocity loop has it [N m/rad].
    """
    time = np.arange(round(8.0 / ROW)) * ROW
    tones = [np.sin(2.0 * np.pi * f * time + f) / f for f in (0.5, 1.1, 2.3, 4.9, 9.7)]
    wanted = 2.0 * np.sum(tones, axis=0) * np.minimum(time / 0.5, 1.0) ** 2
    ticks = np.arange(len(wanted) * TICKS) / TICKS
    fine = np.repeat(wanted, TICKS) if held else np.interp(ticks, np.arange(len(wanted)), wanted)
    shaken = np.random.default_rng(4).normal(0.0, 1e-4, len(fine))
    law = replace(CASCADE, reference_rate=reference_rate)
    steps = np.diff(wanted, append=wanted[-1])
    ways = np.outer(steps, np.arange(1.0, TICKS + 1.0) / TICKS)
    added = (fed * steps[:, None] / ROW + summed * ways).ravel()
    axis = followed(fine, shaken, law, base_model(AXIS), None, ROW / TICKS, added)
    table = axis["torque"].reshape(-1, TICKS)
    read = {"moment": table[:, 0], "eve": np.roll(table[:, -1], 1), "next": table.mean(axis=1)}[taken]
    data = prepare([_rows(wanted, axis["position"][::TICKS], read)])
    rows, free = tuple(one.rows for one in data.stretches), np.zeros(len(read), dtype=np.bool_)
    return (
        data,
        LoopSamples(ROW, data.reference, data.measured, data.torque, free, rows, None),
        table.mean(axis=1),
    )


def _rows(wanted: Floats, position: Floats, read: Floats) -> Recording:
    columns: dict[str, Floats] = {
        "time": np.arange(len(wanted)) * ROW,
        "reference": wanted,
        "position": position.copy(),
        "torque": read.copy(),
    }
    return Recording.from_columns(
        columns, Metadata(sample_period=ROW, position_resolution=RESOLUTION), "motion"
    )


@pytest.mark.slow
@pytest.mark.parametrize("taken", ["moment", "eve", "next"])
def test_a_drive_that_holds_its_set_points_is_among_its_laws_and_acts_as_it_did(taken: str) -> None:
    data, samples, acted = of_a_drive(taken)
    plain = laws_between(samples, PositionController(explained=0.5))[0]
    law = next(one for one in holding(samples, plain) if one.taken == taken)
    assert (law.held, law.reference_delay) == (True, 0)
    assert "stays at each" in law.why
    assert (law.kp, law.kd, law.ki) == pytest.approx((CASCADE.kp, CASCADE.kd, CASCADE.ki), rel=0.03)
    # what was read is not what acts: behind each step the loop works off what it asks for
    rows = slice(200, -50)
    compared = as_recorded(data, law).torque
    off = np.std((compared - acted)[rows])
    assert off < 0.1 * np.std(acted[rows])
    if taken != "next":
        assert off < 0.2 * np.std((data.torque - acted)[rows])
        assert recorded_late_by(law) == 0.0
    means = (asked(data, law) - acted)[rows]
    assert np.std(means - means.mean()) < 0.1 * np.std(acted[rows])


@pytest.mark.slow
@pytest.mark.parametrize("summed", [0.0, 3.0], ids=["damped alone", "summed too"])
def test_a_drive_that_feeds_the_rate_of_what_it_holds_forward_is_among_its_laws(summed: float) -> None:
    """Read before the next set point, what the sum of a cascade has of that rate is at its end: it acts by half."""
    data, samples, acted = of_a_drive("eve", fed=CASCADE.kd, summed=summed)
    plain = laws_between(samples, PositionController(explained=0.5))[0]
    law = next(one for one in holding(samples, plain) if one.taken == "eve")
    assert law.held
    assert law.feeds_rate
    assert law.rate_grows * law.velocity_feedforward == pytest.approx(
        summed * ROW, abs=0.1 * CASCADE.kp * ROW
    )
    rows = slice(200, -50)
    off = [np.std((as_recorded(data, one).torque - acted)[rows]) for one in (law, plain)]
    assert off[0] < 0.3 * off[1]


@pytest.mark.slow
def test_the_twin_of_a_drive_that_holds_its_set_points_is_not_half_a_row_ahead() -> None:
    data, samples, acted = of_a_drive("moment")
    plain = laws_between(samples, PositionController(explained=0.5))[0]
    held = next(one for one in holding(samples, plain) if one.taken == "moment")
    model, off = base_model(AXIS).pack(), []
    for law in (held, replace(held, held=False)):
        run = run_twin(as_recorded(data, law), model, law, STILL, np.random.default_rng(1))
        assert run.stable
        off.append(float(np.std((run.position - data.measured)[200:])))
    assert off[0] < 0.2 * off[1]
    run = run_twin(as_recorded(data, held), model, held, STILL, np.random.default_rng(1))
    assert np.std((run.torque - acted)[200:-50]) < 0.2 * np.std((data.torque - acted)[200:-50])


@pytest.mark.parametrize("taken", ["moment", "eve", "next", "before"])
def test_a_law_that_holds_its_set_points_asks_for_the_same_on_other_ticks(taken: str) -> None:
    """With more ticks they are behind a line by more of a row: the sum of the error would go off with the place.

    To a fifth of that: what the rate of the set points is, as they were taken in, it makes up for half a row late.
    """
    samples = of_a_drive("moment")[1]
    law = replace(ON_ERRORS, held=True, reference_rate=0.0, velocity_feedforward=0.06, taken=taken)
    rate = law.filter_rate(ROW)
    few, many, as_it_was = (
        (between_terms(samples, one, rate) @ one.terms_gains)[200:-50]
        for one in (law, law.on_ticks(3 * TICKS, ROW), replace(law, ticks=3 * TICKS))
    )
    assert np.std(many - few) < 0.2 * np.std(as_it_was - few)


def test_a_reading_behind_lines_is_compared_as_the_mean_that_acts() -> None:
    """The rate that a drive feeds steps with each set point: as a row begins what answers to it has died down."""
    data, _, acted = of_a_drive("moment", held=False, reference_rate=1.0)
    rows = slice(200, -50)
    compared = as_recorded(data, ON_ERRORS)
    # a reading acts half a row later than a mean does
    read = as_recorded(data, replace(ON_ERRORS, cubic=True)).torque - acted
    assert np.std((compared.torque - acted)[rows]) < 0.25 * np.std(read[rows])
    inertia = [
        plain_fit(taken, base_model(AXIS).pack(), POLICY).fitted.packed.p[layout.INERTIA] / AXIS["inertia"]
        for taken in (compared, as_recorded(data, replace(ON_ERRORS, cubic=True)))
    ]
    assert inertia[0] == pytest.approx(1.0, abs=0.02)
    assert abs(inertia[1] - 1.0) > 0.1


@pytest.mark.parametrize("cubic", [False, True], ids=["lines", "cubics"])
def test_a_fit_without_a_law_between_the_rows_is_given_the_mean_that_acts(
    cubic: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the drive's law is told on lines; on cubics nothing steps, and the recording stays as it is."""
    data, samples, acted = of_a_drive("moment", held=False, reference_rate=1.0)
    recording = _rows(samples.reference, samples.position, samples.demand)
    monkeypatch.setattr(controller_module, "_or_between", lambda *_: (replace(ON_ERRORS, cubic=cubic),))
    told = as_acted_in_rows(recording, data)
    if cubic:
        assert told is recording
        return
    rows = slice(200, -50)
    left = np.std((told["torque"] - acted)[rows])
    assert left < 0.1 * np.std((recording["torque"] - acted)[rows])
    assert told.metadata.remarks == (*recording.metadata.remarks, AS_ACTED)


def test_a_fit_takes_the_mean_that_acts_where_no_twin_runs_and_it_leaves_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data, samples, acted = of_a_drive("moment", held=False, reference_rate=1.0)
    read, mean, worse = (
        _rows(samples.reference, samples.position, torque)
        for torque in (samples.demand, acted, samples.demand + 0.1 * np.sin(0.1 * np.arange(len(acted))))
    )
    monkeypatch.setattr(fit_module, "controller_of", lambda _: PositionController())
    monkeypatch.setattr(fit_module, "prepared_repeats", lambda _: data)
    inertia = []
    for told in (mean, worse):
        monkeypatch.setattr(fit_module, "as_acted_in_rows", lambda *_, told=told: told)
        found = fit_module.fit(read)
        assert (AS_ACTED in found.estimate.notes) == (told is mean)
        inertia.append(found.model["inertia"] / AXIS["inertia"])
    assert inertia[0] == pytest.approx(1.0, abs=0.05)
    assert abs(inertia[1] - 1.0) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False], ids=["held", "on lines"])
def test_whether_set_points_are_held_is_told_by_the_twin(held: bool) -> None:
    """A torque that is read at its row's moment is the same either way; the axis is not."""
    data, samples, _ = of_a_drive("moment", held)
    plain = laws_between(samples, PositionController(explained=0.5))
    laws = (*plain, *holding(samples, plain[0]))
    assert {one.held for one in laws} == {True, False}
    assert told_by_twin(data, laws, base_model(AXIS).pack())[0].held == held


@pytest.mark.slow
def test_a_line_is_not_taken_for_steps_that_are_half_a_row_early() -> None:
    """Means of a row on lines: steps that feed half a row of their rate back explain them as well."""
    _, samples, _ = of_a_drive("next", held=False)
    plain = laws_between(samples, PositionController(explained=0.5))[0]
    assert all(one.taken != "next" for one in holding(samples, plain))
