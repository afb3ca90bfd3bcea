"""What is not written in the file is asked for, never guessed; what cannot be is refused with the row."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import AutotuneError, ConfigurationError, RecordingError
from autotune.recordings.importing.factor import evaluate
from autotune.recordings.importing.plausible import refuse_other_velocity, refuse_wrong_sign
from autotune.recordings.importing.recognise import guess
from autotune.recordings.importing.source import Column
from autotune.recordings.importing.units import SCALED, find_unit, split_unit
from autotune.recordings.recording import Metadata, Recording
from autotune_sim.presets import preset
from tests.support.identification_programme import play

from .conftest import Floats, axis_signals, bring_in, write_table

HEAD = "t [s],pos [rad],vel [rad/s],tau [Nm]"


@pytest.mark.parametrize(
    ("text", "kind", "factor"),
    [
        ("ms", "time", 1e-3), ("[µs]", "time", 1e-6), ("deg", "angle", np.pi / 180), ("°", "angle", np.pi / 180),
        ("1/min", "angular speed", np.pi / 30), ("rpm", "angular speed", np.pi / 30), ("mm", "length", 1e-3),
        ("mNm", "torque", 1e-3), ("N·m", "torque", 1.0), ("N m", "torque", 1.0), ("mN", "force", 1e-3),
        ("Nm", "torque", 1.0), ("A", "current", 1.0), ("mA", "current", 1e-3), ("%", "share", 1e-2),
        ("rad/s", "angular speed", 1.0), ("qc", "counts", 1.0),
    ],
)  # fmt: skip
def test_units(text: str, kind: str, factor: float) -> None:
    unit = find_unit(text)
    assert unit is not None
    assert unit.kind == kind
    assert unit.factor == pytest.approx(factor)


@pytest.mark.parametrize(("text", "called"), [("[Deg]", "Deg"), ("mNm", "mNm"), ("N m", "Nm"), (" A ", "A")])
def test_a_unit_is_called_as_it_is_written(text: str, called: str) -> None:
    unit = find_unit(text)
    assert unit is not None
    assert unit.text == called


LISTED = [
    (kind, factor, word)
    for kind, factors in SCALED.items()
    for factor, words in factors.items()
    for word in words.split()
]


@pytest.mark.parametrize("written", ["{}", "[{}]", "({})", " {} "])
def test_every_listed_unit_is_found_however_it_is_written(written: str) -> None:
    for kind, factor, word in LISTED:
        shapes = (
            [word, word.capitalize(), word.upper()] if "µ" not in word else [word, word.replace("µ", "μ")]
        )
        for shape in shapes:
            if shape in ("MN", "Nm", "NM"):
                continue
            unit = find_unit(written.format(shape), "length" if kind == "length" else "")
            assert unit is not None, shape
            assert (unit.kind, unit.factor) == (kind, factor), shape


def test_every_listed_unit_comes_back_from_a_header_and_as_a_factor() -> None:
    for kind, factor, word in LISTED:
        assert split_unit(f"Name [{word}]") == ("Name", word)
        if kind not in ("share", "counts", "count rate") and (kind, word) != ("length", "nm"):
            assert evaluate(word, {}, "here") == pytest.approx(factor, rel=1e-12)
            assert evaluate(f"-{word}", {}, "here") == pytest.approx(-factor, rel=1e-12)


def test_no_unit_is_listed_twice() -> None:
    words = [word for _, _, word in LISTED if word != "nm"]
    assert len(words) == len(set(words))


@pytest.mark.parametrize(
    ("text", "kind", "factor"),
    [
        ("Grad", "angle", np.pi / 180), ("U/min", "angular speed", np.pi / 30),
        ("Grad/s", "angular speed", np.pi / 180),
        ("tr/min", "angular speed", np.pi / 30), ("Umdr.", "angle", 2 * np.pi), ("degrés", "angle", np.pi / 180),
        ("min⁻¹", "angular speed", np.pi / 30), ("rad s^-1", "angular speed", 1.0), ("N mm", "torque", 1e-3),
        ("lbf·in", "torque", 0.11298483), ("ft-lb", "torque", 1.3558179), ("oz-in", "torque", 7.0615518e-3),
        ("Inkremente", "counts", 1.0), ("Zoll", "length", 0.0254), ("Prozent", "share", 1e-2),
        ("gon", "angle", np.pi / 200),
    ],
)  # fmt: skip
def test_units_of_three_languages(text: str, kind: str, factor: float) -> None:
    unit = find_unit(text)
    assert unit is not None
    assert (unit.kind, unit.factor) == (kind, pytest.approx(factor, rel=1e-7))


def test_nanometres_are_a_length_where_one_is_meant() -> None:
    nanometre = find_unit("nm", "length")
    assert nanometre is not None
    assert (nanometre.kind, nanometre.factor) == ("length", 1e-9)


@pytest.mark.parametrize("text", ["MN", "MNm", "furlong", "", "rad/s²"])
def test_unknown_units_are_not_guessed(text: str) -> None:
    assert find_unit(text) is None


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("Position [deg]", "Position", "deg"), ("pos_deg", "pos", "deg"), ("Torque in Nm", "Torque", "Nm"),
        ("Speed(rpm)", "Speed", "rpm"), ("Time, s", "Time", "s"), ("time", "time", ""),
        ("position_actual", "position_actual", ""), ("q_m", "q_m", ""), ("pos_m", "pos_m", ""),
        ("vel_deg_s", "vel", "deg/s"), ("dq_rad_per_s", "dq", "rad/s"), ("v_mm_s", "v", "mm/s"),
        ("n_rev_min", "n", "rev/min"), ("acc_rad_s2", "acc_rad_s2", ""), ("cycle_time_s", "cycle_time", "s"),
        ("vel_rad/s", "vel", "rad/s"), ("force_N", "force", "N"), ("Kraft_N", "Kraft", "N"),
        ("samples_N", "samples_N", ""),
        ("Time / s", "Time", "s"), ("Speed / rad/s", "Speed", "rad/s"), ("Position/deg", "Position", "deg"),
    ],
)  # fmt: skip
def test_units_in_names(header: str, name: str, unit: str) -> None:
    assert split_unit(header) == (name, unit)


@pytest.mark.parametrize(
    ("name", "unit", "target"),
    [
        ("Position actual value", "", "position"), ("Position demand value", "", "reference"),
        ("Target position", "", "reference"), ("qm", "", "position"), ("qg", "", "reference"),
        ("Velocity actual value averaged", "rpm", "velocity"), ("Reference Velocity", "", ""),
        ("Torque actual value averaged", "%", "torque"), ("Torque demand", "", "torque_command"),
        ("Current actual value averaged", "mA", "current"), ("Iq", "", "current"), ("Uq", "", "voltage"),
        ("Following error actual value", "", ""), ("position error", "", ""), ("Time", "", "time"),
        ("motorTorque", "Nm", "torque"), ("Torque", "A", "current"), ("pos1", "", "position"), ("acceleration", "", ""),
        ("Motor torque", "A", "current"), ("Sollposition", "°", "reference"), ("Istposition", "°", "position"),
        ("Lageistwert", "mm", "position"), ("Drehmomentsollwert", "Nm", "torque_command"), ("Motorist", "", ""),
        ("actual_q_1", "rad", "position"), ("joint_q", "", "position"), ("target_q_1", "rad", ""), ("q x", "rad", ""),
        ("setpoint", "deg", "reference"), ("Set point", "deg", "reference"), ("Torque feed-forward", "Nm",
        "torque_feedforward"), ("Sollwert", "°", "reference"), ("commanded", "mm", "reference"),
        ("Weg", "mm", "position"), ("Sollweg", "mm", "reference"),
        ("Torque set", "Nm", "torque_command"), ("Lage Ist", "mm", "position"), ("F_cmd", "N", "torque_command"),
        ("F", "N", ""), ("M_ist", "Nm", "torque"), ("F_act", "N", "torque"), ("F1_act", "N", ""),
        ("iq_ref", "A", "current_command"), ("Torque demand", "A", "current_command"), ("current limit", "A", ""),
        ("command", "Nm", "torque_command"), ("setpoint", "rpm", ""), ("setpoint", "", ""), ("limit", "Nm", ""),
    ],
)  # fmt: skip
def test_names(name: str, unit: str, target: str) -> None:
    assert guess(Column(name, unit)).target == target


WANTED_AND_MEASURED = (
    "x_ref [mm],x [mm],F [N],F_cmd [N]",
    "x_soll [mm],x_ist [mm],M_ist [N],M_soll [N]",
    "q_set [rad],q_act [rad],M_fb [Nm],M_set [Nm]",
    "command [rad],actual [rad],torque_actual [Nm],torque_demand [Nm]",
    "pos1_ref [mm],pos1 [mm],F1 [N],F1_cmd [N]",
    "Sollwert [°],Istwert [°],Moment Ist [Nm],Moment Soll [Nm]",
)


@pytest.mark.parametrize("names", WANTED_AND_MEASURED)
@pytest.mark.parametrize("turned", [False, True])
def test_what_bears_the_name_of_a_command_is_the_measured_one(
    tmp_path: Path, signals: dict[str, Floats], names: str, turned: bool
) -> None:
    """A heading such as `F` says little by itself, and enough beside `F_cmd`; in whatever order."""
    given = (0.9 * signals["position"], signals["position"], signals["torque"], 0.9 * signals["torque"])
    targets = ("reference", "position", "torque", "torque_command")
    columns = list(zip(names.split(","), given, strict=True))[:: -1 if turned else 1]
    table = {"t [s]": signals["time"]} | dict(columns)
    recording = bring_in(write_table(tmp_path / "t.csv", table)).recording
    factor = 1e-3 if "[mm]" in names else np.pi / 180.0 if "°" in names else 1.0
    for target, values, scale in zip(targets, given, (factor, factor, 1.0, 1.0), strict=True):
        np.testing.assert_allclose(recording[target], scale * values, rtol=1e-6, atol=1e-9)


def test_a_wanted_column_of_another_number_is_not_taken(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """Of several joints the one that a person names brings its own reference, or none."""
    q = signals["position"]
    table = {"t [s]": signals["time"], "q_1 [rad]": q, "ref_q_1 [rad]": 0.9 * q, "q_2 [rad]": 2.0 * q}
    path = write_table(tmp_path / "t.csv", {**table, "tau [Nm]": signals["torque"]})
    assert "reference" not in bring_in(path, columns=("position=q_2",)).recording
    first = bring_in(path, columns=("position=q_1",)).recording
    np.testing.assert_allclose(first["reference"], 0.9 * q, rtol=1e-6, atol=1e-9)


def test_a_current_commanded_comes_along_in_amperes(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """By name: `id` is in amperes too. A command in newton metres is none of a torque in amperes."""
    table = {"t [s]": signals["time"], "q [rad]": signals["position"]}
    currents = {f"i{axis}{end} [A]": signals["torque"] for axis in "dq" for end in ("", "_ref")}
    currents["id [A]"] = currents["id_ref [A]"] = np.zeros(len(signals["time"]))
    path = write_table(tmp_path / "t.csv", table | currents)
    recording = bring_in(path, torque_unit="A").recording
    for target in ("torque", "torque_command"):
        np.testing.assert_allclose(recording[target], signals["torque"], rtol=1e-6, atol=1e-9)
    mixed = {"iq [A]": signals["torque"], "tau_cmd [Nm]": signals["torque"]}
    assert (
        "torque_command"
        not in bring_in(write_table(tmp_path / "mixed.csv", table | mixed), torque_unit="A").recording
    )


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2", 2.0), ("-1e-3", -1e-3), ("6.28/60", 6.28 / 60), ("2*pi/60", np.pi / 30), ("-rpm", -np.pi / 30),
        ("1/min", np.pi / 30), ("gtau", 35.0), ("-gtau*2", -70.0), ("deg", np.pi / 180), ("rad/s", 1.0),
        ("1e-3*2*pi/0.005", 1e-3 * 2 * np.pi / 0.005),
    ],
)  # fmt: skip
def test_factors(text: str, value: float) -> None:
    assert evaluate(text, {"gtau": 35.0}, "here") == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    "text", ["", "0", "1/0", "inf", "nan", "x", "2**3", "__import__('os')", "1e999", "%"]
)
def test_wrong_factors(text: str) -> None:
    with pytest.raises(ConfigurationError, match="factor"):
        evaluate(text, {}, "here")


@pytest.mark.parametrize(
    ("head", "columns", "message"),
    [
        ("t [s],pos,vel [rad/s],tau [Nm]", (), "no unit, and a guess could be wrong"),
        ("t [s],pos [rad],vel [rad/s],tau", (), "no unit, and a guess could be wrong"),
        ("t [s],pos [counts],vel [rad/s],tau [Nm]", (), "encoder counts"),
        ("t [s],pos [rad],vel [rad/s],Iq [A]", (), r"torque=Iq\*0.12"),
        ("t [s],pos [rad],vel [rad/s],Iq [A]", ("torque=Iq",), "--torque-unit A"),
        ("t [s],pos [rad],vel [rad/s],Uq", ("torque=Uq",), "--torque-unit V"),
        ("t [s],pos [rad],vel [rad/s],tau [%]", (), "share of the rated torque"),
        ("t [s],pos [parsec],vel [rad/s],tau [Nm]", (), "not known"),
        ("t [s],pos [deg],vel [rad/s],tau [Nm]", ("position=pos*-1",), r"pos\*-deg"),
        ("t [s],pos [mm],vel [rad/s],tau [Nm]", (), "linear"),
        ("t [s],pos [rad],pos2 [rad],tau [Nm]", (), "2 columns that may be position"),
        ("a,b,c,d", (), "cannot tell which column"),
        (
            "t [s],alpha [rad],vel [rad/s],tau [Nm]",
            (),
            "no column is called a position, but 1 measures an angle",
        ),
        (HEAD, ("position=angle",), "has no column 'angle'"),
        (HEAD, ("position=pso",), "did you mean 'pos'"),
        (HEAD, ("postion=pos",), "did you mean position"),
        (HEAD, ("position",), "NAME=FIELD"),
        (HEAD, ("position=pos", "position=pos*2"), "twice"),
        (HEAD, ("experiment=pos",), "no column of labels"),
        (HEAD, ("position=pos*pony",), "pony"),
    ],
)
def test_doubts_are_asked(
    tmp_path: Path, signals: dict[str, Floats], head: str, columns: tuple[str, ...], message: str
) -> None:
    path = write_table(tmp_path / "table.csv", signals, head=head)
    with pytest.raises(AutotuneError, match=message) as caught:
        bring_in(path, columns=columns)
    assert caught.value.exit_code == 2


def test_what_the_message_asks_for_is_accepted(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "table.csv", signals, head="t,Pos,Vel,Iq")
    with_constant = bring_in(path, columns=("position=Pos", "torque=Iq*0.5")).recording
    np.testing.assert_allclose(with_constant["torque"], 0.5 * signals["torque"], rtol=1e-8)
    amperes = bring_in(path, columns=("position=Pos",), torque_unit="A").recording
    np.testing.assert_allclose(amperes["torque"], signals["torque"], rtol=1e-8)
    assert amperes.metadata.extra["torque_unit"] == "A"


def test_every_column_taken_is_said(tmp_path: Path, signals: dict[str, Floats]) -> None:
    signals["position"] = np.degrees(signals["position"])
    lines = "\n".join(
        bring_in(write_table(tmp_path / "t.csv", signals, head=HEAD.replace("pos [rad]", "pos [deg]"))).lines
    )
    for target in (
        "time = 't'",
        "position = 'pos' [deg] × 0.0174532925",
        "velocity = 'vel'",
        "torque = 'tau'",
    ):
        assert target in lines
    assert "motion unit rad (units in the file)" in lines


def test_counts_are_recognised_by_their_values(tmp_path: Path, signals: dict[str, Floats]) -> None:
    signals["position"] = np.round(signals["position"] * 8192 / (2 * np.pi))
    path = write_table(tmp_path / "t.csv", signals, head="time,position,speed,torque")
    with pytest.raises(ConfigurationError, match="looks like encoder counts"):
        bring_in(path)
    recording = bring_in(path, columns=("position=position*2*pi/8192",)).recording
    np.testing.assert_allclose(recording["position"], axis_signals()["position"], atol=2 * np.pi / 8192)


@pytest.mark.parametrize(("digits", "found"), [(6, True), (5, True), (4, False)])
def test_counts_are_told_through_the_digits_of_a_file(tmp_path: Path, digits: int, found: bool) -> None:
    """Five digits made the smallest step 0.4 % small, so that steps of fifteen counts lay on no grid of it; of four
    digits a count has fourteen, and none is told.
    """
    signals, count = axis_signals(period=3e-3), 2.0 * np.pi / 4256.0
    signals["position"] = np.round(np.round(signals["position"] / count) * count, digits)
    del signals["velocity"]
    told = bring_in(write_table(tmp_path / "t.csv", signals)).recording.metadata.position_resolution
    assert (told == pytest.approx(count, rel=1e-4)) if found else (told is None)


def test_counts_with_a_written_unit_use_the_resolution(tmp_path: Path, signals: dict[str, Floats]) -> None:
    count = 2 * np.pi / 8192
    signals["position"] = np.round(signals["position"] / count)
    path = write_table(tmp_path / "t.csv", signals, head="t [s],pos [inc],vel [rad/s],tau [Nm]")
    recording = bring_in(path, resolution=count).recording
    np.testing.assert_allclose(recording["position"], axis_signals()["position"], atol=count)
    assert recording.metadata.position_resolution == count


def test_milliseconds_without_a_unit_are_asked_for(tmp_path: Path, signals: dict[str, Floats]) -> None:
    signals["time"] = np.arange(len(signals["time"]), dtype=float)
    path = write_table(tmp_path / "t.csv", signals)
    with pytest.raises(ConfigurationError, match=r"time=time\*ms"):
        bring_in(path)
    assert bring_in(path, columns=("time=time*ms",)).recording.period == pytest.approx(1e-3)


@pytest.mark.parametrize("turned", ["torque", "position"])
def test_a_wrong_sign_is_asked_for_not_turned(
    tmp_path: Path, signals: dict[str, Floats], turned: str
) -> None:
    signals.pop("velocity")
    signals[turned] = -signals[turned]
    path = write_table(tmp_path / "t.csv", signals)
    with pytest.raises(RecordingError, match=r"opposite directions.*torque=FIELD"):
        bring_in(path)
    kept = bring_in(path, keep_signs=True).recording
    np.testing.assert_allclose(kept[turned], signals[turned], rtol=1e-8, atol=1e-12)
    bring_in(path, columns=(f"{turned}={turned}*-1",))


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize(
    ("inertia", "friction", "gravity", "spring"),
    [(0.01, 0.3, 0.0, 0.0), (0.0, 0.3, 5.0, 0.0), (0.05, 0.01, 0.0, 0.0), (0.01, 0.1, 1.0, 3.0)],
)
def test_right_signs_are_never_questioned(
    tmp_path: Path, inertia: float, friction: float, gravity: float, spring: float, noise: float
) -> None:
    """Gravity, springs, noise and coarse encoders do not make an axis look turned round; turning it does."""
    random = np.random.default_rng(7)
    time = 1e-3 * np.arange(6000)
    position = 0.5 * np.sin(7 * time) + 0.2 * np.sin(23 * time)
    velocity, acceleration = np.gradient(position, time), np.gradient(np.gradient(position, time), time)
    torque = inertia * acceleration + friction * np.sign(velocity) + gravity + spring * position
    torque += noise * random.standard_normal(len(time))
    columns = {"time": time, "position": np.round(position / 1e-3) * 1e-3, "torque": torque}
    bring_in(write_table(tmp_path / "t.csv", columns))
    columns["torque"] = -torque
    with pytest.raises(RecordingError, match="opposite directions"):
        bring_in(write_table(tmp_path / "t.csv", columns))


def test_noise_at_standstill_is_no_wrong_sign(tmp_path: Path) -> None:
    """A controller that answers encoder noise at rest has torque against position, and is right."""
    random = np.random.default_rng(3)
    noise = np.round(random.standard_normal(5000)) * 1e-5
    columns = {"time": 1e-3 * np.arange(5000), "position": noise, "torque": -500 * noise}
    imported = bring_in(write_table(tmp_path / "t.csv", columns))
    np.testing.assert_allclose(imported.recording["torque"], columns["torque"], atol=1e-12)


@pytest.mark.parametrize(
    ("factor", "message"),
    [(-1.0, "opposite signs"), (60 / (2 * np.pi), "rpm"), (180 / np.pi, "deg/s"), (3.7, "3.7 times")],
)
def test_velocity_of_another_unit_is_noticed(
    tmp_path: Path, signals: dict[str, Floats], factor: float, message: str
) -> None:
    signals["velocity"] *= factor
    with pytest.raises(RecordingError, match=message):
        bring_in(write_table(tmp_path / "t.csv", signals))


def test_clipped_torque_is_noted(tmp_path: Path, signals: dict[str, Floats]) -> None:
    signals["torque"] = np.clip(signals["torque"], -0.8, 0.8)
    imported = bring_in(write_table(tmp_path / "t.csv", signals))
    assert "±0.8" in imported.recording.metadata.extra["torque_clipped"]
    assert any("--torque-limit" in line for line in imported.lines)


@pytest.mark.parametrize("shape", ["steps", "two levels", "random levels", "one ramp"])
def test_a_torque_that_is_held_is_not_clipped(tmp_path: Path, signals: dict[str, Floats], shape: str) -> None:
    """Torque control by steps is flat at its extreme too, again and again."""
    random, time = np.random.default_rng(6), signals["time"]
    signals["torque"] = {
        "steps": np.repeat([0.0, 0.5, 0.0, -0.5] * 5, 100),
        "two levels": np.where(random.random(200) < 0.5, -0.5, 0.5).repeat(10),
        "random levels": random.choice([-0.6, -0.2, 0.1, 0.6], 200).repeat(10),
        "one ramp": np.minimum(time, 0.8),
    }[shape]
    imported = bring_in(write_table(tmp_path / "t.csv", signals), keep_signs=True)
    assert "torque_clipped" not in imported.recording.metadata.extra


def test_constant_columns_are_said(tmp_path: Path, signals: dict[str, Floats]) -> None:
    signals["torque"][:] = 0.0
    assert any(
        "torque is 0 in all rows" in line for line in bring_in(write_table(tmp_path / "t.csv", signals)).lines
    )


def test_few_missing_numbers_are_dropped_and_said_many_are_refused(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    signals["torque"][[5, 700]] = np.nan
    imported = bring_in(write_table(tmp_path / "t.csv", signals))
    assert any("2 rows without a number are dropped, the first is row 6" in line for line in imported.lines)
    np.testing.assert_allclose(imported.recording["position"], axis_signals()["position"], atol=1e-4)
    signals["torque"][100:200] = np.nan
    with pytest.raises(
        RecordingError, match="torque has 102 of 2000 values that are not numbers, the first in row 6"
    ):
        bring_in(write_table(tmp_path / "t.csv", signals))


def test_values_beyond_any_axis_are_refused_with_their_row(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    signals["torque"][41] = 1e300
    with pytest.raises(RecordingError, match=r"torque is 1e\+300 at row 42"):
        bring_in(write_table(tmp_path / "t.csv", signals))


def test_an_unusual_size_is_asked_about(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """Counts declared as rad: the speed is a turbine's, and that is said."""
    signals.pop("velocity")
    signals["position"] *= 2000.0
    lines = bring_in(write_table(tmp_path / "t.csv", signals)).lines
    assert any("highest speed is 1.5" in line and "Are the units right?" in line for line in lines)


