"""What the elements of a memory say together: how drawn out the climb of friction is, and what damps them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.models import layout
from autotune.models.contact import elements_carry
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.inverse import required
from autotune.models.model_file import model_text, parse_model, read_model, write_model
from autotune.models.reversal_memory import (
    A_BRISTLE_FORGETS,
    AT_ONCE,
    ATTRACTION,
    DAMPING,
    ELEMENT_STATES,
    REMEMBERS,
    REVERSAL_MEMORY,
    beyond_a_decade,
    climbing,
    closes_loops,
    contact,
    drawn_out,
    forgotten,
    memory_damping,
    memory_torque,
    of_many_contacts,
    of_one_contact,
    share_damping,
    shows_course,
    stands_alone,
    with_level,
)
from autotune.models.stribeck import STRIBECK
from autotune.models.table import EFFECTS
from autotune.models.total_friction import damping_at_rest
from tests.support.axes import NOMINAL


@pytest.mark.parametrize(
    ("coulomb", "elements", "least", "most"),
    [
        (1.0, [], 1.0, 1.0),  # the bristle's own exponential
        (1e-6, [(1.0, 1.0)], 0.38, 0.40),  # straight up, then slides: 0.9 of the way, over ln 10
        (0.3, [(1.0, 0.7)], 0.4, 0.9),
        (1e-3, [(1.0, 0.8), (1.4, 0.2), (100.0, 0.01)], 0.38, 0.6),  # a far element next to nothing
        (1.0, [(4.0, 0.1)], 1.02, 1.2),  # a weak memory, hardly longer than the bristle
        (1.0, [(6.0, 0.3), (30.0, 0.2)], 1.5, 3.0),
    ],
)
def test_a_memory_draws_the_climb_out_and_one_contact_does_not(
    coulomb: float, elements: list[tuple[float, float]], least: float, most: float
) -> None:
    """Against a bristle that reaches its level along 1 (in the unit of the elements' displacements)."""
    p = base_model(NOMINAL).pack().p
    p[layout.COULOMB], p[layout.STIFFNESS] = coulomb, min(coulomb, 1e-2 if coulomb < 0.1 else coulomb)
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert least - 1e-9 <= drawn_out(p) <= most + 1e-9


@pytest.mark.parametrize(
    ("coulomb", "elements", "one"),
    [
        (1.0, [], True),
        (0.8, [(0.05, 0.2)], True),  # a part that is there at once: far stiffer at rest, no longer on its way
        (0.75, [(0.1, 0.1), (0.5, 0.15)], True),
        (
            1e-3,
            [(0.3, 0.2), (0.6, 0.3), (1.0, 0.3), (1.5, 0.2)],
            True,
        ),  # a chain that ends where a bristle's climb does
        (0.95, [(8.0, 0.05)], False),  # a twentieth of all friction, where a bristle has come to its level
        (0.8, [(0.05, 0.15), (20.0, 0.05)], False),
        (0.7, [(2.0, 0.1), (8.0, 0.1), (32.0, 0.1)], False),
    ],
)
def test_elements_are_of_one_contact_where_friction_goes_on_no_longer_than_a_bristle(
    coulomb: float, elements: list[tuple[float, float]], one: bool
) -> None:
    p = base_model(NOMINAL).pack().p
    p[layout.COULOMB], p[layout.STIFFNESS] = coulomb, coulomb
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert of_one_contact(p) is one


MASING = [(0.15, 0.05), (0.4, 0.12), (1.0, 0.3), (2.4, 0.35), (4.2, 0.08), (6.1, 0.1)]
"""Contacts that let go one after another, over a decade and a half."""


@pytest.mark.parametrize(
    ("coulomb", "elements", "many"),
    [
        (1e-3, MASING, True),
        (0.05, MASING, True),  # a twentieth is a bristle still
        (1e-3, [*MASING, (60.0, 0.05)], False),  # goes on far beyond them: memory
        (1.0, [], False),
        (0.9, [(2.0, 0.02), (4.5, 0.03), (10.0, 0.03)], False),  # beside a contact that forgets
        (0.7, [(2.0, 0.1), (8.0, 0.1), (32.0, 0.1)], False),
        (2.0, MASING, False),
    ],
)
def test_many_contacts_close_small_loops_and_a_bristle_does_not(
    coulomb: float, elements: list[tuple[float, float]], many: bool
) -> None:
    p, on = base_model(NOMINAL).pack().p, base_model(NOMINAL).pack().on.copy()
    p[layout.COULOMB], p[layout.STIFFNESS] = coulomb, coulomb
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert of_many_contacts(p) is many
    on[REMEMBERS] = True
    if many:
        assert forgotten(p) == pytest.approx(0.0, abs=0.01)
        assert contact(p, on)[0] == pytest.approx(coulomb + sum(one for _, one in elements))


def test_a_bristle_is_off_where_a_small_loop_should_close() -> None:
    p = base_model(NOMINAL).pack().p
    assert forgotten(p) == pytest.approx(A_BRISTLE_FORGETS, abs=1e-4)


@pytest.mark.parametrize(
    ("elements", "kept"),
    [
        ([(1.0, 1.0)], [1]),
        ([(0.8, 0.5), (1.4, 0.5)], [1, 2]),
        (
            [(1.0, 0.94), (35.0, 0.03), (110.0, 0.03)],
            [1],
        ),  # a twentieth of all friction, but far beyond the contact
    ],
)
def test_elements_that_go_on_beyond_the_contact_are_memory(
    elements: list[tuple[float, float]], kept: list[int]
) -> None:
    p = base_model(NOMINAL).pack().p
    p[layout.COULOMB], p[layout.STIFFNESS] = 1e-3, 1e-3
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    numbers, way = climbing(p)
    assert numbers == kept
    assert way == pytest.approx(
        5.0, rel=0.1
    )  # five times level over stiffness, which is about 1 in all of these


@pytest.mark.parametrize(
    ("elements", "forgets", "kept"),
    [
        (
            [(0.37, 0.45), (1.85, 0.29), (9.2, 0.26)],
            0.0,
            [1, 2, 3],
        ),  # three contacts, and nothing beside them
        ([(0.44, 0.11), (0.82, 0.22), (1.51, 0.27), (2.78, 0.28), (5.8, 0.12)], 0.0, [1, 2, 3, 4, 5]),
        ([(0.37, 0.45), (1.85, 0.29), (12.0, 0.26)], 0.0, [1, 2]),  # beyond a decade
        ([(0.37, 0.1), (1.85, 0.1), (9.2, 0.05)], 3.0, [1, 2]),  # beside a bristle, which forgets
    ],
)
def test_elements_within_a_decade_are_the_contact_where_no_part_of_it_forgets(
    elements: list[tuple[float, float]], forgets: float, kept: list[int]
) -> None:
    """Whether their virgin curve comes to its level as soon as one contact's, as the first two do, does not matter."""
    p = base_model(NOMINAL).pack().p
    p[layout.COULOMB] = max(forgets * sum(torque for _, torque in elements), 1e-3)
    p[layout.STIFFNESS] = p[layout.COULOMB]
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert closes_loops(p) is (forgets == 0.0)
    assert climbing(p)[0] == kept


JOINED = [(0.67, 0.12), (0.99, 0.56), (2.7, 0.07), (5.9, 0.19), (11.4, 0.06)]
"""Contacts over a decade and a half: more than a hundredth is left beyond ten times the way to two thirds."""


@pytest.mark.parametrize(
    ("elements", "attraction", "many"),
    [
        (JOINED, AT_ONCE, True),  # in the place of the bristle
        (JOINED, 0.0, False),  # beside one: they may be an effect
        ([*JOINED, (80.0, 0.05)], AT_ONCE, False),  # a gap of seven: something else
        ([*JOINED, (30.0, 0.005), (80.0, 0.05)], AT_ONCE, False),  # next to nothing bridges no gap
        ([*JOINED[:3], (60.0, 0.25)], AT_ONCE, False),
    ],
)
def test_contacts_that_join_each_other_without_a_gap_are_one_base(
    elements: list[tuple[float, float]], attraction: float, many: bool
) -> None:
    p = base_model(NOMINAL).pack().p
    p[layout.COULOMB], p[layout.STIFFNESS], p[ATTRACTION] = 1e-3, 1e-1, attraction
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert beyond_a_decade(p)
    assert closes_loops(p)
    assert of_many_contacts(p) is many
    numbers, way = climbing(p)
    assert (len(numbers) == len(elements)) is many
    assert not many or way == pytest.approx(11.4)


def slid(p: Floats, state: Floats, more: float, duration: float) -> float:
    """What elements carry that are pushed on over a way longer than all of them have."""
    return memory_torque(p, state, ELEMENT_STATES, 1.0, more, duration)


@pytest.mark.parametrize(("attraction", "part"), [(50.0, math.exp(-0.5)), (AT_ONCE, 0.0), (0.0, 0.0)])
def test_elements_of_a_contact_follow_its_level_and_come_down_to_it_in_their_time(
    attraction: float, part: float
) -> None:
    p, state = memory(attraction=attraction).pack().p, np.zeros(layout.STATES)
    whole = 0.13
    raised = 1.4 if attraction > 0.0 else 1.0
    assert slid(p, state, 1.4, 0.01) == pytest.approx(raised * whole)
    assert slid(p, state, 1.0, 0.01) == pytest.approx((1.0 + (raised - 1.0) * part) * whole)
    held = slid(p, state, 1.4, 0.01)
    assert memory_torque(p, state, ELEMENT_STATES, -1e-4, 1.4, 0.01) == pytest.approx(
        held - 40.0 * 1e-4
    )  # turned, all unload


@pytest.mark.parametrize(("attraction", "shared"), [(AT_ONCE, True), (0.0, False)])
def test_what_is_added_to_the_level_is_added_once_whoever_carries_it(attraction: float, shared: bool) -> None:
    """Friction while all slides is the same; in presliding a contact of elements goes further before it slides."""
    falls = {"break_away": 0.05 + NOMINAL["coulomb"], "stribeck_velocity": 0.1}
    model = memory(attraction=attraction).with_effect(STRIBECK.make(falls))
    packed, state = model.pack(), np.zeros(layout.STATES)
    speed, way = 1e-4, np.arange(10_000) * 1e-5
    torque = np.zeros(len(way))
    required(packed.p, packed.on, state, way, np.full(len(way), speed), 0.0 * way, 0.1, 1, torque)
    whole = NOMINAL["coulomb"] + 0.05 + 0.13
    assert torque[-1] == pytest.approx(
        whole + NOMINAL["viscous"] * speed + NOMINAL.get("offset", 0.0), rel=1e-6
    )
    carried = memory_torque(
        packed.p, state, ELEMENT_STATES, 0.0, elements_carry(packed.p, packed.on, state, speed), 0.1
    )
    rise = 0.05 / (NOMINAL["coulomb"] + 0.13)
    assert carried == pytest.approx(0.13 * (1.0 + rise if shared else 1.0), rel=1e-5)


@pytest.mark.parametrize(("attraction", "behind"), [(AT_ONCE, True), (0.0, False)])
def test_the_elements_of_a_contact_are_behind_a_gap_with_its_friction(
    attraction: float, behind: bool
) -> None:
    """A motor swings in the gap before a load with all friction: what is the contact is not moved, a memory is.

    Beyond the gap a slow motion carries the friction of both sides, whoever has it.
    """
    gap = {"gap": 0.2, "contact_compliance": 1e-4, "load_inertia": 0.4, "load_friction": 1.0, "damping": 0.3}
    slack = memory(attraction=attraction, damping=0.01).with_effect(EFFECTS["backlash"].make(gap))
    packed, time = slack.pack(), np.arange(4000) * 1e-3
    swing = 0.05 * np.sin(2.0 * np.pi * time)
    torque = slack.torque(swing, np.gradient(swing, 1e-3), 0.0 * time, 1e-3) - packed.p[layout.OFFSET]
    elements = DAMPED["torque_1"] + DAMPED["torque_2"]
    assert np.ptp(torque[1000:]) == pytest.approx(
        0.0 if behind else 2.0 * elements, rel=0.05, abs=0.02 * elements
    )
    way = 0.5 * time
    on = slack.torque(way, np.full(len(way), 0.5), 0.0 * time, 1e-3) - packed.p[layout.OFFSET]
    friction = NOMINAL["coulomb"] + elements + 0.5 * NOMINAL["viscous"]
    assert on[-1] == pytest.approx(friction, rel=0.01)


def test_a_contact_of_elements_on_both_sides_of_a_hard_spring_is_that_of_one_mass() -> None:
    spring = {"compliance": 1e-4, "load_inertia": 0.4, "load_friction": 0.6, "damping": 0.5}
    rigid = memory(attraction=AT_ONCE, damping=0.01)
    parted = rigid.with_effect(EFFECTS["elastic_transmission"].make(spring))
    time = np.arange(3000) * 1e-3
    place = 0.05 * np.sin(2.0 * np.pi * time)
    motion = (place, np.gradient(place, 1e-3), -((2.0 * np.pi) ** 2) * place, 1e-3)
    whole = NOMINAL["coulomb"] + DAMPED["torque_1"] + DAMPED["torque_2"]
    np.testing.assert_allclose(parted.torque(*motion)[500:], rigid.torque(*motion)[500:], atol=0.02 * whole)


DAMPED = {"displacement_1": 1e-3, "torque_1": 0.03, "displacement_2": 0.01, "torque_2": 0.1, "damping": 0.08}
"""30 and 10 N m/rad: three quarters and one quarter of the damping."""


def memory(**changed: float) -> DriveModel:
    values = {name: value for name, value in (DAMPED | changed).items() if not math.isnan(value)}
    return base_model(NOMINAL).with_effect(REVERSAL_MEMORY.make(values))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("bent", "way", "damping"),
    [
        (0.0, 5e-4, 0.08),  # all stick
        (0.0, 2e-3, 0.06 * 0.5 + 0.02),  # the first slides from half of the way on
        (1e-3, 1e-4, 0.02),  # it slides already
        (1e-3, -1e-4, 0.08),  # turned: it sticks again
        (0.0, 0.1, 0.06 * 0.01 + 0.02 * 0.1),
        (1e-3, 0.0, 0.08),  # nothing moves, nothing slides
    ],
)
def test_an_element_damps_while_it_sticks(bent: float, way: float, damping: float, sign: float) -> None:
    p, state = memory().pack().p, np.zeros(layout.STATES)
    memory_torque(p, state, ELEMENT_STATES, sign * bent, 1.0, 1e-3)
    assert memory_damping(p, state, ELEMENT_STATES, sign * way, 1.0) == pytest.approx(damping, rel=1e-9)


