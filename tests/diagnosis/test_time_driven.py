"""What follows the clock: a friction level that rises and falls, told from a torque that does, and from noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.diagnosis.evidence import time_driven
from autotune.diagnosis.verdict import NONE, UNKNOWN, diagnose
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.cross_validation import beyond_presliding
from autotune.estimation.data import TRAINING, VETO, Block, Clocked, ReadingWave, Wander, filtered_motion
from autotune.estimation.disturbance import STILL
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import Problem
from autotune.estimation.residual import measured_motion
from autotune.estimation.twin_runs import shaken
from autotune.models import layout
from autotune.models.drive_model import Packed, base_model
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.signals.place_line import PlaceLine
from tests.support.axes import NOMINAL, plain_axis
from tests.support.diagnosis_programme import play

PERIOD, COUNT, BLOCKS = 0.02, 400, 4
"""Four experiments of eight seconds, one after the other, twice."""


@dataclass(frozen=True)
class Clocks:
    """What a level that wanders is looked for in."""

    blocks: tuple[Block, ...]
    grid: np.ndarray
    period: float = PERIOD
    repeated: bool = True
    starts: tuple[int, ...] = (0,)
    wander: Wander | None = None


def _problem() -> tuple[SimpleNamespace, np.ndarray]:
    """Grid rows go through each experiment's repeats; the clock runs through a round of all. And the level's column."""
    rounds = np.arange(2)[None, :, None] * BLOCKS * COUNT
    clock = np.arange(BLOCKS)[:, None, None] * COUNT + rounds + np.arange(COUNT)[None, None, :]
    blocks = tuple(Block(f"part {i}", TRAINING, i * 2 * COUNT, 2, COUNT) for i in range(BLOCKS))
    place = np.sin(0.1 * np.arange(clock.size))
    data = SimpleNamespace(blocks=blocks, grid=clock.ravel(), period=PERIOD, position=place, repeated=True)
    turns = np.where((np.arange(COUNT) // 70) % 2, -1.0, 1.0)
    return SimpleNamespace(data=data, training=np.ones(clock.size), policy=POLICY), np.tile(turns, 2 * BLOCKS)


@pytest.mark.parametrize(
    ("level", "torque", "told"),
    [(0.0, 0.0, False), (1.0, 0.0, True), (0.0, 1.0, False), (0.25, 0.0, False)],
    ids=["noise", "a level", "a torque", "a level of a fifteenth of what differs"],
)
def test_friction_that_breathes_is_told_from_noise_and_from_a_torque(
    monkeypatch: pytest.MonkeyPatch, level: float, torque: float, told: bool
) -> None:
    """In noise of one; repeats are 32 s apart, eleven and a half periods, so that their difference has it twice."""
    problem, column = _problem()
    monkeypatch.setattr(time_driven, "of_friction", lambda *_: column)
    wave = np.sin(2.0 * np.pi * 0.36 * problem.data.grid * PERIOD)
    noise = np.random.default_rng(5).standard_normal(len(wave))
    alike = np.concatenate([np.tile(np.sin(np.arange(COUNT) * (i + 1) / 30.0), 2) for i in range(BLOCKS)])
    fitted = SimpleNamespace(error=level * column * wave + torque * wave + noise + alike)
    found = time_driven.breathing_friction(problem, SimpleNamespace(fitted=fitted, correction=None))
    assert (found is not None) == told
    if found is not None:
        assert found.hertz == pytest.approx(0.36, abs=0.02)
        assert found.share == pytest.approx(0.5, abs=0.1)


def test_a_model_without_friction_has_no_level(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, _ = _problem()
    monkeypatch.setattr(time_driven, "of_friction", lambda *_: None)
    model_fit = SimpleNamespace(fitted=SimpleNamespace(error=np.zeros(1)), correction=None)
    assert time_driven.breathing_friction(problem, model_fit) is None


@pytest.mark.parametrize(
    ("sizes", "in_step", "repeated", "steady"),
    [
        ((1.0, 1.0, 1.0, 1.0), True, True, True),
        ((0.0, 1.0, 2.0, 1.5), True, True, False),
        ((0.0, 2.0, 0.0, 0.0), True, True, None),
        ((1.0, 1.0, 1.0, 1.0), False, True, None),
        ((0.0, 1.0, 2.0, 1.5), False, True, None),
        ((1.0, 1.0, 1.0, 1.0), True, False, True),
        ((0.0, 1.0, 2.0, 1.5), True, False, None),
    ],
    ids=[
        "steady",
        "comes and goes",
        "in one experiment",
        "begins with each motion",
        "begins with some",
        "steady in one motion",
        "in parts of one motion",
    ],
)
def test_a_force_in_step_with_the_clock_is_told_from_what_a_motion_makes(
    sizes: tuple[float, ...], in_step: bool, repeated: bool, steady: bool | None
) -> None:
    """In noise of a fifth; the repeats are eleven and a half periods apart, the experiments none of a whole number."""
    problem, _ = _problem()
    problem.data.stretches, problem.data.periodic, problem.data.repeated = (None,), (), repeated
    clock = problem.data.grid * PERIOD
    own = np.tile(np.arange(COUNT) * PERIOD, 2 * BLOCKS)
    size = np.repeat(sizes, 2 * COUNT)
    turns = np.repeat(np.random.default_rng(4).uniform(0.0, 2.0 * np.pi, 2 * BLOCKS), COUNT)
    wave = np.sin(2.0 * np.pi * 7.31 * (clock if in_step else own) + (0.0 if in_step else turns))
    noise = 0.2 * np.random.default_rng(8).standard_normal(len(wave))
    line = time_driven.time_driven_line(problem, size * wave + noise)
    assert (line.steady if line is not None else None) == steady
    assert time_driven.comes_and_goes(line) == (steady is False)


@pytest.mark.parametrize(("spread", "told"), [(0.0, False), (0.05, True)], ids=["one speed", "several"])
def test_at_one_speed_a_wave_over_position_is_no_clock(spread: float, told: bool) -> None:
    """Cogging of a motor that rolls on evenly has one frequency in every experiment, as a pump has."""
    problem, _ = _problem()
    problem.data.stretches, problem.data.periodic = (None,), ()
    clock = problem.data.grid * PERIOD
    problem.data.position = np.cumsum(np.repeat(1.0 + spread * np.arange(2 * BLOCKS), COUNT)) * 5.0 * PERIOD
    noise = 0.2 * np.random.default_rng(8).standard_normal(len(clock))
    line = time_driven.time_driven_line(problem, np.sin(2.0 * np.pi * 1.59 * clock) + noise)
    assert (line is not None) == told


@pytest.mark.parametrize(
    ("hertz", "told"), [(2.75, False), (2.6, True)], ids=["eleventh harmonic", "between"]
)
def test_a_harmonic_of_a_motion_that_comes_again_is_no_clock(hertz: float, told: bool) -> None:
    """Four seconds come again and again, but for three seconds that come up from rest."""
    problem, _ = _problem()
    problem.data.stretches, problem.data.periodic, problem.data.repeated = (None,), (), False
    clock = np.arange(2 * BLOCKS * COUNT) * PERIOD
    rise = np.clip(clock / 3.0, 0.0, 1.0)
    problem.data.position = rise * (np.sin(0.5 * np.pi * clock) + 0.3 * np.cos(1.5 * np.pi * clock))
    time = problem.data.grid * PERIOD
    noise = 0.2 * np.random.default_rng(8).standard_normal(len(time))
    line = time_driven.time_driven_line(problem, np.sin(2.0 * np.pi * hertz * time) + noise)
    assert (line is not None) == told


def test_the_supply_may_come_and_go() -> None:
    assert not time_driven.comes_and_goes(time_driven.TimeLine(50.0, 0.3, steady=False))
    assert time_driven.comes_and_goes(time_driven.TimeLine(47.0, 0.3, steady=False))


@pytest.mark.parametrize(
    ("hertz", "share", "louder"),
    [
        (7.3, 0.9, True),
        (7.3, 0.3, False),
        (50.02, 0.9, False),
        (100.1, 0.9, False),
        (33.33, 0.9, False),
        (52.0, 0.6, True),
    ],
)
def test_what_the_supply_makes_is_no_cause_to_look_for(hertz: float, share: float, louder: bool) -> None:
    data = SimpleNamespace(clocked=(Clocked(hertz, 0.01, 0.0, 0.0, share),))
    assert time_driven.louder_than_all(data) == louder


def test_a_frequency_is_told_once_as_loud_as_it_was() -> None:
    data = SimpleNamespace(clocked=(Clocked(50.0, 0.01, 0.0, 0.0, 0.6), Clocked(50.01, 0.002, 0.0, 0.0, 0.1)))
    told = time_driven.all_lines(data, time_driven.TimeLine(24.3, 0.2))
    assert sorted((line.hertz, line.share) for line in told) == [(24.3, 0.2), (50.0, 0.6)]


def test_a_twin_is_shaken_by_what_was_taken_out() -> None:
    """A torque that the motion lacks by c acted as -c."""
    hum = Clocked(50.0, 0.01, 0.0, 0.0)
    data = SimpleNamespace(
        reference=np.zeros(100), torque=np.zeros(100), period=1e-3, shift=0.0, clocked=(hum,), wander=None
    )
    torque, position = shaken(data, STILL, np.random.default_rng(1))
    assert torque == pytest.approx(-0.01 * np.sin(2.0 * np.pi * 50.0 * 1e-3 * np.arange(100)))
    assert not position.any()


PARTS = 12
"""Experiments, the last three of which are pieces of one veto trajectory."""


def _levels_of(kind: str, rng: np.random.Generator) -> np.ndarray:
    """The torque's level in each of two plays of each experiment, in the order of time, shape (2·PARTS,)."""
    if kind == "wanders":
        return 0.3 * np.sin(np.arange(2 * PARTS) / 4.0) + 0.02 * rng.standard_normal(2 * PARTS)
    motion = np.concatenate([np.cumsum(0.1 * rng.standard_normal(PARTS - 3)), [-0.6, 0.9, -0.9]])
    return np.tile(motion, 2) + 0.01 * rng.standard_normal(2 * PARTS)


