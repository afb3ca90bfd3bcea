"""The one residual of both engines: where it starts, and what it is told in."""

from dataclasses import replace

import numpy as np
import pytest

import autotune.core.side_by_side as side_by_side
import autotune.estimation.residual as module
from autotune.estimation.bandwidth import Bands
from autotune.estimation.controller import controller_of
from autotune.estimation.data import prepare
from autotune.estimation.disturbance import STILL, Disturbance
from autotune.estimation.pieces import (
    Surroundings,
    cut,
    run_twins,
    torque_error,
    torque_errors,
    with_motion,
    with_motions,
)
from autotune.estimation.pieces import (
    run_twin as run_twin_of_piece,
)
from autotune.estimation.problem import new_problem
from autotune.estimation.residual import (
    Motion,
    measured_motion,
    raw_residual,
    residual,
    residuals,
    stretch_residual,
)
from autotune.estimation.twin import start_state
from autotune.estimation.twin_runs import KnownRuns, run_twin
from autotune.models.drive_model import Packed, base_model
from autotune.models.table import EFFECTS
from tests.estimation.simulated import AXIS, OF_TRUE, RESOLUTION, TRUE, recorded

LAG = EFFECTS["torque_lag"].make({"time_constant": 2e-3})
SATURATION = EFFECTS["torque_saturation"].make({"loss": 0.1, "torque": 0.5})
ELASTIC = EFFECTS["elastic_transmission"].make(
    {"compliance": 2.5e-3, "load_inertia": 0.4, "load_friction": 0.3, "damping": 0.1}
)


def test_a_lag_has_settled_before_the_first_row() -> None:
    """An axis at constant speed under a constant torque: nothing is unexplained, from the first row on."""
    model = base_model(AXIS).with_effect(LAG)
    n, speed, period = 100, 2.0, 1e-3
    position = speed * period * np.arange(n)
    torque = np.full(n, AXIS["coulomb"] + AXIS["offset"] + AXIS["viscous"] * speed)
    moved = Motion(torque, position, np.full(n, speed), np.zeros(n))
    start = np.zeros_like(start_state(_piece(model), model.pack()))
    start[:3] = position[0], speed, AXIS["coulomb"] / AXIS["stiffness"]
    rest = stretch_residual(model.pack(), start, moved, period)
    assert np.max(np.abs(rest)) < 1e-3 * torque[0]  # the bristle is exact only within rounding and its step


def _piece(model):
    recording = recorded(TRUE, OF_TRUE, model=model, seconds=2.0)
    return cut(recording, Bands(), controller_of(recording))[0]


@pytest.mark.parametrize("effect", [LAG, SATURATION])
def test_both_engines_have_the_same_residual(effect) -> None:
    """Wrong by 10 mN m in the offset, on an axis with a lag or a saturation; after the contact's start."""
    model = base_model(AXIS).with_effect(effect)
    wrong = model.with_values({"offset": AXIS["offset"] + 1e-2}).pack()
    recording = recorded(TRUE, OF_TRUE, model=model, seconds=2.0)
    data = prepare([recording])
    piece = cut(recording, Bands(), controller_of(recording))[0]
    whole = Motion(piece.torque, piece.position, piece.velocity, piece.acceleration)
    one = stretch_residual(wrong, start_state(piece, wrong), whole, piece.period)
    other = raw_residual(data, wrong, measured_motion(data))
    np.testing.assert_allclose(one[500:], other[500:], atol=1e-9)


def test_a_saturated_axis_is_told_in_the_scale_of_its_demand() -> None:
    """A torque that lacks at the shaft weighs more where less of the demand arrives, by the slope of the law."""
    model = base_model(AXIS).with_effect(SATURATION)
    wrong = model.with_values({"offset": AXIS["offset"] + 1e-2}).pack()
    recording = recorded(TRUE, OF_TRUE, model=model, seconds=2.0)
    piece = cut(recording, Bands(), controller_of(recording))[0]
    moved = Motion(piece.torque, piece.position, piece.velocity, piece.acceleration)
    start = start_state(piece, model.pack())
    change = stretch_residual(wrong, start, moved, 1e-3) - stretch_residual(model.pack(), start, moved, 1e-3)
    c = 0.9**-2 - 1.0
    slope = (1.0 + c * np.minimum(np.abs(piece.torque) / 0.5, 1.0) ** 2) ** -1.5
    np.testing.assert_allclose(change, -1e-2 / slope, rtol=1e-9)


