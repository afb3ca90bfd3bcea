"""Every effect: the inverse routine gives back the torque that the forward routine was driven with.

One definition of the physics serves both; the test drives the plant open loop and asks the inverse what
torque the resulting motion needed.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.models import layout
from autotune.models.contact import friction_limit, stiffened
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.dwell_time_break_away import AGE, DWELL_TIME_BREAK_AWAY, grow_older
from autotune.models.encoder_eccentricity import parts, reading_error, true_motion
from autotune.models.inverse import applied_torque, load_substeps, required
from autotune.models.load_dependent_friction import PRESSED, transmitted
from autotune.models.plant import simulate, substeps_for
from autotune.models.reversal_memory import AT_ONCE
from autotune.models.table import EFFECTS
from autotune.models.torque_saturation import bent, saturated, torque_slope

PERIOD = 1e-3
NUMBERS = {
    "inertia": 6.66e-4, "viscous": 4.13e-3, "coulomb": 0.30, "stiffness": 60.0, "micro_damping": 0.1,
    "offset": 0.048,
}  # fmt: skip
VALUES: dict[str, dict[str, float]] = {
    "torque_ripple": {"order_1": 12, "sin_1": 0.02, "cos_1": 0.01},
    "direction_asymmetry": {"coulomb": 0.04, "viscous": 1e-3},
    "stribeck": {"break_away": 0.38, "stribeck_velocity": 0.3},
    "nonlinear_viscous": {"torque": 0.05, "exponent": 0.66, "knee": 0.05},
    "position_dependent_friction": {"height": 0.3, "centre": 0.5, "width": 0.8},
    "gravity_imbalance": {"sin": 0.05, "cos": -0.03},
    "spring": {"stiffness": 0.03},
    "reversal_memory": {
        "displacement_1": 0.01, "torque_1": 0.05, "displacement_2": 0.1, "torque_2": 0.05, "damping": 0.02,
    },
    "thermal_drift": {"softening": 0.3, "time_constant": 5.0, "idle": 0.2},
    "elastic_transmission": {
        "compliance": 0.1, "load_inertia": 0.4, "load_friction": 0.4, "damping": 0.05,
    },
    "backlash": {
        "gap": 2e-2, "contact_compliance": 3e-3, "load_inertia": 0.4, "load_friction": 0.4, "damping": 0.1,
    },
    "torque_lag": {"time_constant": 8e-4},
    "torque_saturation": {"loss": 0.25, "torque": 1.3},
    "dwell_time_break_away": {"rise": 0.25, "time_constant": 0.1, "slip": 2e-3},
    "load_dependent_friction": {"factor": 0.2, "friction_share": 0.3},
    "encoder_eccentricity": {"sin": 5e-3, "cos": -3e-3},
}  # fmt: skip
SHAPED: dict[str, dict[str, float]] = {
    "stribeck": {"break_away": 0.45, "stribeck_velocity": 0.1, "stribeck_exponent": 1.2, "stribeck_tail": 1.0},
    "direction_asymmetry": {"coulomb": 0.04, "viscous": 0.0, "width": 0.05, "fast": 0.02, "fast_width": 1.0},
    "nonlinear_viscous": {
        "torque": 0.01, "exponent": 0.66, "knee": 0.05, "film_1": 0.03, "film_speed_1": 0.2, "fan_1": 0.002,
        "fan_speed_1": 2.0,
    },
    "position_dependent_friction": {
        "height": 0.1, "centre": 0.5, "width": 0.8, "edge": 3.5, "from": -1.0, "step": 1.0, "rise_1": 0.2,
        "rise_3": -0.1,
    },
    "gravity_imbalance": {"sin": 0.05, "cos": -0.03, "sin_2": 0.02, "cos_2": 0.01},
    "spring": {"stiffness": 0.01, "from": -0.5, "step": 0.5, "ramp_1": 0.02, "ramp_3": 0.05},
    "reversal_memory": {
        "displacement_1": 0.01, "torque_1": 0.05, "displacement_2": 0.1, "torque_2": 0.05, "damping": 0.02,
        "yielding": 0.7,
    },
    "torque_lag": {"time_constant": 2e-2, "steepness": 0.6},
    "dwell_time_break_away": {
        "rise": 0.1, "time_constant": 0.1, "slip": 2e-3, "rise_2": 0.1, "time_constant_2": 0.01, "rise_3": 0.2,
        "time_constant_3": 1.0, "rest": 0.02, "bending": 0.6,
    },
    "load_dependent_friction": {
        "factor": 0.2, "friction_share": -0.5, "exponent": 1.4, "typical": 0.5, "preload": 0.05,
    },
    "torque_saturation": {
        "loss": 0.02, "torque": 0.6, "loss_1": 0.1, "knee_1": 0.1, "loss_2": 0.2, "knee_2": 0.3,
    },
    "encoder_eccentricity": {"sin": 0.05, "cos": -0.02, "sin_2": 0.01, "cos_2": 0.005},
}  # fmt: skip
"""Effects by a law of their own shape."""
CHAOTIC = {"backlash", "elastic_transmission"}


def test_what_a_tilted_disc_tells_is_undone_exactly() -> None:
    """Place, speed and acceleration of the shaft from those of the reading; derivatives by differences of 0.1 ms."""
    model = base_model(NUMBERS).with_effect(
        EFFECTS["encoder_eccentricity"].make(SHAPED["encoder_eccentricity"])
    )
    p = model.pack().p
    time = np.arange(0.0, 3.0, 1e-4)
    shaft = 3.0 * np.sin(2.0 * time)
    told = shaft + np.array([reading_error(p, x) for x in shaft])
    speed = np.gradient(told, time)
    found = np.array(
        [true_motion(p, *row) for row in zip(told, speed, np.gradient(speed, time), strict=True)]
    )
    right = np.column_stack([shaft, 6.0 * np.cos(2.0 * time), -4.0 * shaft])
    assert np.abs(found - right)[5:-5].max(axis=0) == pytest.approx(0.0, abs=2e-4)


@pytest.mark.parametrize("part", [0, 1])
def test_the_two_parts_of_what_an_encoder_off_centre_adds(part: int) -> None:
    """One goes with the acceleration, one with the square of the speed; to first order in what is told too much."""
    small = {name: 0.01 * value for name, value in SHAPED["encoder_eccentricity"].items()}
    p = base_model(NUMBERS).with_effect(EFFECTS["encoder_eccentricity"].make(small)).pack().p
    place, speed, gain = np.linspace(0.0, 6.0, 50), (0.0, 7.0)[part], (30.0, 0.0)[part]
    exact = np.array([p[layout.INERTIA] * (true_motion(p, x, speed, gain)[2] - gain) for x in place])
    found = parts(p, place, np.full(50, speed), np.full(50, gain))
    assert found[part] == pytest.approx(exact, abs=0.01 * float(np.abs(exact).max()))
    assert not found[1 - part].any()


def _model(effect: str) -> DriveModel:
    return base_model(NUMBERS).with_effect(EFFECTS[effect].make(VALUES[effect]))


@pytest.mark.parametrize("effect", list(SHAPED))
def test_the_inverse_gives_back_the_torque_of_a_free_shape(effect: str) -> None:
    """As close as with the effect's own law, and the shape matters."""
    model = base_model(NUMBERS).with_effect(EFFECTS[effect].make(SHAPED[effect]))
    own = {p.name: SHAPED[effect][p.name] for p in EFFECTS[effect].parameters if not p.optional}
    plain = base_model(NUMBERS).with_effect(EFFECTS[effect].make(own))
    torque = _drive()
    position = _forward(model, torque)
    right = np.sqrt(np.mean(_residual(model, torque, position) ** 2))
    assert right < 2.5e-3
    assert np.sqrt(np.mean(_residual(plain, torque, position) ** 2)) > max(1.5 * right, 1e-4)


