"""One diagnosis in progress: data, controller, noise, and the measures that every verdict rests on.

Repeatable variance mean(e₁e₂) is what a model could explain, ½·mean (e₁ − e₂)² is noise that nobody can.
The bias of the twin is an average over few simulations; its own variance is taken out of the former.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import FORGOTTEN, TRAINING, VETO, Block, Prepared
from autotune.estimation.disturbance import STILL, Disturbance
from autotune.estimation.least_squares import Fitted, Free, done_together, fitting
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.residual import Motion, alike, kind_of_pass, measured_motion, residual
from autotune.estimation.twin import leading, steps_of_twin
from autotune.estimation.twin_runs import KnownRuns, Noise, TwinRuns, add_runs
from autotune.models import layout
from autotune.models.drive_model import BASE, CREEP, CURVE, FADING, Packed
from autotune.models.effect import Kind, Parameter
from autotune.models.lanes import WIDTH
from autotune.models.reversal_memory import as_one_bristle, climbing, contact_remembers
from autotune.models.table import EFFECTS
from autotune.models.transmission import has_load
from autotune.signals.chunks import chunk_means, mean_and_error, shared

CERTAIN_ERRORS = 2.0
"""Standard errors of what comes again in one experiment, taken off where it must be beyond doubt."""
MEDIAN_OF_ONE = 0.455
"""Of its mean: the median of a squared deviate, as the variance of two repeats is one."""
NOISE_CHUNK = 60
ONE_WAY = 0.05
"""Of the travel: what may go the other way of motion one way."""
OUTLYING, OUTLYING_SECONDS = 12.0, 0.25
"""Times the median power: a piece of so many seconds with more is left out."""
OUTLYING_SIZE, FEW = 6.0, 0.02
"""Standard deviations beyond which samples are left out, where they are so few of the rows."""
MOST_EVENTS = 3
"""Stretches that are left out where a twin starts and stops as the axis does: what happens more often belongs to it."""
LEAST_WEIGHT = 0.1
"""Of the steadiest experiment: an unsteady one is never left out."""
LEAST_COULOMB = 0.005  # of the torque
LONGEST_REACH = 0.1  # of the travel
SLIDES_WITHIN = 0.5  # of the travel: a contact that bends further is a spring by another name
LEAST_BENT = 0.02  # of the motion: below its level a contact bends at least so much
SLOWEST = 1e-4  # of the speed: damping that has gone by then is none, and friction all there


@dataclass(frozen=True, slots=True)
class Correction:
    """Bias of the twin on the grid and the variance of its error by block [(N m)²]."""

    bias: Floats
    variance: Floats
    stable: bool = True


@dataclass(frozen=True, slots=True)
class Scales:
    """What is large on this axis: torque [N m], velocity, travel, acceleration, and time [s].

    `one_way`: the axis practically moved in one direction only; `steady`: at constant speeds only.
    """

    torque: float
    velocity: float
    travel: float
    acceleration: float
    seconds: float
    one_way: bool = False
    steady: bool = False


@dataclass(frozen=True, slots=True)
class Told:
    """Laws that explain a demand alike, of which a twin told one, and the data before their torque was taken for it."""

    data: Prepared
    laws: tuple[PositionController, ...]


@dataclass(frozen=True, slots=True)
class Problem:
    """Everything a candidate is judged by.

    Attributes:
        candidates: effects that may be what is missing.
        expected: variance between repeats of each block that the disturbance alone makes [(N m)²], shape (blocks,).
        by_counts: variance that comes again in repeats though no model lacks anything [(N m)²], of pairs of twins by
            block, shape (pairs, blocks): where the encoder's counts turn over, the loop answers alike in every repeat,
            and otherwise in a twin that is off by a little.
        misfit: what the law leaves of the recorded torque, as errors are compared, shape (m,); None where it leaves
            nothing that could come again (`with_misfit`).
        rough: a law whose twin is too far off to take anything out, but tells how much comes again by the chain alone.
        told: what the law was told from; None where there was no choice.
        runs: of the twin, as far as they are known.
    """

    data: Prepared
    moved: Motion
    controller: PositionController | None
    disturbance: Disturbance
    scales: Scales
    weight: Floats
    simulations: int = 2
    policy: Policy = POLICY
    candidates: tuple[Kind, ...] = tuple(EFFECTS.values())
    expected: Floats | None = None
    by_counts: Floats | None = None
    misfit: Floats | None = None
    rough: PositionController | None = None
    told: Told | None = None
    runs: KnownRuns = field(default_factory=lambda: KnownRuns(), repr=False, compare=False)

    @property
    def twin(self) -> bool:
        return self.controller is not None

    def two_masses(self, packed: Packed) -> bool:
        """Whether the twin rings: its bias changes as fast with the parameters as the residual itself."""
        return self.twin and has_load(packed.on)

    def correction(self, packed: Packed, simulations: int | None = None) -> Correction:
        """Bias of the measurement chain for this model; nothing to correct without a controller."""
        return self.corrections([packed], simulations)[0]

    def corrections(self, models: Sequence[Packed], simulations: int | None = None) -> list[Correction]:
        """`correction` of each of several models."""
        count = simulations or self.simulations
        if self.controller is None:
            return [self._led(packed, count) for packed in models]
        found = [self.runs.of(self.data, one, self.controller, self.disturbance) for one in models]
        return _corrected(self.data, found, count, self.moved)

    def biases(self, models: Sequence[Packed], simulations: int) -> list[Floats | None]:
        """Bias of each of several models, shape (m,), where nothing asks for their residuals of the measured motion.

        These would take as many passes of the inverse as the runs. None where a twin is unstable.
        """
        if self.controller is None:
            found = [self._led(packed, simulations) for packed in models]
        else:
            many = [self.runs.of(self.data, one, self.controller, self.disturbance) for one in models]
            found = _corrected(self.data, many, simulations, None)
        return [one.bias if one.stable else None for one in found]

    def corrections_under(self, disturbances: Sequence[Disturbance], packed: Packed) -> list[Correction]:
        """`correction` under each of several disturbances; nothing to correct without a controller."""
        if self.controller is None:
            return [_uncorrected(self.data)] * len(disturbances)
        counts = self.data.resolution if self.controller.adrift else 0.0
        raw = self.raw(packed)
        found = [
            TwinRuns(
                self.data, packed, self.controller, Noise(self.data, one, counts), self.runs.loops, raw=raw
            )
            for one in disturbances
        ]
        return _corrected(self.data, found, self.simulations, self.moved)

    def until_trained(self) -> Problem:
        """The problem up to the last row that is fitted: costs are the same, and nothing after it is computed."""
        return replace(self, data=self.runs.until_last(self.data, self.training > 0))

    def until_judged(self) -> Problem:
        """The same where costs are to be those of all the data to the last digit: a search follows them far.

        All of it where what comes later tells of the rows before: the offset of a law that is adrift is that of the
        noise in all rows, and what a law asks for is filtered far slower than motions are.
        """
        if self.data.asked is not None or (self.controller is not None and self.controller.adrift):
            return self
        return replace(self, data=self.runs.until_last(self.data, self.training > 0, FORGOTTEN))

    def twins_alike(self, models: Sequence[Packed]) -> int:
        """How many of the first models one pass of simulation and of inverse can take together."""
        data, law = self.data, self.controller
        twins = [() if law is None else steps_of_twin(packed, data.period, law) for packed in models]
        return alike([(kind_of_pass(data, packed), twin) for packed, twin in zip(models, twins, strict=True)])

    def known_together(self, models: Sequence[Packed], simulations: int) -> None:
        """Runs the twins of models that may be asked for next, as far as they fill one pass."""
        if self.twin:
            self.corrections(models[: min(self.twins_alike(models), WIDTH // simulations)], simulations)

    def _led(self, packed: Packed, count: int) -> Correction:
        """What a twin in torque mode tells, where the axis is so fast that it needs one."""
        if self.data.pace >= 1.0 or self.scales.steady:
            return _uncorrected(self.data)
        data, controller = led(self.data), leading(packed, self.data.pace)
        runs = self.runs.of(data, packed, controller, self.disturbance)
        return _corrected(data, [runs], count, self.moved)[0]

    def raw(self, packed: Packed) -> Floats:
        """Residual of the measured motion without any bias, shape (m,)."""
        known = self.runs.raw(self.data, packed)
        return residual(self.data, packed, self.moved) if known is None else known

    def repeatable(self, error: Floats, correction: Correction, role: str) -> tuple[float, float]:
        """Variance that comes again in every repeat, and its standard error [(N m)²]."""
        chunks = self._repeatable_chunks(error, correction, role)
        mean, spread = mean_and_error(chunks)
        rows = np.array([float(one[:, 1].sum()) for one in chunks])
        share = float(np.linalg.norm(rows)) / max(float(rows.sum()), 1e-300)
        return mean, math.hypot(spread, share * self._wanders(error))

    def repeatable_for_certain(self, error: Floats, correction: Correction, role: str) -> float:
        """Variance that comes again beyond doubt, experiment by experiment [(N m)²].

        What chance takes off in a noisy experiment, where motion below the quantiser is chaotic, hides nothing of the
        others.
        """
        chunks = self._repeatable_chunks(error, correction, role)
        rows = sum(float(one[:, 1].sum()) for one in chunks)
        each = [(mean_and_error([one]), float(one[:, 1].sum()) / max(rows, 1e-300)) for one in chunks]
        slow = self._wanders(error)
        return sum(
            share * max(mean - CERTAIN_ERRORS * math.hypot(spread, slow), 0.0)
            for (mean, spread), share in each
        )

    def _wanders(self, error: Floats) -> float:
        """Variance between repeats of the mean of an experiment [(N m)²].

        A disturbance that wanders over tens of seconds is one number in each repeat. The product of two of them is
        then a single draw with this for its standard deviation, however many seconds there are. By the median, so that
        one experiment that counts make chaotic says nothing of the others; nor do those of which no row counts.
        """
        repeated = [block for block in self.data.blocks if block.repeats > 1 and self._counts(block)]
        means = [self.compared(block, error).mean(axis=1) for block in repeated]
        return float(np.median([one.var(ddof=1) for one in means])) / MEDIAN_OF_ONE if means else 0.0

    def _repeatable_chunks(self, error: Floats, correction: Correction, role: str) -> list[Floats]:
        """Of each repeated experiment the mean of every second or so, and how much it counts, shape (chunks, 2)."""
        chunks: list[Floats] = []
        for block, spare in zip(self.data.blocks, correction.variance, strict=True):
            steady = self._steadiness(block)
            if block.role != role or block.repeats < 2 or steady == 0.0:
                continue
            product = shared(self.compared(block, error)) - spare
            means = chunk_means(product)
            means[:, 1] *= steady
            chunks.append(means)
        return chunks

    def noise_variance(self, error: Floats, role: str, plain: bool = False) -> float:
        """Variance that differs from repeat to repeat [(N m)²]; nan without repeats of rows that count.

        Experiments count by their weight, or, where it is asked for `plain`, by their length only.
        """
        own = replace(self, data=replace(self.data, certainty=None)) if plain else self
        values = [
            (
                own.compared(block, error).var(axis=0, ddof=1).mean(),
                block.count * (1.0 if plain else self._steadiness(block)),
            )
            for block in self.data.blocks
            if block.role == role and block.repeats > 1
        ]
        variances, counts = np.array(values).reshape(-1, 2).T
        return float(np.average(variances, weights=counts)) if counts.sum() > 0.0 else float("nan")

    def usual_noise(self, error: Floats, role: str) -> float:
        """The same in the median experiment of those that have rows that count [(N m)²]; infinite without any."""
        each = [
            float(self.compared(block, error).var(axis=0, ddof=1).mean())
            for block in self.data.blocks
            if block.role == role and block.repeats > 1 and self._counts(block)
        ]
        return float(np.median(each)) if each else math.inf

    def repeatable_by_block(self, error: Floats, correction: Correction, role: str) -> Floats:
        """Variance that comes again and variance that does not, of each repeated experiment [(N m)²], shape (b, 2)."""
        rows = []
        for block, spare in zip(self.data.blocks, correction.variance, strict=True):
            if block.role == role and block.repeats > 1:
                table = self.compared(block, error)
                noise = float(table.var(axis=0, ddof=1).mean())
                rows.append((float(np.mean(table.mean(axis=0) ** 2)) - noise / block.repeats - spare, noise))
        return np.array(rows).reshape(-1, 2)

    def noise_explainable(self, error: Floats, role: str) -> float:
        """Of the variance between repeats, what the disturbance does not make: drift, memory [(N m)²]."""
        measured = self.noise_variance(error, role)
        if self.expected is None or not math.isfinite(measured):
            return math.inf
        blocks = zip(self.data.blocks, self.expected, strict=True)
        known = [(v, b.count * self._steadiness(b)) for b, v in blocks if b.role == role and b.repeats > 1]
        levels, counts = np.array(known).T
        return max(measured - float(np.average(levels, weights=counts)), 0.0)

    def of_chain(self, error: Floats, role: str) -> float:
        """Of what repeats of an error share, what a drive's loop between the samples makes of its torque [(N m)²].

        It is no axis's torque as recorded: the law does not ask for it, and the error has it as well. What one repeat
        of the error shares with the law's misfit in another tells how much; a misfit that is not in the error, as where
        the law's sum wanders off, is no part of it.
        """
        if self.misfit is None:
            return 0.0
        weight = along = size = 0.0
        for block in self.data.blocks:
            if block.role == role and block.repeats > 1:
                own, law = self.compared(block, error), self.compared(block, self.misfit)
                both, alone, left = (float(shared(table).mean()) for table in (own + law, own, law))
                count = block.count * self._steadiness(block)
                weight, along = weight + count, along + 0.5 * count * (both - alone - left)
                size += count * left
        if along <= 0.0 or size <= 0.0:
            return 0.0
        return along / weight * min(along / size, 1.0)

    def comes_by_counts(self, role: str) -> tuple[float, float]:
        """Of what repeats of a role share, what the encoder's counts make, and by how much that varies [(N m)²]."""
        blocks = [
            b.count * self._steadiness(b) if b.role == role and b.repeats > 1 else 0.0
            for b in self.data.blocks
        ]
        if self.by_counts is None or sum(blocks) <= 0.0:
            return 0.0, 0.0
        levels = np.average(self.by_counts, axis=1, weights=blocks)
        return max(float(levels.mean()), 0.0), float(levels.std(ddof=1)) if len(levels) > 1 else 0.0

    def mean_square(self, error: Floats, role: str) -> float:
        """Of the rows of a role, by their weight [(N m)²]; nan without any."""
        weight = self.weight * self.data.role(role)
        total = float(weight.sum())
        return float(np.dot(weight, error**2)) / total if total > 0.0 else float("nan")

    def compared(self, block: Block, error: Floats) -> Floats:
        """An experiment's error by repeat, rows as far as they count in each; one of zeros where none does."""
        counts = np.all(block.by_repeat(self.weight) > 0.0, axis=0)
        return (
            self.data.in_usual_noise(block, error)[:, counts]
            if counts.any()
            else np.zeros((block.repeats, 1))
        )

    def _steadiness(self, block: Block) -> float:
        return float(self.weight[block.rows].max(initial=0.0))

    @property
    def training(self) -> Floats:
        """Weights of the rows that are fitted, shape (m,)."""
        return np.asarray(self.weight * self.data.role(TRAINING))

    def has(self, role: str) -> bool:
        """Whether any row of a role counts."""
        return any(block.role == role and self._counts(block) for block in self.data.blocks)

    @property
    def has_veto(self) -> bool:
        """Whether there is a veto trajectory, and repeats that tell its noise: its own, or those of the training."""
        return self.veto_repeats or (self.has(VETO) and self._repeats(TRAINING))

    @property
    def veto_repeats(self) -> bool:
        return self._repeats(VETO)

    def _repeats(self, role: str) -> bool:
        return any(
            block.role == role and block.repeats > 1 and self._counts(block) for block in self.data.blocks
        )

    def _counts(self, block: Block) -> bool:
        return bool(np.any(self.weight[block.rows] > 0.0))


