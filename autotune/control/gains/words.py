"""A verdict on gains in sentences: first what matters at the machine, then why."""

from __future__ import annotations

import math
from collections.abc import Sequence

from autotune.control.gains.hunting import LimitCycle
from autotune.control.gains.judge import Verdict
from autotune.control.gains.loop import STRUCTURES, Gains
from autotune.control.gains.members import ASSUMED, Family
from autotune.control.gains.propose import Proposal
from autotune.control.gains.requirements import Requirements
from autotune.control.gains.routh import passivity_margin, pid_conditions
from autotune.control.gains.steps import HORIZON
from autotune.core.units import damping_symbol, percent, torque_symbol

TODAY = "Today's gains"
HARDLY = 1.1
"""Times the proposal's time to settle: who is that quick is not slower to speak of."""
NEARLY = 0.98
"""Of a margin: the rest is rounding of what was sought on a grid of frequencies."""
NEVER = 0.95
"""Of the horizon: who is still outside by then does not settle."""


def advice(
    kin: Family, current: Verdict | None, proposal: Proposal, unit: str, who: str = TODAY
) -> list[str]:
    """All that is to be said, a sentence each; `who`: whose the gains are that were judged."""
    said = assumptions(kin)
    if current is not None:
        said += about(kin, current, unit, who, proposal.requirements)
    if proposal.verdict is not None:
        said += _proposed(kin, current, proposal, unit, who)
    else:
        said.append(f"No better gains can be proposed: {proposal.limited_by}.")
    said += resonance_advice(proposal)
    said.append(passivity_in_words(kin, unit))
    return said


def about(kin: Family, verdict: Verdict, unit: str, who: str, wanted: Requirements) -> list[str]:
    """What a set of gains does: hunting, stick-slip, margins, and what the textbook's conditions say."""
    said = [f"{who}: {hunting_in_words(verdict, unit)}"]
    said.append(f"{who}: {stick_slip_in_words(verdict, unit)}")
    said.append(f"{who}: {_margins_in_words(verdict, wanted)}")
    said.append(f"{who}: {conditions_in_words(kin, verdict.gains)}")
    return said


def hunting_in_words(verdict: Verdict, unit: str) -> str:
    """The verdict on hunting with its frequency and amplitude."""
    if verdict.cycle is not None:
        return f"the axis hunts after a step, {cycle_in_words(verdict.cycle, unit)}."
    if verdict.hunting_members:
        return (
            "the nominal axis holds its set point, but within the intervals of its parameters it can hunt (with "
            f"{', '.join(verdict.hunting_members)})."
        )
    sliding = verdict.nominal["sliding"]
    if not sliding.stable:
        return (
            "after a step friction holds the axis, although the loop is unstable while it slides: in motion it swings, "
            "and a little less friction lets it hunt."
        )
    return "the axis does not hunt, at any end of its parameters' intervals."


def stick_slip_in_words(verdict: Verdict, unit: str) -> str:
    """Which slow speeds the axis can hold."""
    slow = verdict.slow
    if verdict.stick_slip_below <= 0.0:
        return f"no stick-slip between {slow.speeds[0]:.2g} and {slow.speeds[-1]:.2g} {unit}/s."
    if slow.below <= 0.0:
        return (
            f"no stick-slip of the nominal axis from {slow.speeds[0]:.2g} {unit}/s on, but within the intervals of its "
            f"parameters it can stick and slip below {verdict.stick_slip_below:.2g} {unit}/s (with "
            f"{', '.join(verdict.sticking_members)})."
        )
    if verdict.stick_slip_below >= slow.speeds[-1]:
        return (
            f"stick-slip at every speed that was looked at, up to {slow.speeds[-1]:.2g} {unit}/s: the axis stands, or "
            "comes to stand again and again."
        )
    return (
        f"stick-slip below about {verdict.stick_slip_below:.2g} {unit}/s: in slow motion the axis comes to stand again "
        "and again."
    )


def cycle_in_words(cycle: LimitCycle, unit: str) -> str:
    """Amplitude and frequency."""
    if cycle.unbounded:
        return "and the swing grows without bound"
    rate = f" at {cycle.frequency:.3g} Hz" if math.isfinite(cycle.frequency) else ", now and then"
    return f"by about ±{1e3 * cycle.amplitude:.3g} m{unit}{rate}"


def _margins_in_words(verdict: Verdict, wanted: Requirements) -> str:
    parts = []
    for regime, (found, what) in verdict.worst.items():
        if not found.stable:
            parts.append(f"{regime}, unstable ({what})")
        else:
            room = min(found.gain, found.gain_down)
            most = 1.0 / max(found.modulus, 1e-9)
            parts.append(
                f"{regime}, {found.phase:.0f}° and {room:.3g} dB with a sensitivity of {most:.2g} ({what})"
            )
    less = wanted.scaled(wanted.corners)
    told = (
        "that is robust"
        if _robust(verdict, less)
        else f"that is too little, {less.phase:.0f}°, {less.gain:.2g} dB and a sensitivity of at most "
        f"{1.0 / less.modulus:.2g} are wanted"
    )
    return f"crossover at {verdict.bandwidth:.3g} Hz; least margins over the intervals: {'; '.join(parts)}; {told}."


def _robust(verdict: Verdict, least: Requirements) -> bool:
    return all(
        one.stable
        and one.modulus >= NEARLY * least.modulus
        and one.phase >= NEARLY * least.phase
        and min(one.gain, one.gain_down) >= NEARLY * least.gain
        for one, _ in verdict.worst.values()
    )


