"""Files in the forms of public benchmarks of nonlinear systems: they are read, and what is no axis gets no model.

The signals are made up, with dynamics of each benchmark's kind; names, shapes and clocks are those published.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import io as matlab
from scipy import signal

import autotune
from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError, ConfigurationError, RecordingError

from .conftest import axis_signals, bring_in

ROWS = 4096


def multisine() -> Floats:
    """Random phases in 390 bins from the tenth on; deviation 1."""
    lines = np.zeros(ROWS // 2 + 1, dtype=np.complex128)
    lines[10:400] = np.exp(2j * np.pi * np.random.default_rng(5).random(390))
    wave = np.fft.irfft(lines, ROWS)
    return np.asarray(wave / wave.std())


def wiener_hammerstein() -> tuple[Floats, Floats]:
    """Filter, diode, filter: the input and what comes out."""
    filters = [signal.butter(3, edge, output="sos") for edge in (0.17, 0.2)]
    drive = multisine()
    inner = signal.sosfilt(filters[0], drive)
    return drive, np.asarray(signal.sosfilt(filters[1], np.where(inner > 0.0, 0.4 * inner, inner)))


def duffing(rate: float = 610.35) -> tuple[Floats, Floats]:
    """A resonance of 68 Hz whose spring hardens: the input and the position."""
    drive, steps = 0.05 * multisine(), 8
    pull, position, velocity = (2.0 * np.pi * 68.0) ** 2, 0.0, 0.0
    found = np.empty(ROWS)
    for row in range(ROWS):
        for _ in range(steps):
            spring = position + 4.0 * position**3
            velocity += (pull * (drive[row] - spring) - 0.1 * np.sqrt(pull) * velocity) / rate / steps
            position += velocity / rate / steps
        found[row] = position
    return drive, found


def write_rows(path: Path, head: str, columns: tuple[Floats, ...], once: str, end: str = "") -> Path:
    """A table whose last named column has a number in its first row only."""
    table = [",".join(f"{value:.7g}" for value in row) for row in zip(*columns, strict=True)]
    table = [f"{row},{once if number == 0 else ''}{end}" for number, row in enumerate(table)]
    path.write_text("\n".join([head + end, *table]) + "\n")
    return path


@pytest.mark.parametrize("end", ["", ","], ids=["as-written", "a-delimiter-more"])
@pytest.mark.parametrize("rows", [200, ROWS])
def test_a_rate_in_the_first_row_of_a_table_is_its_clock(tmp_path: Path, rows: int, end: str) -> None:
    drive, answer = (column[:rows] for column in wiener_hammerstein())
    path = write_rows(tmp_path / "wh.csv", "uBenchMark,yBenchMark,fs", (drive, answer), "5120", end)
    columns = ("torque=uBenchMark", "position=yBenchMark")
    found = bring_in(path, columns=columns, keep_signs=True)
    assert len(found.recording) == rows
    assert found.recording.period == pytest.approx(1.0 / 5120.0, rel=1e-5)  # periods are kept with few digits
    assert any("'fs' in the file is 5120: rows of 0.000195313 s" in line for line in found.lines)
    other = bring_in(path, columns=columns, keep_signs=True, period=1e-3)
    assert other.recording.period == pytest.approx(1e-3)
    assert any("but --period 0.001 is taken" in line for line in other.lines)


@pytest.mark.parametrize(("name", "value"), [("Ts", 0.002), ("Fs", 500.0), ("sampling_rate", 500.0)])
def test_a_single_number_of_a_matlab_file_is_its_clock(tmp_path: Path, name: str, value: float) -> None:
    content = {key: values for key, values in axis_signals(period=0.002).items() if key != "time"}
    matlab.savemat(tmp_path / "t.mat", {**content, name: value, "gain": 3.0})
    recording = bring_in(tmp_path / "t.mat", kind="mat").recording
    assert recording.period == pytest.approx(0.002)


def test_a_clock_in_the_file_is_believed_before_a_single_number(tmp_path: Path) -> None:
    matlab.savemat(tmp_path / "t.mat", {**axis_signals(period=0.002), "Ts": 0.001})
    assert bring_in(tmp_path / "t.mat", kind="mat").recording.period == pytest.approx(0.002)


def test_rates_that_do_not_agree_are_no_clock(tmp_path: Path) -> None:
    content = {key: values for key, values in axis_signals().items() if key != "time"}
    matlab.savemat(tmp_path / "t.mat", {**content, "fs": 1000.0, "Ts": 0.5})
    with pytest.raises(ConfigurationError, match="--period"):
        bring_in(tmp_path / "t.mat", kind="mat")


def test_signals_saved_one_a_file_are_one_recording(tmp_path: Path) -> None:
    """As the Bouc–Wen benchmark's validation signals are."""
    whole = axis_signals()
    paths = [tmp_path / "uval_sine.mat", tmp_path / "yval_sine.mat"]
    matlab.savemat(paths[0], {"uval_sine": whole["torque"][None, :]})
    matlab.savemat(paths[1], {"yval_sine": whole["position"][None, :]})
    columns = ("torque=uval_sine", "position=yval_sine")
    recording = bring_in(*paths, kind="mat", columns=columns, period=1e-3).recording
    np.testing.assert_array_equal(recording["torque"], whole["torque"])
    np.testing.assert_array_equal(recording["position"], whole["position"])
    assert len(recording.segments()) == 1


