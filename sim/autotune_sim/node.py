"""The CANopen node (CiA 301): network management, SYNC, PDOs, SDO server, heartbeats, EMCY.

`receive` takes frames, `poll` the passing of time; frames leave through `send(cob_id, data)`. What the
device does is behind `Application`.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Protocol

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.emergency import Emergency, ErrorCode
from autotune_sim.heartbeat import HeartbeatConsumer, HeartbeatProducer
from autotune_sim.object_dictionary import ObjectDictionary, Value
from autotune_sim.pdo import NUMBER, ReceivePdo, TransmitPdo
from autotune_sim.sdo_server import Refuse, SdoServer

_INVALID = 0x80000000
_PRODUCER = 0x40000000
_EXTENDED = 0x20000000

Send = Callable[[int, bytes], None]


class NmtState(IntEnum):
    """States as a heartbeat tells them."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class NmtCommand(IntEnum):
    """Commands of the NMT master."""

    START = 1
    STOP = 2
    PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


class Application(Protocol):
    """What the node tells the device."""

    def begin_cycle(self, now: float) -> None:
        """SYNC, with the process data received before it in effect."""

    def end_cycle(self) -> None:
        """SYNC is done, its PDOs are sent."""

    def command_lost(self) -> bool:
        """A receive PDO gets lost, for rehearsals."""

    def connection_lost(self, node: int) -> None:
        """The heartbeat of a watched node has not come in time."""

    def left_operational(self) -> None:
        """Process data are no longer exchanged."""

    def restart(self, communication_only: bool) -> None:
        """The NMT master asks for a reset."""


