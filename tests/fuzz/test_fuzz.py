"""A sample of the fuzz campaign, what it found by name, and that the harness would find it again.

The campaign itself: `python -m bench.fuzz --inputs 1000000`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autotune.core.errors import RecordingError
from autotune.recordings.importing.cleaning import without_missing
from autotune.recordings.importing.clock import RegularPiece, resampled
from bench import fuzz
from bench.fuzz_judging import Found, Kind, require
from bench.fuzz_kinds import KINDS

BY_NAME = {kind.name: kind for kind in KINDS}
EDS = (
    b"[DeviceInfo]\nVendorNumber=%b\nProductNumber=0x402\nRevisionNumber=1\n[1000]\nParameterName=type\nDataType=0x7\n"
    b"AccessType=ro\n"
)
TABLE = b"time,position,torque\n" + b"".join(b"0.%03d,%d,3\n" % (row, row) for row in range(30))

REFUSED = {
    "slcan: an identifier beyond 11 bits": ("slcan", b"t8820"),
    "slcan: a negative identifier": ("slcan", b"t-1029AABB"),
    "slcan: an identifier with an underscore": ("slcan", b"t1_00"),
    "slcan: text behind the data": ("slcan", b"t1852AABBnan"),
    "slcan: two frames whose boundary was lost": ("slcan", b"t1852AABBt705105"),
    "slcan: a digit too much": ("slcan", b"t1852AAABB"),
    "moteus: a frame without an identifier": ("moteus_line", b"rcv  2f0100\n"),
    "moteus: an identifier of twelve digits": ("moteus_line", b"rcv 2147483647 2f010020\n"),
    "sdo: fewer bytes than announced": ("sdo", b"4164600004000000 0b01020304000000"),
    "link: a book": ("link", b"canopen+slcan:///dev/ttyACM0?bi" + b"9" * 11_000),
    "csv: digits without end": ("import_csv", TABLE + b"9" * 60_000 + b"x,1,2\n"),
    "csv: a quoted field without end": ("import_csv", TABLE + b'1,"' + b"a" * 140_000 + b'",3\n'),
    "csv: what a terminal obeys": ("import_csv", TABLE + b"1,2\x1b[2J,3\n"),
    "csv: a clock that is infinite": (
        "import_csv",
        TABLE.replace(b"0.005", b"inf").replace(b"0.006", b"inf"),
    ),
    "recording: a name that is no text": ("recording_csv", b"time,position,torq\xf5e\n0,0,0\n1,0,0\n"),
    "toml: deep": ("axis", b"a = " + b"[" * 9000),
    "toml: digits without end": ("model", b"schema = " + b"9" * 6000),
    "json: nan": ("journal", b'{"changed": {"kp": NaN}}'),
    "json: deep": ("findings", b'{"start": ' + b"[" * 100_000),
    "json: a list for a table": ("findings", b'{"start": [1], "stiffness_range": [1, 2]}'),
}


@pytest.mark.parametrize(("kind", "data"), REFUSED.values(), ids=REFUSED)
def test_what_was_found_is_refused_in_words(tmp_path: Path, kind: str, data: bytes) -> None:
    assert not BY_NAME[kind].run(data, tmp_path)


def test_columns_of_unequal_length_are_damage(tmp_path: Path) -> None:
    """A Parquet file whose pages are damaged gives fewer rows of one column."""
    columns = {"time": np.arange(10.0), "position": np.arange(10.0), "torque": np.empty(0)}
    with pytest.raises(RecordingError, match="first column has 10 rows, but torque 0"):
        without_missing(columns, tmp_path / "some.parquet", [])


def test_stamps_closer_than_numbers_resolve_are_refused() -> None:
    time = np.array([0.0, 1e-320, *np.linspace(0.002, 0.02, 10) ** 1.1])
    piece = RegularPiece({"time": time, "position": np.arange(12.0), "torque": np.arange(12.0)})
    with pytest.raises(RecordingError, match="two time stamps are"):
        resampled(piece, 1e-3)


@pytest.mark.parametrize("number", [b"-5", b"0x7FFFA70100000000", b"99999999999999999999"])
def test_an_identity_has_32_bits(tmp_path: Path, number: bytes) -> None:
    """The judge of the kind holds it; the rest of the data sheet is still read."""
    assert BY_NAME["eds"].run(EDS % number, tmp_path)


@pytest.mark.slow(6)
def test_a_sample_of_the_campaign_finds_nothing() -> None:
    """In a process of its own, as the campaign runs: it forks and limits time by signals."""
    root = Path(__file__).resolve().parents[2]
    paths = os.pathsep.join(map(str, (root, root / "drivers", root / "sim")))
    done = subprocess.run(
        [sys.executable, "-m", "bench.fuzz", "--inputs", "3000", "--seed", "20261120"],
        capture_output=True,
        text=True,
        check=False,
        cwd=root,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 findings" in done.stdout


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_kind_accepts_what_is_sound(tmp_path: Path, kind: Kind) -> None:
    """Else the campaign would only show that everything is refused. Of lines and bodies each counts."""
    whole = fuzz.corpus(kind.name)
    assert any(kind.run(one, tmp_path) for data in whole for one in (data, *data.split(b"\n")[:20]))


def _raise(data: bytes, folder: Path) -> bool:
    raise KeyError("a defect")


def _hang(data: bytes, folder: Path) -> bool:
    while True:
        pass


def _die(data: bytes, folder: Path) -> bool:
    os._exit(3)


def _judged(data: bytes, folder: Path) -> bool:
    require(data == b"", "accepted garbage")
    return True


def test_the_harness_sees_crashes_hangs_deaths_and_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    def make(chance: Any, seeds: Any) -> bytes:
        return b"x" if chance.random() < 0.2 else b""

    def sometimes(run: Any) -> Any:
        return lambda data, folder: run(data, folder) if data else True

    kinds = tuple(
        Kind(name, 1, make, sometimes(run))
        for name, run in (("raise", _raise), ("hang", _hang), ("die", _die), ("judged", _judged))
    )
    monkeypatch.setattr(fuzz, "KINDS", kinds)
    monkeypatch.setattr(fuzz, "corpus", lambda name: [b""])
    monkeypatch.setattr(fuzz, "LONGEST", 0.05)
    result = fuzz.campaign(80, 1, list(kinds), workers=1)
    assert {(kind, what) for kind, what, _ in result.findings} == {
        ("raise", "KeyError"), ("hang", "too long"), ("die", "died"), ("judged", "judged"),
    }  # fmt: skip
    assert result.tallies["judged"].accepted > 0


def test_a_judge_that_is_lied_to_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from autotune_drivers.canopen.slcan import SlcanBus

    monkeypatch.setattr(SlcanBus, "_decode", lambda self, line: (0x185, b"\xaa"))
    with pytest.raises(Found, match="became the frame"):
        BY_NAME["slcan"].run(b"t1852AABB", tmp_path)
