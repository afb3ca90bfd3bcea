"""What recordings say of an effect that was found in another one."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis import confirmation, each_recording
from autotune.diagnosis.confirmation import Elsewhere, confirm_by, told_apart
from autotune.diagnosis.each_recording import (
    OwnBase,
    base_in_words,
    of_each,
    own_recordings,
)
from autotune.diagnosis.evidence.evidence import HoldoutResult
from autotune.diagnosis.refits import with_effects
from autotune.diagnosis.search_state import Found
from autotune.diagnosis.verdict import Diagnosis
from autotune.estimation.least_squares import Free
from autotune.estimation.policy import POLICY
from autotune.models.drive_model import Packed, base_model
from autotune.models.layout import BREAK_AWAY, COULOMB, INERTIA, flag
from autotune.models.reversal_memory import REVERSAL_MEMORY, contact
from autotune.models.table import EFFECTS
from tests.support.axes import NOMINAL


def test_effects_are_carried_and_the_base_is_not() -> None:
    spring = EFFECTS["spring"]
    model = base_model(NOMINAL | {"inertia": 2e-3}).with_effect(spring.make({"stiffness": 0.004})).pack()
    carried = with_effects(base_model(NOMINAL).pack(), model, ["spring"])
    assert carried.p[spring.slot("stiffness")] == 0.004
    assert carried.on[flag("spring")]
    assert carried.p[INERTIA] == pytest.approx(NOMINAL["inertia"])


def _of(*experiments: str) -> SimpleNamespace:
    return SimpleNamespace(segments=lambda: [SimpleNamespace(experiment=one) for one in experiments])


def _data(veto: bool = False, steady: bool = False) -> SimpleNamespace:
    return SimpleNamespace(steady=steady, role=lambda *_: np.full(3, veto))


def test_recordings_are_searched_one_by_one_with_what_is_never_fitted() -> None:
    slow, quick, unseen = _of("slow"), _of("quick"), _of("test")
    assert own_recordings([slow, unseen, quick], _data()) == [(1, [slow, unseen]), (3, [quick, unseen])]
    assert own_recordings([slow, unseen], _data()) == []
    assert own_recordings([slow, quick, _of("veto")], _data(veto=True)) == [], (
        "that veto tells of all of them"
    )
    assert own_recordings([_of("slow", "veto"), quick], _data(veto=True)) == []
    each = [_of("slow", "veto"), _of("quick", "veto")]
    assert own_recordings(each, _data(veto=True)) == [(1, each[:1]), (2, each[1:])]
    assert own_recordings([slow, quick], _data(steady=True)) == []


def _model_fit(*effects: str, error: float = 1.0) -> SimpleNamespace:
    return SimpleNamespace(effects=effects, fitted=SimpleNamespace(error=np.full(400, error), cost=error**2))


def _item(effect: str, error: float = 1.0, **known: object) -> SimpleNamespace:
    return SimpleNamespace(effect=effect, model_fit=_model_fit(effect, error=error), **known)


def _found(chosen: object, tried: tuple[object, ...] = ()) -> Found:
    problem = SimpleNamespace(policy=POLICY, data=None)
    return Found(problem, _model_fit(), chosen, (), tried, {})


def _leaves(*, plain: float, **errors: float) -> Elsewhere:
    """What a recording with a base of its own is left with by single effects."""
    by_effect = {(): plain} | {(effect,): left for effect, left in errors.items()}

    def error_of(model_fit: SimpleNamespace) -> np.ndarray:
        return by_effect[model_fit.effects] * np.ones(400)

    return Elsewhere(error_of, own_base=True)


@pytest.mark.parametrize(
    ("left", "shown", "kept", "lowers"),
    [
        (0.5, (), True, True),
        (0.99, (), True, False),
        (1.005, (), True, False),
        (1.3, (), False, False),
        (1.3, ("spring",), True, False),
    ],
)
def test_an_effect_falls_where_another_recording_plainly_errs_more_with_it(
    monkeypatch: pytest.MonkeyPatch, left: float, shown: tuple[str, ...], kept: bool, lowers: bool
) -> None:
    """Half a per cent more says that it is not seen there; and what is seen there with other values is not refuted."""
    monkeypatch.setattr(confirmation, "evidence_of", lambda _: None)
    monkeypatch.setattr(
        confirmation, "gain_and_z", lambda before, after: (1 - after.total / before.total, -5.0)
    )
    spring = _item("spring")
    chosen, carried = confirm_by(_found(spring), None, [_leaves(plain=1.0, spring=left)], shown)
    assert (chosen is spring) == kept
    assert carried[0].lowers == lowers
    assert carried[0].refuted != kept


@pytest.mark.parametrize(
    ("effects", "cut_short", "asked"),
    [(("stribeck", "spring"), True, 0), (("stribeck", "spring"), False, 2), (("spring",), True, 0)],
)
def test_where_time_was_up_no_further_round_is_searched(
    monkeypatch: pytest.MonkeyPatch, effects: tuple[str, ...], cut_short: bool, asked: int
) -> None:
    """Rivals were ranked and fitted in the place of each effect, whose name is suspected at best by then."""
    carried = [HoldoutResult(effect, 0.5, 9.0, lowers=True) for effect in effects]
    rivals: list[str] = []

    def compared(*told: object) -> HoldoutResult:
        rivals.append(told[3].effect)
        return told[3]

    monkeypatch.setattr(confirmation, "evidence_of", lambda _: None)
    monkeypatch.setattr(confirmation, "hold_out", lambda *_: carried)
    monkeypatch.setattr(confirmation, "compare_alternatives", compared)
    found = replace(_found(SimpleNamespace(model_fit=_model_fit(*effects))), cut_short=cut_short)
    chosen, told = confirm_by(found, None, [_leaves(plain=1.0)])
    assert chosen is found.chosen
    assert (told, len(rivals)) == (carried, asked)


@pytest.mark.parametrize(("anew", "lowers"), [({}, True), ({"gravity_imbalance": 0.5}, False)])
def test_one_of_several_is_asked_beside_the_others_with_values_of_their_own(
    monkeypatch: pytest.MonkeyPatch, anew: dict[str, float], lowers: bool
) -> None:
    """A spring and a wave of the other sign bend one course; a wave of its own value alone leaves as little there."""
    monkeypatch.setattr(confirmation, "evidence_of", lambda _: None)
    both = SimpleNamespace(effect="spring", model_fit=_model_fit("spring", "gravity_imbalance"))
    left = {(): 4.0, ("spring",): 3.0, ("gravity_imbalance",): 0.7, ("spring", "gravity_imbalance"): 0.5}

    def without(_: object, __: object, model_fit: SimpleNamespace, effect: str) -> SimpleNamespace:
        return SimpleNamespace(model_fit=_model_fit(*(one for one in model_fit.effects if one != effect)))

    def beside(model_fit: SimpleNamespace, settled: tuple[str, ...]) -> np.ndarray:
        known = left[model_fit.effects]
        return np.full(400, anew.get(settled[0], known) if len(model_fit.effects) == 1 else known)

    monkeypatch.setattr(confirmation, "without_effect", without)
    other = Elsewhere(lambda one: np.full(400, left[one.effects]), own_base=True, beside=beside)
    carried = confirmation.hold_out(_found(both).problem, _model_fit(), both, [other])
    assert {one.effect: one.lowers for one in carried} == {"spring": lowers, "gravity_imbalance": True}


def test_another_recording_tells_apart_what_one_cannot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(confirmation, "without_own_course", lambda *_: [])
    spring, imbalance = _item("spring"), _item("gravity_imbalance")
    found = _found(spring, (spring, imbalance))
    rivals = ("spring", "gravity_imbalance")
    better = told_apart(found, rivals, [_leaves(plain=1.0, spring=0.3, gravity_imbalance=0.6)])
    assert (better.chosen, better.told_apart) == (spring, ("gravity_imbalance",))
    other = told_apart(found, rivals, [_leaves(plain=1.0, spring=0.6, gravity_imbalance=0.3)])
    assert (other.chosen, other.told_apart) == (imbalance, ("spring",))
    alike = told_apart(found, rivals, [_leaves(plain=1.0, spring=0.31, gravity_imbalance=0.3)])
    assert (alike.chosen, alike.told_apart) == (spring, ())


def test_another_recording_tells_no_wave_over_a_part_of_its_turn_from_a_spring(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A buffer that is met on the way was a weight behind a gear of 1 : 15, confirmed; a straight line erred more."""
    spring, imbalance = _item("spring"), _item("gravity_imbalance")
    found = _found(imbalance, (spring, imbalance))
    monkeypatch.setattr(confirmation, "without_own_course", lambda _, one: [*one.effects])
    there = _leaves(plain=1.0, spring=0.6, gravity_imbalance=0.3)
    assert told_apart(found, ("spring", "gravity_imbalance"), [there]).told_apart == ()
    leads = told_apart(_found(spring, (spring, imbalance)), ("spring", "gravity_imbalance"), [there])
    assert (leads.chosen, leads.told_apart) == (imbalance, ())  # an arm's joint, headed by its spring


