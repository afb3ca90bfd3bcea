"""What is exchanged among several effects keeps its name: names, what is free and what is compared stay in step."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from autotune.diagnosis import (
    backward,
    base_beside,
    confirmation,
    own_presliding,
    refits,
    rounds,
    search,
    search_state,
    settling,
    transmission,
)
from autotune.diagnosis.backward import Backward
from autotune.diagnosis.candidates import exchanged_for, no_progress
from autotune.diagnosis.search_state import Found, SearchState
from autotune.estimation import model_error
from autotune.estimation.cross_validation import Unseen
from autotune.estimation.policy import POLICY
from tests.support.fitted import Item


def item(*effects: str, left: float = 1.0, **others: float) -> Item:
    on = np.zeros(16, dtype=np.bool_)
    fit = SimpleNamespace(effects=effects, left=left, fitted=SimpleNamespace(packed=SimpleNamespace(on=on)))
    return Item(effects[-1], fit, **others)


def problem_of(**others: Any) -> SimpleNamespace:
    return SimpleNamespace(**{"policy": POLICY, "misfit": None, **others})


def state_of(chosen: Item | None, tried: tuple[Item, ...], monkeypatch: pytest.MonkeyPatch) -> SearchState:
    problem, evidence = problem_of(), SimpleNamespace(repeats=True)
    for module in (settling, base_beside, backward):
        monkeypatch.setattr(module, "error_left", lambda _, fit: fit.left)
    given: Any = (problem, SimpleNamespace(), None, no_progress, evidence)
    return SearchState(*given, chosen=chosen, tried=list(tried))


def test_a_second_rival_takes_the_place_of_the_first_one_that_was_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A spring took a weight's place, and a memory was then fitted beside the spring and had no name."""
    left = {"spring": 0.8, "reversal_memory": 0.9}
    asked: list[tuple[str, str]] = []

    def in_place_of(_: object, __: object, chosen: Item, effect: str, rival: Item) -> Item:
        assert effect in chosen.model_fit.effects
        asked.append((effect, rival.effect))
        return item(rival.effect, *chosen.model_fit.effects[1:], left=left[rival.effect])

    monkeypatch.setattr(settling, "in_place_of", in_place_of)
    monkeypatch.setattr(SearchState, "shaped", lambda *_: None)
    tried = item("gravity_imbalance"), item("spring"), item("reversal_memory")
    state = state_of(tried[0], tried, monkeypatch)
    found = settling._first_exchanged(state, item("gravity_imbalance", "torque_saturation"))
    assert asked == [("gravity_imbalance", "spring"), ("spring", "reversal_memory")]
    assert found.model_fit.effects == ("spring", "torque_saturation")
    assert found.effect == "torque_saturation"


