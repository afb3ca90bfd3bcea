"""A verdict on one set of gains: margins over the intervals, hunting, stick-slip, steps, noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from autotune.control.gains.hunting import LimitCycle, predicted
from autotune.control.gains.loop import Gains
from autotune.control.gains.members import Family, Member
from autotune.control.gains.regimes import REGIMES, Regime, linear_axis
from autotune.control.gains.sampled import Margins, margins, sampled_axis, torque_noise
from autotune.control.gains.steps import StepSizes, settling_time, stop_time
from autotune.control.gains.stick_slip import SlowMotion, slow_at, slow_motion


@dataclass(frozen=True, slots=True)
class Task:
    """What the axis is for: the steps and speeds at which gains are judged.

    Attributes:
        steps: small and large step [rad or m].
        speed: the fastest of the slow speeds at which stick-slip is looked for [rad/s or m/s].
    """

    steps: StepSizes
    speed: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of a set of gains on a family of axes.

    Attributes:
        nominal: margins of the nominal axis by regime; `worst` the least over the family, each by itself, with the
            member that is least robust.
        cycle: hunting on the nominal axis; None where it holds.
        hunting_members: those that hunt, of the family.
        sticking_members: those that stick-slip, and `stick_slip_below` the speed that all of them keep above.
        small_settling, large_settling: on the nominal axis [s].
        stop_seconds: standstill where the reference turns at the task's speed [s].
        noise: step of the torque that one count makes [N m or N].
    """

    gains: Gains
    nominal: dict[Regime, Margins]
    worst: dict[Regime, tuple[Margins, str]]
    cycle: LimitCycle | None
    hunting_members: tuple[str, ...]
    slow: SlowMotion
    sticking_members: tuple[str, ...]
    stick_slip_below: float
    small_settling: float
    large_settling: float
    stop_seconds: float
    noise: float

    @property
    def hunts(self) -> bool:
        return self.cycle is not None

    @property
    def bandwidth(self) -> float:
        """Crossover of the sliding regime, the lesser of both [Hz]."""
        return self.nominal["sliding"].crossover

    @property
    def phase_margin(self) -> float:
        """The least over both regimes and the family [deg]."""
        return min(found.phase for found, _ in self.worst.values())

    @property
    def gain_margin(self) -> float:
        """The least over both regimes and the family [dB]."""
        return min(
            min(found.gain, found.gain_down) if found.stable else found.gain
            for found, _ in self.worst.values()
        )

    @property
    def settling(self) -> float:
        """The longer of small and large step [s]."""
        return max(self.small_settling, self.large_settling)

    def as_json(self) -> dict[str, object]:
        """As `gains --json` has it; what is not a number is null there."""
        cycle = self.cycle
        return {
            "gains": self.gains.named(),
            "structure": self.gains.structure,
            "bandwidth_hz": self.bandwidth,
            "phase_margin_deg": self.phase_margin,
            "gain_margin_db": self.gain_margin,
            "hunts": self.hunts,
            "hunting_frequency_hz": cycle.frequency if cycle else None,
            "hunting_amplitude": cycle.amplitude if cycle else None,
            "stick_slip_below": self.stick_slip_below,
            "settling_time": self.settling,
            "settling_time_small": self.small_settling,
            "settling_time_large": self.large_settling,
            "stop_time": self.stop_seconds,
            "torque_noise": self.noise,
            "hunting_members": list(self.hunting_members),
        }


def judge(gains: Gains, kin: Family, task: Task) -> Verdict:
    """Everything about one set of gains; about a second of work."""
    nominal = kin.nominal
    table = {regime: [(_margins(one, gains, regime), one.what) for one in kin.members] for regime in REGIMES}
    sizes = (task.steps.large, task.steps.small)
    cycle = predicted(nominal.model, gains, nominal.timing, sizes)
    hunting = [one.what for one in kin.members[1:] if _hunts(one, gains, sizes)]
    slow = slow_motion(nominal.model, gains, nominal.timing, task.speed)
    others = {one.what: slow_at(one.model, gains, one.timing, slow.speeds).below for one in kin.members[1:]}
    sticking = [what for what, below in others.items() if below > 0.0]
    small, large = (settling_time(nominal.model, gains, nominal.timing, size) for size in sizes[::-1])
    return Verdict(
        gains=gains,
        nominal={regime: rows[0][0] for regime, rows in table.items()},
        worst={regime: _least(rows) for regime, rows in table.items()},
        cycle=cycle,
        hunting_members=tuple((["nominal"] if cycle else []) + hunting),
        slow=slow,
        sticking_members=tuple((["nominal"] if slow.below > 0.0 else []) + sticking),
        stick_slip_below=max([slow.below, *others.values()]),
        small_settling=small,
        large_settling=large,
        stop_seconds=stop_time(nominal.model, gains, nominal.timing, task.speed),
        noise=torque_noise(gains, nominal.timing),
    )


def _margins(member: Member, gains: Gains, regime: Regime) -> Margins:
    axis = sampled_axis(linear_axis(member.model, regime), member.timing)
    return margins(axis, gains, member.timing.period)


def _least(rows: Sequence[tuple[Margins, str]]) -> tuple[Margins, str]:
    """The least margins of several loops, and the member whose loop is least robust.

    Who comes nearest to −1 need not have the least phase margin, or the least gain margin.
    """
    found, what = min(rows, key=lambda row: _robustness(row[0]))
    phase, gain, down = (
        min(getattr(one, name) for one, _ in rows) for name in ("phase", "gain", "gain_down")
    )
    return replace(found, phase=phase, gain=gain, gain_down=down), what


def _hunts(member: Member, gains: Gains, sizes: tuple[float, float]) -> bool:
    return predicted(member.model, gains, member.timing, sizes, slow=False) is not None


def _robustness(found: Margins) -> float:
    """One figure to compare loops by: the distance from −1, below 0 where unstable."""
    return found.modulus if found.stable else -found.radius if math.isfinite(found.radius) else -math.inf
