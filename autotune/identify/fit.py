"""A drive model from any recordings: own experiments or other people's data.

Start values from the experiments where they have their usual names, else from the motion itself; then
the joint refinement, in the twin where the controller is known or can be identified.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.estimation.bandwidth import Bands, Brought, of_one_moment, prepared_repeats
from autotune.estimation.controller import AS_ACTED, as_acted_in_rows, as_read, controller_of
from autotune.estimation.controller_law import PositionController
from autotune.estimation.joint_fit import free_by_name
from autotune.estimation.least_squares import with_values
from autotune.estimation.pieces import UNFITTED, Piece, cut, torque_error
from autotune.estimation.policy import POLICY
from autotune.identify.estimate import Estimate, Quantity
from autotune.identify.first_guess import Guess, guess
from autotune.identify.refinement import (
    SYSTEMATIC_ELSE,
    UNKNOWN,
    Joint,
    free_parameters,
    missing,
    refine_recording,
    usable,
)
from autotune.identify.steady_state import SteadyState, fit_speed_curve, holds_constant_speeds_only
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.drive_model import DriveModel, base_model, surface_parameter
from autotune.models.effect import Effect, Kind
from autotune.models.gravity_imbalance import GRAVITY_IMBALANCE
from autotune.models.spring import SPRING
from autotune.models.stribeck import STRIBECK
from autotune.models.table import effect_kind
from autotune.models.torque_ripple import LINES, TORQUE_RIPPLE
from autotune.recordings.checks import check_recording, refuse_clipping, refuse_limits_throughout
from autotune.recordings.recording import Recording, concatenate, refuse_twice
from autotune.signals.place_terms import Line, find_lines

MOST_ROWS, STRETCH = 600_000, 20_000
VAGUE = 0.1
"""Of Coulomb friction: what looks like the offset is not told from it by a larger standard error."""
FILTERED = (
    "how torque and motion belong together (read late, filtered, or between slow samples) makes {:.2g} % of the "
    "inertia, which is in its standard error"
)
HOLDS = "The torque holds"
IN_OFFSET = (
    "The offset holds the mean over this travel of what was fitted beside the model: it is what the model without that "
    "needs, not a torque by itself"
)
WITH_GRAVITY = (
    "offset: known together with gravity's sine only, as over this travel sines of other orders explain as much; move "
    "over more of a turn of the load"
)
TWIN_WORSE = (
    "a simulation of the model with this controller leaves more of the torque than no simulation does"
)


@dataclass(frozen=True, slots=True)
class FitResult:
    """A fitted model.

    Attributes:
        model: with standard errors.
        estimate: by surface name, with intervals, validity and sentences.
        relative_error: of the torque, filtered; norm of the error over norm of the torque.
        controller: of the twin, or why there is none.
        steady_state: the speed curve, where the recordings hold nothing else; inertia, stiffness and
            micro_damping of the model are placeholders without a standard error then.
        converged: whether the refinement came to an end.
    """

    model: DriveModel
    estimate: Estimate
    controller: PositionController
    steady_state: SteadyState | None = None
    converged: bool = True

    @property
    def valid(self) -> bool:
        return self.estimate.valid

    @property
    def reason(self) -> str:
        return self.estimate.reason

    @property
    def relative_error(self) -> float:
        return self.estimate.relative_error


def fit(recordings: Sequence[Recording] | Recording, effects: Sequence[str] = (), seed: int = 0) -> FitResult:
    """Fits the base model and `effects` to all recordings together.

    Segments named `conditioning`, `veto` and `test` are not fitted.

    Raises:
        RecordingError, NotEnoughExcitation: what is wrong with the data, in a sentence.
        ConfigurationError: an effect that is unknown or that cannot be started from data alone.
    """
    kinds = [_startable(name) for name in effects]
    recording = joined(recordings)
    for kind in kinds:
        kind.refuse_unit(recording.metadata.motion_unit)
    controller = controller_of(recording)
    read = as_read(recording, controller)
    if read is not recording:
        recording, controller = read, controller_of(read)
    if holds_constant_speeds_only(recording):
        speeds = fit_speed_curve(recording, effects)
        return FitResult(speeds.model, speeds.estimate, controller, speeds.steady_state)
    led = _led(recording, controller, effects, seed)
    if led.joint.refined.twin < 1.0:
        led = _or_as_it_acted(led, recording, effects, seed)
    joint, pieces, bands, brought = led.joint, led.pieces, led.bands, led.brought
    held: list[str] = []
    for kind in kinds:
        if kind.name in joint.model:
            continue
        model = STARTS[kind.name](joint.model, pieces, bands)
        joint = _refined(model, brought.recording, held, seed, led.controller)
        for name in _vague(kind, joint):
            held.append(name)
            joint = _refined(model, brought.recording, held, seed, led.controller)
    joint = replace(joint, estimate=_doubted(joint.estimate, brought, led.start))
    joint = _without_beside(joint, led.start, effects, _positions(pieces, bands), float(brought.doubt[-1]))
    if not joint.controller.usable and joint.controller.why == TWIN_WORSE:
        notes = (*joint.estimate.notes, f"No twin: {TWIN_WORSE}.")
        joint = replace(joint, estimate=replace(joint.estimate, notes=notes))
    return _result(joint)


@dataclass(frozen=True, slots=True)
class _Led:
    """The base model by all motion, and what it was found in."""

    joint: Joint
    start: Guess
    brought: Brought
    controller: PositionController
    pieces: Sequence[Piece]
    bands: Bands


def _led(recording: Recording, law: PositionController, effects: Sequence[str], seed: int) -> _Led:
    """The base model by all motion; without a twin where that would mislead."""
    brought = of_one_moment(recording, law)
    recording, controller = brought.recording, brought.law
    bands = Bands.of(recording)
    pieces = cut(recording, bands, controller, UNFITTED)
    if not any(np.any(piece.use) for piece in pieces):
        refuse_limits_throughout(recording)
    metadata = recording.metadata
    start = guess(pieces, bands, metadata.motion_unit, effects)
    model = base_model(
        start.values,
        motion_unit=metadata.motion_unit,
        axis=metadata.axis,
        fingerprint=metadata.fingerprint,
        torque_unit=metadata.torque_unit,
    )
    for effect in place_effects(start):
        model = model.with_effect(effect)
    joint = refine_recording(model, recording, seed=seed, controller=controller)
    if joint.controller.usable and _twin_misleads(joint, start):
        controller = replace(controller, source="none", why=TWIN_WORSE)
        joint = refine_recording(model, recording, seed=seed, controller=controller)
    return _Led(joint, start, brought, controller, pieces, bands)


def _or_as_it_acted(led: _Led, recording: Recording, effects: Sequence[str], seed: int) -> _Led:
    """The same by the mean torque of each row where readings of a moment were recorded and a drive's law tells it, if
    that leaves less.
    """
    data = prepared_repeats([recording]) if "reference" in recording else None
    acted = recording if data is None else as_acted_in_rows(recording, data)
    if acted is recording:
        return led
    other = _led(acted, replace(led.controller, source="none"), effects, seed)
    if other.joint.refined.relative_error >= led.joint.refined.relative_error:
        return led
    notes = (AS_ACTED, *other.joint.estimate.notes)
    return replace(other, joint=replace(other.joint, estimate=replace(other.joint.estimate, notes=notes)))


def _twin_misleads(joint: Joint, start: Guess) -> bool:
    """Whether the refinement in the twin left more than the guess, which had none."""
    return joint.refined.relative_error > math.sqrt(POLICY.twin_worse) * start.relative_error


def place_effects(start: Guess) -> list[Effect]:
    """What the guess fitted beside the model, as effects of their own."""
    terms, sizes = start.place, start.sizes.tolist()
    effects = [SPRING.make({"stiffness": sizes.pop(0)})] if terms.spring else []
    pairs = dict(zip(terms.orders, zip(sizes[::2], sizes[1::2], strict=True), strict=True))
    if terms.gravity:
        values = dict(zip(("sin", "cos"), pairs[terms.load], strict=True))
        effects.append(GRAVITY_IMBALANCE.make(values | ({"order": terms.load} if terms.load < 1.0 else {})))
    if terms.waves:
        lines = [Line(order, *pairs[order]) for order in terms.waves]
        effects.append(TORQUE_RIPPLE.make(_ripple_values(lines)))
    return effects


def _doubted(estimate: Estimate, brought: Brought, start: Guess) -> Estimate:
    """The estimate with standard errors that hold in how far it is not known how the columns belong together, and what
    an order of gravity that is held makes of the offset.
    """
    quantities = dict(estimate.parameters)
    doubts = zip(("inertia", "viscous", "coulomb", "offset"), brought.doubt.tolist(), strict=True)
    for name, doubt in doubts:
        if (one := quantities.get(name)) is not None:
            held = start.offset_doubt if name == "offset" else 0.0
            error = math.hypot(one.standard_error, doubt * one.value, held)
            quantities[name] = replace(one, standard_error=error)
    notes = brought.notes
    if start.offset_doubt > VAGUE * quantities["coulomb"].value:
        notes = (*notes, WITH_GRAVITY)
    if brought.doubt[0] * quantities["inertia"].value > estimate.parameters["inertia"].standard_error:
        notes = (*notes, FILTERED.format(100.0 * brought.doubt[0]))
    return replace(estimate, parameters=MappingProxyType(quantities), notes=(*notes, *estimate.notes))


def _without_beside(
    joint: Joint, start: Guess, wanted: Sequence[str], position: Floats, doubt: float
) -> Joint:
    """The base model with the effects that were asked for, and a sentence on what was fitted beside them.

    What is taken out is on average an offset of the model without it. A spring's mean is taken into the offset however
    well it is known: where the position is zero, the axis may never have been. A sine's is taken where the two cannot
    be told apart, as over a small part of its wave: each is as large as the other makes it, and a model with one of
    them is wrong by as much.

    Args:
        position: of the rows that were fitted [rad or m].
        doubt: share of the offset that it is not known to by how the columns belong together.
    """
    model, notes = joint.model, list(joint.estimate.notes)
    beside = [effect for effect in model.effects if effect.name not in wanted]
    for effect in beside:
        notes = [note for note in notes if not note.startswith(f"{effect.name}.")]
        if _seen(effect, joint.estimate):
            notes.insert(0, _beside_note(effect, start, model))
        model = model.without_effect(effect.name)
    known = {name: q for name, q in joint.estimate.parameters.items() if name in model.parameters}
    if "offset" in known and _takes_part(beside, known["offset"], model["coulomb"]):
        known["offset"] = offset = _with_mean(joint, beside, position, doubt)
        if offset.identified:
            notes = [note for note in notes if not note.startswith("offset:")]
        notes += [IN_OFFSET] * any(note.startswith(HOLDS) for note in notes)
        model = model.with_values({"offset": offset.value}, {"offset": offset.standard_error})
    estimate = replace(
        joint.estimate, parameters=known, valid=usable(known), reason=missing(known), notes=tuple(notes)
    )
    return replace(joint, model=model, estimate=estimate)


def _takes_part(beside: Sequence[Effect], offset: Quantity, coulomb: float) -> bool:
    """Whether a part of what was fitted beside the model is the offset's."""
    spring = any(effect.name == SPRING.name for effect in beside)
    return spring or (bool(beside) and not offset.standard_error <= VAGUE * coulomb)


