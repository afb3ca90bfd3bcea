"""Between motor and load there is one transmission: a gap brings its own spring."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from autotune.diagnosis import settling, transmission
from autotune.diagnosis.candidates import no_progress
from autotune.diagnosis.starts import FitStart, _of_each_size, varying
from autotune.diagnosis.transmission import (
    ADDED,
    HIT,
    LOADS,
    OF_THE_GAP,
    SHARES,
    TURNS,
    _contacts,
    _Exchange,
    _of_all_sizes,
    adds_nothing,
    gap_is_told,
    other_spring_tried,
    other_transmission_tried,
    plainer_of,
    spring_in_place,
)
from autotune.estimation.bias_corrected_fit import FreeAt
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.least_squares import Free
from autotune.estimation.policy import POLICY
from autotune.models import layout
from autotune.models.backlash import BACKLASH, damped_by_impact
from autotune.models.drive_model import Packed, base_model
from autotune.models.effect import Kind
from autotune.models.elastic_transmission import ELASTIC_TRANSMISSION, hardened, relaxing
from autotune.models.plant import advance
from autotune.models.start_values import StartValues, Vary
from autotune.models.table import EFFECTS
from autotune.models.transmission import (
    HARDEST,
    LOAD_POSITION,
    coupling,
    coupling_rate,
    hung,
    load_shares,
    passed_torque,
    relaxed,
)
from tests.support.fitted import Item

SPRING_VALUES = {"compliance": 2e-3, "load_inertia": 0.4, "load_friction": 0.3, "damping": 0.1}
BASE = {
    "inertia": 5e-4, "viscous": 1e-3, "coulomb": 0.28, "stiffness": 100.0, "micro_damping": 0.05, "offset": 0.1,
}  # fmt: skip


def test_a_spring_beside_a_gap_is_the_contact_of_the_gap() -> None:
    packed = base_model(BASE).pack()
    p, on = packed.p.copy(), packed.on.copy()
    on[layout.flag(BACKLASH.name)] = True
    values = {
        "contact_compliance": 3e-3,
        "load_inertia": 0.4,
        "load_friction": 0.3,
        "damping": 0.1,
        "load_offset": 0.7,
    }
    p[BACKLASH.slot("gap")] = 4e-3
    for name, value in values.items():
        p[BACKLASH.slot(name)] = value
    both, on_both = p.copy(), on.copy()
    on_both[layout.flag(ELASTIC_TRANSMISSION.name)] = True
    for name, of_the_gap in OF_THE_GAP.items():
        both[ELASTIC_TRANSMISSION.slot(name)] = values[of_the_gap]
        both[BACKLASH.slot(of_the_gap)] = BACKLASH.parameter(of_the_gap).neutral
    alone, together = Packed(p, on), Packed(both, on_both)
    assert coupling(together.p, together.on)[:6] == pytest.approx(coupling(alone.p, alone.on)[:6])
    assert load_shares(together.p, together.on) == load_shares(alone.p, alone.on)
    assert hung(together.p, together.on) == hung(alone.p, alone.on)


@pytest.mark.parametrize(
    ("kind", "other"), [(ELASTIC_TRANSMISSION, BACKLASH), (BACKLASH, ELASTIC_TRANSMISSION)]
)
def test_neither_is_looked_for_beside_the_other(kind: Kind, other: Kind) -> None:
    """Together they are the model of the gap alone: named both, one of the names is nothing's."""
    assert adds_nothing(kind, SimpleNamespace(effects=(other.name,)))
    assert not adds_nothing(kind, SimpleNamespace(effects=("torque_lag",)))


