"""Torque residual R = L[T(u) − required(q, v, a)] of a model on prepared data, and its bias in a twin.

T is what lag and saturation make of the demand, L a zero-phase low-pass on a coarse grid. The same
measurement chain applied to a simulation of the model itself (with quantiser, controller and process
noise) gives the bias that filters, derivatives and quantisation cause; subtracting it is what makes small
effects visible. The injected noise is known, so that its own part is taken out of the bias.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from autotune.core.arrays import Floats, Integers
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import Prepared, Stretch, filtered_motion
from autotune.estimation.disturbance import Disturbance
from autotune.estimation.twin import simulate_stretch, started_torque
from autotune.models import layout
from autotune.models.compiled import compiled
from autotune.models.drive_model import Packed
from autotune.models.inverse import applied_torque, load_substeps, required
from autotune.models.torque_saturation import torque_slope

SEED = 20_240
KNOWN_RUNS = 12  # models


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
def smooth_at(values: Floats, taps: Floats, rows: Integers, result: Floats) -> None:
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
    rest = np.zeros(len(moved.torque))
    for stretch in data.stretches:
        rows = stretch.rows
        part = Motion(
            moved.torque[rows], moved.position[rows], moved.velocity[rows], moved.acceleration[rows]
        )
        rest[rows] = stretch_residual(packed, np.zeros(layout.STATES), part, data.period)
    return rest


def stretch_residual(packed: Packed, start: Floats, moved: Motion, period: float) -> Floats:
    """Torque that acted less the torque the model needs over one contiguous stretch, shape (n,).

    The torque behind a lag has long been what the first demand makes of it. `start` is where motion and
    contact begin.
    """
    needed, acted = np.empty(len(moved.torque)), np.empty(len(moved.torque))
    state = started_torque(packed, start, moved.torque[0])
    applied_torque(packed.p, packed.on, state, moved.torque, period, acted)
    required(
        packed.p,
        packed.on,
        state,
        moved.position,
        moved.velocity,
        moved.acceleration,
        period,
        load_substeps(packed.p, packed.on, period),
        needed,
    )
    return np.asarray((acted - needed) / torque_slope(packed.p, packed.on, moved.torque))


def residual(data: Prepared, packed: Packed, moved: Motion) -> Floats:
    """R on the grid, shape (m,)."""
    return smoothed(data, raw_residual(data, packed, moved))


def run_twin(
    data: Prepared,
    packed: Packed,
    controller: PositionController,
    noise: Disturbance,
    random: np.random.Generator,
    quantised: bool = True,
) -> Simulated:
    """Simulates all stretches from their references, each from where it was measured to start."""
    n = len(data.reference)
    position, torque = np.zeros(n), np.zeros(n)
    disturbance = noise.drawn(random, n, data.period) if noise.process > 0.0 else np.zeros(n)
    unsure = random.normal(0.0, noise.position, n) if noise.position > 0.0 else np.zeros(n)
    limit = data.metadata.torque_limit or np.inf
    resolution = data.resolution if quantised else 0.0
    stable = True
    for stretch in data.stretches:
        rows = stretch.rows
        position[rows], torque[rows], inside = simulate_stretch(
            _recorded(data, controller, stretch),
            packed,
            controller,
            limit,
            resolution,
            disturbance[rows],
            unsure[rows],
        )
        stable &= inside
        if noise.jitter > 0.0:
            position[rows] = _late_rows(position[rows], noise.jitter / data.period, resolution, random)
    stable = stable and bool(np.all(np.isfinite(position)))
    if stable:
        lag = max(float(np.max(np.abs((position - data.measured)[s.rows]))) for s in data.stretches)
        stable = bool(lag < 0.5 * np.ptp(data.measured) + 1e3 * data.resolution)
    return Simulated(position, torque, disturbance, stable)


def _late_rows(position: Floats, spread: float, resolution: float, random: np.random.Generator) -> Floats:
    """Positions as they are when rows are written at moments that scatter by `spread` samples."""
    late = position + spread * random.standard_normal(len(position)) * np.gradient(position)
    return np.asarray(np.round(late / resolution) * resolution if resolution > 0.0 else late)


@dataclass(slots=True)
class TwinRuns:
    """Biases that runs of the twin give one after another, each with noise of its own, at one model."""

    data: Prepared
    packed: Packed
    controller: PositionController
    disturbance: Disturbance
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(SEED))
    biases: list[Floats] = field(default_factory=list)
    stable: bool = True

    def add(self) -> None:
        """One run more; where the twin leaves all bounds there is none, now and later."""
        data = self.data
        prompt = replace(self.disturbance, jitter=0.0)  # late rows are no bias, but for chance
        run = run_twin(data, self.packed, self.controller, prompt, self.random)
        self.stable = run.stable
        if run.stable:
            raw = raw_residual(data, self.packed, simulated_motion(data, run))
            raw[1:] += 0.5 * (run.disturbance[1:] + run.disturbance[:-1])
            self.biases.append(smoothed(data, raw))


class KnownRuns:
    """Runs of the twin at the models that were asked for last: half of all questions come again."""

    def __init__(self) -> None:
        self._runs: dict[tuple[bytes, bytes], TwinRuns] = {}

    def of(
        self, data: Prepared, packed: Packed, controller: PositionController, disturbance: Disturbance
    ) -> TwinRuns:
        """Runs at a model as far as they are known; none of those of other data, controllers or disturbances."""
        key = packed.p.tobytes(), packed.on.tobytes()
        known = self._runs.pop(key, None)
        same = known is not None and known.data is data and known.controller is controller
        if known is None or not same or known.disturbance is not disturbance:
            own = Packed(packed.p.copy(), packed.on.copy())
            known = TwinRuns(data, own, controller, disturbance)
        self._runs[key] = known
        while len(self._runs) > KNOWN_RUNS:
            del self._runs[next(iter(self._runs))]
        return known


@dataclass(frozen=True, slots=True)
class _Recorded:
    """A stretch of prepared data, as the twin takes it."""

    period: float
    closed: bool
    measured: Floats
    reference: Floats
    torque: Floats
    feedforward: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    rate: float
    last_reference: float
    last_position: float
    pace: float


def _recorded(data: Prepared, controller: PositionController, stretch: Stretch) -> _Recorded:
    """Nothing was recorded before a stretch: the controller is taken to have followed the motion it starts with."""
    rows = stretch.rows
    reference, velocity = data.reference[rows], data.velocity[rows]
    wanted = float(reference[1] - reference[0]) / data.period
    return _Recorded(
        data.period,
        stretch.closed,
        data.measured[rows],
        reference,
        data.torque[rows],
        data.feedforward[rows],
        data.position[rows],
        velocity,
        data.acceleration[rows],
        controller.reference_rate * wanted - float(velocity[0]),
        float(reference[0]) - wanted * data.period,
        float(data.measured[stretch.start]) - float(velocity[0]) * data.period,
        data.pace,
    )
