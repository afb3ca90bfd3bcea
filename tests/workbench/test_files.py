"""Traces show every peak at every zoom; recordings are known by their content; what is none is refused in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autotune.core.errors import AutotuneError, RecordingError
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Metadata, Recording
from autotune.workbench import files as files_module
from autotune.workbench.files import Files, Held
from autotune.workbench.import_child import import_apart, imported
from autotune.workbench.traces import STEPS, TraceWriter


def made(rows: int = 400_000, period: float = 1e-3) -> Recording:
    time = np.arange(rows) * period
    position = np.sin(2 * np.pi * 0.05 * time)
    torque = 0.3 * np.sign(np.cos(2 * np.pi * 0.05 * time))
    torque[rows // 3] = 1.25  # one sample
    return Recording.from_columns(
        {"time": time, "position": position, "torque": torque, "reference": position},
        Metadata(sample_period=period, torque_limit=1.34),
        "motion",
    )


def sent(files: Files, content: bytes, name: str, options: dict[str, Any] | None = None) -> Held:
    """As a page sends it: in parts."""
    with files.incoming() as given:
        for start in range(0, len(content), 100_000):
            given.write(content[start : start + 100_000])
        if options is not None:
            return files.add_foreign(given, name, options)
        return files.add_sent(given, name)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "long.parquet"
    write_recording(made(), path)
    return path


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path / "held")


def test_a_single_sample_is_seen_at_every_zoom(files: Files, path: Path) -> None:
    held = files.add_path(path)
    at = (400_000 // 3) * 1e-3
    for half in (200.0, 50.0, 5.0, 0.2):
        start, end = max(at - half, 0.0), at + half
        trace = files.trace(held.id, ("torque",), start=start, end=end, points=300)
        assert max(trace["torque"]) == pytest.approx(1.25)
        assert len(trace["time"]) == len(trace["torque"]) <= 2 * 300 + 2 * STEPS[0]
        peak = trace["time"][int(np.argmax(trace["torque"]))]
        assert peak == pytest.approx(at, abs=2.5 * 2 * half / 300)
        assert trace["whole"] == pytest.approx([0.0, 399.999])


def test_columns_that_are_not_there_are_left_out(files: Files, path: Path) -> None:
    held = files.add_path(path)
    trace = files.trace(held.id, ("torque", "temperature"), start=0.0, end=0.1, points=500)
    assert "temperature" not in trace
    assert trace["time"] == pytest.approx(np.arange(102) * 1e-3)


def test_the_same_content_is_one_recording(files: Files, path: Path) -> None:
    one = sent(files, path.read_bytes(), "a.parquet")
    two = sent(files, path.read_bytes(), "b.parquet")
    assert one is two
    assert one.about["seconds"] == pytest.approx(399.999)
    assert [held.id for held in files.list()] == [one.id]


@pytest.mark.parametrize("name", ["../../etc/passwd", "a.csv\n<script>", "x" * 500])
def test_a_name_is_never_a_path(files: Files, path: Path, name: str, tmp_path: Path) -> None:
    held = sent(files, path.read_bytes(), Path(name).name[:50] + ".parquet")
    assert held.path.parent == tmp_path / "held"
    assert "\n" not in held.name


@pytest.mark.parametrize("content", [b"", b"\x00" * 1000, b"a,b,c\n1,2,3\n", b"PAR1" + b"x" * 100])
def test_what_is_no_recording_leaves_nothing(files: Files, content: bytes, tmp_path: Path) -> None:
    with pytest.raises(AutotuneError):
        sent(files, content, "thing.csv")
    assert not files.list()
    assert not list((tmp_path / "held").iterdir())


def test_a_foreign_file_is_imported_as_asked(files: Files) -> None:
    t = np.arange(2000) * 1e-3
    lines = [f"{x:.4f},{np.sin(x * 3):.6f},{0.4 * np.sign(np.cos(x * 3)):.4f}" for x in t]
    content = ("s,angle,current\n" + "\n".join(lines)).encode()
    with pytest.raises(RecordingError):
        sent(files, content, "scope.csv")
    columns = ["time=s", "position=angle", "torque=current"]
    held = sent(files, content, "scope.csv", {"columns": columns, "unit": "rad", "torque_unit": "A"})
    assert held.about["rows"] == 2000
    assert held.about["largest_torque"] == pytest.approx(0.4)
    assert held.about["torque_unit"] == "A"


def test_what_is_in_doubt_about_a_foreign_file_is_asked(tmp_path: Path) -> None:
    given = tmp_path / "given.csv"
    given.write_text("s,angle,current\n" + "0.1,0.2,0.3\n" * 10)
    wish = {"file": str(given), "out": str(tmp_path / "out.parquet"), "options": {"columns": ["time=s"]}}
    assert "torque" in imported(wish)
    assert not (tmp_path / "out.parquet").exists()


def test_a_foreign_file_that_takes_too_much_memory_ends_in_a_sentence(tmp_path: Path) -> None:
    """It is read in a process of its own, which takes the memory with it."""
    given, out = tmp_path / "given.csv", tmp_path / "out.parquet"
    given.write_text("time [s],position [rad],torque [Nm]\n" + "0.1,0.2,0.3\n" * 10)
    with pytest.raises(RecordingError, match=r"mine\.csv: it takes more than 0\.05 GB"):
        import_apart(given, "mine.csv", out, {}, most_memory=50_000_000)
    assert not out.exists()


def test_every_slot_has_the_least_and_the_greatest_of_its_rows(files: Files, path: Path) -> None:
    """At every zoom, against the rows themselves: nothing is lost, and nothing comes from far beside a slot."""
    held, recording = files.add_path(path), made()
    time, torque = recording["time"], recording["torque"].astype(np.float32)
    for start, end in [
        (0.0, 400.0),
        (100.0, 260.0),
        (133.0, 134.0),
        (133.3, 133.4),
        (399.0, 500.0),
        (-9.0, 1.0),
    ]:
        shown = files.trace(held.id, ("torque",), start=start, end=end, points=200)
        rows = (time >= start) & (time <= end)
        assert max(shown["torque"]) >= float(torque[rows].max()) - 1e-6
        assert min(shown["torque"]) <= float(torque[rows].min()) + 1e-6
        wide = (end - start) / 200 * 1.5 + 0.032
        near = (time >= start - wide) & (time <= end + wide)
        assert max(shown["torque"]) <= float(torque[near].max()) + 1e-6
        assert start - wide <= shown["time"][0] <= max(start, 0.0)
        assert min(end, 399.999) - wide <= shown["time"][-1] <= end + wide


def test_the_oldest_that_was_sent_is_given_up_for_room(
    files: Files, path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    named = files.add_path(path)
    monkeypatch.setattr(files_module, "MOST_KEPT", 200_000)
    lines = ["time,position,torque"] + [f"{k * 1e-3},{np.sin(k * 3e-3)},0.1" for k in range(3000)]
    one = sent(files, "\n".join(lines).encode(), "one.csv")
    assert files.list() == [named, one]
    two = sent(files, "\n".join(lines[:-1]).encode(), "two.csv")
    assert files.list() == [named, two]
    assert not one.path.exists()
    assert not one.traces.folder.exists()
    with pytest.raises(KeyError):
        files.trace(one.id, ("torque",), start=None, end=None, points=100)
    assert files.trace(named.id, ("torque",), start=None, end=None, points=100)["time"]


def test_no_rows_are_said(files: Files, tmp_path: Path) -> None:
    write_recording(
        Recording.from_columns({"time": [], "position": [], "torque": []}, Metadata()), tmp_path / "a.csv"
    )
    with pytest.raises(AutotuneError, match="no rows"):
        sent(files, (tmp_path / "a.csv").read_bytes(), "a.csv")


def test_a_full_disk_is_said_and_leaves_nothing(
    files: Files, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: object, name: str, values: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(TraceWriter, "see", full)
    with pytest.raises(AutotuneError, match="free some space there"):
        sent(files, path.read_bytes(), "a.parquet")
    assert not files.list()
    assert not list(files.folder.iterdir())
