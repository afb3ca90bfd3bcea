"""Plays a proved model beside a foreign master: from what is heard on the bus to one torque offset a cycle.

Watching: set points are compared with the limits, counted against SYNC, and the torque of the first moves is
compared with the model's; nothing is sent. Playing: the offset is faded in and follows the model. Leaving: it is
faded out, on doubt, on silence, on stop. There is no way back from leaving: whoever wants more starts again.

A host that is held up may not go on where it was: the drive drops an offset whose sender is silent, and a late frame
would bring it back at once. So what stands is given up after `HELD_UP` without a frame of ours, and faded in anew when
the drive has certainly dropped it. Frames that have gathered meanwhile are not sent one after the other either.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from autotune.control.feedforward import FeedforwardLaw
from autotune.control.set_points import Cadence, MotionEstimate, SetPointWatch
from autotune.control.torque_offset import ModelCheck, Phase, TorqueOffset
from autotune.core.axis import Axis
from autotune_drivers.canopen.sidecar import TIME_OUT, Event, Foreign, Synchronised, Target, Told

LISTEN = 0.05  # s
SILENCE = 0.25  # s without SYNC that end the play in real time
SILENCE_LOCK_STEP = 5.0  # s, where the drive's time waits for SYNC
PERIODS = 500  # SYNCs over which their period is measured
PERIOD_AGREES = 0.03
HELD_UP = 0.75 * TIME_OUT  # s without a frame of ours, after which the drive may begin to drop the offset
SURELY_GONE = 1.2  # times what the drive says
APART = 0.6  # periods between two frames: no third one meets two others in one cycle of the drive
SLOW = 0.01  # of limits.speed: below it a sample is no motion


class Bus(Protocol):
    """What the player needs of a sidecar."""

    @property
    def lock_step(self) -> bool: ...
    @property
    def gone_within(self) -> float: ...
    def listen(self, timeout: float) -> list[Event]: ...
    def send(self, torque: float) -> None: ...


@dataclass(frozen=True, slots=True)
class Laws:
    """The whole feedforward, and what of it the drive plays by itself (None: nothing); inertia of the model."""

    whole: FeedforwardLaw
    own: FeedforwardLaw | None
    inertia: float


class LastFrame:
    """How long ago our last frame was, in the drive's time, which waits for SYNC in lock-step."""

    def __init__(self, bus: Bus, period: float, clock: Callable[[], float]) -> None:
        self._bus, self._period, self._clock = bus, period, clock
        self.sent()

    def sent(self) -> None:
        self._syncs, self._at = 0, self._clock()

    def sync(self) -> None:
        self._syncs += 1

    @property
    def ago(self) -> float:
        """s"""
        heard = self._syncs * self._period
        return heard if self._bus.lock_step else max(heard, self._clock() - self._at)

    @property
    def just_now(self) -> bool:
        """Another one would meet it in the same cycle of the drive."""
        return not self._bus.lock_step and self._clock() - self._at < APART * self._period