def test_a_weight_at_the_load_keeps_its_gap_closed() -> None:
    """Motor and load rest: what holds the motor is passed to the load, by as much as hangs there."""
    packed = base_model(BASE | {"offset": 0.2}).pack()
    packed.on[layout.flag(BACKLASH.name)] = True
    values = {"gap": 4e-3, "contact_compliance": 3e-3, "load_inertia": 0.4, "load_friction": 0.0}
    for name, value in (values | {"damping": 0.3}).items():
        packed.p[BACKLASH.slot(name)] = value
    twists = []
    for share in (1.0, 0.5, 0.0):
        packed.p[BACKLASH.slot("load_offset")] = share
        state = np.zeros(layout.STATES)
        for _ in range(500):
            advance(packed.p, packed.on, state, 0.2, 1e-3, 20)
        twists.append(state[layout.POSITION] - state[LOAD_POSITION])
    assert twists[0] == pytest.approx(2e-3 + 0.2 * 3e-3, rel=1e-3)
    assert twists[1] == pytest.approx(2e-3 + 0.1 * 3e-3, rel=1e-3)
    assert abs(twists[2]) < 2e-3


def test_a_contact_may_be_damped_by_its_torque() -> None:
    """Nothing where surfaces meet, more the deeper they are; it never pulls, and loses the speed that it says."""
    stiffness, half, per_torque = 400.0, 1e-3, 0.2
    passed = [
        passed_torque(stiffness, 0.0, half, per_torque, 0.0, side * (half + depth), side * rate)
        for depth, rate, side in ((0.0, 2.0, 1.0), (1e-3, 2.0, 1.0), (1e-3, 2.0, -1.0), (1e-3, -9.0, 1.0))
    ]
    assert passed == pytest.approx([0.0, 0.4 * 1.4, -0.4 * 1.4, 0.0])
    p = base_model(BASE).pack().p
    p[BACKLASH.slot("gap")] = 2.0 * half
    speed, mass = math.sqrt(4.0 * half * BASE["coulomb"] / BASE["inertia"]), 1e-4
    by_torque, twist, rate, step = damped_by_impact(p, 0.05), half, speed, 1e-6
    while twist >= half:
        rate -= step / mass * passed_torque(stiffness, 0.0, half, by_torque, 0.0, twist, rate)
        twist += step * rate
    assert -rate / speed == pytest.approx(math.exp(-0.05 * math.pi), abs=0.02)


def test_a_spring_may_harden() -> None:
    """It gives way as far as the one that does not under the torque that it was told at, and less above."""
    compliance, hardening = hardened(2e-3, 0.5, 1.0)
    packed = base_model(BASE).with_effect(ELASTIC_TRANSMISSION.make(SPRING_VALUES)).pack()
    packed.p[ELASTIC_TRANSMISSION.slot("compliance")] = compliance
    packed.p[ELASTIC_TRANSMISSION.slot("hardening")] = hardening
    *between, harder, _, _ = coupling(packed.p, packed.on)
    passed = [passed_torque(*between, harder, twist, 0.0) for twist in (1e-3, -1e-3, 1e-5, 1.0)]
    stiffness = 1.0 / compliance
    assert passed == pytest.approx([0.5, -0.5, 1e-5 * stiffness * (1.0 + 1e-4), stiffness * (1.0 + HARDEST)])
    assert passed_torque(*between, 0.0, 1e-3, 0.0) == pytest.approx(1e-3 * stiffness)


@pytest.mark.parametrize(("share", "turns"), list(itertools.product(SHARES, TURNS)))
def test_a_spring_a_part_of_which_relaxes_begins_as_stiff_and_as_damped(share: float, turns: float) -> None:
    """Where motor and load ring; at rest it gives way further."""
    packed = base_model(BASE).with_effect(ELASTIC_TRANSMISSION.make(SPRING_VALUES | {"damping": 0.5})).pack()
    rate = coupling_rate(packed.p, packed.on)
    stiff, damped, *_ = coupling(packed.p, packed.on)
    other = Packed(packed.p.copy(), packed.on)
    for name, value in relaxing(packed.p, share, turns).items():
        other.p[ELASTIC_TRANSMISSION.slot(name)] = value
    stays, beside, *_ = coupling(other.p, other.on)
    turned = 1j * rate * other.p[ELASTIC_TRANSMISSION.slot("relaxation_time")]
    dynamic = stays * (1.0 + share * turned / (1.0 + turned)) + 1j * rate * beside
    assert turned == pytest.approx(1j * turns)
    assert dynamic == pytest.approx(stiff + 1j * rate * damped)


