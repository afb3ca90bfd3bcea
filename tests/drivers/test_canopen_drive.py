"""The CANopen drive against the simulated one: directions, cycles, profiles, states it may be found in."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.core.axis import Axis, Mechanics
from autotune.core.drive import HOLD, Command, Mode
from autotune.core.errors import (
    ConfigurationError,
    DriveFault,
    Interrupted,
    LinkError,
    StateError,
    TransferAborted,
)
from autotune.core.loop import ROW_FIELDS
from autotune_drivers import open_loop
from autotune_drivers.canopen.drive import FAULT_REACTION, CanopenDrive
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.opening import CanopenOpener
from autotune_drivers.cyclic.loop import CyclicLoop
from autotune_drivers.profile import read_profile
from autotune_drivers.url import parse_link
from tests.drivers import bus
from tests.drivers.contract import column, play, sine, where
from tests.drivers.routines import Sine
from tests.drivers.simulator import Simulator, axis_of, simulator


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("drive")) as process:
        yield process


def connect(running: Simulator, axis: Axis | None = None, profile: str = "autotune-sim") -> CanopenDrive:
    axis = axis or axis_of()
    return CanopenOpener(parse_link(axis.link, running.directory), axis, read_profile(profile))()


def write(running: Simulator, text: str, raw: float) -> None:
    with bus.sdo(running.port) as client:
        client.write(ObjectRef.parse(text), raw)


def test_a_drive_that_counts_the_other_way(running: Simulator) -> None:
    """Everything turns its sign together: the loop stays stable and the offset still helps."""
    plain = connect(running)
    position = where(plain)
    plain.close()
    mirrored = Mechanics(counts_per_revolution=50000, direction=-1)
    drive = connect(running, axis_of(mechanics=mirrored))
    assert where(drive) == pytest.approx(-position, abs=2e-3)
    turned = play(drive, [Command(velocity=2.0)] * 600, Mode.VELOCITY)
    assert turned[-1].position - turned[0].position == pytest.approx(1.2, abs=0.15)
    assert column(turned, "velocity")[-200:].mean() == pytest.approx(2.0, abs=0.2)
    assert column(turned, "torque_command")[-200:].mean() > 0.1  # friction is overcome forwards
    pushed = play(drive, [Command(torque=0.6)] * 30, Mode.TORQUE)
    assert pushed[-1].position > pushed[0].position
    follow = play(drive, sine(1500, where(drive), feedforward=0.05))
    error = column(follow, "reference") - column(follow, "position")
    assert 1.2e-3 < np.abs(error[500:]).max() < 3.5e-3
    drive.close()


@pytest.mark.parametrize("cycle", [2e-3, 4e-3])
def test_longer_cycles_are_told_to_the_drive(running: Simulator, cycle: float) -> None:
    before = bus.settings(running.port)
    drive = connect(running, axis_of(cycle=cycle))
    samples = play(drive, [HOLD] * 30)
    assert np.diff(column(samples, "time")) == pytest.approx(cycle)
    drive.close()
    assert bus.settings(running.port) == before


def test_a_cycle_that_the_drive_cannot_make_is_refused(running: Simulator) -> None:
    before = bus.settings(running.port)
    with pytest.raises((ConfigurationError, TransferAborted), match="60C2h"):
        connect(running, axis_of(cycle=2.5e-4))
    assert bus.settings(running.port) == before


def test_a_generic_profile_moves_the_axis_too(running: Simulator) -> None:
    """Two PDOs, no counter, torque in thousandths: as most drives are. Real time, as nobody says lock-step."""
    drive = connect(running, profile="cia402")
    samples = play(drive, sine(300, where(drive), feedforward=0.05))
    assert np.isnan(samples[-1].temperature)
    assert column(samples, "torque_feedforward") == pytest.approx(0.05, abs=3e-4)
    total = column(samples, "torque_feedforward") + column(samples, "torque_feedback")
    assert total == pytest.approx(column(samples, "torque_command"), abs=1e-9)
    drive.close()


def hold(drive: CanopenDrive, cycles: int) -> None:
    for _ in range(cycles):
        drive.step(HOLD)


def test_the_temperature_is_known_from_the_first_cycle(running: Simulator) -> None:
    drive = connect(running)
    assert 10.0 < play(drive, [HOLD])[0].temperature < 60.0
    drive.close()


def test_the_drive_guards_us_only_while_power_is_on(running: Simulator) -> None:
    guard = ObjectRef.parse("1016:01 u32")
    drive = connect(running)
    assert drive._sdo.read(guard) == 0
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    assert drive._sdo.read(guard) == 127 << 16 | 150
    drive.disable()
    assert drive._sdo.read(guard) == 0
    drive.close()


def test_a_guard_for_another_master_is_put_back(running: Simulator) -> None:
    write(running, "1016:01 u32", 100 << 16 | 2000)
    before = bus.settings(running.port)
    drive = connect(running)
    play(drive, [HOLD] * 5)
    drive.close()
    assert bus.settings(running.port) == before
    write(running, "1016:01 u32", 0)


@pytest.mark.parametrize("held", [0, 127 << 16, 127 << 16 | 0x8096, 126 << 16 | 150, 150])
def test_without_a_guard_that_stops_the_axis_in_time_power_stays_off(
    running: Simulator, monkeypatch: pytest.MonkeyPatch, held: int
) -> None:
    """As a line without checksum garbles it, in every attempt."""
    before = bus.settings(running.port)
    drive = connect(running)
    with monkeypatch.context() as patched:
        _garble_the_guard(drive, patched, held)
        with pytest.raises(LinkError, match="would not stop in time"):
            drive.enable(Mode.POSITION)
    assert drive.powered() is False
    drive.close()
    assert bus.settings(running.port) == before


def test_a_guard_that_the_drive_rounds_is_one(running: Simulator, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = connect(running)
    with monkeypatch.context() as patched:
        _garble_the_guard(drive, patched, 127 << 16 | 152)
        assert len(play(drive, [HOLD] * 5)) == 5
    drive.close()


def _garble_the_guard(drive: CanopenDrive, patched: pytest.MonkeyPatch, held: int) -> None:
    guard, write = ObjectRef.parse("1016:01 u32"), drive._sdo.write

    def garbling(ref: ObjectRef, raw: float, timeout: float | None = None) -> None:
        ours = (ref.index, ref.sub) == (guard.index, guard.sub) and raw == 127 << 16 | 150
        write(ref, held if ours else raw, timeout)

    patched.setattr(drive._sdo, "write", garbling)


def test_in_torque_mode_alone_a_fault_takes_torque_away(running: Simulator) -> None:
    before = bus.settings(running.port)
    drive = connect(running)
    shown = {}
    for mode in (Mode.POSITION, Mode.TORQUE, Mode.POSITION, Mode.TORQUE):
        drive.enable(mode)
        drive.step(HOLD)
        shown[mode] = drive._sdo.read(FAULT_REACTION)
        drive.disable()
    drive.close()
    assert shown == {Mode.POSITION: 2, Mode.TORQUE: 0}
    assert bus.settings(running.port) == before


def test_a_fault_in_torque_mode_is_not_braked_by_the_encoder(running: Simulator) -> None:
    drive = connect(running)
    drive.enable(Mode.TORQUE)
    drive.step(HOLD)
    mark = running.mark
    running.order("drive-fault")
    with pytest.raises(DriveFault):
        hold(drive, 1000)
    drive.disable()
    drive.close()
    running.wait_for("fault", mark)
    assert not any("quick stop begun" in line for line in running.lines[mark:])
    running.order("clear")
    running.order("fault-reset")


def test_a_drive_that_always_brakes_is_left_as_it_is(
    running: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = bus.settings(running.port)
    drive = connect(running)
    write = drive._sdo.write

    def refusing(ref: ObjectRef, raw: float, timeout: float | None = None) -> None:
        if ref == FAULT_REACTION:
            raise TransferAborted("refused", 0x06090030)
        write(ref, raw, timeout)

    monkeypatch.setattr(drive._sdo, "write", refusing)
    drive.enable(Mode.TORQUE)
    drive.step(HOLD)
    drive.disable()
    drive.close()
    assert bus.settings(running.port) == before


@pytest.mark.parametrize("area", ["1010:01 u32", "1010:04 u32"])
def test_what_a_session_changes_is_never_stored(tmp_path: Path, area: str) -> None:
    profile = read_profile("autotune-sim")
    assert profile.store is not None
    store = profile.store.model_copy(update={"at": ObjectRef.parse(area)})
    axis = axis_of()
    with simulator(tmp_path, "--state", str(tmp_path / "memory")) as process:
        before = bus.settings(process.port)
        opener = CanopenOpener(
            parse_link(axis.link, tmp_path), axis, profile.model_copy(update={"store": store})
        )
        drive = opener()
        play(drive, [HOLD] * 3)
        drive.write_parameters({"feedforward.coulomb": 0.25})
        drive.store()
        play(drive, [HOLD] * 3)  # and the session goes on
        mark = process.mark
        process.order("power-loss")
        process.wait_for("boot-up", mark)
        found = bus.settings_over(drive._sdo)
        assert found == before | {"2100:04 f32": pytest.approx(0.25)}
        drive.close()


def test_a_drive_with_a_sync_counter(running: Simulator) -> None:
    write(running, "1003:00 u8", 0)
    write(running, "1019:00 u8", 10)
    drive = connect(running)
    samples = play(drive, [HOLD] * 50)
    assert column(samples, "missed").sum() == 0
    drive.close()
    write(running, "1019:00 u8", 0)
    assert errors_kept(running) == []  # a SYNC without its counter leaves 8240h


def errors_kept(running: Simulator) -> list[int]:
    """The error codes in the drive's history (1003h), the last first."""
    with bus.sdo(running.port) as client:
        count = int(client.read(ObjectRef.parse("1003:00 u8")))
        kept = [client.read(ObjectRef(0x1003, number, "u32")) for number in range(1, count + 1)]
    return [int(one) & 0xFFFF for one in kept]


