"""The friction of a model is stated as a whole, wherever its parts were fitted."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.models.drive_model import DriveModel, base_model
from autotune.models.effect import Value
from autotune.models.model_file import model_text, read_model, write_model
from autotune.models.table import EFFECTS
from autotune.models.total_friction import (
    stiffness_at_rest,
    stiffness_parts,
    stiffness_spread,
    total_friction,
    total_in_words,
)

BASE = {"inertia": 6.66e-4, "viscous": 0.0, "coulomb": 0.0093, "stiffness": 50.0, "micro_damping": 0.05,
        "offset": 0.048}  # fmt: skip
ELEMENTS = {"displacement_1": 2e-3, "torque_1": 0.12, "displacement_2": 0.02, "torque_2": 0.2}
ERRORS = {"torque_1": 0.006, "torque_2": 0.008}


def moved(errors: dict[str, float] | None = None) -> DriveModel:
    """A model whose friction went into the elements, as a run leaves it."""
    memory = EFFECTS["reversal_memory"].make(ELEMENTS, ERRORS if errors is None else errors)
    return base_model(BASE, {"coulomb": 0.0055}).with_effect(memory)


def test_the_total_is_what_the_model_needs_at_a_steady_speed() -> None:
    model, period = moved(), 1e-3
    velocity = np.full(2000, 0.5)
    torque = model.torque(0.5 * period * np.arange(2000), velocity, np.zeros(2000), period)
    assert total_friction(model).value == pytest.approx(torque[-1] - BASE["offset"], rel=1e-6)


def test_its_standard_error_takes_in_those_of_the_parts() -> None:
    assert total_friction(moved()).standard_error == pytest.approx(math.hypot(0.0055, 0.006, 0.008))
    assert total_friction(moved({"torque_1": 0.006})).standard_error is None


def test_a_fit_that_knows_what_the_parts_have_in_common_says_so_until_something_is_changed() -> None:
    fitted = replace(moved(), friction_error=0.002)
    assert total_friction(fitted).standard_error == 0.002
    assert "0.3293 N m (± 0.002), 97 % of it" in total_in_words(fitted)
    for changed in (fitted.with_values({"coulomb": 0.02}), fitted.without_effect("reversal_memory")):
        assert changed.friction_error is None
    for kept in (fitted.with_values({"inertia": 1e-3}), fitted.without_effect("torque_ripple")):
        assert kept.friction_error == 0.002
    assert fitted == moved()


def test_the_stiffness_at_rest_has_the_error_of_a_sum() -> None:
    model = moved()
    parts = stiffness_parts(model)
    assert sum(
        slope * model[name] for name, slope in parts.items() if "displacement" not in name
    ) == pytest.approx(stiffness_at_rest(model))
    for name, slope in parts.items():
        step = 1e-4 * model[name]
        changed = stiffness_at_rest(model.with_values({name: model[name] + step})) - stiffness_at_rest(model)
        assert changed == pytest.approx(slope * step, rel=1e-3)
    assert stiffness_spread(model) is None  # no error of a displacement is known
    assert stiffness_spread(replace(model, stiffness_error=3.0)) == 3.0


def test_errors_of_sums_are_in_the_model_file(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    write_model(replace(moved(), friction_error=0.002, stiffness_error=3.0), path)
    assert read_model(path).friction_error == 0.002
    assert read_model(path).stiffness_error == 3.0
    write_model(moved(), path)
    assert "standard_errors" not in path.read_text(encoding="utf-8")


def test_without_elements_the_total_is_coulomb_and_nothing_is_said() -> None:
    plain = base_model(BASE, {"coulomb": 0.0055})
    assert total_friction(plain) == Value(0.0093, 0.0055)
    assert total_in_words(plain) == ""
    assert "total friction" not in model_text(plain)


def test_the_model_file_says_it_beside_coulomb_and_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    write_model(moved(), path)
    assert "total friction 0.3293 N m (± 0.011 at most), 97 % of it in the elements" in path.read_text(
        "utf-8"
    )
    assert read_model(path).parameters == moved().parameters


def test_a_bristle_without_friction_adds_no_stiffness_at_rest() -> None:
    model = base_model({**BASE, "coulomb": 0.3})
    assert stiffness_at_rest(model) == BASE["stiffness"]
    assert stiffness_at_rest(base_model({**BASE, "coulomb": 0.0})) == 0.0