def test_what_relaxes_is_gone_after_a_while() -> None:
    """At once it holds as much as what stays, where it is as stiff; after its time a part 1/e of that."""
    values = SPRING_VALUES | {"relaxing": 1.0, "relaxation_time": 0.02}
    packed = base_model(BASE).with_effect(ELASTIC_TRANSMISSION.make(values)).pack()
    stiffness, *_, loose, fading = coupling(packed.p, packed.on)
    state, step = np.zeros(layout.STATES), 1e-5
    passed = [relaxed(state, loose, fading, rate, step) for rate in (100.0, *([0.0] * 4000))]
    twist = 100.0 * step
    assert passed[0] == pytest.approx(stiffness * twist, rel=1e-3)
    assert passed[2000] == pytest.approx(stiffness * twist * math.exp(-1.0), rel=2e-3)


@pytest.mark.parametrize(
    ("effects", "gains", "share", "asked"),
    [
        (("backlash",), {"backlash": 0.6, "elastic_transmission": 0.35}, 1.0, True),
        (("backlash",), {"backlash": 0.6, "elastic_transmission": 0.2}, 1.0, False),
        (("backlash",), {"backlash": 0.6}, 1.0, False),
        (("elastic_transmission",), {"elastic_transmission": 0.6}, 0.9, True),
        (("elastic_transmission",), {"elastic_transmission": 0.6}, 1.0, False),
        (("elastic_transmission",), {"elastic_transmission": 0.6}, 0.4, False),
        (("torque_lag",), {"elastic_transmission": 0.6, "torque_lag": 0.7}, 0.9, False),
    ],
)
@pytest.mark.parametrize("width", [3e-3, 1e-5])
def test_a_spring_that_hardens_is_tried_where_one_comes_near_a_gap_or_leaves_something(
    monkeypatch: pytest.MonkeyPatch,
    effects: tuple[str, ...],
    gains: dict[str, float],
    share: float,
    asked: bool,
    width: float,
) -> None:
    """A gap was named, confirmed, for a spring twice as stiff at the torque that the axis needs.

    For what is hardly a gap it is tried whatever a spring gains by itself.
    """
    gaps = "backlash" in effects
    asked = asked or (gaps and width < 1e-3)
    packed = base_model(BASE).pack()
    for kind, name in ((BACKLASH, "contact_compliance"), (ELASTIC_TRANSMISSION, "compliance")):
        packed.p[kind.slot(name)] = 2e-3
        packed.on[layout.flag(kind.name)] = kind.name in effects
    packed.p[BACKLASH.slot("gap")] = width
    begun: list[FitStart] = []
    both = packed.on.copy()
    both[layout.flag(ELASTIC_TRANSMISSION.name)] = True
    start = FitStart(Packed(packed.p, both), ())
    monkeypatch.setattr(
        transmission, "scouted", lambda _, __, starts, instead: begun.extend(starts) or starts
    )
    monkeypatch.setattr(transmission, "fit_from_starts", lambda *_: None)
    monkeypatch.setattr(transmission, "starts_of", lambda *_: [start])
    monkeypatch.setattr(transmission, "Context", lambda *_: None)
    fit = SimpleNamespace(effects=effects, fitted=SimpleNamespace(packed=packed, cost=1.0), free=[])
    problem = SimpleNamespace(
        policy=POLICY, twin=True, candidates=[ELASTIC_TRANSMISSION], scales=SimpleNamespace(torque=0.5)
    )
    chosen = SimpleNamespace(model_fit=fit, share=share, plain_share=share, effect=effects[0])
    said: list[str] = []
    root = SimpleNamespace(fitted=SimpleNamespace(packed=base_model(BASE).pack()))
    assert other_spring_tried(problem, root, packed, chosen, gains, [], said.append) == (chosen, None)
    assert bool(said) == bool(begun) == asked
    for one, load in zip(begun, np.repeat(LOADS[1:] if gaps else (1.0,), len(ADDED)), strict=False):
        twist = 2e-3 * 0.5 + (0.5 * width / load if gaps else 0.0)
        assert passed_torque(*coupling(one.packed.p, one.packed.on)[:5], twist, 0.0) == pytest.approx(0.5)
        assert not one.packed.on[layout.flag(BACKLASH.name)]


