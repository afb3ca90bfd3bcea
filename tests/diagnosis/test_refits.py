"""Fits with one effect more or less, around a first fit that may have ended in the wrong place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.diagnosis import (
    backward,
    candidates,
    facts,
    refits,
    rounds,
    search,
    search_state,
    settling,
)
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.candidates import FittedCandidate, explains_rest, no_progress
from autotune.diagnosis.refits import (
    a_row_otherwise,
    adds_beside,
    in_place_of,
    in_quieter_twin,
    looped_otherwise,
    root_from,
)
from autotune.diagnosis.rounds import (
    _both_by_their_courses,
    _fit_down,
    _worth_at_its_best,
    _worth_by_its_course,
)
from autotune.diagnosis.search_state import SearchState
from autotune.diagnosis.settling import _a_row_beside, _first_exchanged
from autotune.estimation import model_error
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.bias_corrected_fit import fit_inside_twin
from autotune.estimation.controller_law import PositionController
from autotune.estimation.cross_validation import Explained, Unseen
from autotune.estimation.disturbance import Disturbance
from autotune.estimation.least_squares import followed
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import refit
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS
from tests.support.fitted import Item

DRIFT = EFFECTS["thermal_drift"]


@dataclass(frozen=True)
class _Shaken:
    """A problem of which only the twin's disturbance counts."""

    disturbance: Disturbance
    loads: bool = True
    twin: bool = True
    policy: object = POLICY
    by_counts: object = None
    misfit: object = None

    def two_masses(self, _: object) -> bool:
        return self.loads


@dataclass(frozen=True)
class _Controlled:
    """A problem of which only the law of its loop counts."""

    controller: PositionController
    data: object


def item(*effects: str, left: float = 1.0, **others: float) -> Item:
    return Item(effects[-1], SimpleNamespace(effects=effects, left=left), **others)


@pytest.mark.slow
def test_a_first_fit_that_ended_in_the_wrong_place_is_made_again_from_where_a_candidate_led_it(
    short, nominal
) -> None:
    """An effect that is not there takes nothing with it; what its fit gained is the model's as it is."""
    problem, root, _, _ = begin(prepared_to_fit([short]), nominal)
    off = root.fitted.packed.p.copy()
    off[layout.VISCOUS] *= 2.0
    held = [one for one in root.free if one.slot != layout.VISCOUS]
    astray = refit(problem, Packed(off, root.fitted.packed.on), held, root.correction, 4)
    wrong = replace(root, fitted=replace(astray, free=root.fitted.free))
    p, on = root.fitted.packed.p.copy(), root.fitted.packed.on.copy()
    on[layout.flag(DRIFT.name)] = True
    drifting = fit_inside_twin(problem, Packed(p, on), list(root.free), 1, (DRIFT.name,))
    assert drifting is not None
    assert wrong.fitted.cost > 1.2 * root.fitted.cost
    found = root_from(problem, wrong, drifting)
    assert found is not None
    assert found.effects == ()
    assert not found.fitted.packed.on[layout.flag(DRIFT.name)]
    assert found.fitted.cost == pytest.approx(root.fitted.cost, rel=0.05)
    assert root_from(problem, root, drifting) is None


@pytest.mark.parametrize(
    ("promised", "begun_anew", "expected"),
    [(0.2, 0.3, 0.3), (0.2, 1.1, 0.9), (0.2, None, 0.9), (0.85, 0.3, 0.9)],
)
def test_a_fit_that_comes_short_of_what_was_promised_begins_in_the_contact_that_was_known(
    monkeypatch: pytest.MonkeyPatch, promised: float, begun_anew: float | None, expected: float
) -> None:
    """Beside the bias of a model that lacks an asymmetry damping went to a tenth, and no twin came back from there.

    `begun_anew`: what it leaves from there; None where that twin is unstable.
    """
    known, led = np.zeros((2, layout.PARAMETERS))
    known[layout.MICRO_DAMPING], led[[layout.MICRO_DAMPING, layout.INERTIA]] = 0.5, (0.04, 3.0)
    slots = {"inertia": layout.INERTIA, "micro_damping": layout.MICRO_DAMPING}
    free = tuple(SimpleNamespace(name=name, slot=slot) for name, slot in slots.items())

    def fit(cost: float) -> SimpleNamespace:
        return SimpleNamespace(fitted=SimpleNamespace(cost=cost), effects=("direction_asymmetry",))

    def fitted(_: object, packed: Packed, *__: object) -> SimpleNamespace | None:
        assert packed.p[layout.MICRO_DAMPING] == known[layout.MICRO_DAMPING]
        assert packed.p[layout.INERTIA] == led[layout.INERTIA]
        return None if begun_anew is None else fit(begun_anew)

    monkeypatch.setattr(refits, "fit_inside_twin", fitted)
    before = SimpleNamespace(fitted=SimpleNamespace(packed=Packed(known, None)))
    screened = SimpleNamespace(packed=Packed(led, None), free=free, cost=promised)
    problem = SimpleNamespace(twin=True, policy=POLICY)
    assert refits._as_promised(problem, before, screened, fit(0.9)).fitted.cost == expected


