"""run.rrd: what is in it, read back with Rerun's own reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import RecordingError
from autotune.recordings.recording import Metadata, Recording
from autotune.view.plane import Plane, symmetric, ticks
from autotune.view.rerun_file import FinalValue, Shown, write_rrd


def recording(rows: int = 3000, **columns: np.ndarray) -> Recording:
    time = np.arange(rows) * 1e-3 + 0.1
    base = {
        "time": time,
        "reference": np.sin(time),
        "position": np.sin(time) - 1e-3,
        "velocity": np.cos(time),
        "torque": 0.3 * np.sign(np.cos(time)),
        "temperature": np.full(rows, np.nan),
    }
    names = np.where(time < 1.0, "approach", "benchmark")
    return Recording.from_columns(base | columns, Metadata(axis="test"), names)


def read(path: Path) -> dict[str, list]:
    """All chunks of the file by entity, as Arrow record batches."""
    from rerun.chunk import RrdReader

    found: dict[str, list] = {}
    for chunk in RrdReader(str(path)).stream():
        found.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
    return found


def column(batches: list, name: str) -> list:
    full = [n for n in batches[0].schema.names if n.endswith(name)]
    return [value for batch in batches for value in batch.column(full[0]).to_pylist()]


def times(batches: list) -> np.ndarray:
    import pyarrow as pa

    return np.concatenate([batch.column("machine_time").cast(pa.int64()).to_numpy() for batch in batches])


def test_traces_come_back_with_exact_times(tmp_path: Path) -> None:
    source = recording()
    write_rrd(tmp_path / "run.rrd", source)
    found = read(tmp_path / "run.rrd")
    rows = [b for b in found["/traces/position"] if "machine_time" in b.schema.names]
    np.testing.assert_array_equal(times(rows), np.rint(source["time"] * 1e9).astype(np.int64))
    values = np.array(column(rows, "Scalars:scalars"))
    np.testing.assert_array_equal(values, np.column_stack([source["reference"], source["position"]]))
    rows = [b for b in found["/traces/error"] if "machine_time" in b.schema.names]
    np.testing.assert_allclose(np.array(column(rows, "Scalars:scalars")).ravel(), 1.0, rtol=1e-9)


def test_lines_are_named_and_empty_columns_left_out(tmp_path: Path) -> None:
    write_rrd(tmp_path / "run.rrd", recording())
    found = read(tmp_path / "run.rrd")
    statics = [b for b in found["/traces/torque"] if "machine_time" not in b.schema.names]
    assert column(statics, "SeriesLines:names") == [["measured"]]
    assert "/traces/temperature" not in found


def test_stages_parameters_verdict_and_plane(tmp_path: Path) -> None:
    source = recording()
    shown = Shown(
        torque_model=source["torque"] * 0.9,
        characteristic=(np.array([-1.0, -0.1, 0.1, 1.0]), np.array([-0.3, -0.3, 0.3, 0.3])),
        parameters=[FinalValue("stiffness", 39.5, 0.8, "N m/rad"), FinalValue("offset", 0.05, None, "N m")],
        verdict="# Kept",
    )
    write_rrd(tmp_path / "run.rrd", source, shown)
    found = read(tmp_path / "run.rrd")
    ((text,),) = column(found["/verdict"], "TextDocument:text")
    assert text.startswith("# Kept")
    assert "| stiffness | 39.50 ± 0.80 N m/rad |" in text
    assert "| offset | 50.0 mN m |" in text
    stages = [b for b in found["/stage/experiment"] if "machine_time" in b.schema.names]
    assert column(stages, "StateChange:state") == [["approach"], ["benchmark"]]
    assert {"/plane/grid", "/plane/model", "/plane/trail"} <= set(found)
    trail = times([b for b in found["/plane/trail"] if "machine_time" in b.schema.names])
    # 3 s at 100 Hz at most
    assert 290 <= len(trail) <= 301


def test_joined_recordings_run_on(tmp_path: Path) -> None:
    time = np.concatenate([np.arange(100), np.arange(100)]) * 1e-3
    source = Recording.from_columns(
        {"time": time, "position": time, "torque": time}, Metadata(sample_period=1e-3), "a"
    )
    write_rrd(tmp_path / "run.rrd", source)
    found = read(tmp_path / "run.rrd")
    rows = [b for b in found["/traces/torque"] if "machine_time" in b.schema.names]
    np.testing.assert_array_equal(times(rows), np.arange(200) * 1_000_000)


def test_empty_recording_still_carries_the_verdict(tmp_path: Path) -> None:
    write_rrd(tmp_path / "run.rrd", recording(0), Shown(verdict="stopped"))
    assert "/verdict" in read(tmp_path / "run.rrd")


def test_model_of_another_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="5 rows, the recording 10"):
        write_rrd(tmp_path / "run.rrd", recording(10), Shown(torque_model=np.zeros(5)))


def test_failure_leaves_the_old_file(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be written"):
        write_rrd(tmp_path / "none" / "run.rrd", recording(10))
    folder = tmp_path / "run.rrd"
    folder.mkdir()
    with pytest.raises(RecordingError, match="cannot be written"):
        write_rrd(folder, recording(10))
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]


def test_importing_the_view_does_not_import_rerun_or_plotly() -> None:
    import subprocess
    import sys

    modules = (
        "autotune.view.live, autotune.view.rerun_file, autotune.view.report, autotune.view.report_tables"
    )
    code = f"import sys, {modules}; print(sorted({{'rerun', 'plotly'}} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_plane_maps_corners_and_flips() -> None:
    plane = Plane("t", "x", "y", (-2.0, 2.0), (-1.0, 1.0))
    placed = plane.place(np.array([-2.0, 2.0, 0.0]), np.array([-1.0, 1.0, 0.0]))
    np.testing.assert_allclose(placed, [[0.0, 1.0], [1.6, 0.0], [0.8, 0.5]])
    strips = plane.strips(np.linspace(-3, 3, 61), np.full(61, 0.5))
    assert len(strips) >= 2
    assert all(strip[:, 0].min() >= 0 and strip[:, 0].max() <= 1.6 for strip in strips)


@pytest.mark.parametrize(("low", "high"), [(-2, 2), (0, 0.003), (-20, 20), (1, 1e6)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 3 <= len(found) <= 7
    assert found[0] >= low - 1e-9
    assert found[-1] <= high + 1e-9


def test_symmetric_ranges_hold_their_data() -> None:
    for largest in (0.0, 0.3, 1.26, 7.4, 99.0, float("nan")):
        low, high = symmetric(largest)
        assert low == -high < 0
        assert not high < largest
