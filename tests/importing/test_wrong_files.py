"""A file that is none, or not the right one, gets two lines at most, whatever is in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy import io as matlab

from autotune.core.errors import AutotuneError
from autotune.recordings.importing import FORMATS

from .conftest import bring_in

LINES, LETTERS = 2, 200
LONG = [f"channel_with_a_long_name_{number:03d} [unit of measurement {number}]" for number in range(300)]
NUMBERS = np.random.default_rng(0).normal(size=(50, 300))
BYTES = np.random.default_rng(1).bytes(3000)
CONTENTS: Mapping[str, bytes] = {
    "empty": b"",
    "random": BYTES,
    "program": b"\x7fELF" + BYTES,
    "document.pdf": b"%PDF-1.4\n" + b"1 0 obj << /Type /Catalog >> endobj\n0 0 0 rg 10 20 m 30 40 l\n" * 200,
    "picture.png": b"\x89PNG\r\n\x1a\n" + BYTES,
    "picture.svg": b'<svg xmlns="x"><path d="M 0 0 L 1 1"/></svg>\n' * 100,
    "table.json": b'{"time": [0.0, 0.001, 0.002], "position": [1,2,3]}\n' * 100,
    "workbook.xls": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(3000),
    "prose.txt": b"It was a dark and stormy night, and the axis did not move; nobody knew why.\n" * 300,
    "one.csv": b"position\n" + b"1.5\n" * 500,
    "wide.csv": "\n".join(
        [",".join(LONG), *(",".join(f"{value:g}" for value in row) for row in NUMBERS)]
    ).encode(),
    "words.csv": "\n".join([",".join(LONG), *[",".join(["word"] * 299 + ["1"])] * 50]).encode(),
    "long.csv": b"1,2," * 3000,
    "name.csv": (
        "time," + "x" * 5000 + ",torque\n" + "".join(f"{i * 1e-3:g},1,2\n" for i in range(99))
    ).encode(),
    "oops.csv": ("time,position,torque\n" + "".join(f"{i * 1e-3:g},1,2\n" for i in range(60))).encode()
    + b"0.06,"
    + b"oops " * 100
    + b",2\n",
    "cut.parquet": b"PAR1" + BYTES + b"PAR1",
    "cut.mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + BYTES,
}
WRITTEN: Mapping[str, Callable[[Path], None]] = {
    "texts.mat": lambda path: matlab.savemat(path, {f"name_{i}_of_very_many": "text" for i in range(200)}),
    "lengths.mat": lambda path: matlab.savemat(
        path, {f"vector_of_many_{i}": np.arange(9.0 + i) for i in range(200)}
    ),
    "texts.parquet": lambda path: pa.parquet.write_table(pa.table({name: ["a"] * 5 for name in LONG}), path),
    "wide.parquet": lambda path: pa.parquet.write_table(pa.table({name: [1.0] * 50 for name in LONG}), path),
}
ASKED = ((), ("position=nothing",), ("torque=2", "position=2"), ("torque=1*furlong",))


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=pytest.mark.slow) if kind == "mat" else kind for kind in sorted(FORMATS)],
)
def test_whatever_bytes_they_are_two_lines_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in CONTENTS.items():
        if kind == "mat" and not name.endswith(".mat"):
            continue  # refused by its first bytes, as `test_formats` shows
        Path(name).write_bytes(content)
        for columns in ASKED:
            assert_short(Path(name), kind, columns)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name.endswith(".mat") else name
        for name in sorted(WRITTEN)
    ],
)
def test_files_of_many_names_are_told_in_two_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    WRITTEN[name](Path(name))
    for columns in ASKED[: 2 if name.endswith(".mat") else 4]:
        assert_short(Path(name), Path(name).suffix[1:], columns)


def assert_short(path: Path, kind: str, columns: tuple[str, ...]) -> None:
    with pytest.raises(AutotuneError) as caught:
        bring_in(path, kind=kind, columns=columns)
    lines = str(caught.value).split("\n")
    assert len(lines) <= LINES, str(caught.value)
    assert max(map(len, lines)) <= LETTERS, str(caught.value)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("document.pdf", "a PDF document"), ("picture.png", "a picture"), ("picture.svg", "a web page or an XML file"),
        ("table.json", "a JSON file"), ("workbook.xls", "save the sheet as CSV"), ("program", "a program"),
    ],
)  # fmt: skip
def test_what_it_is_instead_is_said(tmp_path: Path, name: str, what: str) -> None:
    path = tmp_path / name
    path.write_bytes(CONTENTS[name])
    with pytest.raises(AutotuneError, match=what):
        bring_in(path)
