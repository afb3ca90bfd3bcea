"""Motions that a file plays again, told by its reference."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.core.arrays import Floats
from autotune.recordings.importing.played_again import FEWEST, Play, beside, played, told_apart
from autotune.recordings.recording import Metadata, Recording

from .conftest import bring_in

PERIOD = 1e-3


def _move(start: float, by: float, seconds: float) -> Floats:
    """From rest to rest without a jump of acceleration."""
    t = np.linspace(0.0, 1.0, round(seconds / PERIOD) + 1)
    return start + by * (10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5)


def _there_and_back(by: float, seconds: float, rest: float = 0.3) -> Floats:
    """Away, a rest, back, a rest."""
    pause = np.zeros(round(rest / PERIOD))
    there, back = _move(0.0, by, seconds), _move(by, -by, seconds)
    return np.concatenate([there, pause + by, back, pause])


LOOPS = [(1.0, 0.8), (-2.0, 1.1), (0.1, 2.0), (3.0, 0.9), (0.5, 0.5), (-0.05, 1.5)]
ONCE = [_there_and_back(*one) for one in LOOPS]


def _played(reference: Floats) -> list[Play]:
    return played(reference, PERIOD, [(0, len(reference))])


def _experiments(plays: list[Play]) -> dict[int, list[Play]]:
    return {n: [one for one in plays if one.experiment == n] for n in {one.experiment for one in plays}}


def _sound(reference: Floats, plays: list[Play]) -> None:
    """Plays lie one after the other, those of one experiment have as many rows and the same reference."""
    edges = [(one.start, one.stop) for one in plays]
    assert all(a < b for a, b in edges)
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(edges))
    assert not edges or (edges[0][0] >= 0 and edges[-1][1] <= len(reference))
    for own in _experiments(plays).values():
        assert sorted(one.repeat for one in own) == list(range(len(own)))
        first = reference[own[0].start : own[0].stop]
        for other in own[1:]:
            there = reference[other.start : other.stop]
            assert there == pytest.approx(first, abs=5e-3 * np.ptp(first))


@pytest.mark.parametrize("times", [2, 3])
def test_a_programme_played_again_is_cut_into_experiments(times: int) -> None:
    reference = np.concatenate([*ONCE] * times)
    plays = _played(reference)
    _sound(reference, plays)
    found = _experiments(plays)
    assert len(found) >= FEWEST
    assert all(len(own) == times for own in found.values())
    assert sum(one.stop - one.start for one in plays) > 0.8 * len(reference)


@pytest.mark.parametrize("times", [2, 3, 5])
def test_a_file_that_is_one_programme_is_told_apart_however_often_it_is_played(times: int) -> None:
    """Of three plays each is a third of the file, and still holds as many experiments as must be held out."""
    reference = np.concatenate([*ONCE] * times)
    columns = {
        "time": PERIOD * np.arange(len(reference)),
        "position": reference,
        "torque": np.gradient(reference),
    }
    whole = Recording.from_columns(columns | {"reference": reference}, Metadata(sample_period=PERIOD), "axis")
    split, said = told_apart(whole)
    assert said is not None
    assert f"up to {times} times" in said or (times == 2 and "twice" in said)
    again = {one.experiment for one in split.segments() if one.repeat == times - 1}
    assert len(again) >= FEWEST


def test_motions_that_are_played_twice_each_are_repeats() -> None:
    reference = np.concatenate([part for one in ONCE for part in (one, one)])
    plays = _played(reference)
    _sound(reference, plays)
    assert sum(one.stop - one.start for one in plays) > 0.8 * len(reference)


def test_a_rest_that_lasts_longer_is_no_other_motion() -> None:
    pause = np.zeros(700)
    reference = np.concatenate([part for one in ONCE for part in (one, pause, one)])
    plays = _played(reference)
    _sound(reference, plays)
    assert len(_experiments(plays)) >= FEWEST


def test_a_reference_in_counts_plays_the_same_motions() -> None:
    reference = np.round(np.concatenate([*ONCE, *ONCE]) / 1e-4) * 1e-4
    plays = _played(reference)
    _sound(reference, plays)
    assert len(_experiments(plays)) >= FEWEST


@pytest.mark.parametrize("reference", [
    np.concatenate([*ONCE, *(1.1 * one for one in ONCE)]),
    np.sin(np.linspace(0.0, 60.0, 20_000)),
    np.concatenate([np.zeros(500), np.sin(np.linspace(0.0, 60.0, 20_000)), np.zeros(500)]),
    np.zeros(20_000),
    np.concatenate([ONCE[0], ONCE[0]]),
], ids=["never again", "a sine", "a sine between rests", "at rest", "too few"])  # fmt: skip
def test_what_does_not_come_again_stays_in_one_piece(reference: Floats) -> None:
    assert len(_experiments(_played(reference))) < FEWEST


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.integers(0, len(ONCE) - 1), max_size=24),
    st.lists(st.integers(0, 900), min_size=24, max_size=24),
)
def test_any_order_of_motions_is_told_soundly(order: list[int], rests: list[int]) -> None:
    parts = [part for n, rest in zip(order, rests, strict=False) for part in (ONCE[n], np.zeros(rest))]
    reference = np.concatenate([np.zeros(10), *parts])
    plays = _played(reference)
    _sound(reference, plays)
    assert all(len(own) > 1 for own in _experiments(plays).values())


def _file(tmp_path: Path) -> Path:
    """A programme that is played twice, of an axis that follows it."""
    reference = np.concatenate([*ONCE, *ONCE])
    position = np.concatenate([reference[:1], reference[:-1]])
    velocity = np.gradient(position, PERIOD)
    torque = 1e-2 * np.gradient(velocity, PERIOD) + 0.1 * np.tanh(velocity / 0.01)
    rows = zip(PERIOD * np.arange(len(reference)), position, torque, reference, strict=True)
    path = tmp_path / "axis.csv"
    lines = ["t [s],pos [rad],tau [Nm],ref [rad]", *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


COLUMNS = ("time=t", "position=pos", "torque=tau", "reference=ref")


def test_a_file_without_labels_tells_its_repeats(tmp_path: Path) -> None:
    imported = bring_in(_file(tmp_path), columns=COLUMNS)
    assert any("they are told apart as repeats" in line for line in imported.lines)
    names = {one.experiment for one in imported.recording.segments() if one.repeat == 1}
    assert len(names) >= FEWEST
    assert all(name.startswith("axis.") for name in names)


def _labelled(tmp_path: Path, pauses: tuple[int, int], between: tuple[int, ...] = ()) -> Path:
    """Two experiments, twice each, whose labels begin with a pause that is longer in one of the plays.

    `between`: rows of conditioning before each.
    """
    halves = [np.concatenate(ONCE[:3]), np.concatenate(ONCE[3:])]
    parts = [(name, run, half) for name, half in zip("ab", halves, strict=True) for run in (0, 1)]
    labels, runs, references = [], [], []
    for number, (name, run, half) in enumerate(parts):
        rest = between[number] if between else 0
        labels += ["conditioning"] * rest
        runs += [0] * rest
        references.append(np.zeros(rest))
        reference = np.concatenate([np.zeros(pauses[run]), half])
        labels += [name] * len(reference)
        runs += [run] * len(reference)
        references.append(reference)
    reference = np.concatenate(references)
    velocity = np.gradient(reference, PERIOD)
    torque = 1e-2 * np.gradient(velocity, PERIOD) + 0.1 * np.tanh(velocity / 0.01)
    path = tmp_path / "axis.csv"
    rows = zip(PERIOD * np.arange(len(reference)), reference, torque, reference, labels, runs, strict=True)
    lines = [f"{t:.6f},{q:.9g},{u:.9g},{r:.9g},{name},{run}" for t, q, u, r, name, run in rows]
    head = "t [s],pos [rad],tau [Nm],ref [rad],experiment,repeat"
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return path


def test_labels_that_hold_a_longer_pause_are_repeats_still(tmp_path: Path) -> None:
    """Rows of repeats are compared one by one, and were no repeats where one of them was a row longer."""
    recording = bring_in(_labelled(tmp_path, (300, 431)), columns=COLUMNS).recording
    twice = [
        one
        for one in recording.segments()
        if one.experiment[:2] in ("a.", "b.") and ".0." not in one.experiment
    ]
    lengths: dict[str, set[int]] = {}
    for one in twice:
        lengths.setdefault(one.experiment, set()).add(one.stop - one.start)
    assert {name[0] for name in lengths} == {"a", "b"}
    assert all(len(rows) == 1 for rows in lengths.values())
    assert {one.repeat for one in twice} == {0, 1}


def _two_plays(one: Floats, other: Floats) -> Recording:
    """Two plays of one label."""
    reference = np.concatenate([one, other])
    columns = {"reference": reference, "position": reference, "torque": np.cos(reference)}
    columns["time"] = np.arange(len(reference)) * PERIOD
    repeat = np.repeat([0, 1], [len(one), len(other)])
    return Recording.from_columns(columns, Metadata(sample_period=PERIOD), "motion", repeat)


@pytest.mark.parametrize("part", [0.3, 0.5, 0.8])
def test_plays_that_begin_at_parts_of_a_row_are_repeats_of_the_nearest_row(part: float) -> None:
    """A logger that is not in step with what commands; by half a row the fastest is off by ten times `ALIKE`."""
    motion = np.concatenate([_there_and_back(*one) for one in LOOPS])
    rows = np.arange(len(motion))
    later = np.interp(rows - part, rows, motion)[:-1]
    recording, said = told_apart(_two_plays(motion, later))
    assert said is not None
    assert "by 1 row at most" in said
    twice = [one for one in recording.segments() if ".0." not in one.experiment]
    assert {one.repeat for one in twice} == {0, 1}
    assert len({one.experiment for one in twice}) >= FEWEST
    for name in {one.experiment for one in twice}:
        one, other = (
            recording["reference"][part.start : part.stop] for part in twice if part.experiment == name
        )
        assert len(one) == len(other)
        assert np.max(np.abs(one - other)) <= 0.6 * np.max(np.abs(np.diff(one)))


def test_plays_of_unlike_motions_and_lengths_are_no_repeats_and_said_not_to_be() -> None:
    motion = np.concatenate(ONCE)
    recording = _two_plays(np.sin(motion), np.append(1.3 * np.sin(motion), 0.0))
    same, said = told_apart(recording)
    assert same is recording
    assert said is not None
    assert "no motion in them comes again row by row" in said
    other = _two_plays(motion, np.append(np.concatenate(ONCE[::-1]), 0.0))
    assert told_apart(other)[1] is not None


@pytest.mark.parametrize("later", [-120, 0, 77])
def test_without_a_reference_plays_are_put_beside_each_other_by_their_position(later: int) -> None:
    """To the row, in noise of a thousandth of a radian."""
    motion, random = np.concatenate(ONCE), np.random.default_rng(1)
    pauses = 200, 200 + later
    pieces = [np.concatenate([np.zeros(pause), motion, np.zeros(50)]) for pause in pauses]
    position = np.concatenate(pieces) + random.normal(0.0, 0.001, sum(map(len, pieces)))
    edge = len(pieces[0])
    one, other = beside(position, [(0, edge), (edge, len(position))])
    assert one.stop - one.start == other.stop - other.start >= len(motion)
    assert (other.start - edge) - one.start == later


def test_another_motion_is_put_beside_none() -> None:
    position = np.concatenate([*ONCE[:3], *ONCE[3:]])
    edge = sum(map(len, ONCE[:3]))
    assert beside(position, [(0, edge), (edge, len(position))]) == []


def test_labels_of_even_repeats_are_left_as_they_are(tmp_path: Path) -> None:
    recording = bring_in(_labelled(tmp_path, (300, 300)), columns=COLUMNS).recording
    assert [(one.experiment, one.repeat) for one in recording.segments()] == [
        ("a", 0), ("a", 1), ("b", 0), ("b", 1)
    ]  # fmt: skip


def test_conditioning_of_any_length_makes_repeats_no_less_even(tmp_path: Path) -> None:
    imported = bring_in(_labelled(tmp_path, (300, 300), (90, 310, 70, 500)), columns=COLUMNS)
    played = [(one.experiment, one.repeat) for one in imported.recording.segments() if one.experiment in "ab"]
    assert played == [("a", 0), ("a", 1), ("b", 0), ("b", 1)]


def test_a_file_that_is_named_stays_in_one_piece(tmp_path: Path) -> None:
    imported = bring_in(_file(tmp_path), columns=COLUMNS, experiment="day")
    assert [one.experiment for one in imported.recording.segments()] == ["day"]
