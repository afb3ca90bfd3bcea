"""The link that the port is found by."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from autotune.core.errors import ConfigurationError
from autotune_sim.pty_port import PtyPort


def test_bytes_go_both_ways_and_the_link_goes_with_the_port(tmp_path: Path) -> None:
    path = tmp_path / "a.tty"
    port = PtyPort(path)
    port.plug()
    try:
        host = os.open(path, os.O_RDWR | os.O_NOCTTY)
        os.write(host, b"V\r\n\x03\xff")
        assert port.read() == b"V\r\n\x03\xff"
        assert port.read() == b""
        data = bytearray(b"F00\r\x04")
        port.write(data)
        assert not data
        assert os.read(host, 100) == b"F00\r\x04"
        os.close(host)
    finally:
        port.unplug()
    assert not path.is_symlink()
    port.unplug()


def test_a_full_buffer_keeps_the_rest(tmp_path: Path) -> None:
    port = PtyPort(tmp_path / "a.tty")
    port.plug()
    try:
        data = bytearray(200_000)
        port.write(data)
        port.write(data)
        assert 100_000 < len(data) < 200_000
    finally:
        port.unplug()


def test_a_stale_link_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.tty"
    path.symlink_to("/dev/pts/99999")
    port = PtyPort(path)
    port.plug()
    assert path.readlink() == Path(port.device)
    port.unplug()


@pytest.mark.parametrize("kind", ["file", "folder", "link"])
def test_what_is_not_ours_is_left_alone(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.tty"
    if kind == "file":
        path.write_text("mine")
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/null")
    with pytest.raises(ConfigurationError, match="choose another path"):
        PtyPort(path).plug()
    assert path.exists()


def test_two_at_one_path(tmp_path: Path) -> None:
    first, second = PtyPort(tmp_path / "a.tty"), PtyPort(tmp_path / "a.tty")
    first.plug()
    with pytest.raises(ConfigurationError, match="already serves"):
        second.plug()
    assert first.path.readlink() == Path(first.device)
    first.unplug()
    second.plug()
    second.unplug()


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no folder"):
        PtyPort(tmp_path / "missing" / "a.tty").plug()


def test_a_link_that_somebody_else_has_set_since_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.tty"
    port = PtyPort(path)
    port.plug()
    path.unlink()
    path.write_text("theirs")
    port.unplug()
    assert path.read_text() == "theirs"
