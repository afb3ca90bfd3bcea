"""Laws that textbooks have in the base: found where the data ask for them, told, and never named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from autotune.diagnosis.candidates import free_of_model, no_progress
from autotune.diagnosis.contact_laws import goes_on, without_memory, without_tail
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.own_presliding import where_it_slides
from autotune.diagnosis.refits import judged
from autotune.diagnosis.search_state import Found, SearchState
from autotune.diagnosis.verdict import Diagnosis, diagnose
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.cross_validation import beyond_presliding
from autotune.estimation.data import TRAINING
from autotune.estimation.least_squares import Free, standard_errors
from autotune.estimation.problem import Problem, Scales
from autotune.models.drive_model import DriveModel, Packed, base_model
from autotune.models.layout import COULOMB, MICRO_DAMPING, STIFFNESS
from autotune.models.reversal_memory import ATTRACTION, DAMPING, REMEMBERS, REVERSAL_MEMORY
from autotune.models.stribeck import STRIBECK
from autotune.recordings.recording import Recording
from autotune.tuning.found_model import found_model
from autotune_sim.plant import Bristle, Element
from tests.support.axes import NOMINAL, plain_axis
from tests.support.diagnosis_programme import play

DAMPED = 0.3
"""Of critical damping at rest: with less nobody sees whether it fades."""
ERRORS = 3.0
"""Standard errors within which what is true must lie: one chance in four hundred."""


def axis_and_recording(seed: int, effects: dict[str, float], **bristle: float) -> tuple[Bristle, Recording]:
    """The contact of a plain axis with another base, and the diagnosis programme played on it."""
    axis = plain_axis(seed, effects)
    own = axis.plant.bristle
    assert own is not None
    damping = DAMPED * 2.0 * math.sqrt(own.stiffness * axis.plant.inertia)
    own = replace(own, damping=damping, **bristle)
    return own, play(replace(axis, plant=replace(axis.plant, bristle=own)), seed)


def known_within(found: Diagnosis) -> dict[str, tuple[float, float]]:
    """Value and standard error of what is free in the base."""
    root, problem = found.root, found.problem
    assert root is not None
    assert problem is not None
    errors = standard_errors(root.fitted, problem.training)
    names = [one.name for one in root.free]
    return dict(zip(names, zip(root.fitted.values, errors, strict=True), strict=True))


@pytest.mark.slow(12)
def test_damping_that_fades_is_a_law_of_the_base_and_its_speed_comes_back() -> None:
    true, recording = axis_and_recording(43, {}, fading_velocity=0.3)
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("none", ())
    assert any("fades with speed" in note for note in found.notes)
    known = known_within(found)
    for name, value in (("damping_velocity", true.fading_velocity), ("micro_damping", true.damping)):
        assert abs(known[name][0] - value) < ERRORS * known[name][1]
    assert known["damping_velocity"][1] < 0.1 * true.fading_velocity
    made = found_model(found, base_model(NOMINAL), "2024-05-01", "bench")
    assert made is not None
    assert made.error_after < 0.9 * made.error_before
    assert made.model["damping_velocity"] == pytest.approx(known["damping_velocity"][0])


@pytest.mark.long
def test_an_effect_is_named_beside_it() -> None:
    true, recording = axis_and_recording(47, {"torque_lag": 5e-4}, fading_velocity=0.2)
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("named", ("torque_lag",))
    value, error = known_within(found)["damping_velocity"]
    assert abs(value - true.fading_velocity) < 0.5 * true.fading_velocity + ERRORS * error


@pytest.mark.parametrize(
    "effects",
    [
        pytest.param({}, marks=pytest.mark.long),
        pytest.param({"gravity_imbalance": 0.02}, marks=pytest.mark.slow(50)),
    ],
    ids=["alone", "beside an effect"],
)
def test_friction_without_a_static_part_is_a_law_of_the_base(effects: dict[str, float]) -> None:
    """What is missing beside it keeps its name."""
    _, recording = axis_and_recording(44, effects, smooth_velocity=0.2)
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("named" if effects else "none", tuple(effects))
    assert any("no static part" in note for note in found.notes)
    assert known_within(found)["creep_velocity"][0] == pytest.approx(0.2, rel=0.1)
    made = found_model(found, base_model(NOMINAL), "2024-05-01", "bench")
    assert made is not None
    assert "creep_velocity" in made.model.base


@pytest.mark.slow
def test_damping_that_does_not_fade_stays_as_it_is() -> None:
    _, recording = axis_and_recording(42, {})
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.base) == ("none", ())
    assert "damping_velocity" not in known_within(found)
    assert found_model(found, base_model(NOMINAL), "2024-05-01", "bench") is None


def at_once(seed: int, effects: dict[str, float]) -> Recording:
    """A plain axis of which a tenth of all friction is there at once after a reversal."""
    axis = plain_axis(seed, effects)
    own = axis.plant.bristle
    assert own is not None
    part = 0.1 * own.coulomb
    plant = replace(
        axis.plant,
        bristle=replace(own, coulomb=0.9 * own.coulomb, break_away=0.9 * own.coulomb),
        elements=(Element(0.05 * own.coulomb / own.stiffness, part), *axis.plant.elements),
    )
    return play(replace(axis, plant=plant), seed)


@pytest.mark.slow(12)
def test_friction_that_is_there_at_once_is_a_law_of_the_base() -> None:
    recording = at_once(45, {})
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("none", ())
    assert any("another curve than the exponential" in note for note in found.notes)
    made = found_model(found, base_model(NOMINAL), "2024-05-01", "bench")
    assert made is not None
    assert made.error_after < 0.9 * made.error_before
    assert "reversal_memory" in made.model
    assert diagnose([recording], made.model).base == ()


@pytest.mark.long
def test_a_memory_keeps_its_name_beside_friction_that_is_there_at_once() -> None:
    found = diagnose([at_once(49, {"reversal_memory": 0.06})], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("named", ("reversal_memory",))


LINKS = (0.45, 0.75, 1.25, 2.1)
"""Of a bristle's reach: where contacts of a chain let go that carry alike."""


