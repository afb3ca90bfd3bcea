"""What a fit found out about the drive's loop, beside the model's file: the next command need not look for it again.

Which law a drive's loop has is looked for in the recordings, and told by twins of the model: half of a diagnosis behind
a cascade. `autotune model fit --out MODEL.toml` leaves what it found in `MODEL.laws.json`, and `compare`, `diagnose`
and `add` with that model take it up. It may be deleted at any time: everything is found again then.

Nothing in it is believed because of where it lies. It holds answers to questions, each by a digest of all that was
asked: the columns and rows that a law is found in, the policy, and, where a twin told, the model's parameters. So is
the error that the fit stated of its model, with which a diagnosis begins. A question that differs in a bit has no
answer there. The whole file is left aside where its recordings are others in any value, row, unit or known setting,
where it was written by other code or with other numeric libraries, or where a byte of it has changed (checksum).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
import scipy

import autotune
from autotune.core.documents import finite
from autotune.core.durable import read_checked, write_checked
from autotune.core.errors import ConfigurationError
from autotune.core.kernel_cache import digest
from autotune.diagnosis.compare import STATED
from autotune.estimation.controller import KNOWN_LAWS
from autotune.estimation.controller_law import PositionController
from autotune.estimation.controller_unsaid import KNOWN_FED, KNOWN_FILTERS
from autotune.estimation.disturbance import Disturbance
from autotune.estimation.model_error import TOLD_LAWS
from autotune.recordings.checksum import content_checksum
from autotune.recordings.recording import Recording

SCHEMA = 3
ENDING = ".laws.json"
Made = TypeVar("Made", PositionController, Disturbance)


def keep_laws(model: Path, recordings: Sequence[Recording]) -> None:
    """Writes what this process has found out about the loops of `recordings` beside a model's file, where it can."""
    laws = {mark: [_values(law) for law in found] for mark, found in KNOWN_LAWS.answers().items()}
    told = {mark: [_values(law), _values(by)] for mark, (law, by) in TOLD_LAWS.answers().items()}
    unfed = [mark for mark, column in KNOWN_FED.answers().items() if column is None]
    filters = KNOWN_FILTERS.answers()
    stated = {mark: error for mark, error in STATED.answers().items() if all(map(math.isfinite, error))}
    about = {"schema": SCHEMA, "code": _code(), "recordings": _content(recordings)}
    answers = {
        "laws": laws,
        "told": told,
        "set_point_filters": filters,
        "feeds_no_friction": unfed,
        "stated": stated,
    }
    with suppress(OSError):  # a full disk costs the next command time, and this one not its answer
        write_checked(model.with_suffix(ENDING), finite(about | answers))


def take_laws(model: Path, recordings: Sequence[Recording]) -> bool:
    """Takes up what lies beside a model's file; whether it is of these recordings and of this code."""
    content: dict[str, Any] = {}
    with suppress(ConfigurationError):
        content = read_checked(model.with_suffix(ENDING), "file of laws")
    about = content.get("schema"), content.get("code"), content.get("recordings")
    if about != (SCHEMA, _code(), _content(recordings)):
        return False
    try:
        laws = {
            mark: tuple(_made(PositionController, one) for one in found)
            for mark, found in content["laws"].items()
        }
        told = {
            mark: (_made(PositionController, law), _made(Disturbance, by))
            for mark, (law, by) in content["told"].items()
        }
        filters = {
            mark: found and (int(found[0]), float(found[1]))
            for mark, found in content["set_point_filters"].items()
        }
        unfed = {str(mark): None for mark in content["feeds_no_friction"]}
        stated = {mark: (float(rms), float(share)) for mark, (rms, share) in content["stated"].items()}
    except (AttributeError, KeyError, TypeError, ValueError):
        return False
    KNOWN_LAWS.told(laws)
    TOLD_LAWS.told(told)
    KNOWN_FILTERS.told(filters)
    KNOWN_FED.told(unfed)
    STATED.told(stated)
    return True


def _values(made: PositionController | Disturbance) -> dict[str, Any]:
    """By name, as Python's own numbers."""
    values = asdict(made).items()
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in values}


def _made(kind: type[Made], values: Mapping[str, Any]) -> Made:
    """A law or a disturbance of what JSON has of it: whole, and of values of the same kinds."""
    usual = kind()
    if set(values) != {one.name for one in fields(kind)}:
        raise ValueError(f"a {kind.__name__} has other values")
    read: dict[str, Any] = {name: math.nan if value is None else value for name, value in values.items()}
    if any(type(value) is not type(getattr(usual, name)) for name, value in read.items()):
        raise ValueError(f"a {kind.__name__} has values of other kinds")
    return replace(usual, **read)


@cache
def _code() -> str:
    """What tells the code apart by which laws are found: every module's content, and the numeric libraries."""
    root = Path(autotune.__file__).parent
    versions = f"{autotune.__version__} {np.__version__} {scipy.__version__} {numba.__version__}"
    whole = hashlib.sha256(versions.encode())
    for file in sorted(root.rglob("*.py")):
        whole.update(file.relative_to(root).as_posix().encode() + digest(file))
    return whole.hexdigest()


def _content(recordings: Sequence[Recording]) -> str:
    """What tells recordings apart: every value, every row's experiment, and all that is known about them."""
    known = (repr(replace(one.metadata, remarks=())) for one in recordings)
    return " ".join(content_checksum(one, {"known": of}) for one, of in zip(recordings, known, strict=True))
