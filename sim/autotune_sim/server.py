"""The simulated drive as a process of its own: one loop between a pseudo-terminal and the device."""

from __future__ import annotations

import gc
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.core.paths import config_directory
from autotune_sim.device import Device
from autotune_sim.effects import EFFECTS, check_size
from autotune_sim.faults import Faults, Order, parse_order
from autotune_sim.memory import Memory
from autotune_sim.moteus_device import MoteusDevice
from autotune_sim.moteus_uart import UartServer
from autotune_sim.presets import Preset, with_dead_time
from autotune_sim.presets import preset as find_preset
from autotune_sim.pty_port import PtyPort
from autotune_sim.servo import Servo
from autotune_sim.slcan import SlcanAdapter
from autotune_sim.truth import Truth
from autotune_sim.unfit import unfit_axis

EDS = "autotune-sim.eds"
BITRATE = 1_000_000
LINKS = ("canopen", "moteus")
_DRAINS = 1000  # reads before a heartbeat is judged, at most

Log = Callable[[str], None]
Ready = Callable[[Path], None]


class Server:
    """A simulated drive at a pseudo-terminal.

    Args:
        link: what the drive speaks: `canopen` behind an slcan adapter, or `moteus` on its own serial line.
        also: where further slcan adapters on the same bus are put, for other nodes: what one of them sends, the
            drive and all others hear.
        commands: file descriptor that fault orders are read from, one a line; at its end the server
            stops. None for none.

    Attributes:
        device: the drive; touch it only from the thread that runs `run`.
    """

    def __init__(
        self,
        servo: Servo,
        port_path: Path,
        node_id: int,
        *,
        real_time: bool = False,
        faults: Sequence[Order] = (),
        state_file: Path | None = None,
        bitrate: int = BITRATE,
        link: str = "canopen",
        also: Sequence[Path] = (),
        commands: int | None = None,
        log: Log = lambda _: None,
        ready: Ready = lambda _: None,
    ) -> None:
        self._ready = ready
        self._log: Log = lambda text: log(f"{time.monotonic():.6f} {text}")
        self._clock = time.monotonic
        self._port = PtyPort(port_path)
        moteus = link == "moteus"
        self._adapter: SlcanAdapter | UartServer = (
            UartServer(self._deliver, self._port.speed)
            if moteus
            else SlcanAdapter(self._deliver, self._clock, bitrate)
        )
        self._adapter.flush = self._port.discard
        self._others = [self._joined(path, bitrate) for path in also]
        eds = config_directory() / "eds" / EDS
        memory = Memory(state_file, self._log, servo.preset.name)
        self.device = (MoteusDevice if moteus else Device)(
            servo, eds, node_id, self._broadcast, memory, self._log, real_time=real_time
        )
        self._orders = list(faults)
        self._faults = Faults(self.device, self, self._clock, self._log)
        self._commands = commands
        self._typed = b""
        self._stopping = False
        self._wake_read, self._wake_write = os.pipe()

    def _joined(self, path: Path, bitrate: int) -> tuple[PtyPort, SlcanAdapter]:
        """A further adapter on the bus."""
        port = PtyPort(path)
        adapter = SlcanAdapter(lambda cob_id, data: self._hear(adapter, cob_id, data), self._clock, bitrate)
        adapter.flush = port.discard
        return port, adapter

    def stop(self) -> None:
        """Ends `run`; from any thread or signal handler."""
        self._stopping = True
        with suppress(OSError):
            os.write(self._wake_write, b"\0")

    def plug(self) -> None:
        """The adapter is plugged in. Idempotent."""
        if not self._port.plugged:
            self._adapter.reset()
            self._port.plug()
            self._log(f"adapter at {self._port.path} ({self._port.device}), node {self.device.node.node_id}")

    def unplug(self) -> None:
        """The adapter is pulled out. Idempotent."""
        if self._port.plugged:
            self._port.unplug()
            self._adapter.reset()
            self._log("adapter unplugged")

    def run(self) -> None:
        """Serves until `stop`.

        Raises:
            ConfigurationError: the port cannot be made.
        """
        try:
            self.plug()
            for port, _ in self._others:
                port.plug()
            self.device.poll(self._clock())  # powers up first: a fault put in before would be forgotten
            self._ready(self._port.path)
            self.device.note_objects("open")
            for order in self._orders:
                self._faults.add(order)
            while not self._stopping:
                self._turn()
        finally:
            self.device.firmware.disable("end of the simulation")
            self.device.note_objects("closed")
            self.unplug()
            for port, _ in self._others:
                port.unplug()
            os.close(self._wake_read)
            os.close(self._wake_write)

    def _turn(self) -> None:
        now = self._clock()
        due = self.device.poll(now)
        wall = self._faults.poll(now)
        if wall is not None:
            due = min(due, wall)
        self._flush()
        self._wait(max(due - self._clock(), 0.0))
        heartbeat = self.device.heartbeat_due
        if heartbeat is not None and self._clock() >= heartbeat:
            self._drain()
            self.device.check_heartbeats(self._clock())

    def _wait(self, timeout: float) -> None:
        readers = [self._wake_read]
        if self._commands is not None:
            readers.append(self._commands)
        writers = []
        if self._port.plugged:
            readers.append(self._port.fileno())
            if self._adapter.output:
                writers.append(self._port.fileno())
        for port, adapter in self._others:
            readers.append(port.fileno())
            writers += [port.fileno()] if adapter.output else []
        ready, _, _ = select.select(readers, writers, [], timeout)
        if self._port.plugged and self._port.fileno() in ready:
            self._adapter.feed(self._port.read())
            self._flush()
        for port, adapter in self._others:
            if port.fileno() in ready:
                adapter.feed(port.read())
                self._flush()
        if self._commands is not None and self._commands in ready:
            self._obey()

    def _drain(self) -> None:
        """Handles everything that has been received: a drive that was held up must not blame its master."""
        for _ in range(_DRAINS):
            data = self._port.read() if self._port.plugged else b""
            if not data:
                return
            self._adapter.feed(data)
            self._flush()

    def _flush(self) -> None:
        if self._adapter.output and self._port.plugged:
            self._port.write(self._adapter.output)
        for port, adapter in self._others:
            if adapter.output:
                port.write(adapter.output)

    def _deliver(self, cob_id: int, data: bytes) -> None:
        for _, adapter in self._others:
            adapter.transmit(cob_id, data)
        self.device.receive(cob_id, data, self._clock())

    def _hear(self, sender: SlcanAdapter, cob_id: int, data: bytes) -> None:
        """A frame from a further adapter."""
        for adapter in (self._adapter, *(other for _, other in self._others)):
            if adapter is not sender and isinstance(adapter, SlcanAdapter):
                adapter.transmit(cob_id, data)
        self.device.receive(cob_id, data, self._clock())

    def _broadcast(self, cob_id: int, data: bytes) -> None:
        """A frame from the drive."""
        self._adapter.transmit(cob_id, data)
        for _, adapter in self._others:
            adapter.transmit(cob_id, data)

    def _obey(self) -> None:
        data = os.read(self._commands or 0, 4096)
        if not data:
            self.stop()
        *lines, self._typed = (self._typed + data).split(b"\n")
        for line in filter(None, (line.strip() for line in lines)):
            try:
                self._faults.add(parse_order(line.decode("utf-8", "replace")))
            except AutotuneError as error:
                self._log(f"command refused: {error}")


