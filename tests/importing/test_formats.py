"""MATLAB, Parquet and EPOS files, and what these formats can hide."""

from __future__ import annotations

import contextlib
import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy import io as matlab

from autotune.core.errors import AutotuneError, RecordingError
from autotune.recordings.files import read_recording

from .conftest import Floats, bring_in, write_table


def test_matlab_vectors_and_single_numbers(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "t.mat"
    matlab.savemat(path, {**signals, "volts": signals["torque"] / 35.0, "gtau": 35.0, "comment": "none"})
    recording = bring_in(path, kind="mat", columns=("torque=volts*gtau",)).recording
    np.testing.assert_allclose(recording["torque"], signals["torque"], rtol=1e-12)


def test_matlab_structures_matrices_and_cells(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "t.mat"
    both = np.column_stack([signals["position"], signals["torque"]])
    content = {
        "out": {"tout": signals["time"], "log": {"values": both, "label": "q, tau"}},
        "cells": np.array([signals["velocity"], "text"], dtype=object),
    }
    matlab.savemat(path, content)
    columns = ("time=out.tout", "position=out.log.values.1", "torque=out.log.values.2", "velocity=cells.1")
    recording = bring_in(path, kind="mat", columns=columns).recording
    for name, values in signals.items():
        np.testing.assert_array_equal(recording[name], values)


def test_matlab_vectors_of_other_lengths_are_said(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "t.mat"
    matlab.savemat(path, {**signals, "gains": np.arange(7.0)})
    lines = bring_in(path, kind="mat").lines
    assert any("gains (7)" in line for line in lines)


@pytest.mark.parametrize("content", [{}, {"a": 1.0}, {"text": "only"}])
def test_matlab_without_vectors_is_refused(tmp_path: Path, content: dict[str, object]) -> None:
    path = tmp_path / "t.mat"
    matlab.savemat(path, content)
    with pytest.raises(RecordingError, match="no two vectors of numbers"):
        bring_in(path, kind="mat")


def test_matlab_of_version_7_3_says_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "t.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(64))
    with pytest.raises(RecordingError, match="'-v7'"):
        bring_in(path, kind="mat")


@pytest.mark.parametrize("kept", [0.01, 0.3, 0.9])
def test_cut_files_are_refused(tmp_path: Path, signals: dict[str, Floats], kept: float) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    matlab.savemat(whole, signals, appendmat=False)
    cut.write_bytes(whole.read_bytes()[: int(kept * whole.stat().st_size)])
    with pytest.raises(
        RecordingError, match=r"cannot be read as a MATLAB file|no two vectors|has no column|cannot tell"
    ):
        bring_in(cut, kind="mat")
    pyarrow.parquet.write_table(pa.table(signals), whole)
    cut.write_bytes(whole.read_bytes()[: int(kept * whole.stat().st_size)])
    with pytest.raises(RecordingError, match="cannot be read as Parquet"):
        bring_in(cut, kind="parquet")


@pytest.mark.slow  # each a process
@pytest.mark.parametrize("place", [128, 132, 136, 144, 152, 160, 170, 180])
def test_damaged_matlab_files_never_bring_the_program_down(
    tmp_path: Path, signals: dict[str, Floats], place: int
) -> None:
    """scipy's reader can end in a segmentation fault; the file is read by a process of its own."""
    path = tmp_path / "t.mat"
    matlab.savemat(path, signals)
    content = bytearray(path.read_bytes())
    content[place : place + 4] = b"\xff\xff\xff\x7f"
    path.write_bytes(content)
    with contextlib.suppress(AutotuneError):
        assert len(bring_in(path, kind="mat").recording) >= 10


def test_parquet_with_units_in_names_and_metadata(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "t.parquet"
    fields = [
        pa.field("t_ms", pa.float64()),
        pa.field("Angle", pa.float32(), metadata={"unit": "deg"}),
        pa.field("Torque [mNm]", pa.float64()),
        pa.field("note", pa.string()),
    ]
    rows = len(signals["time"])
    arrays = [
        pa.array(signals["time"] * 1e3),
        pa.array(np.degrees(signals["position"]).astype(np.float32)),
        pa.array(signals["torque"] * 1e3),
        pa.array(["x"] * rows),
    ]
    pyarrow.parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)
    recording = bring_in(path, kind="parquet").recording
    np.testing.assert_allclose(recording["time"], signals["time"], rtol=1e-12)
    # single precision of 46 degrees
    np.testing.assert_allclose(recording["position"], signals["position"], atol=1e-7)
    np.testing.assert_allclose(recording["torque"], signals["torque"], rtol=1e-12)


def test_dates_become_seconds(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "t.parquet"
    start = datetime.datetime(2024, 5, 1, tzinfo=datetime.UTC)
    stamps = pa.array(
        [start + datetime.timedelta(seconds=t) for t in signals["time"].tolist()], pa.timestamp("us", "UTC")
    )
    table = pa.table({"time": stamps, "position": signals["position"], "torque": signals["torque"]})
    pyarrow.parquet.write_table(table, path)
    recording = bring_in(path, kind="parquet").recording
    np.testing.assert_allclose(recording["time"], signals["time"], atol=2e-6)


def epos(path: Path, signals: dict[str, Floats], decimal: str = ".", period: str = "1.000") -> Path:
    """As EPOS Studio writes it."""
    lines = [
        "Date:;2020-07-08 21:24:28",
        "Index:;0x6064;0x6077;0x0000;0x0000",
        f"Recorded samples:;{len(signals['time'])}",
        f"Sampling period:;{period}",
        "Scale:;0;True;1.000;10.000;-14.000;-6.000",
        'Trigger:;1;0.000000;"Parameter values";"Channel 1";"Rising above value"',
        ";Velocity actual value averaged;Torque actual value averaged",
        "ms;rpm;%",
    ]
    for t, v, tau in zip(signals["time"], signals["velocity"], signals["torque"], strict=True):
        row = f"{1e3 * t:.3f};{v * 30 / np.pi:.6f};{100 * tau / 0.5:.6f}"
        lines.append(row.replace(".", decimal))
    path.write_text("\r\n".join(lines))
    return path


@pytest.mark.parametrize("decimal", [".", ","])
def test_epos_recordings(tmp_path: Path, signals: dict[str, Floats], decimal: str) -> None:
    path = epos(tmp_path / "e.csv", signals, decimal, f"1{decimal}000")
    with pytest.raises(AutotuneError, match="share of the rated torque"):
        bring_in(path, kind="epos")
    recording = bring_in(path, kind="epos", columns=("torque=3*0.5/100",)).recording
    assert recording.period == pytest.approx(1e-3)
    np.testing.assert_allclose(recording["velocity"], signals["velocity"], atol=1e-6)
    np.testing.assert_allclose(recording["torque"], signals["torque"], atol=1e-7)
    np.testing.assert_allclose(recording["position"], signals["position"] - signals["position"][0], atol=1e-5)


@pytest.mark.parametrize(("decimal", "padding"), [(".", ",,"), (".", ",,,,"), (".", ";;"), (",", ";;")])
def test_epos_recordings_that_a_spreadsheet_saved(
    tmp_path: Path, signals: dict[str, Floats], decimal: str, padding: str
) -> None:
    """Each line ends with empty cells: the period was read as '1.000..'."""
    path = epos(tmp_path / "e.csv", signals, decimal, f"1{decimal}000")
    path.write_text("\r\n".join(line + padding for line in path.read_text().splitlines()))
    recording = bring_in(path, kind="epos", columns=("torque=3*0.5/100",)).recording
    assert recording.period == pytest.approx(1e-3)
    np.testing.assert_allclose(recording["velocity"], signals["velocity"], atol=1e-6)
    np.testing.assert_allclose(recording["torque"], signals["torque"], atol=1e-7)


def test_metadata_that_a_spreadsheet_padded(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "own.csv"
    names = ("time", "position", "torque")
    write_table(path, {name: signals[name] for name in names})
    path.write_text(
        "# motion_unit: rad,,\n# sample_period: 0.001,,\n# torque_limit: 1.5;;\n" + path.read_text()
    )
    metadata = read_recording(path).metadata
    assert (metadata.motion_unit, metadata.sample_period, metadata.torque_limit) == ("rad", 1e-3, 1.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("Sampling period:;1.000", "Sampling period:;2.000"), "the file says 0.002 s a sample"),
        (("Sampling period:;1.000", "Sampling period:;fast"), "must be a number"),
        (("Sampling period", "Sampled"), "no recording of EPOS Studio"),
        (("ms;rpm;%", "ms;rpm"), "3 names but 2 units"),
    ],
)
def test_wrong_epos_files(
    tmp_path: Path, signals: dict[str, Floats], change: tuple[str, str], message: str
) -> None:
    path = epos(tmp_path / "e.csv", signals)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(RecordingError, match=message):
        bring_in(path, kind="epos", columns=("torque=3*0.5/100",))
