"""Each experiment by itself finds the truth of the independent simulator, and says what it cannot find."""

import numpy as np
import pytest

from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.small_motion import SpringMass, from_difference
from autotune.identify.dahl import dahl_curve, identify_dahl
from autotune.identify.presliding import identify_presliding
from autotune.identify.steady_state import Points, compare_shapes, fit_curve, identify_steady_state, predict
from autotune.models.lugre import SHAPES
from autotune.signals.legs import find_legs


def test_steady_state_finds_friction_offset_and_ripple(varied) -> None:
    axis, recording = varied
    plant = axis.plant
    state = identify_steady_state(recording.select("steady_state"))
    found = state.estimate
    assert found.valid
    for name, truth, tolerance in (
        ("coulomb", plant.bristle.coulomb, 0.02),
        ("break_away", plant.bristle.break_away, 0.04),
        ("offset", plant.offset, 0.02),
        ("viscous", plant.viscous, 0.15),
        ("stribeck_velocity", plant.bristle.velocity, 0.15),
    ):
        assert found[name].value == pytest.approx(truth, rel=tolerance), name
    assert [line.order for line in state.ripple] == [7.0]
    assert state.ripple[0].amplitude == pytest.approx(plant.ripple[0].amplitude, rel=0.1)
    assert state.curves[0].shape in ("gaussian", "generalised_exponential")


def test_steady_state_without_a_dip_says_that_there_is_none(vertical) -> None:
    axis, recording = vertical
    found = identify_steady_state(recording.select("steady_state")).estimate
    assert found["coulomb"].value == pytest.approx(axis.plant.friction, rel=0.01)
    assert "stribeck_velocity" not in found
    assert any("does not fall" in note for note in found.notes)


def test_one_direction_is_refused(varied) -> None:
    part = varied[1].select("steady_state")
    forward = part.rows(np.gradient(part["reference"]) > 0)
    with pytest.raises(NotEnoughExcitation, match="positive direction only"):
        identify_steady_state(forward)


def test_a_single_speed_is_refused(varied) -> None:
    part = varied[1].select("steady_state")
    with pytest.raises(NotEnoughExcitation, match="at least 4"):
        identify_steady_state(part.rows((part.repeat == 0) | (part.repeat == 1)))


def test_legs_are_found_between_reversals_and_where_the_speed_changes() -> None:
    """In whole counts, as a drive reports it."""
    speed = np.repeat([0.5, -0.5, 0.1, 2.0, 0.0], 1000)
    path = np.round(np.cumsum(speed) * 1e-3 / 1e-4) * 1e-4
    legs = find_legs(path, 1e-3, 1e-4)
    assert [leg.velocity for leg in legs] == pytest.approx([0.5, -0.5, 0.1, 2.0], rel=0.01)
    assert all(600 < len(leg) < 900 for leg in legs)


FALLING = {
    "coulomb": 0.3,
    "viscous": 5e-3,
    "offset": 0.05,
    "break_away": 0.4,
    "stribeck_velocity": 0.3,
    "exponent": 1.5,
}


def _measured(shape: str, truth: dict[str, float], seed: int) -> Points:
    """A curve over speed in both directions, with noise of 0.1 % of the friction."""
    speed = np.geomspace(0.02, 10.0, 24)
    velocity = np.concatenate([speed, -speed])
    noise = 3e-4 * np.random.default_rng(seed).standard_normal(len(velocity))
    return Points(velocity, predict(shape, truth, velocity) + noise, np.full(len(velocity), 3e-4))


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_of_the_table_recovers_itself(shape: str) -> None:
    """Noise of 0.1 % of the friction: parameters within 4 standard errors, and 5 %."""
    points = _measured(shape, FALLING, 5)
    fit = fit_curve(points, shape)
    for name, quantity in fit.parameters.items():
        assert abs(quantity.value - FALLING[name]) < 4.5 * quantity.standard_error + 1e-9, name
        assert quantity.value == pytest.approx(FALLING[name], rel=0.05), name
    best = compare_shapes(points)[0]
    assert best.held_out_rms < 6e-4


def test_an_asymmetric_characteristic_needs_separate_directions() -> None:
    speed = np.geomspace(0.02, 0.2, 12)
    velocity = np.concatenate([speed, -speed])
    truth = {"coulomb": 20.4, "viscous": 203.0, "offset": -3.2}
    uneven = truth | {"direction_asymmetry.viscous": -37.0}
    points = Points(velocity, predict("linear", uneven, velocity), np.full(24, 0.05))
    fit = fit_curve(points, "linear", asymmetric=True)
    for name, value in uneven.items():
        assert fit.parameters[name].value == pytest.approx(value, rel=1e-4)
    assert fit_curve(points, "linear").rms > 100 * fit.rms