@pytest.mark.parametrize("common", [0.0, 3.0])
def test_what_a_rival_adds_beside_the_true_effect_is_next_to_nothing_whatever_both_leave(
    monkeypatch: pytest.MonkeyPatch, common: float
) -> None:
    """The true one adds all that the rival lacks. `common`: rms of what neither explains."""
    random = np.random.default_rng(2)
    true, other, rest, noise = random.standard_normal((4, 2000))
    missing, weight = 2.0 * true + common * rest + 0.1 * noise, np.ones(2000)

    def fit(effect: str, column: np.ndarray) -> SimpleNamespace:
        table = np.column_stack([np.ones(2000), column])
        free = [SimpleNamespace(slot=-1), SimpleNamespace(slot=EFFECTS[effect].parameters[0].slot)]
        fitted = SimpleNamespace(jacobian=table, error=followed(table, missing, weight), free=free)
        return SimpleNamespace(effects=(effect,), fitted=fitted, correction=SimpleNamespace(bias=0.0))

    monkeypatch.setattr(refits, "taken_out", lambda *_: None)
    problem = SimpleNamespace(training=weight, raw=lambda _: missing)
    right, wrong = fit("spring", true), fit("torque_lag", 0.9 * true + 0.4 * other)
    assert adds_beside(problem, None, right, wrong) < 0.03
    assert adds_beside(problem, None, wrong, right) > 1.0


@pytest.mark.parametrize(
    ("sooner", "together", "moves"), [(0.7, 0.7, True), (0.9, 0.9, False), (0.7, 0.9, False)]
)
def test_two_masses_may_tell_that_their_loop_is_a_row_sooner(
    monkeypatch: pytest.MonkeyPatch, sooner: float, together: float, moves: bool
) -> None:
    """A spring of 173 Hz hunted in a loop a row too late, which one mass could not tell from the right one.

    `together`: what it leaves once all is fitted again there; all stays as it was where that is not clearly less.
    """

    def fit(cost: float) -> SimpleNamespace:
        return SimpleNamespace(fitted=SimpleNamespace(cost=cost, packed=None), free=(), effects=("backlash",))

    def candidate(cost: float) -> FittedCandidate:
        return FittedCandidate("backlash", fit(cost), 0.0, Explained(1.0, 0.1), None, named=False)

    def moved(state: SearchState, problem: object, _: object) -> FittedCandidate:
        state.problem = problem
        return candidate(together)

    before = _Shaken(Disturbance(1.0, 0.0, 0.0, 0.0, 0.0))
    again = replace(before, policy=replace(POLICY))
    monkeypatch.setattr(settling, "a_row_otherwise", lambda _: [again])
    monkeypatch.setattr(settling, "fit_inside_twin", lambda *_: fit(sooner))
    monkeypatch.setattr(SearchState, "moved", moved)
    state, begun = SearchState(before, None, None, no_progress, None), candidate(1.0)
    assert (_a_row_beside(state, begun) is not begun) == moves
    assert state.problem is (again if moves else before)
    assert _a_row_beside(replace(state, problem=replace(before, loads=False)), begun) is begun


@pytest.mark.parametrize(("right", "expected"), [(0.5, 0.5), (0.9, 1.0)])
def test_twins_with_two_masses_are_shaken_less_as_long_as_they_leave_clearly_less(
    monkeypatch: pytest.MonkeyPatch, right: float, expected: float
) -> None:
    """`right`: the level at which they leave least; one that is hardly less loud is not another one."""

    def fitted(problem: _Shaken, *_: object) -> SimpleNamespace:
        cost = 1.0 + 10.0 * (problem.disturbance.white - right) ** 2
        packed = SimpleNamespace(packed=None, cost=cost)
        return SimpleNamespace(fitted=packed, free=(), effects=("backlash",))

    monkeypatch.setattr(refits, "fit_inside_twin", fitted)
    monkeypatch.setattr(refits, "with_expected_noise", lambda problem, _: problem)
    monkeypatch.setattr(
        refits, "judged_again", lambda _, __, one, fit: SimpleNamespace(model_fit=fit, effect=one.effect)
    )
    loud = _Shaken(Disturbance(1.0, 0.0, 0.0, 0.0, 0.0))
    begun = SimpleNamespace(model_fit=fitted(loud), effect="backlash")
    problem, found = in_quieter_twin(loud, None, begun)
    assert problem.disturbance.white == expected
    assert found.model_fit.fitted.cost == fitted(problem).fitted.cost
    assert in_quieter_twin(replace(loud, loads=False), None, begun)[1] is begun


