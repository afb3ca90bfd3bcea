"""TOML files read strictly: an unknown key is an error that names the nearest right one."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from autotune.core.documents import parse_toml, read_limited
from autotune.core.errors import ConfigurationError

Model = TypeVar("Model", bound=BaseModel)
MOST_BYTES = 4_000_000
"""Of a TOML file; the longest, a model with every effect and a long history, has 200 kB."""
_KINDS = {
    "axis file": {"link", "mechanics", "limits"},
    "model": {"inertia", "coulomb", "stiffness"},
    "service file": {"runs", "axes"},
}
"""Keys by which a file is seen to be of another kind than the one asked for."""
_SHOWN = 80
_MOST_PROBLEMS = 20
_TYPED = 0.75  # likeness of a name and a slip of it; below, what is near may be another thing


class Strict(BaseModel):
    """Base of every configuration section: frozen, no unknown keys, no silent conversions."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def read_toml(path: str | Path, kind: str) -> dict[str, Any]:
    """Reads a TOML file; `kind` says in errors what it should have been.

    Raises:
        ConfigurationError: no such file, of another kind, not TOML, too large, too deep, or with numbers that are
            not finite.
    """
    path = Path(path)
    try:
        data = parse_toml(read_limited(path, MOST_BYTES))
    except FileNotFoundError:
        raise ConfigurationError(f"there is no {kind} {path}; check the name{_neighbours(path)}") from None
    except IsADirectoryError:
        raise ConfigurationError(f"{path} is a folder; name the {kind} itself") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{kind} {path} cannot be read: {error}") from error
    except ValueError as error:
        raise ConfigurationError(f"{kind} {path} is not valid TOML: {_shortened(str(error), 200)}") from error
    return _of_kind(data, kind, path)


def _of_kind(data: dict[str, Any], kind: str, path: Path) -> dict[str, Any]:
    """The data, unless they are plainly of another kind."""
    own = _KINDS.get(kind)
    if own is None or own & data.keys():
        return data
    for other, marks in _KINDS.items():
        if marks <= data.keys():
            article = "an" if other.startswith("a") else "a"
            raise ConfigurationError(
                f"{path} is {article} {other}, as its keys {', '.join(sorted(marks))} say; name the {kind} here"
            )
    return data


def validate(model: type[Model], data: dict[str, Any], where: str) -> Model:
    """Builds `model` from `data`.

    Raises:
        ConfigurationError: every problem on a line of its own, unknown keys with the nearest right one.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problems = error.errors()
        lines = [_sentence(model, problem) for problem in problems[:_MOST_PROBLEMS]]
        if len(problems) > len(lines):
            lines.append(f"and {len(problems) - len(lines)} more")
        raise ConfigurationError(f"{where}: " + "; ".join(lines)) from error


def _neighbours(path: Path) -> str:
    if not path.parent.is_dir():
        return ""
    names = [entry.name for entry in path.parent.iterdir() if entry.suffix == path.suffix]
    near = difflib.get_close_matches(path.name, names, 1)
    return f" (there is {path.with_name(near[0])})" if near else ""


def _sentence(model: type[BaseModel], problem: Any) -> str:
    location = [_shortened(str(part)) for part in problem["loc"]]
    key = ".".join(location)
    if problem["type"] == "extra_forbidden":
        known = _keys(model, location[:-1])
        near = difflib.get_close_matches(location[-1], known, 1)
        hint = f"did you mean {near[0]!r}?" if near else ""
        slips = difflib.get_close_matches(location[-1], near, cutoff=_TYPED)
        if not slips:  # near in words at most
            hint = f"{hint} known are {', '.join(sorted(known))}".lstrip()
        return f"unknown key {key!r}; {hint}"
    if problem["type"] == "missing":
        return f"key {key!r} is missing; it must be set"
    given, wrong = _shortened(repr(problem.get("input"))), problem["msg"]
    return f"{key or 'file'} is {given}: {wrong[0].lower()}{wrong[1:]}"


def _shortened(text: str, most: int = _SHOWN) -> str:
    """As much of what stands in a file as a sentence can hold, without what a terminal would obey."""
    shown = "".join(letter if letter.isprintable() else "?" for letter in text[:most])
    return shown + "…" if len(text) > most else shown


def _keys(model: type[BaseModel], location: list[str]) -> list[str]:
    current: Any = model
    for part in location:
        if part.isdigit():  # of a list, whose entries are what the list was declared to hold
            continue
        field = current.model_fields.get(part) if hasattr(current, "model_fields") else None
        annotation = field.annotation if field else None
        candidates = [annotation, *getattr(annotation, "__args__", ())]
        current = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)
        if current is None:
            return []
    return [field.alias or name for name, field in current.model_fields.items()]
