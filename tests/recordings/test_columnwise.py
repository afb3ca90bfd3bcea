"""Column by column, a recording is what it is when it is read whole: the same numbers, and the same files refused."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings import columnwise
from autotune.recordings.columnwise import Outline, walk_recording
from autotune.recordings.files import read_recording, write_recording
from autotune.recordings.recording import Metadata, Recording
from tests.recordings.test_recording_damage import measured

CORPUS = Path(__file__).resolve().parents[1] / "fuzz" / "corpus"


def walked(path: Path) -> tuple[Outline, dict[str, Floats]]:
    seen: dict[str, Floats] = {}

    def see(name: str, values: Floats) -> None:
        seen[name] = values.copy()

    return walk_recording(path, see), seen


def differences(path: Path) -> list[str]:
    """What of a file is not the same, read whole and column by column."""
    whole = read_recording(path)
    outline, seen = walked(path)
    alike = {
        "metadata": outline.metadata == whole.metadata,
        "remarks": outline.metadata.remarks == whole.metadata.remarks,
        "rows": outline.rows == len(whole),
        "segments": list(outline.segments) == whole.segments(),
        "columns": outline.columns == tuple(seen) == tuple(whole.floats),
        **{name: np.array_equal(seen[name], whole[name], equal_nan=True) for name in seen},
    }
    return [name for name, is_alike in alike.items() if not is_alike]


@pytest.mark.parametrize("batch", [7, 200, 1 << 19])
def test_the_same_numbers_and_segments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, batch: int) -> None:
    monkeypatch.setattr(columnwise, "BATCH", batch)
    path = tmp_path / "recording.parquet"
    write_recording(measured(), path)
    assert differences(path) == []
    table = pa.parquet.read_table(path)  # by somebody else: no metadata, no segments, no counts
    pa.parquet.write_table(table.select(["time", "torque", "position"]).replace_schema_metadata(None), path)
    assert differences(path) == []


@pytest.mark.parametrize("path", sorted(CORPUS.glob("recording_*/*")), ids=lambda path: path.name)
def test_the_same_of_a_csv(path: Path) -> None:
    assert differences(path) == []


TABLE = "time,position,torque,what,experiment\n" + "".join(
    f"{k * 1e-3},{k * 1e-4},0.1,w{k},sine\n" for k in range(900)
)


@pytest.mark.parametrize(
    "content",
    [
        TABLE.encode(),
        b"# sample_period: 0.001,,,\n# motion_unit: m,,,\n" + TABLE.encode(),
        TABLE.replace("w700", "").replace("w1\n", "7\n").encode(),
        TABLE.replace("torque", "moment").encode(),
        TABLE.replace("sine", "sin\u00e9").encode(),
        TABLE.replace("sine", "sin\u00e9").encode("latin-1"),
        TABLE.encode() + b"\0",
        TABLE.replace("0.7,0.07,0.1", "0.7,0.07").encode(),
        TABLE.replace("0.7,0.07,0.1", "0.7,zero,0.1").encode(),
        TABLE.replace("0.7,0.07,0.1", "0.7,0.07,").encode(),
        b"# motion_unit: rad\n",
        b"",
        b"time,position,torque\n",
    ],
)  # fmt: skip
def test_a_csv_is_read_or_refused_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes
) -> None:
    monkeypatch.setattr(columnwise, "CSV_BLOCK", 2000)
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    try:
        read_recording(path)
    except RecordingError:
        with pytest.raises(RecordingError):
            walked(path)
    else:
        assert differences(path) == []


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_what_is_damaged_or_impossible_is_refused_alike(tmp_path: Path, ending: str) -> None:
    """Bits flipped anywhere: where one way refuses, the other does."""
    path, chance = tmp_path / f"recording{ending}", random.Random(5)
    write_recording(measured(), path)
    sound = path.read_bytes()
    refused = 0
    for _ in range(150):
        damaged = bytearray(sound)
        bit = chance.randrange(8 * len(damaged))
        damaged[bit >> 3] ^= 1 << (bit & 7)
        path.write_bytes(damaged)
        try:
            read_recording(path)
        except RecordingError:
            refused += 1
            with pytest.raises(RecordingError):
                walked(path)
        else:
            assert differences(path) == []
    assert refused > 100


@pytest.mark.parametrize(
    ("column", "row", "value", "words"),
    [
        ("time", 300, 0.1, "time decreases at row 300"),
        ("position", 120, np.inf, "first in row 120"),
        ("position", 120, 1e5, "no axis goes beyond"),
        ("torque", 50, 20.0, "10 times the torque_limit"),
        ("temperature", 9, -300.0, "possible are -273.15 to"),
    ],
)
def test_the_same_words(tmp_path: Path, column: str, row: int, value: float, words: str) -> None:
    path, sound = tmp_path / "recording.parquet", measured()
    floats = {name: values.copy() for name, values in sound.floats.items()}
    floats[column][row] = value
    write_recording(Recording.from_columns(floats, sound.metadata, "sine"), path)
    with pytest.raises(RecordingError, match=words) as whole:
        read_recording(path)
    with pytest.raises(RecordingError) as parts:
        walked(path)
    assert str(parts.value) == str(whole.value)


def test_damage_is_said_before_what_it_has_made(tmp_path: Path) -> None:
    path = tmp_path / "recording.parquet"
    write_recording(measured(), path)
    table = pa.parquet.read_table(path)
    wrong = table["time"].to_numpy().copy()
    wrong[5] = 1e300
    at = table.column_names.index("time")
    pa.parquet.write_table(table.set_column(at, "time", pa.array(wrong)), path)
    with pytest.raises(RecordingError, match="does not match its checksum"):
        walked(path)


def test_no_rows_and_no_file(tmp_path: Path) -> None:
    path = tmp_path / "empty.parquet"
    write_recording(Recording.from_columns({"time": [], "position": [], "torque": []}, Metadata()), path)
    outline, _ = walked(path)
    assert (outline.rows, outline.segments) == (0, ())
    with pytest.raises(RecordingError, match="there is no recording"):
        walked(tmp_path / "nothing.parquet")
    shutil.copy(path, tmp_path / "cut.parquet")
    (tmp_path / "cut.parquet").write_bytes(path.read_bytes()[:40])
    with pytest.raises(RecordingError, match="cannot be read"):
        walked(tmp_path / "cut.parquet")
