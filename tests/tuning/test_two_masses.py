"""A load that does not go with its motor is refused; one mass, and a transmission that was named, are not."""

from __future__ import annotations

import math
from types import MappingProxyType

import pytest

from autotune.identify.estimate import Estimate, Quantity
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import EFFECTS
from autotune.tuning.two_masses import refuse_loose_load, refuse_resonance, refuse_two_masses
from autotune.tuning.unfit_axes import NotTunable
from tests.identify.test_high_speed import INERTIA, LOAD, passes
from tests.support.refusals import refusal


def estimate(inertia: float, error: float, *, valid: bool = True) -> Estimate:
    return Estimate("test", MappingProxyType({"inertia": Quantity(inertia, error)}), valid)


def test_a_resonance_about_the_bandwidth_is_refused_in_words() -> None:
    """Values of a simulated axis: 0.74 g m² of which 60 % are the motor's, a load at 34 Hz."""
    with pytest.raises(NotTunable, match=r"resonates about the position loop's bandwidth \(about 60 Hz\)"):
        refuse_two_masses(estimate(1.6e-4, 1.3e-5), estimate(2.1e-4, 3e-6), estimate(4.26e-4, 3e-6), (), 60.0)
    with pytest.raises(NotTunable, match="bandwidth, or there is play"):
        refuse_two_masses(estimate(1.6e-4, 1.3e-5), None, estimate(4.26e-4, 3e-6), ("torque_ripple",), None)


@pytest.mark.parametrize(
    ("whole", "small", "named"),
    [
        (estimate(6.78e-4, 3e-6), estimate(6.76e-4, 4e-6), ()),
        (estimate(6.77e-4, 3e-6), estimate(8.09e-4, 6e-6), ()),  # a lag of the torque looks like inertia
        (estimate(1.6e-4, 1e-5), estimate(4.3e-4, 3e-6), ("backlash",)),
        (estimate(1.6e-4, 1e-5), estimate(4.3e-4, 3e-6), ("elastic_transmission",)),
        (estimate(1.6e-4, 1e-5), estimate(4.3e-4, 3e-6, valid=False), ()),
        (estimate(1.6e-4, 6e-5), estimate(4.3e-4, 3e-6), ()),  # hardly known
        (estimate(1.6e-4, 1e-5), None, ()),
    ],
)
def test_what_is_one_mass_or_explained_is_not(
    whole: Estimate, small: Estimate | None, named: tuple[str, ...]
) -> None:
    assert refusal(lambda: refuse_two_masses(whole, whole, small, named, 60.0)) == ""


def test_a_fit_that_went_astray_is_no_second_mass() -> None:
    """edm-vertical?seed=24532: the joint fit ended at 0.23 g m², acceleration alone at the true 0.556."""
    joint, fast, small = estimate(2.3e-4, 1.3e-5), estimate(5.556e-4, 8e-7), estimate(5.52e-4, 5.4e-6)
    assert refusal(lambda: refuse_two_masses(joint, fast, small, (), 60.0)) == ""


def test_a_load_that_resonates_below_the_motor_s_bandwidth_is_refused_whatever_the_fits_say() -> None:
    recording = passes(0.1, 5, LOAD * INERTIA * (2.0 * math.pi * 45.0) ** 2)
    with pytest.raises(NotTunable, match=r"at 4\d Hz the motor stands still and the load swings"):
        refuse_loose_load(recording, KP)
    assert refusal(lambda: refuse_loose_load(recording, 0.4 * KP)) == "", (
        "a bandwidth of 39 Hz for the motor alone"
    )
    assert refusal(lambda: refuse_loose_load(recording, None)) == ""


def test_one_mass_has_no_loose_load() -> None:
    assert refusal(lambda: refuse_loose_load(passes(0.1, 5), KP)) == ""


BASE = {
    "inertia": 7e-4,
    "viscous": 4e-3,
    "coulomb": 0.33,
    "stiffness": 100.0,
    "micro_damping": 0.1,
    "offset": 0.0,
}
KP = 60.0


def soft(compliance: float) -> DriveModel:
    """A load of two fifths behind a spring."""
    spring = {"compliance": compliance, "load_inertia": 0.4, "load_friction": 0.4, "damping": 0.05}
    return base_model(BASE).with_effect(EFFECTS["elastic_transmission"].make(spring))


def test_a_named_transmission_that_resonates_about_the_bandwidth_is_refused_with_both_frequencies() -> None:
    """1/(0.24·60·compliance) is the square of resonance over bandwidth: 1.2 times here."""
    with pytest.raises(NotTunable, match="at 56 Hz, about the position loop's bandwidth of 47 Hz"):
        refuse_resonance(soft(1.0 / (0.24 * KP * 1.2**2)), KP)


def test_a_stiffer_one_or_none_or_a_loop_that_nobody_knows_is_not() -> None:
    for model, kp in (
        (soft(0.02), KP),
        (soft(0.0), KP),
        (soft(0.1), None),
        (base_model(BASE), KP),
        (None, KP),
    ):
        assert refusal(lambda model=model, kp=kp: refuse_resonance(model, kp)) == ""