def _with_mean(joint: Joint, beside: Sequence[Effect], position: Floats, doubt: float) -> Quantity:
    """The offset with the mean of what was fitted beside it: that sum is known where neither of the two is."""
    weights = {"offset": 1.0}
    for effect in beside:
        weights |= _means(effect, position, joint.model.motion_unit)
    value = sum(weight * joint.model[name] for name, weight in weights.items())
    along = np.array([weights.get(name, 0.0) for name in joint.refined.names])
    spread = math.sqrt(max(float(along @ joint.refined.covariance @ along), 0.0))
    error = math.hypot(spread, SYSTEMATIC_ELSE * value, doubt * value)
    before = joint.estimate.parameters["offset"]
    if not error <= UNKNOWN * max(joint.model["coulomb"], abs(value)):
        return replace(before, value=value, standard_error=error)
    return Quantity(value, error, before.quantile)


def _means(effect: Effect, position: Floats, motion_unit: str) -> dict[str, float]:
    """Mean of each column of an effect of the place, by the surface name of its parameter."""
    if effect.name == SPRING.name:
        return {SPRING.surface("stiffness"): float(np.mean(position))}
    value = {name: one.value for name, one in effect.values.items()}
    scale = 1.0 if motion_unit == "rad" else 2.0 * math.pi
    if effect.name == GRAVITY_IMBALANCE.name:
        orders = {"": value.get("order", 1.0)}
    else:
        orders = {f"_{i}": value.get(f"order_{i}", 0.0) for i in range(1, LINES + 1)}
    found = {}
    for number, order in orders.items():
        if order > 0.0:
            angle = order * scale * position
            found[f"{effect.name}.sin{number}"] = float(np.mean(np.sin(angle)))
            found[f"{effect.name}.cos{number}"] = float(np.mean(np.cos(angle)))
    return found


