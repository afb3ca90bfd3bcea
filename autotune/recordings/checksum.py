"""A checksum over what a recording says: its metadata and every value of every column.

SHA-256 of the content, not of the file: it is the same for Parquet and CSV, and a program that copies a
recording with its metadata copies it too. Parquet's own page checksums (CRC-32, in the pages' headers) find
damage in the pages earlier, but cover neither the names of the columns nor the metadata.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.recordings.recording import FLOAT_COLUMNS, Recording, Segment

KEY = "checksum"
_METHOD = "sha256:"
_AT_ONCE = 1 << 19
"""Rows that are copied at a time."""


def content_checksum(recording: Recording, pairs: Mapping[str, str]) -> str:
    """`sha256:` and 64 hexadecimal digits over `pairs` (without the checksum) and all columns.

    Numbers count as little-endian doubles and 64-bit integers; whatever the bits of a nan or the sign of a
    zero, they count alike, for CSV cannot hold the difference.
    """
    digest = ContentDigest(pairs, recording.segments(), len(recording))
    for name in FLOAT_COLUMNS:
        if name in recording:
            digest.column(name, recording[name])
    rows = range(0, len(recording), _AT_ONCE)
    return digest.ended(recording.missed[start : start + _AT_ONCE] for start in rows)


class ContentDigest:
    """The checksum of a recording whose columns come one after the other, in the order of `FLOAT_COLUMNS`."""

    def __init__(self, pairs: Mapping[str, str], segments: Sequence[Segment], rows: int) -> None:
        self._digest, self._rows = hashlib.sha256(), str(rows)
        for name in sorted(pairs):
            if name != KEY:
                _add_text(self._digest, name, pairs[name])
        for one in segments:
            _add_text(self._digest, "segment", f"{one.start} {one.stop} {one.repeat} {one.experiment}")
        _add_text(self._digest, "rows", self._rows)

    def column(self, name: str, column: Floats) -> None:
        """The next one."""
        _add_text(self._digest, name, self._rows)
        for start in range(0, len(column), _AT_ONCE):
            values = column[start : start + _AT_ONCE] + 0.0
            values[np.isnan(values)] = np.nan
            self._digest.update(np.ascontiguousarray(values, "<f8").data)

    def ended(self, missed: Iterable[NDArray[np.int64]]) -> str:
        """The checksum, after the counts of lost cycles, in parts."""
        _add_text(self._digest, "missed", self._rows)
        for part in missed:
            self._digest.update(np.ascontiguousarray(part, "<i8").data)
        return _METHOD + self._digest.hexdigest()


def _add_text(digest: hashlib._Hash, name: str, text: str) -> None:
    """With lengths, so that no two lists of texts run together to the same bytes."""
    for part in (name.encode(), text.encode()):
        digest.update(len(part).to_bytes(8, "little") + part)