@pytest.mark.parametrize(
    ("named", "left", "earns", "rest", "taken"),
    [
        (False, 0.7, False, False, True),
        (False, 0.9, True, True, True),
        (False, 0.9, False, True, False),
        (False, 0.9, True, False, False),
        (True, 0.9, True, True, False),
        (False, 1.1, True, True, False),
    ],
)
def test_a_spring_by_another_law_leaves_clearly_less_or_earns_the_name(
    monkeypatch: pytest.MonkeyPatch, named: bool, left: float, earns: bool, rest: bool, taken: bool
) -> None:
    """A spring that hardens left 0.86 of what a linear one did in noise, all of what comes again, and was no better."""
    packed = base_model(BASE).pack()
    packed.on[layout.flag(ELASTIC_TRANSMISSION.name)] = True
    packed.p[ELASTIC_TRANSMISSION.slot("compliance")] = 2e-3

    def fit(left: float) -> SimpleNamespace:
        fitted = SimpleNamespace(packed=packed, cost=left)
        return SimpleNamespace(effects=(ELASTIC_TRANSMISSION.name,), fitted=fitted, free=[], left=left)

    chosen = Item(model_fit=fit(1.0), effect=ELASTIC_TRANSMISSION.name, share=0.89, named=named)
    monkeypatch.setattr(transmission, "_other_spring", lambda *_: fit(left))
    monkeypatch.setattr(transmission, "error_left", lambda _, model_fit: model_fit.left)
    monkeypatch.setattr(transmission, "explains_rest", lambda *_: rest)
    monkeypatch.setattr(transmission, "masses_led_on", lambda _, __, other, ___: other)
    monkeypatch.setattr(transmission, "refined", lambda _, __, other, ___: other)
    monkeypatch.setattr(
        transmission,
        "judged_again",
        lambda _, __, one, settled: Item(model_fit=settled, effect=one.effect, named=earns),
    )
    problem = SimpleNamespace(policy=POLICY, twin=True, scales=SimpleNamespace(torque=0.5))
    found, behind = other_spring_tried(problem, None, packed, chosen, {}, [], no_progress)
    assert (found is not chosen) == taken
    assert behind is None


@pytest.mark.parametrize(("left", "stands"), [(0.7, True), (1.2, False)])
def test_a_gap_is_compared_with_the_spring_that_leaves_least(
    monkeypatch: pytest.MonkeyPatch, left: float, stands: bool
) -> None:
    """By whatever law; and what a spring in its place begins from later has both. Fits hold arrays: none is equal."""

    class Fit(SimpleNamespace):
        def __eq__(self, other: object) -> bool:
            raise ValueError("the truth value of an array is ambiguous")

    linear, gap, behind = (
        Fit(model_fit=SimpleNamespace(effects=(effect,), left=cost))
        for effect, cost in (
            (ELASTIC_TRANSMISSION.name, 1.0),
            (BACKLASH.name, 0.5),
            (ELASTIC_TRANSMISSION.name, left),
        )
    )
    monkeypatch.setattr(settling, "other_spring_tried", lambda *_: (gap, behind))
    monkeypatch.setattr(settling, "error_left", lambda _, model_fit: model_fit.left)
    state = SimpleNamespace(
        problem=None, root=None, nominal=None, progress=None, first=[], seen=[], tried=[linear, gap]
    )
    assert settling._other_spring(state, gap) is gap
    assert state.tried == ([gap, behind] if stands else [linear, gap])
    assert state.seen == [behind.model_fit]


def test_other_contacts_of_a_gap_give_way_as_far_under_a_load() -> None:
    packed = base_model(BASE).pack()
    packed.p[[BACKLASH.slot(name) for name in ("gap", "contact_compliance")]] = 1e-3, 2e-3
    problem = SimpleNamespace(data=SimpleNamespace(cutoff=60.0), scales=SimpleNamespace(torque=0.5))
    plain, by_impact = (_contacts(problem, packed, impact) for impact in (False, True))
    assert len(by_impact) == 2 * len(plain)
    for one in plain:
        load = (one.p[BACKLASH.slot("gap")] - 1e-3) / (2e-3 - one.p[BACKLASH.slot("contact_compliance")])
        assert any(load == pytest.approx(2.0 * share * 0.5) for share in LOADS)
    assert all(
        one.p[BACKLASH.slot("impact_damping")] == 0.0 < one.p[BACKLASH.slot("damping")] for one in plain
    )
    assert all(one.p[BACKLASH.slot("damping")] == 0.0 for one in by_impact)
    assert all(one.p[BACKLASH.slot("impact_damping")] > 0.0 for one in by_impact)


