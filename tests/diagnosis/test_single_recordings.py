"""Single recordings without repeats: alignment, filtered columns, rests, another trajectory, verdicts.

The axis here is a few lines of its own: inertia, Coulomb and viscous friction, effects added by hand, and a
torque that is computed from the motion, so that what is hidden is known exactly.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from autotune.diagnosis import free_shape, screening
from autotune.diagnosis.base_laws import without_effects
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.compare import compare
from autotune.diagnosis.evidence.single import SingleRecording, beyond_chain, part_of_torque
from autotune.diagnosis.fitting import fit_model
from autotune.diagnosis.free_shape import (
    any_course,
    like_a_motor,
    like_a_spring,
    like_a_weight,
    out_of_proportion,
    rather_a_spring,
)
from autotune.diagnosis.screening import rows_back, screen
from autotune.diagnosis.verdict import diagnose
from autotune.estimation.alignment import aligned, best_shift, compensated
from autotune.estimation.bandwidth import loud_below, prepared_for, without_rest
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.cross_validation import (
    Unseen,
    beyond_presliding,
    evenly,
    gain_and_z,
    goes_with_place,
)
from autotune.estimation.data import prepare
from autotune.estimation.least_squares import Free, with_values
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import Problem
from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Metadata, Recording

PERIOD = 1e-3
INERTIA, COULOMB, VISCOUS = 3e-4, 0.06, 1.2e-3
COUNT = 2 * np.pi / 20_000


def _path(kind: str, seconds: float) -> np.ndarray:
    time = np.arange(0.0, seconds, PERIOD)
    if kind == "slow":
        waves = ((2.5, 0.11, 0.3), (0.8, 0.43, 1.0), (0.2, 1.7, 2.0))
    else:
        waves = ((1.5, 0.31, 0.0), (1.1, 0.83, 2.2), (0.05, 4.1, 0.5))
    return sum(a * np.sin(2 * np.pi * f * time + p) for a, f, p in waves)


def _torque(
    q: np.ndarray, ripple: float = 0.0, curved: float = 0.0, slope: float = 0.0, cold: float = 1.0
) -> np.ndarray:
    """What the motion needs, held from sample to sample as a drive does; `cold`: times the friction."""
    v = np.gradient(q, PERIOD)
    needed = INERTIA * np.gradient(v, PERIOD) + cold * (VISCOUS * v + COULOMB * np.tanh(v / 5e-3))
    needed += ripple * np.sin(7 * q) + curved * np.sign(v) * np.sqrt(np.abs(v)) + slope * q
    middle = np.concatenate([needed[1:], needed[-1:]])
    return 0.5 * (needed + middle)


def _recording(kind: str = "slow", seconds: float = 20.0, noise: float = 2e-3, **effects: float) -> Recording:
    q = _path(kind, seconds)
    random = np.random.default_rng([len(kind), 5])
    torque = _torque(q, **effects) + random.normal(0.0, noise, len(q))
    columns = {"time": np.arange(len(q)) * PERIOD, "position": np.round(q / COUNT) * COUNT, "torque": torque}
    return Recording.from_columns(columns, Metadata(sample_period=PERIOD, position_resolution=COUNT), kind)


def _with(recording: Recording, **columns: np.ndarray) -> Recording:
    return Recording.from_columns(dict(recording.floats) | columns, recording.metadata, recording.experiment)


def test_the_nearest_minimum_is_found_between_half_samples() -> None:
    shift, cost = best_shift(lambda s: 3.0 + (s - 1.3) ** 2, 0.0)
    assert shift == pytest.approx(1.3, abs=0.051)
    assert cost == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize("samples", [-1, 0, 2])
def test_a_torque_that_was_logged_late_is_moved_back(samples: int) -> None:
    recording = _recording(seconds=10.0)
    late = np.roll(recording["torque"], samples)
    found = aligned(without_rest(prepare([_with(recording, torque=late)], 30.0, 75.0))).shift
    assert found == pytest.approx(2.0 * samples, abs=0.8)


@pytest.mark.parametrize("column", ["torque", "position"])
def test_a_filtered_column_is_recognised_and_met(column: str) -> None:
    recording = _recording("quick", seconds=12.0)
    share = 1.0 - np.exp(-1.0 / 8.0)
    slow = lfilter([share], [1.0, share - 1.0], recording[column])
    data = prepared_for([_with(recording, **{column: slow})])
    met, said = compensated(data)
    assert said is not None
    assert f"The {column} looks low-passed" in said
    assert met.filtered
    untouched, nothing = compensated(prepared_for([recording]))
    assert nothing is None
    assert not untouched.filtered


@pytest.mark.parametrize("samples", [6, 9, 14])
def test_a_dead_time_of_many_samples_is_no_filter_of_the_position(samples: int) -> None:
    """A motor behind 9 ms of a bus was told that its encoder was low-passed by 8 ms, and had 8 % more inertia."""
    recording = _recording("quick", seconds=12.0)
    data = prepared_for([_with(recording, torque=np.roll(recording["torque"], -samples))])
    met, said = compensated(data)
    assert said is None
    assert not met.filtered
    assert -0.5 * met.shift == pytest.approx(samples, abs=0.6)  # of half a sample, as columns are read


def test_rests_and_reversals_below_the_encoder_are_left_out() -> None:
    moving = _recording(seconds=10.0)
    rest = np.full(4000, moving["position"][-1])
    torque = np.concatenate([moving["torque"], np.full(4000, 0.03)])
    columns = {"time": np.arange(14_000) * PERIOD, "position": np.concatenate([moving["position"], rest])}
    stopped = Recording.from_columns(columns | {"torque": torque}, moving.metadata, "stops")
    data = without_rest(prepare([stopped], 30.0, 75.0))
    assert data.grid.max() < 10_100
    assert all(block.rows.stop <= len(data.grid) for block in data.blocks)
    assert len(data.grid) == sum(block.repeats * block.count for block in data.blocks)


def test_a_short_piece_does_not_shift_the_rows_after_it() -> None:
    recording = _recording(seconds=10.0)
    missed = np.zeros(len(recording), dtype=np.int64)
    missed[[3000, 3013]] = 2
    cut = Recording(recording.metadata, recording.floats, recording.experiment, recording.repeat, missed)
    data = prepare([cut], 30.0, 75.0)
    assert len(data.position) == len(recording)
    np.testing.assert_allclose(data.position[5000:8000], recording["position"][5000:8000], atol=5e-3)


def test_most_of_a_slow_torque_is_below_its_frequencies() -> None:
    time = np.arange(0.0, 20.0, PERIOD)
    random = np.random.default_rng(1)
    torque = np.sin(2 * np.pi * 3.0 * time) + random.normal(0.0, 0.2, len(time))
    assert 2.5 < loud_below(torque, PERIOD) < 6.0


def test_break_away_is_never_below_coulomb_friction() -> None:
    packed = base_model(
        {
            "inertia": 1e-3,
            "viscous": 1e-3,
            "coulomb": 0.1,
            "stiffness": 50.0,
            "micro_damping": 0.1,
            "offset": 0.0,
        }
    ).pack()
    free = [Free("break_away", layout.BREAK_AWAY, 0.0, 1.0, 0.01, above=layout.COULOMB)]
    assert with_values(packed, free, np.array([0.05])).p[layout.BREAK_AWAY] == pytest.approx(0.1)
    assert with_values(packed, free, np.array([0.15])).p[layout.BREAK_AWAY] == pytest.approx(0.15)


def test_plain_friction_is_fitted_and_nothing_is_named() -> None:
    recording = _recording()
    fitted = fit_model([recording])
    assert fitted.model["inertia"] == pytest.approx(INERTIA, rel=0.05)
    assert fitted.model["coulomb"] == pytest.approx(COULOMB, rel=0.05)
    found = diagnose([recording], fitted.model)
    assert (found.verdict, found.effects) == ("none", ())


@pytest.mark.slow(5)
def test_one_recording_suspects_and_a_second_trajectory_confirms() -> None:
    """Also one taken cold: it has a base of its own, which is said, and nothing of the name is lost."""
    one, other = (_recording(kind, ripple=0.015) for kind in ("slow", "quick"))
    model = fit_model([one]).model
    alone = diagnose([one], model)
    assert (alone.verdict, alone.effects, alone.confidence) == ("named", ("torque_ripple",), "suspected")
    both = diagnose([one, other], model)
    assert (both.effects, both.confidence) == (("torque_ripple",), "confirmed")
    assert any("lowers the squared error there" in note for note in both.notes)
    cold = diagnose([one, _recording("quick", ripple=0.015, cold=1.4)], model)
    assert (cold.effects, cold.confidence) == (("torque_ripple",), "confirmed")
    told = r"different base: Coulomb friction 0\.0601 ± \S+ and 0\.084\d* ± "
    assert any(re.search(told, note) for note in cold.notes)
    assert not any("different base" in note for note in both.notes)


def test_a_base_that_is_two_names_nothing() -> None:
    """Friction half as large again in the second: fitted together that is more than noise in both."""
    one, other = _recording("slow"), _recording("quick", cold=1.5)
    found = diagnose([one, other], fit_model([one]).model)
    assert (found.verdict, found.effects) == ("none", ())
    assert any("recording 1 alone says 'none', recording 2 alone says 'none'" in note for note in found.notes)


def test_what_another_trajectory_refutes_is_not_named() -> None:
    """A spring in one file only: re-rigged between the two, or another axis."""
    one, other = _recording("slow", slope=0.01), _recording("quick")
    found = diagnose([one, other], fit_model([other]).model)
    assert found.verdict == "unknown"
    assert any("it is not the cause" in note for note in found.notes)


def test_temperature_is_a_coordinate_where_it_was_recorded() -> None:
    recording = _recording(seconds=10.0)
    model = fit_model([recording]).model
    warm = _with(recording, temperature=np.linspace(20.0, 30.0, len(recording)))
    assert "temperature" in compare([warm], model).where
    cold = _with(recording, temperature=np.full(len(recording), 20.0))
    assert "temperature" not in compare([cold], model).where


def test_sampling_too_slow_for_the_torque_is_said() -> None:
    recording = _recording("quick")
    thin = {name: values[::20] for name, values in recording.floats.items()}
    slow = Recording.from_columns(thin, replace(recording.metadata, sample_period=0.02), "slow")
    found = diagnose([slow], fit_model([slow]).model)
    assert found.confidence != "confirmed"
    assert set(found.effects) <= {"direction_asymmetry"}


@pytest.mark.long
def test_two_files_that_do_not_tell_rivals_apart_confirm_neither() -> None:
    """Within a fifth of a turn a spring and an imbalance are the same, in both files."""
    files = []
    for kind in ("slow", "quick"):
        q = 0.12 * _path(kind, 10.0)
        torque = _torque(q, slope=0.05) + np.random.default_rng([len(kind), 5]).normal(0.0, 2e-3, len(q))
        columns = {"time": np.arange(len(q)) * PERIOD, "position": np.round(q / COUNT) * COUNT}
        metadata = Metadata(sample_period=PERIOD, position_resolution=COUNT)
        files.append(Recording.from_columns(columns | {"torque": torque}, metadata, kind))
    found = diagnose(files, fit_model(files[:1]).model)
    assert set(found.effects) <= {"spring", "gravity_imbalance"}
    assert found.confidence == "suspected"
    assert {"spring", "gravity_imbalance"} <= set(found.confusable[0])
    assert any("in its place does nearly as well" in note for note in found.notes)


def _with_a_weight(
    load: Callable[[np.ndarray], np.ndarray], size: float, noise: float
) -> tuple[Problem, ModelFit, ModelFit, ModelFit]:
    """An axis under a load by its place [N m], its motion of some `size` [rad]; noise [N m].

    Its problem with a model that has a weight, that as root, without the weight, and with the weight as what was found.
    """
    time = np.arange(0.0, 20.0, PERIOD)
    q = size * (1.5 * np.sin(2 * np.pi * 0.31 * time) + 0.8 * np.sin(2 * np.pi * 0.73 * time + 1.0))
    torque = _torque(q) + load(q) + np.random.default_rng(5).normal(0.0, noise, len(q))
    recording = _with(_recording(), position=np.round(q / COUNT) * COUNT, torque=torque)
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    plain = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    model = plain.with_effect(EFFECTS["gravity_imbalance"].make({"sin": 0.03, "cos": 0.0}))
    problem, root, _, _ = begin(prepared_for([recording]), model)
    bare = replace(root, fitted=replace(root.fitted, packed=plain.pack()))
    return problem, root, bare, replace(root, effects=("gravity_imbalance",))


@pytest.mark.parametrize(
    ("sine", "spring", "hardening", "second", "size", "any_will_do", "parabola"),
    [
        (0.03, 0.0, 0.0, 0.0, 0.4, False, True),
        (0.03, 0.0, 0.0, 0.0, 1.5, False, False),
        (0.0, 0.02, 0.02, 0.0, 0.4, True, True),
        (0.0, 0.02, 0.0, 0.0, 0.4, False, True),
        (0.03, 0.0, 0.0, 0.01, 3.0, False, False),
    ],
)
def test_an_imbalance_over_little_travel_is_a_sine_or_none(
    sine: float,
    spring: float,
    hardening: float,
    second: float,
    size: float,
    any_will_do: bool,
    parabola: bool,
) -> None:
    """A spring comes near to a sine over a quarter of a turn, and a parabola to both; over two turns a lever may
    change.
    """
    problem, root, bare, found = _with_a_weight(
        lambda q: sine * np.sin(q) + second * np.sin(2 * q) + spring * q + hardening * q**3, size, 2e-3
    )
    assert any_course(problem, bare, found) is any_will_do
    assert not any_course(problem, bare, root)
    assert like_a_spring(problem, bare, found, POLICY.alike_single) is parabola


@pytest.mark.parametrize(
    ("load", "size", "spring"),
    [
        (lambda q: 0.03 * np.sin(q + 0.7), 0.9, False),
        (lambda q: 0.02 * np.maximum(q + 0.5, 0.0), 0.6, True),
        (lambda q: 0.02 * np.tanh(1.5 * q), 0.6, True),
        (lambda q: 0.02 * q + 0.01 * q**3, 0.6, True),
    ],
    ids=["a weight", "met on the way", "gives way", "hardens"],
)
def test_of_a_wave_and_a_spring_that_bends_the_nearer_one_is_told(
    load: Callable[[np.ndarray], np.ndarray], size: float, spring: bool
) -> None:
    """Within three quarters of a turn, by as many coefficients each."""
    problem, _, bare, found = _with_a_weight(load, size, 5e-4)
    assert rather_a_spring(problem, bare, found) is spring


@pytest.mark.parametrize(
    ("load", "freed", "weight"),
    [
        (lambda q: 0.03 * np.sin(1.5 * q + 0.4), True, True),
        (lambda q: 0.03 * np.sin(1.5 * q + 0.4), False, False),
        (lambda q: 0.02 * np.maximum(q + 0.5, 0.0), True, False),
        (lambda q: 0.02 * q + 0.02 * q**3, True, False),
    ],
)
def test_a_weight_behind_a_gear_may_stand_for_a_spring_by_another_law(
    load: Callable[[np.ndarray], np.ndarray], freed: bool, weight: bool
) -> None:
    """Over a part of a turn of the load its wave is a smooth course; what a plain spring explains as well is one."""
    time = np.arange(0.0, 20.0, PERIOD)
    q = 0.45 * (1.5 * np.sin(2 * np.pi * 0.31 * time) + 0.8 * np.sin(2 * np.pi * 0.73 * time + 1.0))
    torque = _torque(q) + load(q) + np.random.default_rng(5).normal(0.0, 5e-4, len(q))
    recording = _with(_recording(), position=np.round(q / COUNT) * COUNT, torque=torque)
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    plain = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    problem, root, _, _ = begin(
        prepared_for([recording]), plain.with_effect(EFFECTS["spring"].make({"stiffness": 0.02}))
    )
    bare = replace(root, fitted=replace(root.fitted, packed=plain.pack()))
    spring = replace(root, effects=("spring",))
    found = next(iter(free_shape._courses(problem, plain.pack(), spring, "spring"))) if freed else spring
    assert found is not None
    assert like_a_weight(problem, bare, found, POLICY.alike) is weight


@pytest.mark.parametrize(
    ("there", "sought", "turns", "is_its_course"),
    [
        ("spring", "gravity_imbalance", 0.5, True),
        ("gravity_imbalance", "spring", 0.5, True),
        ("spring", "gravity_imbalance", 2.0, False),
        ("gravity_imbalance", "spring", 2.0, False),
        ("spring", "torque_ripple", 0.5, False),
        ("stribeck", "gravity_imbalance", 0.5, False),
    ],
)
def test_over_a_part_of_a_turn_a_spring_and_a_weight_are_one_course(
    there: str, sought: str, turns: float, is_its_course: bool
) -> None:
    """A hose that gives way was a spring and a weight, both confirmed."""
    base = {
        "inertia": 1.0,
        "coulomb": 1.0,
        "viscous": 0.0,
        "stiffness": 1.0,
        "micro_damping": 0.0,
        "offset": 0.0,
    }
    packed = base_model(base).pack()
    problem = SimpleNamespace(scales=SimpleNamespace(travel=2.0 * np.pi * turns))
    model_fit = SimpleNamespace(effects=(there,), fitted=SimpleNamespace(packed=packed))
    assert screening._is_its_course(problem, EFFECTS[sought], model_fit) is is_its_course


@pytest.mark.parametrize(("met", "spring"), [(True, True), (False, False)])
def test_a_wave_beside_another_effect_rather_a_spring_that_is_met_on_the_way(met: bool, spring: bool) -> None:
    """Over half a turn a wave of free phase bends as the spring does; over a whole one nothing but a wave does."""
    time = np.arange(0.0, 20.0, PERIOD)
    q = (0.68 if met else 1.5) * (
        1.5 * np.sin(2 * np.pi * 0.31 * time) + 0.8 * np.sin(2 * np.pi * 0.73 * time + 1.0)
    )
    load = 0.02 * np.maximum(q + 0.5, 0.0) if met else 0.03 * np.sin(q)
    torque = _torque(q) + load
    torque = torque + 0.1 * COULOMB * np.tanh(np.gradient(q, PERIOD) / 5e-3) ** 2
    torque = torque + np.random.default_rng(5).normal(0.0, 2e-3, len(q))
    recording = _with(_recording(), position=np.round(q / COUNT) * COUNT, torque=torque)
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    plain = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    asymmetry = EFFECTS["direction_asymmetry"].make({"coulomb": 0.1, "viscous": 0.0})
    model = plain.with_effect(asymmetry).with_effect(
        EFFECTS["gravity_imbalance"].make({"sin": 0.03, "cos": 0.0})
    )
    problem, root, _, _ = begin(prepared_for([recording]), model)
    found = replace(root, effects=("direction_asymmetry", "gravity_imbalance"))
    bare = replace(root, fitted=replace(root.fitted, packed=plain.pack()))
    assert like_a_spring(problem, bare, found, POLICY.alike, "gravity_imbalance") is spring
    assert not like_a_spring(problem, bare, found, POLICY.alike, "direction_asymmetry")


@pytest.mark.parametrize(("slides", "spring"), [(False, True), (True, False)])
def test_an_element_that_hardly_slides_may_be_a_spring(slides: bool, spring: bool) -> None:
    """Bent over all of the travel but its last hundredth it pulls as a spring does; half as long it shows a loop."""
    time = np.arange(0.0, 20.0, PERIOD)
    q = 1.5 * np.sin(2 * np.pi * 0.31 * time) + 0.8 * np.sin(2 * np.pi * 0.73 * time + 1.0)
    reach = 0.5 * float(np.ptp(q)) * (0.48 if slides else 0.99)
    bent = np.zeros(len(q))
    for k in range(1, len(q)):
        bent[k] = np.clip(bent[k - 1] + q[k] - q[k - 1], -reach, reach)
    torque = _torque(q) + 0.5 * COULOMB * (bent / reach if slides else q / reach)
    torque = torque + np.random.default_rng(5).normal(0.0, 2e-3, len(q))
    recording = _with(_recording(), position=np.round(q / COUNT) * COUNT, torque=torque)
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    plain = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    element = {"displacement_1": reach, "torque_1": 0.5 * COULOMB}
    data, kind = prepared_for([recording]), EFFECTS["reversal_memory"]
    problem, root, _, _ = begin(data, plain)
    _, found, _, _ = begin(data, plain.with_effect(kind.make(element)))
    found = replace(found, effects=(kind.name,))
    assert like_a_spring(problem, root, found, POLICY.alike) is spring


@pytest.mark.parametrize(("softens", "spring"), [(True, True), (False, False)])
def test_a_wave_beside_a_spring_may_be_the_spring_s_own_course(softens: bool, spring: bool) -> None:
    """Over half a turn; a weight that hangs there too is told over two."""
    time = np.arange(0.0, 20.0, PERIOD)
    size = 0.6 if softens else 3.0
    q = size * (1.5 * np.sin(2 * np.pi * 0.31 * time) + 0.8 * np.sin(2 * np.pi * 0.73 * time + 1.0))
    pull = 0.06 * np.tanh(q) if softens else 0.01 * q + 0.03 * np.sin(q)
    torque = _torque(q) + pull + np.random.default_rng(5).normal(0.0, 2e-3, len(q))
    recording = _with(_recording(), position=np.round(q / COUNT) * COUNT, torque=torque)
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    plain = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    model = plain.with_effect(EFFECTS["spring"].make({"stiffness": 0.01}))
    model = model.with_effect(EFFECTS["gravity_imbalance"].make({"sin": 0.03, "cos": 0.0}))
    problem, root, _, _ = begin(prepared_for([recording]), model)
    found = replace(root, effects=("spring", "gravity_imbalance"))
    bare = replace(root, fitted=replace(root.fitted, packed=plain.pack()))
    assert like_a_spring(problem, bare, found, POLICY.alike, "gravity_imbalance") is spring


@pytest.mark.parametrize("saturates", [True, False])
def test_friction_that_only_driving_shows_may_be_a_motor_that_saturates(saturates: bool) -> None:
    """A motor falls short whichever way it turns; the friction of what its load presses helps to brake."""
    time, inertia = np.arange(0.0, 20.0, PERIOD), 0.01
    q = 1.5 * np.sin(2 * np.pi * 0.31 * time) + 0.8 * np.sin(2 * np.pi * 0.73 * time + 1.0)
    v = np.gradient(q, PERIOD)
    load = inertia * np.gradient(v, PERIOD)
    needed = load + VISCOUS * v + COULOMB * np.tanh(v / 5e-3)
    pressed = needed + 0.3 * np.abs(load) * np.tanh(v / 5e-3)
    torque = 0.5 * np.arctanh(needed / 0.5) if saturates else pressed
    torque = torque + np.random.default_rng(5).normal(0.0, 2e-3, len(q))
    recording = _with(_recording(), position=np.round(q / COUNT) * COUNT, torque=torque)
    values = {"inertia": inertia, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 1000.0}
    plain = base_model(values | {"micro_damping": 0.1, "offset": 0.0})
    data, kind = prepared_for([recording]), EFFECTS["load_dependent_friction"]
    problem, root, _, _ = begin(data, plain)
    _, found, _, _ = begin(data, plain.with_effect(kind.make({"factor": 0.1, "friction_share": 0.0})))
    found = replace(found, effects=(kind.name,))
    assert like_a_motor(problem, root, found, 0.0) is saturates
    assert not like_a_motor(problem, root, replace(root, effects=("spring",)), 0.0)


def _swinging(eccentric: float, crank: float, oiled: float = 0.0) -> Recording:
    """A light motor's large inertia, an encoder that is off centre, and an inertia J·(1 + crank·cos q).

    `oiled`: viscous friction beyond the crank, which follows the place as its inertia does.
    """
    time, inertia = np.arange(0.0, 20.0, PERIOD), 0.01
    q = 3.0 * np.sin(2 * np.pi * 0.31 * time) + 1.5 * np.sin(2 * np.pi * 0.73 * time + 1.0)
    v = np.gradient(q, PERIOD)
    needed = inertia * (1.0 + crank * np.cos(q)) * np.gradient(v, PERIOD) + COULOMB * np.tanh(v / 5e-3)
    needed += (VISCOUS + oiled * np.cos(q)) * v - 0.5 * inertia * crank * np.sin(q) * v**2
    torque = 0.5 * (needed + np.append(needed[1:], needed[-1])) + np.random.default_rng(5).normal(
        0.0, 2e-3, len(q)
    )
    told = np.round((q + eccentric * np.sin(q)) / COUNT) * COUNT
    return _with(_recording(), position=told, torque=torque)


@pytest.mark.parametrize(
    ("eccentric", "crank", "oiled", "between"),
    [
        (0.02, 0.0, 0.0, None),
        (0.3, 0.0, 0.0, None),
        (0.0, 0.03, 0.0, (0.48, 0.52)),
        (0.0, 0.3, 0.0, (0.48, 0.52)),
        (0.0, 0.03, 0.004, (0.47, 0.53)),
        (0.1, 0.25, 0.0, (0.0, 0.4)),
    ],
)
def test_an_inertia_that_changes_with_the_place_is_no_encoder_off_centre(
    eccentric: float, crank: float, oiled: float, between: tuple[float, float] | None
) -> None:
    """Of a crank's torque half as much goes with the square of the speed, however large it is; a mixture is neither.

    What its friction has of the place says nothing of that.
    """
    recording, kind = _swinging(eccentric, crank, oiled), EFFECTS["encoder_eccentricity"]
    values = {"inertia": 0.01, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 1000.0}
    plain = base_model(values | {"micro_damping": 0.1, "offset": 0.0})
    model = plain.with_effect(kind.make({"sin": eccentric - crank, "cos": 0.0, "order": 1.0}))
    problem, found, _, _ = begin(prepared_for([recording]), model)
    root = replace(found, fitted=replace(found.fitted, packed=plain.pack()))
    told = out_of_proportion(problem, root, replace(found, effects=(kind.name,)))
    assert out_of_proportion(problem, root, replace(found, effects=("spring",))) is None
    assert (told is None) == (between is None)
    if told is not None and between is not None:
        assert between[0] < told.times < between[1]
        assert told.error < (0.15 if oiled else 0.05)


def _uneven(friction: float, constant: float, quick: float, oiled: float) -> Recording:
    """Friction, or the torque of each ampere, that waves over the place; `quick`: how fast, over three strokes in ten
    seconds."""
    time = np.arange(0.0, 20.0, PERIOD)
    q = 3.0 * np.sin(2 * np.pi * 0.31 * quick * time) + 1.5 * np.sin(2 * np.pi * 0.73 * quick * time + 1.0)
    v = np.gradient(q, PERIOD)
    contact = COULOMB * (1.0 + friction * np.sin(q)) * np.tanh(v / 5e-3)
    contact += VISCOUS * (1.0 + oiled * np.sin(q)) * v
    needed = (1.0 + constant * np.sin(q)) * (0.002 * np.gradient(v, PERIOD) + contact)
    torque = 0.5 * (needed + np.append(needed[1:], needed[-1])) + np.random.default_rng(5).normal(
        0.0, 2e-3, len(q)
    )
    return _with(_recording(), position=np.round(q / COUNT) * COUNT, torque=torque)


@pytest.mark.parametrize(
    ("friction", "constant", "quick", "oiled", "times"),
    [
        (0.2, 0.0, 1.0, 0.0, None),
        (0.2, 0.0, 1.0, 0.2, None),
        (0.0, 0.2, 1.0, 0.0, 0.0),
        (0.2, 0.0, 0.1, 0.0, None),
        (0.0, 0.2, 0.1, 0.0, None),
    ],
    ids=["friction", "all friction", "torque constant", "friction, slow", "torque constant, slow"],
)
def test_a_torque_constant_that_changes_with_the_place_is_no_friction_that_does(
    friction: float, constant: float, quick: float, oiled: float, times: float | None
) -> None:
    """Magnets of two strengths were friction over the place, suspected, on two simulators of others.

    Where next to nothing accelerates the axis nothing tells them apart, and friction is by far the commoner.
    """
    kind = EFFECTS["position_dependent_friction"]
    values = {"inertia": 0.002, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 1000.0}
    plain = base_model(values | {"micro_damping": 0.1, "offset": 0.0})
    wave = {"height": 0.0, "centre": 0.0, "width": 1.0, "order": 1.0, "sin": friction + constant, "cos": 0.0}
    problem, found, _, _ = begin(
        prepared_for([_uneven(friction, constant, quick, oiled)]), plain.with_effect(kind.make(wave))
    )
    root = replace(found, fitted=replace(found.fitted, packed=plain.pack()))
    told = out_of_proportion(problem, root, replace(found, effects=(kind.name,)))
    assert (told is None) == (times is None)
    if told is not None:
        # viscous friction, a sixth of all here, follows the constant too and is in neither part
        assert told.times == pytest.approx(times, abs=0.2)


@pytest.mark.parametrize(
    "values",
    [
        {"height": 0.6, "centre": 0.3, "width": 0.4, "edge": 4.0},
        {"height": 0.0, "centre": 0.0, "width": 1.0, "order": 2.0, "sin": 0.2, "cos": -0.1},
        {
            "height": -0.5,
            "centre": 0.0,
            "width": 1.0,
            "from": -2.0,
            "step": 0.2,
            "rise_4": 0.3,
            "rise_21": 0.1,
        },
    ],
)
def test_parts_of_friction_over_the_place_are_its_law_together(values: dict[str, float]) -> None:
    kind = EFFECTS["position_dependent_friction"]
    base = {
        "inertia": 0.01,
        "coulomb": 0.5,
        "viscous": 0.02,
        "stiffness": 1.0,
        "micro_damping": 0.0,
        "offset": 0.0,
    }
    p = base_model(base).with_effect(kind.make(values)).pack().p
    place = np.linspace(-3.0, 3.0, 401)
    velocity, acceleration = np.cos(place), np.sin(3.0 * place)
    assert kind.proportion is not None
    assert kind.kernels.level_factor is not None
    first, second = kind.proportion.parts(p, place, velocity, acceleration)
    rise = np.array([kind.kernels.level_factor(p, np.zeros(1), q) - 1.0 for q in place])
    assert first + second == pytest.approx(rise * 0.5 * np.sign(velocity), abs=1e-12)
    assert first == pytest.approx(rise * (0.5 * np.sign(velocity) + 0.01 * acceleration), abs=1e-12)


def test_a_proportion_is_told_beside_a_motor_that_saturates() -> None:
    """The residual is in the demand's scale: of a crank 0.45 was told, by the torque at the shaft."""
    recording, kind = _swinging(0.0, 0.03, 0.0), EFFECTS["encoder_eccentricity"]
    largest = 1.4 * float(np.max(np.abs(recording["torque"])))
    lost = EFFECTS["torque_saturation"].make({"loss": 0.3, "torque": largest, "exponent": 2.0})
    curved = (1.0 - 0.3) ** -2 - 1.0
    demands = np.linspace(0.0, 1.2 * largest, 4000)
    gives = demands / np.sqrt(1.0 + curved * (demands / largest) ** 2)
    asked = np.sign(recording["torque"]) * np.interp(np.abs(recording["torque"]), gives, demands)
    values = {"inertia": 0.01, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 1000.0}
    plain = base_model(values | {"micro_damping": 0.1, "offset": 0.0}).with_effect(lost)
    model = plain.with_effect(kind.make({"sin": -0.03, "cos": 0.0, "order": 1.0}))
    problem, found, _, _ = begin(prepared_for([_with(recording, torque=asked)]), model)
    root = replace(found, fitted=replace(found.fitted, packed=plain.pack()))
    told = out_of_proportion(problem, root, replace(found, effects=(kind.name,)))
    assert told is not None
    assert told.times == pytest.approx(0.5, abs=0.02)


