"""What a Rerun file's own blueprint shows, and whether there are data behind every view of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

FRAME = ("grid", "axes", "labels", "names", "legend", "mark", "band")
"""What is drawn round the data, and is no data."""


@dataclass(frozen=True)
class View:
    """One view of the blueprint."""

    name: str
    kind: str
    origin: str
    query: tuple[str, ...]


def views_of(path: Path) -> list[View]:
    """All views of the file's blueprint."""
    from rerun.chunk import RrdReader

    reader = RrdReader(str(path))
    found: dict[str, dict[str, Any]] = {}
    for store in reader.blueprints():
        for chunk in reader.stream(store=store):
            parts = str(chunk.entity_path).strip("/").split("/")
            if parts[0] == "view":
                batch = chunk.to_record_batch()
                values = {
                    name: batch.column(name).to_pylist()[-1] for name in batch.schema.names if ":" in name
                }
                found.setdefault(parts[1], {}).update(values)
    return [
        View(
            str((one.get("ViewBlueprint:display_name") or [""])[0]),
            str(one["ViewBlueprint:class_identifier"][0]),
            "/" + str(one["ViewBlueprint:space_origin"][0]).strip("/"),
            tuple(one.get("ViewContents:query") or ()),
        )
        for one in found.values()
        if "ViewBlueprint:class_identifier" in one
    ]


def data_of(path: Path) -> dict[str, dict[str, list[Any]]]:
    """All values of the recording, by entity and component."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        entity = found.setdefault(str(chunk.entity_path), {})
        for name in batch.schema.names:
            if ":" in name:
                entity.setdefault(name, []).extend(batch.column(name).to_pylist())
    return found


def empty_views(path: Path) -> list[str]:
    """Names of the views that have nothing to show."""
    data = data_of(path)
    return [view.name for view in views_of(path) if not _filled(view, data)]


def _filled(view: View, data: dict[str, dict[str, list[Any]]]) -> bool:
    assert view.query == ("$origin/**",), f"{view.name} asks for {view.query}"
    inside = {
        entity: components
        for entity, components in data.items()
        if entity == view.origin or entity.startswith(view.origin + "/")
    }
    if view.kind == "TimeSeries":
        return any(_numbers(one, "Scalars:scalars", "Measurements:values") > 1 for one in inside.values())
    if view.kind == "2D":
        drawn = [one for entity, one in inside.items() if entity.rpartition("/")[2] not in FRAME]
        return any(_items(one, "LineStrips2D:strips", "Points2D:positions") > 0 for one in drawn)
    if view.kind == "StateTimeline":
        return any(_items(one, "StateChange:state") > 0 for one in inside.values())
    assert view.kind == "TextDocument", view.kind
    texts = [
        text for one in inside.values() for row in one.get("TextDocument:text", []) for text in row or []
    ]
    return any(str(text).strip() for text in texts)


def _numbers(components: dict[str, list[Any]], *names: str) -> int:
    rows = [row for name in names for row in components.get(name, []) if row]
    return int(sum(np.isfinite(np.array(row, dtype=float)).any() for row in rows))


def _items(components: dict[str, list[Any]], *names: str) -> int:
    return sum(len(row) for name in names for row in components.get(name, []) if row)
