"""Which moteus controllers answer on a line, and what they say of themselves: registers and `conf get` only."""

from __future__ import annotations

import math
from pathlib import Path

from autotune.core.errors import ConfigurationError, LinkError, LinkTimeout, TransferAborted
from autotune.core.paths import config_directory
from autotune_drivers.moteus.console import Console
from autotune_drivers.moteus.node import MoteusNode
from autotune_drivers.moteus.opening import identify
from autotune_drivers.moteus.port import MoteusPort, open_port
from autotune_drivers.moteus.profile import UNITS, MoteusProfile, read_moteus_profile
from autotune_drivers.seen import Seen, with_number
from autotune_drivers.url import LinkAddress


def survey(address: LinkAddress, wanted: int | None) -> list[Seen]:
    """What answers there; `wanted`: only this id.

    Raises:
        LinkError: no such port, or nobody answers.
    """
    port = open_port(Path(address.target), address.options["baud"])
    try:
        numbers = [wanted] if wanted is not None else _answering(port)
        return [_seen(port, address, number) for number in numbers]
    finally:
        port.close()


def _answering(port: MoteusPort) -> list[int]:
    """Ids that answer; id 1, which they have from the factory, is greeted first: the line may want checksums."""
    first = MoteusNode(port, 1)
    try:
        first.greet()
        own = {1}
    except LinkTimeout as error:
        if not port.reader.understood:
            raise
        own, silence = set(), error
    found = sorted(own | first.others())
    if not found:
        raise silence
    return found


def _seen(port: MoteusPort, address: LinkAddress, number: int) -> Seen:
    node = MoteusNode(port, number)
    node.greet()
    profiles = _profiles()
    identity = dict(identify(node, profiles[0]))
    fitting = [one for one in profiles if _is_for(identity, one)]
    identity |= {"vendor": fitting[0].vendor, "name": fitting[0].title} if fitting else {"name": "moteus"}
    limits = _limits(Console(node), fitting[0]) if fitting else {}
    return Seen(
        with_number(address, "id", number), identity, tuple(one.name for one in fitting), (), limits, "rad"
    )


def _profiles() -> list[MoteusProfile]:
    found = []
    for path in sorted((config_directory() / "profiles").glob("*.toml")):
        try:
            found.append(read_moteus_profile(path.stem))
        except ConfigurationError:
            continue  # of another kind of link
    return found


def _is_for(identity: dict[str, int | str], profile: MoteusProfile) -> bool:
    """The simulated controller has a model of its own; what is no such one is the general profile's."""
    wanted, model = profile.identity, int(identity["product"])
    own = {one.identity.model for one in _profiles()} - {None}
    if not wanted.map_min <= int(identity["revision"]) <= wanted.map_max:
        return False
    return model == wanted.model if model in own else wanted.model is None


def _limits(console: Console, profile: MoteusProfile) -> dict[str, float]:
    found = {}
    for name in (name for name in profile.parameters if name.startswith("limit.")):
        place = profile.parameters[name]
        try:
            value = console.number(place.at) * UNITS[place.unit]
        except TransferAborted:
            continue
        except LinkError:
            break
        if math.isfinite(value):
            found[name] = value
    return found
