"""`sim://` URLs: which simulated axis, how it is varied, what is planted, what fails and when."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from autotune.core.errors import ConfigurationError
from autotune_sim.effects import EFFECTS, check_size
from autotune_sim.presets import Preset, preset, with_dead_time
from autotune_sim.rehearsal import Agenda
from autotune_sim.unfit import unfit_axis

KEYS = ("seed", "effect", "cycle", "friction", "fault", "memory", "unfit", "truth", "dead_time")
_REPEATABLE = ("effect", "fault")
HERE = Path()


@dataclass(frozen=True, slots=True)
class SimRequest:
    """What a URL asks for: the axis, faults as (name, value, time [s]), and two files.

    `memory`: that stored parameters live in; `truth`: that what is true on the axis is logged in.
    """

    preset: Preset
    faults: tuple[tuple[str, str, float], ...]
    memory: str = ""
    truth: str = ""


def parse_sim_url(url: str, cycle: float | None = None, directory: Path = HERE) -> SimRequest:
    """Reads a `sim://` URL; `cycle` [s] is used where the URL says none.

    A composed machine's file (`sim://machines/column.toml`) is looked for from `directory` on.

    Raises:
        ConfigurationError: not such a URL, or an unknown or repeated key, or an impossible value.
    """
    parts = urlsplit(url)
    if parts.scheme != "sim":
        raise ConfigurationError(
            f"link {url!r} is not a simulated axis; write, for example, sim://edm-vertical"
        )
    values: dict[str, list[str]] = {}
    for key, value in parse_qsl(parts.query, keep_blank_values=True):
        _check_key(url, key, key in values)
        values.setdefault(key, []).append(value)
    effects = dict(_effect(url, text) for text in values.get("effect", []))
    if "friction" in values:
        effects["friction"] = _number(url, "friction", values["friction"][0])
    seed = _number(url, "seed", values.get("seed", ["0"])[0])
    if seed != int(seed):
        raise ConfigurationError(f"link {url!r}: seed is {seed}; it must be a whole number, 0 for nominal")
    axis = preset(_name(parts.netloc + parts.path, directory), int(seed), effects)
    if "cycle" in values:
        cycle = _number(url, "cycle", values["cycle"][0])
    faults = tuple(_fault(url, text) for text in values.get("fault", []))
    if "unfit" in values:
        axis, lasting = _unfit(url, axis, values["unfit"][0])
        faults += lasting
    memory, truth = values.get("memory", [""])[0], values.get("truth", [""])[0]
    axis = axis if cycle is None else replace(axis, period=cycle)
    if "dead_time" in values:
        axis = with_dead_time(axis, _number(url, "dead_time", values["dead_time"][0]))
    return SimRequest(axis, faults, memory, truth)


def parse_effects(texts: Sequence[str]) -> dict[str, float]:
    """`NAME` or `NAME:SIZE` → size; without a size the default one.

    Raises:
        ConfigurationError: an unknown effect or an impossible size.
    """
    return dict(_effect("effects", text) for text in texts)


def _name(text: str, directory: Path) -> str:
    return str(directory / text) if text.endswith(".toml") else text.strip("/")


def _check_key(url: str, key: str, again: bool) -> None:
    if key not in KEYS:
        near = difflib.get_close_matches(key, KEYS, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(KEYS)}"
        raise ConfigurationError(f"link {url!r} has an unknown key {key!r}; {hint}")
    if again and key not in _REPEATABLE:
        raise ConfigurationError(f"link {url!r} has the key {key!r} twice; give it once")


def _effect(url: str, text: str) -> tuple[str, float]:
    name, separator, size = text.partition(":")
    if name in EFFECTS and not separator:
        return name, EFFECTS[name].default
    value = _number(url, f"effect {name}", size) if separator else 1.0
    check_size(name, value)
    return name, value


def _fault(url: str, text: str) -> tuple[str, str, float]:
    order, separator, time = text.partition("@")
    name, _, value = order.partition("=")
    at = _number(url, f"fault {name}", time) if separator else 0.0
    Agenda().add(name, at, value)
    return name, value, at


def _unfit(url: str, axis: Preset, text: str) -> tuple[Preset, tuple[tuple[str, str, float], ...]]:
    name, separator, size = text.partition(":")
    return unfit_axis(axis, name, _number(url, f"unfit {name}", size) if separator else None)


def _number(url: str, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ConfigurationError(f"link {url!r}: {key} is {text!r}; it must be a number") from None
