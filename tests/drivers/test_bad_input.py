"""What goes wrong at a machine: a clear error each time, power off, settings as they were."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from autotune.core.drive import HOLD, Command, Mode
from autotune.core.errors import (
    AutotuneError,
    DriveFault,
    IdentityMismatch,
    LinkError,
    LinkTimeout,
    StateError,
    TransferAborted,
)
from autotune_drivers.canopen import frames
from autotune_drivers.canopen.drive import CanopenDrive
from autotune_drivers.canopen.frames import open_socketcan
from autotune_drivers.canopen.opening import CanopenOpener
from autotune_drivers.canopen.slcan import open_slcan
from autotune_drivers.profile import read_profile
from autotune_drivers.serial_device import lock_device
from autotune_drivers.url import parse_link
from tests.drivers import bus
from tests.drivers.simulator import Simulator, axis_of, simulator


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("bad")) as process:
        yield process


@pytest.fixture
def drive(running: Simulator) -> Iterator[CanopenDrive]:
    """A drive of the shared simulator; whatever a test breaks is mended afterwards."""
    before = bus.settings(running.port)
    opened = connect(running)
    yield opened
    try:
        mend(running)
    finally:
        opened.close()
    assert bus.settings(running.port) == before
    assert not bus.powered(running.port)


def connect(running: Simulator, node: int = 5, profile: str = "autotune-sim") -> CanopenDrive:
    axis = axis_of(f"canopen+slcan:edm.tty?bitrate=1000000&node={node}")
    return CanopenOpener(parse_link(axis.link, running.directory), axis, read_profile(profile))()


def mend(running: Simulator) -> None:
    """Faults out, drive reset, at the adapter again."""
    mark = running.mark
    running.order("clear")
    running.wait_for("clear", mark)
    running.order("power-loss")
    running.wait_for("boot-up", mark)


def move(drive: CanopenDrive, cycles: int, then: Callable[[], None] | None = None) -> None:
    """Turns at a moderate speed; `then` is called once the axis moves."""
    drive.enable(Mode.VELOCITY)
    try:
        for k in range(cycles):
            if k == 200 and then is not None:
                then()
            drive.step(Command(velocity=1.0 if k > 100 else 0.01 * k))
    finally:
        drive.disable()


def ramp(drive: CanopenDrive) -> None:
    """Moves away from where the axis is at 1 rad/s."""
    drive.enable(Mode.POSITION)
    try:
        start = drive.step(HOLD).position
        for k in range(2000):
            drive.step(Command(start + 1e-3 * k))
    finally:
        drive.disable()


# The port


def test_no_such_adapter(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"no CAN adapter .*check that it is plugged in"):
        open_slcan(tmp_path / "nothing.tty", 1000000)


def test_a_simulator_that_has_ended(tmp_path: Path) -> None:
    (tmp_path / "edm.tty").symlink_to(tmp_path / "gone")
    with pytest.raises(LinkError, match="the simulator has ended"):
        open_slcan(tmp_path / "edm.tty", 1000000)


def test_a_file_is_no_adapter(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(LinkError, match="is not a serial port"):
        open_slcan(tmp_path / "file", 1000000)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open everything")
def test_an_adapter_without_permission(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="may not be used"):
        open_slcan(Path("/dev/tty0"), 1000000)


def test_an_adapter_in_use(drive: CanopenDrive, running: Simulator) -> None:
    with pytest.raises(LinkError, match=r"is in use .*Stop the other program"):
        connect(running)


def test_an_adapter_that_is_let_go_a_moment_later_is_waited_for(running: Simulator) -> None:
    """The cyclic process of a run that was killed brings the axis to rest before it lets go."""
    port = running.directory / "edm.tty"
    timer = threading.Timer(0.3, os.close, (lock_device(port, "the CAN adapter"),))
    timer.start()
    ours = lock_device(port, "the CAN adapter")
    timer.join()
    with port.open("rb") as other, pytest.raises(BlockingIOError):  # it is ours, and nobody else's
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(ours)


def test_no_kernel_interface() -> None:
    with pytest.raises(LinkError, match="'none0' cannot be opened"):
        open_socketcan("none0")


def test_a_can_interface_has_one_master(monkeypatch: pytest.MonkeyPatch) -> None:
    """And it does not hear itself."""
    asked: list[dict[str, object]] = []

    class Bus:
        def __init__(self, **options: object) -> None:
            asked.append(options)

        def shutdown(self) -> None:
            return

    monkeypatch.setattr(frames.can, "Bus", Bus)
    first = open_socketcan("autotune-test0")
    with pytest.raises(LinkError, match=r"in use by another autotune"):
        open_socketcan("autotune-test0")
    first.close()
    open_socketcan("autotune-test0").close()
    assert asked[0]["receive_own_messages"] is False


def test_a_serial_port_that_is_no_can_adapter(tmp_path: Path) -> None:
    """Something is plugged in, but it never answers."""
    master, slave = pty.openpty()
    (tmp_path / "edm.tty").symlink_to(os.ttyname(slave))
    sink = threading.Thread(target=_swallow, args=(master,), daemon=True)
    sink.start()
    axis = axis_of()
    try:
        with pytest.raises(LinkTimeout, match=r"silent .*is it an slcan adapter"):
            CanopenOpener(parse_link(axis.link, tmp_path), axis, read_profile(axis.profile))()
    finally:
        os.close(slave)
        sink.join()
        os.close(master)


def _swallow(descriptor: int) -> None:
    try:
        while os.read(descriptor, 4096):
            pass
    except OSError:
        return


# The node


def test_a_wrong_node_number_names_the_right_one(running: Simulator) -> None:
    with pytest.raises(LinkTimeout, match=r"node 9 does not answer .*but node 5 does.*node=5"):
        connect(running, node=9)


def test_a_silent_node(running: Simulator) -> None:
    running.order("silent=3")
    running.wait_for("silent")
    with pytest.raises(LinkTimeout, match=r"node 5 is silent .*the adapter itself answers"):
        connect(running)
    mend(running)


def test_another_drive_than_the_profile_says(running: Simulator) -> None:
    before = bus.settings(running.port)
    running.order("other-identity=0000009A")
    running.wait_for("other-identity")
    with pytest.raises(IdentityMismatch, match=r"vendor is 0x0000009a.*Nothing was written"):
        connect(running)
    mend(running)
    assert bus.settings(running.port) == before


def test_a_generic_profile_takes_any_drive(running: Simulator) -> None:
    drive = connect(running, profile="cia402")
    assert "feedforward.coulomb" not in drive.read_parameters()
    drive.close()


# The drive


def test_a_drive_in_fault(drive: CanopenDrive, running: Simulator) -> None:
    running.order("drive-fault=2310")
    running.wait_for("fault 2310h")
    with pytest.raises(DriveFault, match=r"over-current.*2310h.*fault.*reset") as caught:
        drive.enable(Mode.POSITION)
    assert caught.value.code == 0x2310
    assert "2310h" in drive.faults()[0]


def test_a_missing_enable_input(drive: CanopenDrive, running: Simulator) -> None:
    running.order("enable-missing")
    running.wait_for("enable-missing")
    with pytest.raises((StateError, DriveFault), match="enable input"):
        drive.enable(Mode.POSITION)


def test_a_missing_brake(drive: CanopenDrive, running: Simulator) -> None:
    running.order("brake-missing")
    running.wait_for("brake-missing")
    with pytest.raises((StateError, DriveFault), match="brake is not released"):
        drive.enable(Mode.POSITION)


def test_the_enable_input_goes_in_the_middle(drive: CanopenDrive, running: Simulator) -> None:
    with pytest.raises(DriveFault, match=r"enable input.*FF10h"):
        move(drive, 20000, lambda: running.order("enable-missing"))


def test_a_following_error_in_the_middle(drive: CanopenDrive, running: Simulator) -> None:
    running.order("blocked")
    running.wait_for("blocked")
    with pytest.raises(DriveFault, match="following error") as caught:
        ramp(drive)
    assert caught.value.code == 0x8611
    assert drive.faults()


def test_a_fault_of_our_own_motion_is_acknowledged_on_closing(running: Simulator) -> None:
    """The next run can start; a fault of the hardware would stay."""
    drive = connect(running)
    running.order("blocked")
    running.wait_for("blocked")
    with pytest.raises(DriveFault):
        ramp(drive)
    mark = running.mark
    running.order("clear")
    running.wait_for("clear", mark)
    drive.close()
    again = connect(running)
    assert again.faults() == []
    again.close()


def test_an_emergency_in_the_middle(drive: CanopenDrive, running: Simulator) -> None:
    with pytest.raises(DriveFault, match="5000h"):
        move(drive, 20000, lambda: running.order("emcy=5000"))


def test_a_hot_motor(drive: CanopenDrive, running: Simulator) -> None:
    with pytest.raises(DriveFault, match="motor temperature too high"):
        move(drive, 20000, lambda: running.order("hot=200"))


def test_power_lost_in_the_middle(drive: CanopenDrive, running: Simulator) -> None:
    with pytest.raises(LinkError, match=r"restarted|did not answer"):
        move(drive, 200000, lambda: running.order("power-loss"))
    mend(running)


def test_unplugged_in_the_middle(running: Simulator) -> None:
    before = bus.settings(running.port)
    drive = connect(running)
    mark = running.mark
    with pytest.raises(LinkError, match=r"adapter .* is gone .*Plug it in"):
        move(drive, 200000, lambda: running.order("unplugged=1"))
    drive.disable()
    drive.close()  # quick and quiet: the error has been told
    running.wait_for("quick stop begun", mark)
    running.wait_for("adapter at", mark)
    # nobody could restore over a cable that is out: a session that inherits the backup does
    axis = axis_of()
    opener = CanopenOpener(parse_link(axis.link, running.directory), axis, read_profile(axis.profile))
    heir = opener(drive.backup())
    heir.close()
    assert bus.settings(running.port) == before


def test_silent_in_the_middle(drive: CanopenDrive, running: Simulator) -> None:
    with pytest.raises(LinkTimeout, match="did not answer SYNC"):
        move(drive, 200000, lambda: running.order("silent=4"))
    mend(running)


def test_a_refused_object_is_named_with_the_reason(drive: CanopenDrive, running: Simulator) -> None:
    mark = running.mark
    running.order("sdo-abort=2100:4:06090031")
    running.wait_for("sdo-abort", mark)
    before = drive.read_parameters(["controller.kp"])
    with pytest.raises(TransferAborted, match=r"feedforward\.coulomb \(2100h:04\).*too high.*06090031h") as e:
        drive.write_parameters({"controller.kp": 50.0, "feedforward.coulomb": 0.3})
    assert e.value.code == 0x06090031
    assert drive.read_parameters(["controller.kp"]) == before


def test_every_error_tells_what_to_do() -> None:
    """A message without advice helps nobody: the ones above all end in an imperative."""
    advice = re.compile(r"check|start|write|choose|reset|plug|remove", re.IGNORECASE)
    with pytest.raises(AutotuneError) as caught:
        open_slcan(Path("none.tty"), 1000000)
    assert advice.search(str(caught.value))
