"""What keeps an effect that lowers the error from a name: too much left, out of sight, or a wild card."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.diagnosis import backward, candidates, transmission
from autotune.diagnosis.candidates import Gain, no_progress
from autotune.diagnosis.evidence import repeated, single
from autotune.diagnosis.evidence.evidence import HoldoutResult
from autotune.diagnosis.evidence.repeated import RepeatedProgramme
from autotune.diagnosis.evidence.single import SingleRecording, least_of
from autotune.diagnosis.free_shape import at_an_edge
from autotune.diagnosis.starts import varying
from autotune.estimation import contact_start
from autotune.estimation.coordinates import coordinates, generic_columns
from autotune.estimation.cross_validation import Explained, chunks_held_out, held_out, left_unseen
from autotune.estimation.data import Block
from autotune.estimation.least_squares import Fitted
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import Problem, without_outlying
from autotune.models import layout
from autotune.models.drive_model import Packed, base_model
from autotune.models.elastic_transmission import CRITICAL
from autotune.models.start_values import Vary
from autotune.models.table import EFFECTS
from tests.support.axes import NOMINAL
from tests.support.fitted import Item


@pytest.mark.parametrize(
    ("before", "after", "noise", "doubted"),
    [
        (4.0, 1.0, 0.5, False),
        (4.0, 3.0, 0.5, True),
        (4.0, 3.0, 2.9, True),
        (0.9, 0.6, 0.55, False),
    ],
)
def test_a_lone_recording_must_keep_less_than_is_explained(
    monkeypatch: pytest.MonkeyPatch, before: float, after: float, noise: float, doubted: bool
) -> None:
    """In units of what measurement chains leave: 3 % of the torque. What goes with the motion still, or is more than
    that, some model could explain; a lag of a valve was named friction that grows with load, 2.2 of 2.0 % left."""
    size = POLICY.large_rest**2
    known = {"before": (before * size, before * size), "after": (after * size, noise * size)}
    monkeypatch.setattr(single, "_neighbours", lambda _: ())
    monkeypatch.setattr(single, "_with_motion", lambda _, error: known[error])
    data = SimpleNamespace(torque=np.ones(5), grid=np.arange(5))
    problem = SimpleNamespace(policy=POLICY, data=data, training=np.ones(5))
    monkeypatch.setattr(single, "worse_on_the_whole", lambda *_: False)
    root, fit = (SimpleNamespace(fitted=SimpleNamespace(error=name)) for name in ("before", "after"))
    assert SingleRecording().doubted(problem, root, fit) == doubted


@pytest.mark.parametrize(("bare", "doubted"), [(None, True), (1.5, True), (4.0, False)])
def test_effects_that_the_model_has_explain_their_part_of_a_lone_recording(
    monkeypatch: pytest.MonkeyPatch, bare: float | None, doubted: bool
) -> None:
    """The third, 0.3 of 1.2 that two others left of `bare`: what stays is held against all three, as if at once."""
    size = POLICY.large_rest**2
    known = {"before": (1.2 * size, 0.1 * size), "after": (0.9 * size, 0.1 * size)}
    known["bare"] = ((bare or 0.0) * size, 0.1 * size)
    monkeypatch.setattr(single, "_neighbours", lambda _: ())
    monkeypatch.setattr(single, "_with_motion", lambda _, error: known[error])
    data = SimpleNamespace(torque=np.ones(5), grid=np.arange(5))
    problem = SimpleNamespace(policy=POLICY, data=data, training=np.ones(5))
    asked = []
    monkeypatch.setattr(
        single, "worse_on_the_whole", lambda _, root, fit: bool(asked.append(root.fitted.error))
    )
    root, fit, base = (
        SimpleNamespace(fitted=SimpleNamespace(error=name)) for name in ("before", "after", "bare")
    )
    told = SingleRecording().doubted(problem, root, fit, bare=None if bare is None else base)
    assert told == doubted
    assert asked == ["before"], "what was found last must not raise the error of what was left out"


@pytest.mark.parametrize(
    ("out", "worse"), [((1.9, 1.9), False), ((1.9, 1.7), False), ((1.9, 2.1), True), ((0.5, 0.52), False)]
)
def test_a_lone_recording_errs_less_on_the_whole(out: tuple[float, float], worse: bool) -> None:
    """Of 100 rows 16 were left out, where a second mass rings: what was bent to the others raised the error there."""
    weight = np.where(np.arange(100) < 16, 0.0, 1.0)
    data = SimpleNamespace(role=lambda _: np.ones(100, dtype=bool))
    problem = SimpleNamespace(data=data, weight=weight, policy=POLICY)
    before, after = (
        SimpleNamespace(fitted=SimpleNamespace(error=np.where(weight > 0.0, usual, left_out)))
        for usual, left_out in zip((0.19, 0.11), out, strict=True)
    )
    assert single.worse_on_the_whole(problem, before, after) == worse
    assert not worse or SingleRecording().doubted(problem, before, after)


@pytest.mark.parametrize(
    ("missing", "left", "noise", "replicas", "told"),
    [
        (44.0, 4.9, 1.0, [0.1, -0.2, 0.3], "dwells"),
        (60.0, 4.9, 1.0, [0.1, -0.2, 0.3], ""),
        (20.0, 2.4, 1.0, [0.1, -0.2, 0.3], ""),
        (44.0, 4.9, 2.0, [0.1, -0.2, 0.3], ""),
        (44.0, 6.0, 1.0, [2.5, 2.9, 2.0], ""),
        (44.0, 6.0, 1.0, [0.0, 4.0, 0.0], ""),
        (44.0, 6.0, 1.0, [], "dwells"),
    ],
)
def test_one_experiment_says_the_contrary(
    monkeypatch: pytest.MonkeyPatch,
    missing: float,
    left: float,
    noise: float,
    replicas: list[float],
    told: str,
) -> None:
    """Where an effect leaves more than a tenth, three times the noise and far above axes that have that effect.

    Dwell time in the place of friction that falls with speed left 44 → 4.9 of the dwells, 47 → 0.6 of the triangles.
    """

    def shared(problem: object, correction: object, error: float, rests: object) -> repeated._Shared:
        return repeated._Shared(0.0, 0.0, np.array([[0.1, noise], [error, noise]]))

    monkeypatch.setattr(repeated, "rests_of", lambda *_: None)
    monkeypatch.setattr(repeated, "_shared", shared)
    monkeypatch.setattr(repeated, "null_errors", lambda *_: replicas)
    blocks = [SimpleNamespace(role="training", repeats=2, name=name) for name in ("scans", "dwells")]
    problem = SimpleNamespace(
        policy=POLICY,
        data=SimpleNamespace(blocks=blocks),
        controller=SimpleNamespace(in_band=False),
        by_counts=None,
        noise_variance=lambda *_: noise,
    )
    root, fit = (
        SimpleNamespace(
            correction=None, fitted=SimpleNamespace(error=error, packed=None), effects=("spring",)
        )
        for error in (missing, left)
    )
    assert RepeatedProgramme().unlike_in_one(problem, root, fit) == told
    elements = SimpleNamespace(correction=None, fitted=fit.fitted, effects=("reversal_memory",))
    assert not RepeatedProgramme().unlike_in_one(problem, root, elements)


@pytest.mark.parametrize(
    ("seconds", "pull", "shown", "edge"),
    [
        (0.1, -1.0, 1.0, True),
        (0.1, 1.0, 1.0, False),
        (0.1, 0.0, 1.0, False),
        (0.4, -1.0, 1.0, False),
        (0.1, 0.0, 0.03, True),
        (0.4, 0.0, 0.03, False),
    ],
)
def test_an_effect_that_would_go_on_beyond_its_law_is_at_its_edge(
    seconds: float, pull: float, shown: float, edge: bool
) -> None:
    """Contacts that age within 0.1 s are friction that falls with speed; `pull`: where the data would take them.

    `shown`: how much of the time constant the data show; at 0.1 s it has to be told from nothing.
    """
    kind = EFFECTS["dwell_time_break_away"]
    packed = base_model(NOMINAL).with_effect(
        kind.make({"rise": 0.01, "time_constant": seconds, "slip": 0.01})
    )
    free = tuple(varying(kind, name, Vary(0.5, lower=0.1)) for name in ("rise", "time_constant"))
    random = np.random.default_rng(3)
    columns = random.normal(size=(6000, 2)) * [1.0, shown]
    error = random.normal(size=6000) - 0.2 * pull * columns[:, 1]
    fitted = SimpleNamespace(
        packed=packed.pack(), free=free, jacobian=columns, error=error, scales=[0.01, 0.5]
    )
    problem = SimpleNamespace(policy=POLICY, training=np.ones(6000))
    assert at_an_edge(problem, SimpleNamespace(effects=(kind.name,), fitted=fitted)) == edge
    assert not at_an_edge(problem, SimpleNamespace(effects=(kind.name, "spring"), fitted=fitted))


@pytest.mark.parametrize(
    ("gain", "part", "overlooked"), [(0.86, 0.016, True), (0.86, 0.004, False), (0.4, 0.016, False)]
)
def test_what_gains_half_of_unseen_data_is_never_nothing(
    monkeypatch: pytest.MonkeyPatch, gain: float, part: float, overlooked: bool
) -> None:
    """Unless it is as small as what measurement chains leave, 0.7 % of the torque, and may be chance."""
    monkeypatch.setattr(single, "part_of_torque", lambda *_: part)
    monkeypatch.setattr(SingleRecording, "_likely", lambda *_: [])
    item = SimpleNamespace(effect="nonlinear_viscous", gain=gain)
    found = SingleRecording().overlooked(SimpleNamespace(policy=POLICY), SimpleNamespace(), [item])
    assert (found is item) == overlooked
    repeated = RepeatedProgramme().overlooked(SimpleNamespace(policy=POLICY), SimpleNamespace(), [item])
    assert (repeated is item) == overlooked


@pytest.mark.parametrize(
    ("part", "likely", "slides", "beats", "overlooked"),
    [
        (0.006, True, True, True, True),
        (0.001, True, True, True, False),  # below what a current is resolved to
        (0.006, False, True, True, False),
        (0.006, True, False, True, False),  # another law of presliding
        (0.006, True, True, False, False),
    ],
)
def test_what_is_only_too_small_for_a_name_is_something(
    monkeypatch: pytest.MonkeyPatch, part: float, likely: bool, slides: bool, beats: bool, overlooked: bool
) -> None:
    """Waves of 0.62 % of the torque, 13 standard errors beyond chance, were "nothing missing": a chain may make them,
    but these data show them."""
    item = SimpleNamespace(effect="torque_ripple", gain=0.2, fitted=None)
    monkeypatch.setattr(single, "part_of_torque", lambda *_: part)
    monkeypatch.setattr(single, "while_sliding", lambda *_: slides)
    monkeypatch.setattr(single, "beats_chance", lambda *_: beats)
    monkeypatch.setattr(SingleRecording, "_likely", lambda *_: [item] if likely else [])
    root = SimpleNamespace(fitted=None)
    found = SingleRecording().overlooked(SimpleNamespace(policy=POLICY), root, [item])
    assert (found is item) == overlooked


@pytest.mark.parametrize(
    ("gain", "evenly", "agree", "beside", "likely"),
    [
        (0.86, 2.8, False, (), True),
        (0.86, 1.4, False, (), False),
        (0.3, 2.8, False, (), False),
        (0.3, 1.4, True, (), True),
        (0.3, 1.4, True, ("direction_asymmetry",), False),  # so does what that one's law leaves
    ],
)
def test_an_effect_that_lowers_every_stretch_by_half_is_no_chance(
    monkeypatch: pytest.MonkeyPatch,
    gain: float,
    evenly: float,
    agree: bool,
    beside: tuple[str, ...],
    likely: bool,
) -> None:
    """It may be large in one experiment and small in another, which the scatter of its fall takes for chance."""
    monkeypatch.setattr(single, "visible", lambda *_: True)
    monkeypatch.setattr(single, "beats_signs", lambda *_: agree)
    item = SimpleNamespace(effect="nonlinear_viscous", gain=gain, z=1.9, evenly=evenly, fitted=None)
    problem = SimpleNamespace(policy=POLICY, data=SimpleNamespace(periodic=(), steady=False))
    root = SimpleNamespace(fitted=None, effects=beside)
    assert bool(SingleRecording()._likely(problem, root, [item], POLICY.least_gain_single)) == likely


def _in_strokes(signs: list[float]) -> tuple[Problem, Fitted, Fitted]:
    """40 s, noise, and a shape of a second that is there in some of them, with these signs; base and candidate."""
    rows, random = np.arange(8000), np.random.default_rng(3)
    shape = np.zeros(len(rows))
    error = random.normal(0.0, 1.0, len(rows))
    for number, sign in enumerate(signs):
        inside = slice(400 * number + 50, 400 * number + 150)
        shape[inside] = 1.0
        error[inside] += 8.0 * sign
    data = SimpleNamespace(folds=rows // 400, second=200, role=lambda *_: np.ones(len(rows), dtype=bool))
    problem = SimpleNamespace(data=data, training=np.ones(len(rows)), policy=POLICY)
    base = np.column_stack([np.ones(len(rows)), np.sin(rows / 90.0)])
    fits = [SimpleNamespace(error=error, jacobian=table) for table in (base, np.column_stack([base, shape]))]
    return problem, *fits


@pytest.mark.parametrize(
    ("signs", "agree"),
    [([1.0] * 10, True), ([1.0, -1.0] * 5, False), ([1.0] * 3, False)],
)
def test_a_gain_in_a_few_strokes_is_no_accident_where_they_agree(signs: list[float], agree: bool) -> None:
    """Of three strokes any signs agree once in four; of ten hardly ever."""
    problem, base, candidate = _in_strokes(signs)
    assert single.beats_signs(problem, base, candidate, POLICY.least_z_single) is agree


def test_what_is_left_of_several_errors_is_what_is_left_of_each() -> None:
    problem, _, candidate = _in_strokes([1.0, -1.0, 1.0])
    errors = np.column_stack([candidate.error, candidate.error[::-1]])
    left = left_unseen(problem, errors, candidate.jacobian)
    each = [held_out(problem, error, candidate.jacobian).total for error in errors.T]
    assert left == pytest.approx(each, rel=1e-9)
    assert [len(rows) for rows in chunks_held_out(problem)] == [200] * 40


@pytest.mark.parametrize(
    ("part", "gain", "evenly", "exact", "slides", "beyond", "beside", "effect", "matters"),
    [
        (0.008, 0.2, 0.0, False, True, False, (), "stribeck", True),
        (0.004, 0.2, 0.0, False, True, False, (), "stribeck", False),
        (
            0.004,
            0.9,
            4.0,
            False,
            True,
            False,
            (),
            "stribeck",
            True,
        ),  # in a few quick moves, but in all of them
        (0.004, 0.9, 2.6, False, True, False, (), "stribeck", False),
        (0.001, 0.2, 0.0, True, True, False, (), "stribeck", True),  # all that the chain does is known
        (0.001, 0.2, 0.0, True, False, False, (), "stribeck", False),  # another law of presliding
        (0.001, 0.9, 4.0, True, True, True, (), "torque_lag", False),
        (0.001, 0.2, 0.0, False, False, True, (), "stribeck", True),  # no chain explains it
        (
            0.001,
            0.2,
            0.0,
            False,
            False,
            True,
            ("spring",),
            "stribeck",
            False,
        ),  # as little as that one's law leaves
    ],
)
def test_so_little_is_the_measurement_chain_where_that_is_not_known(
    monkeypatch: pytest.MonkeyPatch,
    part: float,
    gain: float,
    evenly: float,
    exact: bool,
    slides: bool,
    beyond: bool,
    beside: tuple[str, ...],
    effect: str,
    matters: bool,
) -> None:
    monkeypatch.setattr(single, "part_of_torque", lambda *_: part)
    monkeypatch.setattr(single, "while_sliding", lambda *_: slides)
    monkeypatch.setattr(single, "beyond_chain", lambda *_: beyond)
    item = SimpleNamespace(effect=effect, gain=gain, z=2.6, evenly=evenly)
    problem = SimpleNamespace(policy=POLICY, twin=True, controller=SimpleNamespace(exact=exact))
    root = SimpleNamespace(fitted=None, effects=beside)
    assert single.matters(problem, root, item) is matters


def test_what_a_disturbance_makes_by_itself_tells_nothing_where_nothing_is_repeated() -> None:
    """Nor what a level that wanders makes of a coordinate: a large gain by chance."""
    sizes = {"velocity": 0.4, "acceleration": 0.2, "position": 0.1, "time": 0.5, "travel_since_reversal": 0.6}
    gains = {name: Gain(size, 3.0, 0.0) for name, size in sizes.items()}
    gains["velocity"] = Gain(0.4, 1.4, -1.1)
    gains["travel_since_reversal"] = Gain(0.6, 1.9, 4.0)  # in a few quick moves, but in all of them
    assert set(SingleRecording().telling(POLICY, gains)) == {"position", "travel_since_reversal"}
    assert RepeatedProgramme().telling(POLICY, gains) == sizes


@pytest.mark.parametrize(
    ("effect", "least"), [("torque_lag", 0.5), ("elastic_transmission", 0.5), ("stribeck", 0.08)]
)
def test_what_bends_to_any_dynamics_must_be_plain_in_a_lone_recording(effect: str, least: float) -> None:
    item = SimpleNamespace(effect=effect)
    assert least_of(POLICY, item, POLICY.least_gain_single) == pytest.approx(least)


@pytest.mark.parametrize(("compliance", "doubted"), [(2.2e-2, True), (3.5e-1, False)])
def test_motor_and_load_ring_where_it_is_compared(compliance: float, doubted: bool) -> None:
    """Compared below 45 Hz: a ring at about 200 Hz was the lag of a current loop, one at 50 Hz can be seen.

    Where a lag by itself gains next to nothing, it is none.
    """
    kind = EFFECTS["elastic_transmission"]
    values = {"compliance": compliance, "load_inertia": 0.5, "load_friction": 0.3, "damping": 0.05}
    packed = base_model(NOMINAL | {"inertia": 1.07e-4}).with_effect(kind.make(values)).pack()
    fit = SimpleNamespace(effects=(kind.name,), fitted=SimpleNamespace(packed=packed))
    data = SimpleNamespace(cutoff=45.0, period=2e-3, upsampling=1, lag=0.0)
    problem = SimpleNamespace(data=data, policy=POLICY, controller=None, has_veto=False)
    evidence = RepeatedProgramme()
    assert evidence.doubted(problem, fit, fit) == doubted
    found, near, far = (
        SimpleNamespace(effect=effect, gain=gain)
        for effect, gain in ((kind.name, 0.4), ("torque_lag", 0.3), ("torque_lag", 0.0))
    )
    assert evidence.doubted(problem, fit, fit, [found, near]) == doubted
    assert not evidence.doubted(problem, fit, fit, [found, far])
    law = SimpleNamespace(within=True, exact=True)
    drive = SimpleNamespace(data=data, policy=POLICY, controller=law, has_veto=False)
    little = SimpleNamespace(effect=kind.name, gain=0.1)
    assert evidence.doubted(drive, fit, fit, [little, far]), (
        "a drive's law is not known above what is compared"
    )
    assert not evidence.doubted(drive, fit, fit, [found, far]), "so much of the error is no law's rest"
    coarse = SimpleNamespace(cutoff=20.0, period=1e-3, upsampling=1, lag=0.0)
    drive = SimpleNamespace(data=coarse, policy=POLICY, controller=law, has_veto=False)
    assert evidence.doubted(drive, fit, fit, [little, far]) == doubted, (
        "of a law that is known below 60 Hz counts that lower what is compared hide nothing"
    )


@pytest.mark.parametrize(
    ("lag", "period", "exact", "gain", "doubted"),
    [
        (0.0, 1e-3, True, 0.1, False),
        (3e-5, 1e-3, True, 0.1, False),
        (1e-4, 1e-3, True, 0.1, True),
        (1e-4, 1e-3, True, 0.4, False),
        (0.0, 1e-3, False, 0.4, True),
        (0.0, 4e-3, True, 0.4, True),
    ],
    ids=[
        "a loop as it is",
        "a ninth of a radian at most",
        "a slower current loop",
        "so much is no rest of a lag that the twin has",
        "a dead time",
        "above half the rate",
    ],
)
def test_what_a_twin_lacks_of_phase_is_no_second_mass(
    lag: float, period: float, exact: bool, gain: float, doubted: bool
) -> None:
    """At about 200 Hz, where 45 Hz are compared; a lag by itself gains nothing, as the twin has it."""
    kind = EFFECTS["elastic_transmission"]
    values = {"compliance": 2.2e-2, "load_inertia": 0.5, "load_friction": 0.3, "damping": 0.05}
    packed = base_model(NOMINAL | {"inertia": 1.07e-4}).with_effect(kind.make(values)).pack()
    fit = SimpleNamespace(effects=(kind.name,), fitted=SimpleNamespace(packed=packed))
    data = SimpleNamespace(cutoff=45.0, period=period, upsampling=1, lag=lag)
    law = SimpleNamespace(within=False, exact=exact)
    problem = SimpleNamespace(data=data, policy=POLICY, controller=law, has_veto=False)
    first = [SimpleNamespace(effect=kind.name, gain=gain), SimpleNamespace(effect="torque_lag", gain=0.0)]
    assert RepeatedProgramme().doubted(problem, fit, fit, first) == doubted


@pytest.mark.parametrize(("memory", "doubted"), [(None, True), (0.35, True), (0.0, False)])
def test_motor_and_load_that_ring_above_what_was_recorded_are_no_memory_where_that_gains_far_less(
    memory: float | None, doubted: bool
) -> None:
    """At about 200 Hz, rows at 4 ms: what they are there a memory is too, if it was looked for and gains as much."""
    kind = EFFECTS["elastic_transmission"]
    values = {"compliance": 2.2e-2, "load_inertia": 0.5, "load_friction": 0.3, "damping": 0.05}
    packed = base_model(NOMINAL | {"inertia": 1.07e-4}).with_effect(kind.make(values)).pack()
    fit = SimpleNamespace(effects=(kind.name,), fitted=SimpleNamespace(packed=packed))
    data = SimpleNamespace(cutoff=45.0, period=4e-3, upsampling=1, lag=0.0)
    law = SimpleNamespace(within=False, exact=True)
    problem = SimpleNamespace(data=data, policy=POLICY, controller=law, has_veto=False)
    gains = {kind.name: 0.4, "torque_lag": 0.0} | ({} if memory is None else {"reversal_memory": memory})
    first = [SimpleNamespace(effect=effect, gain=gain) for effect, gain in gains.items()]
    assert RepeatedProgramme().doubted(problem, fit, fit, first) == doubted


@pytest.mark.parametrize("within", [True, False])
@pytest.mark.parametrize(
    ("effect", "damping", "doubted"),
    [
        ("elastic_transmission", 0.25, False),
        ("elastic_transmission", 0.99, False),
        ("elastic_transmission", 1.0, True),
        ("elastic_transmission", 2.0, True),
        ("backlash", 2.0, False),  # a gap has a width that tells
    ],
)
def test_a_load_that_does_not_ring_is_no_elastic_transmission(
    effect: str, damping: float, doubted: bool, within: bool
) -> None:
    """In sight, and two thirds of the error: on an axis with nothing planted, and beside an eccentricity, springs of
    1.5 and 2.0 times critical damping were named, confirmed."""
    kind = EFFECTS[effect]
    compliance = "compliance" if effect == "elastic_transmission" else "contact_compliance"
    values = {compliance: 0.35, "load_inertia": 0.5, "load_friction": 0.3, "damping": damping}
    if effect == "backlash":
        values["gap"] = 0.01
    packed = base_model(NOMINAL | {"inertia": 1.07e-4}).with_effect(kind.make(values)).pack()
    fit = SimpleNamespace(effects=(kind.name,), fitted=SimpleNamespace(packed=packed))
    data = SimpleNamespace(cutoff=45.0, period=1e-3, upsampling=1, lag=0.0)
    law = SimpleNamespace(within=within, exact=True)
    problem = SimpleNamespace(data=data, policy=POLICY, controller=law, has_veto=False)
    first = [SimpleNamespace(effect=kind.name, gain=0.67), SimpleNamespace(effect="torque_lag", gain=0.0)]
    assert RepeatedProgramme().doubted(problem, fit, fit, first) == doubted


def test_a_repeated_programme_without_repeated_veto_is_confirmed_by_what_is_carried_only() -> None:
    problem = SimpleNamespace(twin=True, veto_repeats=False)
    carried = [HoldoutResult("spring", 0.5, 4.0, lowers=True)]
    assert RepeatedProgramme().confirms(problem, ["spring"], carried)
    assert not RepeatedProgramme().confirms(problem, ["spring"], [])
    assert not RepeatedProgramme().confirms(problem, ["spring", "stribeck"], carried)


def test_chance_of_one_experiment_hides_nothing_of_another() -> None:
    """Presliding below the quantiser is chaotic: −2 ± 1 there and 0.15 ± 0.01 elsewhere is not "nothing left"."""
    random = np.random.default_rng(2)
    noisy = np.column_stack([-2.0 + 3.0 * random.normal(size=9), np.ones(9)])
    quiet = np.column_stack([0.15 + 0.03 * random.normal(size=9), np.ones(9)])
    problem = SimpleNamespace(_repeatable_chunks=lambda *_: [noisy, quiet], _wanders=lambda _: 0.0)
    certain = Problem.repeatable_for_certain(problem, None, None, "training")
    assert 0.04 < certain < 0.075
    assert Problem.repeatable(problem, None, None, "training")[0] < 0.0


@pytest.mark.parametrize(
    ("level", "chaotic", "told"), [(0.0, 0.0, 0.01), (1.0, 0.0, 1.0), (0.0, 5.0, 0.01)],
    ids=["noise", "a level that wanders", "chaos in one experiment"],
)  # fmt: skip
def test_what_wanders_over_an_experiment_is_one_number_in_each_repeat(
    level: float, chaotic: float, told: float
) -> None:
    """Variance between the repeats of forty experiments of 100 rows, in noise of one."""
    random = np.random.default_rng(5)
    blocks = tuple(Block(f"part {i}", "training", 200 * i, 2, 100) for i in range(40))
    error = random.standard_normal(8000) + np.repeat(level * random.standard_normal(80), 100)
    error[:100] += chaotic
    problem = SimpleNamespace(
        data=SimpleNamespace(blocks=blocks),
        compared=lambda block, values: block.by_repeat(values),
        _counts=lambda _: True,
    )
    assert Problem._wanders(problem, error) == pytest.approx(told, rel=0.4)
    # where no row of most of them counts, these tell nothing
    problem._counts = lambda block: block.start < 3000
    problem.compared = lambda block, values: block.by_repeat(values) * problem._counts(block)
    assert Problem._wanders(problem, error) == pytest.approx(told, rel=0.6)
    rows = np.column_stack([1.0 + 0.1 * random.standard_normal(9), np.ones(9)])
    problem = SimpleNamespace(_repeatable_chunks=lambda *_: [rows], _wanders=lambda _: told)
    assert Problem.repeatable(problem, error, None, "training")[1] == pytest.approx(
        math.hypot(told, 0.03), rel=0.2
    )
    assert (Problem.repeatable_for_certain(problem, error, None, "training") > 0.0) == (told < 0.4)


def test_points_of_a_speed_curve_have_a_speed_and_nothing_else() -> None:
    speed = np.linspace(-5.0, 5.0, 30)
    data = SimpleNamespace(velocity=speed, grid=np.arange(30), temperature=None, steady=True)
    assert set(coordinates(data)) == {"velocity", "direction"}
    assert set(generic_columns(data, np.ones(30, dtype=bool))) == {"velocity"}


@pytest.mark.parametrize(("cost", "taken"), [(1.2, True), (4.5, False), (0.5, True)])
def test_the_usual_damping_is_not_put_where_the_recording_contradicts_it(
    monkeypatch: pytest.MonkeyPatch, cost: float, taken: bool
) -> None:
    """A contact without damping, 4.5 times worse with the usual one, was held at that: memory was "confirmed"."""
    undamped = base_model(NOMINAL | {"micro_damping": 0.0}).pack()
    monkeypatch.setattr(contact_start, "_twin_cost", lambda _, packed: 1.0 if packed is undamped else cost)
    found = contact_start.quiet_contact(SimpleNamespace(twin=True), undamped)
    assert (found is not None) == taken


@pytest.mark.parametrize(("events", "left_out"), [(1, 250), (3, 750), (4, 0)])
def test_what_happens_again_and_again_belongs_to_the_axis(events: int, left_out: int) -> None:
    """A knock is left out; a load that rings at every start is what is missing."""
    error = np.random.default_rng(4).normal(size=20_000)
    for i in range(events):
        error[2000 + 3000 * i : 2250 + 3000 * i] *= 20.0
    data = SimpleNamespace(pace=1.0, period=1e-3, grid=np.arange(20_000))
    problem = SimpleNamespace(weight=np.ones(20_000), data=data, twin=True)
    assert np.sum(without_outlying(problem, error) == 0.0) == left_out


@pytest.mark.parametrize(
    ("doubted", "repeats", "named", "left", "kept"),
    [
        (True, True, True, 0.6, 1), (True, True, False, 0.6, 1), (False, True, False, 0.6, 2),
        (True, False, True, 0.6, 2), (False, True, True, 0.6, 2), (False, True, True, 0.4, 2),
    ],
)  # fmt: skip
def test_what_stands_beside_a_doubtful_second_mass_keeps_its_name(
    monkeypatch: pytest.MonkeyPatch, doubted: bool, repeats: bool, named: bool, left: float, kept: int
) -> None:
    """Behind a drive's loop a motor and load of no axis stood beside a true Stribeck effect, and nothing was named.

    In a lone recording the doubt is one of all effects together. What has a name by itself is a measure of the mass
    where that lowers half of all that it leaves: beside a spring that explains 99 % a transmission of 2.6 times the
    noise lowered 14 % of the whole.
    """

    def candidate(effects: tuple[str, ...], error: float) -> Item:
        fitted = SimpleNamespace(effects=effects, fitted=SimpleNamespace(error=error))
        return Item(effects[-1], fitted, named=named)

    alone, both = candidate(("stribeck",), 1.0), candidate(("stribeck", "elastic_transmission"), left)
    monkeypatch.setattr(
        backward, "without_effect", lambda _problem, _root, _fit, effect: alone if "el" in effect else None
    )
    asked = []
    evidence = SimpleNamespace(repeats=repeats, doubted=lambda *told: asked.append(told[-1]) or doubted)
    problem, root = (
        SimpleNamespace(has_veto=True, policy=POLICY, mean_square=lambda error, _: error),
        SimpleNamespace(),
    )
    found, unloaded = backward.Backward(problem, root, evidence, no_progress).without_doubtful_load(both, ())
    tells = alone.model_fit if not named or left < POLICY.partly else None
    assert len(found.model_fit.effects) == kept
    assert asked == ([tells] if repeats else [])
    assert unloaded is (tells if kept == 2 and repeats else None)


@pytest.mark.parametrize(("left", "doubted"), [(1.0, True), (0.75, True), (0.6, False)])
def test_a_second_mass_beside_others_is_measured_by_what_these_leave(left: float, doubted: bool) -> None:
    """Beside windage a spring of 180 Hz lowered the veto's error by 69 %, of all that the base leaves by 28 %."""
    kind = EFFECTS["elastic_transmission"]
    values = {"compliance": 2.2e-2, "load_inertia": 0.5, "load_friction": 0.3, "damping": 0.05}
    packed = base_model(NOMINAL | {"inertia": 1.07e-4}).with_effect(kind.make(values)).pack()
    data = SimpleNamespace(cutoff=45.0, period=2e-3, upsampling=1, lag=0.0)
    law = SimpleNamespace(within=True, exact=True)
    problem = SimpleNamespace(data=data, policy=POLICY, controller=law, has_veto=True)
    problem.mean_square = lambda error, _: error

    def fit(effects: tuple[str, ...], error: float) -> SimpleNamespace:
        return SimpleNamespace(effects=effects, fitted=SimpleNamespace(packed=packed, error=error))

    root, alone = fit((), 10.0), fit(("nonlinear_viscous",), 1.0)
    both = fit(("nonlinear_viscous", kind.name), left)
    first = [SimpleNamespace(effect=kind.name, gain=0.28), SimpleNamespace(effect="torque_lag", gain=0.0)]
    assert RepeatedProgramme().doubted(problem, root, both, first), "as screened, in what windage makes"
    assert RepeatedProgramme().doubted(problem, root, both, first, alone) == doubted