def test_contacts_that_are_hit_begin_at_gaps_of_all_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once each, whatever dampers starts have; what the model has beside its gap stays."""
    slots = [BACKLASH.slot(name) for name in ("gap", "contact_compliance", "damping", "impact_damping")]
    beyond = {"contact_compliance": 1e-3, "load_inertia": 0.4, "load_friction": 0.3, "damping": 0.1}

    def begun(gap: float, damping: float) -> FitStart:
        packed = base_model(BASE).with_effect(BACKLASH.make({"gap": gap} | beyond)).pack()
        packed.p[slots[2]] = damping
        return FitStart(packed, ())

    starts = [begun(gap, damping) for gap in (1e-4, 1e-3) for damping in (0.05, 0.3)]
    monkeypatch.setattr(transmission, "starts_of", lambda *_: starts)
    packed = base_model(BASE | {"viscous": 7e-3}).with_effect(BACKLASH.make({"gap": 1e-2} | beyond)).pack()
    root: Any = SimpleNamespace(fitted=SimpleNamespace(packed=packed))
    problem: Any = None
    narrow, wide = _of_all_sizes(problem, root, packed)
    for one, gap in ((narrow, 1e-4), (wide, 1e-3)):
        size, _, damping, impact = one.p[slots]
        assert (size, damping) == (gap, 0.0)
        assert impact == pytest.approx(damped_by_impact(one.p, HIT))
        assert one.p[layout.VISCOUS] == 7e-3
    assert packed.p[slots[0]] == 1e-2


@pytest.mark.parametrize("kind", [ELASTIC_TRANSMISSION, BACKLASH])
def test_fits_begin_with_a_constant_torque_on_either_side(kind: Kind) -> None:
    """Where it is more than what is left; else nothing tells the side of a load that rubs, and it stays the motor's."""

    def begun(left: float) -> list[StartValues]:
        axis = {"coulomb": 0.28, "cutoff": 60.0, "period": 1e-3, "travel": 6.0, "mean_speed": 2.0}
        c = SimpleNamespace(p=base_model(BASE | {"offset": 0.1}).pack().p, left=left, **axis)
        return [start for start in kind.starts(c) if start.values["load_friction"] > 0.0]

    told, hidden = begun(0.02), begun(0.2)
    assert {start.values["load_offset"] for start in told} == {0.0, 1.0}
    assert all("load_offset" in start.free for start in told)
    assert len(told) == 2 * len(hidden)
    assert not any("load_offset" in {**start.values, **start.free} for start in hidden)


@pytest.mark.parametrize(
    ("named", "shares", "spring_has", "gap_has", "told"),
    [
        (False, (0.97, 0.95), 0.68, 0.95, True),
        (False, (0.97, 0.8), 0.68, 0.95, False),
        (True, (0.97, 0.95), 0.68, 0.95, False),
        (False, (0.9, 0.89), 0.15, 0.91, True),
        (False, (0.9, 0.89), 0.15, 0.85, False),
    ],
    ids=["far behind", "not on the veto", "a spring with a name", "a spring refuted", "too little itself"],
)
def test_what_is_hardly_a_gap_is_one_where_a_spring_is_left_behind(
    monkeypatch: pytest.MonkeyPatch,
    named: bool,
    shares: tuple[float, float],
    spring_has: float,
    gap_has: float,
    told: bool,
) -> None:
    """Of a gap of a quarter of its twist, 99.5 % explained, nothing was left but a spring that explains 68 %.

    Of another the spring explained 15 %, so that it left all: the gap's own nine tenths were held against it.
    """
    parts = [SimpleNamespace(plain_share=share) for share in shares]
    monkeypatch.setattr(transmission, "explained_of_rest", lambda *_: parts)
    problem = SimpleNamespace(policy=POLICY, has=lambda role: True)
    spring = SimpleNamespace(named=named, share=spring_has, model_fit=None)
    assert gap_is_told(problem, SimpleNamespace(share=gap_has, model_fit=None), spring) == told
    assert not gap_is_told(SimpleNamespace(policy=POLICY, has=lambda role: False), spring, spring)


