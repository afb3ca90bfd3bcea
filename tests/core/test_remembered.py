"""What was asked is answered again by content, and the oldest answer is forgotten."""

import numpy as np

from autotune.core.remembered import LastOf, Remembered, digest_of


def test_a_question_is_answered_once_until_it_is_forgotten() -> None:
    known: Remembered[int] = Remembered(most=2)
    found: list[str] = []

    def ask(question: str) -> int:
        return known.answer(question, lambda: found.append(question) or len(found))

    assert [ask("a"), ask("b"), ask("a")] == [1, 2, 1]
    assert ask("c") == 3
    assert [ask("b"), ask("a")] == [2, 4]
    assert found == ["a", "b", "c", "a"]


def test_things_are_known_by_themselves_and_not_by_what_they_hold() -> None:
    known: LastOf[int] = LastOf(most=2)
    found: list[int] = []
    one, alike, third = [1], [1], [3]

    def ask(thing: list[int]) -> int:
        return known.answer((thing, None), lambda: found.append(1) or len(found))

    assert [ask(one), ask(alike), ask(one)] == [1, 2, 1]
    assert [ask(third), ask(alike), ask(one)] == [3, 2, 4]


def test_arrays_are_told_apart_by_value_and_shape() -> None:
    values = np.arange(6.0)
    assert digest_of(values) == digest_of(values.copy())
    assert digest_of(values) == digest_of(np.repeat(values, 2)[::2])
    others = [digest_of(values + 1e-15), digest_of(values.reshape(2, 3)), digest_of(values[:5], values[5:])]
    assert digest_of(values) not in others
    assert len(set(others)) == 3
