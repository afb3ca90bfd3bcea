"""The moteus drive against a simulated controller in a process of its own: guard, faults, bad lines, storing."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import serial

from autotune.core.drive import HOLD, Command, Mode
from autotune.core.errors import (
    ConfigurationError,
    DriveError,
    DriveFault,
    IdentityMismatch,
    LinkError,
    LinkTimeout,
    StateError,
)
from autotune_drivers import open_loop
from autotune_drivers.moteus_console import Console
from autotune_drivers.moteus_drive import MoteusDrive
from autotune_drivers.moteus_line import Line
from autotune_drivers.moteus_multiplex import Form, write
from autotune_drivers.moteus_node import MoteusNode
from autotune_drivers.moteus_open import MoteusOpener, open_controller
from autotune_drivers.moteus_port import MoteusPort, open_port
from autotune_drivers.moteus_profile import read_moteus_profile
from autotune_drivers.profile import read_profile
from tests.drivers.contract import column, play, sine, where
from tests.drivers.moteus_rig import LINK, moteus_axis, moteus_opener
from tests.drivers.routines import Calls, Sine, kill_self
from tests.drivers.simulator import Simulator, simulator

SESSION = ("servo.timeout_mode", "servo.default_accel_limit", "autotune.period_s")


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("moteus"), "--link", "moteus", "--node", "1") as process:
        yield process


@pytest.fixture
def running(shared: Simulator) -> Iterator[Simulator]:
    """The shared simulator, without faults afterwards."""
    yield shared
    shared.order("clear")


@pytest.fixture
def drive(running: Simulator) -> Iterator[MoteusDrive]:
    drive = moteus_opener(running.directory)()
    yield drive
    drive.close()


def console(directory: Path) -> Iterator[Console]:
    port = open_port(directory / "edm.tty", 921600)
    try:
        node = MoteusNode(port, 1)
        node.greet()
        yield Console(node)
    finally:
        port.close()


def hold(drive: MoteusDrive, cycles: int) -> None:
    for _ in range(cycles):
        drive.step(HOLD)


def settings(directory: Path) -> dict[str, str]:
    (found,) = (dict(console.enumerate()) for console in console(directory))
    return found


# The guard


def test_a_silent_host_is_stopped_by_the_watchdog_and_the_axis_can_be_used_again(running: Simulator) -> None:
    drive = moteus_opener(running.directory, watchdog=0.1)()
    try:
        mark = running.mark
        drive.enable(Mode.VELOCITY)
        for _ in range(200):
            drive.step(Command(velocity=3.0))
        silent = time.monotonic()
        line = running.wait_for("quick stop begun (watchdog", mark, seconds=5.0)
        # 100 ms, and what a loaded machine is late; the log's time is the simulator's own
        assert 0.05 < float(line.split()[0]) - silent < 0.2
        with pytest.raises(DriveFault, match="100 ms"):
            drive.step(HOLD)
        drive.disable()
        assert abs(column(play(drive, [HOLD] * 50), "velocity")).max() < 1.0
    finally:
        drive.close()


def test_a_killed_cyclic_process_is_stopped_by_the_watchdog_and_put_right_by_the_next(
    running: Simulator,
) -> None:
    before = settings(running.directory)
    loop = open_loop(moteus_axis(), running.directory)
    try:
        mark = running.mark
        with pytest.raises(LinkError, match="has died"):
            loop.play(Calls(kill_self))
        killed = time.monotonic()
        line = running.wait_for("quick stop begun (watchdog", mark, seconds=5.0)
        assert float(line.split()[0]) - killed < 0.2
        assert loop.read_parameters(["controller.kp"])["controller.kp"] == pytest.approx(60.0)
        assert abs(loop.play(Sine(50))) < 100.0
    finally:
        loop.close()
    assert settings(running.directory) == before


def test_power_is_off_and_the_axis_at_rest_after_disable(drive: MoteusDrive, running: Simulator) -> None:
    drive.enable(Mode.VELOCITY)
    for _ in range(300):
        drive.step(Command(velocity=8.0))
    mark = running.mark
    drive.disable()
    assert running.wait_for("SWITCH_ON_DISABLED (stop commanded)", mark)
    first = where(drive)
    assert where(drive) == pytest.approx(first, abs=2e-3)


@pytest.mark.parametrize("mode", list(Mode))
def test_every_mode_begins_where_the_axis_is(drive: MoteusDrive, mode: Mode) -> None:
    start = where(drive)
    play(drive, [Command(start + 1e-3 * k) for k in range(500)])
    rest = {Mode.POSITION: HOLD, Mode.VELOCITY: Command(), Mode.TORQUE: Command(torque=0.048)}[mode]
    samples = play(drive, [rest] * 60, mode)
    assert np.ptp(column(samples, "position")) < 2e-2
    assert samples[0].position == pytest.approx(start + 0.499, abs=0.02)


def test_what_a_session_changes_is_put_back(running: Simulator) -> None:
    before = settings(running.directory)
    drive = moteus_opener(running.directory)()
    during = dict(drive._settings.console.enumerate())
    assert {name for name in before if before[name] != during[name]} <= set(SESSION)
    assert during["servo.timeout_mode"] == "10"
    drive.close()
    assert settings(running.directory) == before


# Faults


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("drive-fault", "motor driver"),
        ("enable-missing", "enable input"),
        ("brake-missing", "brake is not released"),
        ("hot", "over-temperature"),
    ],
)
def test_a_fault_is_said_in_words_and_power_is_off(
    running: Simulator, drive: MoteusDrive, fault: str, says: str
) -> None:
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    mark = running.mark
    running.order(fault)
    running.wait_for("fault put in", mark)
    with pytest.raises(DriveFault, match=says) as caught:
        hold(drive, 500)
    assert "while it was running" in str(caught.value)
    drive.disable()
    assert says in " ".join(drive.faults()).lower() or fault == "enable-missing"
    with pytest.raises((DriveFault, StateError)):
        drive.enable(Mode.POSITION)
    running.order("clear")
    port = drive._settings.node
    port.tell(write(Form.INT8, 0, [0]))
    assert drive.faults() == []


def test_a_blocked_axis_is_a_position_error_that_closing_clears(running: Simulator) -> None:
    drive = moteus_opener(running.directory)()
    start = where(drive)
    mark = running.mark
    running.order("blocked")
    running.wait_for("fault put in", mark)
    with pytest.raises(DriveFault, match="fault_position_error"):
        play(drive, [Command(start + 2e-3 * k) for k in range(1000)])
    assert "fault_position_error" in drive.faults()[0]
    running.order("clear")
    drive.close()
    with_another = moteus_opener(running.directory)()
    try:
        assert with_another.faults() == []
    finally:
        with_another.close()


def test_limits_of_the_controller_hold_the_position(drive: MoteusDrive) -> None:
    start = where(drive)
    before = drive.read_parameters(["limit.position_max"])
    drive.write_parameters({"limit.position_max": start + 0.05})
    try:
        samples = play(drive, [Command(start + 3e-4 * k) for k in range(400)])
    finally:
        drive.write_parameters(before)
    assert samples[-1].reference == pytest.approx(start + 0.05, abs=5e-4)


def test_where_the_torque_is_limited_the_shares_still_add_up(drive: MoteusDrive) -> None:
    start = where(drive)
    before = drive.read_parameters(["limit.torque"])
    drive.write_parameters({"limit.torque": 0.2})
    try:
        samples = play(drive, [Command(start + 5e-4 * k, torque_feedforward=0.05) for k in range(200)])
    finally:
        drive.write_parameters(before)
    command = column(samples, "torque_command")
    assert abs(command).max() == pytest.approx(0.2, abs=1e-3)
    shares = column(samples, "torque_feedforward") + column(samples, "torque_feedback")
    assert shares == pytest.approx(command, abs=1e-6)
    assert column(samples, "torque_feedforward") == pytest.approx(0.05, abs=1e-5)


# Bad lines


class Dripping:
    """A serial port that hands over a few bytes at a time, as a real one at its speed does."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self.baudrate = port.baudrate
        self.write = port.write
        self.close = port.close
        self.fileno = port.fileno

    def read(self, size: int) -> bytes:
        return bytes(self._port.read(7))


