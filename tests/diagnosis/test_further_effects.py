"""Effects beside one that needs more for a name: the others of a round, two of them at once, and what is told of one
that was not taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from autotune.diagnosis import rounds, wording
from autotune.diagnosis.candidates import no_progress
from autotune.diagnosis.rounds import (
    _led_beside,
    _one_after_another,
    _other_by_its_course,
    _other_worth_having,
    _two_at_once,
)
from autotune.diagnosis.search_state import Found, SearchState
from autotune.diagnosis.wording import left_note
from autotune.estimation.policy import POLICY
from tests.support.fitted import Item


def _model(*effects: str, cost: float = 1.0) -> SimpleNamespace:
    """A fitted model: its effects, and what it leaves [(N m)²]."""
    return SimpleNamespace(effects=effects, fitted=SimpleNamespace(cost=cost, error=None))


def _beside(first: str, effect: str, cost: float = 1.0) -> Item:
    return Item(effect, _model(first, effect, cost=cost), named=False)


def _search(chosen: Item | None, repeats: bool = True) -> SearchState:
    evidence: Any = SimpleNamespace(repeats=repeats)
    problem: Any = SimpleNamespace(policy=POLICY)
    root: Any = _model()
    told: Any = chosen
    return SearchState(problem, root, None, no_progress, evidence, chosen=told)  # type: ignore[arg-type]


STRIBECK = Item("stribeck", _model("stribeck"), named=False)
FITS = [
    _beside("stribeck", "position_dependent_friction", 0.6),
    _beside("stribeck", "torque_ripple", 0.5),
    _beside("stribeck", "spring", 0.7),
]


@pytest.mark.parametrize(
    ("chosen", "worth", "taken"),
    [
        (STRIBECK, {"torque_ripple", "spring"}, "torque_ripple"),
        (STRIBECK, {"spring"}, "spring"),
        (STRIBECK, {"position_dependent_friction"}, None),  # the best itself, which was asked before
        (STRIBECK, set(), None),
        (replace(STRIBECK, named=True), {"torque_ripple"}, None),
        (None, {"torque_ripple"}, None),
    ],
    ids=[
        "the one that leaves least",
        "the only one",
        "the best one",
        "none",
        "beside a name",
        "beside nothing",
    ],
)
def test_another_further_effect_is_taken_where_the_best_is_not_worth_having(
    monkeypatch: pytest.MonkeyPatch, chosen: Item | None, worth: set[str], taken: str | None
) -> None:
    """A ripple and a tight spot beside Stribeck friction: 52 and 43 % of what that left, and the spot predicted better.

    Nothing was taken beside the friction, which explained 88 %; with both all three are named.
    """
    monkeypatch.setattr(SearchState, "worth_having", lambda _, one: one.effect in worth)
    found = _other_worth_having(_search(chosen), FITS, FITS[0])  # type: ignore[arg-type]
    assert (found.effect if found is not None else None) == taken


def _two(
    monkeypatch: pytest.MonkeyPatch,
    shares: dict[str, float],
    beside_each: Sequence[float],
    chosen: Item | None = STRIBECK,
    repeats: bool = True,
) -> tuple[str, ...] | None:
    """The effects of what is taken: `shares` of what is chosen leaves, `beside_each` what both explain of its rest."""
    fits = [_beside("stribeck", effect) for effect in shares]

    def of_rest(_: object, before: SimpleNamespace, after: SimpleNamespace) -> list[SimpleNamespace]:
        if len(after.effects) == 2:
            return [SimpleNamespace(share=shares[after.effects[-1]])]
        return [SimpleNamespace(share=beside_each[0]), SimpleNamespace(share=beside_each[1])]

    def fitted(_: object, __: object, before: SimpleNamespace, screened: str) -> Item:
        return Item(screened, _model(*before.effects, screened))

    monkeypatch.setattr(rounds, "explained_of_rest", of_rest)
    monkeypatch.setattr(rounds, "screen", lambda *given: given[-1])
    monkeypatch.setattr(rounds, "inside_twin", fitted)
    monkeypatch.setattr(rounds, "counted_beside", lambda *given: given[-1])
    monkeypatch.setattr(SearchState, "worth_having", lambda *_: True)
    found = _two_at_once(_search(chosen, repeats), fits)  # type: ignore[arg-type]
    return found.model_fit.effects if found is not None else None


def test_two_further_effects_at_once_each_of_which_explains_less_than_half(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A spring to the frame and two masses beside Stribeck friction: 45 and 49.8 % of what it leaves, together 83 %.

    The axis was "unknown". The second mass is the one that is begun with: the other's look is the cheap one.
    """
    taken = _two(monkeypatch, {"spring": 0.45, "elastic_transmission": 0.498}, (0.7, 0.6))
    assert taken == ("stribeck", "elastic_transmission", "spring")