@pytest.mark.parametrize(
    ("named", "left", "instead"),
    [
        (False, (1.1, 1.1), True),
        (False, (3.0, 1.1), False),
        (False, (1.1, 3.0), False),
        (True, (3.0, 3.0), True),
    ],
    ids=["about as little", "not of what was fitted", "not on the veto", "a name"],
)
def test_a_spring_takes_the_place_of_what_is_hardly_a_gap(
    named: bool, left: tuple[float, float], instead: bool
) -> None:
    """Where it has a name, or leaves about as little; an exchange that leaves three times as much is none.

    Nor is one that does so on what was fitted, however loud the veto trajectory is beside that: in the sum of both a
    spring that left 1.4 times as much took the place of a true gap that had not been led to its floor yet.
    """
    loud = {TRAINING: 1.0, VETO: 20.0}

    def mean_square(error: dict[str, float], role: str) -> float:
        return loud[role] * error[role]

    def fitted(error: dict[str, float]) -> SimpleNamespace:
        return SimpleNamespace(fitted=SimpleNamespace(error=error))

    problem = SimpleNamespace(policy=POLICY, has=lambda role: True, mean_square=mean_square)
    gap = SimpleNamespace(model_fit=fitted({TRAINING: 1.0, VETO: 1.0}))
    own = fitted(dict(zip((TRAINING, VETO), left, strict=True)))
    spring = SimpleNamespace(model_fit=own, named=named)
    assert plainer_of(problem, gap, spring) is (spring if instead else gap)
    assert plainer_of(problem, gap, None) is gap


@pytest.mark.parametrize(
    ("hardens", "share", "other", "left", "tried", "taken"),
    [
        (True, 0.9, True, 0.6, True, True),
        (True, 0.9, True, 1.1, True, False),
        (False, 0.9, True, 0.6, False, False),
        (True, 1.0, True, 0.6, False, False),
        (True, 0.9, False, 0.6, False, False),
    ],
)
def test_a_gap_is_tried_again_beside_what_was_found_since(
    monkeypatch: pytest.MonkeyPatch,
    hardens: bool,
    share: float,
    other: bool,
    left: float,
    tried: bool,
    taken: bool,
) -> None:
    """A spring that hardened stood for a gap as long as an asymmetry was missing, and kept its place beside it.

    The gap that was known without the other effect is among the places where its fit begins, beside that effect.
    """
    asymmetry, gap_alone = EFFECTS["direction_asymmetry"], base_model(BASE).pack()
    gap_alone.p[BACKLASH.slot("gap")], gap_alone.on[layout.flag(BACKLASH.name)] = 7e-3, True
    packed = base_model(BASE).pack()
    packed.p[asymmetry.slot("coulomb")] = 0.03
    for name in (ELASTIC_TRANSMISSION.name, asymmetry.name):
        packed.on[layout.flag(name)] = True
    begun: list[Packed] = []

    def fit_from_starts(_: object, starts: list[Packed], *rest: object) -> SimpleNamespace:
        begun.extend(starts)
        return SimpleNamespace(left=left)

    monkeypatch.setattr(transmission, "fit_from_starts", fit_from_starts)
    monkeypatch.setattr(transmission, "starts_of", lambda *_: iter([FitStart(gap_alone, ())]))
    monkeypatch.setattr(transmission, "Context", lambda *_: None)
    monkeypatch.setattr(transmission, "error_left", lambda _, model_fit: model_fit.left)
    monkeypatch.setattr(
        transmission, "judged", lambda _, __, settled, effect: Item(model_fit=settled, effect=effect)
    )
    free = [varying(ELASTIC_TRANSMISSION, "hardening", Vary(1.0, 1.0))] if hardens else []
    effects = (ELASTIC_TRANSMISSION.name, *((asymmetry.name,) if other else ()))
    fit = SimpleNamespace(
        effects=effects, fitted=SimpleNamespace(packed=packed, cost=1.0), free=free, left=1.0
    )
    root = SimpleNamespace(fitted=SimpleNamespace(packed=base_model(BASE).pack()))
    known = SimpleNamespace(effects=(BACKLASH.name,), fitted=SimpleNamespace(packed=gap_alone))
    chosen = Item(model_fit=fit, effect=effects[-1], share=share)
    problem = SimpleNamespace(policy=POLICY, twin=True, candidates=[BACKLASH, ELASTIC_TRANSMISSION])
    found = other_transmission_tried(problem, root, packed, chosen, [known], no_progress)
    assert (found is not chosen) == taken
    assert bool(begun) == tried
    if tried:
        place = begun[-1]
        assert place.p[BACKLASH.slot("gap")] == 7e-3
        assert place.p[asymmetry.slot("coulomb")] == 0.03
        assert not place.on[layout.flag(ELASTIC_TRANSMISSION.name)]


