"""Runs of the twin: the model in its loop along the recorded references, shaken as the axis was.

One run or several beside one another, each model with the same noise, and runs that are kept because half
of all questions come again. The injected noise is known, so that its own part is taken out of the bias.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.core.remembered import LastOf
from autotune.core.side_by_side import on_each
from autotune.estimation.alignment import followed_late
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import SETTLED, Prepared, Stretch, until_last
from autotune.estimation.disturbance import Disturbance
from autotune.estimation.residual import (
    Motion,
    Simulated,
    batches,
    clockless,
    residuals_of_each,
    simulated_motions,
)
from autotune.estimation.twin import Loop, loop_along, simulate_stretch, simulate_stretches, steps_of_twin
from autotune.models.compiled import compiled
from autotune.models.drive_model import Packed
from autotune.models.lanes import WIDTH, beside_or_one
from autotune.signals.between_samples import later, mean_answer
from autotune.signals.filters import low_pass

Asked: TypeAlias = Callable[[Prepared, PositionController], Floats]
SEED = 20_240
KNOWN_RUNS = 24  # models
KNOWN_LOOPS = 4  # stretches
KNOWN_PARTS = 2  # data
Loops: TypeAlias = LastOf[Loop]
MIRRORED = 2.0
"""Periods of its cut-off by which a stretch is mirrored for a low-pass."""
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""Of a count: from run to run, so that few of them lie evenly."""


def run_twin(
    data: Prepared,
    packed: Packed,
    controller: PositionController,
    noise: Disturbance,
    random: np.random.Generator,
    quantised: bool = True,
    loops: Loops | None = None,
) -> Simulated:
    """Simulates all stretches from their references, each from where it was measured to start."""
    resolution = data.resolution if quantised else 0.0
    run = _run(
        data, packed, controller, *shaken(data, noise, random), resolution, loops or LastOf(KNOWN_LOOPS)
    )
    position = run.position.copy()
    for rows in (stretch.rows for stretch in data.stretches if noise.jitter > 0.0):
        position[rows] = _late_rows(position[rows], noise.jitter / data.period, resolution, random)
    return replace(run, position=position, torque=_compared(data, controller, position, run.torque))


def _compared(data: Prepared, law: PositionController, position: Floats, torque: Floats) -> Floats:
    """Torques of runs as that of the recording is compared, shape (…, n): what the law asks for along each run.

    That is told from what it asks for along the recorded motion by where both differ, so that what lies between the
    samples is the same for both. All of it goes through the current loop that the recorded torque was put behind: what
    the law asks for acts no sooner than the rest.
    """
    if data.asked is None:
        return _as_recorded(data, torque)
    law, late = law.of_its_drive(data.period), acted_late(data, law)
    wanted = np.array(np.broadcast_to(moved_later(data, data.asked, late), torque.shape))
    rate = law.filter_rate(data.period)
    for rows in (stretch.rows for stretch in data.stretches):
        apart = position[..., rows] - data.measured[rows]
        answer = mean_answer(apart, data.period, (law.kp, law.kd, law.ki), rate)
        wanted[..., rows] -= later(answer, law.answer_delay + late)
    return _as_recorded(data, wanted + slower(data, torque - wanted, law.asked))


def acted_late(data: Prepared, law: PositionController) -> int:
    """Samples by which the torque of a loop between the samples acts later than it was recorded: whole cycles.

    Parts of a sample are the moment of recording as well: with them in its loop a twin left more.
    """
    return data.upsampling * data.cycles if law.ticks > 1 else 0


def moved_later(data: Prepared, values: Floats, late: int) -> Floats:
    """Values of shape (n,) so many samples later in each stretch."""
    if late == 0:
        return values
    moved = values.copy()
    for rows in (stretch.rows for stretch in data.stretches):
        moved[rows] = later(values[rows], late)
    return moved


def slower(data: Prepared, values: Floats, cutoff: float) -> Floats:
    """Values of shape (…, n) below a frequency [Hz], in each stretch (`slower_in`)."""
    slow = np.zeros_like(values)
    for rows in (stretch.rows for stretch in data.stretches):
        slow[..., rows] = slower_in(values[..., rows], cutoff, data.period)
    return slow


def slower_in(values: Floats, cutoff: float, period: float) -> Floats:
    """Values of shape (…, n) below a frequency [Hz], which go on mirrored beyond their end; the period in s.

    A low-pass turns what it sees about the last value, and would lift the last seconds by whatever that has of noise:
    a law asks there for what is to come.
    """
    count = values.shape[-1]
    beyond = min(count, round(MIRRORED / (cutoff * period)))
    mirrored = np.concatenate([values, values[..., ::-1][..., :beyond]], axis=-1)
    return np.asarray(low_pass(mirrored, cutoff, period)[..., :count])