def test_a_stopped_node_is_woken_and_left_as_it_was(running: Simulator) -> None:
    with bus.sdo(running.port) as client:
        client.write(ObjectRef.parse("1017:00 u16"), 50)
        client._channel._wire.send((0x000, bytes((2, 5))))
    time.sleep(0.1)
    mark = running.mark
    drive = connect(running)
    play(drive, [HOLD] * 3)
    drive.close()
    assert "STOPPED" in running.wait_for("-> STOPPED", mark)
    with bus.sdo(running.port) as client:
        client._channel._wire.send((0x000, bytes((128, 5))))
        client.write(ObjectRef.parse("1017:00 u16"), 0)


def test_an_axis_that_another_master_moves_is_left_alone(running: Simulator) -> None:
    with bus.sdo(running.port) as client:
        client.write(ObjectRef.parse("6060:00 i8"), 8)
        client._channel._wire.send((0x000, bytes((1, 5))))
        for control in (0x06, 0x07, 0x0F):
            client.write(ObjectRef.parse("6040:00 u16"), control)
    with pytest.raises(StateError, match=r"'operation enabled'.*another master.*Nothing was written"):
        connect(running)
    with bus.sdo(running.port) as client:
        assert int(client.read(bus.STATUS)) & 0x6F == 0x27  # still his
        client.write(ObjectRef.parse("6040:00 u16"), 0)