@pytest.mark.parametrize("between", ["elastic_transmission", "backlash"])
@pytest.mark.parametrize(("stiff", "kept"), [(True, 1), (False, 2)])
def test_a_transmission_beside_a_pressed_contact_must_do_more_than_tell_what_presses(
    monkeypatch: pytest.MonkeyPatch, between: str, stiff: bool, kept: int
) -> None:
    """Load dependence with preload was named with a spring of 142 Hz; one that nobody could see did as well."""
    pressed = ("load_dependent_friction", between)
    alone, both = (Item(one[-1], SimpleNamespace(effects=one)) for one in (pressed[:1], pressed))
    monkeypatch.setattr(backward, "without_effect", lambda *_: alone)
    monkeypatch.setattr(backward, "stiff_as_well", lambda *_: stiff)
    steps = backward.Backward(None, None, SimpleNamespace(repeats=True), no_progress)
    assert len(steps.without_stiff_load(both).model_fit.effects) == kept
    assert steps.without_stiff_load(alone) is alone


@pytest.mark.parametrize(
    ("between", "compliance"), [("elastic_transmission", "compliance"), ("backlash", "contact_compliance")]
)
@pytest.mark.parametrize(("left", "stiff"), [(0.45, True), (0.9, False), (None, False)])
def test_a_spring_that_no_sample_sees_leaves_no_elasticity(
    monkeypatch: pytest.MonkeyPatch, between: str, compliance: str, left: float | None, stiff: bool
) -> None:
    """Costs: 1.0 without the spring, 0.4 with it; `left` with motor and load in one piece, and two sides that press."""
    seen = []

    def fit(_: object, packed: Packed, free: list[SimpleNamespace], *__: object) -> SimpleNamespace | None:
        seen.append((packed.p, [one.slot for one in free]))
        return None if left is None else SimpleNamespace(fitted=SimpleNamespace(cost=left))

    monkeypatch.setattr(transmission, "fit_inside_twin", fit)
    packed, spring = base_model(NOMINAL).pack(), EFFECTS[between]
    slots = [spring.slot(name) for name in (compliance, "damping", "load_inertia")]
    packed.p[slots] = 1.0, 0.1, 0.5
    free = tuple(SimpleNamespace(slot=slot) for slot in slots)
    whole, less = (
        SimpleNamespace(fitted=SimpleNamespace(packed=packed, cost=cost), free=free, effects=(between,))
        for cost in (0.4, 1.0)
    )
    problem = SimpleNamespace(policy=POLICY, data=SimpleNamespace(period=1e-3))
    assert transmission.stiff_as_well(problem, less, whole) == stiff
    p, freed = seen[0]
    ringing, damping = p[slots[:2]]
    assert 1.0 / (2.0 * np.pi * np.sqrt(ringing * 0.25 * p[layout.INERTIA])) >= 500.0
    assert damping >= CRITICAL
    assert freed == slots[2:]


