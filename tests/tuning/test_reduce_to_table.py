"""A drive with a table over velocity: what is planned for it by day and by night, and what is not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from autotune.control.reduction import DrivePart
from autotune.control.velocity_table import TableBlock, is_point
from autotune.tuning.findings import Findings
from autotune.tuning.session import Session
from autotune.tuning.stage_reduce import plan_commit, plan_retune
from tests.control.test_reduction import AXIS, PROVED, STIFF
from tests.control.test_velocity_table import BLOCK, as_measured, held

INERTIA = {"feedforward.enabled": 0.0, "feedforward.inertia": 0.0}


def session(block: TableBlock) -> Session:
    told = held(block)
    loop = SimpleNamespace(read_parameters=lambda: told)
    return cast(Session, SimpleNamespace(loop=loop, axis=AXIS, limits=AXIS.limits, controller=STIFF))


def findings() -> Any:
    best = SimpleNamespace(measured=as_measured(PROVED))
    return SimpleNamespace(
        need_proposed=lambda: PROVED, adapted=SimpleNamespace(best=best), planned=None, proposed_model=None
    )


def in_drive(block: TableBlock) -> dict[str, float]:
    return {name: value for name, value in held(block).items() if name.startswith("feedforward.")}


def test_a_retune_at_night_plays_the_table_that_is_planned() -> None:
    found = findings()
    law = plan_retune(session(BLOCK), cast(Findings, found), INERTIA | in_drive(BLOCK))
    assert isinstance(law, DrivePart)
    values = dict(found.planned.values)
    assert values.pop("feedforward.enabled") == 1.0
    assert values.pop("feedforward.inertia") == pytest.approx(PROVED.inertia)
    assert len(values) == 2 * BLOCK.points
    assert all(map(is_point, values))
    torque = law.step(0.0, 1e9, 0.0, None)
    assert torque == pytest.approx(values[f"feedforward.friction_table.torque.{BLOCK.points - 1}"])


def test_what_overflows_is_not_planned_and_said() -> None:
    small = replace(BLOCK, largest_torque=0.2)
    only_a_table = {"feedforward.enabled": 0.0} | in_drive(small)
    found = cast(Findings, findings())
    assert plan_retune(session(small), found, only_a_table) is None
    assert (
        plan_retune(session(small), found, INERTIA | in_drive(small)) is None
    )  # a host would have to play friction
    plan = plan_commit(session(small), found, only_a_table)
    assert not plan.values
    assert "overflows" in plan.why