def _late_rows(position: Floats, spread: float, resolution: float, random: np.random.Generator) -> Floats:
    """Positions as they are when rows are written at moments that scatter by `spread` samples."""
    late = position + spread * random.standard_normal(len(position)) * np.gradient(position)
    return np.asarray(np.round(late / resolution) * resolution if resolution > 0.0 else late)


def shaken(data: Prepared, noise: Disturbance, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Torque and position noise of a run, shape (n,); late rows are no bias, but for chance, and are not in it.

    What follows the clock shakes every run as it shook the axis: it smooths friction away as any other dither does.
    """
    n = len(data.reference)
    disturbance = noise.drawn(random, n, data.period) if noise.process > 0.0 else np.zeros(n)
    unsure = random.normal(0.0, noise.position, n) if noise.position > 0.0 else np.zeros(n)
    return clockless(data, disturbance), unsure  # what the motion lacks acted beside the drive's torque


def _run(
    data: Prepared,
    packed: Packed,
    controller: PositionController,
    disturbance: Floats,
    unsure: Floats,
    resolution: float,
    loops: Loops,
) -> Simulated:
    n = len(data.reference)
    position, torque = np.zeros(n), np.zeros(n)
    limit = data.metadata.torque_limit or np.inf
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
            loop=_loop(data, controller, stretch, loops),
        )
        stable &= inside
    return Simulated(position, torque, disturbance, stable and _follows(data, position, _near(data)))


def _as_recorded(data: Prepared, torque: Floats) -> Floats:
    """Demands of twins behind the current loop that the recorded one was put behind, shape (…, n).

    In torque mode they are behind it already.
    """
    if data.lag <= 0.0:
        return torque
    late = np.array(torque)
    for own, demand in zip(late.reshape(-1, late.shape[-1]), torque.reshape(-1, late.shape[-1]), strict=True):
        behind = followed_late(data, demand, data.lag)
        for stretch in (one for one in data.stretches if one.closed):
            own[stretch.rows] = behind[stretch.rows]
    return late


def _near(data: Prepared) -> float:
    """How far a twin may be from where the axis was."""
    return float(0.5 * np.ptp(data.measured) + 1e3 * data.resolution)


def _follows(data: Prepared, position: Floats, near: float) -> bool:
    """Whether a simulated axis stays near where the axis was."""
    return all(_stays_near(position[s.rows], data.measured[s.rows], near) for s in data.stretches)


@compiled
def _stays_near(position: Floats, measured: Floats, near: float) -> bool:
    """Whether no place of shape (n,) is as far as that from its own, or is none at all."""
    for k in range(len(position)):  # noqa: SIM110
        if not abs(position[k] - measured[k]) < near:
            return False
    return True


def run_twins(
    data: Prepared,
    models: Sequence[Packed],
    controller: PositionController,
    noise: Sequence[tuple[Floats, Floats]],
    loops: Loops | None = None,
) -> list[Simulated]:
    """A run of each of several models, each with its own `noise` (`shaken`): those that each would make by itself."""
    runs: dict[int, Simulated] = {}
    for chosen, made in _each_pass(data, models, controller, noise, loops or LastOf(KNOWN_LOOPS)):
        runs |= dict(zip(chosen, made, strict=True))
    return [runs[i] for i in range(len(models))]


def _each_pass(
    data: Prepared,
    models: Sequence[Packed],
    controller: PositionController,
    noise: Sequence[tuple[Floats, Floats]],
    loops: Loops,
) -> Iterator[tuple[list[int], list[Simulated]]]:
    """Places of the models that go together, and their runs, pass by pass."""
    steps = [steps_of_twin(packed, data.period, controller) for packed in models]
    passes = list(_passes([packed.on.tobytes() for packed in models], steps, [id(one) for one in noise]))

    def runs(chosen: list[int]) -> list[Simulated]:
        return _runs_in_lanes(data, [(models[i], noise[i]) for i in chosen], controller, loops)

    yield from zip(passes, on_each(runs, passes), strict=True)


def _passes(
    effects: Sequence[Hashable], steps: Sequence[tuple[int, int]], shaken_by: Sequence[int]
) -> Iterator[list[int]]:
    """Places of models with the same effects, at most eight of them together: those of many steps with each other.

    What is left of a pass costs nothing: others go there, in finer steps than they need. Where all go in the same
    steps, those with the same noise ride together, as it is then read once for all of them.
    """
    order = sorted(range(len(steps)), key=lambda i: steps[i], reverse=True)
    if len(set(steps)) == 1:
        turn = {one: place for place, one in enumerate(dict.fromkeys(shaken_by))}
        order.sort(key=lambda i: turn[shaken_by[i]])
    for chosen in batches([effects[i] for i in order]):
        yield [order[i] for i in chosen]


def _runs_in_lanes(
    data: Prepared,
    together: Sequence[tuple[Packed, tuple[Floats, Floats]]],
    controller: PositionController,
    loops: Loops,
) -> list[Simulated]:
    """Runs of up to eight models with the same effects; those that leave all bounds are taken out of a pass."""
    n, count = len(data.reference), len(together)
    if count == 1:
        run = _run(data, together[0][0], controller, *together[0][1], data.resolution, loops)
        return [replace(run, torque=_compared(data, controller, run.position, run.torque))]
    position, torque = np.empty((2, count, n))
    before = 0
    for stretch in data.stretches:
        rows = stretch.rows
        position[:, before : rows.start], torque[:, before : rows.start] = 0.0, 0.0
        before = rows.stop
        alike = all(noise is together[0][1] for _, noise in together)  # one for all lanes then
        noises = [noise for _, noise in (together[:1] if alike else together)]
        shaken, unsure = (_abreast([noise[part] for noise in noises], stretch) for part in (0, 1))
        *done, inside = simulate_stretches(
            _recorded(data, controller, stretch),
            [packed for packed, _ in together],
            controller,
            (data.metadata.torque_limit or np.inf, data.resolution),
            shaken,
            unsure,
            _loop(data, controller, stretch, loops),
        )
        position[:, rows], torque[:, rows] = (values[:count] for values in done)
        if not inside.all():
            kept = [one for one, stays in zip(together, inside, strict=False) if stays]
            again = iter(_runs_in_lanes(data, kept, controller, loops) if kept else [])
            return [
                next(again) if stays else Simulated(position[i], torque[i], noise[0], False)
                for i, ((_, noise), stays) in enumerate(zip(together, inside, strict=False))
            ]
    position[:, before:], torque[:, before:] = 0.0, 0.0
    torque = _compared(data, controller, position, torque)
    near = _near(data)
    return [
        Simulated(position[i], torque[i], noise[0], _follows(data, position[i], near))
        for i, (_, noise) in enumerate(together)
    ]


def _abreast(noises: Sequence[Floats], stretch: Stretch) -> Floats:
    """Noises of shape (n,) of the lanes of a pass along a stretch (`beside_or_one`); pass after pass has the same."""
    if len(noises) == 1:
        return beside_or_one([noises[0][stretch.rows]])
    lanes = [noises[min(lane, len(noises) - 1)] for lane in range(WIDTH)]
    return _TURNED.answer((*lanes, stretch), lambda: beside_or_one([one[stretch.rows] for one in noises]))


_TURNED: LastOf[Floats] = LastOf(4)


def _loop(data: Prepared, controller: PositionController, stretch: Stretch, loops: Loops) -> Loop:
    """What the loop of a twin is given along a stretch, whatever its model."""
    return loops.answer(
        (data, controller, stretch), lambda: loop_along(_recorded(data, controller, stretch), controller)
    )


class Noise:
    """What shakes one run of the twin after another: the same for every model, so that it is drawn once."""

    def __init__(self, data: Prepared, disturbance: Disturbance, counts: float = 0.0) -> None:
        self.disturbance, self._data, self._counts = disturbance, data, counts
        self._random = np.random.default_rng(SEED)
        self._drawn: list[tuple[Floats, Floats]] = []

    def fits(self, data: Prepared, disturbance: Disturbance, counts: float) -> bool:
        """Whether it is what shakes the twin of these data."""
        same = disturbance is self.disturbance and counts == self._counts
        own = self._data
        by_time = data.clocked == own.clocked and data.wander is own.wander
        late = data.shift == own.shift or not data.clocked
        return same and by_time and late and len(data.reference) == len(own.reference)

    def of(self, number: int) -> tuple[Floats, Floats]:
        """Torque and position noise of a run, shape (n,)."""
        while len(self._drawn) <= number:
            torque, position = shaken(self._data, self.disturbance, self._random)
            if self._counts > 0.0:
                position = position + self._counts * ((len(self._drawn) * GOLDEN + 0.25) % 1.0 - 0.5)
            self._drawn.append((torque, position))
        return self._drawn[number]


@dataclass(slots=True)
class TwinRuns:
    """Biases that runs of the twin give one after another, each with noise of its own, at one model.

    Attributes:
        raw: residual of the measured motion at the same model, where it is known.
    """

    data: Prepared
    packed: Packed
    controller: PositionController
    noise: Noise
    loops: Loops
    biases: list[Floats] = field(default_factory=list)
    stable: bool = True
    raw: Floats | None = None


def add_runs(many: Sequence[TwinRuns], count: int, measured: Motion | None) -> None:
    """Runs of each of several models in the same data until there are `count` of it.

    Beside them, where one is given, its residual of the `measured` motion.
    Where a twin leaves all bounds there is no further run of it, now and later.
    """
    data, controller = many[0].data, many[0].controller
    jobs = [(one, i) for one in many if one.stable for i in range(len(one.biases), count)]
    models, noise = [one.packed for one, _ in jobs], [one.noise.of(i) for one, i in jobs]
    found: dict[int, Floats] = {}
    waiting: dict[int, Simulated] = {}
    for chosen, made in _each_pass(data, models, controller, noise, many[0].loops):
        waiting |= {i: run for i, run in zip(chosen, made, strict=True) if run.stable}
        if measured is None:
            # each pass by itself: runs of hundreds of models are more than memory that is near
            found |= _biases(data, models, waiting)
            waiting = {}
    if measured is not None:
        found = _beside_measured(data, [one for one in many if one.raw is None], measured, models, waiting)
    for i, (one, _) in enumerate(jobs):
        one.stable &= i in found
        if one.stable:
            one.biases.append(found[i])


def _biases(data: Prepared, models: Sequence[Packed], runs: Mapping[int, Simulated]) -> dict[int, Floats]:
    """What the chain makes of runs of some of the models, shape (m,) each."""
    motions = simulated_motions(data, list(runs.values()))
    acted = [run.disturbance for run in runs.values()]
    return dict(zip(runs, residuals_of_each(data, [models[i] for i in runs], motions, acted), strict=True))


def _beside_measured(
    data: Prepared,
    wanting: Sequence[TwinRuns],
    measured: Motion,
    models: Sequence[Packed],
    runs: Mapping[int, Simulated],
) -> dict[int, Floats]:
    """`_biases`, and residuals of the measured motion at the models `wanting` them, which fill up a pass."""
    order = sorted(runs)
    motions = [*[measured] * len(wanting), *simulated_motions(data, [runs[i] for i in order])]
    acted = [*[None] * len(wanting), *[runs[i].disturbance for i in order]]
    asked = [*[one.packed for one in wanting], *[models[i] for i in order]]
    errors = residuals_of_each(data, asked, motions, acted)
    for one, error in zip(wanting, errors, strict=False):
        one.raw = error
    return dict(zip(order, errors[len(wanting) :], strict=True))


class KnownRuns:
    """Runs of the twin at the models that were asked for last: half of all questions come again."""

    def __init__(self) -> None:
        self._runs: dict[tuple[bytes, bytes], TwinRuns] = {}
        self._noise: Noise | None = None
        self._heard: LastOf[Floats] = LastOf(1)
        self._parts: LastOf[dict[tuple[int, float], Prepared]] = LastOf(KNOWN_PARTS)
        self.loops: Loops = LastOf(KNOWN_LOOPS)

    def of(
        self, data: Prepared, packed: Packed, controller: PositionController, disturbance: Disturbance
    ) -> TwinRuns:
        """Runs at a model as far as they are known; none of those of other data, controllers or disturbances."""
        key = packed.p.tobytes(), packed.on.tobytes()
        known = self._runs.pop(key, None)
        same = known is not None and known.data is data and known.controller is controller
        if known is None or not same or known.noise.disturbance is not disturbance:
            own = Packed(packed.p.copy(), packed.on.copy())
            counts = data.resolution if controller.adrift else 0.0
            known = TwinRuns(data, own, controller, self._noise_of(data, disturbance, counts), self.loops)
        self._runs[key] = known
        while len(self._runs) > KNOWN_RUNS:
            del self._runs[next(iter(self._runs))]
        return known

    def raw(self, data: Prepared, packed: Packed) -> Floats | None:
        """Residual of the measured motion at a model, where it is known."""
        known = self._runs.get((packed.p.tobytes(), packed.on.tobytes()))
        return known.raw if known is not None and known.data is data else None

    def until_last(self, data: Prepared, rows: Flags, settled: float = SETTLED) -> Prepared:
        """`parts.until_last`, the same one for the same question: its runs and its loop are known then."""
        known = self._parts.answer((data,), dict)
        question = int(np.flatnonzero(rows)[-1]) if rows.any() else -1, settled
        if question not in known:
            known[question] = until_last(data, rows, settled)
        return known[question]

    def heard(self, data: Prepared, controller: PositionController, asked: Asked) -> Floats:
        """What the recorded torque has beside what a controller asks for [N m], shape (n,); the last is known."""
        return self._heard.answer(
            (data, controller), lambda: np.asarray(data.torque - asked(data, controller))
        )

    def _noise_of(self, data: Prepared, disturbance: Disturbance, counts: float) -> Noise:
        if self._noise is None or not self._noise.fits(data, disturbance, counts):
            self._noise = Noise(data, disturbance, counts)
        return self._noise


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
    lag: float
    late: int


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
        data.lag,
        acted_late(data, controller),
    )