def test_a_model_is_fitted_without_the_effects_that_it_has() -> None:
    """It leaves what the plain model leaves of the same rows, however its bristle was held."""
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    plain = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    data, kind = prepared_for([_recording(slope=0.01)]), EFFECTS["spring"]
    _, root, _, _ = begin(data, plain)
    problem, with_spring, _, _ = begin(data, plain.with_effect(kind.make({"stiffness": 0.01})))
    bare = without_effects(problem, with_spring)
    assert bare is not None
    assert not bare.fitted.packed.on.any()
    assert without_effects(problem, bare) is None
    assert with_spring.fitted.cost < 0.5 * bare.fitted.cost
    assert bare.fitted.cost == pytest.approx(root.fitted.cost, rel=0.1)


@pytest.mark.parametrize(("slope", "told"), [(0.0, False), (0.004, True)])
def test_what_goes_with_the_place_is_told_where_the_contact_slides(slope: float, told: bool) -> None:
    """tanh is another law than the bristle's: on all rows its misfit would stand beside what belongs to the place."""
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    model = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    problem, root, _, _ = begin(prepared_for([_recording(slope=slope)]), model)
    sliding = beyond_presliding(problem, root.fitted.packed)
    assert sliding is not None
    assert 0.5 < np.count_nonzero(sliding.weight) / np.count_nonzero(problem.weight) < 1.0
    assert goes_with_place(sliding, root.fitted) is told