def _seen(effect: Effect, estimate: Estimate) -> bool:
    """Whether the refinement knows anything of an effect that the guess has fitted beside the model."""
    fitted = [one for name, one in estimate.parameters.items() if name.startswith(f"{effect.name}.")]
    return not fitted or any(one.identified for one in fitted)


def _beside_note(effect: Effect, start: Guess, model: DriveModel) -> str:
    """What belongs to the place, how large it is, and how it is taken into the model."""
    value, unit = {name: one.value for name, one in effect.values.items()}, model.unit("offset")
    if effect.name == TORQUE_RIPPLE.name:
        orders = [i for i in range(1, LINES + 1) if value.get(f"order_{i}", 0.0) > 0.0]
        waves = (
            f"{value[f'order_{i}']:.5g} ({math.hypot(value[f'sin_{i}'], value[f'cos_{i}']):.3g} {unit})"
            for i in orders
        )
        said = f"waves over position, as cogging makes them: orders {', '.join(waves)}"
    elif effect.name == GRAVITY_IMBALANCE.name:
        behind = f" of a load that turns {value['order']:.3g} times as far" if start.place.load < 1.0 else ""
        said = f"one sine a turn{behind}, as gravity makes it, of {math.hypot(value['sin'], value['cos']):.3g} {unit}"
    else:
        size = f"{value['stiffness']:.3g} {model.unit(SPRING.surface('stiffness'))}"
        said = f"a torque in proportion to position, as a spring makes it, of {size}"
    alike = " (over this travel gravity and a spring look alike)" if start.place.spring_like else ""
    return (
        f"{HOLDS} {said}{alike}. It was fitted beside the model, which does not hold it; without it the model "
        f"is wrong by as much: 'autotune model fit --effects {effect.name}' takes it in, 'autotune model diagnose' "
        "judges it"
    )


