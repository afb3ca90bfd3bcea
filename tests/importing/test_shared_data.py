"""Axes that others measured, imported with one command; the numbers are those their authors give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import io as matlab
from typer.testing import CliRunner

from autotune.cli.data import data
from autotune.core.errors import RecordingError
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording

from .conftest import bring_in, shared

EMPS = "--unit m --column time=t --column position=qm --column reference=qg --column torque=vir*35.15"


def run_import(out: Path, *arguments: str) -> tuple[Recording, str]:
    """The command line's `data import`; its recording and what it said."""
    result = CliRunner().invoke(data, ["import", *arguments, "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return read_recording(out), result.output


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_emps(tmp_path: Path, ending: str) -> None:
    file = shared("emps") / "DATA_EMPS.mat"
    recording, said = run_import(tmp_path / f"emps.{ending}", str(file), "--format", "mat", *EMPS.split())
    assert len(recording) == 24841
    assert recording.metadata.motion_unit == "m"
    assert recording.period == pytest.approx(1e-3, rel=1e-6)
    original = matlab.loadmat(file)
    np.testing.assert_array_equal(recording["position"], original["qm"].ravel())
    np.testing.assert_array_equal(recording["reference"], original["qg"].ravel())
    np.testing.assert_allclose(recording["torque"], 35.15 * original["vir"].ravel(), rtol=1e-12)
    # the authors: up to 0.13 m/s
    assert 0.12 < np.max(np.abs(np.gradient(recording["position"], recording.period))) < 0.16
    assert len(recording.segments()) == 1
    assert "torque = 'vir' × 35.15" in said


def test_emps_mass_and_friction_come_out_of_the_import(tmp_path: Path) -> None:
    """A plain regression on the imported file finds the authors' mass within 3 %."""
    from autotune.signals.filters import motion

    recording, _ = run_import(
        tmp_path / "emps.parquet", str(shared("emps") / "DATA_EMPS.mat"), "--format", "mat", *EMPS.split()
    )
    _, velocity, acceleration = motion(recording["position"], recording.period, 60.0)
    terms = np.column_stack([acceleration, velocity, np.sign(velocity), np.ones(len(recording))])
    moving = np.abs(velocity) > 0.005
    mass, viscous, coulomb, offset = np.linalg.lstsq(terms[moving], recording["torque"][moving], rcond=None)[
        0
    ]
    assert mass == pytest.approx(95.11, rel=0.03)
    assert viscous == pytest.approx(203.5, rel=0.1)
    assert coulomb == pytest.approx(20.39, rel=0.1)
    assert -4.5 < offset < -2.0


@pytest.mark.slow
def test_emps_with_the_file_s_own_factor_and_a_wrong_sign() -> None:
    file = shared("emps") / "DATA_EMPS.mat"
    columns = ("time=t", "position=qm", "reference=qg")
    right = bring_in(file, kind="mat", columns=(*columns, "torque=vir*gtau"), motion_unit="m").recording
    assert np.max(np.abs(right["torque"])) == pytest.approx(4.3257 * 35.15065, rel=1e-4)
    with pytest.raises(RecordingError, match="opposite directions"):
        bring_in(file, kind="mat", columns=(*columns, "torque=vir*-gtau"), motion_unit="m")


@pytest.mark.parametrize(
    ("time", "message"),
    [("t*1000", "usual if time is in ms"), ("t*1e6", "usual if time is in µs"), ("t*ms", "was taken as ms")],
)
def test_emps_with_its_time_in_another_unit_is_of_no_axis(time: str, message: str) -> None:
    """Milliseconds as seconds were imported, and fitted with 720 kg m² and exit 0."""
    file = shared("emps") / "DATA_EMPS.mat"
    columns = (f"time={time}", "position=qm", "reference=qg", "torque=vir*35.15")
    with pytest.raises(RecordingError, match=message):
        bring_in(file, kind="mat", columns=columns, motion_unit="m")


def test_what_the_axis_is_in_the_units_declared_is_said(tmp_path: Path) -> None:
    _, said = run_import(
        tmp_path / "emps.parquet", str(shared("emps") / "DATA_EMPS.mat"), "--format", "mat", *EMPS.split()
    )
    assert "rows 1 ms apart, travel 246 mm, up to 0.125 m/s, 1.14 m/s², 138 N, 12.1 W" in said
    assert "Are the units right" not in said


@pytest.mark.parametrize(("name", "segments", "speed"), [("acc_current", 3, None), ("speed_test1", 2, 4.93)])
def test_bldc_in_amperes(tmp_path: Path, name: str, segments: int, speed: float | None) -> None:
    file = str(shared("bldc_cogging") / f"{name}.txt")
    options = "--format csv --column position=Position --column velocity=Velocity --torque-unit A"
    recording, said = run_import(tmp_path / "bldc.parquet", file, *options.split())
    assert recording.period == pytest.approx(1e-3, rel=1e-3)
    assert recording.metadata.extra["torque_unit"] == "A"
    assert len(recording.segments()) == segments
    assert "irregular" in said
    assert 26.0 < recording["time"][-1] - recording["time"][0] < 31.0
    if speed is not None:
        travelled = recording["position"][-1] - recording["position"][0]
        assert travelled == pytest.approx(147.98, abs=0.1)
        assert travelled / 30.0 == pytest.approx(speed, rel=0.01)
    else:
        # 2 Hz, 0.4 A
        torque = recording["torque"][: 2**13]
        strongest = np.argmax(np.abs(np.fft.rfft(torque - torque.mean()))) / (len(torque) * recording.period)
        assert strongest == pytest.approx(2.0, abs=0.13)
        assert 0.35 < np.percentile(np.abs(recording["torque"]), 98) < 0.6


LEAD_SCREW = (
    "--format", "epos",
    "--column", "velocity=Velocity actual value averaged*-rpm",
    "--column", "torque=Torque actual value averaged*-9.84e-3/100",
)  # fmt: skip


def test_lead_screw_steady_state_by_one_command(tmp_path: Path) -> None:
    files = sorted(map(str, (shared("lead_screw") / "steady_state/0.096kg").glob("*.csv")))
    recording, said = run_import(tmp_path / "lead.parquet", *files, *LEAD_SCREW)
    assert len(files) == 32
    assert [segment.experiment for segment in recording.segments()] == [Path(file).stem for file in files]
    assert recording.period == pytest.approx(6.4e-3)
    assert "sample periods differ" in said
    assert "integrated from velocity" in said
    curve = {}
    for segment, part in recording.split():
        rpm = float(np.mean(part["velocity"]) * 30 / np.pi)
        curve[segment.experiment] = (rpm, 1e3 * float(np.mean(part["torque"])))
        named = float(segment.experiment.removeprefix("n"))
        assert abs(rpm) == pytest.approx(named, rel=0.02, abs=0.2)
    # the authors' dip, in mN m; the files give it with three digits
    for name, torque in (("2", 2.77), ("50", 2.53), ("200", 3.21)):
        assert curve[name][1] == pytest.approx(torque, abs=0.006)
    assert all(np.sign(rpm) == np.sign(torque) for rpm, torque in curve.values())


def test_lead_screw_start_and_stop(tmp_path: Path) -> None:
    files = sorted(map(str, (shared("lead_screw") / "start_stop").glob("*.csv")))
    recording, _ = run_import(tmp_path / "start.csv", *files, *LEAD_SCREW)
    assert [segment.experiment for segment in recording.segments()] == ["200", "50"]
    assert recording.period == pytest.approx(0.04)
    assert len(recording) * recording.period == pytest.approx(40.0)
    assert recording.metadata.extra["position"].startswith("integrated")
