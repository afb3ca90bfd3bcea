"""Torque residual R = L[T(u) − required(q, v, a)] of a model on prepared data, and its bias in a twin.

T is what lag and saturation make of the demand, L a zero-phase low-pass on a coarse grid. The same
measurement chain applied to a simulation of the model itself (with quantiser, controller and process
noise) gives the bias that filters, derivatives and quantisation cause; subtracting it is what makes small
effects visible. The injected noise is known, so that its own part is taken out of the bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from autotune.core.recording import Controller
from autotune.diagnose.prepared import Prepared, Rows, filtered_motion
from autotune.models import layout
from autotune.models.compiled import compiled
from autotune.models.drive_model import Packed
from autotune.models.inverse import applied_torque, load_substeps, required
from autotune.models.lugre import Floats
from autotune.models.plant import simulate, substeps_for
from autotune.models.torque_path import MOTOR_TORQUE

_SATURATES = layout.flag("torque_saturation")
_LOSS = layout.block("torque_saturation")


@dataclass(frozen=True, slots=True)
class Simulated:
    """What the twin would have recorded; arrays of shape (n,). `stable`: it stayed within all bounds."""

    position: Floats
    torque: Floats
    disturbance: Floats
    stable: bool


@dataclass(frozen=True, slots=True)
class Motion:
    """Torque and motion to compute a residual from; arrays of shape (n,)."""

    torque: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats


@compiled
def smooth_at(values: Floats, taps: Floats, rows: Rows, result: Floats) -> None:
    """`values` filtered by symmetric `taps`, at `rows` only."""
    half = len(taps) // 2
    for j in range(len(rows)):
        centre = rows[j]
        total = taps[half] * values[centre]
        for i in range(1, half + 1):
            total += taps[half + i] * (values[centre - i] + values[centre + i])
        result[j] = total


def smoothed(data: Prepared, values: Floats) -> Floats:
    """Values of shape (n,) low-passed onto the grid, shape (m,)."""
    result = np.empty(len(data.grid))
    smooth_at(values, data.taps, data.grid, result)
    return result


def measured_motion(data: Prepared) -> Motion:
    return Motion(data.torque, data.position, data.velocity, data.acceleration)


def simulated_motion(data: Prepared, run: Simulated) -> Motion:
    """A simulation through the same filters as the measurement."""
    parts = filtered_motion(run.position, data.stretches, data.period, data.motion_cutoff)
    return Motion(run.torque, *parts)


def raw_residual(data: Prepared, packed: Packed, moved: Motion) -> Floats:
    """Torque that acted less the torque the model needs, sample by sample, shape (n,)."""
    needed, acted = np.zeros(len(moved.torque)), np.zeros(len(moved.torque))
    substeps = load_substeps(packed.p, packed.on, data.period)
    for stretch in data.stretches:
        rows = stretch.rows
        state = np.zeros(layout.STATES)
        state[MOTOR_TORQUE] = moved.torque[stretch.start]
        applied_torque(packed.p, packed.on, state, moved.torque[rows], data.period, acted[rows])
        required(
            packed.p,
            packed.on,
            state,
            moved.position[rows],
            moved.velocity[rows],
            moved.acceleration[rows],
            data.period,
            substeps,
            needed[rows],
        )
    return np.asarray((acted - needed) / torque_slope(packed, moved.torque))


def torque_slope(packed: Packed, demand: Floats) -> Floats | float:
    """How much of a change of the demand arrives at the shaft.

    The residual is told in the demand's own scale; else saturation would seem to explain by shrinking.
    """
    if not packed.on[_SATURATES]:
        return 1.0
    loss, level = packed.p[_LOSS], packed.p[_LOSS + 1]
    ratio = np.minimum(np.abs(demand) / level, 1.0)
    return np.asarray(np.maximum(1.0 - 3.0 * loss * ratio**2, 0.05))


def residual(data: Prepared, packed: Packed, moved: Motion) -> Floats:
    """R on the grid, shape (m,)."""
    return smoothed(data, raw_residual(data, packed, moved))


def run_twin(
    data: Prepared,
    packed: Packed,
    controller: Controller,
    noise: float,
    random: np.random.Generator,
    quantised: bool = True,
) -> Simulated:
    """Simulates all stretches from their references, each from where it was measured to start.

    `noise` is the standard deviation of a torque that changes every sample [N m].
    """
    n = len(data.reference)
    position, torque = np.zeros(n), np.zeros(n)
    disturbance = random.normal(0.0, noise, n) if noise > 0 else np.zeros(n)
    substeps = substeps_for(packed.p, data.period, packed.on)
    gains = np.array([controller.kp, controller.kd, controller.ki, controller.derivative_filter])
    resolution = data.resolution if quantised else 0.0
    clean = np.zeros(n)
    stable = True
    for stretch in data.stretches:
        rows = stretch.rows
        state, loop = _start(data, packed, controller, stretch.start, resolution)
        command = data.reference[rows] if stretch.closed else data.torque[rows]
        done = simulate(
            packed.p, packed.on, state, gains, loop, stretch.closed, substeps, command,
            data.feedforward[rows] * stretch.closed, disturbance[rows], clean[rows], position[rows],
            torque[rows],
        )  # fmt: skip
        stable &= done == stretch.stop - stretch.start
    stable = stable and bool(np.all(np.isfinite(position)))
    if stable:
        lag = max(float(np.max(np.abs((position - data.measured)[s.rows]))) for s in data.stretches)
        stable = bool(lag < 0.5 * np.ptp(data.measured) + 1e3 * data.resolution)
    return Simulated(position, torque, disturbance, stable)


def bias(data: Prepared, packed: Packed, run: Simulated) -> Floats:
    """What the measurement chain adds to the residual of a perfect model, shape (m,).

    Averaged over repeats, which share it.
    """
    raw = raw_residual(data, packed, simulated_motion(data, run))
    noise = run.disturbance
    raw[1:] += 0.5 * (noise[1:] + noise[:-1])
    rest = smoothed(data, raw)
    for block in data.blocks:
        table = rest[block.rows].reshape(block.repeats, block.count)
        table[:] = table.mean(axis=0)
    return rest


def _start(
    data: Prepared, packed: Packed, controller: Controller, row: int, resolution: float
) -> tuple[Floats, Floats]:
    """State of plant and controller that fit the first sample of a stretch."""
    state = np.zeros(layout.STATES)
    state[layout.POSITION] = data.measured[row]
    state[layout.VELOCITY] = data.velocity[row]
    state[MOTOR_TORQUE] = data.torque[row]
    reach = packed.p[layout.COULOMB] / packed.p[layout.STIFFNESS]
    held = (data.torque[row] - packed.p[layout.OFFSET]) / packed.p[layout.STIFFNESS]
    state[layout.BRISTLE] = float(np.clip(held, -reach, reach))
    error = data.reference[row] - data.measured[row]
    left = data.torque[row] - data.feedforward[row] - controller.kp * error
    total = left / controller.ki - error * data.period if controller.ki > 0 else 0.0
    limit = data.metadata.torque_limit or np.inf
    loop = np.array([data.period, limit, resolution, total, 0.0, data.reference[row], data.measured[row]])
    return state, loop