@pytest.mark.parametrize(
    ("ripple", "read", "bend", "effect", "told"),
    [
        (4e-4, 0.0, 0.0, "torque_ripple", True),
        (0.0, 8e-4, 0.0, "torque_ripple", False),
        (0.0, 0.0, 0.03, "torque_saturation", False),
    ],
)
def test_what_no_measurement_chain_makes_may_be_as_small_as_it_is(
    ripple: float, read: float, bend: float, effect: str, told: bool
) -> None:
    """A ripple of half a per cent of the torque; an encoder whose lines are as dense; a sensor with a bent line."""
    q = _strokes(20.0)
    torque = _torque(q, ripple=ripple) + np.random.default_rng(5).normal(0.0, 2e-4, len(q))
    torque -= bend * torque**3 / np.max(torque**2)
    place = np.round((q + read * np.sin(7 * q)) / COUNT) * COUNT
    columns = {"time": np.arange(len(q)) * PERIOD, "position": place, "torque": torque}
    metadata = Metadata(sample_period=PERIOD, position_resolution=COUNT)
    recording = Recording.from_columns(columns, metadata, "strokes")
    problem, root, nominal, _ = begin(prepared_for([recording]), fit_model([recording]).model)
    found = screen(problem, SingleRecording(), root, nominal, effect)
    assert found is not None
    assert found.gain > POLICY.least_gain_single
    assert part_of_torque(problem, root, found) < POLICY.least_part
    assert beyond_chain(problem, root.fitted, found) is told