@pytest.mark.parametrize(
    ("shares", "beside_each"),
    [
        ({"spring": 0.45, "elastic_transmission": 0.3}, (0.7, 0.6)),
        ({"spring": 0.45, "gravity_imbalance": 0.44}, (0.7, 0.1)),
        ({"backlash": 0.45, "elastic_transmission": 0.45}, (0.7, 0.7)),
        ({"spring": 0.9}, (0.7, 0.7)),
    ],
    ids=["too little together", "one instead of the other", "two second masses", "one only"],
)
def test_no_two_at_once_where_either_does_without_the_other(
    monkeypatch: pytest.MonkeyPatch, shares: dict[str, float], beside_each: Sequence[float]
) -> None:
    assert _two(monkeypatch, shares, beside_each) is None


@pytest.mark.parametrize(
    ("chosen", "repeats"),
    [
        (replace(STRIBECK, named=True), True),
        (_beside("stribeck", "spring"), True),
        (None, True),
        (STRIBECK, False),
    ],
    ids=["beside a name", "no room for two", "beside nothing", "a lone recording"],
)
def test_nor_where_nothing_asks_for_them(
    monkeypatch: pytest.MonkeyPatch, chosen: Item | None, repeats: bool
) -> None:
    shares = {"spring": 0.45, "elastic_transmission": 0.498}
    assert _two(monkeypatch, shares, (0.7, 0.6), chosen, repeats) is None


NAMED = replace(STRIBECK, named=True)


@pytest.mark.parametrize(
    ("chosen", "first", "second", "taken"),
    [
        (NAMED, 0.55, 0.95, ("stribeck", "direction_asymmetry", "gravity_imbalance")),
        (NAMED, 0.45, 0.95, None),
        (NAMED, 0.55, 0.4, None),
        (NAMED, 0.55, None, None),
        (STRIBECK, 0.55, 0.95, None),
        (None, 0.55, 0.95, None),
    ],
    ids=[
        "each its part",
        "the first too little",
        "the second too little",
        "no second",
        "beside what has no name",
        "beside nothing",
    ],
)
def test_beside_a_name_two_are_taken_one_after_the_other(
    monkeypatch: pytest.MonkeyPatch,
    chosen: Item | None,
    first: float,
    second: float | None,
    taken: tuple[str, ...] | None,
) -> None:
    """Stribeck friction of the base made twenty times what an asymmetry and a weight did, and had the name alone.

    The asymmetry explained half of its rest; the weight 3 % as long as that was missing, and then 95 %.
    """

    def of_rest(_: object, before: SimpleNamespace, after: SimpleNamespace) -> list[SimpleNamespace]:
        return [SimpleNamespace(share=first if len(before.effects) == 1 else second, fall=1.0)]

    def fitted(_: object, __: object, before: SimpleNamespace, item: SimpleNamespace) -> Item:
        return Item(item.effect, _model(*before.effects, item.effect))

    ranked = [SimpleNamespace(effect="gravity_imbalance")] if second is not None else []
    monkeypatch.setattr(rounds, "explained_of_rest", of_rest)
    monkeypatch.setattr(rounds, "least_fall", lambda *_: 0.1)
    monkeypatch.setattr(rounds, "rank", lambda *_: ranked)
    monkeypatch.setattr(rounds, "inside_twin", fitted)
    monkeypatch.setattr(rounds, "counted_beside", lambda *given: given[-1])
    monkeypatch.setattr(SearchState, "worth_having", lambda *_: True)
    state = _search(chosen)
    state.evidence.worth_fitting = lambda _problem, _fit, ranked: ranked
    found = _one_after_another(state, _beside("stribeck", "direction_asymmetry"))  # type: ignore[arg-type]
    assert (found.model_fit.effects if found is not None else None) == taken


