"""The simulator itself: pytest bench/worlds (not part of `make test`, whose tests know nothing of bench)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import autotune
from bench.worlds import cases, names, planting
from bench.worlds.draw import draw_world, with_base
from bench.worlds.hysteresis import rub
from bench.worlds.judge import lateness
from bench.worlds.laws import faded, pulled
from bench.worlds.lone import changed
from bench.worlds.loop import LAG_TICKS, late
from bench.worlds.names import EFFECTS, LAG, LAWS, LOAD, RIPPLE, SPRING, STRIBECK
from bench.worlds.plant import STATES, rigid
from bench.worlds.play import recording, run
from bench.worlds.programme import Programme, programme, scale_of
from bench.worlds.steady import chatters
from bench.worlds.table import table
from bench.worlds.world import Planted, World

STEP = 15e-6


def quiet(seed: int = 3, **plant: float) -> World:
    """A drawn world with one bristle and no offset."""
    world = draw_world(seed, cycle=1e-3)
    return replace(world, plant=replace(world.plant, **({"other": 0.0, "offset": 0.0} | plant)))


def short(world: World) -> Programme:
    """A quick back and forth of two seconds or so."""
    s = scale_of(world)
    path = np.concatenate(
        [s.rest(0.0, 0.3), s.move(0, 0.8 * s.half, 0.5), s.move(0.8 * s.half, 0, 0.2), s.rest(0, 0.2)]
    )
    return Programme(path, np.full(len(path), "scans"), np.zeros(len(path), dtype=np.int64))


def pushed(world: World, torques: np.ndarray, speed: float = 0.0) -> np.ndarray:
    """States after each step under torques, shape (n, STATES)."""
    law, e, waves = world.laws()
    state, out = np.zeros(STATES), np.zeros((len(torques), STATES))
    state[1] = speed
    for k, torque in enumerate(torques):
        rigid(world.plant.packed(), law, e, waves, state, torque, 0.0, STEP, 0, np.zeros(10))
        out[k] = state
    return out


def test_coasting_stops_where_its_energy_is_rubbed_away() -> None:
    world = quiet(viscous=0.0, micro=0.0)
    plant = world.plant
    speed = 0.3 * plant.top_speed
    way = plant.inertia * speed**2 / (2.0 * plant.coulomb)
    seconds = plant.inertia * speed / plant.coulomb
    states = pushed(world, np.zeros(int(1.2 * seconds / STEP)), speed)
    # The bristle gives back at most half of what it holds and takes a reach to be bent.
    assert states[:, 0].max() == pytest.approx(way, rel=0.01, abs=1.5 * plant.reach)


def test_without_friction_a_torque_gives_its_acceleration() -> None:
    world = quiet(viscous=0.0, micro=0.0, coulomb=1e-12)
    torque = 0.5 * world.plant.inertia * world.hard
    states = pushed(world, np.full(20_000, torque))
    assert states[-1, 1] == pytest.approx(0.5 * world.hard * 20_000 * STEP, rel=1e-6)


@pytest.mark.parametrize("rise", [0.0, 0.4])
def test_breaks_away_at_its_level(rise: float) -> None:
    world = quiet()
    plant = world.plant
    world = replace(world, planted=(Planted(STRIBECK, 1, (rise * plant.coulomb, 0.02 * plant.top_speed)),))
    level = (1.0 + rise) * plant.coulomb
    ramp = np.linspace(0.0, 1.3 * level, 150_000)
    states = pushed(world, ramp)
    gone = ramp[np.argmax(np.abs(states[:, 0]) > 12.0 * plant.reach)]
    # Creeping through the reaches takes it down the falling curve by a few per cent; the ramp goes on meanwhile.
    assert 0.9 * level < gone < 1.18 * level


@pytest.mark.parametrize("family", [0, 1, 2])
def test_hysteresis_dissipates_and_stays_in_its_level(family: int) -> None:
    p = quiet(family=float(family), other=1.0).plant.packed()
    state, way = np.zeros(10), 4.0 * p[names.REACH] * np.sin(np.linspace(0, 6 * math.pi, 4000))
    steps = np.diff(way)
    stretch = np.array([rub(p, state, float(step), 1.0) for step in steps])
    assert np.abs(stretch).max() <= 1.0 + 1e-9
    assert (
        np.sum((stretch * steps)[-1333:]) > 4.0 * p[names.REACH]
    )  # a cycle of ±4 reaches at level 1 rubs up to 16


def test_reading_is_in_whole_counts() -> None:
    world = quiet()
    reading = run(world, short(world), 1).reading / world.plant.resolution
    assert np.allclose(reading, np.rint(reading), atol=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_loops_are_stable_and_follow(seed: int) -> None:
    world = draw_world(seed)
    what = short(world)
    played = run(world, what, 0)
    late = world.plant.top_speed * (4.0 / world.loop.bandwidth + 5.0 * world.loop.period)
    assert np.abs(played.place - what.reference).max() < min(
        0.6 * late + 30 * world.plant.reach, world.plant.travel
    )
    assert np.abs(played.demand).max() < world.plant.limit


@pytest.mark.parametrize(("effect", "law"), [(i, law + 1) for i in range(16) for law in range(LAWS[i])])
def test_every_law_shows_and_vanishes_with_its_size(effect: int, law: int) -> None:
    world = next(w for w in map(quiet, range(3, 40)) if EFFECTS[effect] in planting.possible(w))
    seed = planting.seedling(world, EFFECTS[effect], law, np.random.default_rng(1))
    what = short(world)
    plain = run(world, what, 0, noisy=False)
    two_masses = EFFECTS[effect] in ("backlash", "elastic_transmission")  # they stay two, however stiff
    shares = (1.0, 0.1 if two_masses else 1e-6)
    large, small = (run(seed.at(world, share * seed.start), what, 0, noisy=False) for share in shares)
    differs = [float(np.abs(played.mean - plain.mean).max()) for played in (large, small)]
    assert differs[0] > 1e-3 * world.plant.coulomb or float(np.abs(large.reading - plain.reading).max()) > 0
    if not two_masses:
        assert differs[1] < 2e-2 * max(differs[0], 1e-3 * world.plant.coulomb)


def test_torque_of_a_spring_is_its_law() -> None:
    world = quiet()
    planted = Planted(SPRING, 1, (0.5 * world.plant.coulomb, world.plant.travel, 0.4))
    what = short(world)
    one, two = (run(w, what, 0, noisy=False) for w in (world, replace(world, planted=(planted,))))
    asked = np.array([pulled(1, np.array(planted.e), x) for x in two.place])
    rows = slice(len(asked) // 3, None)
    assert np.corrcoef((two.mean - one.mean)[rows], asked[rows])[0, 1] > 0.98


def test_orders_are_no_whole_numbers() -> None:
    orders = []
    for seed in range(30):
        world = draw_world(seed)
        planted = planting.seedling(world, "torque_ripple", 1, np.random.default_rng(seed)).build(1.0)
        assert planted.effect == RIPPLE
        orders += [wave[1] for wave in planted.waves]
    assert min(abs(order - round(order)) for order in orders) > 0.0


def test_cases_and_recordings_are_the_same_for_a_seed(tmp_path) -> None:  # type: ignore[no-untyped-def]
    batch = cases.draw_batch(7, {"single": 3, "pair": 2})
    assert cases.batch_hash(batch) == cases.batch_hash(cases.draw_batch(7, {"single": 3, "pair": 2}))
    assert cases.batch_hash(batch) != cases.batch_hash(cases.draw_batch(8, {"single": 3, "pair": 2}))
    world = quiet()
    one, two = recording(world, short(world), 5), recording(world, short(world), 5)
    assert np.array_equal(one["torque"], two["torque"])
    autotune.write_recording(one, tmp_path / "world.parquet")
    assert np.array_equal(autotune.read_recording(tmp_path / "world.parquet")["position"], one["position"])


@pytest.mark.parametrize("law", [1, 2, 3], ids=["a delay", "two poles", "a running mean"])
def test_a_torque_is_as_late_as_is_said(law: int) -> None:
    """By what its lag and the current loop make of a demand that goes on growing."""
    world = quiet()
    tick, size = world.loop.tick, 2.3e-3
    lagging = replace(world, planted=(Planted(LAG, law, (size,)),))
    ring, shape = np.zeros(LAG_TICKS + 2), np.array([size])
    acted = [late(law, shape, ring, k, tick, k * tick) for k in range(LAG_TICKS)]
    behind = (LAG_TICKS - 1) * tick - acted[-1]
    assert lateness(lagging) - lateness(world) == pytest.approx(behind, abs=0.05 * tick)


def test_lags_as_any_drive_has_them_are_counted_by_their_length() -> None:
    line = {"kind": "single", "truth": ["torque_lag"], "cycle": 1e-3, "effects": []}
    told, not_told = {**line, "late": 1.3e-3, "late_told": 1.25e-3}, {**line, "late": 3e-4, "late_told": None}
    long = {**line, "late": 1.7e-3, "late_told": 1.7e-3}
    usual, longer = (
        next(r for r in table([told, not_told, long]).splitlines() if w in r) for w in ("as any", "longer")
    )
    assert "1 of 2" in usual
    assert "0 of 1" in longer, "a length that is told is no name"


def test_programme_stays_inside_travel_and_speed() -> None:
    for seed in range(20):
        world = draw_world(seed)
        path = programme(world).reference
        assert np.abs(path).max() <= world.plant.travel * (1.0 + 1e-9)
        assert np.abs(np.diff(path)).max() <= 1.05 * world.plant.top_speed * world.loop.period


def test_a_second_file_is_taken_under_other_circumstances() -> None:
    world = quiet()
    other = changed(world, "all", np.random.default_rng(4))
    assert other.plant.inertia != world.plant.inertia
    assert other.plant.coulomb != world.plant.coulomb
    assert 0.1 <= other.around.level / other.plant.coulomb <= 0.6
    with pytest.raises(ValueError, match="no change"):
        changed(world, "weather", np.random.default_rng(4))


@pytest.mark.parametrize("base", names.BASES)
def test_another_base_changes_no_other_draw(base: str) -> None:
    for seed in range(20):
        world = draw_world(seed)
        other = with_base(world, base)
        own = {"fading": ("micro", "fade_law", "fade_speed"), "falling": ("low_law", "low_size", "low_speed")}
        as_before = {name: getattr(world.plant, name) for name in own[base]}
        assert replace(other, plant=replace(other.plant, **as_before)) == world
        assert other != world
        assert with_base(world, "") is world
    assert len(draw_world(1).plant.packed()) == names.PLANT_SIZE


def test_damping_fades_to_its_share_at_its_speed() -> None:
    assert faded(0, 2.0, 0.1, 5.0) == faded(1, 2.0, 0.1, 0.0) == 2.0
    assert faded(1, 2.0, 0.1, -0.1) == pytest.approx(2.0 / math.e)
    assert faded(2, 2.0, 0.1, 0.1) == pytest.approx(1.0)


def test_an_axis_that_chatters_by_itself_is_drawn_again() -> None:
    """Where friction is pressed by 1.7 · 0.6 of the torque that it takes itself, no damping holds it still."""
    plain = quiet()
    floor = 0.01 * plain.plant.coulomb
    little = replace(plain, plant=replace(plain.plant, micro=0.1 * plain.plant.micro))
    assert not chatters(replace(little, planted=(Planted(LOAD, 3, (0.1, 1.0)),)), floor)
    assert chatters(replace(plain, planted=(Planted(LOAD, 3, (0.6, 1.0)),)), floor)
    assert not chatters(plain, floor), "nothing is pressed there"
