"""One owner a link: the lock goes with the process, is the same for every way of writing a link, and trusts nobody."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError
from autotune.core.text import clean, clean_line
from autotune.service import lock_file
from autotune.service.daemon import Owners
from autotune.service.lock_file import Lock, lock_folder
from autotune.service.ownership import key_of, owner_of, take
from tests.service.conftest import write_axis

CAN = "can:can0"
BUS_KEYS = [
    "canopen+socketcan://can0?node=5", "canopen+socketcan://can0/?node=5", "canopen+socketcan://can0?node=05",
    "CANOPEN+socketcan://can0?node=5",
]  # fmt: skip


def lock_of(bus: str, take_it: Callable[..., Lock] = take) -> Path:
    """Where the lock of a bus is."""
    take_it(bus, "one", "test").release()
    before = set(lock_folder().iterdir())
    held = take_it(bus, "one", "test")
    (path,) = set(lock_folder().iterdir()) - before
    held.release()
    return path


def test_a_link_has_one_owner_and_the_lock_goes_with_the_process(tmp_path: Path) -> None:
    code = (
        "import sys; from autotune.service.ownership import take\n"
        f"held = take({CAN!r}, 'one', 'autotune serve')\n"
        "print('held', flush=True); sys.stdin.read()"
    )
    other = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert other.stdout is not None
    assert other.stdout.readline() == b"held\n"
    axis = read_axis(write_axis(tmp_path, "one", BUS_KEYS[0]))
    holder = owner_of(key_of(axis, tmp_path / "one.toml"))
    assert holder is not None
    assert (holder.process, holder.what) == (other.pid, "autotune serve")
    with pytest.raises(
        ConfigurationError, match=rf"held by autotune serve \(process {other.pid}.*SYNC on can0"
    ):
        take(CAN, "two", "autotune run")
    other.kill()
    other.communicate()
    assert owner_of(key_of(axis, tmp_path / "one.toml")) is None
    take(CAN, "one", "autotune run").release()


@pytest.mark.parametrize("link", BUS_KEYS)
def test_the_same_drive_has_one_key_however_its_link_is_written(tmp_path: Path, link: str) -> None:
    keys = [
        key_of(read_axis(write_axis(tmp_path, "one", one)), tmp_path / "one.toml")
        for one in (link, BUS_KEYS[0])
    ]
    assert keys[0] == keys[1]
    assert keys[0].bus == CAN


def test_the_same_device_has_one_key_however_its_path_is_written(tmp_path: Path) -> None:
    links = (
        "canopen+slcan:x/../a.tty?bitrate=1000000&node=5", f"canopen+slcan://{tmp_path}/a.tty?node=05&bitrate=500000",
    )  # fmt: skip
    keys = [key_of(read_axis(write_axis(tmp_path, "one", one)), tmp_path / "one.toml") for one in links]
    assert keys[0] == keys[1]


def test_two_nodes_of_one_can_interface_are_one_link(tmp_path: Path) -> None:
    """Two programs there would both send SYNC; one program takes the axes in turn."""
    links = [f"canopen+socketcan://can0?node={node}" for node in (5, 6)]
    keys = [key_of(read_axis(write_axis(tmp_path, "one", one)), tmp_path / "one.toml") for one in links]
    assert keys[0].drive != keys[1].drive
    assert keys[0].bus == keys[1].bus


def test_a_service_holds_a_link_of_several_axes_once_and_lets_it_go(world: Callable[..., Any]) -> None:
    here = world(["one", "two"])
    for name in ("one", "two"):
        write_axis(here.folder, name, f"canopen+socketcan://can0?node={5 + (name == 'two')}")
    here.close()
    here.open()
    owners = Owners()
    owners.ensure(here.configuration, set())
    assert owners.holds("one")
    assert owners.holds("two")
    with pytest.raises(ConfigurationError, match="held by autotune serve"):
        take(CAN, "three", "autotune run")
    owners.release()
    take(CAN, "three", "autotune run").release()


def test_a_note_of_somebody_elses_process_is_not_believed() -> None:
    path = lock_of(CAN)
    held = Lock.take(path, "autotune run")
    path.write_text(json.dumps({"process": 1, "what": "autotune serve", "address": "http://10.0.0.1"}))
    with pytest.raises(ConfigurationError, match=rf"another program \(process {os.getpid()}"):
        take(CAN, "one", "autotune run")
    path.chmod(0o666)
    path.write_text(json.dumps({"process": os.getpid(), "what": "whatever others write"}))
    with pytest.raises(ConfigurationError, match="another program"):
        take(CAN, "one", "autotune run")
    held.release()


@pytest.mark.parametrize("kind", ["symlink", "hard link", "pipe"])
def test_what_is_not_a_plain_file_is_no_lock_and_is_not_touched(tmp_path: Path, kind: str) -> None:
    path = lock_of(CAN)
    target = tmp_path / "precious"
    target.write_text("precious")
    if kind == "symlink":
        path.symlink_to(target)
    elif kind == "hard link":
        os.link(target, path)
    else:
        os.mkfifo(path)
    take(CAN, "one", "autotune run").release()
    assert target.read_text() == "precious"


def test_a_folder_in_the_place_of_a_lock_is_named_with_what_to_do() -> None:
    path = lock_of(CAN)
    path.mkdir()
    with pytest.raises(ConfigurationError, match=r"Remove it as root .* folder of their own"):
        take(CAN, "one", "autotune run")


def test_a_lock_that_was_removed_under_its_holder_is_not_taken_for_held(tmp_path: Path) -> None:
    """What is locked must be what the next program finds: a name that was exchanged is noticed."""
    path = lock_of(CAN)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    path.unlink()
    held = take(CAN, "one", "autotune run")
    assert path.stat().st_ino != os.fstat(descriptor).st_ino
    held.release()
    os.close(descriptor)


def test_a_folder_in_which_all_can_exchange_files_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    monkeypatch.setenv("AUTOTUNE_LOCKS", str(tmp_path / "open"))
    with pytest.raises(ConfigurationError, match="make it sticky"):
        take(CAN, "one", "autotune run")


def test_the_locks_own_folder_counts_and_who_began_before_it_was_there_still_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("AUTOTUNE_LOCKS")
    monkeypatch.setattr(lock_file, "OWN_FOLDER", tmp_path / "own")
    monkeypatch.setattr(lock_file, "SHARED", tmp_path / "shared")
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o1777)
    assert lock_folder() == tmp_path / "shared"
    early = take(CAN, "one", "autotune run")
    (tmp_path / "own").mkdir()
    (tmp_path / "own").chmod(0o770)
    assert lock_folder() == tmp_path / "own"
    with pytest.raises(ConfigurationError, match="held by autotune run"):
        take(CAN, "one", "autotune serve")
    early.release()
    held = take(CAN, "one", "autotune serve")
    assert len(list((tmp_path / "own").iterdir())) == 1
    held.release()
    assert list((tmp_path / "own").iterdir()) == []


def test_text_of_others_loses_what_moves_a_terminal() -> None:
    assert clean("a\x1b[2J\x07b\tc\nd\u202e\x9b31m") == "a\ufffd[2J\ufffdb\tc\nd\ufffd\ufffd31m"
    assert clean_line("  a\n\tb " + "x" * 300, 10) == "a b xxxxx…"
    assert clean("Grüße, 95 °C ± 2 µm → ok") == "Grüße, 95 °C ± 2 µm → ok"