def _vague(kind: Kind, joint: Joint) -> list[str]:
    """Parameters that look like the offset and are known to a tenth of the Coulomb level at best."""
    alike = [kind.surface(parameter.name) for parameter in kind.parameters if parameter.like_offset]
    least = VAGUE * joint.model["coulomb"]
    known = "offset" in joint.estimate
    return [name for name in alike if not known or joint.refined.standard_errors[name] > least]


def _refined(
    model: DriveModel, recording: Recording, held: Sequence[str], seed: int, law: PositionController
) -> Joint:
    """The model refined, with what sliding alone cannot tell from the offset `held` as it is."""
    free = [name for name in free_parameters(model) if name not in held] if held else None
    joint = refine_recording(model, recording, free, seed, controller=law)
    notes = tuple(
        f"{name} is held at zero: these recordings cannot tell it from the offset; presliding would"
        for name in held
    )
    return replace(joint, estimate=replace(joint.estimate, notes=(*joint.estimate.notes, *notes)))


def joined(recordings: Sequence[Recording] | Recording) -> Recording:
    """One recording of all, checked one by one; segments of different files stay apart.

    Raises:
        RecordingError, NotEnoughExcitation: what is wrong, in a sentence.
    """
    parts = [recordings] if isinstance(recordings, Recording) else list(recordings)
    for part in parts:
        check_recording(part)
        refuse_clipping(part)
    refuse_twice(parts)
    return thinned(concatenate(parts))