@pytest.mark.parametrize("spring_there", [0.999, 1.1])
def test_a_recording_on_which_no_effect_lowers_the_error_tells_none_apart(
    monkeypatch: pytest.MonkeyPatch, spring_there: float
) -> None:
    """Another joint moved: load dependence raised the error by 1 % there, saturation by more, and was gone."""
    monkeypatch.setattr(confirmation, "without_own_course", lambda *_: [])
    spring, imbalance = _item("spring"), _item("gravity_imbalance")
    found = _found(spring, (spring, imbalance))
    there = _leaves(plain=1.0, spring=spring_there, gravity_imbalance=1.6)
    assert told_apart(found, ("spring", "gravity_imbalance"), [there]) is found


@pytest.mark.parametrize(
    ("after", "share", "why"),
    [
        (0.5, 0.1, ""),
        (0.99, 0.1, "errs no less"),
        (0.5, 0.4, "keeps 40 %"),
        (None, 0.1, "cannot be simulated"),
    ],
)
def test_confirmed_is_what_lowers_the_error_with_only_the_base_refitted(
    monkeypatch: pytest.MonkeyPatch, after: float | None, share: float, why: str
) -> None:
    problem = SimpleNamespace(policy=POLICY, mean_square=lambda error, _: float(np.mean(error**2)))
    base = OwnBase(2, SimpleNamespace(problem=problem, root=_model_fit()))
    settled = None if after is None else _model_fit(error=after)
    monkeypatch.setattr(OwnBase, "fit_of", lambda *_: settled)
    monkeypatch.setattr(each_recording, "unexplained", lambda *_: share)
    said = base.doubt(_model_fit("spring"))
    assert why in said
    assert bool(said) == bool(why)