def parse_effects(texts: Sequence[str]) -> dict[str, float]:
    """Effects to plant from `NAME` or `NAME=SIZE`.

    Raises:
        ConfigurationError: an unknown name, or a size that is no number or out of range.
    """
    effects = {}
    for text in texts:
        name, equals, size = text.partition("=")
        try:
            effects[name] = float(size) if equals else EFFECTS[name].default if name in EFFECTS else 1.0
        except ValueError:
            raise ConfigurationError(f"effect {text!r}: size {size!r} must be a number") from None
        check_size(name, effects[name])
    return effects


def _axis(
    axis: Preset, unfit: str, counts: int | None, dead_time: float
) -> tuple[Preset, tuple[tuple[str, str, float], ...]]:
    """The axis as asked for, and the faults that belong to it."""
    axis = with_dead_time(axis, dead_time)
    if counts is not None:
        if not 100 <= counts <= 1 << 24:
            raise ConfigurationError(f"counts is {counts}; allowed is 100 to {1 << 24} a revolution")
        axis = replace(axis, plant=replace(axis.plant, counts=counts))
    if not unfit:
        return axis, ()
    name, equals, size = unfit.partition("=")
    try:
        return unfit_axis(axis, name, float(size) if equals else None)
    except ValueError:
        raise ConfigurationError(f"unfit axis {unfit!r}: size {size!r} must be a number") from None


