"""The guard: sees every sample and the next command before it is sent, and stops in time.

A stop acts one cycle after it is decided, and on a pipelined link the sample is one cycle old
already. So travel is predicted over a reaction time T = (2 + missed)·h, in which the axis may still
speed up with a, and the braking distance after it (a = `limits.deceleration`):

    v₁ = v + aT,   q₁ = q + vT + aT²/2,   stop = q₁ + v₁²/2a   (upwards, if v₁ > 0)

and mirrored downwards. Both the velocity that the drive reports and the difference of positions are
believed, whichever is worse (see `speed_watch`). Speed and following error are extrapolated over the same
time. Torque that should move the axis and an encoder that does not are told by `motion_watch`. Nothing
here is ever switched off or widened: an experiment that cannot live with a limit does not run. What is
guarded against, how soon, and what is left to drive and emergency stop: docs/safety.md.
"""

from __future__ import annotations

import math
from typing import NoReturn

from autotune.core.axis import Limits
from autotune.core.drive import Command, Mode, Sample
from autotune.core.errors import GuardStop
from autotune.experiments.motion_watch import Learnt, MotionWatch
from autotune.experiments.speed_watch import SpeedWatch

REACTION_CYCLES = 2
MEASURED_TORQUE_MARGIN = 1.1  # the measured torque is noisy; the demand is held to the limit itself
ROUNDING = 1.0 + 1e-9
OFF_REFERENCE = 0.2  # of limits.following_error: how far from its reference the axis may be at the beginning
OFF_COUNTS = 4.0  # and this many counts beside it
BEGIN_SPEED = 0.25  # of limits.speed: what one count of a coarse encoder may look like at the beginning
SILENT_SECONDS = 2.0  # without a temperature that was there before
TREND = 0.25  # weight of the newest change in the smoothed trends of speed and following error


