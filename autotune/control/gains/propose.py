"""Better gains: the quickest to settle among those that are robust in both regimes, over the intervals, and hold.

What the search (`search`) finds must hold on every member of the family, or the requirements are drawn tighter and it
is sought again.
"""

from __future__ import annotations

from dataclasses import dataclass

from autotune.control.gains.judge import Task, Verdict, judge
from autotune.control.gains.loop import Gains
from autotune.control.gains.members import NOMINAL, Family
from autotune.control.gains.regimes import linear_axis
from autotune.control.gains.requirements import Corner, Requirements, corners_of, shortfall
from autotune.control.gains.sampled import margins, torque_noise
from autotune.control.gains.search import LEAST_BANDWIDTH, searched
from autotune.control.gains.steps import HORIZON
from autotune.core.errors import ConfigurationError

ROUNDS = 3
TIGHTER = 1.15


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
        found = searched(kin, corners, task, current, bandwidth, wanted)
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
            f"the encoder: one count makes {torque_noise(gains, member.timing):.3g} {member.model.torque_symbol}, and "
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