@pytest.mark.parametrize(("loads", "of"), [(False, "chosen"), (True, "root")])
@pytest.mark.parametrize("known", [True, False])
def test_what_counts_make_is_that_of_a_twin_as_loud_as_it_is(
    monkeypatch: pytest.MonkeyPatch, loads: bool, of: str, known: bool
) -> None:
    """Behind a coarse encoder a twin that is shaken a third as much shared a twentieth of what was excused."""

    def counted(problem: _Shaken, packed: object) -> _Shaken:
        return replace(problem, by_counts=(problem.disturbance.white, packed))

    monkeypatch.setattr(refits, "fit_inside_twin", lambda *_: _costs("chosen", 0.5))
    monkeypatch.setattr(refits, "with_expected_noise", lambda problem, _: problem)
    monkeypatch.setattr(refits, "with_counts", counted)
    monkeypatch.setattr(refits, "judged_again", lambda problem, *_: SimpleNamespace(counts=problem.by_counts))
    loud = _Shaken(Disturbance(1.0, 0.0, 0.0, 0.0, 0.0), loads, by_counts=("before",) if known else None)
    quiet = loud.disturbance.louder(0.5)
    monkeypatch.setattr(refits, "estimate_disturbance", lambda *_: quiet)
    begun, root = SimpleNamespace(model_fit=_costs("chosen", 1.0), effect="spring"), _costs("root", 2.0)
    problem, found = refits.with_own_noise(loud, root, begun)
    assert problem.disturbance == quiet
    assert problem.by_counts == found.counts == ((0.5, of) if known else None)
    if loads:
        monkeypatch.setattr(refits, "PARTS_ALONE", (0.7,))
        problem, found = in_quieter_twin(loud, root, begun)
        assert problem.by_counts == found.counts == ((0.7, of) if known else None)


def _costs(packed: str, cost: float) -> SimpleNamespace:
    return SimpleNamespace(fitted=SimpleNamespace(packed=packed, cost=cost), free=(), effects=("spring",))


