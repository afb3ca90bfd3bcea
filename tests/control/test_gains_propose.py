"""What is proposed keeps its margins, holds, and says what limits it; what cannot be asked for is refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from autotune.control.gains import propose as proposing
from autotune.control.gains.judge import Task, judge
from autotune.control.gains.loop import Gains, cascade
from autotune.control.gains.members import ASSUMED, family
from autotune.control.gains.propose import Requirements, corners_of, propose, shortfall
from autotune.control.gains.steps import step_sizes
from autotune.control.gains.words import advice
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.models.table import EFFECTS
from tests.control.gains_axis import HOLDS, HUNTS, THESIS, TIMING, lugre, vertical


@pytest.fixture(autouse=True)
def _short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proposing, "POPULATION", 6)
    monkeypatch.setattr(proposing, "GENERATIONS", 4)


def task(model: DriveModel) -> Task:
    return Task(step_sizes(model, TIMING, 0.2), 1.26)


@pytest.mark.parametrize("current", [THESIS, cascade(60.0, 0.15, 2.0)], ids=["pid", "p_pi"])
def test_a_proposal_keeps_its_margins_over_the_intervals(current: Gains) -> None:
    model = vertical()
    kin = family(model, TIMING)
    found = propose(kin, task(model), current)
    assert found.verdict is not None
    assert found.verdict.gains.structure == current.structure
    assert not found.verdict.hunting_members
    assert shortfall(corners_of(kin), found.verdict.gains, Requirements()) < 0.05
    assert found.verdict.settling < judge(current, kin, task(model)).settling * 1.5
    assert found.limited_by


def test_a_bandwidth_asked_for_is_met() -> None:
    model = vertical()
    found = propose(family(model, TIMING), task(model), THESIS, 30.0)
    assert found.verdict is not None
    assert found.verdict.bandwidth == pytest.approx(30.0, rel=0.05)


def test_a_bandwidth_beyond_the_cycle_or_a_resonance_is_refused() -> None:
    model = lugre()
    with pytest.raises(ConfigurationError, match="it can be 0"):
        propose(family(model, TIMING), task(model), THESIS, 400.0)
    coupled = {"compliance": 1.0 / 30.0, "load_inertia": 0.4, "load_friction": 0.4, "damping": 0.05}
    elastic = model.with_effect(EFFECTS["elastic_transmission"].make(coupled, {}))
    with pytest.raises(ConfigurationError, match="lies below the bandwidth"):
        propose(family(elastic, TIMING), task(elastic), THESIS, 200.0)


def test_the_verdict_in_words_names_what_was_assumed() -> None:
    model = vertical()
    bare = model.with_values({name: model[name] for name in ("inertia", "micro_damping", "viscous")})
    kin = family(bare, TIMING)
    assert set(kin.assumed) == {"inertia", "damping"}
    low = next(one for one in kin.members if one.what == "inertia low")
    assert low.model["inertia"] == pytest.approx((1.0 - ASSUMED) * model["inertia"])
    current = judge(HUNTS, kin, task(model))
    proposal = proposing.Proposal(None, Requirements(), "something", 0.0)
    said = " ".join(advice(kin, current, proposal, "rad"))
    assert "no standard error for inertia, damping" in said
    assert "hunts after a step" in said
    assert "Hz" in said


def test_holding_by_friction_alone_is_said() -> None:
    model = vertical()
    said = judge(HOLDS, family(model, TIMING), task(model))
    assert not said.hunts
    assert not said.nominal["sliding"].stable
    assert said.stick_slip_below > 0.0


def test_a_model_in_amperes_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="torque is in A"):
        family(replace(lugre(), torque_unit="A"), TIMING)