class Player:
    """One session beside a master.

    Attributes:
        offset: what is sent. reason: why it leaves, in words; empty where it was asked to stop.
        dropped: the drive has taken over an offset of 0.
        syncs, sent: counted. held_up: how often the host was, with an offset that stood.
    """

    def __init__(self, bus: Bus, axis: Axis, laws: Laws, clock: Callable[[], float] = time.monotonic) -> None:
        self.offset = TorqueOffset(axis.limits.torque, axis.cycle)
        self.reason = ""
        self.dropped = True
        self.syncs = self.sent = self.held_up = 0
        self._bus, self._laws, self._clock = bus, laws, clock
        self._period = axis.cycle
        self._frame = LastFrame(bus, axis.cycle, clock)
        self._given_up = False
        self._watch = SetPointWatch(axis.limits, axis.cycle, axis.position_resolution, laws.inertia)
        self._cadence = Cadence()
        self._estimate = MotionEstimate(axis.cycle)
        self._check = ModelCheck(SLOW * axis.limits.speed)
        self._silence = SILENCE_LOCK_STEP if bus.lock_step else SILENCE
        self._period_known = bus.lock_step
        self._first = self._last = clock()
        self._model = self._velocity = self._wanted = 0.0
        self._fresh = False

    @property
    def ended(self) -> bool:
        """The offset is out, or SYNC is: then the drive drops it by itself."""
        silent = self._clock() - self._last > self._silence
        if silent:
            self.leave("the master fell silent: no SYNC")
        return silent or (self.offset.phase is Phase.LEAVING and self.dropped)

    def leave(self, reason: str = "") -> None:
        """Begins to fade out; the first reason holds."""
        if self.offset.phase is not Phase.LEAVING:
            self.offset.phase = Phase.LEAVING
            self.reason = reason

    def turn(self) -> None:
        """Handles what has arrived, and sends one offset for it. Raises LinkError."""
        for event in self._bus.listen(LISTEN):
            self._handle(event)
        if self._fresh and not self._frame.just_now:
            self._fresh = False
            if not self._waits_for_the_drop():
                self._send()

    def _waits_for_the_drop(self) -> bool:
        """After a time without frames nothing is sent until nothing of the offset is left in the drive."""
        if self.dropped:
            return False
        if not self._given_up and self._frame.ago > HELD_UP:
            self._given_up = True
            self.held_up += 1
        if self._given_up and self._frame.ago > SURELY_GONE * self._bus.gone_within:
            self._given_up = False
            self.offset.begin_again()
        return self._given_up

    def _handle(self, event: Event) -> None:
        if isinstance(event, Target):
            self._target(event.position)
        elif isinstance(event, Synchronised):
            self._sync(event.at)
        elif isinstance(event, Told):
            self._told(event)
        elif isinstance(event, Foreign):
            self.leave(f"somebody else sends {event.cob_id:03X}h, the PDO with the torque offset")

    def _target(self, position: float) -> None:
        doubt = self._watch.see(position)
        self._cadence.target()
        if doubt:
            self.leave(doubt)
            self._fresh = True
            return
        motion = self._estimate.step(position)
        self._fresh = True
        if motion is None:
            return
        where = (motion.position, motion.velocity, motion.acceleration, None)
        self._model = self._laws.whole.step(*where)
        own = self._laws.own.step(*where) if self._laws.own is not None else 0.0
        self._velocity, self._wanted = motion.velocity, self._model - own

    def _sync(self, at: float) -> None:
        self._last = at
        self._first = at if not self.syncs else self._first
        self.syncs += 1
        self._frame.sync()
        if self.offset.phase is Phase.LEAVING:
            self._fresh = True  # also where set points no longer come
        if self.offset.value == 0.0 and self.sent and self.offset.out:
            self.dropped = True  # a zero that was sent is in effect now
        doubt = self._cadence.sync()
        if doubt:
            self.leave(doubt)
            self._fresh = True
        if not self._period_known and self.syncs > PERIODS:
            self._compare_period(at)

    def _compare_period(self, at: float) -> None:
        self._period_known = True
        measured = (at - self._first) / (self.syncs - 1)
        if abs(measured - self._period) > PERIOD_AGREES * self._period:
            self.leave(
                f"SYNC comes every {measured * 1e3:.3f} ms, the model is for {self._period * 1e3:g} ms: set the "
                "master's cycle to it, or look for a second master"
            )

    def _told(self, told: Told) -> None:
        if self.offset.phase is Phase.WATCHING and told.following:
            self._check.see(self._velocity, self._model, told.torque)
            if self._check.done and self._period_known:
                doubt = self._check.doubt()
                if doubt:
                    self.leave(doubt)
                else:
                    self.offset.phase = Phase.PLAYING
        elif self.offset.phase is Phase.PLAYING and not told.following:
            self.leave("the drive follows no set points any more")

    def _send(self) -> None:
        """One frame, where there is an offset or has been one."""
        value = self.offset.step(self._wanted)
        if self.offset.phase is Phase.WATCHING or (value == 0.0 and self.dropped):
            return
        self._bus.send(value)
        self._frame.sent()
        self.sent += 1
        self.dropped = False
