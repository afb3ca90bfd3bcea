"""What was settled before an effect was found is asked again: courses of the others, where a search begins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest

from autotune.diagnosis import settling, verdict
from autotune.diagnosis.candidates import FittedCandidate
from autotune.diagnosis.search_state import Found
from autotune.estimation.cross_validation import Explained
from autotune.estimation.policy import POLICY, Policy


@pytest.mark.parametrize(
    ("named", "repeats", "left", "asked"),
    [
        (False, True, False, True),
        (True, True, True, True),  # what has a name may be told better
        (True, True, False, False),
        (True, False, True, False),  # of one trajectory nothing says that anything is left
    ],
)
def test_courses_of_those_before_are_freed_while_something_is_left(
    named: bool, repeats: bool, left: bool, asked: bool
) -> None:
    model_fit: Any = SimpleNamespace(effects=("spring", "torque_ripple"))
    chosen = FittedCandidate("torque_ripple", model_fit, 0.5, Explained(1.0, 0.01), None, named)
    seen: list[str] = []

    def shaped(item: FittedCandidate) -> None:
        seen.append(item.effect)

    state: Any = SimpleNamespace(
        evidence=SimpleNamespace(repeats=repeats), shaped=shaped, more_to_explain=lambda _: left
    )
    assert settling._others_freed(state, chosen) is chosen
    assert seen == (["spring"] if asked else [])


@pytest.mark.parametrize("still", [True, False])
def test_a_course_that_costs_the_name_is_not_taken(still: bool) -> None:
    model_fit: Any = SimpleNamespace(effects=("spring", "torque_ripple"))
    chosen = FittedCandidate("torque_ripple", model_fit, 0.5, Explained(1.0, 0.01), None, named=True)
    other = FittedCandidate("spring", model_fit, 0.6, Explained(1.0, 0.005), None, named=still)

    def shaped(item: FittedCandidate) -> FittedCandidate:
        return replace(other, freed={item.effect: item.named})

    state: Any = SimpleNamespace(
        evidence=SimpleNamespace(repeats=True), shaped=shaped, more_to_explain=lambda _: True
    )
    found = settling._others_freed(state, chosen)
    assert (found.effect, found.gain) == ("torque_ripple", 0.6 if still else 0.5)
    assert found.freed == ({"spring": True} if still else {})


@pytest.mark.parametrize(
    ("again", "goes_on"),
    [
        (1.5, True),  # what it begins with anew is told without what was found, and leaves more beside that
        (1.1, False),  # by chance
        (0.5, False),
        (None, True),  # no twin is stable there
    ],
)
def test_a_search_that_begins_again_is_no_worse_beside_what_was_found(
    monkeypatch: pytest.MonkeyPatch, again: float | None, goes_on: bool
) -> None:
    """A law that was told anew left 1.6 times as much beside a motor that saturates as the one before."""

    def fit(cost: float) -> Any:
        return SimpleNamespace(fitted=SimpleNamespace(cost=cost, packed="packed"), free=(), effects=())

    begun, asked = iter(["first", "second"]), []

    def begin(*_: Any, **__: Any) -> tuple[Any, ...]:
        name = next(begun)
        return Beginning(name), fit(1.0), None, (name,)

    def search(problem: Any, *_: Any) -> Found:
        asked.append(problem.name)
        last = len(asked) == 2
        seen = Beginning("led on" if not last else problem.name)
        found: Any = (seen, fit(1.0), None, (), (), {})
        return Found(
            *found,
            begin_again=None if last else "packed",
            beside=None if last else SimpleNamespace(model_fit=fit(1.0)),
        )  # type: ignore[arg-type]

    for name, told in {
        "begin": begin,
        "search": search,
        "with_counts": lambda problem, _: problem,
        "with_misfit": lambda problem: problem,
        "notes_after": lambda notes, *_: notes,
        "model_from": lambda model, *_: model,
        "told_of_base": lambda *_: (),
        "fit_inside_twin": lambda *_: None if again is None else fit(again),
    }.items():
        monkeypatch.setattr(verdict, name, told)
    model: Any = SimpleNamespace(pack=lambda: None, motion_unit="rad")
    data: Any = None
    _, _, notes = verdict._searched(data, model, lambda _: None, POLICY, None)
    assert asked == ["first", "led on" if goes_on else "second"]
    assert notes == (("first",) if goes_on else ("second",))


@dataclass(frozen=True)
class Beginning:
    """What a search begins with."""

    name: str
    policy: Policy = POLICY


def _fit(effect: str, left: float, named: bool = False, more: tuple[str, ...] = ()) -> FittedCandidate:
    """One that leaves so much of 1 that comes again."""
    model_fit: Any = SimpleNamespace(effects=(*more, effect))
    return FittedCandidate(effect, model_fit, 0.5, Explained(1.0, left), None, named)


@pytest.mark.parametrize(
    ("best", "rival", "led", "taken"),
    [
        (_fit("elastic_transmission", 0.20), _fit("backlash", 0.30), 0.08, True),
        (_fit("elastic_transmission", 0.20), _fit("backlash", 0.30), 0.25, False),
        (_fit("elastic_transmission", 0.04, named=True), _fit("backlash", 0.30), 0.02, False),
        (_fit("elastic_transmission", 0.20), _fit("reversal_memory", 0.30), 0.08, False),
        (_fit("elastic_transmission", 0.20), _fit("backlash", 1.5), 0.08, False),
        (_fit("elastic_transmission", 0.20, more=("spring",)), _fit("backlash", 0.30), 0.08, False),
        (_fit("backlash", 0.20), _fit("elastic_transmission", 0.30), 0.08, True),
    ],
    ids=["a gap", "no better", "named", "no transmission", "less than half", "beside another", "a spring"],
)
def test_of_two_transmissions_without_a_name_the_other_is_led_as_far(
    monkeypatch: pytest.MonkeyPatch, best: FittedCandidate, rival: FittedCandidate, led: float, taken: bool
) -> None:
    """A gap of 70 % beside a spring of 78 % in the round explained 93 % when it was led on; it was never asked."""
    other = _fit(rival.effect, led)
    monkeypatch.setattr(settling, "refined", lambda *_: rival)
    monkeypatch.setattr(settling, "masses_led_on", lambda *_: other)
    state: Any = SimpleNamespace(
        problem=SimpleNamespace(twin=True, policy=POLICY), root=None, progress=print, tried=[best, rival]
    )
    assert settling._or_other_transmission(state, best) is (other if taken else best)
    asked = taken or led == 0.25
    assert state.tried == [best, other if asked else rival]


@pytest.mark.parametrize(
    ("effect", "another_law", "contends"),
    [
        ("load_dependent_friction", True, True),
        ("load_dependent_friction", False, False),
        ("thermal_drift", True, False),
    ],
    ids=["a look-alike", "its own law is enough", "no look-alike"],
)
def test_a_look_alike_has_its_course_free_where_the_chosen_effect_has(
    effect: str, another_law: bool, contends: bool
) -> None:
    """Friction that the load presses by a root of squares explained 94 % by the library's law, and a motor 96 % by its
    own: by their courses 99.5 and 98 % (development single 70014)."""
    state = SimpleNamespace(
        problem=SimpleNamespace(policy=POLICY),
        root=None,
        evidence=SimpleNamespace(comes_near=lambda *_: False),
    )
    certain = SimpleNamespace(certain=False)
    chosen = SimpleNamespace(
        effect="torque_saturation", named=True, gain=0.9, share=0.96, training=certain, veto=None
    )
    item = SimpleNamespace(effect=effect, named=False, gain=0.8, share=0.94)
    assert settling._contends(state, chosen, item, another_law) is contends


@pytest.mark.parametrize(
    ("effect", "contends"),
    [("encoder_eccentricity", True), ("thermal_drift", False)],
    ids=["two waves", "one law"],
)
def test_an_effect_whose_own_law_is_a_part_of_its_course_contends_by_that_part(
    effect: str, contends: bool
) -> None:
    """Of an encoder that is tilted too one wave a turn explained 35 %, both 98 %; a ripple with 36 % was chosen."""
    state = SimpleNamespace(problem=SimpleNamespace(policy=POLICY), root=None, evidence=None)
    uncertain = SimpleNamespace(certain=False)
    chosen = SimpleNamespace(
        effect="torque_ripple", named=False, gain=0.16, share=0.36, training=uncertain, veto=None
    )
    item = SimpleNamespace(effect=effect, named=False, gain=0.25, share=0.35)
    assert settling._contends(state, chosen, item) is contends
