"""What a process tells those who look on: rows and notes in bounded queues, encoded for a pipe.

Nothing here waits: rows are dropped, oldest first, where nobody takes them in time. A live view feeds its
streamer with it, a worker of the service its hub.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.loop import ROW_FIELDS, Watch
from autotune.view.messages import NOTES_KEPT, RowQueue, encode_note, encode_rows
from autotune.view.pages import Page, page_to_json

ROWS_KEPT = 100_000
ROWS_A_MESSAGE = 10_000
_LABEL = ROW_FIELDS.index("label")


class Teller:
    """Takes what happens; see `tuning.observer.Observer`. One thread tells, another takes."""

    def __init__(self) -> None:
        self._queue = RowQueue(ROWS_KEPT)
        self._notes: deque[dict[str, Any]] = deque(maxlen=NOTES_KEPT)
        self._memory: dict[str, dict[str, Any]] = {}
        self._names: list[str] = []
        self._base = 0
        self._passed = 0

    def programme(self, labels: Sequence[str]) -> Watch:
        """A programme begins whose segments have these names; its rows go to what this returns."""
        self._base = len(self._names)
        self._names += [str(name) for name in labels]
        self._note({"kind": "labels", "base": 0, "names": list(self._names)})
        return self.watch

    def watch(self, rows: Floats) -> None:
        """Takes rows, shape (k, fields); never waits, drops the oldest if it must."""
        own = np.array(rows, dtype=np.float64)
        own[:, _LABEL] += self._base
        self._queue.put(own)

    def stage(self, name: str) -> None:
        """A stage begins."""
        self._note({"kind": "stage", "name": name})

    def page(self, page: Page) -> None:
        """What a stage found."""
        self._note({"kind": "page", "page": page_to_json(page)}, f"page {page.name}")

    def parameters(self, values: Mapping[str, tuple[float, float | None, str]]) -> None:
        """Present estimates: name → value, standard error, unit."""
        entries = {name: [float(v), None if e is None else float(e), u] for name, (v, e, u) in values.items()}
        self._note({"kind": "parameters", "values": entries})

    def pass_note(self, note: Mapping[str, Any]) -> None:
        """A note of another teller, as it is."""
        page = note.get("page")
        name = f"page {page.get('name')}" if isinstance(page, Mapping) else ""
        self._note(dict(note), name)

    def pass_rows(self, rows: Floats) -> None:
        """Rows of another teller, as they are."""
        self._queue.put(rows)

    def remembered(self) -> list[dict[str, Any]]:
        """The newest note of every kind, and of every page."""
        return list(self._memory.values())

    def waiting(self) -> bool:
        """Something has not been taken yet."""
        return bool(self._queue.waiting or self._notes)

    def take(self) -> bytes:
        """Encodes what waits, a message of rows at most; notes first."""
        data = b"".join(encode_note(self._notes.popleft()) for _ in range(len(self._notes)))
        blocks = self._queue.take(ROWS_A_MESSAGE)
        if blocks:
            rows = np.concatenate(blocks)
            self._passed += len(rows)
            data += encode_rows(rows)
        return data

    def _note(self, note: dict[str, Any], name: str = "") -> None:
        self._memory[name or str(note.get("kind"))] = note
        self._notes.append(note)