@pytest.mark.parametrize(
    ("chosen", "shares", "converged", "led_on"),
    [
        (NAMED, (0.90, 0.83), False, True),
        (NAMED, (0.90, 0.45), False, False),
        (NAMED, (0.999, 0.999), False, False),
        (NAMED, (0.90, 0.83), True, False),
        (STRIBECK, (0.90, 0.83), False, False),
    ],
    ids=["most of the rest", "not half of it", "settled", "converged", "beside what has no name"],
)
def test_beside_a_name_what_explains_most_of_the_rest_is_led_on(
    monkeypatch: pytest.MonkeyPatch, chosen: Item, shares: tuple[float, ...], converged: bool, led_on: bool
) -> None:
    """With what is named it explains 99.8 % of all after a step, and looked settled at 90 and 83 % of the rest."""
    item: Any = _beside("stribeck", "torque_saturation", 0.5)
    item.model_fit.converged = converged
    led = _beside("stribeck", "torque_saturation", 0.4)
    monkeypatch.setattr(
        rounds, "explained_of_rest", lambda *_: [SimpleNamespace(share=one) for one in shares]
    )
    monkeypatch.setattr(rounds, "refined", lambda *_, enough: led if enough == math.inf else item)
    monkeypatch.setattr(rounds, "counted_beside", lambda *given: given[-1])
    found = _led_beside(_search(chosen), item)
    assert found.model_fit is (led if led_on else item).model_fit


@pytest.mark.parametrize(
    ("chosen", "worth", "by_course", "half", "taken"),
    [
        (NAMED, set(), {"torque_ripple"}, 0.8, "torque_ripple"),
        (NAMED, {"spring"}, set(), 0.8, "spring"),
        (NAMED, set(), {"position_dependent_friction"}, 0.8, None),  # the best, which was asked before
        (NAMED, set(), {"torque_ripple"}, 0.4, None),
        (STRIBECK, set(), {"torque_ripple"}, 0.8, None),
        (None, set(), {"torque_ripple"}, 0.8, None),
    ],
    ids=["by its course", "by its own law", "the best one", "not half", "beside no name", "beside nothing"],
)
def test_beside_a_name_another_one_is_taken_by_its_course_where_the_best_is_not_worth_having(
    monkeypatch: pytest.MonkeyPatch,
    chosen: Item | None,
    worth: set[str],
    by_course: set[str],
    half: float,
    taken: str | None,
) -> None:
    """A motor that saturates, or friction that the load presses, beside Stribeck friction: either may leave less."""
    monkeypatch.setattr(SearchState, "worth_having", lambda _, one: one.effect in worth)
    monkeypatch.setattr(rounds, "explained_of_rest", lambda *_: [SimpleNamespace(share=half)])
    monkeypatch.setattr(
        rounds, "_worth_by_its_course", lambda _, one: one if one.effect in by_course else None
    )
    found = _other_by_its_course(_search(chosen), FITS, FITS[0])  # type: ignore[arg-type]
    assert (found.effect if found is not None else None) == taken


@pytest.mark.parametrize(
    ("shares", "said"),
    [
        ((0.73, 0.64), "; direction asymmetry explains 64 % of that and may be part of the truth"),
        ((0.9, 0.3), ""),
    ],
)
def test_what_explains_half_of_the_rest_beside_a_name_is_told_without_one(
    monkeypatch: pytest.MonkeyPatch, shares: tuple[float, ...], said: str
) -> None:
    """Beside a name nearly all of the rest is asked for a second one: an asymmetry was 73 and 64 % of it."""
    monkeypatch.setattr(
        wording, "explained_of_rest", lambda *_: [SimpleNamespace(share=share) for share in shares]
    )
    problem: Any = SimpleNamespace(policy=POLICY, noise_variance=lambda *_: 1.0, mean_square=lambda *_: 5.0)
    chosen: Any = Item("elastic_transmission", _model("elastic_transmission"))
    later: Any = [
        _beside("elastic_transmission", "direction_asymmetry"),
        _beside("stribeck", "torque_ripple"),  # beside another one
    ]
    found = Found(problem, chosen, chosen, (), (), {}, later=later)
    assert [one.effect for one in found.further] == ["direction_asymmetry"]
    text = left_note(problem, chosen.model_fit, found.further)
    assert f"another law of what is named{said};" in text


def test_fits_of_other_rows_say_nothing_of_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows that were left out come back, or torque and motion are aligned anew, after an effect was looked at."""

    def of_rest(*_: object) -> list[SimpleNamespace]:
        raise AssertionError("rows that do not belong together")

    monkeypatch.setattr(wording, "explained_of_rest", of_rest)
    problem: Any = SimpleNamespace(policy=POLICY, noise_variance=lambda *_: 1.0, mean_square=lambda *_: 5.0)
    chosen: Any = SimpleNamespace(fitted=SimpleNamespace(error=np.zeros(8)))
    before: Any = SimpleNamespace(
        effect="spring", model_fit=SimpleNamespace(fitted=SimpleNamespace(error=np.zeros(9)))
    )
    assert "another law of what is named; where" in left_note(problem, chosen, [before])
