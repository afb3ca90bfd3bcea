"""What is proposed keeps its margins, holds, and says what limits it; what cannot be asked for is refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from autotune.control.gains import propose as proposing
from autotune.control.gains import search
from autotune.control.gains.judge import Task, judge
from autotune.control.gains.loop import Gains, cascade
from autotune.control.gains.members import ASSUMED, LEAST, MOST, TODAY, drawn, family
from autotune.control.gains.propose import propose
from autotune.control.gains.requirements import Corner, Requirements, corners_of, shortfall
from autotune.control.gains.sampled import Margins, margins
from autotune.control.gains.steps import step_sizes
from autotune.control.gains.words import advice
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import EFFECTS
from autotune.models.total_friction import stiffness_at_rest, total_friction
from tests.control.gains_axis import HOLDS, HUNTS, THESIS, TIMING, expected_settling, lugre, vertical


@pytest.fixture(autouse=True)
def _short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the search, on a quarter of the axes."""
    short = {"SHAPES": 16, "POPULATION": 16, "GENERATIONS": 4, "POLISHED": 8, "VALLEYS": 1}
    for name, value in short.items():
        monkeypatch.setattr(search, name, value)
    monkeypatch.setattr(search, "SOUGHT", (4, 31))


def task(model: DriveModel) -> Task:
    return Task(step_sizes(model, TIMING, 0.2), 1.26)


@pytest.mark.slow
@pytest.mark.parametrize("current", [THESIS, cascade(60.0, 0.15, 2.0)], ids=["pid", "p_pi"])
def test_a_proposal_keeps_its_margins_over_the_intervals_and_settles_on_axes_drawn_from_them(
    current: Gains,
) -> None:
    model = vertical()
    kin = family(model, TIMING)
    found = propose(kin, task(model), current)
    assert found.verdict is not None
    assert found.verdict.gains.structure == current.structure
    assert not found.verdict.hunting_members
    assert shortfall(corners_of(kin), found.verdict.gains, Requirements()) < 0.05
    assert found.verdict.settling < judge(current, kin, task(model)).settling * 1.5
    assert found.limited_by
    others = drawn(model, TIMING, 10, 2)
    expected = expected_settling(others, found.verdict.gains, task(model).steps.large)
    assert expected < 1.3 * found.verdict.large_settling


def test_the_axes_drawn_lie_in_the_intervals() -> None:
    model = vertical()
    timing = replace(TIMING, dead_time=1e-3, dead_time_error=1e-4)
    members = drawn(model, timing, 40, 1)
    part = np.array([one.model["inertia"] / model["inertia"] - 1.0 for one in members])
    assert np.all(np.abs(part) <= TODAY + 1e-12)  # two standard errors of an interval that is the least one
    assert 0.3 * TODAY < part.std() < 0.7 * TODAY
    assert len({one.timing.dead_time for one in members}) == 40
    ends = [one.what for one in family(model, timing).members if "dead time" in one.what]
    assert ends == ["dead time high"]
    friction = np.array([one.model["coulomb"] / model["coulomb"] - 1.0 for one in members])
    assert abs(np.corrcoef(part, friction)[0, 1]) < 0.5


def test_what_elements_trade_with_each_other_widens_no_interval() -> None:
    """Their own errors say little; the interval is that of the sum, where a fit has said it."""
    model = vertical()
    memory = next(one for one in model.effects if one.name == "reversal_memory")
    loose = {name: value.value for name, value in memory.values.items()}
    model = model.with_effect(EFFECTS["reversal_memory"].make(loose, loose))
    whole = stiffness_at_rest(model)
    told = replace(model, friction_error=0.002, stiffness_error=0.05 * whole)
    for one, end in ((model, 1.0 + MOST), (told, 1.1)):
        stiff = next(m.model for m in family(one, TIMING).members if m.what == "stiffness high")
        assert stiffness_at_rest(stiff) == pytest.approx(end * whole)
    rough = next(m.model for m in family(told, TIMING).members if m.what == "friction high")
    assert total_friction(rough).value == pytest.approx((1.0 + LEAST) * total_friction(model).value)


def test_whether_a_lag_is_a_dead_time_is_an_end_of_the_intervals() -> None:
    """What a run finds of it does not tell; the loop in question is the worse for a dead time."""
    lag = EFFECTS["torque_lag"].make({"time_constant": 2e-3}, {"time_constant": 1e-5})
    kin = family(vertical().with_effect(lag), TIMING)
    gains = Gains(30.0, 0.15, 800.0)
    found = {one.what: margins_of(one, gains) for one in corners_of(kin)}
    assert found["sliding, torque lag as dead time"].gain < found["sliding, nominal"].gain - 2.0
    known = EFFECTS["torque_lag"].make({"time_constant": 2e-3, "steepness": 0.8})
    members = family(vertical().with_effect(known), TIMING).members
    assert "torque lag as dead time" not in [one.what for one in members]


def margins_of(corner: Corner, gains: Gains) -> Margins:
    return margins(corner.axis, gains, corner.period, corner.response)


@pytest.mark.slow
def test_a_bandwidth_asked_for_is_met() -> None:
    model = vertical()
    found = propose(family(model, TIMING), task(model), THESIS, 30.0)
    assert found.verdict is not None
    assert found.verdict.bandwidth == pytest.approx(30.0, rel=0.05)