def test_a_spring_in_the_place_of_hardly_a_gap_begins_where_one_was_fitted_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From the gap's contact its fit ended at six times the cost of the spring of the round before."""
    packed = base_model(BASE).pack()
    packed.p[BACKLASH.slot("contact_compliance")] = 2e-3
    gap = SimpleNamespace(fitted=SimpleNamespace(packed=packed, cost=1.0), free=(), effects=(BACKLASH.name,))
    springs = [
        SimpleNamespace(fitted=SimpleNamespace(packed=base_model(BASE).pack()), effects=effects)
        for effects in [(ELASTIC_TRANSMISSION.name,), ("stribeck",)]
    ]
    begun: list[Packed] = []
    monkeypatch.setattr(transmission, "fit_from_starts", lambda _, starts, *rest: begun.extend(starts))
    monkeypatch.setattr(transmission, "starts_of", lambda *_: iter([FitStart(packed, ())]))
    monkeypatch.setattr(transmission, "Context", lambda *_: None)
    problem = SimpleNamespace(policy=POLICY, candidates=[ELASTIC_TRANSMISSION])
    chosen = SimpleNamespace(model_fit=gap, effect=BACKLASH.name)
    spring_in_place(problem, gap, packed, chosen, [gap, *springs])
    assert [one.p[ELASTIC_TRANSMISSION.slot("compliance")] for one in begun] == [2e-3, 0.0]
    assert begun[1] is springs[0].fitted.packed


@pytest.mark.parametrize(
    ("old", "new", "size"),
    [(BACKLASH, ELASTIC_TRANSMISSION, "compliance"), (ELASTIC_TRANSMISSION, BACKLASH, "gap")],
)
def test_the_other_transmission_moves_by_steps_as_large_as_what_it_begins_with(
    monkeypatch: pytest.MonkeyPatch, old: Kind, new: Kind, size: str
) -> None:
    """They were those of the last start of all: a spring as soft as a gap's contact went on by 3 % of itself a step."""
    c = SimpleNamespace(
        p=base_model(BASE).pack().p, coulomb=BASE["coulomb"], left=0.1, cutoff=60.0, period=1e-3, travel=6.0,
        mean_speed=2.0,
    )  # fmt: skip
    packed = base_model(BASE).pack()
    packed.p[BACKLASH.slot("contact_compliance")] = 0.05
    known: list[tuple[Packed, list[Free]]] = []

    def starts_of(kind: Kind, _: object) -> list[FitStart]:
        begun = []
        for start in kind.starts(c):
            p = packed.p.copy()
            for name, value in start.values.items():
                p[kind.slot(name)] = value
            free = tuple(varying(kind, name, vary) for name, vary in start.free.items())
            begun.append(FitStart(Packed(p, packed.on), free))
        return begun

    def fit_from_starts(_: object, starts: list[Packed], __: float, free: FreeAt, *___: object) -> None:
        known.extend((one, list(free(one))) for one in starts)

    monkeypatch.setattr(transmission, "starts_of", starts_of)
    monkeypatch.setattr(transmission, "Context", lambda *_: None)
    monkeypatch.setattr(transmission, "fit_from_starts", fit_from_starts)
    model_fit = SimpleNamespace(
        fitted=SimpleNamespace(packed=packed, cost=1.0), free=(varying(old, "damping", Vary(1.0)),),
        effects=(old.name,),
    )  # fmt: skip
    chosen = SimpleNamespace(model_fit=model_fit, effect=old.name)
    _Exchange(old, new, 1.0).fitted(None, model_fit, packed, chosen)
    at = new.slot(size)
    assert len({float(begun.p[at]) for begun, _ in known}) == (8 if new is BACKLASH else 1)
    for begun, free in known:
        (one,) = (one for one in free if one.slot == at)
        assert one.step == pytest.approx(0.6 * begun.p[at])
        assert not any(other.slot == old.slot("damping") for other in free)
        (share,) = (other for other in free if other.slot == new.slot("load_inertia"))
        assert share.scale == 0.2


