"""The FMU in somebody else's simulator: valid, the numbers of the Python feedforward, wrong steps refused."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import ConfigurationError
from autotune.export import fmu
from autotune.export.fmu import export_fmu
from autotune.export.request import FADE, Request

from .support import H, a_compiler, everything, python_torque, random_motion, with_effects, write

fmpy = pytest.importorskip("fmpy")
SAME = 1e-9


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    a_compiler()
    folder = tmp_path_factory.mktemp("fmu")
    return write(Request(everything(), "a model", H), "fmu", folder)["autotune_ff.fmu"]


def simulated(archive: Path, columns: dict[str, np.ndarray], step: float = H) -> np.ndarray:
    """Outputs of FMPy at each step; the first row is before any."""
    count = len(next(iter(columns.values())))
    kinds = [("time", "f8")] + [(name, "?" if name == "enable" else "f8") for name in columns]
    signals = np.zeros(count, dtype=kinds)
    signals["time"] = np.arange(count) * step
    for name, column in columns.items():
        signals[name] = column
    return np.asarray(
        fmpy.simulate_fmu(
            str(archive), start_time=0.0, stop_time=(count - 1) * step, step_size=step, output_interval=step,
            input=signals, output=["torque", "gain", "fault"],
        )
    )  # fmt: skip


def test_it_is_valid_and_holds_its_sources(archive: Path) -> None:
    validation = pytest.importorskip("fmpy.validation")
    assert validation.validate_fmu(str(archive)) == []
    names = set(zipfile.ZipFile(archive).namelist())
    assert {
        "sources/autotune_ff.c",
        "sources/buildDescription.xml",
        "binaries/x86_64-linux/autotune_ff.so",
    } <= names
    described = fmpy.read_model_description(str(archive))
    assert described.fmiVersion == "3.0"
    assert float(described.coSimulation.fixedInternalStepSize) == H


def test_it_gives_the_torque_of_the_python_feedforward(archive: Path) -> None:
    model = everything()
    motion = random_motion(2000, 8)
    columns = dict(zip(("position", "velocity", "acceleration"), motion, strict=True))
    columns["enable"] = np.ones(2000, dtype=bool)
    torque = simulated(archive, columns)["torque"]
    # FMPy puts the inputs of time t in before the step from t, and reads the output after it
    assert np.max(np.abs(torque[1:] - python_torque(model, motion)[: len(torque) - 1])) < SAME


def test_enable_fades_out(tmp_path: Path) -> None:
    a_compiler()
    archive = write(Request(with_effects(), "a model", H), "fmu", tmp_path)["autotune_ff.fmu"]
    enable = np.arange(1000) < 100
    found = simulated(archive, {"enable": enable})
    assert found["torque"][50] == pytest.approx(0.048)
    assert np.max(np.abs(np.diff(found["torque"][1:]))) <= 0.048 * H / FADE * (1 + 1e-9)
    assert found["torque"][-1] == 0.0


def test_another_step_is_refused(archive: Path) -> None:
    with pytest.raises(Exception, match="fmi3DoStep"):
        simulated(archive, {"position": np.zeros(10)}, step=2e-3)


def test_equal_models_give_equal_archives(archive: Path) -> None:
    again = export_fmu(Request(everything(), "a model", H)).files["autotune_ff.fmu"]
    one, other = zipfile.ZipFile(archive), zipfile.ZipFile(io.BytesIO(again))
    assert one.read("modelDescription.xml") == other.read("modelDescription.xml")


def test_a_host_of_another_kind_and_one_without_a_compiler_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu.shutil, "which", lambda name: None)
    with pytest.raises(ConfigurationError, match="needs a C compiler; install gcc or clang"):
        export_fmu(Request(everything(), "a model", H))
    monkeypatch.setattr(fmu.platform, "machine", lambda: "aarch64")
    with pytest.raises(ConfigurationError, match="this host is aarch64-linux"):
        export_fmu(Request(everything(), "a model", H))