def with_elements(found: Diagnosis) -> tuple[Problem, ModelFit, ModelFit]:
    """The root that was found, and the same with two elements: one within its bristle's reach, one far beyond."""
    problem, root = found.problem, found.root
    assert problem is not None
    assert root is not None
    p, on = root.fitted.packed.p.copy(), root.fitted.packed.on.copy()
    level = float(p[COULOMB])
    reach = level / float(p[STIFFNESS])
    on[REMEMBERS] = True
    free = list(root.free)
    for number, (way, part) in enumerate(((1.0, 0.03), (30.0, 0.003)), 1):
        at = {name: REVERSAL_MEMORY.parameter(f"{name}_{number}").slot for name in ("displacement", "torque")}
        p[at["displacement"]], p[at["torque"]] = way * reach, part * level
        p[COULOMB] -= part * level
        free.append(Free(f"torque_{number}", at["torque"], 0.0, level, 0.1 * level, level))
    own = fit_inside_twin(problem, Packed(p, on), free, 3, root.effects)
    assert own is not None
    return problem, root, own


@pytest.mark.slow(12)
@pytest.mark.parametrize(("effects", "remembers"), [({}, False), ({"reversal_memory": 0.06}, True)])
def test_elements_are_a_memory_where_they_predict_better_beyond_the_contact(
    effects: dict[str, float], remembers: bool
) -> None:
    """Without them the contact keeps its level: a fit that begins outside its bounds would be stuck there."""
    _, recording = axis_and_recording(49, effects)
    problem, root, own = with_elements(diagnose([recording], base_model(NOMINAL)))
    kept = without_tail(problem, own)
    assert kept is not None
    assert goes_on(problem, own) == remembers
    assert (without_memory(problem, root, own) is not None) == remembers
    if not remembers:
        assert kept.fitted.cost < 1.01 * own.fitted.cost


def chain(seed: int, effects: dict[str, float]) -> Recording:
    """A plain axis with contacts that let go one after another, each damped as long as it sticks."""
    axis = plain_axis(seed, effects)
    own = axis.plant.bristle
    assert own is not None
    part, reach = own.coulomb / len(LINKS), own.coulomb / own.stiffness
    elements = tuple(Element(place * reach, part) for place in LINKS)
    damping = 2.0 * DAMPED * math.sqrt(own.stiffness * axis.plant.inertia)
    plant = replace(
        axis.plant, bristle=None, micro_damping=damping, elements=(*elements, *axis.plant.elements)
    )
    return play(replace(axis, plant=plant), seed)


