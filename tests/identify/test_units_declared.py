"""Units declared wrongly are refused or questioned; axes as they are built are not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import RecordingError
from autotune.identify.estimate import judge_model, model_sizes
from autotune.models.drive_model import DriveModel, base_model
from autotune.recordings.axis_sizes import Sizes, judged, refuse_unlike_axis, sizes_line
from autotune.recordings.recording import Metadata, Recording
from autotune.recordings.turn_lines import find_orders, unit_question

DEGREES = 180.0 / math.pi
SAMPLES = 20_000


def turning(orders: tuple[int, ...] = (72, 18), speed: float = 6.28) -> Recording:
    """20 turns of a motor at 1 kHz: speed with a slow swing, torque with ripple, friction and noise."""
    generator, time = np.random.default_rng(5), np.arange(SAMPLES) * 1e-3
    position = speed * time + 0.5 * np.sin(2 * math.pi * 0.3 * time)
    torque = 0.08 + sum(0.03 * np.sin(order * position + order) for order in orders)
    torque = torque + 0.01 * generator.normal(size=SAMPLES)
    return Recording.from_columns({"time": time, "position": position, "torque": torque}, Metadata(), "speed")


def mistaken(recording: Recording, time: float = 1.0, position: float = 1.0) -> Recording:
    """The recording as it is where units are mistaken by these factors."""
    floats = dict(recording.floats)
    floats["time"], floats["position"] = floats["time"] * time, floats["position"] * position
    metadata = replace(recording.metadata, sample_period=recording.period * time)
    return replace(recording, metadata=metadata, floats=floats)


def fitted(motion_unit: str = "rad", torque_unit: str = "", **values: float) -> DriveModel:
    known = {"inertia": 6.66e-4, "viscous": 4e-3, "coulomb": 0.3, "stiffness": 100.0} | values
    known |= {"micro_damping": 0.0, "offset": 0.0}
    model = base_model(known, motion_unit=motion_unit, torque_unit=torque_unit)
    return model.with_values(known, {name: 0.01 * value for name, value in known.items()})


def test_an_axis_as_it_is_raises_no_question() -> None:
    assert refuse_unlike_axis(turning()) == []
    assert judge_model(fitted(), turning(), []) == ("", [])
    assert unit_question(turning()) == ""


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"time": 1e3}, "spacing of the rows is 1 s.*usual if time is in ms"),
        ({"time": 1e6}, "spacing of the rows is 1e\\+03 s; possible are .*usual if time is in µs"),
        ({"time": 1e-3}, "spacing of the rows is 1e-06 s; possible are"),
        ({"position": 1e5}, "highest speed is .* rad/s; possible are"),
    ],
)
def test_time_or_position_in_another_unit_is_of_no_axis(factors: dict[str, float], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        refuse_unlike_axis(mistaken(turning(speed=3.0), **factors))


def test_three_sizes_that_one_mistake_explains_are_one_sentence() -> None:
    with pytest.raises(RecordingError) as caught:
        refuse_unlike_axis(mistaken(turning(speed=3.0), time=1e3))
    assert str(caught.value).count("usual if time is in ms") == 1
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(("factor", "impossible"), [(1e9, False), (1e11, True)])
def test_a_power_of_no_motor_is_asked_or_refused(factor: float, impossible: bool) -> None:
    recording = turning()
    strong = replace(recording, floats=dict(recording.floats) | {"torque": recording["torque"] * factor})
    if impossible:
        with pytest.raises(RecordingError, match=r"power, torque times speed, is .* W; possible"):
            refuse_unlike_axis(strong)
    else:
        assert "power, torque times speed, is" in refuse_unlike_axis(strong)[0]


def test_a_power_in_amperes_is_none() -> None:
    recording = turning()
    current = recording["torque"] * 1e11
    metadata = replace(recording.metadata, extra={"torque_unit": "A"})
    assert (
        refuse_unlike_axis(
            replace(recording, metadata=metadata, floats=recording.floats | {"torque": current})
        )
        == []
    )


def test_milliseconds_as_seconds_are_no_model() -> None:
    """What was seen: inertia 720 kg m², exit 0."""
    impossible, questions = judge_model(fitted(inertia=720.0), mistaken(turning(), time=1e3), [])
    assert "natural frequency at rest" in impossible
    assert any("usual if time is in ms" in question for question in questions)


def test_what_is_not_identified_is_not_judged() -> None:
    vague = fitted().with_values({"stiffness": 1e-9}, {"stiffness": 1.0})
    assert judge_model(vague, turning(), []) == ("", [])
    assert judge_model(fitted(stiffness=1e-6), turning(), ["stiffness"]) == ("", [])


@pytest.mark.parametrize(
    ("unit", "factor"), [("degrees", DEGREES), ("turns", 0.5 / math.pi), ("rpm", 30.0 / math.pi)]
)
def test_ripple_tells_in_which_unit_the_position_is(unit: str, factor: float) -> None:
    question = unit_question(mistaken(turning(), position=factor))
    assert f"position in {unit}" in question
    assert "72" in question
    assert "18" in question


def test_broken_orders_of_a_gear_raise_no_question() -> None:
    """A gear's and a bearing's lines, whole in no unit; and a motor without lines."""
    recording = turning(orders=())
    torque = recording["torque"] + 0.03 * sum(
        np.sin(order * recording["position"]) for order in (3.57, 7.43, 41.27)
    )
    assert unit_question(replace(recording, floats=dict(recording.floats) | {"torque": torque})) == ""
    assert len(find_orders(recording).orders) == 0


@pytest.mark.parametrize(
    ("unit", "period", "speed", "acceleration", "inertia", "coulomb", "stiffness"),
    [
        pytest.param("rad", 1e-3, 10.0, 100.0, 6.66e-4, 0.33, 100.0, id="edm-axis"),
        pytest.param("rad", 1e-3, 0.02, 0.02, 5e-2, 0.5, 1e3, id="telescope-motor-side"),
        pytest.param("rad", 1e-3, 200.0, 2e3, 1e-4, 0.05, 2.0, id="robot-joint-harmonic-gear"),
        pytest.param("rad", 1e-4, 2000.0, 1e4, 1e-3, 0.2, 200.0, id="spindle-20000-rpm"),
        pytest.param("rad", 2.5e-5, 300.0, 5e5, 2e-8, 1e-4, 0.1, id="galvanometer"),
        pytest.param("rad", 4e-2, 22.0, 25.0, 1.5e-6, 2.8e-3, 2.0, id="lead-screw-recorder"),
        pytest.param("rad", 1e-3, 1.0, 5.0, 50.0, 30.0, 3e4, id="rotary-table"),
        pytest.param("m", 1e-3, 0.13, 1.2, 95.0, 20.0, 4e6, id="ball-screw-positioner"),
        pytest.param("m", 1e-4, 5.0, 200.0, 0.5, 1.0, 1e5, id="linear-motor-pick-and-place"),
        pytest.param("m", 1e-3, 0.002, 0.01, 5.0, 0.5, 1e6, id="nano-stage"),
        pytest.param("m", 2e-3, 0.2, 1.0, 2e4, 5e3, 1e8, id="press"),
    ],
)
def test_axes_of_many_decades_raise_no_question(
    unit: str,
    period: float,
    speed: float,
    acceleration: float,
    inertia: float,
    coulomb: float,
    stiffness: float,
) -> None:
    """Orders of magnitude from data sheets and papers."""
    model = fitted(unit, inertia=inertia, coulomb=coulomb, stiffness=stiffness, viscous=0.1 * coulomb / speed)
    moved = Sizes(period, 1.0, speed, acceleration, coulomb, coulomb * speed)
    values = {"period": period, "speed": speed, "acceleration": acceleration}
    assert judged(values | model_sizes(model, moved, []), unit) == ([], [])


def test_sizes_are_stated_as_an_engineer_says_them() -> None:
    line = sizes_line(turning(), 6.66e-4)
    assert "rows 1 ms apart" in line
    assert "travel 20 turns" in line
    assert "N m" in line
    assert "0.000666 kg m²" in line


def test_a_measured_axis_in_milliseconds_is_no_valid_fit() -> None:
    from scipy import io as matlab

    from autotune.diagnosis.fit_recordings import fit_recordings

    file = Path(__file__).resolve().parents[2] / "../shared/data/emps/DATA_EMPS.mat"
    if not file.is_file():
        pytest.skip("the measured data are not here: ../shared/data/emps")
    data = {name: values.ravel() for name, values in matlab.loadmat(file).items() if name[0] != "_"}
    columns = {
        "time": data["t"],
        "position": data["qm"],
        "reference": data["qg"],
        "torque": 35.15 * data["vir"],
    }
    right = Recording.from_columns(columns, Metadata(motion_unit="m"), "emps")
    assert fit_recordings([right]).questions == ()
    result = fit_recordings([mistaken(right, time=1e3)])
    assert not result.valid
    assert any("time is in ms" in question for question in result.questions)


def test_a_pass_sampled_slower_than_its_windows_has_no_spectrum() -> None:
    """Milliseconds taken as seconds ended in a traceback of the spectrum's window."""
    from autotune.core.errors import NotEnoughExcitation
    from autotune.identify.high_speed import identify_high_speed

    slow = mistaken(turning(), time=1e3)
    excited = np.sin(np.arange(SAMPLES) ** 1.5)
    with pytest.raises(NotEnoughExcitation, match="no pass at high speed"):
        identify_high_speed(replace(slow, floats=dict(slow.floats) | {"torque_feedforward": excited}))