@pytest.mark.parametrize(
    ("fall", "share", "enters"), [(0.02, 0.95, True), (0.02, 0.8, False), (0.002, 0.95, False)]
)
def test_what_was_found_first_must_be_worth_having_beside_the_rest(
    monkeypatch: pytest.MonkeyPatch, fall: float, share: float, enters: bool
) -> None:
    """A motor that saturates was named with the load dependence that had stood for it: 0.3 % of what both explain."""
    part = SimpleNamespace(fall=fall, share=share)
    monkeypatch.setattr(backward, "explained_beside", lambda *_: part)
    monkeypatch.setattr(candidates, "explained_of_rest", lambda *_: [part])
    monkeypatch.setattr(backward, "least_fall", lambda *_: 0.01)
    problem = SimpleNamespace(policy=POLICY, has_veto=True, veto_repeats=True)
    fit = SimpleNamespace(model_fit=None, named=True, veto=part)
    steps = backward.Backward(problem, None, RepeatedProgramme(), no_progress)
    assert steps.enters_beside(fit, fit) == enters


@pytest.mark.parametrize(
    ("excused", "falls", "has_veto", "repeats", "without", "kept"),
    [
        (0.9, False, True, True, 0.3, 1),
        (0.9, True, True, True, 0.3, 2),  # beyond chance, and as much by a law that differs
        (0.2, False, True, True, 0.3, 2),  # in a few seconds, most of what is there, and a name
        (0.1, False, True, True, 0.3, 2),  # next to all
        (0.9, False, True, True, 0.4, 2),  # a third of what both explain is no crumb: half is enough
        (1.1, False, True, True, 0.7, 1),
        (0.9, False, False, True, 0.3, 2),
        (0.9, False, True, False, 0.3, 2),
    ],
)
def test_what_the_veto_does_not_bear_out_goes_though_nothing_is_named_without_it(
    monkeypatch: pytest.MonkeyPatch,
    excused: float,
    falls: bool,
    has_veto: bool,
    repeats: bool,
    without: float,
    kept: int,
) -> None:
    """A viscosity by films explained 96 % of what load dependence left, and of the veto all that was not excused.

    Costs: 1.0 of the root, 0.1 of both, `without` the second.
    """

    def fit(cost: float, *effects: str) -> SimpleNamespace:
        return SimpleNamespace(effects=effects, fitted=SimpleNamespace(cost=cost))

    def item(cost: float, *effects: str, named: bool) -> Item:
        return Item(effects[-1], fit(cost, *effects), named=named)

    both = item(0.1, "load_dependent_friction", "nonlinear_viscous", named=True)
    alone = item(without, "load_dependent_friction", named=False)
    part = Explained(1.0, 0.0, excused=excused)
    monkeypatch.setattr(backward, "explained_beside", lambda _, *__: part)
    monkeypatch.setattr(backward, "falls_on_veto", lambda *_: falls)
    for name in ("negligible", "differ_by_chance"):
        monkeypatch.setattr(backward, name, lambda *_: False)
    monkeypatch.setattr(backward, "without_effect", lambda *told: alone if "viscous" in told[-1] else None)
    problem = SimpleNamespace(policy=POLICY, has_veto=has_veto)
    evidence = SimpleNamespace(repeats=repeats)
    found = backward.Backward(problem, fit(1.0), evidence, no_progress).pruned(both, ())
    assert len(found.model_fit.effects) == kept


