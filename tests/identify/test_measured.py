"""Measured data of real axes, made by others; skipped where the folder with them is missing."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from autotune.diagnosis.compare import simulate_closed_loop
from autotune.estimation.controller import controller_of
from autotune.identify.fit import fit
from autotune.identify.steady_state import identify_steady_state
from autotune.recordings.importing.importing import import_files
from autotune.recordings.importing.options import Options
from autotune.recordings.recording import Metadata, Recording
from tests.support.emps import authors_error

SHARED = Path(__file__).resolve().parents[2] / "../shared/data"
RPM = 2 * np.pi / 60


@pytest.fixture(scope="module")
def emps() -> Recording:
    path = SHARED / "emps" / "DATA_EMPS.mat"
    if not path.is_file():
        pytest.skip("EMPS data are not here: ../shared/data/emps")
    raw = {name: np.asarray(values).squeeze() for name, values in loadmat(path).items() if name[0] != "_"}
    columns = {
        "time": raw["t"],
        "position": raw["qm"],
        "reference": raw["qg"],
        "torque": raw["vir"] * float(raw["gtau"]),
    }
    return Recording.from_columns(columns, Metadata(motion_unit="m", sample_period=1e-3), "emps")


@pytest.fixture(scope="module")
def symmetric(emps):
    return fit(emps)


@pytest.fixture(scope="module")
def asymmetric(emps):
    return fit(emps, ["direction_asymmetry"])


def test_emps_parameters_are_the_authors(symmetric) -> None:
    assert symmetric.valid, symmetric.reason
    assert symmetric.model["inertia"] == pytest.approx(95.1089, rel=0.02)
    assert symmetric.model["viscous"] == pytest.approx(203.5034, rel=0.05)
    assert symmetric.model["coulomb"] == pytest.approx(20.3935, rel=0.05)
    assert symmetric.model["offset"] == pytest.approx(-3.1648, rel=0.05)


def test_emps_force_error_is_at_most_the_authors(emps, symmetric, asymmetric) -> None:
    """Authors: 4.083 % and 3.112 %; far below would be another metric."""
    assert 3.0 < authors_error(emps, symmetric.model) <= 4.08
    assert 2.3 < authors_error(emps, asymmetric.model) <= 3.11


def test_emps_asymmetry_is_that_of_the_authors(asymmetric) -> None:
    """Half of 166.7 − 240.4; what the Coulomb levels differ by cannot be told from the offset."""
    assert asymmetric.model["direction_asymmetry.viscous"] == pytest.approx(-36.9, rel=0.25)
    assert any("cannot tell it from the offset" in note for note in asymmetric.estimate.notes)


def test_emps_in_the_loop(emps, symmetric) -> None:
    """Authors: position 0.0138 %, force 5.85 %."""
    result = simulate_closed_loop(emps, symmetric.model)
    assert 0 < 100 * result.relative_position_error <= 0.014
    assert 100 * result.relative_torque_error <= 5.85


def test_emps_controller_is_recognised(emps) -> None:
    """A cascade: kp = 160.18 · 243.45 V/m, damping on the velocity alone; in N with 35.15 N/V."""
    law = controller_of(emps)
    assert law.usable
    assert law.kp == pytest.approx(160.18 * 243.45 * 35.15, rel=0.01)
    assert law.kd == pytest.approx(243.45 * 35.15, rel=0.01)
    assert law.reference_rate == pytest.approx(0.0, abs=0.02)


def test_emps_cannot_tell_the_contact(symmetric) -> None:
    assert "stiffness" in symmetric.reason
    assert not symmetric.estimate.parameters["stiffness"].identified


@pytest.fixture(scope="module")
def lead_screw() -> Recording:
    folder = SHARED / "lead_screw/steady_state/0.096kg"
    if not folder.is_dir():
        pytest.skip("lead screw data are not here: ../shared/data/lead_screw")
    columns = (
        "velocity=Velocity actual value averaged*-rpm",
        "torque=Torque actual value averaged*-9.84e-3/100",
    )
    return import_files(sorted(folder.glob("*.csv")), Options("epos", columns)).recording


def test_lead_screw_curve_has_its_dip_near_50_rpm(lead_screw) -> None:
    """2.77 mN m at 2 rpm, 2.53 at 50 and 3.21 at 199, each within 3 %."""
    points = identify_steady_state(lead_screw).points
    assert len(points) == 32
    speed = points.velocity / RPM
    for rpm, torque in ((2.0, 2.77e-3), (50.0, 2.53e-3), (199.0, 3.21e-3)):
        assert points.torque[np.argmin(np.abs(speed - rpm))] == pytest.approx(torque, rel=0.03)
    forward = speed > 0
    dip = speed[forward][np.argmin(points.torque[forward])]
    assert 40 < dip < 80


def test_lead_screw_is_fitted_as_a_speed_curve(lead_screw) -> None:
    plain, dipped = fit(lead_screw), fit(lead_screw, ["stribeck", "direction_asymmetry"])
    assert dipped.valid
    assert "Inertia, stiffness and micro_damping are not identified" in dipped.reason
    assert 0.04 < plain.relative_error < 0.055
    assert 0.005 < dipped.relative_error < 0.014
    assert dipped.model.parameters["inertia"].standard_error is None
