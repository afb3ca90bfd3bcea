"""Text tables however they were written: the numbers come out the same."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.core.errors import AutotuneError, RecordingError
from autotune.recordings.files import write_recording
from autotune.recordings.importing import FORMATS
from autotune.recordings.importing.delimited import read_csv

from .conftest import Floats, bring_in, write_table

SIGNALS = ("time", "position", "velocity", "torque")


@pytest.mark.parametrize(
    ("delimiter", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), (" ", ","), ("  ", "."), ("|", "."),
     (", ", "."), ("\t ", ".")],
)  # fmt: skip
def test_every_delimiter_and_decimal_sign(
    tmp_path: Path, signals: dict[str, Floats], delimiter: str, decimal: str
) -> None:
    path = write_table(tmp_path / "table.csv", signals, delimiter, decimal)
    recording = bring_in(path).recording
    for name in SIGNALS:
        # nine digits were written
        np.testing.assert_allclose(recording[name], signals[name], rtol=1e-8, atol=1e-12)
    assert recording.period == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
def test_every_encoding(tmp_path: Path, signals: dict[str, Floats], encoding: str) -> None:
    head = "Zeit [s];Winkel [°];Drehzahl [1/min];Drehmoment [Nm]"
    degrees = {
        **signals,
        "position": np.degrees(signals["position"]),
        "velocity": signals["velocity"] * 30 / np.pi,
    }
    path = write_table(tmp_path / "table.csv", degrees, ";", ",", head, encoding=encoding)
    recording = bring_in(path).recording
    for name in SIGNALS:
        np.testing.assert_allclose(recording[name], signals[name], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(
    "head",
    [
        "t,pos,vel,tau\ns,rad,rad/s,Nm",
        "# a remark\n# another: with, commas\nt,pos,vel,tau\n[s],[rad],[rad/s],[Nm]",
        "Instrument XY,\nSerial,17\n\nt [s],pos [rad],vel [rad/s],tau [N m]",
        "# t_s,pos_rad,vel_rad/s,torque_Nm",
        "Time (s),Position (rad),Velocity (rad/s),Torque (Nm)",
        '"Time, s","Position, rad","Velocity, rad/s","Torque, Nm"',
        "time,position,velocity,torque",
        "Time / s,Actual position / rad,Actual velocity / rad/s,Actual torque / Nm",
    ],
)
def test_headers_with_units_anywhere(tmp_path: Path, signals: dict[str, Floats], head: str) -> None:
    recording = bring_in(write_table(tmp_path / "table.csv", signals, head=head)).recording
    for name in SIGNALS:
        np.testing.assert_allclose(recording[name], signals[name], rtol=1e-8, atol=1e-12)


def test_a_file_without_header_is_read_by_number(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "table.csv", signals, head="")
    with pytest.raises(AutotuneError, match="--column time=NAME"):
        bring_in(path)
    recording = bring_in(path, columns=("time=1", "position=2", "torque=4")).recording
    np.testing.assert_allclose(recording["torque"], signals["torque"], rtol=1e-8)
    assert "velocity" not in recording


def test_trailing_delimiters_plus_signs_and_carriage_returns(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    path = tmp_path / "table.csv"
    rows = [";".join(f"{value:+.9e}" for value in row) + ";" for row in zip(*signals.values(), strict=True)]
    path.write_bytes("\r\n".join([";".join(signals) + ";", *rows]).encode())
    recording = bring_in(path).recording
    np.testing.assert_allclose(recording["torque"], signals["torque"], rtol=1e-8)


@pytest.mark.parametrize("delimiter", [",", ";"])
@pytest.mark.parametrize(("head", "row"), [(2, 2), (0, 2), (2, 0), (1, 0), (0, 1), (3, 2)])
def test_empty_cells_at_the_ends_of_lines_change_nothing(
    tmp_path: Path, signals: dict[str, Floats], delimiter: str, head: int, row: int
) -> None:
    """A spreadsheet pads lines to the longest; names and numbers are found all the same."""
    path = write_table(tmp_path / "table.csv", signals, delimiter)
    first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([first + head * delimiter, *(line + row * delimiter for line in rest)]))
    recording = bring_in(path).recording
    for name in SIGNALS:
        np.testing.assert_allclose(recording[name], signals[name], rtol=1e-8, atol=1e-12)


def test_columns_of_words_and_empty_columns_are_left_alone(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    path = tmp_path / "table.csv"
    lines = ["state,time,empty,position,torque,note"]
    for t, q, tau in zip(signals["time"], signals["position"], signals["torque"], strict=True):
        lines.append(f"RUN,{t:.9g},,{q:.9g},{tau:.9g},fine")
    path.write_text("\n".join(lines))
    assert [column.name for column in read_csv(path).columns] == ["time", "position", "torque"]
    np.testing.assert_allclose(
        bring_in(path).recording["position"], signals["position"], rtol=1e-8, atol=1e-12
    )


@pytest.mark.parametrize(("separator", "start"), [("T", "2024-05-01T"), (" ", "2024-05-01 "), ("", "")])
def test_dates_and_clocks_become_seconds(
    tmp_path: Path, signals: dict[str, Floats], separator: str, start: str
) -> None:
    path = tmp_path / "table.csv"
    lines = ["Time;position;torque;remark"]
    for t, q, tau in zip(signals["time"], signals["position"], signals["torque"], strict=True):
        lines.append(f"{start}11:59:{58 + t:06.3f};{q:.9g};{tau:.9g};ok" if t < 2 else "")
    path.write_text("\n".join(lines))
    imported = bring_in(path)
    recording = imported.recording
    np.testing.assert_allclose(np.diff(recording["time"]), 1e-3, rtol=1e-6)
    np.testing.assert_allclose(recording["torque"], signals["torque"], rtol=1e-8)
    assert any("columns of texts: 'remark'" in line for line in imported.lines)


def test_seconds_since_1970_are_counted_from_the_start(tmp_path: Path, signals: dict[str, Floats]) -> None:
    columns = {**signals, "time": signals["time"] + 1.7e9}
    recording = bring_in(write_table(tmp_path / "t.csv", columns, digits=16)).recording
    # a double near 1.7e9 has steps of 2.4e-7
    np.testing.assert_allclose(recording["time"], signals["time"], atol=3e-7)
    assert recording.period == pytest.approx(1e-3, rel=1e-6)


def test_columns_of_one_name_are_told_apart_by_number(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "t.csv", signals, head="time,position,position,torque")
    with pytest.raises(AutotuneError, match="2 columns that may be position"):
        bring_in(path)
    with pytest.raises(AutotuneError, match="say which by its number: 2, 3"):
        bring_in(path, columns=("position=position",))
    recording = bring_in(path, columns=("position=2",)).recording
    np.testing.assert_allclose(recording["position"], signals["position"], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_recording_of_this_program_needs_no_import(
    tmp_path: Path, signals: dict[str, Floats], ending: str
) -> None:
    path = tmp_path / f"own.{ending}"
    write_recording(bring_in(write_table(tmp_path / "t.csv", signals)).recording, path)
    with pytest.raises(RecordingError, match="a recording of this program already"):
        bring_in(path, kind=ending)


def test_decimal_commas_in_quotes(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = tmp_path / "table.csv"
    rows = [
        ",".join('"' + f"{value:.9f}".replace(".", ",") + '"' for value in row)
        for row in zip(*signals.values(), strict=True)
    ]
    path.write_text("\n".join([",".join(signals), *rows]))
    np.testing.assert_allclose(bring_in(path).recording["torque"], signals["torque"], atol=1e-9)


def test_a_word_far_down_is_named_with_its_row(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "table.csv", signals)
    lines = path.read_text().splitlines()
    lines[1500] = "1.499,oops,1,1"
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="oops"):
        bring_in(path)


def test_a_broken_last_line_is_left_out_and_said(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "table.csv", signals)
    path.write_text(path.read_text() + "2.000,0.1")
    imported = bring_in(path)
    assert len(imported.recording) == 2000
    assert any("1 lines with another number of fields" in line for line in imported.lines)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\n\n  \n", "is empty"),
        (b"PK\x03\x04" + bytes(200), "spreadsheet"),
        (b"\x89HDF\r\n\x1a\n" + bytes(50), "HDF5"),
        (b"\x1f\x8b" + bytes(50), "gzip"),
        (b"PAR1" + bytes(50), "--format parquet"),
        (b"MATLAB 7.3 MAT-file, Platform" + bytes(500), "-v7"),
        (bytes(range(256)), "not text"),
        (b"only some words\nand more of them\n", "no table of numbers"),
        (b"time,position,torque\n", "no table of numbers"),
        (b"1\n2\n3\n", "no table of numbers"),
        (b"time,position,torque\n0,1,2\n0.001,1,2\n", "has 2 rows"),
    ],
)
def test_what_is_no_table_gets_a_sentence(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "file.csv"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        bring_in(path)


def test_missing_files_and_folders_are_said(tmp_path: Path) -> None:
    for kind in FORMATS:
        with pytest.raises(RecordingError, match="not there"):
            bring_in(tmp_path / "none", kind=kind)
        with pytest.raises(RecordingError, match="a folder"):
            bring_in(tmp_path, kind=kind)


@settings(max_examples=150, deadline=None)
@given(
    kind=st.sampled_from(sorted(FORMATS)),
    content=st.one_of(
        st.binary(max_size=500),
        st.text('0123456789.,;e+- \n\t"#abtpos', max_size=400).map(str.encode),
        st.binary(max_size=300).map(lambda rest: b"PAR1" + rest + b"PAR1"),
        st.text("0123456789;.,\n", max_size=200).map(
            lambda rest: b"Sampling period:;1.0\n;Position;Torque\nms;rad;Nm\n" + rest.encode()
        ),
    ),
)
def test_any_bytes_are_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, kind: str, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("bytes") / "some.dat"
    path.write_bytes(content)
    with contextlib.suppress(AutotuneError):
        recording = bring_in(path, kind=kind, columns=("time=1", "position=2", "torque=3")).recording
        assert np.all(np.isfinite(recording["position"]))


@settings(max_examples=60, deadline=None)
@given(
    st.integers(2, 5),
    st.integers(12, 40),
    st.sampled_from([(",", "."), (";", ","), ("\t", "."), (" ", ",")]),
    st.randoms(use_true_random=False),
)
def test_written_tables_come_back(
    tmp_path_factory: pytest.TempPathFactory,
    width: int,
    rows: int,
    how: tuple[str, str],
    random: np.random.Generator,
) -> None:
    table = {f"c{i}": np.array([random.uniform(-1e4, 1e4) for _ in range(rows)]) for i in range(width)}
    path = write_table(tmp_path_factory.mktemp("tables") / "t.csv", table, *how, digits=12)
    source = read_csv(path)
    assert [column.name for column in source.columns] == list(table)
    for read, written in zip(source.load(range(width)).columns, table.values(), strict=True):
        np.testing.assert_allclose(read, written, rtol=1e-11)


def test_columns_that_are_not_used_are_told(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """A set point by a name that says nothing would be missing without a word, and with it every twin."""
    path = write_table(tmp_path / "table.csv", {**signals, "vorgabe": signals["position"]}, ",", ".")
    (line,) = [line for line in bring_in(path).lines if line.startswith("not used")]
    assert line.startswith("not used: 'vorgabe';")
    assert not any("not used" in line for line in bring_in(write_table(tmp_path / "b.csv", signals)).lines)
