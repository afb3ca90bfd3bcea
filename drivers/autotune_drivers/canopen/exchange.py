"""One cycle on the wire: commands out, SYNC, samples in.

We send SYNC ourselves and count it. In real time a cycle waits for its turn on an absolute grid; turns
that were missed are skipped and counted, never made up for in a burst. In lock-step the drive's time
advances with SYNC, so nothing waits. Answers are matched to their SYNC by order and, where the drive
has a SYNC counter, by that.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Sequence
from itertools import pairwise

from autotune.core.errors import ConfigurationError, HostLate, LinkError, LinkTimeout
from autotune.core.stopping import Ways
from autotune_drivers.canopen.frames import Frame
from autotune_drivers.canopen.node import PRE_OPERATIONAL, SILENT, STOPPED, Node
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.pdo import RPDO, TPDO, PdoSetting, identifier, layout, pack, setting
from autotune_drivers.profile import Profile
from autotune_drivers.punctuality import busy, host_late

LOCK_STEP_TIMEOUT = 1.0
SLOW_LOST = 3
_BACKLOG = 0.005  # s; a babbling node cannot hold us for longer
_WORD = 0xFFFF
_SYNCHRONOUS = 1
_PDOS = 4
_LEFT = (PRE_OPERATIONAL, STOPPED)


class Exchange:
    """The cyclic traffic with one node.

    Attributes:
        count: cycles since the start, missed ones included.
        healthy: the last cycle was answered.
        sync: the drive's SYNC counter in the last answer, low word; None where it tells none.
        values: what the drive told last: status, position, torque demand, torque, velocity, and then
            torque feedback where the profile has it.
        ways: in the last cycles, as the drive counts positions.
        slow: what the slow PDO told last (temperature), raw; None while it told nothing.
        slow_overdue: it has told something, and `SLOW_LOST` of its messages in a row have not come since.
    """

    def __init__(self, node: Node, profile: Profile, period: float, lock_step: bool) -> None:
        self.count = 0
        self.healthy = False
        self.sync: int | None = None
        self.values: tuple[Raw, ...] = ()
        self.slow: Raw | None = None
        self._slow_age = 0
        self._slow_allowed = SLOW_LOST * profile.cycle.slow_cycles
        self._node = node
        self._wire = node.wire
        self._profile = profile
        self._period = period
        self._lock_step = lock_step
        self._timeout = LOCK_STEP_TIMEOUT if lock_step else profile.cycle.reply_timeout
        self._tries = 1 if lock_step else profile.cycle.lost_cycles + 1
        self._due = 0.0
        self._expected: int | None = None
        self.ways = Ways(period)
        self._boots = node.boots
        self._outputs: list[tuple[int, struct.Struct, int, int]] = []
        self._listen()

    # What is mapped

    def settings(self, target: ObjectRef) -> list[PdoSetting]:
        """The PDO settings for a mode whose target is `target`, and sends accordingly from now on."""
        commands, number = self._profile.commands, self._node.number
        groups = pack([commands.control.ref, target, commands.torque_feedforward.ref])
        edges = pairwise([sum(map(len, groups[:index])) for index in range(len(groups) + 1)])
        self._outputs = [
            (identifier(RPDO, index, number), layout(group), start, stop)
            for index, (group, (start, stop)) in enumerate(zip(groups, edges, strict=True))
        ]
        wanted = [setting(RPDO, i, number, _SYNCHRONOUS, group) for i, group in enumerate(groups)]
        wanted += [setting(TPDO, i, number, _SYNCHRONOUS, group) for i, group in enumerate(self._inputs)]
        if self._slow is not None:
            slow = self._profile.cycle.slow_cycles
            wanted.append(setting(TPDO, len(self._inputs), number, slow, [self._slow]))
        return wanted

    @property
    def slow_signal(self) -> ObjectRef | None:
        """The signal of the slow PDO, if there is one."""
        return self._slow

    def told_slow(self, raw: Raw | None) -> None:
        """The slow signal was read in another way, or has to be told anew."""
        self.slow, self._slow_age = raw, 0

    @property
    def slow_overdue(self) -> bool:
        return self._slow_age > self._slow_allowed and self.slow is not None

    @property
    def slow_seconds(self) -> tuple[float, float]:
        """How old the slow signal is, and how often it comes, counted in SYNCs sent [s]."""
        return self._slow_age * self._period, self._profile.cycle.slow_cycles * self._period

    def _listen(self) -> None:
        signals = self._profile.signals
        head = [signals.status.ref, signals.position.ref]
        counter = [signals.sync_counter.ref] if signals.sync_counter else []
        rest = [signals.torque_demand.ref, signals.torque.ref, signals.velocity.ref]
        rest += [signals.torque_feedback.ref] if signals.torque_feedback else []
        self._has_counter = bool(counter)
        self._inputs = pack([*head, *counter, *rest])
        self._slow = signals.temperature.ref if signals.temperature else None
        if self._slow is not None and len(self._inputs) == _PDOS:
            raise ConfigurationError(
                f"profile {self._profile.name!r} has no PDO left for signals.temperature: its cyclic signals take all "
                f"{_PDOS}. Leave one of them out, as a temperature that nobody sees cannot be guarded"
            )
        self._layouts = [layout(group) for group in self._inputs]
        self._data = [b""] * len(self._inputs)
        self._have = 0
        self._complete = len(self._inputs)
        for index in range(self._complete):
            self._wire.on(identifier(TPDO, index, self._node.number), self._input(index))
        if self._slow is not None:
            self._wire.on(identifier(TPDO, self._complete, self._node.number), self._slow_input)

    def _input(self, index: int) -> Callable[[bytes], None]:
        size = self._layouts[index].size

        def arrived(data: bytes) -> None:
            if len(data) >= size and (index == 0 or self._have == index):
                self._data[index] = data
                self._have = index + 1

        return arrived

    def _slow_input(self, data: bytes) -> None:
        if self._slow is not None and len(data) >= self._slow.size:
            self.told_slow(self._slow.decode(data))

    # One cycle

    def restart(self) -> None:
        """The next cycle is due now; to be called after a pause."""
        self._due = time.monotonic()
        self._expected = None
        self._boots = self._node.boots
        self.ways.begin()
        self._wire.drain()

    def cycle(self, outputs: Sequence[Raw]) -> int:
        """Plays one cycle: control word, target and torque feedforward out, `values` in.

        Returns the number of cycles missed before.

        Raises:
            LinkTimeout: the drive has not answered several times in a row. LinkError: adapter gone.
            struct.error: a value does not fit its object.
        """
        frames = self._frames(outputs)
        self.healthy = False
        missed = 0
        self._wire.punctuality.spell = 0.0
        for _ in range(self._tries):
            missed += self._wait_turn()
            self._have = 0
            self._wire.send(*frames, self._node.sync_frame())
            self._slow_age += 1
            if self._answered():
                self.count += missed + 1
                self.healthy = True
                self.ways.see(self.values[1], missed, math.nan if self._lock_step else time.monotonic())
                return missed
            missed += 1
            self._expected = None
        raise self._silence()

    def _wait_turn(self) -> int:
        """Waits for the next turn; the number of turns that have passed unused."""
        if self._lock_step:
            return 0
        now = time.monotonic()
        late = 0
        if now < self._due:
            time.sleep(self._due - now)
            self._wire.punctuality.note(time.monotonic() - self._due)
        else:
            late = int((now - self._due) / self._period)
        self._due += (late + 1) * self._period
        self._wire.drain()
        return late

    def _answered(self) -> bool:
        """Waits for the answer; what came while this host was held up is looked at before it counts as lost."""
        end = time.monotonic() + self._timeout
        while True:
            heard = self._wire.pump(max(end - time.monotonic(), 0.0))
            if self._have == self._complete and self._take():
                return True
            now = time.monotonic()
            if now >= end and (not heard or now >= end + _BACKLOG):
                self._wire.punctuality.note(now - end)
                return False
            if self._node.boots != self._boots:
                raise self._silence()

    def _take(self) -> bool:
        """Unpacks a complete answer; False where it belongs to an earlier SYNC."""
        values: tuple[Raw, ...] = ()
        for packing, data in zip(self._layouts, self._data, strict=True):
            values += packing.unpack_from(data)
        if self._has_counter:
            counter = int(values[2])
            if self._expected is not None and (self._expected - counter) & _WORD in (1, 2, 3):
                self._have = 0
                return False
            self._expected = (counter + 1) & _WORD
            self.sync = counter
            values = values[:2] + values[3:]
        self.values = values
        return True

    def _silence(self) -> LinkError:
        node, times = self._node, self._tries
        if node.boots != self._boots:
            return LinkError(
                f"node {node.number} has restarted in the middle (boot-up message): its power was "
                "interrupted, or its watchdog acted. Check its supply and start again"
            )
        state = node.nmt_state
        late = self._own_delay(state)
        if late is not None:
            return late
        told = f", its heartbeat says {state!r}" if state and state != SILENT else ""
        return LinkTimeout(
            f"node {node.number} did not answer SYNC within {self._timeout * 1e3:g} ms, {times} times in a "
            f"row{told}; {self._wire.link.hint or 'check'} (power, cable, termination, bit rate)"
            f"{busy()}"
        )

    def _own_delay(self, state: str) -> HostLate | None:
        """The error for a silence that this host has brought about.

        Either the drive has left operational because it missed our heartbeat (CiA 301, object 1029h), or in this
        very cycle this host stood still for as long as an answer may take: what hangs on it then does too.
        """
        self._wire.look_at_the_clock()
        punctuality, guard, number = self._wire.punctuality, self._profile.guard, self._node.number
        if state in _LEFT and punctuality.blamed(guard.consume, guard.produce):
            silent = punctuality.recent + guard.produce
            return host_late(
                f"node {number}", silent, guard.consume, f"went to {state!r} and stopped its axis"
            )
        if punctuality.spell >= self._timeout:
            then = f"{self._tries} answers to SYNC in a row did not come"
            return host_late(f"node {number}", punctuality.spell, self._timeout, then)
        return None

    def shout(self, outputs: Sequence[Raw], times: int) -> None:
        """Sends commands and SYNC without waiting for an answer. Raises LinkError."""
        for _ in range(times):
            self._wire.send(*self._frames(outputs), self._node.sync_frame())

    def _frames(self, outputs: Sequence[Raw]) -> list[Frame]:
        return [(number, form.pack(*outputs[start:stop])) for number, form, start, stop in self._outputs]