def test_a_stretch_that_begins_in_motion_is_simulated_from_there() -> None:
    """Position over the first 50 ms, without noise: the bristle from F/σ0 and a derivative at rest gave 3.6 mrad
    on average here, the balance of the first torques and the motion's own rate 1.1 mrad."""
    model = base_model(AXIS).pack()
    whole = recorded(TRUE, OF_TRUE, seconds=6.0, seed=10, noise=1e-3)
    errors = []
    for first in range(700, 4800, 170):
        data = prepare([whole.rows(slice(first, first + 1000))])
        run = run_twin(data, model, controller_of(whole), STILL, np.random.default_rng(0))
        assert run.stable
        errors.append(float(np.sqrt(np.mean((run.position - data.measured)[:50] ** 2))))
    assert np.mean(errors) < 2e-3


def _several() -> list[Packed]:
    """Rigid axes, springs (other steps), a lag, a saturation; nine rigid ones are two passes."""
    shifted = [base_model({**AXIS, "offset": 1e-3 * i}).pack() for i in range(9)]
    springs = [
        base_model(AXIS).with_effect(
            EFFECTS["elastic_transmission"].make(
                {"compliance": c, "load_inertia": 0.4, "load_friction": 0.4, "damping": 0.05}
            )
        )
        for c in (0.3, 0.31, 0.02, 0.021, 1e-3)
    ]
    others = [base_model(AXIS).with_effect(effect) for effect in (LAG, SATURATION, SATURATION)]
    return [*shifted, *(model.pack() for model in (*springs, *others))]


@pytest.mark.parametrize("count", [1, 2])
def test_pieces_of_time_leave_what_the_whole_motion_leaves(count: int, monkeypatch) -> None:
    """Of so few models pieces of the motion fill a pass: bit for bit the same, as a bristle forgets on its way."""
    data = prepare([recorded(TRUE, OF_TRUE, seconds=12.0)])
    moved, models = measured_motion(data), _several()[:count]
    found = residuals(data, models, moved)
    passes = []
    monkeypatch.setattr(module, "_in_pieces", lambda *given: bool(passes.append(given)))
    np.testing.assert_array_equal(found, residuals(data, models, moved))
    assert passes
    monkeypatch.undo()
    rows = data.stretches[0].rows
    rest = np.empty((len(moved.torque), count))
    assert module._in_pieces(data, rows, models, [moved], rest)


def test_what_does_not_forget_is_not_cut_in_pieces() -> None:
    """A contact that warms, remembers, ages or is pressed, and a torque that comes late; nor one that hardly moves."""
    data = prepare([recorded(TRUE, OF_TRUE, seconds=12.0)])
    moved, rest = measured_motion(data), np.zeros((len(data.time), 1))
    rows = data.stretches[0].rows
    soft = base_model({**AXIS, "stiffness": 1e-7 * AXIS["stiffness"]})
    warm = base_model(AXIS).with_effect(
        EFFECTS["thermal_drift"].make({"softening": 0.1, "time_constant": 5.0, "idle": 0.0})
    )
    for model in (base_model(AXIS).with_effect(LAG), warm, soft):
        assert not module._in_pieces(data, rows, [model.pack()], [moved], rest)
    assert not rest.any()


def test_several_models_at_once_leave_what_each_of_them_leaves() -> None:
    """Equal but for the rounding of an exponential function that is not this machine's own."""
    data = prepare([recorded(TRUE, OF_TRUE, seconds=2.0)])
    moved, models = measured_motion(data), _several()
    for packed, found in zip(models, residuals(data, models, moved), strict=True):
        np.testing.assert_allclose(found, residual(data, packed, moved), rtol=0.0, atol=1e-10)


def test_twins_of_several_models_at_once_are_those_of_each() -> None:
    """Biases, and the residual of the measured motion beside them; a twin that runs away leaves the others alone."""
    recording = recorded(TRUE, OF_TRUE, seconds=2.0)
    data, law = prepare([recording]), controller_of(recording)
    assert law is not None
    problem = replace(new_problem(data, law), disturbance=Disturbance(white=2e-3))
    wild = base_model({**AXIS, "inertia": 1e-9, "micro_damping": 1e-9}).pack()
    models = [*_several()[:3], wild, *_several()[9:12]]
    together = problem.corrections(models, 3)
    assert [found.stable for found in together] == [True, True, True, False, True, True, True]
    for packed, found in zip(models, together, strict=True):
        alone = replace(problem, runs=KnownRuns())
        one = [alone.correction(packed, count) for count in (1, 2, 3)][-1]
        assert one.stable is found.stable
        np.testing.assert_allclose(found.bias, one.bias, rtol=0.0, atol=1e-9)
        np.testing.assert_array_equal(problem.raw(packed), alone.raw(packed))