def test_presliding_finds_the_spring_and_the_mass(varied) -> None:
    """σ0 looks up to 5 % soft: at a tenth of the friction the bristle is already a little bent."""
    axis, recording = varied
    result = identify_presliding(recording.select("presliding"), axis.plant.bristle.coulomb)
    found = result.estimate
    assert found.valid, found.reason
    assert found["inertia"].value == pytest.approx(axis.plant.inertia, rel=0.04)
    assert found["stiffness"].value == pytest.approx(axis.plant.bristle.stiffness, rel=0.06)
    both = axis.plant.bristle.damping + axis.plant.viscous
    assert found["presliding_damping"].value == pytest.approx(both, rel=0.15)


def test_least_squares_is_biased_by_noise_and_box_jenkins_is_not(vertical) -> None:
    """What Figure 6.12 shows: without deviation variables LS is wrong by far, σ worst of all."""
    axis, recording = vertical
    comparison = identify_presliding(recording.select("presliding"), 0.33).comparison

    def stiffness(method: str) -> float:
        values = [fit.system.stiffness for fit in comparison[method] if fit.system]
        return float(np.median(values)) if values else np.inf

    truth = axis.plant.stiffness
    assert abs(stiffness("LS") / truth - 1) > 0.5
    assert abs(stiffness("IVdv") / truth - 1) < 0.1
    assert abs(stiffness("BJ") / truth - 1) < 0.05
    damping = [np.median([f.system.damping for f in comparison[m] if f.system]) for m in ("LSdv", "BJ")]
    assert damping[0] > 1.2 * damping[1]


def test_presliding_that_slides_is_not_valid(varied) -> None:
    axis, recording = varied
    found = identify_presliding(recording.select("presliding"), 0.1 * axis.plant.bristle.coulomb).estimate
    assert not found.valid
    assert "not presliding" in found.reason


@pytest.mark.parametrize(("inertia", "damping"), [(6.66e-4, 0.1), (6.66e-4, 0.5165), (2e-3, 2.0)])
def test_sampling_a_spring_mass_system_and_back(inertia: float, damping: float) -> None:
    """Under-, nearly critically and over-damped."""
    system = SpringMass(inertia, damping, 100.0)
    (_, a1, a2), (_, b1, b2) = system.coefficients(1e-3)
    back = from_difference(a1, a2, b1, b2, 1e-3)
    assert back is not None
    assert back.inertia == pytest.approx(inertia, rel=1e-4)
    assert back.damping == pytest.approx(damping, rel=1e-4)
    assert back.stiffness == pytest.approx(100.0, rel=1e-6)
    assert system.respond(np.ones(5000), 1e-3)[-1] == pytest.approx(0.01, rel=1e-6)


def test_dahls_curve_of_one_element_agrees_with_presliding(varied) -> None:
    axis, recording = varied
    found = identify_dahl(recording.select("dahl"), axis.plant.viscous).estimate
    assert found.valid, found.reason
    assert found["stiffness"].value == pytest.approx(axis.plant.bristle.stiffness, rel=0.10)
    assert found["offset"].value == pytest.approx(axis.plant.offset, rel=0.05)


def test_dahls_curve_of_six_elements_is_soft_and_says_so(vertical) -> None:
    found = identify_dahl(vertical[1].select("dahl")).estimate
    assert 15 < found["stiffness"].value < 55
    assert any("several" in note for note in found.notes)
    free = identify_dahl(vertical[1].select("dahl"), free_exponent=True).estimate
    assert 1.5 < free["exponent"].value < 6
    assert free.relative_error < 0.6 * found.relative_error


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_dahls_curve_solves_its_equation(exponent: float) -> None:
    """Slope by differences against (2.22), up and down."""
    path = np.concatenate([np.linspace(0, 0.02, 4001), np.linspace(0.02, 0.0, 4001)])
    friction = dahl_curve(path, 100.0, 0.3, exponent, 0.0)
    for k in (500, 2000, 5000, 7000):
        direction = np.sign(path[k + 1] - path[k])
        gap = 1 - friction[k] / 0.3 * direction
        slope = (friction[k + 1] - friction[k]) / (path[k + 1] - path[k])
        assert slope == pytest.approx(100.0 * abs(gap) ** exponent * np.sign(gap), rel=0.02, abs=0.05)


@pytest.mark.parametrize("rise", [-0.1, 0.0, 0.05])
def test_friction_falls_with_speed_or_does_not(rise: float) -> None:
    """Where it rises from rest, break-away is Coulomb friction, and the speed of its fall is not known."""
    points = _measured("gaussian", FALLING | {"break_away": 0.3 + rise}, 6)
    found = fit_curve(points, "gaussian")
    assert found.values["break_away"] >= found.values["coulomb"]
    assert found.parameters["stribeck_velocity"].identified == (rise > 0.0)