@pytest.mark.parametrize(
    ("seed", "kind", "told"), [(3, "wanders", True), (3, "motion's", False), (4, "motion's", False)]
)
def test_a_level_that_is_alike_whenever_its_experiment_is_played_does_not_wander(
    monkeypatch: pytest.MonkeyPatch, seed: int, kind: str, told: bool
) -> None:
    """The programme is played twice as a whole; from one experiment to the next a motion's level may change little."""
    names = [f"part {i}" for i in range(PARTS - 3)] + 3 * ["veto"]
    blocks = tuple(
        Block(name, VETO if name == "veto" else TRAINING, i * 2 * COUNT, 2, COUNT)
        for i, name in enumerate(names)
    )
    rounds = np.arange(2)[None, :, None] * PARTS * COUNT
    clock = np.arange(PARTS)[:, None, None] * COUNT + rounds + np.arange(COUNT)[None, None, :]
    rng = np.random.default_rng(seed)
    levels = _levels_of(kind, rng).reshape(2, PARTS).T
    error = (np.repeat(levels[:, :, None], COUNT, axis=2) + 0.05 * rng.standard_normal(clock.shape)).ravel()
    data = Clocks(blocks, clock.ravel())
    problem = SimpleNamespace(
        data=data, weight=np.ones(clock.size), policy=POLICY, noise_variance=lambda *_: 0.05**2
    )
    monkeypatch.setattr(time_driven, "_by_time", lambda _problem, _packed, data: data)
    found = time_driven.without_wander(problem, Packed(np.zeros(1), np.zeros(1, dtype=bool)), error)
    assert (found is not None) == told
    if found is not None:
        assert found.wander.levels == pytest.approx(levels.T.ravel() - levels.mean(), abs=0.02)