def test_mixed_axes_are_refused(tmp_path: Path, signals: dict[str, Floats]) -> None:
    both = {name: np.repeat(values, 2) for name, values in signals.items()}
    both["position"][1::2] += 5.0
    both.pop("velocity")
    with pytest.raises(RecordingError, match="two axes are mixed"):
        bring_in(write_table(tmp_path / "t.csv", both))


@pytest.mark.slow
def test_the_signs_of_a_simulated_axis_are_right_and_turned_ones_are_found() -> None:
    """Steady state, presliding, Dahl's curve, PRBS and benchmark of the vertical axis, gravity included."""
    axis = preset("edm-vertical")
    recording = play(axis, 1)
    turned = replace(
        recording, floats={name: -v if name == "torque" else v for name, v in recording.floats.items()}
    )
    for name in dict.fromkeys(segment.experiment for segment in recording.segments()):
        refuse_wrong_sign(recording.select(name), name)
    refuse_wrong_sign(recording, "all")
    refuse_other_velocity(recording, "all")
    with pytest.raises(RecordingError, match="opposite directions"):
        refuse_wrong_sign(turned, "all")


def test_a_velocity_that_lacks_a_number_says_nothing_of_its_unit() -> None:
    """One empty cell was a velocity of "nan times the derivative of position", whatever the others were."""
    time = 1e-3 * np.arange(4000)
    columns = {"time": time, "position": np.sin(3.0 * time), "torque": 0.1 * np.sign(np.cos(3.0 * time))}

    def asked(velocity: Floats) -> str:
        recording = Recording.from_columns(
            {**columns, "velocity": velocity}, Metadata(sample_period=1e-3), "a"
        )
        try:
            refuse_other_velocity(recording, "all")
        except RecordingError as error:
            return str(error)
        return ""

    turns_a_minute = 3.0 * np.cos(3.0 * time) * 60.0 / (2.0 * np.pi)
    assert "velocity" in asked(turns_a_minute)
    turns_a_minute[1234] = np.nan
    assert asked(turns_a_minute) == ""


@pytest.mark.parametrize(
    ("unit", "factor", "motion_unit"),
    [("deg", 180.0 / np.pi, "rad"), ("turns", 0.5 / np.pi, "rad"), ("mm", 1e3, "m")],
)
def test_a_position_in_another_unit_than_its_velocity_is_named(
    unit: str, factor: float, motion_unit: str
) -> None:
    """Degrees beside rad/s: the factor 57.3 that was offered made both wrong, and was taken."""
    time = 1e-3 * np.arange(4000)
    columns = {
        "time": time,
        "position": factor * np.sin(3.0 * time),
        "velocity": 3.0 * np.cos(3.0 * time),
        "torque": 0.1 * np.sign(np.cos(3.0 * time)),
    }
    recording = Recording.from_columns(columns, Metadata(sample_period=1e-3, motion_unit=motion_unit), "a")
    with pytest.raises(RecordingError, match=re.escape(f"'--column position=FIELD*{unit}'")):
        refuse_other_velocity(recording, "all")
    known = find_unit(unit)
    assert known is not None
    assert known.factor == pytest.approx(1.0 / factor)
