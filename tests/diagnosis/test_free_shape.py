"""A bristle that stands for several short elements is taken apart into them, as far as the data go."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.core.axis import read_axis
from autotune.core.loop import LocalLoop
from autotune.diagnosis import free_shape
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.contact_laws import resolved
from autotune.diagnosis.fitting import updated_model
from autotune.diagnosis.free_shape import relaxing
from autotune.diagnosis.wording import relaxed_note
from autotune.estimation.alignment import followed_late
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.least_squares import Free
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import Problem
from autotune.estimation.residual import smoothed
from autotune.experiments.diagnosis import confirmation
from autotune.experiments.path import Motion
from autotune.experiments.programmes import build
from autotune.experiments.record import Recorder, metadata_for, play
from autotune.experiments.runner import Programme
from autotune.models import layout
from autotune.models.drive_model import DriveModel, Packed, base_model
from autotune.models.spring import RAMPS, SPRING, spring_torque
from autotune.models.table import EFFECTS
from autotune.models.total_friction import stiffness_at_rest, total_friction
from autotune.recordings.recording import Controller, Recording
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset

AXIS = read_axis(Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml")
SHORT = 3  # elements that the coarse model has in its bristle


def recording(name: str) -> Recording:
    """Dahl's curves and the confirming trajectory, on the simulated axis or its plain LuGre twin."""
    motion = Motion.of(AXIS)
    experiments = (*build("dahl", AXIS), *confirmation(motion, 6.0, np.random.default_rng(1)))
    programme = Programme(experiments, AXIS.limits, 300.0)
    recorder = Recorder(metadata_for(AXIS, Controller(60.0, 0.15, 6000.0, 1.0)), programme.labels)
    play(LocalLoop(SimDrive(preset(name), seed=4)), programme, recorder)
    return recorder.recording()


def coarse_model() -> DriveModel:
    """The long elements as they are; one bristle for the short ones."""
    plant = preset("edm-vertical").plant
    short, long = plant.elements[:SHORT], plant.elements[SHORT:]
    values = {
        "inertia": plant.inertia, "viscous": plant.viscous, "coulomb": sum(e.torque for e in short),
        "stiffness": 50.0, "micro_damping": 0.1, "offset": plant.offset,
    }  # fmt: skip
    memory = {f"displacement_{i}": e.displacement for i, e in enumerate(long, 1)}
    memory |= {f"torque_{i}": e.torque for i, e in enumerate(long, 1)}
    ripple: dict[str, float] = {}
    for i, wave in enumerate(plant.ripple, 1):
        sine, cosine = wave.amplitude * np.cos(wave.phase), wave.amplitude * np.sin(wave.phase)
        ripple |= {f"order_{i}": wave.order, f"sin_{i}": sine, f"cos_{i}": cosine}
    model = base_model(values).with_effect(EFFECTS["reversal_memory"].make(memory))
    return model.with_effect(EFFECTS["torque_ripple"].make(ripple))


def test_the_short_elements_come_out_of_the_bristle() -> None:
    plant, model = preset("edm-vertical").plant, coarse_model()
    problem, root, _, _ = begin(prepared_for([recording("edm-vertical")]), model)
    fine = resolved(problem, root)
    assert fine is not None
    assert fine.unseen.total < 0.6 * root.unseen.total
    found = updated_model(model.without_effect("reversal_memory"), problem, fine.fitted)
    assert stiffness_at_rest(found) == pytest.approx(plant.stiffness, rel=0.15)
    assert found["coulomb"] < 0.2 * model["coulomb"]
    carried = sum(v.value for k, v in found.parameters.items() if ".torque_" in k)
    assert carried + found["coulomb"] == pytest.approx(plant.friction, rel=0.03)
    total, apart = total_friction(found), total_friction(replace(found, friction_error=None))
    assert total.standard_error is not None
    assert apart.standard_error is not None
    assert abs(total.value - plant.friction) < 0.02 * plant.friction + 3.0 * total.standard_error
    assert (
        total.standard_error < 0.1 * apart.standard_error
    )  # the elements trade friction, the sum is well known
    places = [found[f"reversal_memory.displacement_{i}"] for i in range(1, SHORT + 1)]
    torques = [found[f"reversal_memory.torque_{i}"] for i in range(1, SHORT + 1)]
    for element in plant.elements[1:SHORT]:
        near = [w for d, w in zip(places, torques, strict=True) if 0.7 < d / element.displacement < 1.4]
        assert sum(near) == pytest.approx(element.torque, rel=0.3)


def test_a_model_without_the_effect_is_left_as_it_is() -> None:
    model = coarse_model().without_effect("reversal_memory")
    problem, root, _, _ = begin(prepared_for([recording("edm-vertical")]), model)
    assert resolved(problem, root) is None
    assert stiffness_at_rest(model) == model["stiffness"]


