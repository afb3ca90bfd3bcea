"""Better gains: the quickest to settle among those that are robust in both regimes, over the intervals, and hold.

Gains are sought as (ωc, a, b): kd makes ωc the crossover of the sliding regime, kp = kd·ωc/a, ki = kp·ωc/b. Those
that do not keep `Requirements` on the corners of the family are left by their margins alone; the rest is run on the
twin, on axes drawn from the intervals: what counts is the time that is expected of the true one. Differential
evolution (Storn and Price, 1997) with a fixed seed searches; what it finds must then hold on every member, or the
requirements are drawn tighter and it is sought again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.control.gains.hunting import after_step
from autotune.control.gains.judge import Task, Verdict, judge
from autotune.control.gains.loop import Gains
from autotune.control.gains.members import NOMINAL, Family, Member, drawn
from autotune.control.gains.regimes import REGIMES, linear_axis
from autotune.control.gains.sampled import (
    Complexes,
    SampledAxis,
    axis_response,
    controller_response,
    frequencies,
    margins,
    sampled_axis,
    torque_noise,
)
from autotune.control.gains.steps import HORIZON, SHAKEN, settling_time
from autotune.control.gains.stick_slip import sticks_at
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError

SEED = 20
POPULATION, GENERATIONS = 12, 18
POLISHED = 80
"""Gains tried by the simplex that ends the search."""
ROUNDS = 3
TIGHTER = 1.15
LEAST_BANDWIDTH = 0.5  # Hz
SOUGHT, COMPARED = (8, 31), (12, 32)
"""How many axes are drawn from the intervals, and by which seed: for the search, and to compare what it found. An
overshoot that just stays within the band on the nominal axis need not on the true one, and settles far later then.
Eight: where the integral works a step free of friction, chance scatters its time by a fifth from axis to axis."""
FINALISTS = 6
PROMISING = 1.3
"""Times the best so far: what is slower on the first axis drawn is not tried on the others."""
ON_TARGET = 0.02
"""Relative: what counts as the bandwidth that was asked for."""


@dataclass(frozen=True, slots=True)
class Requirements:
    """What gains must keep on the nominal axis, and the part of it that is left at the ends of the intervals.

    Attributes:
        modulus: distance of L from −1, that is a sensitivity of at most 1/modulus (Åström and Hägglund, Advanced
            PID Control, ch. 4, take 1/1.4 to 1/2.0).
        phase: [deg]; gain: [dB], to either side.
        noise: step of the torque for one count, as a share of the torque limit.
        corners: part of modulus, phase and gain that every other member must keep.
    """

    modulus: float = 0.5
    phase: float = 30.0
    gain: float = 6.0
    noise: float = 0.05
    corners: float = 0.75

    def scaled(self, part: float) -> Requirements:
        """The same with margins that many times as large."""
        return replace(
            self, modulus=min(self.modulus * part, 0.85), phase=self.phase * part, gain=self.gain * part
        )


@dataclass(frozen=True, slots=True)
class Corner:
    """One axis in one regime, sampled."""

    what: str
    axis: SampledAxis
    response: Complexes
    period: float
    nominal: bool


@dataclass(frozen=True, slots=True)
class Proposal:
    """What is proposed, and why no more is; `verdict` None where nothing can be."""

    verdict: Verdict | None
    requirements: Requirements
    limited_by: str
    resonance: float


def propose(
    kin: Family,
    task: Task,
    current: Gains,
    bandwidth: float | None = None,
    requirements: Requirements | None = None,
) -> Proposal:
    """Gains in the structure of `current`, for a crossover of `bandwidth` [Hz] or the quickest robust ones.

    Raises:
        ConfigurationError: a bandwidth beyond what the cycle, or an identified resonance, can carry.
    """
    wanted = requirements or Requirements()
    resonance = linear_axis(kin.nominal.model, "sliding").resonance
    _check_bandwidth(bandwidth, kin.nominal.timing.period, resonance)
    corners = corners_of(kin)
    for _ in range(ROUNDS):
        found = _searched(kin, corners, task, current, bandwidth, wanted)
        if found is None:
            return Proposal(None, wanted, _none_found(corners, current, kin, wanted, bandwidth), resonance)
        verdict = judge(found, kin, task)
        if _is_held(verdict):
            return Proposal(None, wanted, _held(_limit(corners, found, kin, wanted, bandwidth)), resonance)
        if _holds(verdict):
            return Proposal(verdict, wanted, _limit(corners, found, kin, wanted, bandwidth), resonance)
        wanted = wanted.scaled(TIGHTER)
    return Proposal(
        None,
        wanted,
        "within its intervals the axis hunts with all that keep the margins",
        resonance,
    )


def _check_bandwidth(bandwidth: float | None, period: float, resonance: float) -> None:
    if bandwidth is None:
        return
    highest = 0.25 / period
    if not LEAST_BANDWIDTH <= bandwidth <= highest:
        raise ConfigurationError(
            f"the bandwidth asked for is {bandwidth:g} Hz; with a cycle of {period:g} s it can be "
            f"{LEAST_BANDWIDTH:g} to {highest:g} Hz. Leave --bandwidth out to have the largest robust one"
        )
    if 0.0 < resonance < bandwidth:
        raise ConfigurationError(
            f"the axis's resonance at {resonance:.4g} Hz lies below the bandwidth asked for, {bandwidth:g} Hz; "
            "no gains "
            f"reach beyond it. Ask for less than {0.5 * resonance:.3g} Hz, or stiffen the transmission"
        )


def corners_of(kin: Family) -> tuple[Corner, ...]:
    """Both regimes of every member."""
    return tuple(_corner(one, regime) for one in kin.members for regime in REGIMES)


def _corner(member: Member, regime: str) -> Corner:
    axis = sampled_axis(
        linear_axis(member.model, "sticking" if regime == "sticking" else "sliding"), member.timing
    )
    period = member.timing.period
    return Corner(
        f"{regime}, {member.what}", axis, axis_response(axis, period), period, member.what == NOMINAL
    )


def shaped(corners: tuple[Corner, ...], current: Gains, point: Floats) -> Gains:
    """Gains of (ln ωc, ln a, ln b) in the structure of `current`; kd from |L(ωc)| = 1 on the nominal axis, sliding."""
    crossover, a, b = np.exp(point)
    rate = 2.0 * math.pi * crossover
    integral = 0.0 if current.structure == "pi_velocity" else rate**2 / (a * b)
    unit = current.scaled(rate / a, 1.0, integral)
    nominal = corners[1]
    loop = np.abs(nominal.response * controller_response(unit, nominal.period))
    at = float(
        np.interp(math.log(crossover), np.log(frequencies(nominal.period)), np.log(np.maximum(loop, 1e-300)))
    )
    kd = math.exp(-at)
    return current.scaled(kd * rate / a, kd, kd * integral)


def shortfall(corners: tuple[Corner, ...], gains: Gains, wanted: Requirements) -> float:
    """By how much the requirements are missed over all corners, 0 where they are kept."""
    total, less = 0.0, wanted.scaled(wanted.corners)
    for one in corners:
        found = margins(one.axis, gains, one.period, one.response)
        if not found.stable:
            return 10.0 + min(found.radius, 10.0)
        least = wanted if one.nominal else less
        total += max(0.0, least.modulus - found.modulus) / least.modulus
        total += max(0.0, least.phase - found.phase) / least.phase
        total += max(0.0, least.gain - min(found.gain, found.gain_down)) / least.gain
    return total


def _searched(
    kin: Family,
    corners: tuple[Corner, ...],
    task: Task,
    current: Gains,
    bandwidth: float | None,
    wanted: Requirements,
) -> Gains | None:
    """The best of the search; None where nothing keeps the requirements."""
    search = _Search(kin, corners, task, current, wanted, bandwidth)
    edges = _edges(kin.nominal.timing.period, bandwidth)
    result = scipy.optimize.differential_evolution(
        search.cost,
        scipy.optimize.Bounds(edges[:, 0], edges[:, 1]),
        popsize=POPULATION,
        maxiter=GENERATIONS,
        seed=SEED,
        tol=1e-3,
        polish=False,
        init="sobol",
    )
    ranked = result.population[np.argsort(result.population_energies)]
    return search.best_of(np.vstack([_polished(search.cost, ranked, edges), ranked]))


def _polished(cost: Callable[[Floats], float], ranked: Floats, edges: Floats) -> Floats:
    """The end of the search taken further by a simplex from its best points (Nelder and Mead, 1965), shape (3,).

    The best gains lie in a corner between margins, which evolution alone comes near but slowly.
    """
    found = scipy.optimize.minimize(
        cost,
        ranked[0],
        method="Nelder-Mead",
        bounds=scipy.optimize.Bounds(edges[:, 0], edges[:, 1]),
        options={"initial_simplex": ranked[:4], "maxfev": POLISHED, "xatol": 1e-3, "fatol": 1e-4},
    )
    return np.asarray(found.x, dtype=np.float64)


class _Search:
    """What the search minimises, and the choice among what it ends with."""

    def __init__(
        self,
        kin: Family,
        corners: tuple[Corner, ...],
        task: Task,
        current: Gains,
        wanted: Requirements,
        bandwidth: float | None,
    ) -> None:
        self._nominal, self._task, self._current, self._wanted = kin.nominal, task, current, wanted
        self._corners, self._few = corners, _binding(corners)
        model, timing = kin.nominal.model, kin.nominal.timing
        self._sought = drawn(model, timing, *SOUGHT)
        self._compared = drawn(model, timing, *COMPARED)
        self._parts = (1.0,) if bandwidth is not None else (1.0, 0.95, 0.9, 0.8, 0.7, 0.6)
        self._best = math.inf

    def cost(self, point: Floats) -> float:
        """Expected time of (ln ωc, ln a, ln b); from 100 on where the requirements are missed."""
        gains, timing = shaped(self._corners, self._current, point), self._nominal.timing
        noise = torque_noise(gains, timing) / (self._wanted.noise * timing.torque_limit)
        missed = max(0.0, noise - 1.0) + shortfall(self._few, gains, self._wanted)
        if missed > 0.0:
            return 100.0 + missed
        first = self._time(gains, self._sought[:1])
        if first > PROMISING * self._best:
            return first
        found = self._time(gains, self._sought)
        self._best = min(self._best, found)
        return found

    def best_of(self, points: Floats) -> Gains | None:
        """The quickest of the first points, best first, that keep all corners; None where none does."""
        kept: list[Gains] = []
        for point in points:
            if len(kept) < FINALISTS and self.cost(point) < 100.0:
                gains = _backed_off(self._corners, self._current, point, self._wanted, self._parts)
                kept += [gains] if gains is not None else []
        return min(kept, key=lambda gains: self._time(gains, self._compared), default=None)

    def _time(self, gains: Gains, members: tuple[Member, ...]) -> float:
        """Seconds to settle, the longer of both steps, with a little of the shorter; more where it hunts."""
        task, nominal = self._task, self._nominal
        # a velocity loop does not bring a small step home against friction; that is the position loop's business
        small = () if gains.structure == "pi_velocity" else (task.steps.small,)
        times = [expected_settling(members, gains, size) for size in (*small, task.steps.large)]
        if (
            max(times) < HORIZON
            and after_step(nominal.model, gains, nominal.timing, task.steps.large, 2.0) is not None
        ):
            return 50.0
        sticks = sticks_at(nominal.model, gains, nominal.timing, task.speed)
        return max(times) + 0.1 * min(times) + (10.0 if sticks else 0.0)


def expected_settling(members: tuple[Member, ...], gains: Gains, size: float) -> float:
    """The mean over axes, each under a disturbance of its own [s]."""
    return float(
        np.mean([
            settling_time(one.model, gains, one.timing, size, seeds=(SHAKEN[0] + k,))
            for k, one in enumerate(members)
        ])
    )  # fmt: skip


def _edges(period: float, bandwidth: float | None) -> Floats:
    """Ends of ln ωc, ln a, ln b; shape (3, 2)."""
    low, high = LEAST_BANDWIDTH, 0.25 / period
    if bandwidth is not None:
        low, high = bandwidth * (1.0 - ON_TARGET), bandwidth * (1.0 + ON_TARGET)
    edges: Floats = np.log(np.array([(low, high), (1.05, 8.0), (1.5, 60.0)]))
    return edges


def _binding(corners: tuple[Corner, ...]) -> tuple[Corner, ...]:
    """The corners that usually bind; all are looked at in the end."""
    keys = (
        "nominal",
        "inertia low",
        "inertia high",
        "damping low",
        "compliance",
        "dead time",
        "torque lag high",
    )
    return tuple(one for one in corners if any(key in one.what for key in keys))


def _backed_off(
    corners: tuple[Corner, ...],
    current: Gains,
    point: Floats,
    wanted: Requirements,
    parts: tuple[float, ...],
) -> Gains | None:
    """Less crossover at the same shape, that many times, until every corner keeps the requirements."""
    for part in parts:
        gains = shaped(corners, current, point + np.array([math.log(part), 0.0, 0.0]))
        if shortfall(corners, gains, wanted) < 0.02:
            return gains
    return None


def _holds(verdict: Verdict) -> bool:
    return not verdict.hunting_members


def _is_held(verdict: Verdict) -> bool:
    """Friction holds the axis: neither do steps arrive, nor does it follow at any speed looked at."""
    arrives = min(verdict.small_settling, verdict.large_settling) < HORIZON
    return not arrives and verdict.stick_slip_below >= verdict.slow.speeds[-1]


def _held(limit: str) -> str:
    return (
        f"friction holds the axis with all gains that keep the margins; steps do not arrive within {HORIZON:g} s and "
        f"slow motion stands still. More gain is limited by {limit}; less dead time, or a stiffer transmission, "
        "would allow it"
    )


def _none_found(
    corners: tuple[Corner, ...], current: Gains, kin: Family, wanted: Requirements, bandwidth: float | None
) -> str:
    at = "" if bandwidth is None else f"with a crossover of {bandwidth:g} Hz "
    missed = f"no gains {at}keep the requirements; in the way: {_limit(corners, current, kin, wanted, None)}"
    return missed if bandwidth is None else f"{missed}. Leave --bandwidth out to have the largest robust one"


def _limit(
    corners: tuple[Corner, ...], gains: Gains, kin: Family, wanted: Requirements, bandwidth: float | None
) -> str:
    """What stands in the way of more, in words."""
    member = kin.nominal
    if bandwidth is not None and shortfall(corners, gains, wanted) < 0.02:
        return f"the bandwidth asked for, {bandwidth:g} Hz"
    if torque_noise(gains, member.timing) > 0.9 * wanted.noise * member.timing.torque_limit:
        return (
            f"the encoder: one count makes a torque of {torque_noise(gains, member.timing):.3g}, and "
            f"{100 * wanted.noise:g} % of the torque limit are allowed"
        )
    worst = min(corners, key=lambda one: margins(one.axis, gains, one.period, one.response).modulus)
    regime, _, what = worst.what.partition(", ")
    return f"the margins while the axis is {regime}, {_end_in_words(what)}"


def _end_in_words(what: str) -> str:
    """Which axis of the family it is."""
    group, _, end = what.rpartition(" ")
    if what == NOMINAL:
        return "with its nominal parameters"
    return f"with {group} at the {end} end of its interval" if end in ("low", "high") else f"with {what}"
