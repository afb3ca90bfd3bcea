"""Steady-state characteristic from legs of constant speed (section 3.4.1).

Every leg gives one point: its mean torque, after what repeats with position has been taken out (the
waves are fitted over all legs together) and after the torque that accelerates the inertia. The error
of a point comes from the scatter of its parts.

Recordings may hold constant speeds only, one file a speed, as some test benches record them. They tell friction over
speed and nothing of inertia and contact stiffness; those are placeholders in the model, without a standard error,
and the reason says so (`fit_speed_curve`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.pieces import UNFITTED
from autotune.identify.characteristic import CurveFit, Points, compare_shapes, distinct_speeds, fit_curve
from autotune.identify.estimate import Estimate
from autotune.identify.ripple_lines import Line, columns, find_lines
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.lugre import Shape
from autotune.models.stribeck import STRIBECK
from autotune.recordings.checks import clipped, guide_of, torque_of
from autotune.recordings.recording import Recording
from autotune.signals.filters import motion
from autotune.signals.legs import Leg, find_legs

LEAST_SPEEDS = 4
NO_SCATTER = 1e-6
"""Of the torque: less is rounding, as where each speed has its mean only."""
_BLOCKS = 48
_PARTS = 6


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Result of the experiment.

    Attributes:
        estimate: parameters of the Gaussian shape (3.5), or of the linear one where friction does not fall.
        points: what was measured.
        curves: every shape, best on held-out points first.
        asymmetric: the chosen shape with directions apart.
        ripple: torque waves over position found in the legs.
    """

    estimate: Estimate
    points: Points
    curves: tuple[CurveFit, ...]
    asymmetric: CurveFit | None
    ripple: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Block means of all legs: arrays of shape (m,); `leg` is the number of each block's leg."""

    leg: NDArray[np.int64]
    position: Floats
    acceleration: Floats
    torque: Floats
    velocity: Floats


def identify_steady_state(recording: Recording, settle_distance: float = 0.0) -> SteadyState:
    """Characteristic from every leg of constant speed in the recording.

    Args:
        settle_distance: travel after a reversal that is not used; several times F_s/σ0.

    Raises:
        NotEnoughExcitation: no legs, fewer than four speeds, or one direction only.
    """
    blocks, velocity = _gather(recording, settle_distance)
    _refuse_poor(velocity)
    scale = 1.0 if recording.metadata.motion_unit == "rad" else 2.0 * np.pi
    points, ripple = _points(blocks, velocity, scale)
    curves = compare_shapes(points)
    chosen = _chosen(curves)
    asymmetric = fit_curve(points, chosen.shape, True) if len(points) > 9 else None
    estimate = Estimate("steady_state", chosen.parameters, True, "", chosen.relative_error, _notes(chosen))
    return SteadyState(estimate, points, tuple(curves), asymmetric, tuple(ripple))


def steady_points(recording: Recording, settle_distance: float = 0.0) -> Points:
    """Only the points, without a fit; raises as `identify_steady_state`."""
    blocks, velocity = _gather(recording, settle_distance)
    return _points(blocks, velocity, 1.0 if recording.metadata.motion_unit == "rad" else 2.0 * np.pi)[0]


def _gather(recording: Recording, settle_distance: float) -> tuple[_Blocks, Floats]:
    parts: list[tuple[Floats, ...]] = []
    speeds: list[float] = []
    resolution = recording.metadata.position_resolution or 0.0
    for _, segment in recording.split():
        if len(segment) < 16:
            continue
        path = guide_of(segment)
        smooth = motion(segment["position"], segment.period, min(20.0, 0.1 / segment.period))
        at_limit = clipped(segment).rows
        for leg in find_legs(path, segment.period, resolution, settle_distance):
            if np.any(at_limit[leg.rows]) or len(leg) < _PARTS * 2:
                continue
            parts.append(_blocks_of(leg, len(speeds), smooth, torque_of(segment)))
            speeds.append(float(np.mean(smooth[1][leg.rows])))
    if not parts:
        raise NotEnoughExcitation(
            "there is no stretch of constant speed in the data; play triangles at several speeds, "
            "both directions, over at least one period of the torque ripple"
        )
    leg_number, position, velocity, acceleration, torque = (
        np.concatenate([part[i] for part in parts]) for i in range(5)
    )
    blocks = _Blocks(leg_number.astype(np.int64), position, acceleration, torque, velocity)
    return blocks, np.array(speeds)


