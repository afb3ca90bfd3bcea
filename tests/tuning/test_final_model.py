"""The picture of the final model: what it shows is the loop's, and it is left out where it would not be true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import autotune
from autotune.core.axis import Benchmark
from autotune.models.drive_model import DriveModel, base_model
from autotune.tuning.final_model import BASELINE, final_model_pictures, simulated
from autotune.view import figures

BENCH = Benchmark(amplitude=0.2, frequency=1.0)
MODEL = base_model(
    {"inertia": 6.7e-4, "viscous": 4.2e-3, "coulomb": 0.33, "stiffness": 35.0, "micro_damping": 0.1, "offset": 0.05}
)  # fmt: skip


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / f"{BASELINE}.parquet"
    autotune.write_recording(autotune.simulate("sim://lugre?seed=3", programme="benchmark"), path)
    return path


def twice_as_much_friction(model: DriveModel) -> DriveModel:
    return base_model(
        {name: value.value * (2.0 if name == "coulomb" else 1.0) for name, value in model.parameters.items()}
    )


def test_the_reversal_is_that_of_the_model(recorded: Path) -> None:
    recording = autotune.read_recording(recorded)
    shown = simulated(recording, MODEL, BENCH.frequency)
    assert shown is not None
    assert shown.error.shape[1] == len(shown.model_error) == 1000
    doubled = simulated(recording, twice_as_much_friction(MODEL), BENCH.frequency)
    assert doubled is not None
    assert (
        np.abs(doubled.model_error).max() > 1.3 * np.abs(shown.model_error).max()
    )  # the glitch grows with friction
    np.testing.assert_array_equal(doubled.error, shown.error)
    figure = figures.as_simulated(shown)
    assert {"measured", "model, in the same loop"} <= {str(trace.name) for trace in figure.data}
    assert "Time since reversal 2 [ms]" in str(figure.layout)


def test_without_model_or_benchmark_there_is_no_picture(recorded: Path, tmp_path: Path) -> None:
    assert final_model_pictures([recorded], None, BENCH) == []
    assert final_model_pictures([tmp_path / "experiment.parquet"], MODEL, BENCH) == []
    (picture,) = final_model_pictures([recorded], MODEL, BENCH)
    assert "rms" in picture.caption
    assert picture.title.startswith("Final model")
    (picture,) = final_model_pictures([recorded], MODEL, BENCH, diagnosed=False)
    assert "Final" not in picture.title
    assert "did not come to its diagnosis" in picture.caption
