"""Tables: what they hold is what the model says, and what they cannot hold is told with its cost."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import ConfigurationError
from autotune.export.request import Motion, Request
from autotune.export.tables import position_table, sliding_torque
from autotune.export.targets import export
from autotune.models.drive_model import base_model
from autotune.models.table import EFFECTS

from .support import NUMBERS, H, everything, proved, with_effects, write


def rows_of(path: Path) -> tuple[list[str], np.ndarray]:
    """Column names and numbers of a table, comments left out."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.reader(lines))
    return rows[0], np.array(rows[1:], dtype=float)


def test_sliding_friction_is_the_steady_state_of_the_model() -> None:
    velocity = np.array([-5.0, -0.5, 0.5, 5.0])
    torque = sliding_torque(with_effects("stribeck", "reversal_memory"), velocity)
    level = 0.30 + 0.08 * np.exp(-((np.abs(velocity) / 0.3) ** 1.3)) + 0.10
    assert torque == pytest.approx(np.sign(velocity) * level + 4.13e-3 * velocity + 0.048, abs=1e-9)


def test_csv_names_units_and_holds_velocity_and_position(tmp_path: Path) -> None:
    model = with_effects("gravity_imbalance", "stribeck").without_effect("gravity_imbalance")
    model = model.with_effect(EFFECTS["torque_ripple"].make({"order_1": 12, "sin_1": 0.02, "cos_1": 0.01}))
    paths = write(Request(model, "a model", H, speed=20.0), "csv", tmp_path)
    names, rows = rows_of(paths["autotune_ff_velocity.csv"])
    assert names == ["velocity [rad/s]", "torque [N m]"]
    assert rows[:, 0].max() == 20.0
    assert np.all(np.diff(rows[:, 0]) > 0.0)
    assert np.interp(-20.0, *rows.T) == pytest.approx(-0.30 - 20 * 4.13e-3 + 0.048, abs=1e-6)
    names, rows = rows_of(paths["autotune_ff_position.csv"])
    assert names == ["position [rad]", "torque [N m]"]
    place = np.linspace(0.0, 2 * math.pi, 999)
    wave = 0.02 * np.sin(12 * place) + 0.01 * np.cos(12 * place)
    assert np.interp(place, *rows.T) == pytest.approx(wave, abs=0.025 * 0.0224)  # 2 % and the end points
    constants = paths["autotune_ff_constants.csv"].read_text()
    assert "inertia,0.000666,kg m^2" in constants


def test_a_linear_axis_has_a_table_of_its_travel() -> None:
    ripple = {"order_1": 25.0, "sin_1": 1.0, "cos_1": 0.0, "order_2": 50.0, "sin_2": 0.0, "cos_2": 0.5}
    model = base_model(NUMBERS, motion_unit="m").with_effect(EFFECTS["torque_ripple"].make(ripple))
    table, lost = position_table(Request(model, "a model", H, travel=(-0.1, 0.3)))
    assert table is not None
    assert lost == ()
    assert (table.position[0], table.position[-1]) == (-0.1, 0.3)
    place = np.linspace(-0.1, 0.3, 997)
    wave = np.sin(2 * np.pi * 25 * place) + 0.5 * np.cos(2 * np.pi * 50 * place)
    assert np.interp(place, table.position, table.torque) == pytest.approx(wave, abs=0.025)


def test_what_tables_cannot_hold_is_told_with_its_cost() -> None:
    made = export(Request(everything(), "a model", H), "csv")
    told = {one.effect: one for one in made.lost}
    assert set(told) == {
        "torque_ripple", "gravity_imbalance", "spring", "position_dependent_friction", "presliding",
    }  # fmt: skip
    assert "not all of it repeats" in told["torque_ripple"].why  # 24.5 waves a turn
    assert all(one.cost is not None and one.cost > 1e-4 for one in made.lost)


def test_the_cost_of_presliding_is_that_of_a_motion_that_reverses() -> None:
    small = Request(with_effects(), "a model", H, motion=Motion(0.01, 1.0))
    large = Request(with_effects(), "a model", H, motion=Motion(10.0, 1.0))
    costs = [export(one, "csv").lost[0].cost or 0.0 for one in (small, large)]
    assert costs[0] > 0.1 > costs[1] > 0.0  # of 0.3 N m of friction: nearly all, nearly nothing


def test_a_wave_that_a_table_cannot_hold_is_refused() -> None:
    fine = EFFECTS["torque_ripple"].make({"order_1": 5000, "sin_1": 0.02, "cos_1": 0.01})
    with pytest.raises(ConfigurationError, match=r"overflows: with 16384 points from 0 to 6.28319 rad"):
        export(Request(base_model(NUMBERS).with_effect(fine), "a model", H), "csv")


def entries(text: str) -> dict[str, int]:
    """A compensation list as keys and whole numbers; everything else but comments is an error."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    found = [re.fullmatch(r"(frict_comp\.[a-z_]+(?:\[\d+\]\.(?:in|out))?) +(-?\d+)", line) for line in lines]
    assert all(found), lines
    return {one[1]: int(one[2]) for one in found if one}


@pytest.mark.parametrize(("lead", "scale"), [(None, 180e3 / math.pi), (10.0, 1e4 / (2 * math.pi))])
def test_the_twincat_list_is_in_its_manuals_units(tmp_path: Path, lead: float | None, scale: float) -> None:
    request = Request(with_effects("stribeck"), "a model", H, rated_torque=0.64, lead=lead, speed=20.0)
    listed = entries(write(request, "twincat-table", tmp_path)["autotune_ff.frict_comp"].read_text())
    assert listed["frict_comp.mode"] == 3
    count = listed["frict_comp.table_entries"]
    assert count == 20
    velocity = [listed[f"frict_comp.table[{i}].in"] for i in range(count)]
    assert velocity[0] == 0
    assert velocity == sorted(set(velocity))
    assert velocity[-1] == pytest.approx(20.0 * scale, rel=1e-6)
    permille = listed["frict_comp.table[19].out"] * listed["frict_comp.scaling_factor"] / 1000
    assert permille == pytest.approx(1e3 * (0.30 + 20 * 4.13e-3) / 0.64, abs=0.06)
    assert 0 <= listed["frict_comp.position_delay"] <= 10


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({}, "--rated-torque"),
        ({"rated_torque": 1e-3}, "overflows: friction is"),
        ({"rated_torque": 1.0, "speed": 1e9}, "overflows: velocity"),
        ({"rated_torque": 1.0, "speed": 1e-6}, "not distinct"),
    ],
)
def test_a_list_that_cannot_be_is_refused(options: dict[str, float], told: str) -> None:
    with pytest.raises(ConfigurationError, match=told):
        export(Request(proved(3), "a model", H, **options), "twincat-table")


def test_a_model_of_which_nothing_remains_is_refused() -> None:
    smooth = base_model(NUMBERS | {"coulomb": 0.0, "viscous": 0.0, "offset": 0.0})
    with pytest.raises(ConfigurationError, match="no friction"):
        export(Request(smooth, "a model", H, rated_torque=1.0), "twincat-table")


def test_the_twincat_list_says_what_it_leaves_out() -> None:
    made = export(Request(everything(), "a model", H, rated_torque=0.64), "twincat-table")
    told = {one.effect for one in made.lost}
    assert told >= {"torque_ripple", "direction_asymmetry", "spring", "offset", "presliding", "inertia"}
