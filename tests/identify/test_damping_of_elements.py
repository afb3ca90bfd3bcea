"""Damping in presliding where friction is of several elements: how much, and in which of them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from autotune.identify.refinement import damping_in_small_motion, damping_of_elements
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.total_friction import damping_at_rest, stiffness_at_rest
from autotune_sim.plant import PlantParameters

KEPT = 0.05
"""Of the first element, what a bristle stands for."""


def told(plant: PlantParameters) -> DriveModel:
    """The plant's own elements, and a damping that is far off, as the fit of a diagnosis leaves it."""
    first = plant.elements[0]
    held = {}
    for number, one in enumerate(plant.elements, 1):
        held[f"displacement_{number}"] = one.displacement
        held[f"torque_{number}"] = one.torque * (1.0 - KEPT if number == 1 else 1.0)
    base = {
        "inertia": plant.inertia, "viscous": plant.viscous, "coulomb": KEPT * first.torque,
        "stiffness": KEPT * first.torque / first.displacement, "micro_damping": 0.01, "offset": plant.offset,
    }  # fmt: skip
    return replace(base_model(base), stiffness_error=1.0).with_effect(REVERSAL_MEMORY.make(held))


def test_small_motion_at_rest_tells_how_much_it_is(vertical) -> None:
    """Within its interval, and that is a few percent."""
    plant, recording = vertical[0].plant, vertical[1]
    found = damping_in_small_motion(told(plant), recording, 0.0, 0.9)
    assert found is not None
    assert found.error < 0.05 * plant.micro_damping
    assert found.whole == pytest.approx(plant.micro_damping, abs=3.0 * found.error, rel=0.0)


@pytest.mark.long
def test_motion_tells_that_it_is_in_the_elements(vertical) -> None:
    """By their stiffness nearly all of it is; none is far outside of the interval."""
    plant, recording = vertical[0].plant, vertical[1]
    model = told(plant)
    found = damping_of_elements(model, recording, 0.0, plant.micro_damping)
    assert found is not None
    assert found.share == pytest.approx(1.0 - model["stiffness"] / stiffness_at_rest(model))
    assert found.share_error < 0.2
    damped = model.with_effect(
        REVERSAL_MEMORY.make(
            {name.partition(".")[2]: v.value for name, v in model.parameters.items() if "memory." in name}
            | {"damping": found.values["reversal_memory.damping"].value}
        )
    ).with_values({"micro_damping": found.values["micro_damping"].value})
    assert damping_at_rest(damped) == pytest.approx(plant.micro_damping, rel=0.05)


def test_a_recording_without_small_motion_tells_nothing(vertical) -> None:
    plant, recording = vertical[0].plant, vertical[1]
    benchmark = next(part for segment, part in recording.split() if segment.experiment == "benchmark")
    assert damping_in_small_motion(told(plant), benchmark, 0.0, 0.9) is None