def test_an_interrupted_enable_leaves_no_power(running: Simulator, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = connect(running)
    count = 0
    cycle = drive._exchange.cycle

    def interrupted(outputs: tuple[float, ...]) -> int:
        nonlocal count
        count += 1
        if count == 4:
            raise Interrupted("now")
        return cycle(outputs)

    monkeypatch.setattr(drive._exchange, "cycle", interrupted)
    with pytest.raises(Interrupted):
        drive.enable(Mode.POSITION)
    assert int(drive._sdo.read(bus.STATUS)) & 0x6F not in (0x27, 0x07)
    drive.close()


def in_real_time(tmp_path: Path) -> Floats:
    """Rows of 400 cycles by the drive's own clock."""
    with simulator(tmp_path, "--real-time"):
        loop = open_loop(axis_of(cycle=2e-3), tmp_path)
        assert isinstance(loop, CyclicLoop)
        assert "priority" in loop.priority
        blocks: list[Floats] = []
        try:
            loop.play(Sine(400), blocks.append)
        finally:
            loop.close()
    return np.concatenate(blocks)


def test_real_time(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The drive's own clock runs: cycles wait for theirs, and what is missed is counted.

    A busy host that is late for a tenth of a second and more is stopped by the drive, and tries again.
    """
    for _ in range(3):
        began = time.monotonic()
        try:
            rows = in_real_time(tmp_path_factory.mktemp("drive"))
        except LinkError as error:
            if "this host was late" not in str(error):
                raise
        else:
            break
    else:
        pytest.skip("this host was late three times: it is too busy for a test in real time")
    assert time.monotonic() - began > 0.79
    missed = rows[:, ROW_FIELDS.index("missed")]
    steps = np.diff(rows[:, ROW_FIELDS.index("time")])
    assert steps == pytest.approx(2e-3 * (1 + missed[1:]), rel=1e-6)
    assert np.median(missed) == 0


def test_no_thread_is_needed(running: Simulator) -> None:
    """One thread does everything: nothing competes with the cycle, nothing beats on if it hangs."""
    before = threading.active_count()
    drive = connect(running)
    assert threading.active_count() == before
    drive.close()
