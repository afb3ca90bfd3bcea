"""Which model an axis needs is judged by how its friction reverses, not by its stiffness at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autotune.identify.dahl import identify_dahl, judge_complexity, reversal_displacement
from autotune.identify.estimate import Quantity
from autotune.recordings.recording import Metadata
from autotune_sim.presets import preset
from tests.support.identification_programme import play, reversal_of

ACCELERATION = 0.2 * (2.0 * math.pi) ** 2
FRICTION = {"coulomb": Quantity(0.33, 0.002), "stiffness": Quantity(110.0, 1.0)}


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 8])
def test_the_displacement_is_that_of_the_plant_and_never_shorter(seed: int) -> None:
    """At most 15 % too long: the bent curve of (2.22) is not quite that of six elements."""
    axis = preset("edm-vertical", seed)
    found = identify_dahl(play(axis, seed, ("dahl",)).select("dahl"), axis.plant.viscous)
    travel, _ = reversal_of(axis.plant, ACCELERATION)
    assert found.reversal is not None
    assert travel <= found.reversal.value < 1.15 * travel


def test_stiffness_at_rest_alone_gives_a_lower_bound_and_says_so() -> None:
    fine = judge_complexity(FRICTION, 1e-3, ACCELERATION, Metadata())
    assert fine is not None
    assert fine.lower_bound
    assert "at least 3 mrad" in fine.text
    assert "record Dahl's curve" not in fine.text  # it would not change the verdict
    coarse = judge_complexity(FRICTION, 20e-3, ACCELERATION, Metadata())
    assert coarse is not None
    assert not coarse.lugre_needed
    assert "record Dahl's curve" in coarse.text


def test_the_reversal_is_told_by_its_acceleration_not_by_a_benchmark() -> None:
    """Data of somebody else know no benchmark."""
    judged = judge_complexity(FRICTION, 1e-5, 1.14, Metadata(motion_unit="m"))
    assert judged is not None
    assert "At a reversal with 1.1 m/s² the kinetic model is wrong by up to 0.66 N" in judged.text
    assert "benchmark" not in judged.text


def test_dahl_s_curve_turns_a_verdict_that_stiffness_at_rest_gets_wrong() -> None:
    judged = judge_complexity(FRICTION, 20e-3, ACCELERATION, Metadata(), Quantity(9.9e-3, 1e-4))
    assert judged is not None
    assert judged.lugre_needed
    assert judged.displacement.value == 9.9e-3
    assert "at least" not in judged.text


def test_friction_that_rises_from_rest_is_judged_by_its_level_while_moving() -> None:
    """F_s < F_c (2.2.2): the kinetic model is wrong by twice the larger."""
    judged = judge_complexity(
        {**FRICTION, "break_away": Quantity(0.3, 0.002)}, 1e-3, ACCELERATION, Metadata()
    )
    assert judged is not None
    assert judged.peak_difference == pytest.approx(0.66)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.0 + 1e-9, 2.5])
def test_the_displacement_is_the_integral_of_the_curve(exponent: float) -> None:
    """Followed in small steps from −F_s to where 2/e of F_s is left; 1e-3 for the steps."""
    sigma, force = 30.0, 0.3
    w = np.linspace(2.0, 2.0 / math.e, 20_001)
    expected = force / sigma * float(np.trapezoid(w**-exponent, -w))
    found = reversal_displacement(np.array([sigma, force, 0.05, exponent]))
    assert found == pytest.approx(expected, rel=1e-3)
