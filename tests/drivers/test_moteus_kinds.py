"""Other controllers and adapters than the simulated one: USB adapters, older firmware, the maker's profile."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autotune.core.drive import HOLD, Mode
from autotune.core.errors import DriveFault, LinkError
from autotune.core.ripple_parameters import is_ripple
from autotune_drivers.moteus.exchange import TEMPERATURE_AGE
from autotune_drivers.moteus.opening import MoteusOpener, open_controller
from autotune_drivers.moteus.port import open_port
from autotune_drivers.moteus.profile import read_moteus_profile
from autotune_drivers.url import parse_link
from autotune_sim.moteus_device import MoteusDevice
from autotune_sim.presets import preset
from autotune_sim.server import Server
from autotune_sim.servo import Servo
from tests.drivers.contract import column, play, sine, where
from tests.drivers.moteus_rig import hold, moteus_axis, moteus_opener, patient

LIMITS = {
    "servo.fault_position_error": "limit.following_error",
    "servopos.position_max": "limit.position_max",
}


class UsbAdapter:
    """An fdcanusb: no checksums of its own; what it makes of ours is said by `strict`."""

    def __init__(self, deliver: Callable[[int, bytes], None], strict: bool) -> None:
        self.output = bytearray()
        self.flush: Callable[[], None] = lambda: None
        self._deliver, self._strict = deliver, strict
        self._rest = b""

    def reset(self) -> None:
        self.output.clear()

    def feed(self, data: bytes) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            words = line.split()
            if self._strict and words[-1].startswith(b"*"):
                self.output += b"ERR unknown flag\r\n"
                continue
            self.output += b"OK\r\n"
            self._deliver(int(words[2], 16), bytes.fromhex(words[3].decode()))

    def transmit(self, identifier: int, data: bytes) -> None:
        padding = b"\x50" * (64 - len(data))  # as the bus carries it
        self.output += b"rcv %X %s E B F t12345 f-1\r\n" % (
            identifier,
            (data + padding).hex().upper().encode(),
        )


@contextmanager
def served(
    directory: Path, change: Callable[[Server, MoteusDevice], None], real_time: bool = False
) -> Iterator[Path]:
    """A simulated controller in a thread, changed before it begins."""
    ready = threading.Event()
    servo = Servo(preset("edm-vertical"))
    servo.cycle()
    server = Server(
        servo, directory / "edm.tty", 1, link="moteus", real_time=real_time, ready=lambda _: ready.set()
    )
    assert isinstance(server.device, MoteusDevice)
    change(server, server.device)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        assert ready.wait(10)
        yield directory
    finally:
        server.stop()
        thread.join()


def on_usb(strict: bool) -> Callable[[Server, MoteusDevice], None]:
    def change(server: Server, device: MoteusDevice) -> None:
        adapter = UsbAdapter(server._deliver, strict)
        server._adapter = adapter  # type: ignore[assignment]
        device._transmit = adapter.transmit

    return change


def old_firmware(_: Server, device: MoteusDevice) -> None:
    """Without control position, motor temperature, echo of the watchdog and flow control."""
    for register in (0x038, 0x00A, 0x027):
        del device._registers[register]
    plain: Any = device._stream
    device._stream = (  # type: ignore[method-assign]
        lambda stream, reply: plain(stream, reply) if stream.acknowledged < 0 else None
    )


@pytest.mark.parametrize("strict", [True, False])
def test_an_adapter_without_checksums_is_found_out(tmp_path: Path, strict: bool) -> None:
    with served(tmp_path, on_usb(strict)) as directory:
        drive = moteus_opener(directory)()
        try:
            assert not drive._settings.node.checked
            samples = play(drive, sine(300, where(drive)))
            assert drive.read_parameters(["controller.kp"])["controller.kp"] == pytest.approx(60.0)
        finally:
            drive.close()
    error = column(samples, "reference") - column(samples, "position")
    assert abs(error).max() < 5e-3
    assert int(column(samples, "missed").sum()) <= 1  # none but for a test machine that stood still


def test_an_older_firmware_gives_what_it_has(tmp_path: Path) -> None:
    with served(tmp_path, old_firmware) as directory:
        drive = moteus_opener(directory)()
        try:
            start = where(drive)
            commands = sine(300, start)
            samples = play(drive, commands)
            drive.write_parameters({"feedforward.coulomb": 0.1})
            drive.store()
        finally:
            drive.close()
    assert column(samples, "reference") == pytest.approx([command.position for command in commands], abs=1e-6)
    assert all(math.isnan(sample.temperature) for sample in samples)
    shares = column(samples, "torque_feedforward") + column(samples, "torque_feedback")
    assert shares == pytest.approx(column(samples, "torque_command"), abs=1e-6)


def test_the_makers_profile_holds_ripple_and_nothing_of_friction_and_keeps_real_time(tmp_path: Path) -> None:
    profile = patient(read_moteus_profile("moteus"))
    axis = moteus_axis()
    with served(tmp_path, lambda *_: None, real_time=True) as directory:
        drive = MoteusOpener(parse_link(axis.link, directory), axis, profile)()
        try:
            assert not drive.lock_step
            assert drive.identity["vendor"] == "mjbots"
            names = set(drive.read_parameters())
            samples = play(drive, [HOLD] * 100)
            drive.store()
        finally:
            drive.close()
    held = {name for name in names if name.startswith("feedforward.")}
    assert len(held) == 1025
    assert all(map(is_ripple, held))
    assert {"controller.kp", "limit.position_min"} <= names
    steps = np.diff(column(samples, "time")) / drive.period
    assert steps == pytest.approx(1.0 + column(samples, "missed")[1:], abs=1e-6)


def test_limits_that_a_controller_does_not_have_are_set_for_the_session(tmp_path: Path) -> None:
    """`nan` in a moteus means no limit: the axis file's are in force while we have it, then none again."""
    texts = dict.fromkeys(LIMITS, "nan")

    def without_limits(_: Server, device: MoteusDevice) -> None:
        plain = device.console._answer

        def answer(line: str) -> str:
            words = line.split()
            if len(words) > 2 and words[2] in texts:
                if words[1] == "set":
                    texts[words[2]] = words[3]
                return texts[words[2]] if words[1] == "get" else "OK"
            return plain(line)

        device.console._answer = answer  # type: ignore[method-assign]

    with served(tmp_path, without_limits) as directory:
        drive = moteus_opener(directory)()
        during = {name: float(text) * 2.0 * math.pi for name, text in texts.items()}
        known = set(drive.read_parameters())
        drive.close()
    assert during == pytest.approx({"servo.fault_position_error": 0.15, "servopos.position_max": 20.0})
    assert not known & set(LIMITS.values())
    assert texts == dict.fromkeys(LIMITS, "nan")