def test_a_break_away_torque_is_carried_in_proportion_to_the_friction_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Under another load friction is another one, and what must be overcome at first with it; the spring is not."""
    model = base_model(NOMINAL | {"coulomb": 0.2})
    for name, values in (
        ("stribeck", {"break_away": 0.3, "stribeck_velocity": 0.05}),
        ("spring", {"stiffness": 0.004}),
    ):
        model = model.with_effect(EFFECTS[name].make(values))
    effects = ("stribeck", "spring")
    one = SimpleNamespace(effects=effects, fitted=SimpleNamespace(packed=model.pack()))
    root = base_model(NOMINAL | {"coulomb": 0.35}).pack()
    asked = []

    def fitted(_: object, packed: Packed, *rest: object) -> SimpleNamespace:
        asked.append(packed.p[BREAK_AWAY])
        settled = Packed(packed.p.copy(), packed.on)
        settled.p[COULOMB] = 0.3  # with the effect, its part is not in the base's friction
        return SimpleNamespace(effects=effects, fitted=SimpleNamespace(packed=settled))

    monkeypatch.setattr(each_recording, "fit_inside_twin", fitted)
    own = SimpleNamespace(free=(), fitted=SimpleNamespace(packed=root))
    settled = OwnBase(2, SimpleNamespace(problem=None, root=own)).fit_of(one)
    assert asked == pytest.approx([0.525, 0.45])
    assert settled.fitted.packed.p[EFFECTS["spring"].slot("stiffness")] == 0.004


def _of_elements(level: float, rise: float | None) -> Packed:
    """A contact of that level, nine tenths of it in elements of its own; `rise`: of the level, at rest."""
    model = base_model(NOMINAL | {"coulomb": 0.1 * level, "stiffness": 0.1 * level / 3e-3})
    elements = {
        "displacement_1": 2e-3,
        "torque_1": 0.4 * level,
        "displacement_2": 4e-3,
        "torque_2": 0.5 * level,
    }
    model = model.with_effect(EFFECTS["reversal_memory"].make(elements | {"attraction": 1e6}))
    if rise is not None:
        values = {"break_away": (0.1 + rise) * level, "stribeck_velocity": 0.05}
        model = model.with_effect(EFFECTS["stribeck"].make(values))
    return model.pack()


@pytest.mark.parametrize("elements", ["here", "there"])
def test_a_break_away_torque_is_in_proportion_to_all_that_a_contact_carries(
    monkeypatch: pytest.MonkeyPatch, elements: str
) -> None:
    """Of elements the bristle is a tenth: by its friction alone half more at rest was a twentieth, or five times."""
    single = base_model(NOMINAL | {"coulomb": 0.2}).with_effect(
        EFFECTS["stribeck"].make({"break_away": 0.3, "stribeck_velocity": 0.05})
    )
    found = single.pack() if elements == "here" else _of_elements(0.2, 0.5)
    root = _of_elements(0.35, None) if elements == "here" else base_model(NOMINAL | {"coulomb": 0.35}).pack()
    carried: list[Packed] = []
    monkeypatch.setattr(each_recording, "fit_inside_twin", lambda _, packed, *rest: carried.append(packed))
    one = SimpleNamespace(effects=("stribeck",), fitted=SimpleNamespace(packed=found))
    own = SimpleNamespace(free=(), fitted=SimpleNamespace(packed=root))
    OwnBase(2, SimpleNamespace(problem=None, root=own)).fit_of(one)
    (packed,) = carried
    level, _ = contact(packed.p, packed.on)
    assert level == pytest.approx(0.35)
    assert packed.p[BREAK_AWAY] - packed.p[COULOMB] == pytest.approx(0.5 * level)


def test_a_name_that_no_recording_shows_first_by_itself_is_not_confirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(each_recording, "much_unexplained", lambda *_: "")
    both = [
        each_recording._Alone(number, _found(None), None, (), (), _verdict("ambiguous", "stribeck"))
        for number in (1, 2)
    ]
    doubt = each_recording._doubt(both[0], both[1:], [], _model_fit("dwell_time_break_away"))
    assert doubt == "no recording by itself shows dwell time break away first"
    assert not each_recording._doubt(both[0], both[1:], [], _model_fit("stribeck"))


def test_a_base_that_differs_beyond_its_errors_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(each_recording, "standard_errors", lambda *_: np.array([0.002, 1e-4]))
    slots = (("coulomb", COULOMB), ("inertia", INERTIA))
    free = [Free(name, slot, 0.0, 1.0, 0.1) for name, slot in slots]
    metadata = SimpleNamespace(motion_unit="rad", torque_unit="")
    problem = SimpleNamespace(policy=POLICY, training=None, data=SimpleNamespace(metadata=metadata))

    def fitted(number: int, coulomb: float) -> tuple[int, SimpleNamespace, SimpleNamespace]:
        packed = base_model(NOMINAL | {"coulomb": coulomb}).pack()
        return number, problem, SimpleNamespace(free=free, fitted=SimpleNamespace(packed=packed))

    said = base_in_words(fitted(1, 0.21), fitted(2, 0.17))
    assert (
        said
        == "Recordings 1 and 2 come to a different base: Coulomb friction 0.21 ± 0.002 and 0.17 ± 0.002 N m."
    )
    assert base_in_words(fitted(1, 0.21), fitted(2, 0.208)) == ""
    assert base_in_words(fitted(1, 0.21), fitted(2, 0.201)) == "", "three standard errors, and 4 %"


def test_a_contact_of_elements_is_compared_by_all_that_it_carries(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bristle of 0.2 N m, and one of 0.01 beside elements of 0.19, which are known by their sum only."""
    spread = np.array([[0.0102, -0.01], [-0.01, 0.0102]])
    monkeypatch.setattr(each_recording, "covariance", lambda fitted, _: fitted.spread)
    monkeypatch.setattr(each_recording, "standard_errors", lambda fitted, _: np.sqrt(np.diag(fitted.spread)))
    metadata = SimpleNamespace(motion_unit="rad", torque_unit="")
    problem = SimpleNamespace(policy=POLICY, training=None, data=SimpleNamespace(metadata=metadata))
    torque, reach = (REVERSAL_MEMORY.slot(name) for name in ("torque_1", "displacement_1"))
    bristle = Free("coulomb", COULOMB, 0.0, 1.0, 0.1)
    element = Free(REVERSAL_MEMORY.surface("torque_1"), torque, 0.0, 1.0, 0.1)

    def fitted(number: int, coulomb: float, carried: float) -> tuple[int, SimpleNamespace, SimpleNamespace]:
        packed = base_model(NOMINAL | {"coulomb": coulomb}).pack()
        packed.on[flag(REVERSAL_MEMORY.name)] = carried > 0.0
        packed.p[[torque, reach]] = carried, 0.5 * NOMINAL["coulomb"] / NOMINAL["stiffness"]
        own = (bristle, element) if carried else (bristle,)
        of_all = SimpleNamespace(packed=packed, spread=spread if carried else 4e-6 * np.eye(1))
        return number, problem, SimpleNamespace(free=own, fitted=of_all)

    assert base_in_words(fitted(1, 0.2, 0.0), fitted(2, 0.01, 0.19)) == ""
    assert "0.3 ± 0.002 and 0.2 ± 0.02 N m" in base_in_words(fitted(1, 0.3, 0.0), fitted(2, 0.01, 0.19))