def test_an_axis_that_hardly_slides_tells_nothing_of_its_place() -> None:
    """Its bristle reaches further than it moves."""
    values = {"inertia": INERTIA, "coulomb": COULOMB, "viscous": VISCOUS, "stiffness": 100.0}
    model = base_model(values | {"micro_damping": 0.01, "offset": 0.0})
    problem, root, _, _ = begin(prepared_for([_recording()]), model)
    p = root.fitted.packed.p.copy()
    p[layout.STIFFNESS] = p[layout.COULOMB] / 50.0
    sliding = beyond_presliding(problem, replace(root.fitted.packed, p=p))
    assert sliding is None
    assert not goes_with_place(sliding, root.fitted)


def test_samples_fast_enough_judge_every_effect() -> None:
    """A slow motion is compared at low frequencies only; that is not for want of samples."""
    q = _path("slow", 20.0)
    torque = _torque(q, curved=0.01) + np.random.default_rng(5).normal(0.0, 2e-3, len(q))
    columns = {"time": np.arange(len(q)) * PERIOD, "position": np.round(q / COUNT) * COUNT, "torque": torque}
    recording = Recording.from_columns(columns, Metadata(position_resolution=COUNT), "slow")
    found = diagnose([recording], fit_model([recording]).model)
    assert (found.effects, found.confidence) == (("nonlinear_viscous",), "suspected")
    assert not any("samples of" in note for note in found.notes)