def led(data: Prepared) -> Prepared:
    """A recording in torque mode as if a controller had added to its torque what keeps it on its way.

    What that one asks for is no torque of the recording's: the sum of both is compared.
    """
    stretches = tuple(replace(stretch, closed=True) for stretch in data.stretches)
    return replace(data, reference=data.measured, feedforward=data.torque, stretches=stretches, asked=None)


def new_problem(data: Prepared, controller: PositionController | None, policy: Policy = POLICY) -> Problem:
    """A problem before anything is known about noise."""
    usable = controller if controller is not None and controller.usable else None
    data = replace(data, load_in_twin=usable is not None)
    moved = measured_motion(data)
    rows = data.grid
    scales = Scales(
        float(np.sqrt(np.mean(data.torque[rows] ** 2))) or 1.0,
        float(np.percentile(np.abs(data.velocity[rows]), 99.5)) or 1.0,
        float(np.ptp(data.position[rows])) or 1.0,
        float(np.percentile(np.abs(data.acceleration[rows]), 99.5)) or 1.0,
        float(len(data.time) * data.period),
        one_way(data.velocity[rows]),
        data.steady,
    )
    return Problem(data, moved, usable, STILL, scales, np.ones(len(rows)), policy=policy)


def _can_tell(name: str, scales: Scales) -> bool:
    """Whether recordings of this kind can tell a base parameter."""
    if name == "offset":
        return not scales.one_way
    return not scales.steady or name in ("viscous", "coulomb")


