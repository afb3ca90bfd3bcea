"""Controller, twin, joint refinement and fits of anyone's data."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from autotune.core.errors import ConfigurationError, NotEnoughExcitation, RecordingError
from autotune.diagnosis.compare import simulate_closed_loop, torque_residual
from autotune.estimation import joint_fit
from autotune.estimation.controller import controller_of, is_closed
from autotune.estimation.joint_fit import free_by_name
from autotune.identify.first_guess import refuse_two_axes
from autotune.identify.fit import fit, joined, thinned
from autotune.identify.high_speed import identify_high_speed
from autotune.identify.refinement import refine_recording
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Metadata, Recording, concatenate
from autotune.signals.normal_equations import Normal, Part, assemble, whitener
from autotune_sim.presets import preset
from tests.support.axes import NOMINAL, plain_axis
from tests.support.identification_programme import play, truth
from tests.support.recorded_once import DRESSES, played


def _model(plant):
    return base_model(truth(plant))


def test_the_controller_comes_back_from_the_data(varied) -> None:
    axis, recording = varied
    law = controller_of(recording.select("benchmark").with_metadata(controller=None))
    gains = axis.gains
    assert law.explained > 0.9999
    assert law.kp == pytest.approx(gains.kp, rel=1e-3)
    assert law.kd == pytest.approx(gains.kd, rel=1e-3)
    assert law.ki == pytest.approx(gains.ki, rel=1e-3)
    assert law.derivative_filter == pytest.approx(gains.derivative_filter, rel=1e-2)
    assert law.reference_rate == pytest.approx(1.0, rel=1e-2)


def test_torque_mode_is_not_taken_for_control(varied) -> None:
    recording = varied[1]
    assert not is_closed(recording.select("presliding"))
    assert is_closed(recording.select("benchmark"))
    unknown = recording.select("presliding").with_metadata(controller=None)
    assert not controller_of(unknown).usable


def test_a_torque_that_is_no_controllers_is_not_usable(varied) -> None:
    part = varied[1].select("benchmark")
    noise = np.random.default_rng(1).normal(0, 0.1, len(part))
    columns = dict(part.floats) | {"torque_command": part["torque_command"] + noise}
    other = Recording.from_columns(columns, replace(part.metadata, controller=None), "x")
    law = controller_of(other)
    assert not law.usable


def test_the_true_model_follows_the_axis_in_the_loop(varied) -> None:
    """Another simulator, same physics: what is left is noise, which is 1.5 % of the torque here."""
    axis, recording = varied
    result = simulate_closed_loop(recording.select("benchmark"), _model(axis.plant))
    assert result.relative_position_error < 0.01
    assert 0.005 < result.relative_torque_error < 0.1


def test_the_residual_of_the_true_model_is_noise_and_ripple(varied) -> None:
    axis, recording = varied
    residual = torque_residual(recording.select("benchmark"), _model(axis.plant))
    assert residual.relative_error < 0.05
    ripple = axis.plant.ripple[0].amplitude / np.sqrt(2)
    assert np.std(residual.error[residual.use]) < 1.5 * np.hypot(ripple, 2e-3)
    wrong = torque_residual(recording.select("benchmark"), _model(axis.plant).with_values({"coulomb": 0.1}))
    assert wrong.relative_error > 5 * residual.relative_error


def test_high_speed_finds_the_inertia(varied) -> None:
    axis, recording = varied
    found = identify_high_speed(recording.select("high_speed"))
    assert found.estimate.valid
    assert found.estimate["inertia"].value == pytest.approx(axis.plant.inertia, rel=0.02)
    assert found.estimate["viscous"].value == pytest.approx(axis.plant.viscous, rel=0.5)
    assert found.resonances == ()


def test_high_speed_finds_a_resonance() -> None:
    """40 % of the inertia on a spring of 100 N m/rad: 126 Hz."""
    axis = preset("edm-vertical", effects={"elastic_transmission": 0.01})
    found = identify_high_speed(play(axis, 1, ("high-speed",)).select("high_speed"))
    inertia = axis.plant.inertia
    expected = np.sqrt(100.0 / (inertia * 0.4 * 0.6)) / (2 * np.pi)
    assert found.resonances[0].frequency == pytest.approx(expected, rel=0.05)
    assert "notch" in found.estimate.notes[0]


def test_normal_equations_solve_a_linear_problem() -> None:
    """Exact for a linear model; the sandwich equals the usual covariance for white noise, within 25 %."""
    generator = np.random.default_rng(3)
    truth_ = np.array([0.3, -0.7])
    parts, ends = [], []
    for _ in range(4):
        design = generator.standard_normal((2000, 2))
        noise = 0.1 * generator.standard_normal(2000)
        parts.append(Part(design @ truth_ + noise, -design, -design, 20, 100.0))
        ends.append(Part(noise, -design, -design, 20, 100.0))
    np.testing.assert_allclose(assemble(parts).step, truth_, atol=0.01)
    spread = np.sqrt(np.diag(assemble(ends).covariance))
    np.testing.assert_allclose(spread, 0.1 / np.sqrt(8000), rtol=0.25)


def test_intervals_hold_where_a_few_blocks_tell_a_parameter() -> None:
    """5 blocks of 60 tell the first parameter: the sandwich with 58 degrees of freedom would cover 88 %."""
    generator = np.random.default_rng(4)
    inside = 0
    for _ in range(400):
        design = generator.standard_normal((1200, 2))
        design[100:, 0] *= 0.1
        noise = generator.standard_normal(1200)
        change = assemble([Part(noise, design, design, 20, 1.0)]).step
        solved = assemble([Part(noise + design @ change, design, design, 20, 1.0)])
        reach = stats.t.ppf(0.975, solved.freedom[0])
        inside += abs(change[0]) <= reach * np.sqrt(solved.covariance[0, 0])
    assert 0.90 < inside / 400 < 0.98


def test_a_standard_error_has_as_many_degrees_of_freedom_as_blocks_that_tell_it() -> None:
    generator = np.random.default_rng(5)
    scores = generator.standard_normal((400, 2))
    scores[10:, 1] *= 0.01
    matrices = np.broadcast_to(np.eye(2), (400, 2, 2))
    everywhere, rarely = Normal(400.0 * np.eye(2), scores.sum(axis=0), scores, matrices).freedom
    assert 250 < everywhere <= 398
    assert 4 <= rarely < 20


def test_the_whitener_whitens() -> None:
    generator = np.random.default_rng(2)
    noise = generator.standard_normal(20000)
    coloured = np.convolve(noise, 0.8 ** np.arange(30), "full")[:20000]
    white = np.convolve(coloured, whitener(coloured), "full")[100:20000]
    lag = np.corrcoef(white[1:], white[:-1])[0, 1]
    assert abs(lag) < 0.03


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rows", [0, 5, 400])
def test_a_residual_of_too_few_rows_or_of_nothing_is_left_as_it_is(rows: int) -> None:
    np.testing.assert_array_equal(whitener(np.zeros(rows)), [1.0])


def test_joint_refinement_is_close_and_its_intervals_are_honest(identified) -> None:
    plant, result = identified
    joint = result.joint
    inside = 0
    for name, value in truth(plant).items():
        quantity = joint[name]
        tolerance = {"micro_damping": 0.10, "stribeck_velocity": 0.05}.get(name, 0.02)
        assert quantity.value == pytest.approx(value, rel=tolerance), name
        low, high = quantity.interval
        inside += low <= value <= high
        assert 1e-4 * value < quantity.standard_error < 0.1 * value, name
    assert inside >= 6


def test_refinement_without_presliding_says_what_it_cannot_know(varied) -> None:
    """Triangles at speed alone: nothing is known of the bristle, and the numbers say so."""
    axis, recording = varied
    fast = recording.select("steady_state")
    fast = fast.rows(np.isin(fast.repeat, _fast_repeats(fast)))
    found = refine_recording(_model(axis.plant), fast, ["inertia", "coulomb", "stiffness", "micro_damping"])
    assert not found.estimate["micro_damping"].identified
    assert "presliding" in found.estimate.reason
    assert found.estimate["coulomb"].value == pytest.approx(axis.plant.bristle.coulomb, rel=0.2)


def _fast_repeats(recording) -> list[int]:
    speeds = {s.repeat: np.ptp(recording["reference"][s.rows]) for s in recording.segments()}
    times = {s.repeat: s.stop - s.start for s in recording.segments()}
    return [repeat for repeat, travel in speeds.items() if travel / times[repeat] * 1e3 > 2.0]


@pytest.mark.slow(9)
def test_a_fit_of_any_recording_finds_the_axis(varied) -> None:
    """Without experiment names: start values from the motion, then the twin. Stribeck on demand."""
    axis, recording = varied
    plant = axis.plant
    names = np.where(recording.experiment == "conditioning", "conditioning", "run")
    anonymous = Recording.from_columns(recording.floats, recording.metadata, names, recording.repeat)
    result = fit(anonymous, ["stribeck"])
    assert result.valid, result.reason
    for name, tolerance in (("inertia", 0.02), ("coulomb", 0.02), ("offset", 0.03), ("stiffness", 0.08)):
        assert result.model[name] == pytest.approx(truth(plant)[name], rel=tolerance), name
    assert result.model["break_away"] == pytest.approx(plant.bristle.break_away, rel=0.03)
    assert result.relative_error < 0.05


def test_effects_that_need_more_than_a_fit_say_so(varied) -> None:
    with pytest.raises(ConfigurationError, match="model add backlash"):
        fit(varied[1], ["backlash"])
    with pytest.raises(ConfigurationError, match="did you mean 'stribeck'"):
        fit(varied[1], ["stribek"])


def _alter(recording: Recording, **changes) -> Recording:
    columns = {n: changes.get(n, v) for n, v in recording.floats.items()}
    return Recording.from_columns(columns, recording.metadata, recording.experiment, recording.repeat)


def test_a_torque_of_the_wrong_sign_is_asked_about(varied) -> None:
    part = varied[1].select("benchmark")
    metadata = replace(part.metadata, controller=None)
    columns = {n: part[n] for n in ("time", "position", "reference")} | {"torque": -part["torque_command"]}
    with pytest.raises(RecordingError, match="wrong sign"):
        fit(Recording.from_columns(columns, metadata, "x"))


def test_a_torque_of_something_else_is_refused(varied) -> None:
    part = varied[1].select("benchmark")
    noise = np.random.default_rng(0).normal(0, 0.3, len(part))
    columns = {"time": part["time"], "position": part["position"], "torque": noise}
    with pytest.raises((NotEnoughExcitation, RecordingError), match=r"explains|comes out"):
        fit(Recording.from_columns(columns, replace(part.metadata, controller=None), "x"))


def test_one_direction_only_is_refused(varied) -> None:
    part = varied[1].select("high_speed")
    forward = part.rows(part.repeat == 0)
    with pytest.raises(NotEnoughExcitation, match="direction only"):
        fit(forward)


def test_two_axes_one_after_the_other_are_recognised(varied) -> None:
    part = varied[1].select("benchmark")
    heavier = _alter(part, torque_command=2.5 * part["torque_command"], torque=2.5 * part["torque"])
    mixed = concatenate([part, heavier]).with_metadata(torque_limit=None)
    with pytest.raises(RecordingError, match="mixes axes"):
        fit(mixed)


def _told(inertia: float, friction: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Regressors of a swing (acceleration, velocity, sliding bristle, its rate, 1) and their torque."""
    phase = np.linspace(0.0, 20.0, 400) + seed
    speed = np.sin(phase) + 0.3 * np.sin(2.7 * phase)
    design = np.column_stack(
        [np.gradient(speed, phase), speed, np.sign(speed), np.gradient(np.sign(speed)), np.ones(400)]
    )
    return design, design @ np.array([inertia, 0.01, friction, 0.0, 0.0])