def test_a_rival_of_a_later_round_is_called_by_what_is_new_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a round began with may have been exchanged since: then not what it added stands for it."""
    asked: list[tuple[str, str]] = []

    def in_place_of(_: object, __: object, chosen: Item, effect: str, rival: Item) -> None:
        asked.append((effect, rival.effect))

    monkeypatch.setattr(backward, "in_place_of", in_place_of)
    given: Any = (problem_of(), None, None, no_progress)
    chosen = item("spring", "stribeck", "thermal_drift")
    Backward(*given).in_place(chosen, item("gravity_imbalance", "stribeck"))
    assert asked == [("spring", "gravity_imbalance")]


@pytest.mark.parametrize(("now", "kept"), [(True, True), (False, False)])
def test_a_fit_of_a_torque_that_was_moved_since_says_nothing(now: bool, kept: bool) -> None:
    error, moved = np.sin(np.arange(100.0)), np.sin(np.arange(100.0) + (0.0 if now else 0.1))
    fit: Any = SimpleNamespace(
        fitted=SimpleNamespace(packed=None, error=error), correction=SimpleNamespace(bias=0.0)
    )
    given: Any = (SimpleNamespace(raw=lambda _: moved), None, None, no_progress)
    assert Backward(*given)._of_these_data(fit) is kept


@pytest.mark.parametrize(("now", "asked"), [(True, False), (False, True)])
def test_what_a_rival_left_of_an_earlier_torque_does_not_rule_it_out(
    monkeypatch: pytest.MonkeyPatch, now: bool, asked: bool
) -> None:
    """As its round ended the cycles were not taken out yet, and any model left twice as much."""
    chosen, rival = item("spring", "thermal_drift"), item("spring", "stribeck")
    chosen.model_fit.fitted.cost, rival.model_fit.fitted.cost = 1.0, 2.0
    rival.model_fit.free = ()
    monkeypatch.setattr(Backward, "_of_these_data", lambda *_: now)
    monkeypatch.setattr(backward, "fit_inside_twin", lambda *_: rival.model_fit)
    monkeypatch.setattr(backward, "judged_again", lambda *_: rival)
    given: Any = (problem_of(), None, None, no_progress)
    assert (Backward(*given).in_place(chosen, rival) is rival) is asked


def test_what_looks_like_the_first_effect_stays_its_rival(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = (
        item("spring", gain=0.7),
        item("gravity_imbalance", gain=0.69),
        item("reversal_memory", gain=0.2),
        item("stribeck", gain=0.6),
    )
    chosen = item("spring", "thermal_drift")
    state = state_of(chosen, tried, monkeypatch)
    assert [one.effect for one in backward._like_the_first(state, chosen)] == ["gravity_imbalance"]
    assert backward._like_the_first(state, tried[0]) == [], "a single effect has its rivals already"


@pytest.mark.parametrize(
    ("left", "freed", "certain", "first"),
    [
        (0.5, {"torque_saturation": False}, True, "load_dependent_friction"),
        (1.2, {"torque_saturation": False}, True, "torque_saturation"),
        (0.5, {}, True, "torque_saturation"),
        (0.5, {"torque_saturation": False}, False, "torque_saturation"),
    ],
    ids=["it leaves less", "it leaves more", "by a law of its own", "where nothing is left"],
)
def test_beside_a_free_course_what_looks_alike_has_its_own(
    monkeypatch: pytest.MonkeyPatch, left: float, freed: dict[str, bool], certain: bool, first: str
) -> None:
    """Friction that the load presses by a root, told as a motor that saturates by a course, beside a ripple.

    By its own law it left 1.8 times as much in the motor's place, and was no rival; by its course 0.45 times.
    """
    motor, pressed = item("torque_saturation", gain=0.6), item("load_dependent_friction", gain=0.5)
    state = state_of(motor, (motor, pressed), monkeypatch)
    chosen = replace(item("torque_saturation", "torque_ripple"), freed=freed)
    in_place = item("load_dependent_friction", "torque_ripple", left=1.8)
    monkeypatch.setattr(Backward, "in_place", lambda *_: in_place)
    monkeypatch.setattr(
        SearchState, "shaped", lambda *_: item("load_dependent_friction", "torque_ripple", left=left)
    )
    monkeypatch.setattr(SearchState, "more_to_explain", lambda *_: certain)
    found, rivals = backward._or_alike_by_its_course(state, chosen)
    assert found.model_fit.effects == (first, "torque_ripple")
    assert [one.effect for one in rivals] == ([] if first == "torque_saturation" else ["torque_saturation"])


def test_what_a_base_was_found_beside_keeps_the_mark_of_its_course(monkeypatch: pytest.MonkeyPatch) -> None:
    state = state_of(None, (), monkeypatch)
    again = item("torque_saturation").model_fit
    known = SimpleNamespace(effects=("torque_saturation",), free=(), fitted=SimpleNamespace(packed=None))
    again.fitted.cost = 1.0
    state.beside = Item("torque_saturation", known, freed={"torque_saturation": False})
    monkeypatch.setattr(rounds, "fit_inside_twin", lambda *_: again)
    monkeypatch.setattr(rounds, "judged", lambda *_: Item("torque_saturation", again))
    (found,) = rounds._as_beside(state, [])
    assert found.freed == {"torque_saturation": False}


def test_a_candidate_that_is_displaced_is_a_rival_at_its_best(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = item("spring", left=3.0), item("gravity_imbalance", left=2.0)
    state = state_of(None, tried, monkeypatch)
    best = {"spring": item("spring", left=1.02), "gravity_imbalance": item("gravity_imbalance", left=1.0)}
    state.evidence = SimpleNamespace(repeats=True, only_at_rests=lambda *_: False)
    monkeypatch.setattr(SearchState, "shaped", lambda _, one: best[one.effect])
    monkeypatch.setattr(settling, "_contends", lambda _, chosen, one, __: one.effect != chosen.effect)
    assert settling._freed(state, tried[0]) is best["gravity_imbalance"]
    assert state.tried == list(best.values())


def test_the_others_of_a_round_stay_beside_the_best_that_was_refined(monkeypatch: pytest.MonkeyPatch) -> None:
    """The best may be no more than the chain's own lag: then the next one is taken."""
    fits = [item("torque_lag", share=0.9), item("thermal_drift", share=0.85)]
    done = item("torque_lag", share=0.95)
    monkeypatch.setattr(refits, "refined", lambda *_: done)
    monkeypatch.setattr(refits, "replace", lambda one, **_: one)
    monkeypatch.setattr(refits, "_gain_beside", lambda *_: 0.0)
    assert refits.best_refined(None, None, None, fits, fits[0], no_progress) == [done, fits[1]]