def _aged(kind: str, slip: float, power: float) -> Recording:
    """Friction that rises by the `power` of the rest [s], lost within `slip` [rad]; on a motion that hardly rests."""
    q = _path(kind, 20.0)
    v, age = np.gradient(q, PERIOD), np.zeros(len(q))
    for k in range(1, len(q)):
        age[k] = max(age[k - 1] + PERIOD * (1.0 - abs(v[k]) * age[k - 1] / slip), 0.0)
    level = COULOMB * (1.0 + 3.0 * age**power)
    needed = INERTIA * np.gradient(v, PERIOD) + VISCOUS * v + level * np.tanh(v / 5e-3)
    torque = 0.5 * (needed + np.concatenate([needed[1:], needed[-1:]]))
    noise = np.random.default_rng(3).normal(0.0, 5e-4, len(q))
    return _with(_recording(kind), position=np.round(q / COUNT) * COUNT, torque=torque + noise)


@pytest.mark.parametrize(("kind", "slip"), [("slow", 0.003), ("quick", 0.01)])
def test_friction_that_ages_is_not_called_friction_that_falls_with_speed(kind: str, slip: float) -> None:
    """Its law, a root of the rest, is not the library's: Stribeck friction left a third of what dwell time does."""
    recording = _aged(kind, slip, 0.4)
    found = diagnose([recording], fit_model([recording]).model)
    assert found.verdict == "ambiguous"
    assert set(found.confusable[0]) == {"stribeck", "dwell_time_break_away"}
    assert found.next_experiment is not None
    assert "starts after rests" in found.next_experiment


