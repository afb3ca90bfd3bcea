"""Grid, blocks of repeats, roles and cuts."""

import numpy as np
import pytest

from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.core.recording import Metadata, Recording
from autotune.diagnose.prepared import TEST, TRAINING, VETO, prepare


def test_repeats_are_paired_row_by_row(short) -> None:
    data = prepare([short])
    names = {block.name: block for block in data.blocks}
    assert names["sine"].repeats == 2
    assert names["veto"].role == VETO
    assert names["test"].role == TEST
    block = names["points"]
    rows = data.grid[block.rows].reshape(block.repeats, block.count)
    np.testing.assert_allclose(short["reference"][rows[0]], short["reference"][rows[1]], atol=1e-12)


def test_conditioning_is_never_on_the_grid(short) -> None:
    data = prepare([short])
    assert "conditioning" not in set(short.experiment[data.grid])
    assert data.role(TRAINING).sum() > 1000


def test_rows_at_rest_are_left_out(short) -> None:
    data = prepare([short])
    step = data.resolution
    spread = [np.ptp(short["position"][k - 10 : k + 11]) for k in data.grid[::50]]
    assert min(spread) >= 2.0 * step


def test_lost_samples_cut_the_recording(short) -> None:
    n = len(short)
    missed = np.zeros(n, dtype=np.int64)
    missed[n // 2] = 3
    cut = Recording(short.metadata, short.floats, short.experiment, short.repeat, missed)
    data = prepare([cut])
    assert [stretch.start for stretch in data.stretches] == [0, n // 2]


def test_only_conditioning_is_nothing_to_fit(short) -> None:
    part = short.rows(slice(0, 2000))
    renamed = Recording.from_columns(dict(part.floats), part.metadata, "conditioning")
    with pytest.raises(NotEnoughExcitation, match="record the programme 'diagnosis'"):
        prepare([renamed])


def test_axes_are_not_mixed(short) -> None:
    other = short.with_metadata(motion_unit="m")
    with pytest.raises(RecordingError, match="mix axes"):
        prepare([short, other])


def test_one_long_trajectory_is_cut_into_blocks_to_hold_out() -> None:
    time = np.arange(20_000) * 1e-3
    q = np.sin(2 * np.pi * 0.5 * time)
    columns = {"time": time, "position": q, "torque": np.cos(2 * np.pi * 0.5 * time)}
    data = prepare([Recording.from_columns(columns, Metadata())])
    assert len({block.name for block in data.blocks}) >= 8
    assert not data.repeated
