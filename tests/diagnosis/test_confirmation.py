"""What speaks against calling an effect confirmed."""

from types import SimpleNamespace

import numpy as np
import pytest

from autotune.diagnosis import confirmation
from autotune.diagnosis.confirmation import doubt_of, with_effects
from autotune.estimation.policy import POLICY
from autotune.models.drive_model import base_model
from autotune.models.layout import INERTIA, flag
from autotune.models.table import EFFECTS
from tests.support.axes import NOMINAL

CANDIDATES = tuple(EFFECTS.values())


def test_one_recording_has_nothing_to_be_held_against(short, nominal) -> None:
    assert doubt_of([short], nominal, ["spring"], print, POLICY, CANDIDATES) is None


def test_effects_are_carried_and_the_base_is_not() -> None:
    spring = EFFECTS["spring"]
    model = base_model(NOMINAL | {"inertia": 2e-3}).with_effect(spring.make({"stiffness": 0.004})).pack()
    carried = with_effects(base_model(NOMINAL).pack(), model, ["spring"])
    assert carried.p[spring.slot("stiffness")] == 0.004
    assert carried.on[flag("spring")]
    assert carried.p[INERTIA] == pytest.approx(NOMINAL["inertia"])


def _of(experiment: str) -> SimpleNamespace:
    return SimpleNamespace(segments=lambda: [SimpleNamespace(experiment=experiment)])


TWO = [_of("slow"), _of("quick")]


def test_a_file_of_a_veto_alone_is_no_recording_to_be_held_against(short, nominal) -> None:
    """A programme that was imported segment by segment: it says nothing by itself, and is no reason to doubt."""
    assert doubt_of([short, _of("veto")], nominal, ["spring"], print, POLICY, CANDIDATES) is None


def _alone(monkeypatch, effects: tuple[str, ...], share: float) -> None:
    """The first recording by itself names these, and leaves this share of the torque."""
    model_fit = SimpleNamespace(effects=effects, fitted=SimpleNamespace(error=np.ones(3)))
    chosen = SimpleNamespace(model_fit=model_fit) if effects else None
    found = SimpleNamespace(chosen=chosen, problem=None)
    monkeypatch.setattr(confirmation, "prepared_for", lambda *_: None)
    monkeypatch.setattr(confirmation, "begin", lambda *_, **__: (None, None, None, ()))
    monkeypatch.setattr(confirmation, "replace", lambda problem, **_: problem)
    monkeypatch.setattr(confirmation, "search", lambda *_: found)
    monkeypatch.setattr(confirmation, "unexplained", lambda *_: share)
    monkeypatch.setattr(confirmation, "_elsewhere", lambda *_: None)


@pytest.mark.parametrize(
    ("effects", "share", "why"),
    [
        (("spring",), 0.1, None),
        (("stribeck",), 0.1, "no recording by itself shows spring"),
        ((), 0.1, "no recording by itself shows spring"),
        (("spring",), 0.4, "keeps 40 %"),
    ],
)
def test_confirmed_is_what_the_first_recording_names_by_itself(monkeypatch, effects, share, why) -> None:
    _alone(monkeypatch, effects, share)
    doubt = doubt_of(TWO, None, ["spring"], print, POLICY, CANDIDATES)
    assert (doubt is None) == (why is None)
    if why is not None:
        assert why in doubt.why


def test_what_another_recording_shows_by_itself_stays_suspected(monkeypatch) -> None:
    """Only what no recording shows by itself is no name: a base that is two, warmer in one of them, makes such."""
    _alone(monkeypatch, ("spring",), 0.1)
    spring = confirmation.search()
    found = iter((SimpleNamespace(chosen=None, problem=None), spring))
    monkeypatch.setattr(confirmation, "search", lambda *_: next(found))
    doubt = doubt_of(TWO, None, ["spring"], print, POLICY, CANDIDATES)
    assert doubt is not None
    assert not doubt.nowhere
    _alone(monkeypatch, ("stribeck",), 0.1)
    doubt = doubt_of(TWO, None, ["spring"], print, POLICY, CANDIDATES)
    assert doubt is not None
    assert doubt.nowhere


def test_one_name_of_two_that_no_recording_shows_is_none(monkeypatch) -> None:
    """Of three names that two files together bore, a lag was none of either file's."""
    _alone(monkeypatch, ("spring",), 0.1)
    doubt = doubt_of(TWO, None, ["spring", "torque_lag"], print, POLICY, CANDIDATES)
    assert doubt is not None
    assert doubt.nowhere
    assert "shows torque lag" in doubt.why