def test_look_alikes_share_a_set_and_do_not_bend_to_any_dynamics() -> None:
    recording = _recording(seconds=10.0)
    problem, _, _, _ = begin(prepared_for([recording]), fit_model([recording]).model)
    found = SingleRecording().look_alikes(problem, "stribeck")
    assert {"dwell_time_break_away", "nonlinear_viscous", "thermal_drift"} <= set(found)
    assert "stribeck" not in found
    assert "backlash" not in found


def _strokes(top: float) -> np.ndarray:
    """To and fro at many speeds up to `top` [rad/s], with short rests."""
    random, speeds, seconds = np.random.default_rng(7), [np.zeros(200)], 0.0
    while seconds < 30.0:
        speed = top * np.exp(random.uniform(np.log(0.12), 0.0)) * (-1.0) ** len(speeds)
        ramp = np.linspace(0.0, np.pi, int(abs(speed) / (6e-3 * top)) + 20)
        up = speed * 0.5 * (1.0 - np.cos(ramp))
        speeds.append(
            np.concatenate([up, np.full(int(250.0 * top / abs(speed)), speed), up[::-1], np.zeros(60)])
        )
        seconds += len(speeds[-1]) * PERIOD
    return np.cumsum(np.concatenate(speeds)) * PERIOD


def test_what_a_base_takes_up_is_found_at_its_size() -> None:
    """A film that shears off leaves a tenth of itself: begun at that size, a shape led the fit astray."""
    q = _strokes(60.0)
    v = np.gradient(q, PERIOD)
    film = 0.05 * v / (np.abs(v) + 6.0)
    torque = _torque(q) + film + np.random.default_rng(5).normal(0.0, 2e-4, len(q))
    columns = {"time": np.arange(len(q)) * PERIOD, "position": np.round(q / COUNT) * COUNT, "torque": torque}
    metadata = Metadata(sample_period=PERIOD, position_resolution=COUNT)
    recording = Recording.from_columns(columns, metadata, "strokes")
    problem, root, nominal, _ = begin(prepared_for([recording]), fit_model([recording]).model)
    found = screen(problem, SingleRecording(), root, nominal, "nonlinear_viscous")
    assert found is not None
    assert np.sqrt(root.fitted.cost) < 0.1 * np.sqrt(np.mean(film**2))
    assert found.fitted.cost < 0.2 * root.fitted.cost