def _forward(model: DriveModel, torque: np.ndarray) -> np.ndarray:
    packed, n = model.pack(), len(torque)
    position, demand, zero = np.empty(n), np.empty(n), np.zeros(n)
    loop = np.array([PERIOD, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    steps = 4 * substeps_for(packed.p, PERIOD, packed.on)
    done = simulate(
        packed.p, packed.on, np.zeros(layout.STATES), np.zeros(4), loop, False, steps, torque, zero, zero,
        zero, position, demand,
    )  # fmt: skip
    assert done == n
    return position


def _drive() -> np.ndarray:
    """Smooth torque that accelerates, reverses and rests."""
    time = np.arange(4000) * PERIOD
    wave = 0.55 * np.sin(2 * np.pi * 0.9 * time) + 0.15 * np.sin(2 * np.pi * 2.3 * time + 0.4)
    return 0.048 + wave * np.minimum(1.0, time / 0.3)


def _residual(model: DriveModel, torque: np.ndarray, position: np.ndarray) -> np.ndarray:
    packed = model.pack()
    velocity = np.gradient(position, PERIOD)
    acceleration = np.zeros_like(position)
    acceleration[1:-1] = np.diff(position, 2) / PERIOD**2
    needed, acted, state = np.empty(len(torque)), np.empty(len(torque)), np.zeros(layout.STATES)
    applied_torque(packed.p, packed.on, state, torque, PERIOD, acted)
    steps = load_substeps(packed.p, packed.on, PERIOD)
    required(packed.p, packed.on, state, position, velocity, acceleration, PERIOD, steps, needed)
    return (acted - needed)[5:-5]


@pytest.mark.parametrize("effect", list(EFFECTS))
def test_the_inverse_gives_back_the_torque(effect: str) -> None:
    """Discretisation costs below 2.5 mN m rms of 0.5 N m; two masses ring, and may cost 12."""
    torque, model = _drive(), _model(effect)
    position = _forward(model, torque)
    right = np.sqrt(np.mean(_residual(model, torque, position) ** 2))
    assert right < (1.2e-2 if effect in CHAOTIC else 2.5e-3)


@pytest.mark.parametrize("effect", sorted(CHAOTIC))
def test_the_inverse_gives_back_the_torque_where_a_contact_of_elements_is_on_both_sides(effect: str) -> None:
    """As well as where a bristle is; with the elements on the motor alone it is another axis."""
    elements = VALUES["reversal_memory"] | {"attraction": AT_ONCE}
    model = _model(effect).with_effect(EFFECTS["reversal_memory"].make(elements))
    beside = _model(effect).with_effect(EFFECTS["reversal_memory"].make(elements | {"attraction": 0.0}))
    torque = 1.2 * _drive()
    position = _forward(model, torque)
    right, wrong = (np.sqrt(np.mean(_residual(one, torque, position) ** 2)) for one in (model, beside))
    assert right < 1.2e-2
    assert wrong > 1.2 * right


STIFF = {"compliance": 2e-4, "load_inertia": 0.98, "load_friction": 0.0, "load_offset": 1.0, "damping": 1.0}
GOES_THROUGH_THE_SPRING = {"load_dependent_friction", "encoder_eccentricity"}
"""What it does goes by the torque that the spring passes on, or by an acceleration that it lags behind."""


@pytest.mark.parametrize("effect", sorted(set(EFFECTS) - CHAOTIC))
def test_an_effect_is_the_same_beside_a_load_that_is_all_but_rigid(effect: str) -> None:
    """With nearly all inertia beyond a spring that hardly gives way, what the effect does is what it does without.

    What the spring itself costs along the motion of the rigid axis is in both and cancels.
    """
    own, torque = EFFECTS[effect].make(SHAPED.get(effect, VALUES[effect])), _drive()
    rigid, between = base_model(NUMBERS), EFFECTS["elastic_transmission"].make(STIFF)
    position = _forward(rigid.with_effect(own), torque)
    alone, beside = (
        _residual(one.with_effect(own), torque, position) - _residual(one, torque, position)
        for one in (rigid, rigid.with_effect(between))
    )
    allowed = 0.2 if effect in GOES_THROUGH_THE_SPRING else 1e-9
    assert np.sqrt(np.mean((beside - alone) ** 2)) < allowed * np.sqrt(np.mean(alone**2))


@pytest.mark.parametrize("effect", list(EFFECTS))
def test_an_effect_matters_and_its_neutral_value_does_not(effect: str) -> None:
    torque, model = _drive(), _model(effect)
    position = _forward(model, torque)
    with_it = np.sqrt(np.mean(_residual(model, torque, position) ** 2))
    without = np.sqrt(np.mean(_residual(base_model(NUMBERS), torque, position) ** 2))
    assert without > 1.5 * with_it
    assert without > 1e-4


@given(loss=st.floats(0.0, 0.85), exponent=st.floats(1.0, 10.0), scale=st.floats(0.01, 100.0))
def test_a_saturating_motor_loses_what_is_said_and_never_turns_back(loss, exponent, scale) -> None:
    """Torque over demand rises everywhere, is proportional for small demands, and lacks `loss` at the level given."""
    effect = EFFECTS["torque_saturation"].make({"loss": loss, "torque": 1.3 * scale, "exponent": exponent})
    packed = base_model(NUMBERS).with_effect(effect).pack()
    demand = scale * np.linspace(0.0, 2.6, 201)
    c = bent(packed.p, packed.on)
    torque = np.array([saturated(packed.p, packed.on, u, c) for u in demand])
    assert torque[100] == pytest.approx((1.0 - loss) * demand[100], rel=1e-9)
    assert np.all(np.diff(torque) > 0.0)
    assert np.all(torque <= demand * (1.0 + 1e-12))
    middle = 0.5 * (demand[1:101] + demand[:100])
    measured = np.diff(torque[:101]) / np.diff(demand[:101])
    np.testing.assert_allclose(
        torque_slope(packed.p, packed.on, middle), np.maximum(measured, 0.05), atol=5e-3
    )


def test_every_effect_is_explained_to_people() -> None:
    assert set(EFFECTS) == set(layout.EFFECT_NAMES)
    for kind in EFFECTS.values():
        for text in (kind.looks_like, kind.cause, kind.remedy):
            assert text.endswith(".")
            assert 20 < len(text) < 220


def test_hysteresis_elements_close_small_loops_where_they_began() -> None:
    """Reversal-point memory: after a small loop inside a large one the torque goes on as if never left."""
    model = base_model({**NUMBERS, "coulomb": 1e-6, "viscous": 0.0, "micro_damping": 0.0}).with_effect(
        EFFECTS["reversal_memory"].make(VALUES["reversal_memory"])
    )
    leg = lambda a, b: np.linspace(a, b, 2000)  # noqa: E731
    path = np.concatenate([leg(0, 0.15), leg(0.15, 0.05), leg(0.05, 0.08), leg(0.08, 0.05), leg(0.05, 0.0)])
    straight = np.concatenate([leg(0, 0.15), leg(0.15, 0.05), leg(0.05, 0.0)])
    torques = []
    for q in (path, straight):
        torques.append(model.torque(q, np.gradient(q, PERIOD), np.zeros(len(q)), PERIOD)[-1500:])
    np.testing.assert_allclose(torques[0], torques[1], atol=2e-4)
    assert np.ptp(torques[0]) > 1e-3


def test_lag_is_smooth_down_to_zero() -> None:
    state, torque = np.zeros(layout.STATES), np.sin(np.arange(200) * 0.1)
    results = []
    for lag in (0.0, 1e-9, 1e-6):
        model = base_model(NUMBERS).with_effect(EFFECTS["torque_lag"].make({"time_constant": lag}))
        packed, out = model.pack(), np.empty(200)
        applied_torque(packed.p, packed.on, state.copy(), torque, PERIOD, out)
        results.append(out)
    np.testing.assert_allclose(results[0], results[1], atol=1e-6)
    np.testing.assert_allclose(results[0], results[2], atol=2e-4)
    assert math.isclose(float(results[0][10]), 0.5 * (torque[9] + torque[10]), abs_tol=1e-12)


ADDS = {
    "load_dependent_friction": ({"factor": 0.2, "friction_share": 0.0}, PRESSED, 0.5),
    "dwell_time_break_away": ({"rise": 0.1, "time_constant": 0.1, "slip": 2e-3}, AGE, 1.0),
}
"""Effects that add 0.1 N m to a friction of 0.3: their values, and a state in which they do."""


@pytest.mark.parametrize("effect", list(ADDS))
@pytest.mark.parametrize(("stiffens", "stiffer"), [(0.0, 1.0), (0.5, 0.4 / 0.35), (1.0, 0.4 / 0.3)])
def test_a_contact_slides_alike_however_stiff_it_becomes(
    effect: str, stiffens: float, stiffer: float
) -> None:
    """Its stiffness grows as far as it is said to, and the reach makes up for the rest."""
    values, at, level = ADDS[effect]
    state = np.zeros(layout.STATES)
    state[at] = level
    packed = base_model(NUMBERS).with_effect(EFFECTS[effect].make(values | {"stiffens": stiffens})).pack()
    times = stiffened(packed.p, packed.on, state, 0.1)
    limit = friction_limit(packed.p, packed.on, state, 0.0, 0.1)
    assert times == pytest.approx(stiffer, rel=1e-12)
    assert times * NUMBERS["stiffness"] * limit == pytest.approx(0.4, rel=1e-12)


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("load_dependent_friction", {"factor": 0.4, "friction_share": 0.3}),
        ("dwell_time_break_away", {"rise": 0.25, "time_constant": 0.1, "slip": 2e-3}),
    ],
)
def test_the_inverse_gives_back_the_torque_of_a_contact_that_stiffens(
    effect: str, values: dict[str, float]
) -> None:
    model, plain = (
        base_model(NUMBERS).with_effect(EFFECTS[effect].make(values | {"stiffens": part}))
        for part in (1.0, 0.0)
    )
    torque = _drive()
    position = _forward(model, torque)
    right, wrong = (np.sqrt(np.mean(_residual(one, torque, position) ** 2)) for one in (model, plain))
    assert right < 2.5e-3
    assert wrong > 1.5 * right


