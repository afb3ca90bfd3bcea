"""What is plugged in here, and which drive answers on it: read only, for who writes an axis file.

Nothing is written to a drive, no node is commanded, nothing moves. A bus on which a master is at work is left
alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from serial.tools import list_ports

from autotune.core.errors import ConfigurationError
from autotune_drivers.url import SCHEMES, LinkAddress, parse_link, scheme_of

_CAN = "280"
"""Type of a CAN interface in /sys/class/net (ARPHRD_CAN)."""
_SLCAN = "canopen+slcan"
_KINDS = {"fdcanusb": "moteus+serial", "slcan": _SLCAN, "canable": _SLCAN, "cantact": _SLCAN}
_NUMBER = {"canopen+slcan": "node", "canopen+socketcan": "node", "moteus+serial": "id"}


@dataclass(frozen=True, slots=True)
class Adapter:
    """A way to drives: device or interface, what it calls itself, and the link's scheme where that says it."""

    name: str
    about: str
    scheme: str | None


@dataclass(frozen=True, slots=True)
class Seen:
    """A drive that answered.

    Attributes:
        link: with its node or id.
        identity: vendor, product, revision, serial, name, firmware.
        profiles: names of profiles that are for this drive.
        counts: what its counting says of one revolution; several where it is set up for two.
        limits: what the drive is set to now, SI and motor side, for every way to read it the same.
        motion_unit: where the kind of drive leaves no choice.
        remarks: what could not be read, and why.
    """

    link: str
    identity: Mapping[str, int | str]
    profiles: tuple[str, ...] = ()
    counts: tuple[float, ...] = ()
    limits: Mapping[str, float] = field(default_factory=dict)
    motion_unit: str | None = None
    remarks: tuple[str, ...] = ()


def adapters(network: Path = Path("/sys/class/net")) -> list[Adapter]:
    """USB serial ports and CAN interfaces of this host; nothing is opened."""
    found = []
    for port in sorted(list_ports.comports()):
        if port.vid is None:
            continue  # a serial port of the host itself is no adapter that could be known
        about = " ".join(word for word in (port.manufacturer, port.product) if word) or "a USB serial port"
        kind = next((scheme for word, scheme in _KINDS.items() if word in about.lower()), None)
        found.append(Adapter(port.device, about, kind))
    for interface in sorted(network.glob("*")) if network.is_dir() else ():
        kind_of = interface / "type"
        if kind_of.is_file() and kind_of.read_text().strip() == _CAN:
            found.append(Adapter(interface.name, "a CAN interface of this host", "canopen+socketcan"))
    return found


def look(link: str, directory: Path) -> list[Seen]:
    """The drives that answer at a link; without its node or id, all of them.

    Raises:
        ConfigurationError: the link. LinkError: no such adapter, a silent bus, or a master that is at work.
    """
    name = scheme_of(link)
    key = _NUMBER.get(name)
    if key is None:
        raise ConfigurationError(
            f"at link {link!r} there is nothing to look for; write one of {', '.join(_NUMBER)}, for example "
            f"{SCHEMES['canopen+slcan'].example.rpartition('&')[0]}"
        )
    named = key in dict(parse_qsl(urlsplit(link).query))
    bare = link if named else f"{link}{'&' if '?' in link else '?'}{key}=1"
    address = parse_link(bare, directory)
    wanted = address.options[key] if named else None
    if name == "moteus+serial":
        from autotune_drivers.moteus.survey import survey as moteus_survey

        return moteus_survey(address, wanted)
    from autotune_drivers.canopen.survey import survey

    return survey(address, wanted)


def with_number(address: LinkAddress, key: str, number: int) -> str:
    """The link's text with the node or id that answered."""
    head, _, query = address.text.partition("?")
    pairs = [(name, value) for name, value in parse_qsl(query) if name != key]
    return f"{head}?{'&'.join(f'{name}={value}' for name, value in [*pairs, (key, str(number))])}"
