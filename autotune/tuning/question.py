"""What a diagnosis leaves open: the effects that the next recording has to tell apart."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from autotune.core.documents import parse_json, read_limited
from autotune.core.errors import ConfigurationError
from autotune.models.table import EFFECTS

NEAR = 0.5
"""Part of the best candidate's gain from which others count as possible where nothing is named."""
MOST = 3
VERDICTS = ("named", "none", "unknown", "ambiguous")


def question_in(path: Path) -> tuple[str, ...]:
    """The effects that a diagnosis file leaves in doubt, the likeliest first; none where it knows none.

    Args:
        path: what `autotune model diagnose --json` printed, or a run's `run.json`.

    Raises:
        ConfigurationError: no such file, no diagnosis in it, or one that leaves nothing open.
    """
    try:
        content = parse_json(read_limited(path))
    except OSError as error:
        raise ConfigurationError(f"--from {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise ConfigurationError(f"--from {path} is no diagnosis: {error}; {_HOW}") from error
    found = content.get("diagnosis", content) if isinstance(content, dict) else None
    if not isinstance(found, dict) or found.get("verdict") is None:
        raise ConfigurationError(f"--from {path} is no diagnosis: it holds no 'verdict'; {_HOW}")
    if found["verdict"] not in VERDICTS:
        raise ConfigurationError(
            f"--from {path} is damaged: its verdict is {found['verdict']!r}, not one of {', '.join(VERDICTS)}; {_HOW}"
        )
    try:
        rivals = rivals_of(found)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise ConfigurationError(f"--from {path} is damaged: {error}; {_HOW}") from error
    if rivals is None:
        raise ConfigurationError(
            f"--from {path}: its verdict is {found['verdict']!r}"
            + (
                f" ({', '.join(found.get('effects') or [])}, confirmed)"
                if found["verdict"] == "named"
                else ""
            )
            + "; nothing is in doubt that another recording would have to decide"
        )
    return rivals


_HOW = "it is written by 'autotune model diagnose RECORDING… --model MODEL.toml --json > diagnosis.json'"


def rivals_of(diagnosis: Mapping[str, Any]) -> tuple[str, ...] | None:
    """The effects in doubt, the likeliest first; empty where nothing is known of them, None where nothing is open.

    Args:
        diagnosis: as in `diagnose --json`.
    """
    verdict = diagnosis["verdict"]
    if verdict == "none" or (verdict == "named" and diagnosis.get("confidence") == "confirmed"):
        return None
    named = _effects(diagnosis.get("effects") or [])
    if verdict == "unknown":
        return _near_best(diagnosis.get("candidates") or [])
    doubted = [name for rivals in diagnosis.get("confusable") or [] for name in _effects(rivals)]
    return tuple(dict.fromkeys([*named, *doubted]))


def _near_best(candidates: list[Mapping[str, Any]]) -> tuple[str, ...]:
    gains = {str(one["effect"]): float(one["gain"]) for one in candidates}
    best = max(gains.values(), default=0.0)
    near = sorted((name for name in gains if gains[name] >= NEAR * best > 0.0), key=lambda name: -gains[name])
    return _effects(near[:MOST])


def _effects(names: list[str]) -> tuple[str, ...]:
    for name in names:
        if name not in EFFECTS:
            raise ValueError(f"there is no effect {str(name)[:40]!r}")
    return tuple(names)