@pytest.mark.parametrize(("course", "free"), [(("coulomb",), False), (("coulomb", "viscous", "width"), True)])
def test_a_second_effect_is_needed_only_beside_a_first_with_a_course_as_free(
    course: tuple[str, ...], free: bool
) -> None:
    """By its own law an asymmetry left what a spring explained, and was not tried without it once its course was free.

    What is free of the spring does not matter.
    """
    kind, spring = EFFECTS["direction_asymmetry"], EFFECTS["elastic_transmission"]

    def fit(effects: tuple[str, ...], *slots: int) -> SimpleNamespace:
        return SimpleNamespace(effects=effects, free=[SimpleNamespace(slot=slot) for slot in slots])

    own = [kind.slot(name) for name in ("coulomb", "viscous", "width")]
    both = fit((kind.name, spring.name), layout.INERTIA, *own, spring.slot("compliance"))
    alone = fit((kind.name,), layout.INERTIA, *(kind.slot(name) for name in course))
    assert backward.as_free(alone, both) == free


@pytest.mark.parametrize(("loss", "edge"), [(0.0, False), (1e-4, True)], ids=["a course", "its law"])
def test_a_course_in_the_place_of_a_law_is_at_no_edge_of_it(loss: float, edge: bool) -> None:
    """Knees alone bend a motor's torque: that the data would take a loss that is not there below nothing says nothing.

    Motors that saturate suddenly, behind a cascade and a drive's PID, had all their look-alikes beside them so."""
    kind = EFFECTS["torque_saturation"]
    packed = base_model(NOMINAL).with_effect(kind.make({"loss": loss, "torque": 1.0}))
    free = (varying(kind, "loss", Vary(0.2)),)
    random = np.random.default_rng(3)
    column = random.normal(size=(6000, 1))
    error = random.normal(size=6000) + 0.2 * column[:, 0]
    fitted = SimpleNamespace(packed=packed.pack(), free=free, jacobian=column, error=error, scales=[0.2])
    problem = SimpleNamespace(policy=POLICY, training=np.ones(6000))
    assert at_an_edge(problem, SimpleNamespace(effects=(kind.name,), fitted=fitted)) == edge
