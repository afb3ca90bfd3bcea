"""Axis links as URLs: what is reached, how, and with which options.

canopen+slcan:///dev/ttyACM0?bitrate=1000000&node=5     an absolute device
canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5   relative to the axis file
canopen+socketcan://can0?node=5                         a kernel interface
moteus+serial:///dev/fdcanusb?id=1                      an fdcanusb, or a moteus's own serial line
moteus+serial:edm-vertical-moteus.tty?id=1&baud=921600  relative to the axis file, with the line's speed
replay:recording.parquet                                a recording, relative to the axis file
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from urllib.parse import parse_qsl, unquote, urlsplit

from autotune.core.errors import ConfigurationError

LONGEST = 1000
_SLCAN_BITRATES = (10000, 20000, 50000, 83300, 100000, 125000, 250000, 500000, 750000, 1000000)


@dataclass(frozen=True, slots=True)
class Option:
    """An integer option: its range, or the only values that it may have; what it is where left out."""

    low: int = 0
    high: int = 0
    choices: tuple[int, ...] = ()
    default: int | None = None

    @property
    def allowed(self) -> str:
        return ", ".join(map(str, self.choices)) if self.choices else f"{self.low} to {self.high}"

    def __contains__(self, value: int) -> bool:
        return value in self.choices if self.choices else self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Scheme:
    """How a scheme's URLs look: a device path or an interface name, and the options it needs."""

    is_path: bool
    options: Mapping[str, Option]
    example: str


SCHEMES: Mapping[str, Scheme] = MappingProxyType(
    {
        "canopen+slcan": Scheme(
            True,
            {"bitrate": Option(choices=_SLCAN_BITRATES), "node": Option(1, 127)},
            "canopen+slcan:///dev/ttyACM0?bitrate=1000000&node=5",
        ),
        "moteus+serial": Scheme(
            True,
            {"id": Option(1, 126), "baud": Option(9600, 12_000_000, default=921600)},
            "moteus+serial:///dev/fdcanusb?id=1",
        ),
        "replay": Scheme(True, {}, "replay:recording.parquet"),
        "canopen+socketcan": Scheme(False, {"node": Option(1, 127)}, "canopen+socketcan://can0?node=5"),
    }
)


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """A parsed link. `target` is an absolute device path or an interface name."""

    scheme: str
    target: str
    options: Mapping[str, int]
    text: str

    @property
    def bus(self) -> str:
        """What one program at a time can have, the same for every way of writing it.

        A device below /dev is named by what it is (by-id and ttyACM0 are one); others may be links that move.
        """
        if not SCHEMES[self.scheme].is_path:
            return f"{self.scheme}:{self.target}"
        device = os.path.abspath(self.target)
        return f"{self.scheme}:{os.path.realpath(device) if device.startswith('/dev/') else device}"

    @property
    def place(self) -> str:
        """The drive: which node on which bus, the same for every way of writing it."""
        return f"{self.bus}#{self.options.get('node', self.options.get('id', ''))}"


def scheme_of(link: str, known: Mapping[str, object] = SCHEMES) -> str:
    """The scheme of a link.

    Raises:
        ConfigurationError: there is none, or it is not among `known`; the nearest one is named.
    """
    scheme = link.partition(":")[0].lower()
    if scheme in known:
        return scheme
    near = difflib.get_close_matches(scheme, known, 1, cutoff=0.4)
    hint = f"did you mean {near[0]!r}" if near else f"known are {', '.join(sorted(known))}"
    raise ConfigurationError(f"link {link!r} has the unknown scheme {scheme!r}; {hint}?")


def parse_link(link: str, directory: Path) -> LinkAddress:
    """Parses a link; a path without a leading slash is relative to `directory`.

    Raises:
        ConfigurationError: unknown scheme or option (with the nearest right one), a missing option, a
            value out of range, no device.
    """
    if len(link) > LONGEST:
        raise ConfigurationError(
            f"link {link[:60]!r}… has {len(link)} characters; at most {LONGEST} are allowed"
        )
    name = scheme_of(link)
    scheme = SCHEMES[name]
    try:
        parts = urlsplit(link)
    except ValueError as error:
        raise ConfigurationError(f"link {link!r} is not a URL: {error}; write {scheme.example}") from error
    if parts.fragment or "#" in link:
        raise ConfigurationError(f"link {link!r} contains '#', which a link cannot; write {scheme.example}")
    target = _device(link, parts.netloc, parts.path, directory) if scheme.is_path else parts.netloc
    if not target.isprintable():
        raise ConfigurationError(
            f"link {link!r} has characters in its device that no name has; write {scheme.example}"
        )
    if not target or (not scheme.is_path and parts.path.strip("/")):
        raise ConfigurationError(f"link {link!r} does not name what to open; write {scheme.example}")
    return LinkAddress(name, target, _options(link, parts.query, scheme), link)


def _device(link: str, host: str, path: str, directory: Path) -> str:
    if host:
        raise ConfigurationError(
            f"link {link!r} has two slashes before its path; write three for an absolute path "
            f"(…:///{host}{path}) or none for one relative to the axis file (…:{host}{path})"
        )
    path = unquote(path)
    return str(directory.absolute() / path) if path else ""


def _options(link: str, query: str, scheme: Scheme) -> Mapping[str, int]:
    found: dict[str, int] = {}
    for key, text in parse_qsl(query, keep_blank_values=True):
        _check_key(link, key, scheme, key in found)
        try:
            found[key] = int(text)
        except ValueError:
            raise ConfigurationError(
                f"link {link!r}: {key} is {text!r}; it must be a whole number, {scheme.options[key].allowed}"
            ) from None
        if found[key] not in scheme.options[key]:
            raise ConfigurationError(
                f"link {link!r}: {key} is {found[key]}; allowed is {scheme.options[key].allowed}"
            )
    defaults = {key: option.default for key, option in scheme.options.items() if option.default is not None}
    found = defaults | found
    missing = [key for key in scheme.options if key not in found]
    if missing:
        raise ConfigurationError(
            f"link {link!r} does not say {' and '.join(missing)}; write for example {scheme.example}"
        )
    return found


def _check_key(link: str, key: str, scheme: Scheme, seen: bool) -> None:
    if seen:
        raise ConfigurationError(f"link {link!r} says {key!r} twice; leave one of them out")
    if key not in scheme.options:
        near = difflib.get_close_matches(key, scheme.options, 1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(scheme.options)}"
        raise ConfigurationError(f"link {link!r}: unknown option {key!r}; {hint}")