def test_a_failed_opening_leaves_nothing_changed(tmp_path: Path) -> None:
    """The console refuses the last setting of the session."""
    texts: list[str] = []

    def stubborn(_: Server, device: MoteusDevice) -> None:
        plain = device.console._answer

        def answer(line: str) -> str:
            texts.append(line)
            return "ERR error setting" if line.startswith("conf set autotune.period_s") else plain(line)

        device.console._answer = answer  # type: ignore[method-assign]

    with served(tmp_path, stubborn) as directory:
        opener = moteus_opener(directory)
        port = open_port(directory / "edm.tty", 921600)
        try:
            with pytest.raises(LinkError, match=r"autotune\.period_s"):
                open_controller(port, 1, opener.axis, opener.profile)
        finally:
            port.close()
    assert [line for line in texts if line.startswith("conf set servo.timeout_mode")] == [
        "conf set servo.timeout_mode 10",
        "conf set servo.timeout_mode 12",
    ]


def test_every_mode_is_there_with_the_makers_profile(tmp_path: Path) -> None:
    axis = moteus_axis()
    with served(tmp_path, lambda *_: None, real_time=True) as directory:
        drive = MoteusOpener(parse_link(axis.link, directory), axis, patient(read_moteus_profile("moteus")))()
        try:
            for mode in Mode:
                assert len(play(drive, [HOLD._replace(velocity=0.5, torque=0.048)] * 30, mode)) == 30
        finally:
            drive.close()


def test_an_encoder_that_is_not_valid_ends_the_motion(tmp_path: Path) -> None:
    """A moteus tells nan where it does not know."""
    with served(tmp_path, lambda *_: None) as directory:
        drive = moteus_opener(directory)()
        try:
            drive.enable(Mode.TORQUE)
            hold(drive, 5)
            exchange = drive._exchange
            keep = exchange._keep
            exchange._keep = lambda values, raw: keep([values[0], math.nan, *values[2:]], raw)  # type: ignore[method-assign]
            with pytest.raises(DriveFault, match="does not know where its axis is"):
                hold(drive, 1)
            with pytest.raises(DriveFault, match="did not bring its axis to rest"):
                drive.disable()
            assert exchange.look().mode == 0  # power is off all the same
            with pytest.raises(DriveFault, match="does not know where its axis is"):
                drive.enable(Mode.POSITION)
        finally:
            drive.close()


def test_a_thermistor_that_falls_off_ends_the_motion(tmp_path: Path) -> None:
    with served(tmp_path, lambda *_: None) as directory:
        drive = moteus_opener(directory)()
        try:
            drive.enable(Mode.POSITION)
            hold(drive, 5)
            exchange = drive._exchange
            age = exchange._age
            exchange._age = lambda temperature: age(math.nan)  # type: ignore[method-assign]
            cycles = round(TEMPERATURE_AGE / drive.period)
            hold(drive, cycles)
            with pytest.raises(
                DriveFault, match=r"no temperature for more than 0\.1 s; the last one, 2\d\.\d °C"
            ):
                hold(drive, 2)
            drive.disable()
        finally:
            drive.close()