def test_the_torque_of_a_small_motion_has_the_damping_of_all_elements() -> None:
    """σ·v where all stick: by the model with it less the one without; none where all slide."""
    period, count = 1e-3, 400
    time = period * np.arange(count)
    for size, left in ((2e-4, 0.08), (0.5, 0.0)):
        rate = 2.0 * math.pi * 5.0
        position, velocity = size * np.sin(rate * time), size * rate * np.cos(rate * time)
        motion = (position, velocity, -(rate**2) * position, period)
        more = memory().torque(*motion) - memory(damping=0.0).torque(*motion)
        fast = (np.abs(velocity) > 0.5 * size * rate) & (
            time > 0.05
        )  # away from the start, and from where it turns
        np.testing.assert_allclose(more[fast], left * velocity[fast], atol=0.02 * 0.08 * size * rate)


def test_a_tight_spot_is_one_for_the_elements_too() -> None:
    """All dry friction is higher there, bristle and elements alike, after travel along which all of them slide."""
    spot = {"height": 0.3, "centre": 0.5, "width": 0.1}
    tight = memory(damping=0.0).with_effect(EFFECTS["position_dependent_friction"].make(spot))
    position = np.arange(1000) * 1e-3
    motion = (position, np.full(1000, 1.0), np.zeros(1000), 1e-3)
    more = tight.torque(*motion) - memory(damping=0.0).torque(*motion)
    friction = NOMINAL["coulomb"] + DAMPED["torque_1"] + DAMPED["torque_2"]
    assert more[500] == pytest.approx(0.3 * friction, rel=0.01)
    assert more[900] == pytest.approx(0.0, abs=1e-6 * friction)


