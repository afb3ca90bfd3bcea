"""Which of several laws a drive works by, where only its twin tells."""

from dataclasses import replace

import numpy as np
import pytest

from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import Prepared, filtered_motion, prepare
from autotune.estimation.disturbance import STILL, Disturbance
from autotune.estimation.model_error import told_by_twin
from autotune.estimation.residual import run_twin
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Metadata, Recording
from tests.estimation.simulated import AXIS, PERIOD, TRUE, recorded

COUNTS = 3e-5
"""rad: 40 of them to the presliding of the axis."""
LAW = PositionController(
    26.0, 0.086, 1400.0, 1.0 - np.exp(-2.2), explained=0.9999, source="identified", in_band=True, ticks=4
)


def _driven(ticks: int) -> Prepared:
    """Moves of 0.4 s and rests of 0.6 s, in which the loop swings between two counts."""
    time = np.arange(8_000) * PERIOD
    moved = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time % 1.0, 0.4) / 0.4)
    wanted = 0.3 * np.where(time % 2.0 < 1.0, moved, 1.0 - moved)
    columns = {"time": time, "reference": wanted, "position": wanted + 1e-9, "torque": np.cos(time)}
    metadata = Metadata(sample_period=PERIOD, position_resolution=COUNTS)
    data = prepare([Recording.from_columns(columns, metadata, "motion")])
    shaken, random = Disturbance(white=3e-4), np.random.default_rng(3)
    run = run_twin(data, base_model(AXIS).pack(), replace(LAW, ticks=ticks), shaken, random)
    assert run.stable
    motion = filtered_motion(run.position, data.stretches, PERIOD, data.motion_cutoff)
    return replace(
        data, measured=run.position, torque=run.torque, recorded_torque=run.torque,
        position=motion[0], velocity=motion[1], acceleration=motion[2],
    )  # fmt: skip


@pytest.mark.parametrize(("ticks", "told"), [(6, (4, 6, 8)), (12, (12,))])
def test_how_fast_a_drives_loop_is_shows_in_how_it_rests_between_two_counts(
    ticks: int, told: tuple[int, ...]
) -> None:
    """Identified with 4 ticks a sample; the torque that a rest begins with goes faster behind a later loop."""
    law, _ = told_by_twin(_driven(ticks), [LAW], base_model(AXIS).pack())
    assert law.ticks in told
    assert replace(law, ticks=LAW.ticks) == LAW


def test_a_law_of_the_samples_is_not_asked_about() -> None:
    law = replace(TRUE, source="identified")
    assert told_by_twin(prepare([recorded(TRUE)]), [law], base_model(AXIS).pack()) == (law, STILL)
