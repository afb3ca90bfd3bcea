"""Measured data of others: what is known to hide in them is found, and only suspected."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import autotune
from autotune.core.arrays import Floats
from autotune.diagnosis.fitting import add_effect, fit_model
from autotune.diagnosis.verdict import diagnose
from autotune.recordings.importing.importing import import_files
from autotune.recordings.importing.options import Options, Wishes
from autotune.recordings.recording import Recording
from bench.planted import AXES, MeasuredMotion, raised

DATA = Path(__file__).resolve().parents[2] / "../shared/data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the measured data of ../shared/data are not here")


def _imported(
    files: list[Path], kind: str, columns: tuple[str, ...], unit: str, torque: str | None
) -> Recording:
    options = Options(kind, columns, Wishes(unit, torque, None, None), None, None, None, False)
    return import_files(files, options).recording


@pytest.mark.slow
def test_lead_screw_speed_curve_has_a_stribeck_dip() -> None:
    """At most 1.3 % is left of 4 %; other authors' sign: both columns times −1."""
    files = sorted((DATA / "lead_screw/steady_state/0.096kg").glob("*.csv"))
    columns = (
        "torque=Torque actual value averaged*9.84e-3*-0.01",
        "velocity=Velocity actual value averaged*-1*rpm",
    )
    recording = _imported(files, "epos", columns, "rad", None)
    fitted = fit_model([recording])
    assert 0.03 < fitted.relative_error < 0.06
    found = diagnose([recording], fitted.model)
    assert found.effects == ("stribeck",)
    assert found.confidence == "suspected"
    assert "nonlinear_viscous" in found.confusable[0]
    assert set(found.where) == {"velocity", "direction"}
    assert not any("twin" in note for note in found.notes)
    added = add_effect("stribeck", [recording], fitted.model, "", "")
    again = fit_model([recording], ["stribeck"])
    assert 0.008 < again.relative_error < 0.013
    assert added.error_after < 0.5 * added.error_before


@pytest.mark.slow
@pytest.mark.long
def test_bldc_cogging_orders_are_found_unprompted() -> None:
    columns = ("time=Time", "position=Position", "velocity=Velocity", "torque=Iq")
    recording = _imported([DATA / "bldc_cogging/speed_test1.txt"], "csv", columns, "rad", "A")
    fitted = fit_model([recording])
    assert 0.3 < fitted.relative_error < 0.75
    again = fit_model([recording], ["torque_ripple"])
    orders = {round(again.model[f"torque_ripple.order_{i}"]) for i in range(1, 6)}
    assert {72, 18, 12, 24} <= orders
    assert 0.03 < again.relative_error < 0.1


@pytest.mark.slow(8)
def test_emps_asymmetry_comes_first() -> None:
    columns = ("time=t", "position=qm", "reference=qg", "torque=vir*35.15")
    recording = _imported([DATA / "emps/DATA_EMPS.mat"], "mat", columns, "m", None)
    fitted = fit_model([recording])
    assert fitted.model["inertia"] == pytest.approx(95.1, rel=0.005)
    found = diagnose([recording], fitted.model)
    assert found.verdict == "named"
    assert found.effects[0] == "direction_asymmetry"
    assert found.confidence == "suspected"
    assert found.next_experiment


@pytest.mark.slow(15)
@pytest.mark.long
def test_emps_ripple_is_named_beside_what_was_added_before_it() -> None:
    """As where all three are named at once: the rest is held against what all of them explain."""
    columns = ("time=t", "position=qm", "reference=qg", "torque=vir*35.15")
    recording = _imported([DATA / "emps/DATA_EMPS.mat"], "mat", columns, "m", None)
    model = fit_model([recording]).model
    for effect in ("direction_asymmetry", "nonlinear_viscous"):
        model = add_effect(effect, [recording], model, "", "").model
    found = diagnose([recording], model)
    assert (found.verdict, found.effects, found.confidence) == ("named", ("torque_ripple",), "suspected")