def test_a_model_of_before_reads_as_before_and_moves_as_before(tmp_path: Path) -> None:
    """Without the damping of elements a file has no such key, and the torque is that of none."""
    old = memory(damping=math.nan)
    assert "damping" not in model_text(old).partition("[effects")[2]
    assert REVERSAL_MEMORY.surface("damping") not in parse_model(model_text(old)).parameters
    position = 0.05 * np.sin(0.02 * np.arange(500))
    motion = (position, np.gradient(position, 1e-3), np.zeros(500), 1e-3)
    np.testing.assert_array_equal(old.torque(*motion), memory(damping=0.0).torque(*motion))
    write_model(replace(memory(), damping_error=0.004), tmp_path / "model.toml")
    back = read_model(tmp_path / "model.toml")
    assert back.parameters == memory().parameters
    assert back.damping_error == 0.004
    assert back.with_values({"micro_damping": 0.1}).damping_error is None


def test_the_damping_at_rest_is_that_of_bristle_and_elements() -> None:
    bristle = NOMINAL["micro_damping"]
    assert damping_at_rest(memory()) == pytest.approx(bristle + 0.08)
    assert damping_at_rest(memory(damping=math.nan)) == bristle
    packed = memory(damping=math.nan).pack()
    share_damping(packed.p, packed.on)
    shared = packed.p[DAMPING] / bristle
    assert shared == pytest.approx(40.0 / (40.0 + NOMINAL["stiffness"]))
    assert packed.p[layout.MICRO_DAMPING] + packed.p[DAMPING] == pytest.approx(bristle)