@pytest.mark.parametrize("known", [True, False])
def test_a_root_that_is_shaken_anew_has_what_its_law_leaves_as_it_is_now(
    monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    """The law had been moved, and the rest of the one before it excused what comes again."""
    monkeypatch.setattr(model_error, "with_misfit", lambda one: replace(one, misfit="of the law as it is"))
    monkeypatch.setattr(refits, "fit_inside_twin", lambda *_: _costs("root", 1.0))
    monkeypatch.setattr(refits, "with_expected_noise", lambda problem, _: problem)
    monkeypatch.setattr(refits, "estimate_disturbance", lambda one, _: one.disturbance)
    before = _Shaken(Disturbance(1.0, 0.0, 0.0, 0.0, 0.0), misfit="of the law before" if known else None)
    found, _ = refits.with_noise_of(before, _costs("root", 1.0))
    assert found.misfit == ("of the law as it is" if known else None)


def test_a_rival_in_the_place_of_an_effect_brings_its_own_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """The others, and what is free of them, stay as they are beside it; of what is taken out nothing is left."""
    weight, spring, dwell = (
        EFFECTS[name] for name in ("gravity_imbalance", "spring", "dwell_time_break_away")
    )

    def model_fit(**sizes: float) -> SimpleNamespace:
        p, on = np.zeros(layout.PARAMETERS), np.zeros(len(layout.EFFECT_NAMES), dtype=np.bool_)
        free = [SimpleNamespace(name="inertia", slot=layout.INERTIA)]
        for name, size in sizes.items():
            slot = EFFECTS[name].parameters[0].slot
            p[slot], on[layout.flag(name)] = size, True
            free.append(SimpleNamespace(name=name, slot=slot))
        return SimpleNamespace(
            effects=tuple(sizes), free=tuple(free), fitted=SimpleNamespace(packed=Packed(p, on))
        )

    asked = []
    monkeypatch.setattr(refits, "fit_inside_twin", lambda *told: asked.append(told))
    chosen = SimpleNamespace(model_fit=model_fit(gravity_imbalance=1.0, dwell_time_break_away=2.0))
    rival = SimpleNamespace(model_fit=model_fit(spring=3.0), effect=spring.name)
    assert in_place_of(None, model_fit(), chosen, weight.name, rival) is None
    _, packed, free, _, effects = asked[0]
    assert effects == (spring.name, dwell.name)
    assert [one.name for one in free] == ["inertia", dwell.name, spring.name]
    values = [packed.p[kind.parameters[0].slot] for kind in (weight, spring, dwell)]
    assert values == [0.0, 3.0, 2.0]
    assert [bool(packed.on[layout.flag(kind.name)]) for kind in (weight, spring, dwell)] == [
        False,
        True,
        True,
    ]


def _search(chosen: object, tried: tuple[object, ...] = ()) -> SearchState:
    problem, evidence = SimpleNamespace(policy=POLICY), SimpleNamespace(repeats=True)
    return SearchState(problem, SimpleNamespace(), None, no_progress, evidence, chosen=chosen, tried=tried)


@pytest.mark.parametrize(
    ("named", "known", "training", "veto", "explains"),
    [
        (False, 0.95, 0.6, 0.4, True),
        (False, 0.95, 0.4, 0.95, False),
        (True, 0.95, 0.54, 0.39, False),
        (True, 0.95, 0.95, 0.8, False),
        (True, 0.95, 0.95, 0.92, True),
        (True, 0.996, 0.99, 0.69, True),
        (True, 0.996, 0.99, 0.4, False),
        (True, 0.996, 0.8, 0.95, False),
    ],
    ids=[
        "needed for a name",
        "too little",
        "a law that differs",
        "not on the veto",
        "nearly all of the rest",
        "half of the veto's crumbs",
        "less than half of them",
        "a law that differs, beside crumbs",
    ],
)
def test_beside_effects_that_have_a_name_a_further_one_explains_nearly_all_that_they_leave(
    monkeypatch: pytest.MonkeyPatch, named: bool, known: float, training: float, veto: float, explains: bool
) -> None:
    """An asymmetry took half of what a drift and a load dependence by other laws leave, and was a third name.

    Beside a ripple that left 0.004 of the veto a true gap explained 0.69 of that, and 0.99 of the training's rest.
    """
    parts = [SimpleNamespace(share=one) for one in (training, veto)]
    monkeypatch.setattr(candidates, "explained_of_rest", lambda *_: parts)
    on_veto = SimpleNamespace(share=known)
    chosen, more = SimpleNamespace(model_fit=None, named=named, veto=on_veto), SimpleNamespace(model_fit=None)
    twice = SimpleNamespace(policy=POLICY, has_veto=True, veto_repeats=True)
    assert explains_rest(twice, chosen, more) is explains
    once = SimpleNamespace(policy=POLICY, has_veto=True, veto_repeats=False)
    assert explains_rest(once, chosen, more) is (explains and not named), "of crumbs a bound says nothing"


@pytest.mark.parametrize(
    ("repeats", "effect", "fall", "led_on"),
    [
        (True, "backlash", 0.2, True),
        (True, "backlash", 0.05, False),
        (True, "spring", 0.2, False),
        (False, "backlash", 0.2, False),
    ],
    ids=["a gap", "hardly anything", "one mass", "without repeats"],
)
def test_a_further_transmission_is_led_on_before_it_is_refused(
    monkeypatch: pytest.MonkeyPatch, repeats: bool, effect: str, fall: float, led_on: bool
) -> None:
    """A gap that is damped beside its spring stopped at 33 % of the rest, damped by its impact it explains 83 %."""
    led = SimpleNamespace(effect=effect, model_fit=None)
    monkeypatch.setattr(rounds, "other_contact_tried", lambda *_: led)
    monkeypatch.setattr(rounds, "explained_of_rest", lambda *_: [SimpleNamespace(share=0.8)])
    monkeypatch.setattr(rounds, "_worth_by_its_course", lambda *_: None)
    monkeypatch.setattr(rounds, "counted_beside", lambda *given: given[-1])
    monkeypatch.setattr(SearchState, "worth_having", lambda _, one: one is led)
    before = SimpleNamespace(fitted=SimpleNamespace(cost=1.0))
    search = _search(SimpleNamespace(model_fit=before, named=False))
    search.evidence.repeats = repeats
    search.problem.twin = True
    best = SimpleNamespace(effect=effect, model_fit=SimpleNamespace(fitted=SimpleNamespace(cost=1.0 - fall)))
    assert _worth_at_its_best(search, best) is (led if led_on else None)


@pytest.mark.parametrize(
    ("fall", "share", "of_rest", "taken"),
    [
        (1.0, 0.48, (0.99, 0.95), True),
        (1.0, 0.48, (0.99, 0.8), False),
        (1.0, 0.6, (0.99, 0.95), False),
        (0.01, 0.48, (0.99, 0.95), False),
    ],
    ids=["a tilted encoder", "not on the veto", "no matter of its law", "too little"],
)
def test_a_further_effect_may_be_worth_having_by_its_course(
    monkeypatch: pytest.MonkeyPatch, fall: float, share: float, of_rest: tuple[float, ...], taken: bool
) -> None:
    """Its second wave makes more torque than its first: 48 % of what a weight leaves by the one, 99 % by both."""
    shaped = SimpleNamespace(named=True, model_fit=None)
    monkeypatch.setattr(rounds, "explained_beside", lambda *_: SimpleNamespace(fall=fall, share=share))
    monkeypatch.setattr(rounds, "least_fall", lambda *_: 0.1)
    monkeypatch.setattr(rounds, "explains_rest", lambda *_: share >= POLICY.partly)
    parts = [SimpleNamespace(share=one) for one in of_rest]
    monkeypatch.setattr(rounds, "explained_of_rest", lambda *_: parts)
    monkeypatch.setattr(SearchState, "shaped", lambda *_: shaped)
    monkeypatch.setattr(SearchState, "worth_having", lambda *_: True)
    monkeypatch.setattr(rounds, "counted_beside", lambda *given: given[-1])
    chosen = SimpleNamespace(model_fit=None)
    best = SimpleNamespace(model_fit=None)
    assert _worth_by_its_course(_search(chosen), best) is (shaped if taken else None)
    assert _worth_by_its_course(_search(None), best) is None


@pytest.mark.parametrize(("left", "gain"), [(0.8, 0.3), (0.5, 0.5)], ids=["less than before", "more"])
def test_a_further_effect_that_was_led_on_gains_from_what_is_chosen(
    monkeypatch: pytest.MonkeyPatch, left: float, gain: float
) -> None:
    """Refined, it was worth having by what the effects before it gain from the root.

    `left`: of what the chosen one leaves; 0.3 was its gain as its fit stopped.
    """

    def leaves(error: float) -> SimpleNamespace:
        on = np.zeros(16, dtype=np.bool_)
        fitted = SimpleNamespace(packed=SimpleNamespace(on=on))
        return SimpleNamespace(fitted=fitted, unseen=Unseen(np.full(10, error)))

    state = _search(Item("stribeck", leaves(1.0)))
    state.root = leaves(100.0)
    best, led = Item("spring", leaves(0.9), gain=0.3), Item("spring", leaves(left), gain=0.995)
    assert rounds.counted_beside(state.problem, state.model_fit, best, led).gain == pytest.approx(gain)
    monkeypatch.setattr(refits, "refined", lambda *_: replace(led, share=0.97))
    fits = [replace(best, share=0.9)]
    found = refits.best_refined(None, state.root, leaves(1.0), fits, fits[0], no_progress)
    assert found[0].gain == pytest.approx(gain)


@dataclass(frozen=True)
class _Fitted:
    """A fit of which only its effects and its share count."""

    effect: str
    share: float
    named: bool = False
    gain: float = 0.3
    effects: tuple[str, ...] = ()
    freed: Mapping[str, bool] = field(default_factory=dict)

    @property
    def model_fit(self) -> object:
        return SimpleNamespace(effects=self.effects or (self.effect,))


@pytest.mark.parametrize(
    ("named", "effects", "freed", "course", "worth", "taken"),
    [
        (False, (), {}, 0.9, True, True),
        (False, (), {}, 0.9, False, False),
        (False, (), {}, None, True, False),
        (True, (), {}, 0.9, True, False),
        (False, ("spring", "stribeck"), {}, 0.9, True, False),
        (False, (), {"spring": False}, 0.9, True, False),
    ],
    ids=[
        "two laws that differ",
        "not worth having",
        "no course",
        "a first with a name",
        "two before",
        "freed already",
    ],
)
def test_two_effects_by_other_laws_have_their_courses_together(
    monkeypatch: pytest.MonkeyPatch,
    named: bool,
    effects: tuple[str, ...],
    freed: dict[str, bool],
    course: float | None,
    worth: bool,
    taken: bool,
) -> None:
    """A tight spot of each turn beside viscosity by a root: 48 and 66 % by their own laws, 90 % with the spot's course.

    Alone neither course explained clearly more, and the verdict was "none of the known effects explains".
    """
    first = _Fitted("spring", 0.48, named, effects=effects, freed=freed)
    second = _Fitted("nonlinear_viscous", 0.66, effects=("spring", "nonlinear_viscous"))
    asked: list[str] = []

    def shape(_: object, __: object, ___: object, item: _Fitted) -> _Fitted | None:
        asked.append(item.effect)
        return replace(item, share=course) if course is not None and item.effect == "spring" else None

    for module in (rounds, search_state):
        monkeypatch.setattr(module, "with_free_shape", shape)
    monkeypatch.setattr(SearchState, "worth_having", lambda *_: worth)
    monkeypatch.setattr(rounds, "counted_beside", lambda *given: given[-1])
    state = _search(first)
    found = _both_by_their_courses(state, second)
    assert (found is not None) is taken
    if found is not None:
        assert (found.effect, found.share) == ("nonlinear_viscous", 0.9)
        assert asked == ["spring", "nonlinear_viscous"], "the second's own course is asked beside the first's"
        assert found.freed == {"spring": False}, "its own law had not named it"


@pytest.mark.parametrize(
    ("climbs", "beyond", "named", "effects", "anew"),
    [
        ("root", True, True, ("reversal_memory", "torque_ripple"), True),
        ("beside a ripple", True, True, ("reversal_memory", "torque_ripple"), True),
        ("neither", True, True, ("reversal_memory", "torque_ripple"), False),
        ("root", True, True, ("torque_ripple", "backlash"), False),
        ("root", True, False, ("reversal_memory", "torque_ripple"), False),
        ("root", False, True, ("reversal_memory", "torque_ripple"), False),
    ],
    ids=["a memory", "a contact only beside it", "no contact", "no memory", "not enough", "nothing beyond"],
)
def test_elements_that_go_on_beside_what_hid_them_are_a_memory_and_no_climb(
    monkeypatch: pytest.MonkeyPatch,
    climbs: str,
    beyond: bool,
    named: bool,
    effects: tuple[str, ...],
    anew: bool,
) -> None:
    """A ripple hid the longest elements of an axis, and the short ones were a law of its base: it was unknown."""
    fitted = SimpleNamespace(packed="beside a ripple")
    rippled = SimpleNamespace(model_fit=SimpleNamespace(fitted=fitted), named=False)
    remembered = SimpleNamespace(model_fit=SimpleNamespace(effects=effects), named=named)
    searched = _search(rippled)
    searched.root.fitted = SimpleNamespace(packed="root")
    before, bare = searched.root, SimpleNamespace()
    climb = replace(search.CLIMB_LAW, removed=lambda *_: bare)
    monkeypatch.setattr(search, "CLIMB_LAW", climb)
    monkeypatch.setattr(search, "climbs_otherwise", lambda packed: packed == climbs)
    monkeypatch.setattr(search, "is_a_memory", lambda *_: beyond)
    monkeypatch.setattr(SearchState, "take_root", lambda self, root: setattr(self, "root", root))
    monkeypatch.setattr(search, "_seek", lambda state: setattr(state, "chosen", remembered))
    search._seek_memory_in_the_climb(searched)
    assert searched.chosen is (remembered if anew else rippled)
    assert searched.root is (bare if anew else before)


@pytest.mark.parametrize(
    ("gain", "share", "left", "first"),
    [
        (0.77, 0.91, 0.4, "spring"),
        (0.77, 0.91, 1.1, "gravity_imbalance"),
        (0.3, 0.91, 0.4, "gravity_imbalance"),
        (0.77, 0.4, 0.4, "gravity_imbalance"),
    ],
    ids=["a buffer on the way", "errs more", "never came near", "explained less than half"],
)
def test_rivals_of_the_first_effect_are_asked_again_beside_the_second(
    monkeypatch: pytest.MonkeyPatch, gain: float, share: float, left: float, first: str
) -> None:
    """A weight led while contacts that age were missing; beside them a buffer left four tenths of what it did."""

    monkeypatch.setattr(settling, "error_left", lambda _, fit: fit.left)
    monkeypatch.setattr(
        settling, "in_place_of", lambda *_: item("spring", "dwell_time_break_away", left=left)
    )
    monkeypatch.setattr(SearchState, "shaped", lambda *_: None)
    chosen = item("gravity_imbalance", "dwell_time_break_away")
    tried = (item("gravity_imbalance"), item("spring", gain=gain, share=share))
    found = _first_exchanged(_search(tried[0], tried), chosen)
    assert found.model_fit.effects == (first, "dwell_time_break_away")
    assert found.effect == "dwell_time_break_away"


@pytest.mark.parametrize(
    ("told_apart", "left", "named", "first"),
    [
        (True, 0.9, True, "stribeck"),
        (True, 1.1, True, "dwell_time_break_away"),
        (True, 0.9, False, "dwell_time_break_away"),
        (False, 0.9, True, "dwell_time_break_away"),
    ],
    ids=["another course", "errs more", "no name", "a rival by its own law"],
)
def test_what_may_stand_for_one_of_several_has_a_course_as_free_as_theirs(
    monkeypatch: pytest.MonkeyPatch, told_apart: bool, left: float, named: bool, first: str
) -> None:
    """Contacts that age left 1 % less than Stribeck friction of another course did by the law of the library."""

    def beside(effect: str, left: float, **others: bool) -> Item:
        return item("nonlinear_viscous", effect, left=left, **others)

    state = _search(beside("dwell_time_break_away", 1.0))
    state.evidence = SimpleNamespace(explains_rest_of=lambda *_: told_apart)
    rival = beside("stribeck", 1.01)
    monkeypatch.setattr(backward, "error_left", lambda _, fit: fit.left)
    monkeypatch.setattr(backward, "backward_of", lambda _: SimpleNamespace(exchanged=lambda *_: [rival]))
    monkeypatch.setattr(SearchState, "shaped", lambda *_: beside("stribeck", left, named=named))
    again = backward.in_place(state)
    assert state.chosen.effect == first
    assert [one.effect for one in again] == list({"stribeck", "dwell_time_break_away"} - {first})


@pytest.mark.parametrize(
    ("shaken", "controlled", "late", "stands"),
    [
        (0.6, 1.0, 1.0, True),
        (0.9, 1.0, 0.8, False),
        (1.0, 0.55, 1.0, True),
        (None, 1.0, 1.0, False),
        (0.9, 1.0, 0.5, True),
    ],
)
def test_a_second_mass_must_do_more_than_twins_that_are_shaken_or_controlled_otherwise(
    monkeypatch: pytest.MonkeyPatch, shaken: float | None, controlled: float, late: float, stands: bool
) -> None:
    """Nothing was missing of an axis that rests next to break-away, but a tenth of its disturbance was not there: it
    was named an elastic transmission. Costs of a rigid axis; 1.0 as it is, 0.4 with a second mass.
    """

    def fit(cost: float) -> SimpleNamespace:
        return SimpleNamespace(fitted=SimpleNamespace(cost=cost, packed=None, free=()), effects=())

    loud = _Shaken(Disturbance(1.0, 0.0, 0.0, 0.0, 0.0))
    quiet = replace(loud, disturbance=loud.disturbance.louder(0.8))
    other = replace(loud, disturbance=loud.disturbance.louder(1.1))
    costs = {quiet: shaken, other: controlled}
    monkeypatch.setattr(refits, "_shaken_best", lambda *_: quiet)
    monkeypatch.setattr(refits, "told_beside", lambda *_: other if controlled < 1.0 else loud)
    monkeypatch.setattr(refits, "a_row_otherwise", lambda *_: [])
    monkeypatch.setattr(
        refits, "fit_inside_twin", lambda one, *_: None if costs[one] is None else fit(costs[one])
    )
    anew = (loud, fit(late))
    found = looped_otherwise(loud, fit(1.0), fit(0.4), anew)
    assert (found is not None) == stands
    if found is not None:
        assert found[1].fitted.cost == min(shaken, controlled, late)
    assert looped_otherwise(replace(loud, loads=False), fit(1.0), fit(0.4), anew) is None


@pytest.mark.parametrize(
    ("exact", "ticks", "delays", "asked"),
    [
        (False, 1, (2, 2), [(0, 0), (4, 4)]),
        (False, 1, (2, 0), [(4, 2)]),
        (True, 1, (2, 2), []),
        (False, 10, (2, 2), []),
    ],
    ids=["a row late", "no sooner", "its law tells the row", "between the samples"],
)
def test_a_loop_may_be_a_row_sooner_or_later_than_its_torque_was_recorded(
    exact: bool, ticks: int, delays: tuple[int, int], asked: list[tuple[int, int]]
) -> None:
    """A torque that was logged a row late, and a lag that made up for most of it, passed for a second mass."""
    law = PositionController(1.0, 0.1, reference_delay=delays[0], position_delay=delays[1])
    problem = _Controlled(replace(law, exact=exact, ticks=ticks), SimpleNamespace(upsampling=2))
    found = [one.controller for one in a_row_otherwise(problem)]
    assert [(one.reference_delay, one.position_delay) for one in found] == asked


def test_a_loop_a_row_sooner_stands_for_a_second_mass(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it does half of what the mass does, it is taken in its place; not where it does less."""

    def fit(cost: float) -> SimpleNamespace:
        return SimpleNamespace(fitted=SimpleNamespace(cost=cost, packed=None, free=()), effects=())

    loud = _Shaken(Disturbance(1.0, 0.0, 0.0, 0.0, 0.0))
    sooner = replace(loud, policy=replace(POLICY))
    monkeypatch.setattr(refits, "_shaken_best", lambda *_: loud)
    monkeypatch.setattr(refits, "told_beside", lambda *_: loud)
    monkeypatch.setattr(refits, "a_row_otherwise", lambda *_: [sooner])
    for cost, stands in ((0.5, True), (0.8, False)):
        monkeypatch.setattr(refits, "fit_inside_twin", lambda *_, cost=cost: fit(cost))
        found = looped_otherwise(loud, fit(1.0), fit(0.4), None)
        assert (found is not None and found[0] is sooner) == stands


@pytest.mark.parametrize(
    ("alike", "named", "left", "effect"),
    [
        (True, True, 0.4, "torque_saturation"),
        (True, True, 1.1, "load_dependent_friction"),
        (True, False, 0.4, "load_dependent_friction"),
        (False, True, 0.4, "load_dependent_friction"),
    ],
    ids=["leaves less", "errs more", "no name", "brakes with the load's help"],
)
@pytest.mark.parametrize("others", [(), ("spring",)], ids=["alone", "beside a spring"])
def test_a_motor_that_does_as_well_is_followed_in_the_place_of_what_a_load_presses(
    monkeypatch: pytest.MonkeyPatch,
    others: tuple[str, ...],
    alike: bool,
    named: bool,
    left: float,
    effect: str,
) -> None:
    """A knee that the fastest experiment shows alone gained nothing with that held out, and nobody followed it.

    What is not chosen stays a rival: of a single effect among those that were tried, of several among later fits.
    """
    load, motor = "load_dependent_friction", "torque_saturation"
    pressed = FittedCandidate(load, _model((*others, load), 1.0), 0.7, Explained(1.0, 0.0), None, True)
    short = FittedCandidate(motor, _model((*others, motor), left), -0.5, Explained(1.0, 0.0), None, named)
    monkeypatch.setattr(backward, "like_a_motor", lambda *told: alike and told[-1] == load)
    monkeypatch.setattr(backward, "error_left", lambda _, model_fit: model_fit.left)
    monkeypatch.setattr(backward, "without_effect", lambda *_: pressed)
    monkeypatch.setattr(backward, "at_its_best", lambda *told: told[-1])
    monkeypatch.setattr(backward, "inside_twin", lambda *told: short if told[-1] == motor else None)
    monkeypatch.setattr(backward, "gain_on_veto", lambda *_: 0.8)
    monkeypatch.setattr(SearchState, "shaped", lambda _, item: item)
    looking = _search(pressed, (pressed,))
    looking.problem.candidates = tuple(EFFECTS.values())
    looking.problem.has_veto = True
    looking.evidence.alike = lambda _: 0.03
    backward.try_motor(looking)
    assert looking.chosen is not None
    assert looking.chosen.effect == effect
    assert effect == load or looking.chosen.gain == 0.8, "with the fastest held out it gained nothing"
    beside = {one.effect for one in (looking.later if others else looking.tried)}
    if alike:
        assert beside >= {motor, load} - {effect}
    else:
        assert motor not in beside


def _model(effects: tuple[str, ...], left: float) -> SimpleNamespace:
    """A model by its effects and what it leaves."""
    return SimpleNamespace(effects=effects, left=left)


@pytest.mark.parametrize(
    ("veto", "repeats", "gain", "better"),
    [
        (0.90, True, 0.0, True),
        (0.99, True, 0.5, False),
        (0.90, False, 0.0, True),
        (0.99, False, 0.5, True),  # a spot that the veto passes beside
        (0.99, False, 0.0, False),
        (1.01, False, 0.5, False),  # the veto refutes it
    ],
)
def test_of_a_veto_trajectory_that_was_played_once_experiments_held_out_tell_a_course_too(
    monkeypatch: pytest.MonkeyPatch, veto: float, repeats: bool, gain: float, better: bool
) -> None:
    def fit(left: float, cost: float) -> SimpleNamespace:
        return SimpleNamespace(fitted=SimpleNamespace(error=left, cost=cost, packed=None), unseen=None)

    monkeypatch.setattr(candidates, "rests_of", lambda *_: None)
    monkeypatch.setattr(candidates, "without_rests", lambda error, _: error)
    monkeypatch.setattr(candidates, "gain_and_z", lambda *_: (gain, 10.0))
    problem = SimpleNamespace(
        policy=POLICY, has_veto=True, veto_repeats=repeats, mean_square=lambda error, _: error
    )
    assert candidates.predicts_better(problem, fit(1.0, 1.0), fit(veto, 0.5)) is better


@pytest.mark.parametrize(
    ("named", "rival", "followed_down"),
    [
        ("stribeck", 0.8, ["stribeck", "backlash"]),
        ("stribeck", 0.6, ["stribeck"]),  # a name by a law of its own: close rivals only
        ("reversal_memory", 0.6, ["reversal_memory", "backlash"]),
        ("reversal_memory", 0.3, ["reversal_memory", "backlash"]),
        ("reversal_memory", 0.2, ["reversal_memory"]),
    ],
)
def test_elements_have_a_name_beside_every_rival_that_is_worth_a_fit(
    monkeypatch: pytest.MonkeyPatch, named: str, rival: float, followed_down: list[str]
) -> None:
    """A gap with friction at its load was a memory, confirmed, with a third of its gain on the measured motion."""
    fitted: list[str] = []

    def fit(_: object, __: object, ___: object, item: SimpleNamespace, ____: float) -> SimpleNamespace:
        fitted.append(item.effect)
        costs = SimpleNamespace(fitted=SimpleNamespace(cost=1.0))
        return SimpleNamespace(effect=item.effect, named=item.effect == named, model_fit=costs)

    monkeypatch.setattr(rounds, "inside_twin", fit)
    state = SimpleNamespace(problem=SimpleNamespace(policy=POLICY), root=None, progress=no_progress)
    ranked = [
        SimpleNamespace(effect=named, gain=0.5),
        SimpleNamespace(effect="backlash", gain=0.5 * rival),
    ]
    _fit_down(state, SimpleNamespace(effects=()), ranked)  # type: ignore[arg-type]
    assert fitted == followed_down


@pytest.mark.parametrize(
    ("chosen", "share", "beside"),
    [
        ("reversal_memory", 0.74, True),
        ("reversal_memory", 0.6, False),  # the gap beside a true memory explained 44 to 60 %
        ("stribeck", 0.74, False),
    ],
)
def test_what_explains_most_by_a_form_of_its_own_stands_beside_elements(
    chosen: str, share: float, beside: bool
) -> None:
    """Elements explained 95 % of a gap with friction at the load, and the gap's law 74."""
    named = SimpleNamespace(effect=chosen)
    gap = SimpleNamespace(effect="backlash", named=False, share=share)
    found = facts._rivals(None, None, None, named, [named, gap])  # type: ignore[arg-type]
    assert found == (["backlash"] if beside else [])


@pytest.mark.parametrize(
    ("veto", "named", "share", "told"),
    [
        (True, True, 0.9, 0.7),
        (True, False, 0.9, 0.7),  # by another law of its own: led on from there
        (True, False, 0.4, -0.5),
        (False, False, 0.9, 0.3),
        (False, False, 0.4, -0.5),
    ],
)
def test_what_the_fastest_experiment_alone_shows_is_told_by_the_veto_or_its_way_back(
    monkeypatch: pytest.MonkeyPatch, veto: bool, named: bool, share: float, told: float
) -> None:
    """A motor that saturates there gained -0.58 while that was held out, and explained 0.89 of the veto."""
    monkeypatch.setattr(rounds, "gain_on_veto", lambda *_: 0.7)
    monkeypatch.setattr(rounds, "gain_by_way_back", lambda *_: (0.3, 5.0))
    problem, explains = SimpleNamespace(policy=POLICY, has_veto=veto), SimpleNamespace(share=share)
    best = SimpleNamespace(
        model_fit=None, named=named, gain=-0.5, veto=explains if veto else None, training=explains
    )
    assert rounds._gain_where_one_tells(problem, None, best) == told


@pytest.mark.parametrize(
    ("further", "left", "shaped"),
    [
        ("gravity_imbalance", 0.99, True),  # a weight beside a spring that hardens: its law differs
        ("gravity_imbalance", 0.8, False),
        ("thermal_drift", 0.99, False),
        ("thermal_drift", 1.01, True),
    ],
)
def test_what_looks_like_an_effect_must_predict_clearly_better_than_a_course_of_it(
    further: str, left: float, shaped: bool
) -> None:
    def one(effect: str, chunks: np.ndarray) -> SimpleNamespace:
        return SimpleNamespace(effect=effect, model_fit=SimpleNamespace(unseen=Unseen(chunks)))

    chunks = 1.0 + 0.1 * np.random.default_rng(1).random(40)
    state = SimpleNamespace(problem=SimpleNamespace(policy=POLICY))
    beside = one(further, left * chunks)
    assert search._predicts_more(state, one("spring", chunks), beside) is not shaped