def _verdict(word: str, *effects: str, confidence: str | None = None) -> Diagnosis:
    nothing = (), (), {}, 0.0, None, True
    return Diagnosis(word, effects, confidence, *nothing)


def _diagnosed(
    monkeypatch: pytest.MonkeyPatch, told: list[tuple[Diagnosis, Diagnosis]], until: float = math.inf
) -> Diagnosis | None:
    """The verdict on recordings with what each says `told` by itself, and after it was carried to the others."""
    by_number = dict(enumerate(told, 1))
    monkeypatch.setattr(each_recording, "confirm_in_time", lambda found, *_: (found, None, []))
    monkeypatch.setattr(each_recording, "prepared_to_fit", lambda part: part[0])
    monkeypatch.setattr(
        each_recording, "_told", lambda one, *_: replace(by_number[one.number][1], notes=(str(one.number),))
    )

    def searched(number: int) -> tuple[Found, None, tuple[str]]:
        if by_number[number][0].verdict == "refused":
            raise NotEnoughExcitation("it hardly moves")
        return _found(None), None, (str(number),)

    own = [(number, [number]) for number in by_number]
    return of_each(own, searched, lambda _, notes, *__: by_number[int(notes[0])][0], lambda _: None, until)


NOTHING, SEEN = _verdict("none"), _verdict("named", "spring", confidence="suspected")
SURE, LOST = _verdict("named", "spring", confidence="confirmed"), _verdict("unknown")
REFUSED = _verdict("refused")