def test_a_bandwidth_that_no_margins_bear_is_told_with_what_to_do() -> None:
    model = vertical()
    found = propose(family(model, TIMING), task(model), THESIS, 200.0)
    assert found.verdict is None
    assert "no gains with a crossover of 200 Hz keep the requirements" in found.limited_by
    assert "Leave --bandwidth out" in found.limited_by


@pytest.mark.parametrize(("moves", "unit"), [("rad", "N m"), ("m", "N")])
def test_what_a_count_makes_is_told_in_the_axis_s_unit(moves: str, unit: str) -> None:
    model, coarse = replace(lugre(), motion_unit=moves), replace(TIMING, resolution=2.0 * math.pi / 500)
    steps = Task(step_sizes(model, coarse, 0.2), 1.26)
    found = propose(family(model, coarse), steps, THESIS, 30.0)
    assert re.search(rf"one count makes [\d.]+ {unit}, and 5 % of the torque limit", found.limited_by)


def test_a_bandwidth_beyond_the_cycle_or_a_resonance_is_refused() -> None:
    model = lugre()
    with pytest.raises(ConfigurationError, match="it can be 0"):
        propose(family(model, TIMING), task(model), THESIS, 400.0)
    coupled = {"compliance": 1.0 / 30.0, "load_inertia": 0.4, "load_friction": 0.4, "damping": 0.05}
    elastic = model.with_effect(EFFECTS["elastic_transmission"].make(coupled, {}))
    late = replace(TIMING, dead_time=2e-3, dead_time_error=2e-4)
    ends = {
        one.what: one.timing.dead_time for one in family(elastic, late).members if "dead time" in one.what
    }
    assert ends == pytest.approx({"dead time high": 2.4e-3, "dead time low": 1.6e-3})
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


def test_gains_as_good_as_the_proposal_are_said_to_be_so() -> None:
    model = vertical()
    kin = family(model, TIMING)
    verdict = judge(cascade(80.0, 0.2, 4.0), kin, task(model))
    proposal = proposing.Proposal(verdict, Requirements(), "something", 0.0)
    same = " ".join(advice(kin, verdict, proposal, "rad"))
    assert "Today's gains are robust and hardly slower" in same
    assert "velocity_gain 0.2 N m s/rad" in same
    weak = " ".join(advice(kin, judge(HUNTS, kin, task(model)), proposal, "rad"))
    assert "there is little to gain" not in weak
    assert "that is too little" in weak


def test_each_margin_that_is_told_is_the_least_of_all_axes() -> None:
    """Another axis comes nearest to -1 than has the least phase margin: 86° were told where one has 83°."""
    effect = EFFECTS["elastic_transmission"]
    model = lugre().with_effect(
        effect.make({"compliance": 2e-3, "load_inertia": 0.4, "load_friction": 0.3, "damping": 0.1})
    )
    kin = family(model, replace(TIMING, dead_time=1e-3, dead_time_error=1e-4))
    gains = Gains(10.0, 0.05, 400.0)
    said = judge(gains, kin, task(model)).worst["sticking"][0]
    every = [
        margins(one.axis, gains, one.period) for one in corners_of(kin) if one.what.startswith("sticking")
    ]
    nearest = min(every, key=lambda one: one.modulus)
    assert said.phase == pytest.approx(min(one.phase for one in every))
    assert said.phase < nearest.phase - 2.0
    assert said.modulus == pytest.approx(nearest.modulus)
    assert min(said.gain, said.gain_down) == pytest.approx(min(min(one.gain, one.gain_down) for one in every))


def test_holding_by_friction_alone_is_said() -> None:
    model = vertical()
    said = judge(HOLDS, family(model, TIMING), task(model))
    assert not said.hunts
    assert not said.nominal["sliding"].stable
    assert said.stick_slip_below > 0.0


def test_a_model_in_amperes_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="torque is in A"):
        family(replace(lugre(), torque_unit="A"), TIMING)


@pytest.mark.slow
def test_an_axis_that_friction_holds_gets_no_gains_but_the_reason() -> None:
    """Three cycles late, with a soft transmission: what keeps the margins cannot leave friction."""
    coupled = {"compliance": 1.0 / 41.5, "load_inertia": 0.46, "load_friction": 0.43, "damping": 0.05}
    values = {
        "inertia": 2.6e-4, "viscous": 4e-4, "coulomb": 0.166, "stiffness": 61.0, "micro_damping": 0.1,
        "offset": -0.02, "break_away": 0.224, "stribeck_velocity": 0.17,
    }  # fmt: skip
    model = base_model(values, {name: 0.01 * abs(value) for name, value in values.items()})
    model = model.with_effect(EFFECTS["elastic_transmission"].make(coupled, {"compliance": 1e-3}))
    late = replace(TIMING, dead_time=3e-3, torque_limit=1.1)
    found = propose(family(model, late), Task(step_sizes(model, late, 0.054), 0.54), Gains(1.0, 1.0, 1.0))
    assert found.verdict is None
    assert "friction holds the axis" in found.limited_by or "hunts" in found.limited_by