def _rarely_reversed(bump: float, event: float) -> Recording:
    """Long strokes; friction is higher by `bump` while it is slow, and a torque `event` pushes in two strokes."""
    time = np.arange(0.0, 40.0, PERIOD)
    q = 4.0 * np.sin(2 * np.pi * 0.1 * time) + 0.4 * np.sin(2 * np.pi * 0.37 * time)
    v = np.gradient(q, PERIOD)
    pushed = event * sum(np.exp(-(((time - at) / 0.1) ** 2)) for at in (11.3, 27.9))
    slow = bump * np.exp(-((v / 0.15) ** 2)) * np.tanh(v / 5e-3)
    torque = _torque(q) + slow + pushed + np.random.default_rng(5).normal(0.0, 5e-4, len(q))
    return _with(_recording(seconds=40.0), position=np.round(q / COUNT) * COUNT, torque=torque)


@pytest.mark.parametrize(("bump", "event", "back"), [(0.012, 0.0, True), (0.0, 0.02, False)])
def test_rows_that_an_effect_explains_were_no_events(bump: float, event: float, back: bool) -> None:
    """Friction that falls with speed shows at a few reversals, and looked like a stop in each."""
    recording = _rarely_reversed(bump, event)
    problem, root, nominal, _ = begin(prepared_for([recording]), fit_model([recording]).model)
    out = np.mean(problem.weight == 0.0)
    again, there = rows_back(problem, SingleRecording(), root, nominal, lambda _: None)
    assert out > 0.01
    assert bool(np.mean(again.weight == 0.0) < 0.5 * out) is back
    assert (there is root) is not back