def one_way(velocity: Floats) -> bool:
    """Whether less than a twentieth of the travel went the other way: a fit of both numbers asks for as much."""
    forward = float(np.sum(velocity[velocity > 0.0]))
    backward = -float(np.sum(velocity[velocity < 0.0]))
    return min(forward, backward) < ONE_WAY * (forward + backward)


def base_free(packed: Packed, scales: Scales, motion_unit: str) -> list[Free]:
    """The base parameters as free ones, and their values in `packed` brought inside what is possible here.

    On an axis that only moved one way offset and Coulomb friction are one number; the offset is held.
    """
    p = packed.p
    typical = {
        "inertia": scales.torque / scales.acceleration,
        "viscous": scales.torque / scales.velocity,
        "coulomb": scales.torque,
        "stiffness": max(p[layout.STIFFNESS], 1e-9),
        "micro_damping": max(p[layout.MICRO_DAMPING], 1e-2 * scales.torque / scales.velocity),
        "offset": 0.3 * scales.torque,
    }
    coulomb = LEAST_COULOMB * scales.torque
    level, longest = coulomb, LONGEST_REACH * scales.travel
    remembers, slides_within = contact_remembers(p, packed.on), SLIDES_WITHIN * scales.travel
    if remembers:  # a bristle beside its elements lets go with them, whatever it carries
        level, longest = as_one_bristle(p)[0], climbing(p)[1]
    slides = not remembers and p[layout.COULOMB] <= slides_within * p[layout.STIFFNESS]
    least = {"coulomb": coulomb, "stiffness": level / longest}
    free = [
        Free(
            b.name,
            b.slot,
            max(b.lower, least.get(b.name, b.lower)),
            b.upper,
            typical[b.name],
            relative=b.name != "offset",
            step=3.0 * typical[b.name],
            above=layout.COULOMB if slides and b.slot == layout.STIFFNESS else -1,
            times=1.0 / slides_within,
        )
        for b in BASE
        if _can_tell(b.name, scales)
    ]
    if p[layout.DAMPING_VELOCITY] > 0.0 and not scales.steady:
        free += fading_free(p, scales)
    if p[layout.BENDS_BACK] > 0.0 and not scales.steady:
        free += curve_free()
    if p[layout.CREEP_VELOCITY] > 0.0 and not scales.steady:
        free += creep_free(p, scales)
    for parameter in free:
        p[parameter.slot] = min(max(p[parameter.slot], parameter.lower), parameter.upper)
    return free