def _aged(rest: float, speed: float) -> float:
    """Age after a second of slip at a speed, of a contact that ages in a tenth of one and is young after 2 mrad."""
    values = {"rise": 0.1, "time_constant": 0.1, "slip": 2e-3, "rest": rest}
    p = base_model(NUMBERS).with_effect(DWELL_TIME_BREAK_AWAY.make(values)).pack().p
    state = np.zeros(layout.STATES)
    for _ in range(1000):
        grow_older(p, state, speed * 1e-3, speed * 1e-3, 1e-3)
    return float(state[AGE])


def test_a_contact_that_ages_at_rest_only_is_young_in_a_slow_motion() -> None:
    """Sliding at 5 mrad/s the one that always ages keeps 1/(1 + 0.1·5/2) of its rise."""
    assert _aged(0.0, 5e-3) == pytest.approx(0.8, abs=0.01)
    assert _aged(1e-3, 5e-3) < 1e-3
    assert _aged(1e-3, 0.0) == pytest.approx(_aged(0.0, 0.0), rel=1e-9)


@pytest.mark.parametrize(("edge", "half_way", "beyond"), [(2.0, 0.7788, 0.1845), (8.0, 0.9961, 0.0003)])
def test_a_tight_place_is_a_bell_or_a_stretch_with_two_flanks(
    edge: float, half_way: float, beyond: float
) -> None:
    """exp(−|x|^edge) at 0.5 and 1.3 widths from its middle, times its height."""
    p = np.zeros(layout.PARAMETERS)
    kind = EFFECTS["position_dependent_friction"]
    for name, value in {"height": 0.4, "centre": 1.0, "width": 0.2, "edge": edge}.items():
        p[kind.slot(name)] = value
    factor = kind.kernels.level_factor
    assert factor is not None
    for side in (-1.0, 1.0):
        assert factor(p, p[:1], 1.0 + side * 0.1) == pytest.approx(1.0 + 0.4 * half_way, abs=1e-4)
        assert factor(p, p[:1], 1.0 + side * 0.26) == pytest.approx(1.0 + 0.4 * beyond, abs=1e-4)


@pytest.mark.parametrize(("apart", "pressing"), [(0.0, 0.3), (0.4, 0.22), (1.0, 0.1)])
def test_an_offset_presses_as_far_as_it_passes(apart: float, pressing: float) -> None:
    """A weight's torque passes through a gear; an amplifier's own, or a cable's at the motor, does not."""
    values = {"factor": 0.2, "friction_share": 0.0, "offset_apart": apart}
    model = base_model(NUMBERS | {"offset": 0.2})
    p = model.with_effect(EFFECTS["load_dependent_friction"].make(values)).pack().p
    assert transmitted(p, 0.1 + 0.2) == pytest.approx(pressing, rel=1e-12)


@pytest.mark.parametrize(("told", "starts"), [(True, 4), (False, 3)])
def test_that_no_offset_presses_is_asked_where_there_is_one(told: bool, starts: int) -> None:
    p = np.zeros(layout.PARAMETERS)
    p[layout.OFFSET] = 0.2
    context = SimpleNamespace(p=p, left=0.1 if told else 0.3, torque=1.0, largest_torque=2.0)
    kind = EFFECTS["load_dependent_friction"]
    assert len(list(kind.starts(context))) == starts
    assert ("offset_apart" in kind.free_shape(context).free) is told
