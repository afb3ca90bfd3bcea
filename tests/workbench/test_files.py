"""Traces show every peak at every zoom; recordings are known by their content; what is none is refused in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import AutotuneError, RecordingError
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Metadata, Recording
from autotune.workbench.files import LEVEL, Files


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
        assert len(trace["time"]) == len(trace["torque"]) <= 2 * 300 + 2 * LEVEL
        peak = trace["time"][int(np.argmax(trace["torque"]))]
        assert peak == pytest.approx(at, abs=2.5 * 2 * half / 300)
        assert trace["whole"] == pytest.approx([0.0, 399.999])


def test_columns_that_are_not_there_are_left_out(files: Files, path: Path) -> None:
    held = files.add_path(path)
    trace = files.trace(held.id, ("torque", "temperature"), start=0.0, end=0.1, points=500)
    assert "temperature" not in trace
    assert trace["time"] == pytest.approx(np.arange(102) * 1e-3)


def test_the_same_content_is_one_recording(files: Files, path: Path) -> None:
    one = files.add_bytes(path.read_bytes(), "a.parquet")
    two = files.add_bytes(path.read_bytes(), "b.parquet")
    assert one is two
    assert one.about["seconds"] == pytest.approx(399.999)
    assert [held.id for held in files.list()] == [one.id]


@pytest.mark.parametrize("name", ["../../etc/passwd", "a.csv\n<script>", "x" * 500])
def test_a_name_is_never_a_path(files: Files, path: Path, name: str, tmp_path: Path) -> None:
    held = files.add_bytes(path.read_bytes() + b"", Path(name).name[:50] + ".parquet")
    assert held.path.parent == tmp_path / "held"
    assert "\n" not in held.name


@pytest.mark.parametrize("content", [b"", b"\x00" * 1000, b"a,b,c\n1,2,3\n", b"PAR1" + b"x" * 100])
def test_what_is_no_recording_leaves_nothing(files: Files, content: bytes, tmp_path: Path) -> None:
    with pytest.raises(AutotuneError):
        files.add_bytes(content, "thing.csv")
    assert not files.list()
    assert not list((tmp_path / "held").iterdir())


def test_a_foreign_file_is_imported_as_asked(files: Files) -> None:
    t = np.arange(2000) * 1e-3
    lines = [f"{x:.4f},{np.sin(x * 3):.6f},{0.4 * np.sign(np.cos(x * 3)):.4f}" for x in t]
    content = ("s,angle,current\n" + "\n".join(lines)).encode()
    with pytest.raises(RecordingError):
        files.add_bytes(content, "scope.csv")
    options = {"columns": ["time=s", "position=angle", "torque=current*0.05"], "unit": "rad"}
    held = files.add_foreign(content, "scope.csv", options)
    assert held.about["rows"] == 2000
    assert held.about["largest_torque"] == pytest.approx(0.02)
