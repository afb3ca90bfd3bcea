"""A diagnosis whose time is up tells what it has found until then, and never more than that."""

import math
from itertools import count
from types import SimpleNamespace

import pytest

import autotune
from autotune.core import time_limit
from autotune.core.errors import ConfigurationError
from autotune.core.side_by_side import on_each
from autotune.core.time_limit import TimeIsUp, check_time, deadline, limited
from autotune.diagnosis import (
    backward,
    baseline,
    confirmation,
    each_recording,
    rounds,
    screening,
    search,
)
from autotune.diagnosis.candidates import ScreenedCandidate, no_progress
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.search_state import Found, SearchState
from autotune.diagnosis.verdict import Diagnosis, diagnose
from autotune.estimation.bandwidth import prepared_to_fit

SPRING = 0.004
FEW = 5
"""Candidates that are looked at before the time is up."""


@pytest.fixture
def passes(monkeypatch) -> None:
    """A clock that goes on by one with each pass of a kernel, so that a limit is one of passes on any machine."""
    monkeypatch.setattr(time_limit, "monotonic", count().__next__)


def test_work_ends_where_its_time_is_up_and_only_there(passes) -> None:
    done = []
    with pytest.raises(TimeIsUp), limited(deadline(3.0)):
        list(on_each(done.append, range(10)))
    assert len(done) == 3
    assert len(list(on_each(done.append, range(10)))) == 10


@pytest.mark.slow(30)
@pytest.mark.parametrize(
    ("most", "told"), [(0, ()), (60, ()), (120, ("spring",)), (220, ("spring",)), (320, ("spring",))]
)
def test_wherever_it_stops_what_was_found_is_told_and_nothing_is_certain(
    passes, recorded, nominal, most, told
) -> None:
    """Of some 350 passes 60 to 150 look at the candidates, 150 to 300 at motor and load; then the spring is fitted."""
    found = diagnose([recorded(41, spring=SPRING)], nominal, at_most=most)
    assert not found.complete
    assert "Stopped after" in found.notes[0]
    assert found.effects == told
    assert (found.verdict, found.confidence) == (("named", "suspected") if told else ("unknown", None))


@pytest.mark.slow(20)
@pytest.mark.parametrize("most", [50, 80, 110])
def test_with_nothing_planted_it_never_says_that_nothing_is_missing(passes, recorded, nominal, most) -> None:
    found = diagnose([recorded(42)], nominal, at_most=most)
    assert (found.complete, found.verdict, found.effects) == (False, "unknown", ())
    assert found.next_experiment is not None
    assert f"again with more time before anything is recorded: --at-most {4 * most}" in found.next_experiment


def test_what_is_needed_is_told_after_the_time_and_nothing_is_refined(monkeypatch) -> None:
    """Three rounds of a fit with two masses took a minute of 140 s at 1 kHz, and beyond the limit."""
    fits = {
        effects: SimpleNamespace(effects=effects, model_fit=SimpleNamespace(effects=effects))
        for effects in (("spring", "stribeck"), ("spring",))
    }
    monkeypatch.setattr(backward.Backward, "pruned", lambda *_: fits[("spring",)])
    monkeypatch.setattr(backward, "refined", lambda *_: pytest.fail("it is refined"))
    given = (SimpleNamespace(), SimpleNamespace(), None, no_progress, SimpleNamespace(repeats=True))
    state = SearchState(*given, chosen=fits[("spring", "stribeck")])
    found = search._found_so_far(state)
    assert (found.chosen, found.cut_short) == (fits[("spring",)], True)


def test_a_base_is_fitted_without_more_where_its_time_is_up(monkeypatch, recorded, nominal) -> None:
    """Aligning, a record that may be late and waves of the clock took half of the first 5 s, after a limit of 1 s."""
    for name in ("_aligned", "_late_record", "_without_clocked", "_refuse_misfit"):
        monkeypatch.setattr(baseline, name, lambda *_, name=name: pytest.fail(f"{name} is begun"))
    data = prepared_to_fit([recorded(41, spring=SPRING)])
    with limited(-math.inf):
        problem, root, _, _ = baseline.begin(data, nominal)
    assert math.isfinite(root.fitted.cost)
    assert problem.twin