def test_two_axes_are_told_by_what_comes_first_and_what_after() -> None:
    """A stretch that disagrees with what comes before and after it, which agree, is the model's, no other axis."""
    light, heavy = (1.0, 0.2), (2.5, 0.5)
    before_and_after = [_told(*axis, seed) for seed, axis in enumerate([light, light, heavy, heavy])]
    with pytest.raises(RecordingError, match="mixes axes"):
        refuse_two_axes([before_and_after])
    refuse_two_axes([[_told(*axis, seed) for seed, axis in enumerate([light, heavy, light])]])


def test_a_contact_that_hardly_bends_is_no_other_axis() -> None:
    """Small motion of an axis with a memory told the slope of a spring: a friction of 16 000 times the axis's."""
    sliding, (design, _) = _told(1.0, 0.2, 0), _told(1.0, 0.2, 1)
    bent = design * np.array([0.01, 0.01, 1e-4, 1e-4, 1.0])
    torque = bent @ np.array([30.0, 0.01, 5e3, 0.0, 0.0])
    refuse_two_axes([[sliding, (bent, torque)]])
    with pytest.raises(RecordingError, match="mixes axes"):
        refuse_two_axes([[sliding, (design, design @ np.array([30.0, 0.01, 5e3, 0.0, 0.0]))]])


