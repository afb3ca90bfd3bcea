"""Work on several cores comes in the order in which it was asked for, and no more of it than is wanted."""

from __future__ import annotations

import threading

import pytest

import autotune.core.side_by_side as module
from autotune.core.side_by_side import VARIABLE, on_each, use_free_cores


@pytest.fixture
def cores(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(module, "_cores", 1)
    return monkeypatch


def _allow(cores: pytest.MonkeyPatch, asked: str) -> None:
    cores.setenv(VARIABLE, asked)
    use_free_cores()


@pytest.mark.parametrize("asked", ["1", "2", "3"])
def test_results_come_in_the_order_of_the_items(cores: pytest.MonkeyPatch, asked: str) -> None:
    _allow(cores, asked)
    assert list(on_each(lambda item: item * item, range(20))) == [item * item for item in range(20)]
    assert list(on_each(lambda item: item, [])) == []


def test_items_are_worked_on_beside_each_other(cores: pytest.MonkeyPatch) -> None:
    """Each waits for the other: one after the other they would wait for ever."""
    _allow(cores, "2")
    meeting = threading.Barrier(2, timeout=20.0)
    assert sorted(on_each(lambda _: meeting.wait(), [1, 2])) == [0, 1]


def test_a_library_works_on_one_core(cores: pytest.MonkeyPatch) -> None:
    own = threading.get_ident()
    assert list(on_each(lambda _: threading.get_ident(), [1, 2, 3])) == [own] * 3


@pytest.mark.parametrize("asked", ["1", "3"])
def test_no_more_is_made_in_advance_than_there_are_cores(cores: pytest.MonkeyPatch, asked: str) -> None:
    _allow(cores, asked)
    begun: list[int] = []
    results = on_each(lambda item: begun.append(item) or item, range(50))
    assert next(results) == 0
    results.close()
    assert len(begun) <= int(asked)


@pytest.mark.parametrize("asked", ["1", "2"])
def test_what_fails_is_raised_at_its_place(cores: pytest.MonkeyPatch, asked: str) -> None:
    _allow(cores, asked)
    results = on_each(lambda item: 1 // item, [1, 0, 1])
    assert next(results) == 1
    with pytest.raises(ZeroDivisionError):
        next(results)


@pytest.mark.parametrize(("asked", "most"), [("", 8), ("0", 8), ("many", 8), ("-3", 8), ("2", 2), ("99", 8)])
def test_only_a_number_of_cores_is_heard(cores: pytest.MonkeyPatch, asked: str, most: int) -> None:
    cores.setattr(module, "_allowed", lambda: 64)
    _allow(cores, asked)
    assert module._cores == most


@pytest.mark.parametrize(("allowed", "most"), [(1, 1), (2, 1), (4, 3), (64, 8)])
def test_one_core_is_left_to_others(cores: pytest.MonkeyPatch, allowed: int, most: int) -> None:
    cores.setattr(module, "_allowed", lambda: allowed)
    _allow(cores, "")
    assert module._cores == most