class Guard:
    """Watches one axis; pure apart from what it remembers of the samples before.

    Args:
        limits: of the axis, the tighter of axis file and drive.
        period: cycle [s].
        resolution: one count of the position sensor [rad or m].
        seconds: machine time allowed from now on [s].
        learnt: of the axis by an earlier guard of this session.
    """

    __slots__ = (
        "_acceleration",
        "_error",
        "_error_trend",
        "_left",
        "_limits",
        "_lower",
        "_mode",
        "_motion",
        "_off",
        "_period",
        "_position",
        "_reference",
        "_seconds",
        "_silent",
        "_speed",
        "_speeds",
        "_step",
        "_torque",
        "_upper",
        "_velocity",
        "where",
    )

    def __init__(
        self,
        limits: Limits,
        period: float,
        resolution: float,
        seconds: float | None = None,
        learnt: Learnt | None = None,
    ) -> None:
        self._limits = limits
        self._period = period
        self._lower, self._upper = limits.position_min, limits.position_max
        self._speed, self._torque = limits.speed * ROUNDING, limits.torque * ROUNDING
        self._step = limits.speed * period * ROUNDING
        self._seconds = limits.machine_seconds if seconds is None else seconds
        self._left = self._seconds
        self._mode = Mode.POSITION
        self._reference = self._position = self._velocity = self._acceleration = 0.0
        self._error = self._error_trend = 0.0
        self._off = OFF_REFERENCE * limits.following_error + OFF_COUNTS * resolution
        self._silent = math.nan
        self._motion = MotionWatch(limits, period, resolution, learnt)
        self._speeds = SpeedWatch(limits, period, resolution)
        self.where = ""

    @property
    def elapsed(self) -> float:
        """Machine time used so far [s]."""
        return self._seconds - self._left

    @property
    def learnt(self) -> Learnt:
        """What the axis has shown of itself so far."""
        return self._motion.learnt

    @property
    def doubtful(self) -> bool:
        """Whether the encoder may not show just now what the axis does."""
        return self._motion.doubtful

    def begin(self, mode: Mode, sample: Sample) -> None:
        """Takes the first sample after power came on, in `mode`.

        Raises:
            GuardStop: the axis stands outside its travel, moves, or is not where its reference is. It is `blind`: what
                has not moved yet needs no braking, and an encoder that died before would drive it.
        """
        try:
            self._begin(mode, sample)
        except GuardStop as stop:
            stop.blind = True
            raise

    def _begin(self, mode: Mode, sample: Sample) -> None:
        self._mode = mode
        self._reference, self._position = sample.reference, sample.position
        self._velocity, self._acceleration = sample.velocity, 0.0
        self._error, self._error_trend = sample.reference - sample.position, 0.0
        if not self._lower <= sample.position <= self._upper:
            self._refuse_travel(sample, sample.position, "the axis stands at")
        if not abs(sample.velocity) <= BEGIN_SPEED * self._speed:
            self._refuse(
                sample, "speed", sample.velocity, BEGIN_SPEED * self._speed, "as power comes on, the speed is"
            )
        if mode is Mode.POSITION and not abs(self._error) <= self._off:
            self._refuse_reference(sample)
        self._speeds.begin(sample.position, self._period)
        self._motion.begin(mode, sample.position, sample.reference, sample.torque_command)

    def check(self, sample: Sample, command: Command) -> None:
        """Lets `command` pass, knowing `sample`, or stops.

        Raises:
            GuardStop: the next cycles would break a limit; says which, and what to do. It is `blind` where the
                encoder may not show what the axis does, whichever limit was met first.
        """
        try:
            self._check(sample, command)
        except GuardStop as stop:
            stop.blind = self.doubtful
            raise

    def _check(self, sample: Sample, command: Command) -> None:
        self._check_sample(sample)
        position, velocity, torque, feedforward = command
        mode = self._mode
        if mode is Mode.POSITION:
            if not self._lower <= position <= self._upper:
                self._refuse_travel(sample, position, "the next reference is")
            if not -self._step <= position - self._reference <= self._step:
                self._refuse_jump(sample, position)
            self._reference = position
        elif mode is Mode.VELOCITY:
            if not -self._speed <= velocity <= self._speed:
                self._refuse(sample, "speed", velocity, self._limits.speed, "the commanded speed is")
        elif not -self._torque <= torque + feedforward <= self._torque:
            total = torque + feedforward
            self._refuse(sample, "torque", total, self._limits.torque, "the commanded torque is")
        if not -self._torque <= feedforward <= self._torque:
            self._refuse(sample, "torque", feedforward, self._limits.torque, "the torque offset is")

    def _check_sample(self, sample: Sample) -> None:
        _, reference, position, velocity, demand, torque, _, _, temperature, missed = sample
        cycle = self._period * (1 + missed)
        reaction = self._period * (REACTION_CYCLES + missed)
        self._left -= cycle
        why = self._motion.check(position, reference, demand, cycle)  # first: it knows which stop is blind
        self._check_travel(sample, position, velocity, (position - self._position) / cycle, reaction)
        self._acceleration += TREND * ((velocity - self._velocity) / cycle - self._acceleration)
        if not -self._speed <= velocity + self._acceleration * reaction <= self._speed:
            self._refuse(sample, "speed", velocity, self._limits.speed, "the speed, soon too high, is")
        if fast := self._speeds.check(position, velocity, cycle, reaction):
            raise GuardStop(f"{self._place(sample)}: {fast}")
        error = reference - position
        self._error_trend += TREND * ((error - self._error) / cycle - self._error_trend)
        allowed = self._limits.following_error
        if not -allowed <= error + self._error_trend * reaction <= allowed and self._mode is Mode.POSITION:
            self._refuse(sample, "following_error", error, allowed, "the following error, soon too large, is")
        if not -self._torque <= demand <= self._torque:
            self._refuse(sample, "torque", demand, self._limits.torque, "the torque demand is")
        if not abs(torque) <= MEASURED_TORQUE_MARGIN * self._torque:
            self._refuse(sample, "torque", torque, self._limits.torque, "the measured torque is")
        if temperature > self._limits.temperature:
            self._refuse(sample, "temperature", temperature, self._limits.temperature, "the temperature is")
        if temperature == temperature:
            self._silent = 0.0
        else:
            self._silent += cycle  # stays nan where there never was one
            if self._silent > SILENT_SECONDS:
                self._refuse_silence(sample)
        if self._left < 0.0:
            self._refuse(sample, "machine_seconds", self.elapsed, self._seconds, "the machine time is")
        if why:
            raise GuardStop(f"{self._place(sample)}: {why}")
        self._position, self._velocity, self._error = position, velocity, error

    def _check_travel(
        self, sample: Sample, position: float, reported: float, seen: float, reaction: float
    ) -> None:
        braking = self._limits.deceleration
        gain = braking * reaction
        drift = 0.5 * gain * reaction
        up, down = (reported, seen) if reported > seen else (seen, reported)
        peak = position + up * reaction + drift
        if (end := up + gain) > 0.0:
            peak += end * end / (2.0 * braking)
        low = position + down * reaction - drift
        if (end := down - gain) < 0.0:
            low -= end * end / (2.0 * braking)
        # written so that nan, which makes every comparison false, is refused too
        if not peak <= self._upper:
            self._refuse_travel(sample, peak, "the axis could stop only at")
        if not low >= self._lower:
            self._refuse_travel(sample, low, "the axis could stop only at")

    def _refuse_travel(self, sample: Sample, value: float, what: str) -> NoReturn:
        if not math.isfinite(value):
            raise GuardStop(
                f"{self._place(sample)}: position {sample.position} or velocity {sample.velocity} or the "
                "command is not a finite number; check encoder, cable and the drive's scaling"
            )
        name, limit = "position_max", self._upper
        if value < self._lower:
            name, limit = "position_min", self._lower
        raise GuardStop(
            f"{self._place(sample)}: {what} {value:.6g}, but limits.{name} allows {limit:.6g} (position "
            f"{sample.position:.6g}, velocity {sample.velocity:.4g}); move the axis well inside its travel "
            "by hand, or widen the limit if the machine allows it"
        )

    def _refuse_jump(self, sample: Sample, position: float) -> NoReturn:
        raise GuardStop(
            f"{self._place(sample)}: the reference would jump from {self._reference:.6g} to {position:.6g} "
            f"in one cycle, but limits.speed allows {self._step:.3g} a cycle; slow the trajectory down, or "
            "raise limits.speed if the machine allows it"
        )

    def _refuse_reference(self, sample: Sample) -> NoReturn:
        raise GuardStop(
            f"{self._place(sample)}: as power comes on, the reference is {sample.reference:.6g} but the axis is at "
            f"{sample.position:.6g}, and no more than {self._off:.4g} may lie between them; the drive does not hold "
            "the axis where it stands: check its position limits, its homing, and whether another master speaks"
        )

    def _refuse_silence(self, sample: Sample) -> NoReturn:
        raise GuardStop(
            f"{self._place(sample)}: the temperature has been silent for {self._silent:.1f} s, {SILENT_SECONDS:g} s "
            "are allowed; check sensor and cable, or the object that the profile names for it"
        )

    def _refuse(self, sample: Sample, name: str, value: float, allowed: float, what: str) -> NoReturn:
        raise GuardStop(
            f"{self._place(sample)}: {what} {value:.6g}, but limits.{name} allows {allowed:.6g}; "
            f"{_ADVICE[name]}"
        )

    def _place(self, sample: Sample) -> str:
        return f"guard stopped {self.where or 'the axis'} at {sample.time:.3f} s"


_ADVICE = {
    "speed": "lower the speed of the experiment, or raise the limit if the machine allows it",
    "torque": "look for a blocked or overloaded axis, or raise the limit if motor and machine allow it",
    "following_error": "look for a blocked axis or a badly tuned controller before you raise the limit",
    "temperature": "let the axis cool down and start again",
    "machine_seconds": "play fewer experiments at a time, or raise the limit",
}