@pytest.mark.long
def test_a_hum_that_comes_again_in_repeats_is_taken_out() -> None:
    """50 Hz are whole periods of any experiment in tenths of a second: repeats share the hum as they do an effect."""

    def hum(time: float, position: float, velocity: float, acceleration: float) -> float:
        return 0.012 * math.sin(2.0 * math.pi * 50.0 * time)

    told = diagnose([play(plain_axis(31), 31, alien=hum)], base_model(NOMINAL))
    assert told.verdict == NONE
    assert told.problem is not None
    (found,) = told.problem.data.clocked
    assert found.hertz == pytest.approx(50.0, abs=0.01)
    level = math.hypot(found.sine, found.cosine)
    assert level == pytest.approx(0.0105, rel=0.15), "most of it: at rest it is below a count of the encoder"
    assert any("50.0" in note for note in told.notes)


def _extra(kind: str, clock: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Friction and torque that the axis has more than the model, at times of the clock [s]; shape (m,) each."""

    def between(start: float, end: float) -> np.ndarray:
        return ((clock >= start) & (clock < end)).astype(float)

    none = np.zeros_like(clock)
    if kind == "a jam":
        return 3.0 * between(17.0, 20.0), none
    if kind == "a jam into the next experiment":
        return 4.0 * between(21.5, 24.0) + 2.5 * between(24.0, 27.0), none
    if kind == "a hand":
        return none, -4.0 * between(49.0, 51.5)
    if kind == "three of them":
        return 3.0 * (between(3.0, 5.5) + between(25.0, 27.5) + between(55.0, 57.5)), none
    if kind == "warming":
        return 3.0 * np.exp(-clock / 20.0), none
    if kind == "a level that wanders":
        seconds = np.arange(0.0, 64.5, 0.5)
        return none, np.interp(clock, seconds, 0.5 * np.cumsum(rng.standard_normal(len(seconds))))
    return none, none


@pytest.mark.parametrize(
    ("kind", "start", "end", "friction", "torque"),
    [
        ("a jam", 17.0, 20.0, 3.0, 0.0),
        ("a jam into the next experiment", 21.5, 27.0, 4.0, 0.0),
        ("a hand", 49.0, 51.5, 0.0, -4.0),
        ("three of them", None, None, 0.0, 0.0),
        ("warming", None, None, 0.0, 0.0),
        ("a level that wanders", None, None, 0.0, 0.0),
        ("noise", None, None, 0.0, 0.0),
    ],
)
def test_what_acted_once_is_told_from_noise_and_from_what_goes_on(
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    start: float | None,
    end: float,
    friction: float,
    torque: float,
) -> None:
    """In noise of a half; more friction in a model leaves less, so that its column is against the motion."""
    problem, turns = _problem()
    clock = problem.data.grid * PERIOD
    rng = np.random.default_rng(7)
    more, pushed = _extra(kind, clock, rng)
    monkeypatch.setattr(time_driven, "of_friction", lambda *_: -0.2 * turns)
    monkeypatch.setattr(time_driven, "beyond_presliding", lambda problem, _: problem)
    fitted = SimpleNamespace(
        error=more * turns + pushed + 0.5 * rng.standard_normal(clock.size),
        free=[SimpleNamespace(name="inertia"), SimpleNamespace(name="coulomb")],
        scales=np.array([1.0, 0.2]),
        packed=None,
    )
    found = time_driven.acted_once(problem, SimpleNamespace(fitted=fitted, correction=None))
    assert (found is not None) == (start is not None)
    if found is not None and start is not None:
        assert (found.start, found.end) == pytest.approx((start, end), abs=1.0)
        assert (found.friction, found.torque) == pytest.approx((friction, torque), abs=0.6)


def test_nothing_acted_once_where_hardly_a_row_slides(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, turns = _problem()
    problem.training[:] = 0.0
    problem.training[[5, 5 + COUNT]] = 1.0
    monkeypatch.setattr(time_driven, "of_friction", lambda *_: turns)
    monkeypatch.setattr(time_driven, "beyond_presliding", lambda problem, _: problem)
    free, error = [SimpleNamespace(name="coulomb")], np.random.default_rng(3).standard_normal(turns.size)
    fitted = SimpleNamespace(error=error, free=free, scales=np.ones(1), packed=None)
    assert time_driven.acted_once(problem, SimpleNamespace(fitted=fitted, correction=None)) is None
    monkeypatch.setattr(time_driven, "beyond_presliding", lambda *_: None)
    assert time_driven.acted_once(problem, SimpleNamespace(fitted=fitted, correction=None)) is None


@pytest.mark.long
def test_a_jam_of_some_seconds_is_said_with_its_time_and_is_unknown() -> None:
    """The friction of the axis is a twentieth higher for four seconds, once."""

    def jam(time: float, position: float, velocity: float, acceleration: float) -> float:
        return -0.016 * math.tanh(velocity / 0.02) if 24.0 <= time < 28.0 else 0.0

    told = diagnose([play(plain_axis(31), 31, alien=jam)], base_model(NOMINAL))
    assert told.verdict == UNKNOWN
    assert any("friction was 0.016 N m higher" in note and "there once" in note for note in told.notes)
    assert any(note.startswith(("From 24", "From 23.")) for note in told.notes)


WAVE = ReadingWave(150.0, (1.6e-4, -0.4e-4, 0.4e-4, 0.8e-4))
"""A period is 42 mrad, on an axis whose encoder has counts of 0.13 mrad."""


def _with_reading(problem: Problem, model_fit: ModelFit, *more: ReadingWave) -> tuple[Problem, ModelFit]:
    """The axis seen by an encoder that interpolates with an error, and more of them."""
    data = problem.data
    data = replace(data, measured=data.measured + sum(one.error(data.measured) for one in (WAVE, *more)))
    moved = filtered_motion(data.measured, data.stretches, data.period, data.motion_cutoff)
    parts = dict(zip(("position", "velocity", "acceleration"), moved, strict=True))
    data = replace(data, **parts)
    problem = replace(problem, data=data, moved=measured_motion(data))
    again = fit_inside_twin(problem, model_fit.fitted.packed, list(model_fit.free), 2)
    assert again is not None
    return problem, again


def _told(problem: Problem | None) -> tuple[float, tuple[float, ...]]:
    """Wavenumber [rad/rad] and parts [rad] of the encoder's error that was found."""
    assert problem is not None
    assert problem.data.reading is not None
    return problem.data.reading.wavenumber, problem.data.reading.parts


def test_what_an_encoder_interpolates_is_taken_out(begun: tuple[Problem, ModelFit]) -> None:
    assert time_driven.without_reading_waves(*begun) is None
    problem, model_fit = _with_reading(*begun)
    without = time_driven.without_reading_waves(problem, model_fit)
    wavenumber, parts = _told(without)
    assert wavenumber == pytest.approx(WAVE.wavenumber, rel=1e-3)
    assert np.delete(parts, 1) == pytest.approx(np.delete(WAVE.parts, 1), abs=1e-5)
    assert parts[1] == pytest.approx(WAVE.parts[1], abs=2e-5), "its phase turns with the wavenumber"
    true, found = (one.error(problem.data.measured) for one in (WAVE, ReadingWave(wavenumber, parts)))
    assert np.std(found - true) < 0.22 * np.std(true), (
        "a few seconds tell no more; 0.25 with a lag that is none"
    )
    assert without is not None
    assert time_driven.without_reading_waves(without, model_fit) is None
    again = fit_inside_twin(without, model_fit.fitted.packed, list(model_fit.free), 2)
    assert again is not None
    assert again.fitted.cost < 1.1 * begun[1].fitted.cost


def test_what_an_encoder_interpolates_is_found_beside_a_coarse_wave(begun: tuple[Problem, ModelFit]) -> None:
    """An encoder off centre on a pinion: two waves a radian, ten times as large, are the axis's own and stay."""
    problem, model_fit = _with_reading(*begun, ReadingWave(2.0, (1.6e-3, 0.0, 0.0, 0.0)))
    wavenumber, parts = _told(time_driven.without_reading_waves(problem, model_fit))
    assert wavenumber == pytest.approx(WAVE.wavenumber, rel=1e-3)
    assert parts == pytest.approx(WAVE.parts, abs=2e-5), (
        "the coarse wave is in no model, and bends what is left"
    )


@pytest.mark.parametrize("everywhere", [True, False])
def test_a_scale_is_read_wherever_the_axis_moves(begun: tuple[Problem, ModelFit], everywhere: bool) -> None:
    """What gained 23 % near reversals and rests, and nothing elsewhere, was "sine and cosine" of an exact encoder."""
    problem, read = _with_reading(*begun)
    sliding = beyond_presliding(problem, read.fitted.packed)
    assert sliding is not None
    there = everywhere | (sliding.weight == 0.0)
    error = np.where(there, read.fitted.error, begun[1].fitted.error)
    read = replace(read, fitted=replace(read.fitted, error=error))
    assert time_driven._gains_while_sliding(problem, read, WAVE) is everywhere


@pytest.mark.parametrize("aliased", [True, False])
def test_a_wave_that_a_coarse_one_explains_is_not_taken_out(
    monkeypatch: pytest.MonkeyPatch, begun: tuple[Problem, ModelFit], aliased: bool
) -> None:
    """At one speed whole waves of the fine one more pass between two samples: the columns of both are the same."""
    problem, model_fit = _with_reading(*begun)
    own, fine = time_driven._waves, PlaceLine(WAVE.wavenumber, 10.0)
    coarse = PlaceLine(2.0, 20.0)
    monkeypatch.setattr(
        time_driven, "strongest_line", lambda _p, _s, bounds, _l: coarse if bounds[1] < 100.0 else fine
    )
    alike = WAVE.wavenumber if aliased else coarse.wavenumber
    monkeypatch.setattr(
        time_driven, "_waves", lambda p, m, k: own(p, m, alike if k == coarse.wavenumber else k)
    )
    assert (time_driven.without_reading_waves(problem, model_fit) is None) is aliased


def _with_torques(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit]:
    """The axis with two waves of cogging near each other."""
    place, size = problem.data.position, 0.05 * NOMINAL["coulomb"]
    torque = problem.data.torque + size * (np.sin(50.4 * place) + 0.8 * np.cos(55.9 * place))
    data = replace(problem.data, torque=torque)
    problem = replace(problem, data=data, moved=measured_motion(data))
    again = fit_inside_twin(problem, model_fit.fitted.packed, list(model_fit.free), 2)
    assert again is not None
    return problem, again


def test_waves_of_a_torque_near_each_other_are_no_reading(begun: tuple[Problem, ModelFit]) -> None:
    """One by one they predict nothing of experiments held out, where a reading's wave is small in the slow ones."""
    assert time_driven._rather_torques(*_with_torques(*begun), 50.4)
    assert not time_driven._rather_torques(*_with_torques(*_with_reading(*begun)), WAVE.wavenumber)


@pytest.mark.parametrize("hertz", [17.13, 47.31])
def test_of_a_hum_nothing_is_left(
    begun: tuple[Problem, ModelFit], hertz: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It acts as any torque does, held from each sample to the next: half a sample off, a sixth of 50 Hz was left."""
    problem, model_fit = begun
    time = np.arange(len(problem.data.torque)) * problem.data.period
    torque = problem.data.torque + 2.0 * NOMINAL["coulomb"] * np.sin(2.0 * math.pi * hertz * time + 0.4)
    data = replace(problem.data, torque=torque)
    loud = replace(problem, data=data, moved=measured_motion(data))
    packed = model_fit.fitted.packed
    before, heard = problem.raw(packed), loud.raw(packed)
    monkeypatch.setattr(time_driven, "time_driven_line", lambda *_: time_driven.TimeLine(hertz, 0.99))
    quiet = time_driven.without_clocked(loud, packed, heard)
    assert quiet is not None
    left, there = quiet.raw(packed) - before, heard - before
    assert np.sqrt(np.mean(left**2)) < 0.02 * np.sqrt(np.mean(there**2)), (
        "what the axis makes at this frequency"
    )


def test_a_veto_of_which_no_row_counts_is_none(begun: tuple[Problem, ModelFit]) -> None:
    """Of small strokes the rows on which a contact slides may be none."""
    problem, model_fit = begun
    weight = problem.weight * problem.data.role(TRAINING)
    bare = replace(problem, weight=weight)
    assert problem.has_veto
    assert not bare.has_veto
    assert math.isnan(bare.noise_variance(model_fit.fitted.error, VETO))


@pytest.mark.parametrize(("order", "is_one"), [(50.4, True), (25.2, True), (12.6, False)])
def test_a_wave_beside_a_ripple_of_the_same_place_is_no_reading(
    begun: tuple[Problem, ModelFit], order: float, is_one: bool
) -> None:
    """A ripple that is taken to act later than it does leaves what an error of the reading would at its place."""
    problem, model_fit = begun
    p, on = model_fit.fitted.packed.p.copy(), model_fit.fitted.packed.on.copy()
    p[TORQUE_RIPPLE.slot("order_1")], on[layout.flag(TORQUE_RIPPLE.name)] = order, True
    fitted = replace(model_fit.fitted, packed=Packed(p, on))
    rippled = replace(model_fit, fitted=fitted, effects=(TORQUE_RIPPLE.name,))
    assert time_driven._is_of_a_ripple(problem, rippled, 50.4) is is_one
    assert not time_driven._is_of_a_ripple(problem, model_fit, 50.4)