def test_where_time_is_up_no_further_recording_is_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    found = _diagnosed(monkeypatch, [(SEEN, SEEN), (SEEN, SURE)], until=0.0)
    assert found is not None
    assert (found.confidence, found.complete) == ("suspected", False)
    assert found.notes == ("Recording 2 was not searched: there was no time left.", "1")


@pytest.mark.parametrize(
    ("told", "number", "expected"),
    [
        ([(NOTHING, NOTHING), (NOTHING, NOTHING)], "1", NOTHING),
        ([(NOTHING, NOTHING), (LOST, LOST)], "2", LOST),
        ([(NOTHING, NOTHING), (SEEN, SURE)], "2", SURE),
        ([(SEEN, SEEN), (SEEN, SURE)], "2", SURE),
        ([(SEEN, SEEN), (SEEN, SEEN)], "1", SEEN),
        ([(SEEN, LOST), (SEEN, SEEN)], "2", SEEN),
        ([(SEEN, LOST), (NOTHING, NOTHING)], "1", LOST),
        ([(REFUSED, REFUSED), (SEEN, SEEN)], "2", SEEN),
    ],
)
def test_two_recordings_say_at_least_what_the_better_one_says(
    monkeypatch: pytest.MonkeyPatch, told: list[tuple[Diagnosis, Diagnosis]], number: str, expected: Diagnosis
) -> None:
    found = _diagnosed(monkeypatch, told)
    assert found is not None
    assert (found.verdict, found.effects, found.confidence) == (
        expected.verdict,
        expected.effects,
        expected.confidence,
    )
    assert found.notes[-1] == number
    assert any("tells too little by itself" in note for note in found.notes) == (REFUSED in told[0])


