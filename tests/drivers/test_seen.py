"""What is found on a wire: reading alone, with a bus of others left alone."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from autotune.core.errors import ConfigurationError, LinkError, StateError
from autotune_drivers.canopen import survey as canopen_survey
from autotune_drivers.canopen.survey import survey_over
from autotune_drivers.seen import adapters, look
from autotune_drivers.url import parse_link
from tests.drivers.bus import settings
from tests.drivers.fake_node import FakeNode
from tests.drivers.moteus_rig import settings as moteus_settings
from tests.drivers.simulator import simulator

LINK = "canopen+slcan:edm.tty?bitrate=1000000"


def word(value: int) -> bytes:
    return struct.pack("<I", value)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(canopen_survey, "LISTEN", 0.02)


def node(number: int = 5) -> FakeNode:
    objects = {
        (0x1000, 0): word(0x20192), (0x1018, 1): word(0xFB), (0x1018, 2): word(0x60500000),
        (0x1018, 3): word(0x01700000), (0x1018, 4): word(7), (0x608F, 1): word(4096), (0x608F, 2): word(1),
    }  # fmt: skip
    return FakeNode(objects, number)


def test_only_uploads_are_sent(tmp_path: Path) -> None:
    """No NMT command, no SYNC, no download, no process data: SDO requests to read, and nothing else."""
    link = node()
    address = parse_link(f"{LINK}&node=1", tmp_path)
    (seen,) = survey_over(link, address, None)
    assert seen.identity["vendor"] == 0xFB
    assert seen.profiles == ("maxon-epos4",)
    assert seen.counts == (4096.0,)
    assert seen.link == "canopen+slcan:edm.tty?bitrate=1000000&node=5"
    assert not link.writes
    commands = {(identifier & 0x780, data[0] >> 5) for identifier, data in link.sent}
    assert commands <= {(0x600, 2), (0x600, 3), (0x600, 4)}  # upload, its segments, abort


def test_where_a_master_is_at_work_nothing_is_asked(tmp_path: Path) -> None:
    link = node()
    link.reply((0x80, b""), (0x205, b"\0" * 8))
    with pytest.raises(StateError, match="a master is at work"):
        survey_over(link, parse_link(f"{LINK}&node=1", tmp_path), None)
    assert not link.sent


def test_silence_is_said(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="node 9 does not answer"):
        survey_over(node(), parse_link(f"{LINK}&node=9", tmp_path), 9)


def test_a_drive_that_no_profile_knows_says_what_it_is(tmp_path: Path) -> None:
    link = node()
    link.objects[0x1018, 1] = word(0x1234)
    (seen,) = survey_over(link, parse_link(f"{LINK}&node=1", tmp_path), None)
    assert seen.profiles == ()
    assert not seen.limits


@pytest.mark.parametrize("link", ["sim://edm-vertical", "replay:x.parquet", "canopen+slcam:edm.tty"])
def test_where_nothing_can_be_looked_for_this_is_said(link: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError):
        look(link, tmp_path)


def test_can_interfaces_are_known_by_their_type(tmp_path: Path) -> None:
    for name, kind in (("can0", "280"), ("eth0", "1")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(kind + "\n")
    found = [one for one in adapters(tmp_path) if one.scheme == "canopen+socketcan"]
    assert [one.name for one in found] == ["can0"]


def test_the_simulated_drive_tells_what_it_is_and_is_as_it_was(tmp_path: Path) -> None:
    with simulator(tmp_path) as running:
        before, mark = settings(running.port), running.mark
        (seen,) = look(LINK, tmp_path)
        assert settings(running.port) == before
        said = running.lines[mark:]
    assert seen.identity["name"] == "autotune-sim"
    assert "autotune-sim" in seen.profiles
    assert seen.counts == (50000.0,)
    assert seen.limits["limit.position_max"] == pytest.approx(25.0, abs=1e-3)
    assert seen.limits["limit.speed"] == pytest.approx(50.0, rel=1e-3)
    assert not [line for line in said if "state" in line or "NMT" in line]


@pytest.mark.long
def test_the_simulated_moteus_tells_what_it_is(tmp_path: Path) -> None:
    with simulator(tmp_path, "--link", "moteus", "--node", "1"):
        before = moteus_settings(tmp_path)
        (seen,) = look("moteus+serial:edm.tty", tmp_path)
        assert moteus_settings(tmp_path) == before
    assert seen.profiles == ("autotune-sim-moteus",)
    assert seen.motion_unit == "rad"
    assert seen.limits["limit.speed"] > 0.0
    assert seen.link.endswith("edm.tty?id=1")
