"""Verdicts on planted effects, nothing, and an alien; one effect added and confirmed on unseen data."""

import math

import pytest

import autotune
from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.diagnosis.compare import REGIMES, compare
from autotune.diagnosis.fitting import add_effect
from autotune.diagnosis.verdict import diagnose
from tests.support.axes import ALIENS, plain_axis
from tests.support.diagnosis_programme import play, programme

SPRING = 0.004


@pytest.mark.slow(6)
def test_a_spring_is_named_and_confirmed(recorded, nominal) -> None:
    found = diagnose([recorded(41, spring=SPRING)], nominal)
    assert (found.verdict, found.effects, found.confidence) == ("named", ("spring",), "confirmed")
    assert found.twin
    best = max(found.candidates, key=lambda c: c.gain)
    assert best.effect == "spring"
    assert best.accepted
    assert 0.5 < best.gain < 1.0
    assert 0.5 < found.where["position"] <= 1.0
    assert 0.6 * found.noise_floor_rms < found.error_test < 1.4 * found.noise_floor_rms


@pytest.mark.slow
@pytest.mark.long
def test_an_effect_that_took_a_wrong_shape_alone_is_begun_anew(recorded, nominal) -> None:
    """While the Stribeck effect was missing, a wave over the travel stood for the tight spot."""
    found = diagnose([recorded(37_024, stribeck=0.04, position_dependent_friction=0.15)], nominal)
    assert (found.verdict, set(found.effects)) == ("named", {"stribeck", "position_dependent_friction"})


@pytest.mark.slow
def test_nothing_planted_nothing_named(recorded, nominal) -> None:
    found = diagnose([recorded(42)], nominal)
    assert (found.verdict, found.effects, found.confidence) == ("none", (), None)


@pytest.mark.slow(5)
def test_an_alien_is_unknown(nominal) -> None:
    what = programme(("sine", "scans", "points"))  # all that this oil depends on: place and speed
    found = diagnose([play(plain_axis(43), 43, what, ALIENS["uneven_oil"]())], nominal)
    assert (found.verdict, found.effects) == ("unknown", ())
    assert found.next_experiment


@pytest.mark.slow
def test_adding_lowers_the_error_on_unseen_data_to_the_floor(recorded, nominal) -> None:
    recording = recorded(41, spring=SPRING)
    before = compare([recording], nominal)
    added = add_effect("spring", [recording], nominal, "2024-05-01", "bench")
    after = compare([recording], added.model)
    assert added.error_after < 0.7 * added.error_before
    assert 0.7 * added.noise_floor_rms < added.error_after < 1.3 * added.noise_floor_rms
    assert added.model["spring.stiffness"] == pytest.approx(SPRING, rel=0.05)
    assert after.error_rms < 0.5 * before.error_rms
    assert added.model.history[-1].action == "+ spring"


def test_comparison_tells_size_floor_and_place(recorded, nominal) -> None:
    result = compare([recorded(41, spring=SPRING)], nominal)
    assert 0.0 < result.noise_floor_rms < result.error_rms
    assert 0.5 < result.explained < 1.0
    assert set(result.regimes) == set(REGIMES)
    assert all(0.0 < value < 0.2 for value in result.regimes.values())
    assert 0.0 < result.worst[0].share < 1.0
    assert math.isfinite(result.position_rms)


def test_a_model_of_another_axis_is_refused(recorded, nominal) -> None:
    recording = recorded(41, spring=SPRING)
    with pytest.raises(ConfigurationError, match="autotune model fit"):
        compare([recording.with_metadata(motion_unit="m")], nominal)


def test_a_wrong_sign_of_the_torque_is_said(recorded, nominal) -> None:
    recording = recorded(41, spring=SPRING)
    from autotune.recordings.recording import Recording

    flipped = {n: -v if n.startswith("torque") else v for n, v in recording.floats.items()}
    wrong = Recording.from_columns(flipped, recording.metadata, recording.experiment, recording.repeat)
    with pytest.raises(NotEnoughExcitation, match="sign"):
        diagnose([wrong], nominal)


def test_repeats_at_other_places_do_not_hide_what_belongs_to_the_place() -> None:
    """Two legs that mirror each other: the imbalance comes again with the other sign, and "none" was said of it."""
    played = autotune.simulate("sim://lugre?seed=3&effect=gravity_imbalance:0.05", programme="high-speed")
    recording = played.with_metadata(axis="", fingerprint="")
    found = autotune.diagnose([recording], autotune.fit([recording]).model)
    assert (found.verdict, tuple(found.effects)) == ("named", ("gravity_imbalance",))
