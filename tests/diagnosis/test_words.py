"""What a verdict says: advice that the reader can follow, rivals that matter, nothing longer than a line or two."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from autotune.core.errors import ConfigurationError, a_few
from autotune.core.units import percent
from autotune.diagnosis import facts, search, wording
from autotune.diagnosis.evidence.single import SingleRecording
from autotune.diagnosis.wording import (
    MOST_NAMES,
    PROGRAMME,
    headline,
    left_note,
    missing_codes_note,
    nearest,
    next_experiment,
    not_looked_for,
    offset_note,
    repeats_note,
    separating_experiment,
    sets_of_rivals,
    told_late,
    torque_path_notes,
    unknown_note,
)
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import ReadingWave
from autotune.estimation.policy import POLICY
from autotune.models.drive_model import base_model
from autotune.models.table import EFFECTS, effect_kind
from autotune.recordings.recording import Metadata
from autotune.signals.missing_codes import Gap
from tests.support.axes import NOMINAL


def test_who_has_a_file_only_is_not_sent_to_an_axis_file() -> None:
    own, foreign = (separating_experiment(["spring", "gravity_imbalance"], own) for own in (True, False))
    assert PROGRAMME in own
    assert "AXIS.toml" not in foreign
    assert "autotune data import" in foreign
    assert "To tell spring from gravity imbalance" in foreign


def test_what_cannot_turn_far_enough_is_told_by_another_load() -> None:
    text = separating_experiment(["spring", "gravity_imbalance"], own_axis=True)
    assert "a turn and a half" in text
    assert "with another load" in text


def test_who_gave_every_kind_of_motion_is_not_asked_for_them_again() -> None:
    few, all_of_them = (next_experiment("unknown", (), (), None, None, True, kinds) for kinds in (2, 7))
    assert few is not None
    assert PROGRAMME in few
    assert all_of_them is not None
    assert PROGRAMME not in all_of_them
    assert "7 kinds of motion" in all_of_them
    assert "another payload" in all_of_them


def test_a_name_that_nothing_resembles_asks_for_another_trajectory_and_no_motion_twice() -> None:
    few, all_of_them = (
        next_experiment("named", ("gravity_imbalance",), (), "suspected", None, False, kinds)
        for kinds in (2, 5)
    )
    assert few is not None
    assert "move the axis so" in few
    assert all_of_them is not None
    assert "5 kinds of motion" in all_of_them
    assert "Another trajectory confirms or refutes" in all_of_them
    assert "move the axis so" not in all_of_them


def test_that_nothing_is_missing_says_what_was_not_looked_for() -> None:
    with_twin, without = (headline("none", (), None, complete=True, twin=twin) for twin in (True, False))
    assert with_twin == "nothing is missing that these data could show"
    assert without == f"{with_twin}; what needs a twin was not looked for"


def test_effects_that_are_all_named_are_to_be_confirmed_and_not_told_apart() -> None:
    pair = "position_dependent_friction", "torque_saturation"
    text = next_experiment("named", pair, (), "suspected", None, False, 2)
    assert text is not None
    assert text.startswith("To confirm position dependent friction and torque saturation")


@pytest.mark.parametrize("kinds", [2, 5])
def test_rows_that_are_labelled_veto_are_not_asked_for_where_they_are_there(kinds: int) -> None:
    without, with_veto = (
        next_experiment("named", ("spring",), (), "suspected", None, False, kinds, has_veto)
        for has_veto in (False, True)
    )
    assert without is not None
    assert "in this one, its rows labelled 'veto'" in without
    assert with_veto is not None
    assert "as a further file" in with_veto
    assert "in this one" not in with_veto


@pytest.mark.parametrize("kinds", [2, 5])
@pytest.mark.parametrize(("verdict", "confidence"), [("ambiguous", "suspected"), ("named", "suspected")])
def test_a_motion_that_may_be_there_already_is_not_all_that_is_asked(
    verdict: str, confidence: str, kinds: int
) -> None:
    rivals = (("backlash", "elastic_transmission"),)
    text = next_experiment(verdict, ("backlash",), rivals, confidence, None, False, kinds)
    assert text is not None
    assert "multisine" in text
    assert ("where these data have that already" in text) == (kinds == 5)


def test_repeats_that_differ_much_are_told_beside_none() -> None:
    assert repeats_note(0.03) == ""
    assert "differ by 7.2 % of the torque" in repeats_note(0.072)


def test_each_effect_has_rivals_of_its_own() -> None:
    """A spring and friction that falls with speed: what resembles the one does not stand beside the other."""
    gains = {
        "spring": 0.9,
        "stribeck": 0.5,
        "dwell_time_break_away": 0.4,
        "gravity_imbalance": 0.8,
        "torque_lag": 0.7,
    }
    first = [SimpleNamespace(effect=effect, gain=gain) for effect, gain in gains.items()]
    policy = replace(POLICY, rival_gain=0.3)
    sets = sets_of_rivals(policy, ("spring", "stribeck"), first, ())
    assert sets == (("spring", "gravity_imbalance"), ("stribeck", "dwell_time_break_away"))
    elsewhere = [SimpleNamespace(effect="stribeck", rivals=("nonlinear_viscous",))]
    (one,) = sets_of_rivals(policy, ("stribeck",), first[:2], elsewhere)
    assert one == ("stribeck", "nonlinear_viscous")
    assert sets_of_rivals(policy, ("stribeck",), first[:2], ()) == ()


def test_nobody_is_asked_to_tell_ten_effects_apart() -> None:
    text = separating_experiment(sorted(EFFECTS), own_axis=True)
    assert sum(name.replace("_", " ") in text for name in EFFECTS) <= MOST_NAMES


def test_an_unknown_effect_lists_what_there_is() -> None:
    with pytest.raises(ConfigurationError, match="there is no effect 'nonsense'") as error:
        effect_kind("nonsense")
    assert all(name in str(error.value) for name in EFFECTS)


def test_a_wide_file_is_named_in_one_line() -> None:
    text = a_few([f"a rather long column name number {i} with words" for i in range(500)])
    assert len(text) < 400
    assert text.endswith("and 492 more")


def _read(size: float, resolution: float) -> str:
    """What is said of a reading that is off by `size` [m] in waves of 5 mm."""
    wave = ReadingWave(2.0 * math.pi / 5e-3, (size, 0.0, 0.0, 0.0))
    path = {"cycles": 0, "late": 0.0, "upsampling": 1, "lag": 0.0, "lag_error": 1.0, "by_sensor": False}
    metadata = SimpleNamespace(motion_unit="m")
    (note,) = torque_path_notes(
        SimpleNamespace(**path, reading=wave, resolution=resolution, metadata=metadata)
    )
    return note


@pytest.mark.parametrize(
    ("cycles", "late", "lag", "told"), [(2, 2.0, 0.0, True), (2, 0.0, 0.0, False), (0, 0.0, 3e-4, True)]
)
def test_a_delay_that_was_taken_out_is_told_as_one(cycles: int, late: float, lag: float, told: bool) -> None:
    """Beside something without a name it is a guess; cycles that make up for a late record are none."""
    data = SimpleNamespace(cycles=cycles, late=late, upsampling=1, lag=lag, lag_error=5e-5)
    assert told_late(data) is told


def test_waves_below_a_count_blame_no_encoder() -> None:
    """A quarter of a count over 42 counts was "sine and cosine", of an encoder that read exactly (39th outsider)."""
    note = _read(0.25e-4, 1e-4)
    assert "less than half a count" in note
    assert "sine and cosine" not in note
    assert "taken out of the motion" in note


@pytest.mark.parametrize(
    ("resolution", "lines"), [(0.0, True), (1e-8, False), (1e-6, True), (4e-8, False), (1.6e-7, True)]
)
def test_a_screws_turn_is_no_line_of_an_encoder(resolution: float, lines: bool) -> None:
    """5 mm are 500 000 counts of 10 nm, and no encoder divides a line so finely."""
    note = _read(1e-6, resolution)
    assert ("sine and cosine of its lines" in note) == lines
    assert ("off centre on a shaft" in note) != lines
    assert "taken out of the motion" in note


@pytest.mark.parametrize(
    ("ticks", "cycles", "late", "said"),
    [
        (1, 2, 2.0, "as one that goes over a bus does"),
        (4, 2, 2.0, "no effect that these data tell from a bus"),
        (4, 0, 0.3, "answers 0.3 ms after the torque that is recorded: less than half a row"),
        (4, 0, 0.8, "answers 0.8 ms after the torque that is recorded. A current loop or a filter"),
        (4, 0, -0.3, ""),
    ],
    ids=["a host", "a drive's own loop", "a part of a sample", "most of a sample", "told late"],
)
def test_how_late_the_torque_acts_is_said_as_far_as_it_is_told(
    ticks: int, cycles: int, late: float, said: str
) -> None:
    """Behind a loop between the samples a lag, cycles and the moment of reading leave alike."""
    path = {"cycles": cycles, "late": late, "upsampling": 1, "period": 1e-3, "lag": 0.0, "by_sensor": False}
    data = SimpleNamespace(**path, lag_error=1.0, reading=None)
    notes = torque_path_notes(data, PositionController(ticks=ticks))
    assert len(notes) == bool(said)
    assert all(said in note and "taken out" in note for note in notes)
    asked = torque_path_notes(data, PositionController(ticks=ticks, asked=20.0))
    assert all("after the torque that its controller asked for" in one for one in asked if "answers" in one)


@pytest.mark.parametrize(("cycles", "late", "told"), [(1, 1.0, True), (0, 0.8, True), (0, 0.3, False)])
def test_no_bus_is_blamed_for_what_comes_after_a_measured_torque(
    cycles: int, late: float, told: bool
) -> None:
    """A torque that acted at once and was measured "acts 1 cycle of 1 ms after the row, a bus does that" (65th
    outsider, 26): its dead time lay before the sensor."""
    path = {"cycles": cycles, "late": late, "upsampling": 1, "period": 1e-3, "lag": 0.0}
    data = SimpleNamespace(**path, lag_error=1.0, reading=None, by_sensor=True)
    (note,) = torque_path_notes(data, PositionController(ticks=4))
    assert ("torque that was measured. Neither a bus" in note) is told
    assert "taken out" in note


@pytest.mark.parametrize(
    ("lag", "said"), [(2e-4, "as a current loop of 796 Hz does"), (4.5e-4, "0.45 ms late or more")]
)
def test_a_current_loop_at_the_slowest_that_is_ordinary_is_told_as_a_bound(lag: float, said: str) -> None:
    path = {"cycles": 0, "late": 0.0, "upsampling": 1, "period": 1e-3, "lag": lag, "by_sensor": False}
    (note,) = torque_path_notes(SimpleNamespace(**path, lag_error=2e-5, reading=None))
    assert said in note


def test_codes_that_are_left_out_are_told_with_their_place() -> None:
    gaps = (Gap(0.25, 6e-3, 12), Gap(1.5, 8e-3, 40))
    data = SimpleNamespace(gaps=gaps, resolution=1e-3, metadata=SimpleNamespace(motion_unit="rad"))
    text = missing_codes_note(data)
    assert "never tells 7 codes beside each other at 1.5 rad, and some at 1 other place:" in text
    assert "all 40 slow passes" in text
    assert missing_codes_note(SimpleNamespace(gaps=())) == ""


@pytest.mark.parametrize(("cycles", "lag", "asks"), [(3, 4.5e-4, True), (3, 2e-4, False), (2, 4.5e-4, False)])
def test_a_chain_that_ends_at_its_limits_rules_out_no_lag(cycles: int, lag: float, asks: bool) -> None:
    """Three cycles and the slowest ordinary current loop: what was later was cut off."""
    path = {
        "cycles": cycles,
        "late": float(cycles),
        "upsampling": 1,
        "period": 1e-3,
        "lag": lag,
        "by_sensor": False,
    }
    notes = torque_path_notes(SimpleNamespace(**path, lag_error=7e-4, reading=None))
    assert any("not ruled out" in " ".join(note.split()) for note in notes) == asks


@pytest.mark.parametrize(
    ("stopped", "fits", "said"),
    [
        ("not in enough of them to be no chance", (), ("gain 13.4 %", "not in enough of them")),
        ("", (), ("gain 13.4 %", "not borne out inside the twin")),
        (
            "",
            (SimpleNamespace(effect="stribeck", gain=0.149),),
            ("gain 14.9 %", "explains 97 %, 6 % on the veto"),
        ),
    ],
)
def test_the_candidate_that_comes_nearest_is_told_as_it_is_listed(stopped: str, fits, said) -> None:
    """What was fitted inside the twin stands so among the candidates, and says more than a screening does."""
    evidence: Any = SimpleNamespace(
        needs_twin=lambda *_: "",
        stopped_by=lambda *_: stopped,
        explains=lambda _: "explains 97 %, 6 % on the veto trajectory",
    )
    nobody: Any = None
    best: Any = SimpleNamespace(effect="stribeck", gain=0.134)
    text = nearest(SimpleNamespace(twin=True), evidence, nobody, best, fits)
    assert text.startswith("stribeck comes nearest, ")
    assert all(part in text for part in said)


@pytest.mark.parametrize(
    ("share", "tried", "said"),
    [
        (
            0.48,
            {"nonlinear_viscous": 0.41, "spring": 0.48, "stribeck": 0.02},
            "that none of the known effects explains alone; spring explains 48 % of it; nonlinear viscous explains "
            "41 % of it.",
        ),
        (0.2, {"spring": 0.2}, "that none of the known effects explains."),
        (0.0, {"spring": (1.0, 0.0)}, "that no known effect explains beyond doubt."),
        (
            0.95,
            {"spring": 0.95, "load_dependent_friction": 0.8, "stribeck": 0.3},
            "that no known effect explains beyond doubt; spring explains 95 % of it and may be part of the truth; "
            "load dependent friction explains 80 % of it instead.",
        ),
    ],
    ids=["two halves", "nothing", "refused by the veto alone", "a rival"],
)
def test_what_is_unknown_is_told_with_all_that_come_near(
    share: float, tried: dict[str, float | tuple[float, float]], said: str
) -> None:
    """Two true effects of 41 and 48 % were "none of the known effects"; of two rivals only the wrong one was told.

    Shares of training and veto, or one of both.
    """

    def item(effect: str, share: float | tuple[float, float]) -> Any:
        trained, least = (share, share) if isinstance(share, float) else (share[0], min(share))
        own = SimpleNamespace(effects=(effect,))
        return SimpleNamespace(
            effect=effect, share=least, training=SimpleNamespace(share=trained), model_fit=own
        )

    def told(evidence: Any, problem: Any) -> str:
        return unknown_note(problem, evidence, "velocity", 0.0, item("spring", share), others)

    def explains_part(one: Any) -> str:
        return f"explains {100 * one.share:.0f} % of it"

    others = [item(*one) for one in tried.items()]
    repeated = SimpleNamespace(explains_part=explains_part, repeats=True)
    text = told(repeated, SimpleNamespace(policy=POLICY, twin=True))
    assert text == f"Something repeatable is missing {said}"
    single = SimpleNamespace(explains_part=explains_part, repeats=False)
    text = told(single, SimpleNamespace(policy=POLICY, twin=False))
    assert text == f"Something is missing {said.replace('known effects', 'effects that could be looked for')}"


@pytest.mark.parametrize(("share", "said"), [(0.005, False), (0.02, True)])
def test_an_offset_that_is_a_part_of_friction_is_told_for_what_it_may_be(share: float, said: bool) -> None:
    """Friction that is higher one way is a constant while the axis slides, and was passed over in silence."""
    packed = base_model(NOMINAL | {"offset": -share * NOMINAL["coulomb"]}).pack()
    note = offset_note(packed, Metadata(motion_unit="m"))
    assert bool(note) == said
    assert not said or ("2 % of it" in note and "higher one way" in note and " N acts" in note)


def test_a_weight_larger_than_friction_is_told_in_percent_without_an_exponent() -> None:
    """It was "1.7e+02 % of it"."""
    packed = base_model(NOMINAL | {"offset": 1.66 * NOMINAL["coulomb"]}).pack()
    assert "166 % of it" in offset_note(packed, Metadata(motion_unit="rad"))
    told = [percent(share) for share in (0.00012, 0.0166, 0.284, 0.9949, 0.997, 1.66, 12.0)]
    assert told == ["0.012", "1.7", "28", "99", "100", "166", "1200"]


@pytest.mark.parametrize(("left", "said"), [(5.0, "2 times the noise"), (1.9, "")])
def test_what_is_left_beside_a_name_is_said_where_it_is_as_much_as_the_noise(left: float, said: str) -> None:
    problem: Any = SimpleNamespace(noise_variance=lambda *_: 1.0, mean_square=lambda *_: left)
    model_fit: Any = SimpleNamespace(fitted=SimpleNamespace(error=None))
    text = left_note(problem, model_fit)
    assert said in text
    assert bool(text) == bool(said)


@pytest.mark.parametrize("anything", [True, False])
def test_a_course_of_the_place_over_too_little_travel_is_told_for_that(
    monkeypatch: pytest.MonkeyPatch, anything: bool
) -> None:
    """A weight that explained 97 % over two thirds of a turn was "not beyond doubt", without a word on the doubt."""
    monkeypatch.setattr(wording, "any_course", lambda *_: anything)
    monkeypatch.setattr(wording, "needed_share", lambda *_: 0.9)
    evidence: Any = SimpleNamespace(repeats=True, in_sight=lambda *_: True)
    problem: Any = SimpleNamespace(policy=POLICY)
    root: Any = None
    fit: Any = SimpleNamespace(share=0.97, model_fit=None)
    text = wording._short_of_a_name(problem, evidence, root, fit, ())
    assert ("smooth course of the place" in text) == anything
    assert anything or text == "not beyond doubt"


@pytest.mark.parametrize("twin", [True, False])
def test_a_gap_that_only_a_twin_could_tell_comes_nearest_and_is_no_name(twin: bool) -> None:
    """It was "none of the effects that could be looked for", where the fit of a gap took 77 % of the error away."""
    gap = SimpleNamespace(effect="backlash", gain=0.768)
    problem = SimpleNamespace(
        twin=twin, data=SimpleNamespace(steady=False), candidates=[*EFFECTS.values()], policy=POLICY
    )
    evidence = SingleRecording()
    assert bool(evidence.needs_twin(problem, gap)) is not twin
    assert not evidence.needs_twin(problem, SimpleNamespace(effect="spring"))
    if twin:
        return
    said = nearest(problem, evidence, SimpleNamespace(), gap, [])
    assert said.startswith(
        "backlash comes nearest, gain 76.8 % on unseen experiments, and is not taken: without a twin"
    )
    (rest,) = not_looked_for(problem, evidence, gap)
    assert (
        "Without a twin elastic transmission and torque lag cannot be told, and were not looked for" in rest
    )
    assert "elastic transmission, backlash and torque lag" in not_looked_for(problem, evidence)[0]


@pytest.mark.parametrize(
    ("gain", "z", "other", "told"),
    [(0.39, 4.6, 0.02, True), (0.39, 1.9, 0.02, False), (0.39, 4.6, 0.5, False), (0.05, 4.6, 0.02, False)],
    ids=["leads", "by chance", "another one gains more", "a crumb"],
)
def test_a_second_mass_that_only_a_twin_could_tell_is_told_where_it_leads(
    gain: float, z: float, other: float, told: bool
) -> None:
    """Behind a cascade whose elasticity spoils the twin that would tell it (the 61st outsider's 18)."""
    mass = SimpleNamespace(effect="elastic_transmission", gain=gain, z=z)
    found: Any = SimpleNamespace(without_twin=[mass], first=[SimpleNamespace(gain=other)])
    assert (facts._leading_mass(POLICY, found) is mass) is told


@pytest.mark.parametrize(
    ("twin", "steady", "z", "told"),
    [
        (False, False, 6.6, ["elastic_transmission", "backlash"]),
        (False, False, 1.9, []),
        (True, False, 6.6, []),
        (False, True, 6.6, []),
    ],
)
def test_second_masses_are_looked_at_where_no_twin_tells_of_them(
    monkeypatch: pytest.MonkeyPatch, twin: bool, steady: bool, z: float, told: list[str]
) -> None:
    problem = SimpleNamespace(
        twin=twin, data=SimpleNamespace(steady=steady), candidates=[*EFFECTS.values()], policy=POLICY
    )
    monkeypatch.setattr(search, "screen", lambda *known: SimpleNamespace(effect=known[-1], gain=0.7, z=z))
    state = SimpleNamespace(evidence=SingleRecording(), nominal=None, progress=lambda _: None)
    found = SimpleNamespace(problem=problem, root=None)
    assert [one.effect for one in search._without_twin(state, found)] == told