@pytest.mark.slow(12)
def test_a_chain_of_contacts_that_are_damped_while_they_stick_is_a_law_of_the_base() -> None:
    recording = chain(45, {})
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("none", ())
    assert any("another curve than the exponential" in note for note in found.notes)
    assert found.root is not None
    assert found.root.fitted.packed.p[DAMPING] > found.root.fitted.packed.p[MICRO_DAMPING]
    made = found_model(found, base_model(NOMINAL), "2024-05-01", "bench")
    assert made is not None
    assert made.error_after < 0.9 * made.error_before


@pytest.mark.long
@pytest.mark.parametrize("law", ["fades", "chain"])
def test_a_model_that_has_the_law_asks_for_none(law: str) -> None:
    if law == "fades":
        _, recording = axis_and_recording(43, {}, fading_velocity=0.3)
    else:
        recording = chain(45, {})
    made = found_model(diagnose([recording], base_model(NOMINAL)), base_model(NOMINAL), "2024-05-01", "bench")
    assert made is not None
    again = diagnose([recording], made.model)
    assert again.verdict == "none"
    assert law != "fades" or again.base == ()


@pytest.mark.long
def test_an_effect_is_named_beside_such_a_chain() -> None:
    found = diagnose([chain(48, {"nonlinear_viscous": 0.02})], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("named", ("nonlinear_viscous",))


def many(seed: int, effects: dict[str, float]) -> Recording:
    """A plain axis whose friction is a sum of undamped contacts, none of which is a bristle (Maxwell slip).

    They let go over nearly two decades, and their virgin curve falls off as a power of the way.
    """
    axis = plain_axis(seed, effects)
    own = axis.plant.bristle
    assert own is not None
    places = np.geomspace(0.1, 6.5, 9)
    slopes = (1.0 + np.append(np.sqrt(places[1:] * places[:-1]), np.inf) / 6.0) ** -7.0
    carried = -np.diff(np.append(1.0, slopes)) * places
    reach = own.coulomb / own.stiffness
    shares = own.coulomb * carried / carried.sum()
    elements = tuple(Element(float(x) * reach, float(w)) for x, w in zip(places, shares, strict=True))
    plant = replace(axis.plant, bristle=None, elements=(*elements, *axis.plant.elements))
    return play(replace(axis, plant=plant), seed)


@pytest.mark.slow(15)
def test_friction_of_many_contacts_is_a_law_of_the_base_and_no_memory() -> None:
    recording = many(51, {})
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("none", ())
    assert any("small loops close" in note for note in found.notes)
    made = found_model(found, base_model(NOMINAL), "2024-05-01", "bench")
    assert made is not None
    assert made.error_after < 0.9 * made.error_before


@pytest.mark.parametrize(
    ("effect", "size"),
    [
        # a memory that goes on beyond them is one
        pytest.param("reversal_memory", 0.06, marks=pytest.mark.slow(20)),
        pytest.param("nonlinear_viscous", 0.02, marks=pytest.mark.long),
    ],
)
def test_an_effect_is_named_beside_many_contacts(effect: str, size: float) -> None:
    found = diagnose([many(52, {effect: size})], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("named", (effect,))


@pytest.mark.slow(20)
def test_friction_of_many_contacts_falls_in_all_of_them() -> None:
    """Stribeck friction in the base: beside a bristle that is next to nothing it would leave what elements have."""
    own = many(53, {"stribeck": 0.1})
    values = {"break_away": 1.2 * NOMINAL["coulomb"], "stribeck_velocity": 0.3}
    found = diagnose([own], base_model(NOMINAL).with_effect(STRIBECK.make(values)))
    assert (found.verdict, found.effects) == ("none", ())
    assert found.root is not None
    assert found.root.fitted.packed.p[ATTRACTION] > 0.0
    assert found.root.fitted.packed.p[COULOMB] < 0.05 * NOMINAL["coulomb"]


@pytest.mark.slow(12)
def test_a_contact_that_is_elastic_at_first_bends_by_a_curve_of_its_own() -> None:
    true, recording = axis_and_recording(50, {}, sticks=0.55)
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("none", ())
    assert any("bends by another curve" in note for note in found.notes)
    known = known_within(found)
    assert abs(known["stiffness"][0] - true.stiffness) < 0.05 * true.stiffness
    assert known["bends_35"][0] > 0.85
    made = found_model(found, base_model(NOMINAL), "2024-05-01", "bench")
    assert made is not None
    assert made.error_after < 0.9 * made.error_before
    assert made.model["bends_35"] == pytest.approx(known["bends_35"][0])
    assert diagnose([recording], made.model).base == ()


@pytest.mark.long
def test_an_effect_is_named_beside_such_a_contact() -> None:
    _, recording = axis_and_recording(51, {"nonlinear_viscous": 0.02}, sticks=0.55)
    found = diagnose([recording], base_model(NOMINAL))
    assert (found.verdict, found.effects) == ("named", ("nonlinear_viscous",))


def falling(bristle: Bristle) -> DriveModel:
    """A model whose base has Stribeck friction, by the Gaussian curve."""
    values = {"break_away": 1.2 * NOMINAL["coulomb"], "stribeck_velocity": bristle.velocity}
    return base_model(NOMINAL).with_effect(STRIBECK.make(values))


@pytest.mark.slow(12)
def test_friction_in_the_base_that_falls_by_another_curve_is_shaped_first() -> None:
    true, recording = axis_and_recording(44, {}, break_away=0.33, exponent=1.0)
    found = diagnose([recording], falling(true))
    assert (found.verdict, found.effects) == ("none", ())
    assert any("another curve" in note for note in found.notes)
    known = known_within(found)
    for name, value in (("stribeck_exponent", 1.0), ("break_away", true.break_away)):
        assert abs(known[name][0] - value) < ERRORS * known[name][1] + 0.02 * value
    made = found_model(found, falling(true), "2024-05-01", "bench")
    assert made is not None
    assert made.model["stribeck_exponent"] == pytest.approx(known["stribeck_exponent"][0])


@pytest.mark.slow(60)
def test_an_effect_keeps_its_name_whatever_friction_at_once_leaves_near_reversals() -> None:
    """The same rest near reversals in every repeat, as no law of presliding follows: half of all that comes again."""
    told = diagnose([at_once(48, {"nonlinear_viscous": 0.02})], base_model(NOMINAL))
    assert (told.verdict, told.effects) == ("named", ("nonlinear_viscous",))
    problem, root, named = told.problem, told.root, told.model_fit
    assert problem is not None
    assert root is not None
    assert named is not None
    sliding = beyond_presliding(problem, root.fitted.packed)
    assert sliding is not None
    near = (sliding.weight == 0.0) & (problem.weight > 0.0)
    lost = problem.mean_square(root.fitted.error, TRAINING) - problem.mean_square(
        named.fitted.error, TRAINING
    )
    rest = math.sqrt(0.6 * lost / float(np.mean(near[problem.training > 0]))) * near
    evidence = evidence_of(problem.data)
    root, named = (
        replace(one, fitted=replace(one.fitted, error=one.fitted.error + rest)) for one in (root, named)
    )
    chosen = judged(problem, root, named, "nonlinear_viscous")
    assert problem.policy.partly < chosen.share < problem.policy.named
    search = SearchState(problem, root, root.fitted.packed, no_progress, evidence)
    found = where_it_slides(search, Found(problem, root, chosen, (), (), {}))
    assert found.sliding is not None
    assert found.chosen is not None
    assert found.chosen.named


@pytest.mark.parametrize(
    ("velocity", "steady", "least"),
    [
        (0.5, False, 0.01),
        (0.004, False, 0.004),  # a model that was given is not moved
        (0.5, True, 1e-7),  # speeds of a curve lie decades apart
    ],
)
def test_friction_that_has_fallen_at_the_slowest_motion_is_not_fitted(
    velocity: float, steady: bool, least: float
) -> None:
    """Where a second mass was missing, a fit led the Stribeck velocity to 1e-7 of what moves, and it stayed there."""
    scales = Scales(torque=1.0, velocity=10.0, travel=1.0, acceleration=1.0, seconds=1.0, steady=steady)
    values = {"break_away": 1.2, "stribeck_velocity": velocity}
    free = free_of_model(base_model(NOMINAL).with_effect(STRIBECK.make(values)), scales)
    (found,) = (one for one in free if one.slot == STRIBECK.slot("stribeck_velocity"))
    assert found.lower == pytest.approx(least)
