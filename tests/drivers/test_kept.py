"""What a session has changed is on disk first: whoever dies, the next session on that drive puts it back."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from autotune.core.errors import ConfigurationError, LinkError
from autotune_drivers import open_loop
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.pdo import RPDO, TPDO, setting
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.session import Session
from autotune_drivers.canopen.wire import Wire
from autotune_drivers.cyclic.loop import CyclicLoop
from autotune_drivers.kept import Keeper
from autotune_drivers.left import put_right
from tests.drivers import bus
from tests.drivers.fake_node import FakeNode
from tests.drivers.simulator import Simulator, axis_of, simulator
from tests.drivers.test_cyclic import wait_for
from tests.drivers.test_setting_up import CONTROL, STATUS, TARGET, pdo_objects

MODE = ObjectRef(0x6060, 0, "i8", "mode of operation")
HEARTBEAT = ObjectRef(0x1017, 0, "u16", "producer heartbeat time")
WHO = {"vendor": 1, "product": 2, "serial": 1000}


class Dead(BaseException):
    """The process dies here."""


class Master:
    """A session on a node in memory, whose process dies at the transfer numbered `cut`."""

    def __init__(self, folder: Path, cut: int = 1 << 30, who: dict[str, int] | None = None) -> None:
        self.node = FakeNode(
            pdo_objects(RPDO, 0, 0x205, [0x60400010])
            | pdo_objects(TPDO, 0, 0x40000185, [0x60410010])
            | {(0x6060, 0): b"\x08", (0x1017, 0): b"\xf4\x01"}
        )
        self.keeper = Keeper.of(folder, who or WHO)
        self.cut, self.transfers = cut, 0
        self.flipped: int | None = None  # this transfer arrives as another value

    def connect(self) -> tuple[Node, Sdo]:
        wire = Wire(self.node, 127, 0.05)
        sdo = Sdo(wire, 5)
        write = sdo.write

        def counted(ref: ObjectRef, raw: float, timeout: float | None = None) -> None:
            self.transfers += 1
            if self.transfers > self.cut:
                raise Dead
            write(ref, int(raw) ^ 0x30 if self.transfers == self.flipped else raw, timeout)

        sdo.write = counted  # type: ignore[method-assign]
        return Node(wire, 5), sdo

    def work(self) -> None:
        """What a session does: a heartbeat, a mode, two PDOs, another mode with its PDO."""
        _, sdo = self.connect()
        session = Session(sdo, None, self.keeper)
        session.write(HEARTBEAT, 100)
        session.write(MODE, 9)
        session.map(setting(RPDO, 0, 5, 1, [CONTROL, TARGET]))
        session.map(setting(TPDO, 0, 5, 1, [STATUS]))
        session.write(MODE, 10)
        session.map(setting(RPDO, 0, 5, 1, [CONTROL]))
        assert session.restore() == []

    def put_right(self) -> tuple[str, ...]:
        return put_right(*self.connect(), self.keeper)

    def settings(self) -> dict[tuple[int, int], bytes]:
        """All objects; entries beyond the number in sub-index 0 mean nothing."""
        return {key: data for key, data in self.node.objects.items() if key != (0x1600, 2)}


def transfers(folder: Path) -> int:
    master = Master(folder)
    master.work()
    return master.transfers


def test_a_value_that_arrives_as_another_does_not_stay(tmp_path: Path) -> None:
    for flipped in range(1, transfers(tmp_path) + 1):
        master = Master(tmp_path / str(flipped))
        before, master.flipped = master.settings(), flipped
        with suppress(LinkError):  # the node may refuse it
            master.work()
        master.flipped = None
        if master.settings() != before:
            master.put_right()
        assert master.settings() == before, f"flipped at transfer {flipped}"


def test_a_session_that_dies_after_such_a_value_is_put_right_by_the_next(tmp_path: Path) -> None:
    master = Master(tmp_path)
    before, master.flipped, master.cut = master.settings(), 1, 1
    with pytest.raises(Dead):
        master.work()
    assert master.settings() != before
    master.cut = 1 << 30
    assert any("put back" in sentence for sentence in master.put_right())
    assert master.settings() == before


def test_a_session_cut_at_any_transfer_is_put_right_by_the_next(tmp_path: Path) -> None:
    whole = transfers(tmp_path)
    assert whole > 30
    changed = 0
    for cut in range(whole):
        master = Master(tmp_path / str(cut), cut)
        before = master.settings()
        with pytest.raises(Dead):
            master.work()
        changed += master.settings() != before
        master.cut = 1 << 30
        told = master.put_right()
        assert master.settings() == before, f"cut at transfer {cut}"
        assert all("put back" in sentence for sentence in told)
        assert not master.keeper.path.exists()
    assert changed > whole / 2  # the cuts do leave something: the test can fail


def test_putting_right_may_be_cut_at_any_transfer_too(tmp_path: Path) -> None:
    whole = transfers(tmp_path)
    for cut in range(whole + 12):
        master = Master(tmp_path / str(cut), whole // 2)
        before = master.settings()
        with pytest.raises(Dead):
            master.work()
        master.cut = master.transfers + cut
        try:
            master.put_right()
        except Dead:
            master.cut = 1 << 30
            master.put_right()
        assert master.settings() == before, f"cut at transfer {cut}"


def test_a_session_that_ends_well_leaves_no_file(tmp_path: Path) -> None:
    master = Master(tmp_path)
    master.work()
    assert list(tmp_path.iterdir()) == []
    assert master.put_right() == ()


def test_what_somebody_has_set_since_is_left_alone_and_said(tmp_path: Path) -> None:
    master = Master(tmp_path, cut=9)
    with pytest.raises(Dead):
        master.work()
    master.cut = 1 << 30
    master.node.objects[0x1017, 0] = b"\xe8\x03"
    told = master.put_right()
    assert master.node.objects[0x1017, 0] == b"\xe8\x03"
    assert master.node.objects[0x6060, 0] == b"\x08"
    assert any("producer heartbeat time (1017h:00)" in one and "left as they are" in one for one in told)


def test_another_drive_is_left_alone_and_told_of(tmp_path: Path) -> None:
    first = Master(tmp_path, cut=9)
    with pytest.raises(Dead):
        first.work()
    second = Master(tmp_path, who={**WHO, "serial": 1007})
    second.node.objects[0x6060, 0] = b"\x09"  # as if the first session had been on it
    before = second.settings()
    (told,) = second.put_right()
    assert second.settings() == before
    assert "another drive of this axis" in told
    assert str(first.keeper.path) in told
    first.cut = 1 << 30
    assert "put back" in first.put_right()[0]


def test_a_node_that_refuses_keeps_the_file_open(tmp_path: Path) -> None:
    master = Master(tmp_path, cut=9)
    with pytest.raises(Dead):
        master.work()
    master.cut = 1 << 30
    master.node.refuse[0x6060, 0, "write"] = 0x08000022
    with pytest.raises(LinkError, match=r"mode of operation \(6060h:00\) could not be set back"):
        master.put_right()
    assert master.keeper.path.exists()


@pytest.mark.parametrize("damage", ["", "{}", "[]", '{"schema": 1}'])
def test_a_damaged_file_is_told_and_nothing_is_written(tmp_path: Path, damage: str) -> None:
    master = Master(tmp_path, cut=9)
    with pytest.raises(Dead):
        master.work()
    master.cut, writes = 1 << 30, len(master.node.writes)
    master.keeper.path.write_text(damage)
    with pytest.raises(ConfigurationError, match="Switch the drive off and on"):
        master.put_right()
    assert len(master.node.writes) == writes


def test_what_cannot_be_noted_is_not_changed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    master = Master(tmp_path / "file" / "folder")
    with pytest.raises(ConfigurationError, match="what cannot be noted is not changed"):
        master.work()
    assert master.node.writes == []


# On the wire


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Simulator]:
    with simulator(tmp_path) as process:
        yield process


def test_killed_owner_and_cyclic_process(running: Simulator, tmp_path: Path) -> None:
    """kill -9 of both: the next session restores what the drive had before the first."""
    before = bus.settings(running.port)
    keep = tmp_path / "sessions"
    owner = subprocess.Popen(
        [sys.executable, "-m", "tests.drivers.owner", str(running.directory), str(keep)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        stdout=subprocess.PIPE,
    )
    with owner:
        witness = running.directory / "witness"
        wait_for(lambda: witness.exists() and witness.read_text() == "moving")
        children = Path(f"/proc/{owner.pid}/task/{owner.pid}/children").read_text().split()
        mark = running.mark
        for process in (*map(int, children), owner.pid):
            os.kill(process, signal.SIGKILL)
    running.wait_for("at rest", mark)
    left = bus.settings(running.port)
    for text in ("1016:01 u32", "1017:00 u16", "6007:00 i16", "1400:2"):
        assert left[text] != before[text], text  # the kill does leave something: the test can fail
    loop = open_loop(axis_of(), running.directory, keep=keep)
    assert isinstance(loop, CyclicLoop)
    assert "put back" in loop.left[0]
    loop.close()
    assert bus.settings(running.port) == before
    assert list(keep.iterdir()) == []


def test_the_file_says_what_it_is_of(running: Simulator, tmp_path: Path) -> None:
    keep = tmp_path / "sessions"
    loop = open_loop(axis_of(), running.directory, keep=keep)
    (path,) = keep.iterdir()
    content = json.loads(path.read_text())
    assert {name: loop.identity[name] for name in content["identity"]} == content["identity"]
    assert "1017:00 u16" in [one["object"] for one in content["objects"]]
    loop.close()
    assert list(keep.iterdir()) == []
