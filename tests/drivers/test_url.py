"""Axis links as URLs."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError
from autotune_drivers import OPENERS
from autotune_drivers.canopen.slcan import BITRATES
from autotune_drivers.url import SCHEMES, parse_link

HERE = Path("/somewhere/axes")


def test_absolute_device() -> None:
    address = parse_link("canopen+slcan:///dev/ttyACM0?bitrate=1000000&node=5", HERE)
    assert (address.scheme, address.target) == ("canopen+slcan", "/dev/ttyACM0")
    assert address.options == {"bitrate": 1000000, "node": 5}


def test_relative_device_is_beside_the_axis_file() -> None:
    assert (
        parse_link("canopen+slcan:x/edm.tty?bitrate=500000&node=1", HERE).target
        == "/somewhere/axes/x/edm.tty"
    )


def test_interface() -> None:
    address = parse_link("canopen+socketcan://can0?node=127", HERE)
    assert (address.target, address.options) == ("can0", {"node": 127})


@pytest.mark.parametrize(
    ("link", "says"),
    [
        ("canopen+slcam:///dev/x?bitrate=1000000&node=5", "did you mean 'canopen+slcan'"),
        ("", "unknown scheme"),
        ("can0", "unknown scheme"),
        ("canopen+slcan:///dev/x?bitrate=1000000&nod=5", "did you mean 'node'"),
        ("canopen+slcan:///dev/x?node=5", "does not say bitrate"),
        ("canopen+slcan:///dev/x", "does not say bitrate and node"),
        ("canopen+slcan:///dev/x?bitrate=1000001&node=5", "bitrate is 1000001; allowed is 10000, "),
        ("canopen+slcan:///dev/x?bitrate=1000000&node=0", "node is 0; allowed is 1 to 127"),
        ("canopen+slcan:///dev/x?bitrate=1000000&node=128", "node is 128"),
        ("canopen+slcan:///dev/x?bitrate=1000000&node=five", "must be a whole number"),
        ("canopen+slcan:///dev/x?bitrate=1000000&node=", "must be a whole number"),
        ("canopen+slcan:///dev/x?bitrate=1000000&node=5&node=6", "twice"),
        ("canopen+slcan://dev/x?bitrate=1000000&node=5", "write three"),
        ("canopen+slcan:?bitrate=1000000&node=5", "does not name what to open"),
        ("canopen+slcan:///dev/x?bitrate=1000000&node=5#1", "'#'"),
        ("canopen+socketcan://?node=5", "does not name what to open"),
        ("canopen+socketcan://can0/x?node=5", "does not name what to open"),
        ("canopen+socketcan://can0?node=5&bitrate=1000000", "unknown option 'bitrate'"),
        ("canopen+socketcan://[can0?node=5", "is not a URL"),
    ],
)
def test_mistakes_are_named(link: str, says: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse_link(link, HERE)
    assert says in str(caught.value)


def test_examples_are_right_and_every_scheme_has_an_opener() -> None:
    assert set(SCHEMES) == {*OPENERS, "replay"}  # a recording needs no process of its own
    for name, scheme in SCHEMES.items():
        assert parse_link(scheme.example, HERE).scheme == name


def test_bit_rates_are_those_of_the_adapter_protocol() -> None:
    assert SCHEMES["canopen+slcan"].options["bitrate"].choices == BITRATES


@given(st.text(max_size=60))
def test_any_text_is_parsed_or_refused_in_words(text: str) -> None:
    for link in (text, "canopen+slcan:" + text, "canopen+socketcan://" + text):
        try:
            target = parse_link(link, HERE).target
        except ConfigurationError as error:
            target = str(error)
        assert target


@given(st.integers(1, 127), st.sampled_from(BITRATES))
def test_addresses_travel_between_processes(node: int, bitrate: int) -> None:
    address = parse_link(f"canopen+slcan:a.tty?bitrate={bitrate}&node={node}", HERE)
    assert pickle.loads(pickle.dumps(address)) == address
    assert address.options == {"bitrate": bitrate, "node": node}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("canopen+socketcan://can0?node=5", "canopen+socketcan://can0/?node=05"),
        ("canopen+slcan:a.tty?bitrate=500000&node=5", "canopen+slcan:x/../a.tty?node=005&bitrate=500000"),
        ("canopen+slcan:a.tty?bitrate=500000&node=5", "CANopen+slcan:///somewhere/axes/./a.tty?bitrate=1000000&node=5"),
        ("moteus+serial:a.tty?id=1", "moteus+serial:a.tty?id=01&baud=115200"),
    ],
)  # fmt: skip
def test_a_drive_has_one_place_however_it_is_written(one: str, other: str) -> None:
    first, second = parse_link(one, HERE), parse_link(other, HERE)
    assert first.place == second.place
    assert first.bus == second.bus


def test_drives_of_one_bus_have_places_of_their_own() -> None:
    five, six = (parse_link(f"canopen+socketcan://can0?node={node}", HERE) for node in (5, 6))
    assert five.bus == six.bus
    assert five.place != six.place
    assert parse_link("canopen+socketcan://can1?node=5", HERE).bus != five.bus


@pytest.mark.parametrize(
    "text", ["canopen+slcan:///dev/tty%00?bitrate=1000000&node=5", "replay:a\x1b[31m.csv"]
)
def test_a_device_is_a_name_that_can_be_printed(text: str) -> None:
    with pytest.raises(ConfigurationError, match="no name has"):
        parse_link(text, HERE)