def test_signals_of_one_name_are_told_apart_by_their_files(tmp_path: Path) -> None:
    whole = axis_signals()
    paths = [tmp_path / "torque.mat", tmp_path / "angle.mat"]
    matlab.savemat(paths[0], {"x": whole["torque"]})
    matlab.savemat(paths[1], {"x": whole["position"]})
    columns = ("torque=torque.x", "position=angle.x")
    assert len(bring_in(*paths, kind="mat", columns=columns, period=1e-3).recording) == len(whole["time"])


def test_signals_of_other_lengths_are_not_one_recording(tmp_path: Path) -> None:
    whole = axis_signals()
    paths = [tmp_path / "u.mat", tmp_path / "y.mat"]
    matlab.savemat(paths[0], {"u": whole["torque"]})
    matlab.savemat(paths[1], {"y": whole["position"][:-1]})
    with pytest.raises(RecordingError, match="no two vectors"):
        bring_in(*paths, kind="mat", columns=("torque=u", "position=y"), period=1e-3)


def test_a_level_in_a_tank_every_four_seconds_is_no_axis(tmp_path: Path) -> None:
    drive, answer = (column[:1024] for column in wiener_hammerstein())
    content = {"uEst": drive, "uVal": drive, "yEst": answer, "yVal": answer, "Ts": 4.0}
    matlab.savemat(tmp_path / "dataBenchmark.mat", content)
    with pytest.raises(RecordingError, match="not of an axis: spacing of the rows is 4 s"):
        bring_in(tmp_path / "dataBenchmark.mat", kind="mat", columns=("torque=uEst", "position=yEst"))


@pytest.mark.parametrize(
    ("made", "rate", "true"),
    [(wiener_hammerstein, 5120.0, set()), (duffing, 610.35, {"spring"})],
    ids=["wiener-hammerstein", "silverbox"],
)
def test_what_is_no_axis_gets_no_name(
    tmp_path: Path, made: Callable[[], tuple[Floats, Floats]], rate: float, true: set[str]
) -> None:
    """Refused in words, "unknown" or "none"; the Silverbox is a mass on a spring, and no more may be said of it."""
    drive, answer = made()
    matlab.savemat(tmp_path / "b.mat", {"V1": drive, "V2": answer, "fs": rate})
    named: tuple[str, ...] = ()
    with contextlib.suppress(AutotuneError):
        columns = ("torque=V1", "position=V2")
        recording = bring_in(tmp_path / "b.mat", kind="mat", columns=columns, keep_signs=True).recording
        named = autotune.diagnose([recording], autotune.fit([recording])).effects
    assert set(named) <= true