def conditions_in_words(kin: Family, gains: Gains) -> str:
    """Theorem 4.2 and Routh with their margins, as information."""
    found = pid_conditions(kin.nominal.model, gains)
    theorem = (
        "Theorem 4.2 of the thesis guarantees that it does not hunt"
        if found.sufficient
        else "Theorem 4.2 of the thesis, sufficient but not necessary, leaves it open"
    )
    routh = "holds" if found.sliding_stable else "fails"
    return (
        f"for information, without sampling: {theorem} (kp {found.position[0]:.3g} where more than "
        f"{found.position[1]:.3g} is asked for, damping {found.damping[0]:.3g} where more than {found.damping[1]:.3g} "
        f"is); Routh's condition of the sliding regime {routh} ({found.routh[0]:.3g}, more than {found.routh[1]:.3g} "
        "is asked for)."
    )


def _proposed(kin: Family, current: Verdict | None, proposal: Proposal, unit: str, who: str) -> list[str]:
    verdict = proposal.verdict
    if verdict is None:
        return []
    before = f" ({_lowered(who)} {_settles(current)})" if current is not None else ""
    count = f"One count of the encoder makes a {'torque' if unit == 'rad' else 'force'} of {_count(kin, verdict, unit)}"
    beside = f", and of {_count(kin, current, unit)} with {_lowered(who)}" if current is not None else ""
    said = [
        f"Proposed for {STRUCTURES[verdict.gains.structure]}, in SI at the motor: "
        f"{gains_in_words(verdict.gains, unit)}. Crossover {verdict.bandwidth:.3g} Hz; on the twin steps "
        f"{_settles(verdict)}{before}; {hunting_in_words(verdict, unit)} "
        f"In slow motion: {stick_slip_in_words(verdict, unit)} Higher gains are limited by {proposal.limited_by}.",
        f"{count} with them{beside}.",
    ]
    if current is not None and _as_good(current, verdict, proposal.requirements):
        said.append(f"{who} are robust and hardly slower: there is little to gain by others.")
    return said


def _as_good(current: Verdict, proposed: Verdict, wanted: Requirements) -> bool:
    quick = current.settling <= HARDLY * proposed.settling and current.settling < HORIZON
    still = not current.hunting_members and current.stick_slip_below <= proposed.stick_slip_below
    return quick and still and _robust(current, wanted.scaled(wanted.corners))


def _settles(verdict: Verdict) -> str:
    if verdict.gains.structure == "pi_velocity":
        return "are left to the position loop"
    if verdict.settling >= NEVER * HORIZON:
        return f"do not all settle to ±10 % within {HORIZON:g} s"
    return f"settle to ±10 % within {1e3 * verdict.settling:.0f} ms"


def _count(kin: Family, verdict: Verdict, unit: str) -> str:
    torque = torque_symbol(unit)
    part = percent(verdict.noise / kin.nominal.timing.torque_limit)
    return f"{verdict.noise:.2g} {torque} ({part} % of the limit)"


def gains_in_words(gains: Gains, unit: str) -> str:
    """Every gain with its unit."""
    torque = torque_symbol(unit)
    units = {
        "kp": f" {torque}/{unit}",
        "kd": f" {damping_symbol(unit)}",
        "ki": f" {torque}/({unit} s)",
        "position_gain": " 1/s",
        "velocity_gain": f" {damping_symbol(unit)}",
        "integral_gain": f" {torque}/{unit}",
        "notch_frequency": " Hz",
    }
    return ", ".join(f"{name} {value:.4g}{units.get(name, '')}" for name, value in gains.named().items())


def _lowered(who: str) -> str:
    return who[0].lower() + who[1:]


def assumptions(kin: Family) -> list[str]:
    """What was assumed because the model does not say it."""
    if not kin.assumed:
        return []
    return [
        f"The model has no standard error for {', '.join(kin.assumed)}: ±{100 * ASSUMED:.0f} % is assumed. "
        "Identify the axis "
        "('autotune run') to have intervals."
    ]


def resonance_advice(proposal: Proposal) -> list[str]:
    """A notch where a resonance was identified."""
    if proposal.resonance <= 0.0:
        return []
    verdict = proposal.verdict
    if verdict is not None and verdict.gains.notch is not None:
        return [
            f"The transmission resonates at {proposal.resonance:.4g} Hz: the proposal has a notch there. It "
            "pays only while "
            "the resonance stays where it is."
        ]
    return [
        f"The transmission resonates at {proposal.resonance:.4g} Hz; the proposal keeps clear of it without a notch."
    ]


def passivity_in_words(kin: Family, unit: str) -> str:
    """(3.13), (3.14) as a sentence about the identified parameters."""
    per_speed = damping_symbol(unit)
    margin = passivity_margin(kin.nominal.model)
    if margin >= 0.0:
        return (
            "The axis by itself is passive: its viscous friction exceeds what (3.14) of the thesis asks for by "
            f"{margin:.2g} {per_speed}."
        )
    return (
        "The axis by itself is not passive by (3.14) of the thesis: its friction falls with speed; a velocity gain of "
        f"{-margin:.2g} {per_speed} would make it so."
    )


def joined(sentences: Sequence[str]) -> str:
    """For a report: one paragraph."""
    return " ".join(sentences)