def test_what_is_unstable_where_the_torque_was_moved_stays_where_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was compared there by what it leaves of another torque, and was as good as before."""
    best, rival = item("spring"), item("stribeck")
    state = state_of(None, (best, rival), monkeypatch)
    before, again = (state.problem, state.root, state.tried), problem_of()

    def unstable(*effects: str) -> None:
        twins = {"spring", "stribeck"} - set(effects)
        monkeypatch.setattr(
            search_state,
            "fitted_again",
            lambda _, __, items: ("root", [one if one.effect in twins else None for one in items]),
        )

    unstable("spring")
    assert state.moved(again, best) is best
    assert (state.problem, state.root, state.tried) == before
    unstable("stribeck")
    assert state.moved(again, best) is best
    assert (state.problem, state.root) == (again, "root")
    assert [one.effect for one in state.tried] == ["spring"], "a rival without a twin is none there"


def test_what_a_law_leaves_is_that_of_the_torque_as_it_was_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    state = state_of(None, (), monkeypatch)
    monkeypatch.setattr(model_error, "with_misfit", lambda one: problem_of(misfit=f"{one.misfit} again"))
    monkeypatch.setattr(search_state, "fitted_again", lambda _, __, items: ("root", items))
    state.moved(problem_of(), item("spring"))
    assert state.problem.misfit is None, "where it leaves nothing it still does"
    state.moved(problem_of(misfit="told"), item("spring"))
    assert state.problem.misfit == "told again"


def test_all_that_was_tried_is_compared_where_the_torque_was_moved_to(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What had no name before, and the chosen effect by itself, were left with the errors of the torque before."""
    tried = item("spring", left=3.0), item("stribeck", left=3.0, named=False)
    state = state_of(None, tried, monkeypatch)
    monkeypatch.setattr(
        search_state,
        "fitted_again",
        lambda _, __, items: ("root", [item(*i.model_fit.effects, left=1.0) for i in items]),
    )
    for best in (item("spring", left=2.0), item("stribeck", "spring", left=2.0)):
        state.tried = list(tried)
        assert state.moved(problem_of(), best).model_fit.left == 1.0
        assert [(one.effect, one.model_fit.left) for one in state.tried] == [
            ("spring", 1.0),
            ("stribeck", 1.0),
        ]


def test_cycles_in_the_place_of_a_lag_move_what_was_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    state = state_of(item("spring", "torque_lag"), (item("spring"), item("stribeck")), monkeypatch)
    state.problem.twin, again = True, problem_of()
    state.chosen.model_fit.fitted.cost = 1.0
    bare = item("spring").model_fit
    bare.fitted.cost = 0.5
    monkeypatch.setattr(search, "sees_late", lambda _: False)
    monkeypatch.setattr(search, "cycles_in_place", lambda *_: [(again, bare)])
    monkeypatch.setattr(search, "judged", lambda *_: item("spring"))
    monkeypatch.setattr(
        search_state,
        "fitted_again",
        lambda _, __, items: ("root", [item(*i.model_fit.effects, left=0.1) for i in items]),
    )
    assert search._cycles_do(state, state.chosen)
    assert (state.problem, state.root, state.chosen.model_fit.left) == (again, "root", 0.1)
    assert [one.model_fit.left for one in state.tried] == [0.1, 0.1]