def fading_free(p: Floats, scales: Scales) -> list[Free]:
    """How damping in presliding fades, as free parameters: beyond the fastest motion it does not."""
    return _over_speed(FADING, p, scales)


def creep_free(p: Floats, scales: Scales) -> list[Free]:
    """How friction without a static part comes to its level over speed, as free parameters."""
    return _over_speed(CREEP, p, scales)


def _over_speed(course: tuple[Parameter, ...], p: Floats, scales: Scales) -> list[Free]:
    """Speed and tail of a course over speed."""
    speed, tail = course
    large = float(p[speed.slot])
    return [
        Free(
            speed.name,
            speed.slot,
            SLOWEST * scales.velocity,
            scales.velocity,
            large,
            relative=True,
            step=3.0 * large,
        ),
        Free(tail.name, tail.slot, tail.lower, tail.upper, 0.5, step=0.5),
    ]


def curve_free() -> list[Free]:
    """How a contact bends by a curve of its own, as free parameters."""
    return [Free(one.name, one.slot, LEAST_BENT, one.upper, 0.3, step=0.4) for one in CURVE]


def by_steadiness(problem: Problem, error: Floats) -> Problem:
    """The problem with every experiment weighted by how well its repeats agree.

    Where the quantiser makes slow motion chaotic, repeats differ far more than elsewhere; such an experiment
    would drown what the others tell.
    """
    noise = {i: float(v.mean()) for i, v in _noise_by_block(problem, error)}
    if not noise:
        return problem
    quietest = min(noise.values())
    weight = problem.weight.copy()
    for i, level in noise.items():
        weight[problem.data.blocks[i].rows] *= max(quietest / max(level, 1e-300), LEAST_WEIGHT)
    return replace(problem, weight=weight)


