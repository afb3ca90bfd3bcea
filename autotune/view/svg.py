"""Before and after as a small picture without a browser, for README and mail: SVG written by hand.

Reference on top, period-averaged error with its spread over the repeats below (figure 6.17).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

import numpy as np

from autotune.core.arrays import Floats
from autotune.view.colours import AFTER, BEFORE, GOOD, GRID, INK, MUTED, REFERENCE
from autotune.view.data import BeforeAfter
from autotune.view.plane import ticks
from autotune.view.scale import multiple, peak, quantity, significant, thin

WIDTH, HEIGHT = 820, 460


class _Panel(NamedTuple):
    """A rectangle with its ranges; maps data to pixels."""

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    def px(self, x: float) -> float:
        return self.left + (x - self.x[0]) / (self.x[1] - self.x[0]) * self.width

    def py(self, y: float) -> float:
        return self.top + (self.y[1] - y) / (self.y[1] - self.y[0]) * self.height

    def points(self, x: Floats, y: Floats) -> str:
        return " ".join(f"{self.px(a):.1f},{self.py(b):.1f}" for a, b in zip(x, y, strict=True))


def before_after_svg(data: BeforeAfter, title: str = "") -> str:
    """The picture as SVG text; white background, no scripts, no external fonts."""
    before, after = np.atleast_2d(data.before), np.atleast_2d(data.after)
    alone = np.atleast_2d(data.committed) if data.committed is not None else None
    factor, unit = multiple(peak(before, after), data.motion_unit)
    reference_factor, reference_unit = multiple(peak(data.reference), data.motion_unit)
    span = _range(data.time, 0.0)
    upper = _Panel(78, 74, 720, 78, span, _range(data.reference * reference_factor, 0.08))
    lower = _Panel(78, 176, 720, 232, span, _range(np.vstack([before, after]) * factor, 0.08))
    parts = [
        _text(78, 28, title or "Tracking error over one period of the benchmark", 17, INK, weight=600),
        *_legend(data, factor, unit),
        *_axes(upper, reference_unit, "reference", bottom=False),
        *_axes(lower, unit, "error", bottom=True),
        *_count(lower, data, factor),
        _line(upper, data.time, data.reference * reference_factor, REFERENCE),
        *_error(lower, data.time, before * factor, BEFORE),
        *(_error(lower, data.time, alone * factor, GOOD) if alone is not None else ()),
        *_error(lower, data.time, after * factor, AFTER),
    ]
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}" role="img" font-family="system-ui, Segoe UI, Helvetica, Arial, sans-serif">\n'
        f"<title>{escape(title or 'Before and after')}</title>\n"
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>\n{body}\n</svg>\n'
    )


def _range(values: Floats, margin: float) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    if not high > low:
        low, high = low - 0.5, high + 0.5
    return low - margin * (high - low), high + margin * (high - low)


def _axes(panel: _Panel, unit: str, name: str, *, bottom: bool) -> list[str]:
    right, base = panel.left + panel.width, panel.top + panel.height
    parts = []
    for y in ticks(*panel.y, count=7 if bottom else 4):
        parts.append(_rule(panel.left, panel.py(y), right, panel.py(y), GRID))
        parts.append(_text(panel.left - 8, panel.py(y) + 4, _number(y), 12, MUTED, anchor="end"))
    for x in ticks(*panel.x, count=10):
        parts.append(_rule(panel.px(x), panel.top, panel.px(x), base, GRID))
        if bottom:
            parts.append(_text(panel.px(x), base + 18, _number(x), 12, MUTED, anchor="middle"))
    parts.append(_rule(panel.left, base, right, base, MUTED))
    parts.append(_rule(panel.left, panel.top, panel.left, base, MUTED))
    middle = panel.top + panel.height / 2
    parts.append(
        f'<text x="20" y="{middle:.1f}" transform="rotate(-90 20 {middle:.1f})" text-anchor="middle" '
        f'font-size="13" fill="{INK}">{name} [{unit}]</text>'
    )
    if bottom:
        parts.append(
            _text(panel.left + panel.width / 2, base + 38, "time in the period [s]", 13, INK, "middle")
        )
    return parts


def _error(panel: _Panel, time: Floats, errors: Floats, colour: str) -> list[str]:
    mean = errors.mean(axis=0)
    parts = []
    if len(errors) > 1:
        rows = thin(mean, 300)
        outline = panel.points(
            np.concatenate([time[rows], time[rows][::-1]]),
            np.concatenate([errors.max(axis=0)[rows], errors.min(axis=0)[rows][::-1]]),
        )
        parts.append(f'<polygon points="{outline}" fill="{colour}" fill-opacity="0.22"/>')
    return [*parts, _line(panel, time, mean, colour)]


def _line(panel: _Panel, x: Floats, y: Floats, colour: str) -> str:
    rows = thin(y, 600)
    points = panel.points(x[rows], y[rows])
    style = f'fill="none" stroke="{colour}" stroke-width="2" stroke-linejoin="round"'
    return f'<polyline points="{points}" {style}/>'


def _legend(data: BeforeAfter, factor: float, unit: str) -> list[str]:
    """What is in the drive stands before what a host plays."""
    parts, x = [], 78.0
    for errors, name, colour in (
        (data.before, data.before_name, BEFORE),
        (data.committed, data.committed_name, GOOD),
        (data.after, data.after_name, AFTER),
    ):
        if errors is None:
            continue
        text = f"{name}: peak {significant(peak(np.atleast_2d(errors).mean(axis=0) * factor))} {unit}"
        parts.append(f'<rect x="{x:.0f}" y="45" width="22" height="4" rx="2" fill="{colour}"/>')
        parts.append(_text(x + 30, 52, text, 13, INK))
        x += 50 + 6.6 * len(text)
    return parts


def _count(panel: _Panel, data: BeforeAfter, factor: float) -> Sequence[str]:
    if not data.resolution or not math.isfinite(data.resolution):
        return ()
    count = data.resolution * factor
    top, bottom = panel.py(min(count, panel.y[1])), panel.py(max(-count, panel.y[0]))
    right = panel.left + panel.width
    label = f"± one encoder count ({quantity(data.resolution, data.motion_unit)})"
    return (
        f'<rect x="{panel.left}" y="{top:.1f}" width="{panel.width}" height="{bottom - top:.1f}" '
        f'fill="{MUTED}" fill-opacity="0.2"/>',
        _text(right - 4, top - 5, label, 12, MUTED, anchor="end"),
    )


def _rule(x0: float, y0: float, x1: float, y1: float, colour: str) -> str:
    return f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{colour}"/>'


def _text(
    x: float, y: float, text: str, size: int, colour: str, anchor: str = "start", weight: int = 400
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" font-weight="{weight}" fill="{colour}" '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )


def _number(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")
