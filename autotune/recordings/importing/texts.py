"""Columns of texts, kept as numbers: a label that comes a million times is kept once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from autotune.core.arrays import Floats


@dataclass(frozen=True, slots=True)
class Labels:
    """Which experiment each row belongs to.

    Attributes:
        codes: shape (n,), whole numbers that stand for `names`.
        names: as the file has them; empty where it says nothing.
    """

    codes: Floats
    names: tuple[str, ...]


@dataclass(slots=True)
class Coding:
    """Arrow texts, part by part, as numbers: a label that comes a million times is kept once."""

    _codes: dict[str, int] = field(default_factory=dict)
    _parts: list[Floats] = field(default_factory=list)

    def add(self, part: Any) -> None:
        """The next rows.

        Raises: pa.ArrowException where they are no texts.
        """
        if not pa.types.is_dictionary(part.type):
            part = part.cast(pa.string()).dictionary_encode()
        known = [str(name or "").strip() for name in part.dictionary.to_pylist()]
        whole = np.array([self._codes.setdefault(name, len(self._codes)) for name in known], dtype=np.float64)
        indices = np.asarray(part.indices.fill_null(-1).to_numpy(zero_copy_only=False))
        codes = np.append(whole, np.nan)[indices]
        if len(codes) and np.isnan(codes).any():
            codes[np.isnan(codes)] = self._codes.setdefault("", len(self._codes))
        self._parts.append(codes)

    def whole(self) -> Labels:
        """All rows."""
        return Labels(np.concatenate([np.empty(0), *self._parts]), tuple(self._codes))