def _check_link(node_id: int, link: str, also: Sequence[str | Path]) -> None:
    if not 1 <= node_id <= 127:
        raise ConfigurationError(f"node id is {node_id}; allowed is 1 to 127")
    if link not in LINKS:
        raise ConfigurationError(f"link is {link!r}; known are {' and '.join(LINKS)}")
    if also and link != "canopen":
        raise ConfigurationError("a further adapter joins a CANopen bus only; leave --also out, or --link")


def serve(
    preset: str,
    port_path: str | Path,
    node_id: int,
    *,
    seed: int = 0,
    effects: Mapping[str, float] | None = None,
    link: str = "canopen",
    real_time: bool = False,
    faults: Sequence[str] = (),
    state_file: str | Path | None = None,
    also: Sequence[str | Path] = (),
    commands: bool = False,
    truth: str | Path | Truth | None = None,
    unfit: str = "",
    counts: int | None = None,
    dead_time: float = 0.0,
    log: Log = lambda _: None,
    ready: Ready = lambda _: None,
) -> None:
    """Serves a simulated drive until SIGINT or SIGTERM.

    Args:
        preset: name of the axis; `seed` varies its plant, `effects` (name → size) are planted.
        port_path: where the link to the pseudo-terminal is put.
        link: `canopen` or `moteus`; `faults`: orders as `autotune_sim.faults` describes them.
        state_file: the drive's non-volatile memory; without it, stored values live as long as the process.
        also: where further slcan adapters on the same bus are put (CANopen only).
        commands: reads further orders from standard input, one a line, and ends when it closes.
        truth: file that what is true on the axis is logged in, or the log itself (`truth`).
        unfit: `NAME[=SIZE]`, makes the axis one that must not be tuned (`unfit`).
        counts, dead_time: of the encoder per revolution (None: the preset's); of the torque, in whole cycles [s].
        log: takes one line an event, beginning with the monotonic time [s].
        ready: called with the port's path once it can be opened.

    Raises:
        ConfigurationError: an unknown preset, effect or fault, a node id out of range, or no port.
    """
    _check_link(node_id, link, also)
    orders = [parse_order(text) for text in faults]
    axis, lasting = _axis(find_preset(preset, seed=seed, effects=effects), unfit, counts, dead_time)
    orders += [Order(name, value, "motion", at) for name, value, at in lasting]
    servo = Servo(axis, seed)
    if truth is not None:
        servo.keep_truth(truth if isinstance(truth, Truth) else Truth(Path(truth)))
    servo.cycle()  # loads the compiled code before anybody waits for it
    server = Server(
        servo,
        Path(port_path),
        node_id,
        link=link,
        real_time=real_time,
        faults=orders,
        state_file=Path(state_file) if state_file is not None else None,
        also=[Path(path) for path in also],
        commands=sys.stdin.fileno() if commands else None,
        log=log,
        ready=ready,
    )
    _run_until_signalled(server)


def _run_until_signalled(server: Server) -> None:
    before = {
        number: signal.signal(number, lambda *_: server.stop()) for number in (signal.SIGINT, signal.SIGTERM)
    }
    gc.freeze()
    try:
        server.run()
    finally:
        gc.unfreeze()
        for number, handler in before.items():
            signal.signal(number, handler)
