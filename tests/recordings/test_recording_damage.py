"""A damaged recording never passes for another one, and values that no axis can have are refused in words."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import RecordingError
from autotune.recordings.columnwise import walk_recording
from autotune.recordings.files import read_recording, write_recording
from autotune.recordings.recording import Controller, Metadata, Recording

ROWS = 400


def measured() -> Recording:
    generator, time = np.random.default_rng(3), np.arange(ROWS) * 1e-3
    columns = {
        "time": time,
        "reference": np.sin(time),
        "position": np.sin(time) + 1e-3 * generator.normal(size=ROWS),
        "velocity": np.cos(time),
        "torque": 0.1 * np.sin(time) + 1e-3 * generator.normal(size=ROWS),
        "temperature": np.full(ROWS, np.nan),
    }
    metadata = Metadata(
        torque_limit=1.34, controller=Controller(60, 0.15, 6000, 0.5), axis="z", extra={"note": "of today"}
    )
    experiment = np.where(np.arange(ROWS) < 200, "sine", "ramp")
    return Recording.from_columns(columns, metadata, experiment, 0, np.arange(ROWS) % 2)


def alike(one: Recording, other: Recording) -> bool:
    """The same metadata and the same values, all of them."""
    return (
        one.metadata == other.metadata
        and dict(one.metadata.extra) == dict(other.metadata.extra)
        and list(one.floats) == list(other.floats)
        and all(np.array_equal(one[name], other[name], equal_nan=True) for name in one.floats)
        and one.segments() == other.segments()
        and np.array_equal(one.missed, other.missed)
    )


@pytest.mark.parametrize("name", ["experiment", "temperature", "position"])
def test_a_column_of_lists_is_refused_in_words(tmp_path: Path, name: str) -> None:
    path, sound = tmp_path / "recording.parquet", tmp_path / "sound.parquet"
    write_recording(measured(), sound)
    table = pa.parquet.read_table(sound)
    lists = pa.array([[value] for value in table.column(name).to_pylist()])
    pa.parquet.write_table(table.set_column(table.column_names.index(name), name, lists), path)
    with pytest.raises(RecordingError, match=f"lists or structures in its column {name}"):
        read_recording(path)
    with pytest.raises(RecordingError, match=f"lists or structures in its column {name}"):
        walk_recording(path, lambda name, values: None)


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_no_flipped_bit_changes_what_is_read(tmp_path: Path, ending: str) -> None:
    """Bits anywhere in the file; `python -m bench.fuzz` flips many more."""
    path, chance = tmp_path / f"recording{ending}", random.Random(11)
    write_recording(measured(), path)
    sound, wanted = path.read_bytes(), read_recording(path)
    refused = 0
    for _ in range(400):
        damaged = bytearray(sound)
        for _ in range(chance.choice([1, 1, 1, 2, 5, 20])):
            bit = chance.randrange(8 * len(damaged))
            damaged[bit >> 3] ^= 1 << (bit & 7)
        path.write_bytes(damaged)
        try:
            assert alike(read_recording(path), wanted)
        except RecordingError:
            refused += 1
    assert refused > 300  # the rest hit what nobody reads: column statistics, the writer's name


def test_a_lost_checksum_is_damage_and_a_file_without_one_is_read_and_said(tmp_path: Path) -> None:
    path = tmp_path / "recording.parquet"
    write_recording(measured(), path)
    assert read_recording(path).metadata.remarks == ()
    table = pa.parquet.read_table(path)
    pairs = {k: v for k, v in table.schema.metadata.items() if k != b"autotune.checksum"}
    pa.parquet.write_table(table.replace_schema_metadata(pairs), path)
    with pytest.raises(RecordingError, match="no checksum, which every such file has"):
        read_recording(path)
    pa.parquet.write_table(table.replace_schema_metadata(pairs | {b"autotune.schema": b"1"}), path)
    old = read_recording(path)
    assert "has no checksum" in old.metadata.remarks[0]
    write_recording(old, path)
    assert read_recording(path).metadata.remarks == ()


def test_a_csv_changed_by_hand_says_which_line_to_delete(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    write_recording(measured(), path)
    text = path.read_text().replace("of today", "of yesterday")
    path.write_text(text)
    with pytest.raises(RecordingError, match="delete the line '# checksum:'"):
        read_recording(path)
    path.write_text(text.partition("\n")[2])
    assert read_recording(path).metadata.extra == {"note": "of yesterday"}
    path.write_text(text.replace("# checksum", "# chdcksum"))
    with pytest.raises(RecordingError, match="looks like a damaged"):
        read_recording(path)


@given(
    st.lists(st.floats(-1e3, 1e3) | st.sampled_from([-0.0, 5e-324, float("nan")]), min_size=2, max_size=20)
)
def test_every_number_survives_a_csv_so_that_its_checksum_matches(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float]
) -> None:
    path = tmp_path_factory.mktemp("numbers") / "recording.csv"
    time = np.arange(len(numbers)) * 1e-3
    columns = {"time": time, "position": time, "torque": time, "torque_feedback": np.array(numbers)}
    write_recording(Recording.from_columns(columns, Metadata()), path)
    np.testing.assert_array_equal(read_recording(path)["torque_feedback"], numbers)


def rows(column: str = "", value: object = None, row: int = 5, head: str = "", step: float = 1e-3) -> str:
    """Ten rows of a CSV written by hand, one value of it replaced."""
    names = ["time", "position", "torque", "velocity", "temperature", "missed"]
    lines = [head + ",".join(names)]
    for number in range(10):
        cells: dict[str, object] = dict.fromkeys(names, 0) | {
            "time": f"{number * step:.6g}",
            "temperature": "nan",
        }
        if number == row and column:
            cells[column] = value
        lines.append(",".join(str(cells[name]) for name in names))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            rows("position", "1.6e206"),
            "position is 1.6e\\+206 rad in row 5; no axis goes beyond ±1e\\+11 rad",
        ),
        (rows("position", "inf"), "position has 1 values that are not numbers, the first in row 5"),
        (rows("position", "nan"), "column position has 1 values"),
        (rows("velocity", "-inf"), "column velocity has 1 values"),
        (rows("position", 2e3), "2e\\+06 rad/s; no axis goes beyond"),
        (rows("velocity", 3e6), "velocity is 3e\\+06 rad/s in row 5"),
        (rows("torque", 14, head="# torque_limit: 1.34\n"), "10 times the torque_limit of 1.34"),
        (rows("torque", 1e9), "torque is 1e\\+09 N m in row 5"),
        (rows("torque", 1e10, head="# motion_unit: m\n"), "torque is 1e\\+10 N in row 5"),
        (rows("temperature", 6553.5), "temperature is 6553.5 °C in row 5"),
        (rows("missed", -1), "missed is -1 in row 5"),
        (rows("time", 1e-320, row=1).replace("1e-320,0", "1e-320,0.1"), "inf rad/s; no axis goes beyond"),
        (rows("time", 0.001), "time decreases at row 5"),
        (rows("time", 0.004), "time is duplicated at row 5"),
        (
            rows(step=1.0, head="# sample_period: 0.001\n"),
            "rows are 1 s apart by their time, but sample_period",
        ),
        (rows(head="# sample_period: 1e-300\n"), "sample_period is 1e-300; it must be from"),
        (rows(head="# note: \x1b[2J\n"), "cannot be printed"),
        (rows(head="# controller: pid kp=nan kd=1 ki=1\n"), "not finite"),
    ],
)
def test_what_no_axis_can_do_is_refused_in_words(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "by_hand.csv"
    path.write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_recording(path)


def test_what_an_axis_can_do_is_read(tmp_path: Path) -> None:
    """The fastest motors, sensors that say nothing, a torque that overshoots its limit."""
    path = tmp_path / "by_hand.csv"
    for text in (
        rows(),
        rows("position", 90.0),  # 90 000 rad/s: 860 000 rpm
        rows("velocity", "nan"),
        rows("torque", 2.6, head="# torque_limit: 1.34\n"),
        rows(step=1e-3, head="# sample_period: 0.00105\n"),
    ):
        path.write_text(text)
        assert len(read_recording(path)) == 10


def test_a_name_as_long_as_a_book_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "names.parquet"
    columns = {name: np.arange(20_000) * 1e-3 for name in ("time", "position", "torque")}
    names = pa.array(["sine"] * 19_999 + ["x" * 20_000])
    pa.parquet.write_table(pa.table({**columns, "experiment": names}), path)
    with pytest.raises(RecordingError, match="at most 200 characters"):
        read_recording(path)