class Node:
    """One node. It is silent until `boot`."""

    def __init__(
        self,
        objects: ObjectDictionary,
        send: Send,
        application: Application,
        log: Callable[[str], None],
        refuse: Refuse,
    ) -> None:
        self.node_id = objects.node_id
        self.state = NmtState.INITIALISING
        self._objects = objects
        self._send = send
        self._application = application
        self._log = log
        self.emergency = Emergency(objects, send)
        self._sdo = SdoServer(objects, lambda data: send(0x580 + self.node_id, data), refuse)
        self._heartbeat = HeartbeatProducer(objects)
        self._consumer = HeartbeatConsumer(objects, self._rewire)
        self.receive_pdos = [ReceivePdo(objects, number, self._rewire) for number in range(NUMBER)]
        self._transmit_pdos = [TransmitPdo(objects, number, self._rewire) for number in range(NUMBER)]
        self._bind()
        self._forget()

    def _bind(self) -> None:
        objects = self._objects
        objects[0x1005].write = self._write_sync_cob_id
        objects[0x1014].write = self._write_emergency_cob_id
        objects[0x1019].write = self._write_sync_overflow
        objects[0x2210, 3].read = lambda: self.syncs & 0xFFFFFFFF
        objects[0x2210, 4].read = lambda: self.syncs & 0xFFFF
        objects[0x2210, 5].read = lambda: self.syncs_missed & 0xFFFF

    def _forget(self) -> None:
        self.syncs = 0
        self.syncs_missed = 0
        self._counter = 0
        self._length_told = False
        self._rewire()

    def boot(self) -> None:
        """Takes the parameters as they stand in the dictionary and says hello.

        Raises:
            Abort: the dictionary holds a mapping that cannot be.
        """
        self._sdo.reset()
        for pdo in (*self.receive_pdos, *self._transmit_pdos):
            pdo.refresh()
        self._consumer.reset()
        self._heartbeat.due = None
        self._forget()
        self._send(0x700 + self.node_id, b"\0")
        self._change(NmtState.PRE_OPERATIONAL, "boot-up")

    def shut_down(self) -> None:
        """Power is gone: silent and deaf until `boot`."""
        self._sdo.reset()
        self._consumer.reset()
        self._heartbeat.due = None
        self.state = NmtState.INITIALISING

    @property
    def operational(self) -> bool:
        return self.state is NmtState.OPERATIONAL

    # Frames

    def receive(self, cob_id: int, data: bytes, now: float) -> None:
        """Handles one data frame from the bus."""
        handler = self._handlers.get(cob_id)
        if handler is not None:
            handler(data, now)

    def _rewire(self) -> None:
        """Who handles which COB-ID, after a parameter has changed."""
        handlers: dict[int, Callable[[bytes, float], None]] = {0: self._command}
        for number, pdo in enumerate(self.receive_pdos):
            if pdo.valid:
                handlers[pdo.cob_id] = self._pdo_handler(number, pdo)
        for node in self._consumer.nodes:
            handlers[0x700 + node] = self._heartbeat_handler(node)
        handlers[self._objects.number(0x1005) & 0x7FF] = self._sync
        handlers[0x600 + self.node_id] = self._request
        self._handlers = handlers
        self._synchronous = [pdo for pdo in self._transmit_pdos if pdo.valid and pdo.transmission <= 240]
        self._acyclic = [pdo for pdo in self._transmit_pdos if pdo.valid and pdo.transmission > 240]

    def _pdo_handler(self, number: int, pdo: ReceivePdo) -> Callable[[bytes, float], None]:
        def handle(data: bytes, _: float) -> None:
            if self._application.command_lost():
                return
            if self.state is NmtState.OPERATIONAL and not pdo.receive(data) and not self._length_told:
                self._length_told = True
                self._log(f"RPDO {number + 1} too short: {len(data)} bytes, mapped are {pdo.packer.size}")
                self.emergency.report(ErrorCode.PDO_LENGTH, number + 1, lasting=False)

        return handle

    def _heartbeat_handler(self, node: int) -> Callable[[bytes, float], None]:
        return lambda _, now: self._consumer.heard(node, now)

    def _request(self, data: bytes, now: float) -> None:
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            self._sdo.receive(data, now)

    def _sync(self, data: bytes, now: float) -> None:
        if self.state not in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            return
        overflow = self._objects.number(0x1019)
        counter = 0
        if overflow:
            if len(data) != 1:
                self.emergency.report(ErrorCode.SYNC_LENGTH, len(data), lasting=False)
                return
            counter = data[0]
            self._count(counter, overflow)
        self.syncs += 1
        if self.state is not NmtState.OPERATIONAL:
            self._application.begin_cycle(now)
            self._application.end_cycle()
            return
        for received in self.receive_pdos:
            received.synchronise()
        self._application.begin_cycle(now)
        for sent in self._synchronous:
            if sent.synchronous(counter):
                content = sent.content()
                sent.mark(content, now)
                self._send(sent.cob_id, content)
        self._application.end_cycle()

    def _count(self, counter: int, overflow: int) -> None:
        if self._counter:
            self.syncs_missed += (counter - self._counter - 1) % overflow
        self._counter = counter

    def _command(self, data: bytes, _: float) -> None:
        if len(data) < 2 or data[1] not in (0, self.node_id):
            return
        if data[0] == NmtCommand.START:
            self._change(NmtState.OPERATIONAL, "NMT master")
        elif data[0] == NmtCommand.STOP:
            self._change(NmtState.STOPPED, "NMT master")
        elif data[0] == NmtCommand.PRE_OPERATIONAL:
            self._change(NmtState.PRE_OPERATIONAL, "NMT master")
        elif data[0] in (NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION):
            self._application.restart(data[0] == NmtCommand.RESET_COMMUNICATION)

    def _change(self, state: NmtState, why: str) -> None:
        if state is self.state:
            return
        left = self.state is NmtState.OPERATIONAL
        self._log(f"NMT {self.state.name} -> {state.name} ({why})")
        self.state = state
        self._length_told = False
        if left:
            self._application.left_operational()

    # Time

    def poll(self, now: float) -> float | None:
        """Does what is due; when it must be called again [s], None where nothing waits."""
        self._sdo.poll(now)
        if self._heartbeat.poll(now):
            self._send(0x700 + self.node_id, bytes((self.state,)))
        again = self.emergency.poll(now, self.state is not NmtState.STOPPED)
        if self.state is NmtState.OPERATIONAL:
            again = _earliest(again, self._send_acyclic(now))
        return _earliest(again, self._sdo.due, self._heartbeat.due, self._consumer.due)

    def _send_acyclic(self, now: float) -> float | None:
        again = None
        for pdo in self._acyclic:
            content = pdo.acyclic(now)
            if content is not None:
                self._send(pdo.cob_id, content)
            again = _earliest(again, pdo.due)
        return again

    @property
    def heartbeat_due(self) -> float | None:
        """When the first watched node is late [s]."""
        return self._consumer.due

    def check_heartbeats(self, now: float) -> None:
        """Reacts to nodes that are late. Before it, all frames received must have been handled."""
        for node in self._consumer.lost(now):
            self._log(f"heartbeat of node {node} lost")
            behaviour = self._objects.number(0x1029, 1)
            self._application.connection_lost(node)
            if behaviour == 0 and self.operational:
                self._change(NmtState.PRE_OPERATIONAL, "communication error")
            elif behaviour == 2:
                self._change(NmtState.STOPPED, "communication error")

    # Parameters

    def _write_sync_cob_id(self, value: Value) -> None:
        if int(value) & (_PRODUCER | _EXTENDED) or not 0 < int(value) & 0x7FF <= 0x7FF:
            raise Abort(AbortCode.RANGE)
        self._objects[0x1005].value = value
        self._rewire()

    def _write_emergency_cob_id(self, value: Value) -> None:
        if int(value) & _EXTENDED or (not int(value) & _INVALID and not int(value) & 0x7FF):
            raise Abort(AbortCode.RANGE)

    def _write_sync_overflow(self, value: Value) -> None:
        if int(value) == 1:
            raise Abort(AbortCode.RANGE)
        if self._objects.number(0x1006):
            raise Abort(AbortCode.STATE)
        self._counter = 0


def _earliest(*times: float | None) -> float | None:
    first = None
    for time in times:
        if time is not None and (first is None or time < first):
            first = time
    return first