def test_a_lag_that_is_not_taken_leaves_no_course_freed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the lag the course of the ripple was free; without it the ripple has its own law again."""
    chosen = item("torque_ripple", "spring", freed={"spring": False})
    state = state_of(chosen, (chosen, item("torque_lag", freed={"torque_lag": True})), monkeypatch)
    state.evidence.apart = lambda *_: True
    lagging = item("torque_ripple", "spring", "torque_lag")
    monkeypatch.setattr(SearchState, "more_to_explain", lambda *_: True)
    monkeypatch.setattr(search, "lag_in_loop", lambda *_: (problem_of(), lagging.model_fit))
    monkeypatch.setattr(search, "explained_of_rest", lambda *_: [SimpleNamespace(share=1.0)])
    monkeypatch.setattr(search, "with_noise_of", lambda *found: found)
    monkeypatch.setattr(search, "judged", lambda *_: lagging)
    before, taken = state.problem, []

    def moved(state: SearchState, problem: Any, best: Item) -> Item:
        state.problem = problem
        return best

    monkeypatch.setattr(SearchState, "moved", moved)

    def take(state: SearchState, best: Item) -> None:
        assert best.freed == {"spring": False}, (
            "as the spring has it; the lag has its own law, not its rival's"
        )
        taken.append(best)
        state.chosen = replace(lagging, named=False, freed={**best.freed, "torque_ripple": False})

    monkeypatch.setattr(search, "take", take)
    assert not search._lags_after_all(state)
    assert [one.model_fit for one in taken] == [lagging.model_fit]
    assert (state.problem, state.chosen) == (before, chosen)


def test_a_fit_that_is_unstable_in_another_problem_has_no_figures_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stable = {()}
    monkeypatch.setattr(
        refits,
        "fit_inside_twin",
        lambda *told: "again" if told[4] in stable else None,  # by its effects
    )
    root, fit = (
        SimpleNamespace(fitted=SimpleNamespace(packed=None), free=(), effects=effects)
        for effects in ((), ("spring",))
    )
    assert refits.fitted_again(None, root, [Item("spring", fit)]) == ("again", [None])
    stable.clear()
    assert refits.fitted_again(None, root, [Item("spring", fit)]) is None


def test_where_the_root_is_unstable_all_stays_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it had left of the torque before was taken for the error that the moved torque has to explain."""
    best = item("torque_lag")
    state = state_of(None, (best,), monkeypatch)
    before, again = (state.problem, state.root, state.tried), problem_of()
    monkeypatch.setattr(search_state, "fitted_again", lambda *_: None)
    assert state.moved(again, best) is best
    assert (state.problem, state.root, state.tried) == before


