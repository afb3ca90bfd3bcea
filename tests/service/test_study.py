"""Comparing and diagnosing for the API: a process of its own that knows no command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import autotune
from autotune.models.drive_model import base_model
from autotune.service import studies

NUMBERS = {
    "inertia": 6.7e-4, "viscous": 4e-3, "coulomb": 0.33, "stiffness": 60.0, "micro_damping": 0.1, "offset": 0.05,
}  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("study")
    recording = autotune.simulate("sim://edm-vertical?seed=5", programme="high-speed")
    autotune.write_recording(recording, folder / "axis.parquet")
    autotune.write_model(base_model(NUMBERS), folder / "model.toml")
    return folder / "axis.parquet", folder / "model.toml"


def test_a_study_is_the_object_of_the_face(files: tuple[Path, Path]) -> None:
    found = studies.study("compare", *files)
    assert (found.status, found.detail) == (200, "")
    assert found.content == json.loads(json.dumps(autotune.compare(*files).to_json()))


def test_a_study_is_made_anew_when_the_model_was_written_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, model = tmp_path / "axis.parquet", tmp_path / "model.toml"
    recording.write_bytes(b"PAR1")

    def read(command: list[str]) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 0, json.dumps({"model": model.read_text()}))

    monkeypatch.setattr(studies, "_run", read)
    for text in ("identified", "identified and diagnosed"):
        model.write_text(text)
        assert studies.study("compare", recording, model).content == {"model": text}
    monkeypatch.setattr(studies, "_run", lambda command: pytest.fail("what is known is not studied again"))
    assert studies.study("compare", recording, model).content == {"model": text}


def test_what_is_wrong_is_a_sentence(files: tuple[Path, Path]) -> None:
    found = studies.study("compare", files[0].with_name("absent.parquet"), files[1])
    assert found.status == 409
    assert "there is no recording" in found.detail


def test_the_command_line_is_not_loaded(files: tuple[Path, Path]) -> None:
    code = (
        "import sys\nfrom autotune.service.study import main\n"
        f"main('compare', {str(files[0])!r}, {str(files[1])!r})\n"
        "sys.exit(any(name.startswith(('autotune.cli', 'typer', 'rich')) for name in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