class Noisy:
    """A serial port on which bytes change and get lost, both ways."""

    def __init__(self, port: serial.Serial, chance: random.Random, rate: float) -> None:
        self._port, self._chance, self._rate = port, chance, rate
        self.baudrate = port.baudrate
        self.hits = 0

    def fileno(self) -> int:
        return int(self._port.fileno())

    def close(self) -> None:
        self._port.close()

    def _spoil(self, data: bytes) -> bytes:
        if not data or self._chance.random() > self._rate:
            return data
        self.hits += 1
        at = self._chance.randrange(len(data))
        sort = self._chance.randrange(3)
        if sort == 0:
            return data[:at] + bytes((data[at] ^ 1 << self._chance.randrange(8),)) + data[at + 1 :]
        return data[:at] + data[at + self._chance.randrange(1, 20) :] if sort == 1 else b"rcv 10\x00" + data

    def read(self, size: int) -> bytes:
        return self._spoil(self._port.read(size))

    def write(self, data: bytes) -> None:
        self._port.write(self._spoil(data))


def noisy_drive(directory: Path, rate: float, watchdog: float = 1.0) -> tuple[MoteusDrive, Noisy]:
    opener = moteus_opener(directory, watchdog=watchdog)
    quiet = open_port(directory / "edm.tty", 921600)
    noise = Noisy(quiet._port, random.Random(5), rate)
    port = MoteusPort(noise, quiet.name, quiet._lock)
    return open_controller(port, 1, opener.axis, opener.profile), noise


