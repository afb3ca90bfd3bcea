"""Columns by the file's own numbers, and one command that asks for everything in doubt at once."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy import io as matlab
from typer.testing import CliRunner

from autotune.cli.data import data
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.recordings.files import read_recording

from .conftest import Floats, bring_in, write_table


def with_texts(path: Path, signals: dict[str, Floats]) -> Path:
    """`state,time,note,position,speed,torque`, columns 1 and 3 without numbers."""
    rows = zip(signals["time"], signals["position"], signals["velocity"], signals["torque"], strict=True)
    lines = ["state,time,note,position,speed,torque"]
    lines += [f"RUN,{t:.9g},fine,{q:.9g},{v:.9g},{tau:.9g}" for t, q, v, tau in rows]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_columns_count_as_a_person_sees_them(tmp_path: Path, signals: dict[str, Floats], kind: str) -> None:
    path = tmp_path / f"t.{kind}"
    if kind == "csv":
        with_texts(path, signals)
    else:
        words = pa.array(["x"] * len(signals["time"]))
        names = ["state", "time", "note", "position", "speed", "torque"]
        arrays = [words, signals["time"], words, signals["position"], signals["velocity"], signals["torque"]]
        pyarrow.parquet.write_table(pa.table(dict(zip(names, arrays, strict=True))), path)
    recording = bring_in(
        path, kind=kind, columns=("time=2", "position=4", "velocity=5", "torque=6")
    ).recording
    for name, values in signals.items():
        np.testing.assert_allclose(recording[name], values, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("field", ["3", "note"])
def test_a_column_of_texts_is_refused_in_words(
    tmp_path: Path, signals: dict[str, Floats], field: str
) -> None:
    path = with_texts(tmp_path / "t.csv", signals)
    with pytest.raises(ConfigurationError, match=r"column 3 of .*'note', holds texts.*4 'position'"):
        bring_in(path, columns=(f"position={field}",))


def test_one_column_is_not_two_quantities(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "t.csv", signals)
    with pytest.raises(ConfigurationError, match=r"takes column 2, 'position', .*as position and as torque"):
        bring_in(path, columns=("position=2", "torque=position*3"))


@pytest.mark.slow
def test_matrices_of_another_length_are_reached_by_name(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """Six vectors of a table of gains outnumber the one matrix that was measured."""
    path = tmp_path / "t.mat"
    gains = {f"gain{number}": np.arange(7.0) for number in range(6)}
    measured = np.column_stack([signals["time"], signals["position"], signals["torque"]])
    matlab.savemat(path, {**gains, "measured": measured, "velocity": signals["velocity"]})
    columns = ("time=measured.1", "position=measured.2", "torque=measured.3")
    imported = bring_in(path, kind="mat", columns=columns)
    for name in ("time", "position", "torque", "velocity"):
        np.testing.assert_array_equal(imported.recording[name], signals[name])
    assert any("unless --column names them: measured.1 (2000)" in line for line in imported.lines)
    with pytest.raises(ConfigurationError, match=r"differ in length: .*'gain0' with 7.*with 2000"):
        bring_in(path, kind="mat", columns=("time=gain0", *columns[1:]))


def test_columns_of_one_name_are_suggested_by_number(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "t.csv", signals, head="time,angle [rad],angle [rad],torque")
    with pytest.raises(ConfigurationError, match=r"one of 'position=2', 'position=3'\."):
        bring_in(path)
    with pytest.raises(ConfigurationError, match=r"did you mean 'angle', columns 2, 3\?"):
        bring_in(path, columns=("position=angel",))
    bare = write_table(tmp_path / "bare.csv", signals, head="time [s],x,x,x")
    with pytest.raises(AutotuneError, match=r"the file has 'time' \[s\], 2 'x', 3 'x', 4 'x'"):
        bring_in(bare)


def test_a_column_is_found_by_the_name_that_stands_in_the_file(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    """Its unit is read off the end of the name; a person still calls it as the file does."""
    path = write_table(tmp_path / "t.csv", signals, head="t_s,angle_rad,speed_rad,torque_nm")
    columns = ("time=t_s", "position=angle_rad", "torque=torque_nm")
    for name in ("time", "position", "torque"):
        np.testing.assert_allclose(bring_in(path, columns=columns).recording[name], signals[name], atol=1e-5)


def test_everything_in_doubt_is_asked_for_at_once(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """The command is pasted with its capitals filled in, and nothing else is asked."""
    signals["time"] *= 1e3
    path = write_table(tmp_path / "my axis.csv", signals, head="t,pos,vel,Iq")
    with pytest.raises(ConfigurationError) as caught:
        bring_in(path, resolution=1e-6, experiment="sine")
    message = str(caught.value)
    for doubt in ("'pos' has no unit", "'t' steps by 1", "'Iq' is a current"):
        assert message.count(doubt) == 1
    command = message.splitlines()[-1].strip()
    assert "--resolution 1e-06 --experiment sine" in command
    for capitals, known in (("t*UNIT", "t*ms"), ("pos*UNIT", "pos*rad"), ("CONSTANT", "0.5")):
        assert capitals in command
        command = command.replace(capitals, known)
    out = tmp_path / "out.parquet"
    arguments = shlex.split(command)
    assert arguments[:3] == ["autotune", "data", "import"]
    assert arguments[-2:] == ["--out", "my axis-imported.parquet"]
    result = CliRunner().invoke(data, [*arguments[2:-1], str(out)], catch_exceptions=False)
    assert result.exit_code == 0
    np.testing.assert_allclose(read_recording(out)["torque"], 0.5 * signals["torque"], rtol=1e-8)


def test_the_command_that_is_asked_for_writes_where_it_was_wanted(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    path, out = write_table(tmp_path / "t.csv", signals, head="t,pos,vel,Iq"), tmp_path / "mine.csv"
    result = CliRunner().invoke(data, ["import", str(path), "--format", "csv", "--out", str(out)])
    assert isinstance(result.exception, ConfigurationError)
    assert shlex.split(str(result.exception).splitlines()[-1])[-2:] == ["--out", str(out)]


def test_what_was_written_or_recognised_stands_in_the_command(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    path = write_table(tmp_path / "t.csv", signals, head="t [s],pos [deg],vel [rad/s],load")
    with pytest.raises(AutotuneError, match="cannot tell which column is torque") as caught:
        bring_in(path, columns=("position=2*-deg",))
    words = shlex.split(str(caught.value).splitlines()[-1])
    assert [word for word in words if "=" in word] == [
        "time=t", "position=2*-deg", "velocity=vel", "torque=NAME",
    ]  # fmt: skip


def asked(head: str, path: Path, signals: dict[str, Floats]) -> tuple[str, list[str]]:
    """What is said of a file with that head, and the `--column` options of the command."""
    told = {"t [s]": "time", "q": "position", "x": "position"}
    table = {name: signals[told.get(name, told.get(name[0], "torque"))] for name in head.split(",")}
    with pytest.raises(ConfigurationError) as caught:
        bring_in(write_table(path, table))
    said, command = str(caught.value).rsplit("\n", 1)
    return said, [word for word in shlex.split(command) if "=" in word]


@pytest.mark.parametrize(
    ("head", "options"),
    [
        ("t [s],x [mm],F [N],F_cmd [N]", "time=t position=x torque_command=F_cmd torque=F"),
        ("t [s],x [mm],F [N]", "time=t position=x torque=F"),
        ("t [s],q [rad],S [Nm],tau_cmd [Nm]", "time=t position=q torque_command=tau_cmd torque=S"),
        ("t [s],q [rad],S [Nm],R [Nm],tau_cmd [Nm]", "time=t position=q torque_command=tau_cmd torque=NAME"),
        (
            "t [s],q [rad],iq_ref [A],iq [A]",
            "time=t position=q torque_command=iq_ref*CONSTANT torque=iq*CONSTANT",
        ),
        (
            "t [s],q [rad],id_ref [A],id [A],iq_ref [A],iq [A]",
            "time=t position=q torque_command=iq_ref*CONSTANT torque=iq*CONSTANT",
        ),
        ("t [s],q [rad],iq_ref [A]", "time=t position=q torque_command=iq_ref*CONSTANT"),
        (
            "t [s],q_ref,q,tau_cmd,tau",
            "time=t reference=q_ref*UNIT position=q*UNIT torque_command=tau_cmd*UNIT torque=tau*UNIT",
        ),
        (
            "t [s],x_ref [mm],x,F_cmd [N],F",
            "time=t reference=x_ref position=x*UNIT torque_command=F_cmd torque=F*UNIT",
        ),
        (
            "t [s],x_ref [mm],x [mm],tau_cmd [Nm],tau [Nm]",
            "time=t reference=x_ref*FACTOR position=x*FACTOR torque_command=tau_cmd torque=tau",
        ),
    ],
)
def test_the_command_drops_nothing_that_was_measured_or_commanded(
    tmp_path: Path, signals: dict[str, Floats], head: str, options: str
) -> None:
    """Followed literally, a command without `torque=F` took the torque commanded in its place."""
    _, words = asked(head, tmp_path / "t.csv", signals)
    assert words == options.split()


def test_a_command_without_blanks_is_only_agreed_to(tmp_path: Path, signals: dict[str, Floats]) -> None:
    """A column called `F` is no blank in capitals; where there are any, they are named."""
    path = tmp_path / "t.csv"
    said, words = asked("t [s],x [mm],F [N],F_cmd [N]", path, signals)
    assert "only 'x' [mm] can be position. If that is so, say:" in said
    recording = bring_in(path, columns=tuple(words)).recording
    assert {"torque", "torque_command"} <= set(recording.floats)
    said, _ = asked("t [s],q [rad],iq [A]", path, signals)
    assert said.endswith("Fill in CONSTANT:")
    said, _ = asked("t [s],q [rad],Strom U [A],Strom V [A]", path, signals)
    assert "one of 'torque=Strom U*CONSTANT', 'torque=Strom V*CONSTANT'. Fill in NAME, CONSTANT:" in said


def test_a_constant_of_a_current_in_milliamperes_is_for_each_ampere(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    """0.9 N m for each A, written behind a column in mA, made a joint of 1680 N m and 20 kg m² without a question."""
    path = tmp_path / "t.csv"
    said, words = asked("t [s],q [rad],i [mA]", path, signals)
    assert "'torque=i*0.12*mA' for 0.12 N m (or N) in each A" in said
    assert words[-1] == "torque=i*CONSTANT*mA"
    for options in ({}, {"torque_unit": "A"}):
        with pytest.raises(ConfigurationError, match="makes 900 of each A") as caught:
            bring_in(path, columns=("torque=i*0.9",), **options)
        assert "'torque=i*0.9*mA' if 0.9 is for each A" in str(caught.value)
        assert "'torque=i*900*mA' if it is for each mA" in str(caught.value)
    for factor, times in (("0.9*mA", 9e-4), ("0.05", 0.05), ("900*mA", 0.9)):
        read = bring_in(path, columns=(f"torque=i*{factor}",)).recording
        np.testing.assert_allclose(read["torque"], times * signals["torque"], rtol=1e-8)


def test_the_torque_commanded_is_taken_for_the_measured_one_only_where_that_is_said(
    tmp_path: Path, signals: dict[str, Floats]
) -> None:
    path = tmp_path / "t.csv"
    said, _ = asked("t [s],q [rad],S [Nm],tau_cmd [Nm]", path, signals)
    assert "no column is called a torque, but 1 measures a torque or a force: say 'torque=S'" in said
    imported = bring_in(path, columns=("torque_command=tau_cmd",))
    assert imported.recording.metadata.extra["torque_source"] == "torque_command"
    assert any("takes one, such as the torque measured" in line for line in imported.lines)


def test_a_placeholder_left_in_is_refused(tmp_path: Path, signals: dict[str, Floats]) -> None:
    path = write_table(tmp_path / "t.csv", signals, head="t [s],pos,v [rad/s],tau [Nm]")
    with pytest.raises(ConfigurationError, match="'UNIT' in the factor is not a number"):
        bring_in(path, columns=("position=pos*UNIT",))