@pytest.mark.slow(10)
@pytest.mark.long
def test_emps_in_two_files_is_confirmed_by_each_other() -> None:
    """One base over both named nothing; what one half alone shows falls alone."""
    columns = ("time=t", "position=qm", "reference=qg", "torque=vir*35.15")
    whole = _imported([DATA / "emps/DATA_EMPS.mat"], "mat", columns, "m", None)
    first = np.arange(len(whole)) < len(whole) // 2
    halves = [whole.rows(first), whole.rows(~first)]
    found = diagnose(halves, fit_model(halves[:1]).model)
    assert found.effects == ("direction_asymmetry", "nonlinear_viscous")
    assert found.confidence == "confirmed"


@pytest.mark.slow(10)
def test_a_spring_in_measured_data_is_no_contact_that_never_slides() -> None:
    """Bent over most of the travel, a contact took the spring's place, and its friction was named viscous."""
    whole = raised(AXES["emps"].recording(), lambda motion: motion.place - 0.5, 0.3)
    half = whole.rows(np.arange(len(whole)) >= len(whole) // 2)
    found = autotune.diagnose([half], autotune.fit(half))
    assert found.verdict == "named"
    assert found.effects[:2] == ("spring", "direction_asymmetry")


@pytest.mark.slow(8)
def test_a_buffer_in_measured_data_is_a_spring_by_a_course_of_its_own() -> None:
    """What a straight line leaves of it was named friction over the place, beside the spring."""
    recording = raised(AXES["emps"].recording(), lambda motion: np.maximum(motion.place - 0.65, 0.0), 0.3)
    found = autotune.diagnose([recording], autotune.fit(recording))
    assert found.verdict == "named"
    assert found.effects[0] == "spring"
    assert "position_dependent_friction" not in found.effects
    assert any("Its law differs" in note for note in found.notes)


def _in_motor(law: Callable[[MeasuredMotion], Floats], level: float) -> tuple[Recording, Recording]:
    """Both halves of a motor's swings with an effect in its torque."""
    whole = raised(AXES["bldc-current"].recording(), law, level)
    first = np.arange(len(whole)) < len(whole) // 2
    return whole.rows(first), whole.rows(~first)


@pytest.mark.slow(6)
def test_friction_that_its_load_presses_is_no_filtered_position() -> None:
    """A filter of 16 ms was told, beside which nothing could be named; the other half was "none"."""
    halves = _in_motor(lambda motion: motion.slides * np.abs(motion.torque), 0.31)
    found = autotune.diagnose(halves, autotune.fit(halves[0]))
    assert (found.effects, found.confidence) == (("load_dependent_friction",), "confirmed")
    assert not any("low-passed" in note for note in found.notes)


@pytest.mark.slow(6)
def test_a_weight_in_a_motor_needs_no_friction_over_the_place_beside_it() -> None:
    """A filter took the most of it; what that left was named, confirmed by the other half."""
    halves = _in_motor(lambda motion: np.sin(motion.position + 1.0), 0.32)
    found = autotune.diagnose(halves, autotune.fit(halves[0]))
    assert (found.effects, found.confidence) == (("gravity_imbalance",), "confirmed")


@pytest.mark.slow(9)
def test_a_buffer_in_a_motor_is_a_spring_and_no_wave() -> None:
    """A weight behind a gear came nearer to it than a straight line, and nothing was named."""
    halves = _in_motor(lambda motion: np.maximum(motion.place - 0.6, 0.0), 0.39)
    found = autotune.diagnose(halves, autotune.fit(halves[0]))
    assert found.verdict in ("named", "ambiguous")
    assert found.effects == ("spring",)


@pytest.mark.slow(15)
@pytest.mark.long
def test_a_rival_of_the_second_effect_is_asked_again_beside_the_third() -> None:
    """A loss of torque and friction that grows with torque are one in these data; a third name beside hid that."""

    def loaded(motion: MeasuredMotion) -> Floats:
        return np.asarray(np.tanh(100.0 * motion.speed) * np.abs(motion.torque))

    recording = raised(AXES["emps"].recording(), loaded, 0.06)
    found = autotune.diagnose([recording], autotune.fit(recording))
    assert found.verdict == "ambiguous"
    assert {"load_dependent_friction", "torque_saturation"} <= set(found.confusable[0])