@pytest.mark.parametrize(
    ("goes", "seconds", "held"),
    [(0.0, 0.7, None), (0.03, 0.7, None), (0.29, 0.7, 0.71), (1.0, 0.7, 0.0), (1.0, 3.0, 0.0)],
    ids=["a spring", "less than a name may leave", "a gas that cools", "all goes", "slowly"],
)
def test_a_torque_over_the_place_that_goes_at_rest_is_no_spring(
    begun: tuple[Problem, ModelFit], goes: float, seconds: float, held: float | None
) -> None:
    """`goes`: of the torque, while the axis stays; a gas that was pressed as a whole loses 1 − 1/1.4 as it cools."""
    problem, root = begun
    p, on = root.fitted.packed.p.copy(), root.fitted.packed.on.copy()
    slot, stiffness = SPRING.slot("stiffness"), 0.05
    p[slot], on[layout.flag(SPRING.name)] = stiffness, True
    free = (*root.free, Free("stiffness", slot, -1.0, 1.0, stiffness))
    late = smoothed(problem.data, followed_late(problem.data, stiffness * problem.moved.position, seconds))
    error = root.fitted.error - goes * late
    fitted = replace(root.fitted, packed=Packed(p, on), free=free, error=error)
    found = relaxing(problem, replace(root, fitted=fitted, effects=(SPRING.name,)))
    assert (found is None) == (held is None)
    if found is not None:
        assert found.held == pytest.approx(held, abs=0.1)
        assert found.seconds == pytest.approx(seconds, rel=0.5)
        alone = relaxed_note(found.effect, [], found.held, found.seconds)
        assert alone.startswith("A spring explains most, but its torque does not hold")
        beside = relaxed_note(found.effect, ["reversal_memory"], found.held, found.seconds)
        assert beside.startswith("Beside reversal memory a spring explains most of the rest")
        assert "a memory by another law looks so, too" in beside


@pytest.mark.parametrize("pulls", [1.0, -1.0])
def test_the_free_course_of_a_spring_never_turns_round(pulls: float) -> None:
    """Of one that pushes, as a weight near its highest place does, the line was free to pull, and with ramps that push
    it was any function of the place: a whole wave over the travel, too."""
    p = base_model(dict.fromkeys(layout.BASE, 1.0)).pack().p
    p[SPRING.slot("stiffness")] = 0.01 * pulls
    place = np.linspace(-1.0, 1.0, 201)
    start = SPRING.free_shape(SimpleNamespace(p=p, coulomb=0.3, travel=2.0, position=lambda: place))
    rng = np.random.default_rng(5)
    for _ in range(20):
        course = p.copy()
        for name, value in start.values.items():
            course[SPRING.slot(name)] = value
        for name in ("stiffness", *(f"ramp_{i}" for i in range(1, RAMPS + 1))):
            vary = start.free[name]
            course[SPRING.slot(name)] = np.clip(rng.normal(), vary.lower, vary.upper)
        torque = np.array([spring_torque(course, one) for one in place])
        assert np.all(pulls * np.diff(torque) >= 0.0)
        assert np.ptp(torque) > 0.0


@pytest.mark.parametrize(
    ("effect", "share", "asked"),
    [("stribeck", 0.6, True), ("stribeck", 0.4, False), ("encoder_eccentricity", 0.4, True)],
)
def test_a_course_is_asked_where_its_own_law_explains_enough(
    monkeypatch: pytest.MonkeyPatch, effect: str, share: float, asked: bool
) -> None:
    """A disc that is tilted as much as it is off centre: its own wave explained 45 %, both together 96 %."""
    courses: list[str] = []
    monkeypatch.setattr(free_shape, "_courses", lambda *known: courses.append(known[-1]) or [])
    chosen = SimpleNamespace(effect=effect, model_fit=None, training=SimpleNamespace(share=share))
    found = free_shape.with_free_shape(SimpleNamespace(policy=POLICY), None, None, chosen)
    assert found is None
    assert bool(courses) is asked


@pytest.mark.parametrize("stiff_costs", [0.5, 2.0])
def test_a_free_course_begins_at_the_stiffer_contact_where_that_leaves_less(
    monkeypatch: pytest.MonkeyPatch, stiff_costs: float
) -> None:
    """A contact that ages by a logarithm and stiffens is explained by neither law alone."""
    kind = EFFECTS["dwell_time_break_away"]
    stiffens, faster = kind.slot("stiffens"), kind.slot("time_constant_2")
    asked: list[Packed] = []

    def fit(
        problem: object, packed: Packed, free: list[Free], rounds: int, effects: tuple[str, ...]
    ) -> object:
        asked.append(packed)
        return SimpleNamespace(
            fitted=SimpleNamespace(packed=packed, cost=stiff_costs), free=tuple(free), effects=effects
        )

    names = ("inertia", "viscous", "coulomb", "stiffness", "micro_damping", "offset")
    model = base_model(dict.fromkeys(names, 1.0))
    packed = model.with_effect(kind.make({"rise": 0.1, "time_constant": 1.0, "slip": 1e-3})).pack()
    before = SimpleNamespace(fitted=SimpleNamespace(packed=packed, cost=1.0), free=(), effects=(kind.name,))
    known = lambda problem, fitted, nominal: SimpleNamespace(p=fitted.packed.p, coulomb=1.0)  # noqa: E731
    monkeypatch.setattr(free_shape, "Context", known)
    monkeypatch.setattr(free_shape, "fit_inside_twin", fit)
    monkeypatch.setattr(free_shape, "varying", lambda kind, name, vary: SimpleNamespace(slot=kind.slot(name)))
    assert len(list(free_shape._courses(None, packed, before, kind.name))) == 2
    assert [one.p[stiffens] for one in asked] == [1.0, 1.0 if stiff_costs < 1.0 else 0.0]
    assert asked[0].p[faster] == 0.0
    assert asked[1].p[faster] > 0.0