def _bent(yielding: float, begin: float, way: float, number: int = 1) -> float:
    """How far an element is bent after a way."""
    p, state = memory(yielding=yielding).pack().p, np.zeros(layout.STATES)
    at = layout.state_block("reversal_memory") + number - 1
    state[at] = begin
    memory_torque(p, state, ELEMENT_STATES, way, 1.0, 1e-3)
    return float(state[at])


@pytest.mark.parametrize("yielding", [0.05, 0.4, 1.0])
def test_an_element_that_yields_follows_its_equation(yielding: float) -> None:
    """dz = dq·(1 − b·s·z/d) until it slides, in small steps; one step of any length comes to the same place."""
    limit, small = DAMPED["displacement_1"], 2e-8
    for begin, way in ((0.0, 6e-4), (0.0, -6e-4), (8e-4, -1.5e-3), (-9e-4, 4e-4)):
        bend = begin
        for _ in range(round(abs(way) / small)):
            step = math.copysign(small, way)
            bend += step * (1.0 - yielding * math.copysign(1.0, way) * bend / limit)
        assert _bent(yielding, begin, way) == pytest.approx(bend, abs=1e-3 * limit)


def test_elements_that_yield_forget_on_the_way_what_others_keep() -> None:
    """Small swings after a long way: what slides keeps what it carries, what yields comes to the middle of its loop."""
    left = []
    for yielding in (0.0, 1.0):
        p, state = memory(yielding=yielding).pack().p, np.zeros(layout.STATES)
        memory_torque(p, state, ELEMENT_STATES, 0.1, 1.0, 1e-3)
        swings = [memory_torque(p, state, ELEMENT_STATES, step, 1.0, 1e-3) for step in [-1e-4, 1e-4] * 1000]
        left.append(sum(swings[-2:]) / (DAMPED["torque_1"] + DAMPED["torque_2"]) / 2.0)
    assert left[0] > 0.9
    assert left[1] == pytest.approx(0.0, abs=0.02)


