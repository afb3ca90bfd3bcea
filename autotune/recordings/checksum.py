"""A checksum over what a recording says: its metadata and every value of every column.

SHA-256 of the content, not of the file: it is the same for Parquet and CSV, and a program that copies a
recording with its metadata copies it too. Parquet's own page checksums (CRC-32, in the pages' headers) find
damage in the pages earlier, but cover neither the names of the columns nor the metadata.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np

from autotune.recordings.recording import FLOAT_COLUMNS, Recording

KEY = "checksum"
_METHOD = "sha256:"
_AT_ONCE = 1 << 19
"""Rows that are copied at a time."""


def content_checksum(recording: Recording, pairs: Mapping[str, str]) -> str:
    """`sha256:` and 64 hexadecimal digits over `pairs` (without the checksum) and all columns.

    Numbers count as little-endian doubles and 64-bit integers; whatever the bits of a nan or the sign of a
    zero, they count alike, for CSV cannot hold the difference.
    """
    digest = hashlib.sha256()
    for name in sorted(pairs):
        if name != KEY:
            _add_text(digest, name, pairs[name])
    for segment in recording.segments():
        _add_text(digest, "segment", f"{segment.start} {segment.stop} {segment.repeat} {segment.experiment}")
    _add_text(digest, "rows", str(len(recording)))
    for name in FLOAT_COLUMNS:
        if name in recording:
            _add_text(digest, name, str(len(recording)))
            for start in range(0, len(recording), _AT_ONCE):
                values = recording[name][start : start + _AT_ONCE] + 0.0
                values[np.isnan(values)] = np.nan
                digest.update(np.ascontiguousarray(values, "<f8").data)
    _add_text(digest, "missed", str(len(recording)))
    for start in range(0, len(recording), _AT_ONCE):
        digest.update(np.ascontiguousarray(recording.missed[start : start + _AT_ONCE], "<i8").data)
    return _METHOD + digest.hexdigest()


def _add_text(digest: hashlib._Hash, name: str, text: str) -> None:
    """With lengths, so that no two lists of texts run together to the same bytes."""
    for part in (name.encode(), text.encode()):
        digest.update(len(part).to_bytes(8, "little") + part)
