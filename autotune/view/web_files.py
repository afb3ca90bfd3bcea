"""Files of the pages, from the package: what they are, and what a browser is allowed to do with them."""

from __future__ import annotations

import re
from importlib.resources import files

NAME = re.compile(r"[a-z0-9_-]+\.(?:js|css|svg)|vendor/[A-Za-z0-9_.-]+\.(?:js|css)")
TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
REPORT_HEADERS = HEADERS | {"Content-Security-Policy": "sandbox allow-scripts allow-modals allow-downloads"}
"""A report has its scripts in itself; in a sandbox it shares nothing with the pages, no token either."""


def web_file(name: str) -> tuple[bytes, str] | None:
    """Content and media type of a page's file; None where there is none of that name."""
    if not (NAME.fullmatch(name) or name in ("workbench.html", "service.html", "docs.html")):
        return None
    path = files("autotune.view") / "web" / name
    if not path.is_file():
        return None
    return path.read_bytes(), TYPES[name.rpartition(".")[2]]


def plotly_script() -> str:
    """plotly's basic bundle (lines and bars): a quarter of the whole one, which a report has in itself."""
    path = files("autotune.view") / "web" / "vendor" / "plotly-basic.min.js"
    return path.read_text(encoding="utf-8")
