"""What of ripple goes into a plan: kept as it was where none is planned, refused where the commutation has moved."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from autotune.core.errors import ConfigurationError
from autotune.core.ripple_parameters import GAIN, alignment_of, moved, without_table
from autotune.tuning.findings import Findings, PlannedValues
from autotune.tuning.preparation import acting_feedforward, own_feedforward
from autotune.tuning.session import Session
from autotune.tuning.stage_prove import ENABLED
from autotune.tuning.stage_reduce import Plan, same_commutation, with_what_acted
from autotune.tuning.stage_ripple import RipplePlan
from autotune.tuning.summary import in_drive

ZERO = {"alignment.motor_position.sources.0.offset": 12.0, "alignment.motor.Kv": 82.7}


def session(now: dict[str, float]) -> Session:
    loop = SimpleNamespace(read_parameters=lambda names: {name: now[name] for name in names if name in now})
    return cast(Session, SimpleNamespace(loop=loop))


def test_a_plan_of_an_earlier_run_is_refused_where_the_commutation_moved() -> None:
    planned = PlannedValues({GAIN: 1e-4, "feedforward.coulomb": 0.2}, alignment=ZERO)
    same_commutation(session(ZERO), planned)
    shifted = {**ZERO, "alignment.motor_position.sources.0.offset": 13.0}
    with pytest.raises(ConfigurationError, match=r"sources\.0\.offset was 12 and is 13.*nothing was written"):
        same_commutation(session(shifted), planned)
    with pytest.raises(ConfigurationError, match="not there any more"):
        same_commutation(session({"alignment.motor.Kv": 82.7}), planned)
    same_commutation(session(shifted), PlannedValues({"feedforward.coulomb": 0.2}))
    same_commutation(session(shifted), None)


def test_ripple_that_the_drive_held_before_acts_again_where_none_is_planned() -> None:
    plan = with_what_acted(Plan({"feedforward.coulomb": 0.2}), {GAIN: 0.5, "limit.torque": 1.0})
    assert plan.values == {"feedforward.coulomb": 0.2, GAIN: 0.5}
    assert with_what_acted(Plan({}), {GAIN: 0.5}).values == {}
    assert with_what_acted(Plan({GAIN: 0.1}), {GAIN: 0.5}).values == {GAIN: 0.1}


@pytest.mark.parametrize(
    "off", [{ENABLED: 1.0}, {"feedforward.inertia": 6.7e-4, "feedforward.viscous": 4e-3}]
)
def test_friction_that_the_drive_held_before_acts_again_where_only_ripple_is_planned(
    off: dict[str, float],
) -> None:
    """Else the run would store it switched off."""
    ripple = cast(RipplePlan, SimpleNamespace())
    plan = with_what_acted(Plan({GAIN: 0.1}, ripple=ripple), {**off, "limit.torque": 1.0})
    assert plan.values == {GAIN: 0.1, **off}
    assert plan.only_ripple
    both = Plan({GAIN: 0.1, "feedforward.coulomb": 0.2, ENABLED: 1.0}, ripple=ripple)
    assert with_what_acted(both, off).values == both.values
    assert not with_what_acted(both, off).only_ripple


@pytest.mark.parametrize(
    ("parameters", "acting"),
    [
        ({}, ()),
        ({ENABLED: 0.0, "feedforward.coulomb": 0.2, GAIN: 0.0}, ()),
        ({ENABLED: 1.0, "feedforward.coulomb": 0.2, "feedforward.stiffness": 0.0}, ("coulomb",)),
        (
            {"feedforward.inertia": 6.7e-4, "feedforward.viscous": 0.0, GAIN: 0.5},
            ("inertia", "torque_ripple"),
        ),
        ({ENABLED: 0.0, "feedforward.coulomb": 0.2, GAIN: 0.5}, ("torque_ripple",)),
    ],
)
def test_what_acts_in_a_drive_is_named(parameters: dict[str, float], acting: tuple[str, ...]) -> None:
    assert acting_feedforward(parameters) == acting
    assert in_drive(Findings(), kept=False, acting=acting)["keeps"] == [*acting]


def test_a_run_measures_the_axis_without_the_ripple_that_its_drive_adds() -> None:
    assert own_feedforward({"feedforward.enabled": 1.0, GAIN: 0.5, "feedforward.coulomb": 0.2}) == {
        "feedforward.enabled": 1.0,
        GAIN: 0.5,
    }
    assert own_feedforward({"feedforward.coulomb": 0.2, GAIN: 0.0}) == {"feedforward.coulomb": 0.2}


def test_settings_that_move_the_zero_are_told_from_the_rest() -> None:
    values = {**ZERO, "feedforward.ripple.table.3": 4.0, GAIN: 0.1}
    assert alignment_of(values) == ZERO
    assert without_table(values) == {**ZERO, GAIN: 0.1}
    assert moved(ZERO, ZERO) == []
