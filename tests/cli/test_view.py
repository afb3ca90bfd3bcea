"""`autotune view`: what can be opened, and a sentence for all that cannot."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from autotune.cli.main import main
from autotune.core.errors import ConfigurationError, RecordingError
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Metadata, Recording
from autotune.view import open_file, viewer_server
from autotune.view.open_file import rerun_file
from autotune.view.rerun_file import write_rrd
from tests.view.rerun_contents import empty_views, views_of

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"


def recording(label: str = "benchmark") -> Recording:
    time = np.arange(500) * 1e-3
    columns = {"time": time, "reference": np.sin(time), "position": np.sin(time), "torque": np.cos(time)}
    return Recording.from_columns(columns, Metadata(axis="test"), label)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    with pytest.raises(SystemExit) as ended:
        main(["view", *map(str, arguments)])
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_what_cannot_be_shown_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "there is no" in refused(capsys, tmp_path / "none.rrd")
    assert "neither run.rrd nor recordings" in refused(capsys, tmp_path)
    foreign = tmp_path / "a.rrd"
    foreign.write_bytes(b"PK\x03\x04 a zip")
    assert "is not a Rerun file" in refused(capsys, foreign)
    foreign.write_bytes(b"")
    assert "is not a Rerun file" in refused(capsys, foreign)
    other = tmp_path / "a.stl"
    other.write_bytes(b"solid")
    assert "cannot be shown: give the folder of a run" in refused(capsys, other)
    broken = tmp_path / "a.parquet"
    broken.write_bytes(b"PAR1 no more")
    assert "a.parquet" in refused(capsys, broken)


def test_a_file_of_a_newer_viewer_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.rrd"
    write_rrd(path, recording())
    data = bytearray(path.read_bytes())
    assert tuple(data[4:7]) == viewer_server.library_version()
    data[5] += 1
    path.write_bytes(data)
    assert "newer than the viewer here" in refused(capsys, path)


def test_a_viewer_of_another_version_or_none_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "rerun"
    monkeypatch.setattr(viewer_server, "rerun_binary", lambda: str(program))
    for text, told in (
        ("#!/bin/sh\necho rerun-cli 0.1.2\n", "is of version 0.1.2, the library of"),
        ("#!/bin/sh\necho hello\n", "is of version unknown"),
        ("#!/bin/sh\nexit 1\n", "cannot be run"),
    ):
        program.write_text(text)
        program.chmod(0o755)
        with pytest.raises(ConfigurationError, match=told):
            viewer_server.check_viewer()
    monkeypatch.setattr(viewer_server, "START_SECONDS", 0.2)
    program.write_text("#!/bin/sh\nexec sleep 60\n")
    with pytest.raises(ConfigurationError, match="cannot be run"):
        viewer_server.check_viewer()


def test_an_axis_that_no_service_has_is_a_sentence_that_names_the_last_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AUTOTUNE_LOCKS", str(tmp_path / "locks"))
    folder = tmp_path / "runs" / "20260301-120000-edm-vertical"
    folder.mkdir(parents=True)
    told = refused(capsys, EXAMPLE, "--runs", tmp_path / "runs")
    assert "no service looks after axis edm-vertical" in told
    assert f"autotune view {folder}" in told
    assert "neither" not in refused(capsys, EXAMPLE, "--runs", tmp_path / "none")


def test_a_run_is_opened_by_its_folder_its_report_or_its_file(tmp_path: Path) -> None:
    write_rrd(tmp_path / "run.rrd", recording())
    (tmp_path / "report.html").write_text("<html>")
    for given in (tmp_path, tmp_path / "report.html", tmp_path / "run.rrd"):
        with rerun_file(given) as file:
            assert (file.path, file.temporary) == (tmp_path / "run.rrd", False)


def test_a_run_that_was_cut_off_is_shown_from_its_recordings(tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    for number, name in enumerate(("zeta", "alpha")):
        path = tmp_path / "recordings" / f"{name}.parquet"
        write_recording(recording(name), path)
        os.utime(path, ns=(number, number))
    with rerun_file(tmp_path) as file:
        assert file.temporary
        assert empty_views(file.path) == []
        assert "Position [rad]" in {view.name for view in views_of(file.path)}
    assert not file.path.exists()


def test_a_recording_of_anybody_is_shown(tmp_path: Path) -> None:
    for name in ("a.parquet", "a.csv"):
        write_recording(recording(), tmp_path / name)
        with rerun_file(tmp_path / name) as file:
            assert empty_views(file.path) == []


def test_recordings_that_do_not_belong_together_are_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    write_recording(recording(), tmp_path / "recordings" / "a.parquet")
    other = recording()
    other = Recording.from_columns(other.floats, Metadata(axis="other", motion_unit="m"), "b")
    write_recording(other, tmp_path / "recordings" / "b.parquet")
    with pytest.raises(RecordingError), rerun_file(tmp_path):
        pass


@pytest.mark.long
def test_without_a_screen_the_file_is_served_to_this_machine_until_ctrl_c(tmp_path: Path) -> None:
    write_rrd(tmp_path / "run.rrd", recording())
    environment = {
        name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    with subprocess.Popen(
        [sys.executable, "-m", "autotune.cli.main", "view", str(tmp_path)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
    ) as shown:  # fmt: skip
        assert shown.stdout is not None
        address = shown.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address, timeout=30.0) as page:
            assert page.status == 200
        shown.send_signal(signal.SIGTERM)
        output, errors = shown.communicate(timeout=60.0)
    assert shown.returncode == 0
    assert "Traceback" not in errors
    assert output == ""
    assert viewer_server.is_free(int(address.split(":")[2].split("/")[0]))


def test_a_server_that_ends_by_itself_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_server, "check_viewer", lambda: None)
    monkeypatch.setattr(viewer_server.ViewerServer, "start", lambda self: None)
    path = tmp_path / "run.rrd"
    write_rrd(path, recording())
    with pytest.raises(ConfigurationError, match="has ended by itself"):
        open_file.show(open_file.Opened(path), True, lambda address: None)