def test_lines_may_come_a_few_bytes_at_a_time(running: Simulator) -> None:
    opener = moteus_opener(running.directory)
    quiet = open_port(running.directory / "edm.tty", 921600)
    port = MoteusPort(Dripping(quiet._port), quiet.name, quiet._lock)
    drive = open_controller(port, 1, opener.axis, opener.profile)
    try:
        samples = play(drive, sine(300, where(drive)))
        assert port.reader.garbled == 0
    finally:
        drive.close()
    assert int(column(samples, "missed").sum()) <= 1  # none but for a test machine that stood still


def test_a_line_that_loses_and_changes_bytes_still_carries_a_motion(running: Simulator) -> None:
    drive, noise = noisy_drive(running.directory, 0.01, watchdog=20.0)
    try:
        samples = play(drive, sine(1500, where(drive)))
        names = ["controller.kp", "feedforward.coulomb"]
        assert drive.read_parameters(names) == pytest.approx(
            {"controller.kp": 60.0, "feedforward.coulomb": 0.0}
        )
    finally:
        drive.close()
    assert noise.hits > 20
    error = column(samples, "reference") - column(samples, "position")
    # a garbled command is not executed, a garbled reply is: its cycle is missing and counted
    assert abs(error).max() < 8e-3
    steps = np.diff(column(samples, "time")) / drive.period
    assert steps == pytest.approx(1.0 + column(samples, "missed")[1:], abs=1e-6)


def test_a_line_that_is_only_noise_ends_in_words_and_at_rest(running: Simulator) -> None:
    drive, noise = noisy_drive(running.directory, 0.0, watchdog=0.15)
    mark = running.mark
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    noise._rate = 1.0
    with pytest.raises(LinkError, match="cable"):
        hold(drive, 100)
    noise._rate = 0.0
    drive.disable()
    drive.close()
    running.wait_for("SWITCH_ON_DISABLED", mark)


