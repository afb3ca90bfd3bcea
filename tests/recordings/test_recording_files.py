"""Recordings survive the way to disk and back; wrong files get a sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.drive import Sample
from autotune.core.errors import RecordingError
from autotune.recordings.files import read_recording, write_recording
from autotune.recordings.recording import Controller, Metadata, Recording, concatenate, refuse_twice

EXAMPLE = """# motion_unit: rad
# sample_period: 0.001
# position_resolution: 0.000125663706
# torque_limit: 1.34
# controller: pid kp=60 kd=0.15 ki=6000 derivative_filter=0.5
time,experiment,repeat,reference,position,torque_command,torque
0.000,conditioning,0,0.0,0.0,0.01,0.01
0.001,sine,0,0.1,0.0,0.02,0.02
0.002,sine,1,0.2,0.1,0.03,0.03
"""


def small(**metadata: object) -> Recording:
    samples = [
        Sample(k * 1e-3, 0.1 * k, 0.09 * k, 90.0, 0.3, 0.31, 0.1, 0.2, float("nan"), k % 2) for k in range(7)
    ]
    return Recording.from_samples(samples, Metadata(**metadata), "sine", 2)  # type: ignore[arg-type]


def _moved(by: float) -> Recording:
    columns = {
        name: np.arange(9.0) * scale + by
        for name, scale in (("time", 1e-3), ("position", 0.1), ("torque", 2.0))
    }
    return Recording.from_columns(columns, Metadata(), "x")


def test_the_example_of_the_format_is_read(tmp_path: Path) -> None:
    path = tmp_path / "example.csv"
    path.write_text(EXAMPLE)
    recording = read_recording(path)
    assert recording.metadata.controller == Controller(60.0, 0.15, 6000.0, 0.5)
    assert recording.metadata.torque_limit == 1.34
    assert [(s.experiment, s.repeat, s.start, s.stop) for s in recording.segments()] == [
        ("conditioning", 0, 0, 1),
        ("sine", 0, 1, 2),
        ("sine", 1, 2, 3),
    ]


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_what_is_written_is_read_back(tmp_path: Path, ending: str) -> None:
    written = small(
        position_resolution=1e-4, torque_limit=1.34, controller=Controller(60, 0.15, 6000, 0.5), axis="z"
    )
    path = tmp_path / f"recording{ending}"
    write_recording(written, path)
    read = read_recording(path)
    assert read.metadata == written.metadata
    for name in written.floats:
        np.testing.assert_array_equal(read[name], written[name])
    np.testing.assert_array_equal(read.experiment, written.experiment)
    np.testing.assert_array_equal(read.missed, written.missed)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_metadata_of_a_parquet_count_with_and_without_the_prefix(tmp_path: Path) -> None:
    """As in a CSV; a linear axis would else be taken for a rotary one without a word."""
    table = pa.table({"time": [0.0, 1e-3], "position": [0.0, 1e-6], "torque": [0.1, 0.1]})
    path = tmp_path / "plain.parquet"
    pairs = {"motion_unit": "m", "position_resolution": "1e-6", "autotune.position_resolution": "2e-6"}
    pa.parquet.write_table(table.replace_schema_metadata(pairs), path)
    metadata = read_recording(path).metadata
    assert metadata.motion_unit == "m"
    assert metadata.position_resolution == 2e-6


def test_a_recording_given_twice_is_refused() -> None:
    whole = _moved(0.0)
    refuse_twice([whole, _moved(1.0)])
    for again in (whole, whole.rows(np.arange(len(whole)) < 5)):
        with pytest.raises(RecordingError, match="recordings 1 and 2 hold the same"):
            refuse_twice([whole, again])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("time,", "tim,"), "no column time"),
        (("torque_limit: 1.34", "torque_limit: a lot"), "must be a number"),
        (("sample_period: 0.001", "sample_period: -1"), "above 0"),
        (("motion_unit: rad", "motion_unit: deg"), "allowed are rad, m"),
        (("kp=60 kd=0.15 ki=6000", "kp=60"), "controller"),
        (("0.001,sine", "zero,sine"), "cannot be read"),
        (("torque_command,torque", "torque,torque"), "names a column twice"),
        (("# motion_unit", "# schema: 99\n# motion_unit"), "schema 99"),
    ],
)
def test_a_wrong_file_gets_a_sentence(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "wrong.csv"
    path.write_text(EXAMPLE.replace(*change))
    with pytest.raises(RecordingError, match=message):
        read_recording(path)


@given(st.binary(max_size=400))
def test_any_bytes_are_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("bytes") / "some.csv"
    path.write_bytes(content)
    with pytest.raises(RecordingError):
        read_recording(path)


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no recording"):
        read_recording(tmp_path / "none.parquet")


def test_recordings_of_different_axes_are_not_joined() -> None:
    with pytest.raises(RecordingError, match="mix axes"):
        concatenate([small(fingerprint="a"), small(fingerprint="b")])
    with pytest.raises(RecordingError, match="motion unit"):
        concatenate([small(), small(motion_unit="m")])


def test_joined_recordings_keep_their_segments() -> None:
    both = concatenate([small(), small()])
    assert len(both) == 14
    assert len(both.segments()) == 1
    assert len(both.select("sine")) == 14
    assert len(both.select("other")) == 0


@pytest.mark.parametrize("smoothing", [600.0, 0.0, -0.5])
def test_a_filter_in_hertz_is_refused_and_the_share_is_explained(smoothing: float) -> None:
    """It was taken as it was, and the gains beside it blamed."""
    with pytest.raises(RecordingError, match=r"at most 1.*1 - exp\(-h / T\)"):
        Controller.parse(f"pid kp=60 kd=0.15 ki=6000 derivative_filter={smoothing}")
