"""What a page of the Rerun viewer shows, as plain data: plots over time, charts, bars, words.

A page is made where the numbers are (a stage of a run, a comparison, a diagnosis) and drawn elsewhere: in a
file, or by the streamer of a live view, which it reaches as JSON. What has no data is left out when a page is
made, so that no panel can stay empty.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np

from autotune.core.arrays import Floats

RUN = "run"
"""The page of the traces, which every run has from its first sample."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A line.

    Attributes:
        x, y: shape (n,); gaps are nan.
        spread: half width of its band, shape (n,); None without.
        dots: as single points.
        guide: a bound or a floor, no data: alone it is nothing to show.
    """

    name: str
    colour: str
    x: Floats
    y: Floats
    spread: Floats | None = None
    dots: bool = False
    guide: bool = False


@dataclass(frozen=True, slots=True)
class TimePlot:
    """Curves over time [s]. `period`: the time is that within a period."""

    title: str
    curves: tuple[Curve, ...]

    @property
    def filled(self) -> bool:
        return any(_drawable(curve) for curve in self.curves)


@dataclass(frozen=True, slots=True)
class Chart:
    """Curves over any coordinate. `band`: half width of a band about zero, None without."""

    title: str
    x_name: str
    y_name: str
    curves: tuple[Curve, ...]
    band: float | None = None

    @property
    def filled(self) -> bool:
        return any(_drawable(curve) for curve in self.curves)


@dataclass(frozen=True, slots=True)
class Bar:
    """One bar; `text` is written at its end."""

    name: str
    value: float
    colour: str
    text: str = ""


@dataclass(frozen=True, slots=True)
class Bars:
    """Horizontal bars with their names. `unit` of their common scale; `mark`: drawn across all, None without."""

    title: str
    unit: str
    bars: tuple[Bar, ...]
    mark: float | None = None

    @property
    def filled(self) -> bool:
        return any(np.isfinite(bar.value) for bar in self.bars)


@dataclass(frozen=True, slots=True)
class Words:
    """Text as Markdown."""

    title: str
    markdown: str

    @property
    def filled(self) -> bool:
        return bool(self.markdown.strip())


Panel = TimePlot | Chart | Bars | Words
_KINDS: dict[str, type] = {kind.__name__: kind for kind in (TimePlot, Chart, Bars, Words)}


@dataclass(frozen=True, slots=True)
class Page:
    """One tab of the viewer.

    Attributes:
        name: of the stage; `title`: of its tab.
        columns: panels from the top, column by column.
        shares: widths of the columns.
    """

    name: str
    title: str
    columns: tuple[tuple[Panel, ...], ...]
    shares: tuple[float, ...] = field(default=())

    @classmethod
    def of(
        cls, name: str, title: str, *columns: Iterable[Panel | None], shares: Sequence[float] = ()
    ) -> Page:
        """A page without the panels, and columns, that have nothing to show."""
        kept, widths = [], []
        for index, column in enumerate(columns):
            panels = tuple(panel for panel in column if panel is not None and panel.filled)
            if panels:
                kept.append(panels)
                widths.append(float(shares[index]) if shares else 1.0)
        return cls(name, title, tuple(kept), tuple(widths))

    @property
    def filled(self) -> bool:
        """There is something to see."""
        return bool(self.columns)

    def panels(self) -> list[tuple[str, Panel]]:
        """All panels, each with the entity below which its data are."""
        return [
            (f"pages/{self.name}/{c}_{r}", panel)
            for c, column in enumerate(self.columns)
            for r, panel in enumerate(column)
        ]


def page_to_json(page: Page) -> dict[str, Any]:
    """As JSON takes it."""
    return {
        "name": page.name,
        "title": page.title,
        "shares": list(page.shares),
        "columns": [[_plain(panel) for panel in column] for column in page.columns],
    }


def page_from_json(content: Mapping[str, Any]) -> Page:
    """The reverse of `page_to_json`."""
    columns = tuple(tuple(_panel(one) for one in column) for column in content["columns"])
    return Page(str(content["name"]), str(content["title"]), columns, tuple(content["shares"]))


def _drawable(curve: Curve) -> bool:
    if curve.guide:
        return False
    return bool(np.count_nonzero(np.isfinite(curve.x) & np.isfinite(curve.y)) > (0 if curve.dots else 1))


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        found = {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
        return {"kind": type(value).__name__, **found} if type(value).__name__ in _KINDS else found
    if isinstance(value, np.ndarray):
        return [None if number != number else number for number in value.astype(np.float64).tolist()]
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value


def _panel(content: Mapping[str, Any]) -> Panel:
    values = dict(content)
    kind = _KINDS[values.pop("kind")]
    if "curves" in values:
        values["curves"] = tuple(_curve(one) for one in values["curves"])
    if "bars" in values:
        values["bars"] = tuple(Bar(**one) for one in values["bars"])
    panel: Panel = kind(**values)
    return panel


def _curve(content: Mapping[str, Any]) -> Curve:
    arrays = {
        name: None if content[name] is None else np.array(content[name], dtype=np.float64)
        for name in ("x", "y", "spread")
    }
    return Curve(**{**content, **arrays})