@pytest.mark.parametrize(("counts", "coarse"), [(4096, True), (200_000, False)])
def test_counts_that_are_a_part_of_the_acceleration_hide_what_is_quick(counts: int, coarse: bool) -> None:
    """A second mass behind a spring swallows what counts seem to need: it was named for a slow pendulum."""
    time = np.arange(0.0, 20.0, 5e-3)
    q = 0.25 * np.sin(2.0 * time) + 0.1 * np.sin(5.1 * time + 1.0)
    v, a = np.gradient(q, time), np.gradient(np.gradient(q, time), time)
    torque = 5e-3 * a + 4e-3 * v + 0.04 * np.tanh(v / 0.02)
    torque += np.random.default_rng(2).normal(0.0, 5e-4, len(q))
    count = 2.0 * np.pi / counts
    columns = {"time": time, "position": np.round(q / count) * count, "torque": torque}
    metadata = Metadata(sample_period=5e-3, position_resolution=count)
    recording = Recording.from_columns(columns, metadata, "swing")
    data = prepared_for([recording])
    assert data.coarse is coarse
    values = {"inertia": 5e-3, "coulomb": 0.04, "viscous": 4e-3, "stiffness": 20.0, "micro_damping": 0.1}
    found = diagnose([recording], base_model(values | {"offset": 0.0}))
    assert not found.effects
    assert any("counts make a part of the acceleration" in note for note in found.notes) is coarse


@pytest.mark.parametrize(("left", "sure"), [(0.05, True), (0.3, False)])
def test_of_few_chunks_that_all_vanish_it_is_no_chance(left: float, sure: bool) -> None:
    """Ten slow seconds are five chunks: a weight that explained 99.99 % was "not in enough of them to be no chance"."""
    before = Unseen(np.array([1.0, 2.0, 8.0, 0.5, 2.5]))
    after = Unseen(before.chunks * left)
    assert gain_and_z(before, after)[1] < POLICY.least_z_single
    assert (evenly(before, after) > POLICY.least_z_single) is sure
    assert evenly(Unseen(np.array([1.0, 2.0])), Unseen(np.zeros(2))) < POLICY.least_z_single


@pytest.mark.parametrize(("left", "sure"), [(0.6, True), (0.8, False)])
def test_a_large_gain_is_weighed_second_by_second(left: float, sure: bool) -> None:
    """A weight that the quick motions showed, played once, lowered 42 % in two chunks of six: "no chance" was not said.

    A small gain may be what another law lends: its seconds are not independent, and chunks tell.
    """
    seconds = np.concatenate([np.full(20, 5.0), np.full(40, 0.1)])
    less = np.concatenate([np.full(20, 5.0 * left), np.full(40, 0.1)])
    before, after = (Unseen(one.reshape(6, 10).sum(axis=1), one) for one in (seconds, less))
    assert gain_and_z(replace(before, seconds=None), replace(after, seconds=None))[1] < POLICY.least_z_single
    assert (gain_and_z(before, after)[1] > POLICY.least_z_single) is sure


def _played_once(weight: float) -> Recording:
    """Four motions, each for ten seconds, of which two go far enough to show a weight [N m]; the torque is
    noisy, so that it is compared at low frequencies.

    Of draws 1 to 10 of the noise the third has a ripple beside the weight, suspected, by linear algebra without AVX-512
    and none with it; the other nine have none.
    """
    time = np.arange(0.0, 10.0, PERIOD)
    motions = ((6.0, 0.2), (2.0, 0.3), (0.05, 2.1), (0.12, 1.3))
    parts = [size * (np.sin(2 * np.pi * f * time) + 0.3 * np.sin(7.3 * f * time)) for size, f in motions]
    q = np.concatenate(parts)
    torque = np.concatenate([_torque(part) + weight * np.sin(part) for part in parts])
    torque += np.random.default_rng(1).normal(0.0, 0.03, len(q))
    labels = np.repeat([f"m{i}" for i in range(len(parts))], len(time))
    columns = {"time": np.arange(len(q)) * PERIOD, "position": np.round(q / COUNT) * COUNT, "torque": torque}
    metadata = Metadata(sample_period=PERIOD, position_resolution=COUNT)
    return Recording.from_columns(columns, metadata, labels)


@pytest.mark.parametrize(("weight", "named"), [(0.012, ["gravity_imbalance"]), (0.0, [])])
def test_what_two_motions_of_four_show_is_named(weight: float, named: list[str]) -> None:
    recording = _played_once(weight)
    data = prepared_for([recording])
    assert data.second < 100  # a chunk of 200 rows is half of an experiment
    found = diagnose([recording], fit_model([recording]).model)
    assert list(found.effects) == named
