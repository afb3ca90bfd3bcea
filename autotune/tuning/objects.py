"""Where a drive keeps a parameter, for people: the object number or the configuration name of its profile."""

from __future__ import annotations

from autotune.core.configuration import read_toml
from autotune.core.errors import ConfigurationError


def objects_of(profile: str) -> dict[str, str]:
    """`2100:02` (or a name, on drives without numbers) of each parameter; empty where the profile cannot be read."""
    from autotune_drivers.profile import profile_path

    try:
        parameters = read_toml(profile_path(profile), "profile").get("parameters", {})
    except ConfigurationError:
        return {}
    return {name: str(one["at"]).split()[0] for name, one in parameters.items() if "at" in one}