def test_passes_on_several_cores_leave_what_they_leave_one_after_the_other(monkeypatch) -> None:
    """To the last bit, residuals and biases: no verdict depends on the machine."""
    recording = recorded(TRUE, OF_TRUE, seconds=2.0)
    data, law = prepare([recording]), controller_of(recording)
    assert law is not None
    problem = replace(new_problem(data, law), disturbance=Disturbance(white=2e-3))
    models, found = _several(), []
    assert len({packed.on.tobytes() for packed in models}) > 2
    for cores in (1, 3):
        monkeypatch.setattr(side_by_side, "_cores", cores)
        biases = [one.bias for one in replace(problem, runs=KnownRuns()).corrections(models, 3)]
        found.append((residuals(data, models, measured_motion(data)), biases))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_array_equal(found[0][1], found[1][1])


@pytest.mark.parametrize("effect", [None, LAG, SATURATION, ELASTIC])
def test_motions_and_models_of_a_piece_at_once_leave_what_each_leaves(effect) -> None:
    """The measured motion and those of its twins, with several models: what a refinement asks of a piece."""
    model = base_model(AXIS) if effect is None else base_model(AXIS).with_effect(effect)
    recording, bands = recorded(TRUE, OF_TRUE, model=model, seconds=2.0), Bands()
    law = controller_of(recording)
    piece = cut(recording, bands, law)[0]
    around = Surroundings(law, RESOLUTION, process_noise=2e-3)
    ran = run_twins(piece, model.pack(), around, [np.random.default_rng(i) for i in range(3)])
    alone = [run_twin_of_piece(piece, model.pack(), around, np.random.default_rng(i)) for i in range(3)]
    twins = with_motions(piece, alone, bands)
    for one, other, twin in zip(ran, alone, twins, strict=True):
        assert one.follows
        assert other.follows
        np.testing.assert_allclose(one.position, other.position, rtol=0.0, atol=1e-9)
        expected = with_motion(piece, other.position, other.torque, bands)
        np.testing.assert_array_equal(twin.acceleration, expected.acceleration)
    steps = [model.pack(), model.with_values({"coulomb": 1.001 * AXIS["coulomb"]}).pack()]
    moved = [piece, *twins, *[piece] * 5, *twins]
    models = [steps[0]] * 4 + [steps[1]] * 8
    for left, along, packed in zip(torque_errors(moved, models, bands), moved, models, strict=True):
        np.testing.assert_allclose(left, torque_error(along, packed, bands), rtol=0.0, atol=1e-10)


def test_where_one_of_a_pieces_twins_runs_away_none_follows() -> None:
    recording = recorded(TRUE, OF_TRUE, seconds=2.0)
    law = controller_of(recording)
    piece = cut(recording, Bands(), law)[0]
    wild = base_model({**AXIS, "inertia": 1e-9, "micro_damping": 1e-9}).pack()
    ran = run_twins(piece, wild, Surroundings(law, RESOLUTION), [np.random.default_rng(i) for i in range(3)])
    assert not any(one.follows for one in ran)


def test_biases_alone_are_those_of_corrections_and_ask_nothing_of_the_measured_motion() -> None:
    """The inverse of the measured motion takes as long as that of a run: a search by biases does not pay for it."""
    recording = recorded(TRUE, OF_TRUE, seconds=2.0)
    data, law = prepare([recording]), controller_of(recording)
    problem = replace(new_problem(data, law), disturbance=Disturbance(white=2e-3))
    wild = base_model({**AXIS, "inertia": 1e-9, "micro_damping": 1e-9}).pack()
    models = [*_several()[:3], wild]
    for count in (1, 3):  # one run of each is shaken alike, three are not
        fresh = replace(problem, runs=KnownRuns())
        biases = fresh.biases(models, count)
        assert fresh.runs.raw(data, models[0]) is None
        for one, found in zip(problem.corrections(models, count), biases, strict=True):
            assert (found is not None) is one.stable
            if found is not None:
                np.testing.assert_array_equal(found, one.bias)
        np.testing.assert_array_equal(fresh.raw(models[0]), problem.raw(models[0]))


def test_what_comes_after_the_fitted_rows_tells_nothing_of_their_biases() -> None:
    """But for the last digit; a filter that is given six periods less still feels where it ends."""
    recording = recorded(TRUE, OF_TRUE, seconds=12.0)
    data, law = prepare([recording]), controller_of(recording)
    problem = replace(new_problem(data, law), disturbance=Disturbance(white=2e-3))
    first = np.arange(len(data.grid)) < len(data.grid) // 2
    problem = replace(problem, weight=first.astype(float))
    rows = problem.training > 0
    part, model = problem.until_judged(), _several()[0]
    assert part.data.stretches[-1].stop < 0.8 * data.stretches[-1].stop
    whole, judged, trained = (one.biases([model], 2)[0] for one in (problem, part, problem.until_trained()))
    apart = [float(np.max(np.abs(one[rows] - whole[rows]))) for one in (judged, trained)]
    assert apart[0] <= 1e-15
    assert apart[1] > 1e-13
