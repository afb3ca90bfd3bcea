"""The whole simulated drive behind its CAN connector: dictionary, firmware, node, memory, recorder.

Time. In lock-step every SYNC advances the axis by one interpolation period (60C2), so that a master may
be as slow or as fast as it likes. Where no SYNC comes, the axis must not stand still in the middle of a
stop: after `GAP` the wall clock takes over until the next SYNC. While operation is enabled and the
master is alive the gap is `PATIENCE`, so that a master that was held up for a moment finds the axis
where it left it. In real time the wall clock alone moves the axis. Communication always lives by the
wall clock.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.bindings import Settings, bind_process_values
from autotune_sim.emergency import ErrorCode
from autotune_sim.firmware import Firmware
from autotune_sim.memory import Memory
from autotune_sim.node import Node
from autotune_sim.object_dictionary import Entry, Value, read_eds
from autotune_sim.offset_guard import OffsetGuard
from autotune_sim.recorder import Recorder
from autotune_sim.servo import Servo
from autotune_sim.state_machine import State
from autotune_sim.vendor_blocks import FrictionBlock, RippleBlock, VelocityTable

GAP = 0.02  # s without SYNC until the wall clock takes over
PATIENCE = 0.25  # s, the same while operation is enabled
CATCH_UP = 0.1  # s of axis time that may be made up for in one go
STORE_TIME = 0.3  # s that writing the non-volatile memory takes
BOOT_TIME = 0.3  # s from power-on to the boot-up message
_SAVE, _LOAD = 0x65766173, 0x64616F6C
_AREAS = {1: (0x1000, 0xFFFF), 2: (0x1000, 0x1FFF), 3: (0x6000, 0x9FFF), 4: (0x2000, 0x5FFF)}
_COMMUNICATION = _AREAS[2]
_NOT_KEPT = frozenset({0x1003, 0x1010, 0x1011, 0x2400, 0x2401})

Hook = Callable[["Device"], None]


class Device:
    """One drive on the bus. `receive` takes frames, `poll` the passing of time.

    Args:
        send: takes the drive's frames as (COB-ID, data).
        log: told of events in words.

    Attributes:
        now: time of the last call [s].
        silent: neither hears nor speaks, for rehearsals.
        loss: share of the frames that get lost, command_loss: of the receive PDOs alone, for rehearsals.
        refusals: SDO abort codes by (index, sub-index), sub-index −1 for all, for rehearsals.
        on_cycle, on_write, on_store: called after each servo cycle, before each parameter write, and
            when storing begins.
    """

    def __init__(
        self,
        servo: Servo,
        eds: Path,
        node_id: int,
        send: Callable[[int, bytes], None],
        memory: Memory,
        log: Callable[[str], None],
        *,
        real_time: bool = False,
    ) -> None:
        self.now = 0.0
        self.silent = False
        self.loss = self.command_loss = 0.0
        self._random = Random(servo.preset.seed)
        self.refusals: dict[tuple[int, int], int] = {}
        self.on_cycle: Hook | None = None
        self.on_write: Callable[[Entry], None] | None = None
        self.on_store: Callable[[], None] | None = None
        self.memory = memory
        self.objects = read_eds(eds, node_id)
        self._output = send
        self._log = log
        self._real_time = real_time
        self._axis_time = 0.0
        self._last_sync = 0.0
        self._by_wall_clock = False
        self._boot_at: float | None = 0.0
        self.node = Node(self.objects, self._send, self, log, self._refuse)
        self.firmware = Firmware(self.objects, servo, self.node.emergency, log)
        self.firmware.offset_guard = OffsetGuard(self.objects, self.node.receive_pdos, servo.period)
        self._settings = Settings(self.objects, self.firmware)
        self._friction_block = FrictionBlock(self.objects, self.firmware)
        self._velocity_table = VelocityTable(self.objects, self.firmware)
        self._ripple_block = RippleBlock(
            self.objects, self.firmware, memory.read, self._write_memory, self._save_delay
        )
        bind_process_values(self.objects, self.firmware)
        self.recorder = Recorder(self.objects, lambda: self.firmware.cycles)
        self._bind()
        self._factory = {(e.index, e.subindex): e.default for e in self.objects}

    def _bind(self) -> None:
        self.objects[0x1018, 4].value = 1000 + self.firmware.servo.preset.seed
        self.objects[0x1002].read = self._status_register
        for subindex in _AREAS:
            store, restore = self.objects[0x1010, subindex], self.objects[0x1011, subindex]
            store.read = restore.read = lambda: 1
            store.delay, restore.delay = self._store_delay, self._restore_delay
            store.write = self._storer(_AREAS[subindex])
            restore.write = self._restorer(_AREAS[subindex])

    def _status_register(self) -> int:
        sample = self.firmware.sample
        moving = abs(sample.velocity) > 0.05
        return self.firmware.powered | moving << 1 | sample.saturated << 2 | (not self._real_time) << 3

    def note_objects(self, kind: str) -> None:
        """Logs all writable objects as they stand, where what is true is logged."""
        servo = self.firmware.servo
        if servo.truth is not None:
            kept = {f"{e.index:04X}:{e.subindex:02X}": e.value for e in self.objects if e.access == "rw"}
            values = {key: value for key, value in kept.items() if isinstance(value, int | float)}
            servo.truth.note(kind, servo.time, objects=values)

    # Bus

    def receive(self, cob_id: int, data: bytes, now: float) -> None:
        """Handles one data frame."""
        self.now = now
        if not self.silent and self._boot_at is None and not self._lost():
            self.node.receive(cob_id, data, now)

    def poll(self, now: float) -> float:
        """Lets time pass; the next time that it must be called [s]."""
        self.now = now
        if self._boot_at is not None:
            if now < self._boot_at:
                return self._boot_at
            self._boot(now)
        self._pass_time(now)
        again = self.node.poll(now)
        mine = self._next_wall_cycle()
        return mine if again is None else min(again, mine)

    @property
    def heartbeat_due(self) -> float | None:
        """When a watched node is late [s]; then `check_heartbeats`, with the input empty."""
        return self.node.heartbeat_due

    def check_heartbeats(self, now: float) -> None:
        self.node.check_heartbeats(now)

    def _send(self, cob_id: int, data: bytes) -> None:
        if not self.silent and self._boot_at is None and not self._lost():
            self._output(cob_id, data)

    def _lost(self) -> bool:
        return self.loss > 0.0 and self._random.random() < self.loss

    def _refuse(self, entry: Entry, writing: bool) -> int:
        if writing and self.on_write is not None:
            self.on_write(entry)
        if not self.refusals:
            return 0
        return self.refusals.get((entry.index, entry.subindex)) or self.refusals.get((entry.index, -1), 0)

    # Time

    def begin_cycle(self, now: float) -> None:
        """SYNC: in lock-step the first servo period of the interpolation period."""
        self._last_sync = now
        if not self._real_time:
            self._by_wall_clock = False
            self._cycle()

    def end_cycle(self) -> None:
        """SYNC is answered: in lock-step the other servo periods."""
        if not self._real_time:
            for _ in range(self.firmware.parts - 1):
                self._cycle()

    def _cycle(self) -> None:
        self.firmware.cycle()
        if self.recorder.active:
            self.recorder.tick()
        if self.on_cycle is not None:
            self.on_cycle(self)

    def _gap(self) -> float:
        return (
            PATIENCE if self.firmware.state is State.OPERATION_ENABLED and not self.firmware.stopping else GAP
        )

    def _wall_clock_from(self) -> float:
        """When the wall clock takes over, or has taken over [s]."""
        return 0.0 if self._real_time else self._last_sync + self._gap()

    def _next_wall_cycle(self) -> float:
        if not self._by_wall_clock:
            return self._wall_clock_from()
        idle = not self.firmware.powered and not self._real_time
        return self._axis_time + (GAP if idle else self.firmware.servo.period)

    def _pass_time(self, now: float) -> None:
        if now < self._wall_clock_from():
            return
        if not self._by_wall_clock:
            self._by_wall_clock, self._axis_time = True, now
        period = self.firmware.servo.period
        self._axis_time = max(self._axis_time, now - CATCH_UP)
        while self._axis_time + period <= now:
            self._axis_time += period
            self._cycle()

    # What the node tells

    def command_lost(self) -> bool:
        return self.command_loss > 0.0 and self._random.random() < self.command_loss

    def connection_lost(self, node: int) -> None:
        """Reacts to a lost heartbeat as option code 6007 says."""
        option = self.objects.number(0x6007)
        if option == 1:
            self.firmware.fault(ErrorCode.HEARTBEAT, node)
            return
        self.node.emergency.report(ErrorCode.HEARTBEAT, node, lasting=False)
        if option == 2:
            self.firmware.disable(f"heartbeat of node {node} lost")
        elif option == 3:
            self.firmware.quick_stop(f"heartbeat of node {node} lost")

    def left_operational(self) -> None:
        """Stops an axis that has lost its process data."""
        if self.objects.number(0x6007):
            self.firmware.quick_stop("process data are no longer exchanged")

    def restart(self, communication_only: bool) -> None:
        """NMT reset of the node or of its communication."""
        self._log("reset of communication" if communication_only else "reset of the node")
        if communication_only:
            self.firmware.quick_stop("reset of communication")
        self._start(_COMMUNICATION if communication_only else _AREAS[1])

    # Power and memory

    def power_loss(self) -> None:
        """Power goes and comes back: volatile values are lost, stored ones are kept; meanwhile the brake holds."""
        self._log("power lost")
        self.firmware.disable("power lost")
        self.firmware.servo.lose(round(BOOT_TIME / self.firmware.servo.period))
        self.node.emergency.reset()
        self.node.shut_down()
        self._boot_at = self.now + BOOT_TIME

    def _boot(self, now: float) -> None:
        self._boot_at = None
        self._axis_time = self._last_sync = now
        self._start(_AREAS[1])

    def _start(self, area: tuple[int, int]) -> None:
        try:
            self._load(area, self.memory.read())
            self._begin(area)
        except Abort as abort:
            self._log(f"stored parameters cannot be used ({abort}); factory settings instead")
            self._load(_AREAS[1], {})
            self._begin(_AREAS[1])

    def _begin(self, area: tuple[int, int]) -> None:
        if area != _COMMUNICATION:
            self._reset_application()
        self.node.boot()

    def _reset_application(self) -> None:
        self.node.emergency.reset()
        self._settings.apply()
        self._friction_block.start()
        self._velocity_table.start()
        self._ripple_block.start()
        self.firmware.reset()
        self.recorder.reset()

    def _load(self, area: tuple[int, int], stored: dict[tuple[int, int], bytes]) -> None:
        """Defaults, and over them what was stored, without any hook."""
        for entry in self.objects:
            if not area[0] <= entry.index <= area[1] or entry.access in ("const", "ro"):
                continue
            key = (entry.index, entry.subindex)
            entry.value = self._factory[key]
            if key in stored and entry.kept:
                entry.value = entry.decode(stored[key])

    def _kept(self, area: tuple[int, int]) -> list[Entry]:
        return [
            entry
            for entry in self.objects
            if entry.kept
            and entry.index not in _NOT_KEPT
            and area[0] <= entry.index <= area[1]
            and not self._ripple_block.keeps(entry)
        ]

    def _store_delay(self, value: Value) -> float:
        if value != _SAVE:
            raise Abort(AbortCode.STORE)
        return self._save_delay()

    def _save_delay(self) -> float:
        if self.firmware.powered:
            raise Abort(AbortCode.STATE)
        if self.on_store is not None:
            self.on_store()
        return STORE_TIME

    def _restore_delay(self, value: Value) -> float:
        if value != _LOAD:
            raise Abort(AbortCode.STORE)
        if self.firmware.powered:
            raise Abort(AbortCode.STATE)
        return STORE_TIME

    def _storer(self, area: tuple[int, int]) -> Callable[[Value], None]:
        def store(_: Value) -> None:
            values = self.memory.read()
            values |= {(e.index, e.subindex): e.encode(e.value) for e in self._kept(area)}
            self._write_memory(values)
            self._log("parameters stored")
            self.note_objects("stored")

        return store

    def _restorer(self, area: tuple[int, int]) -> Callable[[Value], None]:
        def restore(_: Value) -> None:
            low, high = area
            values = {key: data for key, data in self.memory.read().items() if not low <= key[0] <= high}
            self._write_memory(values)
            self._log("defaults restored, in effect after a reset")

        return restore

    def _write_memory(self, values: dict[tuple[int, int], bytes]) -> None:
        try:
            self.memory.write(values)
        except OSError as error:
            self._log(f"memory cannot be written: {error}")
            raise Abort(AbortCode.HARDWARE) from error
