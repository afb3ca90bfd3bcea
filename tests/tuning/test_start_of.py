"""What identification found becomes the start of the adaptation as it was found."""

from __future__ import annotations

import math
from types import MappingProxyType

import pytest

from autotune.identify.estimate import Estimate, Quantity
from autotune.identify.run import Identification
from autotune.tuning.stage_identify import start_of

FOUND = {"inertia": 6.66e-4, "viscous": 4e-3, "coulomb": 0.346, "stiffness": 101.0, "micro_damping": 0.112,
         "offset": 0.08, "break_away": 0.3}  # fmt: skip


def identified(stribeck_velocity: Quantity | None, presliding: float | None = None) -> Identification:
    """As in Table 6.2: F_s below F_c."""
    parameters = {name: Quantity(value, 0.01 * value) for name, value in FOUND.items()}
    if stribeck_velocity is not None:
        parameters["stribeck_velocity"] = stribeck_velocity
    joint = Estimate("joint", MappingProxyType(parameters))
    dahl = Estimate("dahl", MappingProxyType({"stiffness": Quantity(18.0, 1.0)}))
    estimates = {"dahl": dahl}
    if presliding is not None:
        estimates["presliding"] = Estimate(
            "presliding", MappingProxyType({"stiffness": Quantity(presliding, 1.0)})
        )
    return Identification(MappingProxyType(estimates), joint, None, None)


def test_friction_that_rises_from_rest_stays_so() -> None:
    start = start_of(identified(Quantity(0.285, 0.02))).parameters
    assert start.break_away == 0.3
    assert start.stribeck_velocity == 0.285


@pytest.mark.parametrize("velocity", [None, Quantity(0.285, 1.0, identified=False)])
def test_without_a_stribeck_velocity_there_is_one_level(velocity: Quantity | None) -> None:
    start = start_of(identified(velocity)).parameters
    assert start.break_away == start.coulomb == 0.346


def test_the_damping_that_is_started_from_belongs_to_the_stiffness_that_is_started_from() -> None:
    """σ1 was identified beside presliding's 101 N m/rad; the start takes Dahl's 18, with the same relative damping.

    With σ1 in proportion to σ0 the laws end at 37 N m/rad on the thesis's axis, where it has 31.3 ± 15 %.
    """
    start = start_of(identified(None)).parameters
    assert start.stiffness == 18.0
    assert start.micro_damping == pytest.approx(0.112 * math.sqrt(18.0 / 101.0))


def test_between_both_stiffnesses_the_damping_keeps_the_ratio_that_is_right_where_the_laws_end() -> None:
    """They keep σ1/σ0 on their way down to about Dahl's stiffness; 36 N m/rad instead of 34.7 without this."""
    start = start_of(identified(None, 101.0)).parameters
    assert start.stiffness == pytest.approx(math.sqrt(18.0 * 101.0))
    assert start.micro_damping / start.stiffness == pytest.approx(0.112 * math.sqrt(18.0 / 101.0) / 18.0)