def _blocks_of(
    leg: Leg, number: int, smooth: tuple[Floats, Floats, Floats], torque: Floats
) -> tuple[Floats, ...]:
    edges = np.linspace(leg.start, leg.stop, min(_BLOCKS, len(leg) // 2) + 1).astype(int)
    widths = np.diff(edges)
    means = [np.add.reduceat(signal[: leg.stop], edges[:-1]) / widths for signal in (*smooth, torque)]
    return (np.full(len(widths), float(number)), *means)


def _refuse_poor(velocity: Floats) -> None:
    directions = np.unique(np.sign(velocity))
    if len(directions) < 2:
        word = "positive" if directions[0] > 0 else "negative"
        raise NotEnoughExcitation(
            f"the axis moved in the {word} direction only; Coulomb friction and offset cannot be told apart. "
            "Record both directions"
        )
    speeds = distinct_speeds(velocity, 1.2)
    if speeds < LEAST_SPEEDS:
        raise NotEnoughExcitation(
            f"the legs have {speeds} different speeds; at least {LEAST_SPEEDS} are needed to tell Coulomb "
            "from viscous friction. Play triangles at more speeds, evenly spaced on a log scale"
        )


def _points(blocks: _Blocks, velocity: Floats, scale: float) -> tuple[Points, list[Line]]:
    """Least squares with one level a leg, waves and inertia in common."""
    count = len(velocity)
    levels = (blocks.leg[:, None] == np.arange(count)).astype(float)
    fixed = np.hstack([levels, blocks.acceleration[:, None]])
    first = blocks.torque - fixed @ np.linalg.lstsq(fixed, blocks.torque, rcond=None)[0]
    least = NO_SCATTER * float(np.max(np.abs(blocks.torque)))
    steady = _steady(first, blocks.leg, count, least)
    ripple = find_lines(blocks.position[steady], first[steady], fixed[steady], scale)
    waves = columns(blocks.position, [line.order for line in ripple], scale)
    design = np.hstack([fixed, waves])
    weight = 1.0 / _leg_scatter(first, blocks.leg, count, least)
    weighted = design * weight[:, None]
    solution = np.linalg.lstsq(weighted, blocks.torque * weight, rcond=None)[0]
    rest = blocks.torque - design @ solution
    level = np.asarray(solution[:count], dtype=np.float64)
    mean_velocity = np.array([blocks.velocity[blocks.leg == leg].mean() for leg in range(count)])
    errors = np.array([_scatter(rest[blocks.leg == leg]) for leg in range(count)])
    return Points(mean_velocity, level, _pooled(errors, level)), ripple


def _leg_scatter(rest: Floats, leg: NDArray[np.int64], count: int, least: float) -> Floats:
    """Standard deviation of each block's leg, shape (m,); never below a tenth of the typical one, nor `least`."""
    scatter = np.array([np.std(rest[leg == number]) for number in range(count)])
    return np.asarray(np.maximum(scatter, max(0.1 * float(np.median(scatter)), least))[leg])


def _steady(rest: Floats, leg: NDArray[np.int64], count: int, least: float) -> NDArray[np.bool_]:
    """Blocks of legs whose torque is not dominated by what the control loop does."""
    scatter = _leg_scatter(rest, leg, count, least)
    return scatter <= 2.0 * np.median(scatter)


def _scatter(rest: Floats) -> float:
    """Standard error of the mean from the means of six parts, which allows for slow disturbances."""
    edges = np.linspace(0, len(rest), min(_PARTS, len(rest)) + 1).astype(int)
    means = np.add.reduceat(rest, edges[:-1]) / np.diff(edges)
    return float(np.std(means, ddof=1) / np.sqrt(len(means)))


def _pooled(errors: Floats, level: Floats) -> Floats:
    """Six parts tell a scatter only to 30 %: half of each leg's own, half of the typical one."""
    typical = max(float(np.median(errors)), NO_SCATTER * float(np.max(np.abs(level))))
    return np.asarray(np.sqrt(0.5 * errors**2 + 0.5 * typical**2))


def _chosen(curves: list[CurveFit]) -> CurveFit:
    """The Gaussian shape of the LuGre model, unless a straight line predicts held-out points as well."""
    by_shape = {curve.shape: curve for curve in curves}
    straight, gaussian = by_shape["linear"], by_shape.get("gaussian")
    if gaussian is None or "stribeck_velocity" not in gaussian.parameters:
        return straight
    if not gaussian.parameters["stribeck_velocity"].identified:
        return straight
    worse = straight.held_out_rms > 1.1 * gaussian.held_out_rms or straight.rms > 1.5 * gaussian.rms
    return gaussian if worse else straight


def _notes(chosen: CurveFit) -> tuple[str, ...]:
    notes = [f"{name}: {q.note}" for name, q in chosen.parameters.items() if q.note]
    if chosen.shape == "linear":
        notes.append("friction does not fall with speed here: break-away equals Coulomb friction")
    return tuple(notes)


PLACEHOLDER_INERTIA = 1e-9
LEAST_SEGMENTS = 4
_COVERED, _OF_ROWS = 0.6, 0.8


@dataclass(frozen=True, slots=True)
class SpeedCurve:
    """A model for constant speeds, its estimate, and the curve with its points."""

    model: DriveModel
    estimate: Estimate
    steady_state: SteadyState


def holds_constant_speeds_only(recording: Recording) -> bool:
    """Whether nearly every segment is one stretch of constant speed, at speeds enough for a curve in both directions.

    One speed that lost samples cut into segments is no curve: what it tells is where the torque waves.
    """
    resolution = recording.metadata.position_resolution or 0.0
    single = total = 0
    speeds: list[float] = []
    for segment, part in recording.split():
        if segment.experiment in UNFITTED or len(part) < 16:
            continue
        legs = find_legs(guide_of(part), part.period, resolution)
        total += len(part)
        if len(legs) == 1 and len(legs[0]) > _COVERED * len(part):
            single += len(part)
            speeds.append(float(part["position"][-1] - part["position"][0]) / (len(part) * part.period))
    if len(speeds) < LEAST_SEGMENTS or single <= _OF_ROWS * total:
        return False
    velocity = np.array(speeds)
    both = len(np.unique(np.sign(velocity))) > 1
    return both and distinct_speeds(velocity, 1.2) >= LEAST_SPEEDS


def fit_speed_curve(recording: Recording, effects: Sequence[str]) -> SpeedCurve:
    """A model of friction at constant speeds.

    Raises:
        NotEnoughExcitation: too few speeds, or one direction only.
    """
    state = identify_steady_state(recording.rows(~np.isin(recording.experiment, UNFITTED)))
    shape: Shape = "gaussian" if STRIBECK.name in effects else "linear"
    curve = fit_curve(state.points, shape, DIRECTION_ASYMMETRY.name in effects)
    found = curve.parameters
    values = {name: quantity.value for name, quantity in found.items() if "." not in name}
    reach = float(np.min(np.abs(state.points.velocity))) * recording.period
    stiffness = values["coulomb"] / max(reach, 1e-12)
    metadata = recording.metadata
    model = base_model(
        values | {"inertia": PLACEHOLDER_INERTIA, "stiffness": stiffness, "micro_damping": 0.0},
        {name: q.standard_error for name, q in found.items() if math.isfinite(q.standard_error)},
        metadata.motion_unit,
        metadata.axis,
        metadata.fingerprint,
        metadata.torque_unit,
    )
    if DIRECTION_ASYMMETRY.name in effects:
        name = DIRECTION_ASYMMETRY.surface("viscous")
        asymmetry = {"coulomb": 0.0, "viscous": found[name].value}
        model = model.with_effect(
            DIRECTION_ASYMMETRY.make(asymmetry, {"viscous": found[name].standard_error})
        )
    reason = (
        f"only the speed curve: {len(state.points)} points. Inertia, stiffness and micro_damping are not "
        "identified by these experiments; record accelerations and reversals"
    )
    estimate = Estimate("steady_state", found, True, reason, curve.relative_error)
    return SpeedCurve(model, estimate, state)