def test_a_start_of_every_size_is_looked_at() -> None:
    """Gaps too small to be seen cost what nothing costs, and stood before one whose valley leaves half."""
    sizes, costs = (1.0, 1.2, 0.9, 3.0, 3.1, 9.0), np.array([1.0, 1.01, 1.02, 1.3, 1.2, 1.4])
    slot = BACKLASH.slot("gap")
    starts = []
    for size in sizes:
        packed = base_model(BASE).pack()
        packed.p[slot] = size
        starts.append(FitStart(packed, (varying(BACKLASH, "gap", Vary(1.0)),)))
    assert _of_each_size(starts, costs) == [0, 4, 5]


def test_a_start_of_every_size_and_damping_is_looked_at() -> None:
    """Where a contact that is damped less makes the loop hunt, the start that costs least led to another place."""
    damped, costs = (0.1, 0.1, 0.3, 0.3, 0.3), np.array([1.0, 1.3, 1.1, 1.01, 1.4])
    gap, damping = BACKLASH.slot("gap"), BACKLASH.slot("damping")
    starts = []
    for size, share in zip((1.0, 3.0, 1.0, 1.1, 3.0), damped, strict=True):
        packed = base_model(BASE).pack()
        packed.p[[gap, damping]] = size, share
        starts.append(FitStart(packed, (varying(BACKLASH, "gap", Vary(1.0)),)))
    assert _of_each_size(starts, costs) == [0, 3, 1, 4]


def test_gaps_begin_in_contacts_that_ring_and_that_hardly_do() -> None:
    p = base_model(BASE).pack().p
    c = SimpleNamespace(
        p=p, coulomb=BASE["coulomb"], left=0.1, cutoff=60.0, period=1e-3, travel=6.0, mean_speed=2.0
    )
    places: dict[float, list[tuple[float, ...]]] = {}
    for start in BACKLASH.starts(c):
        place = tuple(start.values[name] for name in ("gap", "load_inertia", "load_friction"))
        places.setdefault(start.values["damping"], []).append(place)
    ringing, damped = (places[share] for share in sorted(places))
    assert ringing == damped
    assert min(places) < 0.2 < max(places)


@pytest.mark.parametrize(("weight", "both"), [(0.02, True), (1e-10, False)])
def test_any_weight_closes_the_gap_of_a_load_that_floats(weight: float, both: bool) -> None:
    """However little it is of what is left: a true one of 3 % of the friction left 2.4 times as much at the motor."""
    p = base_model(BASE | {"offset": weight}).pack().p
    c = SimpleNamespace(
        p=p, coulomb=BASE["coulomb"], left=0.1, cutoff=60.0, period=1e-3, travel=6.0, mean_speed=2.0
    )
    values = [dict(start.values) for start in BACKLASH.starts(c)]
    floating = [one["load_offset"] for one in values if one["load_friction"] == 0.0 and "load_offset" in one]
    assert (set(floating) == {0.0, 1.0}) == both
    assert not any("load_offset" in one for one in values if one["load_friction"] > 0.0)