def test_what_could_not_be_moved_is_not_taken_with_the_figures_of_another_problem(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It leaves less there, and is compared here."""
    best, there = item("spring"), item("spring", "torque_lag")
    best.model_fit.fitted.cost, there.model_fit.fitted.cost = 1.0, 0.1
    there.model_fit.free = ()
    state = state_of(item("spring", "torque_lag"), (best,), monkeypatch)
    chosen = state.chosen
    assert chosen is not None
    chosen.model_fit.fitted.cost = 1.0
    before, state.problem.twin = (state.problem, state.root, state.tried, chosen), True
    monkeypatch.setattr(search_state, "fitted_again", lambda *_: None)
    again = problem_of()
    assert settling._kept(state, best, 1.0, lambda: state.moved(again, there)) is best
    state.evidence.apart = lambda *_: True
    monkeypatch.setattr(SearchState, "more_to_explain", lambda *_: True)
    monkeypatch.setattr(search, "lag_in_loop", lambda *_: (again, there.model_fit))
    monkeypatch.setattr(search, "explained_of_rest", lambda *_: [SimpleNamespace(share=1.0)])
    monkeypatch.setattr(search, "with_noise_of", lambda *found: found)
    monkeypatch.setattr(search, "judged", lambda *_: there)
    monkeypatch.setattr(search, "take", lambda *_: pytest.fail("it is of another problem"))
    assert not search._lags_after_all(state)
    monkeypatch.setattr(search, "sees_late", lambda _: False)
    monkeypatch.setattr(search, "cycles_in_place", lambda *_: [(again, there.model_fit)])
    assert not search._cycles_do(state, chosen)
    assert (state.problem, state.root, state.tried, state.chosen) == before


@pytest.mark.parametrize("stable", [True, False])
def test_a_new_root_that_is_unstable_where_the_torque_was_moved_to_stays(
    monkeypatch: pytest.MonkeyPatch, stable: bool
) -> None:
    state = state_of(None, (), monkeypatch)
    before, again = state.problem, problem_of()
    state.evidence.aligned = lambda *_: again
    monkeypatch.setattr(search_state, "settled_in", lambda one, _: (one, "settled") if stable else None)
    monkeypatch.setattr(search_state, "with_noise_of", lambda *given: given)
    state.take_root("found")
    assert (state.problem, state.root) == ((again, "settled") if stable else (before, "found"))


@pytest.mark.parametrize("stable", [True, False])
def test_from_a_dead_time_that_the_root_is_unstable_with_nothing_begins_anew(
    monkeypatch: pytest.MonkeyPatch, stable: bool
) -> None:
    state, again = state_of(item("torque_lag"), (), monkeypatch), problem_of()
    state.evidence.apart = lambda *_: True
    before = state.problem, state.root
    monkeypatch.setattr(search, "dead_time_in_place", lambda *_: (again, None))
    monkeypatch.setattr(search, "settled_in", lambda one, _: (one, "settled") if stable else None)
    monkeypatch.setattr(search, "with_noise_of", lambda *given: given)
    assert search._is_dead_time(state) is stable
    assert state.delayed is not stable, "the lag has its name, and is not confirmed"
    assert (state.problem, state.root) == ((again, "settled") if stable else before)


@pytest.mark.parametrize(
    ("found", "moved", "taken"),
    [(0.8, 0.5, True), (0.8, 0.9, False), (None, 0.9, True), (0.8, None, False), (None, None, False)],
    ids=["it leaves less", "more", "beside nothing", "unstable", "unstable beside nothing"],
)
def test_a_law_that_was_outdone_is_compared_where_the_torque_was_moved_to(
    monkeypatch: pytest.MonkeyPatch, found: float | None, moved: float | None, taken: bool
) -> None:
    """As it was outdone it left 0.7 of another torque."""
    state = state_of(None if found is None else item("spring", left=found), (), monkeypatch)
    assert base_beside._outdone_after_all(state) is None
    state.outdone = SimpleNamespace(left=0.7)
    there = None if moved is None else (state.problem, SimpleNamespace(left=moved))
    monkeypatch.setattr(base_beside, "settled_in", lambda *_: there)
    assert base_beside._outdone_after_all(state) is (there[1] if there is not None and taken else None)


def test_no_law_of_an_earlier_root_counts_as_outdone(monkeypatch: pytest.MonkeyPatch) -> None:
    state = state_of(None, (), monkeypatch)
    state.outdone = SimpleNamespace(left=0.7)
    state.evidence.worth_fitting = lambda *_: []
    monkeypatch.setattr(SearchState, "more_to_explain", lambda *_: False)
    assert not base_beside.other_law(state, [])
    assert state.outdone is None


@pytest.mark.parametrize(
    ("others", "tried", "exchanged"),
    [
        (("spring",), {"spring": 3.0, "gravity_imbalance": 1.1, "stribeck": 3.0}, []),
        (
            ("thermal_drift", "spring"),
            {"spring": 3.0, "gravity_imbalance": 3.0, "stribeck": 3.0},
            [("gravity_imbalance", "thermal_drift", "spring")],
        ),
    ],
    ids=["one", "two"],
)
def test_rivals_beside_elements_that_are_the_base_s_have_them_too(
    monkeypatch: pytest.MonkeyPatch,
    others: tuple[str, ...],
    tried: dict[str, float],
    exchanged: list[tuple[str, ...]],
) -> None:
    """By themselves they lack the elements, and leave three times as much: a rival that does as well was none.

    Of several effects the memory itself was told as what may stand for one of them.
    """
    chosen = item("reversal_memory", *others)
    by_themselves = [
        item(one, left=3.0) for one in ("spring", "gravity_imbalance", "stribeck", "reversal_memory")
    ]
    state = state_of(chosen, tuple(by_themselves), monkeypatch)
    rival = replace(
        item("reversal_memory", "gravity_imbalance", *others[:-1], left=1.1), effect="gravity_imbalance"
    )
    if len(others) > 1:
        rival = replace(
            item("gravity_imbalance", "reversal_memory", *others, left=1.1), effect="gravity_imbalance"
        )
    instead = item("stribeck", *others, left=1.2)
    for name, value in {
        "with_own_presliding": "own",
        "_remembered_beyond": None,
        "_needed_beside": True,
    }.items():
        monkeypatch.setattr(own_presliding, name, lambda *_, value=value: value)
    monkeypatch.setattr(own_presliding, "replace", _replaced)
    found = own_presliding.beside_own_presliding(
        state, Found(None, None, chosen, (), state.tried, {}, exchanged=[rival, instead])
    )
    assert {one.effect: one.model_fit.left for one in found.tried} == tried
    assert [one.model_fit.effects for one in found.exchanged] == exchanged
    assert found.chosen is not None
    assert found.chosen.model_fit.effects == others


@pytest.mark.parametrize("others", [(), ("spring",)], ids=["alone", "beside a spring"])
def test_rivals_of_a_memory_beside_a_climb_climb_too(
    monkeypatch: pytest.MonkeyPatch, others: tuple[str, ...]
) -> None:
    """The root has that climb then; rivals without it leave three times as much, and were none."""
    chosen, root = item(*others, "reversal_memory"), item("climb", left=0.7).model_fit
    state = state_of(chosen, (), monkeypatch)
    state.tried = [item("reversal_memory"), item("stribeck", left=3.0), item("backlash", left=3.0)]
    exchanged = [item(*others, "stribeck", left=3.0), item("dwell_time_break_away", "reversal_memory")]
    asked: list[tuple[float, tuple[str, ...]]] = []

    def in_place_of(_: object, its: object, begun: Item, effect: str, rival: Item) -> Item | None:
        assert (its, effect) == (root, "reversal_memory")
        asked.append((begun.model_fit.left, begun.model_fit.effects))
        return None if rival.effect == "backlash" else item(*others, rival.effect, left=1.1)

    for name, value in {
        "with_own_presliding": "own",
        "_remembered_beyond": root,
        "in_place_of": in_place_of,
        "judged_again": lambda _, __, one, model_fit: item(*model_fit.effects, left=model_fit.left),
        "replace": _replaced,
    }.items():
        value = value if callable(value) else lambda *_, value=value: value
        monkeypatch.setattr(own_presliding, name, value)
    found = own_presliding.beside_own_presliding(
        state, Found(None, None, chosen, (), state.tried, {}, exchanged=exchanged)
    )
    assert found.root is root
    fits = found.exchanged if others else found.tried
    assert {one.effect: one.model_fit.left for one in fits} == {"reversal_memory": 1.0, "stribeck": 1.1}
    assert set(asked) == {(1.0 if others else 0.7, (*others, "reversal_memory"))}, (
        "alone, from the root's base"
    )


@pytest.mark.parametrize("others", [(), ("torque_ripple",)], ids=["alone", "beside a ripple"])
@pytest.mark.parametrize("plain", [True, False])
def test_where_a_spring_takes_the_place_of_hardly_a_gap_rivals_of_others_have_it_too(
    monkeypatch: pytest.MonkeyPatch, others: tuple[str, ...], plain: bool
) -> None:
    """Beside the gap an eccentricity did as well as a ripple; beside the spring it was no rival of it any more."""
    gap, spring = item(*others, "backlash"), item(*others, "elastic_transmission")
    beside = item("backlash", "encoder_eccentricity")
    lag = item(*others, "torque_lag")
    state = state_of(gap, (gap, item("elastic_transmission"), item("stribeck")), monkeypatch)
    state.problem.policy = POLICY

    def fitted(_: object, *given: Any) -> Item | None:
        return replace(given[3], model_fit=item("elastic_transmission", "encoder_eccentricity").model_fit)

    monkeypatch.setattr(transmission._Exchange, "fitted", fitted)
    monkeypatch.setattr(search, "spring_in_place", lambda *_: spring)
    monkeypatch.setattr(search, "plainer_of", lambda *_: spring if plain else gap)
    told = [beside, lag] if others else []
    found = Found(state.problem, None, gap, (), state.tried, {}, exchanged=told)
    found = search._or_a_spring(state, found, gap)
    if not plain:
        assert (found.chosen, found.spring, found.exchanged) == (gap, spring, told)
        return
    assert found.chosen is spring
    assert {one.effect for one in found.tried} == (
        {"stribeck", "elastic_transmission"} if not others else {one.effect for one in state.tried}
    )
    ways = [exchanged_for(spring, one) for one in found.exchanged]
    assert ways == (
        [({"torque_ripple"}, {"encoder_eccentricity"}), ({spring.effect}, {"torque_lag"})] if others else []
    )


@pytest.mark.parametrize(
    ("effects", "told"),
    [
        (("stribeck", "backlash"), "known"),
        (("thermal_drift", "backlash"), "anew"),
        (("stribeck", "thermal_drift"), None),
        (("backlash",), None),
    ],
    ids=["as it was", "an exchanged one", "no mass any more", "refuted beside it"],
)
def test_what_tells_of_a_second_mass_stands_beside_it(
    monkeypatch: pytest.MonkeyPatch, effects: tuple[str, ...], told: str | None
) -> None:
    known = SimpleNamespace(effects=("stribeck",), name="known")
    anew = SimpleNamespace(effects=("thermal_drift",), name="anew")
    monkeypatch.setattr(backward, "without_effect", lambda *_: Item("", anew, named=False))
    problem = problem_of(has_veto=True, data=SimpleNamespace(steady=False, repeated=True))
    found = Found(problem, None, item("stribeck", "backlash"), (), (), {}, unloaded=known)
    left = confirmation.with_chosen(found, item(*effects)).unloaded
    assert (None if left is None else left.name) == told
    assert confirmation.with_chosen(found, None).unloaded is None


def _replaced(one: Any, **changes: Any) -> Any:
    """`replace`, of what stands for a fit as well."""
    if isinstance(one, SimpleNamespace):
        return SimpleNamespace(**{**vars(one), **changes})
    return replace(one, **changes)


def test_a_rival_that_is_told_from_what_was_chosen_keeps_its_course(monkeypatch: pytest.MonkeyPatch) -> None:
    """On another recording the rival errs less; that its course was free was forgotten with the search."""
    chosen, rival = item("gravity_imbalance"), item("spring", freed={"spring": False})
    state = state_of(chosen, (chosen, rival), monkeypatch)
    left = {"gravity_imbalance": 2.0, "spring": 1.0}
    monkeypatch.setattr(confirmation, "_pieces", lambda _, fit: Unseen(np.full(10, left[fit.effects[0]])))
    monkeypatch.setattr(confirmation, "without_own_course", lambda *_: [])
    monkeypatch.setattr(confirmation, "_held_out", lambda *_: SimpleNamespace(lowers=True))
    found = confirmation.told_apart(search._in_state(state), ("gravity_imbalance", "spring"), [])
    assert found.chosen is rival
    assert found.chosen.freed == {"spring": False}


def test_a_rival_with_a_free_course_is_taken_later_by_its_own_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring's course was free as a weight's rival; beside the weight it was told to differ, and never freed."""
    chosen = item("gravity_imbalance", freed={"gravity_imbalance": True})
    state = state_of(chosen, (chosen, item("spring", freed={"spring": False})), monkeypatch)
    state.evidence.repeats, state.evidence.worth_fitting = False, lambda *_: []
    for name, value in {
        "least_fall": 0.0,
        "rank": [],
        "_fit_down": [item("gravity_imbalance", "spring")],
        "without_needless_gap": lambda _, fits: fits,
        "_best": lambda _, fits: fits[0],
        "law_before_further": False,
    }.items():
        value = value if callable(value) else lambda *_, value=value: value
        monkeypatch.setattr(rounds, name, value)
    best = rounds.one_round(state, first=False)
    assert best is not None
    assert best.freed == {"gravity_imbalance": True}


def test_a_course_that_is_freed_once_more_was_not_named_by_its_own_law(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = state_of(None, (), monkeypatch)
    monkeypatch.setattr(search_state, "with_free_shape", lambda *_: item("stribeck", "spring"))
    monkeypatch.setattr(search_state, "unsettled", lambda *_: False)
    once = state.shaped(item("stribeck", "spring", named=False, freed={"stribeck": True}))
    assert once is not None
    assert once.freed == {"stribeck": True, "spring": False}
    again = state.shaped(replace(once, named=True))
    assert again is not None
    assert again.freed == once.freed


def test_a_fit_has_the_free_courses_of_what_it_began_with_and_of_what_is_put_in_a_place_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is not among its effects any more may come back by its own law."""
    begun = item("spring", "torque_ripple", freed={"spring": False, "torque_ripple": True})
    rival = item(
        "torque_ripple", "gravity_imbalance", freed={"torque_ripple": False, "gravity_imbalance": False}
    )
    for one in (begun, rival):
        one.model_fit.fitted.packed.p, one.model_fit.free = None, ()
    root = SimpleNamespace(free=())
    for name in ("taken_out", "with_effects"):
        monkeypatch.setattr(refits, name, lambda *_: None)
    monkeypatch.setattr(refits, "fit_inside_twin", lambda *told: item(*told[4]).model_fit)
    monkeypatch.setattr(refits, "judged", lambda _, __, fit, effect: Item(effect, fit))
    found = refits.in_place_of(None, root, begun, "spring", rival)
    assert found is not None
    assert found.model_fit.effects == ("gravity_imbalance", "torque_ripple")
    assert found.freed == {"torque_ripple": True, "gravity_imbalance": False}
    assert refits.judged_again(None, root, begun, item("torque_ripple").model_fit).freed == {
        "torque_ripple": True
    }
    assert begun.with_courses_of(None).freed == {}


def _course_for(_: SearchState, one: Item) -> Item:
    return item(*one.model_fit.effects, left=1.5, freed={one.effect: False})


def test_a_course_that_is_not_taken_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rival kept its own law, and was told on another recording by a course that it has not."""
    chosen, rival = item("gravity_imbalance", left=1.0), item("spring", left=3.0)
    state = state_of(None, (chosen, rival), monkeypatch)
    monkeypatch.setattr(SearchState, "shaped", _course_for)
    monkeypatch.setattr(settling, "_contends", lambda _, best, one, __: one.effect != best.effect)
    state.evidence = SimpleNamespace(repeats=True, only_at_rests=lambda *_: True, comes_near=lambda *_: False)
    best = settling._freed(state, chosen)
    assert (best.effect, best.freed) == ("gravity_imbalance", {"gravity_imbalance": False})
    assert state.tried[1] is rival

    monkeypatch.setattr(settling, "without_own_course", lambda *_: ["gravity_imbalance"])
    monkeypatch.setattr(settling, "rather_a_spring", lambda *_: True)
    straight = item("spring")
    monkeypatch.setattr(settling, "_pulling", lambda _: straight_of(straight))
    assert settling.spring_as_well(state, chosen) is chosen

    pair, other = item("gravity_imbalance", "stribeck"), item("spring", "stribeck", left=2.0)
    monkeypatch.setattr(settling, "in_place_of", lambda *_: other)
    assert settling._first_exchanged(state, pair) is pair

    state.chosen = pair
    state.evidence.explains_rest_of = lambda *_: True
    monkeypatch.setattr(backward, "backward_of", lambda _: SimpleNamespace(exchanged=lambda *_: [other]))
    assert backward.in_place(state) == [other]
    assert (state.chosen, other.freed) == (pair, {})


def straight_of(one: Item) -> SimpleNamespace:
    """The same with what it explains of the training."""
    return SimpleNamespace(**vars(one), training=SimpleNamespace(share=0.97))


def test_a_search_that_begins_anew_has_tried_nothing_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its time may be up before its first round: what was tried beside another root was told of then."""
    state = state_of(item("spring"), (item("spring"),), monkeypatch)
    state.generic, state.later = {"position": 0.5}, [item("stribeck")]
    monkeypatch.setattr(search, "next_best", lambda *_, **__: None)
    search._seek(state)
    for one in (state, state.kept):
        assert one is not None
        assert (one.chosen, list(one.tried), one.later, dict(one.generic)) == (None, [], [], {})


def test_what_was_fitted_beside_an_effect_that_is_refuted_since_is_not_chosen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chosen, beside = item("thermal_drift", "spring"), item("stribeck", "thermal_drift", "gravity_imbalance")
    monkeypatch.setattr(confirmation, "_pieces", lambda _, fit: Unseen(np.full(10, 1.0 / len(fit.effects))))
    monkeypatch.setattr(confirmation, "without_own_course", lambda *_: [])
    monkeypatch.setattr(confirmation, "_held_out", lambda *_: SimpleNamespace(lowers=True))
    found = Found(problem_of(), None, chosen, (), (), {}, exchanged=[beside])
    assert confirmation.told_apart(found, ("spring", "gravity_imbalance"), []) is found


def test_a_course_of_the_first_effect_takes_the_place_of_no_further_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = state_of(None, (), monkeypatch)
    pair = item("spring", "stribeck")
    found = [item("spring"), pair, pair, item("spring", "stribeck", "thermal_drift")]
    shaped = iter([False, True, False, False])
    monkeypatch.setattr(search, "next_best", lambda *_, **__: found.pop(0) if found else None)
    monkeypatch.setattr(search, "drop_laws", lambda *_, **__: None)
    monkeypatch.setattr(search, "_shaped_instead", lambda *_: next(shaped))
    monkeypatch.setattr(search, "take", lambda state, best: setattr(state, "chosen", best))
    monkeypatch.setattr(SearchState, "more_to_explain", lambda *_: True)
    search._seek(state)
    assert state.chosen is not None
    assert state.chosen.model_fit.effects == ("spring", "stribeck", "thermal_drift")
    assert found == []