def test_no_short_fit_is_followed_after_the_time(monkeypatch, begun, nominal) -> None:
    """What was tried is told as its short fit ended: following all of them went on without a limit."""
    problem, root = begun
    whole = screening.rank(problem, evidence_of(problem.data), root, nominal.pack(), no_progress)
    looked = screening._short_fits
    asked: list[str] = []

    def out_of_time(problem, base, nominal, kind, needed=0.0):
        if len(asked) == FEW:
            raise TimeIsUp
        asked.append(kind.name)
        return looked(problem, base, nominal, kind, needed)

    def over(*_):
        raise TimeIsUp

    monkeypatch.setattr(screening, "_short_fits", out_of_time)
    monkeypatch.setattr(screening, "refits", over)
    found = screening.rank(problem, evidence_of(problem.data), root, nominal.pack(), no_progress)
    assert {one.effect for one in found} <= set(asked)
    assert found
    ends = {one.effect: one.fitted.cost for one in whole}
    assert all(one.fitted.cost >= ends[one.effect] for one in found)


def test_of_the_candidates_one_is_fitted_in_haste_and_from_one_place(monkeypatch) -> None:
    """Two fits between two masses, of four places each, took 5.6 s after a limit of 20 s."""
    fitted: list[tuple[str, tuple[object, ...]]] = []

    def inside_twin(_problem, _root, _before, item, *_):
        fitted.append((item.effect, item.others))

    monkeypatch.setattr(rounds, "inside_twin", inside_twin)
    root = SimpleNamespace(effects=())
    first = [ScreenedCandidate(name, root, 1.0, 0.9, 9.0, (1, 2, 3)) for name in ("backlash", "spring")]
    evidence = SimpleNamespace(worth_fitting=lambda *_: first)
    policy = SimpleNamespace(policy=SimpleNamespace(worth_refit=0.5))
    state = SearchState(policy, root, None, no_progress, evidence, first=first)
    assert rounds.best_in_haste(state) is None
    assert fitted == [("backlash", ())]


@pytest.mark.parametrize(("chosen", "short"), [(SimpleNamespace(), True), (None, False)])
def test_a_name_is_cut_short_where_its_time_ends_while_it_is_compared_and_nothing_is_not(
    monkeypatch, chosen, short
) -> None:
    """Comparing with rivals is a round of a search; of nothing found there is nothing to compare."""
    asked: list[bool] = []

    def confirm(found, _):
        asked.append(found.cut_short)
        if chosen is not None:
            check_time()
        return chosen, []

    monkeypatch.setattr(confirmation, "confirm", confirm)
    found = Found(SimpleNamespace(), SimpleNamespace(), chosen, (), (), {})
    after, _, _ = confirmation.confirm_in_time(found, None, -math.inf)
    assert (after.cut_short, asked) == (short, [False, True] if short else [False])


def test_where_no_time_is_left_for_the_other_recordings_nothing_is_confirmed_and_none_is_not_said(
    monkeypatch,
) -> None:
    """One that was searched whole had "none", or a confirmed name, though another one was not asked."""
    monkeypatch.setattr(each_recording, "prepared_to_fit", lambda _: None)
    monkeypatch.setattr(each_recording, "with_chosen", lambda found, _: found)
    monkeypatch.setattr(confirmation, "confirm", lambda *_: (None, []))
    searched = (Found(SimpleNamespace(), SimpleNamespace(), None, (), (), {}), None, ())
    judged: list[bool] = []

    def judge(found, notes, carried):
        judged.append(found.cut_short)
        verdict = "unknown" if found.cut_short else "none"
        return Diagnosis(
            verdict, (), None, (), (), {}, 0.0, None, True, notes=notes, complete=not found.cut_short
        )

    told = each_recording.of_each([(1, []), (2, [])], lambda _: searched, judge, no_progress, until=-math.inf)
    assert told is not None
    assert (told.verdict, told.complete, judged) == ("unknown", False, [False, True])
    assert any("Recording 2 was not searched" in note for note in told.notes)


def test_a_limit_that_is_none_is_refused(recorded, nominal) -> None:
    with pytest.raises(ConfigurationError, match="above 0 s"):
        autotune.diagnose([recorded(41, spring=SPRING)], nominal, at_most=0.0)