def test_friction_curved_over_speed_is_not_two_axes() -> None:
    """Stretches at other speeds tell other inertias and frictions; one axis explains them together."""
    axis = plain_axis(20_029, {"nonlinear_viscous": 0.03})
    found = fit(played(axis, DRESSES[0], "triangles", 20_029, 25.0))
    assert found.estimate.parameters["inertia"].value == pytest.approx(axis.plant.inertia, rel=0.4)


def test_recordings_of_different_axes_are_not_joined(varied) -> None:
    one = varied[1].select("benchmark")
    with pytest.raises(RecordingError, match="mix axes"):
        joined([one, one.with_metadata(fingerprint="other")])


def test_ten_million_rows_are_thinned() -> None:
    time = np.arange(1_000_000) * 1e-3
    columns = {"time": time, "position": np.sin(time), "torque": np.cos(time)}
    recording = Recording.from_columns(columns, Metadata(), "x")
    thin = thinned(recording)
    assert 400_000 < len(thin) <= 600_000
    assert thin["time"][0] == 0.0
    assert thin["time"][-1] == pytest.approx(time[-1], abs=25.0)


def test_a_step_ends_inside_its_bounds_and_the_others_follow() -> None:
    """Break-away is held at Coulomb friction, which moves to where both fit best; as bounded least squares have it."""
    random = np.random.default_rng(3)
    design = random.normal(size=(400, 3)) + random.normal(size=(400, 1))
    model = base_model({**NOMINAL, "break_away": NOMINAL["coulomb"], "stribeck_velocity": 0.3})
    packed, free = model.pack(), free_by_name(model, ("coulomb", "break_away", "offset"))
    scale = np.array([one.scale for one in free])
    wanted = np.array([0.31, 0.29, 0.02])
    error = -design @ ((wanted - packed.p[[one.slot for one in free]]) / scale)
    matrix = design.T @ design
    normal = Normal(matrix, design.T @ error, np.zeros((1, 3)), np.zeros((1, 3, 3)))
    step = joint_fit._step(normal, packed, free)
    found = packed.p[[one.slot for one in free]] + step * scale
    assert found[1] == pytest.approx(found[0])
    both = np.column_stack([design[:, :2] @ (1.0 / scale[:2]), design[:, 2] / scale[2]])
    best = np.linalg.lstsq(both, design @ (wanted / scale), rcond=None)[0]
    assert found[[0, 2]] == pytest.approx(best, rel=0.01)


def test_friction_that_rises_from_rest_is_no_fall_upside_down() -> None:
    """Grease that thins bends the curve at low speed; a fit told of a fall takes none instead of a negative one."""
    axis = plain_axis(5, {"nonlinear_viscous": 0.06})
    found = fit(play(axis, 5), effects=["stribeck"])
    assert found.model["break_away"] >= found.model["coulomb"]