def _noise_by_block(problem: Problem, error: Floats) -> Iterator[tuple[int, Floats]]:
    """Numbers of repeated training blocks, and the variance between repeats of their chunks [(N m)²].

    A friction level that differs between repeats (warming, memory) is no noise: offset and friction of
    each chunk are taken out first.
    """
    direction = np.sign(problem.data.velocity[problem.data.grid])
    for i, block in enumerate(problem.data.blocks):
        if block.role != TRAINING or block.repeats < 2:
            continue
        values: list[float] = []
        table, sign = problem.data.in_usual_noise(block, error), block.by_repeat(direction)
        difference = (table[1:] - table[:-1]) / math.sqrt(2.0)
        pieces = max(1, block.count // NOISE_CHUNK)
        for part in np.array_split(np.arange(block.count), pieces):
            terms = np.column_stack([np.ones(len(part)), sign[0, part]])
            for row in difference[:, part]:
                rest = row - terms @ np.linalg.lstsq(terms, row, rcond=None)[0]
                values.append(float(rest @ rest) / max(len(part) - 2, 1))
        yield i, np.array(values)


def refit(
    problem: Problem,
    packed: Packed,
    free: list[Free],
    correction: Correction,
    iterations: int = 5,
    near: Fitted | None = None,
) -> Fitted:
    """A fit on the training rows; `near` lends its sensitivities to the first step."""
    return refits(problem, [(packed, free, near)], correction, iterations)[0]


def refits(
    problem: Problem,
    starts: Sequence[tuple[Packed, list[Free], Fitted | None]],
    correction: Correction,
    iterations: int,
) -> list[Fitted]:
    """`refit` from several starts, each with what is free and the fit nearby: side by side, in less time."""
    fits = [
        fitting(
            problem.data, packed, free, correction.bias, problem.training, iterations,
            known=None if near is None else (near.jacobian, near.scales),
        )
        for packed, free, near in starts
    ]  # fmt: skip
    return done_together(fits, problem.moved)


def without_outlying(problem: Problem, error: Floats) -> Floats:
    """Weights that leave out stretches with far more error than the usual one: starts, stops, impacts."""
    weight = np.ones_like(problem.weight)
    step = max(
        1,
        round(
            OUTLYING_SECONDS
            * problem.data.pace
            / (problem.data.period * float(np.median(np.diff(problem.data.grid[:50]))))
        ),
    )
    pieces = np.array_split(np.arange(len(error)), max(1, len(error) // step))
    power = np.array([float(np.mean(error[piece] ** 2)) for piece in pieces])
    for piece, value in zip(pieces, power, strict=True):
        if value > OUTLYING * np.median(power):
            weight[piece] = 0.0
    if np.mean(weight > 0) <= 0.5:
        weight = np.ones_like(weight)
    if problem.twin:
        events = int(np.sum(np.diff(weight, prepend=1.0) < 0.0))
        return weight if events <= MOST_EVENTS else np.ones_like(weight)
    size = np.abs(error)
    outlying = size > OUTLYING_SIZE * float(np.median(size[weight > 0])) / 0.6745
    if np.mean(outlying) < FEW:  # more of them are structure
        weight[outlying] = 0.0
    return weight


def _uncorrected(data: Prepared, stable: bool = True) -> Correction:
    return Correction(np.zeros(len(data.grid)), np.zeros(len(data.blocks)), stable)


def _corrected(
    data: Prepared, many: Sequence[TwinRuns], count: int, measured: Motion | None
) -> list[Correction]:
    wanting = {id(runs): runs for runs in many if runs.stable and len(runs.biases) < count}
    if wanting:
        add_runs(list(wanting.values()), count, measured)
    return [
        _uncorrected(data, stable=False)
        if len(runs.biases) < count
        else _averaged(data, np.array(runs.biases[:count]))
        for runs in many
    ]


def _averaged(data: Prepared, runs: Floats) -> Correction:
    bias = runs.mean(axis=0)
    variance = np.zeros(len(data.blocks))
    for i, block in enumerate(data.blocks):
        table = runs[:, block.rows].reshape(-1, block.count)
        bias[block.rows] = np.tile(table.mean(axis=0), block.repeats)
        if len(table) > 1:
            levels = table.var(axis=0, ddof=1) * data.share_of_rows(block)
            variance[i] = float(levels.mean()) / len(table)
    return Correction(bias, variance)