def test_another_talker_on_the_line_is_passed_over(
    drive: MoteusDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames of other controllers, of this one to another host, and replies to other queries."""
    strangers = [
        Line("rcv", 0x0200, bytes.fromhex("21000a2f01000000000000000000000000")),
        Line("rcv", 0x0105, bytes.fromhex("21000a")),
        Line("rcv", 0x0100, bytes.fromhex("230d181400")),
        Line("rcv", 0x0100, b""),
    ]
    plain = MoteusPort.lines

    def talkative(self: MoteusPort, timeout: float) -> list[Line]:
        return [entry for line in plain(self, timeout) for entry in (*strangers, line, *strangers)]

    monkeypatch.setattr(MoteusPort, "lines", talkative)
    samples = play(drive, sine(300, where(drive)))
    assert int(column(samples, "missed").sum()) <= 1  # none but for a test machine that stood still
    error = column(samples, "reference") - column(samples, "position")
    assert abs(error).max() < 5e-3


# Who is there


def test_a_silent_controller_is_said(running: Simulator) -> None:
    running.order("silent=3")
    time.sleep(0.1)
    with pytest.raises(LinkTimeout, match="controller 1 is silent"):
        moteus_opener(running.directory)()
    running.order("clear")


def test_a_wrong_id_names_the_right_one(running: Simulator) -> None:
    with pytest.raises(LinkTimeout, match="id=1"):
        moteus_opener(running.directory, "moteus+serial:edm.tty?id=2")()


def test_a_wrong_speed_is_said(running: Simulator) -> None:
    with pytest.raises(LinkTimeout, match="speed is not 115200 baud"):
        moteus_opener(running.directory, "moteus+serial:edm.tty?id=1&baud=115200")()
    moteus_opener(running.directory)().close()


def test_a_port_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="there is no serial port"):
        moteus_opener(tmp_path)()
    (tmp_path / "edm.tty").write_text("no port")
    with pytest.raises(LinkError, match="not a serial port"):
        moteus_opener(tmp_path)()


def test_a_port_that_another_program_has_is_not_disturbed(drive: MoteusDrive, running: Simulator) -> None:
    with pytest.raises(LinkError, match="in use"):
        moteus_opener(running.directory)()
    assert where(drive) == pytest.approx(where(drive), abs=5e-3)


def test_another_model_is_refused_before_anything_is_written(running: Simulator) -> None:
    before = settings(running.directory)
    mark = running.mark
    running.order("other-identity")
    running.wait_for("fault put in", mark)
    with pytest.raises(IdentityMismatch, match="0x7a01"):
        moteus_opener(running.directory)()
    running.order("clear")
    assert settings(running.directory) == before


def test_a_controller_that_another_host_commands_is_left_alone(running: Simulator) -> None:
    """Its commands have no watchdog; nothing of ours is written."""
    port = open_port(running.directory / "edm.tty", 921600)
    node = MoteusNode(port, 1)
    node.greet()
    node.tell(
        write(Form.INT8, 0, [10])
        + write(Form.FLOAT, 0x20, [float("nan")])
        + write(Form.FLOAT, 0x27, [float("nan")])
    )
    port.close()
    with pytest.raises(StateError, match="another program commands it"):
        moteus_opener(running.directory)()
    port = open_port(running.directory / "edm.tty", 921600)
    node = MoteusNode(port, 1)
    node.greet()
    assert node.registers((Form.INT8, 0, 1))[0] == 10
    node.tell(write(Form.INT8, 0, [0]))
    port.close()


def test_an_axis_in_metres_is_refused(running: Simulator) -> None:
    with pytest.raises(ConfigurationError, match="revolutions"):
        moteus_opener(running.directory, motion_unit="m")()


def test_profiles_are_for_their_links() -> None:
    with pytest.raises(ConfigurationError, match="for a moteus link"):
        read_profile("moteus")
    with pytest.raises(ConfigurationError, match="for CANopen drives"):
        read_moteus_profile("cia402")
    with pytest.raises(ConfigurationError, match="did you mean 'autotune-sim-moteus'"):
        read_moteus_profile("autotune-sim-moteu")
    assert not read_moteus_profile("moteus").has_feedforward_block


@pytest.mark.parametrize("name", ["moteus", "autotune-sim-moteus"])
def test_profiles_load(name: str) -> None:
    assert read_moteus_profile(name).name == name


def test_mistakes_in_a_profile_are_named(tmp_path: Path) -> None:
    text = (
        Path(__file__)
        .resolve()
        .parents[2]
        .joinpath("config/profiles/moteus.toml")
        .read_text(encoding="utf-8")
    )
    for right, wrong, says in (
        ("title =", "titel =", "did you mean 'title'"),
        ('"Nm/rev"', '"Nm/rv"', "did you mean 'Nm/rev'"),
        ('"controller.kp"', '"controler.kp"', "did you mean 'controller.kp'"),
        ("watchdog = 0.15", "watchdog = 0.5", "watchdog"),
    ):
        assert right in text
        (tmp_path / "mine.toml").write_text(text.replace(right, wrong, 1), encoding="utf-8")
        with pytest.raises(ConfigurationError, match=says):
            read_moteus_profile("mine.toml", tmp_path)


# Storing


def test_storing_keeps_ours_and_nothing_that_a_session_or_a_run_has_changed(tmp_path: Path) -> None:
    with simulator(
        tmp_path, "--link", "moteus", "--node", "1", "--state", str(tmp_path / "memory")
    ) as process:
        drive = moteus_opener(tmp_path)()
        drive.write_parameters({"limit.speed": 10.0, "feedforward.coulomb": 0.3, "feedforward.enabled": 1.0})
        drive.store()
        assert drive.read_parameters(["limit.speed"])["limit.speed"] == pytest.approx(10.0, rel=1e-3)
        mark = process.mark
        process.order("power-loss")
        process.wait_for("boot-up", mark)
        after = drive.read_parameters(["limit.speed", "feedforward.coulomb", "feedforward.enabled"])
        drive.close()
        stored = settings(tmp_path)
    assert after == pytest.approx(
        {"limit.speed": 50.0, "feedforward.coulomb": 0.3, "feedforward.enabled": 1.0}, rel=1e-3
    )
    assert stored["servo.default_accel_limit"] == "63.662"


def test_a_controller_that_may_not_load_stores_without_the_session(tmp_path: Path) -> None:
    """As a real one: `conf load` would cost it its position."""
    with simulator(
        tmp_path, "--link", "moteus", "--node", "1", "--state", str(tmp_path / "memory")
    ) as process:
        opener = moteus_opener(tmp_path)
        store = opener.profile.store
        assert store is not None
        profile = opener.profile.model_copy(update={"store": store.model_copy(update={"reload": False})})
        drive = MoteusOpener(opener.address, opener.axis, profile)()
        drive.write_parameters({"feedforward.coulomb": 0.3})
        drive.store()
        assert drive._settings.console.get("servo.timeout_mode") == "10"
        drive.close()
        mark = process.mark
        process.order("power-loss")
        process.wait_for("boot-up", mark)
        stored = settings(tmp_path)
    assert stored["autotune.feedforward.coulomb"] == "0.3"
    assert stored["servo.timeout_mode"] == "12"


def test_a_memory_that_keeps_nothing_is_found_out(running: Simulator, drive: MoteusDrive) -> None:
    mark = running.mark
    running.order("nvm")
    running.wait_for("fault put in", mark)
    drive.write_parameters({"feedforward.viscous": 0.001})
    try:
        with pytest.raises(DriveError, match="does not keep"):
            drive.store()
    finally:
        running.order("clear")
        drive.write_parameters({"feedforward.viscous": 0.0})


def test_a_refused_parameter_is_said_and_nothing_is_half_written(
    running: Simulator, drive: MoteusDrive
) -> None:
    mark = running.mark
    running.order("sdo-abort=2100:04:06090030")
    running.wait_for("fault put in", mark)
    before = drive.read_parameters(["feedforward.inertia"])
    with pytest.raises(LinkError, match=r"autotune\.feedforward\.coulomb"):
        drive.write_parameters({"feedforward.inertia": 0.002, "feedforward.coulomb": 0.3})
    running.order("clear")
    assert drive.read_parameters(["feedforward.inertia"]) == before


def test_nothing_is_stored_with_power_on(drive: MoteusDrive) -> None:
    drive.enable(Mode.POSITION)
    try:
        with pytest.raises(StateError, match="power off"):
            drive.store()
    finally:
        drive.disable()


def test_a_longer_cycle_moves_the_axis_by_its_period(running: Simulator) -> None:
    drive = moteus_opener(running.directory, cycle=0.002)()
    try:
        start = where(drive)
        samples = play(drive, [Command(start + 2e-3 * k) for k in range(400)])
    finally:
        drive.close()
    speed = np.diff(column(samples, "position"))[200:].mean() / 0.002
    assert speed == pytest.approx(1.0, abs=0.02)
    assert np.diff(column(samples, "time")) == pytest.approx(0.002, rel=1e-6)


def test_an_axis_that_counts_backwards_is_the_same_axis(running: Simulator) -> None:
    axis = moteus_axis(LINK)
    mechanics = axis.mechanics.model_copy(update={"direction": -1})
    forwards = moteus_opener(running.directory)()
    expected = (where(forwards), forwards.read_parameters(["limit.position_min", "limit.position_max"]))
    forwards.close()
    drive = moteus_opener(running.directory, mechanics=mechanics)()
    try:
        start = where(drive)
        samples = play(drive, sine(600, start, feedforward=0.05))
        limits = drive.read_parameters(["limit.position_min", "limit.position_max"])
    finally:
        drive.close()
    assert start == pytest.approx(-expected[0], abs=5e-3)
    assert limits["limit.position_min"] == pytest.approx(-expected[1]["limit.position_max"])
    error = column(samples, "reference") - column(samples, "position")
    assert abs(error).max() < 5e-3
    shares = column(samples, "torque_feedforward") + column(samples, "torque_feedback")
    assert shares == pytest.approx(column(samples, "torque_command"), abs=1e-6)
    assert column(samples, "torque_feedforward")[50:] == pytest.approx(0.05, abs=6e-4)


def test_in_real_time_missed_cycles_are_counted(tmp_path: Path) -> None:
    with simulator(tmp_path, "--link", "moteus", "--node", "1", "--real-time"):
        drive = moteus_opener(tmp_path)()
        try:
            assert not drive.lock_step
            samples = play(drive, sine(500, where(drive)))
        finally:
            drive.close()
    steps = np.diff(column(samples, "time")) / drive.period
    assert steps == pytest.approx(1.0 + column(samples, "missed")[1:], abs=1e-6)
    error = column(samples, "reference") - column(samples, "position")
    assert np.median(np.abs(error)) < 5e-3
