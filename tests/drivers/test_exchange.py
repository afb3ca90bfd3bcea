"""One cycle on the wire: pairing of answers, lost and late cycles, and never a burst."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import pytest

from autotune.core.errors import LinkError, LinkTimeout
from autotune_drivers.canopen import exchange as exchange_module
from autotune_drivers.canopen.exchange import Exchange
from autotune_drivers.canopen.frames import Frame
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.wire import Wire
from autotune_drivers.profile import Profile, read_profile
from tests.drivers.fake_node import FakeNode

PERIOD = 1e-3
TARGET = read_profile("autotune-sim").commands.position.ref


@dataclass
class Clock:
    """Time that only passes when somebody sleeps, or a test says so; looking costs a microsecond."""

    now: float = 100.0
    sleeps: list[float] = field(default_factory=list)

    def monotonic(self) -> float:
        self.now += 1e-6
        return self.now

    def sleep(self, seconds: float) -> None:
        self.sleeps.append(seconds)
        self.now += seconds


class Drive:
    """Answers SYNC as the simulated drive's mapping wants it, with faults on demand."""

    def __init__(self, node: FakeNode) -> None:
        self.node = node
        self.counter = 40000
        self.lose = 0
        self.deaf = 0
        self.late: list[Frame] = []
        self.received: list[bytes] = []
        node.on_sync = self.sync

    def sync(self, rpdos: list[Frame]) -> list[Frame]:
        if self.deaf:
            self.deaf -= 1
            return []
        self.counter = (self.counter + 1) & 0xFFFF
        self.received += [data for _, data in rpdos]
        position = self.counter
        frames = [
            (0x185, struct.pack("<HiH", 0x1237, position, self.counter)),
            (0x285, struct.pack("<ii", 1000, 2000)),
            (0x385, struct.pack("<ii", 3000, 4000)),
        ]
        if self.lose:
            self.lose -= 1
            return []
        held, self.late = self.late, []
        return held + frames


def profile() -> Profile:
    return read_profile("autotune-sim")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(exchange_module, "time", clock)
    return clock


def make(lock_step: bool) -> tuple[Exchange, Drive]:
    link = FakeNode({})
    node = Node(Wire(link, 127, 0.05), 5)
    made = Exchange(node, profile(), PERIOD, lock_step)
    made.settings(TARGET)
    made.restart()
    return made, Drive(link)


COMMAND = (0x0F, 123, -5)


def test_sends_commands_then_sync_and_unpacks_the_answer(clock: Clock) -> None:
    made, drive = make(lock_step=True)
    assert made.cycle(COMMAND) == 0
    assert drive.received == [struct.pack("<Hih", *COMMAND)]
    sent = [identifier for identifier, _ in drive.node.sent]
    assert sent == [0x205, 0x80]
    assert made.values == (0x1237, 40001, 1000, 2000, 3000, 4000)
    assert made.count == 1
    assert made.healthy


def test_real_time_waits_on_an_absolute_grid(clock: Clock) -> None:
    made, _ = make(lock_step=False)
    began = clock.now
    for k in range(100):
        clock.now += 0.3e-3 if k % 3 else 0.7e-3  # what the experiment computes
        assert made.cycle(COMMAND) == 0
    assert clock.now - began == pytest.approx(99 * PERIOD, abs=PERIOD)


def test_lock_step_never_waits(clock: Clock) -> None:
    made, _ = make(lock_step=True)
    for _ in range(10):
        made.cycle(COMMAND)
    assert clock.sleeps == []


def test_a_stall_is_counted_and_not_made_up_for(clock: Clock) -> None:
    made, drive = make(lock_step=False)
    made.cycle(COMMAND)
    clock.now += 50.4e-3
    missed = made.cycle(COMMAND)
    assert missed in (49, 50)
    assert made.count == 2 + missed
    before = clock.now
    syncs = len([1 for identifier, _ in drive.node.sent if identifier == 0x80])
    for _ in range(5):
        assert made.cycle(COMMAND) == 0
    assert clock.now - before > 4 * PERIOD  # no burst
    assert len([1 for identifier, _ in drive.node.sent if identifier == 0x80]) == syncs + 5


def test_a_lost_answer_costs_one_cycle(clock: Clock) -> None:
    made, drive = make(lock_step=False)
    made.cycle(COMMAND)
    drive.lose = 1
    missed = made.cycle(COMMAND)
    late = round(profile().cycle.reply_timeout / PERIOD)
    assert 1 <= missed <= late + 2
    assert made.healthy


def test_a_lost_sync_costs_one_cycle_too(clock: Clock) -> None:
    made, drive = make(lock_step=False)
    made.cycle(COMMAND)
    drive.deaf = 1
    assert made.cycle(COMMAND) >= 1
    assert made.cycle(COMMAND) == 0


def test_silence_ends_after_the_tolerated_losses(clock: Clock) -> None:
    made, drive = make(lock_step=False)
    made.cycle(COMMAND)
    drive.deaf = 1000
    began = clock.now
    with pytest.raises(LinkTimeout, match="did not answer SYNC within 50 ms, 4 times in a row"):
        made.cycle(COMMAND)
    assert not made.healthy
    assert clock.now - began < 0.3


def test_a_late_answer_is_not_taken_for_the_present_one(clock: Clock) -> None:
    made, drive = make(lock_step=True)
    made.cycle(COMMAND)
    drive.late = [
        (0x185, struct.pack("<HiH", 0x1237, -1, drive.counter)),
        (0x285, struct.pack("<ii", -1, -1)),
        (0x385, struct.pack("<ii", -1, -1)),
    ]
    made.cycle(COMMAND)
    assert made.values[1] == 40002


def test_half_an_answer_is_not_completed_by_the_next(clock: Clock) -> None:
    made, drive = make(lock_step=True)
    drive.late = [(0x285, struct.pack("<ii", -1, -1)), (0x385, struct.pack("<ii", -1, -1))]
    made.cycle(COMMAND)
    assert made.values[2:] == (1000, 2000, 3000, 4000)


def test_a_counter_that_wraps_is_no_loss(clock: Clock) -> None:
    made, drive = make(lock_step=True)
    drive.counter = 0xFFFE
    for _ in range(4):
        assert made.cycle(COMMAND) == 0
    assert made.values[1] == 2


def test_a_restart_of_the_drive_is_said_at_once(clock: Clock) -> None:
    made, drive = make(lock_step=True)
    made.cycle(COMMAND)
    drive.node.on_sync = lambda rpdos: [(0x705, b"\0")]
    with pytest.raises(LinkError, match="has restarted"):
        made.cycle(COMMAND)


def test_sync_carries_a_counter_where_the_drive_wants_one(clock: Clock) -> None:
    made, drive = make(lock_step=True)
    made._node.count_syncs(3)
    for _ in range(4):
        made.cycle(COMMAND)
    assert [data for identifier, data in drive.node.sent if identifier == 0x80] == [
        b"\1",
        b"\2",
        b"\3",
        b"\1",
    ]


def test_a_value_that_does_not_fit_is_not_sent(clock: Clock) -> None:
    made, drive = make(lock_step=True)
    with pytest.raises(struct.error):
        made.cycle((0x0F, 2**31, 0))
    assert drive.node.sent == []
