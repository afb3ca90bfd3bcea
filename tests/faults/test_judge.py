"""The judge: what is wrong is found, what is right or cannot be avoided is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from autotune_sim.truth import Event
from bench.faults.judge import judge
from tests.faults.support import WALL, H, evidence, ramp, rows_of

SOUND = rows_of(ramp(6.0))


def test_a_sound_run_is_sound() -> None:
    verdict = judge(
        evidence(SOUND, ["load-step=0.4@0.6"], "guard stopped experiment 'dahl': the axis is at rest")
    )
    assert verdict.findings == ()
    assert verdict.to_rest is not None
    assert 0.0 <= verdict.to_power_off <= 1.4 if verdict.to_power_off is not None else False


def test_speed_beyond_its_limit_is_found_and_reaction_is_not() -> None:
    late = judge(evidence(rows_of(ramp(14.0)), ["load-step@0.5"]))
    assert late.kinds == ("speed",)
    in_time = judge(evidence(rows_of(ramp(10.8)), ["load-step@0.5"]))  # 4 ms at 200 rad/s² are 0.8 rad/s
    assert in_time.sound


def test_an_axis_that_does_not_brake_is_found() -> None:
    velocity = ramp(10.8)
    velocity[560:1500] = 10.8
    assert judge(evidence(rows_of(velocity), ["load-step@0.5"])).kinds == ("speed", "travel")


def test_travel_beyond_its_limit_is_found() -> None:
    velocity = np.zeros(8000)
    velocity[500:7000] = 1.0
    assert judge(evidence(rows_of(velocity), ["load-step@0.5"])).kinds == ("travel",)


@pytest.mark.parametrize(("frozen", "kinds"), [(0.0, ()), (0.3, ("speed",))])
def test_a_dead_encoder_must_be_known_from_torque(frozen: float, kinds: tuple[str, ...]) -> None:
    """At 2000 rad/s² 0.1 rad takes 10 ms; who goes on for 0.3 s was blind."""
    velocity = np.zeros(2000)
    n = 11 + round(frozen * 1e3)
    velocity[500 : 500 + n] = 2.0 * np.arange(n)
    rest = np.clip(velocity[499 + n] - 1.0 * np.arange(1500 - n), 0.0, None)
    velocity[500 + n :] = rest
    rows = rows_of(velocity)
    rows["reading"] = 0.0
    assert tuple(k for k in judge(evidence(rows, ["encoder-frozen@0.4"])).kinds if k != "travel") == kinds


def test_what_only_a_drive_can_stop_is_not_held_against_the_host() -> None:
    assert judge(evidence(rows_of(ramp(30.0)), ["runaway@0.5"])).sound


def test_heat_under_power_is_found_unless_the_sensor_hid_it() -> None:
    rows = rows_of(np.zeros(4000))
    rows["temperature"][1000:] = 95.0
    assert judge(evidence(rows, ["temperature-rise=70@1"])).kinds == ("temperature",)
    assert judge(evidence(rows, ["temperature-frozen@0.5", "temperature-rise=70@1"])).sound


def test_power_and_motion_at_the_end_are_found() -> None:
    on = rows_of(ramp(6.0), np.ones(2000, bool))
    assert "power" in judge(evidence(on)).kinds
    moving = rows_of(np.full(2000, 0.5))
    assert "motion" in judge(evidence(moving)).kinds


def test_a_simulated_drive_that_hangs_is_the_rigs_finding_and_not_the_programs() -> None:
    on = rows_of(ramp(6.0), np.ones(2000, bool))
    stalled = Event("stalled", 2.0, WALL + 9.0)
    assert judge(evidence(on, events=[stalled])).kinds == ("rig",)


def test_an_end_that_does_not_come_is_found_and_a_loaded_machine_is_not_blamed() -> None:
    assert judge(evidence(SOUND, ["load-step@0.6"], code=None)).kinds == ("hang",)
    assert judge(evidence(SOUND, ["load-step@0.6"], late=40.0, idle=39.0)).kinds == ("hang",)
    assert judge(evidence(SOUND, ["load-step@0.6"], late=40.0, idle=1.0)).sound


@pytest.mark.parametrize(
    "text", ["Traceback (most recent call last): boom", "unexpected: This is a defect of autotune"]
)
def test_tracebacks_are_found(text: str) -> None:
    assert judge(evidence(SOUND, output=text)).kinds == ("traceback",)


def test_a_fault_that_is_not_told_is_found() -> None:
    fault = Event("fault", 1.8, WALL + 1.8, {"code": 0x2310})
    assert judge(evidence(SOUND, code=0, output="Kept: all is well", events=[fault])).kinds[0] == "swallowed"
    assert judge(evidence(SOUND, code=5, output="reports a fault: (2310h)", events=[fault])).sound


def test_a_loud_fault_must_not_end_with_0() -> None:
    rows = rows_of(np.full(4000, 0.2) * (np.arange(4000) < 3800))
    rows["reading"] = 0.0
    found = judge(evidence(rows, ["encoder-frozen@0.5"], code=0))
    assert "unnoticed" in found.kinds
    assert "unnoticed" not in judge(evidence(rows, ["encoder-frozen@0.5"], code=4)).kinds
    replaced = rows.copy()  # 0.1 s of a tenth, then a gain like another load
    there = float(rows["position"][500])
    replaced["reading"] = rows["position"]
    replaced["reading"][500:600] = there + 0.1 * (rows["position"][500:600] - there)
    replaced["reading"][600:] = replaced["reading"][599] + 2.0 * (
        rows["position"][600:] - rows["position"][599]
    )
    orders = ["encoder-scale=0.1@0.5", "encoder-scale=2@0.6"]
    assert "unnoticed" not in judge(evidence(replaced, orders, code=0)).kinds
    assert "unnoticed" in judge(evidence(replaced, orders[:1], code=0)).kinds
    rows["reading"] = 0.5 * rows["position"]  # like another load: nobody can tell
    assert "unnoticed" not in judge(evidence(rows, ["encoder-scale=0.5@0.5"], code=0)).kinds


@pytest.mark.parametrize(
    ("ran", "missed", "sound"), [(0, 1, True), (3, 1, True), (0, 0, False), (20, 1, False)]
)
def test_a_silence_of_a_cycle_that_the_recording_counts_is_no_finding(
    ran: int, missed: int, sound: bool
) -> None:
    """A simulated axis that waits for its host stands still while the line is silent (seed 1225480)."""
    rows = rows_of(np.full(4000, 0.2) * (np.arange(4000) < 3800))
    rows["wall"][501 + ran :] += 0.05 - H * ran
    found = judge(evidence(rows, ["silent=0.05@0.5"], code=0, missed=missed))
    assert ("unnoticed" not in found.kinds) is sound


@pytest.mark.parametrize(
    ("words", "denied"),
    [
        ("interrupted; the axis is at rest and without power", True),
        ("the axis could not be brought to rest; the axis is at rest only if the brake holds", False),
        ("use the emergency stop if the axis is powered", False),
    ],
)
def test_rest_is_claimed_only_where_it_is_true(words: str, denied: bool) -> None:
    moving = rows_of(np.full(2000, 0.5))
    said = [
        finding for finding in judge(evidence(moving, output=words)).findings if finding.startswith("claim")
    ]
    assert bool(said) is denied


def test_settings_are_as_before_or_named() -> None:
    changed = ({"limit.speed": 20.0}, {"limit.speed": 5.0})
    assert judge(evidence(SOUND, settings=changed)).kinds == ("settings",)
    assert judge(evidence(SOUND, settings=changed, output="limit.speed could not be put back")).sound
    assert judge(evidence(SOUND, settings=changed, output="Nothing was applied.")).kinds == (
        "settings",
        "claim",
    )


def test_what_was_kept_is_no_setting_that_the_next_start_has_to_put_right() -> None:
    """Regression of the judge (seed 3330208): the limits were put right, the kept feedforward was held against it."""
    before, after = (
        {"limit.speed": 20.0, "feedforward.inertia": 0.0},
        {"limit.speed": 5.0, "feedforward.inertia": 1.0},
    )
    said = "Kept: it runs. But after that: limits could not be put back"
    left = evidence(SOUND, code=5, output=said, settings=(before, after))
    assert judge(replace(left, put_right={"limit.speed": 20.0, "feedforward.inertia": 1.0})).sound
    assert judge(replace(left, put_right=after)).kinds == ("settings",)


def test_kept_is_true_only_where_the_drive_holds_it() -> None:
    off, on = {"feedforward.enabled": 0.0}, {"feedforward.enabled": 1.0, "stored feedforward.enabled": 1.0}
    assert judge(evidence(SOUND, code=0, output="Kept: it runs", settings=(off, off))).kinds == ("claim",)
    assert judge(evidence(SOUND, code=0, output="Kept: it runs", settings=(off, on))).sound


def test_a_program_that_never_reached_the_drive_is_judged_by_its_words() -> None:
    assert judge(evidence(SOUND[:0], code=2, output="the file is not there; nothing has moved")).sound