def test_a_yielding_contact_of_one_element_climbs_as_a_bristle_does() -> None:
    p = base_model(NOMINAL).pack().p
    p[layout.COULOMB], p[layout.STIFFNESS] = 1e-6, 1e-2
    for name, value in (("displacement_1", 1.0), ("torque_1", 1.0), ("yielding", 1.0)):
        p[REVERSAL_MEMORY.slot(name)] = value
    assert drawn_out(p) == pytest.approx(1.0, rel=0.02)


def test_yielding_elements_are_damped_less_the_further_they_are_bent() -> None:
    p, state = memory(yielding=0.5).pack().p, np.zeros(layout.STATES)
    bent = [_bent(0.5, 0.0, 5e-4, number) / DAMPED[f"displacement_{number}"] for number in (1, 2)]
    memory_torque(p, state, ELEMENT_STATES, 5e-4, 1.0, 1e-3)
    expected = 0.06 * (1.0 - 0.5 * bent[0]) + 0.02 * (1.0 - 0.5 * bent[1])
    assert memory_damping(p, state, ELEMENT_STATES, 1e-6, 1.0) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("long", "carries", "shown"), [(0.2, 0.5, True), (0.3, 0.5, False), (1.2, 0.5, False), (1.2, 0.01, True)]
)
def test_an_element_that_is_bent_over_most_of_the_travel_follows_the_place(
    long: float, carries: float, shown: bool
) -> None:
    """Over a travel of 1; one that hardly carries anything says nothing of the others."""
    p = base_model(NOMINAL).pack().p
    for number, (displacement, torque) in enumerate([(0.01, 0.5), (long, carries)], 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert shows_course(p, 1.0) is shown


@pytest.mark.parametrize(
    ("coulomb", "elements", "attraction", "alone"),
    [
        (1e-3, JOINED, 0.0, True),  # a wide contact, found beside a bristle that carries next to nothing
        (1e-3, JOINED, AT_ONCE, True),
        (
            1e-3,
            [*JOINED, (80.0, 0.05)],
            0.0,
            False,
        ),  # beyond a gap they are a memory, whatever the contact is
        (5.0, JOINED, 0.0, False),  # most of all friction forgets
        (20.0, JOINED, 0.0, False),
    ],
)
def test_a_memory_stands_alone_where_nothing_beside_it_forgets(
    coulomb: float, elements: list[tuple[float, float]], attraction: float, alone: bool
) -> None:
    p, on = base_model(NOMINAL).pack().p, base_model(NOMINAL).pack().on.copy()
    p[layout.COULOMB] = p[layout.STIFFNESS] = coulomb
    p[ATTRACTION] = attraction
    for number, (displacement, torque) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = displacement
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = torque
    assert not stands_alone(p, on), "there are no elements"
    on[REMEMBERS] = True
    assert stands_alone(p, on) is alone


@pytest.mark.parametrize(
    ("elements", "own"),
    [([(0.5, 0.5)], True), ([(6.0, 0.3), (30.0, 0.2)], False)],
    ids=["contact", "memory"],
)
def test_the_level_of_a_contact_is_carried_by_its_own_elements_too(
    elements: list[tuple[float, float]], own: bool
) -> None:
    """Elements beside a contact, which go on beyond it, keep what they carry."""
    packed = base_model(NOMINAL).pack()
    p, on = packed.p.copy(), packed.on.copy()
    on[REMEMBERS] = True
    for number, (far, part) in enumerate(elements, 1):
        p[REVERSAL_MEMORY.slot(f"displacement_{number}")] = far * p[layout.COULOMB] / p[layout.STIFFNESS]
        p[REVERSAL_MEMORY.slot(f"torque_{number}")] = part * p[layout.COULOMB]
    raised = with_level(p, on, 1.1)
    assert contact(raised, on)[0] == pytest.approx(1.1 * contact(p, on)[0])
    carried = REVERSAL_MEMORY.slot("torque_1")
    assert raised[carried] == pytest.approx((1.1 if own else 1.0) * p[carried])
    assert p[layout.COULOMB] == packed.p[layout.COULOMB], "a copy"