@pytest.mark.parametrize(
    ("other", "first", "rivals"),
    [
        (_verdict("named", "stribeck", confidence="suspected"), SEEN, ("spring", "stribeck")),
        (_verdict("named", "stribeck", confidence="suspected"), SURE, ()),
        (_verdict("named", "spring", "stribeck", confidence="suspected"), SEEN, ()),
        (_verdict("ambiguous", "stribeck"), SEEN, ("spring", "stribeck")),
        (replace(_verdict("ambiguous", "stribeck"), confusable=(("stribeck", "spring"),)), SEEN, ()),
    ],
    ids=[
        "nothing in common",
        "confirmed",
        "a part in common",
        "one of several others",
        "one of several, itself among them",
    ],
)
def test_names_that_have_nothing_in_common_are_ambiguous_unless_one_is_confirmed(
    monkeypatch: pytest.MonkeyPatch, other: Diagnosis, first: Diagnosis, rivals: tuple[str, ...]
) -> None:
    """Falling friction in one recording, refuted by the other, and a motor that saturates in that one."""
    found = _diagnosed(monkeypatch, [(SEEN, first), (other, LOST)])
    assert found is not None
    assert found.effects == ("spring",)
    assert found.verdict == ("ambiguous" if rivals else "named")
    assert found.confusable == ((rivals,) if rivals else ())
    assert bool(found.next_experiment) == bool(rivals)


def test_recordings_that_tell_nothing_one_by_one_are_diagnosed_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert _diagnosed(monkeypatch, [(REFUSED, REFUSED), (REFUSED, REFUSED)]) is None


def test_one_name_that_no_other_recording_shows_costs_that_name_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Drift beside memory, seen in one of two recordings that both show memory: memory keeps its name."""
    monkeypatch.setattr(each_recording, "without", lambda *told: ("without", *told[-1]))
    judged = []
    found = _found(SimpleNamespace(model_fit=_model_fit("spring", "thermal_drift")))
    carried = [HoldoutResult("spring", 0.5, 5.0, lowers=True), HoldoutResult("thermal_drift", 0.01, 0.5)]

    def less(held: set[str]) -> Diagnosis | None:
        one = SimpleNamespace(number=1)
        return each_recording._without_unheld(
            one, found, (), carried, held, lambda *told: judged.append(told) or SURE
        )

    assert less({"spring"}) is SURE
    assert judged[0][0].chosen == ("without", "thermal_drift")
    assert judged[0][1] == ("Recording 1 alone shows thermal drift, which is not named.",)
    assert less({"spring", "thermal_drift"}) is None


@pytest.mark.parametrize(
    ("alone", "refuted", "expected"),
    [
        ("confirmed", False, ("spring", "thermal_drift")),
        ("confirmed", True, ("spring", "thermal_drift")),
        ("suspected", True, ("thermal_drift",)),
    ],
)
def test_what_a_recording_s_own_veto_confirms_is_doubted_by_another_and_not_undone(
    monkeypatch: pytest.MonkeyPatch, alone: str, refuted: bool, expected: tuple[str, ...]
) -> None:
    both, less = (
        SimpleNamespace(model_fit=_model_fit(*names))
        for names in (("spring", "thermal_drift"), ("thermal_drift",))
    )
    carried = [
        HoldoutResult("spring", -0.5, -9.0, refuted=refuted),
        HoldoutResult("thermal_drift", 0.5, 9.0, lowers=True),
    ]
    monkeypatch.setattr(each_recording, "confirm_by", lambda *_: (less if refuted else both, carried))
    monkeypatch.setattr(each_recording, "hold_out", lambda *_: carried)
    monkeypatch.setattr(each_recording, "_with_bases", lambda verdict, *_: verdict)

    def judge(found: Found, notes: tuple[str, ...], _: object) -> Diagnosis:
        model_fit = found.chosen.model_fit
        return replace(
            _verdict("named", *model_fit.effects, confidence=alone), notes=notes, model_fit=model_fit
        )

    found = _found(both)
    first = judge(found, (), ())
    one = each_recording._Alone(1, found, None, (), (), first)
    other = each_recording._Alone(2, _found(None), None, (), (), NOTHING)
    told = each_recording._told(one, [other], judge, lambda _: None)
    assert told.effects == expected
    assert told.confidence == ("suspected" if refuted else alone)
    doubted = "Suspected only: another recording refutes spring."
    assert (told.notes[0] == doubted) == (refuted and alone == "confirmed")
