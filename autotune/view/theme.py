"""One look for every figure: light, quiet, safe for colour-blind readers, and legible on paper.

Colours: see `autotune.view.colours`.
"""

from __future__ import annotations

import plotly.graph_objects as go

from autotune.view.colours import (
    ACCENT,
    AFTER,
    BEFORE,
    GOOD,
    GRID,
    INK,
    MEASURED,
    MODEL,
    MUTED,
    REFERENCE,
    SERIES,
)

__all__ = [
    "ACCENT", "AFTER", "BEFORE", "GOOD", "GRID", "INK", "MEASURED", "MODEL", "MUTED", "REFERENCE",
    "SERIES", "finish", "template", "translucent",
]  # fmt: skip

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def translucent(colour: str, alpha: float) -> str:
    """`#rrggbb` as `rgba(…)`."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{alpha})"


def template() -> go.layout.Template:
    """The theme as a plotly template."""
    axis = {
        "gridcolor": GRID,
        "linecolor": MUTED,
        "showline": True,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": MUTED,
        "zerolinecolor": "#c3cad4",
        "zerolinewidth": 1,
        "automargin": True,
        "exponentformat": "power",
        "title": {"standoff": 10, "font": {"size": 13}},
    }
    return go.layout.Template(
        layout={
            "font": {"family": FONT, "size": 13, "color": INK},
            "paper_bgcolor": "white",
            "plot_bgcolor": "white",
            "colorway": SERIES,
            "hovermode": "closest",
            "hoverlabel": {"align": "left"},
            "margin": {"l": 64, "r": 24, "t": 36, "b": 52},
            "legend": {"orientation": "h", "x": 0, "y": 1.02, "xanchor": "left", "yanchor": "bottom"},
            "xaxis": axis,
            "yaxis": axis,
            "annotationdefaults": {"font": {"size": 12, "color": MUTED}, "arrowcolor": MUTED},
        }
    )


def finish(figure: go.Figure, height: int = 400) -> go.Figure:
    """Puts the theme on a figure and returns it."""
    figure.update_layout(template=template(), height=height)
    return figure
