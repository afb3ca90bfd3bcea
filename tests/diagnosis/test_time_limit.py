"""A diagnosis whose time is up tells what it has found until then, and never more than that."""

from itertools import count
from types import SimpleNamespace

import pytest

import autotune
from autotune.core import time_limit
from autotune.core.errors import ConfigurationError
from autotune.core.side_by_side import on_each
from autotune.core.time_limit import TimeIsUp, deadline, limited
from autotune.diagnosis import backward, search
from autotune.diagnosis.candidates import no_progress
from autotune.diagnosis.search_state import SearchState
from autotune.diagnosis.verdict import diagnose

SPRING = 0.004


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
    assert found.next_experiment is None


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


def test_a_limit_that_is_none_is_refused(recorded, nominal) -> None:
    with pytest.raises(ConfigurationError, match="above 0 s"):
        autotune.diagnose([recorded(41, spring=SPRING)], nominal, at_most=0.0)