def thinned(recording: Recording) -> Recording:
    """Evenly spaced stretches of a recording that is too long to be used whole."""
    if len(recording) <= MOST_ROWS:
        return recording
    starts = np.linspace(0, len(recording) - STRETCH, MOST_ROWS // STRETCH).astype(int)
    keep = np.zeros(len(recording), dtype=np.bool_)
    for start in starts:
        keep[start : start + STRETCH] = True
    return recording.rows(keep)


def _result(joint: Joint) -> FitResult:
    return FitResult(joint.model, joint.estimate, joint.controller, converged=joint.refined.converged)


def _startable(name: str) -> Kind:
    kind = effect_kind(name)
    if name not in STARTS:
        raise ConfigurationError(
            f"effect {name!r} needs start values that a plain fit does not have; fit without it, then "
            f"'autotune model add {name}'. Directly fitted are {', '.join(STARTS)}"
        )
    return kind


def _started_stribeck(model: DriveModel, pieces: Sequence[Piece], bands: Bands) -> DriveModel:
    """The Stribeck velocity, of several, that leaves the least error with the levels fitted for it."""
    speeds = np.concatenate([np.abs(piece.velocity[:: bands.decimation][piece.use]) for piece in pieces])
    names = ("inertia", "viscous", "coulomb", "offset", "break_away")
    trials = []
    for velocity in np.geomspace(0.01, 0.5, 6) * float(np.percentile(speeds, 95)):
        values = {"break_away": 1.1 * model["coulomb"], "stribeck_velocity": float(velocity)}
        trials.append(least_squares_step(model.with_effect(STRIBECK.make(values)), pieces, bands, names))
    return min(trials, key=lambda pair: pair[0])[1]


def least_squares_step(
    model: DriveModel, pieces: Sequence[Piece], bands: Bands, names: Sequence[str]
) -> tuple[float, DriveModel]:
    """Two Gauss–Newton steps on the measured motion, without a twin; mean square error and model."""
    for _ in range(2):
        here = _errors(model, pieces, bands)
        columns = []
        for name in names:
            step = 1e-3 * max(abs(model[name]), 0.01 * model["coulomb"])
            columns.append(
                (_errors(model.with_values({name: model[name] + step}), pieces, bands) - here) / step
            )
        change = -np.linalg.lstsq(np.array(columns).T, here, rcond=1e-9)[0]
        moved = {}
        for name, delta in zip(names, change.tolist(), strict=True):
            lower, upper = surface_parameter(name).lower, surface_parameter(name).upper
            positive = 0.2 * model[name] if lower >= 0.0 else lower
            moved[name] = min(max(model[name] + delta, positive), upper)
        free = free_by_name(model, names)
        packed = with_values(model.pack(), free, np.array(list(moved.values())))
        model = model.with_values({one.name: float(packed.p[one.slot]) for one in free})
    return float(np.mean(_errors(model, pieces, bands) ** 2)), model


def _errors(model: DriveModel, pieces: Sequence[Piece], bands: Bands) -> Floats:
    packed = model.pack()
    return np.concatenate([torque_error(piece, packed, bands)[piece.use] for piece in pieces])


def _positions(pieces: Sequence[Piece], bands: Bands) -> Floats:
    """Of the rows that are fitted."""
    return np.concatenate([p.position[:: bands.decimation][p.use] for p in pieces])


def _started_ripple(model: DriveModel, pieces: Sequence[Piece], bands: Bands) -> DriveModel:
    position = _positions(pieces, bands)
    error = _errors(model, pieces, bands)
    scale = 1.0 if model.motion_unit == "rad" else 2.0 * math.pi
    lines = find_lines(position, error, np.ones((len(error), 1)), scale, most=8)
    if not lines:
        raise ConfigurationError(
            "no torque ripple stands out of the noise in these recordings; leave torque_ripple out"
        )
    return model.with_effect(TORQUE_RIPPLE.make(_ripple_values(lines)))


def _ripple_values(lines: Sequence[Line]) -> dict[str, float]:
    """Parameters of ripple, the largest wave first."""
    values: dict[str, float] = {}
    for number, line in enumerate(sorted(lines, key=lambda one: -one.amplitude), 1):
        values |= {f"order_{number}": line.order, f"sin_{number}": line.sine, f"cos_{number}": line.cosine}
    return values


def _started_gravity(model: DriveModel, pieces: Sequence[Piece], bands: Bands) -> DriveModel:
    return model.with_effect(GRAVITY_IMBALANCE.make({"sin": 0.0, "cos": 0.0}))


def _started_spring(model: DriveModel, pieces: Sequence[Piece], bands: Bands) -> DriveModel:
    return model.with_effect(SPRING.make({"stiffness": 0.0}))


def _started_asymmetry(model: DriveModel, pieces: Sequence[Piece], bands: Bands) -> DriveModel:
    return model.with_effect(DIRECTION_ASYMMETRY.make({"coulomb": 0.0, "viscous": 0.0}))


STARTS: Mapping[str, Callable[[DriveModel, Sequence[Piece], Bands], DriveModel]] = {
    STRIBECK.name: _started_stribeck,
    DIRECTION_ASYMMETRY.name: _started_asymmetry,
    TORQUE_RIPPLE.name: _started_ripple,
    GRAVITY_IMBALANCE.name: _started_gravity,
    SPRING.name: _started_spring,
}
"""The model with an effect at values from which the refinement finds its way."""
